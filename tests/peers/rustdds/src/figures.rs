//! What is measured, shared with the thread that prints it in the end.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Round-trip times.
#[derive(Default)]
pub struct RoundTrips {
    begin: Option<Instant>,
    times: Vec<Duration>,
}

impl RoundTrips {
    pub fn shared() -> Arc<Mutex<Self>> {
        Arc::default()
    }

    /// When measuring begins.
    pub fn begin(shared: &Mutex<Self>, begin: Instant) {
        lock(shared).begin = Some(begin);
    }

    pub fn add(shared: &Mutex<Self>, time: Duration) {
        lock(shared).times.push(time);
    }

    /// Percentiles by rank, zeros when there was no round trip.
    pub fn summary(shared: &Mutex<Self>) -> String {
        let mut this = lock(shared);
        this.times.sort_unstable();
        let count = this.times.len();
        let at = |share: f64| {
            let rank = (count as f64 * share).ceil() as usize;
            let time = this.times.get(rank.saturating_sub(1));
            time.map_or(0.0, |time| time.as_secs_f64() * 1e6)
        };
        let seconds = this
            .begin
            .map_or(0.0, |begin| begin.elapsed().as_secs_f64());
        let [p50, p90, p99, p999, max] = [0.5, 0.9, 0.99, 0.999, 1.0].map(at);
        format!(
            r#"{{"event":"summary","role":"ping","count":{count},"lost":0,"seconds":{seconds},"p50_us":{p50},"p90_us":{p90},"p99_us":{p99},"p999_us":{p999},"max_us":{max}}}"#
        )
    }
}

/// Numbered samples as they came.
#[derive(Default)]
pub struct Arrivals {
    expected: Option<u64>,
    count: u64,
    bytes: usize,
    lost: u64,
    period: Option<(Instant, Instant)>,
}

impl Arrivals {
    pub fn shared() -> Arc<Mutex<Self>> {
        Arc::default()
    }

    /// Gaps always count, samples only when they are `measured`.
    pub fn add(shared: &Mutex<Self>, number: u64, size: usize, measured: bool) {
        let mut this = lock(shared);
        let expected = this.expected.unwrap_or(number);
        this.lost += number.saturating_sub(expected);
        this.expected = Some(number + 1);
        if measured {
            let now = Instant::now();
            this.count += 1;
            this.bytes += size;
            this.period.get_or_insert((now, now)).1 = now;
        }
    }

    pub fn summary(shared: &Mutex<Self>) -> String {
        let this = lock(shared);
        let (count, lost) = (this.count, this.lost);
        let seconds = this
            .period
            .map_or(0.0, |(first, last)| (last - first).as_secs_f64());
        let a_second = |count: f64| if seconds > 0.0 { count / seconds } else { 0.0 };
        let (samples, bytes) = (a_second(count as f64), a_second(this.bytes as f64));
        format!(
            r#"{{"event":"summary","role":"sub","count":{count},"lost":{lost},"seconds":{seconds},"samples_per_s":{samples},"bytes_per_s":{bytes}}}"#
        )
    }
}
