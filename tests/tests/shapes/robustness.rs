//! Nobody reads what the program prints: it goes on, and ends when it is told to.

use std::process::{Child, Stdio};

use anyhow::{Result, ensure};
use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use rtps_tests::stage::eventually;

use crate::lines;
use crate::stage::{Ends, on_the_in_process_layer};

on_the_in_process_layer! {
    a_blocked_publisher_goes_on,
    a_blocked_subscriber_acknowledges,
    nobody_listens_any_more,
}

/// Samples that fill a pipe several times when they are printed.
const MANY: u32 = 20_000;

/// A program whose output is held back; it ends with the value.
struct Blocked(Child);

impl Blocked {
    fn start(ends: &Ends<'_>, arguments: &str) -> Result<Self> {
        let mut command = ends.near_command(arguments)?;
        Ok(Self(command.stdout(Stdio::piped()).spawn()?))
    }

    fn interrupt(&mut self) -> Result<()> {
        kill(Pid::from_raw(self.0.id().cast_signed()), Signal::SIGINT)?;
        let status = eventually("the end", || Ok(self.0.try_wait()?))?;
        ensure!(status.code() == Some(0), "{status}");
        Ok(())
    }
}

impl Drop for Blocked {
    fn drop(&mut self) {
        // Both fail only when it has ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn a_blocked_publisher_goes_on(ends: &Ends<'_>) -> Result<()> {
    let subscriber = ends.subscriber("")?;
    let mut publisher = Blocked::start(ends, "-P -t Square -w -z 0 --write-period 0")?;
    let many = |samples: &[lines::Sample]| samples.last().is_some_and(|last| last.size > MANY);
    lines::wait_until(&subscriber, "samples of a blocked publisher", many)?;
    publisher.interrupt()
}

/// Its writer waits for nothing, although every sample is kept until it is acknowledged.
fn a_blocked_subscriber_acknowledges(ends: &Ends<'_>) -> Result<()> {
    let mut subscriber = Blocked::start(ends, "-S -t Square -k 0 --read-period 1")?;
    let publisher = ends.publisher("-k 0 -z 0 --write-period 0")?;
    let matched = "matched readers 1";
    lines::wait_until(&publisher, matched, |_| {
        lines::has_line(&publisher, matched)
    })?;
    let written = lines::samples(&publisher).len();
    lines::wait_samples(&publisher, written + MANY as usize)?;
    subscriber.interrupt()
}

/// As a program does whose reader is `head`.
fn nobody_listens_any_more(ends: &Ends<'_>) -> Result<()> {
    let mut publisher = Blocked::start(ends, "-P -t Square -w")?;
    drop(publisher.0.stdout.take());
    eventually("the end", || Ok(publisher.0.try_wait()?))?;
    Ok(())
}
