//! A remote participant: what it says of itself, and how far that is believed.
//!
//! Anyone on the network can invent participants. An unproven one is sent to at no other address than its announcement
//! came from, and is soon forgotten unless it goes on.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr};
use std::time::Duration;

use super::lease::Lease;
use super::parameters::reachable;
use super::{EndpointData, ParticipantData};
use crate::RemoteEndpoint;
use crate::wire::EntityId;

/// The longest lease of an unproven participant: who answers does so within seconds.
pub(super) const UNPROVEN_LEASE: Duration = Duration::from_secs(30);

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
    pub(super) standing: Standing,
    /// An app waits for signs of life of one of its writers.
    pub(super) is_supervised: bool,
    pub(super) lease: Lease,
    /// Its place in the order of discovery.
    pub(super) number: u64,
}

/// How far a participant is to be believed in.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Standing {
    /// It was announced to the low-level layer, which has answered. Until it is proven nobody else need know of it.
    Pending,
    /// It was announced to us.
    Unproven,
    /// It has answered us.
    Proven,
}

impl Standing {
    /// How long a participant is remembered without a sign of life; `None` for ever.
    pub(super) fn patience(self, data: &ParticipantData) -> Option<Duration> {
        let lease = data.lease.to_std();
        if self == Self::Proven {
            lease
        } else {
            Some(lease.map_or(UNPROVEN_LEASE, |lease| lease.min(UNPROVEN_LEASE)))
        }
    }
}

impl RemoteParticipant {
    /// A participant without endpoints.
    pub(super) fn new(
        data: ParticipantData,
        source: IpAddr,
        origins: &Origins,
        standing: Standing,
        lease: Lease,
        number: u64,
    ) -> Self {
        let mut participant = Self {
            data,
            metatraffic: Vec::new(),
            user: Vec::new(),
            endpoints: BTreeMap::new(),
            source,
            addresses: Vec::new(),
            standing,
            is_supervised: false,
            lease,
            number,
        };
        participant.settle(origins);
        participant
    }

    /// The address that its announcements come from.
    pub fn source(&self) -> IpAddr {
        self.source
    }

    /// Whether it has answered us: anybody can announce anything.
    pub fn is_proven(&self) -> bool {
        self.standing == Standing::Proven
    }

    /// Whether only the low-level layer deals with it as yet.
    pub fn is_pending(&self) -> bool {
        self.standing == Standing::Pending
    }

    /// Where its datagrams may come from; empty where that is not checked.
    pub fn addresses(&self) -> &[IpAddr] {
        &self.addresses
    }

    /// The lease that it asks for; `None` for ever.
    pub fn lease(&self) -> Option<Duration> {
        self.data.lease.to_std()
    }

    /// Whether an app waits for signs of life of one of its writers.
    pub fn is_supervised(&self) -> bool {
        self.is_supervised
    }

    /// Where datagrams of it or of its endpoints may come from; empty where that is not checked.
    pub fn all_addresses(&self) -> Vec<IpAddr> {
        let mut addresses = self.addresses.clone();
        if !addresses.is_empty() {
            let endpoints = self.endpoints.values();
            addresses.extend(endpoints.flat_map(|data| data.unicast.iter().map(SocketAddr::ip)));
            addresses.sort();
            addresses.dedup();
        }
        addresses
    }

    /// How long it is remembered without a sign of life; `None` for ever.
    pub(super) fn patience(&self) -> Option<Duration> {
        self.standing.patience(&self.data)
    }

    /// Whether datagrams that come from there may be its own.
    pub(super) fn owns(&self, source: IpAddr) -> bool {
        self.addresses.is_empty() || self.addresses.contains(&source)
    }

    /// Takes in what it announces from `source`.
    pub(super) fn update(&mut self, source: IpAddr, origins: &Origins, data: ParticipantData) {
        self.source = source;
        self.data = data;
        self.settle(origins);
    }

    /// Our host has other addresses; gives whether those of the participant are others, too.
    pub(super) fn move_to(&mut self, origins: &Origins) -> bool {
        let before = std::mem::replace(&mut self.addresses, origins.of(&self.data, self.source));
        before != self.addresses
    }

    /// Derives its addresses.
    pub(super) fn settle(&mut self, origins: &Origins) {
        self.metatraffic = answerable(&self.data.metatraffic_unicast, self.source);
        self.user = self.destinations(&self.data.default_unicast);
        self.addresses = origins.of(&self.data, self.source);
    }

    /// Where its endpoints are reached that announce these addresses.
    fn destinations(&self, addresses: &[SocketAddr]) -> Vec<SocketAddr> {
        if self.is_proven() {
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
        if !addresses.is_empty() {
            addresses.extend(data.unicast.iter().map(SocketAddr::ip));
            addresses.sort();
            addresses.dedup();
        }
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
            takes_bare_keys: self.data.is_cyclone_0(),
            qos: data.qos.clone(),
            topic: data.topic.clone(),
            type_name: data.type_name.clone(),
            type_information: data.type_information.clone(),
            content_filter: data.content_filter.clone(),
        })
    }
}

/// Where datagrams of participants may come from.
#[derive(Debug)]
pub(super) struct Origins {
    /// The addresses of this host.
    pub(super) own: Vec<IpAddr>,
    is_checked: bool,
}

impl Origins {
    /// On a host with the addresses `own`.
    pub(super) fn new(own: Vec<IpAddr>, is_checked: bool) -> Self {
        Self { own, is_checked }
    }

    /// The addresses of a participant, since a host with several of them may use any; of one on this host any of ours,
    /// which nobody else can send from. Empty where that is not checked.
    fn of(&self, data: &ParticipantData, source: IpAddr) -> Vec<IpAddr> {
        if !self.is_checked {
            return Vec::new();
        }
        let announced = data.metatraffic_unicast.iter().chain(&data.default_unicast);
        let mut origins: Vec<_> = announced.map(SocketAddr::ip).collect();
        origins.push(source);
        if source.is_loopback() || self.own.contains(&source) {
            origins.extend(&self.own);
            origins.extend([
                IpAddr::from(Ipv4Addr::LOCALHOST),
                Ipv6Addr::LOCALHOST.into(),
            ]);
        }
        origins.sort();
        origins.dedup();
        origins
    }
}

/// Where discovery traffic for a participant goes, and all else as long as it is unproven: to the address that its
/// datagrams come from and nowhere else, for an invented announcement must not make us send to somebody who has never
/// heard of us.
fn answerable(addresses: &[SocketAddr], source: IpAddr) -> Vec<SocketAddr> {
    let mut answerable = reachable(addresses, source);
    answerable.truncate(1);
    if let Some(address) = answerable.first_mut() {
        address.set_ip(source);
    }
    answerable
}
