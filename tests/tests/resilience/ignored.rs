//! What an app ignores it ignores for itself alone, whatever becomes of rtpsd.

use anyhow::{Result, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::process::Process;
use rtps_tests::stage::{PATIENCE, Stage, eventually};
use rtps_tests::{require, skip_unless};
use serde_json::Value;

#[test]
fn a_writer_is_ignored_by_one_app_alone() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("ignored")?;
    let layer = stage.load(&stage.ours)?;
    let common = "--best-effort --timeout 120";
    let app = |arguments: &str| {
        let arguments = format!("--sub {common} {arguments}");
        stage.app(&stage.ours, Layer::Kernel, &arguments)
    };
    let (mut ignorant, mut other) = (app("--ignore-after 50")?, app("")?);
    let _publisher = stage.cyclone(&format!("--pub {common} --period-us 1000"))?;
    ignorant.wait_json_event(is_end_of_match, PATIENCE)?;
    go_on(&mut other, 500)?;
    // What had come before it was ignored may have been taken after that.
    let seen = samples(&ignorant);
    layer.kill()?;
    let layer = stage.load(&stage.ours)?;
    eventually("both apps come back", || {
        let status = layer.status()?;
        let back = status.apps.iter().filter(|app| app.pid.is_some());
        Ok((back.count() == 2).then_some(()))
    })?;
    go_on(&mut other, 500)?;
    // The newcomer is told of the match after those who came back.
    let mut newcomer = app("")?;
    go_on(&mut newcomer, 100)?;
    ensure!(samples(&ignorant) == seen, "{}", ignorant.last_text());
    let matches = ignorant.events().into_iter().filter(is_match).count();
    ensure!(matches == 1, "{}", ignorant.last_text());
    Ok(())
}

/// Waits for so many samples.
fn go_on(app: &mut Process, count: usize) -> Result<()> {
    for _ in 0..count {
        app.wait_json_event(|event| event["event"] == "sample", PATIENCE)?;
    }
    Ok(())
}

fn samples(app: &Process) -> usize {
    let events = app.events().into_iter();
    events.filter(|event| event["event"] == "sample").count()
}

fn is_match(event: &Value) -> bool {
    event["event"] == "matched" && event["current"] == 1
}

fn is_end_of_match(event: &Value) -> bool {
    event["event"] == "matched" && event["current"] == 0
}
