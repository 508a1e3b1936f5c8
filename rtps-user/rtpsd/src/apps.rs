//! The connections of apps: who they are, what they say, and what they are told.
//!
//! No app can make rtpsd wait or grow without bound: sockets don't block, what an app does not read is bounded, so
//! is the number of connections, the time until a hello, and the number of messages handled before others get
//! their turn. Who breaks the protocol is told so in a sentence and disconnected.

use std::collections::BTreeMap;
use std::fs::{self, Permissions};
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, OwnedFd};
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use nix::errno::Errno;
use nix::sys::socket::sockopt::PeerCredentials;
use nix::sys::socket::{
    AddressFamily, Backlog, SockFlag, SockType, UnixAddr, accept4, bind, getsockopt, listen, socket,
};
use nix::unistd::{Gid, Group, chown};
use rtps_user::layer::protocol::{FromLayer, Hello, MAX_PROTOCOL_MESSAGE, ToLayer, Welcome};
use tracing::{debug, info, warn};

use crate::host::{Host, Seat};
use crate::inboxes::Made;
use crate::packet_socket::{Incoming, PacketSocket};
use crate::readiness::{Interest, Readiness, Source};
use crate::run_folder::remove_if_there;

/// Attached apps, and a few that have not yet said hello.
const MAX_CONNECTIONS: usize = 255 + 64;

/// Attached apps of one user other than root, so that nobody can keep all others out.
const MAX_OF_ONE_USER: usize = 200;

/// The time in which an app must say hello.
const HELLO_TIME: Duration = Duration::from_secs(5);

/// Messages of one app, or new connections, that are handled before others get their turn.
const BURST: usize = 64;

/// Who may connect.
#[derive(Clone, Debug)]
pub(crate) struct Access {
    pub(crate) mode: u32,
    pub(crate) group: Option<Gid>,
}

impl Access {
    /// Looks the group up.
    pub(crate) fn new(mode: u32, group: Option<&str>) -> Result<Self> {
        let group = match group {
            None => None,
            Some(name) => Some(
                Group::from_name(name)?
                    .with_context(|| format!("there is no group `{name}`"))?
                    .gid,
            ),
        };
        Ok(Self { mode, group })
    }

    /// Applies it to a socket's file.
    pub(crate) fn apply(&self, path: &Path) -> Result<()> {
        if self.group.is_some() {
            chown(path, None, self.group)
                .with_context(|| format!("cannot change the group of {}", path.display()))?;
        }
        fs::set_permissions(path, Permissions::from_mode(self.mode))
            .with_context(|| format!("cannot change the permissions of {}", path.display()))
    }
}

/// An app's connection.
pub(crate) struct Connection {
    socket: PacketSocket,
    pub(crate) pid: i32,
    pub(crate) uid: u32,
    since: Instant,
    waits_to_write: bool,
    pub(crate) seat: Option<Seat>,
    /// What the app is to be told once its inbox is there.
    pending: Option<Welcome>,
}

/// All of them.
pub(crate) struct Apps {
    listener: OwnedFd,
    connections: BTreeMap<u32, Connection>,
    by_slot: BTreeMap<u8, u32>,
    next_id: u32,
    buffer: Box<[u8; MAX_PROTOCOL_MESSAGE]>,
}

impl Apps {
    /// Opens the socket that apps connect to.
    pub(crate) fn listen(path: &Path, access: &Access) -> Result<Self> {
        remove_if_there(path)?;
        let flags = SockFlag::SOCK_CLOEXEC | SockFlag::SOCK_NONBLOCK;
        let listener = socket(AddressFamily::Unix, SockType::SeqPacket, flags, None)?;
        bind(listener.as_raw_fd(), &UnixAddr::new(path)?)
            .with_context(|| format!("cannot make the socket {}", path.display()))?;
        access.apply(path)?;
        listen(&listener, Backlog::new(128)?)?;
        Ok(Self {
            listener,
            connections: BTreeMap::new(),
            by_slot: BTreeMap::new(),
            next_id: 0,
            buffer: Box::new([0; MAX_PROTOCOL_MESSAGE]),
        })
    }

    /// Attached apps.
    pub(crate) fn attached(&self) -> impl Iterator<Item = (&Connection, &Seat)> {
        let connections = self.connections.values();
        connections.filter_map(|connection| Some((connection, connection.seat.as_ref()?)))
    }

    /// Takes new connections.
    pub(crate) fn accept(&mut self, now: Instant, readiness: &Readiness) {
        for _ in 0..BURST {
            let flags = SockFlag::SOCK_CLOEXEC | SockFlag::SOCK_NONBLOCK;
            let socket = match accept4(self.listener.as_raw_fd(), flags) {
                Ok(descriptor) => crate::sys::accepted_fd(descriptor),
                Err(Errno::EAGAIN) => return,
                Err(error) => {
                    debug!("cannot accept: {error}");
                    return;
                }
            };
            if let Err(error) = self.admit(now, socket, readiness) {
                warn!("cannot take a connection: {error:#}");
            }
        }
    }

