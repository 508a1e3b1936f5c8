//! rtpsd in network namespaces: start, stop, kill, take over, and apps that misbehave.

mod steps;
mod support;

use std::net::UdpSocket;
use std::thread;
use std::time::Duration;

use aya::maps::{MapData, MapType};
use nix::sys::signal::{Signal, kill};
use rtps_user::layer::protocol::{
    CHANNEL_DESCRIPTORS, Endpoint, FromLayer, Resume, ToLayer, Welcome,
};
use rtps_user::local;
use rtps_user::qos::Qos;
use rtps_user::wire::{EntityId, EntityKind, Guid};
use rtpsd::AttachedMode;
use steps::kill_at;
use support::{AppSocket, Netns, Rtpsd, hello, run, wait_until};

fn welcome(message: FromLayer) -> Welcome {
    match message {
        FromLayer::Welcome(welcome) => welcome,
        other => panic!("no welcome but {other:?}"),
    }
}

#[test]
fn a_clean_stop_leaves_nothing() {
    let Some(netns) = Netns::new() else { return };
    let rtpsd = Rtpsd::start(
        &netns,
        &["--mode", "native", "--domain", "0", "--domain", "7"],
    );
    let status = netns.status();
    assert!(status.loaded);
    assert_eq!(status.rtpsd, Some(rtpsd.pid().as_raw()));
    assert_eq!(status.network_namespace, netns.inode);
    let [interface] = &status.interfaces[..] else {
        panic!("{:?}", status.interfaces);
    };
    assert_eq!(interface.name, "veth0");
    assert_eq!(interface.mode, AttachedMode::Native);
    let domains: Vec<u32> = status.domains.iter().map(|domain| domain.domain).collect();
    assert_eq!(domains, [0, 7]);
    assert!(
        status
            .domains
            .iter()
            .all(|domain| domain.discovery.is_some())
    );
    assert!(status.counters.contains_key("veth0") && status.counters.contains_key("other"));
    assert!(netns.has_xdp());
    assert!(rtpsd.end(Signal::SIGTERM));
    assert!(netns.is_clean());
    assert!(!netns.status().loaded);
}

#[test]
fn the_kernel_answers_until_unload() {
    let Some(netns) = Netns::new() else { return };
    let rtpsd = Rtpsd::start(&netns, &[]);
    let status = netns.status();
    assert_eq!(status.discovery.as_deref(), Some("kernel"));
    assert_eq!(status.interfaces[0].answers, "kernel");
    assert!(status.wakeups.is_some());
    assert_eq!(netns.classifiers(), 1);
    assert!(!rtpsd.end(Signal::SIGKILL));
    let orphaned = netns.status();
    assert_eq!(orphaned.interfaces[0].answers, "kernel");
    assert_eq!(orphaned.wakeups, None);
    assert_eq!(netns.classifiers(), 1);
    let _rtpsd = Rtpsd::start(&netns, &[]);
    assert_eq!(netns.classifiers(), 1, "attached twice");
    netns.within(|| rtpsd::unload().unwrap());
    assert!(netns.is_clean());
}

#[test]
fn rtpsd_answers_where_it_is_told_to_or_the_kernel_cannot() {
    let Some(netns) = Netns::new() else { return };
    let answers = || -> Vec<String> {
        let interfaces = netns.status().interfaces.into_iter();
        interfaces.map(|interface| interface.answers).collect()
    };
    let rtpsd = Rtpsd::start(&netns, &["--iface", "lo"]);
    assert_eq!(answers(), ["rtpsd: no Ethernet", "kernel"]);
    assert!(!rtpsd.end(Signal::SIGKILL));
    let rtpsd = Rtpsd::start(&netns, &["--discovery", "user", "--mode", "native"]);
    assert_eq!(answers(), ["rtpsd: `--discovery user`"]);
    assert_eq!(netns.status().discovery.as_deref(), Some("user"));
    assert!(wait_until(|| netns.classifiers() == 0));
    assert!(rtpsd.end(Signal::SIGTERM));
    assert!(netns.is_clean());
}

