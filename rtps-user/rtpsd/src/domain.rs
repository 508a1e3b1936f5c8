//! One domain of the host: its [`Layer`], and the sockets, maps and store that the layer's outputs go to.

use std::fs;
use std::net::{Ipv4Addr, SocketAddr};
use std::os::fd::OwnedFd;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};
use aya::programs::SocketFilter;
use rtps_ebpf::abi::{Domain, PORT_METATRAFFIC, PORT_MULTICAST, PORT_UNICAST, PortConfig};
use rtps_net::{Interface, locators};
use rtps_user::layer::protocol::{FanOut, FromLayer};
use rtps_user::layer::{KernelChange, Layer, LayerConfig, LayerOutput};
use rtps_user::wire::{Guid, GuidPrefix, VendorId};
use tracing::{debug, info, warn};

use crate::channel;
use crate::cli::{Discovery, Options, Peer};
use crate::kernel_maps::{BuiltinSample, KernelMaps, builtin_reader, monotonic_now};
use crate::news::Item;
use crate::pins::PinFolder;
use crate::random;
use crate::sockets::{DomainSockets, Ports};
use crate::store::{Identities, Identity, Store};

/// Datagrams of one socket that are read before others get their turn.
const BURST: usize = 64;

/// How old the kernel's knowledge of who is alive may be when a lease is judged.
const LIFE_FRESH: Duration = Duration::from_millis(100);

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
    discovery: Discovery,
    datagram_size: u16,
    /// When the kernel was last asked who is alive.
    asked: Instant,
    datagram: Vec<u8>,
}

