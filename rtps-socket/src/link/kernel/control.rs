//! The Unix socket to rtpsd: greeting, declarations, and coming back after rtpsd was gone.

use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::os::fd::{AsFd, OwnedFd};
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

use rtps_user::layer::protocol::{
    Endpoint, FromLayer, Hello, MAX_PROTOCOL_MESSAGE, Resume, ToLayer, Welcome,
};
use rtps_user::wire::EntityId;

use super::{AttachError, CONTROL};
use crate::link::encode;
use crate::sys::seqpacket::SeqPacket;
use crate::sys::{Epoll, Interest, wait_readable};

/// Names another socket than the one of this network namespace.
const PATH_VARIABLE: &str = "RTPS_LAYER_SOCKET";
/// How long a program that starts waits for the answer to its hello. rtpsd gives a ring to an app with a call that
/// waits for every CPU (RCU), on a busy machine for seconds.
const WELCOME_TIMEOUT: Duration = Duration::from_secs(10);
/// The first pause before trying to connect again; it doubles.
const RETRY_FIRST: Duration = Duration::from_millis(20);
const RETRY_MAX: Duration = Duration::from_millis(500);
/// The pause before sending again to an rtpsd that does not read.
const RESEND: Duration = Duration::from_millis(20);
/// Packets taken by one call.
const PACKETS_AT_ONCE: usize = 64;

/// Where rtpsd of this thread's network namespace listens.
pub(super) fn socket_path() -> io::Result<PathBuf> {
    if let Some(path) = std::env::var_os(PATH_VARIABLE) {
        return Ok(path.into());
    }
    let inode = std::fs::metadata("/proc/thread-self/ns/net")?.ino();
    Ok(format!("/run/rtps/{inode}/layer.sock").into())
}

/// What the link has to act on; all else is for the endpoints.
#[derive(Debug)]
pub(super) enum ControlEvent {
    /// rtpsd is back.
    Welcome(Box<Welcome>, Vec<OwnedFd>),
    /// There is a channel with the app in this slot.
    Channel(u8, Vec<OwnedFd>),
    /// The channel is over.
    ChannelClosed(u8),
    /// rtpsd is gone.
    Lost(String),
}

#[derive(Debug)]
enum State {
    Attached(SeqPacket),
    /// The hello was sent.
    Greeting(SeqPacket),
    /// To be tried again.
    Away,
}

/// The connection, and what has to be said again after it broke.
#[derive(Debug)]
pub(super) struct Control {
    path: PathBuf,
    hello: Hello,
    epoll: Arc<Epoll>,
    state: State,
    retry: Duration,
    due: Option<Instant>,
    declared: BTreeMap<EntityId, Endpoint>,
    /// USER_DATA of the participant.
    described: Vec<u8>,
    /// Whether the app wants to know of all participants and endpoints.
    browses: bool,
    outbox: VecDeque<Vec<u8>>,
    inbox: VecDeque<FromLayer>,
    buffer: Vec<u8>,
}

impl Control {
    /// Connects and waits for the welcome.
    pub(super) fn connect(
        path: PathBuf,
        hello: Hello,
        epoll: &Arc<Epoll>,
    ) -> Result<(Self, Welcome, Vec<OwnedFd>), AttachError> {
        let not_running = |error| AttachError::NotRunning {
            path: path.clone(),
            error,
        };
        let socket = SeqPacket::connect(&path).map_err(not_running)?;
        socket
            .send(&encode(&ToLayer::Hello(hello.clone())))
            .map_err(not_running)?;
        let [answered] = wait_readable([socket.as_fd()], Some(WELCOME_TIMEOUT))?;
        if !answered {
            return Err(AttachError::NoAnswer(path));
        }
        let mut buffer = vec![0; MAX_PROTOCOL_MESSAGE];
        let packet = socket.receive(&mut buffer)?;
        let welcome = match postcard::from_bytes(buffer.get(..packet.len).unwrap_or_default()) {
            Ok(FromLayer::Welcome(welcome)) => welcome,
            Ok(FromLayer::Refused { reason }) => return Err(AttachError::Refused(reason)),
            Ok(_) | Err(_) => return Err(AttachError::Protocol),
        };
        epoll.add(socket.as_fd(), CONTROL, Interest::Level)?;
        let control = Self {
            path,
            hello,
            epoll: Arc::clone(epoll),
            state: State::Attached(socket),
            retry: RETRY_FIRST,
            due: None,
            declared: BTreeMap::new(),
            described: Vec::new(),
            browses: false,
            outbox: VecDeque::new(),
            inbox: VecDeque::new(),
            buffer,
        };
        Ok((control, welcome, packet.fds))
    }

    /// What to show when coming back.
    pub(super) fn set_resume(&mut self, resume: Resume) {
        self.hello.resume = Some(resume);
    }

    /// Says something, now or when rtpsd is there again.
    pub(super) fn request(&mut self, now: Instant, request: ToLayer) {
        match &request {
            ToLayer::Declare(endpoint) => {
                self.declared
                    .insert(endpoint.entity, Endpoint::clone(endpoint));
            }
            ToLayer::Withdraw(entity) => {
                self.declared.remove(entity);
            }
            ToLayer::Describe(user_data) => self.described.clone_from(user_data),
            ToLayer::Browse { .. } => self.browses = true,
            ToLayer::Hello(_) | ToLayer::AssertLiveliness | ToLayer::FanOut(_) => {}
        }
        // Without a connection there is nothing to queue: coming back declares everything anew.
        if let State::Attached(_) = self.state {
            self.outbox.push_back(encode(&request));
            self.flush(now);
        }
    }

