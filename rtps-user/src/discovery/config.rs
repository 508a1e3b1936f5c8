//! What discovery is started with.

use std::net::SocketAddr;
use std::time::Duration;

use super::ParticipantData;
use crate::wire::Timestamp;

/// Who we are and how we make ourselves known.
#[derive(Clone, Debug)]
pub struct DiscoveryConfig {
    /// What we announce.
    pub participant: ParticipantData,
    /// The groups that announcements go to.
    pub multicast: Vec<SocketAddr>,
    /// Further addresses that announcements go to.
    pub peers: Vec<SocketAddr>,
    /// The time between two announcements.
    pub announce_period: Duration,
    /// The most bytes of UDP payload in one datagram.
    pub datagram_size: u16,
    /// How long ago counts in HEARTBEATs and ACKNACKs began.
    pub count_age: Duration,
    /// A low-level layer answers discovery messages and hands over the news.
    pub kernel_discovery: bool,
    /// Datagrams of a participant are taken only from its own addresses.
    pub bind_addresses: bool,
    /// The wall-clock time at the start, for source timestamps.
    pub started: Timestamp,
    /// How much is remembered.
    pub limits: DiscoveryLimits,
}

/// Bounds of the tables of remote participants and endpoints.
#[derive(Clone, Copy, Debug)]
pub struct DiscoveryLimits {
    /// Participants; in a full table a new one replaces the oldest that has not yet proved to be real, if there is
    /// any.
    pub participants: usize,
    /// Endpoints of one participant; who announces more is no longer listened to.
    pub endpoints_per_participant: usize,
    /// Endpoints of all participants.
    pub endpoints: usize,
}

impl Default for DiscoveryLimits {
    fn default() -> Self {
        Self {
            participants: 4096,
            endpoints_per_participant: 4096,
            endpoints: 1 << 17,
        }
    }
}
