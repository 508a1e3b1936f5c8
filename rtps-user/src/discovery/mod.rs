//! Discovery (RTPS 2.5 section 8.5): who else is in the domain, and which endpoints they have.
//!
//! [`Discovery`] announces one participant and its endpoints, and keeps track of the remote ones; matching is done
//! by who uses it. It knows no I/O: after each call, take the [events](Discovery::poll_event) and then the
//! [datagrams](Discovery::poll_transmit) until there are none, and come back at
//! [`poll_timeout`](Discovery::poll_timeout). Events come before the datagrams that depend on them, so that what an
//! event tells can be stored before a remote participant learns that we know it.

mod announcement;
mod budget;
mod builtin;
mod config;
mod database;
mod endpoint_data;
mod event;
mod lease;
mod liveliness;
mod low_level;
mod matching;
mod parameters;
mod participant_data;
mod ports;
mod receive;
mod remote_participant;
mod restore;
mod sedp;
mod spdp;
mod type_lookup;

use std::collections::VecDeque;
use std::net::{IpAddr, SocketAddr};
use std::time::{Duration, Instant};

pub use announcement::{for_interface, prefer_addresses};
pub use config::{DiscoveryConfig, DiscoveryLimits};
use database::Database;
pub use endpoint_data::EndpointData;
pub use event::{DiscoveryEvent, Refused};
use liveliness::Assertions;
pub use liveliness::ParticipantMessageData;
pub use matching::{MatchChange, Matchmaker, Outcome};
pub use participant_data::{BuiltinEndpointSet, ParticipantData};
pub use ports::{NoPort, Ports};
use remote_participant::Origins;
pub use remote_participant::RemoteParticipant;
use sedp::Withdrawals;
use spdp::Announcer;
use type_lookup::TypeLookup;

use crate::Transmit;
use crate::endpoints::Endpoints;
use crate::history::{ChangeKind, NewChange};
use crate::wire::{EntityId, Guid, GuidPrefix, MessageWriter, SequenceNumber, Timestamp};

/// Bytes of a HEARTBEAT with its header.
const HEARTBEAT_LEN: usize = 32;

/// Discovery of one participant.
#[derive(Debug)]
pub struct Discovery {
    config: DiscoveryConfig,
    start: Instant,
    database: Database,
    endpoints: Endpoints,
    announcer: Announcer,
    withdrawals: Withdrawals,
    assertions: Assertions,
    type_lookup: TypeLookup,
    events: VecDeque<DiscoveryEvent>,
    refused: Refused,
}

impl Discovery {
    /// Starts; the first announcement is due at once.
    pub fn new(config: DiscoveryConfig, now: Instant) -> Self {
        Self {
            start: now,
            database: Database::new(
                config.limits,
                Origins::new(addresses(&config.participant), config.bind_addresses),
            ),
            endpoints: builtin::endpoints(&config, now),
            announcer: Announcer::new(&config, now),
            withdrawals: Withdrawals::default(),
            assertions: Assertions::default(),
            type_lookup: TypeLookup::default(),
            events: VecDeque::new(),
            refused: Refused::default(),
            config,
        }
    }

    /// The remote participants.
    pub fn participants(&self) -> impl Iterator<Item = &RemoteParticipant> {
        self.database.iter()
    }

    /// A remote participant.
    pub fn participant(&self, prefix: GuidPrefix) -> Option<&RemoteParticipant> {
        self.database.get(prefix)
    }

    /// What was not taken.
    pub fn refused(&self) -> Refused {
        self.refused
    }

    /// What we announce of ourselves has changed.
    pub fn set_participant(&mut self, now: Instant, participant: ParticipantData) {
        self.announcer.change(now, &participant);
        for prefix in self.database.set_own(addresses(&participant)) {
            self.match_participant(now, prefix);
            self.events.push_back(DiscoveryEvent::ParticipantFound {
                prefix,
                is_new: false,
            });
        }
        self.config.participant = participant;
    }

    /// Announces an endpoint of ours, or how it has changed. Gives the number of the sample that says so.
    pub fn announce(&mut self, now: Instant, endpoint: &EndpointData) -> Option<SequenceNumber> {
        let timestamp = self.timestamp(now);
        sedp::announce(&mut self.endpoints, now, timestamp, endpoint)
    }

    /// Withdraws an endpoint of ours. Gives the number of the sample that says so, which is to be kept until
    /// [`DiscoveryEvent::WithdrawalDone`].
    pub fn withdraw(&mut self, now: Instant, entity: EntityId) -> Option<SequenceNumber> {
        let timestamp = self.timestamp(now);
        let guid = Guid::new(self.prefix(), entity);
        let sequence = self
            .withdrawals
            .withdraw(&mut self.endpoints, now, timestamp, guid);
        self.clean_up(sedp::announcer_of(entity));
        sequence
    }

    /// The shortest lease of all our AUTOMATIC writers, which discovery asserts; `None` without such a writer.
    pub fn set_automatic_lease(&mut self, now: Instant, lease: Option<Duration>) {
        self.assertions.set_lease(now, lease);
    }

