//! LIFESPAN, DEADLINE, RESOURCE_LIMITS of instances, DURABILITY_SERVICE, TRANSPORT_PRIORITY, LIVELINESS.

use super::*;
use crate::qos::{Deadline, DurabilityService, Lifespan, ResourceLimits};
use crate::wire;

const SECOND: Duration = Duration::from_secs(1);
const MILLISECOND: Duration = Duration::from_millis(1);

fn lifespan(time: Duration) -> Lifespan {
    Lifespan(wire::Duration::from_std(time))
}

fn deadline(time: Duration) -> Deadline {
    Deadline(wire::Duration::from_std(time))
}

fn of_instance(instance: u8, kind: ChangeKind) -> NewChange {
    NewChange {
        kind,
        instance: KeyHash([instance; 16]),
        ..change(8)
    }
}

impl Bench {
    fn write_kind(&mut self, instance: u8, kind: ChangeKind) -> Result<(), WriteError> {
        let change = of_instance(instance, kind);
        self.writer.write(self.now, change).map(|_| ())
    }

    fn write_instance(&mut self, instance: u8) -> Result<(), WriteError> {
        self.write_kind(instance, ChangeKind::Alive)
    }

    /// The instances whose deadline was missed, as time passes.
    fn missed(&mut self, time: Duration) -> Vec<u8> {
        self.pass(time);
        let events = std::iter::from_fn(|| self.writer.poll_event());
        events
            .filter_map(|event| match event {
                WriterEvent::DeadlineMissed { instance } => Some(instance.0[0]),
                _ => None,
            })
            .collect()
    }
}

#[test]
fn what_has_expired_is_gone_and_said_to_be() {
    let mut bench = matched(Qos {
        lifespan: lifespan(SECOND),
        ..reliable(Durability::TransientLocal)
    });
    bench.write(8);
    bench.pass(SECOND / 2);
    bench.write(8);
    bench.pass(SECOND / 2);
    assert_eq!(bench.writer.history.first(), Some(SequenceNumber(2)));
    bench.acknack(1, 1, &[1, 2]);
    let lines = bench.lines();
    assert_eq!(lines[..2], ["GAP 1..2 [] to 1", "DATA 2 to 1"]);
    bench.pass(SECOND / 2);
    assert!(bench.writer.history.is_empty());
}

#[test]
fn what_expires_before_it_is_sent_is_not_sent() {
    let mut bench = matched(Qos {
        lifespan: lifespan(MILLISECOND),
        ..reliable(Durability::Volatile)
    });
    bench.write(8);
    bench.now += MILLISECOND;
    bench.writer.handle_timeout(bench.now);
    let lines = bench.lines();
    assert_eq!(lines[0], "GAP 1..2 [] to all");
    assert!(!lines.contains(&"DATA 1 to all".to_owned()));
}

#[test]
fn expiry_makes_room_and_says_so() {
    let mut qos = reliable(Durability::Volatile);
    qos.lifespan = lifespan(SECOND);
    qos.resource_limits.max_samples = Some(1);
    let mut bench = matched(qos);
    bench.write(8);
    assert!(bench.writer.write(bench.now, change(8)).is_err());
    bench.pass(SECOND);
    assert_eq!(bench.writer.poll_event(), Some(WriterEvent::Acknowledged));
    bench.write(8);
}

#[test]
fn a_shorter_lifespan_concerns_what_is_written_from_then_on() {
    let mut qos = reliable(Durability::TransientLocal);
    qos.lifespan = lifespan(10 * SECOND);
    let mut bench = Bench::new(qos.clone());
    bench.write(8);
    qos.lifespan = lifespan(SECOND);
    bench.writer.set_qos(qos.clone());
    bench.write(8);
    qos.lifespan = Lifespan::default();
    bench.writer.set_qos(qos);
    bench.write(8);
    let lens = [SECOND, 8 * SECOND, SECOND, 100 * SECOND].map(|time| {
        bench.pass(time);
        bench.writer.history.len()
    });
    assert_eq!(lens, [2, 2, 1, 1]);
    assert_eq!(bench.writer.poll_timeout(), None);
}

#[test]
fn what_keep_last_replaces_is_not_watched_for_ever() {
    let mut bench = Bench::new(Qos {
        lifespan: lifespan(3600 * SECOND),
        durability: Durability::TransientLocal,
        ..Qos::default()
    });
    for _ in 0..10_000 {
        bench.write(8);
    }
    assert!(bench.writer.expiry.len() < 100);
}

#[test]
fn each_instance_has_its_deadline() {
    let mut bench = Bench::new(Qos {
        deadline: deadline(SECOND),
        ..Qos::default()
    });
    bench.write_instance(1).unwrap();
    assert_eq!(bench.missed(SECOND / 2), []);
    bench.write_instance(2).unwrap();
    assert_eq!(bench.missed(SECOND / 2), [1]);
    bench.write_instance(1).unwrap();
    assert_eq!(bench.missed(SECOND / 2), [2]);
    assert_eq!(bench.missed(3 * SECOND), [1, 2, 1, 2, 1, 2]);
}

