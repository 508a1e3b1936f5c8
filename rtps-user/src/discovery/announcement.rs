//! An announcement of ours as it leaves through one of several interfaces: with that interface's addresses first.
//!
//! Some stacks (Cyclone DDS 0.10) send to the first address of an announcement, whichever network they are on. The
//! order is all that differs between the interfaces: what is announced, and its sequence number, stay the same.

use std::borrow::Cow;
use std::net::{IpAddr, SocketAddr};
use std::ops::Range;

use super::parameters::{DEFAULT_UNICAST_LOCATOR, METATRAFFIC_UNICAST_LOCATOR};
use crate::ipv6;
use crate::wire::{
    Cursor, Endianness, EntityId, HEADER_LEN, Locator, ParameterId, SubmessageKind, WireError,
};

/// The flags of a DATA with a whole sample and without inline QoS, little endian.
const WHOLE_SAMPLE: u8 = 0x05;
/// PL_CDR_LE.
const ENCAPSULATION: [u8; 4] = [0, 3, 0, 0];
const LOCATOR_LEN: usize = 24;

/// A datagram of ours as it leaves through the interface whose addresses `addresses` gives, which is asked only where
/// that matters.
pub fn for_interface<'a, 'i>(
    datagram: &'a [u8],
    addresses: impl FnOnce() -> Option<&'i [IpAddr]>,
) -> Cow<'a, [u8]> {
    let submessages = datagram.get(HEADER_LEN..).unwrap_or_default();
    if parameters(submessages).is_none() {
        return datagram.into();
    }
    let Some(addresses) = addresses() else {
        return datagram.into();
    };
    let mut datagram = datagram.to_vec();
    if let Some(submessages) = datagram.get_mut(HEADER_LEN..) {
        prefer_addresses(submessages, addresses);
    }
    datagram.into()
}

/// Has the announcement among these submessages of ours name the unicast locators with one of `addresses` before the
/// others, each kind apart; nothing else changes its place. Other messages stay as they are.
pub fn prefer_addresses(submessages: &mut [u8], addresses: &[IpAddr]) {
    let Some(list) = parameters(submessages).and_then(|at| submessages.get_mut(at)) else {
        return;
    };
    for id in [METATRAFFIC_UNICAST_LOCATOR, DEFAULT_UNICAST_LOCATOR] {
        let places = locators(list, id);
        let values = places.iter().filter_map(|at| list.get(at.clone()));
        let mut values: Vec<Vec<u8>> = values.map(<[u8]>::to_vec).collect();
        values.sort_by_key(|value| !is_one_of(value, addresses));
        for (at, value) in places.into_iter().zip(values) {
            if let Some(place) = list.get_mut(at) {
                place.copy_from_slice(&value);
            }
        }
    }
}

fn is_one_of(locator: &[u8], addresses: &[IpAddr]) -> bool {
    let locator = Locator::decode(&mut Cursor::new(locator, Endianness::Little));
    let address = locator.ok().and_then(Locator::to_socket_addr);
    address
        .map(|address| SocketAddr::ip(&address))
        .is_some_and(|ip| {
            let mut addresses = addresses.iter();
            addresses.any(|own| ipv6::without_interface(*own) == ip)
        })
}

/// Where the parameters of the announcement are, behind the encapsulation header.
fn parameters(submessages: &[u8]) -> Option<Range<usize>> {
    let mut cursor = Cursor::new(submessages, Endianness::Little);
    loop {
        let [kind, flags] = cursor.array().ok()?;
        let length = usize::from(cursor.u16().ok()?);
        let start = cursor.position();
        let body = cursor.take(length).ok()?;
        if (SubmessageKind(kind), flags) == (SubmessageKind::DATA, WHOLE_SAMPLE)
            && let Some(offset) = parameters_in_data(body)
        {
            return Some(start + offset..start + length);
        }
    }
}

fn parameters_in_data(body: &[u8]) -> Option<usize> {
    /// Entity ids and sequence number.
    const OCTETS_TO_PAYLOAD: u16 = 16;
    let mut cursor = Cursor::new(body, Endianness::Little);
    let [_extra_flags, to_payload] = [cursor.u16().ok()?, cursor.u16().ok()?];
    let [_reader, writer] = [cursor.array().ok()?, cursor.array().ok()?];
    let _sequence = cursor.take(8).ok()?;
    let is_announcement =
        EntityId(writer) == EntityId::SPDP_WRITER && to_payload == OCTETS_TO_PAYLOAD;
    (is_announcement && cursor.array() == Ok(ENCAPSULATION)).then(|| cursor.position())
}

