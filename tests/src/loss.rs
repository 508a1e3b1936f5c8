//! A lossy link: a program on one end of a link that drops IP packets and counts them.
//!
//! netem is not in every kernel; tcx is since 6.6. ARP, ICMPv6 and MLD pass, so that a loss costs
//! a datagram and not the second that address resolution takes to try again.
//!
//! What an app sends in one call is one packet on a veth pair, up to 64 datagrams, and lost as one. Single datagrams
//! are lost by [`Bridge::lose`](crate::link::Bridge::lose).

use anyhow::{Result, ensure};

use crate::bpf::{self, Counters, Helper, Hook, Link};
use crate::link::Interface;
use crate::netns::Netns;

/// Which packets are lost.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Loss {
    /// Each packet with this probability, 0.0 to 1.0, independently of the others.
    Random(f64),
    /// The n-th, the 2n-th, the 3n-th...: the same packets in every run. 1 loses all.
    EveryNth(u32),
}

/// The direction, as the interface that carries the program sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Packets that the interface receives.
    Ingress,
    /// Packets that the interface sends.
    Egress,
}

/// What a lossy link has seen of one direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LossCount {
    /// Packets that may be dropped, lost ones included.
    pub seen: u64,
    /// Packets dropped.
    pub dropped: u64,
}

/// Packets are lost from [`Lossy::attach`] until the value is dropped.
pub struct Lossy {
    counters: Counters<2>,
    _link: Link,
}

impl Lossy {
    /// Lets packets in one direction through an interface of `netns` get lost. A kernel layer on
    /// that host takes packets off the link before [`Direction::Ingress`] could lose them.
    pub fn attach(
        netns: &Netns,
        interface: &Interface,
        direction: Direction,
        loss: Loss,
    ) -> Result<Self> {
        Self::attach_by_name(netns, &interface.name, direction, loss)
    }

    /// As [`Lossy::attach`], for an interface without addresses.
    pub(crate) fn attach_by_name(
        netns: &Netns,
        interface: &str,
        direction: Direction,
        loss: Loss,
    ) -> Result<Self> {
        let counters = Counters::new()?;
        let hook = match direction {
            Direction::Ingress => Hook::TcIngress,
            Direction::Egress => Hook::TcEgress,
        };
        let link = bpf::attach(netns, interface, hook, &program(&counters, loss)?)?;
        Ok(Self {
            counters,
            _link: link,
        })
    }

    /// What has been seen and dropped so far.
    pub fn count(&self) -> Result<LossCount> {
        let [seen, dropped] = self.counters.read()?;
        Ok(LossCount { seen, dropped })
    }
}

const TCX_PASS: i32 = 0;
const TCX_DROP: i32 = 2;
/// Offset of `protocol` in `struct __sk_buff`; the value is in network byte order.
const SKB_PROTOCOL: i16 = 16;
const ETH_P_IP: u16 = 0x0800;
const ETH_P_IPV6: u16 = 0x86dd;
/// Where "next header" of IPv6 lies in an untagged Ethernet frame.
const NEXT_HEADER: i32 = 14 + 6;
const NEXT_HEADER_HOP_BY_HOP: i32 = 0;
const NEXT_HEADER_ICMPV6: i32 = 58;

/// The program: r6 = the counters, r7 = the number of packets seen before this one.
fn program(counters: &Counters<2>, loss: Loss) -> Result<Vec<u64>> {
    let chosen = choose(loss)?;
    let drop = [
        bpf::move_immediate(1, 1),
        bpf::fetch_add_u64(6, 8, 1),
        bpf::move_immediate(0, TCX_DROP),
        bpf::exit(),
    ];
    let count = [
        bpf::move_register(6, 0),
        bpf::move_immediate(7, 1),
        bpf::fetch_add_u64(6, 0, 7),
    ];
    let [map_low, map_high] = bpf::load_map(1, counters.fd());
    let lookup = [
        bpf::store_u32_immediate(10, -4, 0),
        map_low,
        map_high,
        bpf::move_register(2, 10),
        bpf::add_immediate(2, -4),
        bpf::call(Helper::MapLookup),
    ];
    // Jumps lead to `pass`, which follows everything else.
    let decide = count.len() + chosen.len() + 1 + drop.len();
    let mut program = skip_unless_datagram(lookup.len() + 1 + decide)?;
    program.extend(lookup);
    program.push(bpf::skip_if_equal(0, 0, i16::try_from(decide)?));
    program.extend(count);
    program.extend(chosen);
    program.push(skip_unless_chosen(loss, i16::try_from(drop.len())?));
    program.extend(drop);
    program.extend([bpf::move_immediate(0, TCX_PASS), bpf::exit()]);
    Ok(program)
}

/// Skips `count` further instructions for what a loss must not touch: see the module.
fn skip_unless_datagram(count: usize) -> Result<Vec<u64>> {
    let skip = |further: i16| anyhow::Ok(i16::try_from(count)? + further);
    Ok(vec![
        // A load from the packet takes the context from r6.
        bpf::move_register(6, 1),
        bpf::load_u32(2, 1, SKB_PROTOCOL),
        bpf::skip_if_equal(2, i32::from(ETH_P_IP.to_be()), 4),
        bpf::skip_if_not_equal(2, i32::from(ETH_P_IPV6.to_be()), skip(3)?),
        bpf::load_packet_byte(NEXT_HEADER),
        bpf::skip_if_equal(0, NEXT_HEADER_ICMPV6, skip(1)?),
        bpf::skip_if_equal(0, NEXT_HEADER_HOP_BY_HOP, skip(0)?),
    ])
}

/// Leaves in r0 (random) or r7 (every n-th) what [`skip_unless_chosen`] looks at.
fn choose(loss: Loss) -> Result<Vec<u64>> {
    match loss {
        Loss::Random(probability) => {
            ensure!(
                (0.0..=1.0).contains(&probability),
                "a probability is between 0 and 1, not {probability}"
            );
            Ok(vec![bpf::call(Helper::RandomU32)])
        }
        Loss::EveryNth(n) => {
            ensure!(n > 0, "Loss::EveryNth counts from 1");
            Ok(vec![bpf::modulo_immediate(7, i32::try_from(n)?)])
        }
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a probability times u32::MAX is in the range of u32"
)]
fn skip_unless_chosen(loss: Loss, count: i16) -> u64 {
    match loss {
        Loss::Random(probability) => {
            let threshold = (probability * f64::from(u32::MAX)).round() as u32;
            bpf::skip_if_at_least_u32(0, threshold, count)
        }
        Loss::EveryNth(n) => bpf::skip_if_not_equal(7, n.cast_signed() - 1, count),
    }
}
