//! The answers of the low-level layer and those of the layer itself, byte for byte but for counts.

use std::net::SocketAddr;
use std::time::{Duration, Instant};

use rtps_ebpf::SlotSet;

use super::kernel::Kernel;
use super::sim::{config, endpoint, hello, prefix};
use super::{READER, WRITER};
use crate::discovery::ParticipantData;
use crate::layer::protocol::ToLayer;
use crate::layer::{KernelChange, Layer, LayerConfig, LayerOutput};
use crate::wire::{
    AckNack, Data, EntityId, Guid, GuidPrefix, HEADER_LEN, Heartbeat, InlineQos, MessageWriter,
    PayloadKind, SUBMESSAGE_HEADER_LEN, SequenceNumber, SequenceNumberSet, SubmessageKind,
};

const THEIRS: GuidPrefix = GuidPrefix([0x99; 12]);

fn address() -> SocketAddr {
    ([10, 9, 9, 9], 7410).into()
}

/// Datagrams, and where they go.
type Sent = Vec<(SocketAddr, Vec<u8>)>;

/// A layer that answers by itself, one that has a low-level layer do it, both with the same knowledge, and a remote
/// participant.
struct Pair {
    now: Instant,
    alone: Layer,
    layer: Layer,
    kernel: Kernel,
    requests: u32,
    acknacks: i32,
    heartbeats: i32,
}

/// Of the only app.
const SLOT: u8 = 1;

impl Pair {
    /// With so many writers and readers, of which those with these serial numbers were withdrawn.
    fn new(endpoints: u16, withdrawn: &[u16]) -> Self {
        let now = Instant::now();
        let alone = config(1);
        let config = LayerConfig {
            kernel_discovery: true,
            ..alone.clone()
        };
        let mut pair = Self {
            now,
            kernel: Kernel::new(config.prefix, now),
            alone: Layer::new(alone, now),
            layer: Layer::new(config, now),
            requests: 0,
            acknacks: 0,
            heartbeats: 0,
        };
        for layer in [&mut pair.alone, &mut pair.layer] {
            let attached = layer.attach(now, &hello(), [1; 16], &SlotSet::EMPTY);
            assert_eq!(attached.unwrap().slot, SLOT);
        }
        for kind in [WRITER, READER] {
            for serial in 1..=endpoints {
                let declared = endpoint(SLOT, serial, kind);
                pair.request(ToLayer::Declare(Box::new(declared)));
            }
            for serial in withdrawn {
                let entity = EntityId::of_app(SLOT, *serial, kind);
                pair.request(ToLayer::Withdraw(entity));
            }
        }
        pair
    }

    fn request(&mut self, request: ToLayer) {
        self.alone.handle_request(self.now, SLOT, request.clone());
        self.layer.handle_request(self.now, SLOT, request);
        self.drain();
        // Some have the same timestamp.
        self.requests += 1;
        if self.requests.is_multiple_of(3) {
            self.now += Duration::from_millis(1);
        }
    }

    /// The same with a remote participant that is known and proven.
    fn proven(endpoints: u16, withdrawn: &[u16]) -> Self {
        let mut pair = Self::new(endpoints, withdrawn);
        pair.prove();
        pair
    }

    fn prove(&mut self) {
        self.answers(&announcement());
        let proof = self.acknack(EntityId::SEDP_SUBSCRIPTIONS_READER, 1, &[], true);
        self.answers(&proof);
        assert!(self.kernel.peers.contains_key(&THEIRS));
    }

    /// Does what the layers want; gives what that sends which is alone.
    fn drain(&mut self) -> Sent {
        let mut sent = Vec::new();
        let mut out = Vec::new();
        while let Some(output) = self.layer.poll_output(self.now, &mut out) {
            if let LayerOutput::Kernel(change) = output {
                self.kernel.apply(change);
            }
        }
        while let Some(output) = self.alone.poll_output(self.now, &mut out) {
            if let LayerOutput::Transmit(transmit) = output {
                sent.extend(transmit.destinations.iter().map(|to| (*to, out.clone())));
            }
        }
        sent
    }

    fn pass(&mut self, time: Duration) {
        self.now += time;
        self.alone.handle_timeout(self.now);
        self.layer.handle_timeout(self.now);
        self.drain();
    }

