//! The floor of the benchmarks: the same exchanges over plain UDP sockets, a datagram for each sample.

use std::collections::HashMap;
use std::io::{self, ErrorKind};
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::round_trips::RoundTrips;
use crate::interrupt;

/// One end of an exchange; started by the benchmark inside a network namespace, ended by SIGTERM.
#[derive(Args, Debug)]
pub(crate) struct UdpEnd {
    #[arg(value_enum)]
    role: Role,
    /// Where this end listens.
    #[arg(long)]
    port: u16,
    /// The other ends.
    #[arg(long = "other")]
    others: Vec<SocketAddr>,
    /// Bytes of payload.
    #[arg(long, default_value_t = 100)]
    size: usize,
    /// Bursts a second; as many as can be unless given.
    #[arg(long)]
    rate: Option<f64>,
    /// Datagrams of a burst.
    #[arg(long, default_value_t = 1)]
    burst: u64,
    /// Seconds at the beginning that do not count.
    #[arg(long, default_value_t = 0.0)]
    warm_up: f64,
    /// Ask again and again instead of sleeping until something comes.
    #[arg(long)]
    spin: bool,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum Role {
    Ping,
    Pong,
    Pub,
    Sub,
}

/// How long a lost datagram is waited for, and how long a signal may go unnoticed.
const LOST_AFTER: Duration = Duration::from_millis(50);
/// Longer than any datagram.
const LONGEST: usize = 65_536;
/// Bytes of a datagram's number, at its beginning.
const NUMBER: usize = size_of::<u64>();

impl UdpEnd {
    /// Measures or answers until it is ended; prints JSON lines.
    pub(crate) fn run(&self) -> Result<()> {
        interrupt::catch()?;
        let socket = UdpSocket::bind((Ipv4Addr::UNSPECIFIED, self.port))
            .with_context(|| format!("port {} cannot be bound", self.port))?;
        socket.set_read_timeout(Some(LOST_AFTER))?;
        socket.set_nonblocking(self.spin)?;
        match self.role {
            Role::Ping => self.ping(&socket),
            Role::Pong => pong(&socket),
            Role::Pub => self.publish(&socket),
            Role::Sub => self.subscribe(&socket),
        }
    }

    fn ping(&self, socket: &UdpSocket) -> Result<()> {
        let other = *self.others.first().context("there is nobody to ping")?;
        let mut buffer = vec![0; self.size];
        // The other end may not listen yet: the time counts from its first answer.
        while round_trip(socket, other, &mut buffer)?.is_none() && is_wanted() {}
        print(&json!({"event": "ready"}));
        let start = Instant::now() + Duration::from_secs_f64(self.warm_up);
        let (mut round_trips, mut lost) = (RoundTrips::default(), 0_u64);
        while is_wanted() {
            let time = round_trip(socket, other, &mut buffer)?;
            if Instant::now() < start {
                continue;
            }
            match time {
                Some(time) => round_trips.add(time),
                None => lost += 1,
            }
        }
        let mut summary = serde_json::to_value(round_trips.summary())?;
        summary["event"] = json!("summary");
        summary["role"] = json!("ping");
        summary["lost"] = json!(lost);
        summary["seconds"] = json!(start.elapsed().as_secs_f64());
        print(&summary);
        Ok(())
    }

    fn publish(&self, socket: &UdpSocket) -> Result<()> {
        let mut buffer = vec![0; self.size.max(NUMBER)];
        let start = Instant::now();
        let mut sent = 0_u64;
        while is_wanted() {
            buffer[..NUMBER].copy_from_slice(&sent.to_ne_bytes());
            for other in &self.others {
                send(socket, *other, &buffer)?;
            }
            sent += 1;
            if let Some(rate) = self.rate.filter(|_| sent.is_multiple_of(self.burst)) {
                let due = start + Duration::from_secs_f64((sent / self.burst) as f64 / rate);
                std::thread::sleep(due.saturating_duration_since(Instant::now()));
            }
        }
        print(&json!({"event": "summary", "role": "pub", "count": sent}));
        Ok(())
    }

