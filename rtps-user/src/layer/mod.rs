//! The layer: discovery and matching on behalf of the apps that use it.
//!
//! [`Layer`] is the whole of it without I/O: rtpsd drives one for the kernel layer, and an app without kernel
//! layer drives one for itself. After each call drain [`Layer::poll_output`] until it gives `None`, and do what it
//! says in order; call [`Layer::handle_timeout`] when [`Layer::poll_timeout`] has come.
//!
//! The order of the outputs is a promise: a route is there before the app learns of the match, an app is told before
//! the store is changed, and the store is changed before a remote participant learns that we know. So nothing is
//! lost by a crash between two of them.
//!
//! A low-level layer may answer discovery messages in the layer's name ([`LayerConfig::kernel_discovery`]). It is told
//! what to answer by [`KernelChange`]s, and hands over what it has news in: [`Layer::handle_answered`], or
//! [`Layer::handle_datagram`] where it has not answered. A message it has handed over must not be forgotten before the
//! outputs that follow from it are drained, for it is acknowledged.

mod apps;
mod browse;
mod channels;
mod config;
mod declare;
mod describe;
mod events;
mod fan_out;
mod outputs;
mod peers;
pub mod protocol;
mod restore;
mod status;
mod store;
#[cfg(test)]
mod tests;

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::net::SocketAddr;
use std::time::Instant;

use apps::{App, Apps};
use channels::Channels;
pub use config::{LayerConfig, Limits};
use describe::Descriptions;
pub use outputs::{KernelChange, LayerOutput};
use peers::Peers;
use protocol::{FromLayer, Hello, LAYER_PROTOCOL_VERSION, ToLayer, Welcome};
use rtps_ebpf::SlotSet;
pub use status::{AppStatus, EndpointStatus, LayerStatus, ParticipantStatus, RefusedStatus};
use store::Record;
pub use store::{MAX_STORE_VALUE, StoreChange, StoreKey};

use crate::discovery::{Discovery, Matchmaker};
use crate::wire::{Guid, GuidPrefix, SequenceNumber, WireError};

/// The host's participant in one domain, for up to 255 apps.
#[derive(Debug)]
pub struct Layer {
    config: LayerConfig,
    discovery: Discovery,
    matchmaker: Matchmaker,
    apps: Apps,
    descriptions: Descriptions,
    /// What the low-level layer has been told.
    routes: BTreeMap<Guid, SlotSet>,
    peers: Peers,
    channels: Channels,
    /// Remote endpoints that are too large for the store: they must be announced again after a restart.
    unstorable: BTreeSet<Guid>,
    outputs: VecDeque<LayerOutput>,
}

impl Layer {
    /// Starts; the first announcement is due at once.
    pub fn new(config: LayerConfig, now: Instant) -> Self {
        let mut layer = Self {
            discovery: Discovery::new(config.discovery(), now),
            matchmaker: Matchmaker::new(config.prefix),
            apps: Apps::default(),
            descriptions: Descriptions::default(),
            routes: BTreeMap::new(),
            peers: Peers::default(),
            channels: Channels::default(),
            unstorable: BTreeSet::new(),
            outputs: VecDeque::new(),
            config,
        };
        layer.store_announcement();
        layer
    }

    /// Takes an app: gives it a slot, or the one that it had before the layer was restarted. `token` is random and
    /// serves for a new slot, which is none of those `taken` by apps of the host's other domains. The error is a
    /// sentence for [`FromLayer::Refused`].
    pub fn attach(
        &mut self,
        now: Instant,
        hello: &Hello,
        token: [u8; 16],
        taken: &SlotSet,
    ) -> Result<Welcome, String> {
        self.check(hello)?;
        let (prefix, datagram_size) = (self.config.prefix, self.config.datagram_size);
        let welcome = |slot, token| Welcome {
            slot,
            token,
            prefix,
            datagram_size,
        };
        if let Some(resume) = hello.resume
            && let Some(app) = self.apps.returning(resume)
        {
            app.grace = Some(now + self.config.resume_grace);
            let backlog = app.backlog.take().unwrap_or_default();
            self.open_channels(resume.slot);
            for message in backlog {
                self.reply(resume.slot, message);
            }
            return Ok(welcome(resume.slot, resume.token));
        }
        let name = hello.name.clone();
        let slot = self
            .apps
            .add(App::new(name.clone(), token), taken)
            .ok_or("255 apps use the layers of this host already: end one of them first")?;
        self.store(Record::App { slot, token, name });
        Ok(welcome(slot, token))
    }

