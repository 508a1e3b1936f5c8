//! Which programs are attached to an interface, in which mode, and who answers discovery there.

use nix::sys::signal::Signal;
use rtpsd::AttachedMode;

use crate::support::{Netns, Rtpsd, run, wait_until};

#[test]
fn generic_mode_is_reported() {
    let Some(netns) = Netns::new() else { return };
    let _rtpsd = Rtpsd::start(&netns, &["--mode", "generic"]);
    assert_eq!(netns.status().interfaces[0].mode, AttachedMode::Generic);
    assert!(netns.ip("link show dev veth0").contains("xdpgeneric"));
}

#[test]
fn auto_mode_falls_back_to_generic() {
    let Some(netns) = Netns::new() else { return };
    // The loopback interface has no native XDP.
    let refused = Rtpsd::command(&netns, &["--iface", "lo", "--mode", "native"])
        .output()
        .unwrap();
    assert!(!refused.status.success());
    assert!(netns.is_clean());
    let _rtpsd = Rtpsd::start(&netns, &["--iface", "lo"]);
    let modes: Vec<AttachedMode> = netns.status().interfaces.iter().map(|i| i.mode).collect();
    assert_eq!(modes, [AttachedMode::Generic, AttachedMode::Tc]);
}

#[test]
fn a_veth_is_left_in_one_piece() {
    let Some(netns) = Netns::new() else { return };
    let state = || {
        let mode = netns.status().interfaces[0].mode;
        (mode, netns.has_xdp(), netns.classifiers())
    };
    let by_user: [&str; 2] = ["--discovery", "user"];
    for (arguments, expected) in [
        (&[][..], (AttachedMode::Tc, false, 1)),
        (&by_user, (AttachedMode::Tc, false, 1)),
        (&["--mode", "native"], (AttachedMode::Native, true, 1)),
        (&["--mode", "generic"], (AttachedMode::Generic, true, 1)),
        (&["--mode", "tc"], (AttachedMode::Tc, false, 1)),
    ] {
        // What an earlier one has left is taken over, or makes room.
        let rtpsd = Rtpsd::start(&netns, arguments);
        assert!(
            wait_until(|| state() == expected),
            "{arguments:?}: {:?}",
            state()
        );
        assert!(!rtpsd.end(Signal::SIGKILL));
        assert_eq!(state(), expected, "{arguments:?}, killed");
    }
    netns.within(|| rtpsd::unload().unwrap());
    assert!(netns.is_clean());
}

#[test]
fn the_kernel_answers_until_unload() {
    let Some(netns) = Netns::new() else { return };
    let rtpsd = Rtpsd::start(&netns, &[]);
    let status = netns.status();
    assert_eq!(status.discovery.as_deref(), Some("kernel"));
    assert_eq!(status.interfaces[0].answers, "kernel");
    assert!(status.wakeups.is_some());
    assert_eq!(netns.classifiers(), 1);
    assert!(!rtpsd.end(Signal::SIGKILL));
    let orphaned = netns.status();
    assert_eq!(orphaned.interfaces[0].answers, "kernel");
    assert_eq!(orphaned.wakeups, None);
    assert_eq!(netns.classifiers(), 1);
    let _rtpsd = Rtpsd::start(&netns, &[]);
    assert_eq!(netns.classifiers(), 1, "attached twice");
    netns.within(|| rtpsd::unload().unwrap());
    assert!(netns.is_clean());
}

#[test]
fn rtpsd_answers_where_it_is_told_to_or_the_kernel_cannot() {
    let Some(netns) = Netns::new() else { return };
    let answers = || -> Vec<String> {
        let interfaces = netns.status().interfaces.into_iter();
        interfaces.map(|interface| interface.answers).collect()
    };
    let rtpsd = Rtpsd::start(&netns, &["--iface", "lo"]);
    assert_eq!(answers(), ["rtpsd: no Ethernet", "kernel"]);
    assert!(!rtpsd.end(Signal::SIGKILL));
    let rtpsd = Rtpsd::start(&netns, &["--discovery", "user", "--mode", "native"]);
    assert_eq!(answers(), ["rtpsd: `--discovery user`"]);
    assert_eq!(netns.status().discovery.as_deref(), Some("user"));
    assert!(wait_until(|| netns.classifiers() == 0));
    assert!(rtpsd.end(Signal::SIGTERM));
    assert!(netns.is_clean());
}

#[test]
fn an_interface_that_is_no_longer_asked_for_is_left_alone() {
    let Some(netns) = Netns::new() else { return };
    netns.ip("link add veth2 type veth peer name veth3");
    netns.ip("addr add 10.98.0.1/24 dev veth2");
    netns.ip("link set veth2 up");
    let rtpsd = Rtpsd::start(&netns, &["--iface", "veth2"]);
    assert_eq!(netns.status().interfaces.len(), 2);
    assert!(!rtpsd.end(Signal::SIGKILL));
    let _rtpsd = Rtpsd::start(&netns, &[]);
    assert_eq!(netns.status().interfaces.len(), 1);
    let links = netns.within(|| run("ls", &[netns.pins().to_str().unwrap()]));
    assert_eq!(links.matches("-ingress").count(), 1, "{links}");
    assert_eq!((netns.classifiers(), netns.fan_outs()), (1, 1));
}
