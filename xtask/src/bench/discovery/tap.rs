//! Which packets of discovery have gone over a link: a packet socket at the remote's end.

use std::net::Ipv4Addr;
use std::os::fd::{AsRawFd, OwnedFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use anyhow::{Context, Result, anyhow};
use nix::errno::Errno;
use nix::sys::socket::{
    AddressFamily, MsgFlags, SockFlag, SockProtocol, SockType, recv, setsockopt, socket, sockopt,
};
use rtps_tests::link::Host;
use rtps_user::wire::{EntityId, Submessage, Submessages};

/// What a host has sent to its link.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub(super) struct Discovered {
    /// Datagrams with an announcement of a participant.
    pub(super) participant_packets: u64,
    /// DATA of the built-in writers of endpoints.
    pub(super) endpoint_samples: u64,
}

/// Counts from its start until [`Tap::finish`].
pub(super) struct Tap {
    is_over: Arc<AtomicBool>,
    counting: JoinHandle<Discovered>,
}

/// Room for packets that the counting thread has not had the time for.
const BUFFER: usize = 64 << 20;
/// How often the counting thread looks: all the time it would take CPU time from those who are measured.
const PERIOD: Duration = Duration::from_millis(20);
/// More than the MTU.
const LONGEST: usize = 4096;

impl Tap {
    /// Counts what `host` gets from the address `sender`.
    pub(super) fn start(host: &Host, sender: Ipv4Addr) -> Result<Self> {
        let open = || {
            socket(
                AddressFamily::Packet,
                SockType::Datagram,
                SockFlag::SOCK_CLOEXEC,
                SockProtocol::EthAll,
            )
        };
        let packets = host.netns.enter(open).context("packet sockets need root")?;
        setsockopt(&packets, sockopt::RcvBufForce, &BUFFER)?;
        let is_over = Arc::new(AtomicBool::new(false));
        let seen = Arc::clone(&is_over);
        let counting = thread::spawn(move || count(&packets, sender, &seen));
        Ok(Self { is_over, counting })
    }

    /// What has been counted.
    pub(super) fn finish(self) -> Result<Discovered> {
        self.is_over.store(true, Ordering::Relaxed);
        let counted = self.counting.join();
        counted.map_err(|_panic| anyhow!("the counting thread panicked"))
    }
}

fn count(packets: &OwnedFd, sender: Ipv4Addr, is_over: &AtomicBool) -> Discovered {
    let mut counted = Discovered::default();
    let mut buffer = [0; LONGEST];
    loop {
        // Read before the packets are: what came until then is counted.
        let is_last = is_over.load(Ordering::Relaxed);
        loop {
            match recv(packets.as_raw_fd(), &mut buffer, MsgFlags::MSG_DONTWAIT) {
                Ok(length) => counted.add(message_from(sender, &buffer[..length])),
                Err(Errno::EINTR) => {}
                Err(_) => break,
            }
        }
        if is_last {
            return counted;
        }
        thread::sleep(PERIOD);
    }
}

impl Discovered {
    fn add(&mut self, message: Option<&[u8]>) {
        let Some(Ok((_, submessages))) = message.map(Submessages::parse) else {
            return;
        };
        let mut announces = false;
        for submessage in submessages.filter_map(Result::ok) {
            let Submessage::Data(data) = submessage else {
                continue;
            };
            announces |= data.writer == EntityId::SPDP_WRITER;
            let is_of_endpoint = data.writer == EntityId::SEDP_PUBLICATIONS_WRITER
                || data.writer == EntityId::SEDP_SUBSCRIPTIONS_WRITER;
            self.endpoint_samples += u64::from(is_of_endpoint);
        }
        self.participant_packets += u64::from(announces);
    }
}

/// The payload of an unfragmented UDP datagram over IPv4.
fn message_from(sender: Ipv4Addr, packet: &[u8]) -> Option<&[u8]> {
    const UDP: u8 = 17;
    const UDP_HEADER: usize = 8;
    let header_length = 4 * usize::from(packet.first()? & 0x0f);
    let is_wanted = packet.first()? >> 4 == 4
        && *packet.get(9)? == UDP
        && packet.get(12..16)? == sender.octets().as_slice();
    is_wanted
        .then(|| packet.get(header_length + UDP_HEADER..))
        .flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    const SENDER: Ipv4Addr = Ipv4Addr::new(10, 1, 0, 1);

    fn packet(payload: &[u8]) -> Vec<u8> {
        let mut packet = vec![0x45, 0, 0, 0, 0, 0, 0, 0, 64, 17, 0, 0, 10, 1, 0, 1];
        packet.extend_from_slice(&[10, 1, 0, 2, 0, 1, 0, 2, 0, 0, 0, 0]);
        packet.extend_from_slice(payload);
        packet
    }

    /// DATA without payload.
    fn data(writer: EntityId) -> Vec<u8> {
        let mut data = vec![0x15, 1, 20, 0, 0, 0, 16, 0, 0, 0, 0, 0];
        data.extend_from_slice(&writer.0);
        data.extend_from_slice(&[0, 0, 0, 0, 1, 0, 0, 0]);
        data
    }

    #[test]
    fn announcements_and_samples_are_told_apart() {
        let mut message = b"RTPS\x02\x05\x01\x10prefixprefix".to_vec();
        message.extend(data(EntityId::SPDP_WRITER));
        message.extend(data(EntityId::SEDP_PUBLICATIONS_WRITER));
        message.extend(data(EntityId::SEDP_SUBSCRIPTIONS_WRITER));
        let mut counted = Discovered::default();
        counted.add(message_from(SENDER, &packet(&message)));
        counted.add(message_from(Ipv4Addr::LOCALHOST, &packet(&message)));
        counted.add(message_from(SENDER, &packet(b"nonsense")));
        let expected = Discovered {
            participant_packets: 1,
            endpoint_samples: 2,
        };
        assert_eq!(counted, expected);
    }
}
