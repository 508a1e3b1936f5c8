//! What the layer tells an app of the domain that wants to know.

use std::collections::BTreeMap;

use rtps_user::RemoteEndpoint;
use rtps_user::discovery::ParticipantData;
use rtps_user::layer::protocol::Discovered;
use rtps_user::wire::{Guid, GuidPrefix};

/// The remote participants, and the endpoints of all but the app itself.
#[derive(Debug, Default)]
pub(crate) struct Browser {
    /// Each with the number of the change that it was.
    participants: BTreeMap<GuidPrefix, (u64, ParticipantData)>,
    endpoints: BTreeMap<Guid, (u64, RemoteEndpoint)>,
    is_complete: bool,
    changes: u64,
}

impl Browser {
    /// Takes news; gives the last endpoint that was told of where more are to be asked for.
    pub(super) fn take(&mut self, news: Discovered) -> Option<Guid> {
        let change = self.changes + 1;
        match news {
            Discovered::Begin => {
                let changes = self.changes;
                *self = Self {
                    changes,
                    ..Self::default()
                };
            }
            Discovered::Participant(data) => {
                self.participants.insert(data.prefix, (change, *data));
            }
            Discovered::ParticipantGone(prefix) => _ = self.participants.remove(&prefix),
            Discovered::Endpoint(endpoint) => {
                self.endpoints.insert(endpoint.guid, (change, *endpoint));
            }
            Discovered::EndpointGone(guid) => _ = self.endpoints.remove(&guid),
            Discovered::More(last) => return Some(last),
            Discovered::Complete => self.is_complete = true,
        }
        self.touch();
        None
    }

    /// It looks different from now on.
    pub(super) fn touch(&mut self) {
        self.changes += 1;
    }

    /// The remote participants, each with the change that was its last.
    pub(super) fn participants(&self) -> impl Iterator<Item = (u64, &ParticipantData)> {
        let known = self.participants.values();
        known.map(|(change, participant)| (*change, participant))
    }

    /// The endpoints of remote participants and of other apps, each with the change that was its last.
    pub(super) fn endpoints(&self) -> impl Iterator<Item = (u64, &RemoteEndpoint)> {
        let known = self.endpoints.values();
        known.map(|(change, endpoint)| (*change, endpoint))
    }

    /// Whether all has been told that was known when it was asked for.
    pub(crate) fn is_complete(&self) -> bool {
        self.is_complete
    }

    /// How often something has changed.
    pub(crate) fn changes(&self) -> u64 {
        self.changes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_new_beginning_voids_what_was_told() {
        let mut browser = Browser::default();
        let gone = |number| {
            Discovered::EndpointGone(Guid::new(GuidPrefix([number; 12]), Default::default()))
        };
        assert_eq!(browser.take(Discovered::Begin), None);
        assert_eq!(browser.take(Discovered::Complete), None);
        assert!(browser.is_complete());
        assert_eq!(browser.take(gone(1)), None);
        assert_eq!(browser.changes(), 3);
        assert_eq!(
            browser.take(Discovered::More(Guid::UNKNOWN)),
            Some(Guid::UNKNOWN)
        );
        browser.take(Discovered::Begin);
        assert!(!browser.is_complete());
        assert!(browser.changes() > 3, "whoever waits for a change sees one");
    }
}