#[test]
fn an_interface_that_is_no_longer_asked_for_is_left_alone() {
    let Some(netns) = Netns::new() else { return };
    netns.ip("link add veth2 type veth peer name veth3");
    netns.ip("addr add 10.98.0.1/24 dev veth2");
    netns.ip("link set veth2 up");
    let rtpsd = Rtpsd::start(&netns, &["--iface", "veth2"]);
    assert_eq!(netns.status().interfaces.len(), 2);
    assert!(!rtpsd.end(Signal::SIGKILL));
    let _rtpsd = Rtpsd::start(&netns, &[]);
    assert_eq!(netns.status().interfaces.len(), 1);
    let links = netns.within(|| run("ls", &[netns.pins().to_str().unwrap()]));
    assert_eq!(links.matches("-ingress").count(), 1, "{links}");
    assert_eq!((netns.classifiers(), netns.fan_outs()), (1, 1));
}

#[test]
fn generic_mode_is_reported() {
    let Some(netns) = Netns::new() else { return };
    let _rtpsd = Rtpsd::start(&netns, &["--mode", "generic"]);
    assert_eq!(netns.status().interfaces[0].mode, AttachedMode::Generic);
    assert!(netns.ip("link show dev veth0").contains("xdpgeneric"));
}

#[test]
fn a_veth_is_left_in_one_piece() {
    let Some(netns) = Netns::new() else { return };
    let state = || {
        let mode = netns.status().interfaces[0].mode;
        (mode, netns.has_xdp(), netns.classifiers())
    };
    let by_user: [&str; 2] = ["--discovery", "user"];
    for (arguments, expected) in [
        (&[][..], (AttachedMode::Tc, false, 1)),
        (&by_user, (AttachedMode::Tc, false, 1)),
        (&["--mode", "native"], (AttachedMode::Native, true, 1)),
        (&["--mode", "generic"], (AttachedMode::Generic, true, 1)),
        (&["--mode", "tc"], (AttachedMode::Tc, false, 1)),
    ] {
        // What an earlier one has left is taken over, or makes room.
        let rtpsd = Rtpsd::start(&netns, arguments);
        assert!(
            wait_until(|| state() == expected),
            "{arguments:?}: {:?}",
            state()
        );
        assert!(!rtpsd.end(Signal::SIGKILL));
        assert_eq!(state(), expected, "{arguments:?}, killed");
    }
    netns.within(|| rtpsd::unload().unwrap());
    assert!(netns.is_clean());
}

#[test]
fn auto_mode_falls_back_to_generic() {
    let Some(netns) = Netns::new() else { return };
    // The loopback interface has no native XDP.
    let refused = Rtpsd::command(&netns, &["--iface", "lo", "--mode", "native"])
        .output()
        .unwrap();
    assert!(!refused.status.success());
    assert!(netns.is_clean());
    let _rtpsd = Rtpsd::start(&netns, &["--iface", "lo"]);
    let modes: Vec<AttachedMode> = netns.status().interfaces.iter().map(|i| i.mode).collect();
    assert_eq!(modes, [AttachedMode::Generic, AttachedMode::Tc]);
}

