//! `cargo xtask bench discovery`: what it costs a host to find others and to be found.
//!
//! Three parts, all between two namespaces of this machine: a host with many apps [joins](join) a remote participant;
//! a [crowd](crowd) of remote participants joins a host and stays; a host [answers](answer) the first announcement of
//! a stranger. Ours and Cyclone DDS are measured in the same run, by the same programs at the other end.

mod answer;
mod app;
mod crowd;
mod generator;
mod hosts;
mod join;
mod member;
mod probe;
mod programs;
mod table;
mod tap;
mod traffic;
mod usage;
mod waiting;

use anyhow::Result;
use clap::{Args, ValueEnum};
use serde::Serialize;

pub(crate) use app::App;
pub(crate) use generator::Generator;
pub(crate) use probe::Probe;
pub(super) use programs::as_release_build;

use crate::interrupt;
use programs::Programs;

/// `cargo xtask bench discovery`.
#[derive(Args, Debug)]
pub(crate) struct Discovery {
    /// Print one JSON object as the last line instead of tables.
    #[arg(long)]
    json: bool,
    /// Fewer sizes and shorter steady states: below three minutes instead of twelve.
    #[arg(long)]
    quick: bool,
    /// Measure this part only; may be given several times.
    #[arg(long = "part", value_enum)]
    parts: Vec<Part>,
    /// Join with so many apps only; may be given several times.
    #[arg(long)]
    apps: Vec<usize>,
}

#[derive(Clone, Copy, Debug, Eq, PartialEq, ValueEnum)]
enum Part {
    Join,
    Crowd,
    Answer,
}

/// Everything that was measured.
#[derive(Debug, Default, Serialize)]
struct Report {
    join: Vec<join::Row>,
    crowd: Vec<crowd::Row>,
    answer: Vec<answer::Row>,
    /// What a reader of the numbers should know.
    notes: Vec<String>,
}

/// Whose discovery is measured.
#[derive(Clone, Copy, Debug, Eq, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
enum Stack {
    /// Ours, as it is loaded by default.
    Kernel,
    /// Ours, loaded with `--discovery user`.
    User,
    /// Cyclone DDS.
    Cyclone,
}

impl Discovery {
    /// Measures and prints.
    pub(crate) fn run(&self) -> Result<()> {
        as_release_build()?;
        interrupt::catch()?;
        let programs = Programs::build()?;
        let mut report = Report::default();
        if self.measures(Part::Join) {
            report.join = join::measure(&programs, &self.sizes(), &mut report.notes)?;
        }
        if self.measures(Part::Crowd) {
            report.crowd = crowd::measure(&programs, self.quick, &mut report.notes)?;
        }
        if self.measures(Part::Answer) {
            report.answer = answer::measure(&programs, &mut report.notes)?;
        }
        if self.json {
            println!("{}", serde_json::to_string(&report)?);
        } else {
            print!("{}", table::text(&report));
        }
        Ok(())
    }

    /// How many apps join.
    fn sizes(&self) -> Vec<usize> {
        match (self.apps.as_slice(), self.quick) {
            ([], false) => vec![1, 10, 50, 200],
            ([], true) => vec![1, 50],
            (apps, _) => apps.to_vec(),
        }
    }

    fn measures(&self, part: Part) -> bool {
        self.parts.is_empty() || self.parts.contains(&part)
    }
}
