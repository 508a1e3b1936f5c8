//! What the matrix found, as a document: rewritten with every outcome, so that it is there however the run ends.

use std::fmt::Write;
use std::fs;
use std::sync::{Mutex, PoisonError};

use anyhow::{Context, Result};
use rtps_tests::binaries;
use rtps_tests::layer::Layer;

use super::Direction;
use super::scenario::Scenario;
use super::vendor::Vendor;

const LAYERS: [Layer; 2] = [Layer::Kernel, Layer::InProcess];

/// How a scenario went.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Outcome {
    Passed,
    Failed,
    /// The peer lacks what it needs.
    Lacking(&'static str),
}

impl Outcome {
    pub(super) fn of(played: &Result<()>) -> Self {
        match played {
            Ok(()) => Self::Passed,
            Err(_) => Self::Failed,
        }
    }
}

/// One cell of the table.
struct Cell {
    layer: Layer,
    vendor: Vendor,
    direction: Direction,
    scenario: Scenario,
    outcome: Outcome,
}

static CELLS: Mutex<Vec<Cell>> = Mutex::new(Vec::new());

/// Adds an outcome and writes the document anew.
pub(super) fn record(
    layer: Layer,
    vendor: Vendor,
    direction: Direction,
    scenario: Scenario,
    outcome: Outcome,
) -> Result<()> {
    let mut cells = CELLS.lock().unwrap_or_else(PoisonError::into_inner);
    cells.push(Cell {
        layer,
        vendor,
        direction,
        scenario,
        outcome,
    });
    let path = binaries::target_folder().join("interop.md");
    fs::write(&path, document(&cells)?).with_context(|| format!("writing {}", path.display()))
}

fn document(cells: &[Cell]) -> Result<String> {
    let mut text = String::from(
        "# Interoperability\n\n\
         Written by the tests (`cargo xtask test`, or `cargo test -p rtps-tests --test interop matrix`) to\n\
         `target/interop.md`; the page in `docs` is a copy. Each cell is one publisher and one subscriber on two hosts, ours\n\
         and an unmodified library of another vendor; `-` is a cell that the run left out. dust_dds is met without IPv6: it\n\
         ends with a panic when somebody announces an IPv6 locator.\n",
    );
    let mut notes = Vec::new();
    for layer in LAYERS {
        writeln!(text, "\n## On the {} layer\n", layer.name())?;
        write_table(&mut text, cells, layer, &mut notes)?;
    }
    text.push('\n');
    for (number, note) in notes.iter().enumerate() {
        writeln!(text, "({}) {note}.\n", number + 1)?;
    }
    writeln!(text, "## What the columns mean\n")?;
    for scenario in Scenario::ALL {
        writeln!(text, "- *{}*: {}", scenario.title(), scenario.meaning())?;
    }
    Ok(text)
}

fn write_table(
    text: &mut String,
    cells: &[Cell],
    layer: Layer,
    notes: &mut Vec<&'static str>,
) -> Result<()> {
    let titles = Scenario::ALL.map(Scenario::title);
    writeln!(text, "| from → to | {} |", titles.join(" | "))?;
    writeln!(text, "|---|{}", "---|".repeat(titles.len()))?;
    for vendor in Vendor::ALL {
        for direction in Direction::BOTH {
            match direction {
                Direction::FromPeer => write!(text, "| {} → ours |", vendor.name())?,
                Direction::ToPeer => write!(text, "| ours → {} |", vendor.name())?,
            }
            for scenario in Scenario::ALL {
                let cell = cells.iter().rev().find(|cell| {
                    cell.layer == layer
                        && cell.vendor == vendor
                        && cell.direction == direction
                        && cell.scenario == scenario
                });
                write!(text, " {} |", words(cell, notes))?;
            }
            text.push('\n');
        }
    }
    Ok(())
}

/// What a cell says; a reason that it needs is added to the notes.
fn words(cell: Option<&Cell>, notes: &mut Vec<&'static str>) -> String {
    match cell.map(|cell| cell.outcome) {
        None => "-".to_owned(),
        Some(Outcome::Passed) => "yes".to_owned(),
        Some(Outcome::Failed) => "**failed**".to_owned(),
        Some(Outcome::Lacking(reason)) => {
            let known = notes.iter().position(|note| *note == reason);
            let number = known.unwrap_or_else(|| {
                notes.push(reason);
                notes.len() - 1
            });
            format!("peer cannot ({})", number + 1)
        }
    }
}

#[test]
fn a_document_says_what_was_found_and_why_not() -> Result<()> {
    let cell = |scenario, outcome| Cell {
        layer: Layer::Kernel,
        vendor: Vendor::RustDds,
        direction: Direction::ToPeer,
        scenario,
        outcome,
    };
    let text = document(&[
        cell(Scenario::BestEffort, Outcome::Passed),
        cell(Scenario::Loss, Outcome::Failed),
        cell(Scenario::Dispose, Outcome::Lacking("it cannot")),
    ])?;
    let row = text.lines().find(|line| line.contains("ours → RustDDS"));
    let row = row.context("no row")?;
    let start = "| ours → RustDDS 0.15 | yes | **failed** | peer cannot (1) | - |";
    anyhow::ensure!(row.starts_with(start), "{row}");
    anyhow::ensure!(text.contains("(1) it cannot.\n"), "{text}");
    Ok(())
}
