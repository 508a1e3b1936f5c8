//! What the low-level layer is told of discovery: the remote participants, and what it needs to answer them.

use std::collections::BTreeMap;
use std::net::IpAddr;

use rtps_ebpf::abi::SUBMESSAGE_BYTES;

use super::{KernelChange, Layer};
use crate::discovery::{MatchChange, Outcome};
use crate::ipv6;
use crate::wire::{EntityId, Guid, GuidPrefix};
use crate::writer::Publication;

/// The remote participants as the low-level layer has been told of them.
#[derive(Debug, Default)]
pub(super) struct Peers(BTreeMap<GuidPrefix, Peer>);

#[derive(Clone, Debug, Default, Eq, PartialEq)]
struct Peer {
    /// In ascending order; empty where they are not checked.
    addresses: Vec<IpAddr>,
    supervised: bool,
}

impl Peers {
    /// Whether what comes from all of these addresses is let through, as far as the participant is known.
    pub(super) fn may_send_from(&self, prefix: GuidPrefix, addresses: &[IpAddr]) -> bool {
        let known = self.0.get(&prefix).map(|peer| &peer.addresses);
        let known = known.filter(|known| !known.is_empty());
        known.is_none_or(|known| {
            let mut addresses = addresses.iter().map(|ip| ipv6::without_interface(*ip));
            addresses.all(|ip| known.binary_search(&ip).is_ok())
        })
    }
}

impl Layer {
    /// Tells what has changed of a participant, or that it is there.
    pub(super) fn refresh_peer(&mut self, prefix: GuidPrefix) {
        let Some(participant) = self.discovery.participant(prefix) else {
            return;
        };
        if self.config.kernel_discovery && !participant.is_proven() {
            return;
        }
        let addresses = participant.all_addresses();
        let mut addresses: Vec<_> = addresses.into_iter().map(ipv6::without_interface).collect();
        addresses.sort();
        addresses.dedup();
        let peer = Peer {
            addresses,
            supervised: participant.is_supervised(),
        };
        if self.peers.0.insert(prefix, peer.clone()).as_ref() != Some(&peer) {
            self.kernel(KernelChange::Peer {
                prefix,
                addresses: peer.addresses,
                supervised: peer.supervised,
            });
        }
    }

    /// The participant is gone.
    pub(super) fn forget_peer(&mut self, prefix: GuidPrefix) {
        self.peers.0.remove(&prefix);
        self.kernel(KernelChange::ForgetPeer(prefix));
    }

    /// Tells of all participants, and where to go on with their writers.
    pub(super) fn restore_peers(&mut self) {
        let participants = self.discovery.participants();
        let prefixes: Vec<_> = participants.map(|known| known.data.prefix).collect();
        for prefix in prefixes {
            self.refresh_peer(prefix);
            if !self.config.kernel_discovery {
                continue;
            }
            let progress: Vec<_> = self.discovery.progress(prefix).collect();
            for (writer, next) in progress {
                self.kernel(KernelChange::Progress {
                    writer,
                    next,
                    exact: true,
                });
            }
        }
    }

    /// Finds out whether an app waits for signs of life of the writers of a participant.
    pub(super) fn supervise(&mut self, change: &MatchChange) {
        let MatchChange { local, other, .. } = *change;
        let prefix = other.prefix;
        let Some(participant) = self.discovery.participant(prefix) else {
            return;
        };
        let before = participant.is_supervised();
        let is_supervised = match change.now {
            Some(Outcome::Matched) => before || self.is_waited_for(local, other),
            _ => before && self.is_any_waited_for(prefix),
        };
        if is_supervised != before {
            self.discovery.supervise(prefix, is_supervised);
            self.refresh_peer(prefix);
        }
    }

    fn is_any_waited_for(&self, prefix: GuidPrefix) -> bool {
        let mut pairs = self.matchmaker.pairs_of_participant(prefix);
        pairs.any(|(other, local)| self.is_waited_for(local, other))
    }

    /// A writer that promises signs of life is missed by each of its readers.
    fn is_waited_for(&self, local: EntityId, writer: Guid) -> bool {
        let lease = self.matchmaker.endpoint(writer);
        let lease = lease.and_then(|writer| writer.qos.liveliness.lease.to_std());
        local.is_reader() && lease.is_some()
    }

    /// Tells what announces the host, where it fits.
    pub(super) fn publish_announcement(&mut self) {
        if self.config.kernel_discovery {
            let submessages = self.discovery.announcement_submessages();
            self.kernel(KernelChange::Announcement(fitting(submessages)));
        }
    }

    /// What has happened to the samples of our built-in writers.
    pub(super) fn poll_publication(&mut self) -> Option<KernelChange> {
        let (writer, publication) = self.discovery.poll_publication()?;
        Some(match publication {
            Publication::Change {
                sequence,
                timestamp,
                submessage,
            } => {
                let [seconds, fraction] = [timestamp.seconds, timestamp.fraction];
                let timestamp = u64::from(fraction) << 32 | u64::from(seconds);
                KernelChange::Sample {
                    writer,
                    sequence,
                    timestamp: timestamp.to_le_bytes(),
                    submessage: fitting(submessage),
                }
            }
            Publication::Gone(sequence) => KernelChange::ForgetSample { writer, sequence },
            Publication::Available { first, last } => KernelChange::Available {
                writer,
                first,
                last,
            },
        })
    }
}

/// What is too long for the low-level layer we have to send ourselves.
fn fitting(submessages: Vec<u8>) -> Vec<u8> {
    if submessages.len() > SUBMESSAGE_BYTES {
        return Vec::new();
    }
    submessages
}
