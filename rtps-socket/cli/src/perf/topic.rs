//! ddsperf's topics and types, as serialized samples.
//!
//! All types are final and have members of four-byte and one-byte alignment only, so that both versions of XCDR look
//! the same: `seq`, the key `keyval` but in OneULong, and the octets that make up the size, in KeyedSeq a sequence.

use std::sync::Arc;
use std::time::SystemTime;

use anyhow::{Result, ensure};
use clap::ValueEnum;
use rtps_socket::cdr::{ByteOrder, Encapsulation};
use rtps_socket::{Bytes, ChangeKind, InstanceOf, KeyHash, PayloadKind, RawChange};

/// The encapsulation header of little-endian CDR; its last byte says how many bytes of padding end the payload.
const HEADER: [u8; 4] = [0, 1, 0, 0];
/// Where `seq` is in a payload.
const SEQ: std::ops::Range<usize> = 4..8;
/// What the octets consist of.
const FILLING: u8 = 0xee;

/// A topic, by what its name ends with.
#[derive(Clone, Copy, Debug, Eq, PartialEq, ValueEnum)]
pub(crate) enum Topic {
    /// Number, key, sequence of octets.
    #[value(name = "KS")]
    KeyedSeq,
    /// Number, key, 24 octets.
    #[value(name = "K32")]
    Keyed32,
    /// Number, key, 248 octets.
    #[value(name = "K256")]
    Keyed256,
    /// Number.
    #[value(name = "OU")]
    OneULong,
}

/// What a sample says.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(crate) struct Contents {
    /// The sequence number.
    pub(crate) seq: u32,
    /// The key; 0 where the topic has none.
    pub(crate) key: u32,
    /// Bytes without encapsulation header.
    pub(crate) size: u32,
}

impl Topic {
    /// The end of the topic's name.
    pub(crate) fn suffix(self) -> &'static str {
        match self {
            Self::KeyedSeq => "KS",
            Self::Keyed32 => "K32",
            Self::Keyed256 => "K256",
            Self::OneULong => "OU",
        }
    }

    /// The registered name of the type.
    pub(crate) fn type_name(self) -> &'static str {
        match self {
            Self::KeyedSeq => "KeyedSeq",
            Self::Keyed32 => "Keyed32",
            Self::Keyed256 => "Keyed256",
            Self::OneULong => "OneULong",
        }
    }

    /// Whether there are instances.
    pub(crate) fn has_key(self) -> bool {
        self != Self::OneULong
    }

    /// The smallest size of a sample in bytes, which is the only one unless the topic has a sequence.
    fn least_size(self) -> u32 {
        match self {
            Self::KeyedSeq => 12,
            Self::Keyed32 => 32,
            Self::Keyed256 => 256,
            Self::OneULong => 4,
        }
    }

    /// Finds the instance of a payload.
    pub(crate) fn instance_of(self) -> Option<InstanceOf> {
        let of_payload: InstanceOf = Arc::new(move |kind, payload| {
            let at = match kind {
                PayloadKind::Data => 1,
                PayloadKind::Key => 0,
                PayloadKind::None => return None,
            };
            Words::new(payload)?.get(at).map(instance)
        });
        self.has_key().then_some(of_payload)
    }

    /// What a sample says; `None` if it is none of the topic's.
    pub(crate) fn read(self, payload: &[u8]) -> Option<Contents> {
        let words = Words::new(payload)?;
        let size = match self {
            Self::KeyedSeq => words.get(2)?.checked_add(self.least_size())?,
            Self::Keyed32 | Self::Keyed256 | Self::OneULong => self.least_size(),
        };
        let is_complete = words.data.len() >= usize::try_from(size).ok()?;
        is_complete.then_some(Contents {
            seq: words.get(0)?,
            key: if self.has_key() { words.get(1)? } else { 0 },
            size,
        })
    }
}

/// The 32-bit numbers that a sample begins with.
struct Words<'a> {
    data: &'a [u8],
    byte_order: ByteOrder,
}

impl<'a> Words<'a> {
    fn new(payload: &'a [u8]) -> Option<Self> {
        let (encapsulation, data) = Encapsulation::split(payload).ok()?;
        let byte_order = encapsulation.byte_order;
        Some(Self { data, byte_order })
    }

    fn get(&self, index: usize) -> Option<u32> {
        let bytes = self.data.get(4 * index..)?.first_chunk()?;
        Some(match self.byte_order {
            ByteOrder::Little => u32::from_le_bytes(*bytes),
            ByteOrder::Big => u32::from_be_bytes(*bytes),
        })
    }
}

