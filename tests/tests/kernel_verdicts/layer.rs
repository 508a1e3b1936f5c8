//! The loaded programs with their maps, without an interface: `BPF_PROG_TEST_RUN`.

use std::{
    collections::BTreeMap,
    net::{Ipv4Addr, UdpSocket},
};

use anyhow::{Context as _, Result};
use aya::{
    Ebpf, Pod, TestRun as _, TestRunOptions,
    maps::{Array, ArrayOfMaps, HashMap, Map, MapData, MapError, PerCpuHashMap, RingBuf},
    programs::{SchedClassifier, SocketFilter, TcAttachType, Xdp},
};
use aya_obj::generated::bpf_map_type;
use rtps_ebpf::{
    ABI_VERSION, Counter, SlotSet,
    abi::{
        APP_ATTACHED, App, Bell, Config, Domain, INTERFACE_DELIVERS, Interface, PEER_ANY_ADDRESS,
        PORT_METATRAFFIC, PORT_MULTICAST, PORT_UNICAST, Peer, PortConfig, RecordHeader, name,
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
pub(crate) const METATRAFFIC_PORT: u16 = 7410;
pub(crate) const DOMAIN_ID: u32 = 0;
pub(crate) const ADDRESS_V4: [u8; 4] = [192, 0, 2, 2];
pub(crate) const ADDRESS_V6: [u8; 16] = [0x20, 1, 0xd, 0xb8, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2];
/// Test runs come in on the loopback interface of the current namespace.
const LOOPBACK: u32 = 1;
/// Bytes of `struct __sk_buff` (linux/bpf.h), and where the member `gso_size` begins.
const SK_BUFF: usize = 192;
const SK_BUFF_GSO_SIZE: usize = 176;
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
    pub(crate) news: Vec<Record>,
}

struct AttachedApp {
    ring: RingBuf<MapData>,
    bell: Array<MapData, Bell>,
}

/// Programs, maps and apps.
pub(crate) struct Layer {
    ebpf: Ebpf,
    news: RingBuf<MapData>,
    apps: BTreeMap<u8, AttachedApp>,
}

impl Layer {
    /// Loaded and configured for one domain, without apps.
    pub(crate) fn new(doorbell: u32) -> Result<Self> {
        let mut ebpf = Ebpf::load(rtps_ebpf::OBJECT).context("the object does not load")?;
        xdp(&mut ebpf)?.load()?;
        filter(&mut ebpf)?.load()?;
        ingress(&mut ebpf)?.load()?;
        fan_out(&mut ebpf)?.load()?;
        let news = ebpf.take_map(name::NEWS).context("no ring for news")?;
        let mut layer = Self {
            ebpf,
            news: RingBuf::try_from(news)?,
            apps: BTreeMap::new(),
        };
        let domain = Domain {
            guid_prefix: OWN,
            domain_id: DOMAIN_ID,
            count_base_ns: 0,
            datagram_size: 1_472,
            metatraffic_port: METATRAFFIC_PORT.into(),
        };
        layer.set(name::DOMAINS, DOMAIN, domain)?;
        layer.own_port(UNICAST_PORT, PORT_UNICAST)?;
        layer.own_port(MULTICAST_PORT, PORT_MULTICAST)?;
        layer.own_port(METATRAFFIC_PORT, PORT_METATRAFFIC)?;
        layer.own_address(mapped(ADDRESS_V4))?;
        layer.own_address(ADDRESS_V6)?;
        layer.configure(Config {
            abi_version: ABI_VERSION,
            doorbell,
            ..Config::default()
        })?;
        layer.reset_counters()?;
        Ok(layer)
    }

    pub(crate) fn configure(&mut self, config: Config) -> Result<()> {
        self.set(name::CONFIG, 0, config)
    }

    pub(crate) fn own_address(&mut self, address: [u8; 16]) -> Result<()> {
        self.insert(name::ADDRESSES, address, 1_u32)
    }

    fn own_port(&mut self, port: u16, kind: u16) -> Result<()> {
        let config = PortConfig {
            domain_index: DOMAIN as u16,
            kind,
        };
        self.set(name::PORTS, port.into(), config)
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
        self.set(name::APPS, slot.into(), app)
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
        self.insert(name::ROUTES, writer, slots)
    }

    /// A peer that may send from anywhere.
    pub(crate) fn know_peer(&mut self, prefix: GuidPrefix) -> Result<()> {
        let peer = Peer {
            flags: PEER_ANY_ADDRESS,
            ..Peer::default()
        };
        self.insert(name::PEERS, prefix, peer)
    }

    pub(crate) fn last_seen_ns(&mut self, prefix: GuidPrefix) -> Result<u64> {
        let peer: Peer = self.get(name::PEERS, prefix)?.context("no such peer")?;
        Ok(peer.last_seen_ns)
    }

    /// Writes one entry of a hash.
    pub(crate) fn insert<K: Pod, V: Pod>(&mut self, map: &str, key: K, value: V) -> Result<()> {
        HashMap::<_, K, V>::try_from(self.map(map)?)?.insert(key, value, 0)?;
        Ok(())
    }

    /// Reads one entry of a hash.
    pub(crate) fn get<K: Pod, V: Pod>(&mut self, map: &str, key: K) -> Result<Option<V>> {
        match HashMap::<_, K, V>::try_from(self.map(map)?)?.get(&key, 0) {
            Ok(value) => Ok(Some(value)),
            Err(MapError::KeyNotFound) => Ok(None),
            Err(error) => Err(error.into()),
        }
    }

    /// Writes one element of an array.
    pub(crate) fn set<V: Pod>(&mut self, map: &str, index: u32, value: V) -> Result<()> {
        Array::<_, V>::try_from(self.map(map)?)?.set(index, value, 0)?;
        Ok(())
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

    /// Has the tc program deliver what comes in on the test interface.
    pub(crate) fn deliver_at_ingress(&mut self) -> Result<()> {
        let interface = Interface {
            tasks: INTERFACE_DELIVERS,
            ..Interface::default()
        };
        self.insert(name::INTERFACES, LOOPBACK, interface)
    }

    /// Shows a frame to the tc program; `segment` is not 0 where it holds several datagrams, of so many bytes each.
    pub(crate) fn run_ingress(&mut self, frame: &[u8], segment: u32) -> Result<Outcome> {
        self.reset_counters()?;
        let mut frame = frame.to_vec();
        // The hardware address of the test interface.
        frame[..6].fill(0);
        let mut context = [0; SK_BUFF];
        context[SK_BUFF_GSO_SIZE..][..4].copy_from_slice(&segment.to_ne_bytes());
        let mut packet = vec![0; frame.len() + 64];
        let result = ingress(&mut self.ebpf)?.test_run(TestRunOptions {
            data_in: Some(&frame),
            data_out: Some(&mut packet),
            ctx_in: Some(&context),
            ..TestRunOptions::default()
        })?;
        packet.truncate(result.data_size_out as usize);
        self.outcome(result.return_value, packet)
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

    /// The same, without a look into the rings; counters go on from where they were.
    pub(crate) fn run_filter_undrained(&mut self, datagram: &[u8]) -> Result<()> {
        filter(&mut self.ebpf)?.test_run(TestRunOptions {
            data_in: Some(datagram),
            ..TestRunOptions::default()
        })?;
        Ok(())
    }

    /// A real socket on loopback with the filter on it.
    pub(crate) fn filtered_socket(&mut self) -> Result<UdpSocket> {
        let socket = UdpSocket::bind((Ipv4Addr::LOCALHOST, UNICAST_PORT))?;
        socket.set_nonblocking(true)?;
        self.attach_filter(&socket)?;
        Ok(socket)
    }

    /// Puts the tc program on an interface of the current namespace.
    pub(crate) fn attach_ingress(&mut self, interface: &str) -> Result<()> {
        ingress(&mut self.ebpf)?.attach(interface, TcAttachType::Ingress)?;
        Ok(())
    }

    /// Puts the other one on the loopback interface of the current namespace.
    pub(crate) fn attach_fan_out(&mut self) -> Result<()> {
        fan_out(&mut self.ebpf)?.attach("lo", TcAttachType::Egress)?;
        Ok(())
    }

    /// Puts the filter on a socket.
    pub(crate) fn attach_filter(&mut self, socket: &UdpSocket) -> Result<()> {
        filter(&mut self.ebpf)?.attach(socket)?;
        Ok(())
    }

    pub(crate) fn verified_instructions(&mut self) -> Result<[Option<u32>; 4]> {
        Ok([
            xdp(&mut self.ebpf)?.info()?.verified_instruction_count(),
            ingress(&mut self.ebpf)?
                .info()?
                .verified_instruction_count(),
            filter(&mut self.ebpf)?.info()?.verified_instruction_count(),
            fan_out(&mut self.ebpf)?
                .info()?
                .verified_instruction_count(),
        ])
    }

    /// What rtpsd has not read yet.
    pub(crate) fn news(&mut self) -> Vec<Record> {
        drain(&mut self.news)
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
        self.counts_of(LOOPBACK)
    }

    /// Of an interface.
    pub(crate) fn counts_of(&mut self, ifindex: u32) -> Result<Counts> {
        let counters =
            PerCpuHashMap::<_, u32, [u64; Counter::COUNT]>::try_from(self.map(name::COUNTERS)?)?;
        let per_cpu = counters.get(&ifindex, 0)?;
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
        self.reset_counters_of(LOOPBACK)
    }

    /// Of an interface, which then has counters of its own.
    pub(crate) fn reset_counters_of(&mut self, ifindex: u32) -> Result<()> {
        let zero = vec![[0; Counter::COUNT]; aya::util::nr_cpus().map_err(|(_, error)| error)?];
        PerCpuHashMap::<_, u32, [u64; Counter::COUNT]>::try_from(self.map(name::COUNTERS)?)?
            .insert(ifindex, zero.try_into()?, 0)?;
        Ok(())
    }

    fn outcome(&mut self, verdict: u32, packet: Vec<u8>) -> Result<Outcome> {
        Ok(Outcome {
            verdict,
            packet,
            counts: self.counts()?,
            records: self.drain(),
            news: self.news(),
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

fn ingress(ebpf: &mut Ebpf) -> Result<&mut SchedClassifier> {
    let program = ebpf
        .program_mut(name::INGRESS_PROGRAM)
        .context("no tc program")?;
    Ok(program.try_into()?)
}

fn fan_out(ebpf: &mut Ebpf) -> Result<&mut SchedClassifier> {
    let program = ebpf
        .program_mut(name::FAN_OUT_PROGRAM)
        .context("no program for several destinations")?;
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
        domain_index: half(8),
        segment: half(10),
        hook: record[12],
        flags: record[13],
        source_port: half(14),
        source_address: record[16..32].try_into().unwrap(),
        received_ns: u64::from_ne_bytes(record[32..40].try_into().unwrap()),
    };
    let message = record[40..][..header.message_len as usize].to_vec();
    Record { header, message }
}
