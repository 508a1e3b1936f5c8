//! What an app sends once for several destinations: it leaves to all of them, or the app is told that it does not.

use std::{
    io::{self, ErrorKind},
    net::{Ipv4Addr, SocketAddr, UdpSocket},
    process::Command,
    time::Duration,
};

use anyhow::{Result, ensure};
use nix::{
    net::if_::if_nametoindex,
    sys::socket::{
        setsockopt,
        sockopt::{Ipv4RecvErr, UdpGsoSegment},
    },
};
use rtps_ebpf::abi::{
    DOORBELL_RING, Destination, FAN_OUT_ADDRESS, FAN_OUT_DESTINATIONS, FanOut, FanOutKey, Sender,
    name,
};
use rtps_tests::{
    debian::{self, Package},
    link::{Bridge, Host},
    packet::{ANYBODY, Message, SPDP_WRITER, reader_of, writer_of},
    require, skip_unless, socket_cookie,
};

use crate::layer::{DOMAIN, Layer, OWN, REMOTE};

const SLOT: u8 = 3;
const NUMBER: u16 = 2;
const PORT: u16 = 7_411;
/// Hosts that the list leads to.
const REMOTES: u8 = 3;
/// On a busy machine.
const PATIENCE: Duration = Duration::from_secs(5);

/// A host with the program, an app's socket on it, and hosts with sockets that the app's list leads to.
struct Stage {
    bridge: Bridge,
    layer: Layer,
    app: UdpSocket,
    remotes: Vec<UdpSocket>,
}

impl Stage {
    fn new() -> Result<Self> {
        let bridge = Bridge::new("fan-out", 1 + REMOTES, 1_500)?;
        let (ours, theirs) = bridge.hosts.split_first().expect("there are four");
        let mut layer = Layer::new(DOORBELL_RING)?;
        ours.netns.enter(|| layer.attach_fan_out())?;
        let app = ours.netns.enter(open_app)?;
        let sender = Sender {
            slot: SLOT.into(),
            domain_index: DOMAIN,
        };
        layer.insert(name::SENDERS, socket_cookie(&app)?, sender)?;
        let key = FanOutKey {
            slot: SLOT.into(),
            number: NUMBER.into(),
        };
        layer.insert(name::FAN_OUTS, key, list(ours, theirs)?)?;
        let remotes = theirs.iter().map(open_remote).collect::<Result<_>>()?;
        Ok(Self {
            bridge,
            layer,
            app,
            remotes,
        })
    }

    fn send(&self, message: &Message) -> io::Result<()> {
        send(&self.app, NUMBER, message.bytes())
    }

    /// Fails unless each host gets these datagrams and nothing else.
    fn expect(&self, datagrams: &[&[u8]]) -> Result<()> {
        let host = self.bridge.hosts[0].interface.v4;
        let from = SocketAddr::from((host, self.app.local_addr()?.port()));
        for remote in &self.remotes {
            for datagram in datagrams {
                let mut buffer = [0; 2_000];
                let (len, source) = remote.recv_from(&mut buffer)?;
                ensure!(&buffer[..len] == *datagram, "{len} bytes from {source}");
                ensure!(source == from, "from {source}");
            }
            remote.set_nonblocking(true)?;
            let more = remote.recv(&mut [0; 1]);
            remote.set_nonblocking(false)?;
            let is_empty = more.is_err_and(|error| error.kind() == ErrorKind::WouldBlock);
            ensure!(is_empty, "there is more");
        }
        Ok(())
    }

    /// Fails unless the message is refused, and the refusal counted under this name.
    fn expect_refusal(&mut self, what: &str, message: &Message, counter: &str) -> Result<()> {
        self.layer.reset_counters()?;
        expect_no_buffer(what, self.send(message));
        let counts = self.layer.counts()?;
        ensure!(counts == [(counter, 1)].into(), "{what}: {counts:?}");
        self.expect(&[])
    }
}

fn open_app() -> Result<UdpSocket> {
    let app = UdpSocket::bind((Ipv4Addr::LOCALHOST, 0))?;
    setsockopt(&app, Ipv4RecvErr, &true)?;
    Ok(app)
}

fn open_remote(host: &Host) -> Result<UdpSocket> {
    let socket = host
        .netns
        .enter(|| UdpSocket::bind((Ipv4Addr::UNSPECIFIED, PORT)))?;
    socket.set_read_timeout(Some(PATIENCE))?;
    Ok(socket)
}

fn list(ours: &Host, theirs: &[Host]) -> Result<FanOut> {
    let interface = &ours.interface;
    let ifindex = ours
        .netns
        .enter(|| if_nametoindex(interface.name.as_str()))?;
    let mut destinations = [Destination::default(); FAN_OUT_DESTINATIONS];
    for (destination, host) in destinations.iter_mut().zip(theirs) {
        *destination = Destination {
            source: interface.v4.octets(),
            address: host.interface.v4.octets(),
            port: PORT.into(),
            ifindex,
        };
    }
    Ok(FanOut {
        count: theirs.len() as u32,
        reserved: 0,
        destinations,
    })
}

fn send(socket: &UdpSocket, number: u16, bytes: &[u8]) -> io::Result<()> {
    let to = (Ipv4Addr::from(FAN_OUT_ADDRESS), number);
    socket.send_to(bytes, to).map(drop)
}

