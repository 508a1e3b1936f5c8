//! DiscoveredWriterData and DiscoveredReaderData: what SEDP says of an endpoint (RTPS 2.5 sections 8.5.4.4 and
//! 9.6.3.3).

use std::net::SocketAddr;

use serde::{Deserialize, Serialize};

use super::parameters::{
    ENDPOINT_GUID, EXPECTS_INLINE_QOS, MULTICAST_LOCATOR, TOPIC_NAME, TYPE_INFORMATION, TYPE_NAME,
    UNICAST_LOCATOR, read_bool, read_locator, write_locators, write_string_parameter,
    write_version,
};
use crate::qos::content_filter::CONTENT_FILTER_PROPERTY;
use crate::qos::parameters::{QosParameters, write_qos};
use crate::qos::{ContentFilter, Qos};
use crate::wire::{
    Cursor, Endianness, Guid, KeyHash, Parameter, ParameterId, ParameterList, ParameterWriter,
    WireError,
};

/// A writer or reader of some participant.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
pub struct EndpointData {
    /// Its name; the kind says whether it is a writer or a reader.
    pub guid: Guid,
    /// Its topic.
    pub topic: String,
    /// The name of its type.
    pub type_name: String,
    /// TypeInformation of its type as it is serialized (XTypes 1.3 section 7.6.3.2.1); empty where it says nothing.
    pub type_information: Vec<u8>,
    /// What a reader wants of its topic, if not all.
    pub content_filter: Option<ContentFilter>,
    /// Where it receives; where empty, at its participant's default addresses.
    pub unicast: Vec<SocketAddr>,
    /// Groups in which it receives.
    pub multicast: Vec<SocketAddr>,
    /// A reader that wants inline QoS.
    pub expects_inline_qos: bool,
    /// Its policies.
    pub qos: Qos,
}

impl EndpointData {
    /// Reads a serialized payload that is about `guid`, which may be missing in it where the key hash said it.
    /// Unknown parameters are skipped, unless they must be understood.
    pub fn decode(guid: Guid, payload: &[u8]) -> Result<Self, WireError> {
        let list = ParameterList::from_payload(payload)?;
        let mut data = Self {
            guid,
            topic: String::new(),
            type_name: String::new(),
            type_information: Vec::new(),
            content_filter: None,
            unicast: Vec::new(),
            multicast: Vec::new(),
            expects_inline_qos: false,
            qos: Qos::default(),
        };
        let mut qos = QosParameters::new(guid.entity.is_writer());
        for Parameter { id, mut value } in list.iter() {
            let known = data.read(id, &mut value)? || qos.read(id, &mut value)?;
            if !known && id.must_understand() {
                return Err(WireError::InvalidParameterList);
            }
        }
        data.qos = qos.finish();
        if data.guid != guid || data.topic.is_empty() {
            return Err(WireError::InvalidParameterList);
        }
        Ok(data)
    }

    fn read(&mut self, id: ParameterId, value: &mut Cursor<'_>) -> Result<bool, WireError> {
        match id {
            ENDPOINT_GUID => self.guid = Guid::from_bytes(value.array()?),
            TOPIC_NAME => self.topic = value.string()?.to_owned(),
            TYPE_NAME => self.type_name = value.string()?.to_owned(),
            // It is read, and told to others, in little endian only.
            TYPE_INFORMATION if value.endianness() == Endianness::Little => {
                self.type_information = value.rest().to_vec();
            }
            CONTENT_FILTER_PROPERTY => self.content_filter = Some(ContentFilter::read(value)?),
            UNICAST_LOCATOR => read_locator(value, &mut self.unicast)?,
            MULTICAST_LOCATOR => read_locator(value, &mut self.multicast)?,
            EXPECTS_INLINE_QOS => self.expects_inline_qos = read_bool(value)?,
            _ => return Ok(false),
        }
        Ok(true)
    }

    /// Appends the serialized payload, PL_CDR_LE.
    pub fn encode(&self, out: &mut Vec<u8>) {
        let mut list = ParameterWriter::payload(out);
        list.parameter(ENDPOINT_GUID, |out| {
            out.extend_from_slice(&self.guid.to_bytes())
        });
        write_version(&mut list);
        write_string_parameter(&mut list, TOPIC_NAME, &self.topic);
        write_string_parameter(&mut list, TYPE_NAME, &self.type_name);
        write_locators(&mut list, UNICAST_LOCATOR, &self.unicast);
        write_locators(&mut list, MULTICAST_LOCATOR, &self.multicast);
        if self.expects_inline_qos {
            list.parameter(EXPECTS_INLINE_QOS, |out| out.push(1));
        }
        if let Some(filter) = &self.content_filter {
            filter.write(&mut list);
        }
        write_type_information(&self.type_information, &mut list);
        write_qos(&self.qos, self.guid.entity.is_writer(), &mut list);
        list.finish();
    }
}

