//! Driving a link that behaves oddly.

mod backlog;
mod filters;

use std::net::{SocketAddr, UdpSocket};
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::Duration;

use rtps_user::RemoteEndpoint;
use rtps_user::layer::protocol::{Endpoint, FromLayer, ToLayer};
use rtps_user::qos::Qos;
use rtps_user::wire::{EntityId, EntityKind, Guid, GuidPrefix, MessageReceiver, Submessage};

use super::*;
use crate::link::{Arrivals, Burst, Identity, LayerKind, Sink};
use crate::status::StatusEvent;
use crate::sys::Wakeups;

/// The number of the descriptor of the link under test.
const CONTROL: u8 = 2;

/// What a test sees and steers of its link.
#[derive(Default)]
struct Steering {
    /// There is always another record.
    is_flooded: AtomicBool,
    /// There are always more samples of the remote writer.
    streams: AtomicBool,
    /// How many there have been.
    streamed: Mutex<i64>,
    is_lost: AtomicBool,
    /// Times that the descriptor was found readable.
    seen: AtomicUsize,
    messages: Mutex<Vec<FromLayer>>,
    /// The first bytes of the samples sent.
    sent: Mutex<Vec<u8>>,
}

/// A link in the manner of the kernel's: records come from memory, the layer's messages from a descriptor.
struct OddLink(Arc<Steering>);

impl Link for OddLink {
    fn kind(&self) -> LayerKind {
        LayerKind::Kernel
    }

    fn identity(&self) -> Identity {
        Identity {
            slot: 1,
            prefix: GuidPrefix([1; 12]),
            datagram_size: 1472,
        }
    }

    fn request(&mut self, _now: Instant, _request: ToLayer) {}

    fn poll_message(&mut self) -> Option<FromLayer> {
        self.0.messages.lock().unwrap().pop()
    }

    fn send(&mut self, _now: Instant, burst: &Burst<'_>) {
        for datagram in burst.datagrams() {
            let received = MessageReceiver::new(GuidPrefix::UNKNOWN, datagram).unwrap();
            let samples = received.filter_map(|received| match received.unwrap().submessage {
                Submessage::Data(data) => data.payload.first().copied(),
                _ => None,
            });
            self.0.sent.lock().unwrap().extend(samples);
        }
    }

    fn receive(&mut self, _now: Instant, wakeups: Wakeups, sink: &mut Sink<'_>) {
        if wakeups.contains(CONTROL) {
            self.0.seen.fetch_add(1, Ordering::Relaxed);
        }
        if self.0.is_flooded.load(Ordering::Relaxed) {
            sink(SocketAddr::from(([127, 0, 0, 1], 1)), b"not of RTPS");
        }
        if self.0.streams.load(Ordering::Relaxed) {
            let samples = backlog::next_samples(&mut self.0.streamed.lock().unwrap());
            sink(SocketAddr::from(([127, 0, 0, 1], 1)), &samples);
        }
    }

    fn arrivals(&self) -> Option<Arc<dyn Arrivals>> {
        None
    }

    fn likely(&self) -> Wakeups {
        Wakeups::default()
    }

    fn prepare_sleep(&mut self) -> bool {
        let is_endless = [&self.0.is_flooded, &self.0.streams];
        !is_endless.iter().any(|flag| flag.load(Ordering::Relaxed))
    }

    fn awake(&mut self) {}

    fn has_news(&self, _now: Instant) -> bool {
        !self.0.messages.lock().unwrap().is_empty() || self.is_lost()
    }

    fn poll_timeout(&self) -> Option<Instant> {
        None
    }

    fn handle_timeout(&mut self, _now: Instant) {}

    fn is_lost(&self) -> bool {
        self.0.is_lost.load(Ordering::Relaxed)
    }

    fn shutdown(&mut self, _now: Instant) {}
}

/// A participant whose descriptor is readable from the beginning; the socket keeps it so.
fn open(steering: &Arc<Steering>) -> (Driver, UdpSocket) {
    let epoll = Arc::new(Epoll::new().unwrap());
    let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
    let address = socket.local_addr().unwrap();
    epoll.add(socket.as_fd(), CONTROL, Interest::Edge).unwrap();
    let link = Box::new(OddLink(Arc::clone(steering)));
    let driver = Driver::start(link, epoll, None).unwrap();
    socket.send_to(b"readable", address).unwrap();
    (driver, socket)
}

fn declare(driver: &Driver) -> EntityId {
    driver.shared().with(|core, now| {
        let guid = core.new_guid(EntityKind::ReaderNoKey).unwrap();
        core.declare(now, declaration(guid.entity));
        guid.entity
    })
}

