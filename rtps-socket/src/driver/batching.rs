//! When what is written waits for more, so that several samples share a datagram and many datagrams a system call
//! (LATENCY_BUDGET, DDS 1.4 section 2.2.3.8).
//!
//! A writer may have a latency budget. One that has none waits all the same once the app does nothing but write, a
//! sample every few microseconds: whoever pings, answers, or publishes at a rate never gets there. What waits is
//! sent when there is enough of it, when the app does something else, or after the time [`Patience`] allows.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

use rtps_user::qos::{History, Qos};

/// Writes in a row after which the app is taken to stream.
const STREAM: u32 = 4;
/// Between two writes of a stream, and two datagrams that arrive in one, there is less time than any round trip takes: an app
/// that answers does not stream.
pub(super) const GAP: Duration = Duration::from_micros(20);
/// For how long a sample of a stream waits.
const PAUSE: Duration = Duration::from_micros(100);
/// Writes after which a stream has shown that it lasts.
const LASTING: u32 = 512;
/// For how long a sample waits then: hundreds of them fill what leaves with one system call.
const LONG_PAUSE: Duration = Duration::from_micros(200);
/// How much longer at most the last samples of a stream wait, which the writer does not see to any more.
const SLACK: Duration = Duration::from_micros(400);
/// Bytes that are enough to be sent; what they take beside [`OVERHEAD`] still fits a datagram of the largest size, as
/// which the system takes them.
const ENOUGH: usize = 52 * 1024;
/// What a sample takes beside its payload.
const OVERHEAD: usize = 36;
/// No hint of an app keeps its samples longer.
const LONGEST: Duration = Duration::from_millis(100);

/// How far the samples of a writer may be held back.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Patience {
    budget: Duration,
    /// One more would push a sample out of the history that has not been sent.
    samples: u32,
}

impl Patience {
    /// Its samples may wait as long as any.
    pub(crate) fn suspended(self) -> Self {
        Self {
            budget: LONGEST,
            ..self
        }
    }

    /// What a writer's policies allow.
    pub(crate) fn of(qos: &Qos) -> Self {
        Self {
            budget: qos
                .latency_budget
                .0
                .to_std()
                .map_or(LONGEST, |budget| budget.min(LONGEST)),
            samples: match qos.history {
                History::KeepLast(depth) => depth,
                History::KeepAll => u32::MAX,
            },
        }
    }
}

/// The [`Patience`] of a writer whose LATENCY_BUDGET may change.
#[derive(Debug)]
pub(crate) struct PatienceCell {
    budget_nanos: AtomicU64,
    samples: u32,
}

impl PatienceCell {
    pub(crate) fn new(qos: &Qos) -> Self {
        let cell = Self {
            budget_nanos: AtomicU64::new(0),
            samples: Patience::of(qos).samples,
        };
        cell.set(qos);
        cell
    }

    pub(crate) fn set(&self, qos: &Qos) {
        // At most LONGEST.
        let nanos = Patience::of(qos).budget.as_nanos() as u64;
        self.budget_nanos.store(nanos, Ordering::Relaxed);
    }

    pub(crate) fn get(&self) -> Patience {
        Patience {
            budget: Duration::from_nanos(self.budget_nanos.load(Ordering::Relaxed)),
            samples: self.samples,
        }
    }
}

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Batching {
    row: u32,
    last: Option<Instant>,
    /// When the row began.
    since: Option<Instant>,
    due: Option<Instant>,
    /// Somebody has said how long samples may wait.
    is_strict: bool,
    bytes: usize,
    room: u32,
    /// Something has come since the last write, which the next one may answer.
    may_answer: bool,
}

impl Batching {
    /// A sample of `len` bytes was written. Whether it waits; else everything that waits is to be sent.
    pub(super) fn holds(&mut self, now: Instant, len: usize, patience: Patience) -> bool {
        let last = self.last.replace(now);
        // Who stalls the app for a moment, another thread on its CPU, does not end what still waits for more.
        let joins = self.row >= STREAM && self.is_holding(now);
        let follows = joins || last.is_some_and(|last| now <= last + GAP);
        self.row = if follows {
            self.row.saturating_add(1)
        } else {
            0
        };
        if !follows || self.since.is_none() {
            self.since = Some(now);
        }
        let wait = match self.row {
            ..STREAM => patience.budget,
            STREAM..LASTING => patience.budget.max(PAUSE),
            _ => patience.budget.max(LONG_PAUSE),
        };
        if self.due.is_none() {
            (self.bytes, self.room) = (0, u32::MAX);
            self.is_strict = false;
        }
        self.is_strict |= wait == patience.budget;
        self.bytes += len + OVERHEAD;
        self.room = self.room.min(patience.samples).saturating_sub(1);
        let due = self.due.map_or(now + wait, |due| due.min(now + wait));
        self.due = Some(due);
        now < due && self.bytes < ENOUGH && self.room > 0
    }

    /// The app does something else.
    pub(super) fn interrupt(&mut self) {
        self.end_row();
        self.due = None;
    }

    /// The write is over: sending may have taken longer than any gap. No stream begins with an answer, so that the
    /// clock need not be read for one.
    pub(super) fn wrote(&mut self, now: impl FnOnce() -> Instant) {
        if !std::mem::take(&mut self.may_answer) {
            self.last = Some(now());
        }
    }

    /// Something came that the app may answer.
    pub(super) fn expect_answer(&mut self) {
        self.end_row();
        self.may_answer = true;
    }

