//! Random bytes from the kernel, for GUID prefixes and tokens.

use std::fs::File;
use std::io::Read;

use anyhow::{Context, Result};

/// Fills the buffer.
pub(crate) fn fill(buffer: &mut [u8]) -> Result<()> {
    File::open("/dev/urandom")
        .and_then(|mut source| source.read_exact(buffer))
        .context("cannot read /dev/urandom")
}

/// 16 bytes that nobody can guess.
pub(crate) fn token() -> Result<[u8; 16]> {
    let mut token = [0; 16];
    fill(&mut token)?;
    Ok(token)
}
