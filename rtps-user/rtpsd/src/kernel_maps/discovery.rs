//! The maps that the kernel answers discovery messages from: what the host says of its participants and endpoints, and
//! who it is on each Ethernet.

use std::collections::{BTreeMap, BTreeSet};
use std::net::IpAddr;

use anyhow::{Context, Result};
use aya::maps::{Array, HashMap, MapData};
use rtps_ebpf::abi::{
    self, Announcement, AnnouncementKey, BUILTIN_WRITERS, BuiltinWriter, INTERFACE_ANSWERS,
    Interface, SUBMESSAGE_BYTES, Sample, SampleKey, WRITER_INCOMPLETE, name,
};
use rtps_user::discovery::prefer_addresses;
use rtps_user::wire::{EntityId, SequenceNumber};
use tracing::warn;

use super::{builtin_writer, ignore_missing, open, replace};
use crate::pins::PinFolder;

/// All of them.
pub(crate) struct DiscoveryMaps {
    interfaces: HashMap<MapData, u32, Interface>,
    announcements: HashMap<MapData, AnnouncementKey, Announcement>,
    writers: Array<MapData, BuiltinWriter>,
    samples: HashMap<MapData, SampleKey, Sample>,
    /// What is announced in each domain, by its index.
    announced: BTreeMap<u32, Vec<u8>>,
    /// What this rtpsd has put into `samples`.
    kept: BTreeSet<SampleKey>,
    /// What found no room there.
    missing: BTreeSet<SampleKey>,
}

/// A sample of a built-in writer of ours, as the layer gives it.
pub(crate) struct BuiltinSample<'a> {
    pub(crate) writer: EntityId,
    pub(crate) sequence: SequenceNumber,
    pub(crate) timestamp: [u8; 8],
    /// Empty where rtpsd has to send it.
    pub(crate) submessage: &'a [u8],
}

impl DiscoveryMaps {
    /// Opens the pinned maps.
    pub(super) fn open(folder: &PinFolder) -> Result<Self> {
        Ok(Self {
            interfaces: open(folder, name::INTERFACES)?,
            announcements: open(folder, name::ANNOUNCEMENTS)?,
            writers: open(folder, name::WRITERS)?,
            samples: open(folder, name::SAMPLES)?,
            announced: BTreeMap::new(),
            kept: BTreeSet::new(),
            missing: BTreeSet::new(),
        })
    }

    /// Tells the tc program of these interfaces, and of no other.
    pub(crate) fn set_interfaces(&mut self, interfaces: &BTreeMap<u32, Interface>) -> Result<()> {
        let entries = interfaces.iter().map(|(index, entry)| (*index, *entry));
        replace(&mut self.interfaces, entries).context("map `interfaces`")
    }

    /// The indices of the interfaces where the kernel answers.
    pub(crate) fn interfaces(&self) -> BTreeSet<u32> {
        let entries = self.interfaces.iter().filter_map(Result::ok);
        let answering = entries.filter(|(_, entry)| entry.tasks & INTERFACE_ANSWERS != 0);
        answering.map(|(index, _)| index).collect()
    }

    /// What unknown participants are answered with on these interfaces; rtpsd answers where it is empty or too long.
    pub(crate) fn announce(
        &mut self,
        domain_index: u32,
        submessages: Vec<u8>,
        interfaces: &[rtps_net::Interface],
    ) -> Result<()> {
        self.announced.insert(domain_index, submessages);
        self.announce_on(interfaces)
    }

    /// The interfaces, or their addresses, may be others than before.
    pub(crate) fn announce_on(&mut self, interfaces: &[rtps_net::Interface]) -> Result<()> {
        let entries = self.announced.iter().flat_map(|(domain_index, announced)| {
            interfaces.iter().map(|interface| {
                let key = AnnouncementKey {
                    domain_index: *domain_index,
                    ifindex: interface.index,
                };
                (key, announcement(announced, &interface.addresses))
            })
        });
        replace(&mut self.announcements, entries).context("map `announcements`")
    }

    /// Keeps a sample for those that ask for it. Where there is no room for it, the kernel leaves all who ask for
    /// samples of the writer to rtpsd.
    pub(crate) fn keep_sample(
        &mut self,
        domain_index: u32,
        sample: &BuiltinSample<'_>,
    ) -> Result<()> {
        let Some(key) = sample_key(domain_index, sample.writer, sample.sequence) else {
            return Ok(());
        };
        let (bytes, len) = padded(sample.submessage);
        let value = Sample {
            bytes,
            len,
            reserved: 0,
            timestamp: sample.timestamp,
        };
        match self.samples.insert(key, value, 0) {
            Ok(()) => {
                self.kept.insert(key);
                self.missing.remove(&key);
            }
            Err(error) => {
                if self.missing.is_empty() {
                    warn!(
                        "rtpsd has to answer for endpoints that the kernel has no room for: {error}"
                    );
                }
                self.missing.insert(key);
            }
        }
        self.update_writer(key, |_| {})
    }

