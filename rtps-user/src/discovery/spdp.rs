//! The simple participant discovery protocol (RTPS 2.5 section 8.5.3): announcing ourselves, and reading what
//! others announce.
//!
//! The built-in endpoints of SPDP are stateless and best effort, and every message of theirs has one sample, so
//! that they are written and read here without a history.

use std::collections::VecDeque;
use std::net::SocketAddr;
use std::time::{Duration, Instant};

use super::budget::Budget;
use super::participant_data::{decode_participant_key, encode_participant_key};
use super::{DiscoveryConfig, ParticipantData};
use crate::Transmit;
use crate::wire::{
    Data, EntityId, Guid, GuidPrefix, InlineQos, KeyHash, MessageWriter, ParameterList,
    PayloadKind, SequenceNumber, StatusInfo, Timestamp, WireError,
};

/// What a DATA of the built-in participant topic says.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum SpdpSample {
    /// A participant is there.
    Alive(Box<ParticipantData>),
    /// It has gone.
    Gone(GuidPrefix),
}

/// Reads a DATA of the participant `source`, which may only speak for itself. Vendors dispose a participant with its
/// key as payload, with the key hash alone, or with neither.
pub(super) fn read_spdp(source: GuidPrefix, data: &Data<'_>) -> Result<SpdpSample, WireError> {
    let (about, sample) = if data.inline_qos.status.is_alive() {
        let participant = ParticipantData::decode(data.payload)?;
        (participant.prefix, SpdpSample::Alive(Box::new(participant)))
    } else {
        let about = match (data.inline_qos.key_hash, data.kind) {
            (Some(KeyHash(key)), _) => Guid::from_bytes(key).prefix,
            (None, PayloadKind::None) => source,
            (None, _) => decode_participant_key(&ParameterList::from_payload(data.payload)?)?,
        };
        (about, SpdpSample::Gone(about))
    };
    if about == source {
        Ok(sample)
    } else {
        Err(WireError::InvalidData)
    }
}

/// A datagram to be sent as soon as the driver asks.
#[derive(Clone, Debug)]
enum Announcement {
    /// To everybody, now and then.
    Periodic,
    /// To a participant that was just discovered, so that it need not wait.
    Answer(GuidPrefix, SocketAddr),
    /// To everybody, at the end.
    Farewell,
}

/// Announces our participant.
#[derive(Debug)]
pub(super) struct Announcer {
    prefix: GuidPrefix,
    payload: Vec<u8>,
    sequence: SequenceNumber,
    timestamp: Timestamp,
    destinations: Vec<SocketAddr>,
    period: Duration,
    /// The time to the next announcement: short at first, until it is the period.
    pause: Duration,
    next: Option<Instant>,
    queue: VecDeque<Announcement>,
    budget: Budget,
}

impl Announcer {
    const FIRST_PAUSE: Duration = Duration::from_millis(100);
    /// Answers at once, and in a second: an announcement with an invented source makes us send one datagram there.
    const ANSWERS: u32 = 256;

    /// The first announcement is due at once.
    pub(super) fn new(config: &DiscoveryConfig, now: Instant) -> Self {
        let mut payload = Vec::new();
        config.participant.encode(&mut payload);
        let mut destinations: Vec<_> = config
            .multicast
            .iter()
            .chain(&config.peers)
            .copied()
            .collect();
        destinations.sort();
        destinations.dedup();
        Self {
            prefix: config.participant.prefix,
            payload,
            sequence: SequenceNumber(1),
            timestamp: config.started,
            destinations,
            period: config.announce_period,
            pause: Self::FIRST_PAUSE,
            next: Some(now),
            queue: VecDeque::new(),
            budget: Budget::new(now, Self::ANSWERS),
        }
    }

    /// The number and the bytes of what is announced.
    pub(super) fn announced(&self) -> (SequenceNumber, &[u8]) {
        (self.sequence, &self.payload)
    }

    /// An earlier incarnation has announced `payload` with the number `sequence`: what is the same keeps its number,
    /// and what has changed gets a greater one.
    pub(super) fn resume(&mut self, sequence: SequenceNumber, payload: &[u8]) {
        self.sequence = if payload == self.payload {
            sequence
        } else {
            sequence.next()
        };
    }

    /// Announces something else from now on: at once, and again soon, as in the beginning.
    pub(super) fn change(&mut self, now: Instant, participant: &ParticipantData) {
        self.payload.clear();
        participant.encode(&mut self.payload);
        self.sequence = self.sequence.next();
        self.pause = Self::FIRST_PAUSE;
        self.next = Some(now);
    }

    /// A participant was discovered, reachable there. Beyond the budget it has to wait for the next announcement.
    pub(super) fn answer(&mut self, now: Instant, participant: GuidPrefix, address: SocketAddr) {
        if self.budget.take(now) {
            self.queue
                .push_back(Announcement::Answer(participant, address));
        }
    }

    /// Says goodbye and falls silent.
    pub(super) fn leave(&mut self) {
        self.next = None;
        self.queue.clear();
        self.queue.push_back(Announcement::Farewell);
    }