    /// What the low-level layer answers, and what the layer does that is alone.
    fn answers(&mut self, message: &[u8]) -> (Sent, Sent) {
        // Long enough for whatever was sent or asked for before.
        self.pass(Duration::from_secs(1));
        let by_kernel = self.kernel.receive(self.now, address(), message);
        while let Some(news) = self.kernel.news.pop_front() {
            assert!(news.is_answered);
            self.layer
                .handle_answered(self.now, news.source, &news.message)
                .unwrap();
        }
        self.alone
            .handle_datagram(self.now, address(), message)
            .unwrap();
        let by_layer = self.drain();
        (masked(by_kernel), masked(by_layer))
    }

    fn acknack(&mut self, reader: EntityId, base: i64, asked: &[i64], is_final: bool) -> Vec<u8> {
        let mut bytes = directed();
        self.acknacks += 1;
        let members = asked.iter().copied().map(SequenceNumber);
        MessageWriter::resume(&mut bytes).acknack(&AckNack {
            reader,
            writer: writer_of(reader),
            state: SequenceNumberSet::from_members(SequenceNumber(base), members),
            count: self.acknacks,
            is_final,
        });
        bytes
    }

    fn heartbeat(&mut self, writer: EntityId, first: i64, last: i64, is_final: bool) -> Vec<u8> {
        let mut bytes = directed();
        self.add_heartbeat(&mut bytes, writer, first, last, is_final);
        bytes
    }

    fn add_heartbeat(
        &mut self,
        bytes: &mut Vec<u8>,
        writer: EntityId,
        first: i64,
        last: i64,
        is_final: bool,
    ) {
        self.heartbeats += 1;
        MessageWriter::resume(bytes).heartbeat(&Heartbeat {
            reader: EntityId::UNKNOWN,
            writer,
            first: SequenceNumber(first),
            last: SequenceNumber(last),
            count: self.heartbeats,
            is_final,
            liveliness: false,
            group: None,
        });
    }
}

const TOPICS: [(EntityId, EntityId); 3] = [
    (
        EntityId::SEDP_PUBLICATIONS_WRITER,
        EntityId::SEDP_PUBLICATIONS_READER,
    ),
    (
        EntityId::SEDP_SUBSCRIPTIONS_WRITER,
        EntityId::SEDP_SUBSCRIPTIONS_READER,
    ),
    (
        EntityId::PARTICIPANT_MESSAGE_WRITER,
        EntityId::PARTICIPANT_MESSAGE_READER,
    ),
];

fn writer_of(reader: EntityId) -> EntityId {
    let topic = TOPICS.iter().find(|(_, of_topic)| *of_topic == reader);
    topic.unwrap().0
}

/// A message of the remote participant to us.
fn directed() -> Vec<u8> {
    let mut bytes = Vec::new();
    MessageWriter::new(&mut bytes, THEIRS).info_destination(prefix(1));
    bytes
}

fn data(writer: EntityId, payload: &[u8], bytes: &mut Vec<u8>) {
    MessageWriter::resume(bytes).data(&Data {
        reader: EntityId::UNKNOWN,
        writer,
        sequence: SequenceNumber(1),
        inline_qos: InlineQos::default(),
        filters: None,
        kind: PayloadKind::Data,
        payload,
    });
}

fn announcement() -> Vec<u8> {
    let mut data_of = ParticipantData::new(THEIRS);
    data_of.metatraffic_unicast = vec![address()];
    let mut payload = Vec::new();
    data_of.encode(&mut payload);
    let mut bytes = Vec::new();
    MessageWriter::new(&mut bytes, THEIRS);
    data(EntityId::SPDP_WRITER, &payload, &mut bytes);
    bytes
}

/// The submessages of a datagram: kinds and positions.
fn submessages(datagram: &[u8]) -> Vec<(SubmessageKind, std::ops::Range<usize>)> {
    let mut found = Vec::new();
    let mut at = HEADER_LEN;
    while let Some([kind, _, low, high]) = datagram.get(at..at + SUBMESSAGE_HEADER_LEN) {
        let start = at + SUBMESSAGE_HEADER_LEN;
        at = start + usize::from(u16::from_le_bytes([*low, *high]));
        found.push((SubmessageKind(*kind), start..at));
    }
    assert_eq!(at, datagram.len());
    found
}

/// Sets the counts of HEARTBEATs and ACKNACKs to zero: the last field of both.
fn masked(mut sent: Sent) -> Sent {
    for (_, datagram) in &mut sent {
        for (kind, range) in submessages(datagram) {
            if kind == SubmessageKind::HEARTBEAT || kind == SubmessageKind::ACKNACK {
                datagram[range.end - 4..range.end].fill(0);
            }
        }
    }
    sent
}