/// What a domain is started with.
pub(crate) struct Setting<'a> {
    pub(crate) options: &'a Options,
    pub(crate) peers: &'a [Peer],
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
        let config = layer_config(id, setting, identity, ports, &sockets);
        let datagram_size = config.datagram_size;
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
            discovery: setting.options.discovery,
            datagram_size,
            asked: setting.now,
            datagram: Vec::new(),
        })
    }

    /// The domain, as the kernel wants to know it.
    pub(crate) fn entry(&self) -> Domain {
        let metatraffic_port = self.ports.metatraffic_unicast(self.sockets.participant_id);
        Domain {
            guid_prefix: self.identity.prefix.0,
            domain_id: self.id,
            count_base_ns: self.identity.count_base_ns,
            datagram_size: self.datagram_size.into(),
            metatraffic_port: metatraffic_port.into(),
        }
    }

    /// The ports that the domain owns, as the kernel wants to know them.
    pub(crate) fn port_configs(&self) -> Vec<(u16, PortConfig)> {
        let domain_index = u16::try_from(self.identity.domain_index).unwrap_or(u16::MAX);
        let id = self.sockets.participant_id;
        let metatraffic = match self.discovery {
            Discovery::Kernel => PORT_METATRAFFIC,
            Discovery::User => PORT_UNICAST,
        };
        [
            (self.ports.metatraffic_unicast(id), metatraffic),
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

    /// The interfaces' MTU may have changed: what the kernel sends in somebody's stead it cannot fragment. Others are
    /// told when they come; what they send before is fragmented by IP.
    pub(crate) fn set_datagram_size(
        &mut self,
        interfaces: &[Interface],
        kernel: &mut KernelMaps,
    ) -> Result<()> {
        let size = rtps_net::datagram_size(interfaces);
        if std::mem::replace(&mut self.datagram_size, size) == size {
            return Ok(());
        }
        info!(domain = self.id, size, "datagrams have another size");
        self.layer.set_datagram_size(size);
        kernel.set_domain(self.identity.domain_index, self.entry())
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

    /// Reads what the kernel has handed over.
    pub(crate) fn learn(&mut self, now: Instant, news: &Item<'_>, effects: &mut Effects<'_>) {
        let read = if news.is_answered && self.discovery == Discovery::Kernel {
            self.layer.handle_answered(now, news.source, news.message)
        } else {
            self.layer.handle_datagram(now, news.source, news.message)
        };
        if let Err(error) = read {
            debug!(source = %news.source, "malformed: {error}");
        }
        self.drain(now, effects);
    }

    /// When [`handle_timeout`](Self::handle_timeout) is due.
    pub(crate) fn next_timeout(&self) -> Option<Instant> {
        self.layer.poll_timeout()
    }

    /// Does what is due, knowing what the kernel knows of who is alive and who has what.
    pub(crate) fn handle_timeout(&mut self, now: Instant, effects: &mut Effects<'_>) {
        if now.duration_since(self.asked) >= LIFE_FRESH {
            self.ask_who_is_alive(now, effects.kernel);
        }
        self.ask_who_has_what(now, effects.kernel);
        self.layer.handle_timeout(now);
        self.drain(now, effects);
    }

    fn ask_who_is_alive(&mut self, now: Instant, kernel: &KernelMaps) {
        self.asked = now;
        let participants: Vec<GuidPrefix> = self.layer.participants().collect();
        for prefix in participants {
            let seen = kernel
                .peers
                .silence(prefix)
                .and_then(|silence| now.checked_sub(silence));
            if let Some(seen) = seen {
                self.layer.seen(seen, prefix);
            }
        }
    }

    fn ask_who_has_what(&mut self, now: Instant, kernel: &KernelMaps) {
        let lagging: Vec<GuidPrefix> = self.layer.unacknowledged().collect();
        for prefix in lagging {
            for (writer, base) in kernel.peers.acknowledged(prefix) {
                if let Some(reader) = builtin_reader(writer) {
                    let reader = Guid::new(prefix, reader);
                    self.layer.acknowledged(now, reader, base);
                }
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
                LayerOutput::Reply { slot, message } => {
                    effects.replies.push(Reply::new(slot, message))
                }
                LayerOutput::Channel(slots) => self.connect(slots, effects),
                LayerOutput::Kernel(change) => {
                    if let Err(error) = self.change_kernel(change, effects) {
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

    /// Connects two apps by shared memory.
    fn connect(&mut self, slots: [u8; 2], effects: &mut Effects<'_>) {
        match channel::open(slots) {
            Ok(ends) => effects.replies.extend(ends),
            Err(error) => {
                warn!(?slots, "two apps go without shared memory: {error:#}");
                self.layer.refuse_channel(slots);
            }
        }
    }

    fn change_kernel(&self, change: KernelChange, effects: &mut Effects<'_>) -> Result<()> {
        let kernel = &mut *effects.kernel;
        let domain = self.identity.domain_index;
        match change {
            KernelChange::Route { writer, slots } => kernel.set_route(writer, slots),
            KernelChange::Peer {
                prefix,
                addresses,
                supervised,
            } => kernel.peers.keep(prefix, &addresses, supervised),
            KernelChange::ForgetPeer(prefix) => kernel.peers.forget(prefix),
            KernelChange::Announcement(submessages) => {
                let interfaces = effects.interfaces;
                kernel.discovery.announce(domain, submessages, interfaces)
            }
            KernelChange::Sample {
                writer,
                sequence,
                timestamp,
                submessage,
            } => {
                let sample = BuiltinSample {
                    writer,
                    sequence,
                    timestamp,
                    submessage: &submessage,
                };
                kernel.discovery.keep_sample(domain, &sample)
            }
            KernelChange::ForgetSample { writer, sequence } => {
                kernel.discovery.forget_sample(domain, writer, sequence)
            }
            KernelChange::Available {
                writer,
                first,
                last,
            } => kernel.discovery.set_available(domain, writer, first, last),
            KernelChange::Progress {
                writer,
                next,
                exact,
            } => kernel.peers.progress(writer, next, exact),
            KernelChange::FanOut { slot, fan_out } => self.fan_out(slot, &fan_out, effects),
        }
    }

    /// Keeps an app's list of destinations; the app is told in any case.
    fn fan_out(&self, slot: u8, fan_out: &FanOut, effects: &mut Effects<'_>) -> Result<()> {
        let app = (slot, self.identity.domain_index);
        let fan_outs = &mut effects.kernel.fan_outs;
        let kept = fan_outs.keep(app, fan_out, effects.interfaces);
        let (destinations, outcome) = match kept {
            Ok(served) => (served, Ok(())),
            Err(error) => (Vec::new(), Err(error)),
        };
        let message = FromLayer::FanOut {
            number: fan_out.number,
            destinations,
        };
        effects.replies.push(Reply::new(slot, message));
        outcome
    }
}

/// Where a layer's outputs go, beside its own sockets.
pub(crate) struct Effects<'a> {
    pub(crate) kernel: &'a mut KernelMaps,
    pub(crate) interfaces: &'a [Interface],
    pub(crate) replies: &'a mut Vec<Reply>,
}

/// What an app is to be told.
pub(crate) struct Reply {
    pub(crate) slot: u8,
    pub(crate) message: FromLayer,
    /// What it gets beside the message.
    pub(crate) descriptors: Vec<OwnedFd>,
}

impl Reply {
    /// The message alone.
    pub(crate) fn new(slot: u8, message: FromLayer) -> Self {
        Self {
            slot,
            message,
            descriptors: Vec::new(),
        }
    }
}

fn layer_config(
    domain: u32,
    setting: &Setting<'_>,
    identity: Identity,
    ports: Ports,
    sockets: &DomainSockets,
) -> LayerConfig {
    let options = setting.options;
    let participant_id = sockets.participant_id;
    let user_port = ports.user_unicast(participant_id);
    let loopback = SocketAddr::from((Ipv4Addr::LOCALHOST, user_port));
    LayerConfig {
        name: host_name(),
        metatraffic: locators(
            setting.interfaces,
            ports.metatraffic_unicast(participant_id),
        ),
        user: locators(setting.interfaces, user_port),
        peers: setting
            .peers
            .iter()
            .flat_map(|peer| peer.addresses(ports))
            .collect(),
        multicast: if options.no_multicast {
            Vec::new()
        } else {
            sockets.groups()
        },
        lease: options.lease,
        announce_period: (options.lease / 4).min(ANNOUNCE_PERIOD),
        datagram_size: rtps_net::datagram_size(setting.interfaces),
        count_age: age_of_counts(identity, setting.now),
        channels: true,
        kernel_discovery: options.discovery == Discovery::Kernel,
        bind_addresses: !options.any_source,
        resume_grace: crate::host::RESUME_GRACE,
        ..LayerConfig::new(identity.prefix, domain, loopback)
    }
}

/// How old counts were at `at`. The kernel's are as old: of one that is ahead, others would take the answers of the
/// other for old ones.
fn age_of_counts(identity: Identity, at: Instant) -> Duration {
    monotonic_now()
        .saturating_sub(at.elapsed())
        .saturating_sub(Duration::from_nanos(identity.count_base_ns))
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