#[test]
fn a_killed_rtpsd_is_taken_over() {
    let Some(netns) = Netns::new() else { return };
    let rtpsd = Rtpsd::start(&netns, &["--mode", "native"]);
    let before = netns.status();
    assert!(!rtpsd.end(Signal::SIGKILL));
    let orphaned = netns.status();
    assert!(orphaned.loaded && orphaned.rtpsd.is_none());
    assert_eq!(orphaned.counters.len(), before.counters.len());
    assert!(netns.has_xdp());
    let who_fans_out = [before.fan_out.as_str(), orphaned.fan_out.as_str()];
    assert_eq!(who_fans_out, ["kernel"; 2]);
    assert_eq!(netns.fan_outs(), 1);
    let links = || {
        netns
            .within(|| run("ls", &["-i", netns.pins().to_str().unwrap()]))
            .lines()
            .find(|line| line.contains("xdp-"))
            .unwrap()
            .to_owned()
    };
    let link = links();
    let rtpsd = Rtpsd::start(&netns, &["--mode", "native"]);
    assert_eq!(links(), link, "the link was made anew");
    let after = netns.status();
    assert_eq!(after.domains[0].prefix, before.domains[0].prefix);
    assert_eq!(
        after.domains[0].participant_id,
        before.domains[0].participant_id
    );
    assert_eq!(
        after.domains[0].incarnation,
        before.domains[0].incarnation + 1
    );
    assert_eq!((after.fan_out.as_str(), netns.fan_outs()), ("kernel", 1));
    assert!(rtpsd.end(Signal::SIGINT));
    assert!(netns.is_clean());
}

#[test]
fn unload_cleans_up_after_a_kill() {
    let Some(netns) = Netns::new() else { return };
    let rtpsd = Rtpsd::start(&netns, &[]);
    assert!(!rtpsd.end(Signal::SIGKILL));
    let unloaded = netns.within(|| rtpsd::unload().unwrap());
    assert_eq!(unloaded.rtpsd, None);
    assert!(unloaded.leftovers);
    assert!(netns.is_clean());
    let again = netns.within(|| rtpsd::unload().unwrap());
    assert_eq!(again, rtpsd::Unloaded::default());
}

#[test]
fn unload_ends_a_running_and_a_stopped_rtpsd() {
    let Some(netns) = Netns::new() else { return };
    for stopped in [false, true] {
        let rtpsd = Rtpsd::start(&netns, &[]);
        if stopped {
            kill(rtpsd.pid(), Signal::SIGSTOP).unwrap();
        }
        let unloaded = netns.within(|| rtpsd::unload().unwrap());
        assert_eq!(unloaded.rtpsd, Some(rtpsd.pid().as_raw()));
        assert_eq!(unloaded.killed, stopped);
        assert!(netns.is_clean());
    }
}

#[test]
fn a_second_rtpsd_is_refused() {
    let Some(netns) = Netns::new() else { return };
    let first = Rtpsd::start(&netns, &[]);
    // It is still the one after it was asked for its status.
    assert!(netns.status().loaded);
    let second = Rtpsd::command(&netns, &[]).output().unwrap();
    assert!(!second.status.success());
    let log = String::from_utf8_lossy(&second.stderr);
    assert!(log.contains(&first.pid().to_string()), "{log}");
    assert!(netns.status().loaded);
}

#[test]
fn a_failed_start_leaves_nothing() {
    let Some(netns) = Netns::new() else { return };
    let output = Rtpsd::command(&netns, &["--iface", "nosuchif0"])
        .output()
        .unwrap();
    assert!(!output.status.success());
    assert!(String::from_utf8_lossy(&output.stderr).contains("nosuchif0"));
    assert!(netns.is_clean());
}

#[test]
fn an_app_gets_ring_and_bell_until_it_goes() {
    let Some(netns) = Netns::new() else { return };
    let _rtpsd = Rtpsd::start(&netns, &[]);
    let app = AppSocket::connect(&netns);
    let (message, descriptors) = app.hello(hello(0, None));
    let slot = welcome(message).slot;
    let kinds: Vec<MapType> = descriptors
        .into_iter()
        .map(|fd| MapData::from_fd(fd).unwrap().info().unwrap())
        .map(|info| info.map_type().unwrap())
        .collect();
    assert_eq!(kinds, [MapType::RingBuf, MapType::Array]);
    let status = netns.status();
    assert_eq!(status.apps.len(), 1);
    assert_eq!(status.apps[0].slot, slot);
    assert_eq!(status.apps[0].name, "test");
    assert_eq!(status.apps[0].pid, i32::try_from(std::process::id()).ok());
    assert_eq!(status.apps[0].ring_bytes, 1 << 20);
    assert_eq!(status.apps[0].ring_fill, 0);
    drop(app);
    assert!(wait_until(|| netns.status().apps.is_empty()));
}

