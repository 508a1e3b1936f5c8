//! The lines that tell of communication statuses.

use rtps_socket::qos::PolicyId;
use rtps_socket::{DomainParticipant, EntityEvent, StatusEvent, StatusMask};

use crate::output::Printer;

/// Has all that happens to the participant's writers and readers printed from now on.
pub(crate) fn listen(participant: &DomainParticipant, printer: &Printer) {
    let printer = printer.clone();
    participant.set_listener(StatusMask::WITHOUT_DATA, move |event| {
        if let Some(line) = line(&event) {
            printer.print(line);
        }
    });
}

/// The line of an event; none for what is told nobody.
fn line(event: &EntityEvent) -> Option<String> {
    let EntityEvent {
        topic, type_name, ..
    } = event;
    let (callback, what) = describe(&event.event)?;
    Some(format!(
        "on_{callback}() topic: '{topic}'  type: '{type_name}'{what}"
    ))
}

/// The callback and what it is told.
fn describe(event: &StatusEvent) -> Option<(&'static str, String)> {
    let described = match event {
        StatusEvent::InconsistentTopic { .. } => ("inconsistent_topic", String::new()),
        StatusEvent::OfferedIncompatibleQos { policy, .. } => {
            ("offered_incompatible_qos", policy_of(*policy))
        }
        StatusEvent::RequestedIncompatibleQos { policy, .. } => {
            ("requested_incompatible_qos", policy_of(*policy))
        }
        StatusEvent::PublicationMatched {
            current, change, ..
        } => (
            "publication_matched",
            format!(" : matched readers {current} (change = {change})"),
        ),
        StatusEvent::SubscriptionMatched {
            current, change, ..
        } => (
            "subscription_matched",
            format!(" : matched writers {current} (change = {change})"),
        ),
        StatusEvent::OfferedDeadlineMissed { total, .. } => {
            ("offered_deadline_missed", one_of(*total))
        }
        StatusEvent::RequestedDeadlineMissed { total, .. } => {
            ("requested_deadline_missed", one_of(*total))
        }
        StatusEvent::LivelinessLost { total } => ("liveliness_lost", one_of(*total)),
        StatusEvent::LivelinessChanged {
            alive, not_alive, ..
        } => (
            "liveliness_changed",
            format!(" : (alive = {alive}, not_alive = {not_alive})"),
        ),
        _ => return None,
    };
    Some(described)
}

/// Events come one by one.
fn one_of(total: u64) -> String {
    format!(" : (total = {total}, change = 1)")
}

fn policy_of(policy: PolicyId) -> String {
    let name = match policy {
        PolicyId::TypeConsistency => "TYPE_CONSISTENCY_ENFORCEMENT".to_owned(),
        other => format!("{other:?}").to_uppercase(),
    };
    format!(" : {} ({name})", policy as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn policies_have_the_names_of_the_vendors() {
        let policies = [
            PolicyId::Reliability,
            PolicyId::DataRepresentation,
            PolicyId::TypeConsistency,
        ];
        let names = policies.map(policy_of);
        let expected = [
            " : 11 (RELIABILITY)",
            " : 23 (DATAREPRESENTATION)",
            " : 24 (TYPE_CONSISTENCY_ENFORCEMENT)",
        ];
        assert_eq!(names, expected);
    }

    #[test]
    fn totals_are_told() {
        let (callback, what) = describe(&StatusEvent::LivelinessLost { total: 3 }).unwrap();
        assert_eq!(callback, "liveliness_lost");
        assert_eq!(what, " : (total = 3, change = 1)");
        assert_eq!(describe(&StatusEvent::DataAvailable), None);
    }
}
