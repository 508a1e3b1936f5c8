//! The command line as `shape_main` understands it: values with their defaults, and how they are read.
//!
//! [`parse`] reads tokens as GNU `getopt_long` does; [`check`] then compares what was given. Whatever is wrong
//! ends the program with the [`USAGE`] and exit code 1.

mod check;
mod parse;
mod usage;

use std::time::Duration;

use rtps_socket::qos::{Durability, History, PresentationScope};

pub(crate) use parse::parse;
pub(crate) use usage::USAGE;

/// What the command line asks for.
#[derive(Debug)]
pub(crate) enum Request {
    /// `--help`.
    Help,
    /// A publisher or subscriber, and what to warn of.
    Run(Box<Options>, Vec<String>),
}

/// Either end of the topics.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum Role {
    Publisher,
    Subscriber,
}

/// What instances become at the end of a publisher.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) enum FinalState {
    Unregistered,
    Disposed,
}

/// All options.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Options {
    pub(crate) role: Role,
    pub(crate) is_verbose: bool,
    pub(crate) domain: u32,
    /// The first topic; further ones have a number behind it.
    pub(crate) topic: String,
    pub(crate) topics: u32,
    /// Publisher: the first instance; subscriber: the only one that is wanted.
    pub(crate) color: Option<String>,
    pub(crate) partition: Option<String>,
    /// Of the main loop; endless without.
    pub(crate) iterations: Option<u64>,
    pub(crate) announce_period: Option<Duration>,
    pub(crate) fragment_size: Option<u16>,
    pub(crate) qos: QosOptions,
    pub(crate) publisher: PublisherOptions,
    pub(crate) subscriber: SubscriberOptions,
}

/// Policies; `None` leaves the default.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct QosOptions {
    pub(crate) is_reliable: bool,
    pub(crate) durability: Durability,
    pub(crate) history: Option<History>,
    pub(crate) deadline: Option<Duration>,
    /// EXCLUSIVE ownership with this strength.
    pub(crate) strength: Option<i32>,
    /// XCDR version 2 instead of 1.
    pub(crate) is_xcdr2: bool,
    pub(crate) lifespan: Option<Duration>,
    pub(crate) minimum_separation: Option<Duration>,
    pub(crate) scope: PresentationScope,
    pub(crate) is_coherent: bool,
    pub(crate) is_ordered: bool,
}

/// What only a publisher heeds.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct PublisherOptions {
    pub(crate) prints_samples: bool,
    /// 0 grows by one each iteration.
    pub(crate) shape_size: i32,
    /// A growing size starts again behind it.
    pub(crate) size_modulo: Option<i32>,
    pub(crate) period: Duration,
    pub(crate) instances: u32,
    pub(crate) final_state: Option<FinalState>,
    /// Iterations in a coherent set; without there are no sets.
    pub(crate) set_iterations: Option<u64>,
    /// Octets beside the shape in each sample.
    pub(crate) payload_size: usize,
}

/// What only a subscriber heeds.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SubscriberOptions {
    /// Samples stay in the reader.
    pub(crate) reads: bool,
    /// Plain take or read instead of one instance after the other.
    pub(crate) is_plain: bool,
    pub(crate) period: Duration,
    /// A content filter expression.
    pub(crate) filter: Option<String>,
}

impl Options {
    /// Whether PRESENTATION asks for more than the default: the scope alone has no effect.
    pub(crate) fn has_presentation(&self) -> bool {
        self.qos.is_coherent || self.qos.is_ordered
    }

    /// The names of the topics.
    pub(crate) fn topic_names(&self) -> impl Iterator<Item = String> + '_ {
        (0..self.topics).map(|number| numbered(&self.topic, number))
    }
}

/// `NAME`, `NAME1`, `NAME2`...
pub(crate) fn numbered(name: &str, number: u32) -> String {
    match number {
        0 => name.to_owned(),
        number => format!("{name}{number}"),
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            role: Role::Subscriber,
            is_verbose: false,
            domain: 0,
            topic: String::new(),
            topics: 1,
            color: None,
            partition: None,
            iterations: None,
            announce_period: None,
            fragment_size: None,
            qos: QosOptions::default(),
            publisher: PublisherOptions::default(),
            subscriber: SubscriberOptions::default(),
        }
    }
}

impl Default for QosOptions {
    fn default() -> Self {
        Self {
            is_reliable: true,
            durability: Durability::Volatile,
            history: None,
            deadline: None,
            strength: None,
            is_xcdr2: false,
            lifespan: None,
            minimum_separation: None,
            scope: PresentationScope::Instance,
            is_coherent: false,
            is_ordered: false,
        }
    }
}

impl Default for PublisherOptions {
    fn default() -> Self {
        Self {
            prints_samples: false,
            shape_size: 20,
            size_modulo: None,
            period: Duration::from_millis(33),
            instances: 1,
            final_state: None,
            set_iterations: None,
            payload_size: 0,
        }
    }
}

impl Default for SubscriberOptions {
    fn default() -> Self {
        Self {
            reads: false,
            is_plain: false,
            period: Duration::from_millis(100),
            filter: None,
        }
    }
}
