//! Where a scenario plays: two hosts joined by a link, with a layer of ours on both or on the first.

use std::process::Command;

use anyhow::Result;
use rtps_tests::capture::Capture;
use rtps_tests::layer::{KernelLayer, Layer};
use rtps_tests::link::Host;
use rtps_tests::loss::{Direction, Loss, Lossy};
use rtps_tests::netns::Identity;
use rtps_tests::peers::Peer;
use rtps_tests::process::Process;
use rtps_tests::stage::{self, binaries, spawn_peer};

/// The program.
const PROGRAM: &str = "shape_main";

/// Two hosts joined by a veth pair.
pub(crate) struct Stage {
    hosts: [Host; 2],
}

impl Stage {
    pub(crate) fn new(label: &str) -> Result<Self> {
        // Whoever is started first must not wait for a build.
        binaries()?;
        let hosts = stage::hosts(label)?;
        Ok(Self { hosts })
    }

    /// Starts the layer of both hosts.
    pub(crate) fn with(&self, layer: Layer) -> Result<Ends<'_>> {
        let [near, far] = &self.hosts;
        Ok(Ends {
            layer,
            near,
            far,
            partition: None,
            _daemons: [start(near, layer)?, start(far, layer)?],
        })
    }

    /// Starts the layer of the first host: another vendor's programs are on the other.
    pub(crate) fn with_near(&self, layer: Layer) -> Result<Ends<'_>> {
        let [near, far] = &self.hosts;
        Ok(Ends {
            layer,
            near,
            far,
            partition: None,
            _daemons: [start(near, layer)?, None],
        })
    }

    /// As [`Stage::with_near`], for programs that cannot do with IPv6.
    pub(crate) fn with_near_over_ipv4(&self, layer: Layer) -> Result<Ends<'_>> {
        for host in &self.hosts {
            host.netns.disable_ipv6()?;
        }
        self.with_near(layer)
    }
}

fn start(host: &Host, layer: Layer) -> Result<Option<KernelLayer<'_>>> {
    let daemon = layer.daemon_arguments().map(|arguments| {
        let rtpsd = binaries()?.rtpsd();
        KernelLayer::start(&rtpsd, &host.netns, &host.interface.name, arguments)
    });
    daemon.transpose()
}

/// The hosts with their layers.
pub(crate) struct Ends<'a> {
    layer: Layer,
    near: &'a Host,
    far: &'a Host,
    partition: Option<&'static str>,
    _daemons: [Option<KernelLayer<'a>>; 2],
}

impl Ends<'_> {
    /// The same hosts, for programs that meet only each other.
    pub(crate) fn in_partition(&self, name: &'static str) -> Ends<'_> {
        Ends {
            partition: Some(name),
            _daemons: [None, None],
            ..*self
        }
    }

    /// A publisher of topic Square on the first host, which prints what it writes.
    pub(crate) fn publisher(&self, arguments: &str) -> Result<Process> {
        spawn(self.command(self.near, &format!("-P -t Square -w {arguments}"))?)
    }

    /// A subscriber of topic Square on the other host.
    pub(crate) fn subscriber(&self, arguments: &str) -> Result<Process> {
        spawn(self.command(self.far, &format!("-S -t Square {arguments}"))?)
    }

    /// As [`Ends::subscriber`], on the first host.
    pub(crate) fn near_subscriber(&self, arguments: &str) -> Result<Process> {
        spawn(self.command(self.near, &format!("-S -t Square {arguments}"))?)
    }

    /// Another vendor's program on the other host; its topic is Square too.
    pub(crate) fn peer(&self, peer: &Peer, arguments: &str) -> Result<Process> {
        spawn_peer(&self.far.netns, &self.far.interface, peer, arguments)
    }

    /// As [`Ends::subscriber`], with a content filter.
    pub(crate) fn filtered_subscriber(&self, arguments: &str, filter: &str) -> Result<Process> {
        let mut command = self.command(self.far, &format!("-S -t Square {arguments}"))?;
        command.args(["--cft", filter]);
        spawn(command)
    }

    /// Loses packets in both directions while the value lives: at the sender's end, before XDP takes them off the link.
    pub(crate) fn lose(&self, loss: Loss) -> Result<[Lossy; 2]> {
        let attach =
            |host: &Host| Lossy::attach(&host.netns, &host.interface, Direction::Egress, loss);
        Ok([attach(self.near)?, attach(self.far)?])
    }

    /// Captures what both hosts send.
    pub(crate) fn capture(&self) -> Result<Capture> {
        Capture::start(&self.near.netns, &self.near.interface.name)
    }

    /// The program with arguments separated by spaces, without rights, on the first host.
    pub(crate) fn near_command(&self, arguments: &str) -> Result<Command> {
        self.command(self.near, arguments)
    }

    fn command(&self, host: &Host, arguments: &str) -> Result<Command> {
        let program = binaries()?.example(PROGRAM);
        let mut command = host.netns.command_as(Identity::NOBODY, &program)?;
        command
            .args(arguments.split_whitespace())
            .args(
                self.partition
                    .map(|name| ["-p", name])
                    .into_iter()
                    .flatten(),
            )
            .env("RTPS_LAYER", self.layer.name());
        Ok(command)
    }
}

fn spawn(mut command: Command) -> Result<Process> {
    let arguments: Vec<_> = command
        .get_args()
        .map(|word| word.display().to_string())
        .collect();
    Process::spawn(&format!("{PROGRAM} {}", arguments.join(" ")), &mut command)
}

/// Makes two tests of each scenario: `NAME::kernel` and `NAME::in_process`. The layer is that of both hosts, as
/// [`Stage::with`] starts it, unless the scenario names another method of [`Stage`] in parentheses.
macro_rules! on_both_layers {
    ($($scenario:ident $(($with:ident))?),+ $(,)?) => {
        $(crate::stage::tests! { $scenario $(($with))?: kernel(Kernel), in_process(InProcess) })+
    };
}
pub(crate) use on_both_layers;

/// Makes a test of each scenario where the layer makes no difference: `NAME::in_process`.
macro_rules! on_the_in_process_layer {
    ($($scenario:ident),+ $(,)?) => {
        $(crate::stage::tests! { $scenario: in_process(InProcess) })+
    };
}
pub(crate) use on_the_in_process_layer;

/// The module of a scenario.
macro_rules! tests {
    ($scenario:ident: $($name:ident($layer:ident)),+) => {
        crate::stage::tests! { $scenario(with): $($name($layer)),+ }
    };
    ($scenario:ident($with:ident): $($name:ident($layer:ident)),+) => {
        mod $scenario {
            $(
                #[test]
                fn $name() -> anyhow::Result<()> {
                    rtps_tests::skip_unless!(rtps_tests::require::root());
                    let stage = crate::stage::Stage::new(stringify!($scenario))?;
                    super::$scenario(&stage.$with(rtps_tests::layer::Layer::$layer)?)
                }
            )+
        }
    };
}
pub(crate) use tests;
