//! Publishers and subscribers of ShapeType on other vendors' libraries, taken unmodified from
//! Debian.
//!
//! The programs are in `tests/peers`; they are built into `<cargo target>/peers` when their
//! sources changed, and missing Debian packages are installed first when this process is root.
//! Both have the same command line (`--help` prints it) and print one JSON object a line:
//! `matched`, `sample` (its number in `x`), `disposed`, `unregistered`, `incompatible_qos`,
//! `liveliness`, `deadline_missed`, `error`, `done`. They exit with 0 when `--count` is reached.

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};
use nix::fcntl::{Flock, FlockArg};

use crate::debian::{self, Package};
use crate::link::Interface;
use crate::netns::Netns;

/// A peer program, built and ready to run.
#[derive(Clone, Debug)]
pub struct Peer {
    vendor: Vendor,
    program: PathBuf,
}

/// Eclipse Cyclone DDS 0.10.
///
/// # Errors
/// Without a compiler or the library, with the command that installs them.
pub fn cyclone() -> Result<Peer> {
    Peer::build(Vendor::Cyclone)
}

/// eProsima Fast DDS 2.9; it knows XCDR1 only and disposes by key hash only.
///
/// # Errors
/// Without a compiler or the library, with the command that installs them.
pub fn fast_dds() -> Result<Peer> {
    Peer::build(Vendor::FastDds)
}

/// Cyclone DDS again: one participant with many endpoints that tells when all are matched, for measurements of
/// discovery. Its command line is another one (`--help` prints it); its events are `ready`, `matched`, `error`.
///
/// # Errors
/// Without a compiler or the library, with the command that installs them.
pub fn cyclone_discovery() -> Result<Peer> {
    Peer::build(Vendor::CycloneDiscovery)
}

/// Fast DDS again: round trips and streams, measured like those of `rtps perf`. Its command line is another one (without
/// arguments it prints it); its events are `ready` and `summary`.
///
/// # Errors
/// Without a compiler or the library, with the command that installs them.
pub fn fast_dds_perf() -> Result<Peer> {
    Peer::build(Vendor::FastDdsPerf)
}

impl Peer {
    /// The program's file.
    #[must_use]
    pub fn program(&self) -> &Path {
        &self.program
    }

    /// The vendor's name, for messages.
    #[must_use]
    pub fn name(&self) -> &'static str {
        self.vendor.name()
    }

    /// A command for a host, with arguments separated by spaces; the interface is added to them.
    #[must_use]
    pub fn command(&self, netns: &Netns, interface: &Interface, arguments: &str) -> Command {
        let mut command = netns.command(&self.program);
        command
            .args(arguments.split_whitespace())
            .arg("--interface");
        match self.vendor {
            Vendor::Cyclone | Vendor::CycloneDiscovery => command.arg(&interface.name),
            Vendor::FastDds | Vendor::FastDdsPerf => command.arg(interface.v4.to_string()),
        };
        command
    }

    /// As [`Peer::command`], for a program that uses IPv6 and nothing else.
    #[must_use]
    pub fn command_over_ipv6(
        &self,
        netns: &Netns,
        interface: &Interface,
        arguments: &str,
    ) -> Command {
        const CYCLONE: &str = "<General><Transport>udp6</Transport></General>";
        let mut command = self.command(netns, interface, arguments);
        match self.vendor {
            Vendor::Cyclone | Vendor::CycloneDiscovery => command.env("CYCLONEDDS_URI", CYCLONE),
            // The last one counts.
            Vendor::FastDds | Vendor::FastDdsPerf => {
                command.args(["--interface", &interface.v6.to_string()])
            }
        };
        command
    }

    fn build(vendor: Vendor) -> Result<Self> {
        let directory = target_dir()?.join("peers");
        let program = directory.join(vendor.name());
        let stamp = directory.join(format!("{}.stamp", vendor.name()));
        let wanted = vendor.fingerprint()?;
        let is_current = || {
            fs::read_to_string(&stamp).is_ok_and(|built| built == wanted) && is_runnable(&program)
        };
        if !is_current() {
            fs::create_dir_all(&directory)?;
            let lock = File::create(directory.join("lock"))?;
            let _lock =
                Flock::lock(lock, FlockArg::LockExclusive).map_err(|(_file, error)| error)?;
            // Another process may have built it meanwhile.
            if !is_current() {
                debian::ensure_installed(vendor.packages())?;
                eprintln!("building the {} peer", vendor.name());
                vendor
                    .compile(&directory, &program)
                    .with_context(|| format!("building the {} peer", vendor.name()))?;
                fs::write(&stamp, &wanted)?;
            }
        }
        Ok(Self { vendor, program })
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Vendor {
    Cyclone,
    CycloneDiscovery,
    FastDds,
    FastDdsPerf,
}

impl Vendor {
    fn name(self) -> &'static str {
        match self {
            Self::Cyclone => "cyclone",
            Self::CycloneDiscovery => "cyclone-discovery",
            Self::FastDds => "fastdds",
            Self::FastDdsPerf => "fastdds-perf",
        }
    }

    fn packages(self) -> &'static [Package] {
        const GCC: Package = Package::new("gcc", "/usr/bin/gcc");
        const GXX: Package = Package::new("g++", "/usr/bin/g++");
        const LIBC: Package = Package::new("libc6-dev", "/usr/include/stdio.h");
        match self {
            Self::Cyclone | Self::CycloneDiscovery => {
                &const {
                    [
                        GCC,
                        LIBC,
                        Package::new("cyclonedds-dev", "/usr/include/dds/dds.h"),
                        Package::new("cyclonedds-tools", "/usr/bin/idlc"),
                    ]
                }
            }
            Self::FastDds | Self::FastDdsPerf => {
                &const {
                    [
                        GCC,
                        GXX,
                        LIBC,
                        Package::new("libfastcdr-dev", "/usr/include/fastcdr/Cdr.h"),
                        Package::new(
                            "libfastrtps-dev",
                            "/usr/include/fastdds/dds/topic/TopicDataType.hpp",
                        ),
                    ]
                }
            }
        }
    }

    fn sources(self) -> &'static [&'static str] {
        match self {
            Self::Cyclone => &["peer.h", "peer.c", "ShapeType.idl", "cyclone.c"],
            Self::CycloneDiscovery => &["peer.h", "peer.c", "ShapeType.idl", "discovery.c"],
            Self::FastDds => &[
                "peer.h",
                "peer.c",
                "shape_type.hpp",
                "shape_type.cpp",
                "fastdds.cpp",
            ],
            Self::FastDdsPerf => &["peer.h", "peer.c", "fastdds_perf.cpp"],
        }
    }

    /// What a build was made of: the text of all its sources.
    fn fingerprint(self) -> Result<String> {
        self.sources()
            .iter()
            .map(|name| {
                let path = sources_dir().join(name);
                fs::read_to_string(&path).with_context(|| format!("reading {}", path.display()))
            })
            .collect()
    }

    fn compile(self, directory: &Path, program: &Path) -> Result<()> {
        let directory = directory.join(format!("{}.build", self.name()));
        fs::create_dir_all(&directory)?;
        let workshop = Workshop { directory };
        workshop.compile_c("peer.o", &source("peer.c"), &[])?;
        match self {
            Self::Cyclone => workshop.cyclone("cyclone.c")?,
            Self::CycloneDiscovery => workshop.cyclone("discovery.c")?,
            Self::FastDds => workshop.fast_dds(&["fastdds.cpp", "shape_type.cpp"], "-O1")?,
            Self::FastDdsPerf => workshop.fast_dds(&["fastdds_perf.cpp"], "-O2")?,
        }
        // Replaced as a whole: an older program of that name may be running.
        fs::rename(workshop.directory.join("program"), program)?;
        Ok(())
    }
}

