//! rtpsd, the control process of the kernel layer in one network namespace.
//!
//! It loads the low-level layer, attaches it, joins the domains as one participant each, does discovery for every
//! app of the host, and hands each app its slot and ring over a Unix socket. Samples never pass through it, and
//! what it has put into the kernel goes on without it: killed and started again it takes everything over.
//!
//! - [`run`] is the process; [`Options`] its command line;
//! - [`unload`] ends it, or removes what a killed one left;
//! - [`status`] says what there is.
#![deny(unsafe_code)]

mod apps;
mod attachment;
mod channel;
mod cli;
mod daemon;
mod domain;
mod ethernet;
mod event_loop;
mod host;
mod inboxes;
mod kernel_maps;
mod loader;
mod netns;
mod news;
mod own_addresses;
mod packet_socket;
mod pins;
mod random;
mod readiness;
mod run_folder;
mod sign_of_life;
mod sockets;
mod status;
mod status_server;
mod store;
mod sys;
mod unload;

pub use cli::{Discovery, Doorbell, Options, Peer};
pub use daemon::run;
pub use loader::{AttachedMode, WantedMode};
pub use netns::{inode as network_namespace, join_shared_mounts};
pub use pins::PinFolder;
pub use run_folder::RunFolder;
pub use status::{AppStatus, DomainStatus, InterfaceStatus, Status, status};
pub use unload::{Unloaded, unload};
