//! Which apps of the host are connected by shared memory.
//!
//! Two apps get a channel with their first match and keep it until one of them is gone. After a restart of the layer
//! nobody knows whether a pair of apps had got its channel before: it gets a new one as soon as both are back, and uses
//! the old one until then.

use std::collections::BTreeMap;

use super::protocol::FromLayer;
use super::{Layer, LayerOutput};
use crate::wire::EntityId;
use crate::{RemoteEndpoint, local};

/// Channels of one app: each takes descriptors and mappings in it.
const MAX_CHANNELS: usize = 64;

/// The lower slot first.
type Pair = [u8; 2];

/// All pairs of apps that have been matched.
#[derive(Debug, Default)]
pub(super) struct Channels(BTreeMap<Pair, State>);

#[derive(Clone, Copy, Debug, Eq, PartialEq)]
enum State {
    /// To be made as soon as both apps are attached.
    Wanted,
    Open,
    /// It cannot be made: the two reach each other over the loopback interface.
    Refused,
}

fn pair(a: u8, b: u8) -> Pair {
    [a.min(b), a.max(b)]
}

impl Channels {
    fn count(&self, slot: u8) -> usize {
        let of_slot =
            |(pair, state): &(&Pair, &State)| pair.contains(&slot) && **state != State::Refused;
        self.0.iter().filter(of_slot).count()
    }

    /// Whether the pair has a channel or gets one.
    fn connect(&mut self, pair: Pair) -> bool {
        if !self.0.contains_key(&pair) {
            let is_room = pair.iter().all(|slot| self.count(*slot) < MAX_CHANNELS);
            let state = if is_room {
                State::Wanted
            } else {
                State::Refused
            };
            self.0.insert(pair, state);
        }
        self.0.get(&pair) != Some(&State::Refused)
    }

    /// Takes all channels of an app out; those that it had them with.
    fn remove(&mut self, slot: u8) -> Vec<u8> {
        let mut others = Vec::new();
        self.0.retain(|pair, state| {
            let [a, b] = *pair;
            let is_gone = pair.contains(&slot);
            if is_gone && *state != State::Refused {
                others.push(if a == slot { b } else { a });
            }
            !is_gone
        });
        others
    }
}

impl Layer {
    /// Says where the app in `slot` reaches an endpoint of this host, and where the endpoint's datagrams come from: an
    /// app that shares memory with others must not be told anything in the name of a third by one of them.
    pub(super) fn locate(&mut self, slot: u8, endpoint: &mut RemoteEndpoint) {
        if !self.config.channels {
            return;
        }
        let other = endpoint.guid.entity.slot();
        let mut source = self.config.loopback;
        if other != slot && self.channels.connect(pair(slot, other)) {
            self.open_channel(pair(slot, other));
            source = local::address(other);
            endpoint.unicast = vec![source];
        }
        endpoint.addresses = vec![source.ip()];
    }

    fn open_channel(&mut self, pair: Pair) {
        let is_attached = pair.iter().all(|slot| self.apps.is_attached(*slot));
        if let Some(state) = self.channels.0.get_mut(&pair)
            && *state == State::Wanted
            && is_attached
        {
            *state = State::Open;
            self.outputs.push_back(LayerOutput::Channel(pair));
        }
    }

    /// An app is back after a restart of the layer.
    pub(super) fn open_channels(&mut self, slot: u8) {
        let pairs = self.channels.0.keys().filter(|pair| pair.contains(&slot));
        for pair in pairs.copied().collect::<Vec<_>>() {
            self.open_channel(pair);
        }
    }

    /// An app is gone.
    pub(super) fn close_channels(&mut self, slot: u8) {
        for other in self.channels.remove(slot) {
            self.reply(other, FromLayer::ChannelClosed { slot });
        }
    }

    /// The channel that was asked for by [`LayerOutput::Channel`] could not be made: the two apps are told to go without.
    pub fn refuse_channel(&mut self, slots: [u8; 2]) {
        let [a, b] = slots;
        let refused = pair(a, b);
        self.channels.0.insert(refused, State::Refused);
        let is_between =
            |local: EntityId, other: EntityId| pair(local.slot(), other.slot()) == refused;
        let pairs = self.matchmaker.pairs_of_participant(self.config.prefix);
        let concerned: Vec<_> = pairs
            .filter(|(other, local)| is_between(*local, other.entity))
            .collect();
        for (other, local) in concerned {
            if let Some(message) = self.match_of(local, other) {
                self.reply(local.slot(), message);
            }
        }
    }
}
