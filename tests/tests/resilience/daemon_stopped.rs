//! rtpsd does not run at all for a while (SIGSTOP): samples don't pass through it.

use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use nix::sys::signal::Signal;
use rtps_tests::layer::{KernelLayer, Layer};
use rtps_tests::stage::Stage;
use rtps_tests::stream::{End, RATE, Stream};
use rtps_tests::{require, skip_unless};

const STOPPED: Duration = Duration::from_secs(3);
/// The longest pause that a busy machine may put into a stream.
const PAUSE: Duration = Duration::from_secs(1);

#[test]
fn streams_between_two_kernel_layers_go_on() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("stopped")?;
    let mut layers = [stage.load(&stage.ours)?, stage.load(&stage.theirs)?];
    let ends = (End::Ours(Layer::Kernel), End::Theirs);
    let streams = vec![Stream::start(&stage, "Square", ends, 8 * RATE)?];
    outlive_a_stop(&mut layers, streams)
}

#[test]
fn streams_from_and_to_cyclone_go_on() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("stopped-cyclone")?;
    let mut layers = [stage.load(&stage.ours)?];
    let ours = End::Ours(Layer::Kernel);
    let streams = vec![
        Stream::start(&stage, "Square", (End::Cyclone, ours), 8 * RATE)?,
        Stream::start(&stage, "Circle", (ours, End::Cyclone), 8 * RATE)?,
    ];
    outlive_a_stop(&mut layers, streams)
}

fn outlive_a_stop(layers: &mut [KernelLayer<'_>], mut streams: Vec<Stream>) -> Result<()> {
    for stream in &mut streams {
        stream.wait_for(500)?;
    }
    let before = Instant::now();
    for layer in &mut *layers {
        layer.process().signal(Signal::SIGSTOP)?;
    }
    thread::sleep(STOPPED);
    let after = Instant::now();
    for layer in &mut *layers {
        layer.process().signal(Signal::SIGCONT)?;
    }
    for stream in streams {
        let pause = stream.finish()?.longest_pause(before, after);
        ensure!(
            pause < PAUSE,
            "no sample for {pause:?} while rtpsd stood still"
        );
    }
    Ok(())
}
