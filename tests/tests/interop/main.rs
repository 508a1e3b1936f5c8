//! Our apps against unmodified libraries of other vendors, and against each other, over real links.
//!
//! A scenario runs with each of the [`layers`] under our apps, which are unprivileged every time. Scenarios wait for what they are about and never for time to pass: a busy machine makes
//! them slow, not red. Where a test must not depend on which side sees a match first, it uses TRANSIENT_LOCAL.

mod best_effort;
mod coexistence;
mod durability;
mod fan_out;
mod filters;
mod flow;
mod instances;
mod ipv6;
mod large;
mod large_and_lossy;
mod layers;
mod loss;
mod matching;
mod matrix;
mod perf;
mod reliable;
mod stage;
mod static_peers;
mod type_lookup;
mod wire;
