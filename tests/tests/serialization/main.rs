//! Any values, serialized here, are read by other vendors' serializers, which write the same bytes of them.
//!
//! Cyclone DDS 0.10 writes XCDR1 for final types, and XCDR2; Fast-CDR 1 knows XCDR1. What Fast-CDR 2 writes, and where it
//! differs, is in `cdr/tests/samples.rs` of rtps-socket: the size of a mutable type's member may be that of the nested
//! type (length code 5) or stand before it (4).

mod types;

use std::cell::RefCell;
use std::io::{Read, Write};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use anyhow::{Context, Result};
use proptest::prelude::*;
use proptest::test_runner::{Config, TestRunner};
use rtps_socket::cdr::{
    ByteOrder, DdsType, Encapsulation, Encoder, Representation, Scope, from_payload, key_hash,
    key_payload,
};
use rtps_tests::peers::{self, Peer};
use rtps_tests::{require, skip_unless};

/// What is wanted of a codec; the values are its protocol's.
#[derive(Clone, Copy)]
enum Wanted {
    Sample = 0,
    Key = 1,
    BigEndianKey = 2,
}

/// A vendor's serializer, running.
struct Codec {
    child: Child,
    requests: ChildStdin,
    answers: ChildStdout,
}

impl Codec {
    fn start(peer: &Peer) -> Result<Self> {
        let mut child = Command::new(peer.program())
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()?;
        Ok(Self {
            requests: child.stdin.take().context("no standard input")?,
            answers: child.stdout.take().context("no standard output")?,
            child,
        })
    }

    /// What it makes of a sample; `None` where it is none for it.
    fn convert(
        &mut self,
        number: u8,
        (representation, byte_order): (Representation, ByteOrder),
        wanted: Wanted,
        sample: &[u8],
    ) -> Result<Option<Vec<u8>>> {
        let version = match representation {
            Representation::Xcdr1 => 1,
            Representation::Xcdr2 => 2,
        };
        let big_endian = u8::from(byte_order == ByteOrder::Big);
        let mut request = vec![number, version, big_endian, wanted as u8];
        request.extend(u32::try_from(sample.len())?.to_le_bytes());
        request.extend(sample);
        self.requests.write_all(&request)?;
        let mut size = [0; 4];
        self.answers.read_exact(&mut size)?;
        if size == [0xff; 4] {
            return Ok(None);
        }
        let mut answer = vec![0; usize::try_from(u32::from_le_bytes(size))?];
        self.answers.read_exact(&mut answer)?;
        Ok(Some(answer))
    }
}

impl Drop for Codec {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A type as a codec knows it.
struct Meeting {
    codec: RefCell<Codec>,
    number: u8,
    representations: &'static [Representation],
}

const XCDR1: &[Representation] = &[Representation::Xcdr1];
const XCDR2: &[Representation] = &[Representation::Xcdr2];
const BOTH: &[Representation] = &[Representation::Xcdr1, Representation::Xcdr2];

impl Meeting {
    fn with(peer: &Peer, number: u8, representations: &'static [Representation]) -> Result<Self> {
        let codec = RefCell::new(Codec::start(peer)?);
        Ok(Self {
            codec,
            number,
            representations,
        })
    }

    fn convert(
        &self,
        form: (Representation, ByteOrder),
        wanted: Wanted,
        sample: &[u8],
    ) -> Option<Vec<u8>> {
        let mut codec = self.codec.borrow_mut();
        let answer = codec.convert(self.number, form, wanted, sample);
        answer.expect("the codec runs")
    }

    /// Its samples are ours, byte for byte, in both byte orders.
    fn samples<T: DdsType + PartialEq + std::fmt::Debug>(
        &self,
        values: impl Strategy<Value = T>,
    ) -> Result<()> {
        self.each(values, |value, representation| {
            for byte_order in [ByteOrder::Little, ByteOrder::Big] {
                let form = (representation, byte_order);
                let sample = serialized(value, form);
                let theirs = self.convert(form, Wanted::Sample, &sample);
                prop_assert_eq!(theirs.as_ref(), Some(&sample));
                let payload = [encapsulation::<T>(form).to_vec(), sample].concat();
                let read = from_payload::<T>(&payload);
                prop_assert_eq!(read.as_ref(), Ok(value));
            }
            Ok(())
        })
    }

