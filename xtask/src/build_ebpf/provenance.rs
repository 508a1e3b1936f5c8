//! What the committed object was made of: the tool chain and a fingerprint of the sources.
//!
//! The same tool chain makes the same bytes, so `--check` compares bytes. Another one (distributions update their
//! compilers) makes other bytes of the same sources: then the fingerprint decides whether source and object belong
//! together.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use md5::{Digest, Md5};
use serde::{Deserialize, Serialize};

use super::toolchain::Toolchain;

/// Stands beside the object, as JSON.
const FILE: &str = "rtps-ebpf/rtps-ebpf.o.json";

/// See the module.
#[derive(Debug, Deserialize, PartialEq, Serialize)]
pub(super) struct Provenance {
    pub(super) toolchain: String,
    sources: String,
}

impl Provenance {
    /// What an object would be made of now.
    pub(super) fn now(workspace: &Path, toolchain: &Toolchain) -> Result<Self> {
        Ok(Self {
            toolchain: toolchain.to_string(),
            sources: fingerprint(&workspace.join("rtps-ebpf"))?,
        })
    }

    /// What the committed object was made of.
    pub(super) fn committed(workspace: &Path) -> Result<Self> {
        let text = fs::read_to_string(workspace.join(FILE))
            .with_context(|| format!("cannot read {FILE}"))?;
        serde_json::from_str(&text).with_context(|| format!("{FILE} is not what build-ebpf writes"))
    }

    /// Commits it to the source tree.
    pub(super) fn write(&self, workspace: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self)? + "\n";
        fs::write(workspace.join(FILE), text).with_context(|| format!("cannot write {FILE}"))
    }

    /// Whether both were made of the same sources.
    pub(super) fn same_sources(&self, other: &Self) -> bool {
        self.sources == other.sources
    }
}

/// MD5 of the names and contents of all sources, in the order of their names.
fn fingerprint(package: &Path) -> Result<String> {
    let mut files = vec![package.join("Cargo.toml")];
    add_files(&package.join("src"), &mut files)?;
    files.sort();
    let mut digest = Md5::new();
    for file in files {
        let name = file
            .strip_prefix(package)
            .unwrap_or(&file)
            .display()
            .to_string();
        let content = fs::read(&file).with_context(|| format!("cannot read {}", file.display()))?;
        digest.update(format!("{name}\0{}\0", content.len()));
        digest.update(content);
    }
    Ok(digest
        .finalize()
        .iter()
        .map(|byte| format!("{byte:02x}"))
        .collect())
}

fn add_files(folder: &Path, files: &mut Vec<PathBuf>) -> Result<()> {
    for entry in
        fs::read_dir(folder).with_context(|| format!("cannot read {}", folder.display()))?
    {
        let path = entry?.path();
        if path.is_dir() {
            add_files(&path, files)?;
        } else {
            files.push(path);
        }
    }
    Ok(())
}
