//! Why an expression is refused.

use thiserror::Error;

use super::{MAX_DEPTH, MAX_LEN, MAX_PATH, MAX_PATTERN, MAX_PREDICATES};

/// Why a text is no expression. Positions count bytes from 0.
#[derive(Clone, Debug, Eq, Error, PartialEq)]
pub enum ParseError {
    /// The expression and its parameters are longer than [`MAX_LEN`].
    #[error("an expression and its parameters have at most {MAX_LEN} bytes together")]
    TooLong,
    /// Parentheses nest deeper than [`MAX_DEPTH`].
    #[error("parentheses nest at most {MAX_DEPTH} deep")]
    TooDeep,
    /// More comparisons than [`MAX_PREDICATES`].
    #[error("an expression has at most {MAX_PREDICATES} comparisons")]
    TooManyPredicates,
    /// A pattern is longer than [`MAX_PATTERN`].
    #[error("a pattern has at most {MAX_PATTERN} bytes")]
    PatternTooLong,
    /// A character that nothing begins with.
    #[error("nothing begins with the character at {0}")]
    UnexpectedCharacter(usize),
    /// A text without its closing quote.
    #[error("the text that begins at {0} has no closing quote")]
    UnterminatedText(usize),
    /// Digits that are no number, or one beyond 64 bits.
    #[error("what stands at {0} is no number of up to 64 bits")]
    InvalidNumber(usize),
    /// A member's name that is none, or of too many parts.
    #[error("what stands at {0} is no member's name of up to {MAX_PATH} parts")]
    InvalidName(usize),
    /// Something else was needed.
    #[error("{what} is missing at {position}")]
    Expected {
        /// What was needed.
        what: &'static str,
        /// Where.
        position: usize,
    },
    /// A parameter that the expression mentions was not given.
    #[error("the expression mentions %{0}, which was not given")]
    MissingParameter(usize),
}

/// Why an expression does not apply to a type.
#[derive(Clone, Debug, Eq, Error, PartialEq)]
pub enum BindError {
    /// The type has no such primitive, string or enumerated member.
    #[error("the type has no member `{0}` that can be compared")]
    UnknownMember(String),
    /// The member is compared with what its type does not compare with.
    #[error("the type of `{0}` does not compare with what it is compared with")]
    Incomparable(String),
}
