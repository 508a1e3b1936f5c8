//! Invented participants, more of them than anybody can remember: who is known stays, and nobody gets more than was sent.

use std::net::Ipv4Addr;
use std::os::fd::{AsRawFd, OwnedFd};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use nix::sys::socket::{
    AddressFamily, MsgFlags, MultiHeaders, SockFlag, SockProtocol, SockType, SockaddrIn, sendmmsg,
    socket,
};
use rtps_tests::layer::{KernelLayer, Layer};
use rtps_tests::link::Host;
use rtps_tests::process::resident;
use rtps_tests::stage::{Stage, counter};
use rtps_tests::stream::{End, RATE, Stream};
use rtps_tests::{require, skip_unless};
use rtps_user::wire::GuidPrefix;

use crate::crowd::METATRAFFIC_UNICAST;
use crate::remote::Remote;
use crate::support::{LONG_LEASE, known_crowd, knows};

/// Announcements a second, as far as the machine can.
const FLOOD_RATE: u64 = 50_000;
/// Fewer than these are no flood.
const LOWEST_RATE: u64 = 5_000;
const BATCH: usize = 64;
/// What bounded tables and buffers of rtpsd may take in all, in bytes.
const MEMORY: u64 = 200 << 20;
/// IPv4 and UDP header without options.
const HEADERS: usize = 20 + 8;
/// Where the datagrams claim to come from.
const SOURCE_PORT: u16 = 7_410;

#[test]
fn from_one_address() -> Result<()> {
    skip_unless!(require::root());
    withstand(Duration::from_secs(20), |stage, _random| {
        stage.theirs.interface.v4
    })
}

#[test]
fn from_any_address() -> Result<()> {
    skip_unless!(require::root());
    // Of this link or of none; all of them answer to the sender's hardware address.
    withstand(Duration::from_secs(5), |_stage, random| {
        let [_, b, c, d] = (random as u32).to_be_bytes();
        Ipv4Addr::new(10, b, c, d.clamp(3, 250))
    })
}

/// Streams with Cyclone both ways, and somebody who is only known, while announcements come from `source`.
fn withstand(time: Duration, source: impl Fn(&Stage, u64) -> Ipv4Addr) -> Result<()> {
    let stage = Stage::new("spoofed")?;
    let mut layer = stage.load(&stage.ours)?;
    let bystanders = known_crowd(&stage, 3, (Duration::from_secs(1), LONG_LEASE))?;
    let ours = End::Ours(Layer::Kernel);
    let count = (time.as_secs() + 2) * RATE;
    let mut streams = [
        Stream::start(&stage, "Square", (End::Cyclone, ours), count)?,
        Stream::start(&stage, "Circle", (ours, End::Cyclone), count)?,
    ];
    for stream in &mut streams {
        stream.wait_for(100)?;
    }
    let before = Traffic::now(&stage, &layer)?;
    let sent = flood(&stage, time, source)?;
    let after = Traffic::now(&stage, &layer)?;

    let answered = after.answered - before.answered;
    ensure!(
        answered > 0,
        "nobody is answered: the flood does not get there"
    );
    ensure!(answered <= sent, "{answered} bytes for {sent}");
    let (received, transmitted) = (after.received - before.received, after.sent - before.sent);
    ensure!(
        transmitted <= received,
        "{transmitted} bytes out, {received} in"
    );
    let memory = resident(layer.process().pid())?;
    ensure!(memory < MEMORY, "rtpsd takes {memory} bytes");
    for prefix in bystanders.prefixes() {
        ensure!(knows(&layer, prefix)?, "{prefix} is forgotten");
    }
    for stream in streams {
        stream.finish()?;
    }
    Ok(())
}

/// What a host's interface and its kernel layer have counted, in bytes.
struct Traffic {
    answered: u64,
    received: u64,
    sent: u64,
}

impl Traffic {
    fn now(stage: &Stage, layer: &KernelLayer<'_>) -> Result<Self> {
        let (received, sent) = interface_bytes(&stage.ours)?;
        Ok(Self {
            answered: counter(&layer.status()?, "answer_bytes"),
            received,
            sent,
        })
    }
}

/// Bytes of frames that the interface of a host has received and sent (proc_net_dev(5)).
fn interface_bytes(host: &Host) -> Result<(u64, u64)> {
    let table = host
        .netns
        .enter(|| std::fs::read_to_string("/proc/thread-self/net/dev"))?;
    let name = format!("{}:", host.interface.name);
    let mut lines = table.lines().map(str::trim_start);
    let line = lines.find_map(|line| line.strip_prefix(&name));
    let fields: Vec<&str> = line
        .context("no such interface")?
        .split_whitespace()
        .collect();
    match fields.as_slice() {
        [received, _, _, _, _, _, _, _, sent, ..] => Ok((received.parse()?, sent.parse()?)),
        _ => anyhow::bail!("{} fields", fields.len()),
    }
}

