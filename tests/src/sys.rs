//! The unsafe room of the test harness: code between fork and exec, and the bpf system call.
//!
//! Everything here is a thin safe function; decisions are made by the callers.
#![allow(
    unsafe_code,
    reason = "the one module that talks to the kernel directly"
)]

use std::fs::File;
use std::io;
use std::os::fd::{AsRawFd, FromRawFd, OwnedFd};
use std::os::unix::process::CommandExt;
use std::process::Command;
use std::sync::Arc;

use nix::sched::{CloneFlags, setns};
use nix::sys::signal::Signal;

use crate::netns::Identity;

/// Makes `command` enter the network namespace behind `netns`, then become `identity`, before it
/// executes its program.
pub(crate) fn enter_before_exec(
    command: &mut Command,
    netns: Arc<File>,
    identity: Option<Identity>,
) {
    let enter = move || {
        setns(&*netns, CloneFlags::CLONE_NEWNET)?;
        identity.map_or(Ok(()), become_unprivileged)
    };
    // SAFETY: between fork and exec the closure makes system calls only; it neither allocates nor
    // takes a lock, and it does not touch memory that another thread may have been changing.
    unsafe { command.pre_exec(enter) };
}

/// Keeps `file` open, under the same number in the child, as long as `command` exists.
pub(crate) fn keep_open(command: &mut Command, file: File) {
    let hold = move || {
        let _held = &file;
        Ok(())
    };
    // SAFETY: the closure does nothing.
    unsafe { command.pre_exec(hold) };
}

/// Makes the kernel kill the child when the thread that spawns it ends, however it ends.
pub(crate) fn end_with_parent(command: &mut Command, signal: Signal) {
    let set = move || {
        // SAFETY: PR_SET_PDEATHSIG takes a signal number and no pointer.
        match unsafe { libc::prctl(libc::PR_SET_PDEATHSIG, signal as libc::c_int) } {
            0 => Ok(()),
            _ => Err(io::Error::last_os_error()),
        }
    };
    // SAFETY: as in `enter_before_exec`: one system call, no allocation, no lock.
    unsafe { command.pre_exec(set) };
}

/// Drops every group, both ids and with them all capabilities, of the calling thread alone: the C library's
/// functions of these names would change all threads.
pub(crate) fn become_unprivileged(identity: Identity) -> io::Result<()> {
    let Identity { uid, gid } = identity;
    let no_groups: *const libc::gid_t = std::ptr::null();
    // SAFETY: a list of no groups is not read; the other calls take numbers and no pointer.
    let results = unsafe {
        [
            libc::syscall(libc::SYS_setgroups, 0, no_groups),
            libc::syscall(libc::SYS_setresgid, gid, gid, gid),
            libc::syscall(libc::SYS_setresuid, uid, uid, uid),
            libc::c_long::from(libc::prctl(libc::PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)),
        ]
    };
    if results.iter().any(|result| *result != 0) {
        return Err(io::Error::last_os_error());
    }
    clear_capabilities()
}

/// Leaving uid 0 clears the permitted and effective sets; this clears the inheritable one too.
fn clear_capabilities() -> io::Result<()> {
    /// `_LINUX_CAPABILITY_VERSION_3` of linux/capability.h.
    const VERSION_3: u32 = 0x2008_0522;
    let header: [u32; 2] = [VERSION_3, 0];
    let sets = [0u32; 6];
    // SAFETY: `header` and `sets` have the layout of __user_cap_header_struct and of two
    // __user_cap_data_struct (capset(2)), and live until the call returns.
    match unsafe { libc::syscall(libc::SYS_capset, header.as_ptr(), sets.as_ptr()) } {
        0 => Ok(()),
        _ => Err(io::Error::last_os_error()),
    }
}

