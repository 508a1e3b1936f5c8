//! Any bytes as a datagram: to the kernel's walk over messages, to the endpoints of an app, and to discovery.

#![no_main]

use std::sync::LazyLock;
use std::time::{Duration, Instant};

use libfuzzer_sys::fuzz_target;
use rtps_ebpf::{Routes, SlotSet};
use rtps_fuzz::{DATAGRAM, OURS, address, remote, remote_guid, transmit};
use rtps_user::endpoints::Endpoints;
use rtps_user::layer::{Layer, LayerConfig};
use rtps_user::qos::{Qos, Reliability};
use rtps_user::reader::ReaderConfig;
use rtps_user::wire::{
    EntityId, EntityKind, Guid, GuidPrefix, HEADER_LEN, Header, MessageReceiver,
};
use rtps_user::writer::{WriterConfig, WriterTiming};

const NUMBER: u8 = 2;

/// One app reads from all writers.
struct Everyone;

impl Routes for Everyone {
    fn add_readers(&self, _writer: &[u8; 16], slots: &mut SlotSet) {
        slots.insert(7);
    }
}

fn endpoints(now: Instant) -> Endpoints {
    let qos = Qos {
        reliability: Reliability::RELIABLE,
        ..Qos::default()
    };
    let mut endpoints = Endpoints::new(OURS);
    let writer = EntityId::of_app(1, 1, EntityKind::WriterWithKey);
    let reader = EntityId::of_app(1, 2, EntityKind::ReaderWithKey);
    endpoints.add_writer(WriterConfig {
        guid: Guid::new(OURS, writer),
        qos: qos.clone(),
        datagram_size: DATAGRAM,
        timing: WriterTiming::default(),
    });
    endpoints.add_reader(ReaderConfig::new(Guid::new(OURS, reader), qos.clone()));
    let remote = |kind| remote(remote_guid(NUMBER, kind), NUMBER, qos.clone());
    endpoints.match_remote(now, writer, &remote(EntityKind::ReaderWithKey));
    endpoints.match_remote(now, reader, &remote(EntityKind::WriterWithKey));
    endpoints
}

fuzz_target!(|data: &[u8]| {
    static START: LazyLock<Instant> = LazyLock::new(Instant::now);
    let now = *START;
    // The header of one whom we know, so that not all inputs fail at that.
    let mut datagram = Vec::new();
    Header::encode(GuidPrefix([NUMBER; 12]), &mut datagram);
    debug_assert_eq!(datagram.len(), HEADER_LEN);
    datagram.extend_from_slice(data);
    for datagram in [data, &datagram] {
        let _ = rtps_ebpf::examine(datagram, OURS.0, &Everyone);
        if let Ok(receiver) = MessageReceiver::new(OURS, datagram) {
            receiver.for_each(drop);
        }
        let mut endpoints = endpoints(now);
        let _ = endpoints.handle_datagram(now, address(NUMBER), datagram);
        transmit(&mut endpoints, now);
        endpoints.handle_timeout(now + Duration::from_secs(1));
        transmit(&mut endpoints, now + Duration::from_secs(1));

        let mut layer = Layer::new(LayerConfig::new(OURS, 0, address(1)), now);
        let _ = layer.handle_datagram(now, address(NUMBER), datagram);
        let mut out = Vec::new();
        while layer.poll_output(now, &mut out).is_some() {}
    }
});
