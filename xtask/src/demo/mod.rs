//! `cargo xtask demo`: an unmodified Cyclone DDS on one host, two apps on another, and what lies between them.
//!
//! As root the hosts are two network namespaces joined by veth, and the apps, which run as an unprivileged user,
//! use the kernel layer. Otherwise all run on this host's loopback interface and the apps use the in-process layer.

pub(crate) mod app;
mod stage;
mod summary;

use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use clap::Args;

use crate::interrupt;
use stage::Stage;
use summary::{Summary, Table};

/// Samples of each topic per second.
const RATE: u64 = 100;
/// How often the table is drawn.
const TICK: Duration = Duration::from_secs(1);
/// What start, discovery and the last acknowledgements may take beside the time asked for.
const SLACK: Duration = Duration::from_secs(30);

/// `cargo xtask demo`.
#[derive(Args, Debug)]
pub(crate) struct Demo {
    /// How long samples are published.
    #[arg(long, default_value_t = 10)]
    seconds: u64,
    /// Print a JSON object as the last line.
    #[arg(long)]
    json: bool,
}

impl Demo {
    /// Runs the demo; an error unless every sample arrived.
    pub(crate) fn run(&self) -> Result<()> {
        interrupt::catch()?;
        let samples = self.seconds.max(1) * RATE;
        let kernel = nix::unistd::geteuid().is_root();
        if !kernel {
            println!("not root: the demo runs on the in-process layer, on the loopback interface");
        }
        let hosts = if kernel {
            Some(stage::Hosts::new()?)
        } else {
            None
        };
        let mut stage = match &hosts {
            Some(hosts) => Stage::on_kernel_layer(hosts, samples, SLACK)?,
            None => Stage::in_process(samples, SLACK)?,
        };
        let summary = self.watch(&mut stage, samples)?;
        drop(stage);
        println!("{}", summary.text());
        if self.json {
            println!("{}", summary.json());
        }
        ensure!(summary.complete(), "samples were lost");
        Ok(())
    }

    fn watch(&self, stage: &mut Stage<'_>, samples: u64) -> Result<Summary> {
        let mut table = Table::new();
        let end = Instant::now() + Duration::from_secs(self.seconds) + SLACK;
        loop {
            let summary = stage.summary(samples)?;
            table.draw(&summary);
            if stage.is_over() || Instant::now() > end {
                return stage.summary(samples);
            }
            interrupt::check()?;
            std::thread::sleep(TICK);
        }
    }
}
