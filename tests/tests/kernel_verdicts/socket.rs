//! The filter on a real socket, where data begins at the UDP header and fragments are whole.

use std::{io::ErrorKind, net::UdpSocket};

use anyhow::{Context as _, Result};
use rtps_ebpf::{
    abi::{DOORBELL_RING, HOOK_FILTER},
    frame::mapped,
};
use rtps_tests::{
    netns::Netns,
    packet::{ANYBODY, SPDP_WRITER, reader_of, writer_of},
    require, skip_unless,
};

use crate::{
    layer::UNICAST_PORT,
    valid::{layer, remote},
};

#[test]
fn apps_get_theirs_and_the_socket_gets_rtpsds() -> Result<()> {
    skip_unless!(require::root());
    Netns::new("verdicts")?.enter(on_loopback)
}

fn on_loopback() -> Result<()> {
    let mut layer = layer(DOORBELL_RING)?;
    let socket = layer.filtered_socket()?;
    let sender = UdpSocket::bind("127.0.0.1:0")?;
    sender.connect(("127.0.0.1", UNICAST_PORT))?;
    let mut buffer = vec![0; 65_536];

    for len in [100, 20_000, 60_000] {
        let message = remote().data(reader_of(1), writer_of(3), len);
        sender.send(message.bytes())?;
        let records = layer.drain().remove(&1).context("nothing in the ring")?;
        assert_eq!(records.len(), 1);
        assert_eq!(records[0].message, message.bytes());
        let header = records[0].header;
        assert_eq!(header.source_address, mapped([127, 0, 0, 1]));
        assert_eq!(header.source_port, sender.local_addr()?.port());
        assert_eq!(header.hook, HOOK_FILTER);
        let error = socket
            .recv(&mut buffer)
            .expect_err("the socket gets nothing");
        assert_eq!(error.kind(), ErrorKind::WouldBlock);
    }

    let message = remote().data(ANYBODY, SPDP_WRITER, 20_000);
    sender.send(message.bytes())?;
    assert!(layer.drain().is_empty());
    let len = socket.recv(&mut buffer)?;
    assert_eq!(&buffer[..len], message.bytes());
    Ok(())
}
