//! The maps of remote participants: `peers`, which the layer has accepted, and `strangers`, which only the kernel knows.
//!
//! The kernel changes entries in place while rtpsd replaces them as a whole, so what it writes in between may be lost.
//! That costs a repetition: a sample that is handed over twice, an answer that is sent twice.

use std::collections::BTreeSet;
use std::net::IpAddr;
use std::time::Duration;

use anyhow::{Context, Result};
use aya::maps::{HashMap, MapData};
use rtps_ebpf::abi::{
    PEER_ADDRESSES, PEER_ANY_ADDRESS, PEER_PROVEN, PEER_SUPERVISED, Peer, WRITER_FRAGMENTED, name,
};
use rtps_user::wire::{EntityId, Guid, GuidPrefix, SequenceNumber};

use super::{builtin_writer, ignore_missing, monotonic_now, nanoseconds, open};
use crate::own_addresses::mapped;
use crate::pins::PinFolder;

type PeerMap = HashMap<MapData, [u8; 12], Peer>;

/// Both maps.
pub(crate) struct Peers {
    known: PeerMap,
    strangers: PeerMap,
}

impl Peers {
    /// Opens the pinned maps.
    pub(super) fn open(folder: &PinFolder) -> Result<Self> {
        Ok(Self {
            known: open(folder, name::PEERS)?,
            strangers: open(folder, name::STRANGERS)?,
        })
    }

    /// Has a participant known, and taken only from these addresses, or from any if none is given. What the kernel has
    /// learned of it as a stranger goes on to count.
    pub(crate) fn keep(
        &mut self,
        prefix: GuidPrefix,
        addresses: &[IpAddr],
        supervised: bool,
    ) -> Result<()> {
        let known = self.known.get(&prefix.0, 0).ok();
        let before = known
            .or_else(|| self.strangers.get(&prefix.0, 0).ok())
            .unwrap_or_else(new_peer);
        let after = accepted(before, addresses, supervised);
        if known != Some(after) {
            self.known
                .insert(prefix.0, after, 0)
                .context("map `peers`")?;
        }
        if known.is_none() {
            ignore_missing(self.strangers.remove(&prefix.0)).context("map `strangers`")?;
        }
        Ok(())
    }

    /// Forgets a participant, so that it has to announce itself like one that was never seen.
    pub(crate) fn forget(&mut self, prefix: GuidPrefix) -> Result<()> {
        ignore_missing(self.known.remove(&prefix.0)).context("map `peers`")?;
        ignore_missing(self.strangers.remove(&prefix.0)).context("map `strangers`")
    }

    /// Forgets those that rtpsd has accepted and that are not among these.
    pub(crate) fn forget_others(&mut self, participants: &BTreeSet<GuidPrefix>) -> Result<()> {
        let known: Vec<[u8; 12]> = self.known.keys().collect::<Result<_, _>>()?;
        for old in known {
            if !participants.contains(&GuidPrefix(old)) {
                ignore_missing(self.known.remove(&old)).context("map `peers`")?;
            }
        }
        Ok(())
    }

    /// All that the writer sent below `next` is had or will not come. Goes back only if this is `exact`.
    pub(crate) fn progress(
        &mut self,
        writer: Guid,
        next: SequenceNumber,
        exact: bool,
    ) -> Result<()> {
        let prefix = writer.prefix.0;
        let (map, peer) = match self.known.get(&prefix, 0) {
            Ok(peer) => (&mut self.known, peer),
            Err(_) => match self.strangers.get(&prefix, 0) {
                Ok(peer) => (&mut self.strangers, peer),
                Err(_) => return Ok(()),
            },
        };
        match advanced(peer, writer.entity, next, exact) {
            Some(after) if after != peer => map.insert(prefix, after, 0).context("map of peers"),
            _ => Ok(()),
        }
    }

    /// How long ago the kernel saw a message of the participant; `None` when it is unknown.
    pub(crate) fn silence(&self, prefix: GuidPrefix) -> Option<Duration> {
        let seen = Duration::from_nanos(self.get(prefix)?.last_seen_ns);
        Some(monotonic_now().saturating_sub(seen))
    }

