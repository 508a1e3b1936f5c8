//! One domain of the host: its [`Layer`], and the sockets, maps and store that the layer's outputs go to.

use std::collections::BTreeSet;
use std::fs;
use std::net::{Ipv4Addr, SocketAddr};
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use aya::programs::SocketFilter;
use rtps_ebpf::abi::{PORT_MULTICAST, PORT_UNICAST, PortConfig};
use rtps_user::layer::protocol::FromLayer;
use rtps_user::layer::{KernelChange, Layer, LayerConfig, LayerOutput};
use rtps_user::wire::{GuidPrefix, VendorId};
use tracing::{debug, info, warn};

use crate::cli::Options;
use crate::interfaces::{self, Interface};
use crate::kernel_maps::KernelMaps;
use crate::pins::PinFolder;
use crate::random;
use crate::sockets::{DomainSockets, GROUP, Ports};
use crate::store::{Identities, Identity, Store};

/// Datagrams of one socket that are read before others get their turn.
const BURST: usize = 64;

/// How old the kernel's knowledge of who is alive may be when a lease is judged.
const PEERS_FRESH: Duration = Duration::from_millis(100);

/// The longest time between two announcements.
const ANNOUNCE_PERIOD: Duration = Duration::from_secs(5);

/// The host's part in one domain.
pub(crate) struct DomainHost {
    pub(crate) id: u32,
    pub(crate) identity: Identity,
    pub(crate) layer: Layer,
    pub(crate) sockets: DomainSockets,
    ports: Ports,
    store: Store,
    peers: BTreeSet<GuidPrefix>,
    peers_read: Instant,
    datagram: Vec<u8>,
}

/// What a domain is started with.
pub(crate) struct Setting<'a> {
    pub(crate) options: &'a Options,
    pub(crate) folder: &'a PinFolder,
    pub(crate) interfaces: &'a [Interface],
    pub(crate) filter: &'a SocketFilter,
    pub(crate) now: Instant,
}

impl DomainHost {
    /// Joins a domain, as the participant that the host was before where there was one.
    pub(crate) fn start(
        id: u32,
        setting: &Setting<'_>,
        identities: &mut Identities,
    ) -> Result<Self> {
        let ports = Ports::of_domain(id).context("the domain's ports do not fit into 16 bits")?;
        let mut identity = identities.begin(id, new_prefix()?)?;
        let sockets = DomainSockets::open(
            ports,
            setting.interfaces,
            setting.filter,
            identity.participant_id,
        )?;
        identity.participant_id = Some(sockets.participant_id);
        identities.keep(id, identity)?;
        let store = Store::open(setting.folder, id)?;
        let config = layer_config(id, setting, identity, ports, sockets.participant_id);
        let mut layer = Layer::new(config, setting.now);
        let records = store.records();
        info!(
            domain = id,
            prefix = %identity.prefix,
            participant = sockets.participant_id,
            records = records.len(),
            "domain joined"
        );
        layer.restore(setting.now, records);
        Ok(Self {
            id,
            identity,
            layer,
            sockets,
            ports,
            store,
            peers: BTreeSet::new(),
            peers_read: setting.now,
            datagram: Vec::new(),
        })
    }

    /// The ports that the domain owns, as the kernel wants to know them.
    pub(crate) fn port_configs(&self) -> Vec<(u16, PortConfig)> {
        let domain_index = u16::try_from(self.identity.domain_index).unwrap_or(u16::MAX);
        let id = self.sockets.participant_id;
        [
            (self.ports.metatraffic_unicast(id), PORT_UNICAST),
            (self.ports.user_unicast(id), PORT_UNICAST),
            (self.ports.metatraffic_multicast(), PORT_MULTICAST),
            (self.ports.user_multicast(), PORT_MULTICAST),
        ]
        .map(|(port, kind)| (port, PortConfig { domain_index, kind }))
        .to_vec()
    }

    /// The interfaces' addresses may have changed.
    pub(crate) fn set_addresses(&mut self, now: Instant, interfaces: &[Interface]) {
        let id = self.sockets.participant_id;
        let metatraffic = locators(interfaces, self.ports.metatraffic_unicast(id));
        let user = locators(interfaces, self.ports.user_unicast(id));
        self.layer.set_addresses(now, metatraffic, user);
    }

    /// Reads what came to a socket, up to a burst.
    pub(crate) fn receive(
        &mut self,
        now: Instant,
        socket: usize,
        buffer: &mut [u8],
        effects: &mut Effects<'_>,
    ) {
        for _ in 0..BURST {
            let Some((length, source)) = self.sockets.receive(socket, buffer) else {
                return;
            };
            let datagram = buffer.get(..length).unwrap_or_default();
            if let Err(error) = self.layer.handle_datagram(now, source, datagram) {
                debug!(%source, "malformed: {error}");
            }
            self.drain(now, effects);
        }
    }

