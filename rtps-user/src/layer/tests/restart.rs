//! A layer that is started anew, as others see it.

use super::sim::{Net, config, endpoint};
use super::{READER, SECOND, WRITER, matched, matches, unmatched};
use crate::layer::protocol::ToLayer;

/// Starts the first host's layer anew.
fn restart(net: &mut Net) {
    let mut next = config(1);
    next.count_age = 60 * SECOND;
    net.restart(0, next);
}

#[test]
fn a_restart_goes_unnoticed() {
    let (mut net, writer, reader) = matched();
    let samples = net.endpoint_samples;
    restart(&mut net);
    assert_eq!(net.resume(0, 1), 1);
    assert_eq!(matches(&net.replies(0)), [reader], "told again, to be sure");
    net.declare(0, endpoint(1, 1, WRITER));
    net.run(40 * SECOND);
    assert_eq!(net.endpoint_samples, samples, "nothing is sent again");
    assert_eq!(net.replies(1), [], "nothing has happened");
    assert_eq!(net.replies(0), []);
    net.hosts[0].layer.detach(net.now, 1);
    net.run(SECOND);
    assert_eq!(net.replies(1), [unmatched(reader, writer)]);
}

#[test]
fn news_during_a_restart_arrive_afterwards() {
    let (mut net, writer, reader) = matched();
    net.hosts[0].is_connected = false;
    net.request(1, 1, ToLayer::Withdraw(reader.entity));
    let second = net.declare(1, endpoint(1, 2, READER));
    net.run(SECOND);
    net.hosts[0].is_connected = true;
    restart(&mut net);
    net.run(4 * SECOND);
    assert_eq!(net.replies(0), [], "the app is not back yet");
    net.resume(0, 1);
    net.declare(0, endpoint(1, 1, WRITER));
    let replies = net.replies(0);
    assert_eq!(matches(&replies), [reader, second]);
    assert!(replies.contains(&unmatched(writer, reader)));
}

#[test]
fn what_does_not_come_back_after_a_restart_is_withdrawn() {
    for comes_back in [true, false] {
        let (mut net, writer, reader) = matched();
        let second = net.declare(0, endpoint(1, 2, WRITER));
        net.run(SECOND);
        assert_eq!(matches(&net.replies(1)), [second]);
        restart(&mut net);
        if comes_back {
            net.resume(0, 1);
            net.declare(0, endpoint(1, 2, WRITER));
        }
        net.run(4 * SECOND);
        assert_eq!(net.replies(1), []);
        net.run(4 * SECOND);
        let mut gone = vec![unmatched(reader, writer)];
        if !comes_back {
            gone.push(unmatched(reader, second));
        }
        assert_eq!(net.replies(1), gone);
        let apps = net.hosts[0].layer.status().apps;
        assert_eq!(apps.len(), usize::from(comes_back));
    }
}

#[test]
fn a_withdrawal_survives_a_restart() {
    let (mut net, writer, reader) = matched();
    net.hosts[1].is_connected = false;
    net.request(0, 1, ToLayer::Withdraw(writer.entity));
    restart(&mut net);
    net.hosts[1].is_connected = true;
    net.run(6 * SECOND);
    assert_eq!(net.replies(1), [unmatched(reader, writer)]);
}

#[test]
fn what_is_too_large_for_the_store_is_asked_for_again() {
    let (mut net, writer, _) = matched();
    let mut large = endpoint(1, 2, READER);
    large.qos.partition.0 = (0..200)
        .map(|number| format!("partition {number:20}"))
        .collect();
    large.qos.partition.0.push(String::new());
    let large = net.declare(1, large);
    net.run(SECOND);
    assert_eq!(matches(&net.replies(0)), [large]);
    assert_eq!(matches(&net.replies(1)), [writer]);
    restart(&mut net);
    net.run(SECOND);
    net.resume(0, 1);
    assert!(matches(&net.replies(0)).contains(&large));
    assert_eq!(net.replies(1), [], "the writer was there all the time");
}

#[test]
fn records_of_another_version_are_skipped() {
    let (mut net, _, _) = matched();
    for value in net.hosts[0].store.values_mut() {
        value.insert(0, 0xff);
    }
    restart(&mut net);
    net.run(SECOND);
    assert!(net.hosts[0].layer.status().apps.is_empty());
    assert_eq!(net.hosts[0].layer.status().participants.len(), 1);
}
