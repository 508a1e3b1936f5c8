//! Every vendor, every scenario, both directions, both layers; the outcome of a run is a table, `target/interop.md`, of
//! which `docs/interop.md` is a copy.
//!
//! A test is a scenario with one vendor on one layer: what the peer publishes first, then what it subscribes. Where a
//! vendor lacks what a scenario needs, the table says so and the test has nothing to do.

mod course;
mod scenario;
mod soak;
mod table;
mod vendor;

use anyhow::{Context, Result};
use rtps_tests::layer::Layer;

use crate::stage::Stage;
use course::Ends;
use scenario::Scenario;
use table::Outcome;
use vendor::Vendor;

/// Which end is ours.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum Direction {
    /// The peer publishes.
    FromPeer,
    /// We publish.
    ToPeer,
}

impl Direction {
    const BOTH: [Self; 2] = [Self::FromPeer, Self::ToPeer];
}

/// Makes the tests of scenarios: `SCENARIO::VENDOR::kernel` and `SCENARIO::VENDOR::in_process`.
macro_rules! with_every_vendor {
    ($($module:ident($scenario:ident)),+ $(,)?) => {
        $(mod $module {
            crate::matrix::scenario_tests! {
                $scenario:
                cyclone_0_10(Cyclone010),
                cyclone_11(Cyclone11),
                fast_dds(FastDds),
                rust_dds(RustDds),
                dust_dds(DustDds)
            }
        })+
    };
}

/// The tests of one scenario.
macro_rules! scenario_tests {
    ($scenario:ident: $($module:ident($vendor:ident)),+) => {
        $(mod $module {
            use crate::matrix::{Scenario, Vendor, run};
            use rtps_tests::{layer::Layer, require, skip_unless};

            #[test]
            fn kernel() -> anyhow::Result<()> {
                skip_unless!(require::root());
                skip_unless!(require::kernel(6, 6));
                run(Scenario::$scenario, Vendor::$vendor, Layer::Kernel)
            }

            #[test]
            fn in_process() -> anyhow::Result<()> {
                skip_unless!(require::root());
                skip_unless!(require::kernel(6, 6));
                run(Scenario::$scenario, Vendor::$vendor, Layer::InProcess)
            }
        })+
    };
}
use scenario_tests;

with_every_vendor! {
    best_effort(BestEffort),
    reliable_with_loss(Loss),
    dispose(Dispose),
    unregister(Unregister),
    late_joiner(LateJoiner),
    hundred_kilobytes(HundredKilobytes),
    four_megabytes(FourMegabytes),
    incompatible_qos(IncompatibleQos),
    partitions(Partitions),
}

/// Plays a scenario in both directions, the second also when the first fails, and records how it went.
fn run(scenario: Scenario, vendor: Vendor, layer: Layer) -> Result<()> {
    let stage = Stage::new("matrix")?;
    if vendor.lacks_ipv6() {
        for host in stage.hosts() {
            host.netns.disable_ipv6()?;
        }
    }
    let host = stage.near(layer)?;
    let peer = vendor.peer()?;
    let outcomes = Direction::BOTH.map(|direction| {
        if let Some(reason) = vendor.lacks(scenario, direction) {
            let outcome = Outcome::Lacking(reason);
            return table::record(layer, vendor, direction, scenario, outcome);
        }
        let played = scenario.play(&Ends::new(&stage, &host, &peer, direction));
        table::record(layer, vendor, direction, scenario, Outcome::of(&played))?;
        played.with_context(|| format!("{direction:?}"))
    });
    outcomes.into_iter().collect()
}
