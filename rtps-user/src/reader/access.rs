//! Reading and taking: which samples are handed out, and the states and ranks that go with them
//! (DDS 1.4 sections 2.2.2.5.1 and 2.2.2.5.3.8).

use bytes::Bytes;

use super::cache::Cache;
use super::entries::Entry;
use super::instance::Instance;
use super::{Reader, Sample, SampleInfo, SampleState, Selection, ViewState};

/// Whether samples stay.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Access {
    Read,
    Take,
}

impl Reader {
    /// Takes up to `max` samples in the order of arrival; makes room for samples that could not be accepted. A reader
    /// with coherent or ordered access of INSTANCE scope gets those of each instance in a row (DDS 1.4 section
    /// 2.2.2.5.3.8).
    pub fn take(&mut self, max: usize, selection: &Selection) -> Vec<Sample> {
        let samples = self.cache.collect(max, selection, Access::Take);
        self.taken(&samples);
        samples
    }

    /// There is room for what could not be accepted.
    pub(super) fn taken(&mut self, samples: &[Sample]) {
        if !samples.is_empty() && !self.blocked.is_empty() {
            self.release();
        }
    }

    /// Takes the first sample of a selection in the order of arrival, as [`take`](Self::take) does.
    pub fn take_next(&mut self, selection: &Selection) -> Option<Sample> {
        let sample = self.cache.take_next(selection);
        if sample.is_some() && !self.blocked.is_empty() {
            self.release();
        }
        sample
    }

    /// Reads up to `max` samples, which stay.
    pub fn read(&mut self, max: usize, selection: &Selection) -> Vec<Sample> {
        self.cache.collect(max, selection, Access::Read)
    }

    /// Whether there is a sample that has not been read.
    pub fn has_data(&self) -> bool {
        self.cache.unread_count > 0
    }

    /// Whether it has as many samples for the application as are worth having at once, none of which gives way to what
    /// comes after it.
    pub fn has_backlog(&self) -> bool {
        const BACKLOG: usize = 256;
        let cache = &self.cache;
        let is_open = cache.horizon == u64::MAX;
        cache.unread_count >= BACKLOG && cache.limits.depth.is_none() && is_open
    }

    /// Whether there is a sample that `selection` selects.
    pub fn has_matching(&self, selection: &Selection) -> bool {
        self.cache.has_matching(selection)
    }

    /// How many samples there are, read or not.
    pub fn len(&self) -> usize {
        self.cache.entries.len()
    }

    /// Whether there is no sample.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl Cache {
    /// Hands out up to `max` samples that `selection` selects, in the order of arrival.
    pub(super) fn collect(
        &mut self,
        max: usize,
        selection: &Selection,
        access: Access,
    ) -> Vec<Sample> {
        let mut chosen = std::mem::take(&mut self.chosen);
        chosen.extend(self.select(selection).take(max));
        self.hand_out(chosen, access)
    }

    /// Hands out samples by their places; makes these the room for those of the next time.
    pub(super) fn hand_out(&mut self, mut chosen: Vec<u32>, access: Access) -> Vec<Sample> {
        if self.groups_instances && chosen.len() > 1 {
            self.group_by_instance(&mut chosen);
        }
        let mut samples: Vec<Sample> = chosen
            .iter()
            .map(|place| self.sample(*place, access))
            .collect();
        for (place, sample) in chosen.iter().zip(&mut samples).rev() {
            self.rank(*place, &mut sample.info);
        }
        for place in chosen.drain(..) {
            self.accessed(place, access);
        }
        self.chosen = chosen;
        samples
    }

    /// Brings samples of one instance together, in the order of the first ones.
    fn group_by_instance(&mut self, chosen: &mut [u32]) {
        let mut count = 0;
        for place in chosen.iter() {
            let instance = &mut self.instances[self.entries.get(*place).instance];
            if instance.collected.0 == 0 {
                count += 1;
                instance.collected.0 = count;
            }
        }
        chosen.sort_by_key(|place| {
            self.instances[self.entries.get(*place).instance]
                .collected
                .0
        });
        for place in chosen.iter() {
            let instance = self.entries.get(*place).instance;
            self.instances[instance].collected = (0, 0);
        }
    }

