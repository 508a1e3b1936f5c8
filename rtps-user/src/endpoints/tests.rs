//! Two apps' endpoints, with the datagrams between them carried by hand.

use std::net::SocketAddr;
use std::time::Duration;

use super::*;
use crate::history::{ChangeKind, NewChange};
use crate::qos::{History, Liveliness, LivelinessKind, Qos, Reliability};
use crate::reader::Selection;
use crate::wire::{EntityKind, KeyHash, Timestamp, WireError};
use crate::writer::WriterTiming;

const ADDRESS: SocketAddr = SocketAddr::new(
    std::net::IpAddr::V4(std::net::Ipv4Addr::new(10, 0, 0, 1)),
    7411,
);

fn qos() -> Qos {
    Qos {
        reliability: Reliability::RELIABLE,
        history: History::KeepAll,
        ..Qos::default()
    }
}

fn remote(guid: Guid) -> RemoteEndpoint {
    RemoteEndpoint {
        guid,
        unicast: vec![ADDRESS],
        addresses: Vec::new(),
        multicast: Vec::new(),
        expects_inline_qos: false,
        takes_bare_keys: false,
        qos: qos(),
        topic: String::new(),
        type_name: String::new(),
        type_information: Vec::new(),
        content_filter: None,
    }
}

/// An app with one writer, and one with three readers of which two are matched with it.
struct Apps {
    now: Instant,
    writing: Endpoints,
    writer: Guid,
    reading: Endpoints,
    readers: [EntityId; 3],
}

impl Apps {
    fn new() -> Self {
        let (ours, theirs) = (GuidPrefix([1; 12]), GuidPrefix([2; 12]));
        let writer = Guid::new(ours, EntityId::of_app(1, 1, EntityKind::WriterNoKey));
        let id = |serial| EntityId::of_app(3, serial, EntityKind::ReaderNoKey);
        let mut apps = Self {
            now: Instant::now(),
            writing: Endpoints::new(ours),
            writer,
            reading: Endpoints::new(theirs),
            readers: [1, 2, 3].map(id),
        };
        apps.writing.add_writer(WriterConfig {
            guid: writer,
            qos: qos(),
            datagram_size: 1472,
            timing: WriterTiming::default(),
        });
        for reader in apps.readers {
            let config = ReaderConfig::new(Guid::new(theirs, reader), qos());
            apps.reading.add_reader(config);
        }
        for reader in [apps.readers[0], apps.readers[1]] {
            let guid = Guid::new(theirs, reader);
            apps.writing
                .match_remote(apps.now, writer.entity, &remote(guid));
            apps.reading.match_remote(apps.now, reader, &remote(writer));
        }
        apps.exchange();
        apps
    }

    fn write(&mut self) {
        let change = NewChange {
            kind: ChangeKind::Alive,
            instance: KeyHash::default(),
            payload: vec![0; 8].into(),
            timestamp: Timestamp::default(),
        };
        let writer = self.writing.writer_mut(self.writer.entity).unwrap();
        writer.write(self.now, change).unwrap();
    }

    /// The datagrams of the writing app.
    fn written(&mut self) -> Vec<Vec<u8>> {
        let mut out = Vec::new();
        let mut datagrams = Vec::new();
        while self.writing.poll_transmit(self.now, &mut out).is_some() {
            datagrams.push(std::mem::take(&mut out));
        }
        datagrams
    }

    fn deliver(&mut self, datagram: &[u8]) -> Result<(), WireError> {
        self.reading.handle_datagram(self.now, ADDRESS, datagram)
    }

    fn exchange(&mut self) {
        let mut out = Vec::new();
        for _ in 0..10 {
            for datagram in self.written() {
                self.deliver(&datagram).unwrap();
            }
            while self.reading.poll_transmit(self.now, &mut out).is_some() {
                self.writing
                    .handle_datagram(self.now, ADDRESS, &out)
                    .unwrap();
                out.clear();
            }
        }
    }

    /// The reading app has sent and told all that there is.
    fn settle(&mut self) {
        let mut out = Vec::new();
        while self.reading.poll_transmit(self.now, &mut out).is_some() {}
        self.events();
    }

    fn events(&mut self) -> Vec<EndpointEvent> {
        std::iter::from_fn(|| self.reading.poll_event()).collect()
    }

