//! Everything at once while other programs keep all CPUs busy: what is late is complete all the same, and nothing is
//! taken for missed, expired or dead that is only late.

use std::process::Command;
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, anyhow, ensure};
use rtps_tests::process::Process;

use crate::lines::{self, Sample, are_consecutive};
use crate::stage::{Ends, on_both_layers};
use crate::{filters, history, instances, ownership, presentation};

on_both_layers! { everything_at_once }

/// Programs that keep all CPUs busy while the value lives.
pub(crate) struct Busy(#[expect(dead_code, reason = "held for its drop")] Vec<Process>);

impl Busy {
    pub(crate) fn start() -> Result<Self> {
        let count = thread::available_parallelism()?.get();
        let endless = || {
            let mut command = Command::new("sh");
            Process::spawn("busy", command.args(["-c", "while :; do :; done"]))
        };
        (0..count)
            .map(|_| endless())
            .collect::<Result<_>>()
            .map(Self)
    }
}

type Scenario = fn(&Ends<'_>) -> Result<()>;

const SCENARIOS: [(&str, Scenario); 8] = [
    ("instances", samples_of_instances_are_complete),
    ("sets", presentation::sets_of_a_group_are_whole),
    ("deadline", no_deadline_is_missed),
    ("ownership", ownership::the_stronger_writer_takes_over),
    ("lifespan", history::old_samples_are_gone_at_the_reader),
    ("separation", filters::a_minimum_separation),
    ("expression", filters::an_expression),
    ("end", instances::instances_are_disposed),
];

/// Each scenario is alone in its partition.
fn everything_at_once(ends: &Ends<'_>) -> Result<()> {
    let _busy = Busy::start()?;
    thread::scope(|scope| {
        let run = |(name, scenario): (&'static str, Scenario)| {
            let thread = scope.spawn(move || scenario(&ends.in_partition(name)));
            (name, thread)
        };
        for (name, thread) in SCENARIOS.map(run) {
            let result = thread.join().map_err(|_panic| anyhow!("it panicked"));
            result.flatten().context(name)?;
        }
        Ok(())
    })
}

/// Nothing expires either, in a time that is long enough.
fn samples_of_instances_are_complete(ends: &Ends<'_>) -> Result<()> {
    let _publisher =
        ends.publisher("-D l -k 0 -z 0 --num-instances 3 --write-period 10 --lifespan 60000")?;
    let subscriber = ends.subscriber("-D l -k 0")?;
    let samples = lines::wait_samples(&subscriber, 300)?;
    for color in ["BLUE", "BLUE1", "BLUE2"] {
        let of_color = samples.iter().filter(|sample| sample.color == color);
        let sizes: Vec<u32> = of_color.map(|sample: &Sample| sample.size).collect();
        ensure!(
            sizes.first() == Some(&1) && are_consecutive(&sizes),
            "{color}: {sizes:?}"
        );
    }
    Ok(())
}

/// A comfortable period, for longer than that.
fn no_deadline_is_missed(ends: &Ends<'_>) -> Result<()> {
    let period = Duration::from_secs(2);
    let arguments = format!("-D l -k 0 -z 0 -f {}", period.as_millis());
    let publisher = ends.publisher(&format!("{arguments} --write-period 50"))?;
    let subscriber = ends.subscriber(&arguments)?;
    lines::wait_samples(&subscriber, 1)?;
    thread::sleep(2 * period);
    for app in [&publisher, &subscriber] {
        ensure!(!lines::has_line(app, "deadline"), "{}", app.last_text());
    }
    Ok(())
}