    /// Takes the first sample that `selection` selects.
    pub(super) fn take_next(&mut self, selection: &Selection) -> Option<Sample> {
        let place = self.select(selection).next()?;
        let mut sample = self.sample(place, Access::Take);
        self.rank(place, &mut sample.info);
        self.accessed(place, Access::Take);
        Some(sample)
    }

    /// Whether there is a sample that `selection` selects.
    pub(super) fn has_matching(&self, selection: &Selection) -> bool {
        self.select(selection).next().is_some()
    }

    pub(super) fn select<'a>(&'a self, selection: &'a Selection) -> impl Iterator<Item = u32> + 'a {
        let mut next = match selection.instance {
            Some(key) => self.samples_of(key),
            None => self.entries.arrival(),
        }
        .first();
        std::iter::from_fn(move || {
            let place = next?;
            next = match selection.instance {
                Some(_) => self.entries.next_sibling(place),
                None => self.entries.next_arrival(place),
            };
            Some(place)
        })
        .filter(|place| self.is_selected(*place, selection))
    }

    fn is_selected(&self, place: u32, selection: &Selection) -> bool {
        let entry = self.entries.get(place);
        let instance = &self.instances[entry.instance];
        entry.arrival < self.horizon
            && selection.sample_states.contains(sample_state(entry))
            && selection.view_states.contains(instance.view)
            && selection.instance_states.contains(instance.state)
    }

    #[inline]
    fn sample(&mut self, place: u32, access: Access) -> Sample {
        let entry = self.entries.get_mut(place);
        let instance = &self.instances[entry.instance];
        let info = info(entry, instance);
        // A handle is not free: the first clone of a payload allocates.
        let payload: Bytes = match access {
            Access::Read => entry.payload.clone(),
            Access::Take => std::mem::take(&mut entry.payload),
        };
        Sample { payload, info }
    }

    /// What is known of a sample by itself.
    pub(super) fn info(&self, place: u32) -> SampleInfo {
        let entry = self.entries.get(place);
        info(entry, &self.instances[entry.instance])
    }

    /// Fills in the ranks; called from the last sample of a collection to its first.
    fn rank(&mut self, place: u32, info: &mut SampleInfo) {
        let entry = self.entries.get(place);
        let generation = entry.generation();
        let instance = &mut self.instances[entry.instance];
        let (following, newest) = match instance.collected {
            (0, _) => (0, generation),
            collected => collected,
        };
        instance.collected = (following + 1, newest);
        info.sample_rank = following;
        info.generation_rank = newest.saturating_sub(generation);
        info.absolute_generation_rank = instance.generation().saturating_sub(generation);
    }

    /// Removes a taken sample or marks a read one, and its instance as seen.
    #[inline]
    fn accessed(&mut self, place: u32, access: Access) {
        let entry = self.entries.get_mut(place);
        let was_read = std::mem::replace(&mut entry.read, true);
        let instance = entry.instance;
        if !was_read {
            self.unread_count -= 1;
            self.seen(place);
        }
        self.instances[instance].view = ViewState::NotNew;
        self.instances[instance].collected = (0, 0);
        if access == Access::Take {
            self.remove(place);
            self.review(instance);
        }
    }
}

fn sample_state(entry: &Entry) -> SampleState {
    if entry.read {
        SampleState::Read
    } else {
        SampleState::NotRead
    }
}

fn info(entry: &Entry, instance: &Instance) -> SampleInfo {
    SampleInfo {
        valid_data: entry.valid_data,
        instance: instance.key,
        writer: entry.writer,
        sequence: entry.sequence,
        source_timestamp: entry.timestamp,
        group_sequence: entry
            .extras
            .as_ref()
            .and_then(|extras| extras.group_sequence),
        reception: entry.reception,
        sample_state: sample_state(entry),
        view_state: instance.view,
        instance_state: instance.state,
        disposed_generation_count: entry.disposed_generation,
        no_writers_generation_count: entry.no_writers_generation,
        sample_rank: 0,
        generation_rank: 0,
        absolute_generation_rank: 0,
    }
}
