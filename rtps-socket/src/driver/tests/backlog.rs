//! Samples that the app does not take as fast as they come stay where they are.

use rtps_user::qos::History;
use rtps_user::reader::{ReaderConfig, Selection};
use rtps_user::wire::{Data, InlineQos, MessageWriter, PayloadKind, SequenceNumber};

use super::*;

/// The next samples of the remote writer, in one datagram.
pub(super) fn next_samples(sent: &mut i64) -> Vec<u8> {
    const AT_ONCE: i64 = 100;
    let mut datagram = Vec::new();
    let writer = remote_writer().guid;
    let mut message = MessageWriter::new(&mut datagram, writer.prefix);
    for sequence in *sent + 1..=*sent + AT_ONCE {
        message.data(&Data {
            reader: EntityId::UNKNOWN,
            writer: writer.entity,
            sequence: SequenceNumber(sequence),
            inline_qos: InlineQos::default(),
            filters: None,
            kind: PayloadKind::Data,
            payload: &[0, 1, 0, 0],
        });
    }
    *sent += AT_ONCE;
    datagram
}

/// How many samples there are at most in the reader of an app that takes two at a time.
fn most(history: History, take: impl Fn(&Shared, EntityId)) -> usize {
    let steering = Arc::new(Steering::default());
    let (driver, _socket) = open(&steering);
    let id = declare(&driver);
    let shared = driver.shared();
    shared.with(|core, _| {
        let qos = Qos {
            history,
            ..Qos::default()
        };
        let guid = Guid::new(GuidPrefix([1; 12]), id);
        core.endpoints.add_reader(ReaderConfig::new(guid, qos));
    });
    let remote = Box::new(remote_writer());
    let matched = FromLayer::Matched { local: id, remote };
    steering.messages.lock().unwrap().push(matched);
    events(&driver, id);
    steering.streams.store(true, Ordering::Relaxed);
    let most = (0..5000).map(|_| {
        take(shared, id);
        shared.with(|core, _| core.endpoints.reader(id).unwrap().len())
    });
    let most = most.max().unwrap();
    steering.streams.store(false, Ordering::Relaxed);
    most
}

fn take_two(core: &mut Core, id: EntityId) -> usize {
    let reader = core.endpoints.reader_mut(id).unwrap();
    reader.take(2, &Selection::default()).len()
}

fn poll(shared: &Shared, id: EntityId) {
    shared.poll_reader(id, |core, _| take_two(core, id));
}

fn wait(shared: &Shared, id: EntityId) {
    let mut limit = Duration::from_secs(1).into();
    let found = shared.wait_in_reader(id, &mut limit, |core, _| {
        (take_two(core, id) > 0).then_some(())
    });
    found.unwrap();
}

#[test]
fn who_takes_slowly_gets_no_heap_of_samples() {
    for take in [poll, wait] {
        let start = Instant::now();
        let most = most(History::KeepAll, take);
        // A datagram for each millisecond, and those that the background thread takes in before it is sent away.
        let datagrams = start.elapsed().as_millis() as usize + 20;
        let bound = 2 * 100 * datagrams;
        assert!((100..bound).contains(&most), "{most} of 500,000, {bound}");
    }
}

#[test]
fn who_wants_the_newest_gets_it() {
    let most = most(History::KeepLast(300), poll);
    assert!((298..=300).contains(&most), "{most}");
}
