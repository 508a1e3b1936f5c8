//! Choosing a layer: an explicit choice, else the kernel layer where it answers, else the in-process layer.

use std::sync::Arc;
use std::time::Duration;

use thiserror::Error;

use super::in_process::{InProcessError, InProcessLink};
use super::kernel::{AttachError, KernelLink};
use super::{LayerChoice, Link};
use crate::error::CreateError;
use crate::sys::Epoll;

/// The environment variable that decides where the program does not.
const CHOICE_VARIABLE: &str = "RTPS_LAYER";

/// How a participant wants to be connected.
#[derive(Clone, Debug)]
pub(crate) struct Settings {
    /// The DDS domain, 0 to 232.
    pub(crate) domain: u32,
    /// The app's name, for people.
    pub(crate) name: String,
    /// Which layer.
    pub(crate) layer: LayerChoice,
    /// Bytes of the ring that the app asks the kernel layer for.
    pub(crate) ring_bytes: u32,
    /// For how long a waiting thread looks for samples before it sleeps, if the app says so.
    pub(crate) busy_poll: Option<Duration>,
    /// In-process layer: where to announce beside the multicast group.
    pub(crate) peers: Vec<std::net::SocketAddr>,
    /// In-process layer: the time between two announcements, if the app says so.
    pub(crate) announce_period: Option<Duration>,
}

/// Why a participant could not be opened.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum OpenError {
    /// Ports exist for the domains 0 to 232 only (RTPS 2.5 section 9.6.2.3).
    #[error("there is no domain {0}: choose one from 0 to 232")]
    NoSuchDomain(u32),
    /// `RTPS_LAYER` holds something else.
    #[error("RTPS_LAYER is {0:?}: set it to `kernel` or `in-process`, or unset it")]
    UnknownLayer(String),
    /// The kernel layer was asked for by name.
    #[error("the kernel layer cannot be used: {0}")]
    Kernel(#[from] AttachError),
    /// The in-process layer's sockets could not be opened.
    #[error("the in-process layer cannot be used: {0}")]
    InProcess(#[from] InProcessError),
    /// The participant cannot have these policies.
    #[error(transparent)]
    Policies(#[from] CreateError),
    /// The system has no descriptors, memory or threads left.
    #[error("the system refuses what every participant needs: {0}")]
    System(#[from] std::io::Error),
}

/// Connects to the layer of choice; its descriptors are put into `epoll`.
pub(crate) fn open(settings: &Settings, epoll: &Arc<Epoll>) -> Result<Box<dyn Link>, OpenError> {
    if settings.domain > 232 {
        return Err(OpenError::NoSuchDomain(settings.domain));
    }
    let domain = settings.domain;
    match choice(settings.layer)? {
        LayerChoice::Kernel => {
            let link = KernelLink::attach(settings, epoll)?;
            tracing::info!(domain, "using the kernel layer, as chosen");
            Ok(Box::new(link))
        }
        LayerChoice::InProcess => {
            let link = InProcessLink::open(settings, epoll)?;
            tracing::info!(domain, "using the in-process layer, as chosen");
            Ok(Box::new(link))
        }
        LayerChoice::Automatic => match KernelLink::attach(settings, epoll) {
            Ok(link) => {
                tracing::info!(domain, "using the kernel layer");
                Ok(Box::new(link))
            }
            Err(reason) => {
                let link = InProcessLink::open(settings, epoll)?;
                tracing::info!(
                    domain,
                    "using the in-process layer over UDP sockets: {reason}"
                );
                Ok(Box::new(link))
            }
        },
    }
}

/// The program's choice, or else the environment's.
fn choice(explicit: LayerChoice) -> Result<LayerChoice, OpenError> {
    if explicit != LayerChoice::Automatic {
        return Ok(explicit);
    }
    match std::env::var(CHOICE_VARIABLE).as_deref() {
        Err(_) | Ok("") => Ok(LayerChoice::Automatic),
        Ok(name) => parse_choice(name),
    }
}

fn parse_choice(name: &str) -> Result<LayerChoice, OpenError> {
    match name {
        "kernel" => Ok(LayerChoice::Kernel),
        "in-process" => Ok(LayerChoice::InProcess),
        other => Err(OpenError::UnknownLayer(other.to_owned())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_layers() {
        assert_eq!(parse_choice("kernel").unwrap(), LayerChoice::Kernel);
        assert_eq!(parse_choice("in-process").unwrap(), LayerChoice::InProcess);
        let error = parse_choice("Kernel").unwrap_err().to_string();
        assert!(error.contains("`kernel` or `in-process`"), "{error}");
    }

    #[test]
    fn domains_beyond_the_ports_are_refused() {
        let settings = Settings {
            domain: 233,
            name: String::new(),
            layer: LayerChoice::InProcess,
            ring_bytes: 0,
            busy_poll: None,
            peers: Vec::new(),
            announce_period: None,
        };
        let epoll = Arc::new(Epoll::new().unwrap());
        let error = open(&settings, &epoll).err().unwrap();
        assert!(matches!(error, OpenError::NoSuchDomain(233)));
    }
}