    /// So are its serialized keys and key hashes.
    fn keys<T: DdsType + std::fmt::Debug>(
        &self,
        values: impl Strategy<Value = T>,
        is_hashed: bool,
    ) -> Result<()> {
        self.each(values, |value, representation| {
            let form = (representation, ByteOrder::Little);
            let sample = serialized(value, form);
            let mut payload = Vec::new();
            key_payload(value, representation, &mut payload).expect("the key can be encoded");
            let theirs = self.convert(form, Wanted::Key, &sample).unwrap_or_default();
            prop_assert!(payload[4..].starts_with(&theirs), "{:?}", theirs);
            prop_assert!(payload[4 + theirs.len()..].iter().all(|byte| *byte == 0));
            self.same_hash(value, representation, is_hashed)
        })
    }

    /// So are its key hashes, where serialized keys differ: Cyclone DDS 0.10 has them without DHEADERs.
    fn key_hashes<T: DdsType + std::fmt::Debug>(
        &self,
        values: impl Strategy<Value = T>,
    ) -> Result<()> {
        self.each(values, |value, representation| {
            self.same_hash(value, representation, false)
        })
    }

    fn same_hash<T: DdsType>(
        &self,
        value: &T,
        representation: Representation,
        is_hashed: bool,
    ) -> Result<(), TestCaseError> {
        let form = (representation, ByteOrder::Little);
        let sample = serialized(value, form);
        let theirs = self.convert(form, Wanted::BigEndianKey, &sample);
        let mut key = Vec::new();
        let hash = key_hash(value, representation, &mut key).expect("the key can be encoded");
        prop_assert_eq!(theirs.as_ref(), Some(&key));
        if !is_hashed {
            prop_assert_eq!(&hash[..key.len()], &key);
        }
        Ok(())
    }

    fn each<T: std::fmt::Debug>(
        &self,
        values: impl Strategy<Value = T>,
        check: impl Fn(&T, Representation) -> Result<(), TestCaseError>,
    ) -> Result<()> {
        let mut runner = TestRunner::new(Config {
            failure_persistence: None,
            ..Config::default()
        });
        runner
            .run(&values, |value| {
                let mut representations = self.representations.iter();
                representations.try_for_each(|representation| check(&value, *representation))
            })
            .map_err(|error| anyhow::anyhow!("{error}"))
    }
}

/// Without encapsulation and the padding at the end.
fn serialized<T: DdsType>(value: &T, form: (Representation, ByteOrder)) -> Vec<u8> {
    let mut out = Vec::new();
    let mut encoder = Encoder::new(&mut out, form.0, form.1, Scope::Sample);
    value
        .encode(&mut encoder)
        .expect("the value can be encoded");
    out
}

fn encapsulation<T: DdsType>((representation, byte_order): (Representation, ByteOrder)) -> [u8; 4] {
    let encapsulation = Encapsulation {
        representation,
        extensibility: T::EXTENSIBILITY,
        byte_order,
    };
    let [high, low] = encapsulation.id().to_be_bytes();
    [high, low, 0, 0]
}

#[test]
fn samples_of_cyclone() -> Result<()> {
    skip_unless!(require::root());
    let cyclone = peers::cyclone_codec()?;
    Meeting::with(&cyclone, 0, BOTH)?.samples(types::any_plain())?;
    Meeting::with(&cyclone, 1, XCDR2)?.samples(types::any_extensible())?;
    Meeting::with(&cyclone, 2, XCDR2)?.samples(types::any_changing())
}

#[test]
fn keys_of_cyclone() -> Result<()> {
    skip_unless!(require::root());
    let cyclone = peers::cyclone_codec()?;
    Meeting::with(&cyclone, 0, BOTH)?.keys(types::any_plain(), false)?;
    Meeting::with(&cyclone, 2, XCDR2)?.key_hashes(types::any_changing())?;
    Meeting::with(&cyclone, 3, BOTH)?.keys(types::any_located(), false)?;
    Meeting::with(&cyclone, 4, BOTH)?.keys(types::any_named(), true)
}

#[test]
fn samples_of_fast_cdr() -> Result<()> {
    skip_unless!(require::root());
    let fast_cdr = peers::fast_cdr_codec()?;
    Meeting::with(&fast_cdr, 0, XCDR1)?.samples(types::any_plain())?;
    Meeting::with(&fast_cdr, 5, XCDR1)?.samples(types::any_collections())
}

#[test]
fn keys_of_fast_cdr() -> Result<()> {
    skip_unless!(require::root());
    let fast_cdr = peers::fast_cdr_codec()?;
    Meeting::with(&fast_cdr, 0, XCDR1)?.keys(types::any_plain(), false)?;
    Meeting::with(&fast_cdr, 3, XCDR1)?.keys(types::any_located(), false)?;
    Meeting::with(&fast_cdr, 4, XCDR1)?.keys(types::any_named(), true)
}
