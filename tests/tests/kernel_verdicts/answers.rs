//! How answers leave: over both versions of IP, with right checksums, under the VLAN tag of the question.

use std::{
    net::{IpAddr, Ipv6Addr, SocketAddr, UdpSocket},
    os::fd::{AsRawFd as _, OwnedFd},
};

use anyhow::{Context as _, Result};
use nix::sys::socket::{AddressFamily, LinkAddr, MsgFlags, SockFlag, SockType, sendto, socket};
use rtps_ebpf::{
    frame::mapped,
    reply::{Flow, fold},
};
use rtps_tests::{capture::Capture, packet::Message, require, skip_unless};

use crate::{
    layer::{METATRAFFIC_PORT, MULTICAST_PORT, REMOTE},
    stage::{GROUP, REMOTE_V4, REPLY_PORT, Stage, hardware_address},
};

const GROUP_V6: Ipv6Addr = Ipv6Addr::new(0xff0e, 0, 0, 0, 0, 0xffff, 0xefff, 1);
const VLAN: u16 = 7;

/// The remote's announcement, with its locator at `address`; each is another participant's.
fn announcement(address: IpAddr, number: u8) -> Message {
    let mut prefix = REMOTE;
    prefix[11] = number;
    Message::from(prefix).announcement(prefix, SocketAddr::new(address, REPLY_PORT), b"here")
}

/// Fails unless exactly one answer comes, from the port for discovery.
fn expect_answer(stage: &mut Stage, remote: &UdpSocket, what: &str) -> Result<()> {
    let heard = stage.hear(remote)?;
    let [(from, answer)] = &heard.answers[..] else {
        panic!("{what}: {heard:?}");
    };
    assert_eq!(from.port(), METATRAFFIC_PORT, "{what}");
    assert_eq!(heard.counts["answer_bytes"], answer.len() as u64, "{what}");
    stage.reset_counters()
}

/// Frames of a local socket have no checksum yet, and answers get none either.
#[test]
fn sockets_are_answered_over_both_versions() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    let remote_v6 = stage.veth.b.v6;
    let v4 = stage.socket(REMOTE_V4)?;
    let v6 = stage.socket(remote_v6)?;
    let rows: [(&str, &UdpSocket, IpAddr, u16); 4] = [
        ("unicast", &v4, stage.veth.a.v4.into(), METATRAFFIC_PORT),
        (
            "unicast, IPv6",
            &v6,
            stage.veth.a.v6.into(),
            METATRAFFIC_PORT,
        ),
        ("multicast", &v4, GROUP.into(), MULTICAST_PORT),
        ("multicast, IPv6", &v6, GROUP_V6.into(), MULTICAST_PORT),
    ];
    for (number, (what, socket, to, port)) in (0..).zip(rows) {
        let own = socket.local_addr()?.ip();
        let to = SocketAddr::new(to, port);
        socket.send_to(announcement(own, number).bytes(), to)?;
        expect_answer(&mut stage, socket, what)?;
    }
    Ok(())
}

/// Frames from elsewhere have checksums, and so must answers over IPv6: the remote's kernel drops others.
#[test]
fn frames_with_checksums_are_answered_with_checksums() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    let (host_v4, host_v6) = (stage.veth.a.v4, stage.veth.a.v6);
    let remote_v6 = stage.veth.b.v6;
    let (v4, v6) = (stage.socket(REMOTE_V4)?, stage.socket(remote_v6)?);
    let sender = FrameSender::new(&stage)?;
    let rows: [(&str, &UdpSocket, IpAddr, IpAddr, u16); 4] = [
        (
            "unicast",
            &v4,
            REMOTE_V4.into(),
            host_v4.into(),
            METATRAFFIC_PORT,
        ),
        (
            "unicast, IPv6",
            &v6,
            remote_v6.into(),
            host_v6.into(),
            METATRAFFIC_PORT,
        ),
        (
            "multicast",
            &v4,
            REMOTE_V4.into(),
            GROUP.into(),
            MULTICAST_PORT,
        ),
        (
            "multicast, IPv6",
            &v6,
            remote_v6.into(),
            GROUP_V6.into(),
            MULTICAST_PORT,
        ),
    ];
    for (number, (what, socket, from, to, port)) in (0..).zip(rows) {
        let message = announcement(from, number);
        sender.send(None, from, SocketAddr::new(to, port), &message)?;
        expect_answer(&mut stage, socket, what)?;
    }
    Ok(())
}

