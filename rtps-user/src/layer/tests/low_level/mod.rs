//! Layers on top of a low-level layer that answers discovery messages.

mod endpoints;
mod invented;
mod presence;
mod progress;
mod restart;
mod strangers;

use super::sim::{Net, config, endpoint};
use super::{READER, SECOND, WRITER, matches};
use crate::layer::LayerConfig;
use crate::wire::Guid;

/// Hosts of which those that `answers` names have a low-level layer that answers.
fn hosts(answers: &[bool]) -> Net {
    let mut net = Net::new(0);
    for (number, answers) in (1..).zip(answers) {
        if *answers {
            net.add_with_kernel(config(number));
        } else {
            net.add(config(number));
        }
    }
    net
}

/// The first with a low-level layer that answers, a writer on it and a reader on the second, matched.
fn matched() -> (Net, Guid, Guid) {
    let mut net = hosts(&[true, false]);
    let (a, b) = (net.attach(0), net.attach(1));
    let writer = net.declare(0, endpoint(a, 1, WRITER));
    let reader = net.declare(1, endpoint(b, 1, READER));
    net.run(SECOND);
    assert_eq!(matches(&net.replies(0)), [reader]);
    assert_eq!(matches(&net.replies(1)), [writer]);
    (net, writer, reader)
}

fn restarted(net: &mut Net) -> LayerConfig {
    let now = net.now;
    LayerConfig {
        kernel_discovery: true,
        count_age: net.kernel(0).count_age(now),
        ..config(1)
    }
}

fn sorted(mut guids: Vec<Guid>) -> Vec<Guid> {
    guids.sort();
    guids
}
