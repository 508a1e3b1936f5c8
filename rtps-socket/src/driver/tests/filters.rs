//! What readers announce that they want is what they are sent, as far as the writer understands it.

use rtps_user::filter::PayloadFilter;
use rtps_user::history::{ChangeKind, NewChange};
use rtps_user::qos::ContentFilter;
use rtps_user::wire::{KeyHash, Timestamp};
use rtps_user::writer::{WriterConfig, WriterTiming};

use super::*;

/// Understands but one expression.
fn make_filter(filter: &ContentFilter) -> Option<PayloadFilter> {
    let is_understood = filter.expression == "even";
    is_understood.then(|| -> PayloadFilter { Arc::new(|_, payload| payload[0] % 2 == 0) })
}

fn declare_writer(driver: &Driver) -> EntityId {
    driver.shared().with(|core, now| {
        let guid = core.new_guid(EntityKind::WriterNoKey).unwrap();
        core.endpoints.add_writer(WriterConfig {
            guid,
            qos: Qos::default(),
            datagram_size: core.datagram_size(),
            timing: WriterTiming::default(),
        });
        let declaration = Declaration {
            make_filter: Some(make_filter),
            ..declaration(guid.entity)
        };
        core.declare(now, declaration);
        guid.entity
    })
}

/// A reader that announces this filter.
fn announce(steering: &Steering, writer: EntityId, expression: Option<&str>) {
    let entity = EntityId::of_app(1, 1, EntityKind::ReaderNoKey);
    let remote = RemoteEndpoint {
        guid: Guid::new(GuidPrefix([9; 12]), entity),
        unicast: vec![([127, 0, 0, 1], 1).into()],
        content_filter: expression.map(|expression| ContentFilter {
            expression: expression.to_owned(),
            ..ContentFilter::default()
        }),
        ..remote_writer()
    };
    let matched = FromLayer::Matched {
        local: writer,
        remote: Box::new(remote),
    };
    steering.messages.lock().unwrap().push(matched);
}

/// Writes samples that begin with 0, 1, 2 and 3; gives those that are sent.
fn sent(steering: &Steering, driver: &Driver, writer: EntityId) -> Vec<u8> {
    events(driver, writer);
    steering.sent.lock().unwrap().clear();
    driver.shared().with(|core, now| {
        for first in 0..4 {
            let change = NewChange {
                kind: ChangeKind::Alive,
                instance: KeyHash::default(),
                payload: vec![first, 1, 0, 0].into(),
                timestamp: Timestamp::default(),
            };
            let writer = core.endpoints.writer_mut(writer).unwrap();
            writer.write(now, change).unwrap();
            core.settle(now);
        }
    });
    steering.sent.lock().unwrap().clone()
}

#[test]
fn writers_send_what_readers_want() {
    let steering = Arc::new(Steering::default());
    let (driver, _socket) = open(&steering);
    let writer = declare_writer(&driver);
    for (expression, wanted) in [
        (Some("even"), &[0, 2][..]),
        // The reader is announced anew, with a filter that is not understood, and with none.
        (Some("odd"), &[0, 1, 2, 3]),
        (Some("even"), &[0, 2]),
        (None, &[0, 1, 2, 3]),
    ] {
        announce(&steering, writer, expression);
        let sent = sent(&steering, &driver, writer);
        assert_eq!(sent, wanted, "{expression:?}");
    }
}
