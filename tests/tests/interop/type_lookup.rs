//! A program that does not know the type of our writer asks for it (XTypes 1.3 section 7.6.3.3).

use anyhow::{Result, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::peers;
use rtps_tests::stage::PATIENCE;
use rtps_tests::{require, skip_unless};
use serde_json::json;

use crate::stage::Stage;

#[test]
fn rtpsd_tells_cyclone() -> Result<()> {
    tell_cyclone(Layer::Kernel)
}

#[test]
fn the_app_tells_cyclone() -> Result<()> {
    tell_cyclone(Layer::InProcess)
}

fn tell_cyclone(layer: Layer) -> Result<()> {
    skip_unless!(require::root());
    let (stage, peer) = (Stage::new("types")?, peers::cyclone11()?);
    let host = stage.near(layer)?;
    let _greeter = host.greeter()?;
    let mut asker = stage.peer(&peer, "--type --topic Greetings")?;
    asker.wait_success(PATIENCE)?;
    let expected = json!({ "event": "type", "name": "Greeting", "members": ["text"] });
    ensure!(asker.events() == [expected], "{}", asker.text());
    Ok(())
}
