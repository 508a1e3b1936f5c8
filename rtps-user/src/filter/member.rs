//! The path to a member, such as `position.x` or `legs[2].length`.

use std::fmt;

use super::{Fields, MAX_PATH, ParseError, Value};

/// One to [`MAX_PATH`] names.
#[derive(Clone, Debug, Eq, PartialEq)]
pub(super) struct MemberPath {
    names: Box<[Box<str>]>,
}

impl MemberPath {
    /// Splits a path; `position` is where it stands in the expression.
    pub(super) fn parse(text: &str, position: usize) -> Result<Self, ParseError> {
        let mut names = Vec::new();
        for part in text.split('.') {
            let mut pieces = part.split('[');
            names.push(pieces.next().filter(|name| is_name(name)));
            names.extend(pieces.map(|piece| piece.strip_suffix(']').filter(|at| is_index(at))));
        }
        let names: Option<Box<[_]>> = names.into_iter().map(|name| name.map(Box::from)).collect();
        match names {
            Some(names) if names.len() <= MAX_PATH => Ok(Self { names }),
            _ => Err(ParseError::InvalidName(position)),
        }
    }

    /// The value of the member in a sample.
    pub(super) fn value_in<'a>(&self, sample: &'a dyn Fields) -> Option<Value<'a>> {
        self.with_names(|names| sample.field(names))
    }

    /// Calls `call` with the names; nothing is allocated for it.
    pub(super) fn with_names<R>(&self, call: impl FnOnce(&[&str]) -> R) -> R {
        let mut names = [""; MAX_PATH];
        let count = names
            .iter_mut()
            .zip(&self.names)
            .map(|(to, from)| *to = from)
            .count();
        call(names.get(..count).unwrap_or_default())
    }

    /// The name where it is a single one, which may be that of an enumerated literal.
    pub(super) fn single(&self) -> Option<&str> {
        match &*self.names {
            [name] => Some(name),
            _ => None,
        }
    }
}

impl fmt::Display for MemberPath {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (place, name) in self.names.iter().enumerate() {
            match place {
                _ if is_index(name) => write!(f, "[{name}]")?,
                0 => f.write_str(name)?,
                _ => write!(f, ".{name}")?,
            }
        }
        Ok(())
    }
}

fn is_name(text: &str) -> bool {
    !text.is_empty() && !text.starts_with(|first: char| first.is_ascii_digit())
}

fn is_index(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit())
}
