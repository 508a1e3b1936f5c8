//! The expert API in an event loop of the program's own.

use std::os::fd::AsFd;
use std::time::{Duration, Instant};

use nix::poll::{PollFd, PollFlags, poll};
use rtps_socket::{LayerChoice, Qos, RtpsSocket, Selection};

use crate::support;

/// Waits for either socket and drives what is readable, until `is_done`.
fn run(sockets: [&RtpsSocket; 2], mut is_done: impl FnMut() -> bool) {
    let end = Instant::now() + Duration::from_secs(10);
    while !is_done() {
        assert!(Instant::now() < end, "it does not come to that");
        let mut fds = sockets.map(|socket| PollFd::new(socket.as_fd(), PollFlags::POLLIN));
        poll(&mut fds, 1000u16).unwrap();
        for (fd, socket) in fds.iter().zip(sockets) {
            if fd.any() == Some(true) {
                socket.drive();
            }
        }
    }
}

#[test]
fn one_thread_drives_two_participants() {
    let domain = support::own_network();
    let open = || {
        RtpsSocket::builder()
            .domain(domain)
            .layer(LayerChoice::InProcess)
            .open()
            .unwrap()
    };
    let (a, b) = (open(), open());
    let qos = || Qos::reliable().keep_all();
    let writer = a.create_writer("Raw", "Bytes", qos(), false).unwrap();
    let reader = b.create_reader("Raw", "Bytes", qos(), None).unwrap();
    run([&a, &b], || {
        !writer.matched().is_empty() && !reader.matched().is_empty()
    });
    let mut received = Vec::new();
    for number in 0..50u8 {
        writer.send(vec![0, 1, 0, 0, number, 0, 0, 0]).unwrap();
    }
    run([&a, &b], || {
        let samples = reader.take(usize::MAX, &Selection::default());
        received.extend(
            samples
                .into_iter()
                .filter_map(|sample| sample.payload.get(4).copied()),
        );
        received.len() == 50
    });
    assert_eq!(received, (0..50).collect::<Vec<_>>());
    assert!(writer.send(vec![1, 2]).is_err(), "no encapsulation header");
}