    /// Queues the announcement that is due.
    pub(super) fn handle_timeout(&mut self, now: Instant) {
        if self.next.is_some_and(|next| next <= now) {
            self.queue.push_back(Announcement::Periodic);
            self.next = Some(now + self.pause);
            self.pause = (2 * self.pause).min(self.period);
        }
    }

    /// When the next announcement is due.
    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        self.next
    }

    /// Writes the next datagram, and says which participant it answers, if it does. `participants` are the addresses
    /// of those that multicast does not reach.
    pub(super) fn poll_transmit(
        &mut self,
        participants: impl Fn() -> Vec<SocketAddr>,
        out: &mut Vec<u8>,
    ) -> Option<(Transmit, Option<GuidPrefix>)> {
        loop {
            let announcement = self.queue.pop_front()?;
            let mut answered = None;
            let destinations = match announcement {
                Announcement::Answer(participant, address) => {
                    answered = Some(participant);
                    vec![address]
                }
                Announcement::Periodic | Announcement::Farewell => {
                    let mut all = participants();
                    all.retain(|address| !self.destinations.contains(address));
                    all.sort();
                    all.dedup();
                    all.extend(&self.destinations);
                    all
                }
            };
            if !destinations.is_empty() {
                self.write(&announcement, out);
                let destinations = destinations.into();
                return Some((
                    Transmit {
                        destinations,
                        dscp: 0,
                    },
                    answered,
                ));
            }
            if self.queue.is_empty() {
                return None;
            }
        }
    }

    /// What announces us, for one who does it in our name: INFO_TS and DATA.
    pub(super) fn submessages(&self) -> Vec<u8> {
        let mut out = Vec::new();
        let mut message = MessageWriter::resume(&mut out);
        message.info_timestamp(self.timestamp);
        message.data(&self.data());
        out
    }

    fn data(&self) -> Data<'_> {
        Data {
            reader: EntityId::UNKNOWN,
            writer: EntityId::SPDP_WRITER,
            sequence: self.sequence,
            inline_qos: InlineQos::default(),
            filters: None,
            kind: PayloadKind::Data,
            payload: &self.payload,
        }
    }

    fn write(&self, announcement: &Announcement, out: &mut Vec<u8>) {
        let mut message = MessageWriter::new(out, self.prefix);
        if let Announcement::Answer(participant, _) = announcement {
            message.info_destination(*participant);
        }
        message.info_timestamp(self.timestamp);
        let mut data = self.data();
        let mut key = Vec::new();
        if let Announcement::Farewell = announcement {
            encode_participant_key(self.prefix, &mut key);
            let guid = Guid::new(self.prefix, EntityId::PARTICIPANT);
            data.sequence = self.sequence.next();
            data.inline_qos.key_hash = Some(KeyHash(guid.to_bytes()));
            data.inline_qos.status = StatusInfo {
                disposed: true,
                unregistered: true,
                filtered: false,
            };
            data.kind = PayloadKind::Key;
            data.payload = &key;
        }
        message.data(&data);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const THEIRS: GuidPrefix = GuidPrefix([2; 12]);

    fn disposal<'a>(key_hash: Option<KeyHash>, kind: PayloadKind, payload: &'a [u8]) -> Data<'a> {
        Data {
            reader: EntityId::UNKNOWN,
            writer: EntityId::SPDP_WRITER,
            sequence: SequenceNumber(2),
            inline_qos: InlineQos {
                key_hash,
                status: StatusInfo {
                    disposed: true,
                    ..StatusInfo::default()
                },
                ..InlineQos::default()
            },
            filters: None,
            kind,
            payload,
        }
    }

    #[test]
    fn every_form_of_disposal_is_understood() {
        let guid = Guid::new(THEIRS, EntityId::PARTICIPANT);
        let hash = Some(KeyHash(guid.to_bytes()));
        let mut key = Vec::new();
        encode_participant_key(THEIRS, &mut key);
        let mut whole = Vec::new();
        ParticipantData::new(THEIRS).encode(&mut whole);
        for data in [
            disposal(hash, PayloadKind::None, &[]),
            disposal(hash, PayloadKind::Key, &key),
            disposal(None, PayloadKind::Key, &key),
            disposal(None, PayloadKind::Data, &whole),
            disposal(None, PayloadKind::None, &[]),
        ] {
            assert_eq!(read_spdp(THEIRS, &data), Ok(SpdpSample::Gone(THEIRS)));
        }
    }

    #[test]
    fn nobody_speaks_for_others() {
        let stranger = GuidPrefix([9; 12]);
        let mut payload = Vec::new();
        ParticipantData::new(THEIRS).encode(&mut payload);
        let mut data = disposal(None, PayloadKind::Data, &payload);
        assert!(read_spdp(stranger, &data).is_err());
        data.inline_qos.status = StatusInfo::default();
        assert!(read_spdp(stranger, &data).is_err());
        assert!(read_spdp(THEIRS, &data).is_ok());
    }
}
