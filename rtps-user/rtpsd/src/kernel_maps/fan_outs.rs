//! The maps behind the fan-out: whose socket may use it, and each app's lists of destinations with the ways there.

use std::collections::BTreeMap;
use std::net::{IpAddr, Ipv4Addr, SocketAddrV4};

use anyhow::{Context, Result, bail};
use aya::maps::{HashMap, MapData};
use rtps_ebpf::SlotSet;
use rtps_ebpf::abi::{Destination, FAN_OUT_DESTINATIONS, FanOut, FanOutKey, Sender, name};
use rtps_net::{Interface, source_towards};
use rtps_user::layer::protocol;
use tracing::warn;

use super::{ignore_missing, open};
use crate::pins::PinFolder;

/// A list of an app that the kernel serves in another way than before.
#[derive(Debug)]
pub(crate) struct Rerouted {
    pub(crate) slot: u8,
    pub(crate) number: u8,
    /// The destinations that it serves now.
    pub(crate) destinations: Vec<SocketAddrV4>,
}

/// See the module.
pub(crate) struct FanOuts {
    senders: HashMap<MapData, u64, Sender>,
    lists: HashMap<MapData, FanOutKey, FanOut>,
    /// The destinations that apps want, whether there is a way to them now or not.
    wanted: BTreeMap<FanOutKey, Vec<SocketAddrV4>>,
    is_attached: bool,
}

impl FanOuts {
    /// Opens the pinned maps, and goes on with the lists that are there.
    pub(super) fn open(folder: &PinFolder) -> Result<Self> {
        let senders = open(folder, name::SENDERS)?;
        let lists: HashMap<_, FanOutKey, FanOut> = open(folder, name::FAN_OUTS)?;
        let wanted = lists
            .iter()
            .map(|entry| entry.map(|(key, list)| (key, destinations(&list))))
            .collect::<Result<_, _>>()
            .context("map `fan_outs`")?;
        Ok(Self {
            senders,
            lists,
            wanted,
            is_attached: false,
        })
    }

    /// The program is in place.
    pub(crate) fn attached(&mut self) {
        self.is_attached = true;
    }

    /// Keeps a list of an app, and says to which of its destinations the kernel sends from now on.
    pub(crate) fn keep(
        &mut self,
        (slot, domain_index): (u8, u32),
        list: &protocol::FanOut,
        interfaces: &[Interface],
    ) -> Result<Vec<SocketAddrV4>> {
        if !self.is_attached {
            return Ok(Vec::new());
        }
        self.admit(slot, domain_index, list.cookie)?;
        let key = FanOutKey {
            slot: slot.into(),
            number: list.number.into(),
        };
        let served = self.route(key, &list.destinations, interfaces)?;
        self.wanted.insert(key, list.destinations.clone());
        Ok(served)
    }

    /// The app is gone.
    pub(crate) fn forget(&mut self, slot: u8) -> Result<()> {
        let slot = u32::from(slot);
        let lists: Vec<FanOutKey> = self.wanted.keys().copied().collect();
        for key in lists.into_iter().filter(|key| key.slot == slot) {
            self.wanted.remove(&key);
            ignore_missing(self.lists.remove(&key)).context("map `fan_outs`")?;
        }
        self.dismiss(slot, None)
    }

    /// Forgets all apps but these.
    pub(crate) fn forget_others(&mut self, slots: &SlotSet) -> Result<()> {
        let of_lists = self.wanted.keys().map(|key| key.slot);
        let senders: Vec<Sender> = self.values_of_senders()?;
        let of_senders = senders.iter().map(|sender| sender.slot);
        let all: SlotSet = of_lists
            .chain(of_senders)
            .filter_map(|slot| u8::try_from(slot).ok())
            .collect();
        all.iter()
            .filter(|slot| !slots.contains(*slot))
            .try_for_each(|slot| self.forget(slot))
    }

