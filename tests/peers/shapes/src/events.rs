//! What happens, one JSON object a line on standard output.

use std::io::Write;

/// So many remote endpoints are matched.
pub fn matched(current: i32) {
    print(&format!(r#"{{"event":"matched","current":{current}}}"#));
}

/// A remote endpoint is not matched because of this policy, in the words of DDS: `RELIABILITY`.
pub fn incompatible_qos(policy: &str) {
    print(&format!(
        r#"{{"event":"incompatible_qos","policy":"{policy}"}}"#
    ));
}

/// The program ends for this reason.
pub fn error(message: &str) {
    print(&format!(r#"{{"event":"error","message":{message:?}}}"#));
}

pub(crate) fn sample(color: &str, number: i32, size: usize) {
    print(&format!(
        r#"{{"event":"sample","color":{color:?},"x":{number},"size":{size}}}"#
    ));
}

pub(crate) fn end(event: &str, color: &str) {
    print(&format!(r#"{{"event":"{event}","color":{color:?}}}"#));
}

pub(crate) fn done(sent: u64, received: u64) {
    print(&format!(
        r#"{{"event":"done","sent":{sent},"received":{received}}}"#
    ));
}

fn print(line: &str) {
    // Nobody reads any more: there will be a signal, or the time will be over.
    let _ = writeln!(std::io::stdout().lock(), "{line}");
}
