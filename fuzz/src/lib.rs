//! What the fuzz targets share: messages made by hand, so that they may lie, and remote endpoints to send them.

use std::net::SocketAddr;

use rtps_user::RemoteEndpoint;
use rtps_user::endpoints::Endpoints;
use rtps_user::qos::Qos;
use rtps_user::wire::{EntityId, EntityKind, Guid, GuidPrefix, MessageReceiver};

mod message;
mod policies;

pub use message::{Message, Number, entities, sequence, sequence_set};
pub use policies::{MOST_SAMPLES, Policies};

/// The participant that is fuzzed.
pub const OURS: GuidPrefix = GuidPrefix([1; 12]);

/// Bytes of the largest datagram to send.
pub const DATAGRAM: usize = 1472;

/// More datagrams than this in a row, where nothing arrives, are an endless loop.
const MOST_DATAGRAMS: usize = 100_000;

/// The address of a remote participant.
pub fn address(number: u8) -> SocketAddr {
    ([10, 0, 0, number], 7411).into()
}

/// A remote endpoint, in a participant of its own.
pub fn remote_guid(number: u8, kind: EntityKind) -> Guid {
    Guid::new(GuidPrefix([number; 12]), EntityId::of_app(2, 1, kind))
}

/// What discovery tells of a remote endpoint.
pub fn remote(guid: Guid, number: u8, qos: Qos) -> RemoteEndpoint {
    RemoteEndpoint {
        guid,
        unicast: vec![address(number)],
        addresses: vec![address(number).ip()],
        multicast: Vec::new(),
        expects_inline_qos: false,
        takes_bare_keys: false,
        qos,
        topic: "Square".to_owned(),
        type_name: "ShapeType".to_owned(),
        type_information: Vec::new(),
        content_filter: None,
    }
}

/// Takes all that is to be sent, which must be whole messages of at most [`DATAGRAM`] bytes and come to an end.
pub fn transmit(endpoints: &mut Endpoints, now: std::time::Instant) {
    for _ in 0..MOST_DATAGRAMS {
        let mut datagram = Vec::new();
        if endpoints.poll_transmit(now, &mut datagram).is_none() {
            return;
        }
        assert!(datagram.len() <= DATAGRAM, "{} bytes", datagram.len());
        let receiver = MessageReceiver::new(GuidPrefix::UNKNOWN, &datagram);
        let mut received = receiver.expect("a header of ours");
        assert!(received.all(|submessage| submessage.is_ok()));
    }
    panic!("the datagrams have no end");
}