    fn taken(&mut self) -> [usize; 3] {
        let everything = Selection::default();
        self.readers.map(|reader| {
            let reader = self.reading.reader_mut(reader).unwrap();
            reader.take(usize::MAX, &everything).len()
        })
    }
}

#[test]
fn one_datagram_serves_all_matched_readers() {
    let mut apps = Apps::new();
    apps.events();
    apps.write();
    let datagrams = apps.written();
    assert_eq!(datagrams.len(), 1);
    apps.deliver(&datagrams[0]).unwrap();
    let expected = [0, 1].map(|index| EndpointEvent::DataAvailable(apps.readers[index]));
    assert_eq!(apps.events(), expected);
    assert_eq!(apps.taken(), [1, 1, 0]);
}

#[test]
fn who_takes_one_sample_leaves_all_settled() {
    let mut apps = Apps::new();
    let reader = apps.readers[0];
    apps.write();
    assert!(!apps.writing.is_settled(apps.now));
    for datagram in apps.written() {
        apps.deliver(&datagram).unwrap();
    }
    assert!(!apps.reading.is_settled(apps.now));
    apps.settle();
    assert!(apps.reading.is_settled(apps.now));
    let take = |apps: &mut Apps| apps.reading.take_next(reader, &Selection::default());
    assert!(take(&mut apps).is_some());
    assert!(take(&mut apps).is_none());
    assert!(apps.reading.is_settled(apps.now));
    let due = apps.writing.poll_timeout().unwrap();
    assert!(apps.writing.is_settled(due - Duration::from_nanos(1)));
    assert!(!apps.writing.is_settled(due));
}

#[test]
fn a_sample_that_waits_for_room_comes_once_another_was_taken() {
    let mut apps = Apps::new();
    let full = apps.readers[0];
    let guid = Guid::new(apps.reading.prefix(), full);
    let mut qos = qos();
    qos.resource_limits.max_samples = Some(1);
    apps.reading.add_reader(ReaderConfig::new(guid, qos));
    apps.reading
        .match_remote(apps.now, full, &remote(apps.writer));
    apps.write();
    apps.write();
    for datagram in apps.written() {
        apps.deliver(&datagram).unwrap();
    }
    apps.settle();
    let take = |apps: &mut Apps| apps.reading.take_next(full, &Selection::default());
    assert!(take(&mut apps).is_some());
    assert_eq!(apps.events(), [EndpointEvent::DataAvailable(full)]);
    assert!(take(&mut apps).is_some());
    assert!(take(&mut apps).is_none());
}

#[test]
fn datagrams_are_appended_to_what_is_there() {
    let mut apps = Apps::new();
    apps.write();
    let mut out = b"before".to_vec();
    assert!(apps.writing.poll_transmit(apps.now, &mut out).is_some());
    apps.deliver(out.strip_prefix(b"before").unwrap()).unwrap();
    let before = out.clone();
    assert!(apps.writing.poll_transmit(apps.now, &mut out).is_none());
    assert_eq!(out, before);

    apps.now += Duration::from_secs(1);
    apps.writing.handle_timeout(apps.now);
    for heartbeat in apps.written() {
        apps.deliver(&heartbeat).unwrap();
    }
    let mut out = b"before".to_vec();
    assert!(apps.reading.poll_transmit(apps.now, &mut out).is_some());
    let acknack = out.strip_prefix(b"before").unwrap();
    let result = apps.writing.handle_datagram(apps.now, ADDRESS, acknack);
    assert_eq!(result, Ok(()));
    while apps.reading.poll_transmit(apps.now, &mut out).is_some() {}
    let before = out.clone();
    assert!(apps.reading.poll_transmit(apps.now, &mut out).is_none());
    assert_eq!(out, before);
}

