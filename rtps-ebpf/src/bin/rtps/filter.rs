//! Hook 3, the filter on the layer's own UDP sockets: whatever the other hooks passed, reassembled
//! fragments, loopback, and interfaces without XDP or tc.

use rtps_ebpf::{
    Bytes as _, Counter,
    abi::{DISCOVERY_KERNEL, HOOK_FILTER, RecordHeader},
    frame::{mapped, udp},
};

use crate::{
    deliver::Delivery,
    exchange::Conversation,
    ingress::handled,
    maps::{self, Counters, Scratch},
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
    /// Apps have it in their rings, and rtpsd in its, as far as it concerns them.
    Delivered,
    /// Nobody gets it. Other sockets of the port have copies of their own.
    Drop(Counter),
}

#[inline(always)]
pub(crate) fn handle(buffer: &SocketBuffer) -> i64 {
    let whole = i64::from(buffer.len());
    let (counter, len) = match verdict(buffer) {
        Verdict::Pass(counter) => (counter, whole),
        Verdict::ToDaemon => (Counter::ToDaemon, whole),
        Verdict::Drop(counter) => (counter, 0),
        Verdict::Delivered => return 0,
    };
    Counters::of(buffer.ifindex()).count(counter);
    len
}

#[inline(always)]
fn verdict(buffer: &SocketBuffer) -> Verdict {
    let Some(scratch) = maps::scratch() else {
        return Verdict::Pass(Counter::PassNotConfigured);
    };
    if let Err(counter) = arrive(buffer, scratch) {
        return Verdict::Pass(counter);
    }
    match deliver(buffer, scratch) {
        Ok(true) => converse(buffer, scratch),
        Ok(false) => Verdict::Delivered,
        Err(counter) => Verdict::Drop(counter),
    }
}

/// Notes the datagram, if it is the layer's; if not, the counter to pass it under.
#[inline(never)]
fn arrive(buffer: &SocketBuffer, scratch: &mut Scratch) -> Result<(), Counter> {
    let config = maps::config().ok_or(Counter::PassNotConfigured)?;
    let ports = udp(buffer, 0).ok_or(Counter::PassBadLengths)?;
    let port = maps::port(ports.destination).ok_or(Counter::PassNotOurPort)?;
    let source_address = source_address(buffer).unwrap_or_default();
    let now_ns = now_ns();
    scratch.lookup.turn_to(source_address, config, now_ns);
    scratch.header = RecordHeader {
        message_len: buffer.message().len(),
        ifindex: buffer.ifindex(),
        domain_index: port.domain_index,
        segment: 0,
        hook: HOOK_FILTER,
        flags: 0,
        source_port: ports.source,
        source_address,
        received_ns: now_ns,
    };
    Ok(())
}

/// Delivers to the apps, and says whether the message concerns built-in endpoints, too; if it concerns
/// nobody here, the counter to drop it under.
#[inline(never)]
fn deliver(buffer: &SocketBuffer, scratch: &mut Scratch) -> Result<bool, Counter> {
    let counters = Counters::of(buffer.ifindex());
    counters.count(Counter::FilterMessages);
    let domain =
        maps::domain(scratch.header.domain_index.into()).ok_or(Counter::PassNotConfigured)?;
    if buffer.mark() == handled(domain) {
        return Err(Counter::DropHandled);
    }
    let message = buffer.message();
    let built_in = examine(&message, scratch, domain);
    counters.count_malformed(scratch.malformed);
    let built_in = built_in?;
    let mut delivery = Delivery {
        message: &message,
        scratch,
        counters,
        doorbell_by_packet: false,
    };
    delivery.run();
    Ok(built_in)
}

/// Does what the built-in endpoints would, but for answers, or leaves it to rtpsd.
#[inline(never)]
fn converse(buffer: &SocketBuffer, scratch: &mut Scratch) -> Verdict {
    let (Some(config), Some(domain), Some(exchange)) = (
        maps::config(),
        maps::domain(scratch.header.domain_index.into()),
        maps::exchange(),
    ) else {
        return Verdict::ToDaemon;
    };
    if config.discovery != DISCOVERY_KERNEL {
        return Verdict::ToDaemon;
    }
    if *scratch.walk.sender() == domain.guid_prefix {
        return Verdict::Drop(Counter::DropOwn);
    }
    let message = buffer.message();
    let mut conversation = Conversation {
        message: &message,
        scratch,
        exchange,
        domain,
    };
    // Nothing can be sent from here: what asks for an answer is news.
    if conversation.listen(false).is_ok() {
        conversation.commit();
    }
    Verdict::Delivered
}

#[inline(always)]
fn source_address(buffer: &SocketBuffer) -> Option<[u8; 16]> {
    if buffer.protocol() == ETHERTYPE_IPV4 {
        buffer.load_network::<4>(IPV4_SOURCE).map(mapped)
    } else {
        buffer.load_network::<16>(IPV6_SOURCE)
    }
}
