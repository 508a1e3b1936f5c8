//! The samples: octets that begin with a number, the cheapest there is to serialize.

use std::convert::Infallible;

use bytes::Bytes;
use rustdds::RepresentationIdentifier;
use rustdds::no_key::{Decode, DefaultDecoder, DeserializerAdapter, SerializerAdapter};

const NUMBER: usize = size_of::<u64>();

/// See the module.
pub struct Octets(Bytes);

impl Octets {
    /// A sample of so many bytes, but not less than its number.
    pub fn numbered(size: usize, number: u64) -> Self {
        let mut octets = vec![0; size.max(NUMBER)];
        octets[..NUMBER].copy_from_slice(&number.to_le_bytes());
        Self(octets.into())
    }

    /// Its number.
    pub fn number(&self) -> u64 {
        self.0
            .first_chunk()
            .map_or(u64::MAX, |number| u64::from_le_bytes(*number))
    }

    /// Its size in bytes.
    pub fn len(&self) -> usize {
        self.0.len()
    }
}

/// What RustDDS wants to know of them.
pub struct OctetsAdapter;

/// Copies.
#[derive(Clone)]
pub struct OctetsDecoder;

impl SerializerAdapter<Octets> for OctetsAdapter {
    type Error = Infallible;

    fn output_encoding() -> RepresentationIdentifier {
        RepresentationIdentifier::CDR_LE
    }

    fn to_bytes(value: &Octets) -> Result<Bytes, Infallible> {
        Ok(value.0.clone())
    }
}

impl DeserializerAdapter<Octets> for OctetsAdapter {
    type Error = Infallible;
    type Decoded = Octets;

    fn supported_encodings() -> &'static [RepresentationIdentifier] {
        &[RepresentationIdentifier::CDR_LE]
    }

    fn transform_decoded(decoded: Octets) -> Octets {
        decoded
    }
}

impl DefaultDecoder<Octets> for OctetsAdapter {
    type Decoder = OctetsDecoder;
    const DECODER: OctetsDecoder = OctetsDecoder;
}

impl Decode<'_, Octets> for OctetsDecoder {
    type Error = Infallible;

    fn decode_bytes(
        self,
        input: &[u8],
        _encoding: RepresentationIdentifier,
    ) -> Result<Octets, Infallible> {
        Ok(Octets(Bytes::copy_from_slice(input)))
    }
}
