//! Signs of life, which the low-level layer keeps to itself as long as nobody waits for them.



#[test]
fn the_steady_state_leaves_the_layer_alone() {
    let mut net = hosts(&[true; 20]);
    for host in 0..20 {
        let slot = net.attach(host);
        net.declare(
            host,
            endpoint(slot, 1, if host == 0 { READER } else { WRITER }),
        );
        net.run(SECOND / 7);
    }
    net.run(30 * SECOND);
    net.hosts[0].wakeups = 0;
    net.run(60 * SECOND);
    assert!(net.hosts[0].wakeups <= 20, "{}", net.hosts[0].wakeups);
    assert_eq!(net.hosts[0].layer.status().participants.len(), 19);
    for host in 1..20 {
        net.hosts[host].is_connected = host % 2 == 0;
    }
    net.run(21 * SECOND);
    assert_eq!(net.hosts[0].layer.status().participants.len(), 9);
    assert_eq!(net.kernel(0).peers.len(), 9);
}

#[test]
fn signs_of_life_come_through_where_an_app_waits_for_them() {
    let mut net = hosts(&[true, false]);
    let (a, b) = (net.attach(0), net.attach(1));
    let mut writer = endpoint(b, 1, WRITER);
    writer.qos.liveliness = Liveliness {
        kind: LivelinessKind::Automatic,
        lease: wire::Duration {
            seconds: 3,
            fraction: 0,
        },
    };
    net.declare(1, writer);
    net.run(5 * SECOND);
    let signs = |net: &mut Net| {
        let told = net.replies(0);
        let is_sign = |message: &FromLayer| matches!(message, FromLayer::Liveliness { .. });
        told.iter().filter(|(_, message)| is_sign(message)).count()
    };
    let flags = |net: &mut Net| net.kernel(0).peers[&prefix(2)].flags & PEER_SUPERVISED;
    assert_eq!((signs(&mut net), flags(&mut net)), (0, 0));
    let reader = net.declare(0, endpoint(a, 1, READER));
    net.run(9 * SECOND);
    assert_eq!((signs(&mut net), flags(&mut net)), (9, PEER_SUPERVISED));
    net.request(0, a, ToLayer::Withdraw(reader.entity));
    net.run(9 * SECOND);
    assert_eq!((signs(&mut net), flags(&mut net)), (0, 0));
    net.run(SECOND / 2);
    assert_eq!(net.hosts[1].layer.unacknowledged().count(), 0);
}
