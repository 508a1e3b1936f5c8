//! The maps that rtpsd shares with the programs, by their pins; who writes which stands in `docs/abi.md`.

mod discovery;
mod fan_outs;
mod peers;
mod ports;

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::os::fd::AsFd;
use std::time::Duration;

use anyhow::{Context, Result};
use aya::Pod;
use aya::maps::{Array, ArrayOfMaps, HashMap, Map, MapData, MapError, PerCpuHashMap, PerCpuValues};
use aya::util::nr_cpus;
pub(crate) use discovery::{BuiltinSample, DiscoveryMaps};
pub(crate) use fan_outs::FanOuts;
use nix::time::{ClockId, clock_gettime};
pub(crate) use peers::Peers;
use ports::Ports;
use rtps_ebpf::abi::{self, App, Config, Domain, PortConfig, name};
use rtps_ebpf::{ABI_VERSION, Counter, SlotSet};
use rtps_net::{Interface, LOOPBACK_INDEX};
use rtps_user::wire::{EntityId, Guid};

use crate::pins::PinFolder;
use crate::sys;

/// Counters of one interface on one CPU.
type Counts = [u64; Counter::COUNT];

/// Handles to every map of the low-level layer.
pub(crate) struct KernelMaps {
    config: Array<MapData, Config>,
    domains: Array<MapData, Domain>,
    ports: Ports,
    addresses: HashMap<MapData, [u8; 16], u32>,
    routes: HashMap<MapData, [u8; 16], SlotSet>,
    apps: Array<MapData, App>,
    rings: ArrayOfMaps<MapData, MapData>,
    pub(crate) peers: Peers,
    pub(crate) discovery: DiscoveryMaps,
    pub(crate) fan_outs: FanOuts,
    counters: PerCpuHashMap<MapData, u32, Counts>,
}

impl KernelMaps {
    /// Opens the pinned maps.
    pub(crate) fn open(folder: &PinFolder) -> Result<Self> {
        Ok(Self {
            config: open(folder, name::CONFIG)?,
            domains: open(folder, name::DOMAINS)?,
            ports: Ports::open(folder)?,
            addresses: open(folder, name::ADDRESSES)?,
            routes: open(folder, name::ROUTES)?,
            apps: open(folder, name::APPS)?,
            rings: open(folder, name::RINGS)?,
            peers: Peers::open(folder)?,
            discovery: DiscoveryMaps::open(folder)?,
            fan_outs: FanOuts::open(folder)?,
            counters: open(folder, name::COUNTERS)?,
        })
    }

    /// Lets the programs act; to be called when everything else is in place, and then now and then as a sign of life.
    pub(crate) fn configure(&mut self, config: Config) -> Result<()> {
        self.config.set(0, config, 0).context("map `config`")
    }

    /// What the programs act by; `None` while they leave every packet alone.
    pub(crate) fn config(&self) -> Option<Config> {
        let config = self.config.get(&0, 0).ok()?;
        (config.abi_version == ABI_VERSION).then_some(config)
    }

    /// Says which participant the host is in a domain.
    pub(crate) fn set_domain(&mut self, index: u32, domain: Domain) -> Result<()> {
        self.domains.set(index, domain, 0).context("map `domains`")
    }

    /// Replaces the table of ports that the layer owns.
    pub(crate) fn set_ports(&mut self, ports: &BTreeMap<u16, PortConfig>) -> Result<()> {
        self.ports.replace(ports)
    }

    /// Replaces the table of this host's addresses.
    pub(crate) fn set_addresses(&mut self, addresses: &BTreeSet<[u8; 16]>) -> Result<()> {
        let entries = addresses.iter().take(abi::ADDRESSES as usize);
        replace(&mut self.addresses, entries.map(|address| (*address, 1)))
            .context("map `addresses`")
    }

    /// Has these interfaces and the loopback one counted on their own; others share entry 0. Counts already there
    /// stay.
    pub(crate) fn count_interfaces(&mut self, interfaces: &[Interface]) -> Result<()> {
        const OTHER: u32 = 0;
        let indices: BTreeSet<u32> = interfaces
            .iter()
            .map(|interface| interface.index)
            .chain([OTHER, LOOPBACK_INDEX])
            .collect();
        let known: BTreeSet<u32> = self.counters.keys().collect::<Result<_, _>>()?;
        for gone in known.difference(&indices) {
            ignore_missing(self.counters.remove(gone))?;
        }
        let cpus = nr_cpus().map_err(|(_, error)| error)?;
        for index in indices.difference(&known) {
            let zeros = PerCpuValues::try_from(vec![[0; Counter::COUNT]; cpus])?;
            self.counters
                .insert(index, zeros, 0)
                .context("map `counters`")?;
        }
        Ok(())
    }

    /// Counters by interface index, summed over the CPUs.
    pub(crate) fn counters(&self) -> Result<BTreeMap<u32, Counts>> {
        let mut sums = BTreeMap::new();
        for entry in self.counters.iter() {
            let (index, per_cpu) = entry.context("map `counters`")?;
            let mut sum = [0u64; Counter::COUNT];
            for counts in per_cpu.iter() {
                for (total, count) in sum.iter_mut().zip(counts) {
                    *total = total.wrapping_add(*count);
                }
            }
            sums.insert(index, sum);
        }
        Ok(sums)
    }

