//! Content filters of typed topics: expressions checked against a type, and applied to its serialized samples.

use std::sync::Arc;

use rtps_user::qos::ContentFilter;
use rtps_user::wire::PayloadKind;

use crate::cdr::{DdsType, from_key_payload, from_payload};

pub use rtps_user::filter::{BindError, Expression, ParseError, PayloadFilter};

/// Checks an expression against the members of `T`, and finds the values of the enumerated literals that it names.
///
/// # Errors
/// When the type has no such member, or it does not compare with what it is compared with.
pub fn bind<T: DdsType>(expression: Expression) -> Result<Expression, BindError> {
    expression.bind(T::type_at)
}

/// Applies an expression that is bound to `T` to serialized samples. Keys are judged where the expression knows no
/// other members, and pass otherwise, as does what cannot be decoded: the reader will report it.
pub fn payload_filter<T: DdsType>(expression: Expression) -> PayloadFilter {
    let judges_keys = uses_keys_alone::<T>(&expression);
    Arc::new(move |kind, payload| {
        let sample = match kind {
            PayloadKind::Data => from_payload::<T>(payload),
            PayloadKind::Key if judges_keys => from_key_payload::<T>(payload),
            PayloadKind::Key | PayloadKind::None => return true,
        };
        sample.map_or(true, |sample| expression.evaluate(&sample))
    })
}

/// The filter that a remote reader announces; `None` where it is not understood, so that everything is to be sent.
pub(crate) fn announced_filter<T: DdsType>(filter: &ContentFilter) -> Option<PayloadFilter> {
    let is_ours = filter.class == ContentFilter::SQL_WITH_FNMATCH;
    if filter.class != ContentFilter::SQL && !is_ours {
        return None;
    }
    let expression = Expression::parse(&filter.expression, &filter.parameters);
    let bound = expression
        .map_err(|error| error.to_string())
        .and_then(|expression| bind::<T>(expression).map_err(|error| error.to_string()));
    match bound {
        Ok(expression) if expression.is_ambiguous() && !is_ours => None,
        Ok(expression) => Some(payload_filter::<T>(expression)),
        Err(error) => {
            tracing::info!(
                expression = filter.expression,
                "a reader's filter is left to the reader: {error}"
            );
            None
        }
    }
}

fn uses_keys_alone<T: DdsType>(expression: &Expression) -> bool {
    let is_key = |member: &Vec<String>| {
        let path: Vec<&str> = member.iter().map(String::as_str).collect();
        T::type_at(&path).is_some_and(|found| found.is_key)
    };
    T::HAS_KEY && expression.members().iter().all(is_key)
}
