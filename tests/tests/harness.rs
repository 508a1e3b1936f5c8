//! The harness proves itself with other vendors' programs alone, before it tests our stack.

use std::fs::DirBuilder;
use std::net::{IpAddr, Ipv4Addr, UdpSocket};
use std::os::unix::fs::DirBuilderExt;
use std::time::Duration;

use anyhow::{Context, Result, ensure};
use rtps_tests::capture::Capture;
use rtps_tests::link::{Bridge, Interface, Veth};
use rtps_tests::loss::{Direction, Loss, LossCount, Lossy};
use rtps_tests::netns::{Identity, Netns};
use rtps_tests::pass_all::PassAll;
use rtps_tests::peers::{self, Peer};
use rtps_tests::process::Process;
use rtps_tests::{require, skip_unless};

const PEER_END: Duration = Duration::from_secs(30);
/// submessageId of DATA_FRAG, ACKNACK and HEARTBEAT (RTPS 2.5, 9.4.5.1.1).
const DATA_FRAG: u8 = 0x16;
const ACKNACK: u8 = 0x06;
const HEARTBEAT: u8 = 0x07;

/// Two hosts joined by a veth pair.
struct Pair {
    a: Netns,
    b: Netns,
    veth: Veth,
}

impl Pair {
    fn new(label: &str) -> Result<Self> {
        let a = Netns::new(&format!("{label}-a"))?;
        let b = Netns::new(&format!("{label}-b"))?;
        let [from, to] = [1, 2].map(|host| Ipv4Addr::new(10, 1, 0, host));
        let veth = Veth::between(&a, &b, from, to, 1500)?;
        Ok(Self { a, b, veth })
    }
}

/// Publishes from host a to host b; both ends must count every sample in order.
fn exchange(
    pair: &Pair,
    publisher: &Peer,
    subscriber: &Peer,
    samples: u64,
    size: u32,
) -> Result<()> {
    // Transient-local: the publisher may see the match before the subscriber does.
    let arguments =
        format!("--reliable --durability transient-local --count {samples} --size {size}");
    let mut subscriber = Process::spawn(
        &format!("{} subscriber", subscriber.name()),
        &mut subscriber.command(
            &pair.b,
            &pair.veth.b,
            &format!("--sub {arguments} --linger 0.5"),
        ),
    )?;
    let mut publisher = Process::spawn(
        &format!("{} publisher", publisher.name()),
        &mut publisher.command(
            &pair.a,
            &pair.veth.a,
            &format!("--pub {arguments} --period-us 1000"),
        ),
    )?;
    subscriber
        .wait_success(PEER_END)
        .with_context(|| format!("the publisher's output:\n{}", publisher.text()))?;
    publisher.wait_success(PEER_END)?;
    let received: Vec<_> = subscriber
        .events()
        .iter()
        .filter(|event| event["event"] == "sample" && event["size"] == size)
        .filter_map(|event| event["x"].as_u64())
        .collect();
    ensure!(received == Vec::from_iter(0..samples), "{received:?}");
    Ok(())
}

#[test]
fn cyclone_to_cyclone() -> Result<()> {
    skip_unless!(require::root());
    let cyclone = peers::cyclone()?;
    exchange(&Pair::new("cc")?, &cyclone, &cyclone, 100, 0)
}

#[test]
fn cyclone_to_fast_dds() -> Result<()> {
    skip_unless!(require::root());
    exchange(
        &Pair::new("cf")?,
        &peers::cyclone()?,
        &peers::fast_dds()?,
        100,
        0,
    )
}

#[test]
fn fast_dds_to_cyclone() -> Result<()> {
    skip_unless!(require::root());
    exchange(
        &Pair::new("fc")?,
        &peers::fast_dds()?,
        &peers::cyclone()?,
        100,
        0,
    )
}

#[test]
fn reliable_samples_survive_loss() -> Result<()> {
    skip_unless!(require::root());
    skip_unless!(require::kernel(6, 6));
    let pair = Pair::new("loss")?;
    let lossy = |direction, loss| Lossy::attach(&pair.b, &pair.veth.b, direction, loss);
    let ingress = lossy(Direction::Ingress, Loss::Random(0.1))?;
    // Few packets go this way: at random perhaps none would be lost.
    let egress = lossy(Direction::Egress, Loss::EveryNth(7))?;
    let cyclone = peers::cyclone()?;
    exchange(&pair, &cyclone, &cyclone, 100, 0)?;
    for count in [ingress.count()?, egress.count()?] {
        ensure!(count.dropped > 0 && count.dropped < count.seen, "{count:?}");
    }
    Ok(())
}