    /// What rtpsd says next to the app's endpoints.
    pub(super) fn poll_message(&mut self) -> Option<FromLayer> {
        self.inbox.pop_front()
    }

    /// Whether rtpsd has said something, or something is due at `now`.
    pub(super) fn has_news(&self, now: Instant) -> bool {
        !self.inbox.is_empty() || self.due.is_some_and(|due| due <= now)
    }

    /// Takes what has arrived.
    pub(super) fn receive(&mut self, now: Instant) -> Option<ControlEvent> {
        for _ in 0..PACKETS_AT_ONCE {
            let (State::Attached(socket) | State::Greeting(socket)) = &self.state else {
                return None;
            };
            let packet = match socket.receive(&mut self.buffer) {
                Ok(packet) => packet,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return None,
                // The packets after it are whole again.
                Err(error) if error.kind() == io::ErrorKind::InvalidData => {
                    tracing::error!(%error, "a packet of rtpsd is left out");
                    continue;
                }
                Err(error) => return self.lost(now, &error.to_string()),
            };
            if packet.len == 0 {
                return self.lost(now, "it closed the connection");
            }
            match postcard::from_bytes(self.buffer.get(..packet.len).unwrap_or_default()) {
                Ok(FromLayer::Welcome(welcome)) => {
                    return Some(ControlEvent::Welcome(Box::new(welcome), packet.fds));
                }
                Ok(FromLayer::Channel { slot }) => {
                    return Some(ControlEvent::Channel(slot, packet.fds));
                }
                Ok(FromLayer::ChannelClosed { slot }) => {
                    return Some(ControlEvent::ChannelClosed(slot));
                }
                Ok(message) => self.take(now, message),
                Err(_) => return self.lost(now, "it sent what is not of the layer protocol"),
            }
        }
        None
    }

    fn take(&mut self, now: Instant, message: FromLayer) {
        match (&self.state, message) {
            (State::Greeting(_), FromLayer::Refused { reason }) => self.give_up(now, &reason),
            (_, message) => self.inbox.push_back(message),
        }
    }

    /// The welcome was good: everything is declared again, which changes nothing where it is known.
    pub(super) fn attached(&mut self, now: Instant) {
        tracing::info!("rtpsd is back");
        self.state = match std::mem::replace(&mut self.state, State::Away) {
            State::Greeting(socket) | State::Attached(socket) => State::Attached(socket),
            State::Away => State::Away,
        };
        self.retry = RETRY_FIRST;
        let declared = self.declared.values().cloned();
        let declarations = declared.map(|endpoint| ToLayer::Declare(Box::new(endpoint)));
        let user_data = Some(self.described.clone()).filter(|user_data| !user_data.is_empty());
        let browse = self.browses.then_some(ToLayer::Browse { after: None });
        self.outbox = user_data
            .map(ToLayer::Describe)
            .into_iter()
            .chain(declarations)
            .chain(browse)
            .map(|request| encode(&request))
            .collect();
        self.flush(now);
    }

    /// rtpsd does not take the app back; it is asked again, more and more rarely.
    pub(super) fn give_up(&mut self, now: Instant, reason: &str) {
        tracing::error!("rtpsd does not take this app back: {reason}");
        self.retry = RETRY_MAX;
        self.away(now);
    }

    /// Leaves rtpsd and does not ask it again.
    pub(super) fn close(&mut self) {
        self.state = State::Away;
        self.outbox.clear();
        self.due = None;
    }

    /// When [`handle_timeout`](Self::handle_timeout) is due.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.due
    }

    /// Connects again, or sends what could not be sent.
    pub(super) fn handle_timeout(&mut self, now: Instant) {
        if self.due.is_none_or(|due| due > now) {
            return;
        }
        self.due = None;
        match self.state {
            State::Attached(_) => self.flush(now),
            // No answer in time; the next attempt has a new connection.
            State::Greeting(_) => self.away(now),
            State::Away => match self.greet() {
                Ok(socket) => {
                    self.state = State::Greeting(socket);
                    self.due = Some(now + WELCOME_TIMEOUT);
                }
                Err(error) => {
                    tracing::debug!(%error, "rtpsd is still away");
                    self.away(now);
                }
            },
        }
    }

    fn greet(&self) -> io::Result<SeqPacket> {
        let socket = SeqPacket::connect(&self.path)?;
        socket.send(&encode(&ToLayer::Hello(self.hello.clone())))?;
        self.epoll.add(socket.as_fd(), CONTROL, Interest::Level)?;
        Ok(socket)
    }

    fn lost(&mut self, now: Instant, why: &str) -> Option<ControlEvent> {
        let was_attached = matches!(self.state, State::Attached(_));
        self.away(now);
        was_attached.then(|| ControlEvent::Lost(why.to_owned()))
    }

    fn away(&mut self, now: Instant) {
        self.state = State::Away;
        self.outbox.clear();
        self.due = Some(now + self.retry);
        self.retry = (self.retry * 2).min(RETRY_MAX);
    }

    fn flush(&mut self, now: Instant) {
        let State::Attached(socket) = &self.state else {
            return;
        };
        while let Some(packet) = self.outbox.front() {
            match socket.send(packet) {
                Ok(()) => drop(self.outbox.pop_front()),
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {
                    self.due = Some(now + RESEND);
                    return;
                }
                // It will never be sent, and must not keep the others from it.
                Err(error) if error.raw_os_error() == Some(libc::EMSGSIZE) => {
                    let reason = format!("{} bytes are too many for one packet", packet.len());
                    self.inbox.push_back(FromLayer::Refused { reason });
                    self.outbox.pop_front();
                }
                // The end of the connection will be read, too.
                Err(error) => {
                    tracing::debug!(%error, "rtpsd cannot be told");
                    return;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
