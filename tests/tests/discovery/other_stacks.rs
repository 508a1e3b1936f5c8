//! Other stacks on the same host: the kernel answers for us, and leaves to them what they have to hear.

use anyhow::Result;
use rtps_tests::layer::Layer;
use rtps_tests::process::Process;
use rtps_tests::stage::{PATIENCE, Stage};
use rtps_tests::{require, skip_unless};

use crate::support::{ensure_kernel_answers, while_stopped};

const COMMON: &str = "--reliable --durability transient-local --count 100 --timeout 100";

#[test]
fn cyclone_beside_us_and_across_the_link() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("beside")?;
    let mut layer = stage.load(&stage.ours)?;
    ensure_kernel_answers(&mut layer, &stage.theirs, stage.ours.interface.v4)?;
    // Each writes to both of the others.
    let publisher =
        |topic: &str| format!("--pub --topic {topic} {COMMON} --wait-match 2 --linger 1");
    let subscriber = |topic: &str| format!("--sub --topic {topic} {COMMON} --linger 1");
    let app = |arguments: &str| stage.app(&stage.ours, Layer::Kernel, arguments);
    let beside = |arguments: &str| stage.cyclone_on(&stage.ours, arguments);
    let across = |arguments: &str| stage.cyclone(arguments);
    let programs = vec![
        app(&publisher("App"))?,
        beside(&subscriber("App"))?,
        across(&subscriber("App"))?,
        beside(&publisher("Beside"))?,
        app(&subscriber("Beside"))?,
        across(&subscriber("Beside"))?,
        across(&publisher("Across"))?,
        app(&subscriber("Across"))?,
        beside(&subscriber("Across"))?,
    ];
    finish(programs)
}

/// They find each other by the same multicast that the kernel takes our part of.
#[test]
fn cyclone_to_cyclone_while_rtpsd_stands_still() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("among-themselves")?;
    let mut layer = stage.load(&stage.ours)?;
    while_stopped(&mut layer, || {
        finish(vec![
            stage.cyclone_on(&stage.ours, &format!("--sub {COMMON} --linger 1"))?,
            stage.cyclone(&format!("--pub {COMMON}"))?,
        ])
    })
}

fn finish(programs: Vec<Process>) -> Result<()> {
    for mut program in programs {
        program.wait_success(PATIENCE)?;
    }
    Ok(())
}