    fn check(&self, hello: &Hello) -> Result<(), String> {
        if hello.version != LAYER_PROTOCOL_VERSION {
            return Err(format!(
                "the app speaks version {} of the layer protocol and the layer version {LAYER_PROTOCOL_VERSION}: \
                 build both from the same release",
                hello.version
            ));
        }
        if hello.domain != self.config.domain {
            return Err(format!(
                "this layer serves domain {} and not {}",
                self.config.domain, hello.domain
            ));
        }
        Ok(())
    }

    /// Does what an attached app asks for; answers are replies to its slot.
    pub fn handle_request(&mut self, now: Instant, slot: u8, request: ToLayer) {
        match request {
            ToLayer::Hello(_) => self.refuse(slot, "the app has said hello before".to_owned()),
            ToLayer::Declare(endpoint) => {
                if let Err(reason) = self.declare(now, slot, *endpoint) {
                    self.refuse(slot, reason);
                }
            }
            ToLayer::Withdraw(entity) if entity.slot() == slot => {
                self.withdraw(now, entity);
                self.refresh_automatic_lease(now);
            }
            ToLayer::Withdraw(_) => {
                self.refuse(slot, "the endpoint belongs to another app".to_owned());
            }
            // On the wire all apps of the host are one participant, so that this asserts for the others as well.
            ToLayer::AssertLiveliness => self.discovery.assert_liveliness(now, true),
            ToLayer::FanOut(fan_out) => self.fan_out(slot, fan_out),
            ToLayer::Browse { after } => self.browse(slot, after),
            ToLayer::Describe(user_data) => self.describe(now, slot, user_data),
        }
        self.settle();
    }

    /// The app is gone: its endpoints are withdrawn.
    pub fn detach(&mut self, now: Instant, slot: u8) {
        let Some(app) = self.apps.remove(slot) else {
            return;
        };
        for declared in app.endpoints.into_values() {
            self.withdraw_declared(now, &declared);
        }
        self.close_channels(slot);
        self.forget(StoreKey::app(slot));
        self.describe(now, slot, Vec::new());
        self.refresh_automatic_lease(now);
        self.settle();
    }

    /// Reads a datagram that came to the layer's own sockets from `source`.
    pub fn handle_datagram(
        &mut self,
        now: Instant,
        source: SocketAddr,
        datagram: &[u8],
    ) -> Result<(), WireError> {
        let result = self.discovery.handle_datagram(now, source, datagram);
        self.settle();
        result
    }

    /// Reads a message that the low-level layer has handed over and answered: samples and what is gone count as ever,
    /// but nothing is answered once more.
    pub fn handle_answered(
        &mut self,
        now: Instant,
        source: SocketAddr,
        datagram: &[u8],
    ) -> Result<(), WireError> {
        let result = self.discovery.handle_answered(now, source, datagram);
        self.settle();
        result
    }

    /// The low-level layer has seen that a built-in reader of a remote participant has all samples below `base`. To be
    /// said before [`handle_timeout`](Self::handle_timeout), which reminds readers that lag behind, of all that
    /// [`unacknowledged`](Self::unacknowledged) gives.
    pub fn acknowledged(&mut self, now: Instant, reader: Guid, base: SequenceNumber) {
        self.discovery.acknowledged(now, reader, base);
        self.settle();
    }

    /// The participants with built-in readers that have not acknowledged everything, as far as is known here.
    pub fn unacknowledged(&self) -> impl Iterator<Item = GuidPrefix> + use<> {
        self.discovery.unacknowledged()
    }

    /// The remote participants that are known, whose signs of life are to be told by [`seen`](Self::seen).
    pub fn participants(&self) -> impl Iterator<Item = GuidPrefix> {
        self.discovery
            .participants()
            .map(|participant| participant.data.prefix)
    }

