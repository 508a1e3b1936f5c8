//! The one thread of rtpsd: waits for whatever comes first, and hands it to whom it concerns.

use std::os::fd::OwnedFd;
use std::time::Instant;

use anyhow::{Context, Result};
use nix::sys::epoll::EpollTimeout;
use nix::sys::signal::{SigSet, Signal};
use nix::sys::signalfd::{SfdFlags, SignalFd};
use rtps_net::AddressWatch;
use tracing::{info, warn};

use crate::apps::Apps;
use crate::attachment::Attachment;
use crate::host::Host;
use crate::readiness::{Interest, Readiness, Source};
use crate::status::{self, Running};
use crate::status_server::StatusServer;

/// Room for the largest UDP datagram.
const DATAGRAM: usize = 65_536;

/// Everything that events are handed to.
pub(crate) struct EventLoop {
    inode: u64,
    host: Host,
    apps: Apps,
    status: StatusServer,
    attachment: Attachment,
    watch: AddressWatch,
    signals: SignalFd,
    readiness: Readiness,
    datagram: Vec<u8>,
    /// How often the thread was woken.
    wakeups: u64,
}

impl EventLoop {
    /// Registers every source.
    pub(crate) fn new(
        inode: u64,
        host: Host,
        apps: Apps,
        status: StatusServer,
        attachment: Attachment,
        signals: SignalFd,
    ) -> Result<Self> {
        let watch = AddressWatch::new().context("cannot watch the interfaces' addresses")?;
        let readiness = Readiness::new().context("epoll")?;
        readiness.add(&signals, Source::Signal, Interest::Read)?;
        readiness.add(&watch, Source::Addresses, Interest::Read)?;
        readiness.add(&apps, Source::AppListener, Interest::Read)?;
        readiness.add(&status, Source::StatusListener, Interest::Read)?;
        readiness.add(&host.news, Source::News, Interest::Read)?;
        readiness.add(&host.inboxes, Source::Inboxes, Interest::Read)?;
        for (domain, served) in (0..).zip(&host.domains) {
            for (socket, descriptor) in (0..).zip(served.sockets.all()) {
                let source = Source::Socket { domain, socket };
                readiness.add(descriptor, source, Interest::Read)?;
            }
        }
        Ok(Self {
            inode,
            host,
            apps,
            status,
            attachment,
            watch,
            signals,
            readiness,
            datagram: vec![0; DATAGRAM],
            wakeups: 0,
        })
    }

    /// Runs until a signal ends it; then the host has left its domains.
    pub(crate) fn run(mut self) -> Result<()> {
        loop {
            let now = Instant::now();
            self.handle_timeouts(now);
            let sources = self.readiness.wait(self.timeout(now)).context("epoll")?;
            self.wakeups += 1;
            let now = Instant::now();
            for source in sources {
                if source == Source::Signal && self.signalled() {
                    self.host.shutdown(now);
                    return Ok(());
                }
                self.handle(now, source);
            }
        }
    }

    fn signalled(&mut self) -> bool {
        match self.signals.read_signal() {
            Ok(Some(signal)) => {
                info!(signal = signal.ssi_signo, "leaving");
                true
            }
            Ok(None) => false,
            Err(error) => {
                warn!("signalfd: {error}");
                false
            }
        }
    }

    fn handle(&mut self, now: Instant, source: Source) {
        match source {
            Source::Signal => {}
            Source::Addresses => {
                self.watch.drain();
                self.host.refresh_interfaces(now, &mut self.attachment);
            }
            Source::News => self.host.read_news(now),
            Source::Inboxes => self.apps.welcome_all(now, &mut self.host, &self.readiness),
            Source::AppListener => self.apps.accept(now, &self.readiness),
            Source::StatusListener => self.accept_status(now),
            Source::Socket { domain, socket } => {
                let (domain, socket) = (domain.into(), socket.into());
                self.host.receive(now, domain, socket, &mut self.datagram);
            }
            Source::App(id) => self.apps.handle(now, id, &mut self.host, &self.readiness),
            Source::StatusClient(id) => self.status.handle(id),
        }
        self.apps.deliver(now, &mut self.host, &self.readiness);
    }

    fn accept_status(&mut self, now: Instant) {
        let document = || {
            let running = Running {
                host: &self.host,
                apps: &self.apps,
                attachment: &self.attachment,
                wakeups: self.wakeups,
            };
            let status = status::status_of_daemon(self.inode, &running);
            match status.and_then(|status| Ok(serde_json::to_vec(&status)?)) {
                Ok(document) => document,
                Err(error) => {
                    warn!("no status: {error:#}");
                    Vec::new()
                }
            }
        };
        if let Err(error) = self.status.accept(now, document, &self.readiness) {
            warn!("{error:#}");
        }
    }

    /// Rounded up to the milliseconds that epoll counts in, so that what is due then is really due.
    fn timeout(&self, now: Instant) -> EpollTimeout {
        let due = [
            self.host.next_timeout(),
            self.apps.next_timeout(),
            self.status.next_timeout(),
        ];
        let Some(due) = due.into_iter().flatten().min() else {
            return EpollTimeout::NONE;
        };
        let milliseconds = due
            .saturating_duration_since(now)
            .as_micros()
            .div_ceil(1000);
        u32::try_from(milliseconds)
            .ok()
            .and_then(|milliseconds| EpollTimeout::try_from(milliseconds).ok())
            .unwrap_or(EpollTimeout::MAX)
    }

    fn handle_timeouts(&mut self, now: Instant) {
        self.host.handle_timeouts(now);
        self.apps.handle_timeouts(now, &mut self.host);
        self.status.handle_timeouts(now);
        self.apps.deliver(now, &mut self.host, &self.readiness);
    }
}

/// Turns SIGTERM and SIGINT into something to read.
pub(crate) fn catch_signals() -> Result<SignalFd> {
    let mut signals = SigSet::empty();
    signals.add(Signal::SIGTERM);
    signals.add(Signal::SIGINT);
    signals.thread_block().context("cannot block signals")?;
    SignalFd::with_flags(&signals, SfdFlags::SFD_CLOEXEC | SfdFlags::SFD_NONBLOCK)
        .context("signalfd")
}

/// Tells who started rtpsd that apps can connect.
pub(crate) fn announce_ready(descriptor: OwnedFd) {
    use std::io::Write;
    if let Err(error) = std::fs::File::from(descriptor).write_all(b"ready\n") {
        warn!("nobody waits until rtpsd is ready: {error}");
    }
}
