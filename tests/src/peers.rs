//! Publishers and subscribers of ShapeType on other vendors' libraries, taken unmodified from Debian, PyPI and
//! crates.io.
//!
//! The programs are in `tests/peers`; they are built into `<cargo target>/peers` when their
//! sources changed, and missing Debian packages are installed first when this process is root.
//! All have the same command line (`peer.c` prints it) and print one JSON object a line:
//! `matched`, `sample` (its number in `x`), `disposed`, `unregistered`, `incompatible_qos`,
//! `liveliness`, `deadline_missed`, `error`, `done`. They exit with 0 when `--count` is reached.
//! The programs in Python and Rust know the options that the matrix of vendors needs, and of the events the same.

mod debian_c;
mod python;
mod rust;

use std::fs::{self, File};
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};
use nix::fcntl::{Flock, FlockArg};

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

/// Eclipse Cyclone DDS 11, by its Python binding.
///
/// # Errors
/// Without Python, or when the binding cannot be installed.
pub fn cyclone11() -> Result<Peer> {
    Peer::build(Vendor::Cyclone11)
}

/// eProsima Fast DDS 2.9; it knows XCDR1 only and disposes by key hash only.
///
/// # Errors
/// Without a compiler or the library, with the command that installs them.
pub fn fast_dds() -> Result<Peer> {
    Peer::build(Vendor::FastDds)
}

/// Atostek RustDDS 0.15; it knows neither PARTITION nor unregistering.
///
/// # Errors
/// When cargo cannot get or build it.
pub fn rust_dds() -> Result<Peer> {
    Peer::build(Vendor::RustDds)
}

/// RustDDS again: round trips and streams, measured like those of `rtps perf`, with its command line as far as
/// benchmarks use it; its events are `ready` and `summary`.
///
/// # Errors
/// When cargo cannot get or build it.
pub fn rust_dds_perf() -> Result<Peer> {
    Peer::build(Vendor::RustDdsPerf)
}

/// S2E's dust_dds 0.16.
///
/// # Errors
/// When cargo cannot get or build it.
pub fn dust_dds() -> Result<Peer> {
    Peer::build(Vendor::DustDds)
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

/// What Cyclone DDS 0.10 makes of serialized samples: it reads and answers requests, as `codec.c` says.
///
/// # Errors
/// Without a compiler or the library, with the command that installs them.
pub fn cyclone_codec() -> Result<Peer> {
    Peer::build(Vendor::CycloneCodec)
}

/// The same of Fast-CDR, which is how Fast DDS serializes.
///
/// # Errors
/// Without a compiler or the library, with the command that installs them.
pub fn fast_cdr_codec() -> Result<Peer> {
    Peer::build(Vendor::FastCdrCodec)
}

/// Builds every peer that tests start, so that no test has to.
///
/// # Errors
/// Those of the single peers.
pub fn build_all() -> Result<()> {
    for build in [
        cyclone,
        cyclone11,
        fast_dds,
        rust_dds,
        dust_dds,
        cyclone_codec,
        fast_cdr_codec,
    ] {
        build()?;
    }
    Ok(())
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
        command.args(arguments.split_whitespace());
        let interface = match self.vendor {
            Vendor::Cyclone | Vendor::CycloneDiscovery | Vendor::Cyclone11 | Vendor::DustDds => {
                interface.name.clone()
            }
            Vendor::FastDds | Vendor::FastDdsPerf | Vendor::RustDds => interface.v4.to_string(),
            // They take whatever there is, or no network at all.
            Vendor::RustDdsPerf | Vendor::CycloneCodec | Vendor::FastCdrCodec => return command,
        };
        command.args(["--interface", &interface]);
        command
    }

    /// As [`Peer::command`], for a program that uses IPv6 and nothing else; Cyclone DDS and Fast DDS can.
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
            Vendor::Cyclone | Vendor::CycloneDiscovery | Vendor::Cyclone11 => {
                command.env("CYCLONEDDS_URI", CYCLONE)
            }
            // The last one counts.
            Vendor::FastDds | Vendor::FastDdsPerf => {
                command.args(["--interface", &interface.v6.to_string()])
            }
            Vendor::RustDds
            | Vendor::RustDdsPerf
            | Vendor::DustDds
            | Vendor::CycloneCodec
            | Vendor::FastCdrCodec => &mut command,
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
                eprintln!("building the {} peer", vendor.name());
                vendor
                    .make(&directory, &program)
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
    Cyclone11,
    CycloneDiscovery,
    FastDds,
    FastDdsPerf,
    RustDds,
    RustDdsPerf,
    DustDds,
    CycloneCodec,
    FastCdrCodec,
}

