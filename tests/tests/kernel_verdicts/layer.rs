//! The loaded programs with their maps, without an interface: `BPF_PROG_TEST_RUN`.

use std::{
    collections::BTreeMap,
    net::{Ipv4Addr, UdpSocket},
};

use anyhow::{Context as _, Result};
use aya::{
    Ebpf, TestRun as _, TestRunOptions,
    maps::{Array, ArrayOfMaps, HashMap, Map, MapData, PerCpuHashMap, RingBuf},
    programs::{SocketFilter, Xdp},
};
use aya_obj::generated::bpf_map_type;
use rtps_ebpf::{
    ABI_VERSION, Counter, SlotSet,
    abi::{
        APP_ATTACHED, App, Bell, Config, Domain, PORT_MULTICAST, PORT_UNICAST, Peer, PortConfig,
        RecordHeader, name,
    },
    entity::{Guid, GuidPrefix},
    frame::mapped,
};

pub(crate) const OWN: GuidPrefix = *b"own-prefix--";
pub(crate) const REMOTE: GuidPrefix = *b"remote------";
/// Index in `domains`; not 0, so that a default does not pass for it.
pub(crate) const DOMAIN: u32 = 3;
pub(crate) const UNICAST_PORT: u16 = 7411;
pub(crate) const MULTICAST_PORT: u16 = 7401;
pub(crate) const ADDRESS_V4: [u8; 4] = [192, 0, 2, 2];
pub(crate) const ADDRESS_V6: [u8; 16] = [0x20, 1, 0xd, 0xb8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2];
/// Test runs come in on the loopback interface of the current namespace.
const LOOPBACK: u32 = 1;
const BPF_F_MMAPABLE: u32 = 1 << 10;

/// Counters that differ from 0.
pub(crate) type Counts = BTreeMap<&'static str, u64>;

/// One record in an app's ring.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Record {
    pub(crate) header: RecordHeader,
    pub(crate) message: Vec<u8>,
}

/// What a program made of a packet.
#[derive(Debug)]
pub(crate) struct Outcome {
    pub(crate) verdict: u32,
    pub(crate) packet: Vec<u8>,
    pub(crate) counts: Counts,
    pub(crate) records: BTreeMap<u8, Vec<Record>>,
}

struct AttachedApp {
    ring: RingBuf<MapData>,
    bell: Array<MapData, Bell>,
}

/// Programs, maps and apps.
pub(crate) struct Layer {
    ebpf: Ebpf,
    apps: BTreeMap<u8, AttachedApp>,
}

impl Layer {
    /// Loaded and configured for one domain, without apps.
    pub(crate) fn new(doorbell: u32) -> Result<Self> {
        let mut ebpf = Ebpf::load(rtps_ebpf::OBJECT).context("the object does not load")?;
        xdp(&mut ebpf)?.load()?;
        filter(&mut ebpf)?.load()?;
        let mut layer = Self {
            ebpf,
            apps: BTreeMap::new(),
        };
        let domain = Domain {
            guid_prefix: OWN,
            domain_id: 0,
        };
        Array::<_, Domain>::try_from(layer.map(name::DOMAINS)?)?.set(DOMAIN, domain, 0)?;
        layer.own_port(UNICAST_PORT, PORT_UNICAST)?;
        layer.own_port(MULTICAST_PORT, PORT_MULTICAST)?;
        let mut addresses = HashMap::<_, [u8; 16], u32>::try_from(layer.map(name::ADDRESSES)?)?;
        addresses.insert(mapped(ADDRESS_V4), 1, 0)?;
        addresses.insert(ADDRESS_V6, 1, 0)?;
        layer.configure(Config {
            abi_version: ABI_VERSION,
            doorbell,
        })?;
        layer.reset_counters()?;
        Ok(layer)
    }

    pub(crate) fn configure(&mut self, config: Config) -> Result<()> {
        Array::<_, Config>::try_from(self.map(name::CONFIG)?)?.set(0, config, 0)?;
        Ok(())
    }

