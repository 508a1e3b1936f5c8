//! The kernel layer's link: an own ring that BPF programs fill, an own UDP socket that sends and is the doorbell,
//! another one to send over IPv6, and the Unix socket to rtpsd, which may come and go without a sample lost.

mod channels;
mod control;
mod doorbell;
mod fan_out;
mod outlet;
mod places;
mod record;

use std::io;
use std::net::{SocketAddr, UdpSocket};
use std::os::fd::{AsFd, OwnedFd};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Instant;

use rtps_user::layer::protocol::{
    FromLayer, Hello, LAYER_PROTOCOL_VERSION, Resume, ToLayer, Welcome,
};
use rtps_user::local;
use thiserror::Error;

use self::channels::Channels;
use self::control::{Control, ControlEvent};
use self::doorbell::Doorbell;
use self::fan_out::FanOut;
use self::outlet::Outlet;
use self::places::Places;
use super::{Arrivals, Burst, FIRST, Identity, LayerKind, Link, Settings, Sink, log_send_error};
use crate::link::sender::Sender;
use crate::sys::{Bell, Epoll, Interest, RingConsumer, Wakeups};

const CONTROL: u8 = FIRST;
const DOORBELL: u8 = FIRST + 1;
const RING: u8 = FIRST + 2;
/// All channels, which need not be told apart.
const CHANNEL: u8 = FIRST + 3;

/// Records that one call takes out of the ring: bounds how long timers wait in a flood.
const RECORDS_AT_ONCE: usize = 64;
/// Bytes after which it takes no more: a record may be a burst, whose samples need several times its room once they are
/// taken apart. They are better kept in the ring until the app has taken those before.
const BYTES_AT_ONCE: usize = 128 * 1024;

/// Why the kernel layer could not be used.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AttachError {
    /// No rtpsd.
    #[error("rtpsd does not listen on {}: {error} (`cargo xtask load` starts it)", path.display())]
    NotRunning {
        /// The socket's path; the variable `RTPS_LAYER_SOCKET` overrides it.
        path: PathBuf,
        /// What connecting said.
        error: io::Error,
    },
    /// There is an rtpsd, but it does not answer.
    #[error("rtpsd on {} does not answer: is it stopped?", .0.display())]
    NoAnswer(PathBuf),
    /// rtpsd says why.
    #[error("rtpsd refuses: {0}")]
    Refused(String),
    /// What came is no welcome.
    #[error(
        "rtpsd does not speak this version of the layer protocol: install the same version of both"
    )]
    Protocol,
    /// What rtpsd passed cannot be used, or sockets cannot be opened.
    #[error("the ring cannot be set up: {0}")]
    System(#[from] io::Error),
}

/// A slot of the host's low-level layer.
#[derive(Debug)]
pub(crate) struct KernelLink {
    identity: Identity,
    ring: RingConsumer,
    bell: Bell,
    doorbell: Doorbell,
    sender: Sender,
    /// To IPv6 destinations.
    outlet: Outlet,
    /// To several IPv4 destinations at once.
    fan_out: FanOut,
    /// To and from other apps of this host.
    channels: Channels,
    places: Arc<Places>,
    control: Control,
    epoll: Arc<Epoll>,
    is_lost: bool,
}

impl KernelLink {
    /// Takes a slot of the layer.
    pub(super) fn attach(settings: &Settings, epoll: &Arc<Epoll>) -> Result<Self, AttachError> {
        let socket = UdpSocket::bind("0.0.0.0:0")?;
        let hello = Hello {
            version: LAYER_PROTOCOL_VERSION,
            domain: settings.domain,
            name: settings.name.clone(),
            doorbell_port: socket.local_addr()?.port(),
            ring_bytes: settings.ring_bytes,
            resume: None,
        };
        let (mut control, welcome, fds) = Control::connect(control::socket_path()?, hello, epoll)?;
        let (ring, bell) = map(fds)?;
        epoll.add(ring.as_fd(), RING, Interest::Level)?;
        epoll.add(socket.as_fd(), DOORBELL, Interest::Edge)?;
        control.set_resume(Resume {
            slot: welcome.slot,
            token: welcome.token,
        });
        let places = Places {
            ring: Arc::clone(ring.ring()),
            inlets: Vec::new(),
        };
        Ok(Self {
            identity: identity(&welcome),
            places: Arc::new(places),
            ring,
            bell,
            doorbell: Doorbell::new(socket),
            sender: Sender::default(),
            outlet: Outlet::default(),
            fan_out: FanOut::default(),
            channels: Channels::new(epoll),
            control,
            epoll: Arc::clone(epoll),
            is_lost: false,
        })
    }

    /// The layer's process was restarted and knows the app again.
    fn resume(&mut self, fds: Vec<OwnedFd>) -> Result<(), AttachError> {
        // An app that comes back still has its ring: nothing is passed.
        if !fds.is_empty() {
            let (ring, bell) = map(fds)?;
            self.epoll.add(ring.as_fd(), RING, Interest::Level)?;
            (self.ring, self.bell) = (ring, bell);
            self.note_places();
        }
        Ok(())
    }

    fn note_places(&mut self) {
        self.places = Arc::new(Places {
            ring: Arc::clone(self.ring.ring()),
            inlets: self.channels.inlets(),
        });
    }

