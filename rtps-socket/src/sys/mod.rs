//! Everything that needs `unsafe`: memory shared with the kernel, and system calls that have no safe wrapper.
//!
//! [`RingConsumer`] and [`Bell`] map what the kernel layer hands to an app, [`channel`] what connects it with other apps
//! of the host, [`Epoll`] waits with nanosecond timeouts, and [`seqpacket`], [`udp`], [`receive`] and [`fan_out`] are
//! the sockets of the two links. What leaves this room is safe to call in any order.

mod bell;
pub(crate) mod channel;
mod epoll;
pub(crate) mod fan_out;
mod mapping;
mod random;
pub(crate) mod receive;
mod ring;
pub(crate) mod seqpacket;
pub(crate) mod udp;

pub(crate) use bell::Bell;
pub(crate) use epoll::{Epoll, Interest, Wakeups, wait_readable};
pub(crate) use random::random_bytes;
pub(crate) use ring::{Ring, RingConsumer};

/// The result of a C function that returns -1 and sets `errno` on failure.
fn check(result: libc::c_int) -> std::io::Result<libc::c_int> {
    match result {
        -1 => Err(std::io::Error::last_os_error()),
        value => Ok(value),
    }
}

/// As [`check`], for functions that return a length.
fn check_len(result: libc::ssize_t) -> std::io::Result<usize> {
    usize::try_from(result).map_err(|_| std::io::Error::last_os_error())
}
