//! Waiting for several descriptors, with timeouts in nanoseconds.

use std::io;
use std::os::fd::{AsFd, AsRawFd, BorrowedFd, FromRawFd, OwnedFd};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use super::check;

/// How a descriptor reports that it is readable.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum Interest {
    /// As long as it is readable.
    Level,
    /// Whenever something arrives; nobody has to read it.
    Edge,
}

/// An epoll instance; each descriptor in it has a number of the caller's choice below 32.
#[derive(Debug)]
pub(crate) struct Epoll {
    fd: OwnedFd,
    /// `epoll_pwait2` came with Linux 5.11.
    has_pwait2: AtomicBool,
}

/// The numbers of the descriptors that are readable.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub(crate) struct Wakeups(u32);

impl Wakeups {
    /// This one alone.
    pub(crate) fn of(number: u8) -> Self {
        Self(1 << number)
    }

    /// Whether none is.
    pub(crate) fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// Whether this one is readable, or its other side hung up.
    pub(crate) fn contains(self, number: u8) -> bool {
        self.0 & (1 << number) != 0
    }
}

/// No more are in use; more would only need another call.
const MAX_EVENTS: usize = 10;

impl Epoll {
    /// An instance without descriptors.
    pub(crate) fn new() -> io::Result<Self> {
        // SAFETY: no preconditions.
        let fd = check(unsafe { libc::epoll_create1(libc::EPOLL_CLOEXEC) })?;
        Ok(Self {
            // SAFETY: a new descriptor that nobody else owns.
            fd: unsafe { OwnedFd::from_raw_fd(fd) },
            has_pwait2: AtomicBool::new(true),
        })
    }

    /// Watches `fd` as `number`; a descriptor leaves by being closed.
    pub(crate) fn add(&self, fd: BorrowedFd<'_>, number: u8, interest: Interest) -> io::Result<()> {
        let edge = match interest {
            Interest::Level => 0,
            Interest::Edge => libc::EPOLLET as u32,
        };
        let mut event = libc::epoll_event {
            events: libc::EPOLLIN as u32 | edge,
            u64: u64::from(number),
        };
        let (epoll, fd) = (self.fd.as_raw_fd(), fd.as_raw_fd());
        // SAFETY: both descriptors are open, the event is initialized.
        check(unsafe { libc::epoll_ctl(epoll, libc::EPOLL_CTL_ADD, fd, &mut event) })?;
        Ok(())
    }

    /// Waits until something is readable or `timeout` is over; `None` waits for ever. A signal ends the wait too.
    pub(crate) fn wait(&self, timeout: Option<Duration>) -> io::Result<Wakeups> {
        let mut events = [libc::epoll_event { events: 0, u64: 0 }; MAX_EVENTS];
        let count = match self.wait_for_events(&mut events, timeout) {
            Ok(count) => count,
            Err(error) if error.kind() == io::ErrorKind::Interrupted => 0,
            Err(error) => return Err(error),
        };
        let numbers = events.iter().take(count).map(|event| event.u64);
        Ok(Wakeups(numbers.fold(0, |set, number| set | 1 << number)))
    }

    fn wait_for_events(
        &self,
        events: &mut [libc::epoll_event; MAX_EVENTS],
        timeout: Option<Duration>,
    ) -> io::Result<usize> {
        let fd = self.fd.as_raw_fd();
        let len = MAX_EVENTS as libc::c_int;
        if self.has_pwait2.load(Ordering::Relaxed) {
            let timeout = timeout.map(to_timespec);
            let timeout = timeout.as_ref().map_or(std::ptr::null(), |timeout| timeout);
            let no_mask = std::ptr::null::<libc::sigset_t>();
            // SAFETY: room for `len` events; the timeout is null or lives beyond the call; no signal mask.
            let count = unsafe {
                libc::syscall(
                    libc::SYS_epoll_pwait2,
                    fd,
                    events.as_mut_ptr(),
                    len,
                    timeout,
                    no_mask,
                    0,
                )
            };
            match check(count as libc::c_int) {
                Err(error) if error.raw_os_error() == Some(libc::ENOSYS) => {
                    self.has_pwait2.store(false, Ordering::Relaxed);
                }
                result => return result.map(|count| count as usize),
            }
        }
        // SAFETY: room for `len` events.
        let count = unsafe { libc::epoll_wait(fd, events.as_mut_ptr(), len, to_millis(timeout)) };
        check(count).map(|count| count as usize)
    }
}

impl AsFd for Epoll {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }
}

/// Waits until one of `fds` is readable or `timeout` is over; `None` waits for ever. Tells which are.
pub(crate) fn wait_readable<const N: usize>(
    fds: [BorrowedFd<'_>; N],
    timeout: Option<Duration>,
) -> io::Result<[bool; N]> {
    let mut polled = fds.map(|fd| libc::pollfd {
        fd: fd.as_raw_fd(),
        events: libc::POLLIN,
        revents: 0,
    });
    let timeout = timeout.map(to_timespec);
    let timeout = timeout.as_ref().map_or(std::ptr::null(), |timeout| timeout);
    // SAFETY: `N` entries with open descriptors; the timeout is null or lives beyond the call; no signal mask.
    match check(unsafe {
        libc::ppoll(
            polled.as_mut_ptr(),
            N as libc::nfds_t,
            timeout,
            std::ptr::null(),
        )
    }) {
        Ok(_) => Ok(polled.map(|fd| fd.revents != 0)),
        Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok([false; N]),
        Err(error) => Err(error),
    }
}

fn to_timespec(duration: Duration) -> libc::timespec {
    libc::timespec {
        tv_sec: libc::time_t::try_from(duration.as_secs()).unwrap_or(libc::time_t::MAX),
        tv_nsec: duration.subsec_nanos().into(),
    }
}

/// Rounded up: a wait that ends too early would only come again at once.
fn to_millis(timeout: Option<Duration>) -> libc::c_int {
    timeout.map_or(-1, |timeout| {
        let millis = timeout.as_nanos().div_ceil(1_000_000);
        libc::c_int::try_from(millis).unwrap_or(libc::c_int::MAX)
    })
}

#[cfg(test)]
mod tests {
    use std::net::UdpSocket;
    use std::time::Instant;

    use super::*;

    #[test]
    fn an_edge_is_reported_once_per_arrival() {
        let epoll = Epoll::new().unwrap();
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        let address = socket.local_addr().unwrap();
        epoll.add(socket.as_fd(), 3, Interest::Edge).unwrap();
        let poll = || {
            epoll
                .wait(Some(Duration::from_millis(1)))
                .unwrap()
                .contains(3)
        };
        assert!(!poll());
        for _ in 0..2 {
            socket.send_to(b"ring", address).unwrap();
            assert!(poll());
            assert!(!poll(), "nobody read it, and still it is reported once");
        }
    }

    #[test]
    fn timeouts_are_finer_than_milliseconds() {
        let epoll = Epoll::new().unwrap();
        let start = Instant::now();
        for _ in 0..10 {
            epoll.wait(Some(Duration::from_micros(100))).unwrap();
        }
        assert!(start.elapsed() >= Duration::from_millis(1));
        assert_eq!(to_millis(Some(Duration::from_nanos(1))), 1);
        assert_eq!(to_millis(None), -1);
    }
}
