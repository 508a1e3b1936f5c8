//! SPDPdiscoveredParticipantData: what a participant says of itself (RTPS 2.5 sections 8.5.3.2 and 9.6.3.1).

use std::net::SocketAddr;

use serde::{Deserialize, Serialize};

use super::parameters::{
    BUILTIN_ENDPOINT_QOS, BUILTIN_ENDPOINT_SET, DEFAULT_UNICAST_LOCATOR, DOMAIN_ID, DOMAIN_TAG,
    ENTITY_NAME, EXPECTS_INLINE_QOS, METATRAFFIC_MULTICAST_LOCATOR, METATRAFFIC_UNICAST_LOCATOR,
    PARTICIPANT_GUID, PARTICIPANT_LEASE_DURATION, PROTOCOL_VERSION_ID, VENDOR_ID, read_bool,
    read_locator, write_locators, write_string_parameter, write_version,
};
use crate::qos::parameters::{USER_DATA, read_octets, write_octets};
use crate::wire::{
    Cursor, Duration, EntityId, Guid, GuidPrefix, PROTOCOL_VERSION, Parameter, ParameterId,
    ParameterList, ParameterWriter, ProtocolVersion, VendorId, WireError,
};

/// Which built-in endpoints a participant has: BuiltinEndpointSet_t (RTPS table 9.6).
#[derive(Clone, Copy, Debug, Deserialize, Eq, PartialEq, Serialize)]
pub struct BuiltinEndpointSet(pub u32);

impl BuiltinEndpointSet {
    const PARTICIPANT_ANNOUNCER: u32 = 1;
    const PARTICIPANT_DETECTOR: u32 = 1 << 1;
    /// SEDPbuiltinPublicationsWriter.
    pub const PUBLICATIONS_ANNOUNCER: u32 = 1 << 2;
    /// SEDPbuiltinPublicationsReader.
    pub const PUBLICATIONS_DETECTOR: u32 = 1 << 3;
    /// SEDPbuiltinSubscriptionsWriter.
    pub const SUBSCRIPTIONS_ANNOUNCER: u32 = 1 << 4;
    /// SEDPbuiltinSubscriptionsReader.
    pub const SUBSCRIPTIONS_DETECTOR: u32 = 1 << 5;
    /// BuiltinParticipantMessageWriter.
    pub const PARTICIPANT_MESSAGE_WRITER: u32 = 1 << 10;
    /// BuiltinParticipantMessageReader.
    pub const PARTICIPANT_MESSAGE_READER: u32 = 1 << 11;
    /// TypeLookupServiceRequestDataWriter.
    pub const TYPE_LOOKUP_REQUEST_WRITER: u32 = 1 << 12;
    /// TypeLookupServiceRequestDataReader.
    pub const TYPE_LOOKUP_REQUEST_READER: u32 = 1 << 13;
    /// TypeLookupServiceReplyDataWriter.
    pub const TYPE_LOOKUP_REPLY_WRITER: u32 = 1 << 14;
    /// TypeLookupServiceReplyDataReader.
    pub const TYPE_LOOKUP_REPLY_READER: u32 = 1 << 15;

    /// What we have.
    pub const OURS: Self = Self(
        Self::PARTICIPANT_ANNOUNCER
            | Self::PARTICIPANT_DETECTOR
            | Self::PUBLICATIONS_ANNOUNCER
            | Self::PUBLICATIONS_DETECTOR
            | Self::SUBSCRIPTIONS_ANNOUNCER
            | Self::SUBSCRIPTIONS_DETECTOR
            | Self::PARTICIPANT_MESSAGE_WRITER
            | Self::PARTICIPANT_MESSAGE_READER
            | Self::TYPE_LOOKUP_REQUEST_WRITER
            | Self::TYPE_LOOKUP_REQUEST_READER
            | Self::TYPE_LOOKUP_REPLY_WRITER
            | Self::TYPE_LOOKUP_REPLY_READER,
    );

    /// Whether the endpoint with this bit is there.
    pub fn has(self, bit: u32) -> bool {
        self.0 & bit != 0
    }
}