    fn admit(&mut self, now: Instant, socket: OwnedFd, readiness: &Readiness) -> Result<()> {
        let credentials = getsockopt(&socket, PeerCredentials)?;
        let connection = Connection {
            socket: PacketSocket::new(socket),
            pid: credentials.pid(),
            uid: credentials.uid(),
            since: now,
            waits_to_write: false,
            seat: None,
            pending: None,
        };
        self.make_room();
        let id = self.next_id;
        self.next_id = self.next_id.wrapping_add(1);
        readiness.add(connection.socket.as_fd(), Source::App(id), Interest::Read)?;
        self.connections.insert(id, connection);
        Ok(())
    }

    /// Where there are too many connections, the one that has been silent for longest goes: whoever means well says
    /// hello at once.
    fn make_room(&mut self) {
        if self.connections.len() < MAX_CONNECTIONS {
            return;
        }
        let connections = self.connections.iter();
        let silent = connections.filter(|(_, connection)| connection.seat.is_none());
        let longest = silent.min_by_key(|(_, connection)| connection.since);
        if let Some(id) = longest.map(|(id, _)| *id)
            && let Some(mut connection) = self.connections.remove(&id)
        {
            let reason = "too many connections wait for a hello, and this one for longest";
            refuse(&mut connection, reason.to_owned());
        }
    }

    /// Handles what an app said, and writes what waited for it.
    pub(crate) fn handle(&mut self, now: Instant, id: u32, host: &mut Host, readiness: &Readiness) {
        for _ in 0..BURST {
            let Some(connection) = self.connections.get_mut(&id) else {
                return;
            };
            if connection.socket.flush().is_err() {
                self.close(now, id, host);
                return;
            }
            match connection.socket.receive(&mut self.buffer) {
                Incoming::Message(message) => {
                    if let Err(reason) = self.obey(now, id, message, host) {
                        self.expel(now, id, reason, host);
                    }
                }
                Incoming::Garbage(reason) => self.expel(now, id, reason, host),
                Incoming::Closed => self.close(now, id, host),
                Incoming::Nothing => break,
            }
            self.deliver(now, host, readiness);
        }
        self.update_interest(id, readiness);
    }

    /// Does what an app asks for; the error is why it has to go.
    fn obey(
        &mut self,
        now: Instant,
        id: u32,
        message: ToLayer,
        host: &mut Host,
    ) -> Result<(), String> {
        let Some(connection) = self.connections.get_mut(&id) else {
            return Ok(());
        };
        match (&connection.seat, message) {
            (None, ToLayer::Hello(hello)) => self.greet(now, id, &hello, host),
            (None, _) => Err("the first message must be a hello".to_owned()),
            (Some(_), ToLayer::Hello(_)) => Err("the app has already said hello".to_owned()),
            (Some(_), _) if connection.pending.is_some() => {
                Err("the app does not wait for its welcome".to_owned())
            }
            (Some(seat), request) => {
                host.request(now, seat, request);
                Ok(())
            }
        }
    }

    fn greet(
        &mut self,
        now: Instant,
        id: u32,
        hello: &Hello,
        host: &mut Host,
    ) -> Result<(), String> {
        self.check_user(id)?;
        let admission = host.attach(now, id, hello)?;
        let Some(connection) = self.connections.get_mut(&id) else {
            host.detach(now, &admission.seat);
            return Ok(());
        };
        let seat = admission.seat;
        info!(
            slot = seat.slot,
            domain = seat.domain,
            name = seat.name,
            pid = connection.pid,
            uid = connection.uid,
            returned = admission.has_inbox,
            "app attached"
        );
        connection.seat = Some(seat);
        connection.pending = Some(admission.welcome);
        if admission.has_inbox {
            self.welcome(id, Vec::new())?;
        }
        Ok(())
    }

    /// Welcomes the apps whose inboxes are there.
    pub(crate) fn welcome_all(&mut self, now: Instant, host: &mut Host, readiness: &Readiness) {
        while let Some(Made { order, inbox }) = host.next_inbox() {
            let id = order.connection;
            if !self.connections.contains_key(&id) {
                // It is gone, and its slot may be another app's.
                continue;
            }
            let welcomed = inbox
                .and_then(|inbox| host.open(&order).map(|()| inbox))
                .and_then(|inbox| self.welcome(id, vec![inbox.ring, inbox.bell]));
            if let Err(reason) = welcomed {
                let reason = format!("rtpsd cannot make the app's ring: {reason}");
                self.expel(now, id, reason, host);
            }
            self.update_interest(id, readiness);
        }
    }

