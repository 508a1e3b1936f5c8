//! The MANUAL_BY_PARTICIPANT writers of an app are alive together: what one of them asserts, by writing as well, holds for
//! all (DDS 1.4 section 2.2.3.11).
//!
//! Here they learn of it from each other when a lease ends, and readers of the others by a message of the participant
//! (RTPS 2.5 section 8.4.13).

use std::time::{Duration, Instant};

use super::Endpoints;
use crate::writer::Writer;

/// Two messages may be lost or late in the shortest lease.
const PER_LEASE: u32 = 3;
/// Shorter leases are asserted no more often than is possible.
const MIN_PERIOD: Duration = Duration::from_millis(10);

impl Endpoints {
    /// The app asserts the liveliness of all its writers that are MANUAL_BY_PARTICIPANT, and tells their readers itself.
    pub fn assert_liveliness(&mut self, now: Instant) {
        for (place, scheduled) in self.endpoints.iter_mut() {
            if let Some(writer) = scheduled.endpoint.as_writer_mut()
                && writer.is_asserted_by_others()
            {
                writer.assert_liveliness(now);
                writer.note_shared(now);
                self.schedule.touch(place, &mut scheduled.mark);
            }
        }
    }

    /// A writer has come or gone that is MANUAL_BY_PARTICIPANT.
    pub(super) fn refresh_sharing(&mut self) {
        let leases: Vec<_> = self.sharing_writers().map(Writer::shared_lease).collect();
        let Some(shortest) = leases.iter().flatten().min() else {
            return;
        };
        let period = (*shortest / PER_LEASE).max(MIN_PERIOD);
        let by_writing = leases.len() > 1;
        for (_, scheduled) in self.endpoints.iter_mut() {
            if let Some(writer) = scheduled.endpoint.as_writer_mut()
                && writer.is_asserted_by_others()
            {
                writer.share_assertions(period, by_writing);
            }
        }
    }

    /// The readers of all of them are told, unless they have been.
    pub(super) fn note_shared(&mut self, at: Instant) -> bool {
        if self.shared.replace(at) == Some(at) {
            return false;
        }
        for (place, scheduled) in self.endpoints.iter_mut() {
            if let Some(writer) = scheduled.endpoint.as_writer_mut()
                && writer.is_asserted_by_others()
            {
                writer.note_shared(at);
                self.schedule.touch(place, &mut scheduled.mark);
            }
        }
        true
    }

    /// A writer whose lease ends may be alive because another is.
    pub(super) fn share_liveliness(&mut self, now: Instant, place: u32) {
        let due = self
            .endpoints
            .at_mut(place)
            .and_then(|due| due.endpoint.as_writer());
        if !due.is_some_and(|writer| writer.depends_on_others(now)) {
            return;
        }
        let newest = self
            .sharing_writers()
            .filter_map(Writer::asserted_for_all)
            .max();
        let due = self
            .endpoints
            .at_mut(place)
            .and_then(|due| due.endpoint.as_writer_mut());
        if let (Some(writer), Some(newest)) = (due, newest) {
            writer.handle_assertion(newest);
        }
    }

    fn sharing_writers(&mut self) -> impl Iterator<Item = &Writer> {
        let endpoints = self.endpoints.iter_mut();
        let writers = endpoints.filter_map(|(_, scheduled)| scheduled.endpoint.as_writer());
        writers.filter(|writer| writer.is_asserted_by_others())
    }
}
