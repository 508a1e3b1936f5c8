//! A matched remote endpoint: which local ones it is matched with, and where its datagrams may come from.
//!
//! A GUID is no secret, so that anybody can send in the name of another; few can do it from the other's address.

use std::net::IpAddr;

use crate::wire::EntityId;

/// A remote endpoint that is matched with some of ours.
#[derive(Debug, Default)]
pub(super) struct Match {
    locals: Vec<Local>,
    /// The last one that a datagram came from is the first; empty where any is accepted.
    addresses: Vec<IpAddr>,
}

/// One of our endpoints, and its place among them.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) struct Local {
    pub(super) id: EntityId,
    pub(super) place: u32,
}

impl Match {
    /// Our endpoints that it is matched with.
    pub(super) fn locals(&self) -> &[Local] {
        &self.locals
    }

    /// Adds one of our endpoints, or takes in other addresses.
    pub(super) fn insert(&mut self, local: Local, addresses: &[IpAddr]) {
        if !self.locals.contains(&local) {
            self.locals.push(local);
        }
        self.addresses = addresses.to_vec();
    }

    /// Takes one of our endpoints out; tells whether none remains.
    pub(super) fn remove(&mut self, local: EntityId) -> bool {
        self.locals.retain(|known| known.id != local);
        self.locals.is_empty()
    }

    /// Whether a datagram from there may be its own.
    #[inline]
    pub(super) fn accepts(&mut self, source: IpAddr) -> bool {
        match self.addresses.iter().position(|known| *known == source) {
            Some(0) => true,
            Some(position) => {
                self.addresses.swap(0, position);
                true
            }
            None => self.addresses.is_empty(),
        }
    }
}
