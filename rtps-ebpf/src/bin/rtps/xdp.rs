//! Hook 1, XDP: from a frame's verdict to an action.

use aya_ebpf::bindings::xdp_action::{XDP_DROP, XDP_PASS};
use rtps_ebpf::{
    Bytes as _, Counter,
    abi::{Config, DOORBELL_PACKET, HOOK_XDP, PORT_UNICAST, PortConfig, RecordHeader},
    frame::{Datagram, UDP_CHECKSUM, UDP_DESTINATION, UDP_LEN, unicast_datagram},
    walk::Concerned,
};

use crate::{
    deliver::Delivery,
    maps::{self, Counters},
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

/// Everything about a message that both its walk and its delivery need.
struct Arrival<'a> {
    frame: &'a Frame,
    datagram: Datagram,
    config: &'static Config,
    port: &'static PortConfig,
    counters: Counters,
}

#[inline(always)]
pub(crate) fn handle(frame: &Frame) -> u32 {
    let counters = Counters::of(frame.ifindex());
    let arrival = match arrival(frame, counters) {
        Ok(arrival) => arrival,
        Err(counter) => {
            counters.count(counter);
            return XDP_PASS;
        }
    };
    match verdict(&arrival) {
        Verdict::Pass(counter) => {
            counters.count(counter);
            XDP_PASS
        }
        Verdict::Drop(counter) => {
            counters.count(counter);
            XDP_DROP
        }
        Verdict::Delivered => XDP_DROP,
        Verdict::Ring { port } => match redirect(frame, &arrival.datagram, port) {
            Ok(()) => XDP_PASS,
            Err(()) => XDP_DROP,
        },
    }
}

/// Whether the frame is the layer's at all; if not, the counter to pass it under.
#[inline(always)]
fn arrival(frame: &Frame, counters: Counters) -> Result<Arrival<'_>, Counter> {
    let config = maps::config().ok_or(Counter::PassNotConfigured)?;
    let datagram = unicast_datagram(frame)?;
    let port = maps::port(datagram.ports.destination)
        .filter(|port| port.kind == PORT_UNICAST)
        .ok_or(Counter::PassNotOurPort)?;
    if !maps::is_own_address(&datagram.destination) {
        return Err(Counter::PassNotOurAddress);
    }
    Ok(Arrival {
        frame,
        datagram,
        config,
        port,
        counters,
    })
}

#[inline(always)]
fn verdict(arrival: &Arrival<'_>) -> Verdict {
    let (Some(domain), Some(scratch)) = (
        maps::domain(arrival.port.domain_index.into()),
        maps::scratch(),
    ) else {
        return Verdict::Pass(Counter::PassNotConfigured);
    };
    let Datagram { udp, ports, .. } = arrival.datagram;
    let message = arrival.frame.message(udp + UDP_LEN, ports.len - UDP_LEN);
    let now_ns = now_ns();
    let counters = arrival.counters;
    counters.count(Counter::XdpMessages);
    let findings = examine(&message, &domain.guid_prefix, now_ns, scratch);
    let concerned = findings.concerned();
    if let Ok(Concerned { built_in: true, .. }) = concerned {
        // The socket filter sees it next and counts the rest.
        return Verdict::Pass(Counter::PassBuiltIn);
    }
    counters.count_malformed(findings.malformed);
    let targets = match concerned {
        Ok(Concerned { targets, .. }) => targets,
        Err(counter) => return Verdict::Drop(counter),
    };
    scratch.header = header(arrival, message.len(), now_ns);
    let delivery = Delivery {
        message: &message,
        scratch,
        counters,
        doorbell_by_packet: arrival.config.doorbell == DOORBELL_PACKET && arrival.datagram.ipv4,
    };
    match delivery.run(&targets) {
        Some(port) => Verdict::Ring { port },
        None => Verdict::Delivered,
    }
}

#[inline(always)]
fn header(arrival: &Arrival<'_>, message_len: u32, now_ns: u64) -> RecordHeader {
    RecordHeader {
        message_len,
        ifindex: arrival.frame.ifindex(),
        domain_index: arrival.port.domain_index.into(),
        hook: HOOK_XDP,
        source_port: arrival.datagram.ports.source,
        source_address: arrival.datagram.source,
        received_ns: now_ns,
    }
}

/// Turns the datagram into the doorbell of the app with this port. It stays whole: the app does
/// not read it, and a shorter one would cost more work here than it saves there. Its UDP checksum
/// is left out, as IPv4 allows: frames of a local veth peer do not have a complete one.
#[inline(always)]
fn redirect(frame: &Frame, datagram: &Datagram, port: u16) -> Result<(), ()> {
    frame.store_u16(datagram.udp + UDP_DESTINATION, port)?;
    frame.store_u16(datagram.udp + UDP_CHECKSUM, 0)
}
