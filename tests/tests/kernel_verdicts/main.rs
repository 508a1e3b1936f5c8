//! Tables of packets and what the kernel programs must make of them.
//!
//! `valid` has what is passed or delivered, `hostile` what is dropped, `socket` the filter where it
//! really sits.

mod hostile;
mod layer;
mod socket;
mod valid;
