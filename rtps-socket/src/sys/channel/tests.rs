//! Both sides of a ring in one process, and sides that break the rules.

use std::collections::VecDeque;
use std::os::unix::fs::FileExt;
use std::sync::atomic::AtomicBool;
use std::thread;
use std::time::Duration;

use nix::fcntl::OFlag;
use nix::unistd::pipe2;
use proptest::prelude::*;

use super::*;
use crate::sys::mapping::page_size;
use crate::sys::ring::tests::memory_file;
use crate::sys::{Epoll, Interest};

const SIZE: usize = 8 * 1024;

/// A channel and what another process could write to.
struct Channel {
    outbound: Outbound,
    inbound: Inbound,
    ring: File,
}

impl Channel {
    fn new() -> Self {
        let ring = memory_file(2 * page_size() + SIZE);
        let (read, write) = pipe2(OFlag::O_CLOEXEC | OFlag::O_NONBLOCK).unwrap();
        let copy = |file: &File| OwnedFd::from(file.try_clone().unwrap());
        Self {
            outbound: Outbound::map(copy(&ring), write).unwrap(),
            inbound: Inbound::map(copy(&ring), read).unwrap(),
            ring,
        }
    }

    fn send(&mut self, datagram: &[u8]) -> bool {
        self.outbound.send(std::iter::once(datagram))
    }

    fn receive(&mut self, limit: usize) -> Vec<Vec<u8>> {
        let mut datagrams = Vec::new();
        let mut buffer = Vec::new();
        let take = |datagram: &[u8]| datagrams.push(datagram.to_vec());
        let count = self.inbound.drain(limit, &mut buffer, take);
        assert_eq!(count, datagrams.len());
        datagrams
    }

    /// What the other process claims to have written or read.
    fn claim(&self, page: usize, position: u64) {
        let at = (page * page_size()) as u64;
        self.ring.write_all_at(&position.to_ne_bytes(), at).unwrap();
    }

    /// How often the receiver was woken since the last call.
    fn wakes(&mut self) -> usize {
        self.inbound.pipe.read(&mut [0; 4096]).unwrap_or_default()
    }
}

const PRODUCER: usize = 0;
const CONSUMER: usize = 1;

#[test]
fn datagrams_arrive_in_order_up_to_a_limit() {
    let mut channel = Channel::new();
    assert!(!channel.inbound.has_record());
    let datagrams: [&[u8]; 4] = [b"one", b"", b"three", &[4; 1472]];
    assert!(channel.outbound.send(datagrams.into_iter()));
    assert!(channel.inbound.has_record());
    assert_eq!(channel.receive(3), datagrams[..3]);
    assert_eq!(channel.receive(9), datagrams[3..]);
    assert!(!channel.inbound.has_record());
    assert_eq!(channel.receive(9), [[0; 0]; 0]);
}

#[test]
fn a_full_ring_takes_nothing_until_it_is_read() {
    let mut channel = Channel::new();
    assert!(!channel.send(&[0; SIZE]));
    let sent = (0u8..).take_while(|n| channel.send(&[*n; 1000])).count();
    assert_eq!(sent, SIZE / 1008);
    assert!(channel.send(&[77; 100]), "there is room for a small one");
    assert_eq!(channel.receive(1), [[0; 1000]]);
    assert!(channel.send(&[88; 1000]));
    let rest = channel.receive(100);
    assert_eq!(rest.len(), sent + 1);
    assert_eq!(rest[sent], [88; 1000]);
}

#[test]
fn of_a_burst_comes_what_there_is_room_for() {
    let mut channel = Channel::new();
    let burst = [[5u8; 1000]; 20];
    assert!(
        !channel
            .outbound
            .send(burst.iter().map(|datagram| &datagram[..]))
    );
    assert_eq!(channel.receive(100).len(), SIZE / 1008);
}

#[test]
fn a_reader_that_stands_still_is_waited_for_once() {
    let mut channel = Channel::new();
    while channel.send(&[1; 1000]) {}
    let start = Instant::now();
    for _ in 0..10_000 {
        assert!(!channel.send(&[2; 1000]));
    }
    assert!(start.elapsed() < 1_000 * PATIENCE);
    let Channel {
        mut outbound,
        mut inbound,
        ring: _ring,
    } = channel;
    let reader = thread::spawn(move || {
        let mut buffer = Vec::new();
        while inbound.drain(1, &mut buffer, |_| ()) > 0 || !buffer.starts_with(&[3]) {
            thread::yield_now();
        }
    });
    while !outbound.send(std::iter::once(&[3u8; 1000][..])) {}
    reader.join().unwrap();
}

#[test]
fn a_reader_that_makes_room_little_by_little_is_not_waited_for_throughout_a_burst() {
    let Channel {
        mut outbound,
        mut inbound,
        ring: _ring,
    } = Channel::new();
    let is_over = Arc::new(AtomicBool::new(false));
    let has_ended = Arc::clone(&is_over);
    let reader = thread::spawn(move || {
        while !has_ended.load(Ordering::Relaxed) {
            inbound.drain(1, &mut Vec::new(), |_| ());
            thread::sleep(PATIENCE / 4);
        }
    });
    assert!(!outbound.send([&[1u8; 1000][..]; 1_000].into_iter()));
    is_over.store(true, Ordering::Relaxed);
    reader.join().unwrap();
}

