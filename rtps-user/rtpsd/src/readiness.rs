//! What the event loop waits for: every source of events under a number of its own.

use std::os::fd::AsFd;

use nix::errno::Errno;
use nix::sys::epoll::{Epoll, EpollCreateFlags, EpollEvent, EpollFlags, EpollTimeout};

/// A source of events.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Source {
    /// SIGTERM or SIGINT.
    Signal,
    /// A changed address or interface.
    Addresses,
    /// An app wants to connect.
    AppListener,
    /// Somebody wants the status.
    StatusListener,
    /// A UDP socket of the domain in this position.
    Socket {
        /// The domain's position.
        domain: u16,
        /// The socket's position.
        socket: u16,
    },
    /// The kernel has something to tell of discovery.
    News,
    /// The inbox of an app is in place.
    Inboxes,
    /// The connection of this app.
    App(u32),
    /// The connection of somebody who wants the status.
    StatusClient(u32),
}

impl Source {
    fn encode(self) -> u64 {
        let (kind, value) = match self {
            Self::Signal => (0, 0),
            Self::Addresses => (1, 0),
            Self::AppListener => (2, 0),
            Self::StatusListener => (3, 0),
            Self::Socket { domain, socket } => (4, u32::from(domain) << 16 | u32::from(socket)),
            Self::App(id) => (5, id),
            Self::StatusClient(id) => (6, id),
            Self::News => (7, 0),
            Self::Inboxes => (8, 0),
        };
        kind << 32 | u64::from(value)
    }

    fn decode(data: u64) -> Option<Self> {
        let value = (data & u64::from(u32::MAX)) as u32;
        Some(match data >> 32 {
            0 => Self::Signal,
            1 => Self::Addresses,
            2 => Self::AppListener,
            3 => Self::StatusListener,
            4 => Self::Socket {
                domain: (value >> 16) as u16,
                socket: value as u16,
            },
            5 => Self::App(value),
            6 => Self::StatusClient(value),
            7 => Self::News,
            8 => Self::Inboxes,
            _ => return None,
        })
    }
}

/// What is waited for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Interest {
    /// Something to read.
    Read,
    /// Something to read, or room to write.
    ReadAndWrite,
    /// Room to write.
    Write,
}

impl Interest {
    fn flags(self) -> EpollFlags {
        match self {
            Self::Read => EpollFlags::EPOLLIN,
            Self::ReadAndWrite => EpollFlags::EPOLLIN | EpollFlags::EPOLLOUT,
            Self::Write => EpollFlags::EPOLLOUT,
        }
    }
}

/// The set of sources. A closed descriptor leaves it by itself.
pub(crate) struct Readiness {
    epoll: Epoll,
}

impl Readiness {
    pub(crate) fn new() -> Result<Self, Errno> {
        Ok(Self {
            epoll: Epoll::new(EpollCreateFlags::EPOLL_CLOEXEC)?,
        })
    }

    pub(crate) fn add(
        &self,
        descriptor: impl AsFd,
        source: Source,
        interest: Interest,
    ) -> Result<(), Errno> {
        let event = EpollEvent::new(interest.flags(), source.encode());
        self.epoll.add(descriptor, event)
    }

    pub(crate) fn change(
        &self,
        descriptor: impl AsFd,
        source: Source,
        interest: Interest,
    ) -> Result<(), Errno> {
        let mut event = EpollEvent::new(interest.flags(), source.encode());
        self.epoll.modify(descriptor, &mut event)
    }

    /// Waits, and says which sources have something.
    pub(crate) fn wait(&self, timeout: EpollTimeout) -> Result<Vec<Source>, Errno> {
        let mut events = [EpollEvent::empty(); 64];
        let count = match self.epoll.wait(&mut events, timeout) {
            Ok(count) => count,
            Err(Errno::EINTR) => 0,
            Err(error) => return Err(error),
        };
        let events = events.iter().take(count);
        Ok(events
            .filter_map(|event| Source::decode(event.data()))
            .collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sources_are_told_apart() {
        for source in [
            Source::Signal,
            Source::Addresses,
            Source::AppListener,
            Source::StatusListener,
            Source::Socket {
                domain: 15,
                socket: 3,
            },
            Source::News,
            Source::Inboxes,
            Source::App(u32::MAX),
            Source::StatusClient(7),
        ] {
            assert_eq!(Source::decode(source.encode()), Some(source));
        }
        assert_eq!(Source::decode(u64::MAX), None);
    }
}