fn write_type_information(information: &[u8], list: &mut ParameterWriter<'_>) {
    if !information.is_empty() {
        list.parameter(TYPE_INFORMATION, |out| out.extend_from_slice(information));
    }
}

/// The instance of a sample of a built-in endpoint topic: the GUID of its endpoint, which fits a key hash as it is.
pub(super) fn endpoint_instance(payload: &[u8]) -> Option<KeyHash> {
    let list = ParameterList::from_payload(payload).ok()?;
    let mut guid = list
        .iter()
        .find(|parameter| parameter.id == ENDPOINT_GUID)?
        .value;
    guid.array().ok().map(KeyHash)
}

/// Appends the key of an endpoint, for its disposal.
pub(super) fn encode_endpoint_key(guid: Guid, out: &mut Vec<u8>) {
    let mut list = ParameterWriter::payload(out);
    list.parameter(ENDPOINT_GUID, |out| out.extend_from_slice(&guid.to_bytes()));
    list.finish();
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::qos::strategies;
    use crate::wire::{EntityId, EntityKind, GuidPrefix};
    use proptest::collection::vec;
    use proptest::option;
    use proptest::prelude::*;

    fn content_filter() -> impl Strategy<Value = ContentFilter> {
        let fields = ("[^\0]{0,9}", "[^\0]{0,40}", vec("[^\0]{0,9}", 0..4));
        fields.prop_map(|(name, expression, parameters)| ContentFilter {
            related_topic: format!("{name}?"),
            class: ContentFilter::SQL.to_owned(),
            name,
            expression,
            parameters,
        })
    }

    fn endpoints() -> impl Strategy<Value = EndpointData> {
        any::<bool>().prop_flat_map(|writer| {
            let kind = if writer {
                EntityKind::WriterNoKey
            } else {
                EntityKind::ReaderWithKey
            };
            let guid = Guid::new(GuidPrefix([3; 12]), EntityId::of_app(1, 2, kind));
            let fields = (
                "[^\0]{1,20}",
                "[^\0]{0,20}",
                vec(vec(any::<u8>(), 4), 0..9),
                option::of(content_filter()),
                any::<bool>(),
                strategies::qos(writer),
            );
            fields.prop_map(
                move |(topic, type_name, words, content_filter, expects_inline_qos, qos)| {
                    EndpointData {
                        guid,
                        topic,
                        type_name,
                        type_information: words.concat(),
                        content_filter,
                        unicast: vec![([10, 0, 0, 1], 7411).into()],
                        multicast: vec![([239, 255, 0, 2], 7401).into()],
                        expects_inline_qos,
                        qos,
                    }
                },
            )
        })
    }

    fn encoded(data: &EndpointData) -> Vec<u8> {
        let mut bytes = Vec::new();
        data.encode(&mut bytes);
        bytes
    }

    proptest! {
        #[test]
        fn what_is_written_is_read_again(data in endpoints()) {
            let bytes = encoded(&data);
            prop_assert_eq!(endpoint_instance(&bytes), Some(KeyHash(data.guid.to_bytes())));
            prop_assert_eq!(EndpointData::decode(data.guid, &bytes), Ok(data));
        }

        #[test]
        fn truncated_data_is_refused(data in endpoints()) {
            let bytes = encoded(&data);
            for length in 0..bytes.len() {
                prop_assert!(EndpointData::decode(data.guid, &bytes[..length]).is_err());
            }
        }

        #[test]
        fn flipped_bytes_are_survived(data in endpoints(), flips in vec((any::<usize>(), any::<u8>()), 1..8)) {
            let mut bytes = encoded(&data);
            let length = bytes.len();
            for (at, value) in flips {
                bytes[at % length] = value;
            }
            let _ = EndpointData::decode(data.guid, &bytes);
        }
    }

    #[test]
    fn data_about_another_endpoint_is_refused() {
        let guid = |serial| {
            let entity = EntityId::of_app(1, serial, EntityKind::WriterNoKey);
            Guid::new(GuidPrefix([3; 12]), entity)
        };
        let data = EndpointData {
            guid: guid(1),
            topic: "t".to_owned(),
            type_name: String::new(),
            type_information: Vec::new(),
            content_filter: None,
            unicast: Vec::new(),
            multicast: Vec::new(),
            expects_inline_qos: false,
            qos: Qos::default(),
        };
        assert!(EndpointData::decode(guid(1), &encoded(&data)).is_ok());
        assert!(EndpointData::decode(guid(2), &encoded(&data)).is_err());
    }
}
