//! The tree that an expression is, and its evaluation.
//!
//! A comparison with a member that is absent is neither true nor false, as in SQL, and so is its negation.

use std::cmp::Ordering;

use super::literal::{Literal, compare_values};
use super::member::MemberPath;
use super::pattern::Pattern;
use super::{Fields, Value};

/// A condition. The nesting of `All` and `Any` is that of the parentheses.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Condition {
    All(Vec<Self>),
    Any(Vec<Self>),
    Not(Box<Self>),
    Predicate(Predicate),
}

/// A comparison.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Predicate {
    /// Of a member with a constant.
    Compare(MemberPath, Relation, Literal),
    /// Of two members; or of one with the name of an enumerated literal, until the type is known.
    CompareMembers(MemberPath, Relation, MemberPath),
    /// Whether a member is from one constant to another.
    Between(MemberPath, Literal, Literal),
    /// LIKE or MATCH.
    Pattern(MemberPath, Pattern),
}

/// RelOp.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Relation {
    Equal,
    NotEqual,
    Less,
    LessOrEqual,
    Greater,
    GreaterOrEqual,
}

impl Relation {
    /// The relation that holds with the sides exchanged.
    pub(super) fn mirrored(self) -> Self {
        match self {
            Self::Equal | Self::NotEqual => self,
            Self::Less => Self::Greater,
            Self::LessOrEqual => Self::GreaterOrEqual,
            Self::Greater => Self::Less,
            Self::GreaterOrEqual => Self::LessOrEqual,
        }
    }

    fn holds(self, ordering: Ordering) -> bool {
        match self {
            Self::Equal => ordering.is_eq(),
            Self::NotEqual => ordering.is_ne(),
            Self::Less => ordering.is_lt(),
            Self::LessOrEqual => ordering.is_le(),
            Self::Greater => ordering.is_gt(),
            Self::GreaterOrEqual => ordering.is_ge(),
        }
    }
}

impl Condition {
    /// Whether the condition holds; `None` where absent members leave that open.
    pub(super) fn evaluate(&self, sample: &dyn Fields) -> Option<bool> {
        match self {
            Self::All(conditions) => unless_any(conditions, sample, false),
            Self::Any(conditions) => unless_any(conditions, sample, true),
            Self::Not(condition) => condition.evaluate(sample).map(|holds| !holds),
            Self::Predicate(predicate) => predicate.evaluate(sample),
        }
    }

    /// Calls `visit` with every predicate, in the order of the text.
    pub(super) fn for_each<'a>(&'a self, visit: &mut impl FnMut(&'a Predicate)) {
        match self {
            Self::All(conditions) | Self::Any(conditions) => conditions
                .iter()
                .for_each(|condition| condition.for_each(visit)),
            Self::Not(condition) => condition.for_each(visit),
            Self::Predicate(predicate) => visit(predicate),
        }
    }

    /// Calls `visit` with every predicate, in the order of the text, until one fails.
    pub(super) fn try_each<E>(
        &mut self,
        visit: &mut impl FnMut(&mut Predicate) -> Result<(), E>,
    ) -> Result<(), E> {
        match self {
            Self::All(conditions) | Self::Any(conditions) => conditions
                .iter_mut()
                .try_for_each(|condition| condition.try_each(visit)),
            Self::Not(condition) => condition.try_each(visit),
            Self::Predicate(predicate) => visit(predicate),
        }
    }
}

/// `decisive` as soon as one condition is; the opposite where all are the opposite.
fn unless_any(conditions: &[Condition], sample: &dyn Fields, decisive: bool) -> Option<bool> {
    let mut result = Some(!decisive);
    for condition in conditions {
        match condition.evaluate(sample) {
            Some(holds) if holds == decisive => return Some(decisive),
            Some(_) => {}
            None => result = None,
        }
    }
    result
}

impl Predicate {
    fn evaluate(&self, sample: &dyn Fields) -> Option<bool> {
        match self {
            Self::Compare(member, relation, literal) => {
                let ordering = literal.compare(member.value_in(sample)?)?;
                Some(relation.holds(ordering))
            }
            Self::CompareMembers(left, relation, right) => {
                let ordering = compare_values(left.value_in(sample)?, right.value_in(sample)?)?;
                Some(relation.holds(ordering))
            }
            Self::Between(member, low, high) => {
                let value = member.value_in(sample)?;
                Some(low.compare(value)?.is_ge() && high.compare(value)?.is_le())
            }
            Self::Pattern(member, pattern) => match member.value_in(sample)? {
                Value::Str(text) => Some(pattern.matches(text)),
                _ => None,
            },
        }
    }

    /// Whether vendors differ on what it means.
    pub(super) fn is_ambiguous(&self) -> bool {
        matches!(self, Self::Pattern(_, Pattern::Match(_)))
    }

    /// The members that are compared.
    pub(super) fn members(&self) -> impl Iterator<Item = &MemberPath> {
        let (first, second) = match self {
            Self::CompareMembers(left, _, right) => (left, Some(right)),
            Self::Compare(member, ..) | Self::Between(member, ..) | Self::Pattern(member, _) => {
                (member, None)
            }
        };
        [Some(first), second].into_iter().flatten()
    }
}
