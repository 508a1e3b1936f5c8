//! The consumer against a ring in a memory file, laid out and filled as the kernel does it.

use std::fs::File;
use std::os::fd::FromRawFd;
use std::os::unix::fs::FileExt;

use proptest::prelude::*;

use super::*;

const SIZE: usize = 16 * 1024;

/// A file of `len` zero bytes in memory.
pub(in crate::sys) fn memory_file(len: usize) -> File {
    // SAFETY: the name is NUL-terminated.
    let fd = unsafe { libc::memfd_create(c"test".as_ptr(), libc::MFD_CLOEXEC) };
    assert!(fd >= 0, "{}", io::Error::last_os_error());
    // SAFETY: a new descriptor that nobody else owns.
    let file = unsafe { File::from_raw_fd(fd) };
    file.set_len(len as u64).unwrap();
    file
}

/// The kernel's side of the ring.
struct Producer {
    file: File,
    position: u64,
}

impl Producer {
    fn new() -> (Self, RingConsumer) {
        let file = memory_file(2 * page_size() + SIZE);
        let ring = RingConsumer::map_sized(file.try_clone().unwrap().into(), SIZE).unwrap();
        (Self { file, position: 0 }, ring)
    }

    fn put(&mut self, position: u64, bytes: &[u8]) {
        let data = 2 * page_size() as u64;
        for (position, byte) in (position..).zip(bytes) {
            let at = data + position % SIZE as u64;
            self.file.write_all_at(&[*byte], at).unwrap();
        }
    }

    /// Reserves a record, still busy; false when there is no room.
    fn reserve(&mut self, record: &[u8]) -> bool {
        let mut consumer = [0; 8];
        self.file.read_exact_at(&mut consumer, 0).unwrap();
        let next = self.position + (8 + record.len() as u64).next_multiple_of(8);
        if next - u64::from_ne_bytes(consumer) > SIZE as u64 - 1 {
            return false;
        }
        self.set_header(self.position, record.len() as u32 | BUSY);
        self.put(self.position + 8, record);
        self.position = next;
        let page = page_size() as u64;
        self.file.write_all_at(&next.to_ne_bytes(), page).unwrap();
        true
    }

    fn set_header(&mut self, position: u64, header: u32) {
        self.put(position, &header.to_ne_bytes());
    }

    fn submit(&mut self, record: &[u8], flags: u32) -> bool {
        let at = self.position;
        let fits = self.reserve(record);
        if fits {
            self.set_header(at, record.len() as u32 | flags);
        }
        fits
    }
}

fn drain_all(ring: &mut RingConsumer) -> Vec<Vec<u8>> {
    let mut records = Vec::new();
    ring.drain(usize::MAX, |record| records.push(record.to_vec()));
    records
}

#[test]
fn busy_and_discarded_records() {
    let (mut kernel, mut ring) = Producer::new();
    assert!(!ring.ring().has_record());
    kernel.submit(b"first", 0);
    kernel.submit(b"nothing", DISCARDED);
    let busy_at = kernel.position;
    kernel.reserve(b"second");
    kernel.submit(b"third", 0);
    assert_eq!(drain_all(&mut ring), [b"first"]);
    assert!(!ring.ring().has_record(), "the next one is busy");
    assert!(drain_all(&mut ring).is_empty());
    kernel.set_header(busy_at, 6);
    assert!(ring.ring().has_record());
    assert_eq!(drain_all(&mut ring), [&b"second"[..], b"third"]);
}

#[test]
fn the_limit_holds() {
    let (mut kernel, mut ring) = Producer::new();
    (0..5u8).for_each(|n| assert!(kernel.submit(&[n], 0)));
    let mut seen = Vec::new();
    assert_eq!(ring.drain(3, |record| seen.extend_from_slice(record)), 3);
    assert_eq!(seen, [0, 1, 2]);
    assert_eq!(ring.drain(3, |record| seen.extend_from_slice(record)), 2);
    assert_eq!(seen, [0, 1, 2, 3, 4]);
}

#[test]
fn a_length_that_lies_ends_the_drain() {
    let (mut kernel, mut ring) = Producer::new();
    kernel.submit(b"good", 0);
    let at = kernel.position;
    kernel.submit(b"bad", 0);
    kernel.set_header(at, 0x3fff_ffff);
    assert_eq!(drain_all(&mut ring), [b"good"]);
    kernel.submit(b"later", 0);
    assert_eq!(drain_all(&mut ring), [b"later"]);
}

#[test]
fn sizes_that_no_ring_has_are_refused() {
    let file = memory_file(64 * 1024);
    for size in [0, 1000, 3 * page_size(), 1 << 31] {
        assert!(RingConsumer::map_sized(file.try_clone().unwrap().into(), size).is_err());
    }
    assert!(RingConsumer::map(file.into()).is_err(), "not a BPF map");
}

proptest! {
    #[test]
    fn every_record_arrives_whole_and_in_order(
        lengths in prop::collection::vec((0..3000usize, any::<bool>()), 1..60),
    ) {
        let (mut kernel, mut ring) = Producer::new();
        let (mut expected, mut received) = (Vec::new(), Vec::new());
        for (index, (length, drain)) in lengths.into_iter().enumerate() {
            let record: Vec<u8> = (0..length).map(|n| (n + index) as u8).collect();
            if drain || !kernel.submit(&record, 0) {
                received.append(&mut drain_all(&mut ring));
                prop_assert!(!drain || kernel.submit(&record, 0));
                if !drain {
                    prop_assert!(kernel.submit(&record, 0), "empty again");
                }
            }
            expected.push(record);
        }
        received.append(&mut drain_all(&mut ring));
        prop_assert_eq!(received, expected);
    }
}