/// What is said, however it is spread over datagrams.
fn said(sent: &Sent) -> Vec<(SocketAddr, Vec<u8>)> {
    let mut said = Vec::new();
    for (to, datagram) in sent {
        for (kind, range) in submessages(datagram) {
            let is_context = kind == SubmessageKind::INFO_DST || kind == SubmessageKind::INFO_TS;
            if !is_context {
                let start = range.start - SUBMESSAGE_HEADER_LEN;
                said.push((*to, datagram[start..range.end].to_vec()));
            }
        }
    }
    said
}

fn kinds(sent: &Sent) -> Vec<Vec<SubmessageKind>> {
    let datagrams = sent.iter();
    let kinds = |datagram| submessages(datagram).into_iter().map(|(kind, _)| kind);
    datagrams
        .map(|(_, datagram)| kinds(datagram).collect())
        .collect()
}

#[test]
fn an_unknown_participant_is_answered_alike() {
    for endpoints in [0, 1, 7] {
        let mut pair = Pair::new(endpoints, &[]);
        let (by_kernel, mut by_layer) = pair.answers(&announcement());
        assert_eq!(
            kinds(&by_kernel),
            [[
                SubmessageKind::INFO_DST,
                SubmessageKind::INFO_TS,
                SubmessageKind::DATA,
                SubmessageKind::HEARTBEAT,
                SubmessageKind::HEARTBEAT,
                SubmessageKind::HEARTBEAT,
            ]]
        );
        // The layer goes on to greet the remote writers. The endpoints of the TypeLookup service, of which the low-level
        // layer knows nothing, greet each other.
        let mut greetings = by_layer.split_off(1);
        let lookups = greetings.split_off(3);
        assert_eq!(lookups.len(), 4);
        let greeting = vec![SubmessageKind::INFO_DST, SubmessageKind::ACKNACK];
        assert_eq!(kinds(&greetings), vec![greeting; 3]);
        assert_eq!(by_kernel, by_layer);
    }
}

#[test]
fn heartbeats_are_answered_alike() {
    for (writer, _) in TOPICS {
        for is_final in [true, false] {
            for (first, last) in [(1, 0), (1, 1), (1, 3), (1, 40), (1, 256), (1, 1000)] {
                let mut pair = Pair::proven(1, &[]);
                let message = pair.heartbeat(writer, first, last, is_final);
                let (by_kernel, by_layer) = pair.answers(&message);
                assert_eq!(by_kernel, by_layer, "{writer} {first}..={last} {is_final}");
                let is_answered = last > 0 || !is_final;
                assert_eq!(by_kernel.len(), usize::from(is_answered));
            }
        }
    }
}

#[test]
fn samples_that_have_come_are_not_asked_for_by_either() {
    let mut pair = Pair::proven(1, &[]);
    let writer = EntityId::SEDP_PUBLICATIONS_WRITER;
    let mut bytes = directed();
    let guid = Guid::new(THEIRS, EntityId::of_app(1, 1, WRITER));
    let endpoint = crate::discovery::EndpointData {
        guid,
        topic: "Square".to_owned(),
        type_name: "ShapeType".to_owned(),
        type_information: Vec::new(),
        content_filter: None,
        unicast: Vec::new(),
        multicast: Vec::new(),
        expects_inline_qos: false,
        qos: crate::qos::Qos::default(),
    };
    let mut payload = Vec::new();
    endpoint.encode(&mut payload);
    data(writer, &payload, &mut bytes);
    pair.add_heartbeat(&mut bytes, writer, 1, 1, false);
    let (by_kernel, by_layer) = pair.answers(&bytes);
    assert_eq!(by_kernel, by_layer);
    assert_eq!(by_kernel.len(), 1);
    for (last, is_final, count) in [(1, true, 0), (4, true, 1)] {
        let message = pair.heartbeat(writer, 1, last, is_final);
        let (by_kernel, by_layer) = pair.answers(&message);
        assert_eq!(by_kernel, by_layer);
        assert_eq!(by_kernel.len(), count);
    }
}