impl Vendor {
    fn name(self) -> &'static str {
        match self {
            Self::Cyclone => "cyclone",
            Self::Cyclone11 => "cyclone11",
            Self::CycloneDiscovery => "cyclone-discovery",
            Self::FastDds => "fastdds",
            Self::FastDdsPerf => "fastdds-perf",
            Self::RustDds => "rustdds-shapes",
            Self::RustDdsPerf => "rustdds-perf",
            Self::DustDds => "dustdds-shapes",
            Self::CycloneCodec => "cyclone-codec",
            Self::FastCdrCodec => "fastcdr-codec",
        }
    }

    fn sources(self) -> &'static [&'static str] {
        match self {
            Self::Cyclone => &["peer.h", "peer.c", "ShapeType.idl", "cyclone.c"],
            Self::Cyclone11 => python::SOURCES,
            Self::CycloneDiscovery => &["peer.h", "peer.c", "ShapeType.idl", "discovery.c"],
            Self::FastDds => &[
                "peer.h",
                "peer.c",
                "shape_type.hpp",
                "shape_type.cpp",
                "fastdds.cpp",
            ],
            Self::FastDdsPerf => &["peer.h", "peer.c", "fastdds_perf.cpp"],
            Self::RustDds | Self::RustDdsPerf | Self::DustDds => rust::SOURCES,
            Self::CycloneCodec => &["Codec.idl", "codec.c"],
            Self::FastCdrCodec => &["codec.cpp"],
        }
    }

    /// What a build was made of: the text of all its sources.
    fn fingerprint(self) -> Result<String> {
        self.sources()
            .iter()
            .map(|name| {
                let path = source(name);
                fs::read_to_string(&path).with_context(|| format!("reading {}", path.display()))
            })
            .collect()
    }

    /// Makes the program, replaced as a whole: an older one of that name may be running.
    fn make(self, directory: &Path, program: &Path) -> Result<()> {
        let made = match self {
            Self::Cyclone => debian_c::cyclone(directory, self.name(), "cyclone.c")?,
            Self::CycloneDiscovery => debian_c::cyclone(directory, self.name(), "discovery.c")?,
            Self::FastDds => {
                let sources = ["fastdds.cpp", "shape_type.cpp"];
                debian_c::fast_dds(directory, self.name(), &sources, "-O1")?
            }
            Self::FastDdsPerf => {
                debian_c::fast_dds(directory, self.name(), &["fastdds_perf.cpp"], "-O2")?
            }
            Self::Cyclone11 => python::cyclone11(directory)?,
            Self::CycloneCodec => debian_c::cyclone_codec(directory, self.name())?,
            Self::FastCdrCodec => debian_c::fast_cdr_codec(directory, self.name())?,
            Self::RustDds | Self::RustDdsPerf | Self::DustDds => {
                rust::build(directory, self.name())?
            }
        };
        fs::rename(made, program)?;
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

/// Runs a command that makes something; an error with what it said when it fails.
fn run(command: &mut Command) -> Result<()> {
    let output = command
        .output()
        .with_context(|| format!("running {}", command.get_program().display()))?;
    if !output.status.success() {
        let words = String::from_utf8_lossy(&output.stderr);
        anyhow::bail!("{} failed:\n{words}", command.get_program().display());
    }
    Ok(())
}

/// A file of `tests/peers`.
fn source(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("peers")
        .join(name)
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
