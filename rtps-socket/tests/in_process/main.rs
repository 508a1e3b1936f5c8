//! The API over the in-process layer: in a network namespace of its own where a test runs as root, else in a domain
//! that no other test has.

mod builtin;
mod dcps;
mod driving;
mod event_loop;
mod filters;
mod groups;
mod instances;
mod presentation;
mod processes;
mod streaming;
mod support;
mod traffic;
mod waiting;
