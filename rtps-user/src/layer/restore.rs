//! Taking over from an earlier incarnation.

use std::time::Instant;

use super::apps::{App, Declared};
use super::store::Record;
use super::{Layer, StoreKey};

impl Layer {
    /// Takes over what an earlier incarnation wanted kept; before anything else. Apps then have
    /// [`resume_grace`](super::LayerConfig::resume_grace) to come back; meanwhile all looks to others as if nothing had
    /// happened. Records that an incompatible version has kept are skipped.
    pub fn restore(
        &mut self,
        now: Instant,
        records: impl IntoIterator<Item = (StoreKey, Vec<u8>)>,
    ) {
        self.outputs.clear();
        let mut records: Vec<_> = records.into_iter().collect();
        records.sort_by_key(|(key, _)| *key);
        for (key, value) in records {
            match Record::decode(&value) {
                Some(record) => self.restore_record(now, record),
                None => self.forget(key),
            }
        }
        self.apps.forget_old_news();
        self.store_announcement();
        self.restore_peers();
        self.refresh_automatic_lease(now);
        self.settle();
    }

    fn restore_record(&mut self, now: Instant, record: Record) {
        match record {
            Record::Announcement { sequence, payload } => {
                self.discovery.restore_announcement(sequence, &payload);
            }
            Record::App { slot, token, name } => {
                let mut app = App::new(name, token);
                app.backlog = Some(Vec::new());
                app.grace = Some(now + self.config.resume_grace);
                self.apps.insert(slot, app);
            }
            Record::Declared { sequence, endpoint } => {
                let data = self.data_of(&endpoint);
                self.discovery
                    .restore_endpoint_of_ours(now, sequence, &data);
                self.insert_endpoint(&endpoint);
                let entity = endpoint.entity;
                let declared = Declared {
                    endpoint: *endpoint,
                    sequence: Some(sequence),
                    is_confirmed: false,
                };
                match self.apps.get_mut(entity.slot()) {
                    Some(app) => {
                        app.endpoints.insert(entity, declared);
                    }
                    None => self.withdraw_declared(now, &declared),
                }
            }
            Record::Withdrawn { sequence, entity } => {
                self.discovery.restore_withdrawal(now, sequence, entity);
            }
            Record::NextSequence { writer, next } => {
                self.discovery.restore_sequence(writer, next);
            }
            Record::Participant {
                source,
                proven,
                data,
            } => {
                self.discovery
                    .restore_participant(now, source, proven, *data);
            }
            Record::Endpoint(data) => {
                let guid = data.guid;
                if self.discovery.restore_endpoint(*data)
                    && let Some(endpoint) = self.remote_endpoint(guid)
                {
                    let changes = self.matchmaker.insert(endpoint);
                    self.apply(changes);
                }
            }
            Record::Progress { writer, next } => self.discovery.restore_progress(writer, next),
        }
    }

    /// Withdraws what apps have not declared again in time.
    pub(super) fn end_grace(&mut self, now: Instant) {
        while let Some((slot, app)) = self.apps.end_grace(now) {
            if app.backlog.is_some() {
                tracing::info!(slot, name = %app.name, "an app did not come back after the restart");
                self.detach(now, slot);
                continue;
            }
            let endpoints = app.endpoints.iter();
            let gone: Vec<_> = endpoints
                .filter(|(_, declared)| !declared.is_confirmed)
                .map(|(entity, _)| *entity)
                .collect();
            for entity in gone {
                self.withdraw(now, entity);
            }
            self.refresh_automatic_lease(now);
        }
    }

    pub(super) fn store_announcement(&mut self) {
        let (sequence, payload) = self.discovery.announcement();
        let payload = payload.to_vec();
        self.store(Record::Announcement { sequence, payload });
        self.publish_announcement();
    }
}
