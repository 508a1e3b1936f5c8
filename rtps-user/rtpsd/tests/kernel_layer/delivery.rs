//! Datagrams on their way to the ring of an app.

use std::net::UdpSocket;

use rtps_user::wire::{EntityId, EntityKind};

use crate::support::{AppSocket, Netns, Rtpsd, hello, wait_until, welcome};

#[test]
fn datagrams_reach_the_ring_through_xdp_and_the_filter() {
    datagrams_reach_the_ring(&["--mode", "native"], "xdp_messages");
}

#[test]
fn datagrams_reach_the_ring_through_tc_and_the_filter() {
    datagrams_reach_the_ring(&["--mode", "tc"], "ingress_messages");
    datagrams_reach_the_ring(&["--discovery", "user"], "ingress_messages");
}

fn datagrams_reach_the_ring(arguments: &[&str], counter: &str) {
    let Some((here, there)) = Netns::pair() else {
        return;
    };
    let _rtpsd = Rtpsd::start(&here, arguments);
    let app = AppSocket::connect(&here);
    let slot = welcome(app.hello(hello(0, None)).0).slot;
    let delivered = |interface: &str| here.status().counters[interface]["delivered_records"];
    let fill = || here.status().apps[0].ring_fill;
    let reader = EntityId::of_app(slot, 1, EntityKind::ReaderNoKey);
    there.within(|| send_data(reader, "10.99.0.1:7411"));
    assert!(wait_until(|| delivered("veth0") == 1));
    let from_outside = fill();
    assert!(from_outside > 0);
    here.within(|| send_data(reader, "127.0.0.1:7411"));
    assert!(wait_until(|| delivered("lo") == 1));
    assert!(fill() > from_outside);
    let counters = here.status().counters;
    assert_eq!(counters["veth0"][counter], 1);
    assert_eq!(counters["lo"]["filter_messages"], 1);
}

/// A message with one DATA submessage (RTPS 2.5, 9.4.5.4).
fn send_data(reader: EntityId, to: &str) {
    let mut message = b"RTPS\x02\x05\0\0ABCDEFGHIJKL".to_vec();
    message.extend([0x15, 0x05, 28, 0, 0, 0, 16, 0]);
    message.extend(reader.0);
    message.extend([0, 0, 1, 0x03]);
    message.extend([0, 0, 0, 0, 1, 0, 0, 0]);
    message.extend([0, 1, 0, 0, 1, 2, 3, 4]);
    let socket = UdpSocket::bind("0.0.0.0:0").unwrap();
    socket.send_to(&message, to).unwrap();
}
