//! A network namespace with two veth interfaces, rtpsd in it, and an app's end of the Unix socket.

use std::fs::{self, File};
use std::io::{BufRead, BufReader, IoSliceMut, Lines};
use std::os::fd::{AsFd, AsRawFd, FromRawFd, OwnedFd};
use std::os::unix::fs::MetadataExt;
use std::path::PathBuf;
use std::process::{Child, ChildStderr, Command, Stdio};
use std::sync::atomic::{AtomicU32, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use aya::programs::{SchedClassifier, TcAttachType};
use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use nix::sched::{CloneFlags, setns};
use nix::sys::signal::{Signal, kill};
use nix::sys::socket::{
    AddressFamily, ControlMessageOwned, MsgFlags, SockFlag, SockType, UnixAddr, connect, recvmsg,
    send, socket,
};
use nix::unistd::{Pid, geteuid};
use rtps_user::layer::protocol::{
    CHANNEL_DESCRIPTORS, Endpoint, FromLayer, Hello, LAYER_PROTOCOL_VERSION, Resume, ToLayer,
    Welcome,
};
use rtps_user::qos::Qos;
use rtps_user::wire::{EntityId, Guid};
use rtpsd::{PinFolder, RunFolder, Status};

/// A network namespace of this test; gone at the end of it.
pub(crate) struct Netns {
    name: String,
    pub(crate) inode: u64,
}

impl Netns {
    /// With 10.99.0.1 at veth0, and nobody at the other end; `None`, and a reason, when the test cannot run here.
    pub(crate) fn new() -> Option<Self> {
        let netns = Self::without_link()?;
        netns.ip("link add veth0 type veth peer name veth1");
        netns.ip("link set veth0 up");
        netns.ip("link set veth1 up");
        netns.ip("addr add 10.99.0.1/24 dev veth0");
        Some(netns)
    }

    /// Two, joined by their veth0.
    pub(crate) fn pair() -> Option<(Self, Self)> {
        let (here, there) = (Self::without_link()?, Self::without_link()?);
        here.ip(&format!(
            "link add veth0 type veth peer name veth0 netns {}",
            there.name
        ));
        for (netns, address) in [(&here, "10.99.0.1/24"), (&there, "10.99.0.2/24")] {
            netns.ip("link set veth0 up");
            netns.ip(&format!("addr add {address} dev veth0"));
        }
        Some((here, there))
    }

    fn without_link() -> Option<Self> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        if !geteuid().is_root() {
            eprintln!("skipped: network namespaces and BPF need root");
            return None;
        }
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let name = format!("rtpsd-{}-{count}", std::process::id());
        run("ip", &["netns", "add", &name]);
        let inode = fs::metadata(format!("/run/netns/{name}")).unwrap().ino();
        let netns = Self { name, inode };
        netns.ip("link set lo up");
        Some(netns)
    }

    pub(crate) fn ip(&self, arguments: &str) -> String {
        let arguments: Vec<&str> = arguments.split(' ').collect();
        run(
            "ip",
            &[&["-n", self.name.as_str()], &arguments[..]].concat(),
        )
    }

    /// Runs `act` on a thread within the namespace.
    pub(crate) fn within<T: Send>(&self, act: impl FnOnce() -> T + Send) -> T {
        let file = File::open(format!("/run/netns/{}", self.name)).unwrap();
        thread::scope(|scope| {
            let inside = scope.spawn(move || {
                setns(file, CloneFlags::CLONE_NEWNET).unwrap();
                act()
            });
            inside.join().unwrap()
        })
    }

    pub(crate) fn status(&self) -> Status {
        self.within(|| rtpsd::status().unwrap())
    }

    pub(crate) fn has_xdp(&self) -> bool {
        self.ip("link show").contains("xdp")
    }

    /// How many tc programs veth0 has on ingress.
    pub(crate) fn classifiers(&self) -> usize {
        let ingress = TcAttachType::Ingress;
        let query = || SchedClassifier::query_tcx("veth0", ingress).unwrap();
        self.within(|| query().1.len())
    }

    /// How many tc programs take what is sent over the loopback interface.
    pub(crate) fn fan_outs(&self) -> usize {
        let query = || SchedClassifier::query_tcx("lo", TcAttachType::Egress).unwrap();
        self.within(|| query().1.len())
    }

    pub(crate) fn pins(&self) -> PathBuf {
        PinFolder::of_namespace(self.inode).path().to_owned()
    }

    pub(crate) fn run_folder(&self) -> RunFolder {
        RunFolder::of_namespace(self.inode)
    }

    /// Whether no trace of the layer is left. A link without pin is freed a moment later.
    pub(crate) fn is_clean(&self) -> bool {
        let is_detached = || !self.has_xdp() && self.classifiers() == 0 && self.fan_outs() == 0;
        wait_until(is_detached)
            && !self.pins().exists()
            && !self.run_folder().layer_socket().parent().unwrap().exists()
    }
}

