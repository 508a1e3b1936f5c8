//! Tables of packets and what the kernel programs must make of them.
//!
//! `valid` has what is passed or delivered, `hostile` what is dropped, `socket` the filter where it
//! really sits, `ingress` tc where it delivers; `discovery` what the kernel does in rtpsd's place, `strangers` who may make it do so,
//! and `answers` how answers leave; `fan_out` what apps send to
//! several destinations. `verifier` is about the programs themselves.

mod answers;
mod discovery;
mod fan_out;
mod hostile;
mod ingress;
mod layer;
mod socket;
mod stage;
mod strangers;
mod valid;
mod verifier;
