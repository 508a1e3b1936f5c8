//! The remote participants and their endpoints, in bounded tables.
//!
//! Anyone on the network can claim to be any number of participants. Therefore a participant first counts as
//! unproven; who answers our discovery traffic is proven. A full table makes room for a new participant only by
//! forgetting the oldest unproven one, so that a flood of inventions never pushes out a real one. And who is known
//! by one address is not changed or removed by a datagram from another.

use std::collections::{BTreeMap, BTreeSet};
use std::net::{IpAddr, SocketAddr};
use std::time::{Duration, Instant};

use super::lease::{Lease, LeaseQueue};
use super::parameters::reachable;
use super::{DiscoveryLimits, EndpointData, ParticipantData};
use crate::RemoteEndpoint;
use crate::wire::{EntityId, Guid, GuidPrefix};

/// A remote participant.
#[derive(Debug)]
pub struct RemoteParticipant {
    /// What it says of itself.
    pub data: ParticipantData,
    /// Where discovery traffic for it goes, best first.
    pub metatraffic: Vec<SocketAddr>,
    /// Where its endpoints receive that say nothing else, best first.
    pub user: Vec<SocketAddr>,
    /// What its endpoints say of themselves.
    pub endpoints: BTreeMap<EntityId, EndpointData>,
    source: IpAddr,
    proven: bool,
    lease: Lease,
    /// Its place in the order of discovery.
    number: u64,
}

impl RemoteParticipant {
    /// The address that its announcements come from.
    pub fn source(&self) -> IpAddr {
        self.source
    }

    /// Whether it has answered us: anybody can announce anything.
    pub fn is_proven(&self) -> bool {
        self.proven
    }

    /// The lease that it asks for; `None` for ever.
    pub fn lease(&self) -> Option<Duration> {
        self.data.lease.to_std()
    }

    /// Whether datagrams that come from there may be its own.
    fn owns(&self, source: IpAddr) -> bool {
        self.source == source
            || [&self.data.metatraffic_unicast, &self.data.default_unicast]
                .into_iter()
                .flatten()
                .any(|address| address.ip() == source)
    }

    /// What a local endpoint needs to know of one of its endpoints.
    pub fn endpoint(&self, entity: EntityId) -> Option<RemoteEndpoint> {
        let data = self.endpoints.get(&entity)?;
        let own = reachable(&data.unicast, self.source);
        Some(RemoteEndpoint {
            guid: data.guid,
            unicast: if own.is_empty() {
                self.user.clone()
            } else {
                own
            },
            multicast: data.multicast.clone(),
            expects_inline_qos: data.expects_inline_qos || self.data.expects_inline_qos,
            qos: data.qos.clone(),
            topic: data.topic.clone(),
            type_name: data.type_name.clone(),
        })
    }
}

/// What an announcement brought.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Announced {
    /// A participant that was not known; another had to make room for it.
    New { evicted: Option<GuidPrefix> },
    /// Other data or addresses than before.
    Changed,
    /// A sign of life.
    Unchanged,
    /// The table is full.
    NoRoom,
    /// It came from elsewhere than the known participant.
    Foreign,
}

/// The tables.
#[derive(Debug)]
pub(super) struct Database {
    limits: DiscoveryLimits,
    participants: BTreeMap<GuidPrefix, RemoteParticipant>,
    leases: LeaseQueue,
    /// Unproven participants in the order of their discovery.
    unproven: BTreeSet<(u64, GuidPrefix)>,
    discovered: u64,
    endpoints: usize,
}

impl Database {
    /// Empty tables.
    pub(super) fn new(limits: DiscoveryLimits) -> Self {
        Self {
            limits,
            participants: BTreeMap::new(),
            leases: LeaseQueue::default(),
            unproven: BTreeSet::new(),
            discovered: 0,
            endpoints: 0,
        }
    }

    /// A participant.
    pub(super) fn get(&self, prefix: GuidPrefix) -> Option<&RemoteParticipant> {
        self.participants.get(&prefix)
    }

    /// All participants.
    pub(super) fn iter(&self) -> impl Iterator<Item = &RemoteParticipant> {
        self.participants.values()
    }

