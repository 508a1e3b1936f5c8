//! The folder in the BPF file system where maps, programs and links outlive rtpsd.
//!
//! `<bpffs>/rtps-v<ABI>/<network namespace inode>/` holds each map and program under its name, the maps that
//! rtpsd makes for itself, and each XDP link as `xdp-<interface index>-<mode>`: an index because a name may
//! contain dots, which the BPF file system does not take, and the mode because the kernel does not tell it.

use std::fs;
use std::io;
use std::os::unix::fs::{DirBuilderExt, PermissionsExt};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use nix::mount::{MsFlags, mount};
use nix::sys::statfs::{BPF_FS_MAGIC, statfs};
use rtps_ebpf::ABI_VERSION;

use crate::loader::AttachedMode;

const BPFFS: &str = "/sys/fs/bpf";

/// The pins of one network namespace.
#[derive(Clone, Debug)]
pub struct PinFolder {
    path: PathBuf,
}

/// An XDP link found in a [`PinFolder`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct PinnedXdp {
    pub(crate) interface_index: u32,
    pub(crate) mode: AttachedMode,
    pub(crate) path: PathBuf,
}

impl PinFolder {
    /// Where the pins of a network namespace are, whether there are any or not.
    pub fn of_namespace(inode: u64) -> Self {
        Self {
            path: Path::new(BPFFS)
                .join(format!("rtps-v{ABI_VERSION}"))
                .join(inode.to_string()),
        }
    }

    /// Mounts the BPF file system when missing, and makes the folder, for root alone.
    pub(crate) fn create(&self) -> Result<()> {
        mount_bpffs()?;
        fs::DirBuilder::new()
            .recursive(true)
            .mode(0o700)
            .create(&self.path)
            .with_context(|| format!("cannot make the pin folder {}", self.path.display()))?;
        fs::set_permissions(&self.path, fs::Permissions::from_mode(0o700))?;
        Ok(())
    }

    /// The folder itself.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Where the map or program of that name is pinned.
    pub(crate) fn entry(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// Where an XDP link is pinned.
    pub(crate) fn xdp(&self, interface_index: u32, mode: AttachedMode) -> PathBuf {
        self.entry(&format!("xdp-{interface_index}-{}", mode.name()))
    }

    /// Whether anything is pinned.
    pub fn exists(&self) -> bool {
        self.path.exists()
    }

    /// Every pinned XDP link, in no order.
    pub(crate) fn xdp_links(&self) -> Result<Vec<PinnedXdp>> {
        let mut links = Vec::new();
        for entry in self.entries()? {
            let name = entry.file_name().unwrap_or_default().to_string_lossy();
            if let Some((interface_index, mode)) = parse_xdp_name(&name) {
                links.push(PinnedXdp {
                    interface_index,
                    mode,
                    path: entry.clone(),
                });
            }
        }
        Ok(links)
    }

    /// Removes every pin and the folder: what no process holds open detaches and is freed. Says whether there was
    /// anything.
    pub(crate) fn remove(&self) -> Result<bool> {
        if !self.exists() {
            return Ok(false);
        }
        let (links, others): (Vec<_>, Vec<_>) = self.entries()?.into_iter().partition(|path| {
            parse_xdp_name(&path.file_name().unwrap_or_default().to_string_lossy()).is_some()
        });
        for path in links.iter().chain(&others) {
            fs::remove_file(path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
        fs::remove_dir(&self.path)
            .with_context(|| format!("cannot remove {}", self.path.display()))?;
        if let Some(parent) = self.path.parent() {
            // Fails while another network namespace has pins there.
            drop(fs::remove_dir(parent));
        }
        Ok(true)
    }

    fn entries(&self) -> Result<Vec<PathBuf>> {
        let read = match fs::read_dir(&self.path) {
            Ok(read) => read,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Vec::new()),
            Err(error) => {
                return Err(error).with_context(|| format!("cannot read {}", self.path.display()));
            }
        };
        read.map(|entry| Ok(entry?.path())).collect()
    }
}

fn parse_xdp_name(name: &str) -> Option<(u32, AttachedMode)> {
    let (index, mode) = name.strip_prefix("xdp-")?.split_once('-')?;
    Some((index.parse().ok()?, AttachedMode::from_name(mode)?))
}

fn mount_bpffs() -> Result<()> {
    let kind = statfs(BPFFS)
        .with_context(|| {
            format!("{BPFFS} is missing: the kernel has no BPF, or /sys is not mounted")
        })?
        .filesystem_type();
    if kind == BPF_FS_MAGIC {
        return Ok(());
    }
    mount(
        Some("bpf"),
        BPFFS,
        Some("bpf"),
        MsFlags::empty(),
        Some("mode=0755"),
    )
    .with_context(|| format!("cannot mount the BPF file system at {BPFFS}"))?;
    if statfs(BPFFS)?.filesystem_type() != BPF_FS_MAGIC {
        bail!("mounted the BPF file system at {BPFFS}, but something else is there");
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn link_names_are_read_back() {
        let folder = PinFolder::of_namespace(42);
        let path = folder.xdp(7, AttachedMode::Generic);
        assert!(path.starts_with(format!("{BPFFS}/rtps-v{ABI_VERSION}/42")));
        let name = path.file_name().unwrap().to_str().unwrap();
        assert_eq!(parse_xdp_name(name), Some((7, AttachedMode::Generic)));
        for other in ["xdp-7", "xdp-x-native", "xdp-7-fast", "ports"] {
            assert_eq!(parse_xdp_name(other), None, "{other}");
        }
    }
}
