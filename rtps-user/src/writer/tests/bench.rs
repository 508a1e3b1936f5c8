//! The writer under test, and hands that play its readers.

use super::*;

pub(super) const DATAGRAM: usize = 1472;

pub(super) fn writer_guid() -> Guid {
    let entity = EntityId::of_app(1, 1, EntityKind::WriterWithKey);
    Guid::new(GuidPrefix([1; 12]), entity)
}

pub(super) fn reader_guid(number: u8) -> Guid {
    let entity = EntityId::of_app(2, u16::from(number), EntityKind::ReaderWithKey);
    Guid::new(GuidPrefix([2; 12]), entity)
}

pub(super) fn reliable(durability: Durability) -> Qos {
    Qos {
        reliability: Reliability::RELIABLE,
        history: History::KeepAll,
        durability,
        ..Qos::default()
    }
}

pub(super) fn change(bytes: usize) -> NewChange {
    NewChange {
        kind: ChangeKind::Alive,
        instance: KeyHash::default(),
        payload: vec![0; bytes].into(),
        timestamp: Timestamp::default(),
    }
}

/// A writer, the time, and what it has sent.
pub(super) struct Bench {
    pub(super) writer: Writer,
    pub(super) now: Instant,
    pub(super) count: i32,
}

/// Where a datagram went, and a line for each of its submessages.
pub(super) type Sent = (Vec<SocketAddr>, Vec<String>);

impl Bench {
    pub(super) fn new(qos: Qos) -> Self {
        Self::with_timing(qos, WriterTiming::default())
    }

    pub(super) fn with_timing(qos: Qos, timing: WriterTiming) -> Self {
        let config = WriterConfig {
            guid: writer_guid(),
            qos,
            datagram_size: DATAGRAM,
            timing,
        };
        Self {
            writer: Writer::new(config),
            now: Instant::now(),
            count: 0,
        }
    }

    pub(super) fn write(&mut self, bytes: usize) {
        self.writer.write(self.now, change(bytes)).unwrap();
    }

    /// Matches reader `number`, which listens on that port.
    pub(super) fn match_reader(&mut self, number: u8, port: u16, qos: Qos) {
        let remote = Self::remote(number, port, qos);
        self.writer.match_reader(self.now, &remote);
    }

    pub(super) fn remote(number: u8, port: u16, qos: Qos) -> RemoteEndpoint {
        RemoteEndpoint {
            guid: reader_guid(number),
            unicast: vec![SocketAddr::from(([10, 0, 0, 1], port))],
            addresses: Vec::new(),
            multicast: Vec::new(),
            expects_inline_qos: false,
            takes_bare_keys: false,
            qos,
            topic: String::new(),
            type_name: String::new(),
            type_information: Vec::new(),
            content_filter: None,
        }
    }

    pub(super) fn acknack(&mut self, number: u8, base: i64, missing: &[i64]) {
        self.acknack_with(number, base, missing, true);
    }

    pub(super) fn acknack_with(&mut self, number: u8, base: i64, missing: &[i64], is_final: bool) {
        self.count += 1;
        let base = SequenceNumber(base);
        let missing = missing.iter().copied().map(SequenceNumber);
        let acknack = AckNack {
            reader: reader_guid(number).entity,
            writer: writer_guid().entity,
            state: SequenceNumberSet::from_members(base, missing),
            count: self.count,
            is_final,
        };
        self.writer
            .handle_acknack(self.now, reader_guid(number), &acknack);
    }

    pub(super) fn nack_frag(&mut self, number: u8, sequence: i64, missing: &[u32]) {
        self.count += 1;
        let nack = NackFrag {
            reader: reader_guid(number).entity,
            writer: writer_guid().entity,
            sequence: SequenceNumber(sequence),
            missing: FragmentNumberSet::from_members(missing[0], missing.iter().copied()),
            count: self.count,
        };
        self.writer
            .handle_nack_frag(self.now, reader_guid(number), &nack);
    }

    /// A reader has all fragments of a change below that one.
    pub(super) fn progress(&mut self, number: u8, sequence: i64, fragment: u32) {
        self.count += 1;
        let nack = NackFrag {
            reader: reader_guid(number).entity,
            writer: writer_guid().entity,
            sequence: SequenceNumber(sequence),
            missing: FragmentNumberSet::nothing(fragment),
            count: self.count,
        };
        self.writer
            .handle_nack_frag(self.now, reader_guid(number), &nack);
    }

    pub(super) fn sent(&mut self) -> Vec<Sent> {
        self.sent_as(describe)
    }

    pub(super) fn sent_as<T>(
        &mut self,
        describe: impl Fn(&Submessage<'_>) -> T,
    ) -> Vec<(Vec<SocketAddr>, Vec<T>)> {
        let mut out = Vec::new();
        let mut sent = Vec::new();
        let mut start = 0;
        while let Some(transmit) = self.writer.poll_transmit(self.now, &mut out) {
            let datagram = &out[std::mem::replace(&mut start, out.len())..];
            assert!(datagram.len() <= DATAGRAM);
            let receiver = MessageReceiver::new(reader_guid(0).prefix, datagram).unwrap();
            let lines = receiver.map(|received| describe(&received.unwrap().submessage));
            sent.push((transmit.destinations.to_vec(), lines.collect()));
        }
        assert_eq!(
            start,
            out.len(),
            "where there is no datagram, nothing is appended"
        );
        sent
    }

    /// The submessages of all that was sent.
    pub(super) fn lines(&mut self) -> Vec<String> {
        self.sent()
            .into_iter()
            .flat_map(|(_, lines)| lines)
            .collect()
    }

    /// Lets time pass in the steps that the writer asks for.
    pub(super) fn pass(&mut self, time: Duration) -> Vec<String> {
        let end = self.now + time;
        let mut lines = self.lines();
        while let Some(due) = self.writer.poll_timeout().filter(|due| *due <= end) {
            self.now = self.now.max(due);
            self.writer.handle_timeout(self.now);
            lines.extend(self.lines());
        }
        self.now = end;
        lines
    }
}

pub(super) fn describe(submessage: &Submessage<'_>) -> String {
    let to = |reader: EntityId| match reader {
        EntityId::UNKNOWN => "all".to_owned(),
        reader => reader.0[2].to_string(),
    };
    match submessage {
        Submessage::Data(data) => format!("DATA {} to {}", data.sequence, to(data.reader)),
        Submessage::DataFrag(data) => format!(
            "DATA_FRAG {}.{} to {}",
            data.sequence,
            data.first_fragment,
            to(data.reader)
        ),
        Submessage::Gap(gap) => {
            let list: Vec<_> = gap.list.iter().map(|member| member.0).collect();
            let (start, end) = (gap.start, gap.list.base);
            format!("GAP {start}..{end} {list:?} to {}", to(gap.reader))
        }
        Submessage::Heartbeat(heartbeat) => format!(
            "HEARTBEAT {}..={}{}{} to {}",
            heartbeat.first,
            heartbeat.last,
            if heartbeat.is_final { " final" } else { "" },
            if heartbeat.liveliness { " alive" } else { "" },
            to(heartbeat.reader)
        ),
        other => format!("{other:?}"),
    }
}

/// A writer with a reader that has been greeted.
pub(super) fn matched(qos: Qos) -> Bench {
    let mut bench = Bench::new(qos.clone());
    bench.match_reader(1, 7411, qos);
    assert_eq!(bench.lines(), ["HEARTBEAT 1..=0 final to 1"]);
    bench
}
