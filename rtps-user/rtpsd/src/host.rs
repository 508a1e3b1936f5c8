//! The host as one participant in each of its domains: the kernel's maps, the domains, and the slots of apps.
//!
//! Everything that happens goes in here by a method; what is to be told to apps is collected and fetched with
//! [`Host::take_replies`].

use std::collections::{BTreeMap, BTreeSet};
use std::time::{Duration, Instant};

use anyhow::Result;
use rtps_ebpf::SlotSet;
use rtps_ebpf::abi::{APP_ATTACHED, App};
use rtps_net::Interface;
use rtps_user::layer::Layer;
use rtps_user::layer::protocol::{FromLayer, Hello, LAYER_PROTOCOL_VERSION, ToLayer, Welcome};
use tracing::{debug, error, info, warn};

use crate::attachment::Attachment;
use crate::domain::{DomainHost, Effects, Reply};
use crate::inboxes::{Inboxes, Made, Order};
use crate::kernel_maps::{KernelMaps, monotonic_now};
use crate::news::News;
use crate::own_addresses::own_addresses;
use crate::random;
use crate::sign_of_life::SignOfLife;

/// How long the slots of apps outlive a killed rtpsd that has been started again.
pub(crate) const RESUME_GRACE: Duration = Duration::from_secs(5);

/// The size of a ring when the app does not say, and the least that holds a few of the largest messages; in bytes.
const DEFAULT_RING: u32 = 1 << 20;
const SMALLEST_RING: u32 = 1 << 18;

/// Ports below need privileges.
const FIRST_UNPRIVILEGED_PORT: u16 = 1024;

/// The longest name of an app, in bytes.
const MAX_NAME: usize = 256;

/// An attached app.
#[derive(Clone, Debug)]
pub(crate) struct Seat {
    pub(crate) slot: u8,
    pub(crate) domain: u32,
    pub(crate) name: String,
    pub(crate) doorbell_port: u16,
}

/// What an app gets when it is taken.
pub(crate) struct Admission {
    pub(crate) seat: Seat,
    pub(crate) welcome: Welcome,
    /// Whether the app came back and still has its inbox; else it is to be welcomed when it is there.
    pub(crate) has_inbox: bool,
}

/// A slot whose app has not come back since rtpsd was started again.
struct Awaited {
    domain_index: u32,
    until: Instant,
}

/// See the module.
pub(crate) struct Host {
    pub(crate) interfaces: Vec<Interface>,
    pub(crate) kernel: KernelMaps,
    pub(crate) domains: Vec<DomainHost>,
    pub(crate) news: News,
    pub(crate) inboxes: Inboxes,
    life: SignOfLife,
    occupied: SlotSet,
    awaited: BTreeMap<u8, Awaited>,
    replies: Vec<Reply>,
    /// Indices of interfaces that came back, and to which the programs could not be attached yet.
    unattached: BTreeSet<u32>,
    max_ring: u32,
}

/// What a host is made of.
pub(crate) struct Parts {
    pub(crate) interfaces: Vec<Interface>,
    pub(crate) kernel: KernelMaps,
    pub(crate) domains: Vec<DomainHost>,
    pub(crate) news: News,
    pub(crate) inboxes: Inboxes,
    pub(crate) life: SignOfLife,
}

impl Host {
    /// Brings the kernel up to date and has it act. Takes over the slots that the kernel still delivers to; those of
    /// domains that are no longer served, and those of apps that do not come back in time, are freed.
    pub(crate) fn new(parts: Parts, max_ring: u32, now: Instant) -> Result<Self> {
        let mut host = Self {
            interfaces: parts.interfaces,
            kernel: parts.kernel,
            domains: parts.domains,
            news: parts.news,
            inboxes: parts.inboxes,
            life: parts.life,
            occupied: SlotSet::EMPTY,
            awaited: BTreeMap::new(),
            replies: Vec::new(),
            unattached: BTreeSet::new(),
            max_ring,
        };
        for (slot, app) in host.kernel.attached_apps()? {
            let awaited = Awaited {
                domain_index: app.domain_index,
                until: now + RESUME_GRACE,
            };
            host.occupied.insert(slot);
            host.awaited.insert(slot, awaited);
        }
        if !host.awaited.is_empty() {
            info!(slots = host.awaited.len(), "waiting for apps to come back");
        }
        host.kernel.fan_outs.forget_others(&host.occupied)?;
        host.drain_all(now);
        host.forget_old_entries()?;
        host.give_sign_of_life(now)?;
        Ok(host)
    }

