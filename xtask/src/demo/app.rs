//! An app of the demo: receives squares and, where it is told to, publishes circles.

use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use clap::Args;
use rtps_socket::{DdsType, DomainParticipant, Qos};

/// The type of the well-known shapes demonstration.
#[derive(Clone, Debug, Default, DdsType)]
// Vendors differ in whether it is final: like them, it does not insist on its own form.
#[dds(appendable, type_name = "ShapeType", by_name)]
pub(crate) struct ShapeType {
    #[dds(key, bound = 128)]
    color: String,
    x: i32,
    y: i32,
    shapesize: i32,
    additional_payload_size: Vec<u8>,
}

/// Started by the demo itself, as an unprivileged user.
#[derive(Args, Debug)]
pub(crate) struct App {
    /// How many squares will come.
    #[arg(long)]
    squares: u64,
    /// How many circles to publish.
    #[arg(long, default_value_t = 0)]
    circles: u64,
    /// Microseconds from one circle to the next.
    #[arg(long, default_value_t = 10_000)]
    period_us: u64,
    /// The DDS domain.
    #[arg(long, default_value_t = 0)]
    domain: u32,
    /// When to give up.
    #[arg(long)]
    timeout_seconds: u64,
}

/// How often progress is reported.
const REPORT: Duration = Duration::from_millis(200);
/// How long a reader that was started together with its writer may take to be found.
const DISCOVERY: Duration = Duration::from_secs(20);

impl App {
    /// Runs until all squares have come and all circles are acknowledged; prints JSON lines.
    pub(crate) fn run(&self) -> Result<()> {
        let participant = DomainParticipant::builder().domain(self.domain).open()?;
        let publishing = (self.circles > 0).then(|| {
            let (participant, app) = (participant.clone(), Self { ..*self });
            thread::spawn(move || app.publish_circles(&participant))
        });
        let received = self.receive_squares(&participant)?;
        let sent = publishing.map_or(Ok(0), |thread| {
            thread.join().expect("the publishing thread does not panic")
        })?;
        println!(
            "{}",
            serde_json::json!({"event": "done", "sent": sent, "received": received})
        );
        ensure!(
            received == self.squares,
            "{received} of {} squares arrived",
            self.squares
        );
        Ok(())
    }

    fn receive_squares(&self, participant: &DomainParticipant) -> Result<u64> {
        let topic = participant.create_topic::<ShapeType>("Square")?;
        let reader =
            participant.create_reader(&topic, Qos::reliable().keep_all().transient_local())?;
        let end = Instant::now() + Duration::from_secs(self.timeout_seconds);
        let (mut received, mut reported) = (0, Instant::now());
        while received < self.squares && Instant::now() < end {
            reader.wait(REPORT);
            received += reader
                .take()
                .iter()
                .filter(|sample| sample.info.valid_data)
                .count() as u64;
            if reported.elapsed() >= REPORT {
                reported = Instant::now();
                println!(
                    "{}",
                    serde_json::json!({"event": "progress", "received": received})
                );
            }
        }
        Ok(received)
    }

    fn publish_circles(&self, participant: &DomainParticipant) -> Result<u64> {
        let topic = participant.create_topic::<ShapeType>("Circle")?;
        let writer =
            participant.create_writer(&topic, Qos::reliable().keep_all().transient_local())?;
        writer
            .wait_for_matched(1, DISCOVERY)
            .context("nobody wants circles")?;
        let start = Instant::now();
        for number in 0..self.circles {
            let circle = ShapeType {
                color: "RED".into(),
                x: number as i32,
                shapesize: 30,
                ..ShapeType::default()
            };
            writer.write(&circle)?;
            let next = start + Duration::from_micros(self.period_us * (number + 1));
            thread::sleep(next.saturating_duration_since(Instant::now()));
        }
        writer
            .wait_for_acknowledgments(DISCOVERY)
            .context("the circles were not acknowledged")?;
        Ok(self.circles)
    }
}