    /// Asserts that our MANUAL_BY_PARTICIPANT writers, or else the AUTOMATIC ones, are alive.
    pub fn assert_liveliness(&mut self, now: Instant, manual: bool) {
        let message = ParticipantMessageData {
            participant: self.prefix(),
            manual,
        };
        let mut payload = Vec::new();
        message.encode(&mut payload);
        let change = NewChange {
            kind: ChangeKind::Alive,
            instance: message.instance(),
            payload: payload.into(),
            timestamp: self.timestamp(now),
        };
        let writer = EntityId::PARTICIPANT_MESSAGE_WRITER;
        if let Some(sequence) = sedp::write(&mut self.endpoints, now, writer, change) {
            self.events
                .push_back(DiscoveryEvent::Asserted { sequence, manual });
        }
    }

    /// Traffic of a participant was seen at `at`: its lease holds from then.
    pub fn seen(&mut self, at: Instant, participant: GuidPrefix) {
        self.database.renew(at, participant);
    }

    /// Says goodbye to all.
    pub fn leave(&mut self) {
        self.announcer.leave();
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.announcer.handle_timeout(now);
        for prefix in self.database.take_ended(now) {
            tracing::debug!(%prefix, "the lease of a participant has ended");
            self.remove_participant(now, prefix);
        }
        if self.assertions.expire(now) {
            self.assert_liveliness(now, false);
        }
        self.endpoints.handle_timeout(now);
        self.collect(now);
    }

    /// When [`handle_timeout`](Self::handle_timeout) is to be called at the latest.
    pub fn poll_timeout(&self) -> Option<Instant> {
        let timers = [
            self.announcer.poll_timeout(),
            self.database.poll_timeout(),
            self.assertions.poll_timeout(),
            self.endpoints.poll_timeout(),
        ];
        timers.into_iter().flatten().min()
    }

    /// What has happened.
    pub fn poll_event(&mut self) -> Option<DiscoveryEvent> {
        self.events.pop_front()
    }

    /// The next datagram, which is put into `out`, replacing what is there.
    pub fn poll_transmit(&mut self, now: Instant, out: &mut Vec<u8>) -> Option<Transmit> {
        out.clear();
        self.flush_type_lookup(now);
        let (database, config) = (&self.database, &self.config);
        let announcement = self
            .announcer
            .poll_transmit(|| out_of_reach(database, config), out);
        match announcement {
            Some((transmit, answered)) => {
                if let Some(participant) = answered {
                    self.greet(now, participant, out);
                }
                Some(transmit)
            }
            None => self.endpoints.poll_transmit(now, out),
        }
    }

    /// Tells a participant what our built-in writers have with the answer to its announcement: it has just learned that
    /// they are there.
    fn greet(&mut self, now: Instant, participant: GuidPrefix, out: &mut Vec<u8>) {
        for (writer, reader) in builtin::topics() {
            if out.len() + HEARTBEAT_LEN > usize::from(self.config.datagram_size) {
                return;
            }
            if let Some(writer) = self.endpoints.writer_mut(writer) {
                let heartbeat = writer.greeting(now, Guid::new(participant, reader));
                MessageWriter::resume(out).heartbeat(&heartbeat);
            }
        }
    }

    fn prefix(&self) -> GuidPrefix {
        self.config.participant.prefix
    }

    /// The wall-clock time, as far as we were told it at the start.
    fn timestamp(&self, now: Instant) -> Timestamp {
        let elapsed = now.saturating_duration_since(self.start);
        Timestamp::from_unix(self.config.started.to_unix().saturating_add(elapsed))
    }

    /// Matches the built-in endpoints of a known participant, or takes in its new addresses.
    fn match_participant(&mut self, now: Instant, prefix: GuidPrefix) {
        if let Some(participant) = self.database.get(prefix) {
            builtin::match_participant(&mut self.endpoints, now, participant);
        }
    }

    fn remove_participant(&mut self, now: Instant, prefix: GuidPrefix) {
        builtin::unmatch_participant(&mut self.endpoints, now, prefix);
        let Some(participant) = self.database.remove(prefix) else {
            return;
        };
        if participant.is_pending() {
            self.disown(prefix);
        } else {
            let entities = participant.endpoints.into_keys();
            let endpoints = entities.map(|entity| Guid::new(prefix, entity)).collect();
            self.events
                .push_back(DiscoveryEvent::ParticipantLost { prefix, endpoints });
        }
    }

    fn clean_up(&mut self, announcer: EntityId) {
        for sequence in self.withdrawals.clean_up(&self.endpoints, announcer) {
            self.events.push_back(DiscoveryEvent::WithdrawalDone {
                announcer,
                sequence,
            });
        }
    }
}

/// The addresses of our host.
fn addresses(participant: &ParticipantData) -> Vec<IpAddr> {
    let unicast = [
        &participant.metatraffic_unicast,
        &participant.default_unicast,
    ];
    unicast.into_iter().flatten().map(SocketAddr::ip).collect()
}

/// The addresses of participants that an announcement to the group does not reach: that would end their lease on us.
fn out_of_reach(database: &Database, config: &DiscoveryConfig) -> Vec<SocketAddr> {
    database
        .iter()
        .filter(|participant| !participant.is_pending())
        .filter(|participant| {
            config.multicast.is_empty() || participant.data.metatraffic_multicast.is_empty()
        })
        .filter_map(|participant| participant.metatraffic.first().copied())
        .collect()
}
