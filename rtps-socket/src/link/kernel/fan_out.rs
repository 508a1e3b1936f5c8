//! One system call for several destinations: what is sent to a list of them the kernel copies to each.
//!
//! A list that comes again and again is shown to rtpsd, which says for which of its destinations it has found the way.
//! From then on a burst for the list goes once to an address where a program of the layer takes it, and from the app
//! itself only to those that are left: of this host, over IPv6, to groups. What the program refuses it drops, and the
//! system call says so; then the app sends to all by itself.

use std::collections::VecDeque;
use std::io;
use std::net::{SocketAddr, SocketAddrV4, UdpSocket};

use rtps_ebpf::abi::{FAN_OUT_ADDRESS, FAN_OUT_DESTINATIONS, FAN_OUTS_PER_APP};
use rtps_user::layer::protocol::{self, ToLayer};

use crate::link::Burst;
use crate::link::sender::Sender;
use crate::sys::fan_out;

/// How often a list is used before rtpsd is asked for it: those of repairs come once.
const USES_BEFORE_ASKING: u32 = 4;
/// After so many refusals in a row a list is not tried again.
const MAX_REFUSALS: u32 = 8;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct FanOut {
    socket: Option<Socket>,
    /// The list with number `n` is at `n - 1`.
    lists: Vec<List>,
    /// Counts bursts, to find the list that was not used for longest.
    clock: u64,
    requests: VecDeque<ToLayer>,
    /// There is no program that takes what is sent to lists, as far as is known.
    is_absent: bool,
}

#[derive(Debug)]
struct Socket {
    socket: UdpSocket,
    cookie: u64,
    sender: Sender,
}

#[derive(Debug)]
struct List {
    destinations: Vec<SocketAddr>,
    state: State,
    used: u64,
}

#[derive(Debug, Eq, PartialEq)]
enum State {
    /// It was used so many times.
    Seen(u32),
    /// rtpsd was asked.
    Asked,
    /// The kernel sends to all but those that are left.
    Served {
        left: Vec<SocketAddr>,
        refusals: u32,
    },
    /// The kernel does not send to any.
    Refused,
}

impl FanOut {
    /// Sends a burst to as many of its destinations as can be reached at once, and gives those that are left.
    pub(super) fn send<'a>(&'a mut self, burst: &Burst<'a>) -> &'a [SocketAddr] {
        if burst.destinations.len() < 2 || self.is_absent {
            return burst.destinations;
        }
        self.clock += 1;
        let index = self.list_of(burst.destinations);
        let outcome = self.send_to(index, burst);
        self.conclude(index, outcome);
        match self.lists.get(index).map(|list| &list.state) {
            Some(State::Served { left, refusals: 0 }) => left,
            _ => burst.destinations,
        }
    }

    /// The position of the list with these destinations; one that was not used for long makes room for a new one.
    fn list_of(&mut self, destinations: &[SocketAddr]) -> usize {
        let mut lists = self.lists.iter();
        if let Some(known) = lists.position(|list| list.destinations == destinations) {
            return known;
        }
        let list = List {
            destinations: destinations.to_vec(),
            state: State::Seen(0),
            used: self.clock,
        };
        if self.lists.len() < usize::from(FAN_OUTS_PER_APP) {
            self.lists.push(list);
            return self.lists.len() - 1;
        }
        // What was asked for is waited for, so that no answer is taken for that of another list.
        let lists = self.lists.iter_mut().enumerate();
        let settled = lists.filter(|(_, list)| list.state != State::Asked);
        match settled.min_by_key(|(_, list)| list.used) {
            Some((index, oldest)) => {
                *oldest = list;
                index
            }
            None => usize::MAX,
        }
    }

    /// Sends to a list where it is served; else notes that it would have been of use.
    fn send_to(&mut self, index: usize, burst: &Burst<'_>) -> Option<io::Result<()>> {
        let list = self.lists.get_mut(index)?;
        list.used = self.clock;
        match &mut list.state {
            State::Served { .. } => {
                let socket = self.socket.as_mut()?;
                let to = (FAN_OUT_ADDRESS, number(index)).into();
                Some(socket.sender.send_from(&socket.socket, to, burst))
            }
            State::Seen(uses) if *uses + 1 < USES_BEFORE_ASKING => {
                *uses += 1;
                None
            }
            State::Seen(_) => {
                self.ask(index);
                None
            }
            State::Asked | State::Refused => None,
        }
    }

