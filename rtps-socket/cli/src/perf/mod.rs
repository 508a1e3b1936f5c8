//! `rtps perf ping|pong|pub|sub`: the roles of Cyclone DDS's ddsperf, on its topics, with its types and policies.
//!
//! Every topic has a sequence number and most have a key. Pings are answered on a topic of their own, in the
//! partition that is named after the participant that asked; the lowest bit of the source timestamp says what a
//! sample or an answer is meant as. That, and what the participants tell of themselves, is all in [`session`] and
//! [`topic`].

mod histogram;
mod options;
mod pace;
mod ping;
mod pong;
mod publish;
mod report;
mod session;
mod subscribe;
mod topic;

use anyhow::Result;
use clap::Subcommand;

/// The role of this end.
#[derive(Debug, Subcommand)]
pub(crate) enum Perf {
    /// Send samples one by one and measure how long each takes to come back.
    Ping(ping::Ping),
    /// Send back what comes.
    Pong(pong::Pong),
    /// Publish, as fast as possible unless a rate is given.
    Pub(publish::Publish),
    /// Subscribe, and count what comes and what is missing.
    Sub(subscribe::Subscribe),
}

impl Perf {
    /// Plays the role until it is over.
    pub(crate) fn run(self) -> Result<()> {
        match self {
            Self::Ping(ping) => ping.run(),
            Self::Pong(pong) => pong.run(),
            Self::Pub(publish) => publish.run(),
            Self::Sub(subscribe) => subscribe.run(),
        }
    }
}
