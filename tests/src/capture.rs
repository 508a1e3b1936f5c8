//! What was on the wire: captured by tcpdump, decoded by tshark's RTPS dissector.
//!
//! tshark reassembles IP fragments, so that a packet here is one UDP datagram.

use std::fs;
use std::net::IpAddr;
use std::path::PathBuf;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use nix::sys::signal::Signal;

use crate::debian::{self, Package};
use crate::netns::Netns;
use crate::process::Process;

const PACKAGES: &[Package] = &[
    Package::new("tcpdump", "/usr/bin/tcpdump"),
    Package::new("tshark", "/usr/bin/tshark"),
];

/// Opening and closing a packet socket waits for every CPU, on a busy machine for seconds.
const TCPDUMP_ANSWER: Duration = Duration::from_secs(30);
/// More octets than the MTU of any link of the harness; `lo` is no link.
const LONGEST_PACKET: &str = "4096";
/// tcpdump reads its ring in intervals; what was sent shortly before the end is in there by then.
const LAST_PACKETS: Duration = Duration::from_millis(200);

/// A running capture; dropping it ends it and removes its file.
pub struct Capture {
    tcpdump: Process,
    file: TemporaryFile,
}

impl Capture {
    /// Captures the UDP datagrams of an interface of `netns`, fragments included. Returns when the
    /// capture runs.
    pub fn start(netns: &Netns, interface: &str) -> Result<Self> {
        debian::ensure_installed(PACKAGES)?;
        let file = TemporaryFile::new("pcap");
        let mut command = netns.command("tcpdump");
        // As root tcpdump would become a user who cannot write the file. A large buffer, because
        // a packet that tcpdump misses looks like one that nobody sent; the buffer has slots of
        // the size of the longest packet, which is far below tcpdump's default here.
        command
            .args(["-Z", "root", "-B", "65536", "-s", LONGEST_PACKET])
            .args(["-U", "--immediate-mode", "-n"])
            .args(["-i", interface, "-w"])
            .arg(&file.path)
            .arg("udp or (ip[6:2] & 0x1fff != 0) or ip6[6] == 44");
        let mut tcpdump = Process::spawn("tcpdump", &mut command)?;
        tcpdump.wait_line("listening on", TCPDUMP_ANSWER)?;
        Ok(Self { tcpdump, file })
    }

    /// Ends the capture and decodes it.
    pub fn finish(mut self) -> Result<Decoded> {
        thread::sleep(LAST_PACKETS);
        self.tcpdump.signal(Signal::SIGINT)?;
        self.tcpdump.wait_success(TCPDUMP_ANSWER)?;
        if !self
            .tcpdump
            .text()
            .contains("\n0 packets dropped by kernel")
        {
            bail!("tcpdump missed packets:\n{}", self.tcpdump.text());
        }
        let packets = tshark(&self.file, "udp && !icmp && !icmpv6", &[], FIELDS)?
            .lines()
            .map(|line| parse_packet(line).with_context(|| format!("tshark's line {line:?}")))
            .collect::<Result<_>>()?;
        Ok(Decoded {
            packets,
            file: Arc::new(self.file),
        })
    }
}

/// The fields of the packets that match a display filter: a line each, separated by tabs.
fn tshark(
    file: &TemporaryFile,
    filter: &str,
    preferences: &[&str],
    fields: &[&str],
) -> Result<String> {
    let output = Command::new("tshark")
        .args(["-r".as_ref(), file.path.as_os_str()])
        // A port that the system chose may be the one of another protocol.
        .args(["-o", "udp.try_heuristic_first:TRUE"])
        .args(preferences.iter().flat_map(|preference| ["-o", preference]))
        .args(["-Y", filter])
        .args(["-T", "fields", "-E", "separator=/t", "-E", "aggregator=,"])
        .args(fields.iter().flat_map(|field| ["-e", field]))
        .output()
        .context("running tshark")?;
    if !output.status.success() {
        let words = String::from_utf8_lossy(&output.stderr);
        bail!("tshark failed: {}", words.trim());
    }
    Ok(String::from_utf8_lossy(&output.stdout).into_owned())
}

/// A decoded capture.
#[derive(Clone, Debug)]
pub struct Decoded {
    /// The UDP datagrams in the order of their capture.
    pub packets: Vec<Packet>,
    file: Arc<TemporaryFile>,
}

impl Decoded {
    /// The datagrams that this address sent.
    pub fn from(&self, source: impl Into<IpAddr>) -> impl Iterator<Item = &Packet> {
        let source = source.into();
        self.packets
            .iter()
            .filter(move |packet| packet.source == source)
    }

    /// Datagrams of this address that tshark cannot decode or finds an error in.
    pub fn malformed_from(&self, source: impl Into<IpAddr>) -> Vec<&Packet> {
        self.from(source)
            .filter(|packet| packet.malformed)
            .collect()
    }

    /// How many packets of the link match a display filter of Wireshark. IP fragments count each, and only the last
    /// one of a datagram has what IP carries.
    ///
    /// # Errors
    /// When tshark fails, for example because of the filter.
    pub fn frames(&self, filter: &str) -> Result<usize> {
        let lines = tshark(&self.file, filter, &[], &["frame.number"])?;
        Ok(lines.lines().count())
    }

