//! Participants and writers that live, leave, or fall silent.

use std::time::Duration;

use super::sim::{Net, endpoint, prefix};
use super::{READER, SECOND, WRITER, matched, unmatched};
use crate::layer::StoreKey;
use crate::layer::protocol::{FromLayer, MAX_USER_DATA, ToLayer};
use crate::qos::{Liveliness, LivelinessKind};
use crate::wire;

#[test]
fn a_leaving_host_is_forgotten_at_once_and_a_silent_one_after_its_lease() {
    for leaves in [true, false] {
        let (mut net, writer, reader) = matched();
        if leaves {
            net.hosts[0].layer.shutdown(net.now);
            net.run(Duration::from_millis(50));
        } else {
            net.hosts[0].is_connected = false;
            net.run(12 * SECOND);
            assert_eq!(net.replies(1), []);
            net.run(10 * SECOND);
        }
        assert_eq!(net.replies(1), [unmatched(reader, writer)]);
        assert!(net.hosts[1].peers.is_empty());
        assert!(net.hosts[1].layer.status().participants.is_empty());
        let is_of_others = |key: &&StoreKey| key.0[0] > 4;
        let kept = net.hosts[1].store.keys().filter(is_of_others);
        assert_eq!(kept.count(), 0);
    }
}

#[test]
fn traffic_that_the_kernel_saw_renews_the_lease() {
    let (mut net, _, _) = matched();
    net.hosts[0].is_connected = false;
    for _ in 0..30 {
        net.run(SECOND);
        net.hosts[1].layer.seen(net.now, prefix(1));
    }
    assert_eq!(net.replies(1), []);
}

#[test]
fn after_a_broken_connection_all_is_found_again() {
    let (mut net, writer, reader) = matched();
    net.hosts[0].is_connected = false;
    net.run(30 * SECOND);
    assert_eq!(net.replies(0), [unmatched(writer, reader)]);
    assert_eq!(net.replies(1), [unmatched(reader, writer)]);
    net.hosts[0].is_connected = true;
    net.run(6 * SECOND);
    assert_eq!(super::matches(&net.replies(0)), [reader]);
    assert_eq!(super::matches(&net.replies(1)), [writer]);
}

#[test]
fn new_addresses_reach_the_others() {
    let (mut net, writer, reader) = matched();
    let (metatraffic, user) = ("10.0.9.9:7410", "10.0.9.9:7411");
    let told = |net: &mut Net| {
        let addresses = [metatraffic, user].map(|address| vec![address.parse().unwrap()]);
        let [metatraffic, user] = addresses;
        let now = net.now;
        net.hosts[0].layer.set_addresses(now, metatraffic, user);
        net.run(SECOND);
    };
    told(&mut net);
    let replies = net.replies(1);
    let [(_, FromLayer::Matched { local, remote })] = replies.as_slice() else {
        panic!("{replies:?}");
    };
    assert_eq!((*local, remote.guid), (reader.entity, writer));
    assert_eq!(remote.unicast, [user.parse().unwrap()]);
    told(&mut net);
    assert_eq!(net.replies(1), []);
    // Without any the host cannot be heard, and those of before may come back.
    let now = net.now;
    net.hosts[0].layer.set_addresses(now, vec![], vec![]);
    net.run(SECOND);
    told(&mut net);
    assert_eq!(net.replies(1), []);
}

#[test]
fn liveliness_is_asserted_for_automatic_writers_and_on_demand() {
    let mut net = Net::new(2);
    let (a, b) = (net.attach(0), net.attach(1));
    let mut writer = endpoint(a, 1, WRITER);
    writer.qos.liveliness = Liveliness {
        kind: LivelinessKind::Automatic,
        lease: wire::Duration {
            seconds: 3,
            fraction: 0,
        },
    };
    net.declare(0, writer);
    net.declare(1, endpoint(b, 1, READER));
    net.run(SECOND / 2);
    net.replies(1);
    net.run(9 * SECOND);
    let participant = prefix(1);
    let assertion = |manual| {
        let message = FromLayer::Liveliness {
            participant,
            manual,
        };
        (b, message)
    };
    assert_eq!(net.replies(1), vec![assertion(false); 9]);
    net.request(0, a, ToLayer::AssertLiveliness);
    net.run(Duration::from_millis(10));
    assert_eq!(net.replies(1), [assertion(true)]);
}

#[test]
fn others_see_the_user_data_of_an_app_while_it_is_there() {
    let (mut net, _, _) = matched();
    let seen = |net: &mut Net, wanted: &[u8]| {
        net.run(SECOND);
        let mut participants = net.hosts[1].layer.discovery.participants();
        assert_eq!(participants.next().unwrap().data.user_data, wanted);
    };
    let [a, b] = [net.attach(0), net.attach(0)];
    seen(&mut net, b"");
    net.request(0, a, ToLayer::Describe(b"a".to_vec()));
    seen(&mut net, b"a");
    net.request(0, b, ToLayer::Describe(b"b".to_vec()));
    seen(&mut net, b"b");
    net.hosts[0].layer.detach(net.now, b);
    seen(&mut net, b"a");
    net.replies(0);
    net.request(0, a, ToLayer::Describe(vec![0; MAX_USER_DATA + 1]));
    assert!(matches!(
        net.replies(0)[..],
        [(_, FromLayer::Refused { .. })]
    ));
    seen(&mut net, b"a");
}
