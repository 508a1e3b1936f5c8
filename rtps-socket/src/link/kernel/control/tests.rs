//! The app's side of the layer protocol against an rtpsd that comes and goes.

use std::os::fd::AsRawFd;

use nix::sys::socket::{
    AddressFamily, Backlog, MsgFlags, SockFlag, SockType, UnixAddr, bind, listen, recv, send,
    socket,
};
use rtps_user::layer::protocol::LAYER_PROTOCOL_VERSION;
use rtps_user::qos::Qos;
use rtps_user::wire::{EntityKind, Guid, GuidPrefix};

use super::*;
use crate::sys::seqpacket::accept;

/// An rtpsd that answers as it is told.
struct Daemon {
    path: PathBuf,
    listener: OwnedFd,
}

impl Daemon {
    fn start(path: &std::path::Path) -> Self {
        let _ = std::fs::remove_file(path);
        let flags = SockFlag::SOCK_CLOEXEC;
        let listener = socket(AddressFamily::Unix, SockType::SeqPacket, flags, None).unwrap();
        bind(listener.as_raw_fd(), &UnixAddr::new(path).unwrap()).unwrap();
        listen(&listener, Backlog::new(4).unwrap()).unwrap();
        Self {
            path: path.to_owned(),
            listener,
        }
    }

    fn accept(&self) -> Connection {
        Connection(accept(&self.listener))
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        let _ = std::fs::remove_file(&self.path);
    }
}

struct Connection(OwnedFd);

impl Connection {
    fn hear(&self) -> ToLayer {
        let mut buffer = vec![0; MAX_PROTOCOL_MESSAGE];
        let len = recv(self.0.as_raw_fd(), &mut buffer, MsgFlags::empty()).unwrap();
        postcard::from_bytes(&buffer[..len]).unwrap()
    }

    fn hear_hello(&self) -> Hello {
        match self.hear() {
            ToLayer::Hello(hello) => hello,
            other => panic!("{other:?} is no hello"),
        }
    }

    fn say(&self, message: &FromLayer) {
        let bytes = postcard::to_stdvec(message).unwrap();
        send(self.0.as_raw_fd(), &bytes, MsgFlags::empty()).unwrap();
    }
}

fn welcome() -> Welcome {
    Welcome {
        slot: 3,
        token: [7; 16],
        prefix: GuidPrefix([1; 12]),
        datagram_size: 1472,
    }
}

fn hello() -> Hello {
    Hello {
        version: LAYER_PROTOCOL_VERSION,
        domain: 0,
        name: "test".to_owned(),
        doorbell_port: 1,
        ring_bytes: 4096,
        resume: None,
    }
}

fn declaration(serial: u16) -> ToLayer {
    ToLayer::Declare(Box::new(Endpoint {
        entity: EntityId::of_app(3, serial, EntityKind::WriterNoKey),
        topic: "T".to_owned(),
        type_name: "T".to_owned(),
        type_information: Vec::new(),
        type_objects: Vec::new(),
        content_filter: None,
        qos: Qos::default(),
    }))
}

fn socket_path(name: &str) -> PathBuf {
    std::env::temp_dir().join(format!("rtps-socket-{name}-{}.sock", std::process::id()))
}

fn attach(daemon: &Daemon) -> (Control, Connection) {
    let epoll = Arc::new(Epoll::new().unwrap());
    std::thread::scope(|scope| {
        let server = scope.spawn(|| {
            let connection = daemon.accept();
            assert_eq!(connection.hear_hello().resume, None);
            connection.say(&FromLayer::Welcome(welcome()));
            connection
        });
        let attached = Control::connect(daemon.path.clone(), hello(), &epoll);
        let (mut control, welcome, _) = attached.unwrap();
        control.set_resume(Resume {
            slot: welcome.slot,
            token: welcome.token,
        });
        (control, server.join().unwrap())
    })
}

