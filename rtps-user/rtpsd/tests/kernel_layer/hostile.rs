//! Apps that misbehave at the Unix socket.

use rtps_user::layer::protocol::ToLayer;
use rtps_user::wire::{EntityId, EntityKind};

use crate::support::{AppSocket, Netns, Rtpsd, hello, welcome};

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
