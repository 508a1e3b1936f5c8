//! What `shape_main` prints, understood.

use std::time::Duration;

use anyhow::{Context, Result, bail};
use nix::sys::signal::Signal;
use rtps_tests::process::Process;
use rtps_tests::stage::{PATIENCE, eventually};

/// How long the program may take to end.
const END: Duration = Duration::from_secs(20);

/// A sample line.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(crate) struct Sample {
    pub(crate) topic: String,
    pub(crate) color: String,
    pub(crate) x: i32,
    pub(crate) y: i32,
    pub(crate) size: u32,
    /// The last octet of the additional payload.
    pub(crate) payload: Option<u8>,
}

impl Sample {
    /// Understands a line; `None` for other lines.
    pub(crate) fn parse(line: &str) -> Option<Self> {
        let mut words = line.split_whitespace();
        let mut next = || words.next();
        let (topic, color) = (next()?.to_owned(), next()?.to_owned());
        let (x, y) = (next()?.parse().ok()?, next()?.parse().ok()?);
        let size = next()?.strip_prefix('[')?.strip_suffix(']')?.parse().ok()?;
        let payload =
            next().and_then(|word| word.strip_prefix('{')?.strip_suffix('}')?.parse().ok());
        Some(Self {
            topic,
            color,
            x,
            y,
            size,
            payload,
        })
    }
}

/// All samples printed so far.
pub(crate) fn samples(app: &Process) -> Vec<Sample> {
    app.text().lines().filter_map(Sample::parse).collect()
}

/// The sizes of all samples printed so far.
pub(crate) fn sizes(app: &Process) -> Vec<u32> {
    samples(app).iter().map(|sample| sample.size).collect()
}

/// Waits for so many sample lines in all.
pub(crate) fn wait_samples(app: &Process, count: usize) -> Result<Vec<Sample>> {
    wait_until(app, &format!("{count} samples"), |samples| {
        samples.len() >= count
    })
}

/// Waits until the samples printed so far are `enough`.
pub(crate) fn wait_until(
    app: &Process,
    what: &str,
    enough: impl Fn(&[Sample]) -> bool,
) -> Result<Vec<Sample>> {
    let found = eventually(what, || {
        let samples = samples(app);
        Ok(enough(&samples).then_some(samples))
    });
    found.with_context(|| app.last_text())
}

/// Waits for a line that contains `text`.
pub(crate) fn wait_line(app: &mut Process, text: &str) -> Result<String> {
    app.wait_line(text, PATIENCE)
}

/// Whether a line that contains `text` has been printed.
pub(crate) fn has_line(app: &Process, text: &str) -> bool {
    app.text().lines().any(|line| line.contains(text))
}

/// Ends the program as a user does; it has to end well.
pub(crate) fn interrupt(mut app: Process) -> Result<Process> {
    app.signal(Signal::SIGINT)?;
    app.wait_success(END)?;
    if !has_line(&app, "Done.") {
        bail!("not done:\n{}", app.last_text());
    }
    Ok(app)
}

/// Whether each size follows the one before.
pub(crate) fn are_consecutive(sizes: &[u32]) -> bool {
    sizes.windows(2).all(|pair| pair[1] == pair[0] + 1)
}

/// Whether sizes only grow.
pub(crate) fn are_ascending(sizes: &[u32]) -> bool {
    sizes.windows(2).all(|pair| pair[1] > pair[0])
}
