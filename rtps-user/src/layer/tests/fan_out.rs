//! Lists of destinations: an app gets those that it is matched with.

use std::net::SocketAddrV4;

use super::sim::{Net, endpoint};
use super::{READER, SECOND, WRITER};
use crate::layer::protocol::{FanOut, FromLayer, ToLayer};
use crate::layer::{KernelChange, LayerOutput};

/// Where the apps of a host of the simulation receive samples.
fn user(number: u8) -> SocketAddrV4 {
    SocketAddrV4::new([10, 0, 0, number].into(), 7411)
}

fn list(number: u8, destinations: Vec<SocketAddrV4>) -> FanOut {
    FanOut {
        cookie: 42,
        number,
        destinations,
    }
}

/// A writer on the first of four hosts that is matched with readers on the second and third, and its app.
fn matched() -> (Net, u8) {
    let mut net = Net::new(4);
    let app = net.attach(0);
    net.declare(0, endpoint(app, 1, WRITER));
    for host in [1, 2] {
        let slot = net.attach(host);
        net.declare(host, endpoint(slot, 1, READER));
    }
    net.run(SECOND);
    net.replies(0);
    (net, app)
}

/// What the first host's layer wants done for a list.
fn outputs(net: &mut Net, app: u8, list: FanOut) -> Vec<LayerOutput> {
    let now = net.now;
    let layer = &mut net.hosts[0].layer;
    layer.handle_request(now, app, ToLayer::FanOut(list));
    std::iter::from_fn(|| layer.poll_output(now, &mut Vec::new())).collect()
}

fn answer(slot: u8, number: u8) -> LayerOutput {
    let message = FromLayer::FanOut {
        number,
        destinations: Vec::new(),
    };
    LayerOutput::Reply { slot, message }
}

#[test]
fn the_kernel_sends_to_those_that_are_matched() {
    let (mut net, slot) = matched();
    let strangers = [user(4), "10.9.9.9:7411".parse().unwrap()];
    let mut wanted = vec![user(2), user(3)];
    wanted.extend(strangers);
    let change = KernelChange::FanOut {
        slot,
        fan_out: list(1, vec![user(2), user(3)]),
    };
    let expected = [LayerOutput::Kernel(change)];
    assert_eq!(outputs(&mut net, slot, list(1, wanted)), expected);
    let other = net.attach(0);
    net.replies(0);
    let wanted = list(1, vec![user(2), user(3)]);
    assert_eq!(outputs(&mut net, other, wanted), [answer(other, 1)]);
}

#[test]
fn one_destination_is_left_to_the_app() {
    let (mut net, slot) = matched();
    let wanted = list(16, vec![user(2), user(4)]);
    assert_eq!(outputs(&mut net, slot, wanted), [answer(slot, 16)]);
}

#[test]
fn numbers_are_few() {
    let (mut net, slot) = matched();
    for number in [0, 17, 255] {
        let outputs = outputs(&mut net, slot, list(number, vec![user(2), user(3)]));
        let [LayerOutput::Reply { message, .. }] = outputs.as_slice() else {
            panic!("{outputs:?}");
        };
        assert!(
            matches!(message, FromLayer::Refused { .. }),
            "{number}: {message:?}"
        );
    }
}
