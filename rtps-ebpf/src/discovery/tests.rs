//! The exchange in user space: every row of what it does, and what hostile input must not make it do.

mod hostile;
mod message;
mod reading;
mod spdp;
mod speech;
mod stage;
mod writing;