    /// The writers that the low-level layer has a route of.
    pub fn routed(&self) -> impl Iterator<Item = Guid> {
        self.routes.keys().copied()
    }

    /// The low-level layer saw traffic of a participant at `at`: its lease holds from then. To be said before
    /// [`handle_timeout`](Self::handle_timeout), which ends leases.
    pub fn seen(&mut self, at: Instant, participant: GuidPrefix) {
        self.discovery.seen(at, participant);
    }

    /// Does what is due.
    pub fn handle_timeout(&mut self, now: Instant) {
        self.discovery.handle_timeout(now);
        self.end_grace(now);
        self.settle();
    }

    /// The host has other addresses than before: tells the remote participants. What is no change is not told, and
    /// neither is that there are none: nobody would hear that, and those that come may be those of before.
    pub fn set_addresses(
        &mut self,
        now: Instant,
        metatraffic: Vec<SocketAddr>,
        user: Vec<SocketAddr>,
    ) {
        let is_same = self.config.metatraffic == metatraffic && self.config.user == user;
        if is_same || metatraffic.is_empty() {
            return;
        }
        self.config.metatraffic = metatraffic;
        self.config.user = user;
        self.announce_participant(now);
        self.settle();
    }

    /// The most bytes of a datagram are others than before, as apps that come from now on are told.
    pub fn set_datagram_size(&mut self, size: u16) {
        self.config.datagram_size = size;
    }

    /// Tells what has changed in the configuration.
    fn announce_participant(&mut self, now: Instant) {
        let participant = self.config.discovery().participant;
        self.discovery.set_participant(now, participant);
        self.store_announcement();
    }

    /// When [`handle_timeout`](Self::handle_timeout) is to be called at the latest.
    pub fn poll_timeout(&self) -> Option<Instant> {
        let timers = [self.discovery.poll_timeout(), self.apps.poll_timeout()];
        timers.into_iter().flatten().min()
    }

    /// Leaves the domain: remote participants forget this one and all of its endpoints at once. Drain the outputs
    /// once more, then drop the layer.
    pub fn shutdown(&mut self, _now: Instant) {
        if self.config.kernel_discovery {
            self.kernel(KernelChange::Announcement(Vec::new()));
        }
        self.discovery.leave();
    }

    /// The next thing to do; a datagram to be sent is put into `out`, replacing what is there.
    pub fn poll_output(&mut self, now: Instant, out: &mut Vec<u8>) -> Option<LayerOutput> {
        if let Some(output) = self.outputs.pop_front() {
            return Some(output);
        }
        // Only now, for what others may learn must have been stored; and before it is sent.
        if let Some(change) = self.poll_publication() {
            return Some(LayerOutput::Kernel(change));
        }
        self.discovery
            .poll_transmit(now, out)
            .map(LayerOutput::Transmit)
    }

    fn refuse(&mut self, slot: u8, reason: String) {
        self.reply(slot, FromLayer::Refused { reason });
    }

    /// Tells an app, or notes it until the app is back.
    fn reply(&mut self, slot: u8, message: FromLayer) {
        match self.apps.get_mut(slot) {
            Some(App {
                backlog: Some(backlog),
                ..
            }) => backlog.push(message),
            Some(_) => self.outputs.push_back(LayerOutput::Reply { slot, message }),
            None => {}
        }
    }

    fn kernel(&mut self, change: KernelChange) {
        self.outputs.push_back(LayerOutput::Kernel(change));
    }

    /// Keeps a record; false, and an older one forgotten, where it is too large.
    fn store(&mut self, record: Record) -> bool {
        let key = record.key();
        let value = record.encode();
        let is_stored = value.is_some();
        let change = match value {
            Some(value) => StoreChange::Store { key, value },
            None => StoreChange::Forget(key),
        };
        self.outputs.push_back(LayerOutput::Store(change));
        is_stored
    }

    fn forget(&mut self, key: StoreKey) {
        self.outputs
            .push_back(LayerOutput::Store(StoreChange::Forget(key)));
    }
}
