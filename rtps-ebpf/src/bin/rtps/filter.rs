//! Hook 2, the filter on the layer's own UDP sockets: whatever XDP passed, multicast, reassembled
//! fragments, loopback, and interfaces without XDP.

use rtps_ebpf::{
    Bytes as _, Counter,
    abi::{HOOK_FILTER, PortConfig, RecordHeader},
    frame::{Udp, mapped, udp},
};

use crate::{
    deliver::Delivery,
    maps::{self, Counters},
    message::examine,
    sys::{SocketBuffer, now_ns},
};

const ETHERTYPE_IPV4: u16 = 0x0800;
const IPV4_SOURCE: u32 = 12;
const IPV6_SOURCE: u32 = 8;

/// What becomes of a datagram.
enum Verdict {
    /// The socket gets it although the layer does not understand it.
    Pass(Counter),
    /// The socket gets it: it concerns rtpsd.
    ToDaemon,
    /// Only apps got it.
    Delivered,
    /// Nobody gets it. Other sockets of the port have copies of their own.
    Drop(Counter),
}

#[inline(always)]
pub(crate) fn handle(buffer: &SocketBuffer) -> i64 {
    let counters = Counters::of(buffer.ifindex());
    let whole = i64::from(buffer.len());
    match verdict(buffer, counters) {
        Verdict::Pass(counter) => {
            counters.count(counter);
            whole
        }
        Verdict::ToDaemon => {
            counters.count(Counter::ToDaemon);
            whole
        }
        Verdict::Delivered => 0,
        Verdict::Drop(counter) => {
            counters.count(counter);
            0
        }
    }
}

#[inline(always)]
fn verdict(buffer: &SocketBuffer, counters: Counters) -> Verdict {
    if maps::config().is_none() {
        return Verdict::Pass(Counter::PassNotConfigured);
    }
    let Some(ports) = udp(buffer, 0) else {
        return Verdict::Pass(Counter::PassBadLengths);
    };
    let Some(port) = maps::port(ports.destination) else {
        return Verdict::Pass(Counter::PassNotOurPort);
    };
    let (Some(domain), Some(scratch)) = (maps::domain(port.domain_index.into()), maps::scratch())
    else {
        return Verdict::Pass(Counter::PassNotConfigured);
    };
    let message = buffer.message();
    let now_ns = now_ns();
    counters.count(Counter::FilterMessages);
    let findings = examine(&message, &domain.guid_prefix, now_ns, scratch);
    counters.count_malformed(findings.malformed);
    let concerned = match findings.concerned() {
        Ok(concerned) => concerned,
        Err(counter) => return Verdict::Drop(counter),
    };
    scratch.header = header(buffer, port, ports, message.len(), now_ns);
    let delivery = Delivery {
        message: &message,
        scratch,
        counters,
        doorbell_by_packet: false,
    };
    delivery.run(&concerned.targets);
    if concerned.built_in {
        Verdict::ToDaemon
    } else {
        Verdict::Delivered
    }
}

#[inline(always)]
fn header(
    buffer: &SocketBuffer,
    port: &PortConfig,
    ports: Udp,
    message_len: u32,
    now_ns: u64,
) -> RecordHeader {
    RecordHeader {
        message_len,
        ifindex: buffer.ifindex(),
        domain_index: port.domain_index.into(),
        hook: HOOK_FILTER,
        source_port: ports.source,
        source_address: source_address(buffer).unwrap_or_default(),
        received_ns: now_ns,
    }
}

#[inline(always)]
fn source_address(buffer: &SocketBuffer) -> Option<[u8; 16]> {
    if buffer.protocol() == ETHERTYPE_IPV4 {
        buffer.load_network::<4>(IPV4_SOURCE).map(mapped)
    } else {
        buffer.load_network::<16>(IPV6_SOURCE)
    }
}