#[test]
fn who_writes_in_time_misses_nothing() {
    let mut bench = Bench::new(Qos {
        deadline: deadline(SECOND),
        ..Qos::default()
    });
    for _ in 0..10 {
        bench.write_instance(1).unwrap();
        assert_eq!(bench.missed(SECOND * 9 / 10), []);
    }
}

#[test]
fn instances_that_are_not_alive_have_no_deadline() {
    for kind in [
        ChangeKind::Disposed,
        ChangeKind::Unregistered,
        ChangeKind::DisposedUnregistered,
    ] {
        let mut bench = Bench::new(Qos {
            deadline: deadline(SECOND),
            ..Qos::default()
        });
        bench.write_instance(1).unwrap();
        bench.write_kind(1, kind).unwrap();
        assert_eq!(bench.missed(10 * SECOND), []);
        bench.write_instance(1).unwrap();
        assert_eq!(bench.missed(SECOND), [1]);
    }
}

#[test]
fn an_instance_that_comes_back_is_missed_once() {
    let mut bench = Bench::new(Qos {
        deadline: deadline(SECOND),
        ..Qos::default()
    });
    for _ in 0..5 {
        bench.write_instance(1).unwrap();
        bench.write_kind(1, ChangeKind::Unregistered).unwrap();
    }
    bench.write_instance(1).unwrap();
    assert_eq!(bench.missed(SECOND), [1]);
}

#[test]
fn a_deadline_may_come_change_and_go() {
    let mut bench = Bench::new(Qos::default());
    bench.write_instance(1).unwrap();
    let set = |bench: &mut Bench, deadline| {
        bench.writer.set_qos(Qos {
            deadline,
            ..Qos::default()
        });
    };
    set(&mut bench, deadline(10 * SECOND));
    bench.write_instance(1).unwrap();
    set(&mut bench, deadline(SECOND));
    assert_eq!(bench.missed(SECOND), [1]);
    set(&mut bench, Deadline::default());
    assert_eq!(bench.missed(100 * SECOND), []);
    assert_eq!(bench.writer.poll_timeout(), None);
}

#[test]
fn registered_instances_count_until_they_are_unregistered() {
    let mut qos = reliable(Durability::Volatile);
    qos.resource_limits.max_instances = Some(2);
    let mut bench = Bench::new(qos);
    let (one, two) = (KeyHash([1; 16]), KeyHash([2; 16]));
    bench.write_instance(1).unwrap();
    bench.writer.register_instance(bench.now, two).unwrap();
    bench.writer.register_instance(bench.now, two).unwrap();
    assert_eq!(bench.write_instance(3), Err(WriteError::OutOfResources));
    bench.write_kind(1, ChangeKind::Disposed).unwrap();
    assert!(bench.writer.is_registered(one));
    bench.write_kind(1, ChangeKind::Unregistered).unwrap();
    assert!(!bench.writer.is_registered(one));
    bench.write_instance(3).unwrap();
    assert!(bench.writer.is_registered(two));
}

#[test]
fn instances_whose_unregistration_is_not_acknowledged_still_take_room() {
    let mut qos = reliable(Durability::TransientLocal);
    qos.resource_limits.max_instances = Some(1);
    let mut bench = matched(qos);
    bench.write_instance(1).unwrap();
    bench
        .write_kind(1, ChangeKind::DisposedUnregistered)
        .unwrap();
    bench.lines();
    assert_eq!(bench.write_instance(2), Err(WriteError::HistoryFull));
    bench.acknack(1, 3, &[]);
    bench.write_instance(2).unwrap();
}

#[test]
fn keep_last_waits_where_its_instances_need_more_than_max_samples() {
    let mut qos = Qos {
        history: History::KeepLast(2),
        ..reliable(Durability::Volatile)
    };
    qos.resource_limits.max_samples = Some(3);
    let mut bench = matched(qos);
    for instance in [1, 1, 2] {
        bench.write_instance(instance).unwrap();
    }
    bench.lines();
    assert_eq!(bench.write_instance(3), Err(WriteError::HistoryFull));
    bench.write_instance(1).unwrap();
    bench.lines();
    bench.acknack(1, 1, &[1, 2]);
    let replaced = ["GAP 1..2 [] to 1", "DATA 2 to 1"];
    assert_eq!(bench.lines()[..2], replaced);
    assert_eq!(bench.write_instance(3), Err(WriteError::HistoryFull));
    bench.acknack(1, 3, &[]);
    bench.write_instance(3).unwrap();
}

