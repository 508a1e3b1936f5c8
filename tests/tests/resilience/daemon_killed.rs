//! rtpsd is killed (SIGKILL) and started again, while streams run both ways.

use std::thread;
use std::time::Duration;

use anyhow::{Result, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::stage::{Stage, eventually};
use rtps_tests::stream::{End, RATE, Stream};
use rtps_tests::{require, skip_unless};

/// For so long nobody does its work.
const ABSENCE: Duration = Duration::from_secs(3);

#[test]
fn nobody_notices_and_newcomers_are_welcome() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("killed")?;
    let ours = End::Ours(Layer::Kernel);
    let mut layer = stage.load(&stage.ours)?;
    let mut streams = [
        Stream::start(&stage, "Square", (End::Cyclone, ours), 20 * RATE)?,
        Stream::start(&stage, "Circle", (ours, End::Cyclone), 20 * RATE)?,
    ];
    for round in ["First", "Second"] {
        for stream in &mut streams {
            stream.wait_for(stream.position() + 200)?;
        }
        let before = layer.status()?;
        layer.kill()?;
        thread::sleep(ABSENCE);
        layer = stage.load(&stage.ours)?;
        let after = eventually("the apps come back", || {
            let status = layer.status()?;
            let names = status.apps.iter().filter(|app| app.pid.is_some());
            Ok((names.count() == before.apps.len()).then_some(status))
        })?;
        let slots = |status: &rtpsd::Status| -> Vec<u8> {
            status.apps.iter().map(|app| app.slot).collect()
        };
        ensure!(slots(&before) == slots(&after), "{before:?}\n{after:?}");
        for (number, ends) in [(End::Cyclone, ours), (ours, End::Cyclone)]
            .iter()
            .enumerate()
        {
            let topic = format!("{round}{number}");
            Stream::start(&stage, &topic, *ends, 100)?.finish()?;
        }
    }
    for stream in streams {
        stream.finish()?;
    }
    Ok(())
}

/// Between two kernel layers, of which both are killed, one after the other.
#[test]
fn two_layers_survive_each_others_restart() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("killed-both")?;
    let (first, second) = (stage.load(&stage.ours)?, stage.load(&stage.theirs)?);
    let ends = (End::Ours(Layer::Kernel), End::Theirs);
    let back = (End::Theirs, End::Ours(Layer::Kernel));
    let mut streams = [
        Stream::start(&stage, "Square", ends, 10 * RATE)?,
        Stream::start(&stage, "Circle", back, 10 * RATE)?,
    ];
    for stream in &mut streams {
        stream.wait_for(200)?;
    }
    first.kill()?;
    thread::sleep(Duration::from_secs(1));
    let _first = stage.load(&stage.ours)?;
    second.kill()?;
    thread::sleep(Duration::from_secs(1));
    let _second = stage.load(&stage.theirs)?;
    for stream in streams {
        stream.finish()?;
    }
    Ok(())
}
