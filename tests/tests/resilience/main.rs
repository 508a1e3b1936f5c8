//! What must go on while something else goes wrong: rtpsd stopped or killed, apps killed or stuck, hostile input.
//!
//! `hostile` has the bad messages, `control_socket` an app's end of rtpsd's socket; the rest is one theme a file. Our
//! apps run as nobody without any capability.

mod addresses;
mod app_killed;
mod control_socket;
mod daemon_killed;
mod daemon_stopped;
mod flood;
mod hostile;
mod idle;
mod ignored;
mod isolation;
mod many_apps;
mod same_host;
mod slow_app;
mod stuck_reader;
mod unload;