#[test]
fn tshark_decodes_a_conversation() -> Result<()> {
    skip_unless!(require::root());
    let pair = Pair::new("tshark")?;
    let cyclone = peers::cyclone()?;
    let capture = Capture::start(&pair.a, &pair.veth.a.name)?;
    exchange(&pair, &cyclone, &cyclone, 20, 20_000)?;
    let decoded = capture.finish()?;
    // Cyclone sends its fragments in datagrams of up to 14,720 octets, which IP fragments again.
    let fragments = decoded.count(pair.veth.a.v4, DATA_FRAG);
    ensure!(fragments >= 40, "{fragments} DATA_FRAG");
    ensure!(decoded.count(pair.veth.b.v4, ACKNACK) > 0, "no ACKNACK");
    for address in [pair.veth.a.v4, pair.veth.b.v4] {
        let malformed = decoded.malformed_from(address);
        ensure!(malformed.is_empty(), "{malformed:?}");
    }
    Ok(())
}

/// The check itself can fail: a truncated RTPS message is seen as one.
#[test]
fn tshark_finds_a_malformed_message() -> Result<()> {
    skip_unless!(require::root());
    let pair = Pair::new("malformed")?;
    let capture = Capture::start(&pair.a, &pair.veth.a.name)?;
    let socket = bind(&pair.a, pair.veth.a.v4)?;
    // A header, then a HEARTBEAT that ends after its entity ids.
    let mut message = b"RTPS\x02\x03\x01\x10".to_vec();
    message.extend([1; 12]);
    message.extend([0x07, 0x01, 28, 0]);
    message.extend([0; 8]);
    socket.send_to(&message, (pair.veth.b.v4, 7410))?;
    let decoded = capture.finish()?;
    let malformed = decoded.malformed_from(pair.veth.a.v4);
    ensure!(malformed.len() == 1, "{decoded:?}");
    ensure!(malformed[0].destination_port == 7410, "{decoded:?}");
    Ok(())
}

/// Ports that the system chooses for us may be those that tshark knows of other protocols.
#[test]
fn tshark_goes_by_contents_and_not_by_ports() -> Result<()> {
    const MANOLITO: u16 = 41_170;
    skip_unless!(require::root());
    let pair = Pair::new("contents")?;
    let capture = Capture::start(&pair.a, &pair.veth.a.name)?;
    let socket = bind(&pair.a, pair.veth.a.v4)?;
    // A header, then a HEARTBEAT.
    let mut message = b"RTPS\x02\x03\x01\x10".to_vec();
    message.extend([1; 12]);
    message.extend([HEARTBEAT, 0x01, 28, 0]);
    message.extend([0; 28]);
    socket.send_to(&message, (pair.veth.b.v4, MANOLITO))?;
    let decoded = capture.finish()?;
    ensure!(decoded.count(pair.veth.a.v4, HEARTBEAT) == 1, "{decoded:?}");
    Ok(())
}

#[test]
fn every_third_packet_is_lost() -> Result<()> {
    lose_every_third("third4", |interface| interface.v4.into())
}

#[test]
fn every_third_ipv6_packet_is_lost() -> Result<()> {
    lose_every_third("third6", |interface| interface.v6.into())
}

fn lose_every_third(label: &str, address: impl Fn(&Interface) -> IpAddr) -> Result<()> {
    skip_unless!(require::root());
    skip_unless!(require::kernel(6, 6));
    let pair = Pair::new(label)?;
    let deliver = |count| deliver(&pair, &address, count);
    let lossy = Lossy::attach(&pair.b, &pair.veth.b, Direction::Ingress, Loss::EveryNth(3))?;
    ensure!(deliver(9)? == [0, 1, 3, 4, 6, 7]);
    let expected = LossCount {
        seen: 9,
        dropped: 3,
    };
    ensure!(lossy.count()? == expected, "{:?}", lossy.count()?);
    drop(lossy);
    ensure!(deliver(3)? == [0, 1, 2]);
    Ok(())
}

#[test]
fn pass_all_attaches_natively_and_detaches() -> Result<()> {
    skip_unless!(require::root());
    let pair = Pair::new("pass")?;
    let has_xdp = || -> Result<bool> {
        let output = pair.b.command("ip").args(["link", "show"]).output()?;
        Ok(String::from_utf8(output.stdout)?.contains(" xdp "))
    };
    let pass = PassAll::attach(&pair.b, &pair.veth.b)?;
    ensure!(has_xdp()?);
    ensure!(deliver(&pair, |interface| interface.v4.into(), 3)? == [0, 1, 2]);
    drop(pass);
    ensure!(!has_xdp()?);
    Ok(())
}