impl Drop for Netns {
    fn drop(&mut self) {
        drop(self.within(rtpsd::unload));
        run("ip", &["netns", "del", &self.name]);
    }
}

pub(crate) fn run(program: &str, arguments: &[&str]) -> String {
    let output = Command::new(program).args(arguments).output().unwrap();
    assert!(
        output.status.success(),
        "{program} {arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).unwrap()
}

/// Waits for something that happens soon.
pub(crate) fn wait_until(mut happened: impl FnMut() -> bool) -> bool {
    let deadline = Instant::now() + Duration::from_secs(8);
    while !happened() {
        if Instant::now() > deadline {
            return false;
        }
        thread::sleep(Duration::from_millis(20));
    }
    true
}

/// A running rtpsd.
pub(crate) struct Rtpsd {
    child: Child,
}

impl Rtpsd {
    /// Starts it in the namespace and waits until apps can connect.
    pub(crate) fn start(netns: &Netns, arguments: &[&str]) -> Self {
        let (rtpsd, log) = Self::start_logging(netns, arguments);
        // Keeps the pipe empty.
        thread::spawn(move || log.for_each(drop));
        rtpsd
    }

    /// The same; nobody reads its log after that.
    pub(crate) fn start_unread(netns: &Netns, arguments: &[&str]) -> Self {
        Self::start_logging(netns, arguments).0
    }

    fn start_logging(netns: &Netns, arguments: &[&str]) -> (Self, Lines<BufReader<ChildStderr>>) {
        let mut child = Self::command(netns, arguments)
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut lines = BufReader::new(child.stderr.take().unwrap()).lines();
        let mut log = String::new();
        for line in lines.by_ref() {
            let line = line.unwrap();
            let ready = line.contains("ready for apps");
            log.push_str(&line);
            log.push('\n');
            if ready {
                return (Self { child }, lines);
            }
        }
        panic!("rtpsd did not start ({:?}): {log}", child.wait());
    }

    pub(crate) fn command(netns: &Netns, arguments: &[&str]) -> Command {
        let mut command = Command::new("ip");
        command
            .args(["netns", "exec", &netns.name, env!("CARGO_BIN_EXE_rtpsd")])
            .args(["--iface", "veth0"])
            .args(arguments)
            .env_remove("RUST_LOG");
        command
    }

    /// `ip netns exec` becomes the command that it runs.
    pub(crate) fn pid(&self) -> Pid {
        Pid::from_raw(self.child.id().try_into().unwrap())
    }

    /// Sends a signal and waits for the end; says whether rtpsd ended well.
    pub(crate) fn end(mut self, signal: Signal) -> bool {
        kill(self.pid(), signal).unwrap();
        self.child.wait().unwrap().success()
    }
}

impl Drop for Rtpsd {
    fn drop(&mut self) {
        drop(self.child.kill());
        drop(self.child.wait());
    }
}

/// An app's end of the Unix socket.
pub(crate) struct AppSocket {
    socket: OwnedFd,
}

impl AppSocket {
    pub(crate) fn connect(netns: &Netns) -> Self {
        let kind = SockType::SeqPacket;
        let socket = socket(AddressFamily::Unix, kind, SockFlag::empty(), None).unwrap();
        let path = netns.run_folder().layer_socket();
        connect(socket.as_raw_fd(), &UnixAddr::new(&path).unwrap()).unwrap();
        Self { socket }
    }

    /// Sends bytes as they are; false when rtpsd has closed the connection.
    pub(crate) fn send_raw(&self, bytes: &[u8]) -> bool {
        send(self.socket.as_raw_fd(), bytes, MsgFlags::MSG_NOSIGNAL).is_ok()
    }

    pub(crate) fn send(&self, message: &ToLayer) {
        assert!(self.send_raw(&postcard::to_stdvec(message).unwrap()));
    }

    /// The next message and its descriptors; `None` at the end.
    pub(crate) fn receive(&self) -> Option<(FromLayer, Vec<OwnedFd>)> {
        let mut buffer = vec![0; 1 << 17];
        let mut control = nix::cmsg_space!([i32; CHANNEL_DESCRIPTORS]);
        let mut slices = [IoSliceMut::new(&mut buffer)];
        let received = recvmsg::<()>(
            self.socket.as_raw_fd(),
            &mut slices,
            Some(&mut control),
            MsgFlags::MSG_CMSG_CLOEXEC,
        )
        .ok()?;
        let length = received.bytes;
        let mut descriptors = Vec::new();
        for message in received.cmsgs().unwrap() {
            if let ControlMessageOwned::ScmRights(numbers) = message {
                // SAFETY: the kernel has just made these descriptors for this process.
                let owned = numbers
                    .into_iter()
                    .map(|fd| unsafe { OwnedFd::from_raw_fd(fd) });
                descriptors.extend(owned);
            }
        }
        (length > 0).then(|| {
            (
                postcard::from_bytes(&buffer[..length]).unwrap(),
                descriptors,
            )
        })
    }

    /// Skips to the refusal; panics when the connection ends without.
    pub(crate) fn refusal(&self) -> String {
        loop {
            match self.receive() {
                Some((FromLayer::Refused { reason }, _)) => return reason,
                Some(_) => {}
                None => panic!("no reason given"),
            }
        }
    }

    /// Skips to the next match.
    pub(crate) fn matched(&self) -> Guid {
        loop {
            match self.receive().expect("a match").0 {
                FromLayer::Matched { remote, .. } => return remote.guid,
                FromLayer::Refused { reason } => panic!("{reason}"),
                _ => {}
            }
        }
    }

    /// Whether nothing comes for so long.
    pub(crate) fn is_silent_for(&self, duration: Duration) -> bool {
        let mut waiting = [PollFd::new(self.socket.as_fd(), PollFlags::POLLIN)];
        let timeout = PollTimeout::try_from(duration).unwrap();
        poll(&mut waiting, timeout).unwrap() == 0
    }

    pub(crate) fn hello(&self, hello: Hello) -> (FromLayer, Vec<OwnedFd>) {
        self.send(&ToLayer::Hello(hello));
        self.receive().expect("an answer to the hello")
    }
}

pub(crate) fn hello(domain: u32, resume: Option<Resume>) -> Hello {
    Hello {
        version: LAYER_PROTOCOL_VERSION,
        domain,
        name: "test".into(),
        doorbell_port: 40_000,
        ring_bytes: 0,
        resume,
    }
}

/// What an app is told that is taken in.
pub(crate) fn welcome(message: FromLayer) -> Welcome {
    match message {
        FromLayer::Welcome(welcome) => welcome,
        other => panic!("no welcome but {other:?}"),
    }
}

/// Declares an endpoint of the one topic of these tests.
pub(crate) fn declaration(entity: EntityId) -> ToLayer {
    ToLayer::Declare(Box::new(Endpoint {
        entity,
        topic: "topic".into(),
        type_name: "type".into(),
        type_information: Vec::new(),
        type_objects: Vec::new(),
        content_filter: None,
        qos: Qos::default(),
    }))
}
