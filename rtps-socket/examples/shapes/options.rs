//! The command line: the options of the interoperability peers in `tests/peers`.

use clap::{Args, Parser, ValueEnum};
use rtps_socket::qos::LivelinessKind;
use rtps_socket::{LayerChoice, Qos};
use std::time::Duration;

#[derive(Clone, Copy, Eq, PartialEq, ValueEnum)]
pub(crate) enum Durability {
    Volatile,
    TransientLocal,
}

#[derive(Clone, Copy, Eq, PartialEq, ValueEnum)]
pub(crate) enum Switch {
    On,
    Off,
}

#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum Layer {
    Kernel,
    InProcess,
}

#[derive(Args)]
#[group(required = true, multiple = false)]
pub(crate) struct Role {
    /// Write samples.
    #[arg(long = "pub")]
    pub(crate) publish: bool,
    /// Read samples.
    #[arg(long = "sub")]
    pub(crate) subscribe: bool,
}

/// Publishes or subscribes shapes, one JSON object a line.
#[derive(Parser)]
#[command(args_override_self = true)]
pub(crate) struct Options {
    #[command(flatten)]
    pub(crate) role: Role,
    #[arg(long, default_value = "Square")]
    pub(crate) topic: String,
    #[arg(long, default_value_t = 0)]
    pub(crate) domain: u32,
    /// The layer to use; the best one there is unless given.
    #[arg(long)]
    pub(crate) layer: Option<Layer>,
    /// Samples to write or to receive; 0: until stopped.
    #[arg(long, default_value_t = 0)]
    pub(crate) count: u64,
    /// Pause between two samples.
    #[arg(long, default_value_t = 0)]
    pub(crate) period_us: u64,
    /// The default.
    #[arg(long, overrides_with = "best_effort")]
    pub(crate) reliable: bool,
    #[arg(long)]
    pub(crate) best_effort: bool,
    #[arg(long, default_value = "volatile")]
    pub(crate) durability: Durability,
    #[arg(long)]
    pub(crate) transient_local: bool,
    /// The default.
    #[arg(long, alias = "keep-all", overrides_with = "keep_last")]
    pub(crate) history_keep_all: bool,
    #[arg(long)]
    pub(crate) keep_last: Option<u32>,
    /// RESOURCE_LIMITS: samples that are kept at most.
    #[arg(long)]
    pub(crate) max_samples: Option<u32>,
    /// How long a write may wait for room before it reports `timeout`, and is tried again.
    #[arg(long, default_value = "10", value_parser = seconds)]
    pub(crate) max_blocking: Duration,
    /// Additional payload in bytes.
    #[arg(long, default_value_t = 0)]
    pub(crate) size: usize,
    /// Fill the additional payload with octets that depend on the sample and on their place; a subscriber says of each
    /// sample whether it holds them.
    #[arg(long)]
    pub(crate) pattern: bool,
    /// Key of the first instance.
    #[arg(long, default_value = "BLUE")]
    pub(crate) color: String,
    /// Instances C, C1, C2... in turn.
    #[arg(long, default_value_t = 1)]
    pub(crate) instances: u64,
    /// Dispose the instances at the end.
    #[arg(long)]
    pub(crate) dispose: bool,
    /// Unregister the instances at the end.
    #[arg(long)]
    pub(crate) unregister: bool,
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=2))]
    pub(crate) xcdr: u8,
    #[arg(long)]
    pub(crate) partition: Option<String>,
    /// Matched readers that a publisher waits for.
    #[arg(long, default_value_t = 1)]
    pub(crate) wait_match: usize,
    /// Pause between matching and the first sample: the other side may match later.
    #[arg(long, default_value = "0.3", value_parser = seconds)]
    pub(crate) settle: Duration,
    /// Stay so long after the count is reached.
    #[arg(long, default_value = "0", value_parser = seconds)]
    pub(crate) linger: Duration,
    /// Give up after so long.
    #[arg(long, default_value = "30", value_parser = seconds)]
    pub(crate) timeout: Duration,
    /// For the other peers' sake; this one always uses multicast.
    #[arg(long, default_value = "on")]
    pub(crate) multicast: Switch,
    /// Address to announce to.
    #[arg(long)]
    pub(crate) peer: Option<std::net::SocketAddr>,
    #[arg(long)]
    pub(crate) deadline_ms: Option<u64>,
    /// Lease of AUTOMATIC liveliness.
    #[arg(long)]
    pub(crate) liveliness_ms: Option<u64>,
    /// Ignore the writers that are matched when so many samples have come.
    #[arg(long)]
    pub(crate) ignore_after: Option<u64>,
    /// Read what passes this expression.
    #[arg(long)]
    pub(crate) filter: Option<String>,
    /// What stands for %0 in it.
    #[arg(long)]
    pub(crate) filter_parameter: Option<String>,
    /// For the other peers' sake; this one prints nothing else.
    #[arg(long)]
    pub(crate) json: bool,
}

impl Options {
    pub(crate) fn layer(&self) -> LayerChoice {
        match self.layer {
            None => LayerChoice::Automatic,
            Some(Layer::Kernel) => LayerChoice::Kernel,
            Some(Layer::InProcess) => LayerChoice::InProcess,
        }
    }

    pub(crate) fn qos(&self) -> Qos {
        let mut qos = match self.best_effort {
            true => Qos::best_effort(),
            false => Qos::reliable().max_blocking_time(self.max_blocking),
        };
        qos = match self.keep_last {
            Some(depth) => qos.keep_last(depth),
            None => qos.keep_all(),
        };
        if let Some(limit) = self.max_samples {
            qos = qos.resource_limits(Some(limit), None, None);
        }
        if self.transient_local || self.durability == Durability::TransientLocal {
            qos = qos.transient_local();
        }
        if let Some(period) = self.deadline_ms {
            qos = qos.deadline(Duration::from_millis(period));
        }
        if let Some(lease) = self.liveliness_ms {
            qos = qos.liveliness(LivelinessKind::Automatic, Duration::from_millis(lease));
        }
        match self.xcdr {
            2 => qos.xcdr2(),
            _ => qos.xcdr1(),
        }
    }

    /// The color of an instance.
    pub(crate) fn color(&self, instance: u64) -> String {
        match instance {
            0 => self.color.clone(),
            n => format!("{}{n}", self.color),
        }
    }
}

fn seconds(text: &str) -> Result<Duration, String> {
    let seconds = text.parse::<f64>().map_err(|error| error.to_string())?;
    Duration::try_from_secs_f64(seconds).map_err(|error| error.to_string())
}
