//! Reading and taking in all forms (DDS 1.4 section 2.2.2.5.3): by selection, by instance, instance after instance.
//!
//! `read` leaves the samples in the reader, `take` does not. None of it waits.

use std::sync::{Arc, Mutex};

use rtps_user::reader::{self, InstanceOf, InstanceState, Selection};
use rtps_user::wire::{KeyHash, PayloadKind};

use super::content_filtered_topic::compiled;
use super::{DataReader, QueryCondition, ReadCondition, Sample, instance_of};
use crate::cdr::{
    DdsType, DecodeError, Encapsulation, Representation, from_key_payload, from_payload,
};
use crate::error::FilterError;
use crate::socket::Trigger;
use crate::status::StatusEvent;

/// Whether samples stay in the reader.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Form {
    Read,
    Take,
}

impl<T: DdsType> DataReader<T> {
    /// Takes all samples.
    pub fn take(&self) -> Vec<Sample<T>> {
        self.take_selection(usize::MAX, &Selection::default())
    }

    /// Takes up to `max` samples of a selection.
    pub fn take_selection(&self, max: usize, selection: &Selection) -> Vec<Sample<T>> {
        self.decode_all(self.reader.take(max, selection), Form::Take)
    }

    /// Takes up to `max` samples as they were received: the payload is that in the reader's cache, not a copy, and not
    /// deserialized.
    pub fn take_serialized(&self, max: usize, selection: &Selection) -> Vec<reader::Sample> {
        self.reader.take(max, selection)
    }

    /// Takes up to `max` samples of one instance.
    pub fn take_instance(
        &self,
        instance: KeyHash,
        max: usize,
        selection: &Selection,
    ) -> Vec<Sample<T>> {
        self.take_selection(max, &of_instance(instance, selection))
    }

    /// Takes up to `max` samples of the next instance after `previous` that has samples of the selection; of the
    /// first one where there is no previous. Nothing when there is no such instance.
    ///
    /// The order of instances is that of their handles, the same in every reader of a type.
    pub fn take_next_instance(
        &self,
        previous: Option<KeyHash>,
        max: usize,
        selection: &Selection,
    ) -> Vec<Sample<T>> {
        self.next_instance(previous, Form::Take, |previous| {
            self.reader.take_next_instance(previous, max, selection)
        })
    }

    /// Takes up to `max` samples that have made a condition of this reader true.
    pub fn take_query(&self, max: usize, condition: &QueryCondition) -> Vec<Sample<T>> {
        let Some(filter) = condition.filter() else {
            return Vec::new();
        };
        let samples = self.reader.take_where(max, condition.selection(), &filter);
        self.decode_all(samples, Form::Take)
    }

    /// Reads up to `max` samples that have made a condition of this reader true.
    pub fn read_query(&self, max: usize, condition: &QueryCondition) -> Vec<Sample<T>> {
        let Some(filter) = condition.filter() else {
            return Vec::new();
        };
        let samples = self.reader.read_where(max, condition.selection(), &filter);
        self.decode_all(samples, Form::Read)
    }

    /// A condition that is true while there are samples of a selection.
    pub fn read_condition(&self, selection: Selection) -> ReadCondition {
        ReadCondition::new(self.reader.watch(Trigger::Read(selection)), selection)
    }

    /// A condition that is true while there are samples of a selection for which an expression of DDS 1.4 annex B is;
    /// `parameters` stand for `%0`, `%1` and so on in it. News of instances that come without key count, too.
    ///
    /// # Errors
    /// When the expression is none, or does not fit the type.
    pub fn query_condition(
        &self,
        selection: Selection,
        expression: &str,
        parameters: &[&str],
    ) -> Result<QueryCondition, FilterError> {
        let parameters: Vec<_> = parameters.iter().map(|text| (*text).to_owned()).collect();
        let filter = Mutex::new(compiled::<T>(expression, &parameters)?);
        let watched = self.reader.watch(Trigger::Query(selection, filter));
        let condition = QueryCondition::new(watched, selection, expression, compiled::<T>);
        Ok(condition)
    }

    /// Reads all samples that have not been read before.
    pub fn read(&self) -> Vec<Sample<T>> {
        self.read_selection(usize::MAX, &Selection::not_read())
    }

    /// Reads up to `max` samples of a selection, which count as read then.
    pub fn read_selection(&self, max: usize, selection: &Selection) -> Vec<Sample<T>> {
        self.decode_all(self.reader.read(max, selection), Form::Read)
    }

