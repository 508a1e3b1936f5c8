use std::net::Ipv6Addr;

use super::*;

/// No other test has it; the tests of `sockets` have those above.
const DOMAIN: u32 = 229;

fn open() -> (InProcessLink, Arc<Epoll>) {
    let settings = Settings {
        domain: DOMAIN,
        name: "test".to_owned(),
        layer: crate::LayerChoice::InProcess,
        ring_bytes: 0,
        busy_poll: None,
        peers: Vec::new(),
        announce_period: None,
    };
    let epoll = Arc::new(Epoll::new().unwrap());
    let link = InProcessLink::open(&settings, &epoll).unwrap();
    (link, epoll)
}

/// What one call takes of what is readable: first bytes and whether IPv6 brought them.
fn receive(link: &mut InProcessLink, epoll: &Epoll) -> Vec<(u8, bool)> {
    let wakeups = epoll.wait(Some(Duration::ZERO)).unwrap();
    let mut taken = Vec::new();
    link.receive(Instant::now(), wakeups, &mut |source, datagram| {
        taken.push((datagram[0], source.is_ipv6()));
    });
    taken
}

#[test]
fn sockets_take_turns_in_a_flood() {
    let (mut link, epoll) = open();
    let port = link.sockets.user_port;
    let addresses = [
        SocketAddr::from((Ipv4Addr::LOCALHOST, port)),
        (Ipv6Addr::LOCALHOST, port).into(),
    ];
    // How many are there by IPv4 and by IPv6.
    let mut left = [0; 2];
    for (address, left) in addresses.into_iter().zip(&mut left) {
        let Ok(sender) = udp::bind(SocketAddr::new(address.ip(), 0)) else {
            println!("skipped: {address} is no address here");
            continue;
        };
        for n in 0..=200 {
            sender.send_to(&[n], address).unwrap();
            *left += 1;
        }
    }
    let mut taken = Vec::new();
    while left != [0; 2] {
        let more = receive(&mut link, &epoll);
        for (is_v6, left) in [false, true].into_iter().zip(&mut left) {
            let count = more.iter().filter(|(_, v6)| *v6 == is_v6).count();
            let turn = 1.min(*left)..=DATAGRAMS_AT_ONCE.min(*left);
            assert!(turn.contains(&count), "{count} of {left}");
            *left -= count;
        }
        taken.extend(more);
    }
    for is_v6 in [false, true] {
        let of_family = taken.iter().filter(|(_, v6)| *v6 == is_v6);
        assert!(of_family.is_sorted(), "the order is kept");
    }
}

#[test]
fn what_left_together_arrives_as_datagrams() {
    let (mut link, epoll) = open();
    let to = SocketAddr::from((Ipv4Addr::LOCALHOST, link.sockets.user_port));
    let sender = udp::bind((Ipv4Addr::LOCALHOST, 0).into()).unwrap();
    for first in [0, 100] {
        let bytes: Vec<u8> = (first..first + 50).flat_map(|n| [n; 20]).collect();
        udp::send_segmented(&sender, to, &bytes[..990], 20).unwrap();
    }
    let mut taken = Vec::new();
    for _ in 0..4 {
        taken.extend(receive(&mut link, &epoll).iter().map(|(n, _)| *n));
    }
    assert_eq!(taken, (0..50).chain(100..150).collect::<Vec<_>>());
}

#[test]
fn nothing_read_is_nothing_taken() {
    let (mut link, epoll) = open();
    let to = SocketAddr::from((Ipv4Addr::LOCALHOST, link.sockets.user_port));
    let sender = udp::bind((Ipv4Addr::LOCALHOST, 0).into()).unwrap();
    sender.send_to(&[], to).unwrap();
    sender.send_to(b"x", to).unwrap();
    let taken: Vec<_> = (0..3).flat_map(|_| receive(&mut link, &epoll)).collect();
    assert_eq!(taken, [(b'x', false)]);
    // Woken for nothing, as by a datagram with a wrong checksum.
    link.receive_from(Instant::now(), 1, &mut |_, _| panic!("there is nothing"));
}