#[test]
fn two_apps_get_a_channel_before_their_first_match() {
    let Some(netns) = Netns::new() else { return };
    let _rtpsd = Rtpsd::start(&netns, &[]);
    let kinds = [EntityKind::WriterNoKey, EntityKind::ReaderNoKey];
    let apps = kinds.map(|kind| {
        let app = AppSocket::connect(&netns);
        let slot = welcome(app.hello(hello(0, None)).0).slot;
        (app, slot, EntityId::of_app(slot, 1, kind))
    });
    for (app, _, entity) in &apps {
        app.send(&declaration(*entity));
    }
    let [(writer, a, _), (reader, b, _)] = apps;
    for (app, other) in [(&writer, b), (&reader, a)] {
        let (message, descriptors) = app.receive().unwrap();
        assert_eq!(message, FromLayer::Channel { slot: other });
        assert_eq!(descriptors.len(), CHANNEL_DESCRIPTORS);
        let Some((FromLayer::Matched { remote, .. }, _)) = app.receive() else {
            panic!("no match");
        };
        assert_eq!(remote.unicast, [local::address(other)]);
    }
    drop(reader);
    let unmatched = writer.receive().unwrap().0;
    assert!(matches!(unmatched, FromLayer::Unmatched { .. }));
    let closed = FromLayer::ChannelClosed { slot: b };
    assert_eq!(writer.receive().unwrap().0, closed);
}

#[test]
fn slots_are_the_hosts_not_a_domains() {
    let Some(netns) = Netns::new() else { return };
    let _rtpsd = Rtpsd::start(&netns, &["--domain", "0", "--domain", "1"]);
    let apps: Vec<(AppSocket, u8)> = [0, 1, 0, 1]
        .into_iter()
        .map(|domain| {
            let app = AppSocket::connect(&netns);
            let slot = welcome(app.hello(hello(domain, None)).0).slot;
            (app, slot)
        })
        .collect();
    let mut slots: Vec<u8> = apps.iter().map(|(_, slot)| *slot).collect();
    slots.sort_unstable();
    slots.dedup();
    assert_eq!(slots.len(), apps.len());
}

#[test]
fn an_app_keeps_slot_and_ring_over_a_kill() {
    let Some(netns) = Netns::new() else { return };
    let rtpsd = Rtpsd::start(&netns, &[]);
    let app = AppSocket::connect(&netns);
    let (message, _ring) = app.hello(hello(0, None));
    let first = welcome(message);
    rtpsd.end(Signal::SIGKILL);
    let _rtpsd = Rtpsd::start(&netns, &[]);
    let again = AppSocket::connect(&netns);
    let resume = Resume {
        slot: first.slot,
        token: first.token,
    };
    let (message, descriptors) = again.hello(hello(0, Some(resume)));
    let second = welcome(message);
    assert_eq!((second.slot, second.prefix), (first.slot, first.prefix));
    assert!(descriptors.is_empty());
    thread::sleep(Duration::from_secs(6));
    assert_eq!(netns.status().apps.len(), 1, "freed although it came back");
}

#[test]
fn an_app_that_does_not_come_back_is_forgotten() {
    let Some(netns) = Netns::new() else { return };
    let rtpsd = Rtpsd::start(&netns, &[]);
    let app = AppSocket::connect(&netns);
    welcome(app.hello(hello(0, None)).0);
    rtpsd.end(Signal::SIGKILL);
    let _rtpsd = Rtpsd::start(&netns, &[]);
    assert_eq!(netns.status().apps.len(), 1);
    assert!(wait_until(|| netns.status().apps.is_empty()));
}

