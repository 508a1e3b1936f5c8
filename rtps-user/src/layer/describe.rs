//! What apps want others to see of the participant: USER_DATA (DDS 1.4 section 2.2.3.1), of which it has one.

use std::time::Instant;

use super::Layer;
use super::protocol::MAX_USER_DATA;

/// What each app wants to be seen, the newest last.
#[derive(Debug, Default)]
pub(super) struct Descriptions(Vec<(u8, Vec<u8>)>);

impl Descriptions {
    /// An app wants something else than before, or nothing.
    fn set(&mut self, slot: u8, user_data: Vec<u8>) {
        self.0.retain(|(other, _)| *other != slot);
        if !user_data.is_empty() {
            self.0.push((slot, user_data));
        }
    }

    /// What is to be seen.
    fn current(&self) -> &[u8] {
        self.0.last().map_or(&[], |(_, user_data)| user_data)
    }
}

impl Layer {
    /// Has others see the user data of an app, or of the one before it where this one has none.
    pub(super) fn describe(&mut self, now: Instant, slot: u8, user_data: Vec<u8>) {
        if user_data.len() > MAX_USER_DATA {
            let len = user_data.len();
            let reason =
                format!("USER_DATA of a participant may have {MAX_USER_DATA} bytes and not {len}");
            return self.refuse(slot, reason);
        }
        self.descriptions.set(slot, user_data);
        if self.config.user_data != self.descriptions.current() {
            self.config.user_data = self.descriptions.current().to_vec();
            self.announce_participant(now);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_of_those_who_say_something_is_seen() {
        let mut descriptions = Descriptions::default();
        assert_eq!(descriptions.current(), b"");
        descriptions.set(1, b"one".to_vec());
        descriptions.set(2, b"two".to_vec());
        descriptions.set(3, Vec::new());
        assert_eq!(descriptions.current(), b"two");
        descriptions.set(1, b"one again".to_vec());
        assert_eq!(descriptions.current(), b"one again");
        descriptions.set(1, Vec::new());
        assert_eq!(descriptions.current(), b"two");
        descriptions.set(2, Vec::new());
        assert_eq!(descriptions.current(), b"");
    }
}
