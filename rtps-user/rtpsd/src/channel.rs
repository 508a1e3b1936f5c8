//! Shared memory between two apps: for each direction a ring that one fills and the other empties, and a pipe by which
//! the first wakes the second. What is in the rings is between the apps; rtpsd keeps nothing of them.
//!
//! The apps need not trust each other. Neither can change the size of a ring under the other's feet. A pipe's two ends
//! are opened one by one, so that neither app can make the other's calls wait, and the end that wakes is open for
//! reading too: it cannot break, which would be a signal that ends the app.

use std::fs::{File, OpenOptions};
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::fs::OpenOptionsExt;

use anyhow::{Context, Result};
use nix::fcntl::{FcntlArg, OFlag, SealFlag, fcntl};
use nix::sys::memfd::{MFdFlags, memfd_create};
use nix::unistd::pipe2;
use rtps_user::layer::protocol::FromLayer;

use crate::domain::Reply;
use crate::sys;

/// Bytes of data in a ring. Only pages that were written to take memory.
const RING_BYTES: usize = 512 << 10;

/// Makes a channel between the apps in two slots; what each of them is to be told.
pub(crate) fn open(slots: [u8; 2]) -> Result<[Reply; 2]> {
    let [a, b] = slots;
    let (from_a, from_b) = (Direction::new()?, Direction::new()?);
    Ok([
        reply(a, b, from_a.sending_end()?, from_b.receiving_end()?),
        reply(b, a, from_b.sending_end()?, from_a.receiving_end()?),
    ])
}

/// Tells `slot` that it is connected with `other`.
fn reply(slot: u8, other: u8, sending: [OwnedFd; 2], receiving: [OwnedFd; 2]) -> Reply {
    Reply {
        slot,
        message: FromLayer::Channel { slot: other },
        descriptors: sending.into_iter().chain(receiving).collect(),
    }
}

/// From one app to the other.
struct Direction {
    ring: OwnedFd,
    /// What wakes the receiver.
    pipe: OwnedFd,
}

impl Direction {
    fn new() -> Result<Self> {
        let (pipe, _) = pipe2(OFlag::O_CLOEXEC | OFlag::O_NONBLOCK).context("pipe")?;
        Ok(Self {
            ring: ring()?,
            pipe,
        })
    }

    /// The ring, and what wakes the receiver.
    fn sending_end(&self) -> Result<[OwnedFd; 2]> {
        let path = format!("/proc/self/fd/{}", self.pipe.as_raw_fd());
        let mut options = OpenOptions::new();
        options.read(true).write(true);
        let wake = options
            .custom_flags(OFlag::O_NONBLOCK.bits())
            .open(path)
            .context("the writing end of a pipe")?;
        Ok([self.ring.try_clone()?, wake.into()])
    }

    /// The ring, and what wakes.
    fn receiving_end(&self) -> Result<[OwnedFd; 2]> {
        Ok([self.ring.try_clone()?, self.pipe.try_clone()?])
    }
}

/// A page for the producer, one for the consumer, and the data.
fn ring() -> Result<OwnedFd> {
    let flags = MFdFlags::MFD_CLOEXEC | MFdFlags::MFD_ALLOW_SEALING;
    let file = File::from(memfd_create("rtps-channel", flags).context("memfd")?);
    file.set_len((2 * sys::page_size() + RING_BYTES) as u64)?;
    let fixed = SealFlag::F_SEAL_SHRINK | SealFlag::F_SEAL_GROW | SealFlag::F_SEAL_SEAL;
    fcntl(&file, FcntlArg::F_ADD_SEALS(fixed)).context("sealing a memfd")?;
    Ok(file.into())
}

#[cfg(test)]
mod tests {
    use std::io::{ErrorKind, Read, Write};
    use std::os::unix::fs::FileExt;

    use rtps_user::layer::protocol::CHANNEL_DESCRIPTORS;

    use super::*;

    /// Each end's descriptors.
    fn channel() -> [Vec<File>; 2] {
        let [a, b] = open([3, 9]).unwrap();
        assert_eq!((a.slot, a.message), (3, FromLayer::Channel { slot: 9 }));
        assert_eq!((b.slot, b.message), (9, FromLayer::Channel { slot: 3 }));
        [a.descriptors, b.descriptors].map(|end| end.into_iter().map(File::from).collect())
    }

    #[test]
    fn what_one_end_sends_the_other_receives() {
        for ends in [channel(), {
            let [a, b] = channel();
            [b, a]
        }] {
            let [near, far] = &ends;
            assert_eq!([near.len(), far.len()], [CHANNEL_DESCRIPTORS; 2]);
            near[0].write_all_at(b"ring", 8192).unwrap();
            let mut seen = [0; 4];
            far[2].read_exact_at(&mut seen, 8192).unwrap();
            assert_eq!(&seen, b"ring");
            (&near[1]).write_all(b"!").unwrap();
            assert_eq!((&far[3]).read(&mut seen).unwrap(), 1);
        }
    }

    #[test]
    fn neither_end_can_resize_a_ring() {
        let [near, far] = channel();
        for ring in [&near[0], &near[2], &far[0], &far[2]] {
            assert!(ring.set_len(0).is_err());
            assert!(ring.set_len(1 << 30).is_err());
        }
    }

    #[test]
    fn the_waking_end_neither_waits_nor_breaks() {
        let [near, far] = channel();
        let mut wake = &near[1];
        let full = (0..100).find_map(|_| wake.write(&[0; 4096]).err()).unwrap();
        assert_eq!(full.kind(), ErrorKind::WouldBlock);
        // What the receiver sets is its own affair.
        let blocking = FcntlArg::F_SETFL(OFlag::empty());
        fcntl(&far[3], blocking).unwrap();
        let full = wake.write(&[0; 4096]).unwrap_err();
        assert_eq!(full.kind(), ErrorKind::WouldBlock);
        drop(far);
        let full = wake.write(&[0; 4096]).unwrap_err();
        assert_eq!(full.kind(), ErrorKind::WouldBlock, "and not a broken pipe");
    }
}
