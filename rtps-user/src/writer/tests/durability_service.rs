//! What a writer keeps in the place of a durability service.

use super::*;
use crate::qos::{DurabilityService, ResourceLimits};

const SECOND: Duration = Duration::from_secs(1);

fn transient(service: DurabilityService) -> Qos {
    Qos {
        durability_service: service,
        ..reliable(Durability::Transient)
    }
}

fn keeping(history: History, resource_limits: ResourceLimits) -> DurabilityService {
    DurabilityService {
        history,
        resource_limits,
        ..DurabilityService::default()
    }
}

impl Bench {
    fn write_to(&mut self, instance: u8, kind: ChangeKind) -> Result<SequenceNumber, WriteError> {
        let change = NewChange {
            kind,
            instance: KeyHash([instance; 16]),
            ..change(8)
        };
        self.writer.write(self.now, change)
    }

    /// Writes samples of these instances in turn.
    fn write_in_turn(&mut self, instances: &[u8]) {
        for instance in instances {
            self.write_to(*instance, ChangeKind::Alive).unwrap();
        }
    }

    /// The numbers of the changes that a late joiner gets.
    fn past(&self) -> Vec<i64> {
        let history = &self.writer.history;
        let numbers = (1..=self.writer.last_sequence().0).map(SequenceNumber);
        let kept = numbers.filter(|number| history.get(*number).is_some());
        kept.map(|number| number.0).collect()
    }
}

#[test]
fn its_history_bounds_what_stays_when_all_have_it() {
    let depth = |depth| keeping(History::KeepLast(depth), ResourceLimits::default());
    let mut bench = matched(transient(depth(2)));
    bench.write_in_turn(&[1, 1, 2, 1, 1]);
    bench.lines();
    assert_eq!(bench.past(), [1, 2, 3, 4, 5], "not acknowledged");
    bench.acknack(1, 3, &[]);
    assert_eq!(bench.past(), [3, 4, 5]);
    bench.acknack(1, 6, &[]);
    assert_eq!(bench.past(), [3, 4, 5]);
    bench.write_in_turn(&[1]);
    assert_eq!(bench.past(), [3, 4, 5, 6]);
    bench.lines();
    bench.acknack(1, 7, &[]);
    assert_eq!(bench.past(), [3, 5, 6]);
    // TRANSIENT_LOCAL knows no service, and a KEEP_ALL one without limits bounds nothing.
    let keep_all = keeping(History::KeepAll, ResourceLimits::default());
    let local = Qos {
        durability: Durability::TransientLocal,
        ..transient(depth(2))
    };
    for qos in [local, transient(keep_all), transient(depth(1))] {
        let mut bench = Bench::new(qos);
        bench.write_in_turn(&[1; 5]);
        assert_eq!(bench.past(), [1, 2, 3, 4, 5]);
    }
}

#[test]
fn its_resource_limits_bound_what_stays() {
    let limits = |samples, instances, per_instance| ResourceLimits {
        max_samples: samples,
        max_instances: instances,
        max_samples_per_instance: per_instance,
    };
    for (limits, past) in [
        (limits(Some(3), None, None), &[4, 5, 6][..]),
        (limits(None, None, Some(2)), &[1, 4, 5, 6]),
        (limits(None, Some(2), None), &[2, 3, 4, 5, 6]),
        (limits(Some(1), Some(1), Some(1)), &[6]),
    ] {
        let mut bench = Bench::new(transient(keeping(History::KeepAll, limits)));
        bench.write_in_turn(&[1, 2, 2, 2, 3, 2]);
        assert_eq!(bench.past(), past, "{limits:?}");
    }
}

#[test]
fn an_instance_goes_when_its_cleanup_delay_has_passed() {
    let service = DurabilityService {
        cleanup_delay: crate::wire::Duration::from_std(SECOND),
        ..keeping(History::KeepLast(1), ResourceLimits::default())
    };
    let mut bench = matched(transient(service));
    bench.write_in_turn(&[1, 2, 3]);
    for instance in [1, 2] {
        bench
            .write_to(instance, ChangeKind::DisposedUnregistered)
            .unwrap();
    }
    bench.write_to(3, ChangeKind::Disposed).unwrap();
    bench.lines();
    bench.acknack(1, 7, &[]);
    assert_eq!(bench.past(), [4, 5, 6]);
    bench.pass(SECOND / 2);
    bench.write_in_turn(&[2]);
    bench.lines();
    bench.acknack(1, 8, &[]);
    bench.pass(SECOND * 49 / 100);
    assert_eq!(bench.past(), [4, 6, 7]);
    bench.pass(SECOND / 100);
    assert_eq!(bench.past(), [6, 7], "2 is written again, 3 is registered");
    assert_eq!(bench.writer.poll_timeout(), None);
}

#[test]
fn an_instance_that_stays_for_readers_to_come_makes_room_for_another() {
    let service = DurabilityService {
        cleanup_delay: crate::wire::Duration::INFINITE,
        ..keeping(History::KeepAll, ResourceLimits::default())
    };
    let mut qos = transient(service);
    qos.resource_limits.max_instances = Some(1);
    let mut bench = matched(qos);
    bench.write_in_turn(&[1]);
    bench.write_to(1, ChangeKind::DisposedUnregistered).unwrap();
    bench.lines();
    let refused = bench.write_to(2, ChangeKind::Alive);
    assert_eq!(refused, Err(WriteError::HistoryFull), "not acknowledged");
    bench.acknack(1, 3, &[]);
    bench.pass(1000 * SECOND);
    assert_eq!(bench.past(), [1, 2]);
    bench.write_in_turn(&[2]);
    assert_eq!(bench.past(), [3]);
}
