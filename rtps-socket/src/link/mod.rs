//! What an app's endpoints are connected by: datagrams out, datagrams in, and the layer protocol beside them.
//!
//! The [`kernel`] link uses the host's low-level layer: datagrams come out of a ring that BPF programs fill, and
//! rtpsd does the discovery. The [`in_process`] link needs nobody: plain UDP sockets, and the layer's discovery runs
//! in the app. The driver polls either in the same way.

mod direct;
pub(crate) mod in_process;
pub(crate) mod kernel;
mod open;
pub(crate) mod sender;

use std::net::SocketAddr;
use std::sync::Arc;
use std::time::Instant;

use rtps_user::layer::protocol::{FromLayer, ToLayer};
use rtps_user::wire::GuidPrefix;

pub use open::OpenError;
pub(crate) use open::{Settings, open};

use crate::sys::Wakeups;

/// Which layer an app uses.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum LayerChoice {
    /// What the environment variable `RTPS_LAYER` says (`kernel` or `in-process`); else the kernel layer where
    /// rtpsd answers, else the in-process layer.
    #[default]
    Automatic,
    /// The kernel layer: an error where rtpsd does not answer.
    Kernel,
    /// The in-process layer.
    InProcess,
}

/// The layer that an app got.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum LayerKind {
    /// The host's low-level layer in the kernel.
    Kernel,
    /// Plain UDP sockets.
    InProcess,
}

/// Who the app is within its participant.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) struct Identity {
    /// The first byte of the keys of its entities.
    pub(crate) slot: u8,
    /// The prefix of their GUIDs.
    pub(crate) prefix: GuidPrefix,
    /// The most bytes of a datagram.
    pub(crate) datagram_size: u16,
}

/// Datagrams that leave together: for the same destinations, and all of `segment` bytes but the last, which may be
/// shorter. The form that UDP segmentation offload takes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Burst<'a> {
    /// Where they go, each once.
    pub(crate) destinations: &'a [SocketAddr],
    /// One after the other, up to [`MAX_DATAGRAMS`](Self::MAX_DATAGRAMS) of them.
    pub(crate) bytes: &'a [u8],
    /// Bytes of a datagram; not 0.
    pub(crate) segment: usize,
    /// The DSCP that they are marked with, for networks that tell traffic by it.
    pub(crate) dscp: u8,
}

impl<'a> Burst<'a> {
    /// What every kernel with UDP segmentation offload takes (UDP_MAX_SEGMENTS).
    pub(crate) const MAX_DATAGRAMS: usize = 64;
    /// The bytes of one IPv4 packet without its headers.
    pub(crate) const MAX_BYTES: usize = 65_507;

    /// Each datagram.
    pub(crate) fn datagrams(&self) -> impl Iterator<Item = &'a [u8]> {
        self.bytes.chunks(self.segment)
    }
}

/// Takes a datagram that came from an address.
pub(crate) type Sink<'a> = dyn FnMut(SocketAddr, &[u8]) + 'a;

/// The number in the epoll set of the driver's own interrupt; links use the numbers above.
pub(crate) const INTERRUPT: u8 = 0;
/// The number of the timer that callers who drive by themselves need.
pub(crate) const TIMER: u8 = 1;
/// The first number that a link may use for its descriptors.
const FIRST: u8 = 2;

/// A connection of an app to a layer. Its descriptors are in the driver's epoll set.
pub(crate) trait Link: Send {
    /// Which layer it is.
    fn kind(&self) -> LayerKind;

    /// Who the app is.
    fn identity(&self) -> Identity;

    /// Says something to the layer. What cannot be said now is said later.
    fn request(&mut self, now: Instant, request: ToLayer);

    /// What the layer says next.
    fn poll_message(&mut self) -> Option<FromLayer>;

    /// Sends datagrams from the app's own socket. What cannot be sent counts as lost on the way.
    fn send(&mut self, now: Instant, burst: &Burst<'_>);

    /// Takes what has arrived, a bounded number of datagrams: all that costs no system call, and what `wakeups`
    /// names.
    fn receive(&mut self, now: Instant, wakeups: Wakeups, sink: &mut Sink<'_>);

    /// What to look at without a system call, and without the link, to see whether something has arrived; `None` where
    /// everything comes through descriptors.
    fn arrivals(&self) -> Option<Arc<dyn Arrivals>>;

    /// Where everything comes through descriptors, those through which samples have come of late.
    fn likely(&self) -> Wakeups;

    /// About to wait for the descriptors: asks to be woken. False when something has arrived already.
    fn prepare_sleep(&mut self) -> bool;

    /// The wait is over.
    fn awake(&mut self);

    /// Whether there is a message, or something due at `now`, or the layer is gone: asked far more often than it is so.
    fn has_news(&self, now: Instant) -> bool;

    /// When [`handle_timeout`](Self::handle_timeout) is due.
    fn poll_timeout(&self) -> Option<Instant>;

    /// Does what is due.
    fn handle_timeout(&mut self, now: Instant);

    /// Whether the layer has gone for good: it was set up anew and gave the app's identity away. Nothing is sent then.
    fn is_lost(&self) -> bool;

    /// Leaves the domain in good order.
    fn shutdown(&mut self, now: Instant);
}

/// Where what comes in can be seen by any thread.
pub(crate) trait Arrivals: Send + Sync {
    /// Whether [`Link::receive`] would find something.
    fn has_arrived(&self) -> bool;
}

/// A packet of the layer protocol.
pub(crate) fn encode(request: &ToLayer) -> Vec<u8> {
    postcard::to_stdvec(request).expect("requests have no maps or numbers that postcard refuses")
}

/// Logs a datagram that could not be sent; the protocol repeats what matters.
fn log_send_error(destination: SocketAddr, len: usize, error: &std::io::Error) {
    tracing::debug!(%destination, len, %error, "datagram not sent");
}
