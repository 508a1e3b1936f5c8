//! Two of our `shape_main` programs against each other, or one and another vendor's program: the effect of each option,
//! and what they print.
//!
//! Other programs judge `shape_main` by its lines, so these tests do too. Scenarios wait for what they are about and
//! never for time to pass: a busy machine makes them slow, not red. A shape that grows (`-z 0`) counts iterations: its
//! size says which samples have come.

mod access;
mod busy;
mod command_line;
mod filters;
mod history;
mod instances;
mod lines;
mod matching;
mod ownership;
mod payload;
mod presentation;
mod rivals;
mod robustness;
mod stage;
mod vendors;
