//! The ports that the layer owns.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Context as _, Result};
use aya::maps::{Array, MapData, MapError};
use rtps_ebpf::abi::{PORT_FOREIGN, PortConfig, name};

use super::open;
use crate::pins::PinFolder;

/// The table of all ports.
pub(super) struct Ports {
    map: Array<MapData, PortConfig>,
    /// Those of the layer; `None` until they are asked for: an earlier rtpsd may have left some.
    owned: Option<BTreeSet<u16>>,
}

impl Ports {
    pub(super) fn open(folder: &PinFolder) -> Result<Self> {
        let map = open(folder, name::PORTS)?;
        Ok(Self { map, owned: None })
    }

    /// The layer owns these ports from now on, and no others.
    pub(super) fn replace(&mut self, ports: &BTreeMap<u16, PortConfig>) -> Result<()> {
        self.write(ports).context("map `ports`")
    }

    fn write(&mut self, ports: &BTreeMap<u16, PortConfig>) -> Result<(), MapError> {
        let before = match self.owned.take() {
            Some(owned) => owned,
            None => self.read()?,
        };
        for gone in before.iter().filter(|port| !ports.contains_key(port)) {
            self.map.set((*gone).into(), PortConfig::default(), 0)?;
        }
        for (port, config) in ports {
            self.map.set((*port).into(), *config, 0)?;
        }
        self.owned = Some(ports.keys().copied().collect());
        Ok(())
    }

    fn read(&self) -> Result<BTreeSet<u16>, MapError> {
        let mut owned = BTreeSet::new();
        for port in 0..=u16::MAX {
            if self.map.get(&port.into(), 0)?.kind != PORT_FOREIGN {
                owned.insert(port);
            }
        }
        Ok(owned)
    }
}