    /// Sends undirected messages of `writer` to these slots; to none: forgets the writer.
    pub(crate) fn set_route(&mut self, writer: Guid, slots: SlotSet) -> Result<()> {
        let key = writer.to_bytes();
        if slots.is_empty() {
            ignore_missing(self.routes.remove(&key)).context("map `routes`")
        } else {
            self.routes.insert(key, slots, 0).context("map `routes`")
        }
    }

    /// Forgets the writers that are not among these.
    pub(crate) fn forget_other_routes(&mut self, writers: &BTreeSet<Guid>) -> Result<()> {
        let known: Vec<[u8; 16]> = self.routes.keys().collect::<Result<_, _>>()?;
        for old in known {
            if !writers.contains(&Guid::from_bytes(old)) {
                ignore_missing(self.routes.remove(&old)).context("map `routes`")?;
            }
        }
        Ok(())
    }

    /// Has the kernel deliver to an app, whose ring and bell are in place, or notes its changed doorbell.
    pub(crate) fn set_app(&mut self, slot: u8, app: App) -> Result<()> {
        self.apps.set(slot.into(), app, 0).context("map `apps`")
    }

    /// Stops delivery to a slot.
    pub(crate) fn remove_app(&mut self, slot: u8) -> Result<()> {
        self.set_app(slot, App::default())
    }

    /// The slots that the kernel delivers to.
    pub(crate) fn attached_apps(&self) -> Result<BTreeMap<u8, App>> {
        let mut attached = BTreeMap::new();
        for slot in 1..=u8::MAX {
            let app = self.apps.get(&slot.into(), 0).context("map `apps`")?;
            if app.state == abi::APP_ATTACHED {
                attached.insert(slot, app);
            }
        }
        Ok(attached)
    }

    /// The size of a slot's ring and how much of it waits to be read, in bytes.
    pub(crate) fn ring_usage(&self, slot: u8) -> Option<(u32, u64)> {
        let ring = self.rings.get(&slot.into(), 0).ok()?;
        let size = ring.info().ok()?.max_entries();
        Some((size, sys::ring_fill(ring.fd().as_fd()).ok()?))
    }
}

fn pinned(folder: &PinFolder, name: &str) -> Result<Map> {
    let path = folder.entry(name);
    MapData::from_pin(&path)
        .and_then(Map::from_map_data)
        .with_context(|| format!("cannot open the pinned map {}", path.display()))
}

/// Opens a pinned map as what it is used as.
pub(crate) fn open<T>(folder: &PinFolder, name: &str) -> Result<T>
where
    T: TryFrom<Map, Error = MapError>,
{
    T::try_from(pinned(folder, name)?).with_context(|| format!("map `{name}`"))
}

/// Makes a map that the object does not define.
pub(crate) fn create(
    kind: u32,
    key_size: u32,
    value_size: u32,
    max_entries: u32,
    flags: u32,
    name: &str,
) -> Result<MapData, MapError> {
    let map = aya_obj::Map::new_from_params(kind, key_size, value_size, max_entries, flags);
    MapData::create(map, name, None)
}

/// Makes the map's content equal to `entries`, touching nothing that already is.
fn replace<K: Pod + Ord, V: Pod + PartialEq>(
    map: &mut HashMap<MapData, K, V>,
    entries: impl Iterator<Item = (K, V)>,
) -> Result<()> {
    let wanted: Vec<(K, V)> = entries.collect();
    let known: BTreeSet<K> = map.keys().collect::<Result<_, _>>()?;
    let keep: BTreeSet<K> = wanted.iter().map(|(key, _)| *key).collect();
    for gone in known.difference(&keep) {
        ignore_missing(map.remove(gone))?;
    }
    for (key, value) in wanted {
        if map.get(&key, 0).ok() != Some(value) {
            map.insert(key, value, 0)?;
        }
    }
    Ok(())
}

/// Removing what is not there is no error.
pub(crate) fn ignore_missing(result: Result<(), MapError>) -> Result<(), MapError> {
    match result {
        Err(MapError::KeyNotFound) => Ok(()),
        Err(MapError::SyscallError(error)) if error.io_error.kind() == io::ErrorKind::NotFound => {
            Ok(())
        }
        other => other,
    }
}

/// The number of a reliable built-in writer in the maps.
pub(crate) fn builtin_writer(writer: EntityId) -> Option<u32> {
    match writer {
        EntityId::SEDP_PUBLICATIONS_WRITER => Some(abi::PUBLICATIONS),
        EntityId::SEDP_SUBSCRIPTIONS_WRITER => Some(abi::SUBSCRIPTIONS),
        EntityId::PARTICIPANT_MESSAGE_WRITER => Some(abi::PARTICIPANT_MESSAGES),
        _ => None,
    }
}

/// The built-in reader of the same topic as the built-in writer with this number.
pub(crate) fn builtin_reader(writer: u32) -> Option<EntityId> {
    match writer {
        abi::PUBLICATIONS => Some(EntityId::SEDP_PUBLICATIONS_READER),
        abi::SUBSCRIPTIONS => Some(EntityId::SEDP_SUBSCRIPTIONS_READER),
        abi::PARTICIPANT_MESSAGES => Some(EntityId::PARTICIPANT_MESSAGE_READER),
        _ => None,
    }
}

/// CLOCK_MONOTONIC, which the programs' time stamps are of.
pub(crate) fn monotonic_now() -> Duration {
    clock_gettime(ClockId::CLOCK_MONOTONIC).map_or(Duration::ZERO, Duration::from)
}

/// As the maps keep times.
pub(crate) fn nanoseconds(duration: Duration) -> u64 {
    u64::try_from(duration.as_nanos()).unwrap_or(u64::MAX)
}
