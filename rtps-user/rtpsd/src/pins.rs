//! The folder in the BPF file system where maps, programs and links outlive rtpsd.
//!
//! `<bpffs>/rtps-v<ABI>/<network namespace inode>/` holds each map and program under its name, the maps that
//! rtpsd makes for itself, each XDP link as `xdp-<interface index>-<mode>`, and each tcx link as
//! `tcx-<interface index>-<direction>`: an index because a name may contain dots, which the BPF file system does
//! not take, and the mode because the kernel does not tell it.

use std::fs;
use std::io;
use std::os::unix::fs::{DirBuilderExt, PermissionsExt};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use nix::mount::{MsFlags, mount};
use nix::sys::statfs::{BPF_FS_MAGIC, statfs};
use rtps_ebpf::ABI_VERSION;

use crate::loader::XdpHook;
use crate::run_folder::remove_if_there;

const BPFFS: &str = "/sys/fs/bpf";

/// The pins of one network namespace.
#[derive(Clone, Debug)]
pub struct PinFolder {
    path: PathBuf,
}

/// What a pinned link attaches to its interface.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Hook {
    /// The classifier on ingress, by tcx.
    Ingress,
    /// The classifier on egress of the loopback interface, by tcx.
    FanOut,
    /// XDP.
    Xdp(XdpHook),
}

impl Hook {
    const ALL: [Self; 4] = [
        Self::Ingress,
        Self::FanOut,
        Self::Xdp(XdpHook::Native),
        Self::Xdp(XdpHook::Generic),
    ];

    /// What comes before and after the interface's index in a pin's name.
    fn name_parts(self) -> (&'static str, &'static str) {
        match self {
            Self::Ingress => ("tcx", "ingress"),
            Self::FanOut => ("tcx", "egress"),
            Self::Xdp(hook) => ("xdp", hook.name()),
        }
    }
}

/// A link found in a [`PinFolder`].
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct LinkPin {
    pub(crate) interface_index: u32,
    pub(crate) hook: Hook,
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

    /// Where the link of a hook is pinned.
    pub(crate) fn link(&self, interface_index: u32, hook: Hook) -> PathBuf {
        let (before, after) = hook.name_parts();
        self.entry(&format!("{before}-{interface_index}-{after}"))
    }

    /// Whether anything is pinned.
    pub fn exists(&self) -> bool {
        self.path.exists()
    }

    /// Every pinned link, in the order in which they are to be removed.
    pub(crate) fn links(&self) -> Result<Vec<LinkPin>> {
        let entries = self.entries()?.into_iter();
        let mut links: Vec<LinkPin> = entries.filter_map(parse_link).collect();
        links.sort_by_key(|link| link.hook);
        Ok(links)
    }

    /// Removes every pin and the folder: what no process holds open detaches and is freed. Says whether there was
    /// anything.
    pub(crate) fn remove(&self) -> Result<bool> {
        if !self.exists() {
            return Ok(false);
        }
        let links = self.links()?.into_iter().map(|link| link.path);
        for path in links.chain(self.entries()?) {
            remove_if_there(&path)?;
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

fn parse_link(path: PathBuf) -> Option<LinkPin> {
    let name = path.file_name()?.to_str()?;
    let (before, rest) = name.split_once('-')?;
    let (index, after) = rest.split_once('-')?;
    Some(LinkPin {
        interface_index: index.parse().ok()?,
        hook: Hook::ALL
            .into_iter()
            .find(|hook| hook.name_parts() == (before, after))?,
        path,
    })
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
        for hook in Hook::ALL {
            let path = folder.link(7, hook);
            assert!(path.starts_with(format!("{BPFFS}/rtps-v{ABI_VERSION}/42")));
            let link = parse_link(path.clone()).unwrap();
            assert_eq!((link.interface_index, link.hook), (7, hook));
            assert_eq!(link.path, path);
        }
        for other in [
            "xdp-7",
            "xdp-x-native",
            "xdp-7-fast",
            "tcx-7-native",
            "ports",
        ] {
            assert_eq!(parse_link(folder.entry(other)), None, "{other}");
        }
    }
}
