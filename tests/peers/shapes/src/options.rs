//! The command line: that of `peer.h`.

use std::time::Duration;

use clap::{Args, Parser, ValueEnum};

/// DURABILITY of both ends.
#[derive(Clone, Copy, Eq, PartialEq, ValueEnum)]
pub enum Durability {
    /// Late readers get what is written from then on.
    Volatile,
    /// Late readers get what the writer keeps.
    TransientLocal,
}

/// What the program does.
#[derive(Args)]
#[group(required = true, multiple = false)]
pub struct Role {
    /// Write samples.
    #[arg(long = "pub")]
    pub publish: bool,
    /// Read samples.
    #[arg(long = "sub")]
    pub subscribe: bool,
}

/// Publishes or subscribes shapes, one JSON object a line.
#[derive(Parser)]
#[command(args_override_self = true)]
pub struct Options {
    #[command(flatten)]
    pub role: Role,
    #[arg(long, default_value = "Square")]
    pub topic: String,
    #[arg(long, default_value_t = 0)]
    pub domain: u16,
    /// Samples to write or to receive; 0: until stopped.
    #[arg(long, default_value_t = 0)]
    pub count: u64,
    /// Pause between two samples.
    #[arg(long, default_value_t = 0)]
    pub period_us: u64,
    /// The default.
    #[arg(long, overrides_with = "best_effort")]
    pub reliable: bool,
    #[arg(long)]
    pub best_effort: bool,
    #[arg(long, default_value = "volatile")]
    pub durability: Durability,
    /// The default.
    #[arg(long, overrides_with = "keep_last")]
    pub history_keep_all: bool,
    #[arg(long)]
    pub keep_last: Option<u32>,
    /// Additional payload in bytes.
    #[arg(long, default_value_t = 0)]
    pub size: usize,
    /// Key of the first instance.
    #[arg(long, default_value = "BLUE")]
    pub color: String,
    /// Instances C, C1, C2... in turn.
    #[arg(long, default_value_t = 1)]
    pub instances: u64,
    /// Dispose the instances at the end.
    #[arg(long)]
    pub dispose: bool,
    /// Unregister the instances at the end.
    #[arg(long)]
    pub unregister: bool,
    /// Data representation, 1 or 2.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    pub xcdr: u8,
    #[arg(long)]
    pub deadline_ms: Option<u64>,
    #[arg(long)]
    pub partition: Option<String>,
    /// Matched readers that a publisher waits for.
    #[arg(long, default_value_t = 1)]
    pub wait_match: usize,
    /// Pause between matching and the first sample: the other side may match later.
    #[arg(long, default_value = "0.3", value_parser = seconds)]
    pub settle: Duration,
    /// Stay so long after the count is reached.
    #[arg(long, default_value = "0", value_parser = seconds)]
    pub linger: Duration,
    /// Give up after so long.
    #[arg(long, default_value = "30", value_parser = seconds)]
    pub timeout: Duration,
    /// Network interface: its name or its address, as the library wants it.
    #[arg(long)]
    pub interface: Option<String>,
}

impl Options {
    /// The color of an instance.
    #[must_use]
    pub fn instance_color(&self, instance: u64) -> String {
        match instance {
            0 => self.color.clone(),
            number => format!("{}{number}", self.color),
        }
    }
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse::<f64>().map_err(|error| error.to_string())?;
    Duration::try_from_secs_f64(seconds).map_err(|error| error.to_string())
}