#[test]
fn a_place_that_is_used_again_belongs_to_its_new_endpoint() {
    let mut apps = Apps::new();
    let removed = apps.readers[0];
    apps.write();
    let datagram = apps.written().remove(0);
    apps.deliver(&datagram).unwrap();
    apps.reading.remove(removed);
    let config = ReaderConfig::new(
        Guid::new(
            apps.reading.prefix(),
            EntityId::of_app(3, 9, EntityKind::ReaderNoKey),
        ),
        qos(),
    );
    let added = config.guid.entity;
    apps.reading.add_reader(config);
    apps.now += Duration::from_secs(1);
    apps.reading.handle_timeout(apps.now);
    apps.write();
    for datagram in apps.written() {
        apps.deliver(&datagram).unwrap();
    }
    assert!(apps.reading.reader(removed).is_none());
    assert!(apps.reading.reader(added).is_some_and(Reader::is_empty));
    assert_eq!(
        apps.reading.reader(apps.readers[1]).map(Reader::len),
        Some(2)
    );
}

#[test]
fn unmatched_and_removed_readers_get_nothing() {
    let mut apps = Apps::new();
    apps.reading.unmatch(apps.now, apps.readers[0], apps.writer);
    apps.reading.remove(apps.readers[1]);
    apps.events();
    apps.write();
    for datagram in apps.written() {
        apps.deliver(&datagram).unwrap();
    }
    assert_eq!(apps.events(), []);
    assert!(apps.reading.reader(apps.readers[1]).is_none());
}

#[test]
fn what_precedes_a_malformed_part_is_processed() {
    let mut apps = Apps::new();
    apps.write();
    let mut datagram = apps.written().remove(0);
    // A HEARTBEAT whose body is missing.
    datagram.extend_from_slice(&[7, 1, 28, 0]);
    assert_eq!(apps.deliver(&datagram), Err(WireError::SubmessageTooLong));
    assert_eq!(apps.taken(), [1, 1, 0]);
}

#[test]
fn timers_run_for_whoever_has_set_them() {
    let mut apps = Apps::new();
    apps.exchange();
    assert_eq!(apps.writing.poll_timeout(), None);
    apps.write();
    apps.written();
    let due = apps.writing.poll_timeout().unwrap();
    assert_eq!(due, apps.now + WriterTiming::default().heartbeat_period);
    apps.writing.handle_timeout(due - Duration::from_nanos(1));
    assert!(apps.written().is_empty());
    apps.now = due;
    apps.writing.handle_timeout(due);
    assert_eq!(apps.written().len(), 2, "a HEARTBEAT for each reader");
    assert!(apps.writing.poll_timeout() > Some(due));
    apps.writing.remove(apps.writer.entity);
    assert_eq!(apps.writing.poll_timeout(), None);
}

#[test]
fn what_comes_from_elsewhere_is_refused_and_counted() {
    let mut apps = Apps::new();
    let second_interface = SocketAddr::from(([10, 0, 1, 1], 7411));
    let elsewhere = SocketAddr::from(([10, 6, 6, 6], 7411));
    let addresses = vec![ADDRESS.ip(), second_interface.ip()];
    let mut writer = remote(apps.writer);
    writer.addresses.clone_from(&addresses);
    apps.reading
        .match_remote(apps.now, apps.readers[0], &writer);
    let mut reader = remote(Guid::new(apps.reading.prefix(), apps.readers[0]));
    reader.addresses = addresses;
    apps.writing
        .match_remote(apps.now, apps.writer.entity, &reader);

    apps.write();
    let deliver = |apps: &mut Apps, from, datagram: &[u8]| {
        apps.reading
            .handle_datagram(apps.now, from, datagram)
            .unwrap();
        apps.taken()
    };
    let data = apps.written().remove(0);
    assert_eq!(deliver(&mut apps, elsewhere, &data), [0, 0, 0]);
    assert_eq!(apps.reading.foreign(), 1);
    assert_eq!(deliver(&mut apps, second_interface, &data), [1, 1, 0]);
    assert_eq!(apps.reading.foreign(), 1);

    apps.reading.unmatch(apps.now, apps.readers[1], apps.writer);
    apps.writing.unmatch(
        apps.now,
        apps.writer.entity,
        Guid::new(apps.reading.prefix(), apps.readers[1]),
    );
    let mut acknack = Vec::new();
    apps.now += Duration::from_secs(1);
    apps.writing.handle_timeout(apps.now);
    for heartbeat in apps.written() {
        apps.deliver(&heartbeat).unwrap();
    }
    assert!(apps.reading.poll_transmit(apps.now, &mut acknack).is_some());
    let is_acknowledged = |apps: &Apps| {
        let writer = apps.writing.writer(apps.writer.entity);
        writer.is_some_and(Writer::all_acknowledged)
    };
    apps.writing
        .handle_datagram(apps.now, elsewhere, &acknack)
        .unwrap();
    assert!(!is_acknowledged(&apps));
    assert_eq!(apps.writing.foreign(), 1);
    apps.writing
        .handle_datagram(apps.now, second_interface, &acknack)
        .unwrap();
    assert!(is_acknowledged(&apps));
}

