//! Conditions (DDS 1.4 sections 2.2.2.1.6 to 2.2.2.1.9, 2.2.2.5.8 and 2.2.2.5.9): what a [`WaitSet`](super::WaitSet)
//! waits for.
//!
//! A [`Condition`] is the common handle of the four kinds; clones are the same condition.

use std::fmt;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::Waker;

use rtps_user::reader::Selection;

use crate::error::FilterError;
use crate::filter::PayloadFilter;
use crate::socket::{Trigger, Watched};
use crate::status::StatusMask;

/// Something that is true or not. Equal is what is the same condition.
#[derive(Clone)]
pub struct Condition {
    source: Source,
}

/// Where the truth is found.
#[derive(Clone)]
pub(super) enum Source {
    Guard(Arc<Guard>),
    Entity(Arc<Watched>),
}

/// The state of a guard condition.
#[derive(Default)]
pub(super) struct Guard {
    is_true: AtomicBool,
    wakers: Mutex<Vec<Waker>>,
}

impl Guard {
    pub(super) fn is_true(&self) -> bool {
        self.is_true.load(Ordering::SeqCst)
    }

    pub(super) fn wake_later(&self, waker: &Waker) {
        let mut wakers = self.lock();
        if !wakers.iter().any(|known| known.will_wake(waker)) {
            wakers.push(waker.clone());
        }
    }

    pub(super) fn wake_no_more(&self, waker: &Waker) {
        self.lock().retain(|known| !known.will_wake(waker));
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Waker>> {
        self.wakers.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Condition {
    fn of_entity(watched: Watched) -> Self {
        Self {
            source: Source::Entity(Arc::new(watched)),
        }
    }

    pub(super) fn source(&self) -> &Source {
        &self.source
    }

    /// Whether it is true, after taking in what has arrived.
    pub fn trigger_value(&self) -> bool {
        match &self.source {
            Source::Guard(guard) => guard.is_true(),
            Source::Entity(watched) => watched.shared().poll(|core, _| watched.is_true(core)),
        }
    }
}

impl PartialEq for Condition {
    fn eq(&self, other: &Self) -> bool {
        match (&self.source, &other.source) {
            (Source::Guard(one), Source::Guard(other)) => Arc::ptr_eq(one, other),
            (Source::Entity(one), Source::Entity(other)) => Arc::ptr_eq(one, other),
            _ => false,
        }
    }
}

impl Eq for Condition {}

impl fmt::Debug for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match &self.source {
            Source::Guard(_) => "GuardCondition",
            Source::Entity(watched) => match watched.trigger() {
                Trigger::Status(_) => "StatusCondition",
                Trigger::Read(_) | Trigger::Holds(_) => "ReadCondition",
                Trigger::Query(..) => "QueryCondition",
            },
        };
        f.write_str(name)
    }
}

/// True when the app says so.
#[derive(Clone, Debug)]
pub struct GuardCondition {
    condition: Condition,
}

impl GuardCondition {
    /// One that is not true.
    #[must_use]
    pub fn new() -> Self {
        Self {
            condition: Condition {
                source: Source::Guard(Arc::default()),
            },
        }
    }

    /// Makes it true or not, from any thread; ends the waits for it.
    pub fn set_trigger_value(&self, value: bool) {
        let Source::Guard(guard) = &self.condition.source else {
            return;
        };
        guard.is_true.store(value, Ordering::SeqCst);
        if value {
            let wakers = std::mem::take(&mut *guard.lock());
            wakers.into_iter().for_each(Waker::wake);
        }
    }
}

impl Default for GuardCondition {
    fn default() -> Self {
        Self::new()
    }
}

/// True while a status has changed since it was last asked for and no listener was told, or there are samples that have
/// not been read where it is about DATA_AVAILABLE or DATA_ON_READERS.
#[derive(Clone, Debug)]
pub struct StatusCondition {
    condition: Condition,
}

impl StatusCondition {
    pub(super) fn new(watched: Watched) -> Self {
        Self {
            condition: Condition::of_entity(watched),
        }
    }

