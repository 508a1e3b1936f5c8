//! Writers and readers on a virtual network in virtual time: latency, loss, reordering, duplication and an MTU.
//!
//! Every test prints the seed that it failed with; the same seed gives the same run. SIMULATION_FACTOR in the
//! environment multiplies the number of seeds.

mod best_effort;
mod durability;
mod flow;
mod fragments;
mod history;
mod hostile;
mod instances;
mod marathon;
mod network;
mod operations;
mod policies;
mod random;
mod reliability;
mod sample;
