//! What the app does not want to know of (`ignore_*`, DDS 1.4 sections 2.2.2.2.1.15 to 2.2.2.2.1.18).
//!
//! The layer goes on matching for all apps of the host; here its matches are not heeded. So an ignore holds for this app
//! alone, and the other side learns nothing of it.

use std::collections::BTreeSet;
use std::time::Instant;

use rtps_user::RemoteEndpoint;
use rtps_user::discovery::ParticipantData;
use rtps_user::wire::{EntityId, Guid, GuidPrefix};

use super::core::Core;

/// See the module.
#[derive(Debug, Default)]
pub(super) struct Ignored {
    participants: BTreeSet<GuidPrefix>,
    endpoints: BTreeSet<Guid>,
    topics: BTreeSet<String>,
}

/// What is to be ignored from now on.
#[derive(Debug)]
pub(crate) enum Ignore {
    /// With all its endpoints; of the own participant those of this app.
    Participant(GuidPrefix),
    /// A writer or reader.
    Endpoint(Guid),
    /// Whatever its type.
    Topic(String),
}

impl Ignored {
    fn insert(&mut self, ignore: Ignore) {
        match ignore {
            Ignore::Participant(prefix) => _ = self.participants.insert(prefix),
            Ignore::Endpoint(guid) => _ = self.endpoints.insert(guid),
            Ignore::Topic(name) => _ = self.topics.insert(name),
        }
    }
}

impl Core {
    /// Ignores something for good: matches with it end.
    pub(crate) fn ignore(&mut self, now: Instant, ignore: Ignore) {
        self.ignored.insert(ignore);
        let entities = self.entities.iter();
        let matches = entities.flat_map(|(id, entity)| entity.matched().map(|other| (*id, other)));
        let ended: Vec<_> = matches
            .filter(|(local, remote)| self.is_match_ignored(*local, *remote))
            .collect();
        for (local, remote) in ended {
            self.end_match(now, local, remote);
        }
        if let Some(browser) = &mut self.browser {
            browser.touch();
        }
        self.seat.news = true;
        self.audience.wake();
    }

    /// Whether a local endpoint is to know nothing of another one.
    pub(super) fn is_match_ignored(&self, local: EntityId, remote: Guid) -> bool {
        let own = Guid::new(self.endpoints.prefix(), local);
        // Of two endpoints of the app neither may be ignored.
        self.is_ignored(remote)
            || (self.is_own(remote) && self.is_ignored(own))
            || self
                .entity(local)
                .is_some_and(|entity| self.ignored.topics.contains(entity.topic()))
    }

    fn is_ignored(&self, guid: Guid) -> bool {
        // Other apps of the host are of the same participant on the wire, but not of the one that is meant.
        let is_of_other_app = guid.prefix == self.endpoints.prefix() && !self.is_own(guid);
        let is_of_ignored = self.ignored.participants.contains(&guid.prefix) && !is_of_other_app;
        is_of_ignored || self.ignored.endpoints.contains(&guid)
    }

    /// The remote participants, if the app has asked for them, that are not ignored; with the change that was theirs last.
    pub(crate) fn known_participants(&self) -> impl Iterator<Item = (u64, &ParticipantData)> {
        let known = self.browser().into_iter();
        let known = known.flat_map(|browser| browser.participants());
        known.filter(|(_, known)| !self.ignored.participants.contains(&known.prefix))
    }

    /// The endpoints of others, if the app has asked for them, that are not ignored; with the change that was theirs last.
    pub(crate) fn known_endpoints(&self) -> impl Iterator<Item = (u64, &RemoteEndpoint)> {
        let known = self.browser().into_iter();
        let known = known.flat_map(|browser| browser.endpoints());
        known.filter(|(_, known)| {
            !self.is_ignored(known.guid) && !self.ignored.topics.contains(&known.topic)
        })
    }
}
