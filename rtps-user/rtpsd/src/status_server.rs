//! Writes the status document to whoever connects to the status socket, without ever waiting for a slow reader.

use std::collections::BTreeMap;
use std::io::{self, Write};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::Path;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use tracing::debug;

use crate::apps::Access;
use crate::readiness::{Interest, Readiness, Source};
use crate::run_folder::remove_if_there;

/// Readers at the same time, and how long one may take.
const MAX_CLIENTS: usize = 16;
const CLIENT_TIME: Duration = Duration::from_secs(5);

struct Client {
    stream: UnixStream,
    document: Vec<u8>,
    written: usize,
    since: Instant,
}

/// The status socket and its readers.
pub(crate) struct StatusServer {
    listener: UnixListener,
    clients: BTreeMap<u32, Client>,
    next_id: u32,
}

impl StatusServer {
    /// Opens the socket.
    pub(crate) fn listen(path: &Path, access: &Access) -> Result<Self> {
        remove_if_there(path)?;
        let listener = UnixListener::bind(path)
            .with_context(|| format!("cannot make the socket {}", path.display()))?;
        listener.set_nonblocking(true)?;
        access.apply(path)?;
        Ok(Self {
            listener,
            clients: BTreeMap::new(),
            next_id: 0,
        })
    }

    /// Takes one reader, who gets `document`.
    pub(crate) fn accept(
        &mut self,
        now: Instant,
        document: impl FnOnce() -> Vec<u8>,
        readiness: &Readiness,
    ) -> Result<()> {
        let (stream, _) = match self.listener.accept() {
            Ok(accepted) => accepted,
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(()),
            Err(error) => return Err(error).context("cannot accept"),
        };
        if self.clients.len() >= MAX_CLIENTS {
            return Ok(());
        }
        stream.set_nonblocking(true)?;
        let id = self.next_id;
        self.next_id = self.next_id.wrapping_add(1);
        readiness.add(&stream, Source::StatusClient(id), Interest::Write)?;
        let client = Client {
            stream,
            document: document(),
            written: 0,
            since: now,
        };
        self.clients.insert(id, client);
        Ok(())
    }

    /// Writes on to a reader.
    pub(crate) fn handle(&mut self, id: u32) {
        let Some(client) = self.clients.get_mut(&id) else {
            return;
        };
        let rest = client.document.get(client.written..).unwrap_or_default();
        match client.stream.write(rest) {
            Ok(written) if written < rest.len() => client.written += written,
            Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
            Ok(_) => drop(self.clients.remove(&id)),
            Err(error) => {
                debug!("the status was not read: {error}");
                self.clients.remove(&id);
            }
        }
    }

    /// When [`handle_timeouts`](Self::handle_timeouts) is due.
    pub(crate) fn next_timeout(&self) -> Option<Instant> {
        let since = self.clients.values().map(|client| client.since);
        since.min().map(|since| since + CLIENT_TIME)
    }

    /// Gives up on readers that take too long.
    pub(crate) fn handle_timeouts(&mut self, now: Instant) {
        self.clients
            .retain(|_, client| client.since + CLIENT_TIME > now);
    }
}

impl AsFd for StatusServer {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.listener.as_fd()
    }
}
