//! Lists of destinations that the low-level layer is to send to in an app's stead.
//!
//! The app asks for them, for it alone knows how its writers choose among the locators of their readers. It gets what
//! it may send to anyway: the unicast locators of what its endpoints are matched with.

use std::collections::BTreeSet;
use std::net::{SocketAddr, SocketAddrV4};

use rtps_ebpf::abi::{FAN_OUT_DESTINATIONS, FAN_OUTS_PER_APP};

use super::protocol::{FanOut, FromLayer};
use super::{KernelChange, Layer};
use crate::wire::{EntityId, Guid};

impl Layer {
    /// Has the kernel send to these destinations; those that are nobody's whom the app is matched with are left to the
    /// app, and so are all where there are too few to be worth it.
    pub(super) fn fan_out(&mut self, slot: u8, mut fan_out: FanOut) {
        if !(1..=FAN_OUTS_PER_APP).contains(&fan_out.number) {
            let reason = format!("fan-outs have the numbers 1 to {FAN_OUTS_PER_APP}");
            return self.refuse(slot, reason);
        }
        let matched = self.matched_destinations(slot);
        let destinations = &mut fan_out.destinations;
        destinations.retain(|destination| matched.contains(destination));
        destinations.truncate(FAN_OUT_DESTINATIONS);
        if destinations.len() < 2 {
            let (number, destinations) = (fan_out.number, Vec::new());
            return self.reply(
                slot,
                FromLayer::FanOut {
                    number,
                    destinations,
                },
            );
        }
        self.kernel(KernelChange::FanOut { slot, fan_out });
    }

    /// Where the endpoints on other hosts are that an app is matched with, over IPv4.
    fn matched_destinations(&mut self, slot: u8) -> BTreeSet<SocketAddrV4> {
        let endpoints: Vec<EntityId> = self
            .apps
            .get_mut(slot)
            .map(|app| app.endpoints.keys().copied().collect())
            .unwrap_or_default();
        let own = self.config.prefix;
        let endpoints = endpoints.into_iter();
        let matched: BTreeSet<Guid> = endpoints
            .flat_map(|local| self.matchmaker.matches_of(local))
            .filter(|remote| remote.prefix != own)
            .collect();
        matched
            .into_iter()
            .filter_map(|remote| self.matchmaker.endpoint(remote))
            .flat_map(|remote| &remote.unicast)
            .filter_map(|destination| match destination {
                SocketAddr::V4(destination) => Some(*destination),
                SocketAddr::V6(_) => None,
            })
            .collect()
    }
}
