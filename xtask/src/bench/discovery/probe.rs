//! A stranger that announces itself and takes the time until somebody answers, again and again under new names.

use std::io;
use std::net::{Ipv4Addr, SocketAddr, UdpSocket};
use std::time::{Duration, Instant};

use anyhow::Result;
use clap::Args;
use rtps_user::wire::GuidPrefix;
use serde::{Deserialize, Serialize};

use super::member::{GROUP, Identity, LEASE, Member};
use crate::bench::round_trips::{RoundTrips, Summary};

/// Started by the benchmark itself, on the remote host.
#[derive(Args, Debug)]
pub(crate) struct Probe {
    /// Where the stranger lives.
    #[arg(long)]
    own: Ipv4Addr,
    /// The metatraffic address of the host that is to answer.
    #[arg(long)]
    host: SocketAddr,
    /// How often it is measured each way: by unicast, and by multicast.
    #[arg(long, default_value_t = 500)]
    count: u32,
}

/// What it prints.
#[derive(Debug, Deserialize, Serialize)]
pub(super) struct Answers {
    /// "answers".
    event: String,
    pub(super) all: Summary,
    pub(super) unicast: Summary,
    pub(super) multicast: Summary,
    /// Announcements that nobody answered.
    pub(super) unanswered: u32,
}

/// How long an answer is waited for.
const PATIENCE: Duration = Duration::from_millis(500);
/// Between two strangers: no stack has to limit its answers to so few.
const PAUSE: Duration = Duration::from_millis(10);
/// The first ones find caches and tables empty, and addresses to be resolved.
const WARM_UP: u32 = 5;

impl Probe {
    /// Measures and prints one JSON line.
    pub(crate) fn run(&self) -> Result<()> {
        let [mut all, mut unicast, mut multicast] = [(); 3].map(|()| RoundTrips::default());
        let mut unanswered = 0;
        for number in 0..WARM_UP + self.count {
            for (destination, times) in [(self.host, &mut unicast), (GROUP, &mut multicast)] {
                let time = self.ask(number, destination)?;
                match time {
                    _ if number < WARM_UP => {}
                    Some(time) => {
                        times.add(time);
                        all.add(time);
                    }
                    None => unanswered += 1,
                }
            }
        }
        let answers = Answers {
            event: "answers".to_owned(),
            all: all.summary(),
            unicast: unicast.summary(),
            multicast: multicast.summary(),
            unanswered,
        };
        println!("{}", serde_json::to_string(&answers)?);
        Ok(())
    }

    /// The time from a stranger's announcement to the first datagram for it; the stranger then says goodbye.
    fn ask(&self, number: u32, destination: SocketAddr) -> Result<Option<Duration>> {
        let now = Instant::now();
        let mut stranger = Member::new(now, self.identity(number, destination), 0)?;
        let announcement = stranger.announcement(now);
        let announced = Instant::now();
        stranger.socket().send_to(&announcement, destination)?;
        let answered = wait_for_datagram(stranger.socket(), announced + PATIENCE)?;
        let farewell = stranger.farewell(now);
        stranger.socket().send_to(&farewell, destination)?;
        std::thread::sleep(PAUSE);
        Ok(answered.map(|answered| answered - announced))
    }

    fn identity(&self, number: u32, destination: SocketAddr) -> Identity {
        let mut prefix = *b"stranger\0\0\0\0";
        prefix[0] ^= u8::from(destination == GROUP);
        prefix[8..].copy_from_slice(&number.to_be_bytes());
        Identity {
            prefix: GuidPrefix(prefix),
            own: self.own,
            peers: Vec::new(),
            announce_period: LEASE,
        }
    }
}

/// Asks the socket again and again, because to be woken would take longer than some answers do.
fn wait_for_datagram(socket: &UdpSocket, deadline: Instant) -> io::Result<Option<Instant>> {
    let mut buffer = [0; 65_536];
    loop {
        let received = socket.recv_from(&mut buffer);
        let now = Instant::now();
        match received {
            Ok(_) => return Ok(Some(now)),
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            Err(error) => return Err(error),
        }
        if now >= deadline {
            return Ok(None);
        }
    }
}
