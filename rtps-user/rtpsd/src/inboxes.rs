//! The rings and bells of apps, made and put into place by a thread of their own.
//!
//! Whoever changes a map of maps waits until no program uses what was there, which takes long on a busy host. The
//! thread takes all changes that are due together, so that they wait only once, and rtpsd goes on with its work.

use std::collections::BTreeMap;
use std::io;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;

use anyhow::{Context, Result};
use aya::maps::{MapData, MapError};
use aya_obj::generated::{BPF_F_MMAPABLE, bpf_map_type};
use nix::sys::eventfd::{EfdFlags, EventFd};
use rtps_ebpf::abi::{App, Bell, name};
use tracing::warn;

use crate::kernel_maps::create;
use crate::pins::PinFolder;
use crate::sys;

/// What an attached app maps into its memory.
pub(crate) struct Inbox {
    pub(crate) ring: OwnedFd,
    pub(crate) bell: OwnedFd,
}

/// An inbox that is wanted.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Order {
    /// Of whom.
    pub(crate) connection: u32,
    pub(crate) slot: u8,
    /// What the kernel is to know of the app once it has its inbox.
    pub(crate) app: App,
    pub(crate) ring_bytes: u32,
}

/// An inbox that is in place, or why it is not.
pub(crate) struct Made {
    pub(crate) order: Order,
    pub(crate) inbox: Result<Inbox, String>,
}

enum Job {
    Make(Order),
    Free(u8),
}

/// The near end of the thread.
pub(crate) struct Inboxes {
    jobs: Sender<Job>,
    made: Receiver<Made>,
    /// Readable while something is in `made`.
    notice: Arc<EventFd>,
}

impl Inboxes {
    /// Starts the thread, which ends with the value.
    pub(crate) fn start(folder: &PinFolder) -> Result<Self> {
        let (jobs, ordered) = channel();
        let (finished, made) = channel();
        let flags = EfdFlags::EFD_CLOEXEC | EfdFlags::EFD_NONBLOCK;
        let notice = Arc::new(EventFd::from_flags(flags).context("eventfd")?);
        let maker = Maker {
            rings: MapData::from_pin(folder.entry(name::RINGS))?,
            bells: MapData::from_pin(folder.entry(name::BELLS))?,
            nobody: Pair::new(sys::page_size() as u32)?,
            finished,
            notice: Arc::clone(&notice),
        };
        thread::Builder::new()
            .name("inboxes".to_owned())
            .spawn(move || maker.run(&ordered))
            .context("cannot start a thread")?;
        Ok(Self { jobs, made, notice })
    }

    /// Has an inbox made; [`next`](Self::next) gives it.
    pub(crate) fn make(&self, order: Order) -> Result<(), String> {
        let sent = self.jobs.send(Job::Make(order));
        sent.map_err(|_| "rtpsd makes no rings any more: load the layer again".to_owned())
    }

    /// Lets go of a slot's ring and bell, which the kernel no longer uses; they are freed when the app has closed them,
    /// too.
    pub(crate) fn free(&self, slot: u8) {
        if self.jobs.send(Job::Free(slot)).is_err() {
            warn!(slot, "its ring stays");
        }
    }

    /// What has been finished; to be called until there is nothing.
    pub(crate) fn next(&self) -> Option<Made> {
        if let Ok(made) = self.made.try_recv() {
            return Some(made);
        }
        // Cleared before the last look, so that what comes after it is noticed. It fails where it is clear already.
        let _ = self.notice.read();
        self.made.try_recv().ok()
    }
}

impl AsFd for Inboxes {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.notice.as_fd()
    }
}

/// A ring and a bell.
struct Pair {
    ring: MapData,
    bell: MapData,
}

impl Pair {
    fn new(ring_bytes: u32) -> Result<Self, MapError> {
        const ARRAY: u32 = bpf_map_type::BPF_MAP_TYPE_ARRAY as u32;
        const RINGBUF: u32 = bpf_map_type::BPF_MAP_TYPE_RINGBUF as u32;
        let bell_size = size_of::<Bell>() as u32;
        Ok(Self {
            ring: create(RINGBUF, 0, 0, ring_bytes, 0, "rtps_ring")?,
            bell: create(ARRAY, 4, bell_size, 1, BPF_F_MMAPABLE, "rtps_bell")?,
        })
    }

    fn inbox(&self) -> io::Result<Inbox> {
        Ok(Inbox {
            ring: self.ring.fd().as_fd().try_clone_to_owned()?,
            bell: self.bell.fd().as_fd().try_clone_to_owned()?,
        })
    }
}

/// The thread.
struct Maker {
    rings: MapData,
    bells: MapData,
    /// What stands in free slots: the kernel can replace many entries at once, but not remove them.
    nobody: Pair,
    finished: Sender<Made>,
    notice: Arc<EventFd>,
}

impl Maker {
    fn run(&self, jobs: &Receiver<Job>) {
        while let Ok(first) = jobs.recv() {
            let due = std::iter::once(first).chain(jobs.try_iter());
            self.work(due);
        }
    }

    /// Of several jobs for one slot the last one counts: its app has gone already, or is the one that stays.
    fn work(&self, jobs: impl Iterator<Item = Job>) {
        let mut slots: BTreeMap<u8, Option<Pair>> = BTreeMap::new();
        let mut orders: Vec<(Order, Inbox)> = Vec::new();
        for job in jobs {
            match job {
                Job::Make(order) => match make(&order) {
                    Ok((pair, inbox)) => {
                        slots.insert(order.slot, Some(pair));
                        orders.push((order, inbox));
                    }
                    Err(error) => self.finish(order, Err(format!("{error:#}"))),
                },
                Job::Free(slot) => drop(slots.insert(slot, None)),
            }
        }
        let placed = self.place(&slots).map_err(|error| format!("{error:#}"));
        if let Err(error) = &placed {
            warn!("{error}");
        }
        for (order, inbox) in orders {
            self.finish(order, placed.clone().map(|()| inbox));
        }
    }

    fn place(&self, slots: &BTreeMap<u8, Option<Pair>>) -> Result<()> {
        let keys: Vec<u32> = slots.keys().copied().map(u32::from).collect();
        let pairs = || {
            slots
                .values()
                .map(|pair| pair.as_ref().unwrap_or(&self.nobody))
        };
        let bells: Vec<BorrowedFd<'_>> = pairs().map(|pair| pair.bell.fd().as_fd()).collect();
        let rings: Vec<BorrowedFd<'_>> = pairs().map(|pair| pair.ring.fd().as_fd()).collect();
        sys::set_inner_maps(self.bells.fd().as_fd(), &keys, &bells).context("map `bells`")?;
        sys::set_inner_maps(self.rings.fd().as_fd(), &keys, &rings).context("map `rings`")
    }

    fn finish(&self, order: Order, inbox: Result<Inbox, String>) {
        // Nobody listens once rtpsd ends.
        drop(self.finished.send(Made { order, inbox }));
        let _ = self.notice.write(1);
    }
}

fn make(order: &Order) -> Result<(Pair, Inbox)> {
    let pair = Pair::new(order.ring_bytes)?;
    let inbox = pair.inbox()?;
    Ok((pair, inbox))
}
