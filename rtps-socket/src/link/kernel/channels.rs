//! The app's channels: shared memory to and from other apps of its host, by their slots.

use std::collections::BTreeMap;
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::sync::Arc;

use rtps_user::local;

use super::CHANNEL;
use crate::link::{Burst, Sink};
use crate::sys::channel::{Inbound, Inlet, Outbound};
use crate::sys::{Epoll, Interest};

/// Datagrams that one call takes out of one channel: bounds how long timers, and other channels, wait in a flood.
const DATAGRAMS_AT_ONCE: usize = 64;

#[derive(Debug)]
struct Channel {
    outbound: Outbound,
    inbound: Inbound,
    /// Of the channel that this one replaced: the other app may still use it, or have used it for what was not read yet.
    replaced: Option<Inbound>,
}

/// See the module.
#[derive(Debug)]
pub(super) struct Channels {
    by_slot: BTreeMap<u8, Channel>,
    epoll: Arc<Epoll>,
    /// Where a datagram is copied to before it is looked at.
    datagram: Vec<u8>,
}

impl Channels {
    /// None yet; what wakes the app will be in `epoll`.
    pub(super) fn new(epoll: &Arc<Epoll>) -> Self {
        Self {
            by_slot: BTreeMap::new(),
            epoll: Arc::clone(epoll),
            datagram: Vec::new(),
        }
    }

    /// Takes a channel with another app, with the descriptors that came beside
    /// [`FromLayer::Channel`](rtps_user::layer::protocol::FromLayer::Channel).
    pub(super) fn open(&mut self, slot: u8, descriptors: Vec<OwnedFd>) -> io::Result<()> {
        let [to, wake, from, pipe] = descriptors
            .try_into()
            .map_err(|_| io::Error::from(io::ErrorKind::InvalidData))?;
        let outbound = Outbound::map(to, wake)?;
        let inbound = Inbound::map(from, pipe)?;
        self.epoll.add(inbound.as_fd(), CHANNEL, Interest::Edge)?;
        let replaced = self.by_slot.remove(&slot).map(|channel| channel.inbound);
        let channel = Channel {
            outbound,
            inbound,
            replaced,
        };
        self.by_slot.insert(slot, channel);
        Ok(())
    }

    /// The other app is gone.
    pub(super) fn close(&mut self, slot: u8) {
        self.by_slot.remove(&slot);
    }

    /// Sends datagrams to another app; false when not all of them could be.
    pub(super) fn send(&mut self, slot: u8, burst: &Burst<'_>) -> bool {
        let channel = self.by_slot.get_mut(&slot);
        channel.is_some_and(|channel| channel.outbound.send(burst.datagrams()))
    }

    /// What other threads may look at to see whether something has arrived; another one after each
    /// [`open`](Self::open) and [`close`](Self::close).
    pub(super) fn inlets(&self) -> Vec<Arc<Inlet>> {
        self.inbound()
            .map(|inbound| Arc::clone(inbound.inlet()))
            .collect()
    }

    /// Takes what has arrived. It counts as sent from the other app's [`local::address`], whatever it says.
    pub(super) fn receive(&mut self, sink: &mut Sink<'_>) {
        for (slot, channel) in &mut self.by_slot {
            let source = local::address(*slot);
            for inbound in channel.replaced.iter_mut().chain([&mut channel.inbound]) {
                inbound.drain(DATAGRAMS_AT_ONCE, &mut self.datagram, |datagram| {
                    sink(source, datagram);
                });
            }
        }
    }

    /// Asks to be woken; false when something has arrived already.
    pub(super) fn arm(&self) -> bool {
        self.inbound().for_each(Inbound::arm);
        !self.inbound().any(Inbound::has_record)
    }

    /// Awake: no wake-ups, please.
    pub(super) fn disarm(&self) {
        self.inbound().for_each(Inbound::disarm);
    }

    fn inbound(&self) -> impl Iterator<Item = &Inbound> {
        let channels = self.by_slot.values();
        channels.flat_map(|channel| channel.replaced.iter().chain([&channel.inbound]))
    }
}
