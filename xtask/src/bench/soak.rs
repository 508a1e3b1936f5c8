//! `cargo xtask bench soak`: minutes at 80 % of the peak rate, in which memory must stay flat and nothing get lost.

use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use clap::Args;

use super::discovery;
use super::exchange::{Exchange, Kind};
use super::figures::Figures;
use super::hosts::Hosts;
use super::machine::Baseline;
use super::programs::Programs;
use super::rounds::Run;
use super::row::{Case, Pinning, Row, Stack};
use super::table;
use crate::interrupt;

/// Of the peak rate.
const SHARE: f64 = 0.8;
/// How long the peak rate is measured.
const PEAK_SECONDS: f64 = 3.0;
/// How often memory is looked at; each look is a row.
const LOOKS: u32 = 10;

/// Its options.
#[derive(Args, Debug)]
pub(crate) struct Soak {
    /// Minutes of it.
    #[arg(long, default_value_t = 10.0)]
    minutes: f64,
    /// The stack.
    #[arg(long, value_enum, default_value_t = Stack::Kernel)]
    stack: Stack,
    /// Bytes of a sample.
    #[arg(long, default_value_t = 100)]
    size: usize,
    /// Print a JSON array of rows as the last line instead of a table.
    #[arg(long)]
    json: bool,
}

impl Soak {
    /// Measures the peak, then writes slower for minutes; prints the memory of the larger program at equal times, and the
    /// losses of the whole.
    pub(crate) fn run(&self) -> Result<()> {
        discovery::as_release_build()?;
        interrupt::catch()?;
        let mut cases = vec![self.case()];
        let programs = Programs::for_cases(&mut cases)?;
        let case = cases.first().context("the stack is missing")?;
        let hosts = Hosts::pair()?;
        let _layers = hosts.load(&programs, &cases)?;
        let exchange = |rate| -> Result<_> {
            Ok(Exchange {
                programs: &programs,
                kind: Kind::Stream,
                case,
                rate,
                sides: hosts.of(case.stack)?,
            })
        };
        let run = Run {
            seconds: PEAK_SECONDS,
            baseline: Baseline::measure()?,
            counts_syscalls: false,
        };
        let peak = exchange(None)?.run(run)?.samples_per_s;
        let rate = peak.context("the peak was not measured")? * SHARE;
        let rows = self.soak(case, &exchange(Some(rate as u32))?)?;
        table::print(&rows, self.json)
    }

    fn case(&self) -> Case {
        Case {
            bench: "soak",
            stack: self.stack,
            size: self.size,
            pinning: Pinning::Free,
            readers: 1,
        }
    }

    fn soak(&self, case: &Case, exchange: &Exchange<'_>) -> Result<Vec<Row>> {
        let mut cast = exchange.start_steady()?;
        let pause = Duration::from_secs_f64(60.0 * self.minutes / f64::from(LOOKS));
        let mut rows = Vec::new();
        for look in 0..=LOOKS {
            if look > 0 {
                wait(pause)?;
            }
            let figures = Figures {
                rss_kb: Some(cast.resident_kb()?),
                ..Figures::default()
            };
            eprintln!(
                "after {look}/{LOOKS}: {} kB",
                figures.rss_kb.unwrap_or_default()
            );
            let case = *case;
            rows.push(Row { case, figures });
        }
        let outcome = cast.end(Kind::Stream)?;
        if let Some(last) = rows.last_mut() {
            last.figures.samples_per_s = outcome.figures.samples_per_s;
            last.figures.lost = outcome.figures.lost;
        }
        Ok(rows)
    }
}

/// # Errors
/// After a signal to this process.
fn wait(time: Duration) -> Result<()> {
    let deadline = Instant::now() + time;
    while Instant::now() < deadline {
        interrupt::check()?;
        let left = deadline.saturating_duration_since(Instant::now());
        thread::sleep(left.min(Duration::from_millis(200)));
    }
    Ok(())
}