/// A command of bpf(2) with the leading fields of its `union bpf_attr` (linux/bpf.h).
#[derive(Clone, Copy)]
pub(crate) enum BpfCommand<'a> {
    /// BPF_MAP_CREATE of an array with one element of this many bytes.
    CreateArray { value_size: u32 },
    /// BPF_PROG_LOAD; the log receives the verifier's words.
    LoadProgram {
        program_type: u32,
        instructions: &'a [u64],
    },
    /// BPF_LINK_CREATE to an interface of the current namespace.
    Attach {
        program: i32,
        interface: u32,
        attach_type: u32,
        flags: u32,
    },
}

/// Executes a command of bpf(2) that makes a file descriptor.
pub(crate) fn bpf(command: BpfCommand<'_>) -> io::Result<OwnedFd> {
    const LICENSE: &[u8] = b"Dual MIT/GPL\0";
    const MAP_TYPE_ARRAY: u32 = 2;
    let mut attr = [0u64; 16];
    let number: libc::c_long = match command {
        BpfCommand::CreateArray { value_size } => {
            attr[0] = pair(MAP_TYPE_ARRAY, 4);
            attr[1] = pair(value_size, 1);
            0
        }
        BpfCommand::LoadProgram {
            program_type,
            instructions,
        } => {
            let count = u32::try_from(instructions.len()).map_err(io::Error::other)?;
            attr[0] = pair(program_type, count);
            attr[1] = instructions.as_ptr() as u64;
            attr[2] = LICENSE.as_ptr() as u64;
            5
        }
        BpfCommand::Attach {
            program,
            interface,
            attach_type,
            flags,
        } => {
            attr[0] = pair(program.cast_unsigned(), interface);
            attr[1] = pair(attach_type, flags);
            28
        }
    };
    // SAFETY: `attr` is larger than the fields these commands read, zero beyond those set; the
    // slices that it points to are borrowed until the call returns.
    let result =
        unsafe { libc::syscall(libc::SYS_bpf, number, attr.as_mut_ptr(), size_of_val(&attr)) };
    match i32::try_from(result) {
        // SAFETY: a result of zero or more is a new descriptor that nobody else owns.
        Ok(fd) if fd >= 0 => Ok(unsafe { OwnedFd::from_raw_fd(fd) }),
        _ => Err(io::Error::last_os_error()),
    }
}

/// Reads element 0 of an array map whose values are `N` 64-bit numbers.
pub(crate) fn bpf_read_array<const N: usize>(map: i32) -> io::Result<[u64; N]> {
    const MAP_LOOKUP_ELEM: libc::c_long = 1;
    let key = 0u32;
    let mut value = [0u64; N];
    let mut attr = [
        pair(map.cast_unsigned(), 0),
        (&raw const key) as u64,
        value.as_mut_ptr() as u64,
        0,
    ];
    // SAFETY: key and value outlive the call, and the callers made the map with this value size.
    let result = unsafe {
        libc::syscall(
            libc::SYS_bpf,
            MAP_LOOKUP_ELEM,
            attr.as_mut_ptr(),
            size_of_val(&attr),
        )
    };
    match result {
        0 => Ok(value),
        _ => Err(io::Error::last_os_error()),
    }
}

/// Two neighbouring 32-bit fields of a `union bpf_attr`.
fn pair(first: u32, second: u32) -> u64 {
    if cfg!(target_endian = "little") {
        u64::from(second) << 32 | u64::from(first)
    } else {
        u64::from(first) << 32 | u64::from(second)
    }
}

/// SO_COOKIE: the number by which BPF programs know a socket.
///
/// # Errors
/// When it is not the descriptor of a socket.
pub fn socket_cookie(socket: &impl AsRawFd) -> io::Result<u64> {
    let mut cookie = 0_u64;
    let mut len = size_of::<u64>() as libc::socklen_t;
    // SAFETY: `cookie` is writable for its size.
    let result = unsafe {
        libc::getsockopt(
            socket.as_raw_fd(),
            libc::SOL_SOCKET,
            libc::SO_COOKIE,
            (&raw mut cookie).cast(),
            &raw mut len,
        )
    };
    if result == -1 {
        return Err(io::Error::last_os_error());
    }
    Ok(cookie)
}
