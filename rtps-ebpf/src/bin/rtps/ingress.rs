//! Hook 2, tc on ingress: discovery, decided and answered before the host's own stack sees it, and messages for apps
//! where there is no XDP.
//!
//! Unicast ends here. Multicast goes on to the other stacks of the host, with a mark for the socket
//! filter, so that rtpsd does not get it once more.

use aya_ebpf::bindings::tcx_action_base::{TCX_DROP, TCX_NEXT};
use rtps_ebpf::{
    Bytes as _, Counter,
    abi::{
        DISCOVERY_KERNEL, Domain, HOOK_INGRESS, INTERFACE_ANSWERS, INTERFACE_DELIVERS,
        PORT_MULTICAST, PORT_UNICAST, RecordHeader,
    },
    discovery::Exchange,
    frame::{Datagram, IPV4_MIN_LEN, IPV6_LEN, UDP_LEN, datagram},
};

use crate::{
    burst::{self, Taken},
    deliver::Delivery,
    emit::{ORIGINAL_BYTES, Reply},
    exchange::{Conversation, Voice},
    maps::{self, Counters, Scratch},
    message::examine,
    sys::{LinkBuffer, Message, Packet, now_ns},
};

/// What becomes of a frame.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Verdict {
    /// It goes its way as if this hook were not there; others count it.
    Pass,
    /// Nobody gets it.
    Drop(Counter),
    /// All has been done.
    Handled,
}

#[inline(always)]
pub(crate) fn handle(buffer: &LinkBuffer) -> i32 {
    let Some(scratch) = maps::scratch() else {
        return TCX_NEXT;
    };
    let tasks = maps::interface(buffer.ifindex()).map_or(0, |interface| interface.tasks);
    if let Err(counter) = arrive(buffer, scratch, tasks) {
        if tasks & INTERFACE_DELIVERS != 0 {
            // No other hook has counted it.
            Counters::of(buffer.ifindex()).count(counter);
        }
        return TCX_NEXT;
    }
    let verdict = decide(buffer, scratch);
    match verdict {
        Verdict::Pass => TCX_NEXT,
        Verdict::Drop(counter) => {
            Counters::of(buffer.ifindex()).count(counter);
            TCX_DROP
        }
        Verdict::Handled if scratch.datagram.multicast => {
            if let Some(domain) = maps::domain(scratch.header.domain_index.into()) {
                buffer.set_mark(handled(domain));
            }
            TCX_NEXT
        }
        Verdict::Handled => TCX_DROP,
    }
}

/// The mark on frames that this hook has handled. Each host has another: a frame keeps its mark on its
/// way into a container.
#[inline(always)]
pub(crate) const fn handled(domain: &Domain) -> u16 {
    let [.., a, b] = domain.guid_prefix;
    // 0 is no mark.
    u16::from_ne_bytes([a, b]) | 1
}

/// Apps first; the rest is discovery.
#[inline(always)]
fn decide(buffer: &LinkBuffer, scratch: &mut Scratch) -> Verdict {
    if scratch.is_for_apps {
        match burst::take(buffer, scratch) {
            Taken::Left if !(scratch.may_converse && is_plain(&scratch.datagram)) => {
                return Verdict::Pass;
            }
            Taken::Left => {}
            Taken::Nobody(counter) => return Verdict::Drop(counter),
            Taken::Delivered => return Verdict::Handled,
            Taken::Rings => return Verdict::Pass,
        }
    }
    match deliver(buffer, scratch) {
        Err(verdict) => verdict,
        Ok(()) => converse(buffer, scratch),
    }
}

/// Notes the datagram, if it is one that this hook may take; if not, the counter to pass it under.
#[inline(never)]
fn arrive(buffer: &LinkBuffer, scratch: &mut Scratch, tasks: u16) -> Result<(), Counter> {
    let config = maps::config().ok_or(Counter::PassNotConfigured)?;
    if !buffer.is_for_this_host() {
        return Err(Counter::PassNotOurAddress);
    }
    scratch.datagram = datagram(buffer)?;
    let datagram = &scratch.datagram;
    let port = maps::port(datagram.ports.destination).ok_or(Counter::PassNotOurPort)?;
    if datagram.multicast {
        // With a tag it is for another interface, where it comes by once more.
        if port.kind != PORT_MULTICAST || buffer.has_vlan_tag() {
            return Err(Counter::PassMulticast);
        }
    } else if port.kind == PORT_MULTICAST || !maps::is_own_address(&datagram.destination) {
        return Err(Counter::PassNotOurAddress);
    }
    scratch.is_for_apps = port.kind == PORT_UNICAST && tasks & INTERFACE_DELIVERS != 0;
    // What is for apps is asked for its looks only where it turns out to be for others.
    scratch.may_converse = config.discovery == DISCOVERY_KERNEL
        && buffer.segment() == 0
        && (scratch.is_for_apps || is_plain(datagram));
    if !scratch.is_for_apps && !scratch.may_converse {
        return Err(match datagram.multicast {
            true => Counter::PassMulticast,
            false => Counter::PassMetatraffic,
        });
    }
    let now_ns = now_ns();
    scratch.lookup.turn_to(datagram.source, config, now_ns);
    scratch.header = RecordHeader {
        message_len: datagram.ports.len - UDP_LEN,
        ifindex: buffer.ifindex(),
        domain_index: port.domain_index,
        segment: buffer.segment() as u16,
        hook: HOOK_INGRESS,
        flags: 0,
        source_port: datagram.ports.source,
        source_address: datagram.source,
        received_ns: now_ns,
    };
    Ok(())
}

