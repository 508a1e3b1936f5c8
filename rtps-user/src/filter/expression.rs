//! A content filter's expression with its parameters.

use super::condition::{Condition, Predicate, Relation};
use super::literal::Literal;
use super::member::MemberPath;
use super::{BindError, FieldType, Fields, Kind, ParseError, parser};

/// A parsed expression. The empty one holds for every sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Expression {
    text: String,
    parameters: Vec<String>,
    condition: Option<Condition>,
}

impl Expression {
    /// Parses a FilterExpression, in which `parameters` stand for `%0`, `%1` and so on. A text among them may have
    /// quotes or not.
    ///
    /// # Errors
    /// When it is none, mentions a parameter that is not there, or exceeds a limit.
    pub fn parse(text: &str, parameters: &[String]) -> Result<Self, ParseError> {
        Ok(Self {
            condition: parser::parse(text, parameters)?,
            text: text.to_owned(),
            parameters: parameters.to_vec(),
        })
    }

    /// The same expression with other parameters, not bound to a type.
    ///
    /// # Errors
    /// As [`parse`](Self::parse).
    pub fn with_parameters(&self, parameters: &[String]) -> Result<Self, ParseError> {
        Self::parse(&self.text, parameters)
    }

    /// What was parsed.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// What stands for `%0`, `%1` and so on.
    pub fn parameters(&self) -> &[String] {
        &self.parameters
    }

    /// Checks the expression against a type, and finds the values of enumerated literals that it names: before that
    /// no comparison with one holds. `type_of` gives the type of the member at a path as in [`Fields::field`].
    ///
    /// # Errors
    /// When the type has no such member, or it does not compare with what it is compared with.
    pub fn bind(
        mut self,
        type_of: impl Fn(&[&str]) -> Option<FieldType>,
    ) -> Result<Self, BindError> {
        let kind_of = |member: &MemberPath| {
            let found = member.with_names(&type_of).map(|found| found.kind);
            found.ok_or_else(|| BindError::UnknownMember(member.to_string()))
        };
        if let Some(condition) = &mut self.condition {
            condition.try_each(&mut |predicate| bind(predicate, &kind_of))?;
        }
        Ok(self)
    }

    /// Whether a sample passes. A comparison with a member that is absent does not hold, and neither does its negation.
    pub fn evaluate(&self, sample: &dyn Fields) -> bool {
        let condition = self.condition.as_ref();
        condition.is_none_or(|condition| condition.evaluate(sample) == Some(true))
    }

    /// Whether it has an operator that is not of DDS 1.4: MATCH, which vendors have given different meanings (Connext takes
    /// patterns of `fnmatch`, Fast DDS regular expressions). Only who wrote such an expression knows what it means.
    pub fn is_ambiguous(&self) -> bool {
        let mut is_ambiguous = false;
        if let Some(condition) = &self.condition {
            condition.for_each(&mut |predicate| is_ambiguous |= predicate.is_ambiguous());
        }
        is_ambiguous
    }

    /// The paths of all members that are compared, as [`Fields::field`] takes them; before it is bound also the names
    /// of enumerated literals that stand without quotes.
    pub fn members(&self) -> Vec<Vec<String>> {
        let mut members = Vec::new();
        let owned = |names: &[&str]| names.iter().map(ToString::to_string).collect();
        if let Some(condition) = &self.condition {
            condition.for_each(&mut |predicate| {
                members.extend(predicate.members().map(|member| member.with_names(owned)));
            });
        }
        members
    }
}

fn bind(
    predicate: &mut Predicate,
    kind_of: &impl Fn(&MemberPath) -> Result<Kind, BindError>,
) -> Result<(), BindError> {
    match predicate {
        Predicate::Compare(member, _, literal) => bind_literal(literal, member, kind_of(member)?),
        Predicate::Between(member, low, high) => {
            let kind = kind_of(member)?;
            bind_literal(low, member, kind)?;
            bind_literal(high, member, kind)
        }
        Predicate::Pattern(member, _) => match kind_of(member)? {
            Kind::String => Ok(()),
            _ => Err(BindError::Incomparable(member.to_string())),
        },
        Predicate::CompareMembers(left, relation, right) => {
            let (left, right) = (left.clone(), right.clone());
            *predicate = bind_members(left, *relation, right, kind_of)?;
            Ok(())
        }
    }
}

fn bind_literal(literal: &mut Literal, member: &MemberPath, kind: Kind) -> Result<(), BindError> {
    let bound = std::mem::take(literal).bound_to(kind);
    *literal = bound.ok_or_else(|| BindError::Incomparable(member.to_string()))?;
    Ok(())
}

/// One of the names may be that of an enumerated literal.
fn bind_members(
    left: MemberPath,
    relation: Relation,
    right: MemberPath,
    kind_of: &impl Fn(&MemberPath) -> Result<Kind, BindError>,
) -> Result<Predicate, BindError> {
    let named = |literal: &MemberPath, member: MemberPath, kind, relation| {
        let mut literal = Literal::text(literal.to_string());
        bind_literal(&mut literal, &member, kind)?;
        Ok(Predicate::Compare(member, relation, literal))
    };
    match (kind_of(&left), kind_of(&right)) {
        (Ok(of_left), Ok(of_right)) if of_left.compares_with(of_right) => {
            Ok(Predicate::CompareMembers(left, relation, right))
        }
        (Ok(_), Ok(_)) => Err(BindError::Incomparable(left.to_string())),
        (Ok(kind @ Kind::Enum(_)), Err(_)) => named(&right, left, kind, relation),
        (Err(_), Ok(kind @ Kind::Enum(_))) => named(&left, right, kind, relation.mirrored()),
        (Err(error), _) | (_, Err(error)) => Err(error),
    }
}
