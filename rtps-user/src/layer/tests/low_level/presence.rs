//! Participants that stay, leave, are forgotten and come back. The low-level layer keeps to itself what nobody waits for.

use rtps_ebpf::abi::PEER_SUPERVISED;

use super::invented::{STRANGER, acknack, address, announcement, farewell, publication};
use super::{hosts, restarted};
use crate::layer::protocol::{FromLayer, ToLayer};
use crate::layer::tests::sim::{GROUP, Net, endpoint, prefix};
use crate::layer::tests::{READER, SECOND, WRITER, matches, unmatched};
use crate::qos::{Liveliness, LivelinessKind};
use crate::wire;

#[test]
fn the_steady_state_leaves_the_layer_alone() {
    let mut net = hosts(&[true; 20]);
    for host in 0..20 {
        let slot = net.attach(host);
        net.declare(
            host,
            endpoint(slot, 1, if host == 0 { READER } else { WRITER }),
        );
        net.run(SECOND / 7);
    }
    net.run(30 * SECOND);
    net.hosts[0].wakeups = 0;
    net.run(60 * SECOND);
    assert!(net.hosts[0].wakeups <= 20, "{}", net.hosts[0].wakeups);
    assert_eq!(net.hosts[0].layer.status().participants.len(), 19);
    for host in 1..20 {
        net.hosts[host].is_connected = host % 2 == 0;
    }
    net.run(21 * SECOND);
    assert_eq!(net.hosts[0].layer.status().participants.len(), 9);
    assert_eq!(net.kernel(0).peers.len(), 9);
}

#[test]
fn signs_of_life_come_through_where_an_app_waits_for_them() {
    let mut net = hosts(&[true, false]);
    let (a, b) = (net.attach(0), net.attach(1));
    let mut writer = endpoint(b, 1, WRITER);
    writer.qos.liveliness = Liveliness {
        kind: LivelinessKind::Automatic,
        lease: wire::Duration {
            seconds: 3,
            fraction: 0,
        },
    };
    net.declare(1, writer);
    net.run(5 * SECOND);
    let signs = |net: &mut Net| {
        let told = net.replies(0);
        let is_sign = |message: &FromLayer| matches!(message, FromLayer::Liveliness { .. });
        told.iter().filter(|(_, message)| is_sign(message)).count()
    };
    let flags = |net: &mut Net| net.kernel(0).peers[&prefix(2)].flags & PEER_SUPERVISED;
    assert_eq!((signs(&mut net), flags(&mut net)), (0, 0));
    let reader = net.declare(0, endpoint(a, 1, READER));
    net.run(9 * SECOND);
    assert_eq!((signs(&mut net), flags(&mut net)), (9, PEER_SUPERVISED));
    net.request(0, a, ToLayer::Withdraw(reader.entity));
    net.run(9 * SECOND);
    assert_eq!((signs(&mut net), flags(&mut net)), (0, 0));
    net.run(SECOND / 2);
    assert_eq!(net.hosts[1].layer.unacknowledged().count(), 0);
}

#[test]
fn who_was_forgotten_here_becomes_known_again() {
    let mut net = hosts(&[true]);
    net.inject(address(), GROUP, announcement());
    net.run(31 * SECOND);
    assert_eq!(net.hosts[0].layer.status().participants, []);
    assert!(net.kernel(0).strangers.is_empty());
    net.inject(address(), GROUP, announcement());
    net.run(SECOND);
    assert_eq!(net.hosts[0].layer.status().participants.len(), 1);
    // The layer alone forgets it.
    let next = restarted(&mut net);
    net.restart(0, next);
    net.inject(address(), GROUP, acknack(1));
    net.run(SECOND);
    assert!(
        net.kernel(0).strangers.is_empty(),
        "it has to say who it is"
    );
    net.inject(address(), GROUP, announcement());
    net.inject(address(), GROUP, acknack(2));
    net.run(SECOND);
    assert_eq!(net.hosts[0].peers, [STRANGER].into());
}

#[test]
fn who_says_goodbye_and_is_back_at_once_is_taken_in_again() {
    for answers in [true, false] {
        let mut net = hosts(&[answers]);
        let slot = net.attach(0);
        let reader = net.declare(0, endpoint(slot, 1, READER));
        let (writer, publication) = publication();
        let come = [announcement(), acknack(1), publication];
        let say = |net: &mut Net, messages: &[Vec<u8>]| {
            for bytes in messages {
                net.inject(address(), GROUP, bytes.clone());
            }
        };
        say(&mut net, &come);
        net.run(SECOND);
        assert_eq!(matches(&net.replies(0)), [writer]);
        for _ in 0..3 {
            say(&mut net, &[farewell(STRANGER, 2)]);
            say(&mut net, &come);
            net.run(SECOND);
            let replies = net.replies(0);
            assert!(replies.contains(&unmatched(reader, writer)));
            assert_eq!(matches(&replies), [writer]);
        }
        // What the layer learns late has happened before.
        net.hosts[0].is_stopped = true;
        say(&mut net, &[farewell(STRANGER, 2)]);
        say(&mut net, &come);
        net.run(SECOND);
        net.hosts[0].is_stopped = false;
        net.run(SECOND);
        say(&mut net, &come);
        net.run(SECOND);
        assert_eq!(matches(&net.replies(0)).last(), Some(&writer));
    }
}

/// A remote participant that we have lost still knows us, and holds all of its samples for acknowledged.
#[test]
fn who_is_found_again_is_asked_for_its_endpoints() {
    let mut net = hosts(&[true, true]);
    let (a, b) = (net.attach(0), net.attach(1));
    net.declare(0, endpoint(a, 1, WRITER));
    let reader = net.declare(1, endpoint(b, 1, READER));
    net.run(SECOND);
    assert_eq!(matches(&net.replies(0)), [reader]);
    let (from, to) = (net.hosts[1].address, net.hosts[0].address);
    net.inject(from, to, farewell(prefix(2), 9));
    net.run(30 * SECOND);
    assert_eq!(matches(&net.replies(0)), [reader]);
}
