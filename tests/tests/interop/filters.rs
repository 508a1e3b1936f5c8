//! Content filters: writers heed what the other vendor's readers want, and say so.

use std::net::IpAddr;

use anyhow::{Context, Result, ensure};
use rtps_tests::capture::{Capture, Decoded};
use rtps_tests::layer::Layer;
use rtps_tests::peers;
use rtps_tests::process::Process;
use rtps_user::qos::ContentFilter;
use rtps_user::wire::{Submessage, Submessages};

use crate::flow::{self, EVERYTHING};
use crate::layers::on_both_layers;
use crate::stage::Stage;

const SAMPLES: u64 = 60;
const UNWANTED: u64 = 20;

on_both_layers! {
    fast_dds_filters_for_us,
    we_filter_for_fast_dds,
}

fn publisher() -> String {
    format!("--pub {EVERYTHING} --period-us 500 --count {SAMPLES}")
}

fn subscriber() -> String {
    let wanted = SAMPLES - UNWANTED;
    let filter = format!("--filter x>=%0 --filter-parameter {UNWANTED}");
    format!("--sub {EVERYTHING} {filter} --count {wanted} --linger 0.2")
}

/// What both readers announce.
fn announced() -> ContentFilter {
    ContentFilter {
        name: "Filtered".to_owned(),
        related_topic: "Square".to_owned(),
        class: ContentFilter::SQL.to_owned(),
        expression: "x>=%0".to_owned(),
        parameters: vec![UNWANTED.to_string()],
    }
}

fn fast_dds_filters_for_us(layer: Layer) -> Result<()> {
    let stage = Stage::new("filters-in")?;
    let host = stage.near(layer)?;
    let [_, far] = stage.hosts();
    let capture = Capture::start(&far.netns, &far.interface.name)?;
    let app = host.app(&subscriber())?;
    let fast_dds = stage.peer(&peers::fast_dds()?, &format!("{} --filters", publisher()))?;
    ensure_wanted(fast_dds, app)?;
    ensure_passed(&capture.finish()?, "10.1.0.2")
}

fn we_filter_for_fast_dds(layer: Layer) -> Result<()> {
    let stage = Stage::new("filters-out")?;
    let host = stage.near(layer)?;
    let [_, far] = stage.hosts();
    let capture = Capture::start(&far.netns, &far.interface.name)?;
    let fast_dds = stage.peer(&peers::fast_dds()?, &subscriber())?;
    let app = host.app(&publisher())?;
    ensure_wanted(app, fast_dds)?;
    ensure_passed(&capture.finish()?, "10.1.0.1")
}

fn ensure_wanted(mut publisher: Process, mut subscriber: Process) -> Result<()> {
    subscriber.wait_success(flow::END)?;
    publisher.wait_success(flow::END)?;
    let numbers = flow::numbers(&subscriber);
    ensure!(numbers.iter().copied().eq(UNWANTED..SAMPLES), "{numbers:?}");
    Ok(())
}

/// Samples come with the result of the filter that the reader announced, by its signature.
fn ensure_passed(sent: &Decoded, writer: &str) -> Result<()> {
    let signature = announced().signature();
    let mut results = Vec::new();
    for packet in sent.from(writer.parse::<IpAddr>()?) {
        let Ok((_, submessages)) = Submessages::parse(&packet.payload) else {
            continue;
        };
        for submessage in submessages {
            if let Ok(Submessage::Data(data)) = submessage
                && let Some(filters) = data.filters
            {
                results.push(filters.result_of(signature).context("another signature")?);
            }
        }
    }
    let passed = results.iter().filter(|passed| **passed).count() as u64;
    ensure!(passed >= SAMPLES - UNWANTED, "{results:?}");
    Ok(())
}
