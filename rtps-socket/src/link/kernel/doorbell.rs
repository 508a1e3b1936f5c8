//! The app's own UDP socket: datagrams leave through it, and what arrives in it only wakes the app.

use std::net::UdpSocket;

use crate::sys::udp;

/// Bytes after which what has piled up is thrown away: few enough that the socket's receive buffer, without room
/// in which it would not wake anybody, cannot be full (it has 212,992 where nobody changed net.core.rmem_default, and the
/// last burst may have 65,536), and enough for the system call not to matter.
const PENDING_MAX: usize = 80 * 1024;
/// What the kernel counts for a datagram beside its payload, at most. A burst counts as much as it had, though it was
/// emptied to ring.
const OVERHEAD: usize = 1024;

/// How often records are taken after a sleep until none of them can have rung any more: a program that saw the app
/// asleep may be a little late with its record.
const LATE_ROUNDS: u32 = 4;

/// See the module.
#[derive(Debug)]
pub(super) struct Doorbell {
    socket: UdpSocket,
    /// The most bytes that can be in the socket.
    pending: usize,
    /// How often records are still to be taken that may have rung.
    rounds: u32,
}

impl Doorbell {
    pub(super) fn new(socket: UdpSocket) -> Self {
        Self {
            socket,
            pending: 0,
            rounds: 0,
        }
    }

    /// The socket, to send from.
    pub(super) fn socket(&self) -> &UdpSocket {
        &self.socket
    }

    /// From now on each record rings.
    pub(super) fn armed(&mut self) {
        self.rounds = LATE_ROUNDS;
    }

    /// `records` of so many `bytes` were taken out of the ring, and the socket has woken the app or not. Until the app is
    /// awake and says so, each of the records may have rung: one after the other leaves its datagram, whatever the number
    /// of wake-ups.
    pub(super) fn took(&mut self, records: usize, bytes: usize, has_rung: bool) {
        if self.rounds == 0 && !has_rung {
            return;
        }
        // A record that is there has been waited for.
        self.rounds -= u32::from(records > 0).min(self.rounds);
        // Without a record it rings for one that was taken before, or a stranger does: nobody counts those.
        let is_late = has_rung && records == 0;
        let taken = bytes + records * OVERHEAD;
        self.pending += taken;
        if is_late || self.pending >= PENDING_MAX {
            udp::discard_pending(&self.socket);
            // A record is in the ring a little before its datagram is in the socket.
            self.pending = taken;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::os::fd::AsFd;
    use std::time::Duration;

    use super::*;
    use crate::sys::{Epoll, Interest};

    const LEN: usize = 1400;

    /// Sends `burst` datagrams per wake-up; `take` tells the doorbell what came out of the ring.
    fn ring_often(burst: usize, mut take: impl FnMut(&mut Doorbell)) {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let (epoll, address) = (Epoll::new().unwrap(), socket.local_addr().unwrap());
        epoll.add(socket.as_fd(), 5, Interest::Edge).unwrap();
        let mut doorbell = Doorbell::new(socket);
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        for round in 0..2000 {
            for _ in 0..burst {
                sender.send_to(&[0; LEN], address).unwrap();
            }
            doorbell.armed();
            let wakeups = epoll.wait(Some(Duration::from_millis(500))).unwrap();
            assert!(wakeups.contains(5), "silent in round {round} of {burst}");
            take(&mut doorbell);
        }
    }

    #[test]
    fn it_never_stops_ringing() {
        for burst in [1, 3, 44, 300] {
            ring_often(burst, |doorbell| doorbell.took(burst, burst * LEN, true));
        }
    }

    #[test]
    fn records_taken_without_a_wake_up_count() {
        ring_often(44, |doorbell| {
            doorbell.took(1, LEN, true);
            doorbell.took(43, 43 * LEN, false);
        });
    }

    #[test]
    fn what_comes_while_the_app_is_awake_does_not_ring() {
        let mut doorbell = Doorbell::new(UdpSocket::bind("127.0.0.1:0").unwrap());
        doorbell.armed();
        (0..100).for_each(|_| doorbell.took(1, LEN, false));
        assert_eq!(doorbell.pending, LATE_ROUNDS as usize * (LEN + OVERHEAD));
    }

    #[test]
    fn datagrams_that_come_after_their_records_do_not_fill_it() {
        ring_often(20, |doorbell| doorbell.took(0, 0, true));
    }
}