/// Gives the bytes of UDP payload that were sent.
fn flood(stage: &Stage, time: Duration, source: impl Fn(&Stage, u64) -> Ipv4Addr) -> Result<u64> {
    let target = SockaddrIn::from(std::net::SocketAddrV4::new(stage.ours.interface.v4, 0));
    let socket = raw_socket(&stage.theirs)?;
    let template = Template::new(stage.ours.interface.v4)?;
    let mut headers = MultiHeaders::<SockaddrIn>::preallocate(BATCH, None);
    let (begin, mut sent, mut random) = (Instant::now(), 0, 0x5eed);
    while begin.elapsed() < time {
        let due = begin.elapsed().as_millis() as u64 * FLOOD_RATE / 1_000;
        if sent >= due {
            thread::sleep(Duration::from_millis(1));
            continue;
        }
        let packets: Vec<_> = (0..BATCH)
            .map(|_| {
                random = next_random(random);
                template.packet(source(stage, random), random)
            })
            .collect();
        let slices: Vec<_> = packets
            .iter()
            .map(|packet| [std::io::IoSlice::new(packet)])
            .collect();
        let addresses = [Some(target); BATCH];
        let batch = sendmmsg(
            socket.as_raw_fd(),
            &mut headers,
            &slices,
            addresses,
            [],
            MsgFlags::empty(),
        )?;
        sent += batch.count() as u64;
    }
    ensure!(
        sent > LOWEST_RATE * time.as_secs(),
        "{sent} announcements are no flood"
    );
    eprintln!("{} announcements a second", sent / time.as_secs());
    Ok(sent * template.payload_len() as u64)
}

/// A socket that takes whole IPv4 packets (raw(7)).
fn raw_socket(host: &Host) -> Result<OwnedFd> {
    let open = || {
        socket(
            AddressFamily::Inet,
            SockType::Raw,
            SockFlag::SOCK_CLOEXEC,
            SockProtocol::Raw,
        )
    };
    host.netns.enter(open).context("opening a raw socket")
}

/// An IPv4 packet with an announcement, and where in it the participant is named and located.
struct Template {
    packet: Vec<u8>,
    prefixes: Vec<usize>,
    addresses: Vec<usize>,
}

impl Template {
    fn new(target: Ipv4Addr) -> Result<Self> {
        let somebody = GuidPrefix(*b"\x01\xfeinventions");
        let somewhere = Ipv4Addr::new(198, 51, 100, 33);
        let metatraffic = (somewhere, METATRAFFIC_UNICAST).into();
        let payload = Remote::new(somebody, metatraffic, LONG_LEASE).announcement();
        let mut packet = ipv4_and_udp(somewhere, target, u16::try_from(payload.len())?);
        packet.extend(payload);
        let (prefixes, addresses) = (
            positions(&packet, &somebody.0),
            positions(&packet, &somewhere.octets()),
        );
        ensure!(prefixes.len() >= 2 && addresses.len() >= 2);
        Ok(Self {
            packet,
            prefixes,
            addresses,
        })
    }

    fn packet(&self, source: Ipv4Addr, random: u64) -> Vec<u8> {
        let mut packet = self.packet.clone();
        for position in &self.prefixes {
            packet[position + 4..position + 12].copy_from_slice(&random.to_be_bytes());
        }
        for position in &self.addresses {
            packet[*position..position + 4].copy_from_slice(&source.octets());
        }
        packet
    }

    fn payload_len(&self) -> usize {
        self.packet.len() - HEADERS
    }
}

/// The kernel fills in the length and the checksum of the IPv4 header; UDP does without a checksum.
fn ipv4_and_udp(source: Ipv4Addr, target: Ipv4Addr, payload_len: u16) -> Vec<u8> {
    let mut packet = vec![0x45, 0, 0, 0, 0, 0, 0, 0, 64, 17, 0, 0];
    packet.extend(source.octets());
    packet.extend(target.octets());
    for field in [SOURCE_PORT, METATRAFFIC_UNICAST, 8 + payload_len, 0] {
        packet.extend(field.to_be_bytes());
    }
    packet
}

fn positions(bytes: &[u8], wanted: &[u8]) -> Vec<usize> {
    let windows = bytes.windows(wanted.len()).enumerate();
    windows
        .filter(|(_, window)| *window == wanted)
        .map(|(position, _)| position)
        .collect()
}

/// xorshift64, the same in every run.
fn next_random(mut random: u64) -> u64 {
    random ^= random << 13;
    random ^= random >> 7;
    random ^ random << 17
}
