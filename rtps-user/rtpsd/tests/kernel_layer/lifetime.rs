//! Start, stop, kill, take-over and unload of rtpsd, and what each leaves.

use nix::sys::signal::{Signal, kill};
use rtpsd::AttachedMode;

use crate::steps::kill_at;
use crate::support::{AppSocket, Netns, Rtpsd, run};

#[test]
fn a_clean_stop_leaves_nothing() {
    let Some(netns) = Netns::new() else { return };
    let rtpsd = Rtpsd::start(
        &netns,
        &["--mode", "native", "--domain", "0", "--domain", "7"],
    );
    let status = netns.status();
    assert!(status.loaded);
    assert_eq!(status.rtpsd, Some(rtpsd.pid().as_raw()));
    assert_eq!(status.network_namespace, netns.inode);
    let [interface] = &status.interfaces[..] else {
        panic!("{:?}", status.interfaces);
    };
    assert_eq!(interface.name, "veth0");
    assert_eq!(interface.mode, AttachedMode::Native);
    let domains: Vec<u32> = status.domains.iter().map(|domain| domain.domain).collect();
    assert_eq!(domains, [0, 7]);
    assert!(
        status
            .domains
            .iter()
            .all(|domain| domain.discovery.is_some())
    );
    assert!(status.counters.contains_key("veth0") && status.counters.contains_key("other"));
    assert!(netns.has_xdp());
    assert!(rtpsd.end(Signal::SIGTERM));
    assert!(netns.is_clean());
    assert!(!netns.status().loaded);
}

#[test]
fn it_stops_cleanly_though_nobody_reads_its_log() {
    let Some(netns) = Netns::new() else { return };
    let rtpsd = Rtpsd::start_unread(&netns, &[]);
    // What it has to say of an app, and of its own end, it says to a closed pipe.
    drop(AppSocket::connect(&netns));
    assert!(rtpsd.end(Signal::SIGTERM));
    assert!(netns.is_clean());
}

#[test]
fn a_failed_start_leaves_nothing() {
    let Some(netns) = Netns::new() else { return };
    let output = Rtpsd::command(&netns, &["--iface", "nosuchif0"])
        .output()
        .unwrap();
    assert!(!output.status.success());
    assert!(String::from_utf8_lossy(&output.stderr).contains("nosuchif0"));
    assert!(netns.is_clean());
}

#[test]
fn a_second_rtpsd_is_refused() {
    let Some(netns) = Netns::new() else { return };
    let first = Rtpsd::start(&netns, &[]);
    // It is still the one after it was asked for its status.
    assert!(netns.status().loaded);
    let second = Rtpsd::command(&netns, &[]).output().unwrap();
    assert!(!second.status.success());
    let log = String::from_utf8_lossy(&second.stderr);
    assert!(log.contains(&first.pid().to_string()), "{log}");
    assert!(netns.status().loaded);
}

#[test]
fn a_killed_rtpsd_is_taken_over() {
    let Some(netns) = Netns::new() else { return };
    let rtpsd = Rtpsd::start(&netns, &["--mode", "native"]);
    let before = netns.status();
    assert!(!rtpsd.end(Signal::SIGKILL));
    let orphaned = netns.status();
    assert!(orphaned.loaded && orphaned.rtpsd.is_none());
    assert_eq!(orphaned.counters.len(), before.counters.len());
    assert!(netns.has_xdp());
    let who_fans_out = [before.fan_out.as_str(), orphaned.fan_out.as_str()];
    assert_eq!(who_fans_out, ["kernel"; 2]);
    assert_eq!(netns.fan_outs(), 1);
    let links = || {
        netns
            .within(|| run("ls", &["-i", netns.pins().to_str().unwrap()]))
            .lines()
            .find(|line| line.contains("xdp-"))
            .unwrap()
            .to_owned()
    };
    let link = links();
    let rtpsd = Rtpsd::start(&netns, &["--mode", "native"]);
    assert_eq!(links(), link, "the link was made anew");
    let after = netns.status();
    assert_eq!(after.domains[0].prefix, before.domains[0].prefix);
    assert_eq!(
        after.domains[0].participant_id,
        before.domains[0].participant_id
    );
    assert_eq!(
        after.domains[0].incarnation,
        before.domains[0].incarnation + 1
    );
    assert_eq!((after.fan_out.as_str(), netns.fan_outs()), ("kernel", 1));
    assert!(rtpsd.end(Signal::SIGINT));
    assert!(netns.is_clean());
}

#[test]
fn what_is_no_longer_served_is_forgotten() {
    let Some(netns) = Netns::new() else { return };
    let rtpsd = Rtpsd::start(&netns, &["--domain", "0", "--domain", "7"]);
    let before = netns.status().domains;
    assert!(!rtpsd.end(Signal::SIGKILL));
    let rtpsd = Rtpsd::start(&netns, &["--domain", "0", "--domain", "9"]);
    let after = netns.status().domains;
    let ids: Vec<u32> = after.iter().map(|domain| domain.domain).collect();
    assert_eq!(ids, [0, 9]);
    assert_eq!(after[0].prefix, before[0].prefix);
    let pins = run("ls", &[netns.pins().to_str().unwrap()]);
    assert!(
        !pins.contains("store-7") && pins.contains("store-9"),
        "{pins}"
    );
    assert!(!rtpsd.end(Signal::SIGKILL));
    let _rtpsd = Rtpsd::start(&netns, &["--domain", "7"]);
    let again = netns.status().domains;
    assert_ne!(again[0].prefix, before[1].prefix);
}

#[test]
fn unload_cleans_up_after_a_kill() {
    let Some(netns) = Netns::new() else { return };
    let rtpsd = Rtpsd::start(&netns, &[]);
    assert!(!rtpsd.end(Signal::SIGKILL));
    let unloaded = netns.within(|| rtpsd::unload().unwrap());
    assert_eq!(unloaded.rtpsd, None);
    assert!(unloaded.leftovers);
    assert!(netns.is_clean());
    let again = netns.within(|| rtpsd::unload().unwrap());
    assert_eq!(again, rtpsd::Unloaded::default());
}

#[test]
fn unload_ends_a_running_and_a_stopped_rtpsd() {
    let Some(netns) = Netns::new() else { return };
    for stopped in [false, true] {
        let rtpsd = Rtpsd::start(&netns, &[]);
        if stopped {
            kill(rtpsd.pid(), Signal::SIGSTOP).unwrap();
        }
        let unloaded = netns.within(|| rtpsd::unload().unwrap());
        assert_eq!(unloaded.rtpsd, Some(rtpsd.pid().as_raw()));
        assert_eq!(unloaded.killed, stopped);
        assert!(netns.is_clean());
    }
}

#[test]
fn a_kill_at_any_step_leaves_nothing_that_stays() {
    /// Not all, for the sake of time; of what is done one after the other, each kind of step.
    const STRIDE: usize = 11;
    let Some(netns) = Netns::new() else { return };
    for step in (1..).step_by(STRIDE) {
        let was_killed = netns.within(|| kill_at(step));
        if step % 2 == 1 {
            netns.within(|| rtpsd::unload().unwrap());
        } else {
            assert!(Rtpsd::start(&netns, &[]).end(Signal::SIGTERM));
        }
        assert!(netns.is_clean(), "after step {step}");
        if !was_killed {
            assert!(step > 5 * STRIDE, "only {step} steps");
            return;
        }
    }
}