const LEASE: Duration = Duration::from_millis(900);

/// The MANUAL_BY_PARTICIPANT writers of one app.
fn manual_writers<const N: usize>() -> (Endpoints, [EntityId; N]) {
    let prefix = GuidPrefix([1; 12]);
    let mut endpoints = Endpoints::new(prefix);
    let ids = std::array::from_fn(|serial| {
        EntityId::of_app(1, serial as u16 + 1, EntityKind::WriterNoKey)
    });
    for id in ids {
        endpoints.add_writer(WriterConfig {
            guid: Guid::new(prefix, id),
            qos: Qos {
                liveliness: Liveliness {
                    kind: LivelinessKind::ManualByParticipant,
                    lease: crate::wire::Duration::from_std(LEASE),
                },
                ..qos()
            },
            datagram_size: 1472,
            timing: WriterTiming::default(),
        });
    }
    (endpoints, ids)
}

fn write(endpoints: &mut Endpoints, now: Instant, id: EntityId) {
    let change = NewChange {
        kind: ChangeKind::Alive,
        instance: KeyHash::default(),
        payload: vec![0; 8].into(),
        timestamp: Timestamp::default(),
    };
    let writer = endpoints.writer_mut(id).unwrap();
    writer.write(now, change).unwrap();
}

fn events(endpoints: &mut Endpoints, now: Instant) -> Vec<EndpointEvent> {
    endpoints.handle_timeout(now);
    while endpoints.poll_transmit(now, &mut Vec::new()).is_some() {}
    std::iter::from_fn(|| endpoints.poll_event()).collect()
}

#[test]
fn manual_by_participant_writers_are_alive_together() {
    let (mut endpoints, ids) = manual_writers::<2>();
    let mut now = Instant::now();
    endpoints.assert_liveliness(now);
    for _ in 0..5 {
        now += LEASE * 6 / 10;
        write(&mut endpoints, now, ids[0]);
        let told = [EndpointEvent::Asserted { at: now }];
        assert_eq!(events(&mut endpoints, now), told, "none is lost");
    }
    now += LEASE;
    let both = ids.map(EndpointEvent::LivelinessLost);
    let mut events = events(&mut endpoints, now);
    events.sort_by_key(|event| format!("{event:?}"));
    assert_eq!(events, both);
}

#[test]
fn assertions_are_told_at_once_and_no_more_often_than_needed() {
    let (mut endpoints, ids) = manual_writers::<2>();
    let start = Instant::now();
    let mut told = Vec::new();
    // One of them writes for 500 ms, 1000 samples a second, the other now and then.
    for millis in 0..2000 {
        let now = start + Duration::from_millis(millis);
        if millis < 500 {
            write(&mut endpoints, now, ids[0]);
            if millis % 100 == 50 {
                write(&mut endpoints, now, ids[1]);
            }
        }
        for event in events(&mut endpoints, now) {
            match event {
                EndpointEvent::Asserted { at } => told.push((at - start).as_millis()),
                EndpointEvent::LivelinessLost(_) => assert!(millis >= 499 + 900),
                other => panic!("unexpected {other:?}"),
            }
        }
    }
    assert_eq!(told, [0, 300, 600], "the last one for the last sample");
}

#[test]
fn who_is_alone_tells_only_what_it_does_not_write() {
    let (mut endpoints, [id]) = manual_writers::<1>();
    let now = Instant::now();
    write(&mut endpoints, now, id);
    assert_eq!(events(&mut endpoints, now), []);
    endpoints.writer_mut(id).unwrap().assert_liveliness(now);
    let told = [EndpointEvent::Asserted { at: now }];
    assert_eq!(events(&mut endpoints, now), told);
}