    /// Reads up to `max` samples of one instance.
    pub fn read_instance(
        &self,
        instance: KeyHash,
        max: usize,
        selection: &Selection,
    ) -> Vec<Sample<T>> {
        self.read_selection(max, &of_instance(instance, selection))
    }

    /// Reads what [`take_next_instance`](Self::take_next_instance) would take.
    pub fn read_next_instance(
        &self,
        previous: Option<KeyHash>,
        max: usize,
        selection: &Selection,
    ) -> Vec<Sample<T>> {
        self.next_instance(previous, Form::Read, |previous| {
            self.reader.read_next_instance(previous, max, selection)
        })
    }

    /// The handle of the instance that `value` belongs to, if the reader knows it; only key members count.
    pub fn lookup_instance(&self, value: &T) -> Option<KeyHash> {
        if !T::HAS_KEY {
            return None;
        }
        let mut scratch = Vec::new();
        // For some types it depends on the writer's representation.
        let handles = [Representation::Xcdr1, Representation::Xcdr2].map(|representation| {
            let handle = instance_of(value, representation, &mut scratch);
            handle.ok()
        });
        let mut handles = handles.into_iter().flatten();
        handles.find(|handle| self.reader.lookup_instance(*handle))
    }

    /// A value of which only the key members are set, those of an instance of which samples have been read or taken.
    pub fn key_value(&self, instance: KeyHash) -> Option<T> {
        self.keys.value(instance).ok().flatten()
    }

    /// The samples of the next instance; where they are all none of the type, of the one after that.
    fn next_instance(
        &self,
        mut previous: Option<KeyHash>,
        form: Form,
        next: impl Fn(Option<KeyHash>) -> Vec<reader::Sample>,
    ) -> Vec<Sample<T>> {
        loop {
            let samples = next(previous);
            let Some(first) = samples.first() else {
                return Vec::new();
            };
            previous = Some(first.info.instance);
            let samples = self.decode_all(samples, form);
            if !samples.is_empty() {
                return samples;
            }
        }
    }

    fn decode_all(&self, samples: Vec<reader::Sample>, form: Form) -> Vec<Sample<T>> {
        let samples = samples.into_iter();
        let decoded = samples.filter_map(|sample| self.decode(sample, form));
        decoded.collect()
    }

    /// The typed sample; what is not of the type is reported and left out.
    pub(super) fn decode(&self, sample: reader::Sample, form: Form) -> Option<Sample<T>> {
        let info = sample.info;
        let decoded = match info.valid_data {
            true => from_payload(&sample.payload).map(|data| (Some(data), None)),
            false => self.decode_key(&sample).map(|key| (None, key)),
        };
        match decoded {
            Ok((data, key)) => {
                let sample = Sample { data, key, info };
                if T::HAS_KEY {
                    self.note_instance(&sample, form);
                }
                Some(sample)
            }
            Err(error) => {
                let writer = info.writer;
                tracing::warn!(%writer, "a sample is left out, as it is no {}: {error}", T::TYPE_NAME);
                self.reader
                    .report(StatusEvent::Undecodable { writer, error });
                None
            }
        }
    }

    fn decode_key(&self, sample: &reader::Sample) -> Result<Option<T>, DecodeError> {
        match sample.payload.is_empty() {
            true => self.keys.value(sample.info.instance),
            false => from_key_payload(&sample.payload).map(Some),
        }
    }

    /// Notes the key of an instance until its end has been taken: who ends it may send its hash alone.
    fn note_instance(&self, sample: &Sample<T>, form: Form) {
        let info = &sample.info;
        if let Some(data) = &sample.data {
            self.keys.note(info.instance, data, |keys| {
                self.reader.retain_known(keys);
            });
        } else if form == Form::Take && info.instance_state != InstanceState::Alive {
            self.keys.forget(info.instance);
        }
    }
}

fn of_instance(instance: KeyHash, selection: &Selection) -> Selection {
    Selection {
        instance: Some(instance),
        ..*selection
    }
}

/// Finds the instance of a serialized payload.
pub(super) fn instance_of_payload<T: DdsType>() -> InstanceOf {
    Arc::new(|kind, payload| {
        let (encapsulation, _) = Encapsulation::split(payload).ok()?;
        let value: T = match kind {
            PayloadKind::Data => from_payload(payload).ok()?,
            PayloadKind::Key => from_key_payload(payload).ok()?,
            PayloadKind::None => return None,
        };
        instance_of(&value, encapsulation.representation, &mut Vec::new()).ok()
    })
}
