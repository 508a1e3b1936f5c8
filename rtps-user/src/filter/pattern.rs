//! The patterns of LIKE and MATCH.

use super::{MAX_PATTERN, ParseError};
use crate::qos::glob_matches;

/// What a text is compared with.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Pattern {
    /// LIKE: `%` stands for any characters, `_` for any one.
    Like(Box<[Piece]>),
    /// Connext's MATCH: one or more patterns of `fnmatch` with commas between.
    Match(Box<[Box<str>]>),
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Piece {
    AnyNumber,
    AnyOne,
    Literal(char),
}

impl Pattern {
    pub(super) fn like(text: &str) -> Result<Self, ParseError> {
        check_len(text)?;
        let pieces = text.chars().map(|character| match character {
            '%' => Piece::AnyNumber,
            '_' => Piece::AnyOne,
            literal => Piece::Literal(literal),
        });
        Ok(Self::Like(pieces.collect()))
    }

    pub(super) fn matching(text: &str) -> Result<Self, ParseError> {
        check_len(text)?;
        Ok(Self::Match(text.split(',').map(Box::from).collect()))
    }

    pub(super) fn matches(&self, text: &str) -> bool {
        match self {
            Self::Like(pieces) => like_matches(pieces, text),
            Self::Match(patterns) => patterns
                .iter()
                .any(|pattern| glob_matches(pattern.as_bytes(), text.as_bytes())),
        }
    }
}

fn check_len(text: &str) -> Result<(), ParseError> {
    match text.len() <= MAX_PATTERN {
        true => Ok(()),
        false => Err(ParseError::PatternTooLong),
    }
}

/// Matches without recursion: after a mismatch only the last `%` takes one character more, so that the time is at
/// most the product of the lengths.
fn like_matches(mut pieces: &[Piece], text: &str) -> bool {
    let mut characters = text.chars();
    let mut retry = None;
    loop {
        if let [Piece::AnyNumber, after @ ..] = pieces {
            if after.is_empty() {
                return true;
            }
            pieces = after;
            retry = Some((after, characters.clone()));
            continue;
        }
        let matched = match (pieces.split_first(), characters.next()) {
            (None, None) => return true,
            (Some(_), None) => return false,
            (Some((Piece::Literal(wanted), _)), Some(found)) => *wanted == found,
            (Some(_), Some(_)) => true,
            (None, Some(_)) => false,
        };
        if matched {
            pieces = pieces.get(1..).unwrap_or_default();
        } else if let Some((after, from)) = &mut retry {
            from.next();
            (pieces, characters) = (after, from.clone());
        } else {
            return false;
        }
    }
}
