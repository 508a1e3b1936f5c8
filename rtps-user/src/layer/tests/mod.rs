//! Layers that discover each other in virtual time.

mod browse;
mod channels;
mod equality;
mod fan_out;
mod hostile;
mod kernel;
mod low_level;
mod matching;
mod messages;
mod presence;
mod restart;
mod sim;

use std::time::Duration;

use super::protocol::FromLayer;
use crate::wire::{EntityKind, Guid};
use sim::{Net, endpoint};

const SECOND: Duration = Duration::from_secs(1);
const WRITER: EntityKind = EntityKind::WriterWithKey;
const READER: EntityKind = EntityKind::ReaderWithKey;

/// Two hosts, a writer on the first and a reader on the second, matched; what their apps were told of it is taken.
fn matched() -> (Net, Guid, Guid) {
    matched_in(Net::new(2))
}

/// The same between two hosts that are there.
fn matched_in(mut net: Net) -> (Net, Guid, Guid) {
    let (a, b) = (net.attach(0), net.attach(1));
    let writer = net.declare(0, endpoint(a, 1, WRITER));
    let reader = net.declare(1, endpoint(b, 1, READER));
    net.run(SECOND);
    assert_eq!(matches(&net.replies(0)), [reader]);
    assert_eq!(matches(&net.replies(1)), [writer]);
    (net, writer, reader)
}

/// The remote endpoints that apps were told of.
fn matches(replies: &[(u8, FromLayer)]) -> Vec<Guid> {
    replies
        .iter()
        .filter_map(|(_, message)| match message {
            FromLayer::Matched { remote, .. } => Some(remote.guid),
            _ => None,
        })
        .collect()
}

/// What an app is told when a match is over.
fn unmatched(local: Guid, remote: Guid) -> (u8, FromLayer) {
    let local = local.entity;
    (local.slot(), FromLayer::Unmatched { local, remote })
}
