//! Bad messages: random ones, and real ones that were cut, bent, or given a false sender.

use std::net::Ipv4Addr;

use anyhow::{Result, ensure};
use rtps_tests::capture::Capture;
use rtps_tests::layer::Layer;
use rtps_tests::stage::{PATIENCE, Stage};

/// Where the header of a message has its GUID prefix (RTPS 2.5, 9.4.4).
const PREFIX: std::ops::Range<usize> = 8..20;
/// Where the first submessage has its length.
const FIRST_LENGTH: std::ops::Range<usize> = 22..24;
/// The most that goes into one Ethernet frame.
const LONGEST: u64 = 1472;

/// Pseudo-random numbers (xorshift64), the same in every run.
pub(crate) struct Random(u64);

impl Random {
    /// `seed` is not 0.
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed)
    }

    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    /// A number below `bound`, which is not 0.
    pub(crate) fn below(&mut self, bound: u64) -> u64 {
        self.next() % bound
    }

    pub(crate) fn bytes(&mut self, count: u64) -> Vec<u8> {
        (0..count).map(|_| self.next() as u8).collect()
    }
}

/// The messages of a conversation between Cyclone DDS and an app of ours, with fragments both ways.
pub(crate) fn record(stage: &Stage, layer: Layer) -> Result<Vec<Vec<u8>>> {
    let capture = Capture::start(&stage.ours.netns, &stage.ours.interface.name)?;
    let common = "--reliable --durability transient-local --count 10 --size 5000 --timeout 60";
    for (topic, is_ours) in [("ToUs", false), ("FromUs", true)] {
        let publish =
            format!("--pub --topic {topic} --period-us 5000 --dispose --unregister {common}");
        let subscribe = format!("--sub --topic {topic} --linger 0.5 {common}");
        let (mut subscriber, mut publisher) = if is_ours {
            (
                stage.cyclone(&subscribe)?,
                stage.app(&stage.ours, layer, &publish)?,
            )
        } else {
            (
                stage.app(&stage.ours, layer, &subscribe)?,
                stage.cyclone(&publish)?,
            )
        };
        subscriber.wait_success(PATIENCE)?;
        publisher.wait_success(PATIENCE)?;
    }
    let messages: Vec<Vec<u8>> = capture
        .finish()?
        .packets
        .into_iter()
        .map(|packet| packet.payload)
        .filter(|payload| payload.len() > FIRST_LENGTH.end && payload.starts_with(b"RTPS"))
        .collect();
    ensure!(messages.len() > 50, "only {} messages", messages.len());
    Ok(messages)
}

/// One message of each kind of a conversation, by the submessages that it has.
pub(crate) fn one_of_each_kind(messages: &[Vec<u8>]) -> Vec<&Vec<u8>> {
    let mut kinds = std::collections::BTreeMap::new();
    for message in messages {
        kinds.entry(submessage_ids(message)).or_insert(message);
    }
    kinds.into_values().collect()
}

/// The ids of a valid message's submessages (RTPS 2.5, 9.4.5.1).
fn submessage_ids(message: &[u8]) -> Vec<u8> {
    let mut ids = Vec::new();
    let mut rest = message.get(PREFIX.end..).unwrap_or_default();
    while let [id, flags, low, high, body @ ..] = rest {
        ids.push(*id);
        let length = match flags & 1 {
            0 => u16::from_be_bytes([*low, *high]),
            _ => u16::from_le_bytes([*low, *high]),
        };
        rest = body.get(usize::from(length)..).unwrap_or_default();
    }
    ids
}

/// An endless supply of bad messages.
pub(crate) struct Hostile<'a> {
    real: &'a [Vec<u8>],
    random: Random,
}

impl<'a> Hostile<'a> {
    pub(crate) fn new(real: &'a [Vec<u8>]) -> Self {
        Self {
            real,
            random: Random::new(0x5eed),
        }
    }

    /// The next one.
    pub(crate) fn message(&mut self) -> Vec<u8> {
        match self.random.below(6) {
            0 => self.noise(),
            1 => [b"RTPS\x02\x05\x01\x10".as_slice(), &self.noise()].concat(),
            2 => self.cut(),
            3 => self.bent(),
            4 => self.lying(),
            _ => self.spoofed(),
        }
    }

    fn noise(&mut self) -> Vec<u8> {
        let length = self.random.below(LONGEST);
        self.random.bytes(length)
    }

    fn real(&mut self) -> Vec<u8> {
        let index = self.random.below(self.real.len() as u64) as usize;
        let mut message = self.real[index].clone();
        message.truncate(LONGEST as usize);
        message
    }

    fn cut(&mut self) -> Vec<u8> {
        let mut message = self.real();
        let length = self.random.below(message.len() as u64) as usize;
        message.truncate(length);
        message
    }

    /// With some bytes changed.
    fn bent(&mut self) -> Vec<u8> {
        let mut message = self.real();
        for _ in 0..=self.random.below(8) {
            let index = self.random.below(message.len() as u64) as usize;
            message[index] = self.random.next() as u8;
        }
        message
    }

    /// With a submessage of another length than it says.
    fn lying(&mut self) -> Vec<u8> {
        let mut message = self.real();
        message[FIRST_LENGTH].copy_from_slice(&self.random.bytes(2));
        message
    }

    /// From a participant that there is not, and that its content speaks of, too.
    fn spoofed(&mut self) -> Vec<u8> {
        let mut message = self.real();
        let prefix = message[PREFIX].to_vec();
        let stranger = self.random.bytes(prefix.len() as u64);
        for start in 0..=message.len() - prefix.len() {
            let place = &mut message[start..start + prefix.len()];
            if place == prefix {
                place.copy_from_slice(&stranger);
            }
        }
        message
    }
}

/// Every port of a layer in domain 0 (RTPS 2.5, 9.6.2.3) at which it can be attacked from another host.
pub(crate) fn targets(address: Ipv4Addr) -> [(Ipv4Addr, u16); 5] {
    let group = Ipv4Addr::new(239, 255, 0, 1);
    [
        (address, 7410),
        (address, 7411),
        (group, 7400),
        (group, 7401),
        (address, 7400),
    ]
}
