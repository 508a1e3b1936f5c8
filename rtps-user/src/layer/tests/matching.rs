//! Endpoints that match, do not, and no longer do.

use std::net::SocketAddr;
use std::time::Duration;

use rtps_ebpf::SlotSet;

use super::sim::{Net, config, endpoint, hello, prefix, reliable};
use super::{READER, SECOND, WRITER, matched, matches, unmatched};
use crate::layer::StoreKey;
use crate::layer::protocol::{FromLayer, ToLayer};
use crate::qos::{PolicyId, Qos};
use crate::wire::EntityId;

#[test]
fn endpoints_of_two_hosts_match() {
    let mut net = Net::new(2);
    let (a, b) = (net.attach(0), net.attach(1));
    let writer = net.declare(0, endpoint(a, 1, WRITER));
    let reader = net.declare(1, endpoint(b, 1, READER));
    net.run(SECOND / 10);
    let [(1, FromLayer::Matched { local, remote })] = &net.replies(0)[..] else {
        panic!()
    };
    assert_eq!((*local, remote.guid), (writer.entity, reader));
    let user: SocketAddr = ([10, 0, 0, 2], 7411).into();
    assert_eq!(remote.unicast, [user]);
    assert_eq!(remote.qos, reliable());
    assert_eq!(matches(&net.replies(1)), [writer]);
    assert!(net.hosts[1].routes[&writer].contains(1));
    assert_eq!(net.hosts[1].peers, [prefix(1)].into());
}

#[test]
fn they_match_over_a_lossy_network_too() {
    for loss in [10, 20, 50] {
        let mut net = Net::new(2);
        net.loss = loss;
        let (a, b) = (net.attach(0), net.attach(1));
        let writer = net.declare(0, endpoint(a, 1, WRITER));
        let reader = net.declare(1, endpoint(b, 1, READER));
        net.run(30 * SECOND);
        assert_eq!(matches(&net.replies(0)), [reader], "{loss}");
        assert_eq!(matches(&net.replies(1)), [writer], "{loss}");
    }
}

#[test]
fn one_side_that_knows_the_other_is_enough_without_multicast() {
    let mut net = Net::new(0);
    for number in 1..=2 {
        let mut config = config(number);
        config.multicast.clear();
        if number == 1 {
            config.peers = vec![([10, 0, 0, 2], 7410).into()];
        }
        net.add(config);
    }
    let (a, b) = (net.attach(0), net.attach(1));
    let writer = net.declare(0, endpoint(a, 1, WRITER));
    net.declare(1, endpoint(b, 1, READER));
    net.run(60 * SECOND);
    assert_eq!(matches(&net.replies(1)), [writer]);
    assert_eq!(net.replies(0).len(), 1, "and the leases hold");
}

#[test]
fn apps_of_one_host_reach_each_other_over_loopback() {
    let mut net = Net::new(1);
    let (a, b) = (net.attach(0), net.attach(0));
    let writer = net.declare(0, endpoint(a, 1, WRITER));
    let reader = net.declare(0, endpoint(b, 1, READER));
    let own = net.declare(0, endpoint(a, 2, READER));
    let replies = net.replies(0);
    let mut found = matches(&replies);
    found.sort();
    let mut expected = [reader, own, writer, writer];
    expected.sort();
    assert_eq!(found, expected);
    for (_, message) in replies {
        if let FromLayer::Matched { remote, .. } = message {
            assert_eq!(remote.unicast, [([127, 0, 0, 1], 7411).into()]);
        }
    }
    let slots = |net: &Net| net.hosts[0].routes[&writer].iter().collect::<Vec<_>>();
    assert_eq!(slots(&net), [a, b]);
    net.request(0, b, ToLayer::Withdraw(reader.entity));
    assert_eq!(slots(&net), [a]);
}

#[test]
fn both_sides_are_told_of_policies_and_types_that_do_not_fit() {
    let mut net = Net::new(2);
    let (a, b) = (net.attach(0), net.attach(1));
    let mut best_effort = endpoint(a, 1, WRITER);
    best_effort.qos = Qos::default();
    net.declare(0, best_effort);
    let mut other_type = endpoint(a, 2, WRITER);
    other_type.type_name = "Other".to_owned();
    net.declare(0, other_type);
    net.declare(1, endpoint(b, 1, READER));
    net.run(SECOND);
    for host in 0..2 {
        let mut replies = net.replies(host);
        replies.sort_by_key(|(_, message)| matches!(message, FromLayer::InconsistentTopic { .. }));
        let [
            (_, FromLayer::IncompatibleQos { policy, .. }),
            (_, FromLayer::InconsistentTopic { .. }),
        ] = &replies[..]
        else {
            panic!("{replies:?}")
        };
        assert_eq!(*policy, PolicyId::Reliability);
    }
}

#[test]
fn changed_policies_end_and_begin_matches() {
    let (mut net, writer, reader) = matched();
    let mut changed = endpoint(1, 1, WRITER);
    changed.qos.partition.0 = vec!["elsewhere".to_owned()];
    net.declare(0, changed);
    net.run(SECOND);
    assert_eq!(net.replies(0), [unmatched(writer, reader)]);
    assert_eq!(net.replies(1), [unmatched(reader, writer)]);
    assert!(net.hosts[1].routes.is_empty());
    net.declare(0, endpoint(1, 1, WRITER));
    net.run(SECOND);
    assert_eq!(matches(&net.replies(0)), [reader]);
    assert_eq!(matches(&net.replies(1)), [writer]);
}

#[test]
fn the_endpoints_of_a_detached_app_are_gone_at_once() {
    let (mut net, writer, reader) = matched();
    net.hosts[0].layer.detach(net.now, 1);
    net.run(Duration::from_millis(50));
    assert_eq!(net.replies(1), [unmatched(reader, writer)]);
    assert!(net.hosts[1].routes.is_empty());
    net.run(SECOND);
    let is_about_an_endpoint = |key: &&StoreKey| key.0[0] == 3;
    let kept = net.hosts[0].store.keys().filter(is_about_an_endpoint);
    assert_eq!(kept.count(), 0, "all know");
}

#[test]
fn requests_that_make_no_sense_are_refused() {
    let mut net = Net::new(1);
    let (a, b) = (net.attach(0), net.attach(0));
    let mut nameless = endpoint(a, 1, WRITER);
    nameless.topic = String::new();
    let mut huge = endpoint(a, 1, WRITER);
    huge.qos.user_data = vec![0; 60_000];
    let mut builtin = endpoint(a, 1, WRITER);
    builtin.entity = EntityId::SEDP_PUBLICATIONS_WRITER;
    let declare = |endpoint| ToLayer::Declare(Box::new(endpoint));
    for request in [
        declare(endpoint(b, 1, WRITER)),
        declare(nameless),
        declare(huge),
        declare(builtin),
        ToLayer::Withdraw(EntityId::of_app(b, 1, WRITER)),
        ToLayer::Hello(hello()),
    ] {
        net.request(0, a, request);
        let replies = net.replies(0);
        assert!(
            matches!(&replies[..], [(slot, FromLayer::Refused { .. })] if *slot == a),
            "{replies:?}"
        );
    }
    let mut stranger = hello();
    stranger.domain = 1;
    let now = net.now;
    assert!(
        net.hosts[0]
            .layer
            .attach(now, &stranger, [0; 16], &SlotSet::EMPTY)
            .is_err()
    );
}
