//! Hosts on different networks, which multicast does not reach: one of the two names the other.

use std::fs;
use std::net::{IpAddr, Ipv4Addr};

use anyhow::Result;
use rtps_tests::layer::{KernelLayer, Layer};
use rtps_tests::link::{Interface, Veth};
use rtps_tests::netns::{Identity, Netns};
use rtps_tests::peers;
use rtps_tests::process::Process;
use rtps_tests::stage::binaries;

use crate::flow::{self, Arguments};
use crate::layers::on_both_layers;

const SAMPLES: u64 = 300;

on_both_layers! {
    we_name_cyclone,
    we_name_cyclone_over_ipv6,
    cyclone_names_us,
    cyclone_names_us_over_ipv6,
    we_name_a_host_of_ours,
}

fn we_name_cyclone(layer: Layer) -> Result<()> {
    let networks = Networks::new()?;
    let cyclone = |arguments: &str| networks.cyclone(Family::V4, arguments);
    we_name(&networks, layer, networks.far.v4.into(), cyclone)
}

fn we_name_cyclone_over_ipv6(layer: Layer) -> Result<()> {
    let networks = Networks::new()?;
    let cyclone = |arguments: &str| networks.cyclone(Family::V6, arguments);
    we_name(&networks, layer, networks.far.v6.into(), cyclone)
}

fn we_name_a_host_of_ours(layer: Layer) -> Result<()> {
    let networks = Networks::new()?;
    let (netns, far) = (&networks.far_netns, &networks.far);
    let host = Host::start(netns, far, layer, None)?;
    we_name(&networks, layer, far.v6.into(), |arguments| {
        host.app(arguments)
    })
}

fn we_name(
    networks: &Networks,
    layer: Layer,
    far: IpAddr,
    subscribe: impl FnOnce(&str) -> Result<Process>,
) -> Result<()> {
    let (netns, interface) = (&networks.near_netns, &networks.near);
    let host = Host::start(netns, interface, layer, Some(far))?;
    let arguments = Arguments::reliable(SAMPLES, 1, "");
    let subscriber = subscribe(&arguments.subscriber)?;
    flow::complete(host.app(&arguments.publisher)?, [subscriber], SAMPLES, 0)
}

fn cyclone_names_us(layer: Layer) -> Result<()> {
    let networks = Networks::new()?;
    names_us(&networks, layer, Family::V4, networks.near.v4.into())
}

fn cyclone_names_us_over_ipv6(layer: Layer) -> Result<()> {
    let networks = Networks::new()?;
    names_us(&networks, layer, Family::V6, networks.near.v6.into())
}

fn names_us(networks: &Networks, layer: Layer, family: Family, near: IpAddr) -> Result<()> {
    let host = Host::start(&networks.near_netns, &networks.near, layer, None)?;
    let arguments = Arguments::reliable(SAMPLES, 1, "");
    let app = host.app(&arguments.subscriber)?;
    let publisher = format!("{} --peer {near}", arguments.publisher);
    let publisher = networks.cyclone(family, &publisher)?;
    flow::complete(publisher, [app], SAMPLES, 0)
}

#[derive(Clone, Copy)]
enum Family {
    V4,
    V6,
}

/// Two hosts with a router between them, which does not forward multicast.
struct Networks {
    near_netns: Netns,
    near: Interface,
    far_netns: Netns,
    far: Interface,
    _router: Netns,
}

impl Networks {
    fn new() -> Result<Self> {
        let near_netns = Netns::new("routed-near")?;
        let router = Netns::new("router")?;
        let far_netns = Netns::new("routed-far")?;
        let address = |network, host| Ipv4Addr::new(10, network, 0, host);
        let near = Veth::between(&near_netns, &router, address(1, 1), address(1, 2), 1500)?;
        let far = Veth::between(&far_netns, &router, address(2, 1), address(2, 2), 1500)?;
        for family in ["ipv4", "ipv6"] {
            let setting = format!("/proc/sys/net/{family}/conf/all/forwarding");
            router.enter(|| fs::write(&setting, "1"))?;
        }
        for (host, gateway) in [(&near_netns, &near.b), (&far_netns, &far.b)] {
            host.ip(&format!("route add default via {}", gateway.v4))?;
            host.ip(&format!("-6 route add default via {}", gateway.v6))?;
        }
        Ok(Self {
            near_netns,
            near: near.a,
            far_netns,
            far: far.a,
            _router: router,
        })
    }

    /// Starts Cyclone DDS on the far host, on ports that others can compute.
    fn cyclone(&self, family: Family, arguments: &str) -> Result<Process> {
        let cyclone = peers::cyclone()?;
        let arguments = format!("{arguments} --multicast off");
        let (netns, interface) = (&self.far_netns, &self.far);
        let mut command = match family {
            Family::V4 => cyclone.command(netns, interface, &arguments),
            Family::V6 => cyclone.command_over_ipv6(netns, interface, &arguments),
        };
        Process::spawn("cyclone on another network", &mut command)
    }
}

/// A host with apps of ours.
struct Host<'a> {
    netns: &'a Netns,
    layer: Layer,
    peers: String,
    _daemon: Option<KernelLayer<'a>>,
}

impl<'a> Host<'a> {
    /// The layer that has the apps' discovery is told of `peer`: rtpsd by its command line.
    fn start(
        netns: &'a Netns,
        interface: &Interface,
        layer: Layer,
        peer: Option<IpAddr>,
    ) -> Result<Self> {
        let peers = peer.map(|peer| peer.to_string()).unwrap_or_default();
        let start = |of_layer: &[&str]| {
            let mut arguments = [of_layer, &["--no-multicast"]].concat();
            if peer.is_some() {
                arguments.extend(["--peer", &peers]);
            }
            let rtpsd = binaries()?.rtpsd();
            KernelLayer::start(&rtpsd, netns, &interface.name, &arguments)
        };
        let daemon = layer.daemon_arguments().map(start).transpose()?;
        Ok(Self {
            netns,
            layer,
            peers,
            _daemon: daemon,
        })
    }

    fn app(&self, arguments: &str) -> Result<Process> {
        let program = binaries()?.example("shapes");
        let mut command = self.netns.command_as(Identity::NOBODY, &program)?;
        command
            .args(arguments.split_whitespace())
            .env("RTPS_LAYER", self.layer.name())
            .env("ROS_STATIC_PEERS", &self.peers);
        Process::spawn("app on another network", &mut command)
    }
}