    fn ask(&mut self, index: usize) {
        let Some(list) = self.lists.get_mut(index) else {
            return;
        };
        let reachable = list.destinations.iter().filter_map(|to| reachable(*to));
        let destinations: Vec<_> = reachable.take(FAN_OUT_DESTINATIONS).collect();
        if destinations.len() < 2 {
            list.state = State::Refused;
            return;
        }
        if self.socket.is_none() {
            let opened = Socket::open().inspect_err(
                |error| tracing::warn!(%error, "no socket for several destinations at once"),
            );
            self.socket = opened.ok();
        }
        let Some(socket) = &self.socket else {
            self.is_absent = true;
            return;
        };
        list.state = State::Asked;
        self.requests.push_back(ToLayer::FanOut(protocol::FanOut {
            cookie: socket.cookie,
            number: number(index) as u8,
            destinations,
        }));
    }

    /// Takes in what came of sending.
    fn conclude(&mut self, index: usize, outcome: Option<io::Result<()>>) {
        let Some(outcome) = outcome else { return };
        let list = self.lists.get_mut(index);
        let Some(state) = list.map(|list| &mut list.state) else {
            return;
        };
        let State::Served { refusals, .. } = state else {
            return;
        };
        match outcome {
            Ok(()) => *refusals = 0,
            // What was sent before has reached nobody.
            Err(error) if error.kind() == io::ErrorKind::ConnectionRefused => {
                tracing::info!("the fan-out is gone: sending to each destination by itself");
                *self = Self {
                    is_absent: true,
                    ..Self::default()
                };
            }
            Err(error) => {
                *refusals += 1;
                tracing::debug!(%error, "the kernel does not send to a list");
                if *refusals == MAX_REFUSALS {
                    *state = State::Refused;
                }
            }
        }
    }

    /// What rtpsd is to be asked next.
    pub(super) fn poll_request(&mut self) -> Option<ToLayer> {
        self.requests.pop_front()
    }

    /// rtpsd has found the ways to these destinations of a list, now or before.
    pub(super) fn answered(&mut self, number: u8, served: &[SocketAddrV4]) {
        let list = self.lists.get_mut(usize::from(number).wrapping_sub(1));
        let Some(list) = list.filter(|list| !matches!(list.state, State::Seen(_))) else {
            return;
        };
        let is_served = |to: &SocketAddr| reachable(*to).is_some_and(|to| served.contains(&to));
        let (served_here, left): (Vec<_>, Vec<_>) =
            list.destinations.iter().copied().partition(is_served);
        list.state = if served.is_empty() {
            State::Refused
        } else if served_here.len() == served.len() {
            State::Served { left, refusals: 0 }
        } else {
            // About another list, whose number this one has now.
            return;
        };
    }

    /// rtpsd was away and is back: what it had been asked meanwhile it does not know.
    pub(super) fn reconnected(&mut self) {
        self.is_absent = false;
        self.requests.clear();
        for list in &mut self.lists {
            if list.state == State::Asked {
                list.state = State::Seen(0);
            }
        }
    }
}

impl Socket {
    fn open() -> io::Result<Self> {
        let (socket, cookie) = fan_out::open()?;
        Ok(Self {
            socket,
            cookie,
            sender: Sender::default(),
        })
    }
}

/// The number of the list at a position, of which there are few.
fn number(index: usize) -> u16 {
    index as u16 + 1
}

/// A destination on another host, as far as its address tells.
fn reachable(destination: SocketAddr) -> Option<SocketAddrV4> {
    let SocketAddr::V4(destination) = destination else {
        return None;
    };
    let ip = destination.ip();
    let is_special =
        ip.is_loopback() || ip.is_multicast() || ip.is_broadcast() || ip.octets()[0] == 0;
    (!is_special).then_some(destination)
}

#[cfg(test)]
mod tests {
    use super::*;