#[test]
fn everything_is_declared_again_after_a_restart() {
    let path = socket_path("restart");
    let daemon = Daemon::start(&path);
    let (mut control, connection) = attach(&daemon);
    let now = Instant::now();
    control.request(now, declaration(1));
    control.request(now, declaration(2));
    assert_eq!(
        [connection.hear(), connection.hear()],
        [declaration(1), declaration(2)]
    );
    drop((connection, daemon));
    assert!(matches!(control.receive(now), Some(ControlEvent::Lost(_))));

    // While rtpsd is away, things change.
    control.request(
        now,
        ToLayer::Withdraw(EntityId::of_app(3, 1, EntityKind::WriterNoKey)),
    );
    control.request(now, declaration(3));
    control.request(now, ToLayer::Describe(vec![1]));
    let after = Some(Guid::UNKNOWN);
    control.request(now, ToLayer::Browse { after });
    let later = now + Duration::from_secs(1);
    control.handle_timeout(later);
    let daemon = Daemon::start(&path);
    control.handle_timeout(later + Duration::from_secs(1));
    let connection = daemon.accept();
    let resume = connection.hear_hello().resume.unwrap();
    assert_eq!((resume.slot, resume.token), (3, [7; 16]));
    connection.say(&FromLayer::Welcome(welcome()));
    assert!(matches!(
        control.receive(later),
        Some(ControlEvent::Welcome(..))
    ));
    control.attached(later);
    let heard = [(); 4].map(|()| connection.hear());
    let browse = ToLayer::Browse { after: None };
    assert_eq!(
        heard,
        [
            ToLayer::Describe(vec![1]),
            declaration(2),
            declaration(3),
            browse
        ]
    );
}

#[test]
fn a_refused_app_asks_again() {
    let path = socket_path("refused");
    let daemon = Daemon::start(&path);
    let (mut control, connection) = attach(&daemon);
    drop(connection);
    let mut now = Instant::now();
    control.receive(now);
    for _ in 0..3 {
        now = control.poll_timeout().unwrap();
        control.handle_timeout(now);
        let connection = daemon.accept();
        connection.hear_hello();
        let reason = "not yet".to_owned();
        connection.say(&FromLayer::Refused { reason });
        assert!(control.receive(now).is_none());
    }
    assert!(control.poll_message().is_none());
}

#[test]
fn packets_that_are_no_messages_end_the_connection() {
    let path = socket_path("garbage");
    let daemon = Daemon::start(&path);
    let (mut control, connection) = attach(&daemon);
    send(connection.0.as_raw_fd(), &[0xff; 40], MsgFlags::empty()).unwrap();
    let now = Instant::now();
    assert!(matches!(control.receive(now), Some(ControlEvent::Lost(_))));
    assert!(control.poll_timeout().is_some_and(|retry| retry > now));
}

#[test]
fn packets_that_are_too_long_are_left_out() {
    let path = socket_path("long");
    let daemon = Daemon::start(&path);
    let (mut control, connection) = attach(&daemon);
    let long = vec![0; MAX_PROTOCOL_MESSAGE + 1];
    send(connection.0.as_raw_fd(), &long, MsgFlags::empty()).unwrap();
    let refused = FromLayer::Refused {
        reason: "the next".to_owned(),
    };
    connection.say(&refused);
    assert!(control.receive(Instant::now()).is_none());
    assert_eq!(control.poll_message(), Some(refused));
    assert_eq!(control.poll_timeout(), None, "nothing is lost");
}

#[test]
fn what_no_packet_can_carry_does_not_block_the_rest() {
    let path = socket_path("carry");
    let daemon = Daemon::start(&path);
    let (mut control, connection) = attach(&daemon);
    let mut huge = declaration(1);
    if let ToLayer::Declare(endpoint) = &mut huge {
        endpoint.qos.user_data = vec![0; 64 << 20];
    }
    let now = Instant::now();
    control.request(now, huge);
    control.request(now, declaration(2));
    assert_eq!(connection.hear(), declaration(2));
    assert!(matches!(
        control.poll_message(),
        Some(FromLayer::Refused { .. })
    ));
}

#[test]
fn a_closed_connection_is_not_tried_again() {
    let path = socket_path("closed");
    let daemon = Daemon::start(&path);
    let (mut control, connection) = attach(&daemon);
    let now = Instant::now();
    control.close();
    control.request(now, declaration(1));
    assert_eq!(control.poll_timeout(), None);
    let mut buffer = [0; 8];
    let end = recv(connection.0.as_raw_fd(), &mut buffer, MsgFlags::empty());
    assert_eq!(end, Ok(0));
}

#[test]
fn without_rtpsd_the_error_says_what_to_do() {
    let epoll = Arc::new(Epoll::new().unwrap());
    let error = Control::connect(socket_path("nobody"), hello(), &epoll).unwrap_err();
    assert!(error.to_string().contains("cargo xtask load"), "{error}");
}
