//! What the integration tests share: a type, networks of their own, and a small executor.

use std::pin::pin;
use std::process::Command;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};
use std::task::{Context, Poll, Wake, Waker};
use std::thread::{self, Thread};
use std::time::{Duration, Instant};

use nix::sched::{CloneFlags, unshare};
use rtps_socket::{DdsType, DomainParticipant, LayerChoice};

#[derive(Clone, Debug, DdsType, PartialEq)]
#[dds(type_name = "ShapeType")]
pub(crate) struct Shape {
    #[dds(key, bound = 128)]
    pub(crate) color: String,
    pub(crate) x: i32,
    pub(crate) payload: Vec<u8>,
}

pub(crate) fn shape(color: &str, x: i32, size: usize) -> Shape {
    Shape {
        color: color.to_owned(),
        x,
        payload: (0..size).map(|n| n as u8).collect(),
    }
}

/// Moves this thread, and those that it starts, to a network namespace of its own, where any domain is free; without
/// the privilege it stays, and gets a domain that no other test has. The namespace goes with its last thread.
pub(crate) fn own_network() -> u32 {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let _ = tracing_subscriber::fmt()
        .with_env_filter(tracing_subscriber::EnvFilter::from_default_env())
        .with_test_writer()
        .try_init();
    if unshare(CloneFlags::CLONE_NEWNET).is_ok() {
        let up = Command::new("ip")
            .args(["link", "set", "lo", "up"])
            .status();
        assert!(
            up.is_ok_and(|status| status.success()),
            "`ip link set lo up` fails"
        );
        return 0;
    }
    100 + (std::process::id() * 13 + NEXT.fetch_add(1, Ordering::Relaxed)) % 130
}

pub(crate) fn participant(domain: u32) -> DomainParticipant {
    let builder = DomainParticipant::builder()
        .domain(domain)
        .layer(LayerChoice::InProcess);
    builder
        .open()
        .expect("the in-process layer needs no privileges")
}

/// Waits until `is_so`, for ten seconds at the most.
pub(crate) fn eventually(mut is_so: impl FnMut() -> bool) {
    let end = Instant::now() + Duration::from_secs(10);
    while !is_so() {
        assert!(Instant::now() < end, "it does not come to that");
        thread::sleep(Duration::from_millis(5));
    }
}

/// Runs a future on this thread.
pub(crate) fn block_on<F: Future>(future: F) -> F::Output {
    struct Unpark(Thread);
    impl Wake for Unpark {
        fn wake(self: Arc<Self>) {
            self.0.unpark();
        }
    }
    let waker = Waker::from(Arc::new(Unpark(thread::current())));
    let mut future = pin!(future);
    loop {
        match future.as_mut().poll(&mut Context::from_waker(&waker)) {
            Poll::Ready(output) => return output,
            Poll::Pending => thread::park(),
        }
    }
}