#[test]
fn a_transient_writer_keeps_what_the_durability_service_would() {
    let service = |history, max_samples_per_instance| DurabilityService {
        history,
        resource_limits: ResourceLimits {
            max_samples_per_instance,
            ..ResourceLimits::default()
        },
        ..DurabilityService::default()
    };
    for (durability, durability_service, kept) in [
        (
            Durability::TransientLocal,
            service(History::KeepLast(5), None),
            2,
        ),
        (
            Durability::Transient,
            service(History::KeepLast(5), None),
            5,
        ),
        (
            Durability::Persistent,
            service(History::KeepLast(1), None),
            2,
        ),
        (Durability::Persistent, service(History::KeepAll, None), 20),
        (Durability::Transient, service(History::KeepAll, Some(7)), 7),
    ] {
        let mut bench = Bench::new(Qos {
            history: History::KeepLast(2),
            durability,
            durability_service,
            ..Qos::default()
        });
        for _ in 0..20 {
            bench.write(8);
        }
        assert_eq!(bench.writer.history.len(), kept);
    }
}

#[test]
fn datagrams_are_marked_with_the_priority() {
    for (transport_priority, dscp) in [(0, 0), (-5, 0), (46, 46), (1000, 63)] {
        let mut bench = Bench::new(Qos {
            transport_priority,
            ..Qos::default()
        });
        bench.match_reader(1, 7411, Qos::default());
        bench.write(8);
        let transmit = bench.writer.poll_transmit(bench.now, &mut Vec::new());
        assert_eq!(transmit.unwrap().dscp, dscp);
    }
}

#[test]
fn a_manual_writer_is_alive_as_long_as_it_writes() {
    for kind in [
        LivelinessKind::ManualByParticipant,
        LivelinessKind::ManualByTopic,
    ] {
        let mut bench = matched(Qos {
            liveliness: Liveliness {
                kind,
                lease: wire::Duration::from_std(SECOND),
            },
            ..reliable(Durability::Volatile)
        });
        let lost = |bench: &mut Bench| {
            bench.pass(SECOND * 9 / 10);
            std::iter::from_fn(|| bench.writer.poll_event())
                .any(|e| e == WriterEvent::LivelinessLost)
        };
        for _ in 0..5 {
            bench.write(8);
            assert!(!lost(&mut bench));
        }
        assert!(lost(&mut bench));
        assert!(!lost(&mut bench), "it is told once");
        bench.write(8);
        assert!(!lost(&mut bench));
        assert!(lost(&mut bench));
    }
}

#[test]
fn readers_that_expect_inline_qos_get_them() {
    let mut bench = Bench::new(Qos {
        lifespan: lifespan(SECOND),
        ..reliable(Durability::Volatile)
    });
    let remote = |number, expects_inline_qos| RemoteEndpoint {
        expects_inline_qos,
        ..Bench::remote(number, 7411, reliable(Durability::Volatile))
    };
    bench.writer.match_reader(bench.now, &remote(1, false));
    bench.writer.match_reader(bench.now, &remote(2, true));
    let lifespans = |bench: &mut Bench| {
        bench.write(8);
        bench.write(3000);
        let sent = bench.sent_as(|submessage| match submessage {
            Submessage::Data(data) => Some(data.inline_qos.lifespan),
            Submessage::DataFrag(data) => Some(data.inline_qos.lifespan),
            _ => None,
        });
        let all = sent.into_iter().flat_map(|(_, lifespans)| lifespans);
        all.flatten().collect::<Vec<_>>()
    };
    assert_eq!(lifespans(&mut bench), [Some(lifespan(SECOND).0); 4]);
    bench.writer.set_qos(Qos {
        lifespan: lifespan(2 * SECOND),
        ..reliable(Durability::Volatile)
    });
    assert_eq!(lifespans(&mut bench), [Some(lifespan(2 * SECOND).0); 4]);
    bench.writer.unmatch_reader(reader_guid(2));
    assert_eq!(lifespans(&mut bench), [None; 4]);
}

#[test]
fn inline_qos_name_the_topic_and_the_policies_that_matter() {
    let mut bench = Bench::new(Qos {
        deadline: deadline(SECOND),
        user_data: vec![7; 1000],
        ..Qos::default()
    });
    let remote = RemoteEndpoint {
        expects_inline_qos: true,
        topic: "Square".to_owned(),
        ..Bench::remote(1, 7411, Qos::default())
    };
    bench.writer.match_reader(bench.now, &remote);
    bench.write(8);
    let mut out = Vec::new();
    bench.writer.poll_transmit(bench.now, &mut out).unwrap();
    let has = |bytes: &[u8]| out.windows(bytes.len()).any(|window| window == bytes);
    assert!(has(b"Square\0"));
    assert!(has(&[0x23, 0, 8, 0, 1, 0, 0, 0, 0, 0, 0, 0]), "DEADLINE");
    assert!(!has(&[7; 16]), "USER_DATA");
}