fn declaration(entity: EntityId) -> Declaration {
    Declaration {
        endpoint: Endpoint {
            entity,
            topic: "Square".to_owned(),
            type_name: "Shape".to_owned(),
            type_information: Vec::new(),
            type_objects: Vec::new(),
            content_filter: None,
            qos: Qos::default(),
        },
        group: None,
        inherits: Inherits::default(),
        is_enabled: true,
        make_filter: None,
        bare_key: None,
    }
}
fn events(driver: &Driver, id: EntityId) -> Vec<StatusEvent> {
    driver.shared().poll(|core, now| {
        core.settle(now);
        core.entity_mut(id).unwrap().take_events()
    })
}

#[test]
fn a_flood_does_not_hide_the_descriptors() {
    let steering = Arc::new(Steering::default());
    steering.is_flooded.store(true, Ordering::Relaxed);
    let (driver, _socket) = open(&steering);
    let deadline = Instant::now() + Duration::from_millis(200);
    let found: Option<()> = driver.shared().wait_until(Some(deadline), |_, _| None);
    assert_eq!(found, None);
    assert!(steering.seen.load(Ordering::Relaxed) > 0);
    steering.is_flooded.store(false, Ordering::Relaxed);
}

#[test]
fn polling_does_not_hide_the_descriptors() {
    let steering = Arc::new(Steering::default());
    let (driver, socket) = open(&steering);
    // Whoever sleeps takes the seat from the background thread and leaves it free.
    let soon = Instant::now() + Duration::from_millis(50);
    let found: Option<()> = driver.shared().wait_until(Some(soon), |_, _| None);
    assert_eq!(found, None);
    let before = steering.seen.load(Ordering::Relaxed);
    let address = socket.local_addr().unwrap();
    socket.send_to(b"readable", address).unwrap();
    let end = Instant::now() + Duration::from_millis(200);
    while Instant::now() < end {
        let now = Some(Instant::now());
        let found: Option<()> = driver.shared().wait_until(now, |_, _| None);
        assert_eq!(found, None);
    }
    assert!(steering.seen.load(Ordering::Relaxed) > before);
}

#[test]
fn a_flood_leaves_an_event_loop_its_turn() {
    let steering = Arc::new(Steering::default());
    let (driver, _socket) = open(&steering);
    driver.shared().external_fd();
    steering.is_flooded.store(true, Ordering::Relaxed);
    driver.shared().drive();
    let wakeups = driver.shared().epoll.wait(Some(Duration::ZERO)).unwrap();
    assert!(wakeups.contains(INTERRUPT), "there is more to drive");
    steering.is_flooded.store(false, Ordering::Relaxed);
}

fn remote_writer() -> RemoteEndpoint {
    let entity = EntityId::of_app(1, 1, EntityKind::WriterNoKey);
    RemoteEndpoint {
        guid: Guid::new(GuidPrefix([9; 12]), entity),
        unicast: Vec::new(),
        multicast: Vec::new(),
        addresses: Vec::new(),
        expects_inline_qos: false,
        takes_bare_keys: false,
        qos: Qos::default(),
        topic: "Square".to_owned(),
        type_name: "Shape".to_owned(),
        type_information: Vec::new(),
        content_filter: None,
    }
}

#[test]
fn the_loss_of_the_layer_ends_matches_and_endless_waits() {
    let steering = Arc::new(Steering::default());
    let (driver, _socket) = open(&steering);
    let id = declare(&driver);
    let remote = Box::new(remote_writer());
    let matched = FromLayer::Matched { local: id, remote };
    steering.messages.lock().unwrap().push(matched);
    assert!(matches!(
        events(&driver, id)[..],
        [StatusEvent::SubscriptionMatched { change: 1, .. }]
    ));
    steering.is_lost.store(true, Ordering::Relaxed);
    let found: Option<()> = driver.shared().wait_until(None, |_, _| None);
    assert_eq!(found, None);
    assert!(matches!(
        events(&driver, id)[..],
        [
            StatusEvent::SubscriptionMatched { change: -1, .. },
            StatusEvent::LayerLost
        ]
    ));
    assert!(events(&driver, id).is_empty(), "it is said once");
}

#[test]
fn a_refusal_is_reported() {
    let steering = Arc::new(Steering::default());
    let (driver, _socket) = open(&steering);
    let id = declare(&driver);
    let reason = "no".to_owned();
    let refused = FromLayer::Refused {
        reason: reason.clone(),
    };
    steering.messages.lock().unwrap().push(refused);
    assert_eq!(events(&driver, id), [StatusEvent::Refused { reason }]);
}