    /// The interfaces have changed: finds the ways anew, and says what is served in another way.
    pub(crate) fn refresh(&mut self, interfaces: &[Interface]) -> Vec<Rerouted> {
        let mut rerouted = Vec::new();
        for (key, wanted) in self.wanted.clone() {
            let before = self.lists.get(&key, 0).ok();
            let before = before.map(|list| destinations(&list)).unwrap_or_default();
            let now = self
                .route(key, &wanted, interfaces)
                .unwrap_or_else(|error| {
                    warn!("{error:#}");
                    Vec::new()
                });
            if now != before {
                rerouted.push(Rerouted {
                    slot: key.slot as u8,
                    number: key.number as u8,
                    destinations: now,
                });
            }
        }
        rerouted
    }

    /// One socket for each app; nobody gets one that is another's already.
    fn admit(&mut self, slot: u8, domain_index: u32, cookie: u64) -> Result<()> {
        let sender = Sender {
            slot: slot.into(),
            domain_index,
        };
        match self.senders.get(&cookie, 0) {
            Ok(known) if known == sender => return Ok(()),
            Ok(known) => bail!("the socket is of the app in slot {}", known.slot),
            Err(_) => {}
        }
        self.dismiss(sender.slot, Some(cookie))?;
        self.senders
            .insert(cookie, sender, 0)
            .context("map `senders`")
    }

    /// Forgets the sockets of an app but this one.
    fn dismiss(&mut self, slot: u32, but: Option<u64>) -> Result<()> {
        let entries = self.senders.iter().collect::<Result<Vec<_>, _>>();
        for (cookie, sender) in entries.context("map `senders`")? {
            if sender.slot == slot && but != Some(cookie) {
                ignore_missing(self.senders.remove(&cookie)).context("map `senders`")?;
            }
        }
        Ok(())
    }

    fn values_of_senders(&self) -> Result<Vec<Sender>> {
        let values = self.senders.iter().map(|entry| Ok(entry?.1));
        values.collect::<Result<_>>().context("map `senders`")
    }

    /// Writes the list as far as there are ways to its destinations now.
    fn route(
        &mut self,
        key: FanOutKey,
        wanted: &[SocketAddrV4],
        interfaces: &[Interface],
    ) -> Result<Vec<SocketAddrV4>> {
        let ways = wanted.iter().filter_map(|to| way(*to, interfaces));
        let ways: Vec<Destination> = ways.take(FAN_OUT_DESTINATIONS).collect();
        let mut list = FanOut {
            count: ways.len() as u32,
            reserved: 0,
            destinations: [Destination::default(); FAN_OUT_DESTINATIONS],
        };
        for (to, way) in list.destinations.iter_mut().zip(&ways) {
            *to = *way;
        }
        let written = if ways.is_empty() {
            ignore_missing(self.lists.remove(&key))
        } else {
            self.lists.insert(key, list, 0)
        };
        written.context("map `fan_outs`")?;
        Ok(destinations(&list))
    }
}

/// How to get there; `None` for this host's own addresses, and where no interface of the layer leads.
fn way(to: SocketAddrV4, interfaces: &[Interface]) -> Option<Destination> {
    let IpAddr::V4(source) = source_towards(to.into())? else {
        return None;
    };
    if to.ip().is_loopback() || *to.ip() == source {
        return None;
    }
    let mut interfaces = interfaces.iter();
    let interface = interfaces.find(|known| known.addresses.contains(&source.into()))?;
    Some(Destination {
        source: source.octets(),
        address: to.ip().octets(),
        port: to.port().into(),
        ifindex: interface.index,
    })
}

fn destinations(list: &FanOut) -> Vec<SocketAddrV4> {
    let count = list.count as usize;
    let destinations = list.destinations.iter().take(count);
    destinations
        .map(|to| SocketAddrV4::new(Ipv4Addr::from(to.address), to.port as u16))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_no_way_out_to_this_host_itself() {
        let loopback = Interface {
            name: "lo".into(),
            index: 1,
            mtu: 65_536,
            addresses: vec![Ipv4Addr::LOCALHOST.into()],
            is_loopback: true,
        };
        for own in ["127.0.0.1:7411", "127.0.0.2:7411"] {
            assert_eq!(
                way(own.parse().unwrap(), std::slice::from_ref(&loopback)),
                None
            );
        }
    }
}
