//! Peers in C and C++, on the libraries that Debian has.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::Result;

use super::source;
use crate::debian::{self, Package};

const GCC: Package = Package::new("gcc", "/usr/bin/gcc");
const GXX: Package = Package::new("g++", "/usr/bin/g++");
const LIBC: Package = Package::new("libc6-dev", "/usr/include/stdio.h");
const CYCLONE: [Package; 4] = [
    GCC,
    LIBC,
    Package::new("cyclonedds-dev", "/usr/include/dds/dds.h"),
    Package::new("cyclonedds-tools", "/usr/bin/idlc"),
];
const FAST_DDS: [Package; 5] = [
    GCC,
    GXX,
    LIBC,
    Package::new("libfastcdr-dev", "/usr/include/fastcdr/Cdr.h"),
    Package::new(
        "libfastrtps-dev",
        "/usr/include/fastdds/dds/topic/TopicDataType.hpp",
    ),
];

/// A program on Cyclone DDS, compiled in a directory of its own below `directory`.
pub(super) fn cyclone(directory: &Path, name: &str, program: &str) -> Result<PathBuf> {
    debian::ensure_installed(&CYCLONE)?;
    let workshop = Workshop::new(directory, name)?;
    for extensibility in ["final", "appendable"] {
        fs::create_dir_all(workshop.directory.join(extensibility))?;
        workshop.run(
            Command::new("idlc")
                .args(["-x", extensibility, "-o", extensibility])
                .arg(source("ShapeType.idl")),
        )?;
        let rename = format!("-DShapeType_desc=ShapeType_{extensibility}_desc");
        workshop.compile_c(
            &format!("{extensibility}.o"),
            &workshop.directory.join(extensibility).join("ShapeType.c"),
            &[&rename],
        )?;
    }
    // The struct is the same in both headers.
    workshop.compile_c("cyclone.o", &source(program), &["-Ifinal"])?;
    workshop.run(Command::new("gcc").args([
        "-o",
        "program",
        "cyclone.o",
        "peer.o",
        "final.o",
        "appendable.o",
        "-lddsc",
    ]))?;
    Ok(workshop.program())
}

/// The serializer of Cyclone DDS alone.
pub(super) fn cyclone_codec(directory: &Path, name: &str) -> Result<PathBuf> {
    debian::ensure_installed(&CYCLONE)?;
    let workshop = Workshop::empty(directory, name)?;
    workshop.run(
        Command::new("idlc")
            .args(["-x", "final"])
            .arg(source("Codec.idl")),
    )?;
    workshop.run(
        Command::new("gcc")
            .args(["-O1", "-I.", "-o", "program", "Codec.c"])
            .arg(source("codec.c"))
            .arg("-lddsc"),
    )?;
    Ok(workshop.program())
}

/// Fast-CDR alone.
pub(super) fn fast_cdr_codec(directory: &Path, name: &str) -> Result<PathBuf> {
    debian::ensure_installed(&FAST_DDS)?;
    let workshop = Workshop::empty(directory, name)?;
    workshop.run(
        Command::new("g++")
            .args(["-std=c++17", "-O1", "-o", "program"])
            .arg(source("codec.cpp"))
            .arg("-lfastcdr"),
    )?;
    Ok(workshop.program())
}

/// As [`cyclone`], on Fast DDS.
pub(super) fn fast_dds(
    directory: &Path,
    name: &str,
    sources: &[&str],
    optimization: &str,
) -> Result<PathBuf> {
    debian::ensure_installed(&FAST_DDS)?;
    let workshop = Workshop::new(directory, name)?;
    workshop.run(
        Command::new("g++")
            .args(["-std=c++17", optimization, "-o", "program"])
            .args(sources.iter().map(|name| source(name)))
            .args(["peer.o", "-lfastrtps"]),
    )?;
    Ok(workshop.program())
}

/// The directory where a peer is compiled, into a file `program`.
struct Workshop {
    directory: PathBuf,
}

impl Workshop {
    /// With what all peers in C share, compiled.
    fn new(directory: &Path, name: &str) -> Result<Self> {
        let workshop = Self::empty(directory, name)?;
        workshop.compile_c("peer.o", &source("peer.c"), &[])?;
        Ok(workshop)
    }

    fn empty(directory: &Path, name: &str) -> Result<Self> {
        let directory = directory.join(format!("{name}.build"));
        fs::create_dir_all(&directory)?;
        Ok(Self { directory })
    }

    fn program(&self) -> PathBuf {
        self.directory.join("program")
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
        super::run(command.current_dir(&self.directory))
    }
}
