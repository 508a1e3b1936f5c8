//! The remote participants and their endpoints, in bounded tables.
//!
//! Anyone on the network can claim to be any number of participants. Therefore a participant first counts as
//! unproven; who answers our discovery traffic is proven. A full table makes room for a new participant by
//! forgetting the oldest unproven one, so that a flood of inventions never pushes out a real one. Inventions can be
//! proven, too, and announce leases that never end: so one address has at most half of a table, and where all are
//! proven the one goes that was silent for longest, if it was for longer than any stack is. And who is known by some
//! addresses is not listened to at others.

use std::collections::{BTreeMap, BTreeSet};
use std::net::IpAddr;
use std::time::{Duration, Instant};

use super::lease::LeaseQueue;
use super::remote_participant::{Origins, RemoteParticipant, Standing};
use super::{DiscoveryLimits, EndpointData, ParticipantData};
use crate::wire::{Guid, GuidPrefix};

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

/// What became of a participant that has answered our discovery traffic.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Proof {
    /// It is proven from now on.
    New {
        /// What it was before.
        before: Standing,
        /// The participant that has to make room for it.
        evicted: Option<GuidPrefix>,
    },
    /// It is not known, or was proven before.
    Old,
    /// Too many are proven that come from its address: it remains what it was.
    NoRoom,
}

/// The tables.
#[derive(Debug)]
pub(super) struct Database {
    limits: DiscoveryLimits,
    origins: Origins,
    participants: BTreeMap<GuidPrefix, RemoteParticipant>,
    leases: LeaseQueue,
    /// Unproven participants in the order of their discovery.
    unproven: BTreeSet<(u64, GuidPrefix)>,
    /// How many participants are proven that come from an address.
    proven: BTreeMap<IpAddr, usize>,
    discovered: u64,
    endpoints: usize,
}

impl Database {
    /// Who was silent for so long may have to make room: whatever lease they announce, stacks announce themselves each
    /// few seconds, or each 30 s.
    const SILENCE: Duration = Duration::from_secs(120);

    /// Empty tables, of participants whose datagrams come from `origins`.
    pub(super) fn new(limits: DiscoveryLimits, origins: Origins) -> Self {
        Self {
            limits,
            origins,
            participants: BTreeMap::new(),
            leases: LeaseQueue::default(),
            unproven: BTreeSet::new(),
            proven: BTreeMap::new(),
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
        self.origins.own = own;
        let mut changed = Vec::new();
        for (prefix, participant) in &mut self.participants {
            if participant.move_to(&self.origins) {
                changed.push(*prefix);
            }
        }
        changed
    }

    /// Notes an announcement that came from `source`, an address of the participant where it is known. Where it has
    /// been answered, nobody need know of a new participant before it is proven. An evicted participant is still
    /// there, for the caller to remove with all that hangs on it.
    pub(super) fn announce(
        &mut self,
        now: Instant,
        source: IpAddr,
        data: ParticipantData,
        is_answered: bool,
    ) -> Announced {
        let prefix = data.prefix;
        let Some(known) = self.participants.get_mut(&prefix) else {
            return self.announce_new(now, source, data, is_answered);
        };
        let is_changed = !known.data.says_the_same(&data);
        if is_changed {
            if known.is_proven() {
                leave(&mut self.proven, known.source());
                *self.proven.entry(source).or_default() += 1;
            }
            known.update(source, &self.origins, data);
            self.leases.revoke(prefix, &known.lease);
            known.lease = self.leases.grant(now, prefix, known.patience());
        } else {
            self.leases.renew(now, prefix, &mut known.lease);
        }
        if known.is_pending() && !is_answered {
            known.standing = Standing::Unproven;
            Announced::New { evicted: None }
        } else if is_changed {
            Announced::Changed
        } else {
            Announced::Unchanged
        }
    }

    fn announce_new(
        &mut self,
        now: Instant,
        source: IpAddr,
        data: ParticipantData,
        is_answered: bool,
    ) -> Announced {
        let mut evicted = None;
        if self.participants.len() >= self.limits.participants {
            let oldest = self.unproven.first().map(|(_, oldest)| *oldest);
            evicted = oldest.or_else(|| self.find_silent(now, |_| true));
            if evicted.is_none() {
                return Announced::NoRoom;
            }
        }
        let standing = if is_answered {
            Standing::Pending
        } else {
            Standing::Unproven
        };
        self.insert(now, source, data, standing);
        Announced::New { evicted }
    }

    /// Adds a participant that is not there.
    pub(super) fn insert(
        &mut self,
        now: Instant,
        source: IpAddr,
        data: ParticipantData,
        standing: Standing,
    ) {
        let prefix = data.prefix;
        let number = self.discovered;
        self.discovered += 1;
        if standing == Standing::Proven {
            *self.proven.entry(source).or_default() += 1;
        } else {
            self.unproven.insert((number, prefix));
        }
        let lease = self.leases.grant(now, prefix, standing.patience(&data));
        let participant =
            RemoteParticipant::new(data, source, &self.origins, standing, lease, number);
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
            self.leases.renew(at, prefix, &mut participant.lease);
        }
    }

