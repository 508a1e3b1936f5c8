//! What people and tools see of the kernel layer: one JSON document.
//!
//! A running rtpsd writes it to whoever connects to its status socket. Without one, [`status`] reads what the pins
//! tell, for the low-level layer goes on delivering.

use std::collections::BTreeMap;
use std::io::{self, Read};
use std::os::unix::net::UnixStream;
use std::time::Duration;

use anyhow::{Context, Result};
use nix::net::if_::if_indextoname;
use nix::unistd::geteuid;
use rtps_ebpf::abi::{DISCOVERY_KERNEL, DOORBELL_PACKET};
use rtps_ebpf::{ABI_VERSION, Counter};
use serde::{Deserialize, Serialize};

use crate::apps::Apps;
use crate::attachment::Attachment;
use crate::host::Host;
use crate::kernel_maps::KernelMaps;
use crate::loader::AttachedMode;
use crate::netns;
use crate::pins::{Hook, PinFolder};
use crate::run_folder::RunFolder;
use crate::store::Identities;

/// How long rtpsd may take to answer.
const ANSWER_TIME: Duration = Duration::from_secs(5);

/// Who answers where the kernel does not.
const RTPSD: &str = "rtpsd";

/// Who does what programs do.
const KERNEL: &str = "kernel";

/// Who sends to each destination where the kernel does not.
const APP: &str = "app";

/// The kernel layer of one network namespace.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Status {
    /// Whether something of the layer is in the kernel.
    pub loaded: bool,
    /// The process id of rtpsd; none when it does not run.
    pub rtpsd: Option<i32>,
    /// The inode of the network namespace.
    pub network_namespace: u64,
    /// The version of the interface between the programs and rtpsd.
    pub abi_version: u32,
    /// Where everything is pinned.
    pub pins: String,
    /// How sleeping apps are woken: "packet" or "ring"; none while the programs leave every packet alone.
    pub doorbell: Option<String>,
    /// Who is to answer discovery messages: "kernel", which leaves to rtpsd what it cannot, or "user" for rtpsd alone;
    /// none while the programs leave every packet alone.
    pub discovery: Option<String>,
    /// Who sends to several destinations what an app sends once: "kernel", or "app: " and why.
    pub fan_out: String,
    /// How often something has woken rtpsd; none when it does not run.
    pub wakeups: Option<u64>,
    /// The interfaces that the layer works on.
    pub interfaces: Vec<InterfaceStatus>,
    /// Domains, with what discovery knows.
    pub domains: Vec<DomainStatus>,
    /// Attached apps.
    pub apps: Vec<AppStatus>,
    /// What the kernel counted since it was loaded, by interface ("other" for the rest) and name.
    pub counters: BTreeMap<String, BTreeMap<String, u64>>,
}

/// An interface that the layer works on.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct InterfaceStatus {
    /// Its name.
    pub name: String,
    /// Its index.
    pub index: u32,
    /// The mode that took effect.
    pub mode: AttachedMode,
    /// Who answers discovery messages that come in there: "kernel", or "rtpsd: " and why.
    pub answers: String,
}

/// A domain.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct DomainStatus {
    /// The domain id.
    pub domain: u32,
    /// The GUID prefix of the host's participant, in hexadecimal.
    pub prefix: String,
    /// The participant id, which the unicast ports follow from.
    pub participant_id: Option<u16>,
    /// How often rtpsd has been started as this participant.
    pub incarnation: u32,
    /// [`LayerStatus`](rtps_user::layer::LayerStatus): participants, endpoints, matches; none when rtpsd does not
    /// run.
    pub discovery: Option<serde_json::Value>,
}

/// An attached app.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct AppStatus {
    /// Its slot.
    pub slot: u8,
    /// Its domain; none when rtpsd does not run.
    pub domain: Option<u32>,
    /// Its name; empty when it has not come back to a restarted rtpsd.
    pub name: String,
    /// Its process id, as rtpsd sees it.
    pub pid: Option<i32>,
    /// Its user.
    pub uid: Option<u32>,
    /// The UDP port that serves as its doorbell.
    pub doorbell_port: u32,
    /// The size of its ring in bytes.
    pub ring_bytes: u32,
    /// How much of the ring waits to be read, in bytes.
    pub ring_fill: u64,
}

/// The status of the kernel layer in the calling thread's network namespace. Without a running rtpsd the thread may
/// end up in the mount namespace of process 1.
pub fn status() -> Result<Status> {
    let inode = netns::inode()?;
    let run = RunFolder::of_namespace(inode);
    match UnixStream::connect(run.status_socket()) {
        Ok(stream) => ask(stream),
        Err(error) if error.kind() == io::ErrorKind::PermissionDenied => Err(error)
            .context("may not ask rtpsd; be root, or in the group that the layer was loaded with"),
        Err(_) => {
            if geteuid().is_root() {
                netns::join_shared_mounts()?;
            }
            let rtpsd = run.daemon()?.map(nix::unistd::Pid::as_raw);
            status_of_pins(inode, rtpsd)
        }
    }
}

fn ask(mut stream: UnixStream) -> Result<Status> {
    stream.set_read_timeout(Some(ANSWER_TIME))?;
    let mut answer = String::new();
    stream
        .read_to_string(&mut answer)
        .context("rtpsd runs but does not answer; is it stopped?")?;
    serde_json::from_str(&answer).context("rtpsd is of another version; load the layer again")
}

