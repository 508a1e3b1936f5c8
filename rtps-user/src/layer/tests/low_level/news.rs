//! What remote participants say of their endpoints, and is answered: kept by the low-level layer, taken by the layer.

use std::collections::BTreeSet;

use super::super::{READER, SECOND, WRITER, matches, unmatched};
use super::{hosts, matched, sorted};
use crate::layer::protocol::ToLayer;
use crate::layer::tests::sim::endpoint;

#[test]
fn everything_is_discovered_whatever_the_network_does() {
    for loss in [0, 10, 30] {
        for answers in [[true, false], [true, true]] {
            let mut net = hosts(&answers);
            net.loss = loss;
            net.is_disorderly = true;
            let (a, b) = (net.attach(0), net.attach(1));
            let mut declared = [Vec::new(), Vec::new()];
            for serial in 1..=20 {
                declared[0].push(net.declare(0, endpoint(a, serial, WRITER)));
                declared[1].push(net.declare(1, endpoint(b, serial, READER)));
                net.run(SECOND / 20);
            }
            net.run(20 * SECOND);
            for (host, expected) in [(0, &declared[1]), (1, &declared[0])] {
                let found: BTreeSet<_> = matches(&net.replies(host)).into_iter().collect();
                let expected = expected.iter().copied().collect();
                assert_eq!(found, expected, "host {host} of {answers:?}, loss {loss}");
            }
            for reader in &declared[1][..10] {
                net.request(1, b, ToLayer::Withdraw(reader.entity));
            }
            net.run(20 * SECOND);
            let told = net.replies(0);
            for reader in &declared[1][..10] {
                let gone = unmatched(declared[0][0], *reader);
                assert!(told.contains(&gone), "{answers:?}, loss {loss}");
            }
            assert_eq!(net.hosts[0].layer.unacknowledged().count(), 0);
        }
    }
}

#[test]
fn the_low_level_layer_alone_makes_the_host_known() {
    let mut net = hosts(&[true, false]);
    let a = net.attach(0);
    let mut writers: Vec<_> = (1..=30)
        .map(|serial| net.declare(0, endpoint(a, serial, WRITER)))
        .collect();
    net.request(0, a, ToLayer::Withdraw(writers.remove(3).entity));
    net.hosts[1].is_connected = false;
    net.run(SECOND);
    net.hosts[0].is_stopped = true;
    net.hosts[1].is_connected = true;
    let b = net.attach(1);
    net.declare(1, endpoint(b, 1, READER));
    net.run(8 * SECOND);
    assert_eq!(sorted(matches(&net.replies(1))), writers);
    net.wake(0);
    net.run(SECOND);
    assert_eq!(matches(&net.replies(0)).len(), 29, "news were kept");
}

#[test]
fn nothing_is_acknowledged_that_could_not_be_handed_over() {
    let (mut net, writer, reader) = matched();
    net.hosts[0].is_stopped = true;
    net.kernel(0).capacity = 3;
    let mut readers = vec![reader];
    for serial in 2..=12 {
        readers.push(net.declare(1, endpoint(reader.entity.slot(), serial, READER)));
        net.run(SECOND / 10);
    }
    net.request(1, 1, ToLayer::Withdraw(reader.entity));
    net.run(SECOND);
    assert!(net.kernel(0).refused > 0);
    assert_ne!(net.hosts[1].layer.unacknowledged().count(), 0);
    net.wake(0);
    net.run(10 * SECOND);
    let told = net.replies(0);
    assert_eq!(sorted(matches(&told)), readers[1..]);
    assert!(told.contains(&unmatched(writer, reader)));
    assert_eq!(net.hosts[1].layer.unacknowledged().count(), 0);
}

#[test]
fn where_the_low_level_layer_may_not_answer_the_layer_does() {
    let mut net = hosts(&[true, false]);
    net.kernel(0).may_answer = false;
    net.loss = 20;
    let (a, b) = (net.attach(0), net.attach(1));
    let writers: Vec<_> = (1..=10)
        .map(|serial| net.declare(0, endpoint(a, serial, WRITER)))
        .collect();
    let mut supervised = endpoint(b, 1, READER);
    supervised.topic = "Circle".to_owned();
    net.declare(1, supervised);
    let reader = net.declare(1, endpoint(b, 2, READER));
    net.request(1, b, ToLayer::AssertLiveliness);
    net.run(20 * SECOND);
    assert_eq!(
        sorted(matches(&net.replies(1)))
            .into_iter()
            .collect::<BTreeSet<_>>(),
        writers.into_iter().collect()
    );
    let found: BTreeSet<_> = matches(&net.replies(0)).into_iter().collect();
    assert_eq!(found, [reader].into());
    for host in 0..2 {
        assert_eq!(net.hosts[host].layer.unacknowledged().count(), 0, "{host}");
    }
}
