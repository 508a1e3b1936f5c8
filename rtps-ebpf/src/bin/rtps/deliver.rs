//! Delivery: one record into the ring of each app concerned, then a look at its bell.

use core::ops::ControlFlow;

use rtps_ebpf::{
    Counter,
    abi::{App, SLOTS},
    frame::{UDP_CHECKSUM, UDP_DESTINATION},
};

use crate::{
    maps::{self, Counters, Ring, Scratch},
    sys::{Message, Overwrite, Packet, Repeat, repeat},
};

/// Turns the datagram whose UDP header is at `udp` into the doorbell of the app with this port. The app does not read
/// it; it is not cut here, which would cost more work than it saves there (a burst is, for other reasons, before this).
/// Its UDP checksum is left out, as IPv4 allows: frames of a local veth peer do not have a complete one.
#[inline(always)]
pub(crate) fn ring(packet: &impl Overwrite, udp: u32, port: u16) -> Result<(), ()> {
    packet.store_u16(udp + UDP_DESTINATION, port)?;
    packet.store_u16(udp + UDP_CHECKSUM, 0)
}

/// What a hook wants delivered; `scratch` holds the record's header and the apps.
pub(crate) struct Delivery<'a, P> {
    pub(crate) message: &'a Message<P>,
    pub(crate) scratch: &'a mut Scratch,
    pub(crate) counters: Counters,
    /// Whether the datagram itself may serve as the doorbell of one app.
    pub(crate) doorbell_by_packet: bool,
}

impl<P: Packet> Delivery<'_, P> {
    /// Delivers, and returns the port of the app that the datagram itself has to wake, if any.
    #[inline(never)]
    pub(crate) fn run(&mut self) -> Option<u16> {
        self.scratch.delivered = 0;
        self.scratch.doorbell_port = 0;
        repeat(SLOTS, self);
        if self.scratch.delivered != 0 {
            self.counters.count(Counter::DeliveredMessages);
        }
        let port = self.scratch.doorbell_port;
        (port != 0).then_some(port as u16)
    }
}

impl<P: Packet> Repeat for Delivery<'_, P> {
    #[inline(always)]
    fn turn(&mut self) -> ControlFlow<()> {
        let Some(slot) = self.scratch.targets.pop() else {
            return ControlFlow::Break(());
        };
        self.deliver_to(u32::from(slot));
        ControlFlow::Continue(())
    }
}

impl<P: Packet> Delivery<'_, P> {
    #[inline(always)]
    fn deliver_to(&mut self, slot: u32) {
        let header = &self.scratch.header;
        let counters = self.counters;
        let (Some(app), Some(ring)) = (maps::app(slot, header.domain_index.into()), Ring::of(slot))
        else {
            counters.count(Counter::LostNoApp);
            return;
        };
        match ring.write(header, self.message) {
            Ok(()) => {
                self.scratch.delivered = 1;
                counters.count(Counter::DeliveredRecords);
                counters.add(Counter::DeliveredBytes, header.message_len.into());
            }
            Err(()) => counters.count(Counter::LostRingFull),
        }
        // Even when the ring is full: an earlier doorbell may have got lost on its way.
        if maps::needs_wakeup(slot) {
            self.wake(app, ring);
        }
    }

    #[inline(always)]
    fn wake(&mut self, app: &App, ring: Ring) {
        let counters = self.counters;
        let port = app.doorbell_port;
        if self.doorbell_by_packet && self.scratch.doorbell_port == 0 && port != 0 {
            self.scratch.doorbell_port = port;
            counters.count(Counter::DoorbellPacket);
        } else {
            ring.wake();
            counters.count(Counter::DoorbellRing);
        }
    }
}