/// What the pins tell, which takes root.
fn status_of_pins(inode: u64, rtpsd: Option<i32>) -> Result<Status> {
    let folder = PinFolder::of_namespace(inode);
    let mut status = Status {
        loaded: folder.exists(),
        rtpsd,
        network_namespace: inode,
        abi_version: ABI_VERSION,
        pins: folder.path().display().to_string(),
        doorbell: None,
        discovery: None,
        fan_out: format!("{APP}: the program is not attached"),
        wakeups: None,
        interfaces: Vec::new(),
        domains: Vec::new(),
        apps: Vec::new(),
        counters: BTreeMap::new(),
    };
    if status.loaded {
        let kernel = KernelMaps::open(&folder)?;
        fill_from_kernel(&mut status, &folder, &kernel)?;
    }
    Ok(status)
}

/// The parts of a running rtpsd that know something.
pub(crate) struct Running<'a> {
    pub(crate) host: &'a Host,
    pub(crate) apps: &'a Apps,
    pub(crate) attachment: &'a Attachment,
    pub(crate) wakeups: u64,
}

/// What the running rtpsd knows.
pub(crate) fn status_of_daemon(inode: u64, running: &Running<'_>) -> Result<Status> {
    let mut status = status_of_pins(inode, i32::try_from(std::process::id()).ok())?;
    status.wakeups = Some(running.wakeups);
    if let Some(reason) = running.attachment.fan_out_refusal() {
        status.fan_out = format!("{APP}: {reason}");
    }
    for interface in &mut status.interfaces {
        if let Some(reason) = running.attachment.refusal(interface.index) {
            interface.answers = format!("{RTPSD}: {reason}");
        }
    }
    let by_slot: BTreeMap<u8, _> = running
        .apps
        .attached()
        .map(|(connection, seat)| (seat.slot, (connection, seat)))
        .collect();
    for app in &mut status.apps {
        if let Some((connection, seat)) = by_slot.get(&app.slot) {
            app.domain = Some(seat.domain);
            app.name.clone_from(&seat.name);
            app.pid = Some(connection.pid);
            app.uid = Some(connection.uid);
        }
    }
    for domain in &mut status.domains {
        let mut hosts = running.host.domains.iter();
        let served = hosts.find(|host| host.id == domain.domain);
        if let Some(served) = served {
            domain.discovery = Some(serde_json::to_value(served.layer.status())?);
        }
    }
    Ok(status)
}

fn fill_from_kernel(status: &mut Status, folder: &PinFolder, kernel: &KernelMaps) -> Result<()> {
    if let Some(config) = kernel.config() {
        let is_packet = config.doorbell == DOORBELL_PACKET;
        status.doorbell = Some(if is_packet { "packet" } else { "ring" }.to_owned());
        let is_kernel = config.discovery == DISCOVERY_KERNEL;
        status.discovery = Some(if is_kernel { KERNEL } else { "user" }.to_owned());
    }
    fill_interfaces(status, folder, kernel)?;
    for (domain, identity) in Identities::open(folder)?.all()? {
        status.domains.push(DomainStatus {
            domain,
            prefix: identity.prefix.to_string(),
            participant_id: identity.participant_id,
            incarnation: identity.incarnation,
            discovery: None,
        });
    }
    status.domains.sort_by_key(|domain| domain.domain);
    for (slot, app) in kernel.attached_apps()? {
        let (ring_bytes, ring_fill) = kernel.ring_usage(slot).unwrap_or_default();
        status.apps.push(AppStatus {
            slot,
            domain: None,
            name: String::new(),
            pid: None,
            uid: None,
            doorbell_port: app.doorbell_port,
            ring_bytes,
            ring_fill,
        });
    }
    for (index, counts) in kernel.counters()? {
        let named = Counter::ALL.iter().zip(counts);
        let named = named.map(|(counter, count)| (counter.name().to_owned(), count));
        status
            .counters
            .insert(interface_name(index), named.collect());
    }
    Ok(())
}

fn fill_interfaces(status: &mut Status, folder: &PinFolder, kernel: &KernelMaps) -> Result<()> {
    let answering = kernel.discovery.interfaces();
    let mut modes: BTreeMap<u32, AttachedMode> = BTreeMap::new();
    for link in folder.links()? {
        match link.hook {
            Hook::Xdp(hook) => _ = modes.insert(link.interface_index, hook.into()),
            // It is there beside XDP as well.
            Hook::Ingress => {
                _ = modes
                    .entry(link.interface_index)
                    .or_insert(AttachedMode::Tc)
            }
            Hook::FanOut => KERNEL.clone_into(&mut status.fan_out),
        }
    }
    for (index, mode) in modes {
        let answers = if answering.contains(&index) {
            KERNEL.to_owned()
        } else {
            format!("{RTPSD}: the kernel was not told to")
        };
        status.interfaces.push(InterfaceStatus {
            name: interface_name(index),
            index,
            mode,
            answers,
        });
    }
    Ok(())
}

fn interface_name(index: u32) -> String {
    match if_indextoname(index) {
        _ if index == 0 => "other".to_owned(),
        Ok(name) => name.to_string_lossy().into_owned(),
        Err(_) => format!("gone-{index}"),
    }
}