#[test]
fn hosts_on_a_bridge_reach_each_other_by_both_protocols() -> Result<()> {
    skip_unless!(require::root());
    let bridge = Bridge::new("bridge", 3, 1500)?;
    let [first, .., last] = bridge.hosts.as_slice() else {
        anyhow::bail!("three hosts asked for, got {}", bridge.hosts.len());
    };
    let receiver = last
        .netns
        .enter(|| UdpSocket::bind((last.interface.v6, 9)))?;
    let sender = first
        .netns
        .enter(|| UdpSocket::bind((first.interface.v6, 0)))?;
    sender.send_to(b"v6", (last.interface.v6, 9))?;
    ensure!(receive(&receiver)? == Some(b"v6".to_vec()));
    let receiver = bind(&last.netns, last.interface.v4)?;
    let sender = bind(&first.netns, first.interface.v4)?;
    sender.send_to(b"v4", receiver.local_addr()?)?;
    ensure!(receive(&receiver)? == Some(b"v4".to_vec()));
    Ok(())
}

#[test]
fn an_unprivileged_command_has_no_capability() -> Result<()> {
    skip_unless!(require::root());
    let netns = Netns::new("unprivileged")?;
    // The program may be where only root can go.
    let directory = std::env::temp_dir().join(format!("rtps-tests-{}", std::process::id()));
    DirBuilder::new().mode(0o700).create(&directory)?;
    let program = directory.join("cat");
    std::fs::copy("/usr/bin/cat", &program)?;
    let mut command = netns.command_as(Identity::NOBODY, &program)?;
    std::fs::remove_dir_all(&directory)?;
    let output = command.arg("/proc/self/status").output()?;
    let status = String::from_utf8(output.stdout)?;
    let value = |name: &str| {
        let line = status.lines().find_map(|line| line.strip_prefix(name));
        line.map(str::trim)
            .context("no such line")
            .map(str::to_owned)
    };
    ensure!(value("Uid:")? == "65534\t65534\t65534\t65534", "{status}");
    ensure!(value("Groups:")?.is_empty(), "{status}");
    for set in ["CapInh:", "CapPrm:", "CapEff:", "CapAmb:"] {
        ensure!(value(set)? == "0000000000000000", "{status}");
    }
    ensure!(value("NoNewPrivs:")? == "1", "{status}");
    Ok(())
}

#[test]
fn a_namespace_ends_with_its_value() -> Result<()> {
    skip_unless!(require::root());
    let netns = Netns::new("short")?;
    let inside = netns
        .command("readlink")
        .arg("/proc/self/ns/net")
        .output()?;
    let inode = netns.inode()?;
    ensure!(inside.stdout == format!("net:[{inode}]\n").into_bytes());
    let path = netns.path();
    ensure!(path.exists());
    drop(netns);
    // The number may have been given to another file of this process by now, not to this one.
    let now = std::fs::read_link(&path).unwrap_or_default();
    ensure!(now.as_os_str() != format!("net:[{inode}]").as_str());
    Ok(())
}

fn bind(netns: &Netns, address: impl Into<IpAddr>) -> Result<UdpSocket> {
    let address = address.into();
    Ok(netns.enter(|| UdpSocket::bind((address, 0)))?)
}

fn receive(socket: &UdpSocket) -> Result<Option<Vec<u8>>> {
    socket.set_read_timeout(Some(Duration::from_millis(300)))?;
    let mut buffer = [0; 64];
    match socket.recv(&mut buffer) {
        Ok(length) => Ok(Some(buffer[..length].to_vec())),
        Err(error) if error.kind() == std::io::ErrorKind::WouldBlock => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// Sends numbered datagrams from a to b and returns the numbers that arrive.
fn deliver(pair: &Pair, address: impl Fn(&Interface) -> IpAddr, count: u8) -> Result<Vec<u8>> {
    let receiver = bind(&pair.b, address(&pair.veth.b))?;
    let sender = bind(&pair.a, address(&pair.veth.a))?;
    for number in 0..count {
        sender.send_to(&[number], receiver.local_addr()?)?;
    }
    let mut arrived = Vec::new();
    while let Some(datagram) = receive(&receiver)? {
        arrived.extend(datagram);
    }
    Ok(arrived)
}
