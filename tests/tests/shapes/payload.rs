//! Samples beyond a datagram, and both representations.

use anyhow::{Result, ensure};

use crate::lines;
use crate::stage::{Ends, on_both_layers, on_the_in_process_layer};

on_both_layers! {
    large_samples,
}

on_the_in_process_layer! {
    large_samples_in_small_fragments,
    both_representations,
}

fn large_samples(ends: &Ends<'_>) -> Result<()> {
    arrive(ends, "--additional-payload-size 100000", "")
}

/// Fragments are as large as asked for, but never larger than a datagram carries.
fn large_samples_in_small_fragments(ends: &Ends<'_>) -> Result<()> {
    for (asked, sent) in [(1000, "== 1000"), (65_535, "in {1300 .. 1472}")] {
        let capture = ends.capture()?;
        let size = format!("--additional-payload-size 20000 --datafrag-size {asked}");
        arrive(ends, &size, "")?;
        let capture = capture.finish()?;
        let fragments = capture.frames("rtps.data_frag.size")?;
        let as_wanted = capture.frames(&format!("rtps.data_frag.size {sent}"))?;
        ensure!(
            fragments > 0 && fragments == as_wanted,
            "{as_wanted} of {fragments}"
        );
    }
    Ok(())
}

/// All samples from the first on.
fn arrive(ends: &Ends<'_>, publisher: &str, subscriber: &str) -> Result<()> {
    let publisher = ends.publisher(&format!("-D l -k 0 -z 0 {publisher}"))?;
    let subscriber = ends.subscriber(&format!("-D l -k 0 {subscriber}"))?;
    let received = lines::wait_samples(&subscriber, 20)?;
    let written = lines::samples(&publisher);
    ensure!(received[..20] == written[..20], "{received:?}");
    ensure!(
        received.iter().all(|sample| sample.payload == Some(255)),
        "{received:?}"
    );
    Ok(())
}

fn both_representations(ends: &Ends<'_>) -> Result<()> {
    for version in [1, 2] {
        arrive(
            ends,
            &format!("-x {version} --additional-payload-size 1"),
            &format!("-x {version}"),
        )?;
    }
    Ok(())
}
