//! rtpsd in network namespaces: start, stop, kill, take over, and apps that misbehave.

mod apps;
mod attachment;
mod delivery;
mod hostile;
mod interfaces;
mod lifetime;
mod steps;
mod support;