#[test]
fn several_heartbeats_at_once_are_answered_with_the_same() {
    let mut pair = Pair::proven(1, &[]);
    let mut bytes = directed();
    for (last, (writer, _)) in (0..).zip(TOPICS) {
        pair.add_heartbeat(&mut bytes, writer, 1, last, false);
    }
    let (by_kernel, by_layer) = pair.answers(&bytes);
    assert_eq!(by_kernel.len(), 1, "the low-level layer needs one datagram");
    let sorted = |sent| {
        let mut said = said(sent);
        said.sort();
        said
    };
    assert_eq!(sorted(&by_kernel), sorted(&by_layer));
}

/// The answers to an ACKNACK.
fn answers_to(pair: &mut Pair, base: i64, asked: &[i64], is_final: bool) -> (Sent, Sent) {
    let reader = EntityId::SEDP_PUBLICATIONS_READER;
    let message = pair.acknack(reader, base, asked, is_final);
    pair.answers(&message)
}

/// Both answer an ACKNACK alike, with so many datagrams.
#[track_caller]
fn check_acknack(pair: &mut Pair, base: i64, asked: &[i64], is_final: bool) -> usize {
    let (by_kernel, by_layer) = answers_to(pair, base, asked, is_final);
    assert_eq!(kinds(&by_kernel), kinds(&by_layer));
    assert_eq!(by_kernel, by_layer);
    by_kernel.len()
}

#[test]
fn acknacks_are_answered_alike() {
    let all: Vec<i64> = (1..=10).collect();
    let beyond: Vec<i64> = (1..=20).collect();
    for (base, asked, is_final, datagrams) in [
        (1, &[][..], false, 1),
        (1, &[], true, 0),
        (1, &[3], true, 1),
        (1, &[2, 3, 5, 7], false, 1),
        (4, &[4, 5, 6], true, 1),
        (9, &[10], true, 1),
        (11, &[], false, 1),
        (11, &[], true, 0),
        (11, &[11, 12], true, 0),
        (1, &all, true, 2),
        (1, &beyond, false, 2),
    ] {
        let mut pair = Pair::proven(10, &[]);
        let sent = check_acknack(&mut pair, base, asked, is_final);
        assert_eq!(sent, datagrams, "{base} {asked:?} {is_final}");
    }
}

#[test]
fn what_is_gone_is_told_alike() {
    let all: Vec<i64> = (1..=14).collect();
    for withdrawn in [&[1][..], &[1, 2, 3], &[3, 5, 6, 10], &[10], &[2, 9]] {
        for asked in [&all[..], &[1, 2], &[3, 9, 10], &[1, 5, 10], &[2, 10]] {
            let mut pair = Pair::proven(10, withdrawn);
            assert_ne!(check_acknack(&mut pair, 1, asked, true), 0);
        }
    }
}

#[test]
fn what_takes_many_datagrams_is_spread_alike() {
    let withdrawn: Vec<u16> = (1..=100).filter(|serial| serial % 3 == 0).collect();
    let asked: Vec<i64> = (1..=100).collect();
    for withdrawn in [&[][..], &withdrawn] {
        let mut pair = Pair::proven(100, withdrawn);
        let sent = check_acknack(&mut pair, 1, &asked, true);
        assert!(sent > 5, "{sent}");
    }
}

#[test]
fn of_more_than_the_low_level_layer_sends_at_once_it_sends_the_beginning() {
    let mut pair = Pair::new(1, &[]);
    for serial in 2..=100 {
        let mut large = endpoint(SLOT, serial, WRITER);
        large.qos.user_data = vec![7; 900];
        pair.request(ToLayer::Declare(Box::new(large)));
    }
    pair.prove();
    let asked: Vec<i64> = (1..=100).collect();
    let (by_kernel, by_layer) = answers_to(&mut pair, 1, &asked, true);
    assert_eq!(
        by_kernel.len(),
        rtps_ebpf::discovery::MAX_DATAGRAMS as usize
    );
    assert!(by_layer.starts_with(&by_kernel));
}

#[test]
fn what_is_too_long_is_left_to_the_layer() {
    let mut pair = Pair::new(1, &[]);
    let mut long = endpoint(SLOT, 2, WRITER);
    long.qos.user_data = vec![7; 2000];
    pair.layer
        .handle_request(pair.now, SLOT, ToLayer::Declare(Box::new(long)));
    let mut out = Vec::new();
    let mut lengths = Vec::new();
    while let Some(output) = pair.layer.poll_output(pair.now, &mut out) {
        if let LayerOutput::Kernel(KernelChange::Sample { submessage, .. }) = output {
            lengths.push(submessage.len());
        }
    }
    assert_eq!(lengths, [0]);
}