#[test]
fn only_who_sleeps_is_woken_and_only_once() {
    let mut channel = Channel::new();
    channel.send(b"awake");
    assert_eq!(channel.wakes(), 0);
    assert_eq!(channel.receive(9).len(), 1);
    channel.inbound.arm();
    for _ in 0..5 {
        channel.send(b"asleep");
    }
    assert_eq!(channel.wakes(), 1);
    channel.inbound.disarm();
    assert_eq!(channel.receive(9).len(), 5);
    channel.inbound.arm();
    channel.send(b"asleep again");
    assert_eq!(channel.wakes(), 1);
}

#[test]
fn who_has_read_before_it_could_be_woken_is_woken_the_next_time() {
    let mut channel = Channel::new();
    channel.inbound.arm();
    channel.outbound.producer.put(b"read at once");
    channel.outbound.producer.publish();
    assert_eq!(channel.receive(9).len(), 1);
    channel.outbound.wake();
    assert_eq!(channel.wakes(), 0);
    channel.send(b"next");
    assert_eq!(channel.wakes(), 1);
}

#[test]
fn the_pipe_never_fills() {
    let mut channel = Channel::new();
    let epoll = Epoll::new().unwrap();
    epoll
        .add(channel.inbound.as_fd(), 7, Interest::Edge)
        .unwrap();
    for _ in 0..70_000 {
        channel.inbound.arm();
        channel.send(b"wake up");
        let wakeups = epoll.wait(Some(Duration::from_secs(5))).unwrap();
        assert!(wakeups.contains(7));
        channel.inbound.disarm();
        assert_eq!(channel.receive(9).len(), 1);
    }
    assert!(channel.wakes() <= 2 * PIPE_PERIOD);
}

#[test]
fn a_producer_that_lies_is_not_read_any_more() {
    for position in [1, 7, 9, SIZE as u64 + 8, u64::MAX, u64::MAX - 7] {
        let mut channel = Channel::new();
        channel.claim(PRODUCER, position);
        assert_eq!(channel.receive(9), [[0; 0]; 0], "{position}");
        assert!(
            !channel.inbound.has_record(),
            "or the app would never sleep"
        );
        channel.claim(PRODUCER, 16);
        assert!(!channel.inbound.has_record());
    }
}

#[test]
fn lengths_that_lie_are_not_believed() {
    for len in [9u32, 65_536, u32::MAX, u32::MAX - 8] {
        let mut channel = Channel::new();
        channel.send(b"honest");
        channel.send(b"8 bytes!");
        let second = (2 * page_size() + 16) as u64;
        channel
            .ring
            .write_all_at(&len.to_ne_bytes(), second)
            .unwrap();
        assert_eq!(channel.receive(9), [b"honest"], "{len}");
        assert!(!channel.inbound.has_record());
    }
}

#[test]
fn a_consumer_that_lies_gets_no_more_than_fits() {
    for position in [8, SIZE as u64, u64::MAX, 1 << 63] {
        let mut channel = Channel::new();
        let sent = (0..100)
            .filter(|_| {
                channel.claim(CONSUMER, position);
                channel.send(&[1; 1000])
            })
            .count();
        assert!(sent <= SIZE / 1008 + 1, "{position}: {sent}");
    }
}

#[test]
fn files_of_odd_sizes_are_refused() {
    for len in [
        0,
        100,
        2 * page_size(),
        2 * page_size() + 100,
        5 * page_size(),
    ] {
        let file = memory_file(len);
        assert!(Producer::map(&file).is_err(), "{len}");
        assert!(Consumer::map(&file).is_err(), "{len}");
    }
}

#[test]
fn two_threads_lose_nothing_and_miss_no_wake_up() {
    const COUNT: u32 = 200_000;
    let Channel {
        mut outbound,
        mut inbound,
        ring: _,
    } = Channel::new();
    let sender = thread::spawn(move || {
        for n in 0..COUNT {
            let datagram = n.to_ne_bytes().repeat(1 + n as usize % 40);
            while !outbound.send(std::iter::once(&datagram[..])) {
                thread::yield_now();
            }
        }
        outbound
    });
    let epoll = Epoll::new().unwrap();
    epoll.add(inbound.as_fd(), 7, Interest::Edge).unwrap();
    let (mut next, mut buffer) = (0u32, Vec::new());
    while next < COUNT {
        inbound.arm();
        if !inbound.has_record() {
            let wakeups = epoll.wait(Some(Duration::from_secs(20))).unwrap();
            assert!(!wakeups.is_empty(), "nobody woke the reader of {next}");
        }
        inbound.disarm();
        inbound.drain(64, &mut buffer, |datagram| {
            assert_eq!(datagram, next.to_ne_bytes().repeat(1 + next as usize % 40));
            next += 1;
        });
    }
    sender.join().unwrap();
}

proptest! {
    #[test]
    fn it_behaves_as_a_bounded_queue(
        steps in prop::collection::vec((0usize..3000, 0usize..4), 1..300),
    ) {
        let mut channel = Channel::new();
        let mut model: VecDeque<Vec<u8>> = VecDeque::new();
        for (n, (len, limit)) in steps.into_iter().enumerate() {
            let datagram = vec![n as u8; len];
            let used: usize = model.iter().map(|d| (8 + d.len()).next_multiple_of(8)).sum();
            let fits = used + (8 + len).next_multiple_of(8) <= SIZE;
            prop_assert_eq!(channel.send(&datagram), fits);
            if fits {
                model.push_back(datagram);
            }
            let expected: Vec<_> = model.drain(..limit.min(model.len())).collect();
            prop_assert_eq!(channel.receive(limit), expected);
        }
    }
}