#[test]
fn garbage_gets_a_reason_and_harms_nobody() {
    let Some(netns) = Netns::new() else { return };
    let _rtpsd = Rtpsd::start(&netns, &[]);
    let honest = AppSocket::connect(&netns);
    let slot = welcome(honest.hello(hello(0, None)).0).slot;
    let valid = postcard::to_stdvec(&ToLayer::Hello(hello(0, None))).unwrap();
    let truncated = (1..valid.len()).map(|length| valid[..length].to_vec());
    let garbage = [
        vec![0xff; 60_000],
        vec![0; 1],
        vec![0x80; 200],
        vec![0; 140_000],
    ];
    for bytes in truncated.chain(garbage) {
        let app = AppSocket::connect(&netns);
        assert!(app.send_raw(&bytes));
        assert!(!app.refusal().is_empty());
        assert!(app.receive().is_none());
    }
    let early = AppSocket::connect(&netns);
    early.send(&ToLayer::Withdraw(EntityId::of_app(
        slot,
        1,
        EntityKind::ReaderNoKey,
    )));
    assert!(early.refusal().contains("hello"));
    let mut old = hello(0, None);
    old.version += 1;
    let unserved = hello(5, None);
    for (hello, hint) in [(old, "version"), (unserved, "--domain 5")] {
        let app = AppSocket::connect(&netns);
        app.send(&ToLayer::Hello(hello));
        let reason = app.refusal();
        assert!(reason.contains(hint), "{reason}");
    }
    let status = netns.status();
    assert_eq!(status.apps.len(), 1);
    assert_eq!(status.apps[0].slot, slot);
}

#[test]
fn silent_connections_cannot_keep_apps_out() {
    let Some(netns) = Netns::new() else { return };
    let _rtpsd = Rtpsd::start(&netns, &[]);
    let silent: Vec<AppSocket> = (0..400).map(|_| AppSocket::connect(&netns)).collect();
    assert!(silent[0].refusal().contains("hello"));
    let app = AppSocket::connect(&netns);
    welcome(app.hello(hello(0, None)).0);
}

#[test]
fn two_hosts_match_their_apps_and_survive_a_restart_unnoticed() {
    let Some((here, there)) = Netns::pair() else {
        return;
    };
    let (first, _second) = (Rtpsd::start(&here, &[]), Rtpsd::start(&there, &[]));
    let (writing, reading) = (AppSocket::connect(&here), AppSocket::connect(&there));
    let writer_host = welcome(writing.hello(hello(0, None)).0);
    let reader_host = welcome(reading.hello(hello(0, None)).0);
    let writer = EntityId::of_app(writer_host.slot, 1, EntityKind::WriterNoKey);
    let reader = EntityId::of_app(reader_host.slot, 1, EntityKind::ReaderNoKey);
    writing.send(&declaration(writer));
    reading.send(&declaration(reader));
    assert_eq!(writing.matched(), Guid::new(reader_host.prefix, reader));
    assert_eq!(reading.matched(), Guid::new(writer_host.prefix, writer));
    drop(first);
    let _first = Rtpsd::start(&here, &[]);
    let again = AppSocket::connect(&here);
    let resume = Resume {
        slot: writer_host.slot,
        token: writer_host.token,
    };
    welcome(again.hello(hello(0, Some(resume))).0);
    again.send(&declaration(writer));
    assert!(
        reading.is_silent_for(Duration::from_secs(7)),
        "the other host noticed"
    );
    drop(again);
    let (message, _) = reading.receive().unwrap();
    assert_eq!(
        message,
        FromLayer::Unmatched {
            local: reader,
            remote: Guid::new(writer_host.prefix, writer)
        }
    );
}

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

