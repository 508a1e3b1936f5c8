//! The harness of the tests (and of `cargo xtask demo`): hosts, links, other vendors' programs.
//!
//! - [`netns`], [`link`]: hosts made of network namespaces, joined by veth pairs or a bridge
//! - [`loss`], [`pass_all`]: small BPF programs of our own that lose packets or let all pass
//! - [`binaries`]: rtpsd, `rtps` and the examples of rtps-socket
//! - [`layer`]: what the apps of a host stand on, and the kernel layer
//! - [`stage`], [`stream`]: two hosts with programs on them, and samples on their way, of which none may be missing
//! - [`packet`]: frames and RTPS messages for the kernel verdict tables
//! - [`process`]: child processes that end with the test
//! - [`peers`], [`ddsperf`]: publishers and subscribers on other vendors' libraries, and Cyclone DDS's own measure
//! - [`capture`]: what was on the wire, decoded by tshark
//! - [`debian`], [`require`]: what a machine lacks, and why a test is skipped
//!
//! Everything is RAII: nothing stays behind, not even when a test panics or is killed.

pub mod binaries;
mod bpf;
pub mod capture;
pub mod ddsperf;
pub mod debian;
pub mod layer;
pub mod link;
pub mod loss;
pub mod netns;
pub mod packet;
pub mod pass_all;
pub mod peers;
pub mod process;
pub mod require;
pub mod stage;
pub mod stream;
mod sys;

pub use sys::socket_cookie;
