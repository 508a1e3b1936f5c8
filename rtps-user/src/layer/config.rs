//! What a layer is started with.

use std::net::SocketAddr;
use std::time::Duration;

use crate::discovery::{DiscoveryConfig, DiscoveryLimits, ParticipantData};
use crate::wire::{self, GuidPrefix, Timestamp};

/// Identity, addresses, timing and bounds of a [`Layer`](super::Layer).
#[derive(Clone, Debug)]
pub struct LayerConfig {
    /// The GUID prefix of the host's participant; the same after a restart that is to go unnoticed.
    pub prefix: GuidPrefix,
    /// The DDS domain.
    pub domain: u32,
    /// The participant's name, for people who look at the domain (PID_ENTITY_NAME).
    pub name: String,
    /// What apps want others to see in the participant's announcement (USER_DATA).
    pub user_data: Vec<u8>,
    /// Where the layer receives discovery traffic: announced as metatraffic unicast locators.
    pub metatraffic: Vec<SocketAddr>,
    /// Where the host's apps receive samples: announced as default unicast locators.
    pub user: Vec<SocketAddr>,
    /// Where the apps of this host reach each other without channels, and an app itself.
    pub loopback: SocketAddr,
    /// Where announcements go beside the multicast group: addresses of hosts that multicast does not reach.
    pub peers: Vec<SocketAddr>,
    /// The groups that announcements go to and come from; none where multicast is not wanted.
    pub multicast: Vec<SocketAddr>,
    /// How long others keep the host's participant after its last sign of life.
    pub lease: Duration,
    /// The time between two announcements; well below the lease.
    pub announce_period: Duration,
    /// The most bytes of UDP payload in one datagram.
    pub datagram_size: u16,
    /// How long ago counts in HEARTBEATs and ACKNACKs began. They follow the time, so that those of the low-level layer
    /// and those after a restart with the same prefix go on from each other.
    pub count_age: Duration,
    /// The low-level layer answers discovery messages and hands over the news
    /// ([`handle_answered`](super::Layer::handle_answered)); it is told what it needs for that.
    pub kernel_discovery: bool,
    /// Apps of this host are connected by shared memory ([`LayerOutput::Channel`](super::LayerOutput::Channel)); else
    /// they reach each other at `loopback`.
    pub channels: bool,
    /// Datagrams of a participant are taken only from its own addresses; to be switched off for hosts that send from
    /// addresses that they do not announce.
    pub bind_addresses: bool,
    /// The wall-clock time at the start, for the source timestamps of discovery samples.
    pub started: Timestamp,
    /// How long endpoints of apps stay declared after a restart of the layer until the apps come back.
    pub resume_grace: Duration,
    /// How much the layer remembers.
    pub limits: Limits,
}

/// Bounds of the layer's tables.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Remote participants and endpoints.
    pub discovery: DiscoveryLimits,
    /// Endpoints of one app.
    pub endpoints_per_app: usize,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            discovery: DiscoveryLimits::default(),
            endpoints_per_app: 4096,
        }
    }
}

impl LayerConfig {
    /// A layer of `domain` for `prefix`, reachable only within this host until addresses are added: no peers, no
    /// multicast, lease 20 s, announcements each 5 s.
    pub fn new(prefix: GuidPrefix, domain: u32, loopback: SocketAddr) -> Self {
        Self {
            prefix,
            domain,
            name: String::new(),
            user_data: Vec::new(),
            metatraffic: Vec::new(),
            user: Vec::new(),
            loopback,
            peers: Vec::new(),
            multicast: Vec::new(),
            lease: Duration::from_secs(20),
            announce_period: Duration::from_secs(5),
            datagram_size: 1472,
            count_age: Duration::ZERO,
            kernel_discovery: false,
            channels: false,
            bind_addresses: true,
            started: Timestamp::default(),
            resume_grace: Duration::from_secs(5),
            limits: Limits::default(),
        }
    }

    /// The part that discovery needs.
    pub(super) fn discovery(&self) -> DiscoveryConfig {
        DiscoveryConfig {
            participant: ParticipantData {
                domain: Some(self.domain),
                name: self.name.clone(),
                user_data: self.user_data.clone(),
                metatraffic_unicast: self.metatraffic.clone(),
                metatraffic_multicast: self.multicast.clone(),
                default_unicast: self.user.clone(),
                lease: wire::Duration::from_std(self.lease),
                ..ParticipantData::new(self.prefix)
            },
            multicast: self.multicast.clone(),
            peers: self.peers.clone(),
            announce_period: self.announce_period,
            datagram_size: self.datagram_size,
            count_age: self.count_age,
            kernel_discovery: self.kernel_discovery,
            bind_addresses: self.bind_addresses,
            started: self.started,
            limits: self.limits.discovery,
        }
    }
}