/// Where the values of the locators of a kind are.
fn locators(list: &[u8], kind: ParameterId) -> Vec<Range<usize>> {
    let mut cursor = Cursor::new(list, Endianness::Little);
    let mut next = || -> Result<_, WireError> {
        let id = ParameterId(cursor.u16()?);
        let length = usize::from(cursor.u16()?);
        let start = cursor.position();
        cursor.take(length)?;
        Ok((id, start..start + length))
    };
    std::iter::from_fn(|| next().ok())
        .take_while(|(id, _)| *id != ParameterId::SENTINEL)
        .filter(|(id, value)| *id == kind && value.len() == LOCATOR_LEN)
        .map(|(_, value)| value)
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::ParticipantData;
    use super::*;
    use crate::wire::{
        Data, GuidPrefix, InlineQos, MessageWriter, PayloadKind, SequenceNumber, StatusInfo,
        Submessage, Submessages, Timestamp,
    };

    const PREFIX: GuidPrefix = GuidPrefix([7; 12]);

    fn locators_at(port: u16, ips: &[&str]) -> Vec<SocketAddr> {
        let ips = ips.iter().map(|ip| ip.parse().unwrap());
        ips.map(|ip| SocketAddr::new(ip, port)).collect()
    }

    fn participant(ips: &[&str]) -> ParticipantData {
        ParticipantData {
            domain: Some(3),
            name: "host".to_owned(),
            metatraffic_unicast: locators_at(7410, ips),
            metatraffic_multicast: locators_at(7400, &["239.255.0.1"]),
            default_unicast: locators_at(7411, ips),
            ..ParticipantData::new(PREFIX)
        }
    }

    fn message(writer: EntityId, inline_qos: InlineQos) -> Vec<u8> {
        let mut payload = Vec::new();
        participant(&["10.1.0.1", "10.2.0.1", "fd00::1", "fe80::2"]).encode(&mut payload);
        let mut out = Vec::new();
        let mut message = MessageWriter::new(&mut out, PREFIX);
        message.info_destination(GuidPrefix([9; 12]));
        message.info_timestamp(Timestamp::from_unix(std::time::Duration::from_secs(5)));
        message.data(&Data {
            reader: EntityId::UNKNOWN,
            writer,
            sequence: SequenceNumber(4),
            inline_qos,
            filters: None,
            kind: PayloadKind::Data,
            payload: &payload,
        });
        out
    }

    fn announcement() -> Vec<u8> {
        message(EntityId::SPDP_WRITER, InlineQos::default())
    }

    fn leaving(datagram: &[u8], addresses: &[&str]) -> Vec<u8> {
        let addresses: Vec<IpAddr> = addresses.iter().map(|ip| ip.parse().unwrap()).collect();
        for_interface(datagram, || Some(&addresses)).into_owned()
    }

    fn decoded(datagram: &[u8]) -> ParticipantData {
        let (_, submessages) = Submessages::parse(datagram).unwrap();
        let mut payloads = submessages.filter_map(|submessage| match submessage.unwrap() {
            Submessage::Data(data) => Some(ParticipantData::decode(data.payload).unwrap()),
            _ => None,
        });
        payloads.next().unwrap()
    }

    #[test]
    fn the_addresses_of_the_interface_come_first_and_the_others_keep_their_order() {
        let before = announcement();
        for (own, expected) in [
            (
                &["10.2.0.1"][..],
                ["10.2.0.1", "10.1.0.1", "fd00::1", "fe80::2"],
            ),
            (
                &["fe80:0:0:3::2", "fd00::1"],
                ["fd00::1", "fe80::2", "10.1.0.1", "10.2.0.1"],
            ),
            (
                &["10.9.0.1"],
                ["10.1.0.1", "10.2.0.1", "fd00::1", "fe80::2"],
            ),
        ] {
            let after = leaving(&before, own);
            assert_eq!(decoded(&after), participant(&expected), "{own:?}");
            assert_eq!(leaving(&after, own), after, "twice");
            assert!(decoded(&after).says_the_same(&decoded(&before)));
            let [mut bytes, mut others] = [after, before.clone()];
            bytes.sort_unstable();
            others.sort_unstable();
            assert_eq!(bytes, others);
        }
    }

    #[test]
    fn everything_else_stays_as_it_is() {
        let disposed = InlineQos {
            status: StatusInfo {
                disposed: true,
                ..StatusInfo::default()
            },
            ..InlineQos::default()
        };
        for message in [
            message(EntityId::SPDP_WRITER, disposed),
            message(EntityId::SEDP_PUBLICATIONS_WRITER, InlineQos::default()),
        ] {
            let same = for_interface(&message, || panic!("nobody need know"));
            assert!(matches!(same, Cow::Borrowed(same) if same == message));
        }
        let announcement = announcement();
        let unknown = for_interface(&announcement, || None);
        assert_eq!(unknown, announcement);
    }

    #[test]
    fn what_is_cut_off_is_survived() {
        let announcement = announcement();
        for length in 0..announcement.len() {
            let short = &announcement[..length];
            assert_eq!(leaving(short, &["10.2.0.1"]), short, "{length}");
            let mut broken = announcement.clone();
            broken[length] = !broken[length];
            assert_eq!(leaving(&broken, &["10.2.0.1"]).len(), broken.len());
        }
    }
}
