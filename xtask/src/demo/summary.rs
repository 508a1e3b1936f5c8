//! What the demo shows: how far each topic is, and what the kernel did.

use std::fmt::Write as _;
use std::time::Instant;

use serde::Serialize;
use serde_json::{Map, Value};

/// One topic on its way to one reader.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Flow {
    pub(crate) topic: &'static str,
    pub(crate) writer: &'static str,
    pub(crate) reader: &'static str,
    pub(crate) sent: u64,
    pub(crate) received: u64,
    pub(crate) lost: u64,
}

/// What the table shows of the kernel, and the beginnings of the names of the counters that each is the sum of.
const KERNEL_SUMS: [(&str, &[&str]); 5] = [
    (
        "parsed",
        &["xdp_messages", "ingress_messages", "filter_messages"],
    ),
    ("answered", &["answers"]),
    ("delivered", &["delivered_records"]),
    ("passed", &["pass_"]),
    ("dropped", &["drop_"]),
];

/// Puts the sums in front of the counters.
pub(crate) fn with_sums(counters: Map<String, Value>) -> Map<String, Value> {
    let sum = |prefixes: &[&str]| -> u64 {
        let counted = |name: &str| prefixes.iter().any(|prefix| name.starts_with(prefix));
        counters
            .iter()
            .filter(|(name, _)| counted(name))
            .filter_map(|(_, value)| value.as_u64())
            .sum()
    };
    let sums = KERNEL_SUMS.map(|(name, prefixes)| (name.to_owned(), Value::from(sum(prefixes))));
    sums.into_iter().chain(counters.clone()).collect()
}

/// All there is to say at one moment.
#[derive(Clone, Debug, Serialize)]
pub(crate) struct Summary {
    pub(crate) layer: String,
    pub(crate) xdp_mode: Option<String>,
    pub(crate) topics: Vec<Flow>,
    /// The counters of the kernel programs, summed over the interfaces; empty without kernel layer.
    pub(crate) kernel: Map<String, Value>,
}

impl Flow {
    /// A flow of which all samples were sent, or will be.
    pub(crate) fn new(
        topic: &'static str,
        writer: &'static str,
        reader: &'static str,
        sent: u64,
        received: u64,
    ) -> Self {
        Self {
            topic,
            writer,
            reader,
            sent,
            received,
            lost: sent.saturating_sub(received),
        }
    }
}

impl Summary {
    /// Whether every sample arrived.
    pub(crate) fn complete(&self) -> bool {
        self.topics.iter().all(|flow| flow.lost == 0)
    }

    /// One line of JSON.
    pub(crate) fn json(&self) -> String {
        serde_json::to_string(self).expect("strings and numbers can be written as JSON")
    }

    /// The closing words.
    pub(crate) fn text(&self) -> String {
        let mode = self
            .xdp_mode
            .as_ref()
            .map_or(String::new(), |mode| format!(", XDP {mode}"));
        let mut text = format!("\nlayer: {}{mode}\n", self.layer);
        for flow in &self.topics {
            let Flow {
                topic,
                writer,
                reader,
                sent,
                received,
                lost,
            } = flow;
            let _ = writeln!(
                text,
                "{topic:<8} {writer} -> {reader}: {sent} sent, {received} received, {lost} lost"
            );
        }
        for (name, value) in self
            .kernel
            .iter()
            .filter(|(_, value)| value.as_u64() != Some(0))
        {
            let _ = writeln!(text, "kernel   {name}: {value}");
        }
        text.push_str(if self.complete() {
            "every sample arrived"
        } else {
            "SAMPLES ARE MISSING"
        });
        text
    }
}

/// The live table: a line for each second.
#[derive(Debug)]
pub(crate) struct Table {
    last: Option<(Instant, Vec<u64>)>,
}

impl Table {
    pub(crate) fn new() -> Self {
        Self { last: None }
    }

    /// Prints what has changed since the last call.
    pub(crate) fn draw(&mut self, summary: &Summary) {
        let now = Instant::now();
        let received: Vec<u64> = summary.topics.iter().map(|flow| flow.received).collect();
        if let Some((then, before)) = self.last.take() {
            let seconds = (now - then).as_secs_f64();
            let mut line = String::new();
            for (flow, before) in summary.topics.iter().zip(before) {
                let rate = (flow.received - before) as f64 / seconds;
                let _ = write!(
                    line,
                    "{} -> {}: {:>6} ({rate:>4.0}/s)   ",
                    flow.topic, flow.reader, flow.received
                );
            }
            for name in KERNEL_SUMS.map(|(name, _)| name) {
                if let Some(value) = summary.kernel.get(name) {
                    let _ = write!(line, "{name} {value}  ");
                }
            }
            println!("{line}");
        }
        self.last = Some((now, received));
    }
}
