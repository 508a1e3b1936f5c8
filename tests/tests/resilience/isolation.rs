//! What an app cannot do to others.

use std::fs;
use std::io::ErrorKind;
use std::thread;

use anyhow::{Context, Result, ensure};
use rtps_tests::layer::Layer;
use rtps_tests::netns::Identity;
use rtps_tests::stage::{Stage, eventually};
use rtps_tests::stream::{End, RATE, Stream};
use rtps_tests::{require, skip_unless};
use rtps_user::layer::protocol::{FromLayer, Resume};
use rtpsd::{PinFolder, RunFolder};

use crate::control_socket::{BREATH, ControlSocket};
use crate::hostile::Random;

#[test]
fn pins_are_closed_to_apps() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("pins")?;
    let _layer = stage.load(&stage.ours)?;
    let inode = stage.ours.netns.inode()?;
    let (pins, run) = (
        PinFolder::of_namespace(inode),
        RunFolder::of_namespace(inode),
    );
    ensure!(pins.path().join("rings").exists());
    let socket = run.layer_socket();
    stage
        .ours
        .netns
        .enter_as(Identity::NOBODY, || -> Result<()> {
            let refused = |error: std::io::Error| error.kind() == ErrorKind::PermissionDenied;
            ensure!(fs::read_dir(pins.path()).is_err_and(refused));
            ensure!(fs::metadata(pins.path().join("rings")).is_err_and(refused));
            // Connecting is all that it may do there.
            let sibling = socket.with_file_name("mine.sock");
            ensure!(fs::File::create(sibling).is_err_and(refused));
            ensure!(fs::remove_file(&socket).is_err_and(refused));
            Ok(())
        })
}

#[test]
fn a_slot_belongs_to_who_has_its_token() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("token")?;
    let layer = stage.load(&stage.ours)?;
    let owner = ControlSocket::connect(&stage.ours.netns)?;
    let FromLayer::Welcome(welcome) = owner.hello(None)? else {
        anyhow::bail!("the owner is not welcome");
    };
    let (slot, token) = (welcome.slot, welcome.token);
    let guess = [token.map(|byte| !byte), [0; 16]];
    // While the owner is there not even the token helps.
    for token in guess.into_iter().chain([token]) {
        try_to_take(&stage, slot, token).context("with the owner attached")?;
    }
    layer.kill()?;
    let _layer = stage.load(&stage.ours)?;
    for token in guess {
        try_to_take(&stage, slot, token).context("while the owner is awaited")?;
    }
    let owner = ControlSocket::connect(&stage.ours.netns)?;
    let FromLayer::Welcome(again) = owner.hello(Some(Resume { slot, token }))? else {
        anyhow::bail!("the owner is not welcome back");
    };
    ensure!((again.slot, again.prefix) == (slot, welcome.prefix));
    Ok(())
}

fn try_to_take(stage: &Stage, slot: u8, token: [u8; 16]) -> Result<()> {
    let thief = ControlSocket::connect(&stage.ours.netns)?;
    if let FromLayer::Welcome(welcome) = thief.hello(Some(Resume { slot, token }))? {
        ensure!(welcome.slot != slot, "slot {slot} was given away");
    }
    Ok(())
}

#[test]
fn one_user_cannot_keep_others_out() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("users")?;
    let _layer = stage.load(&stage.ours)?;
    let netns = &stage.ours.netns;
    let greedy = (0..200)
        .map(|_| {
            let app = ControlSocket::connect(netns)?;
            app.slot().map(|_slot| app)
        })
        .collect::<Result<Vec<_>>>()?;
    let refused = ControlSocket::connect(netns)?.hello(None)?;
    ensure!(
        matches!(&refused, FromLayer::Refused { reason } if reason.contains("65534")),
        "{refused:?}"
    );
    let somebody = Identity {
        uid: 65533,
        gid: 65534,
    };
    ControlSocket::connect_as(somebody, netns)?.slot()?;
    drop(greedy);
    // rtpsd may see the new one before it sees all the others go.
    eventually("there is room again", || {
        Ok(ControlSocket::connect(netns)?.slot().ok())
    })
    .map(drop)
}

#[test]
fn garbage_on_the_control_socket_disturbs_nobody() -> Result<()> {
    skip_unless!(require::root());
    let stage = Stage::new("control")?;
    let mut layer = stage.load(&stage.ours)?;
    let ends = (End::Cyclone, End::Ours(Layer::Kernel));
    let mut stream = Stream::start(&stage, "Square", ends, 4 * RATE)?;
    stream.wait_for(100)?;
    let mut random = Random::new(1);
    for round in 0..1000 {
        let socket = ControlSocket::connect(&stage.ours.netns)?;
        if round % 3 == 0 {
            socket.slot()?;
        }
        for _ in 0..4 {
            let length = random.below(4000);
            // After the first of them nobody may be listening any more.
            let _ = socket.send_raw(&random.bytes(length));
        }
        thread::sleep(BREATH);
    }
    stream.finish()?;
    ensure!(
        layer.process().wait_exit(BREATH).is_err(),
        "rtpsd has ended"
    );
    // Whoever behaves is still welcome.
    Stream::start(&stage, "Circle", ends, 100)?
        .finish()
        .map(drop)
}
