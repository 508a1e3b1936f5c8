//! A host: a network namespace that lives as long as the value.
//!
//! The namespace has no name in /run/netns, so nothing can be left behind, not even by SIGKILL:
//! it ends with its last descriptor, process and socket. [`Netns::path`] leads into it with
//! `nsenter --net=PATH` while a test hangs.

use std::ffi::OsStr;
use std::fs::{self, File};
use std::io;
use std::os::fd::AsRawFd;
use std::os::unix::fs::MetadataExt;
use std::os::unix::process::CommandExt;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;

use anyhow::{Context, Result, bail};
use nix::sched::{CloneFlags, setns, unshare};

use crate::sys;

/// The user and group that an unprivileged command runs as.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Identity {
    /// User id.
    pub uid: u32,
    /// Group id.
    pub gid: u32,
}

impl Identity {
    /// nobody and nogroup of Debian.
    pub const NOBODY: Self = Self {
        uid: 65534,
        gid: 65534,
    };
}

/// A network namespace with `lo` up and no duplicate address detection.
#[derive(Debug)]
pub struct Netns {
    label: String,
    file: Arc<File>,
    interfaces: AtomicU32,
}

impl Netns {
    /// Makes a namespace; `label` appears in error messages.
    ///
    /// # Errors
    /// Without CAP_SYS_ADMIN, or when `ip` (Debian: iproute2) is missing.
    pub fn new(label: &str) -> Result<Self> {
        let file = thread::scope(|scope| scope.spawn(make_namespace).join())
            .map_err(|_panic| anyhow::anyhow!("the thread of namespace {label} panicked"))?
            .with_context(|| format!("making the network namespace {label} (root needed)"))?;
        let netns = Self {
            label: label.to_owned(),
            file: Arc::new(file),
            interfaces: AtomicU32::new(0),
        };
        netns.ip("link set lo up")?;
        // An IPv6 address is usable at once: nobody else is on the link.
        for scope in ["default", "all"] {
            let path = format!("/proc/sys/net/ipv6/conf/{scope}/accept_dad");
            netns.enter(|| ignore_missing(fs::write(&path, "0")))?;
        }
        Ok(netns)
    }

    /// The label given to [`Netns::new`].
    #[must_use]
    pub fn label(&self) -> &str {
        &self.label
    }

    /// A path by which other programs reach the namespace while this process lives.
    #[must_use]
    pub fn path(&self) -> PathBuf {
        PathBuf::from(format!(
            "/proc/{}/fd/{}",
            std::process::id(),
            self.file.as_raw_fd()
        ))
    }

    /// The inode that identifies the namespace (the number in `readlink /proc/self/ns/net`).
    pub fn inode(&self) -> Result<u64> {
        Ok(self.file.metadata()?.ino())
    }

    /// Runs `work` on a new thread inside the namespace and waits for it.
    ///
    /// Sockets made in there stay in the namespace. Spawn no [`crate::process::Process`] in there:
    /// it would end with the thread; use [`Netns::command`].
    ///
    /// # Panics
    /// With the panic of `work`, or when the kernel refuses to enter the namespace.
    pub fn enter<T: Send>(&self, work: impl FnOnce() -> T + Send) -> T {
        let inside = || {
            setns(&*self.file, CloneFlags::CLONE_NEWNET)
                .expect("the namespace exists and its maker may enter it");
            work()
        };
        thread::scope(|scope| scope.spawn(inside).join())
            .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
    }

    /// Like [`Netns::enter`], as `identity` and without any capability.
    ///
    /// # Panics
    /// As [`Netns::enter`], and when the kernel refuses to give up privileges.
    pub fn enter_as<T: Send>(&self, identity: Identity, work: impl FnOnce() -> T + Send) -> T {
        self.enter(|| {
            sys::become_unprivileged(identity).expect("root may become anybody");
            work()
        })
    }

    /// A command that will run inside the namespace, with the mounts and rights of this process
    /// (`ip netns exec` would hide /sys/fs/bpf).
    pub fn command(&self, program: impl AsRef<OsStr>) -> Command {
        let mut command = Command::new(program);
        sys::enter_before_exec(&mut command, Arc::clone(&self.file), None);
        command
    }

    /// A command that will run inside the namespace as `identity`, without any capability, in the
    /// directory `/`.
    ///
    /// The program is opened now, with the rights of this process: it may be in a directory that
    /// `identity` cannot enter, like a checkout below /root.
    pub fn command_as(&self, identity: Identity, program: &Path) -> Result<Command> {
        let executable =
            File::open(program).with_context(|| format!("opening {}", program.display()))?;
        let mut command = Command::new(format!("/proc/self/fd/{}", executable.as_raw_fd()));
        command.arg0(program).current_dir("/");
        // The closure keeps the descriptor open until the command is dropped.
        let namespace = Arc::clone(&self.file);
        sys::enter_before_exec(&mut command, namespace, Some(identity));
        sys::keep_open(&mut command, executable);
        Ok(command)
    }

    /// Takes IPv6 away from all interfaces, and from those to come.
    ///
    /// # Errors
    /// When the kernel refuses.
    pub fn disable_ipv6(&self) -> Result<()> {
        let setting = "/proc/sys/net/ipv6/conf/all/disable_ipv6";
        Ok(self.enter(|| ignore_missing(fs::write(setting, "1")))?)
    }

    /// Runs `ip` with arguments separated by spaces and fails with its words.
    pub fn ip(&self, arguments: &str) -> Result<()> {
        let output = self
            .command("ip")
            .args(arguments.split_whitespace())
            .output()
            .context("running ip (Debian: apt-get install iproute2)")?;
        if !output.status.success() {
            let words = String::from_utf8_lossy(&output.stderr);
            bail!("{}: ip {arguments}: {}", self.label, words.trim());
        }
        Ok(())
    }

    /// A name that no interface of the namespace has: eth0, eth1...
    pub(crate) fn next_interface_name(&self) -> String {
        format!("eth{}", self.interfaces.fetch_add(1, Ordering::Relaxed))
    }
}

fn make_namespace() -> io::Result<File> {
    unshare(CloneFlags::CLONE_NEWNET)?;
    File::open("/proc/thread-self/ns/net")
}

/// The kernel may be built without IPv6.
fn ignore_missing(result: io::Result<()>) -> io::Result<()> {
    match result {
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}