    const REMOTE: [&str; 3] = ["192.0.2.1:7411", "192.0.2.2:7411", "192.0.2.3:7413"];
    const LOCAL: [&str; 4] = [
        "127.0.0.1:7411",
        "0.0.0.3:1",
        "239.255.0.1:7401",
        "[fd00::1]:7411",
    ];

    fn all() -> Vec<SocketAddr> {
        let all = REMOTE.iter().chain(&LOCAL);
        all.map(|address| address.parse().unwrap()).collect()
    }

    fn v4(addresses: &[&str]) -> Vec<SocketAddrV4> {
        let addresses = addresses.iter();
        addresses.map(|address| address.parse().unwrap()).collect()
    }

    fn send(fan_out: &mut FanOut, destinations: &[SocketAddr]) -> Vec<SocketAddr> {
        let burst = Burst {
            destinations,
            bytes: b"RTPS",
            segment: 4,
            dscp: 0,
        };
        fan_out.send(&burst).to_vec()
    }

    /// Uses a list until rtpsd is to be asked.
    fn asked(fan_out: &mut FanOut, destinations: &[SocketAddr]) -> protocol::FanOut {
        for _ in 0..USES_BEFORE_ASKING {
            assert_eq!(fan_out.poll_request(), None);
            assert_eq!(send(fan_out, destinations), destinations);
        }
        match fan_out.poll_request() {
            Some(ToLayer::FanOut(list)) => list,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn a_list_is_asked_for_once_it_proves_of_use() {
        let mut fan_out = FanOut::default();
        let list = asked(&mut fan_out, &all());
        assert_eq!((list.number, &list.destinations), (1, &v4(&REMOTE)));
        send(&mut fan_out, &all());
        assert_eq!(fan_out.poll_request(), None);
        let other = asked(&mut fan_out, &all()[..2]);
        assert_eq!((other.number, other.cookie), (2, list.cookie));
        // To a single one of another host there is nothing to gain.
        for _ in 0..2 * USES_BEFORE_ASKING {
            send(&mut fan_out, &all()[2..]);
            send(&mut fan_out, &all()[..1]);
        }
        assert_eq!(fan_out.poll_request(), None);
    }

    #[test]
    fn what_rtpsd_does_not_serve_is_left() {
        let mut fan_out = FanOut::default();
        asked(&mut fan_out, &all());
        fan_out.answered(1, &v4(&REMOTE[..2]));
        assert_eq!(send(&mut fan_out, &all()), all()[2..]);
        fan_out.answered(1, &[]);
        assert_eq!(send(&mut fan_out, &all()), all());
        // An answer about a list that has gone.
        fan_out.answered(1, &v4(&["192.0.2.9:7411"]));
        assert_eq!(send(&mut fan_out, &all()), all());
        fan_out.answered(9, &v4(&REMOTE));
    }

    #[test]
    fn without_a_program_the_app_sends_by_itself() {
        let mut fan_out = FanOut::default();
        asked(&mut fan_out, &all());
        fan_out.answered(1, &v4(&REMOTE));
        // The first goes into the void, and brings an error back.
        send(&mut fan_out, &all());
        assert_eq!(send(&mut fan_out, &all()), all());
        assert!(fan_out.is_absent);
        fan_out.reconnected();
        asked(&mut fan_out, &all());
    }

    #[test]
    fn what_a_vanished_rtpsd_was_asked_is_asked_again() {
        let mut fan_out = FanOut::default();
        asked(&mut fan_out, &all());
        fan_out.reconnected();
        asked(&mut fan_out, &all());
    }

    #[test]
    fn the_list_of_longest_ago_makes_room() {
        let mut fan_out = FanOut::default();
        for port in 1..=u16::from(FAN_OUTS_PER_APP) + 1 {
            let mut destinations = all();
            destinations[0].set_port(port);
            send(&mut fan_out, &all());
            send(&mut fan_out, &destinations);
        }
        assert_eq!(fan_out.lists.len(), usize::from(FAN_OUTS_PER_APP));
        let mut lists = fan_out.lists.iter();
        assert!(lists.any(|list| list.destinations == all()));
    }
}
