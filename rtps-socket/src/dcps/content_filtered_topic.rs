//! ContentFilteredTopic (DDS 1.4 section 2.2.2.3.3): a topic of which a reader wants only what an expression is true
//! for.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use rtps_user::qos::ContentFilter;

use super::Topic;
use crate::cdr::DdsType;
use crate::error::{CreateError, FilterError};
use crate::filter::{Expression, PayloadFilter, bind, payload_filter};
use crate::socket::FilterSetter;

/// `%0` to `%99`.
const MAX_PARAMETERS: usize = 100;

/// What a reader can be created for: a [`Topic`] or a [`ContentFilteredTopic`].
pub trait TopicDescription<T>: sealed::Described<T> {
    /// Its name; that of a filtered topic is not seen by others.
    fn name(&self) -> &str;
}

pub(super) mod sealed {
    use super::{Filter, Topic};

    /// What a reader needs to know.
    pub trait Described<T> {
        /// The topic that is written.
        fn topic(&self) -> &Topic<T>;

        /// What is wanted of it.
        fn filter(&self) -> Option<&Filter>;
    }
}

/// The filter of a topic, and the readers that have it.
pub struct Filter {
    state: Mutex<State>,
}

struct State {
    announced: ContentFilter,
    payloads: PayloadFilter,
    readers: Vec<Weak<FilterSetter>>,
}

/// A topic as readers see it that want only some of its samples. Clones are the same filtered topic.
///
/// Writers that understand the expression do not even send the others.
pub struct ContentFilteredTopic<T> {
    name: String,
    topic: Topic<T>,
    filter: Arc<Filter>,
}

impl<T> Clone for ContentFilteredTopic<T> {
    fn clone(&self) -> Self {
        Self {
            name: self.name.clone(),
            topic: self.topic.clone(),
            filter: Arc::clone(&self.filter),
        }
    }
}

impl<T: DdsType> ContentFilteredTopic<T> {
    pub(super) fn new(
        name: &str,
        topic: &Topic<T>,
        expression: &str,
        parameters: &[&str],
    ) -> Result<Self, FilterError> {
        if !Topic::<T>::is_name(name) {
            return Err(CreateError::InvalidName(name.to_owned()).into());
        }
        let parameters = owned(parameters)?;
        let bound = bind::<T>(Expression::parse(expression, &parameters)?)?;
        let class = match bound.is_ambiguous() {
            true => ContentFilter::SQL_WITH_FNMATCH,
            false => ContentFilter::SQL,
        };
        let announced = ContentFilter {
            name: name.to_owned(),
            related_topic: topic.name().to_owned(),
            class: class.to_owned(),
            expression: expression.to_owned(),
            parameters,
        };
        let state = State {
            announced,
            payloads: payload_filter::<T>(bound),
            readers: Vec::new(),
        };
        Ok(Self {
            name: name.to_owned(),
            topic: topic.clone(),
            filter: Arc::new(Filter {
                state: Mutex::new(state),
            }),
        })
    }

    /// Its name.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// The topic that is filtered.
    pub fn related_topic(&self) -> &Topic<T> {
        &self.topic
    }

    /// The expression.
    pub fn filter_expression(&self) -> String {
        self.filter.lock().announced.expression.clone()
    }

    /// What stands for `%0`, `%1` and so on.
    pub fn expression_parameters(&self) -> Vec<String> {
        self.filter.lock().announced.parameters.clone()
    }

    /// Changes what stands for `%0`, `%1` and so on, for what its readers receive from now on.
    ///
    /// # Errors
    /// When one is missing or does not compare with its member; all stay as they were then.
    pub fn set_expression_parameters(&self, parameters: &[&str]) -> Result<(), FilterError> {
        let parameters = owned(parameters)?;
        let mut state = self.filter.lock();
        let payloads = compiled::<T>(&state.announced.expression, &parameters)?;
        let announced = ContentFilter {
            parameters,
            ..state.announced.clone()
        };
        for reader in state.readers.iter().filter_map(Weak::upgrade) {
            reader.set(announced.clone(), Arc::clone(&payloads))?;
        }
        (state.announced, state.payloads) = (announced, payloads);
        Ok(())
    }
}

impl Filter {
    /// What others and the reader itself are told.
    pub(super) fn current(&self) -> (ContentFilter, PayloadFilter) {
        let state = self.lock();
        (state.announced.clone(), Arc::clone(&state.payloads))
    }

    /// A reader has been created with what was current.
    ///
    /// # Errors
    /// When what is current now is too large to be announced.
    pub(super) fn follow(&self, reader: &Arc<FilterSetter>) -> Result<(), CreateError> {
        let mut state = self.lock();
        state.readers.retain(|known| known.strong_count() > 0);
        state.readers.push(Arc::downgrade(reader));
        reader.set(state.announced.clone(), Arc::clone(&state.payloads))
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl<T: DdsType> TopicDescription<T> for Topic<T> {
    fn name(&self) -> &str {
        self.name()
    }
}

impl<T: DdsType> sealed::Described<T> for Topic<T> {
    fn topic(&self) -> &Self {
        self
    }

    fn filter(&self) -> Option<&Filter> {
        None
    }
}

impl<T: DdsType> TopicDescription<T> for ContentFilteredTopic<T> {
    fn name(&self) -> &str {
        self.name()
    }
}

impl<T: DdsType> sealed::Described<T> for ContentFilteredTopic<T> {
    fn topic(&self) -> &Topic<T> {
        &self.topic
    }

    fn filter(&self) -> Option<&Filter> {
        Some(&self.filter)
    }
}

fn owned(parameters: &[&str]) -> Result<Vec<String>, FilterError> {
    if parameters.len() > MAX_PARAMETERS {
        return Err(FilterError::TooManyParameters(parameters.len()));
    }
    Ok(parameters.iter().map(|text| (*text).to_owned()).collect())
}

pub(super) fn compiled<T: DdsType>(
    expression: &str,
    parameters: &[String],
) -> Result<PayloadFilter, FilterError> {
    let expression = Expression::parse(expression, parameters)?;
    Ok(payload_filter::<T>(bind::<T>(expression)?))
}
