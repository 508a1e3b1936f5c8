//! The remote participants and their endpoints, in bounded tables.
//!
//! Anyone on the network can claim to be any number of participants. Therefore a participant first counts as
//! unproven; who answers our discovery traffic is proven. A full table makes room for a new participant only by
//! forgetting the oldest unproven one, so that a flood of inventions never pushes out a real one. An unproven one is
//! sent to at no other address than its announcement came from, and is soon forgotten unless it goes on. And who is
//! known by some addresses is not listened to at others.

use std::collections::{BTreeMap, BTreeSet};
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::time::{Duration, Instant};

use super::lease::{Lease, LeaseQueue};
use super::parameters::reachable;
use super::{DiscoveryLimits, EndpointData, ParticipantData};
use crate::RemoteEndpoint;
use crate::wire::{EntityId, Guid, GuidPrefix};

/// The longest lease of an unproven participant: who answers does so within seconds.
const UNPROVEN_LEASE: Duration = Duration::from_secs(30);

/// A remote participant.
#[derive(Debug)]
pub struct RemoteParticipant {
    /// What it says of itself.
    pub data: ParticipantData,
    /// Where discovery traffic for it goes.
    pub metatraffic: Vec<SocketAddr>,
    /// Where its endpoints receive that say nothing else, best first.
    pub user: Vec<SocketAddr>,
    /// What its endpoints say of themselves.
    pub endpoints: BTreeMap<EntityId, EndpointData>,
    source: IpAddr,
    addresses: Vec<IpAddr>,
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

    /// Where its datagrams may come from.
    pub fn addresses(&self) -> &[IpAddr] {
        &self.addresses
    }

    /// The lease that it asks for; `None` for ever.
    pub fn lease(&self) -> Option<Duration> {
        self.data.lease.to_std()
    }

    /// Whether datagrams that come from there may be its own.
    fn owns(&self, source: IpAddr) -> bool {
        self.addresses.contains(&source)
    }

    /// Takes in what it announces from `source`, on a host with the addresses `own`.
    fn update(&mut self, source: IpAddr, own: &[IpAddr], data: ParticipantData) {
        self.source = source;
        self.data = data;
        self.settle(own);
    }

    /// Derives its addresses.
    fn settle(&mut self, own: &[IpAddr]) {
        self.metatraffic = answerable(&self.data.metatraffic_unicast, self.source);
        self.user = self.destinations(&self.data.default_unicast);
        self.addresses = origins(&self.data, self.source, own);
    }

    /// Where its endpoints are reached that announce these addresses.
    fn destinations(&self, addresses: &[SocketAddr]) -> Vec<SocketAddr> {
        if self.proven {
            reachable(addresses, self.source)
        } else {
            answerable(addresses, self.source)
        }
    }