    fn own_port(&mut self, port: u16, kind: u16) -> Result<()> {
        let config = PortConfig {
            domain_index: DOMAIN as u16,
            kind,
        };
        HashMap::<_, u16, PortConfig>::try_from(self.map(name::PORTS)?)?.insert(port, config, 0)?;
        Ok(())
    }

    /// Attaches an app with a ring of `bytes`.
    pub(crate) fn attach_app(&mut self, slot: u8, doorbell_port: u16, bytes: u32) -> Result<()> {
        let ring = MapData::create(
            aya_obj::Map::new_from_params(
                bpf_map_type::BPF_MAP_TYPE_RINGBUF as u32,
                0,
                0,
                bytes,
                0,
            ),
            "ring",
            None,
        )?;
        ArrayOfMaps::<_, MapData>::try_from(self.map(name::RINGS)?)?.set(slot.into(), &ring, 0)?;
        let bell = Array::<MapData, Bell>::create(1, BPF_F_MMAPABLE)?;
        ArrayOfMaps::<_, Array<MapData, Bell>>::try_from(self.map(name::BELLS)?)?.set(
            slot.into(),
            &bell,
            0,
        )?;
        let app = App {
            state: APP_ATTACHED,
            domain_index: DOMAIN,
            doorbell_port: doorbell_port.into(),
            reserved: 0,
        };
        self.set_app(slot, app)?;
        let ring = RingBuf::try_from(Map::RingBuf(ring))?;
        self.apps.insert(slot, AttachedApp { ring, bell });
        Ok(())
    }

    pub(crate) fn set_app(&mut self, slot: u8, app: App) -> Result<()> {
        Array::<_, App>::try_from(self.map(name::APPS)?)?.set(slot.into(), app, 0)?;
        Ok(())
    }

    /// As the app does before it sleeps.
    pub(crate) fn sleep(&mut self, slot: u8, sleeps: bool) -> Result<()> {
        let bell = Bell {
            need_wakeup: sleeps.into(),
            ..Bell::default()
        };
        let app = self.apps.get_mut(&slot).context("no such app")?;
        app.bell.set(0, bell, 0)?;
        Ok(())
    }

    pub(crate) fn route(&mut self, writer: Guid, slots: &[u8]) -> Result<()> {
        let slots: SlotSet = slots.iter().copied().collect();
        HashMap::<_, Guid, SlotSet>::try_from(self.map(name::ROUTES)?)?.insert(writer, slots, 0)?;
        Ok(())
    }

    pub(crate) fn know_peer(&mut self, prefix: GuidPrefix) -> Result<()> {
        HashMap::<_, GuidPrefix, Peer>::try_from(self.map(name::PEERS)?)?.insert(
            prefix,
            Peer::default(),
            0,
        )?;
        Ok(())
    }

    pub(crate) fn last_seen_ns(&mut self, prefix: GuidPrefix) -> Result<u64> {
        let peers = HashMap::<_, GuidPrefix, Peer>::try_from(self.map(name::PEERS)?)?;
        Ok(peers.get(&prefix, 0)?.last_seen_ns)
    }

    /// Shows a frame to the XDP program.
    pub(crate) fn run_xdp(&mut self, frame: &[u8]) -> Result<Outcome> {
        self.reset_counters()?;
        let mut packet = vec![0; frame.len() + 64];
        let result = xdp(&mut self.ebpf)?.test_run(TestRunOptions {
            data_in: Some(frame),
            data_out: Some(&mut packet),
            ..TestRunOptions::default()
        })?;
        packet.truncate(result.data_size_out as usize);
        self.outcome(result.return_value, packet)
    }

    /// The same, without a look into the rings; counters go on from where they were.
    pub(crate) fn run_xdp_undrained(&mut self, frame: &[u8]) -> Result<u32> {
        let result = xdp(&mut self.ebpf)?.test_run(TestRunOptions {
            data_in: Some(frame),
            ..TestRunOptions::default()
        })?;
        Ok(result.return_value)
    }

