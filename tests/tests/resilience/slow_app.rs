//! An app stops reading (SIGSTOP): its own ring fills, nobody else's, and later it catches up.

use anyhow::{Result, ensure};
use nix::sys::signal::Signal;
use rtps_tests::layer::Layer;
use rtps_tests::stage::{PATIENCE, Stage, counter, eventually};
use rtps_tests::stream::{End, RATE, Stream};
use rtps_tests::{require, skip_unless};

/// Fills a ring with few samples.
const SIZE: u32 = 4000;
/// One would stop when its window is full, which a ring has room for.
const PUBLISHERS: usize = 6;

#[test]
fn only_its_own_samples_wait() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("slow")?;
    let layer = stage.load(&stage.ours)?;
    let _other_layer = stage.load(&stage.theirs)?;
    let count = RATE;
    let common = format!("--topic Slow --durability transient-local --timeout 120 --size {SIZE}");
    let mut slow = stage.app(
        &stage.ours,
        Layer::Kernel,
        &format!("--sub {common} --count {}", count * PUBLISHERS as u64),
    )?;
    let arguments = format!("--pub {common} --count {count} --period-us 1000");
    let publishers = (0..PUBLISHERS).map(|_| stage.app(&stage.theirs, Layer::Kernel, &arguments));
    let publishers: Vec<_> = publishers.collect::<Result<_>>()?;
    let ends = (End::Theirs, End::Ours(Layer::Kernel));
    let mut others = Stream::start(&stage, "Square", ends, 8 * RATE)?;
    slow.wait_json_event(|event| event["x"].as_u64() >= Some(100), PATIENCE)?;
    others.wait_for(100)?;
    slow.signal(Signal::SIGSTOP)?;
    eventually("the ring is full", || {
        let lost = counter(&layer.status()?, "lost_ring_full");
        Ok((lost > 0).then_some(()))
    })?;
    // The others go on all the while.
    others.wait_for(others.position() + 500)?;
    slow.signal(Signal::SIGCONT)?;
    slow.wait_success(2 * PATIENCE)?;
    for mut publisher in publishers {
        publisher.wait_success(PATIENCE)?;
    }
    let events = slow.events();
    let samples = events.iter().filter(|event| event["event"] == "sample");
    let mut numbers: Vec<u64> = samples.filter_map(|event| event["x"].as_u64()).collect();
    numbers.sort_unstable();
    let expected: Vec<u64> = (0..count).flat_map(|x| [x; PUBLISHERS]).collect();
    ensure!(numbers == expected, "{} samples", numbers.len());
    others.finish().map(drop)
}
