//! The low-level RTPS layer: everything that crosses or lives below the kernel line.
//!
//! - [`abi`]: map names, keys and values, and the record that precedes a message in an app's ring;
//! - [`counter`]: one named counter for every verdict and reason;
//! - [`frame`] and [`walk`]: the decoder. The programs in `src/bin/rtps` run it in the kernel,
//!   tests and fuzzers run the very same code in user space;
//! - `object` (feature): the built programs, embedded, for whoever loads them.
//!
//! Nothing here allocates, panics on a byte from the network, or loops by a number from it.
#![no_std]
#![deny(unsafe_code)]

#[cfg(test)]
extern crate std;

pub mod abi;
pub mod bytes;
pub mod counter;
pub mod discovery;
pub mod entity;
pub mod frame;
mod number_set;
#[cfg(feature = "object")]
mod object;
#[cfg(feature = "object")]
mod pod;
pub mod reply;
pub mod review;
mod slot_set;
mod submessage;
pub mod walk;

pub use abi::ABI_VERSION;
pub use bytes::Bytes;
pub use counter::{Counter, Reason};
#[cfg(feature = "object")]
pub use object::OBJECT;
pub use slot_set::SlotSet;
pub use walk::{Routes, Step, Walk, examine};
