//! What another has to know who answers readers in the writer's name, as the low-level layer does for the built-in
//! writers: the changes in the history as they are sent, and which numbers there are.

use super::Writer;
use crate::history::Entry;
use crate::wire::{EntityId, SequenceNumber, Timestamp};

/// Something to be told.
#[derive(Clone, Debug, Eq, PartialEq)]
pub enum Publication {
    /// A change.
    Change {
        /// Its number.
        sequence: SequenceNumber,
        /// Its source timestamp.
        timestamp: Timestamp,
        /// The DATA; empty where the change is sent in fragments.
        submessage: Vec<u8>,
    },
    /// A change is not there any more.
    Gone(SequenceNumber),
    /// What HEARTBEATs say, once all changes have been sent.
    Available {
        /// The first number; one above `last` without changes.
        first: SequenceNumber,
        /// The last number; 0 before the first change.
        last: SequenceNumber,
    },
}

/// What has been told.
#[derive(Debug, Default)]
pub(super) struct Publisher {
    available: Option<(SequenceNumber, SequenceNumber)>,
}

impl Writer {
    /// Tells from now on what happens to the history; before the first change.
    pub fn publish(&mut self) {
        self.history.keep_journal();
        self.publisher = Some(Publisher::default());
    }

    /// Whether [`poll_publication`](Self::poll_publication) has something to tell.
    pub fn has_publications(&self) -> bool {
        let has_moved = |publisher: &Publisher| publisher.available != Some(self.available());
        self.history.has_news() || self.publisher.as_ref().is_some_and(has_moved)
    }

    /// What has happened since the last call, changes first. DATAs are for `reader`.
    pub fn poll_publication(&mut self, reader: EntityId) -> Option<Publication> {
        while let Some(entry) = self.history.next_news() {
            let sequence = match entry {
                Entry::Inserted(sequence) => sequence,
                Entry::Removed(sequence) => return Some(Publication::Gone(sequence)),
            };
            if let Some(change) = self.history.get(sequence) {
                return Some(Publication::Change {
                    sequence,
                    timestamp: change.timestamp,
                    submessage: self.layout.submessage(reader, sequence, change),
                });
            }
        }
        let available = self.available();
        let publisher = self.publisher.as_mut()?;
        if publisher.available.replace(available) == Some(available) {
            return None;
        }
        let (first, last) = available;
        Some(Publication::Available { first, last })
    }

    fn available(&self) -> (SequenceNumber, SequenceNumber) {
        let first = self.history.first();
        (first.unwrap_or_else(|| self.last.next()), self.last)
    }
}

#[cfg(test)]
mod tests {
    use std::net::SocketAddr;
    use std::time::{Duration, Instant};

    use super::*;
    use crate::history::{ChangeKind, NewChange};
    use crate::qos::{Durability, Qos, Reliability};
    use crate::wire::{Guid, GuidPrefix, KeyHash, MessageReceiver, Submessage};
    use crate::writer::{WriterConfig, WriterTiming};
    use crate::{CountClock, RemoteEndpoint};

    const WRITER: EntityId = EntityId::SEDP_PUBLICATIONS_WRITER;
    const READER: EntityId = EntityId::SEDP_PUBLICATIONS_READER;

    fn qos() -> Qos {
        Qos {
            reliability: Reliability::RELIABLE,
            durability: Durability::TransientLocal,
            ..Qos::default()
        }
    }

    fn writer(now: Instant) -> Writer {
        let timing = WriterTiming {
            count_clock: Some(CountClock::new(now, Duration::from_secs(60))),
            ..WriterTiming::default()
        };
        let mut writer = Writer::new(WriterConfig {
            guid: Guid::new(GuidPrefix([1; 12]), WRITER),
            qos: qos(),
            datagram_size: 1472,
            timing,
        });
        writer.publish();
        writer
    }

    fn write(writer: &mut Writer, now: Instant, instance: u8, bytes: usize) {
        let change = NewChange {
            kind: ChangeKind::Alive,
            instance: KeyHash([instance; 16]),
            payload: vec![instance; bytes].into(),
            timestamp: Timestamp::default(),
        };
        writer.write(now, change).unwrap();
    }

    fn reader(number: u8) -> RemoteEndpoint {
        RemoteEndpoint {
            guid: Guid::new(GuidPrefix([100 + number; 12]), READER),
            unicast: vec![SocketAddr::from(([10, 0, 0, number], 7410))],
            addresses: Vec::new(),
            multicast: Vec::new(),
            expects_inline_qos: false,
            takes_bare_keys: false,
            qos: qos(),
            topic: String::new(),
            type_name: String::new(),
            type_information: Vec::new(),
            content_filter: None,
        }
    }

