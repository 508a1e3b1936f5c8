//! What we send, as Wireshark's RTPS dissector sees it.

use std::net::IpAddr;

use anyhow::{Result, ensure};
use rtps_tests::capture::{Capture, Decoded};
use rtps_tests::layer::Layer;
use rtps_tests::link::Interface;
use rtps_tests::loss::Loss;
use rtps_tests::peers;
use rtps_tests::require;
use rtps_tests::skip_unless;

use crate::flow::{self, Arguments, EVERYTHING};
use crate::layers::{on_both_layers, on_every_layer};
use crate::stage::Stage;

/// submessageIds (RTPS 2.5, 9.4.5.1.1).
const SUBMESSAGES: [(u8, &str); 8] = [
    (0x06, "ACKNACK"),
    (0x07, "HEARTBEAT"),
    (0x08, "GAP"),
    (0x09, "INFO_TS"),
    (0x0e, "INFO_DST"),
    (0x12, "NACK_FRAG"),
    (0x15, "DATA"),
    (0x16, "DATA_FRAG"),
];

on_every_layer! { everything_decodes }

on_both_layers! { data_is_undirected_until_somebody_comes_late }

/// Entity ids of the built-in writers that announce the participant, its writers and its readers.
const SPDP: &str = "0x000100c2";
const SEDP_PUBLICATIONS: &str = "0x000003c2";
const SEDP_SUBSCRIPTIONS: &str = "0x000004c2";

/// A conversation that has it all: instances that end, fragments, losses, and a reader that does not want the history.
fn everything_decodes(layer: Layer) -> Result<()> {
    skip_unless!(require::kernel(6, 6));
    let stage = Stage::new("decodes")?;
    let (near, far) = (stage.near(layer)?, stage.far(layer)?);
    let captures = [
        Capture::start(near.netns(), &near.interface().name)?,
        Capture::start(far.netns(), &far.interface().name)?,
    ];
    let small = format!("{EVERYTHING} --topic Circle");
    let mut reader = far.app(&format!("--sub {small}"))?;
    let mut writer = near.app(&format!(
        "--pub {small} --instances 2 --count 100 --dispose --linger 50"
    ))?;
    for _ in 0..2 {
        reader.wait_json_event(|event| event["event"] == "disposed", flow::END)?;
    }
    // A GAP tells it what it need not wait for.
    let _late_reader = far.app("--sub --reliable --durability volatile --topic Circle")?;
    flow::wait_matched(&mut writer, 2)?;
    // What gets lost is not captured either; from here on it is repeated.
    let _lossy = stage.lose(Loss::Random(0.2))?;
    let large = Arguments::reliable(20, 1, "--size 20000");
    let large_reader = far.app(&format!("{} --linger 2", large.subscriber))?;
    flow::complete(near.app(&large.publisher)?, [large_reader], 20, 20_000)?;
    let [near_sent, far_sent] = captures.map(Capture::finish);
    let near_sent = decoded(&near_sent?, near.interface(), &[SPDP, SEDP_PUBLICATIONS])?;
    let far_sent = decoded(&far_sent?, far.interface(), &[SPDP, SEDP_SUBSCRIPTIONS])?;
    for (id, name) in SUBMESSAGES {
        let was_sent = near_sent.contains(&id) || far_sent.contains(&id);
        ensure!(was_sent, "no {name} was sent");
    }
    Ok(())
}

/// Checks that nothing of what the host sent is malformed and that those of its built-in writers had something to
/// say; gives the kinds of its submessages.
fn decoded(decoded: &Decoded, host: &Interface, builtin: &[&str]) -> Result<Vec<u8>> {
    // Which of its addresses it sends from depends on which announcement came first.
    let addresses = [IpAddr::from(host.v4), host.v6.into()];
    for address in addresses {
        let malformed = decoded.malformed_from(address);
        ensure!(malformed.is_empty(), "{malformed:?}");
    }
    let sources = format!("(ip.src == {} || ipv6.src == {})", host.v4, host.v6);
    for writer in builtin {
        let from = format!("{sources} && rtps.sm.id == 0x15");
        let frames = decoded.frames(&format!("{from} && rtps.sm.wrEntityId == {writer}"))?;
        ensure!(frames > 0, "no DATA of {writer}");
    }
    Ok(addresses
        .into_iter()
        .flat_map(|address| decoded.from(address))
        .flat_map(|packet| packet.submessages.clone())
        .collect())
}

/// Samples that all matched readers want name no reader; what a late joiner gets names it.
fn data_is_undirected_until_somebody_comes_late(layer: Layer) -> Result<()> {
    let stage = Stage::new("directed")?;
    let host = stage.near(layer)?;
    let capture = Capture::start(host.netns(), &host.interface().name)?;
    let cyclone = peers::cyclone()?;
    let _publisher = host.app(&format!("--pub {EVERYTHING} --count 50 --linger 50"))?;
    let subscriber = format!("--sub {EVERYTHING} --count 50");
    stage.peer(&cyclone, &subscriber)?.wait_success(flow::END)?;
    stage.peer(&cyclone, &subscriber)?.wait_success(flow::END)?;
    let decoded = capture.finish()?;
    let data = format!(
        "ip.src == {} && rtps.sm.id == 0x15 && udp.dstport != 7400 && !(rtps.sm.wrEntityId.entityKind == 0xc2)",
        host.interface().v4
    );
    let undirected = decoded.frames(&format!("{data} && rtps.sm.rdEntityId == 0"))?;
    let directed = decoded.frames(&format!("{data} && !(rtps.sm.rdEntityId == 0)"))?;
    ensure!(undirected > 0, "every sample names a reader");
    ensure!(directed > 0, "no sample names a reader");
    Ok(())
}
