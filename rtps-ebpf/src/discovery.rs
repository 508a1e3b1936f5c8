//! The exchange: how the kernel deals with a message that concerns the built-in endpoints.
//!
//! [`Exchange::step`] goes through the message on a tentative copy of the sender's [`Peer`]: what is known is
//! swallowed, what is new is for rtpsd, what asks for an answer gets one. [`Exchange::fill`] then puts the
//! answer together, as the built-in endpoints of rtpsd would. Like the walk, both take one small step at a
//! time, so that the kernel drives them with `bpf_loop` and tests with plain loops, and all state lies in one
//! struct, which the kernel keeps in a map.
//!
//! What goes beyond this (fragments, relayed messages, jumps of sequence numbers) is handed to rtpsd
//! unanswered: correctness never depends on the kernel's answer.
//!
//! [`Peer`]: crate::abi::Peer

mod announcement;
mod answer;
pub mod budget;
mod count;
mod exchange;
mod fill;
mod request;
mod world;

pub use answer::{ANSWER_BYTES, Answer, MAX_DATAGRAM};
pub use count::{count_at, next_count};
pub use exchange::{Exchange, Outcome, Setting};
pub use world::World;

/// The steps that one message may take: submessages, parameters of announcements, parts of what is hashed,
/// and numbers that are asked for.
pub const TURNS: u32 = 16_384;
/// The steps that one datagram of an answer may take: three sets of numbers are looked through, and then
/// there are a few submessages.
pub const FILL_TURNS: u32 = 1_024;
/// The most datagrams in answer to one message: what a UDP socket with the usual buffer has room for.
/// Whoever asks for more asks again.
pub const MAX_DATAGRAMS: u32 = 64;

#[cfg(test)]
mod tests;
