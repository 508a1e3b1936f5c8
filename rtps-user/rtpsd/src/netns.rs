//! Where rtpsd runs: its network namespace, and the mount namespace that all of a host's processes share.
//!
//! A layer belongs to a network namespace, whose inode names the folders of its pins and sockets.
//! `ip netns exec` gives its child a private mount of `/sys`, on which pins would vanish with the child; so
//! whoever touches pins first joins the mount namespace of process 1, or, where that is hidden, of the oldest
//! ancestor that is not.

use std::fs::{self, File};
use std::os::unix::fs::MetadataExt;

use anyhow::{Context, Result};
use nix::sched::{CloneFlags, setns, unshare};
use nix::unistd::getppid;

/// More generations than processes have.
const MAX_ANCESTORS: usize = 64;

/// The inode of the calling thread's network namespace.
pub fn inode() -> Result<u64> {
    Ok(fs::metadata("/proc/thread-self/ns/net")
        .context("cannot look at the own network namespace; is /proc mounted?")?
        .ino())
}

/// Has the calling thread join the host's mount namespace where it is in another one.
pub fn join_shared_mounts() -> Result<()> {
    let own = fs::metadata("/proc/thread-self/ns/mnt")
        .context("cannot look at the own mount namespace")?
        .ino();
    let Some(shared) = shared_mount_namespace() else {
        return Ok(());
    };
    if shared.metadata()?.ino() == own {
        return Ok(());
    }
    // A thread that shares its working directory with others cannot change the namespace alone.
    unshare(CloneFlags::CLONE_FS)
        .and_then(|()| setns(shared, CloneFlags::CLONE_NEWNS))
        .context(
            "cannot join the mount namespace where pins and sockets have to be; it takes CAP_SYS_ADMIN",
        )
}

/// That of the oldest process above this one whose namespaces are not hidden from it.
fn shared_mount_namespace() -> Option<File> {
    let mut ancestors = vec![getppid().as_raw()];
    while let Some(parent) = ancestors.last().copied().and_then(parent_of)
        && ancestors.len() < MAX_ANCESTORS
    {
        ancestors.push(parent);
    }
    ancestors.push(1);
    ancestors
        .iter()
        .rev()
        .find_map(|pid| File::open(format!("/proc/{pid}/ns/mnt")).ok())
}

fn parent_of(pid: i32) -> Option<i32> {
    let status = fs::read_to_string(format!("/proc/{pid}/status")).ok()?;
    let parent = status.lines().find_map(|line| line.strip_prefix("PPid:"))?;
    parent.trim().parse().ok().filter(|parent| *parent > 0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ancestors_end_at_process_1() {
        let mut pid = i32::try_from(std::process::id()).unwrap();
        for _ in 0..MAX_ANCESTORS {
            match parent_of(pid) {
                Some(parent) => pid = parent,
                None => break,
            }
        }
        assert_eq!(parent_of(pid), None);
    }
}