    /// When [`handle_timeout`](Self::handle_timeout) is due.
    pub(crate) fn next_timeout(&self) -> Option<Instant> {
        self.layer.poll_timeout()
    }

    /// Does what is due, knowing what the kernel knows of who is alive.
    pub(crate) fn handle_timeout(&mut self, now: Instant, effects: &mut Effects<'_>) {
        if now.duration_since(self.peers_read) >= PEERS_FRESH {
            self.read_peers(now, effects.kernel);
        }
        self.layer.handle_timeout(now);
        self.drain(now, effects);
    }

    fn read_peers(&mut self, now: Instant, kernel: &KernelMaps) {
        self.peers_read = now;
        for peer in &self.peers {
            let seen = kernel
                .peer_silence(*peer)
                .and_then(|silence| now.checked_sub(silence));
            if let Some(seen) = seen {
                self.layer.seen(seen, *peer);
            }
        }
    }

    /// Does everything that the layer wants done.
    pub(crate) fn drain(&mut self, now: Instant, effects: &mut Effects<'_>) {
        let mut datagram = std::mem::take(&mut self.datagram);
        while let Some(output) = self.layer.poll_output(now, &mut datagram) {
            match output {
                LayerOutput::Transmit(transmit) => {
                    for &destination in transmit.destinations.iter() {
                        self.sockets
                            .send(&datagram, destination, effects.interfaces);
                    }
                }
                LayerOutput::Reply { slot, message } => effects.replies.push((slot, message)),
                LayerOutput::Kernel(change) => {
                    if let Err(error) = self.change_kernel(change, effects.kernel) {
                        warn!("{error:#}");
                    }
                }
                LayerOutput::Store(change) => {
                    if let Err(error) = self.store.apply(&change) {
                        warn!("a restart may be noticed: {error:#}");
                    }
                }
            }
        }
        self.datagram = datagram;
    }

    fn change_kernel(&mut self, change: KernelChange, kernel: &mut KernelMaps) -> Result<()> {
        match change {
            KernelChange::Route { writer, slots } => kernel.set_route(writer, slots),
            KernelChange::Peer(peer) => {
                self.peers.insert(peer);
                kernel.add_peer(peer)
            }
            KernelChange::ForgetPeer(peer) => {
                self.peers.remove(&peer);
                kernel.remove_peer(peer)
            }
        }
    }
}

/// Where a layer's outputs go, beside its own sockets.
pub(crate) struct Effects<'a> {
    pub(crate) kernel: &'a mut KernelMaps,
    pub(crate) interfaces: &'a [Interface],
    /// For the apps in these slots.
    pub(crate) replies: &'a mut Vec<(u8, FromLayer)>,
}

fn layer_config(
    domain: u32,
    setting: &Setting<'_>,
    identity: Identity,
    ports: Ports,
    participant_id: u16,
) -> LayerConfig {
    let options = setting.options;
    let user_port = ports.user_unicast(participant_id);
    let group = SocketAddr::from((GROUP, ports.metatraffic_multicast()));
    let loopback = SocketAddr::from((Ipv4Addr::LOCALHOST, user_port));
    LayerConfig {
        name: host_name(),
        metatraffic: locators(
            setting.interfaces,
            ports.metatraffic_unicast(participant_id),
        ),
        user: locators(setting.interfaces, user_port),
        peers: options
            .peers
            .iter()
            .flat_map(|peer| peer.addresses(ports))
            .collect(),
        multicast: (!options.no_multicast).then_some(group),
        lease: options.lease,
        announce_period: (options.lease / 4).min(ANNOUNCE_PERIOD),
        datagram_size: interfaces::datagram_size(setting.interfaces),
        incarnation: identity.incarnation,
        resume_grace: crate::host::RESUME_GRACE,
        ..LayerConfig::new(identity.prefix, domain, loopback)
    }
}

/// Where a port of this host is reached.
fn locators(interfaces: &[Interface], port: u16) -> Vec<SocketAddr> {
    interfaces
        .iter()
        .flat_map(|interface| &interface.addresses)
        .map(|address| SocketAddr::from((*address, port)))
        .collect()
}

/// A GUID prefix that no other participant has: the vendor's number (RTPS 2.5, 9.3.1.5) and 80 random bits.
fn new_prefix() -> Result<GuidPrefix> {
    let mut prefix = [0; 12];
    let (vendor, rest) = prefix.split_at_mut(2);
    vendor.copy_from_slice(&VendorId::UNKNOWN.0);
    random::fill(rest)?;
    Ok(GuidPrefix(prefix))
}

fn host_name() -> String {
    fs::read_to_string("/proc/sys/kernel/hostname")
        .map_or_else(|_| "rtpsd".to_owned(), |name| name.trim().to_owned())
}
