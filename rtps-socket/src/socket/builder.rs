//! The choices that a participant is opened with.

use std::marker::PhantomData;
use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Duration;

use super::RtpsSocket;
use crate::driver::Driver;
use crate::error::OpenError;
use crate::link::{LayerChoice, Settings};

/// The ring that an app asks the kernel layer for, in bytes: some 4,000 small messages, or 700 of the size of an Ethernet frame.
const RING_BYTES: u32 = 1 << 20;

/// Opens an [`RtpsSocket`] or a [`DomainParticipant`](crate::DomainParticipant).
#[derive(Clone, Debug)]
#[must_use = "nothing is opened before `open`"]
pub struct Builder<P> {
    settings: Settings,
    fragment_size: Option<u16>,
    user_data: Vec<u8>,
    opened: PhantomData<P>,
}

impl<P: From<RtpsSocket>> Builder<P> {
    pub(crate) fn new() -> Self {
        let program = std::env::current_exe().ok();
        let name = program.as_ref().and_then(|path| path.file_name());
        Self {
            settings: Settings {
                domain: 0,
                name: name.map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
                layer: LayerChoice::Automatic,
                ring_bytes: RING_BYTES,
                busy_poll: busy_poll_from_environment(),
                peers: Vec::new(),
                announce_period: None,
            },
            fragment_size: None,
            user_data: Vec::new(),
            opened: PhantomData,
        }
    }

    /// The DDS domain, 0 to 232; 0 unless set.
    pub fn domain(mut self, domain: u32) -> Self {
        self.settings.domain = domain;
        self
    }

    /// The app's name, for people who look at the domain; the program's unless set.
    pub fn name(mut self, name: impl Into<String>) -> Self {
        self.settings.name = name.into();
        self
    }

    /// Which layer to use.
    pub fn layer(mut self, layer: LayerChoice) -> Self {
        self.settings.layer = layer;
        self
    }

    /// How many bytes of messages may wait for the app in the kernel layer; 1 MiB unless set.
    pub fn ring_bytes(mut self, bytes: u32) -> Self {
        self.settings.ring_bytes = bytes;
        self
    }

    /// For how long a thread that waits for samples looks for them again and again before it sleeps: a look takes
    /// nanoseconds, to be woken takes microseconds, and on many machines tens of them, but nobody else has the CPU in the
    /// meantime. Unless set, what the environment variable `RTPS_BUSY_POLL_US` says in microseconds; without that, up to
    /// 100 us while samples come at shorter intervals and looking finds them.
    pub fn busy_poll(mut self, duration: Duration) -> Self {
        self.settings.busy_poll = Some(duration);
        self
    }

    /// Announces the in-process layer to this address too: a host that multicast does not reach.
    pub fn peer(mut self, address: SocketAddr) -> Self {
        self.settings.peers.push(address);
        self
    }

    /// The time between two announcements of the in-process layer, 5 s unless set. On the kernel layer rtpsd announces the
    /// host, for all of its apps.
    pub fn announce_period(mut self, period: Duration) -> Self {
        self.settings.announce_period = Some(period);
        self
    }

    /// The most bytes of a fragment of a sample that is too large for a datagram; what a datagram can carry unless set,
    /// and never more.
    pub fn fragment_size(mut self, bytes: u16) -> Self {
        self.fragment_size = Some(bytes);
        self
    }

    /// USER_DATA: up to 256 bytes that others see in the participant's announcement. On the kernel layer all apps of
    /// the host are one participant, and of those that have user data the last one to be opened is seen.
    pub fn user_data(mut self, data: impl Into<Vec<u8>>) -> Self {
        self.user_data = data.into();
        self
    }

    /// Joins the domain.
    ///
    /// # Errors
    /// When the chosen layer cannot be used, or the user data are too long; the error says what to do.
    pub fn open(self) -> Result<P, OpenError> {
        let driver = Arc::new(Driver::open(&self.settings)?);
        if let Some(size) = self.fragment_size {
            let shared = driver.shared();
            shared.with(|core, _| core.limit_fragments(size));
        }
        let socket = RtpsSocket { driver };
        if !self.user_data.is_empty() {
            socket.describe(self.user_data)?;
        }
        Ok(socket.into())
    }
}

/// The default of [`Builder::busy_poll`].
fn busy_poll_from_environment() -> Option<Duration> {
    const VARIABLE: &str = "RTPS_BUSY_POLL_US";
    let text = std::env::var(VARIABLE).ok()?;
    let micros = text.parse().ok();
    if micros.is_none() {
        tracing::warn!("{VARIABLE} is {text:?}, which is no number of microseconds: it is ignored");
    }
    micros.map(Duration::from_micros)
}
