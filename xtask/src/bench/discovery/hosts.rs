//! The two hosts of a measurement, and what runs on them.

use std::net::Ipv4Addr;
use std::time::{Duration, Instant};

use anyhow::Result;
use nix::unistd::Pid;
use rtps_tests::layer::KernelLayer;
use rtps_tests::link::{Host, Veth};
use rtps_tests::netns::{Identity, Netns};
use rtps_tests::process::Process;

use super::Stack;
use super::programs::Programs;
use super::usage;
use super::waiting;

/// Endpoints of an app: so many writers, and as many readers.
pub(super) const ENDPOINTS: usize = 5;
/// What the start of a program takes at most.
pub(super) const START: Duration = Duration::from_secs(60);
/// Configuration of Cyclone DDS with which participants of one host do not find each other.
const STRANGERS: &str =
    "<General><EnableMulticastLoopback>false</EnableMulticastLoopback></General>";
/// Apps that start at the same time: more would only hinder each other.
const WAVE: usize = 10;
/// Nobody on a busy machine is at rest sooner.
const SHORTEST_SETTLING: Duration = Duration::from_secs(4);
/// CPU seconds that what is at rest may use in a second.
const AT_REST: f64 = 0.05;

/// Two hosts joined by a veth pair of the usual MTU: 10.1.0.1, which is measured, and 10.1.0.2.
pub(super) struct Hosts {
    pub(super) measured: Host,
    pub(super) remote: Host,
}

impl Hosts {
    pub(super) fn new() -> Result<Self> {
        let (near, far) = (Netns::new("measured")?, Netns::new("remote")?);
        let [from, to] = [1, 2].map(|host| Ipv4Addr::new(10, 1, 0, host));
        let veth = Veth::between(&near, &far, from, to, 1500)?;
        let host = |netns, interface| Host { netns, interface };
        Ok(Self {
            measured: host(near, veth.a),
            remote: host(far, veth.b),
        })
    }

    /// Starts a stack on the measured host, with apps that each wait until all of their endpoints have `matches`.
    pub(super) fn start(&self, programs: &Programs, start: Start<'_>) -> Result<Running<'_>> {
        let layer = match start.stack {
            Stack::Kernel => Some(self.load(programs, &[])?),
            Stack::User => Some(self.load(programs, &["--discovery", "user"])?),
            Stack::Cyclone => None,
        };
        let mut apps = Vec::new();
        while apps.len() < start.apps {
            let first = apps.len();
            for number in first..start.apps.min(first + WAVE) {
                apps.push(match layer {
                    Some(_) => self.app_of_ours(programs, number, start.app_arguments)?,
                    None => self.cyclone(programs, &start)?,
                });
            }
            for app in &mut apps[first..] {
                waiting::require(app, "ready", START)?;
            }
        }
        Ok(Running { layer, apps })
    }

    fn load(&self, programs: &Programs, arguments: &[&str]) -> Result<KernelLayer<'_>> {
        let Host { netns, interface } = &self.measured;
        KernelLayer::start(&programs.rtpsd(), netns, &interface.name, arguments)
    }

    fn app_of_ours(&self, programs: &Programs, number: usize, arguments: &str) -> Result<Process> {
        let netns = &self.measured.netns;
        let mut command = netns.command_as(Identity::NOBODY, &programs.this)?;
        command
            .args(["bench", "discovery-app"])
            .args(arguments.split_whitespace())
            .env("RTPS_LAYER", "kernel");
        Process::spawn(&format!("app {number}"), &mut command)
    }

    fn cyclone(&self, programs: &Programs, start: &Start<'_>) -> Result<Process> {
        let Host { netns, interface } = &self.measured;
        let arguments = start.app_arguments;
        let mut command = programs.cyclone.command(netns, interface, arguments);
        if start.is_crowded() {
            command.env("CYCLONEDDS_URI", STRANGERS);
        }
        Process::spawn("Cyclone DDS", &mut command)
    }

    /// Starts one of this program's other roles on the remote host.
    pub(super) fn remote_role(&self, programs: &Programs, arguments: &str) -> Result<Process> {
        // Each simulated participant has a socket.
        let mut command = self.remote.netns.command("prlimit");
        command
            .arg("--nofile=8192:8192")
            .arg(&programs.this)
            .arg("bench")
            .args(arguments.split_whitespace());
        Process::spawn(arguments, &mut command)
    }
}

/// What is started on the measured host.
pub(super) struct Start<'a> {
    pub(super) stack: Stack,
    pub(super) apps: usize,
    /// Those of the app, of ours or of Cyclone DDS.
    pub(super) app_arguments: &'a str,
}

impl Start<'_> {
    /// Whether the apps are kept from finding each other: so many participants of Cyclone DDS on one small machine never
    /// come to rest once they have, and then do not find a remote within minutes.
    pub(super) fn is_crowded(&self) -> bool {
        self.stack == Stack::Cyclone && self.apps > 100
    }
}

/// A stack and its apps, which end with the value.
pub(super) struct Running<'a> {
    pub(super) layer: Option<KernelLayer<'a>>,
    pub(super) apps: Vec<Process>,
}

impl Running<'_> {
    /// The process of the layer; Cyclone DDS has none.
    pub(super) fn daemon(&mut self) -> Option<Pid> {
        self.layer.as_mut().map(|layer| layer.process().pid())
    }

    /// CPU seconds of all processes and kernel programs so far.
    pub(super) fn cpu_seconds(&mut self) -> Result<f64> {
        let mut seconds = 0.0;
        if let Some(daemon) = self.daemon() {
            seconds += usage::cpu_seconds(daemon)? + usage::program_seconds(daemon)?;
        }
        for app in &self.apps {
            seconds += usage::cpu_seconds(app.pid())?;
        }
        Ok(seconds)
    }

    /// Waits until the processes have nothing more to do. False when they still have after that time: many participants
    /// of other stacks on one host are never at rest.
    pub(super) fn settle(&mut self, patience: Duration) -> Result<bool> {
        const SECOND: Duration = Duration::from_secs(1);
        let deadline = Instant::now() + patience;
        waiting::pause(SHORTEST_SETTLING)?;
        while Instant::now() < deadline {
            let before = self.cpu_seconds()?;
            waiting::pause(SECOND)?;
            if self.cpu_seconds()? - before < AT_REST {
                return Ok(true);
            }
        }
        Ok(false)
    }
}
