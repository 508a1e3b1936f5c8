//! What is known of a domain, told to apps that ask for it (the built-in topics of DDS 1.4 section 2.2.5).
//!
//! Apps that do not ask cost nothing. Those that do are told page by page what is there, so that no app is sent more
//! than it reads, and beside that each change; what is told twice is the same.

use std::ops::Bound;

use super::Layer;
use super::events::without_large_data;
use super::protocol::{Discovered, FromLayer};
use crate::discovery::ParticipantData;
use crate::wire::{Guid, GuidPrefix};

/// Endpoints of a page.
const PAGE: usize = 256;

impl Layer {
    /// Tells an app of the endpoints after `after` and, to begin with, of the participants.
    pub(super) fn browse(&mut self, slot: u8, after: Option<Guid>) {
        let Some(app) = self.apps.get_mut(slot) else {
            return;
        };
        app.browses = true;
        let mut known = Vec::new();
        if after.is_none() {
            known.push(Discovered::Begin);
            let participants = self.discovery.participants();
            known.extend(participants.map(|known| participant(&known.data)));
        }
        let start = after.map_or(Bound::Unbounded, Bound::Excluded);
        let mut last = None;
        for endpoint in self.matchmaker.endpoints_from(start).take(PAGE) {
            last = Some(endpoint.guid);
            if !self.is_of(slot, endpoint.guid) {
                let endpoint = without_large_data(endpoint.clone());
                known.push(Discovered::Endpoint(Box::new(endpoint)));
            }
        }
        known.push(match last {
            Some(last) => Discovered::More(last),
            None => Discovered::Complete,
        });
        for discovered in known {
            self.reply(slot, FromLayer::Discovered(discovered));
        }
    }

    /// Tells of a new or changed participant.
    pub(super) fn show_participant(&mut self, prefix: GuidPrefix) {
        for slot in self.browsers() {
            if let Some(known) = self.discovery.participant(prefix) {
                let discovered = participant(&known.data);
                self.reply(slot, FromLayer::Discovered(discovered));
            }
        }
    }

    /// Tells of a new or changed endpoint all apps but its own.
    pub(super) fn show_endpoint(&mut self, guid: Guid) {
        for slot in self.browsers() {
            if self.is_of(slot, guid) {
                continue;
            }
            if let Some(endpoint) = self.matchmaker.endpoint(guid) {
                let endpoint = Box::new(without_large_data(endpoint.clone()));
                self.reply(slot, FromLayer::Discovered(Discovered::Endpoint(endpoint)));
            }
        }
    }

    /// Tells that a participant is gone.
    pub(super) fn hide_participant(&mut self, prefix: GuidPrefix) {
        for slot in self.browsers() {
            let gone = Discovered::ParticipantGone(prefix);
            self.reply(slot, FromLayer::Discovered(gone));
        }
    }

    /// Tells that an endpoint is gone all apps but its own.
    pub(super) fn hide_endpoint(&mut self, guid: Guid) {
        for slot in self.browsers() {
            if !self.is_of(slot, guid) {
                let gone = Discovered::EndpointGone(guid);
                self.reply(slot, FromLayer::Discovered(gone));
            }
        }
    }

    fn browsers(&self) -> Vec<u8> {
        let apps = self.apps.iter().filter(|(_, app)| app.browses);
        apps.map(|(slot, _)| slot).collect()
    }

    fn is_of(&self, slot: u8, guid: Guid) -> bool {
        guid.prefix == self.config.prefix && guid.entity.slot() == slot
    }
}

fn participant(data: &ParticipantData) -> Discovered {
    Discovered::Participant(Box::new(data.clone()))
}
