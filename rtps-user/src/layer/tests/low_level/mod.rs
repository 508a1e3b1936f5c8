//! Layers on top of a low-level layer that answers discovery messages.

mod endpoints;
mod invented;
mod presence;
mod progress;
mod restart;
mod strangers;

use super::matched_in;
use super::sim::{Net, config};
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
    matched_in(hosts(&[true, false]))
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
