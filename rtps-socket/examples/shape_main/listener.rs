//! The lines that tell of communication statuses.

use rtps_socket::StatusEvent;
use rtps_socket::qos::PolicyId;

use crate::output::Printer;

/// A listener that prints.
pub(crate) fn printing(
    topic: &str,
    type_name: &'static str,
    printer: &Printer,
) -> impl Fn(StatusEvent) + Send + Sync + 'static {
    let (topic, printer) = (topic.to_owned(), printer.clone());
    move |event| {
        if let Some(line) = line(&event, &topic, type_name) {
            printer.print(line);
        }
    }
}

/// The line of an event of an endpoint; none for what is told nobody.
fn line(event: &StatusEvent, topic: &str, type_name: &str) -> Option<String> {
    let (callback, what) = match event {
        StatusEvent::InconsistentTopic { .. } => ("on_inconsistent_topic", String::new()),
        StatusEvent::OfferedIncompatibleQos { policy, .. } => {
            ("on_offered_incompatible_qos", policy_of(*policy))
        }
        StatusEvent::RequestedIncompatibleQos { policy, .. } => {
            ("on_requested_incompatible_qos", policy_of(*policy))
        }
        StatusEvent::PublicationMatched {
            current, change, ..
        } => (
            "on_publication_matched",
            format!(" : matched readers {current} (change = {change})"),
        ),
        StatusEvent::SubscriptionMatched {
            current, change, ..
        } => (
            "on_subscription_matched",
            format!(" : matched writers {current} (change = {change})"),
        ),
        StatusEvent::LivelinessChanged {
            alive, not_alive, ..
        } => (
            "on_liveliness_changed",
            format!(" : (alive = {alive}, not_alive = {not_alive})"),
        ),
        StatusEvent::LivelinessLost => ("on_liveliness_lost", missed(1, 1)),
        StatusEvent::DeadlineMissed { .. } => ("on_requested_deadline_missed", missed(1, 1)),
        _ => return None,
    };
    Some(format!(
        "{callback}() topic: '{topic}'  type: '{type_name}'{what}"
    ))
}

fn missed(total: u64, change: u64) -> String {
    format!(" : (total = {total}, change = {change})")
}

fn policy_of(policy: PolicyId) -> String {
    format!(" : {} ({})", policy as u32, policy_name(policy))
}

/// As the vendors spell it.
fn policy_name(policy: PolicyId) -> String {
    match policy {
        PolicyId::TypeConsistency => "TYPE_CONSISTENCY_ENFORCEMENT".to_owned(),
        other => format!("{other:?}").to_uppercase(),
    }
}