    /// How many datagrams of this address have a wrong UDP checksum; none at all is right over IPv4. A link that leaves
    /// checksums to the hardware of its ends, as veth does by default, carries wrong ones.
    ///
    /// # Errors
    /// When tshark fails.
    pub fn bad_checksums_from(&self, source: impl Into<IpAddr>) -> Result<usize> {
        let source = match source.into() {
            IpAddr::V4(address) => format!("ip.src == {address}"),
            IpAddr::V6(address) => format!("ipv6.src == {address}"),
        };
        // Status 0 is bad.
        let filter = format!("{source} && udp.checksum.status == 0");
        let preferences = ["udp.check_checksum:TRUE"];
        let lines = tshark(&self.file, &filter, &preferences, &["frame.number"])?;
        Ok(lines.lines().count())
    }

    /// How often this address sent a submessage of this kind.
    pub fn count(&self, source: impl Into<IpAddr>, submessage_id: u8) -> usize {
        self.from(source)
            .flat_map(|packet| &packet.submessages)
            .filter(|&&id| id == submessage_id)
            .count()
    }
}

/// A UDP datagram.
#[derive(Clone, Debug, PartialEq)]
pub struct Packet {
    /// Number in the capture, from 1.
    pub number: u64,
    /// Seconds since the first packet.
    pub time: f64,
    /// The sender's address.
    pub source: IpAddr,
    /// The address it was sent to.
    pub destination: IpAddr,
    /// The sender's port.
    pub source_port: u16,
    /// The port it was sent to.
    pub destination_port: u16,
    /// submessageId of each submessage (RTPS 2.5, 9.4.5.1.1); empty: not RTPS.
    pub submessages: Vec<u8>,
    /// tshark's dissectors gave up, or reported an error.
    pub malformed: bool,
    /// What tshark's experts say, of any severity.
    pub remarks: String,
    /// The datagram's bytes.
    pub payload: Vec<u8>,
}

const FIELDS: &[&str] = &[
    "frame.number",
    "frame.time_relative",
    "ip.src",
    "ip.dst",
    "ipv6.src",
    "ipv6.dst",
    "udp.srcport",
    "udp.dstport",
    "rtps.sm.id",
    "_ws.malformed",
    "_ws.expert.severity",
    "_ws.expert.message",
    "udp.payload",
];

/// `PI_ERROR` of Wireshark's expert information.
const SEVERITY_ERROR: u32 = 0x0080_0000;

fn parse_packet(line: &str) -> Result<Packet> {
    let fields: Vec<&str> = line.split('\t').collect();
    let [
        number,
        time,
        v4_from,
        v4_to,
        v6_from,
        v6_to,
        from,
        to,
        ids,
        malformed,
        severity,
        remarks,
        payload,
    ] = fields.as_slice()
    else {
        bail!("{} fields instead of {}", fields.len(), FIELDS.len());
    };
    let errors = list(severity, parse_number)?
        .iter()
        .any(|&severity| severity >= SEVERITY_ERROR);
    let ids = list(ids, parse_number)?;
    Ok(Packet {
        number: number.parse()?,
        time: time.parse()?,
        source: format!("{v4_from}{v6_from}").parse()?,
        destination: format!("{v4_to}{v6_to}").parse()?,
        source_port: from.parse()?,
        destination_port: to.parse()?,
        submessages: ids
            .into_iter()
            .map(u8::try_from)
            .collect::<Result<_, _>>()?,
        malformed: errors || !malformed.is_empty(),
        remarks: (*remarks).to_owned(),
        payload: parse_bytes(payload)?,
    })
}

fn list<T>(field: &str, parse: impl Fn(&str) -> Result<T>) -> Result<Vec<T>> {
    field
        .split(',')
        .filter(|item| !item.is_empty())
        .map(parse)
        .collect()
}

/// tshark prints some numbers in decimal and some in hexadecimal.
fn parse_number(text: &str) -> Result<u32> {
    let number = match text.strip_prefix("0x") {
        Some(digits) => u32::from_str_radix(digits, 16),
        None => text.parse(),
    };
    number.with_context(|| format!("not a number: {text}"))
}

/// tshark prints bytes as hexadecimal digits, with or without colons.
fn parse_bytes(text: &str) -> Result<Vec<u8>> {
    let digits = text.replace(':', "");
    let pairs = digits.as_bytes().chunks(2);
    pairs
        .map(|pair| Ok(u8::from_str_radix(std::str::from_utf8(pair)?, 16)?))
        .collect()
}

/// A file of its own for every capture, removed on drop.
#[derive(Debug)]
struct TemporaryFile {
    path: PathBuf,
}

impl TemporaryFile {
    fn new(extension: &str) -> Self {
        static NEXT: AtomicU32 = AtomicU32::new(0);
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("rtps-tests-{}-{number}.{extension}", std::process::id());
        Self {
            path: std::env::temp_dir().join(name),
        }
    }
}

impl Drop for TemporaryFile {
    fn drop(&mut self) {
        // There is none when the capture did not start.
        let _ = fs::remove_file(&self.path);
    }
}
