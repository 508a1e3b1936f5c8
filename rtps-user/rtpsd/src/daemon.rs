//! From the command line to a running layer, and back to nothing.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use nix::sys::signalfd::SignalFd;
use nix::unistd::geteuid;
use rtps_ebpf::ABI_VERSION;
use rtps_ebpf::abi::Config;
use rtps_net::Interface;
use tracing::info;

use crate::apps::{Access, Apps};
use crate::attachment::Attachment;
use crate::cli::Options;
use crate::domain::{DomainHost, Setting};
use crate::event_loop::{self, EventLoop};
use crate::host::{Host, Parts};
use crate::inboxes::Inboxes;
use crate::kernel_maps::KernelMaps;
use crate::loader::Loader;
use crate::netns;
use crate::news::News;
use crate::own_addresses::own_addresses;
use crate::pins::PinFolder;
use crate::run_folder::RunFolder;
use crate::sign_of_life::SignOfLife;
use crate::status_server::StatusServer;
use crate::store::Identities;
use crate::sys;

/// Runs the layer of this network namespace until SIGTERM or SIGINT, and leaves nothing of it in the kernel then.
///
/// Killed otherwise it leaves everything in place, and the next call takes it over.
pub fn run(options: &Options) -> Result<()> {
    if !geteuid().is_root() {
        bail!(
            "the kernel layer needs root; without it, apps use the in-process layer by themselves"
        );
    }
    netns::join_shared_mounts()?;
    let signals = event_loop::catch_signals()?;
    let inode = netns::inode()?;
    let run_folder = RunFolder::of_namespace(inode);
    let pins = PinFolder::of_namespace(inode);
    run_folder.create()?;
    let lock = run_folder.lock()?;
    let taking_over = pins.exists();
    let outcome = match start(options, inode, &run_folder, &pins, signals) {
        Ok(event_loop) => {
            info!(network_namespace = inode, "ready for apps");
            if let Some(descriptor) = options.ready_fd.and_then(sys::inherited_fd) {
                event_loop::announce_ready(descriptor);
            }
            event_loop.run()
        }
        // What an earlier rtpsd left goes on serving its apps.
        Err(error) if taking_over => return Err(error),
        Err(error) => Err(error),
    };
    let (pins_removed, files_removed) = (pins.remove(), run_folder.remove());
    drop(lock);
    outcome?;
    pins_removed
        .and(files_removed)
        .context("the layer is not gone altogether")?;
    info!("gone");
    Ok(())
}

fn start(
    options: &Options,
    inode: u64,
    run_folder: &RunFolder,
    pins: &PinFolder,
    signals: SignalFd,
) -> Result<EventLoop> {
    let interfaces = find_interfaces(&options.interfaces)?;
    let access = Access::new(options.socket_mode, options.group.as_deref())?;
    pins.create()?;
    let mut loader = Loader::load(pins.clone())?;
    let mut kernel = KernelMaps::open(pins)?;
    let now = Instant::now();
    let domains = join_domains(options, pins, &interfaces, &mut loader, now)?;
    tell_kernel(&mut kernel, &interfaces, &domains)?;
    let mut attachment = Attachment::new(loader, options.mode, options.discovery);
    for interface in &interfaces {
        attachment.attach(interface, &interfaces)?;
    }
    attachment.describe(&interfaces, &mut kernel)?;
    attachment.attach_fan_out(&mut kernel);
    let parts = Parts {
        interfaces,
        kernel,
        domains,
        news: News::open(pins)?,
        inboxes: Inboxes::start(pins)?,
        life: SignOfLife::new(programs_config(options), options.lease),
    };
    let host = Host::new(parts, options.max_ring, now)?;
    let apps = Apps::listen(&run_folder.layer_socket(), &access)?;
    let status = StatusServer::listen(&run_folder.status_socket(), &access)?;
    EventLoop::new(inode, host, apps, status, attachment, signals)
}

/// What the programs act by; the time until which they may answer is that of the sign of life.
fn programs_config(options: &Options) -> Config {
    Config {
        abi_version: ABI_VERSION,
        doorbell: options.doorbell.to_abi(),
        discovery: options.discovery.to_abi(),
        any_source: options.any_source.into(),
        answer_until_ns: 0,
    }
}

fn find_interfaces(names: &[String]) -> Result<Vec<Interface>> {
    let unique: BTreeSet<&String> = names.iter().collect();
    if unique.len() < names.len() {
        bail!("an interface is given twice");
    }
    Ok(names
        .iter()
        .map(|name| rtps_net::find(name))
        .collect::<Result<_, _>>()?)
}

fn join_domains(
    options: &Options,
    pins: &PinFolder,
    interfaces: &[Interface],
    loader: &mut Loader,
    now: Instant,
) -> Result<Vec<DomainHost>> {
    let unique: BTreeSet<u32> = options.domains.iter().copied().collect();
    let mut identities = Identities::open(pins)?;
    identities.forget_others(pins, &unique)?;
    let setting = Setting {
        options,
        peers: &options.all_peers(),
        folder: pins,
        interfaces,
        filter: loader.filter()?,
        now,
    };
    unique
        .into_iter()
        .map(|domain| {
            DomainHost::start(domain, &setting, &mut identities)
                .with_context(|| format!("cannot join domain {domain}"))
        })
        .collect()
}

/// Fills the maps that say what is the layer's.
fn tell_kernel(
    kernel: &mut KernelMaps,
    interfaces: &[Interface],
    domains: &[DomainHost],
) -> Result<()> {
    kernel.count_interfaces(interfaces)?;
    kernel.set_addresses(&own_addresses()?)?;
    let mut ports = BTreeMap::new();
    for domain in domains {
        kernel.set_domain(domain.identity.domain_index, domain.entry())?;
        ports.extend(domain.port_configs());
    }
    kernel.set_ports(&ports)
}
