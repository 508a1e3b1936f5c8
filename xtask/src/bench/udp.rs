//! The floor of the latency benchmark: a round trip over plain blocking UDP sockets.

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
const LOST_AFTER: Duration = Duration::from_secs(1);

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
        let mut round_trips = RoundTrips::default();
        let start = Instant::now();
        let end = start + Duration::from_secs_f64(self.seconds);
        let mut now = start;
        while now < end {
            socket.send_to(&buffer, other)?;
            match socket.recv_from(&mut buffer) {
                Ok(_) => {
                    let answered = Instant::now();
                    round_trips.add(answered - now);
                    now = answered;
                }
                // The other end may not listen yet.
                Err(_) => now = Instant::now(),
            }
        }
        println!("{}", serde_json::to_string(&round_trips.summary())?);
        Ok(())
    }
}

fn pong(socket: &UdpSocket) -> Result<()> {
    let mut buffer = vec![0; 65_536];
    loop {
        let (length, from) = socket.recv_from(&mut buffer)?;
        socket.send_to(&buffer[..length], from)?;
    }
}