    /// The participant has answered our discovery traffic. An evicted participant is still there, for the caller to
    /// remove with all that hangs on it.
    pub(super) fn prove(&mut self, now: Instant, prefix: GuidPrefix) -> Proof {
        let known = self.get(prefix).filter(|known| !known.is_proven());
        let Some(source) = known.map(RemoteParticipant::source) else {
            return Proof::Old;
        };
        let of_source = self.proven.get(&source).copied().unwrap_or_default();
        let mut evicted = None;
        if of_source >= self.limits.participants / 2 {
            evicted = self.find_silent(now, |known| known.source() == source);
            if evicted.is_none() {
                return Proof::NoRoom;
            }
        }
        let Some(participant) = self.participants.get_mut(&prefix) else {
            return Proof::Old;
        };
        let before = std::mem::replace(&mut participant.standing, Standing::Proven);
        participant.settle(&self.origins);
        self.leases.revoke(prefix, &participant.lease);
        participant.lease = self.leases.grant(now, prefix, participant.patience());
        self.unproven.remove(&(participant.number, prefix));
        *self.proven.entry(source).or_default() += 1;
        Proof::New { before, evicted }
    }

    /// The participant, of those that are proven, that gave no sign of life for longest, if that is long.
    fn find_silent(
        &self,
        now: Instant,
        is_eligible: impl Fn(&RemoteParticipant) -> bool,
    ) -> Option<GuidPrefix> {
        let mut silent = self.leases.silent_since(now.checked_sub(Self::SILENCE)?);
        silent.find(|prefix| {
            let known = self.get(*prefix).filter(|known| known.is_proven());
            known.is_some_and(&is_eligible)
        })
    }

    /// Notes whether an app waits for signs of life of its writers.
    pub(super) fn supervise(&mut self, prefix: GuidPrefix, is_supervised: bool) {
        if let Some(participant) = self.participants.get_mut(&prefix) {
            participant.is_supervised = is_supervised;
        }
    }

    /// Forgets a participant and all of its endpoints.
    pub(super) fn remove(&mut self, prefix: GuidPrefix) -> Option<RemoteParticipant> {
        let participant = self.participants.remove(&prefix)?;
        self.leases.revoke(prefix, &participant.lease);
        if participant.is_proven() {
            leave(&mut self.proven, participant.source());
        }
        self.unproven.remove(&(participant.number, prefix));
        self.endpoints -= participant.endpoints.len();
        Some(participant)
    }

    /// The participants whose leases have ended; they are still there.
    pub(super) fn take_ended(&mut self, now: Instant) -> Vec<GuidPrefix> {
        self.leases.take_ended(now)
    }

