//! The report for people.

use std::fmt::Write as _;

use super::{Report, Stack, answer, crowd, join};

/// Tables, then notes.
pub(super) fn text(report: &Report) -> String {
    let mut text = String::new();
    join_table(&mut text, &report.join);
    crowd_table(&mut text, &report.crowd);
    answer_table(&mut text, &report.answer);
    for note in &report.notes {
        let _ = writeln!(text, "{note}.");
    }
    text
}

fn join_table(text: &mut String, rows: &[join::Row]) {
    if rows.is_empty() {
        return;
    }
    let _ = writeln!(
        text,
        "A remote Cyclone DDS participant joins a host\n{:<8} {:>5} {:>8} {:>10} {:>6} {:>8} {:>9} {:>9} {:>9}",
        "stack", "apps", "packets", "bytes", "SPDP", "samples", "match s", "CPU s", "remote s"
    );
    for row in rows {
        let _ = writeln!(
            text,
            "{:<8} {:>5} {:>8} {:>10} {:>6} {:>8} {:>9} {:>9.3} {:>9.3}",
            name(row.stack),
            row.apps,
            row.packets,
            row.bytes,
            row.participant_packets,
            row.endpoint_samples,
            seconds(row.match_seconds),
            row.cpu_seconds,
            row.remote_cpu_seconds
        );
    }
    text.push('\n');
}

fn crowd_table(text: &mut String, rows: &[crowd::Row]) {
    if rows.is_empty() {
        return;
    }
    let _ = writeln!(
        text,
        "A crowd of participants joins a host, and half of it vanishes\n{:>12} {:>11} {:>7} {:>9} {:>11} {:>12} {:>5} {:>13}",
        "participants",
        "discovery s",
        "CPU s",
        "wakes/min",
        "(an app's)",
        "CPU s/min",
        "lost",
        "after lease s"
    );
    for row in rows {
        let _ = writeln!(
            text,
            "{:>12} {:>11.3} {:>7.3} {:>9.1} {:>11.1} {:>12.3} {:>5} {:>13}",
            row.participants,
            row.discovery_seconds,
            row.cpu_seconds,
            row.wakeups_per_minute,
            row.app_wakeups_per_minute,
            row.steady_cpu_seconds_per_minute,
            row.lost,
            seconds(row.forgotten_seconds_after_lease)
        );
    }
    text.push('\n');
}

fn answer_table(text: &mut String, rows: &[answer::Row]) {
    if rows.is_empty() {
        return;
    }
    let _ = writeln!(
        text,
        "A host answers a stranger; microseconds\n{:<8} {:>9} {:>9} {:>12} {:>14} {:>8} {:>10}  by",
        "stack", "p50", "p99", "unicast p50", "multicast p50", "answers", "unanswered"
    );
    for row in rows {
        let _ = writeln!(
            text,
            "{:<8} {:>9.1} {:>9.1} {:>12.1} {:>14.1} {:>8} {:>10}  {}",
            name(row.stack),
            row.p50_us,
            row.p99_us,
            row.unicast_p50_us,
            row.multicast_p50_us,
            row.answers,
            row.unanswered,
            row.answers_by.as_deref().unwrap_or_default()
        );
    }
    text.push('\n');
}

fn name(stack: Stack) -> &'static str {
    match stack {
        Stack::Kernel => "kernel",
        Stack::User => "user",
        Stack::Cyclone => "cyclone",
    }
}

fn seconds(seconds: Option<f64>) -> String {
    seconds.map_or_else(|| "never".to_owned(), |seconds| format!("{seconds:.3}"))
}