fn expect_no_buffer(what: &str, sent: io::Result<()>) {
    let error = sent.expect_err(what);
    assert_eq!(error.raw_os_error(), Some(libc::ENOBUFS), "{what}: {error}");
}

/// A message of the app with a number of bytes in all, of which 44 are header and fields.
fn message(len: usize) -> Message {
    Message::from(OWN).data(ANYBODY, writer_of(SLOT), len - 44)
}

#[test]
fn a_datagram_reaches_all() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    // The first has no neighbour's hardware address yet.
    for len in [100, 1_000, 1_472] {
        stage.layer.reset_counters()?;
        stage.send(&message(len))?;
        stage.expect(&[message(len).bytes()])?;
        let counts = stage.layer.counts()?;
        let copies = u64::from(REMOTES);
        assert_eq!(counts, [("fan_outs", 1), ("fan_out_copies", copies)].into());
    }
    Ok(())
}

#[test]
fn a_burst_reaches_all_as_datagrams() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new()?;
    let datagrams: Vec<Message> = (0..40).map(|n| message(1_400).with(60, n)).collect();
    let last = message(200);
    let whole: Vec<&[u8]> = datagrams
        .iter()
        .chain([&last])
        .map(Message::bytes)
        .collect();
    setsockopt(&stage.app, UdpGsoSegment, &1_400)?;
    send(&stage.app, NUMBER, &whole.concat())?;
    stage.expect(&whole)
}

/// As on an interface that does not: here the sums that the program leaves behind are looked at by the receivers.
#[test]
fn sums_are_right_where_the_interface_does_not_complete_them() -> Result<()> {
    skip_unless!(require::root());
    debian::ensure_installed(&[Package::new("ethtool", "/usr/sbin/ethtool")])?;
    let stage = Stage::new()?;
    let host = &stage.bridge.hosts[0];
    let mut ethtool: Command = host.netns.command("ethtool");
    let switched = ethtool.args(["-K", &host.interface.name, "tx", "off"]);
    ensure!(switched.output()?.status.success(), "ethtool");
    for len in [101, 1_400] {
        stage.send(&message(len))?;
        stage.expect(&[message(len).bytes()])?;
    }
    let burst = [message(1_400), message(1_399)];
    let whole: Vec<&[u8]> = burst.iter().map(Message::bytes).collect();
    setsockopt(&stage.app, UdpGsoSegment, &1_400)?;
    send(&stage.app, NUMBER, &whole.concat())?;
    stage.expect(&whole)
}

#[test]
fn who_may_not_send_is_told_so() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    let stranger = stage.bridge.hosts[0].netns.enter(open_app)?;
    let good = message(100);
    expect_no_buffer("a stranger", send(&stranger, NUMBER, good.bytes()));
    expect_no_buffer("no list", send(&stage.app, NUMBER + 1, good.bytes()));
    let counts = stage.layer.counts()?;
    let expected = [("drop_fan_out_stranger", 1), ("drop_fan_out_unknown", 1)];
    assert_eq!(counts, expected.into());
    stage.expect(&[])?;
    // Whoever sends to himself is not kept from it.
    let receiver = stage.bridge.hosts[0].netns.enter(open_app)?;
    let to = receiver.local_addr()?;
    stage.app.send_to(b"other", to)?;
    assert_eq!(receiver.recv(&mut [0; 8])?, 5);
    Ok(())
}

#[test]
fn what_may_not_be_said_is_not() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    let own = || Message::from(OWN);
    let (mine, others) = (writer_of(SLOT), writer_of(SLOT + 1));
    let rows = [
        (
            "another host's participant",
            Message::from(REMOTE).data(ANYBODY, mine, 50),
        ),
        ("another app's writer", own().data(ANYBODY, others, 50)),
        ("discovery", own().data(ANYBODY, SPDP_WRITER, 50)),
        (
            "another app's heartbeat behind data",
            own()
                .data(ANYBODY, mine, 50)
                .heartbeat(ANYBODY, others, 1, 1),
        ),
        (
            "another source",
            own().source(REMOTE).data(ANYBODY, mine, 50),
        ),
        ("a reader's words", own().acknack(mine, 1, 0, 0)),
        ("no RTPS", own().with(0, b'X')),
        ("cut short", message(100).truncated(99)),
        ("longer than a datagram may be", message(1_473)),
    ];
    for (what, message) in rows {
        stage.expect_refusal(what, &message, "drop_fan_out_denied")?;
    }
    let good = own()
        .destination(REMOTE)
        .data(reader_of(9), mine, 50)
        .heartbeat(ANYBODY, mine, 1, 1);
    stage.send(&good)?;
    stage.expect(&[good.bytes()])
}

#[test]
fn a_burst_is_looked_at_to_its_end() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new()?;
    let foreign = Message::from(OWN).data(ANYBODY, writer_of(SLOT + 1), 10);
    let burst = [message(1_000), message(1_000), foreign];
    let whole: Vec<&[u8]> = burst.iter().map(Message::bytes).collect();
    setsockopt(&stage.app, UdpGsoSegment, &1_000)?;
    let sent = send(&stage.app, NUMBER, &whole.concat());
    expect_no_buffer("a foreign datagram at the end", sent);
    stage.expect(&[])
}