    /// What a local endpoint needs to know of one of its endpoints.
    pub fn endpoint(&self, entity: EntityId) -> Option<RemoteEndpoint> {
        let data = self.endpoints.get(&entity)?;
        let own = self.destinations(&data.unicast);
        let mut addresses = self.addresses.clone();
        addresses.extend(data.unicast.iter().map(SocketAddr::ip));
        addresses.sort();
        addresses.dedup();
        Some(RemoteEndpoint {
            guid: data.guid,
            unicast: if own.is_empty() {
                self.user.clone()
            } else {
                own
            },
            addresses,
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
}

/// The tables.
#[derive(Debug)]
pub(super) struct Database {
    limits: DiscoveryLimits,
    /// The addresses of this host.
    own: Vec<IpAddr>,
    participants: BTreeMap<GuidPrefix, RemoteParticipant>,
    leases: LeaseQueue,
    /// Unproven participants in the order of their discovery.
    unproven: BTreeSet<(u64, GuidPrefix)>,
    discovered: u64,
    endpoints: usize,
}

impl Database {
    /// Empty tables, on a host with the addresses `own`.
    pub(super) fn new(limits: DiscoveryLimits, own: Vec<IpAddr>) -> Self {
        Self {
            limits,
            own,
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

    /// This host has other addresses than before, and so have the participants on it, which are returned.
    pub(super) fn set_own(&mut self, own: Vec<IpAddr>) -> Vec<GuidPrefix> {
        self.own = own;
        let mut changed = Vec::new();
        for (prefix, participant) in &mut self.participants {
            let addresses = origins(&participant.data, participant.source, &self.own);
            if participant.addresses != addresses {
                participant.addresses = addresses;
                changed.push(*prefix);
            }
        }
        changed
    }

    /// Notes an announcement that came from `source`, an address of the participant where it is known. An evicted participant is still there, for the caller to
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
        known.lease.renew(now);
        if known.data == data {
            return Announced::Unchanged;
        }
        let prefix = data.prefix;
        known.update(source, &self.own, data);
        self.leases.revoke(prefix, &known.lease);
        known.lease = self
            .leases
            .grant(now, prefix, patience(&known.data, known.proven));
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
        let mut participant = RemoteParticipant {
            metatraffic: Vec::new(),
            user: Vec::new(),
            endpoints: BTreeMap::new(),
            source,
            addresses: Vec::new(),
            proven,
            lease: self.leases.grant(now, prefix, patience(&data, proven)),
            number,
            data,
        };
        participant.settle(&self.own);
        self.participants.insert(prefix, participant);
    }

    /// Whether a datagram from there does not come from the participant that it names, as far as that is known.
    pub(super) fn is_foreign(&self, prefix: GuidPrefix, source: IpAddr) -> bool {
        self.get(prefix)
            .is_some_and(|participant| !participant.owns(source))
    }

    /// A sign of life.
    pub(super) fn renew(&mut self, at: Instant, prefix: GuidPrefix) {
        if let Some(participant) = self.participants.get_mut(&prefix) {
            participant.lease.renew(at);
        }
    }

    /// The participant has answered our discovery traffic; tells whether that is new.
    pub(super) fn prove(&mut self, now: Instant, prefix: GuidPrefix) -> bool {
        match self.participants.get_mut(&prefix) {
            Some(participant) if !participant.proven => {
                participant.proven = true;
                participant.settle(&self.own);
                self.leases.revoke(prefix, &participant.lease);
                participant.lease =
                    self.leases
                        .grant(now, prefix, patience(&participant.data, participant.proven));
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

/// How long a participant is remembered without a sign of life; `None` for ever.
fn patience(data: &ParticipantData, proven: bool) -> Option<Duration> {
    let lease = data.lease.to_std();
    if proven {
        lease
    } else {
        Some(lease.map_or(UNPROVEN_LEASE, |lease| lease.min(UNPROVEN_LEASE)))
    }
}

/// Where datagrams of a participant may come from: a host with several addresses may use any of them. On this host
/// that is any of ours, which nobody else can send from.
fn origins(data: &ParticipantData, source: IpAddr, own: &[IpAddr]) -> Vec<IpAddr> {
    let announced = data.metatraffic_unicast.iter().chain(&data.default_unicast);
    let mut origins: Vec<_> = announced.map(SocketAddr::ip).collect();
    origins.push(source);
    if source.is_loopback() || own.contains(&source) {
        origins.extend(own);
        origins.extend([
            IpAddr::from(Ipv4Addr::LOCALHOST),
            Ipv6Addr::LOCALHOST.into(),
        ]);
    }
    origins.sort();
    origins.dedup();
    origins
}

/// Where discovery traffic for a participant goes, and all else as long as it is unproven: to the address that its datagrams come from and nowhere else, for
/// an invented announcement must not make us send to somebody who has never heard of us.
fn answerable(addresses: &[SocketAddr], source: IpAddr) -> Vec<SocketAddr> {
    let mut answerable = reachable(addresses, source);
    answerable.truncate(1);
    if let Some(address) = answerable.first_mut() {
        address.set_ip(source);
    }
    answerable
}

#[cfg(test)]
mod tests {
    use super::*;

    const SOURCE: IpAddr = IpAddr::V4(Ipv4Addr::new(10, 0, 0, 1));
    const OWN: IpAddr = IpAddr::V4(Ipv4Addr::new(10, 0, 0, 99));
    const ELSEWHERE: IpAddr = IpAddr::V4(Ipv4Addr::new(10, 6, 6, 6));

    fn database(participants: usize) -> Database {
        let limits = DiscoveryLimits {
            participants,
            ..DiscoveryLimits::default()
        };
        Database::new(limits, vec![OWN])
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
        assert!(database.prove(now, GuidPrefix([1; 12])));
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
            database.prove(now, GuidPrefix([number; 12]));
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
        let prefix = announced.prefix;
        database.announce(now, SOURCE, announced);
        assert!(!database.is_foreign(prefix, SOURCE));
        assert!(!database.is_foreign(prefix, second_interface));
        for other in [ELSEWHERE, OWN, Ipv4Addr::LOCALHOST.into()] {
            assert!(database.is_foreign(prefix, other));
        }
        assert!(!database.is_foreign(GuidPrefix([2; 12]), ELSEWHERE));
    }

    #[test]
    fn a_participant_on_this_host_may_use_all_of_its_addresses() {
        let mut database = database(3);
        database.announce(Instant::now(), OWN, data(1));
        let prefix = GuidPrefix([1; 12]);
        assert!(!database.is_foreign(prefix, Ipv4Addr::LOCALHOST.into()));
        let another = IpAddr::from([10, 0, 1, 99]);
        assert!(database.is_foreign(prefix, another));
        assert_eq!(database.set_own(vec![OWN, another]), [prefix]);
        assert!(!database.is_foreign(prefix, another));
    }

    #[test]
    fn the_unproven_are_sent_to_where_they_are_and_soon_forgotten() {
        let now = Instant::now();
        let mut database = database(3);
        let mut announced = data(1);
        announced.lease = crate::wire::Duration::INFINITE;
        let elsewhere = SocketAddr::new(ELSEWHERE, 7411);
        announced.default_unicast = vec![elsewhere];
        let prefix = announced.prefix;
        database.announce(now, SOURCE, announced);
        let user = |database: &Database| database.get(prefix).map(|known| known.user.clone());
        assert_eq!(user(&database), Some(vec![SocketAddr::new(SOURCE, 7411)]));
        assert_eq!(database.poll_timeout(), Some(now + UNPROVEN_LEASE));
        assert!(database.prove(now, prefix));
        assert_eq!(user(&database), Some(vec![elsewhere]));
        assert_eq!(database.poll_timeout(), None);
    }

    #[test]
    fn endpoints_are_bounded() {
        let limits = DiscoveryLimits {
            participants: 9,
            endpoints_per_participant: 2,
            endpoints: 3,
        };
        let mut database = Database::new(limits, vec![OWN]);
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
