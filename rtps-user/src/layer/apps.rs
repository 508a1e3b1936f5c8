//! The apps that use the layer, by slot.

use std::collections::BTreeMap;
use std::time::Instant;

use rtps_ebpf::SlotSet;

use super::protocol::{Endpoint, FromLayer, Resume};
use crate::wire::{EntityId, SequenceNumber};

/// An app.
#[derive(Debug)]
pub(super) struct App {
    /// What it calls itself.
    pub(super) name: String,
    /// Proves after a restart of the layer that the slot is its own.
    pub(super) token: [u8; 16],
    /// What it is to be told when it comes back after a restart of the layer; `None` while it is attached.
    pub(super) backlog: Option<Vec<FromLayer>>,
    /// Until when endpoints that were declared before a restart of the layer must be declared again.
    pub(super) grace: Option<Instant>,
    /// Whether it wants to know of all participants and endpoints.
    pub(super) browses: bool,
    /// Its endpoints.
    pub(super) endpoints: BTreeMap<EntityId, Declared>,
}

/// An endpoint of an app.
#[derive(Debug)]
pub(super) struct Declared {
    /// What the app said of it.
    pub(super) endpoint: Endpoint,
    /// The number of the sample that announces it.
    pub(super) sequence: Option<SequenceNumber>,
    /// False between a restart of the layer and its being declared again.
    pub(super) is_confirmed: bool,
}

impl App {
    /// An app without endpoints, attached.
    pub(super) fn new(name: String, token: [u8; 16]) -> Self {
        Self {
            name,
            token,
            backlog: None,
            grace: None,
            browses: false,
            endpoints: BTreeMap::new(),
        }
    }
}

/// All apps.
#[derive(Debug, Default)]
pub(super) struct Apps {
    by_slot: BTreeMap<u8, App>,
    /// The slot that was given last: the next app gets one after it, so that a slot, and with it GUIDs, rest as
    /// long as possible before they are used again.
    last: u8,
}

impl Apps {
    /// Adds an app in a free slot that is not among those `taken` elsewhere; `None` where there is none.
    pub(super) fn add(&mut self, app: App, taken: &SlotSet) -> Option<u8> {
        let is_free = |slot: &u8| !self.by_slot.contains_key(slot) && !taken.contains(*slot);
        let after_last = (self.last..=u8::MAX).skip(1);
        let slot = after_last.chain(1..=self.last).find(is_free)?;
        self.insert(slot, app);
        Some(slot)
    }

    /// Puts an app into its slot.
    pub(super) fn insert(&mut self, slot: u8, app: App) {
        self.last = slot;
        self.by_slot.insert(slot, app);
    }

    /// An app.
    pub(super) fn get_mut(&mut self, slot: u8) -> Option<&mut App> {
        self.by_slot.get_mut(&slot)
    }

    /// Whether there is an app in this slot, and it can be told something.
    pub(super) fn is_attached(&self, slot: u8) -> bool {
        let app = self.by_slot.get(&slot);
        app.is_some_and(|app| app.backlog.is_none())
    }

    /// The app that was in this slot before a restart of the layer and has not come back yet.
    pub(super) fn returning(&mut self, resume: Resume) -> Option<&mut App> {
        self.by_slot
            .get_mut(&resume.slot)
            .filter(|app| app.backlog.is_some() && app.token == resume.token)
    }

    /// All apps with their slots.
    pub(super) fn iter(&self) -> impl Iterator<Item = (u8, &App)> {
        self.by_slot.iter().map(|(slot, app)| (*slot, app))
    }

    /// Takes an app out.
    pub(super) fn remove(&mut self, slot: u8) -> Option<App> {
        self.by_slot.remove(&slot)
    }

    /// An endpoint of an app.
    pub(super) fn endpoint_mut(&mut self, entity: EntityId) -> Option<&mut Declared> {
        self.by_slot
            .get_mut(&entity.slot())?
            .endpoints
            .get_mut(&entity)
    }

    /// Of what apps are to be told when they come back only the matches matter: of the rest they were told before.
    pub(super) fn forget_old_news(&mut self) {
        for backlog in self.by_slot.values_mut().flat_map(|app| &mut app.backlog) {
            backlog.retain(|message| matches!(message, FromLayer::Matched { .. }));
        }
    }

    /// The endpoints of all apps.
    pub(super) fn endpoints(&self) -> impl Iterator<Item = &Endpoint> {
        self.by_slot
            .values()
            .flat_map(|app| app.endpoints.values())
            .map(|declared| &declared.endpoint)
    }

    /// When the next grace period ends.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.by_slot.values().filter_map(|app| app.grace).min()
    }

    /// An app whose grace period has ended; that is then over.
    pub(super) fn end_grace(&mut self, now: Instant) -> Option<(u8, &App)> {
        let due = |app: &App| app.grace.is_some_and(|end| end <= now);
        let (slot, app) = self.by_slot.iter_mut().find(|(_, app)| due(app))?;
        app.grace = None;
        Some((*slot, app))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn app() -> App {
        App::new(String::new(), [0; 16])
    }

    #[test]
    fn slots_rest_before_they_are_used_again() {
        let mut apps = Apps::default();
        let mut add = |freed| {
            let slot = apps.add(app(), &SlotSet::EMPTY);
            apps.remove(freed);
            slot
        };
        assert_eq!(add(0), Some(1));
        assert_eq!(add(1), Some(2));
        for slot in 3..=255 {
            assert_eq!(add(255), Some(slot));
        }
        assert_eq!(add(0), Some(1));
        assert_eq!(add(0), Some(255));
        assert_eq!(add(0), None);
    }

    #[test]
    fn slots_that_are_taken_elsewhere_are_left_out() {
        let mut apps = Apps::default();
        let mut taken = SlotSet::EMPTY;
        taken.insert(1);
        taken.insert(3);
        assert_eq!(apps.add(app(), &taken), Some(2));
        assert_eq!(apps.add(app(), &taken), Some(4));
        (1..=255).for_each(|slot| taken.insert(slot));
        assert_eq!(apps.add(app(), &taken), None);
    }

    #[test]
    fn only_an_absent_app_with_the_token_returns() {
        let mut apps = Apps::default();
        apps.insert(7, App::new(String::new(), [7; 16]));
        let resume = |slot, token| Resume {
            slot,
            token: [token; 16],
        };
        assert!(apps.returning(resume(7, 7)).is_none(), "attached");
        apps.get_mut(7).unwrap().backlog = Some(Vec::new());
        assert!(apps.returning(resume(7, 8)).is_none());
        assert!(apps.returning(resume(8, 7)).is_none());
        assert!(apps.returning(resume(7, 7)).is_some());
    }
}