    /// Notes an announcement that came from `source`. An evicted participant is still there, for the caller to
    /// remove with all that hangs on it.
    pub(super) fn announce(
        &mut self,
        now: Instant,
        source: IpAddr,
        data: ParticipantData,
    ) -> Announced {
        let Some(known) = self.participants.get_mut(&data.prefix) else {
            return self.announce_new(now, source, data);
        };
        if !known.owns(source) {
            return Announced::Foreign;
        }
        known.lease.renew(now);
        if known.data == data {
            return Announced::Unchanged;
        }
        self.leases.revoke(data.prefix, &known.lease);
        known.lease = self.leases.grant(now, data.prefix, data.lease.to_std());
        known.source = source;
        known.metatraffic = reachable(&data.metatraffic_unicast, source);
        known.user = reachable(&data.default_unicast, source);
        known.data = data;
        Announced::Changed
    }

    fn announce_new(&mut self, now: Instant, source: IpAddr, data: ParticipantData) -> Announced {
        let mut evicted = None;
        if self.participants.len() >= self.limits.participants {
            let Some((_, oldest)) = self.unproven.first() else {
                return Announced::NoRoom;
            };
            evicted = Some(*oldest);
        }
        self.insert(now, source, data, false);
        Announced::New { evicted }
    }

    /// Adds a participant that is not there.
    pub(super) fn insert(
        &mut self,
        now: Instant,
        source: IpAddr,
        data: ParticipantData,
        proven: bool,
    ) {
        let prefix = data.prefix;
        let number = self.discovered;
        self.discovered += 1;
        if !proven {
            self.unproven.insert((number, prefix));
        }
        let participant = RemoteParticipant {
            metatraffic: reachable(&data.metatraffic_unicast, source),
            user: reachable(&data.default_unicast, source),
            endpoints: BTreeMap::new(),
            source,
            proven,
            lease: self.leases.grant(now, prefix, data.lease.to_std()),
            number,
            data,
        };
        self.participants.insert(prefix, participant);
    }

    /// Whether a datagram from there may speak for the participant.
    pub(super) fn owns(&self, prefix: GuidPrefix, source: IpAddr) -> bool {
        self.get(prefix)
            .is_some_and(|participant| participant.owns(source))
    }

    /// A sign of life.
    pub(super) fn renew(&mut self, at: Instant, prefix: GuidPrefix) {
        if let Some(participant) = self.participants.get_mut(&prefix) {
            participant.lease.renew(at);
        }
    }

    /// The participant has answered our discovery traffic; tells whether that is new.
    pub(super) fn prove(&mut self, prefix: GuidPrefix) -> bool {
        match self.participants.get_mut(&prefix) {
            Some(participant) if !participant.proven => {
                participant.proven = true;
                self.unproven.remove(&(participant.number, prefix))
            }
            _ => false,
        }
    }

    /// Forgets a participant and all of its endpoints.
    pub(super) fn remove(&mut self, prefix: GuidPrefix) -> Option<RemoteParticipant> {
        let participant = self.participants.remove(&prefix)?;
        self.leases.revoke(prefix, &participant.lease);
        self.unproven.remove(&(participant.number, prefix));
        self.endpoints -= participant.endpoints.len();
        Some(participant)
    }

    /// The next participant whose lease has ended; it is still there.
    pub(super) fn next_expired(&mut self, now: Instant) -> Option<GuidPrefix> {
        while let Some(prefix) = self.leases.pop_due(now) {
            let Some(participant) = self.participants.get_mut(&prefix) else {
                continue;
            };
            if self.leases.has_ended(now, prefix, &mut participant.lease) {
                return Some(prefix);
            }
        }
        None
    }