    /// Shows a datagram, built by `packet::at_socket`, to the socket filter.
    pub(crate) fn run_filter(&mut self, datagram: &[u8]) -> Result<Outcome> {
        self.reset_counters()?;
        let result = filter(&mut self.ebpf)?.test_run(TestRunOptions {
            data_in: Some(datagram),
            ..TestRunOptions::default()
        })?;
        self.outcome(result.return_value, Vec::new())
    }

    /// A real socket on loopback with the filter on it.
    pub(crate) fn filtered_socket(&mut self) -> Result<UdpSocket> {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, UNICAST_PORT))?;
        socket.set_nonblocking(true)?;
        filter(&mut self.ebpf)?.attach(&socket)?;
        Ok(socket)
    }

    pub(crate) fn verified_instructions(&mut self) -> Result<[Option<u32>; 2]> {
        Ok([
            xdp(&mut self.ebpf)?.info()?.verified_instruction_count(),
            filter(&mut self.ebpf)?.info()?.verified_instruction_count(),
        ])
    }

    /// Everything that the apps have not read yet.
    pub(crate) fn drain(&mut self) -> BTreeMap<u8, Vec<Record>> {
        self.apps
            .iter_mut()
            .map(|(&slot, app)| (slot, drain(&mut app.ring)))
            .filter(|(_, records)| !records.is_empty())
            .collect()
    }

    pub(crate) fn counts(&mut self) -> Result<Counts> {
        let counters =
            PerCpuHashMap::<_, u32, [u64; Counter::COUNT]>::try_from(self.map(name::COUNTERS)?)?;
        let per_cpu = counters.get(&LOOPBACK, 0)?;
        Ok(Counter::ALL
            .iter()
            .map(|&counter| {
                let sum = per_cpu.iter().map(|counts| counts[counter as usize]).sum();
                (counter.name(), sum)
            })
            .filter(|&(_, count)| count != 0)
            .collect())
    }

    pub(crate) fn reset_counters(&mut self) -> Result<()> {
        let zero = vec![[0; Counter::COUNT]; aya::util::nr_cpus().map_err(|(_, error)| error)?];
        PerCpuHashMap::<_, u32, [u64; Counter::COUNT]>::try_from(self.map(name::COUNTERS)?)?
            .insert(LOOPBACK, zero.try_into()?, 0)?;
        Ok(())
    }

    fn outcome(&mut self, verdict: u32, packet: Vec<u8>) -> Result<Outcome> {
        Ok(Outcome {
            verdict,
            packet,
            counts: self.counts()?,
            records: self.drain(),
        })
    }

    fn map(&mut self, name: &str) -> Result<&mut Map> {
        self.ebpf
            .map_mut(name)
            .with_context(|| format!("the object has no map {name}"))
    }
}

fn xdp(ebpf: &mut Ebpf) -> Result<&mut Xdp> {
    let program = ebpf
        .program_mut(name::XDP_PROGRAM)
        .context("no XDP program")?;
    Ok(program.try_into()?)
}

fn filter(ebpf: &mut Ebpf) -> Result<&mut SocketFilter> {
    let program = ebpf
        .program_mut(name::FILTER_PROGRAM)
        .context("no filter")?;
    Ok(program.try_into()?)
}

fn drain(ring: &mut RingBuf<MapData>) -> Vec<Record> {
    let mut records = Vec::new();
    while let Some(item) = ring.next() {
        records.push(parse(&item));
    }
    records
}

fn parse(record: &[u8]) -> Record {
    let word = |at: usize| u32::from_ne_bytes(record[at..at + 4].try_into().unwrap());
    let half = |at: usize| u16::from_ne_bytes(record[at..at + 2].try_into().unwrap());
    let header = RecordHeader {
        message_len: word(0),
        ifindex: word(4),
        domain_index: word(8),
        hook: half(12),
        source_port: half(14),
        source_address: record[16..32].try_into().unwrap(),
        received_ns: u64::from_ne_bytes(record[32..40].try_into().unwrap()),
    };
    let message = record[40..][..header.message_len as usize].to_vec();
    Record { header, message }
}