    /// Forgets a sample.
    pub(crate) fn forget_sample(
        &mut self,
        domain_index: u32,
        writer: EntityId,
        sequence: SequenceNumber,
    ) -> Result<()> {
        let Some(key) = sample_key(domain_index, writer, sequence) else {
            return Ok(());
        };
        self.kept.remove(&key);
        self.missing.remove(&key);
        ignore_missing(self.samples.remove(&key)).context("map `samples`")?;
        self.update_writer(key, |_| {})
    }

    /// What HEARTBEATs of a writer say.
    pub(crate) fn set_available(
        &mut self,
        domain_index: u32,
        writer: EntityId,
        first: SequenceNumber,
        last: SequenceNumber,
    ) -> Result<()> {
        let Some(key) = sample_key(domain_index, writer, last) else {
            return Ok(());
        };
        self.update_writer(key, |entry| {
            entry.first = u64::try_from(first.0).unwrap_or(1);
            entry.last = key.sequence;
        })
    }

    /// Forgets what an earlier rtpsd kept and this one, which has been told everything, did not: samples, and the writers
    /// of domains that are not among these.
    pub(crate) fn forget_others(&mut self, domain_indices: &BTreeSet<u32>) -> Result<()> {
        let found: BTreeSet<SampleKey> = self.samples.keys().collect::<Result<_, _>>()?;
        for old in found.difference(&self.kept) {
            ignore_missing(self.samples.remove(old)).context("map `samples`")?;
        }
        for index in 0..abi::DOMAINS * BUILTIN_WRITERS {
            if !domain_indices.contains(&(index / BUILTIN_WRITERS)) {
                let nothing = BuiltinWriter::default();
                self.writers
                    .set(index, nothing, 0)
                    .context("map `writers`")?;
            }
        }
        Ok(())
    }

    /// Changes the entry of the key's writer, and notes in it whether all samples are there.
    fn update_writer(&mut self, key: SampleKey, change: impl Fn(&mut BuiltinWriter)) -> Result<()> {
        let index = key.domain_index * BUILTIN_WRITERS + key.writer;
        let before = self.writers.get(&index, 0).context("map `writers`")?;
        let mut after = before;
        change(&mut after);
        let of_writer = |other: &SampleKey| {
            (other.domain_index, other.writer) == (key.domain_index, key.writer)
        };
        after.flags = if self.missing.iter().any(of_writer) {
            WRITER_INCOMPLETE
        } else {
            0
        };
        if after == before {
            return Ok(());
        }
        self.writers.set(index, after, 0).context("map `writers`")
    }
}

/// What is announced on an interface with these addresses.
fn announcement(submessages: &[u8], addresses: &[IpAddr]) -> Announcement {
    let mut submessages = submessages.to_vec();
    prefer_addresses(&mut submessages, addresses);
    let (bytes, len) = padded(&submessages);
    Announcement {
        bytes,
        len,
        reserved: 0,
    }
}

/// `None` for what is no reliable built-in writer, or no number.
fn sample_key(domain_index: u32, writer: EntityId, sequence: SequenceNumber) -> Option<SampleKey> {
    Some(SampleKey {
        domain_index,
        writer: builtin_writer(writer)?,
        sequence: u64::try_from(sequence.0).ok()?,
    })
}

/// Submessages and their length, which is 0 when they are too long.
fn padded(submessages: &[u8]) -> ([u8; SUBMESSAGE_BYTES], u32) {
    let mut bytes = [0; SUBMESSAGE_BYTES];
    let is_whole = submessages.len().is_multiple_of(4);
    match bytes.get_mut(..submessages.len()) {
        Some(room) if is_whole => {
            room.copy_from_slice(submessages);
            (bytes, submessages.len() as u32)
        }
        _ => (bytes, 0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_left_to_rtpsd() {
        assert_eq!(padded(&[1; SUBMESSAGE_BYTES]).1 as usize, SUBMESSAGE_BYTES);
        assert_eq!(padded(&[1; 8]).1, 8);
        assert_eq!(padded(&[1; 8]).0[..9], [1, 1, 1, 1, 1, 1, 1, 1, 0]);
        for length in [0, 6, SUBMESSAGE_BYTES + 4] {
            assert_eq!(padded(&vec![1; length]).1, 0, "{length}");
        }
    }

    #[test]
    fn only_builtin_writers_have_samples() {
        let key = |writer, number| sample_key(2, writer, SequenceNumber(number));
        let expected = SampleKey {
            domain_index: 2,
            writer: 1,
            sequence: 7,
        };
        assert_eq!(key(EntityId::SEDP_SUBSCRIPTIONS_WRITER, 7), Some(expected));
        assert_eq!(key(EntityId::SEDP_SUBSCRIPTIONS_WRITER, -7), None);
        assert_eq!(key(EntityId([1, 0, 0, 2]), 7), None);
    }
}
