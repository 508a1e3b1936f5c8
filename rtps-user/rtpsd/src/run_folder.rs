//! The folder in /run where a running rtpsd is found: its Unix sockets, and its process id.
//!
//! `/run/rtps/<network namespace inode>/rtpsd.pid` is locked as long as rtpsd lives, and the kernel tells whose
//! lock it is: so neither a stale file nor a reused process id can mislead.

use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{self, Write};
use std::os::unix::fs::{DirBuilderExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use nix::errno::Errno;
use nix::fcntl::{FcntlArg, fcntl};
use nix::unistd::Pid;

const RUN: &str = "/run/rtps";

/// The run folder of one network namespace.
#[derive(Clone, Debug)]
pub struct RunFolder {
    path: PathBuf,
}

impl RunFolder {
    /// Where the folder is, whether rtpsd runs or not.
    pub fn of_namespace(inode: u64) -> Self {
        Self {
            path: Path::new(RUN).join(inode.to_string()),
        }
    }

    /// The socket that apps connect to.
    pub fn layer_socket(&self) -> PathBuf {
        self.path.join("layer.sock")
    }

    /// The socket that tells the status.
    pub fn status_socket(&self) -> PathBuf {
        self.path.join("status.sock")
    }

    fn pid_file(&self) -> PathBuf {
        self.path.join("rtpsd.pid")
    }

    /// Makes the folder, which everybody may enter.
    pub(crate) fn create(&self) -> Result<()> {
        fs::DirBuilder::new()
            .recursive(true)
            .mode(0o755)
            .create(&self.path)
            .with_context(|| format!("cannot make {}", self.path.display()))?;
        for folder in [Path::new(RUN), &self.path] {
            fs::set_permissions(folder, Permissions::from_mode(0o755))?;
        }
        Ok(())
    }

    /// Whether the folder is there.
    pub(crate) fn exists(&self) -> bool {
        self.path.exists()
    }

    /// Becomes the one rtpsd of this network namespace, as long as the returned file is open.
    pub(crate) fn lock(&self) -> Result<File> {
        let path = self.pid_file();
        let mut file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .mode(0o644)
            .open(&path)
            .with_context(|| format!("cannot open {}", path.display()))?;
        match fcntl(&file, FcntlArg::F_SETLK(&whole_file())) {
            Ok(_) => {}
            Err(Errno::EACCES | Errno::EAGAIN) => {
                let pid =
                    lock_holder(&file)?.map_or_else(String::new, |pid| format!(" (pid {pid})"));
                bail!(
                    "the layer of this network namespace is already loaded{pid}; `cargo xtask unload` ends it"
                );
            }
            Err(error) => return Err(error).context("cannot lock the pid file"),
        }
        file.set_len(0)?;
        writeln!(file, "{}", std::process::id())?;
        Ok(file)
    }

    /// The process id of the running rtpsd. It must not ask itself: a process gives up its lock on a file when it
    /// closes any descriptor of it.
    pub fn daemon(&self) -> Result<Option<Pid>> {
        match File::open(self.pid_file()) {
            Ok(file) => lock_holder(&file),
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(None),
            Err(error) => Err(error).context("cannot open the pid file"),
        }
    }

    /// Removes the folder and what rtpsd puts there; says whether there was anything.
    pub(crate) fn remove(&self) -> Result<bool> {
        if !self.exists() {
            return Ok(false);
        }
        for file in [self.layer_socket(), self.status_socket(), self.pid_file()] {
            remove_if_there(&file)?;
        }
        fs::remove_dir(&self.path)
            .with_context(|| format!("cannot remove {}", self.path.display()))?;
        // Fails while rtpsd runs in another network namespace.
        drop(fs::remove_dir(RUN));
        Ok(true)
    }
}

/// Removes a file; one that is missing is no error.
pub(crate) fn remove_if_there(path: &Path) -> Result<()> {
    match fs::remove_file(path) {
        Err(error) if error.kind() != io::ErrorKind::NotFound => {
            Err(error).with_context(|| format!("cannot remove {}", path.display()))
        }
        _ => Ok(()),
    }
}

fn lock_holder(file: &File) -> Result<Option<Pid>> {
    let mut lock = whole_file();
    fcntl(file, FcntlArg::F_GETLK(&mut lock)).context("cannot ask who locks the pid file")?;
    Ok((lock.l_type != libc::F_UNLCK as libc::c_short).then(|| Pid::from_raw(lock.l_pid)))
}

fn whole_file() -> libc::flock {
    libc::flock {
        l_type: libc::F_WRLCK as libc::c_short,
        l_whence: libc::SEEK_SET as libc::c_short,
        l_start: 0,
        l_len: 0,
        l_pid: 0,
    }
}