/// Whether its frame can be made the frame of an answer, to another host.
#[inline(always)]
fn is_plain(datagram: &Datagram) -> bool {
    let header_len = if datagram.ipv4 {
        IPV4_MIN_LEN
    } else {
        IPV6_LEN
    };
    datagram.udp == datagram.ip + header_len && !maps::is_own_address(&datagram.source)
}

/// Takes the message from the stack if it concerns built-in endpoints, or nobody; apps get theirs.
#[inline(never)]
fn deliver(buffer: &LinkBuffer, scratch: &mut Scratch) -> Result<(), Verdict> {
    let message = message(buffer, scratch);
    let domain = maps::domain(scratch.header.domain_index.into()).ok_or(Verdict::Pass)?;
    let built_in = examine(&message, scratch, domain);
    let is_own = *scratch.walk.sender() == domain.guid_prefix;
    if is_own || built_in == Ok(false) || built_in.is_err() && scratch.datagram.multicast {
        return Err(Verdict::Pass);
    }
    let counters = Counters::of(buffer.ifindex());
    counters.count(Counter::IngressMessages);
    counters.count_malformed(scratch.malformed);
    built_in.map_err(Verdict::Drop)?;
    let mut delivery = Delivery {
        message: &message,
        scratch,
        counters,
        doorbell_by_packet: false,
    };
    delivery.run();
    Ok(())
}

/// Does what the built-in endpoints would.
#[inline(never)]
fn converse(buffer: &LinkBuffer, scratch: &mut Scratch) -> Verdict {
    let domain = maps::domain(scratch.header.domain_index.into());
    let (Some(exchange), Some(domain)) = (maps::exchange(), domain) else {
        return Verdict::Handled;
    };
    let message = message(buffer, scratch);
    let may_answer = may_answer(buffer, domain, scratch);
    let mut conversation = Conversation {
        message: &message,
        scratch,
        exchange,
        domain,
    };
    let Ok(speaks) = conversation.listen(may_answer) else {
        return Verdict::Handled;
    };
    if !speaks {
        conversation.commit();
        return Verdict::Handled;
    }
    let Some(reply) = maps::reply() else {
        return Verdict::Handled;
    };
    let mut answering = Answering { buffer, reply };
    conversation.speak(&mut answering);
    conversation.commit();
    answering.finish()
}

#[inline(always)]
fn message(buffer: &LinkBuffer, scratch: &Scratch) -> Message<impl Packet + use<>> {
    buffer.message(scratch.datagram.udp + UDP_LEN, scratch.header.message_len)
}

/// Prepares for answers; they are possible while rtpsd lives and where the interface has an address for
/// them.
#[inline(never)]
fn may_answer(buffer: &LinkBuffer, domain: &Domain, scratch: &Scratch) -> bool {
    let (Some(config), Some(interface), Some(reply)) = (
        maps::config(),
        maps::interface(buffer.ifindex()),
        maps::reply(),
    ) else {
        return false;
    };
    let datagram = &scratch.datagram;
    let now_ns = scratch.header.received_ns;
    let is_too_long = datagram.multicast && buffer.len() > ORIGINAL_BYTES as u32;
    interface.tasks & INTERFACE_ANSWERS != 0
        && now_ns <= config.answer_until_ns
        && !is_too_long
        && reply
            .prepare(datagram, interface, domain.metatraffic_port as u16, now_ns)
            .is_ok()
}

/// Answers by way of the frame that came in.
struct Answering<'a> {
    buffer: &'a LinkBuffer,
    reply: &'static mut Reply,
}

impl Voice for Answering<'_> {
    #[inline(never)]
    fn say(&mut self, exchange: &Exchange) -> Result<(), ()> {
        if !self.reply.has_begun {
            let port = exchange.peer.reply_port as u16;
            self.reply.begin(self.buffer, port)?;
        }
        let answer = &exchange.answer;
        self.reply.send(self.buffer, &answer.bytes, answer.len)
    }
}

impl Answering<'_> {
    #[inline(never)]
    fn finish(&self) -> Verdict {
        match self.reply.restore(self.buffer) {
            Ok(()) => Verdict::Handled,
            Err(()) => Verdict::Drop(Counter::LostOriginal),
        }
    }
}