/// What a participant says of itself.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct ParticipantData {
    /// The first part of the GUIDs of all its entities.
    pub prefix: GuidPrefix,
    /// The protocol that it speaks.
    pub version: ProtocolVersion,
    /// Whose implementation it is.
    pub vendor: VendorId,
    /// Its domain, where it says one.
    pub domain: Option<u32>,
    /// Participants with different tags ignore each other.
    pub domain_tag: String,
    /// A name for people.
    pub name: String,
    /// USER_DATA.
    pub user_data: Vec<u8>,
    /// Where it receives discovery traffic.
    pub metatraffic_unicast: Vec<SocketAddr>,
    /// Groups in which it receives discovery traffic.
    pub metatraffic_multicast: Vec<SocketAddr>,
    /// Where its endpoints receive that say nothing else.
    pub default_unicast: Vec<SocketAddr>,
    /// Its built-in endpoints.
    pub endpoints: BuiltinEndpointSet,
    /// Its BuiltinParticipantMessageReader is BEST_EFFORT (RTPS 8.4.13.3).
    pub best_effort_messages: bool,
    /// Its readers want inline QoS.
    pub expects_inline_qos: bool,
    /// How long after its last sign of life it counts as alive.
    pub lease: Duration,
}

/// Set in BuiltinEndpointQos_t where the participant-message reader is BEST_EFFORT.
const BEST_EFFORT_PARTICIPANT_MESSAGE_READER: u32 = 1;

impl ParticipantData {
    /// The default of PID_PARTICIPANT_LEASE_DURATION.
    const DEFAULT_LEASE: Duration = Duration {
        seconds: 100,
        fraction: 0,
    };

    /// A participant of ours, with all defaults.
    pub fn new(prefix: GuidPrefix) -> Self {
        Self {
            prefix,
            version: PROTOCOL_VERSION,
            vendor: VendorId::UNKNOWN,
            domain: None,
            domain_tag: String::new(),
            name: String::new(),
            user_data: Vec::new(),
            metatraffic_unicast: Vec::new(),
            metatraffic_multicast: Vec::new(),
            default_unicast: Vec::new(),
            endpoints: BuiltinEndpointSet::OURS,
            best_effort_messages: false,
            expects_inline_qos: false,
            lease: Self::DEFAULT_LEASE,
        }
    }

    /// Whether it may be Cyclone DDS 0.10, which has no choice but to say that it speaks RTPS 2.1; 11 speaks 2.5.
    pub fn is_cyclone_0_10(&self) -> bool {
        self.vendor == VendorId::CYCLONE_DDS && self.version < PROTOCOL_VERSION
    }

    /// Reads a serialized payload. Unknown parameters are skipped, unless they must be understood.
    pub fn decode(payload: &[u8]) -> Result<Self, WireError> {
        let list = ParameterList::from_payload(payload)?;
        let mut data = Self::new(decode_participant_key(&list)?);
        data.endpoints = BuiltinEndpointSet(0);
        for Parameter { id, mut value } in list.iter() {
            if !data.read(id, &mut value)? && id.must_understand() {
                return Err(WireError::InvalidParameterList);
            }
        }
        Ok(data)
    }

