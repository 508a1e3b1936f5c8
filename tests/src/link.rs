//! Links between hosts: a veth pair, or a bridge that joins several hosts.
//!
//! Every interface has an IPv4 address of a /24 and an IPv6 address of a /120 with the same last
//! number: 10.1.0.2 and fd00::10.1.0.2. MTU in octets of IP packet.

use std::net::{Ipv4Addr, Ipv6Addr};
use std::thread;
use std::time::{Duration, Instant};

use anyhow::{Result, ensure};
use nix::ifaddrs::getifaddrs;
use nix::net::if_::InterfaceFlags;

use crate::loss::{Direction, Loss, Lossy};
use crate::netns::Netns;

/// On a busy machine namespaces that end hold the lock of all interfaces for seconds.
const CARRIER_TIMEOUT: Duration = Duration::from_secs(30);

/// An interface of a host, up and with its addresses.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interface {
    /// Name inside the host's namespace.
    pub name: String,
    /// The IPv4 address.
    pub v4: Ipv4Addr,
    /// The IPv6 address (unique local).
    pub v6: Ipv6Addr,
}

/// A veth pair between two hosts.
#[derive(Debug)]
pub struct Veth {
    /// The end in the first host.
    pub a: Interface,
    /// The end in the second host.
    pub b: Interface,
}

impl Veth {
    /// Joins two hosts; the interfaces go with either namespace.
    pub fn between(
        a: &Netns,
        b: &Netns,
        address_a: Ipv4Addr,
        address_b: Ipv4Addr,
        mtu: u16,
    ) -> Result<Self> {
        let (name_a, name_b) = (a.next_interface_name(), b.next_interface_name());
        add_veth(a, &name_a, b, &name_b, mtu)?;
        let veth = Self {
            a: configure(a, name_a, address_a)?,
            b: configure(b, name_b, address_b)?,
        };
        wait_running(a, &veth.a)?;
        wait_running(b, &veth.b)?;
        Ok(veth)
    }
}

/// A host with one interface, like those of a [`Bridge`].
#[derive(Debug)]
pub struct Host {
    /// Its namespace.
    pub netns: Netns,
    /// Its one interface beside `lo`.
    pub interface: Interface,
}

/// Hosts joined by a bridge, which has a namespace of its own.
#[derive(Debug)]
pub struct Bridge {
    /// The namespace of the bridge.
    pub hub: Netns,
    /// The hosts, 10.1.0.1, 10.1.0.2...
    pub hosts: Vec<Host>,
    /// The hub's end of each host's link, by its name.
    ports: Vec<String>,
}

impl Bridge {
    /// Makes `count` hosts (at most 254) and joins them.
    pub fn new(label: &str, count: u8, mtu: u16) -> Result<Self> {
        let hub = Netns::new(&format!("{label}-hub"))?;
        // Without snooping multicast is flooded: no querier would keep the memberships alive.
        hub.ip("link add br0 type bridge mcast_snooping 0")?;
        hub.ip("link set br0 up")?;
        let joined = (1..=count).map(|number| Self::join(&hub, label, number, mtu));
        let (hosts, ports) = joined.collect::<Result<_>>()?;
        Ok(Self { hub, hosts, ports })
    }

    /// Loses single packets that the hosts send while the values live, one value for each host: their interfaces take
    /// apart what an app sends in one call, and the bridge is behind them.
    ///
    /// # Errors
    /// When the kernel refuses.
    pub fn lose(&self, loss: Loss) -> Result<Vec<Lossy>> {
        for Host { netns, interface } in &self.hosts {
            netns.ip(&format!("link set {} gso_max_segs 1", interface.name))?;
        }
        let ports = self.ports.iter();
        ports
            .map(|port| Lossy::attach_by_name(&self.hub, port, Direction::Ingress, loss))
            .collect()
    }

    fn join(hub: &Netns, label: &str, number: u8, mtu: u16) -> Result<(Host, String)> {
        let netns = Netns::new(&format!("{label}-{number}"))?;
        let (name, port) = (netns.next_interface_name(), hub.next_interface_name());
        add_veth(&netns, &name, hub, &port, mtu)?;
        hub.ip(&format!("link set {port} master br0 up"))?;
        let interface = configure(&netns, name, Ipv4Addr::new(10, 1, 0, number))?;
        wait_running(&netns, &interface)?;
        Ok((Host { netns, interface }, port))
    }
}

/// Joins two hosts by a new veth pair with the names and addresses of the one that they had.
///
/// # Errors
/// When it is still there.
pub fn join_again(a: &Host, b: &Host, mtu: u16) -> Result<()> {
    add_veth(
        &a.netns,
        &a.interface.name,
        &b.netns,
        &b.interface.name,
        mtu,
    )?;
    for host in [a, b] {
        configure(&host.netns, host.interface.name.clone(), host.interface.v4)?;
    }
    for host in [a, b] {
        wait_running(&host.netns, &host.interface)?;
    }
    Ok(())
}

fn add_veth(a: &Netns, name_a: &str, b: &Netns, name_b: &str, mtu: u16) -> Result<()> {
    let path_b = b.path();
    a.ip(&format!(
        "link add name {name_a} mtu {mtu} type veth peer name {name_b} mtu {mtu} netns {}",
        path_b.display()
    ))
}

fn configure(netns: &Netns, name: String, v4: Ipv4Addr) -> Result<Interface> {
    let v6 = unique_local(v4);
    netns.ip(&format!("address add {v4}/24 dev {name}"))?;
    netns.ip(&format!("address add {v6}/120 dev {name} nodad"))?;
    netns.ip(&format!("link set {name} up"))?;
    Ok(Interface { name, v4, v6 })
}

/// The kernel reports a new carrier a little later, and DDS implementations ignore an interface
/// without one for good.
fn wait_running(netns: &Netns, interface: &Interface) -> Result<()> {
    let deadline = Instant::now() + CARRIER_TIMEOUT;
    while !netns.enter(|| is_running(&interface.name))? {
        ensure!(
            Instant::now() < deadline,
            "{} of {} has no carrier after {CARRIER_TIMEOUT:?}",
            interface.name,
            netns.label()
        );
        thread::sleep(Duration::from_millis(2));
    }
    Ok(())
}

fn is_running(name: &str) -> nix::Result<bool> {
    let mut addresses = getifaddrs()?;
    Ok(addresses.any(|address| {
        address.interface_name == name && address.flags.contains(InterfaceFlags::IFF_RUNNING)
    }))
}

/// fd00:: with the IPv4 address in the last 32 bits.
fn unique_local(v4: Ipv4Addr) -> Ipv6Addr {
    let [a, b, c, d] = v4.octets();
    Ipv6Addr::new(
        0xfd00,
        0,
        0,
        0,
        0,
        0,
        u16::from_be_bytes([a, b]),
        u16::from_be_bytes([c, d]),
    )
}