    /// Up to where the participant's built-in readers have acknowledged, by the number of our writer, as far as they
    /// have.
    pub(crate) fn acknowledged(
        &self,
        prefix: GuidPrefix,
    ) -> impl Iterator<Item = (u32, SequenceNumber)> + use<> {
        let readers = self.get(prefix).map(|peer| peer.readers);
        let bases = readers.into_iter().flatten().map(|reader| {
            let base = i64::try_from(reader.acknowledged).ok()?;
            (base > 0).then_some(SequenceNumber(base))
        });
        (0..)
            .zip(bases)
            .filter_map(|(writer, base)| Some((writer, base?)))
    }

    fn get(&self, prefix: GuidPrefix) -> Option<Peer> {
        let known = self.known.get(&prefix.0, 0);
        known.or_else(|_| self.strangers.get(&prefix.0, 0)).ok()
    }
}

/// A participant of which the kernel knows nothing yet.
fn new_peer() -> Peer {
    let mut peer = Peer {
        last_seen_ns: nanoseconds(monotonic_now()),
        ..Peer::default()
    };
    for writer in &mut peer.writers {
        writer.next = 1;
    }
    peer
}

fn accepted(mut peer: Peer, addresses: &[IpAddr], supervised: bool) -> Peer {
    peer.addresses = [[0; 16]; PEER_ADDRESSES];
    for (to, from) in peer.addresses.iter_mut().zip(addresses) {
        *to = mapped(*from);
    }
    let is_unbound = addresses.is_empty() || addresses.len() > PEER_ADDRESSES;
    peer.flags = PEER_PROVEN
        | if supervised { PEER_SUPERVISED } else { 0 }
        | if is_unbound { PEER_ANY_ADDRESS } else { 0 };
    peer
}

/// `None` for what is no built-in writer, or no number.
fn advanced(mut peer: Peer, writer: EntityId, next: SequenceNumber, exact: bool) -> Option<Peer> {
    let number = usize::try_from(builtin_writer(writer)?).ok()?;
    let state = peer.writers.get_mut(number)?;
    let next = u64::try_from(next.0).ok()?.max(1);
    if exact || next > state.next {
        state.next = next;
        state.flags &= !WRITER_FRAGMENTED;
    }
    Some(peer)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ADDRESS: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 1));

    #[test]
    fn what_the_kernel_learned_of_a_stranger_stays() {
        let mut stranger = new_peer();
        stranger.reply_port = 7410;
        stranger.announcement_hash = 5;
        stranger.writers[1].next = 9;
        let peer = accepted(stranger, &[ADDRESS], true);
        assert_eq!((peer.reply_port, peer.announcement_hash), (7410, 5));
        assert_eq!(peer.writers, stranger.writers);
        assert_eq!(peer.flags, PEER_PROVEN | PEER_SUPERVISED);
        assert_eq!(peer.addresses[0], mapped(ADDRESS));
        assert_eq!(peer.addresses[1..], [[0; 16]; PEER_ADDRESSES - 1]);
    }

    #[test]
    fn addresses_are_not_checked_where_there_are_none_or_too_many() {
        for count in [0, PEER_ADDRESSES + 1] {
            let peer = accepted(new_peer(), &vec![ADDRESS; count], false);
            assert_eq!(peer.flags, PEER_PROVEN | PEER_ANY_ADDRESS, "{count}");
        }
        let peer = accepted(new_peer(), &[ADDRESS; PEER_ADDRESSES], false);
        assert_eq!(peer.flags, PEER_PROVEN);
    }

    #[test]
    fn progress_goes_back_only_if_exact() {
        let mut peer = new_peer();
        peer.writers[0].next = 7;
        peer.writers[0].flags = WRITER_FRAGMENTED;
        let to = |next, exact| {
            let writer = EntityId::SEDP_PUBLICATIONS_WRITER;
            advanced(peer, writer, SequenceNumber(next), exact)
                .unwrap()
                .writers[0]
        };
        // The fragments of the sample that is expected are still being collected.
        assert_eq!(to(5, false), peer.writers[0]);
        assert_eq!((to(8, false).next, to(8, false).flags), (8, 0));
        assert_eq!(to(5, true).next, 5);
        assert_eq!(to(0, true).next, 1);
        let of_app = EntityId([1, 0, 0, 3]);
        assert_eq!(advanced(peer, of_app, SequenceNumber(5), false), None);
    }
}