    /// Numbers of changes (0 without DATA), of what is gone, and ranges.
    fn told(writer: &mut Writer) -> Vec<String> {
        let mut told = Vec::new();
        while let Some(publication) = writer.poll_publication(READER) {
            told.push(match publication {
                Publication::Change {
                    sequence,
                    submessage,
                    ..
                } => format!("{} of {} bytes", sequence.0, submessage.len()),
                Publication::Gone(sequence) => format!("no {}", sequence.0),
                Publication::Available { first, last } => format!("{}..={}", first.0, last.0),
            });
            assert!(told.len() < 100);
        }
        assert!(!writer.has_publications());
        told
    }

    #[test]
    fn whatever_happens_to_the_history_is_told() {
        let now = Instant::now();
        let mut writer = writer(now);
        assert_eq!(told(&mut writer), ["1..=0"]);
        write(&mut writer, now, 1, 8);
        write(&mut writer, now, 2, 2000);
        assert!(writer.has_publications());
        assert_eq!(
            told(&mut writer),
            ["1 of 32 bytes", "2 of 0 bytes", "1..=2"]
        );
        write(&mut writer, now, 1, 8);
        assert_eq!(told(&mut writer), ["no 1", "3 of 32 bytes", "2..=3"]);
        write(&mut writer, now, 3, 8);
        writer.remove(SequenceNumber(4));
        assert_eq!(told(&mut writer), ["no 4", "2..=4"]);
        for sequence in [2, 3] {
            writer.remove(SequenceNumber(sequence));
        }
        assert_eq!(told(&mut writer), ["no 2", "no 3", "5..=4"]);
    }

    #[test]
    fn what_is_published_is_what_is_sent() {
        let now = Instant::now();
        let mut writer = writer(now);
        write(&mut writer, now, 1, 9);
        let Some(Publication::Change { submessage, .. }) = writer.poll_publication(READER) else {
            panic!("a change");
        };
        writer.match_reader(now, &reader(1));
        let acknack = crate::wire::AckNack {
            reader: READER,
            writer: WRITER,
            state: crate::wire::SequenceNumberSet::from_members(
                SequenceNumber(1),
                [SequenceNumber(1)],
            ),
            count: 1,
            is_final: true,
        };
        writer.handle_acknack(now, reader(1).guid, &acknack);
        let mut out = Vec::new();
        writer.poll_transmit(now, &mut out).unwrap();
        let sent = out.windows(submessage.len());
        assert_eq!(sent.filter(|bytes| *bytes == submessage).count(), 1);
    }

    /// The counts of the HEARTBEATs that are sent now.
    fn heartbeats(writer: &mut Writer, now: Instant) -> Vec<i32> {
        let mut counts = Vec::new();
        let mut out = Vec::new();
        while writer.poll_transmit(now, &mut out).is_some() {
            let received = MessageReceiver::new(GuidPrefix([101; 12]), &out).unwrap();
            counts.extend(
                received.filter_map(|received| match received.ok()?.submessage {
                    Submessage::Heartbeat(heartbeat) => Some(heartbeat.count),
                    _ => None,
                }),
            );
            out.clear();
        }
        counts
    }

    #[test]
    fn counts_of_heartbeats_do_not_run_ahead_of_the_time() {
        let now = Instant::now();
        let mut writer = writer(now);
        for number in 0..100 {
            writer.match_reader(now, &reader(number));
        }
        // Those to other readers are not read here.
        let greetings = heartbeats(&mut writer, now);
        let greeting = writer.greeting(now, reader(1).guid).count;
        assert_eq!(greetings, [greeting - 1]);
        let at_once = writer.greeting(now, reader(99).guid).count;
        assert_eq!(at_once, greeting, "each reader has its own");
        let later = now + Duration::from_secs(1);
        assert!(writer.greeting(later, reader(1).guid).count > greeting + 100);
    }

    #[test]
    fn whom_another_greets_the_writer_does_not() {
        let now = Instant::now();
        let mut writer = writer(now);
        write(&mut writer, now, 1, 8);
        writer.match_reader(now, &reader(1));
        let greeting = writer.greeting(now, reader(1).guid);
        assert_eq!((greeting.first.0, greeting.last.0), (1, 1));
        assert!(!greeting.is_final);
        assert!(heartbeats(&mut writer, now).is_empty());
    }

    #[test]
    fn what_another_has_seen_acknowledged_is_acknowledged() {
        let now = Instant::now();
        let mut writer = writer(now);
        write(&mut writer, now, 1, 8);
        for number in [1, 2] {
            writer.match_reader(now, &reader(number));
            writer.greeting(now, reader(number).guid);
        }
        assert_eq!(writer.lagging_readers().count(), 2);
        writer.acknowledge(now, reader(1).guid, SequenceNumber(2));
        let lagging: Vec<_> = writer.lagging_readers().collect();
        assert_eq!(lagging, [reader(2).guid]);
        assert!(!writer.all_acknowledged());
        writer.acknowledge(now, reader(2).guid, SequenceNumber(100));
        assert!(writer.all_acknowledged());
        assert_eq!(writer.poll_timeout(), None, "nobody is to be reminded");
        write(&mut writer, now, 2, 8);
        assert!(!writer.all_acknowledged(), "nobody can have that yet");
    }
}