    fn handle_control(&mut self, now: Instant, event: ControlEvent) {
        match event {
            ControlEvent::Welcome(welcome, _) if !is_same(&self.identity, &welcome) => {
                tracing::error!(
                    "the layer was set up anew while this app was not connected, and its endpoints \
                     are gone: open the participant again"
                );
                // Each further attempt would take another slot, and what the app sends under its old name may be
                // taken for another app's.
                self.is_lost = true;
                self.control.close();
            }
            ControlEvent::Welcome(_, fds) => match self.resume(fds) {
                Ok(()) => {
                    self.fan_out.reconnected();
                    self.control.attached(now);
                }
                Err(error) => self.control.give_up(now, &error.to_string()),
            },
            ControlEvent::Channel(slot, fds) => {
                if let Err(error) = self.channels.open(slot, fds) {
                    tracing::error!(slot, %error, "another app of this host cannot be reached");
                }
                self.note_places();
            }
            ControlEvent::ChannelClosed(slot) => {
                self.channels.close(slot);
                self.note_places();
            }
            ControlEvent::Lost(why) => {
                tracing::warn!(
                    "rtpsd is gone ({why}): data keep flowing, matching waits for its return"
                );
            }
        }
    }
}

impl Link for KernelLink {
    fn kind(&self) -> LayerKind {
        LayerKind::Kernel
    }

    fn identity(&self) -> Identity {
        self.identity
    }

    fn request(&mut self, now: Instant, request: ToLayer) {
        self.control.request(now, request);
    }

    fn poll_message(&mut self) -> Option<FromLayer> {
        loop {
            match self.control.poll_message()? {
                FromLayer::FanOut {
                    number,
                    destinations,
                } => self.fan_out.answered(number, &destinations),
                message => return Some(message),
            }
        }
    }

    fn send(&mut self, now: Instant, burst: &Burst<'_>) {
        if self.is_lost {
            return;
        }
        for destination in self.fan_out.send(burst) {
            if let Some(slot) = local::slot(*destination) {
                if !self.channels.send(slot, burst) {
                    tracing::debug!(slot, "the channel to another app is full");
                }
                continue;
            }
            let sent = match destination {
                SocketAddr::V4(_) => {
                    self.sender
                        .send(now, self.doorbell.socket(), *destination, burst)
                }
                SocketAddr::V6(_) => self.outlet.send(now, burst, *destination),
            };
            if let Err(error) = sent {
                log_send_error(*destination, burst.bytes.len(), &error);
            }
        }
    }

    fn receive(&mut self, now: Instant, wakeups: Wakeups, sink: &mut Sink<'_>) {
        let (mut records, mut bytes) = (0, 0);
        while records < RECORDS_AT_ONCE && bytes < BYTES_AT_ONCE {
            let taken = self.ring.drain(1, |record| {
                bytes += record.len();
                take_record(record, sink);
            });
            if taken == 0 {
                break;
            }
            records += taken;
        }
        let has_rung = wakeups.contains(DOORBELL);
        self.doorbell.took(records, bytes, has_rung);
        self.channels.receive(sink);
        while let Some(request) = self.fan_out.poll_request() {
            self.control.request(now, request);
        }
        if wakeups.contains(CONTROL) {
            while let Some(event) = self.control.receive(now) {
                self.handle_control(now, event);
            }
        }
    }

    fn arrivals(&self) -> Option<Arc<dyn Arrivals>> {
        Some(Arc::clone(&self.places) as Arc<dyn Arrivals>)
    }

    fn likely(&self) -> Wakeups {
        Wakeups::default()
    }

    fn prepare_sleep(&mut self) -> bool {
        self.bell.arm();
        self.doorbell.armed();
        let quiet = self.channels.arm() && !self.ring.ring().has_record();
        if !quiet {
            self.awake();
        }
        quiet
    }

    fn awake(&mut self) {
        self.bell.disarm();
        self.channels.disarm();
    }

    fn has_news(&self, now: Instant) -> bool {
        self.is_lost || self.control.has_news(now)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.control.poll_timeout()
    }

    fn handle_timeout(&mut self, now: Instant) {
        self.control.handle_timeout(now);
    }

    fn is_lost(&self) -> bool {
        self.is_lost
    }

    /// Closing the socket says it all: rtpsd withdraws the endpoints of whoever is gone.
    fn shutdown(&mut self, _now: Instant) {}
}

fn take_record(record: &[u8], sink: &mut Sink<'_>) {
    match record::parse(record) {
        // Those addresses are for what comes out of channels.
        Some((source, _)) if local::is_local(source.ip()) => {}
        Some((source, messages)) => messages.for_each(|message| sink(source, message)),
        None => tracing::warn!(len = record.len(), "a record of the ring is malformed"),
    }
}

/// Whether the layer knows the app by the name that its endpoints have.
fn is_same(identity: &Identity, welcome: &Welcome) -> bool {
    (identity.slot, identity.prefix) == (welcome.slot, welcome.prefix)
}

fn identity(welcome: &Welcome) -> Identity {
    Identity {
        slot: welcome.slot,
        prefix: welcome.prefix,
        datagram_size: welcome.datagram_size,
    }
}

/// Maps ring and bell, which come in this order.
fn map(fds: Vec<OwnedFd>) -> Result<(RingConsumer, Bell), AttachError> {
    let [ring, bell] = <[OwnedFd; 2]>::try_from(fds).map_err(|_| AttachError::Protocol)?;
    Ok((RingConsumer::map(ring)?, Bell::map(bell.as_fd())?))
}