    /// After the first [`drain_all`](Self::drain_all), which brings the kernel up to date: forgets what it knows beyond
    /// that, such as what an earlier rtpsd told it of domains that are no longer served.
    fn forget_old_entries(&mut self) -> Result<()> {
        let domains = self.domains.iter();
        let indices: BTreeSet<u32> = domains.map(|domain| domain.identity.domain_index).collect();
        self.kernel.discovery.forget_others(&indices)?;
        let layers = || self.domains.iter().map(|domain| &domain.layer);
        let participants = layers().flat_map(Layer::participants).collect();
        self.kernel.peers.forget_others(&participants)?;
        let routes = layers().flat_map(Layer::routed).collect();
        self.kernel.forget_other_routes(&routes)
    }

    /// Takes an app, or says in a sentence why not. Nothing is delivered to it before [`open`](Self::open), unless it
    /// has come back.
    pub(crate) fn attach(
        &mut self,
        now: Instant,
        connection: u32,
        hello: &Hello,
    ) -> Result<Admission, String> {
        self.check(hello)?;
        let position = self.position(hello.domain)?;
        let token = random::token().map_err(|error| format!("{error:#}"))?;
        let domain = self
            .domains
            .get_mut(position)
            .ok_or_else(|| "the domain is gone".to_owned())?;
        let welcome = domain.layer.attach(now, hello, token, &self.occupied)?;
        let seat = Seat {
            slot: welcome.slot,
            domain: hello.domain,
            name: hello.name.clone(),
            doorbell_port: hello.doorbell_port,
        };
        let domain_index = domain.identity.domain_index;
        let order = Order {
            connection,
            slot: seat.slot,
            app: App {
                state: APP_ATTACHED,
                domain_index,
                doorbell_port: seat.doorbell_port.into(),
                reserved: 0,
            },
            ring_bytes: ring_size(hello.ring_bytes, self.max_ring),
        };
        match self.provide_inbox(order, hello) {
            Ok(has_inbox) => {
                self.occupied.insert(seat.slot);
                self.drain_all(now);
                Ok(Admission {
                    seat,
                    welcome,
                    has_inbox,
                })
            }
            Err(reason) => {
                self.detach(now, &seat);
                Err(reason)
            }
        }
    }

    fn check(&self, hello: &Hello) -> Result<(), String> {
        if hello.version != LAYER_PROTOCOL_VERSION {
            return Err(format!(
                "the app speaks version {} of the layer protocol and rtpsd version {LAYER_PROTOCOL_VERSION}; \
                 build both from the same source",
                hello.version
            ));
        }
        if hello.name.len() > MAX_NAME {
            return Err(format!("the app's name is longer than {MAX_NAME} bytes"));
        }
        let mut owned = self.domains.iter().flat_map(DomainHost::port_configs);
        let is_owned = owned.any(|(port, _)| port == hello.doorbell_port);
        check_doorbell(hello.doorbell_port, is_owned)
    }

    fn position(&self, domain: u32) -> Result<usize, String> {
        self.domains
            .iter()
            .position(|served| served.id == domain)
            .ok_or_else(|| {
                format!(
                    "the kernel layer does not serve domain {domain}; load it with `--domain {domain}`"
                )
            })
    }

    /// Has the inbox of a new app made; true for an app that still has its own.
    fn provide_inbox(&mut self, order: Order, hello: &Hello) -> Result<bool, String> {
        let has_returned = hello.resume.is_some_and(|resume| resume.slot == order.slot)
            && self.awaited.remove(&order.slot).is_some();
        if has_returned {
            self.kernel
                .set_app(order.slot, order.app)
                .map_err(|error| format!("{error:#}"))?;
        } else {
            self.inboxes.make(order)?;
        }
        Ok(has_returned)
    }

    /// The next inbox that has been made; to be opened if its app is still there.
    pub(crate) fn next_inbox(&mut self) -> Option<Made> {
        self.inboxes.next()
    }

    /// Has the kernel deliver to an app whose inbox is in place.
    pub(crate) fn open(&mut self, order: &Order) -> Result<(), String> {
        self.kernel
            .set_app(order.slot, order.app)
            .map_err(|error| format!("{error:#}"))
    }

    /// Does what an attached app asks for.
    pub(crate) fn request(&mut self, now: Instant, seat: &Seat, request: ToLayer) {
        if let Some(domain) = self.domain_mut(seat.domain) {
            domain.layer.handle_request(now, seat.slot, request);
        }
        self.drain_all(now);
    }

