//! Interfaces that go and come back, with other addresses and another MTU.

use nix::sys::signal::Signal;

use crate::support::{AppSocket, Netns, Rtpsd, hello, wait_until, welcome};

#[test]
fn an_interface_that_comes_back_is_attached_again() {
    let Some(netns) = Netns::new() else { return };
    let rtpsd = Rtpsd::start(&netns, &["--mode", "native"]);
    let first = netns.status().interfaces[0].index;
    netns.ip("link del veth0");
    netns.ip("link add veth0 type veth peer name veth1");
    netns.ip("link set veth0 up");
    netns.ip("addr add 10.99.0.1/24 dev veth0");
    assert!(wait_until(|| netns.has_xdp()));
    assert!(wait_until(|| netns.classifiers() == 1));
    let interfaces = netns.status().interfaces;
    assert_eq!(interfaces.len(), 1);
    assert!(wait_until(
        || netns.status().interfaces[0].answers == "kernel"
    ));
    assert_ne!(interfaces[0].index, first);
    assert!(netns.ip("maddr show dev veth0").contains("239.255.0.1"));
    assert!(rtpsd.end(Signal::SIGTERM));
    assert!(netns.is_clean());
}

#[test]
fn only_addresses_that_are_there_are_told_of() {
    let Some((here, there)) = Netns::pair() else {
        return;
    };
    here.ip("link add veth2 type veth peer name veth3");
    here.ip("link set veth3 up");
    let give_address = || {
        here.ip("link set veth2 up");
        here.ip("addr add 10.98.0.1/24 dev veth2");
    };
    give_address();
    let _rtpsd = Rtpsd::start(&here, &["--iface", "veth2"]);
    let _other = Rtpsd::start(&there, &[]);
    let tells_of = |address: &str| {
        let domains = there.status().domains.into_iter();
        let mut discovery = domains.filter_map(|domain| domain.discovery);
        discovery.any(|known| known.to_string().contains(address))
    };
    assert!(wait_until(|| tells_of("10.98.0.1") && tells_of("10.99.0.1")));
    here.ip("addr del 10.98.0.1/24 dev veth2");
    assert!(wait_until(|| !tells_of("10.98.0.1")));
    here.ip("addr add 10.98.0.1/24 dev veth2");
    assert!(wait_until(|| tells_of("10.98.0.1")));
    here.ip("link del veth2");
    assert!(wait_until(|| !tells_of("10.98.0.1")));
    here.ip("link add veth2 type veth peer name veth3");
    give_address();
    assert!(wait_until(|| tells_of("10.98.0.1") && tells_of("10.99.0.1")));
}

#[test]
fn apps_are_told_of_the_mtu_that_there_is() {
    let Some(netns) = Netns::new() else { return };
    let _rtpsd = Rtpsd::start(&netns, &[]);
    let datagram_size = || {
        let app = AppSocket::connect(&netns);
        let (message, _) = app.hello(hello(0, None));
        welcome(message).datagram_size
    };
    assert_eq!(datagram_size(), 1500 - 48);
    netns.ip("link set veth0 mtu 1300");
    assert!(wait_until(|| datagram_size() == 1300 - 48));
}
