//! Endpoints of apps: declared, changed, withdrawn.

use std::time::Instant;

use super::Layer;
use super::apps::Declared;
use super::protocol::Endpoint;
use super::store::{Record, StoreKey};
use crate::RemoteEndpoint;
use crate::discovery::EndpointData;
use crate::qos::LivelinessKind;
use crate::wire::{EntityId, Guid, SequenceNumber};

/// The longest name of a topic or type, in bytes.
const MAX_NAME: usize = 1024;
/// The longest announcement, in bytes: each of its parameters must have a 16-bit length.
const MAX_ANNOUNCEMENT: usize = 60_000;

impl Layer {
    /// Takes a new endpoint of an app, or what has changed of a known one. The error is a sentence for the app's user.
    pub(super) fn declare(
        &mut self,
        now: Instant,
        slot: u8,
        mut endpoint: Endpoint,
    ) -> Result<(), String> {
        self.check_endpoint(slot, &endpoint)?;
        let objects = std::mem::take(&mut endpoint.type_objects);
        if !objects.is_empty() && self.matchmaker.add_types(&objects).is_err() {
            return Err(format!(
                "the TypeObjects of type {} are malformed",
                endpoint.type_name
            ));
        }
        let entity = endpoint.entity;
        let mut replaced = None;
        if let Some(known) = self.apps.endpoint_mut(entity) {
            known.is_confirmed = true;
            if known.endpoint == endpoint {
                return Ok(());
            }
            if known.endpoint.topic != endpoint.topic
                || known.endpoint.type_name != endpoint.type_name
            {
                return Err(format!(
                    "endpoint {entity} cannot change its topic: withdraw it first"
                ));
            }
            replaced = known.sequence;
        }
        self.insert_endpoint(&endpoint);
        let sequence = self.discovery.announce(now, &self.data_of(&endpoint));
        if let Some(sequence) = sequence {
            self.store(Record::Declared {
                sequence,
                endpoint: Box::new(endpoint.clone()),
            });
        }
        self.note_sample(entity, replaced, sequence);
        if let Some(app) = self.apps.get_mut(slot) {
            let declared = Declared {
                endpoint,
                sequence,
                is_confirmed: true,
            };
            app.endpoints.insert(entity, declared);
        }
        self.refresh_automatic_lease(now);
        Ok(())
    }

    fn check_endpoint(&mut self, slot: u8, endpoint: &Endpoint) -> Result<(), String> {
        let entity = endpoint.entity;
        let limit = self.config.limits.endpoints_per_app;
        let app = self.apps.get_mut(slot).ok_or("the app is not attached")?;
        if entity.slot() != slot || !(entity.is_writer() || entity.is_reader()) {
            return Err(format!("{entity} is no endpoint of the app in slot {slot}"));
        }
        if app.endpoints.len() >= limit && !app.endpoints.contains_key(&entity) {
            return Err(format!("the app has {limit} endpoints already"));
        }
        for (what, name) in [("topic", &endpoint.topic), ("type", &endpoint.type_name)] {
            if name.is_empty() || name.len() > MAX_NAME || name.contains('\0') {
                return Err(format!(
                    "the name of the {what} must have 1 to {MAX_NAME} bytes and no NUL"
                ));
            }
        }
        let mut announcement = Vec::new();
        self.data_of(endpoint).encode(&mut announcement);
        if announcement.len() > MAX_ANNOUNCEMENT {
            return Err(format!(
                "the policies of endpoint {entity} take more than {MAX_ANNOUNCEMENT} bytes: shorten USER_DATA, \
                 TOPIC_DATA, GROUP_DATA or PARTITION"
            ));
        }
        Ok(())
    }

    /// Withdraws an endpoint of an app, if it is there.
    pub(super) fn withdraw(&mut self, now: Instant, entity: EntityId) {
        let declared = self
            .apps
            .get_mut(entity.slot())
            .and_then(|app| app.endpoints.remove(&entity));
        if let Some(declared) = declared {
            self.withdraw_declared(now, &declared);
        }
    }

    /// Withdraws an endpoint that was taken out of its app.
    pub(super) fn withdraw_declared(&mut self, now: Instant, declared: &Declared) {
        let entity = declared.endpoint.entity;
        let changes = self
            .matchmaker
            .remove(Guid::new(self.config.prefix, entity));
        self.apply(changes);
        self.hide_endpoint(Guid::new(self.config.prefix, entity));
        let sequence = self.discovery.withdraw(now, entity);
        if let Some(sequence) = sequence {
            self.store(Record::Withdrawn { sequence, entity });
        }
        self.note_sample(entity, declared.sequence, sequence);
    }

    /// A sample about an endpoint of ours took the place of another.
    fn note_sample(
        &mut self,
        entity: EntityId,
        replaced: Option<SequenceNumber>,
        sequence: Option<SequenceNumber>,
    ) {
        let is_writer = entity.is_writer();
        if let Some(replaced) = replaced {
            self.forget(StoreKey::sample(is_writer, replaced));
        }
        if let Some(sequence) = sequence {
            let writer = if is_writer {
                EntityId::SEDP_PUBLICATIONS_WRITER
            } else {
                EntityId::SEDP_SUBSCRIPTIONS_WRITER
            };
            let next = sequence.next();
            self.store(Record::NextSequence { writer, next });
        }
    }

    /// Discovery asserts the AUTOMATIC writers of all apps with the shortest of their leases.
    pub(super) fn refresh_automatic_lease(&mut self, now: Instant) {
        let lease = self
            .apps
            .endpoints()
            .filter(|endpoint| {
                endpoint.entity.is_writer()
                    && endpoint.qos.liveliness.kind == LivelinessKind::Automatic
            })
            .filter_map(|endpoint| endpoint.qos.liveliness.lease.to_std())
            .min();
        self.discovery.set_automatic_lease(now, lease);
    }

    /// Shows an endpoint of an app to the apps' other endpoints and to the remote ones.
    pub(super) fn insert_endpoint(&mut self, endpoint: &Endpoint) {
        let changes = self.matchmaker.insert(RemoteEndpoint {
            guid: Guid::new(self.config.prefix, endpoint.entity),
            unicast: vec![self.config.loopback],
            addresses: Vec::new(),
            multicast: Vec::new(),
            expects_inline_qos: false,
            takes_bare_keys: false,
            qos: endpoint.qos.clone(),
            topic: endpoint.topic.clone(),
            type_name: endpoint.type_name.clone(),
            type_information: endpoint.type_information.clone(),
            content_filter: endpoint.content_filter.clone(),
        });
        self.apply(changes);
        self.show_endpoint(Guid::new(self.config.prefix, endpoint.entity));
    }

    /// An endpoint of an app as remote participants are to see it: reachable where its participant is.
    pub(super) fn data_of(&self, endpoint: &Endpoint) -> EndpointData {
        EndpointData {
            guid: Guid::new(self.config.prefix, endpoint.entity),
            topic: endpoint.topic.clone(),
            type_name: endpoint.type_name.clone(),
            type_information: endpoint.type_information.clone(),
            content_filter: endpoint.content_filter.clone(),
            unicast: Vec::new(),
            multicast: Vec::new(),
            expects_inline_qos: false,
            qos: endpoint.qos.clone(),
        }
    }
}