    fn welcome(&mut self, id: u32, descriptors: Vec<OwnedFd>) -> Result<(), String> {
        let Some(connection) = self.connections.get_mut(&id) else {
            return Ok(());
        };
        let Some(welcome) = connection.pending.take() else {
            return Ok(());
        };
        self.by_slot.insert(welcome.slot, id);
        connection
            .socket
            .send(&FromLayer::Welcome(welcome), descriptors)
            .map_err(|failure| format!("the welcome cannot be sent ({failure:?})"))
    }

    fn check_user(&self, id: u32) -> Result<(), String> {
        let uid = self
            .connections
            .get(&id)
            .map_or(0, |connection| connection.uid);
        let of_user = self.attached().filter(|(other, _)| other.uid == uid);
        if uid != 0 && of_user.count() >= MAX_OF_ONE_USER {
            return Err(format!(
                "user {uid} has {MAX_OF_ONE_USER} apps on this layer, which is all that one user may have: \
                 end some of them"
            ));
        }
        Ok(())
    }

    /// Tells the apps what the host has for them.
    pub(crate) fn deliver(&mut self, now: Instant, host: &mut Host, readiness: &Readiness) {
        loop {
            let replies = host.take_replies();
            if replies.is_empty() {
                return;
            }
            for reply in replies {
                let slot = reply.slot;
                let Some(id) = self.by_slot.get(&slot).copied() else {
                    continue;
                };
                let Some(connection) = self.connections.get_mut(&id) else {
                    continue;
                };
                match connection.socket.send(&reply.message, reply.descriptors) {
                    Ok(()) => self.update_interest(id, readiness),
                    Err(failure) => {
                        debug!(slot, ?failure, "app cannot be told anything");
                        self.close(now, id, host);
                    }
                }
            }
        }
    }

    /// When [`handle_timeouts`](Self::handle_timeouts) is due.
    pub(crate) fn next_timeout(&self) -> Option<Instant> {
        let silent = self.connections.values().filter(|c| c.seat.is_none());
        silent.map(|connection| connection.since + HELLO_TIME).min()
    }

    /// Disconnects who has not said hello in time.
    pub(crate) fn handle_timeouts(&mut self, now: Instant, host: &mut Host) {
        let overdue: Vec<u32> = self
            .connections
            .iter()
            .filter(|(_, connection)| {
                connection.seat.is_none() && connection.since + HELLO_TIME <= now
            })
            .map(|(id, _)| *id)
            .collect();
        for id in overdue {
            self.expel(now, id, "the hello did not come in time".to_owned(), host);
        }
    }

    fn expel(&mut self, now: Instant, id: u32, reason: String, host: &mut Host) {
        if let Some(connection) = self.connections.get_mut(&id) {
            refuse(connection, reason);
            // What is left unread at the end would reach the app as a broken connection before the reason does.
            for _ in 0..BURST {
                match connection.socket.receive(&mut self.buffer) {
                    Incoming::Message(_) | Incoming::Garbage(_) => {}
                    Incoming::Nothing | Incoming::Closed => break,
                }
            }
        }
        self.close(now, id, host);
    }

    fn close(&mut self, now: Instant, id: u32, host: &mut Host) {
        let Some(connection) = self.connections.remove(&id) else {
            return;
        };
        if let Some(seat) = &connection.seat {
            info!(slot = seat.slot, name = seat.name, "app detached");
            self.by_slot.remove(&seat.slot);
            host.detach(now, seat);
        }
    }

    fn update_interest(&mut self, id: u32, readiness: &Readiness) {
        let Some(connection) = self.connections.get_mut(&id) else {
            return;
        };
        let waits = connection.socket.is_waiting();
        if waits == connection.waits_to_write {
            return;
        }
        connection.waits_to_write = waits;
        let interest = if waits {
            Interest::ReadAndWrite
        } else {
            Interest::Read
        };
        let changed = readiness.change(connection.socket.as_fd(), Source::App(id), interest);
        if let Err(error) = changed {
            warn!("epoll: {error}");
        }
    }
}

impl AsFd for Apps {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.listener.as_fd()
    }
}

/// Says why; whether the app reads it is its own affair.
fn refuse(connection: &mut Connection, reason: String) {
    info!(
        pid = connection.pid,
        uid = connection.uid,
        "app refused: {reason}"
    );
    let told = connection
        .socket
        .send(&FromLayer::Refused { reason }, Vec::new());
    if let Err(failure) = told {
        debug!(?failure, "and it cannot be told");
    }
}