    /// When a lease may end.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.leases.poll_timeout()
    }

    /// Adds or replaces an endpoint of a known participant; false where there is no room.
    pub(super) fn insert_endpoint(&mut self, data: EndpointData) -> bool {
        let Some(participant) = self.participants.get_mut(&data.guid.prefix) else {
            return false;
        };
        let is_known = participant.endpoints.contains_key(&data.guid.entity);
        let has_room = participant.endpoints.len() < self.limits.endpoints_per_participant
            && self.endpoints < self.limits.endpoints;
        if is_known || has_room {
            participant.endpoints.insert(data.guid.entity, data);
            self.endpoints += usize::from(!is_known);
        }
        is_known || has_room
    }

    /// Forgets an endpoint; tells whether it was there.
    pub(super) fn remove_endpoint(&mut self, guid: Guid) -> bool {
        let removed = self
            .participants
            .get_mut(&guid.prefix)
            .and_then(|participant| participant.endpoints.remove(&guid.entity));
        self.endpoints -= usize::from(removed.is_some());
        removed.is_some()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOURCE: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 1));
    const ELSEWHERE: IpAddr = IpAddr::V4(std::net::Ipv4Addr::new(10, 6, 6, 6));

    fn database(participants: usize) -> Database {
        Database::new(DiscoveryLimits {
            participants,
            ..DiscoveryLimits::default()
        })
    }

    fn data(number: u8) -> ParticipantData {
        ParticipantData::new(GuidPrefix([number; 12]))
    }

    #[test]
    fn a_flood_replaces_only_the_unproven() {
        let now = Instant::now();
        let mut database = database(3);
        for number in [1, 2] {
            database.announce(now, SOURCE, data(number));
        }
        assert!(database.prove(GuidPrefix([1; 12])));
        let mut evictions = Vec::new();
        for number in 3..=9 {
            match database.announce(now, ELSEWHERE, data(number)) {
                Announced::New { evicted } => {
                    evictions.extend(evicted.map(|prefix| prefix.0[0]));
                    evicted.map(|prefix| database.remove(prefix));
                }
                other => panic!("{other:?}"),
            }
        }
        assert_eq!(evictions, [2, 3, 4, 5, 6, 7]);
        for number in [8, 9] {
            database.prove(GuidPrefix([number; 12]));
        }
        assert_eq!(
            database.announce(now, ELSEWHERE, data(10)),
            Announced::NoRoom
        );
        assert_eq!(database.iter().count(), 3);
    }

    #[test]
    fn only_its_own_addresses_speak_for_a_participant() {
        let now = Instant::now();
        let mut database = database(3);
        let mut announced = data(1);
        let second_interface = IpAddr::from([10, 0, 1, 1]);
        announced.metatraffic_unicast = vec![SocketAddr::new(second_interface, 7410)];
        database.announce(now, SOURCE, announced.clone());
        assert_eq!(
            database.announce(now, second_interface, announced.clone()),
            Announced::Unchanged
        );
        announced.name = "changed".to_owned();
        assert_eq!(
            database.announce(now, ELSEWHERE, announced.clone()),
            Announced::Foreign
        );
        assert_eq!(
            database.announce(now, SOURCE, announced),
            Announced::Changed
        );
    }

    #[test]
    fn endpoints_are_bounded() {
        let mut database = Database::new(DiscoveryLimits {
            participants: 9,
            endpoints_per_participant: 2,
            endpoints: 3,
        });
        let insert = |database: &mut Database, participant, entity| {
            database.insert_endpoint(EndpointData {
                guid: Guid::new(GuidPrefix([participant; 12]), EntityId([1, 0, entity, 2])),
                topic: "t".to_owned(),
                type_name: String::new(),
                unicast: Vec::new(),
                multicast: Vec::new(),
                expects_inline_qos: false,
                qos: crate::qos::Qos::default(),
            })
        };
        assert!(!insert(&mut database, 1, 1), "unknown participant");
        for number in [1, 2] {
            database.announce(Instant::now(), SOURCE, data(number));
        }
        assert!(insert(&mut database, 1, 1));
        assert!(insert(&mut database, 1, 2));
        assert!(insert(&mut database, 1, 2), "known");
        assert!(!insert(&mut database, 1, 3), "of one participant");
        assert!(insert(&mut database, 2, 1));
        assert!(!insert(&mut database, 2, 2), "in all");
        database.remove(GuidPrefix([1; 12]));
        assert!(insert(&mut database, 2, 2));
    }
}
