//! An app with many endpoints, which reports when all are matched and when a match is over.
//!
//! It writes the topics Out0, Out1... and reads In0, In1...; a remote does it the other way round, so that apps match
//! remotes only. Policies are the standard's defaults, so that matches cause no traffic of their own. The program tests/peers/discovery.c is the same on Cyclone DDS.

use std::time::Duration;

use anyhow::Result;
use clap::Args;
use rtps_socket::{DomainParticipant, Qos, StatusEvent};
use serde_json::json;

use super::hosts::ENDPOINTS;
use crate::demo::app::ShapeType;

/// Started by the benchmark itself, as an unprivileged user.
#[derive(Args, Debug)]
pub(crate) struct App {
    /// Writers, and as many readers.
    #[arg(long, default_value_t = ENDPOINTS)]
    endpoints: usize,
    /// Matches of each endpoint that are waited for.
    #[arg(long, default_value_t = 1)]
    expect: usize,
}

/// Whole runs take less; an app ends with the benchmark.
const PATIENCE: Duration = Duration::from_secs(3600);
/// Room for several of the largest datagrams: samples are not what is measured.
const RING_BYTES: u32 = 512 << 10;

impl App {
    /// Runs until it is ended; prints JSON lines.
    pub(crate) fn run(&self) -> Result<()> {
        let participant: DomainParticipant =
            DomainParticipant::builder().ring_bytes(RING_BYTES).open()?;
        let (mut writers, mut readers) = (Vec::new(), Vec::new());
        for number in 0..self.endpoints {
            let out = participant.create_topic::<ShapeType>(&format!("Out{number}"))?;
            writers.push(participant.create_writer(&out, Qos::default())?);
            let into = participant.create_topic::<ShapeType>(&format!("In{number}"))?;
            readers.push(participant.create_reader(&into, Qos::default())?);
        }
        writers
            .iter()
            .for_each(|writer| writer.set_listener(report));
        readers
            .iter()
            .for_each(|reader| reader.set_listener(report));
        println!("{}", json!({"event": "ready"}));
        for writer in &writers {
            writer.wait_for_matched(self.expect, PATIENCE)?;
        }
        for reader in &readers {
            reader.wait_for_matched(self.expect, PATIENCE)?;
        }
        println!("{}", json!({"event": "matched", "current": self.expect}));
        std::thread::sleep(PATIENCE);
        Ok(())
    }
}

/// Tells the end of a match.
fn report(event: StatusEvent) {
    let lost = match event {
        StatusEvent::PublicationMatched { change, reader, .. } if change < 0 => reader,
        StatusEvent::SubscriptionMatched { change, writer, .. } if change < 0 => writer,
        _ => return,
    };
    let participant = lost.prefix.to_string();
    println!(
        "{}",
        json!({"event": "unmatched", "participant": participant})
    );
}
