//! The simple endpoint discovery protocol (RTPS 2.5 section 8.5.4): our endpoints as samples of the built-in
//! writers, and what a sample of a remote one says.

use std::collections::BTreeSet;
use std::time::Instant;

use super::EndpointData;
use super::endpoint_data::encode_endpoint_key;
use crate::endpoints::Endpoints;
use crate::history::{ChangeKind, NewChange};
use crate::reader::Sample;
use crate::wire::{EntityId, Guid, KeyHash, SequenceNumber, Timestamp, WireError};

/// What a sample of a built-in endpoint topic says.
#[derive(Debug, PartialEq)]
pub(super) enum SedpSample {
    /// An endpoint is there, or has changed.
    Alive(Box<EndpointData>),
    /// It has gone.
    Gone(Guid),
}

/// Reads a sample. A participant may only speak of its own endpoints, and of writers only in the topic of writers.
pub(super) fn read_sedp(sample: &Sample) -> Result<SedpSample, WireError> {
    let guid = Guid::from_bytes(sample.info.instance.0);
    let writer = sample.info.writer;
    let is_for_writers = writer.entity == EntityId::SEDP_PUBLICATIONS_WRITER;
    let fits = if is_for_writers {
        guid.entity.is_writer()
    } else {
        guid.entity.is_reader()
    };
    if guid.prefix != writer.prefix || !fits || guid.entity.is_builtin() {
        return Err(WireError::InvalidData);
    }
    if sample.info.valid_data {
        let data = EndpointData::decode(guid, &sample.payload)?;
        Ok(SedpSample::Alive(Box::new(data)))
    } else {
        Ok(SedpSample::Gone(guid))
    }
}

/// The built-in writer that announces an endpoint of ours.
pub(super) fn announcer_of(entity: EntityId) -> EntityId {
    if entity.is_writer() {
        EntityId::SEDP_PUBLICATIONS_WRITER
    } else {
        EntityId::SEDP_SUBSCRIPTIONS_WRITER
    }
}

/// Announces an endpoint of ours, or how it has changed. Gives the sample's number.
pub(super) fn announce(
    endpoints: &mut Endpoints,
    now: Instant,
    timestamp: Timestamp,
    data: &EndpointData,
) -> Option<SequenceNumber> {
    let mut payload = Vec::new();
    data.encode(&mut payload);
    let change = NewChange {
        kind: ChangeKind::Alive,
        instance: KeyHash(data.guid.to_bytes()),
        payload: payload.into(),
        timestamp,
    };
    write(endpoints, now, announcer_of(data.guid.entity), change)
}

/// Disposals that some participant may not have got yet.
#[derive(Debug, Default)]
pub(super) struct Withdrawals {
    /// Built-in writer and number.
    withdrawn: BTreeSet<(EntityId, SequenceNumber)>,
}

impl Withdrawals {
    /// Disposes the sample of an endpoint of ours. Gives the disposal's number.
    pub(super) fn withdraw(
        &mut self,
        endpoints: &mut Endpoints,
        now: Instant,
        timestamp: Timestamp,
        guid: Guid,
    ) -> Option<SequenceNumber> {
        let mut payload = Vec::new();
        encode_endpoint_key(guid, &mut payload);
        let change = NewChange {
            kind: ChangeKind::DisposedUnregistered,
            instance: KeyHash(guid.to_bytes()),
            payload: payload.into(),
            timestamp,
        };
        let announcer = announcer_of(guid.entity);
        let sequence = write(endpoints, now, announcer, change)?;
        self.withdrawn.insert((announcer, sequence));
        Some(sequence)
    }

    /// Forgets the disposals that everybody has got, as their writer does. Gives their numbers.
    pub(super) fn clean_up(
        &mut self,
        endpoints: &Endpoints,
        announcer: EntityId,
    ) -> Vec<SequenceNumber> {
        let Some(writer) = endpoints.writer(announcer) else {
            return Vec::new();
        };
        let done: Vec<_> = self
            .withdrawn
            .range((announcer, SequenceNumber::ZERO)..=(announcer, SequenceNumber(i64::MAX)))
            .map(|(_, sequence)| *sequence)
            .take_while(|sequence| writer.acknowledged_by_all(*sequence))
            .collect();
        for sequence in &done {
            self.withdrawn.remove(&(announcer, *sequence));
        }
        done
    }
}

/// Writes a sample of a built-in topic; these writers have no limits that could refuse it.
pub(super) fn write(
    endpoints: &mut Endpoints,
    now: Instant,
    writer: EntityId,
    change: NewChange,
) -> Option<SequenceNumber> {
    match endpoints.writer_mut(writer)?.write(now, change) {
        Ok(sequence) => Some(sequence),
        Err(error) => {
            tracing::error!(%writer, %error, "a discovery sample was not written");
            None
        }
    }
}
