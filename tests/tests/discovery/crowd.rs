//! Many [`Remote`] participants behind one socket, driven by the test that has them.

use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use rtps_tests::link::Host;
use rtps_tests::stage::PATIENCE;
use rtps_user::wire::GuidPrefix;

use crate::remote::Remote;

/// Where a host with one participant receives discovery traffic of domain 0 (RTPS 2.5, 9.6.2.3).
pub(crate) const METATRAFFIC_UNICAST: u16 = 7410;
const METATRAFFIC_MULTICAST: SocketAddr =
    SocketAddr::new(IpAddr::V4(Ipv4Addr::new(239, 255, 0, 1)), 7400);
/// How long the socket is listened to before it is looked what else there is to do.
const TICK: Duration = Duration::from_millis(5);
/// Unanswered questions are repeated after this.
const REPETITION: Duration = Duration::from_millis(500);
/// Where an INFO_DST that comes first has its GUID prefix (RTPS 2.5, 9.4.4 and 9.4.5.9).
const FIRST_DESTINATION: std::ops::Range<usize> = 24..36;
const INFO_DST: u8 = 0x0e;

/// See the module.
pub(crate) struct Crowd {
    pub(crate) remotes: Vec<Remote>,
    socket: UdpSocket,
    host: SocketAddr,
    announcements: Schedule,
    repetitions: Schedule,
    is_lively: bool,
}

/// What comes up at the same distance for one after the other, around and around.
struct Schedule {
    next: Instant,
    index: usize,
    round: Duration,
}

impl Crowd {
    /// Participants on `from` that announce themselves every `period` to the host at `to`.
    pub(crate) fn new(
        from: &Host,
        to: Ipv4Addr,
        count: u32,
        (period, lease): (Duration, Duration),
    ) -> Result<Self> {
        Self::at((from, from.interface.v4), to, count, (period, lease))
    }

    /// As [`Crowd::new`], at one of the addresses of `from`.
    pub(crate) fn at(
        (from, address): (&Host, Ipv4Addr),
        to: Ipv4Addr,
        count: u32,
        (period, lease): (Duration, Duration),
    ) -> Result<Self> {
        let socket = from.netns.enter(|| UdpSocket::bind((address, 0)))?;
        socket.set_read_timeout(Some(TICK))?;
        let metatraffic = socket.local_addr()?;
        let remotes = (0..count)
            .map(|_| Remote::new(next_prefix(), metatraffic, lease))
            .collect();
        Ok(Self {
            remotes,
            socket,
            host: (to, METATRAFFIC_UNICAST).into(),
            announcements: Schedule::new(period),
            repetitions: Schedule::new(REPETITION),
            is_lively: false,
        })
    }

    /// Their GUID prefixes.
    pub(crate) fn prefixes(&self) -> Vec<GuidPrefix> {
        self.remotes.iter().map(|remote| remote.prefix).collect()
    }

    /// Each makes so many endpoints and tells of them.
    pub(crate) fn add_endpoints(&mut self, count: usize) -> Result<()> {
        for _ in 0..count {
            let messages: Vec<_> = self.remotes.iter_mut().map(Remote::add_endpoint).collect();
            self.send_all(&messages)?;
        }
        Ok(())
    }

    /// From now on each announcement comes with an assertion of liveliness.
    pub(crate) fn be_lively(&mut self) {
        self.is_lively = true;
    }

    /// Lets only the first `count` go on; the others fall silent.
    pub(crate) fn truncate(&mut self, count: usize) {
        self.remotes.truncate(count);
    }

    /// Goes on for a while.
    pub(crate) fn run(&mut self, time: Duration) -> Result<()> {
        let end = Instant::now() + time;
        while Instant::now() < end {
            self.step()?;
        }
        Ok(())
    }

    /// Goes on until something holds.
    pub(crate) fn run_until(&mut self, what: &str, holds: impl Fn(&Self) -> bool) -> Result<()> {
        let deadline = Instant::now() + PATIENCE;
        while !holds(self) {
            ensure!(Instant::now() < deadline, "not within {PATIENCE:?}: {what}");
            self.step()?;
        }
        Ok(())
    }

    /// Goes on until everything that it has to tell is acknowledged and it knows all that the host tells.
    pub(crate) fn run_until_content(&mut self) -> Result<()> {
        self.run_until("discovery is complete", |crowd| {
            crowd.remotes.iter().all(Remote::is_content)
        })
    }

    /// Sends to the host's metatraffic unicast port.
    pub(crate) fn send(&self, message: &[u8]) -> Result<()> {
        let sent = self.socket.send_to(message, self.host);
        sent.map(drop).context("sending to the host")
    }

    /// Whether a datagram arrives within `time`.
    pub(crate) fn hears_something(&self, time: Duration) -> Result<bool> {
        let end = Instant::now() + time;
        let mut buffer = [0; 2048];
        while Instant::now() < end {
            match self.socket.recv(&mut buffer) {
                Ok(_) => return Ok(true),
                Err(error) if is_timeout(&error) => {}
                Err(error) => return Err(error.into()),
            }
        }
        Ok(false)
    }

    fn step(&mut self) -> Result<()> {
        while let Some(index) = self.announcements.due(self.remotes.len()) {
            let remote = &mut self.remotes[index];
            let message = remote.announcement();
            let assertion = self.is_lively.then(|| remote.assert_liveliness());
            self.socket.send_to(&message, METATRAFFIC_MULTICAST)?;
            assertion.map_or(Ok(()), |assertion| self.send(&assertion))?;
        }
        while let Some(index) = self.repetitions.due(self.remotes.len()) {
            if !self.remotes[index].is_content() {
                let questions = self.remotes[index].questions();
                self.send_all(&questions)?;
            }
        }
        self.receive()
    }

    fn receive(&mut self) -> Result<()> {
        let mut buffer = [0; 2048];
        let length = match self.socket.recv(&mut buffer) {
            Ok(length) => length,
            Err(error) if is_timeout(&error) => return Ok(()),
            Err(error) => return Err(error.into()),
        };
        let message = &buffer[..length];
        let destination = match message.get(20) {
            Some(&INFO_DST) => message.get(FIRST_DESTINATION),
            _ => None,
        };
        let mut replies = Vec::new();
        for remote in &mut self.remotes {
            if destination.is_none_or(|prefix| prefix == remote.prefix.0) {
                replies.extend(remote.receive(message));
            }
        }
        self.send_all(&replies)
    }

    fn send_all(&self, messages: &[Vec<u8>]) -> Result<()> {
        messages.iter().try_for_each(|message| self.send(message))
    }
}

impl Schedule {
    fn new(round: Duration) -> Self {
        Self {
            next: Instant::now(),
            index: 0,
            round,
        }
    }

    /// Whose turn it is now, if anybody's.
    fn due(&mut self, count: usize) -> Option<usize> {
        if count == 0 || Instant::now() < self.next {
            return None;
        }
        self.next += self.round / u32::try_from(count).unwrap_or(u32::MAX);
        self.index = (self.index + 1) % count;
        Some(self.index)
    }
}

fn is_timeout(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
}

/// Nobody else has it, not even in another test of this process.
fn next_prefix() -> GuidPrefix {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let [a, b, c, d] = NEXT.fetch_add(1, Ordering::Relaxed).to_be_bytes();
    GuidPrefix([0x01, 0xff, b'c', b'r', b'o', b'w', b'd', 0, a, b, c, d])
}
