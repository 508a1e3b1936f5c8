//! The floor of the latency benchmark: a round trip over plain blocking UDP sockets.

use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clap::Args;

use super::round_trips::RoundTrips;

/// One end of the ping-pong; started by the benchmark inside a network namespace.
#[derive(Args, Debug)]
pub(crate) struct UdpEnd {
    /// Where this end listens.
    #[arg(long)]
    bind: SocketAddr,
    /// The other end; with it this end pings, without it answers.
    #[arg(long)]
    ping: Option<SocketAddr>,
    /// Bytes of payload.
    #[arg(long, default_value_t = 100)]
    size: usize,
    /// How long to measure.
    #[arg(long, default_value_t = 1.0)]
    seconds: f64,
}

/// How long a lost datagram is waited for.
const LOST_AFTER: Duration = Duration::from_millis(50);

impl UdpEnd {
    /// Pings and prints what was measured as one JSON line, or answers until it is ended.
    pub(crate) fn run(&self) -> Result<()> {
        let socket =
            UdpSocket::bind(self.bind).with_context(|| format!("{} cannot be bound", self.bind))?;
        match self.ping {
            Some(other) => self.ping(&socket, other),
            None => pong(&socket),
        }
    }

    fn ping(&self, socket: &UdpSocket, other: SocketAddr) -> Result<()> {
        socket.set_read_timeout(Some(LOST_AFTER))?;
        let mut buffer = vec![0; self.size];
        // The other end may not listen yet: the time counts from its first answer.
        while round_trip(socket, other, &mut buffer)?.is_none() {}
        let mut round_trips = RoundTrips::default();
        let end = Instant::now() + Duration::from_secs_f64(self.seconds);
        while Instant::now() < end {
            if let Some(time) = round_trip(socket, other, &mut buffer)? {
                round_trips.add(time);
            }
        }
        println!("{}", serde_json::to_string(&round_trips.summary())?);
        Ok(())
    }
}

/// `None` when there was no answer in time.
fn round_trip(
    socket: &UdpSocket,
    other: SocketAddr,
    buffer: &mut [u8],
) -> Result<Option<Duration>> {
    let sent = Instant::now();
    socket.send_to(buffer, other)?;
    match socket.recv_from(buffer) {
        Ok(_) => Ok(Some(sent.elapsed())),
        Err(error) if error.kind() == ErrorKind::WouldBlock => Ok(None),
        // The other end has not bound its port yet, and its host said so.
        Err(error) if error.kind() == ErrorKind::ConnectionRefused => Ok(None),
        Err(error) => Err(error.into()),
    }
}

fn pong(socket: &UdpSocket) -> Result<()> {
    let mut buffer = vec![0; 65_536];
    loop {
        let (length, from) = socket.recv_from(&mut buffer)?;
        socket.send_to(&buffer[..length], from)?;
    }
}
