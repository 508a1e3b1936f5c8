//! `cargo xtask status`: what the kernel layer of this network namespace is doing.

use anyhow::Result;
use rtpsd::Status;
use serde_json::Value;

/// Prints the status for people, or as one JSON document.
pub(crate) fn run(json: bool) -> Result<()> {
    let status = rtpsd::status()?;
    if json {
        println!("{}", serde_json::to_string_pretty(&status)?);
    } else {
        print(&status);
    }
    Ok(())
}

fn print(status: &Status) {
    if !status.loaded {
        println!(
            "no kernel layer is loaded in this network namespace; `cargo xtask load --iface IF` loads it"
        );
        return;
    }
    match status.rtpsd {
        Some(pid) => println!(
            "rtpsd runs with pid {pid}, woken {} times",
            status.wakeups.unwrap_or_default()
        ),
        None => {
            println!("rtpsd does not run; samples still flow; `cargo xtask load` starts it again")
        }
    }
    for interface in &status.interfaces {
        println!(
            "interface {}: {}, discovery answered by {}",
            interface.name,
            interface.mode.name(),
            interface.answers
        );
    }
    println!("fan-out: {}", status.fan_out);
    for domain in &status.domains {
        print_domain(domain);
    }
    for app in &status.apps {
        let (pid, uid) = (app.pid.unwrap_or_default(), app.uid.unwrap_or_default());
        println!(
            "app {}: {} (pid {pid}, uid {uid}), ring of {} kB",
            app.slot,
            app.name,
            app.ring_bytes / 1024
        );
    }
    for (interface, counters) in &status.counters {
        for (name, value) in counters.iter().filter(|(_, value)| **value > 0) {
            println!("{interface}: {name} {value}");
        }
    }
}

fn print_domain(domain: &rtpsd::DomainStatus) {
    print!("domain {}: participant {}", domain.domain, domain.prefix);
    match &domain.discovery {
        Some(discovery) => println!(", {}", known(discovery)),
        None => println!(),
    }
}

/// What discovery knows, in words.
fn known(discovery: &Value) -> String {
    let count = |of: &str| -> (usize, usize) {
        let found = discovery[of]
            .as_array()
            .map(Vec::as_slice)
            .unwrap_or_default();
        let endpoints = found
            .iter()
            .filter_map(|one| one["endpoints"].as_array())
            .map(Vec::len);
        (found.len(), endpoints.sum())
    };
    let (participants, remote) = count("participants");
    let (apps, local) = count("apps");
    format!(
        "knows {participants} participants with {remote} endpoints; serves {apps} apps with {local} endpoints"
    )
}
