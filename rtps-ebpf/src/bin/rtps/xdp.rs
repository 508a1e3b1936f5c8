//! Hook 1, XDP: from a frame's verdict to an action.

use aya_ebpf::bindings::xdp_action::{XDP_DROP, XDP_PASS};
use rtps_ebpf::{
    Counter,
    abi::{
        DISCOVERY_KERNEL, DOORBELL_PACKET, HOOK_XDP, PORT_METATRAFFIC, PORT_MULTICAST, RecordHeader,
    },
    frame::{UDP_LEN, datagram},
};

use crate::{
    deliver::{Delivery, ring},
    maps::{self, Counters, Scratch},
    message::examine,
    sys::{Frame, now_ns},
};

/// What becomes of a frame.
enum Verdict {
    /// The kernel's own stack gets it, for the reason that the counter names.
    Pass(Counter),
    /// Nobody gets it.
    Drop(Counter),
    /// Apps have it in their rings.
    Delivered,
    /// The same, and the datagram goes on to the port of an app that sleeps.
    Ring { port: u16 },
}

#[inline(always)]
pub(crate) fn handle(frame: &Frame) -> u32 {
    let counters = Counters::of(frame.ifindex());
    let Some(scratch) = maps::scratch() else {
        return XDP_PASS;
    };
    let verdict = match arrive(frame, scratch) {
        Ok(()) => deliver(frame, scratch, counters),
        Err(counter) => Verdict::Pass(counter),
    };
    match verdict {
        Verdict::Pass(counter) => {
            counters.count(counter);
            XDP_PASS
        }
        Verdict::Drop(counter) => {
            counters.count(counter);
            XDP_DROP
        }
        Verdict::Delivered => XDP_DROP,
        Verdict::Ring { port } => match ring(frame, scratch.datagram.udp, port) {
            Ok(()) => XDP_PASS,
            Err(()) => XDP_DROP,
        },
    }
}

/// Notes the datagram, if it is the layer's; if not, the counter to pass it under.
#[inline(never)]
fn arrive(frame: &Frame, scratch: &mut Scratch) -> Result<(), Counter> {
    let config = maps::config().ok_or(Counter::PassNotConfigured)?;
    scratch.datagram = datagram(frame)?;
    let datagram = &scratch.datagram;
    if datagram.multicast {
        return Err(Counter::PassMulticast);
    }
    let port = maps::port(datagram.ports.destination)
        .filter(|port| port.kind != PORT_MULTICAST)
        .ok_or(Counter::PassNotOurPort)?;
    if !maps::is_own_address(&datagram.destination) {
        return Err(Counter::PassNotOurAddress);
    }
    if port.kind == PORT_METATRAFFIC && config.discovery == DISCOVERY_KERNEL {
        return Err(Counter::PassMetatraffic);
    }
    let now_ns = now_ns();
    scratch.lookup.turn_to(datagram.source, config, now_ns);
    scratch.header = RecordHeader {
        message_len: datagram.ports.len - UDP_LEN,
        ifindex: frame.ifindex(),
        domain_index: port.domain_index,
        segment: 0,
        hook: HOOK_XDP,
        flags: 0,
        source_port: datagram.ports.source,
        source_address: datagram.source,
        received_ns: now_ns,
    };
    Ok(())
}

#[inline(always)]
fn deliver(frame: &Frame, scratch: &mut Scratch, counters: Counters) -> Verdict {
    let (Some(config), Some(domain)) = (
        maps::config(),
        maps::domain(scratch.header.domain_index.into()),
    ) else {
        return Verdict::Pass(Counter::PassNotConfigured);
    };
    let message = frame.message(scratch.datagram.udp + UDP_LEN, scratch.header.message_len);
    counters.count(Counter::XdpMessages);
    let built_in = examine(&message, scratch, domain);
    if built_in == Ok(true) {
        // The next hook sees it, and counts the rest.
        return Verdict::Pass(Counter::PassBuiltIn);
    }
    counters.count_malformed(scratch.malformed);
    if let Err(counter) = built_in {
        return Verdict::Drop(counter);
    }
    let doorbell_by_packet = config.doorbell == DOORBELL_PACKET && scratch.datagram.ipv4;
    let mut delivery = Delivery {
        message: &message,
        scratch,
        counters,
        doorbell_by_packet,
    };
    match delivery.run() {
        Some(port) => Verdict::Ring { port },
        None => Verdict::Delivered,
    }
}