/// The key hash: the key in big-endian CDR, filled up with zeros (RTPS 2.5 section 9.6.4.8).
fn instance(key: u32) -> KeyHash {
    let mut hash = [0; 16];
    hash[..4].copy_from_slice(&key.to_be_bytes());
    KeyHash(hash)
}

/// Samples that differ in nothing but their number.
#[derive(Debug)]
pub(crate) struct Template {
    payload: Vec<u8>,
    instance: KeyHash,
}

impl Template {
    /// Samples of `size` bytes; 0 is the smallest size.
    pub(crate) fn new(topic: Topic, size: u32, key: u32) -> Result<Self> {
        let least = topic.least_size();
        let size = if size == 0 { least } else { size };
        let is_possible = size == least || topic == Topic::KeyedSeq && size > least;
        ensure!(
            is_possible,
            "a sample of topic {} cannot have {size} bytes: only KS has another size than {least}",
            topic.suffix()
        );
        let mut payload = HEADER.to_vec();
        payload.extend(0_u32.to_le_bytes());
        if topic.has_key() {
            payload.extend(key.to_le_bytes());
        }
        if topic == Topic::KeyedSeq {
            payload.extend((size - least).to_le_bytes());
        }
        payload.resize(HEADER.len() + usize::try_from(size)?, FILLING);
        let padding = payload.len().next_multiple_of(4) - payload.len();
        payload.resize(payload.len() + padding, 0);
        payload[3] = u8::try_from(padding)?;
        let instance = if topic.has_key() {
            instance(key)
        } else {
            KeyHash::default()
        };
        Ok(Self { payload, instance })
    }

    /// The sample with this number.
    pub(crate) fn sample(&self, seq: u32, timestamp: SystemTime) -> RawChange {
        RawChange {
            kind: ChangeKind::Alive,
            instance: self.instance,
            payload: self.payload(seq),
            timestamp: Some(timestamp),
        }
    }

    fn payload(&self, seq: u32) -> Bytes {
        let mut payload = self.payload.clone();
        payload[SEQ].copy_from_slice(&seq.to_le_bytes());
        payload.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TOPICS: [Topic; 4] = [
        Topic::KeyedSeq,
        Topic::Keyed32,
        Topic::Keyed256,
        Topic::OneULong,
    ];

    #[test]
    fn what_is_written_is_read() {
        for topic in TOPICS {
            let template = Template::new(topic, 0, 7).unwrap();
            let contents = topic.read(&template.payload(9)).unwrap();
            let key = if topic.has_key() { 7 } else { 0 };
            let size = topic.least_size();
            assert_eq!(contents, Contents { seq: 9, key, size });
        }
    }

    #[test]
    fn a_sequence_of_any_length_is_padded() {
        for size in 12..20 {
            let template = Template::new(Topic::KeyedSeq, size, 0).unwrap();
            let sample = template.payload(1);
            assert_eq!(sample.len() % 4, 0);
            assert_eq!(Topic::KeyedSeq.read(&sample).unwrap().size, size);
        }
    }

    #[test]
    fn only_a_sequence_has_a_length_of_choice() {
        assert!(Template::new(Topic::KeyedSeq, 11, 0).is_err());
        assert!(Template::new(Topic::Keyed32, 33, 0).is_err());
        assert!(Template::new(Topic::Keyed32, 32, 0).is_ok());
        assert!(Template::new(Topic::OneULong, 12, 0).is_err());
    }

    #[test]
    fn the_instance_is_found_in_samples_and_keys_of_either_byte_order() {
        let instance_of = Topic::KeyedSeq.instance_of().unwrap();
        let template = Template::new(Topic::KeyedSeq, 40, 0x0102_0304).unwrap();
        let expected = Some(template.instance);
        assert_eq!(
            instance_of(PayloadKind::Data, &template.payload(5)),
            expected
        );
        let key = [0, 0, 0, 0, 1, 2, 3, 4];
        assert_eq!(instance_of(PayloadKind::Key, &key), expected);
        assert_eq!(instance_of(PayloadKind::None, &key), None);
        assert!(Topic::OneULong.instance_of().is_none());
    }

    #[test]
    fn what_is_too_short_or_lies_about_its_length_is_no_sample() {
        let sample = Template::new(Topic::KeyedSeq, 20, 0).unwrap().payload(1);
        assert_eq!(Topic::KeyedSeq.read(&sample[..sample.len() - 1]), None);
        assert_eq!(Topic::KeyedSeq.read(&sample[..10]), None);
        let mut lies = sample.to_vec();
        lies[12..16].fill(0xff);
        assert_eq!(Topic::KeyedSeq.read(&lies), None);
        assert_eq!(Topic::Keyed256.read(&sample), None);
        assert_eq!(Topic::OneULong.read(&[]), None);
    }
}
