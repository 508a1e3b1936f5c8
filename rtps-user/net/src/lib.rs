//! What both layers ask the system about the network: which interfaces there are, which of them leads where, and
//! when that changes.
//!
//! All of it is about the network namespace of the calling thread. There is no protocol in here, and no state.
//!
//! - [`Interface`] with [`find`] and [`all_up`]: the interfaces, their addresses and MTUs;
//! - [`addresses_towards`]: the one that leads to an address, and [`source_towards`] the address that it is sent from;
//! - [`AddressWatch`]: whether to look again.
#![deny(unsafe_code)]

mod address_watch;
mod interface;
mod route;
mod sys;

pub use address_watch::AddressWatch;
pub use interface::{
    FindError, Interface, LOOPBACK_INDEX, all_up, datagram_size, find, ipv6_addresses, locators,
    own_addresses,
};
pub use route::{addresses_towards, source_towards};