    fn read(&mut self, id: ParameterId, value: &mut Cursor<'_>) -> Result<bool, WireError> {
        match id {
            PARTICIPANT_GUID => {}
            PROTOCOL_VERSION_ID => {
                let [major, minor] = value.array()?;
                self.version = ProtocolVersion { major, minor };
            }
            VENDOR_ID => self.vendor = VendorId(value.array()?),
            DOMAIN_ID => self.domain = Some(value.u32()?),
            DOMAIN_TAG => self.domain_tag = value.string()?.to_owned(),
            ENTITY_NAME => self.name = value.string()?.to_owned(),
            USER_DATA => self.user_data = read_octets(value)?,
            METATRAFFIC_UNICAST_LOCATOR => read_locator(value, &mut self.metatraffic_unicast)?,
            METATRAFFIC_MULTICAST_LOCATOR => read_locator(value, &mut self.metatraffic_multicast)?,
            DEFAULT_UNICAST_LOCATOR => read_locator(value, &mut self.default_unicast)?,
            BUILTIN_ENDPOINT_SET => self.endpoints = BuiltinEndpointSet(value.u32()?),
            BUILTIN_ENDPOINT_QOS => {
                self.best_effort_messages =
                    value.u32()? & BEST_EFFORT_PARTICIPANT_MESSAGE_READER != 0;
            }
            EXPECTS_INLINE_QOS => self.expects_inline_qos = read_bool(value)?,
            PARTICIPANT_LEASE_DURATION => self.lease = Duration::decode(value)?,
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Whether both say the same but for the order of locators: a host on several networks names those first that
    /// can be reached on the network that it announces itself on.
    pub fn says_the_same(&self, other: &Self) -> bool {
        let sorted = |data: &Self| {
            let mut data = data.clone();
            data.metatraffic_unicast.sort_unstable();
            data.metatraffic_multicast.sort_unstable();
            data.default_unicast.sort_unstable();
            data
        };
        self == other || sorted(self) == sorted(other)
    }

    /// Appends the serialized payload, PL_CDR_LE.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let mut list = ParameterWriter::payload(out);
        write_version(&mut list);
        list.parameter(PARTICIPANT_GUID, |out| {
            out.extend_from_slice(&Guid::new(self.prefix, EntityId::PARTICIPANT).to_bytes());
        });
        write_locators(
            &mut list,
            METATRAFFIC_UNICAST_LOCATOR,
            &self.metatraffic_unicast,
        );
        write_locators(
            &mut list,
            METATRAFFIC_MULTICAST_LOCATOR,
            &self.metatraffic_multicast,
        );
        write_locators(&mut list, DEFAULT_UNICAST_LOCATOR, &self.default_unicast);
        list.parameter(PARTICIPANT_LEASE_DURATION, |out| self.lease.encode(out));
        list.parameter(BUILTIN_ENDPOINT_SET, |out| {
            out.extend_from_slice(&self.endpoints.0.to_le_bytes());
        });
        if let Some(domain) = self.domain {
            list.parameter(DOMAIN_ID, |out| {
                out.extend_from_slice(&domain.to_le_bytes())
            });
        }
        if !self.name.is_empty() {
            write_string_parameter(&mut list, ENTITY_NAME, &self.name);
        }
        write_octets(&mut list, USER_DATA, &self.user_data);
        list.finish();
    }
}

/// The participant that a sample of the built-in participant topic, or only its key, is about.
pub(super) fn decode_participant_key(list: &ParameterList<'_>) -> Result<GuidPrefix, WireError> {
    let mut guids = list
        .iter()
        .filter(|parameter| parameter.id == PARTICIPANT_GUID);
    let Parameter { mut value, .. } = guids.next().ok_or(WireError::InvalidParameterList)?;
    Ok(Guid::from_bytes(value.array()?).prefix)
}

/// Appends the key of a participant, for its disposal.
pub(super) fn encode_participant_key(prefix: GuidPrefix, out: &mut Vec<u8>) {
    let mut list = ParameterWriter::payload(out);
    list.parameter(PARTICIPANT_GUID, |out| {
        out.extend_from_slice(&Guid::new(prefix, EntityId::PARTICIPANT).to_bytes());
    });
    list.finish();
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::collection::vec;
    use proptest::prelude::*;

    fn addresses() -> impl Strategy<Value = Vec<SocketAddr>> {
        let v4 = (1..224_u8, any::<[u8; 3]>(), 1..=u16::MAX)
            .prop_map(|(a, [b, c, d], port)| SocketAddr::from(([a, b, c, d], port)));
        let v6 = (any::<[u16; 7]>(), 1..=u16::MAX).prop_map(|([b, c, d, e, f, g, h], port)| {
            SocketAddr::from(([0xfd00, b, c, d, e, f, g, h], port))
        });
        vec(prop_oneof![v4, v6], 0..4).prop_map(|mut list| {
            list.sort();
            list.dedup();
            list
        })
    }

    prop_compose! {
        fn participants()(
            prefix in any::<[u8; 12]>(),
            domain in proptest::option::of(any::<u32>()),
            name in ".{0,20}",
            metatraffic_unicast in addresses(),
            metatraffic_multicast in addresses(),
            default_unicast in addresses(),
            endpoints in any::<u32>(),
            seconds in any::<i32>(),
            fraction in any::<u32>(),
            user_data in vec(any::<u8>(), 0..9),
        ) -> ParticipantData {
            ParticipantData {
                domain,
                name: name.replace('\0', ""),
                metatraffic_unicast,
                metatraffic_multicast,
                default_unicast,
                endpoints: BuiltinEndpointSet(endpoints),
                lease: Duration { seconds, fraction },
                user_data,
                ..ParticipantData::new(GuidPrefix(prefix))
            }
        }
    }

    fn encoded(data: &ParticipantData) -> Vec<u8> {
        let mut bytes = Vec::new();
        data.encode(&mut bytes);
        bytes
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_again(data in participants()) {
            prop_assert_eq!(ParticipantData::decode(&encoded(&data)), Ok(data));
        }

        #[test]
        fn truncated_data_is_refused(data in participants()) {
            let bytes = encoded(&data);
            for length in 0..bytes.len() {
                prop_assert!(ParticipantData::decode(&bytes[..length]).is_err());
            }
        }

        #[test]
        fn garbage_is_survived(mut bytes in vec(any::<u8>(), 0..200), header in any::<bool>()) {
            if header && bytes.len() > 4 {
                bytes[..4].copy_from_slice(&[0, 3, 0, 0]);
            }
            let _ = ParticipantData::decode(&bytes);
        }
    }

    /// As they begin their announcements: 0.10.2 of Debian and 11.0.1 of PyPI.
    #[test]
    fn versions_of_cyclone_are_told_apart() {
        for (minor, expected) in [(1, true), (5, false)] {
            let mut bytes = vec![
                0, 3, 0, 0, 0x15, 0, 4, 0, 2, minor, 0, 0, 0x16, 0, 4, 0, 1, 16, 0, 0,
            ];
            bytes.extend_from_slice(&[0x50, 0, 16, 0]);
            bytes.extend_from_slice(&[7; 12]);
            bytes.extend_from_slice(&[0, 0, 1, 0xc1, 1, 0, 0, 0]);
            let data = ParticipantData::decode(&bytes).unwrap();
            assert_eq!(data.is_cyclone_0_10(), expected);
        }
        assert!(!ParticipantData::new(GuidPrefix([1; 12])).is_cyclone_0_10());
    }

    #[test]
    fn unknown_parameters() {
        let with = |id| {
            let mut bytes = encoded(&ParticipantData::new(GuidPrefix([1; 12])));
            bytes.truncate(bytes.len() - 4);
            let mut list = ParameterWriter::new(&mut bytes);
            list.parameter(ParameterId(id), |out| out.extend_from_slice(&[1, 2, 3, 4]));
            list.finish();
            ParticipantData::decode(&bytes).is_ok()
        };
        assert!(with(0x0666), "skipped");
        assert!(with(0x8666), "of a vendor: skipped");
        assert!(with(0xc666), "of a vendor: skipped");
        assert!(!with(0x4666), "must be understood");
    }

    #[test]
    fn big_endian_data_is_read() {
        let mut bytes = vec![0, 2, 0, 0, 0, 0x50, 0, 16];
        bytes.extend_from_slice(&[7; 12]);
        bytes.extend_from_slice(&EntityId::PARTICIPANT.0);
        bytes.extend_from_slice(&[0, 2, 0, 8, 0, 0, 0, 9, 0, 0, 0, 0, 0, 1, 0, 0]);
        let data = ParticipantData::decode(&bytes).unwrap();
        assert_eq!(data.prefix, GuidPrefix([7; 12]));
        assert_eq!(data.lease.seconds, 9);
    }

    #[test]
    fn lengths_that_lie_are_refused() {
        let mut bytes = vec![0, 3, 0, 0, 0x50, 0, 16, 0];
        bytes.extend_from_slice(&[7; 16]);
        for name in [
            &[0xff, 0xff, 0xff, 0xff, b'a', b'b', b'c', 0][..],
            &[4, 0, 0, 0, b'a', b'b', b'c', b'd'],
            &[0; 4],
        ] {
            let mut bytes = bytes.clone();
            let mut list = ParameterWriter::new(&mut bytes);
            list.parameter(ENTITY_NAME, |out| out.extend_from_slice(name));
            list.finish();
            assert_eq!(
                ParticipantData::decode(&bytes),
                Err(WireError::InvalidString)
            );
        }
    }
}