    fn subscribe(&self, socket: &UdpSocket) -> Result<()> {
        let mut buffer = vec![0; LONGEST];
        let mut arrivals = Arrivals::default();
        let mut start = None;
        while is_wanted() {
            let Some((length, from)) = receive(socket, &mut buffer)? else {
                continue;
            };
            let now = Instant::now();
            let start = start.get_or_insert_with(|| {
                print(&json!({"event": "ready"}));
                now + Duration::from_secs_f64(self.warm_up)
            });
            if now >= *start {
                arrivals.add(now, from, &buffer[..length]);
            }
        }
        print(&arrivals.summary());
        Ok(())
    }
}

fn is_wanted() -> bool {
    interrupt::check().is_ok()
}

fn print(event: &Value) {
    println!("{event}");
}

fn pong(socket: &UdpSocket) -> Result<()> {
    let mut buffer = vec![0; LONGEST];
    while is_wanted() {
        if let Some((length, from)) = receive(socket, &mut buffer)? {
            send(socket, from, &buffer[..length])?;
        }
    }
    Ok(())
}

/// `None` when there was no answer in time.
fn round_trip(
    socket: &UdpSocket,
    other: SocketAddr,
    buffer: &mut [u8],
) -> Result<Option<Duration>> {
    let sent = Instant::now();
    send(socket, other, buffer)?;
    // A spinning socket says at once that there is nothing.
    while sent.elapsed() < LOST_AFTER {
        if receive(socket, buffer)?.is_some() {
            return Ok(Some(sent.elapsed()));
        }
    }
    Ok(None)
}

fn send(socket: &UdpSocket, to: SocketAddr, datagram: &[u8]) -> Result<()> {
    match socket.send_to(datagram, to) {
        Err(error) if !is_passing(&error) => Err(error.into()),
        _ => Ok(()),
    }
}

fn receive(socket: &UdpSocket, buffer: &mut [u8]) -> Result<Option<(usize, SocketAddr)>> {
    match socket.recv_from(buffer) {
        Ok(received) => Ok(Some(received)),
        Err(error) if is_passing(&error) => Ok(None),
        Err(error) => Err(error.into()),
    }
}

/// Nothing there, no room, a signal, or the other end's host has said that nobody listens yet.
fn is_passing(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::WouldBlock | ErrorKind::Interrupted | ErrorKind::ConnectionRefused
    )
}

/// Numbered datagrams as they came.
#[derive(Default)]
struct Arrivals {
    count: u64,
    bytes: u64,
    period: Option<(Instant, Instant)>,
    /// The first and the highest number of each sender.
    numbers: HashMap<SocketAddr, (u64, u64)>,
}

impl Arrivals {
    fn add(&mut self, now: Instant, from: SocketAddr, datagram: &[u8]) {
        let Some(number) = datagram.first_chunk() else {
            return;
        };
        let number = u64::from_ne_bytes(*number);
        self.count += 1;
        self.bytes += datagram.len() as u64;
        self.period.get_or_insert((now, now)).1 = now;
        let (_, highest) = self.numbers.entry(from).or_insert((number, number));
        *highest = number.max(*highest);
    }

    fn summary(&self) -> Value {
        let expected = self
            .numbers
            .values()
            .map(|(first, highest)| highest - first + 1);
        let lost = expected.sum::<u64>().saturating_sub(self.count);
        let seconds = self
            .period
            .map_or(0.0, |(from, to)| (to - from).as_secs_f64());
        let a_second = |count: u64| {
            if seconds > 0.0 {
                count as f64 / seconds
            } else {
                0.0
            }
        };
        json!({"event": "summary", "role": "sub", "count": self.count, "lost": lost, "seconds": seconds,
            "samples_per_s": a_second(self.count), "bytes_per_s": a_second(self.bytes)})
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_are_losses() {
        let mut arrivals = Arrivals::default();
        let start = Instant::now();
        let from = SocketAddr::from((Ipv4Addr::LOCALHOST, 1));
        for number in [5_u64, 6, 8, 7, 12] {
            let now = start + Duration::from_secs(number);
            arrivals.add(now, from, &number.to_ne_bytes());
        }
        let summary = arrivals.summary();
        assert_eq!(
            (&summary["count"], &summary["lost"]),
            (&json!(5), &json!(3))
        );
        assert_eq!(summary["samples_per_s"], 5.0 / 7.0);
    }
}