    /// The app is gone.
    pub(crate) fn detach(&mut self, now: Instant, seat: &Seat) {
        self.free_slot(seat.slot);
        if let Some(domain) = self.domain_mut(seat.domain) {
            domain.layer.detach(now, seat.slot);
        }
        self.drain_all(now);
    }

    fn free_slot(&mut self, slot: u8) {
        self.occupied.remove(slot);
        self.awaited.remove(&slot);
        let removed = self.kernel.remove_app(slot);
        for result in [removed, self.kernel.fan_outs.forget(slot)] {
            if let Err(error) = result {
                warn!(slot, "{error:#}");
            }
        }
        self.inboxes.free(slot);
    }

    /// Reads from one of a domain's sockets.
    pub(crate) fn receive(
        &mut self,
        now: Instant,
        position: usize,
        socket: usize,
        buffer: &mut [u8],
    ) {
        let mut effects = Effects {
            kernel: &mut self.kernel,
            interfaces: &self.interfaces,
            replies: &mut self.replies,
        };
        if let Some(domain) = self.domains.get_mut(position) {
            domain.receive(now, socket, buffer, &mut effects);
        }
    }

    /// Reads what the kernel has to tell of discovery.
    pub(crate) fn read_news(&mut self, now: Instant) {
        let mut effects = Effects {
            kernel: &mut self.kernel,
            interfaces: &self.interfaces,
            replies: &mut self.replies,
        };
        let domains = &mut self.domains;
        self.news.read(|item| {
            let index = item.domain_index;
            let mut served = domains.iter_mut();
            if let Some(domain) = served.find(|d| d.identity.domain_index == index) {
                domain.learn(now, &item, &mut effects);
            }
        });
    }

    /// When [`handle_timeouts`](Self::handle_timeouts) is due.
    pub(crate) fn next_timeout(&self) -> Option<Instant> {
        let awaited = self.awaited.values().map(|awaited| awaited.until);
        let domains = self.domains.iter().filter_map(DomainHost::next_timeout);
        domains.chain(awaited).chain(self.life.due()).min()
    }

    /// Does what is due.
    pub(crate) fn handle_timeouts(&mut self, now: Instant) {
        let mut effects = Effects {
            kernel: &mut self.kernel,
            interfaces: &self.interfaces,
            replies: &mut self.replies,
        };
        for domain in &mut self.domains {
            if domain.next_timeout().is_some_and(|due| due <= now) {
                domain.handle_timeout(now, &mut effects);
            }
        }
        self.free_overdue_slots(now);
        if let Err(error) = self.give_sign_of_life(now) {
            error!("{error:#}");
        }
    }

    fn give_sign_of_life(&mut self, now: Instant) -> Result<()> {
        match self.life.give(now, monotonic_now()) {
            Some(config) => self.kernel.configure(config),
            None => Ok(()),
        }
    }

    fn free_overdue_slots(&mut self, now: Instant) {
        let overdue: Vec<(u8, u32)> = self
            .awaited
            .iter()
            .filter(|(_, awaited)| awaited.until <= now)
            .map(|(slot, awaited)| (*slot, awaited.domain_index))
            .collect();
        for (slot, domain_index) in overdue {
            info!(slot, "the app did not come back");
            self.free_slot(slot);
            let mut domains = self.domains.iter_mut();
            if let Some(domain) = domains.find(|d| d.identity.domain_index == domain_index) {
                domain.layer.detach(now, slot);
            }
            self.drain_all(now);
        }
    }

    /// Addresses or interfaces of this network namespace changed.
    pub(crate) fn refresh_interfaces(&mut self, now: Instant, attachment: &mut Attachment) {
        let refreshed = own_addresses().and_then(|addresses| self.kernel.set_addresses(&addresses));
        if let Err(error) = refreshed {
            error!("{error:#}");
        }
        for position in 0..self.interfaces.len() {
            if let Err(error) = self.refresh_interface(position, attachment) {
                error!("{error:#}");
            }
        }
        if let Err(error) = attachment.describe(&self.interfaces, &mut self.kernel) {
            error!("{error:#}");
        }
        if let Err(error) = self.kernel.discovery.announce_on(&self.interfaces) {
            error!("{error:#}");
        }
        for domain in &mut self.domains {
            domain.set_addresses(now, &self.interfaces);
            if let Err(error) = domain.set_datagram_size(&self.interfaces, &mut self.kernel) {
                error!("{error:#}");
            }
        }
        for list in self.kernel.fan_outs.refresh(&self.interfaces) {
            let message = FromLayer::FanOut {
                number: list.number,
                destinations: list.destinations,
            };
            self.replies.push(Reply::new(list.slot, message));
        }
        self.drain_all(now);
    }