#[test]
fn the_vlan_tag_stays() -> Result<()> {
    skip_unless!(require::root());
    let mut stage = Stage::new()?;
    let (host_v4, host_v6) = (stage.veth.a.v4, stage.veth.a.v6);
    let remote_v6 = stage.veth.b.v6;
    // Its kernel may know no VLANs: the socket is there for its timeout.
    let socket = stage.socket(REMOTE_V4)?;
    let sender = FrameSender::new(&stage)?;
    let interface = stage.veth.b.name.clone();
    let capture = Capture::start(&stage.remote, &interface)?;
    let rows: [(IpAddr, IpAddr); 2] = [
        (REMOTE_V4.into(), host_v4.into()),
        (remote_v6.into(), host_v6.into()),
    ];
    for (number, (from, to)) in (0..).zip(rows) {
        let to = SocketAddr::new(to, METATRAFFIC_PORT);
        sender.send(Some(VLAN), from, to, &announcement(from, number))?;
        let heard = stage.hear(&socket)?;
        assert_eq!(heard.counts["answers"], 1);
        stage.reset_counters()?;
    }
    let decoded = capture.finish()?;
    for address in [
        format!("ip.src == {host_v4}"),
        format!("ipv6.src == {host_v6}"),
    ] {
        let filter = format!("vlan.id == {VLAN} && {address} && udp.srcport == {METATRAFFIC_PORT}");
        assert_eq!(decoded.frames(&filter)?, 1, "{filter}");
    }
    Ok(())
}

/// Sends frames as they are, on the remote's end.
struct FrameSender {
    socket: OwnedFd,
    /// The remote's end.
    link: LinkAddr,
    host: [u8; 6],
}

impl FrameSender {
    fn new(stage: &Stage) -> Result<Self> {
        let link = hardware_address(&stage.remote, &stage.veth.b.name)?;
        let host = hardware_address(&stage.host, &stage.veth.a.name)?;
        let socket = stage.remote.enter(|| {
            let (family, kind) = (AddressFamily::Packet, SockType::Raw);
            socket(family, kind, SockFlag::empty(), None)
        })?;
        Ok(Self {
            socket,
            link,
            host: host.addr().context("no hardware address")?,
        })
    }

    /// Sends a message from the remote's port with all checksums.
    fn send(
        &self,
        vlan: Option<u16>,
        from: IpAddr,
        to: SocketAddr,
        message: &Message,
    ) -> Result<()> {
        let flow = Flow {
            source: octets(from),
            destination: octets(to.ip()),
            source_port: REPLY_PORT,
            destination_port: to.port(),
            identification: 0,
        };
        let payload = message.bytes();
        let len = payload.len() as u16;
        let checksum = flow.udp_checksum(len, fold(words(payload)));
        let (ethertype, head) = if from.is_ipv4() {
            ([0x08, 0x00], flow.ipv4_head(len, checksum).to_vec())
        } else {
            ([0x86, 0xdd], flow.ipv6_head(len, checksum).to_vec())
        };
        let tag = vlan.map_or(vec![], |vlan| [[0x81, 0x00], vlan.to_be_bytes()].concat());
        let source = self.link.addr().context("no hardware address")?;
        let frame = [
            &self.hardware_destination(to.ip())[..],
            &source,
            &tag,
            &ethertype,
            &head,
            payload,
        ]
        .concat();
        let (socket, flags) = (self.socket.as_raw_fd(), MsgFlags::empty());
        sendto(socket, &frame, &self.link, flags)?;
        Ok(())
    }

    fn hardware_destination(&self, to: IpAddr) -> [u8; 6] {
        match to {
            IpAddr::V4(to) if to.is_multicast() => {
                let [_, b, c, d] = to.octets();
                [0x01, 0x00, 0x5e, b & 0x7f, c, d]
            }
            IpAddr::V6(to) if to.is_multicast() => {
                let [.., a, b, c, d] = to.octets();
                [0x33, 0x33, a, b, c, d]
            }
            _ => self.host,
        }
    }
}

fn octets(address: IpAddr) -> [u8; 16] {
    match address {
        IpAddr::V4(address) => mapped(address.octets()),
        IpAddr::V6(address) => address.octets(),
    }
}

/// The sum of 16-bit words of a message, whose length is a multiple of 4.
fn words(bytes: &[u8]) -> u32 {
    let words = bytes.chunks_exact(2);
    words
        .map(|word| u32::from(u16::from_be_bytes([word[0], word[1]])))
        .sum()
}