    fn end_row(&mut self) {
        self.row = 0;
        self.since = None;
    }

    /// What waits was sent, or is to be sent now.
    pub(super) fn sent(&mut self) {
        self.due = None;
    }

    /// When the app wrote last.
    pub(super) fn last_write(&self) -> Option<Instant> {
        self.last
    }

    /// When what waits is to be sent; `None` when nothing waits.
    pub(super) fn due(&self) -> Option<Instant> {
        self.due
    }

    /// When somebody else than the writer is to see to what waits. The writer of a stream does so by itself as long as it
    /// writes, so that the others look the later the longer that has been going on.
    pub(super) fn relief(&self) -> Option<Instant> {
        let age = self.last.zip(self.since).map(|(last, since)| last - since);
        let slack = match age {
            Some(age) if !self.is_strict => (age / 2).min(SLACK),
            _ => Duration::ZERO,
        };
        self.due.map(|due| due + slack)
    }

    /// Whether something waits, and does so for longer.
    pub(super) fn is_holding(&self, now: Instant) -> bool {
        self.due.is_some_and(|due| now < due)
    }
}

#[cfg(test)]
mod tests {
    use rtps_user::qos::LatencyBudget;
    use rtps_user::wire;

    use super::*;

    fn patience(budget_us: u64, history: History) -> Patience {
        let budget = Duration::from_micros(budget_us);
        Patience::of(&Qos {
            latency_budget: LatencyBudget(wire::Duration::from_std(budget)),
            history,
            ..Qos::default()
        })
    }

    /// Writes `count` samples `gap_us` apart; which of them wait.
    fn write(gap_us: u64, count: usize, len: usize, patience: Patience) -> Vec<bool> {
        let (mut batching, mut now) = (Batching::default(), Instant::now());
        let write = |_| {
            now += Duration::from_micros(gap_us);
            let holds = batching.holds(now, len, patience);
            if !holds {
                batching.sent();
            }
            holds
        };
        (0..count).map(write).collect()
    }

    #[test]
    fn a_stream_is_gathered() {
        let held = write(1, 1000, 100, patience(0, History::KeepAll));
        assert_eq!(held[..4], [false; 4]);
        let sent = held[4..].iter().filter(|held| !**held).count();
        assert!((5..20).contains(&sent), "{sent}");
    }

    #[test]
    fn a_stall_ends_no_stream_as_long_as_something_waits() {
        let (mut batching, mut now) = (Batching::default(), Instant::now());
        let mut write = |gap_us| {
            now += Duration::from_micros(gap_us);
            let holds = batching.holds(now, 100, patience(0, History::KeepAll));
            if !holds {
                batching.sent();
            }
            holds
        };
        assert_eq!([1; 5].map(&mut write), [false, false, false, false, true]);
        assert!(write(50), "it still waits");
        assert!(!write(50), "it is time");
        assert!(!write(50), "that was no stream");
    }

    #[test]
    fn who_pauses_does_not_stream() {
        let held = write(50, 100, 100, patience(0, History::KeepAll));
        assert!(!held.contains(&true));
    }

    #[test]
    fn large_samples_do_not_wait() {
        let held = write(1, 100, 60_000, patience(0, History::KeepAll));
        assert!(!held.contains(&true));
    }

    #[test]
    fn nothing_is_pushed_out_of_the_history_unsent() {
        let held = write(1, 100, 100, patience(0, History::KeepLast(1)));
        assert!(!held.contains(&true));
        let held = write(1, 100, 100, patience(0, History::KeepLast(3)));
        assert!(held[4..].windows(3).all(|window| window.contains(&false)));
        assert!(held.contains(&true));
    }

    #[test]
    fn an_answer_begins_no_stream_and_needs_no_clock() {
        let (mut batching, now) = (Batching::default(), Instant::now());
        let mut reads = 0;
        let mut write = |batching: &mut Batching| {
            batching.holds(now, 100, patience(0, History::KeepAll));
            batching.sent();
            batching.wrote(|| {
                reads += 1;
                now
            });
            reads
        };
        for _ in 0..100 {
            batching.expect_answer();
            assert_eq!(write(&mut batching), 0);
        }
        assert_eq!(write(&mut batching), 1);
    }

    #[test]
    fn the_longer_a_stream_the_later_others_see_to_it() {
        let slack = |budget, count| {
            let (mut batching, mut now) = (Batching::default(), Instant::now());
            for _ in 0..count {
                now += Duration::from_micros(1);
                if !batching.holds(now, 10, patience(budget, History::KeepAll)) {
                    batching.sent();
                }
            }
            let due = batching.due().unwrap();
            (batching.relief().unwrap() - due).as_micros()
        };
        assert_eq!(slack(0, 61), 30);
        assert_eq!(slack(0, 10_000), 400);
        assert_eq!(slack(500, 10_000), 0, "a budget is a promise");
    }

    #[test]
    fn a_latency_budget_is_used_at_any_rate() {
        let held = write(300, 100, 100, patience(1000, History::KeepAll));
        let sent = held.iter().filter(|held| !**held).count();
        assert!((15..40).contains(&sent), "{sent}");
    }

    #[test]
    fn the_app_does_something_else() {
        let (mut batching, now) = (Batching::default(), Instant::now());
        let patience = patience(1000, History::KeepAll);
        assert!(batching.holds(now, 100, patience));
        assert!(batching.is_holding(now));
        assert!(!batching.is_holding(now + Duration::from_millis(1)));
        batching.interrupt();
        assert!(!batching.is_holding(now));
    }
}
