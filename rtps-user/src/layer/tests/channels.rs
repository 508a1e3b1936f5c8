//! Apps of one host that are connected by shared memory.

use std::net::SocketAddr;
use std::time::Duration;

use super::sim::{Net, config, endpoint};
use super::{READER, SECOND, WRITER, matches};
use crate::layer::protocol::{FromLayer, ToLayer};
use crate::{RemoteEndpoint, local};

const LOOPBACK: ([u8; 4], u16) = ([127, 0, 0, 1], 7411);

fn with_channels() -> crate::layer::LayerConfig {
    let mut config = config(1);
    config.channels = true;
    config
}

fn host() -> Net {
    let mut net = Net::new(0);
    net.add(with_channels());
    net
}

/// A writer in one app and a reader in another, matched over their channel.
fn connected() -> (Net, u8, u8) {
    let mut net = host();
    let (a, b) = (net.attach(0), net.attach(0));
    net.declare(0, endpoint(a, 1, WRITER));
    net.declare(0, endpoint(b, 1, READER));
    assert_eq!(std::mem::take(&mut net.hosts[0].channels), [[a, b]]);
    net.replies(0);
    (net, a, b)
}

/// Where apps are told that the endpoints are that they are matched with.
fn remotes(replies: &[(u8, FromLayer)]) -> Vec<(u8, &RemoteEndpoint)> {
    let matched = replies.iter().filter_map(|(slot, message)| match message {
        FromLayer::Matched { remote, .. } => Some((*slot, &**remote)),
        _ => None,
    });
    matched.collect()
}

#[test]
fn two_apps_that_match_get_one_channel_before_they_learn_of_it() {
    let mut net = host();
    let (a, b) = (net.attach(0), net.attach(0));
    net.declare(0, endpoint(a, 1, WRITER));
    assert_eq!(net.hosts[0].channels, [[0; 2]; 0]);
    net.declare(0, endpoint(b, 1, READER));
    assert_eq!(net.hosts[0].channels, [[a, b]]);
    let replies = net.replies(0);
    assert_eq!(remotes(&replies).len(), 2);
    for (slot, remote) in remotes(&replies) {
        let address = local::address(if slot == a { b } else { a });
        assert_eq!(remote.unicast, [address]);
        assert_eq!(remote.addresses, [address.ip()]);
    }
    net.declare(0, endpoint(b, 2, READER));
    assert_eq!(net.hosts[0].channels.len(), 1, "they have one");
}

#[test]
fn an_app_reaches_itself_over_loopback_and_no_peer_can_speak_for_it() {
    let mut net = host();
    let a = net.attach(0);
    net.declare(0, endpoint(a, 1, WRITER));
    net.declare(0, endpoint(a, 2, READER));
    assert_eq!(net.hosts[0].channels, [[0; 2]; 0]);
    let replies = net.replies(0);
    assert_eq!(remotes(&replies).len(), 2);
    for (_, remote) in remotes(&replies) {
        assert_eq!(remote.unicast, [SocketAddr::from(LOOPBACK)]);
        assert_eq!(remote.addresses, [SocketAddr::from(LOOPBACK).ip()]);
    }
}

#[test]
fn a_channel_ends_with_one_of_its_apps() {
    let (mut net, a, b) = connected();
    let now = net.now;
    net.hosts[0].layer.detach(now, b);
    let replies = net.replies(0);
    let [(first, FromLayer::Unmatched { .. }), last] = &replies[..] else {
        panic!("{replies:?}")
    };
    assert_eq!(*first, a);
    assert_eq!(*last, (a, FromLayer::ChannelClosed { slot: b }));
    let next = net.attach(0);
    net.declare(0, endpoint(next, 1, READER));
    assert_eq!(net.hosts[0].channels, [[a, next]]);
}

#[test]
fn unmatched_apps_keep_their_channel() {
    let (mut net, _, b) = connected();
    let reader = endpoint(b, 1, READER);
    net.request(0, b, ToLayer::Withdraw(reader.entity));
    net.declare(0, reader);
    assert_eq!(net.hosts[0].channels, [[0; 2]; 0]);
    let closed = |message: &FromLayer| matches!(message, FromLayer::ChannelClosed { .. });
    assert!(!net.replies(0).iter().any(|(_, message)| closed(message)));
}

#[test]
fn apps_do_without_a_channel_that_cannot_be_made() {
    let (mut net, a, b) = connected();
    net.hosts[0].layer.refuse_channel([a, b]);
    let replies = net.replies(0);
    let told: Vec<u8> = remotes(&replies).iter().map(|(slot, _)| *slot).collect();
    assert_eq!(told.len(), 2);
    assert!(told.contains(&a) && told.contains(&b));
    for (_, remote) in remotes(&replies) {
        assert_eq!(remote.unicast, [SocketAddr::from(LOOPBACK)]);
    }
    net.declare(0, endpoint(b, 2, READER));
    assert_eq!(net.hosts[0].channels, [[0; 2]; 0], "nor later");
}

#[test]
fn the_channels_of_one_app_are_bounded() {
    let mut net = host();
    let a = net.attach(0);
    net.declare(0, endpoint(a, 1, WRITER));
    for _ in 0..70 {
        let slot = net.attach(0);
        net.declare(0, endpoint(slot, 1, READER));
    }
    assert_eq!(net.hosts[0].channels.len(), 64);
    let replies = net.replies(0);
    let over_loopback = |(_, remote): &&(u8, &RemoteEndpoint)| remote.unicast == [LOOPBACK.into()];
    let remotes = remotes(&replies);
    assert_eq!(remotes.iter().filter(over_loopback).count(), 2 * 6);
}

#[test]
fn channels_are_made_anew_when_both_apps_are_back_after_a_restart() {
    let (mut net, a, b) = connected();
    net.restart(0, with_channels());
    net.run(Duration::from_millis(100));
    assert_eq!(net.resume(0, a), a);
    let replies = net.replies(0);
    assert_eq!(matches(&replies).len(), 1);
    assert_eq!(remotes(&replies)[0].1.unicast, [local::address(b)]);
    assert_eq!(net.hosts[0].channels, [[0; 2]; 0], "one is not back yet");
    assert_eq!(net.resume(0, b), b);
    net.replies(0);
    assert_eq!(net.hosts[0].channels, [[a, b]]);
    for slot in [a, b] {
        net.declare(
            0,
            endpoint(slot, 1, if slot == a { WRITER } else { READER }),
        );
    }
    net.run(20 * SECOND);
    assert_eq!(net.hosts[0].channels.len(), 1);
}

#[test]
fn the_channel_of_an_app_that_does_not_come_back_is_closed() {
    let (mut net, a, b) = connected();
    net.restart(0, with_channels());
    net.resume(0, a);
    net.declare(0, endpoint(a, 1, WRITER));
    net.replies(0);
    net.run(20 * SECOND);
    let closed = (a, FromLayer::ChannelClosed { slot: b });
    assert!(net.replies(0).contains(&closed));
}
