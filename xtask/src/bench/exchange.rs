//! One run: programs of a stack exchange samples, and what that costs is read meanwhile.

use std::thread;
use std::time::Duration;

use anyhow::{Context, Result};
use nix::unistd::Pid;
use rtps_tests::link::Host;

use super::figures::Figures;
use super::hosts::{Hosts, Sides};
use super::machine::{self, Usage};
use super::options::Options;
use super::program::{Outcome, Program, Role};
use super::programs::{Part, Programs};
use super::rounds::{self, Run};
use super::row::{Case, Row};

/// What is still under way arrives before readers are ended.
const DRAIN: Duration = Duration::from_millis(200);

/// What the programs do.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Kind {
    /// The active one sends samples that the passive one sends back.
    RoundTrips,
    /// The active one writes, the passive ones read.
    Stream,
}

/// Measures all cases: a writer writes `rate` samples a second, or as many as it can, to the readers.
pub(super) fn measure_streams(
    options: &Options,
    cases: &[Case],
    programs: &Programs,
    hosts: &Hosts,
    rate: Option<u32>,
) -> Result<Vec<Row>> {
    rounds::measure(cases, options, |case, run| {
        let exchange = Exchange {
            programs,
            kind: Kind::Stream,
            case,
            rate,
            sides: hosts.of(case.stack)?,
        };
        exchange.run(run)
    })
}

/// See the module.
pub(super) struct Exchange<'a> {
    pub(super) programs: &'a Programs,
    pub(super) kind: Kind,
    pub(super) case: &'a Case,
    /// Samples a second that are written; `None`: as many as can be.
    pub(super) rate: Option<u32>,
    pub(super) sides: Sides<'a>,
}

/// All programs of a running exchange.
pub(super) struct Cast {
    active: Program,
    passive: Vec<Program>,
}

impl Exchange<'_> {
    /// Starts all programs, measures, ends them.
    pub(super) fn run(&self, run: Run) -> Result<Figures> {
        let cast = self.start_steady()?;
        if run.counts_syscalls {
            self.count_syscalls(cast, run)
        } else {
            self.measure(cast, run)
        }
    }

    /// Starts all programs, and waits until the samples flow.
    pub(super) fn start_steady(&self) -> Result<Cast> {
        let mut cast = self.start()?;
        let measuring = cast.measuring(self.kind);
        measuring.iter_mut().try_for_each(Program::wait_steady)?;
        Ok(cast)
    }

    fn start(&self) -> Result<Cast> {
        let (active, passive) = match self.kind {
            Kind::RoundTrips => (Role::Ping, Role::Pong),
            Kind::Stream => (Role::Publish, Role::Subscribe),
        };
        let readers = self.sides.passive.iter();
        let passive = readers
            .map(|host| self.program(passive, host))
            .collect::<Result<_>>()?;
        Ok(Cast {
            passive,
            active: self.program(active, self.sides.active)?,
        })
    }

    fn program(&self, role: Role, host: &Host) -> Result<Program> {
        let others = match role {
            Role::Ping | Role::Publish => self.sides.passive,
            Role::Pong | Role::Subscribe => std::slice::from_ref(self.sides.active),
        };
        self.programs.start(&Part {
            case: self.case,
            role,
            rate: self.rate,
            host,
            others,
        })
    }

    fn measure(&self, mut cast: Cast, run: Run) -> Result<Figures> {
        let before = Usage::of(&cast.pids())?;
        cast.let_measure(self.kind, run.seconds)?;
        let rates = before.rates(&Usage::of(&cast.pids())?);
        let rss_kb = cast.resident_kb()?;
        let outcome = cast.end(self.kind)?;
        let (cpu, switches) = rates.of_a_sample(run.baseline, outcome.samples_per_s);
        Ok(Figures {
            cpu_ns_per_sample: Some(cpu),
            switches_per_sample: Some(switches),
            rss_kb: Some(rss_kb),
            ..outcome.figures
        })
    }

    /// With several readers those of the writer, by the samples that it wrote.
    fn count_syscalls(&self, mut cast: Cast, run: Run) -> Result<Figures> {
        let watched = Duration::from_secs_f64(run.seconds);
        let readers = cast.passive.len();
        let pids = match readers {
            1 => cast.pids(),
            _ => vec![cast.active.pid()],
        };
        let syscalls = machine::syscalls_per_second(&pids, watched)?;
        cast.let_measure(self.kind, 0.0)?;
        let written_per_s = cast.end(self.kind)?.samples_per_s / readers as f64;
        Ok(Figures {
            syscalls_per_sample: Some(syscalls / written_per_s),
            ..Figures::default()
        })
    }
}

impl Cast {
    fn measuring(&mut self, kind: Kind) -> &mut [Program] {
        match kind {
            Kind::RoundTrips => std::slice::from_mut(&mut self.active),
            Kind::Stream => &mut self.passive,
        }
    }

    fn pids(&self) -> Vec<Pid> {
        let programs = std::iter::once(&self.active).chain(&self.passive);
        programs.map(Program::pid).collect()
    }

    /// At least so long; programs that tell something each second do so once more.
    fn let_measure(&mut self, kind: Kind, seconds: f64) -> Result<()> {
        let measuring = self.measuring(kind);
        let told: Vec<usize> = measuring.iter().map(|program| program.told()).collect();
        thread::sleep(Duration::from_secs_f64(seconds));
        let mut programs = measuring.iter_mut().zip(told);
        programs.try_for_each(|(program, told)| program.wait_told(told + 1))
    }

    /// Resident memory of the largest program on the passive side.
    pub(super) fn resident_kb(&self) -> Result<u64> {
        let programs = self.passive.iter();
        let sizes = programs.map(|program| machine::resident_kb(program.pid()));
        let sizes = sizes.collect::<Result<Vec<_>>>()?;
        sizes.into_iter().max().context("there is no reader")
    }

    /// Ends all programs; what the measuring ones have seen together.
    pub(super) fn end(&mut self, kind: Kind) -> Result<Outcome> {
        let measuring = self.measuring(kind);
        let steady: Vec<String> = measuring.iter().map(|program| program.text()).collect();
        self.active.end()?;
        thread::sleep(DRAIN);
        self.passive.iter_mut().try_for_each(Program::end)?;
        let programs = self.measuring(kind).iter().zip(&steady);
        let outcomes = programs.map(|(program, steady)| program.outcome(steady));
        together(&outcomes.collect::<Result<Vec<_>>>()?)
    }
}

/// Rates and losses of several readers added up.
fn together(outcomes: &[Outcome]) -> Result<Outcome> {
    let first = outcomes.first().context("there is no reader")?;
    let sum = outcomes.iter().map(|outcome| outcome.samples_per_s).sum();
    let lost = outcomes.iter().filter_map(|outcome| outcome.figures.lost);
    Ok(Outcome {
        figures: Figures {
            samples_per_s: first.figures.samples_per_s.map(|_| sum),
            lost: lost.reduce(|sum, lost| sum + lost),
            ..first.figures.clone()
        },
        samples_per_s: sum,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readers_add_up() {
        let reader = |rate, lost| Outcome {
            figures: Figures {
                samples_per_s: Some(rate),
                lost: Some(lost),
                ..Figures::default()
            },
            samples_per_s: rate,
        };
        let all = together(&[reader(10.0, 0), reader(20.0, 3)]).unwrap();
        assert_eq!(all.samples_per_s, 30.0);
        assert_eq!(
            (all.figures.samples_per_s, all.figures.lost),
            (Some(30.0), Some(3))
        );
        assert!(together(&[]).is_err());
    }
}
