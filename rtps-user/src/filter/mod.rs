//! Content filters: the conditions of DDS 1.4 annex B, as ContentFilteredTopics and QueryConditions have them.
//!
//! [`Expression`] parses the text once, has itself checked against a type, and judges samples, which show their
//! members through [`Fields`]. Expressions come from remote readers too, so nothing in here recurses or takes time
//! without a limit: see [`ParseError`] for what is refused.
//!
//! Beside the annex's grammar are understood: `!=`, texts in double quotes, `[2]` for the elements of sequences, and
//! `MATCH` with a list of `fnmatch` patterns, which Connext has: see [`Expression::is_ambiguous`]. LIKE has no escapes, as in
//! the annex.

mod condition;
mod error;
mod expression;
mod fields;
mod literal;
mod member;
mod parser;
mod pattern;
mod token;

#[cfg(test)]
mod tests;

use std::sync::Arc;

pub use error::{BindError, ParseError};
pub use expression::Expression;
pub use fields::{FieldType, Fields, Kind, Value};

use crate::wire::PayloadKind;

/// Whether a sample passes, by its serialized payload with encapsulation header. It is called for data and for keys;
/// what it cannot decode it lets pass.
pub type PayloadFilter = Arc<dyn Fn(PayloadKind, &[u8]) -> bool + Send + Sync>;

/// Bytes of the longest expression with its parameters.
pub const MAX_LEN: usize = 8192;

/// How deep parentheses may nest.
pub const MAX_DEPTH: usize = 32;

/// The most comparisons of an expression.
pub const MAX_PREDICATES: usize = 128;

/// The most names in a member's path, as the three of `a.b.c`.
pub const MAX_PATH: usize = 16;

/// Bytes of the longest pattern of LIKE and MATCH: what a text is compared with takes up to this many times its length.
pub const MAX_PATTERN: usize = 256;
