//! The host gets another address, as it does when it moves to another network.

use anyhow::Result;
use rtps_tests::layer::Layer;
use rtps_tests::stage::{Stage, eventually};
use rtps_tests::stream::{End, RATE, Stream};
use rtps_tests::{require, skip_unless};

#[test]
fn streams_follow_to_the_new_address() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("addresses")?;
    let _layer = stage.load(&stage.ours)?;
    let other_layer = stage.load(&stage.theirs)?;
    let ours = End::Ours(Layer::Kernel);
    let mut streams = [
        Stream::start(&stage, "Square", (End::Theirs, ours), 4 * RATE)?,
        Stream::start(&stage, "Circle", (ours, End::Theirs), 4 * RATE)?,
    ];
    for stream in &mut streams {
        stream.wait_for(500)?;
    }
    let interface = &stage.ours.interface;
    let ip = |what: &str| {
        stage
            .ours
            .netns
            .ip(&format!("address {what}/24 dev {}", interface.name))
    };
    ip("add 10.1.0.77")?;
    // Told by the old address; who speaks from an unknown one would be an impostor.
    eventually("the other host knows the new address", || {
        let discovery = serde_json::to_string(&other_layer.status()?.domains)?;
        Ok(discovery.contains("10.1.0.77").then_some(()))
    })?;
    // The kernel would take the second address of a network away together with the first.
    ip(&format!("delete {}", interface.v4))?;
    ip("replace 10.1.0.77")?;
    for stream in streams {
        stream.finish()?;
    }
    // Cyclone DDS does not follow, but finds what is new.
    Stream::start(&stage, "After", (End::Cyclone, ours), 100)?
        .finish()
        .map(drop)
}