#[test]
fn what_is_no_longer_served_is_forgotten() {
    let Some(netns) = Netns::new() else { return };
    let rtpsd = Rtpsd::start(&netns, &["--domain", "0", "--domain", "7"]);
    let before = netns.status().domains;
    assert!(!rtpsd.end(Signal::SIGKILL));
    let rtpsd = Rtpsd::start(&netns, &["--domain", "0", "--domain", "9"]);
    let after = netns.status().domains;
    let ids: Vec<u32> = after.iter().map(|domain| domain.domain).collect();
    assert_eq!(ids, [0, 9]);
    assert_eq!(after[0].prefix, before[0].prefix);
    let pins = run("ls", &[netns.pins().to_str().unwrap()]);
    assert!(
        !pins.contains("store-7") && pins.contains("store-9"),
        "{pins}"
    );
    assert!(!rtpsd.end(Signal::SIGKILL));
    let _rtpsd = Rtpsd::start(&netns, &["--domain", "7"]);
    let again = netns.status().domains;
    assert_ne!(again[0].prefix, before[1].prefix);
}

#[test]
fn a_kill_at_any_step_leaves_nothing_that_stays() {
    /// Not all, for the sake of time; of what is done one after the other, each kind of step.
    const STRIDE: usize = 11;
    let Some(netns) = Netns::new() else { return };
    for step in (1..).step_by(STRIDE) {
        let was_killed = netns.within(|| kill_at(step));
        if step % 2 == 1 {
            netns.within(|| rtpsd::unload().unwrap());
        } else {
            assert!(Rtpsd::start(&netns, &[]).end(Signal::SIGTERM));
        }
        assert!(netns.is_clean(), "after step {step}");
        if !was_killed {
            assert!(step > 5 * STRIDE, "only {step} steps");
            return;
        }
    }
}

#[test]
fn datagrams_reach_the_ring_through_xdp_and_the_filter() {
    datagrams_reach_the_ring(&["--mode", "native"], "xdp_messages");
}

#[test]
fn datagrams_reach_the_ring_through_tc_and_the_filter() {
    datagrams_reach_the_ring(&["--mode", "tc"], "ingress_messages");
    datagrams_reach_the_ring(&["--discovery", "user"], "ingress_messages");
}

fn datagrams_reach_the_ring(arguments: &[&str], counter: &str) {
    let Some((here, there)) = Netns::pair() else {
        return;
    };
    let _rtpsd = Rtpsd::start(&here, arguments);
    let app = AppSocket::connect(&here);
    let slot = welcome(app.hello(hello(0, None)).0).slot;
    let delivered = |interface: &str| here.status().counters[interface]["delivered_records"];
    let fill = || here.status().apps[0].ring_fill;
    let reader = EntityId::of_app(slot, 1, EntityKind::ReaderNoKey);
    there.within(|| send_data(reader, "10.99.0.1:7411"));
    assert!(wait_until(|| delivered("veth0") == 1));
    let from_outside = fill();
    assert!(from_outside > 0);
    here.within(|| send_data(reader, "127.0.0.1:7411"));
    assert!(wait_until(|| delivered("lo") == 1));
    assert!(fill() > from_outside);
    let counters = here.status().counters;
    assert_eq!(counters["veth0"][counter], 1);
    assert_eq!(counters["lo"]["filter_messages"], 1);
}

/// A message with one DATA submessage (RTPS 2.5, 9.4.5.4).
fn send_data(reader: EntityId, to: &str) {
    let mut message = b"RTPS\x02\x05\0\0ABCDEFGHIJKL".to_vec();
    message.extend([0x15, 0x05, 28, 0, 0, 0, 16, 0]);
    message.extend(reader.0);
    message.extend([0, 0, 1, 0x03]);
    message.extend([0, 0, 0, 0, 1, 0, 0, 0]);
    message.extend([0, 1, 0, 0, 1, 2, 3, 4]);
    let socket = UdpSocket::bind("0.0.0.0:0").unwrap();
    socket.send_to(&message, to).unwrap();
}

fn declaration(entity: EntityId) -> ToLayer {
    ToLayer::Declare(Box::new(Endpoint {
        entity,
        topic: "topic".into(),
        type_name: "type".into(),
        type_information: Vec::new(),
        type_objects: Vec::new(),
        content_filter: None,
        qos: Qos::default(),
    }))
}
