//! The high-level RTPS layer: everything of the protocol that is not I/O.
//!
//! Bytes, commands and the current time go in; datagrams to send, events, and wanted changes of kernel maps come
//! out. Nothing in here has a socket, a thread, a clock or a random number, so that all of it runs in virtual
//! time (see the tests), and the kernel layer and the in-process layer run the very same code.
#![forbid(unsafe_code)]

mod count;
mod deadline;
pub mod discovery;
pub mod endpoints;
pub mod filter;
pub mod history;
pub mod ipv6;
pub mod layer;
pub mod local;
mod own_keys;
pub mod qos;
pub mod reader;
mod remote;
mod slab;
mod table;
mod transmit;
pub mod wire;
pub mod writer;
pub mod xtypes;

pub use count::CountClock;
pub use own_keys::{OwnKeyHasher, OwnKeys};
pub use remote::RemoteEndpoint;
pub use transmit::Transmit;
