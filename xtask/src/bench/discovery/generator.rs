//! A crowd of participants in one process: real SPDP and SEDP, no samples.
//!
//! Everybody has a GUID prefix and a UDP port of its own and announces itself to the group and to the measured host. The
//! members do not hear each other. On SIGUSR1 a part of the crowd falls silent.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clap::Args;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};
use nix::sys::signal::{SigSet, Signal};
use nix::sys::signalfd::SignalFd;
use rtps_user::wire::GuidPrefix;
use serde_json::json;

use super::member::{GROUP, Identity, Member};

/// Started by the benchmark itself, on the remote host; useful as a test tool as well.
#[derive(Args, Debug)]
pub(crate) struct Generator {
    /// How many participants.
    #[arg(long)]
    members: usize,
    /// Where they live.
    #[arg(long)]
    own: Ipv4Addr,
    /// The metatraffic address of the host that they join.
    #[arg(long)]
    host: SocketAddr,
    /// Writers of each, and as many readers.
    #[arg(long, default_value_t = 2)]
    endpoints: u16,
    /// How many fall silent on SIGUSR1.
    #[arg(long, default_value_t = 0)]
    silent: usize,
}

/// The time between two announcements of a member, on average: members drift apart as real ones do.
const PERIOD: Duration = Duration::from_secs(3);
/// Events taken at once.
const BATCH: usize = 64;
/// Tokens of epoll beside the members' numbers.
const GROUP_TOKEN: u64 = u64::MAX;
const SIGNAL_TOKEN: u64 = u64::MAX - 1;

impl Generator {
    /// Runs until it is ended; prints JSON lines.
    pub(crate) fn run(&self) -> Result<()> {
        let mut crowd = Crowd::new(self)?;
        println!("{}", json!({"event": "started", "members": self.members}));
        loop {
            crowd.turn()?;
        }
    }

    fn identity(&self, number: usize) -> Identity {
        let mut prefix = *b"crowd\0\0\0\0\0\0\0";
        prefix[8..].copy_from_slice(&(number as u32).to_be_bytes());
        // From nine to eleven tenths.
        let share = 0.9 + 0.2 * number as f64 / self.members as f64;
        Identity {
            prefix: GuidPrefix(prefix),
            own: self.own,
            peers: vec![self.host],
            announce_period: PERIOD.mul_f64(share),
        }
    }
}

struct Crowd {
    members: Vec<Member>,
    /// When each is due: asked of a member only after something has happened to it.
    due: Vec<Option<Instant>>,
    /// Members below this number have fallen silent.
    silenced: usize,
    to_silence: usize,
    group: UdpSocket,
    signal: SignalFd,
    epoll: Epoll,
}

impl Crowd {
    fn new(generator: &Generator) -> Result<Self> {
        let mut signals = SigSet::empty();
        signals.add(Signal::SIGUSR1);
        signals.thread_block()?;
        let signal = SignalFd::new(&signals)?;
        let group = UdpSocket::bind(("0.0.0.0".parse::<Ipv4Addr>()?, GROUP.port()))?;
        let SocketAddr::V4(address) = GROUP else {
            unreachable!("the group is one of IPv4")
        };
        group.join_multicast_v4(address.ip(), &generator.own)?;
        group.set_nonblocking(true)?;
        let epoll = Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC)?;
        epoll.add(&group, EpollEvent::new(EpollFlags::EPOLLIN, GROUP_TOKEN))?;
        epoll.add(&signal, EpollEvent::new(EpollFlags::EPOLLIN, SIGNAL_TOKEN))?;
        let now = Instant::now();
        let members = (0..generator.members)
            .map(|number| Member::new(now, generator.identity(number), generator.endpoints))
            .collect::<Result<Vec<_>>>()
            .context("a member cannot be made; has this process enough descriptors?")?;
        for (number, member) in members.iter().enumerate() {
            epoll.add(
                member.socket(),
                EpollEvent::new(EpollFlags::EPOLLIN, number as u64),
            )?;
        }
        Ok(Self {
            due: vec![Some(now); members.len()],
            members,
            silenced: 0,
            to_silence: generator.silent.min(generator.members),
            group,
            signal,
            epoll,
        })
    }

    /// Waits for something, and does what follows.
    fn turn(&mut self) -> Result<()> {
        let mut events = [EpollEvent::empty(); BATCH];
        let count = self.epoll.wait(&mut events, self.time_left())?;
        let now = Instant::now();
        for event in &events[..count] {
            match event.data() {
                GROUP_TOKEN => self.hear_group(now)?,
                SIGNAL_TOKEN => self.fall_silent(now)?,
                number => self.receive(now, number as usize)?,
            }
        }
        self.act(now)?;
        Ok(())
    }

    fn time_left(&self) -> EpollTimeout {
        let Some(due) = self.due[self.silenced..].iter().flatten().min() else {
            return EpollTimeout::NONE;
        };
        let left = due.saturating_duration_since(Instant::now());
        // Rounded up: to wake too early would be to spin.
        let milliseconds = left.as_nanos().div_ceil(1_000_000);
        EpollTimeout::from(milliseconds.min(1000) as u16)
    }

    fn receive(&mut self, now: Instant, number: usize) -> io::Result<()> {
        let member = &mut self.members[number];
        if number < self.silenced {
            // Nobody reads what comes to the silent.
            return self.epoll.delete(member.socket()).map_err(Into::into);
        }
        member.receive(now)?;
        self.due[number] = member.due();
        Ok(())
    }

    /// What comes to the group concerns everybody.
    fn hear_group(&mut self, now: Instant) -> io::Result<()> {
        let mut buffer = [0; 65_536];
        loop {
            let (length, source) = match self.group.recv_from(&mut buffer) {
                Ok(received) => received,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
                Err(error) => return Err(error),
            };
            let speaking = self.members.iter_mut().zip(&mut self.due);
            for (member, due) in speaking.skip(self.silenced) {
                member.take(now, source, &buffer[..length]);
                member.send(now)?;
                *due = member.due();
            }
        }
    }

    fn act(&mut self, now: Instant) -> io::Result<()> {
        let speaking = self.members.iter_mut().zip(&mut self.due);
        for (member, due) in speaking.skip(self.silenced) {
            if due.is_some_and(|due| due <= now) {
                member.act(now)?;
                *due = member.due();
            }
        }
        Ok(())
    }

    /// From now on nothing is heard of the first members; tells who they are and how long ago they last spoke.
    fn fall_silent(&mut self, now: Instant) -> Result<()> {
        self.signal.read_signal()?;
        self.silenced = self.to_silence;
        let silenced = self.members[..self.silenced].iter().map(|member| {
            let age = now.saturating_duration_since(member.last_sent);
            json!({"prefix": member.prefix.to_string(), "silent_for_seconds": age.as_secs_f64()})
        });
        let silenced: Vec<_> = silenced.collect();
        println!("{}", json!({"event": "silent", "members": silenced}));
        Ok(())
    }
}
