//! What the core wants sent.

use std::net::SocketAddr;
use std::sync::Arc;

/// A datagram for one or more destinations; the bytes stand in the buffer that `poll_transmit` was given.
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct Transmit {
    /// Where the datagram goes, each destination once. Shared, because it rarely changes between datagrams.
    pub destinations: Arc<[SocketAddr]>,
    /// The DSCP that it is to be marked with, the upper six bits of the IP header's TOS; 0 means nothing special.
    pub dscp: u8,
}

impl Transmit {
    /// For one destination.
    pub fn to(destination: SocketAddr) -> Self {
        Self {
            destinations: Arc::new([destination]),
            dscp: 0,
        }
    }
}
