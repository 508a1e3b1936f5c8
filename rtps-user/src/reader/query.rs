//! Samples by their content: what a QueryCondition asks for (DDS 1.4 section 2.2.2.5.9).

use super::access::Access;
use super::cache::Cache;
use super::{PayloadFilter, Reader, Sample, SampleInfo, Selection};
use crate::wire::PayloadKind;

impl Reader {
    /// Takes up to `max` samples of a selection that pass a filter, in the order of arrival.
    pub fn take_where(
        &mut self,
        max: usize,
        selection: &Selection,
        filter: &PayloadFilter,
    ) -> Vec<Sample> {
        let samples = self
            .cache
            .collect_where(max, selection, filter, Access::Take);
        self.taken(&samples);
        samples
    }

    /// Reads up to `max` samples of a selection that pass a filter; they stay.
    pub fn read_where(
        &mut self,
        max: usize,
        selection: &Selection,
        filter: &PayloadFilter,
    ) -> Vec<Sample> {
        self.cache
            .collect_where(max, selection, filter, Access::Read)
    }

    /// What the samples of a selection are known to be, in the order of arrival; they do not count as read, and their
    /// ranks are 0.
    pub fn infos<'a>(&'a self, selection: &'a Selection) -> impl Iterator<Item = SampleInfo> + 'a {
        let places = self.cache.select(selection);
        places.map(|place| self.cache.info(place))
    }

    /// Whether there is a sample of a selection that passes a filter.
    pub fn has_matching_where(&self, selection: &Selection, filter: &PayloadFilter) -> bool {
        self.cache.select_where(selection, filter).next().is_some()
    }
}

impl Cache {
    fn collect_where(
        &mut self,
        max: usize,
        selection: &Selection,
        filter: &PayloadFilter,
        access: Access,
    ) -> Vec<Sample> {
        let mut chosen = std::mem::take(&mut self.chosen);
        chosen.extend(self.select_where(selection, filter).take(max));
        self.hand_out(chosen, access)
    }

    fn select_where<'a>(
        &'a self,
        selection: &'a Selection,
        filter: &'a PayloadFilter,
    ) -> impl Iterator<Item = u32> + 'a {
        self.select(selection).filter(|place| {
            let entry = self.entries.get(*place);
            let kind = match (entry.valid_data, entry.payload.is_empty()) {
                (true, _) => PayloadKind::Data,
                (false, false) => PayloadKind::Key,
                (false, true) => PayloadKind::None,
            };
            filter(kind, &entry.payload)
        })
    }
}