    /// When a lease may end.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.leases.poll_timeout()
    }

    /// Adds or replaces an endpoint of a known participant; false where there is no room.
    pub(super) fn insert_endpoint(&mut self, data: EndpointData) -> bool {
        let Some(participant) = self.get(data.guid.prefix) else {
            return false;
        };
        let is_known = participant.endpoints.contains_key(&data.guid.entity);
        let has_room = participant.endpoints.len() < self.limits.endpoints_per_participant
            && self.has_room_for_endpoints(participant.source());
        let Some(participant) = self.participants.get_mut(&data.guid.prefix) else {
            return false;
        };
        if is_known || has_room {
            participant.endpoints.insert(data.guid.entity, data);
            self.endpoints += usize::from(!is_known);
        }
        is_known || has_room
    }

    /// Half of the table is for all, the other half for those whose address does not have a half.
    fn has_room_for_endpoints(&self, source: IpAddr) -> bool {
        let share = self.limits.endpoints / 2;
        self.endpoints < share
            || self.endpoints < self.limits.endpoints && {
                let of_source = self.iter().filter(|known| known.source() == source);
                of_source.map(|known| known.endpoints.len()).sum::<usize>() < share
            }
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

/// One participant less is proven that comes from an address.
fn leave(proven: &mut BTreeMap<IpAddr, usize>, source: IpAddr) {
    if let Some(count) = proven.get_mut(&source) {
        *count -= 1;
        if *count == 0 {
            proven.remove(&source);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::net::{Ipv4Addr, SocketAddr};

    use super::super::remote_participant::UNPROVEN_LEASE;
    use super::*;
    use crate::wire::EntityId;

    const SOURCE: IpAddr = IpAddr::V4(Ipv4Addr::new(10, 0, 0, 1));
    const OWN: IpAddr = IpAddr::V4(Ipv4Addr::new(10, 0, 0, 99));
    const ELSEWHERE: IpAddr = IpAddr::V4(Ipv4Addr::new(10, 6, 6, 6));

    fn database(participants: usize) -> Database {
        let limits = DiscoveryLimits {
            participants,
            ..DiscoveryLimits::default()
        };
        Database::new(limits, Origins::new(vec![OWN], true))
    }

    fn data(number: u8) -> ParticipantData {
        ParticipantData::new(GuidPrefix([number; 12]))
    }

    #[test]
    fn a_flood_replaces_only_the_unproven() {
        let now = Instant::now();
        let mut database = database(3);
        for number in [1, 2] {
            database.announce(now, SOURCE, data(number), false);
        }
        prove(&mut database, now, 1);
        let mut evictions = Vec::new();
        for number in 3..=9 {
            match database.announce(now, ELSEWHERE, data(number), false) {
                Announced::New { evicted } => {
                    evictions.extend(evicted.map(|prefix| prefix.0[0]));
                    evicted.map(|prefix| database.remove(prefix));
                }
                other => panic!("{other:?}"),
            }
        }
        assert_eq!(evictions, [2, 3, 4, 5, 6, 7]);
        assert_eq!(database.iter().count(), 3);
    }

    fn prove(database: &mut Database, now: Instant, number: u8) -> Proof {
        let prefix = GuidPrefix([number; 12]);
        let proof = database.prove(now, prefix);
        if let Proof::New {
            evicted: Some(evicted),
            ..
        } = proof
        {
            database.remove(evicted);
        }
        proof
    }

    /// With the proven participants 1 to 3, of an address each, which want to be remembered for ever.
    fn full(now: Instant) -> Database {
        let mut database = database(3);
        for number in 1..=3 {
            let mut data = data(number);
            data.lease = crate::wire::Duration::INFINITE;
            database.announce(now, [10, 0, 0, number].into(), data, false);
            prove(&mut database, now, number);
        }
        database
    }

    #[test]
    fn the_proven_make_room_only_when_they_have_fallen_silent() {
        let now = Instant::now();
        let mut database = full(now);
        let announced =
            |database: &mut Database, at| database.announce(now + at, ELSEWHERE, data(4), false);
        let soon = Database::SILENCE - Duration::from_secs(1);
        assert_eq!(announced(&mut database, soon), Announced::NoRoom);
        for alive in [1, 3] {
            database.renew(now + soon, GuidPrefix([alive; 12]));
        }
        let evicted = Some(GuidPrefix([2; 12]));
        assert_eq!(
            announced(&mut database, Database::SILENCE),
            Announced::New { evicted }
        );
    }

    #[test]
    fn one_address_has_half_of_the_table() {
        let now = Instant::now();
        let mut database = database(6);
        for number in 1..=6 {
            database.announce(now, ELSEWHERE, data(number), false);
        }
        for number in 1..=3 {
            let before = Standing::Unproven;
            let evicted = None;
            assert_eq!(
                prove(&mut database, now, number),
                Proof::New { before, evicted }
            );
        }
        assert_eq!(prove(&mut database, now, 4), Proof::NoRoom);
        assert_eq!(prove(&mut database, now, 3), Proof::Old);
        let later = now + Database::SILENCE;
        database.renew(later, GuidPrefix([1; 12]));
        database.renew(later, GuidPrefix([3; 12]));
        let (before, evicted) = (Standing::Unproven, Some(GuidPrefix([2; 12])));
        assert_eq!(
            prove(&mut database, later, 4),
            Proof::New { before, evicted }
        );
        assert_eq!(prove(&mut database, later, 5), Proof::NoRoom);
        database.announce(later, SOURCE, data(7), false);
        assert_ne!(prove(&mut database, later, 7), Proof::NoRoom);
    }

    #[test]
    fn only_its_own_addresses_speak_for_a_participant() {
        let now = Instant::now();
        let mut database = database(3);
        let mut announced = data(1);
        let second_interface = IpAddr::from([10, 0, 1, 1]);
        announced.metatraffic_unicast = vec![SocketAddr::new(second_interface, 7410)];
        let prefix = announced.prefix;
        database.announce(now, SOURCE, announced, false);
        assert!(!database.is_foreign(prefix, SOURCE));
        assert!(!database.is_foreign(prefix, second_interface));
        for other in [ELSEWHERE, OWN, Ipv4Addr::LOCALHOST.into()] {
            assert!(database.is_foreign(prefix, other));
        }
        assert!(!database.is_foreign(GuidPrefix([2; 12]), ELSEWHERE));
    }

    #[test]
    fn the_order_of_locators_is_no_change() {
        let now = Instant::now();
        let mut database = database(3);
        let mut announced = data(1);
        let locators = [[10, 0, 0, 1], [10, 0, 1, 1]].map(|ip| SocketAddr::from((ip, 7411)));
        announced.default_unicast = locators.to_vec();
        database.announce(now, SOURCE, announced.clone(), false);
        announced.default_unicast.reverse();
        let other_link = locators[1].ip();
        let again = database.announce(now, other_link, announced.clone(), false);
        assert_eq!(again, Announced::Unchanged);
        announced.default_unicast.pop();
        let fewer = database.announce(now, other_link, announced, false);
        assert_eq!(fewer, Announced::Changed);
    }

    #[test]
    fn a_participant_on_this_host_may_use_all_of_its_addresses() {
        let mut database = database(3);
        database.announce(Instant::now(), OWN, data(1), false);
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
        database.announce(now, SOURCE, announced, false);
        let user = |database: &Database| database.get(prefix).map(|known| known.user.clone());
        assert_eq!(user(&database), Some(vec![SocketAddr::new(SOURCE, 7411)]));
        assert_eq!(database.poll_timeout(), Some(now + UNPROVEN_LEASE));
        assert_ne!(database.prove(now, prefix), Proof::Old);
        assert_eq!(user(&database), Some(vec![elsewhere]));
        assert_eq!(database.poll_timeout(), None);
    }

    #[test]
    fn endpoints_are_bounded() {
        let limits = DiscoveryLimits {
            participants: 9,
            endpoints_per_participant: 2,
            endpoints: 4,
        };
        let mut database = Database::new(limits, Origins::new(vec![OWN], true));
        let insert = |database: &mut Database, participant, entity| {
            database.insert_endpoint(EndpointData {
                guid: Guid::new(GuidPrefix([participant; 12]), EntityId([1, 0, entity, 2])),
                topic: "t".to_owned(),
                type_name: String::new(),
                type_information: Vec::new(),
                content_filter: None,
                unicast: Vec::new(),
                multicast: Vec::new(),
                expects_inline_qos: false,
                qos: crate::qos::Qos::default(),
            })
        };
        assert!(!insert(&mut database, 1, 1), "unknown participant");
        for (number, source) in [(1, SOURCE), (2, ELSEWHERE), (3, SOURCE), (4, OWN)] {
            database.announce(Instant::now(), source, data(number), false);
        }
        assert!(insert(&mut database, 1, 1));
        assert!(insert(&mut database, 1, 2));
        assert!(insert(&mut database, 1, 2), "known");
        assert!(!insert(&mut database, 1, 3), "of one participant");
        assert!(!insert(&mut database, 3, 1), "of one address");
        assert!(insert(&mut database, 2, 1));
        assert!(insert(&mut database, 2, 2));
        assert!(!insert(&mut database, 4, 1), "in all");
        database.remove(GuidPrefix([1; 12]));
        assert!(insert(&mut database, 4, 1));
    }
}
