//! Kills rtpsd right after one of its steps: a system call that leaves something in the kernel or in a file system, or
//! takes it away.

use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};

use libc::{c_long, user_regs_struct};
use nix::sys::ptrace::{self, Options};
use nix::sys::signal::{Signal, kill};
use nix::sys::wait::{WaitStatus, waitpid};
use nix::unistd::Pid;

/// Commands of bpf(2) that leave something: BPF_OBJ_PIN, BPF_LINK_CREATE, BPF_LINK_UPDATE.
const LASTING_COMMANDS: [u64; 3] = [6, 28, 29];
/// Other system calls that do.
const LASTING: [c_long; 7] = [
    libc::SYS_mkdir,
    libc::SYS_mkdirat,
    libc::SYS_bind,
    libc::SYS_unlink,
    libc::SYS_unlinkat,
    libc::SYS_rmdir,
    libc::SYS_mount,
];

/// Starts rtpsd in the namespace of the calling thread, ends it by SIGTERM as soon as it waits for something to do, and
/// kills it after step `last` of all that. False if it was at its end before.
pub(crate) fn kill_at(last: usize) -> bool {
    let mut command = Command::new(env!("CARGO_BIN_EXE_rtpsd"));
    command.args(["--iface", "veth0", "--mode", "native"]);
    command.stdout(Stdio::null()).stderr(Stdio::null());
    // SAFETY: one system call, which is all that may be done between fork and exec.
    unsafe { command.pre_exec(|| Ok(ptrace::traceme()?)) };
    let mut child = command.spawn().unwrap();
    let was_running = run_to(Pid::from_raw(child.id().try_into().unwrap()), last);
    if was_running {
        child.kill().unwrap();
    }
    // Nothing is left to wait for where it has ended by itself.
    drop(child.wait());
    was_running
}

/// Whether it has come to that step.
fn run_to(pid: Pid, last: usize) -> bool {
    // It stops when it has become rtpsd.
    waitpid(pid, None).unwrap();
    ptrace::setoptions(
        pid,
        Options::PTRACE_O_TRACESYSGOOD | Options::PTRACE_O_EXITKILL,
    )
    .unwrap();
    let mut steps = 0;
    let mut is_ready = false;
    let mut signal = None;
    loop {
        ptrace::syscall(pid, signal.take()).unwrap();
        match waitpid(pid, None).unwrap() {
            WaitStatus::PtraceSyscall(_) => {}
            WaitStatus::Stopped(_, other) => {
                signal = Some(other);
                continue;
            }
            _ => return false,
        }
        let registers = ptrace::getregs(pid).unwrap();
        if is_waiting(&registers) && !is_ready {
            is_ready = true;
            kill(pid, Signal::SIGTERM).unwrap();
        }
        steps += usize::from(is_step(&registers));
        if steps == last {
            return true;
        }
    }
}

fn is_waiting(registers: &user_regs_struct) -> bool {
    [libc::SYS_epoll_wait, libc::SYS_epoll_pwait].contains(&(registers.orig_rax as c_long))
}

/// Whether such a system call has just succeeded. While it begins, its result is an error.
fn is_step(registers: &user_regs_struct) -> bool {
    let call = registers.orig_rax as c_long;
    let is_lasting = LASTING.contains(&call)
        || call == libc::SYS_bpf && LASTING_COMMANDS.contains(&registers.rdi);
    is_lasting && registers.rax as i64 >= 0
}
