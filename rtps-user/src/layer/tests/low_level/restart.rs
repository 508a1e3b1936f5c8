//! A layer that is started anew above a low-level layer that has gone on.

use std::collections::BTreeSet;

use super::{hosts, matched, restarted};
use crate::layer::tests::sim::endpoint;
use crate::layer::tests::{READER, SECOND, WRITER, matches, unmatched};
use crate::wire::Guid;

#[test]
fn a_restart_goes_unnoticed() {
    let (mut net, writer, reader) = matched();
    let samples = net.endpoint_samples;
    let kept = net.kernel(0).peers.clone();
    let next = restarted(&mut net);
    net.restart(0, next);
    assert_eq!(net.resume(0, 1), 1);
    assert_eq!(matches(&net.replies(0)), [reader]);
    let progress = |peer: &rtps_ebpf::abi::Peer| peer.writers.map(|writer| writer.next);
    for (prefix, peer) in kept {
        assert_eq!(progress(&peer), progress(&net.kernel(0).peers[&prefix]));
    }
    net.declare(0, endpoint(1, 1, WRITER));
    net.run(40 * SECOND);
    assert_eq!(net.endpoint_samples, samples, "nothing is sent again");
    assert_eq!(net.replies(1), []);
    let second = net.declare(1, endpoint(1, 2, READER));
    net.run(SECOND);
    assert_eq!(matches(&net.replies(0)), [second]);
    assert_eq!(matches(&net.replies(1)), [writer]);
    net.hosts[0].layer.detach(net.now, 1);
    net.run(SECOND);
    assert_eq!(
        net.replies(1),
        [unmatched(reader, writer), unmatched(second, writer)]
    );
}

#[test]
fn a_restart_in_the_middle_loses_nothing() {
    for loss in [0, 20] {
        let mut net = hosts(&[true, false]);
        net.loss = loss;
        net.is_disorderly = true;
        let (a, b) = (net.attach(0), net.attach(1));
        let mut declared = [Vec::new(), Vec::new()];
        for serial in 1..=20 {
            if serial % 7 == 0 {
                let next = restarted(&mut net);
                net.restart(0, next);
                net.resume(0, a);
                for earlier in 1..serial {
                    net.declare(0, endpoint(a, earlier, WRITER));
                }
            }
            declared[0].push(net.declare(0, endpoint(a, serial, WRITER)));
            declared[1].push(net.declare(1, endpoint(b, serial, READER)));
            net.run(SECOND / 50);
        }
        net.run(20 * SECOND);
        for (host, expected) in [(0, &declared[1]), (1, &declared[0])] {
            let status = net.hosts[host].layer.status();
            let [other] = status.participants.as_slice() else {
                panic!("{:?}", status.participants);
            };
            let found: BTreeSet<_> = other
                .endpoints
                .iter()
                .map(|known| known.guid.clone())
                .collect();
            let expected = expected.iter().map(Guid::to_string).collect();
            assert_eq!(found, expected, "host {host}, loss {loss}");
            assert_eq!(net.hosts[host].layer.unacknowledged().count(), 0);
        }
    }
}

#[test]
fn what_a_layer_took_and_lost_is_asked_for_again_by_the_next() {
    let (mut net, _, reader) = matched();
    net.hosts[0].is_stopped = true;
    let second = net.declare(1, endpoint(1, 2, READER));
    net.run(SECOND);
    net.hosts[0].is_stopped = false;
    // Taken from the low-level layer, but not dealt with.
    net.kernel(0).news.clear();
    let next = restarted(&mut net);
    net.restart(0, next);
    net.resume(0, 1);
    net.declare(0, endpoint(1, 1, WRITER));
    // The writer thinks that all is acknowledged; the next news tells.
    let third = net.declare(1, endpoint(1, 3, READER));
    net.run(10 * SECOND);
    assert_eq!(matches(&net.replies(0)), [reader, second, third]);
}