    /// An interface that was removed and made again has another index: it starts anew. Meanwhile, or without addresses,
    /// it is none that anybody could be told of.
    fn refresh_interface(&mut self, position: usize, attachment: &mut Attachment) -> Result<()> {
        let Some(known) = self.interfaces.get_mut(position) else {
            return Ok(());
        };
        let found = match rtps_net::find(&known.name) {
            Ok(found) => found,
            Err(error) => {
                debug!("{error}");
                known.addresses.clear();
                return Ok(());
            }
        };
        if found.index != known.index {
            self.unattached.insert(found.index);
        }
        *known = found.clone();
        // Again, for the groups of a family that it had no addresses of before.
        for domain in &self.domains {
            if let Err(error) = domain.sockets.join(&found) {
                warn!("{error:#}");
            }
        }
        if !self.unattached.contains(&found.index) {
            return Ok(());
        }
        self.kernel.count_interfaces(&self.interfaces)?;
        attachment.attach(&found, &self.interfaces)?;
        self.unattached.remove(&found.index);
        info!(interface = found.name, "the interface is back");
        Ok(())
    }

    /// Leaves every domain, telling the others.
    pub(crate) fn shutdown(&mut self, now: Instant) {
        if let Err(error) = self.kernel.configure(self.life.last()) {
            error!("{error:#}");
        }
        for domain in &mut self.domains {
            domain.layer.shutdown(now);
        }
        self.drain_all(now);
    }

    /// What is to be told to apps, in this order.
    pub(crate) fn take_replies(&mut self) -> Vec<Reply> {
        std::mem::take(&mut self.replies)
    }

    fn domain_mut(&mut self, id: u32) -> Option<&mut DomainHost> {
        self.domains.iter_mut().find(|domain| domain.id == id)
    }

    fn drain_all(&mut self, now: Instant) {
        let mut effects = Effects {
            kernel: &mut self.kernel,
            interfaces: &self.interfaces,
            replies: &mut self.replies,
        };
        for domain in &mut self.domains {
            domain.drain(now, &mut effects);
        }
    }
}

/// The kernel sends datagrams on to the doorbell port: an app must not have them go to a service of this host, nor
/// round and round to the layer's own ports.
fn check_doorbell(port: u16, is_owned: bool) -> Result<(), String> {
    let is_privileged = (1..FIRST_UNPRIVILEGED_PORT).contains(&port);
    if is_privileged || is_owned {
        return Err(format!(
            "port {port} cannot be a doorbell: bind the app's socket to a port that the system chooses"
        ));
    }
    Ok(())
}

/// The kernel takes powers of two that are whole pages.
fn ring_size(wanted: u32, largest: u32) -> u32 {
    let wanted = if wanted == 0 { DEFAULT_RING } else { wanted };
    let largest = largest.max(SMALLEST_RING);
    let largest_power = 1 << largest.ilog2();
    wanted
        .clamp(SMALLEST_RING, largest)
        .checked_next_power_of_two()
        .map_or(largest_power, |size| size.min(largest_power))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doorbells_are_ports_that_belong_to_nobody_else() {
        assert_eq!(check_doorbell(0, false), Ok(()));
        assert_eq!(check_doorbell(40_000, false), Ok(()));
        assert_eq!(check_doorbell(1024, false), Ok(()));
        for (port, is_owned) in [(1, false), (1023, false), (7411, true)] {
            assert!(check_doorbell(port, is_owned).is_err());
        }
    }

    #[test]
    fn rings_are_powers_of_two_within_bounds() {
        assert_eq!(ring_size(0, 64 << 20), DEFAULT_RING);
        assert_eq!(ring_size(1, 64 << 20), SMALLEST_RING);
        assert_eq!(ring_size((1 << 20) + 1, 64 << 20), 2 << 20);
        assert_eq!(ring_size(u32::MAX, 64 << 20), 64 << 20);
        assert_eq!(ring_size(u32::MAX, u32::MAX), 1 << 31);
        assert_eq!(ring_size(3 << 20, 3 << 20), 2 << 20);
        assert_eq!(ring_size(0, 0), SMALLEST_RING);
    }
}