/// The directory where a peer is compiled, into a file `program`.
struct Workshop {
    directory: PathBuf,
}

impl Workshop {
    fn cyclone(&self, program: &str) -> Result<()> {
        for extensibility in ["final", "appendable"] {
            fs::create_dir_all(self.directory.join(extensibility))?;
            self.run(
                Command::new("idlc")
                    .args(["-x", extensibility, "-o", extensibility])
                    .arg(source("ShapeType.idl")),
            )?;
            let rename = format!("-DShapeType_desc=ShapeType_{extensibility}_desc");
            self.compile_c(
                &format!("{extensibility}.o"),
                &self.directory.join(extensibility).join("ShapeType.c"),
                &[&rename],
            )?;
        }
        // The struct is the same in both headers.
        self.compile_c("cyclone.o", &source(program), &["-Ifinal"])?;
        self.run(Command::new("gcc").args([
            "-o",
            "program",
            "cyclone.o",
            "peer.o",
            "final.o",
            "appendable.o",
            "-lddsc",
        ]))
    }

    fn fast_dds(&self, sources: &[&str], optimization: &str) -> Result<()> {
        self.run(
            Command::new("g++")
                .args(["-std=c++17", optimization, "-o", "program"])
                .args(sources.iter().map(|name| source(name)))
                .args(["peer.o", "-lfastrtps"]),
        )
    }

    fn compile_c(&self, object: &str, source: &Path, flags: &[&str]) -> Result<()> {
        self.run(
            Command::new("gcc")
                .args(["-O2", "-c", "-o", object])
                .args(flags)
                .arg(source),
        )
    }

    fn run(&self, command: &mut Command) -> Result<()> {
        let output = command
            .current_dir(&self.directory)
            .output()
            .with_context(|| format!("running {}", command.get_program().display()))?;
        if !output.status.success() {
            let words = String::from_utf8_lossy(&output.stderr);
            bail!("{} failed:\n{words}", command.get_program().display());
        }
        Ok(())
    }
}

/// Whether a peer starts: the library that it was built with may have been removed since.
fn is_runnable(program: &Path) -> bool {
    const CANNOT_LOAD: i32 = 127;
    Command::new(program)
        .arg("--help")
        .output()
        .is_ok_and(|output| output.status.code().is_some_and(|code| code != CANNOT_LOAD))
}

fn sources_dir() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("peers")
}

fn source(name: &str) -> PathBuf {
    sources_dir().join(name)
}

/// Where cargo puts the results of this build: the marked directory above the running program.
fn target_dir() -> Result<PathBuf> {
    let program = fs::canonicalize(std::env::current_exe()?)?;
    program
        .ancestors()
        .find(|directory| directory.join("CACHEDIR.TAG").exists())
        .map(Path::to_path_buf)
        .with_context(|| format!("{} is in no cargo target directory", program.display()))
}