    /// The statuses that it is about.
    pub fn enabled_statuses(&self) -> StatusMask {
        match self.trigger() {
            Some(Trigger::Status(mask)) => StatusMask::from_bits(mask.load(Ordering::Relaxed)),
            _ => StatusMask::NONE,
        }
    }

    /// Changes the statuses that it is about.
    pub fn set_enabled_statuses(&self, statuses: StatusMask) {
        if let Some(Trigger::Status(mask)) = self.trigger() {
            mask.store(statuses.bits(), Ordering::Relaxed);
        }
        if let Source::Entity(watched) = &self.condition.source {
            watched.shared().nudge();
        }
    }

    fn trigger(&self) -> Option<&Trigger> {
        match &self.condition.source {
            Source::Entity(watched) => Some(watched.trigger()),
            Source::Guard(_) => None,
        }
    }
}

/// True while its reader has a sample of a selection.
#[derive(Clone, Debug)]
pub struct ReadCondition {
    condition: Condition,
    selection: Selection,
}

impl ReadCondition {
    pub(super) fn new(watched: Watched, selection: Selection) -> Self {
        Self {
            condition: Condition::of_entity(watched),
            selection,
        }
    }

    /// The selection, to read or take what has made it true.
    pub fn selection(&self) -> &Selection {
        &self.selection
    }
}

/// Makes a filter of an expression and its parameters.
pub(super) type Compile = fn(&str, &[String]) -> Result<PayloadFilter, FilterError>;

/// True while its reader has a sample of a selection for which an expression is true.
#[derive(Clone)]
pub struct QueryCondition {
    condition: Condition,
    selection: Selection,
    expression: String,
    compile: Compile,
}

impl QueryCondition {
    pub(super) fn new(
        watched: Watched,
        selection: Selection,
        expression: &str,
        compile: Compile,
    ) -> Self {
        Self {
            condition: Condition::of_entity(watched),
            selection,
            expression: expression.to_owned(),
            compile,
        }
    }

    /// The selection.
    pub fn selection(&self) -> &Selection {
        &self.selection
    }

    /// The expression.
    pub fn query_expression(&self) -> &str {
        &self.expression
    }

    /// Changes what stands for `%0`, `%1` and so on in the expression.
    ///
    /// # Errors
    /// When one is missing or does not compare with its member; all stay as they were then.
    pub fn set_query_parameters(&self, parameters: &[&str]) -> Result<(), FilterError> {
        let parameters: Vec<_> = parameters.iter().map(|text| (*text).to_owned()).collect();
        let filter = (self.compile)(&self.expression, &parameters)?;
        if let Source::Entity(watched) = &self.condition.source {
            if let Trigger::Query(_, current) = watched.trigger() {
                *current.lock().unwrap_or_else(PoisonError::into_inner) = filter;
            }
            watched.shared().nudge();
        }
        Ok(())
    }

    /// The expression as a filter; `None` for what is no query.
    pub(super) fn filter(&self) -> Option<PayloadFilter> {
        let Source::Entity(watched) = &self.condition.source else {
            return None;
        };
        let Trigger::Query(_, filter) = watched.trigger() else {
            return None;
        };
        Some(Arc::clone(
            &filter.lock().unwrap_or_else(PoisonError::into_inner),
        ))
    }
}

impl fmt::Debug for QueryCondition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("QueryCondition")
            .field("selection", &self.selection)
            .field("expression", &self.expression)
            .finish_non_exhaustive()
    }
}

macro_rules! is_condition {
    ($($kind:ty),*) => {$(
        impl AsRef<Condition> for $kind {
            fn as_ref(&self) -> &Condition {
                &self.condition
            }
        }
    )*};
}

is_condition!(
    GuardCondition,
    StatusCondition,
    ReadCondition,
    QueryCondition
);

impl AsRef<Self> for Condition {
    fn as_ref(&self) -> &Self {
        self
    }
}
