//! Apps at the Unix socket: what they get, their channels and matches, and how they outlive a restart of rtpsd.

use std::thread;
use std::time::Duration;

use aya::maps::{MapData, MapType};
use nix::sys::signal::Signal;
use rtps_user::layer::protocol::{CHANNEL_DESCRIPTORS, FromLayer, Resume};
use rtps_user::local;
use rtps_user::wire::{EntityId, EntityKind, Guid};

use crate::support::{AppSocket, Netns, Rtpsd, declaration, hello, wait_until, welcome};

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
