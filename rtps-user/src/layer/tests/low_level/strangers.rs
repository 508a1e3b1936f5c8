//! Participants that are not known until it is proven that they exist.

use std::time::Duration;

use super::hosts;
use super::invented::{STRANGER, acknack, address, announcement, announcement_of};
use crate::layer::tests::SECOND;
use crate::layer::tests::sim::{GROUP, Net, config, prefix};
use crate::layer::{LayerConfig, StoreKey};
use crate::wire::{AckNack, EntityId, MessageWriter, SequenceNumber, SequenceNumberSet};

#[test]
fn a_stranger_costs_nothing_until_it_is_proven() {
    let mut net = hosts(&[true]);
    net.run(30 * SECOND);
    let (sent, kept) = (net.sent, net.hosts[0].store.len());
    let inject = |net: &mut Net, bytes| {
        net.inject(address(), GROUP, bytes);
        net.run(Duration::from_millis(500));
    };
    inject(&mut net, announcement());
    assert_eq!(net.sent - sent, 1, "the low-level layer's answer");
    assert_eq!(net.hosts[0].layer.status().participants.len(), 1);
    assert_eq!(net.hosts[0].store.len(), kept);
    assert!(net.hosts[0].peers.is_empty());

    inject(&mut net, acknack(1));
    assert_eq!(net.hosts[0].peers, [STRANGER].into());
    let key = StoreKey::participant(STRANGER);
    assert!(net.hosts[0].store.contains_key(&key));
    assert!(net.kernel(0).strangers.is_empty());
}

#[test]
fn who_acknowledges_without_naming_us_is_proven() {
    let mut net = hosts(&[true]);
    let mut bytes = Vec::new();
    MessageWriter::new(&mut bytes, STRANGER).acknack(&AckNack {
        reader: EntityId::SEDP_PUBLICATIONS_READER,
        writer: EntityId::SEDP_PUBLICATIONS_WRITER,
        state: SequenceNumberSet::empty(SequenceNumber(1)),
        count: 1,
        is_final: true,
    });
    net.inject(address(), GROUP, announcement());
    net.inject(address(), GROUP, bytes);
    net.run(SECOND);
    assert_eq!(net.hosts[0].peers, [STRANGER].into());
    assert!(net.kernel(0).strangers.is_empty());
}

#[test]
fn a_flood_of_inventions_does_not_push_out_the_known() {
    let mut net = Net::new(0);
    let mut limited = config(1);
    limited.limits.discovery.participants = 50;
    net.add_with_kernel(limited);
    net.add(config(2));
    net.run(SECOND);
    let kept = net.hosts[0].store.len();
    for number in 1000..4000 {
        let ([.., high, low], invented) = (u32::to_be_bytes(number), prefix(number as usize));
        let source = ([10, 6, high, low], 7410).into();
        net.inject(source, GROUP, announcement_of(invented, source));
        net.run(Duration::from_micros(100));
    }
    let participants = net.hosts[0].layer.status().participants;
    assert_eq!(participants.len(), 50);
    let known = prefix(2).to_string();
    assert!(
        participants
            .iter()
            .any(|participant| participant.prefix == known)
    );
    assert_eq!(net.hosts[0].peers, [prefix(2)].into());
    assert_eq!(net.hosts[0].store.len(), kept);
    assert!(net.kernel(0).strangers.len() <= 50, "both know the same");
}

#[test]
fn without_binding_any_address_will_do() {
    for binds in [true, false] {
        let mut net = Net::new(0);
        net.add_with_kernel(LayerConfig {
            bind_addresses: binds,
            ..config(1)
        });
        net.inject(address(), GROUP, announcement());
        net.inject(address(), GROUP, acknack(1));
        net.run(SECOND);
        let elsewhere = ([10, 9, 9, 10], 7410).into();
        let before = net.kernel(0).peers[&STRANGER].last_seen_ns;
        net.inject(elsewhere, GROUP, acknack(2));
        net.run(SECOND);
        let is_renewed = net.kernel(0).peers[&STRANGER].last_seen_ns > before;
        assert_eq!(is_renewed, !binds);
        let layer = &mut net.hosts[0].layer;
        layer
            .handle_datagram(net.now, elsewhere, &acknack(3))
            .unwrap();
        assert_eq!(layer.status().refused.foreign > 0, binds);
    }
}
