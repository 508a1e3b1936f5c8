//! What the options have to be in view of each other.

use thiserror::Error;

use super::{Options, PublisherOptions, Role, SubscriberOptions};

/// Options that do not go together.
#[derive(Clone, Copy, Debug, Eq, Error, PartialEq)]
pub(crate) enum Inconsistent {
    #[error("a topic is needed: -t NAME")]
    NoTopic,
    #[error("either -P (publish) or -S (subscribe) is needed")]
    NoRole,
    #[error("-P and -S exclude each other")]
    BothRoles,
    #[error("--cft and -c exclude each other: either is a filter")]
    TwoFilters,
}

/// Completes the options; also what to warn of.
pub(super) fn check(
    mut options: Options,
    roles: &[Role],
) -> Result<(Options, Vec<String>), Inconsistent> {
    if options.topic.is_empty() {
        return Err(Inconsistent::NoTopic);
    }
    options.role = role(roles)?;
    let mut warnings = Vec::new();
    match options.role {
        Role::Publisher => {
            if options.color.is_none() {
                options.color = Some("BLUE".to_owned());
                warnings.push("no color was given (-c): it is BLUE".to_owned());
            }
            warn_publisher(&options, &mut warnings);
        }
        Role::Subscriber => warn_subscriber(&options, &mut warnings),
    }
    warn_either(&options, &mut warnings);
    if options.role == Role::Subscriber
        && options.subscriber.filter.is_some()
        && options.color.is_some()
    {
        return Err(Inconsistent::TwoFilters);
    }
    Ok((options, warnings))
}

fn role(roles: &[Role]) -> Result<Role, Inconsistent> {
    let has = |role| roles.contains(&role);
    match (has(Role::Publisher), has(Role::Subscriber)) {
        (true, false) => Ok(Role::Publisher),
        (false, true) => Ok(Role::Subscriber),
        (false, false) => Err(Inconsistent::NoRole),
        (true, true) => Err(Inconsistent::BothRoles),
    }
}

fn warn_publisher(options: &Options, warnings: &mut Vec<String>) {
    let subscriber = &options.subscriber;
    let default = SubscriberOptions::default();
    let ignored = [
        (options.qos.minimum_separation.is_some(), "--time-filter"),
        (subscriber.reads, "-R"),
        (subscriber.is_plain, "--take-read"),
        (subscriber.filter.is_some(), "--cft"),
        (subscriber.period != default.period, "--read-period"),
    ];
    warn(&ignored, "a publisher", warnings);
}

fn warn_subscriber(options: &Options, warnings: &mut Vec<String>) {
    let publisher = &options.publisher;
    let default = PublisherOptions::default();
    let ignored = [
        (publisher.shape_size != default.shape_size, "-z"),
        (options.qos.lifespan.is_some(), "--lifespan"),
        (publisher.instances != default.instances, "--num-instances"),
        (publisher.final_state.is_some(), "--final-instance-state"),
        (
            publisher.set_iterations.is_some(),
            "--coherent-sample-count",
        ),
        (publisher.payload_size > 0, "--additional-payload-size"),
    ];
    warn(&ignored, "a subscriber", warnings);
}

fn warn_either(options: &Options, warnings: &mut Vec<String>) {
    let publisher = &options.publisher;
    let has_scope = options.qos.scope != super::QosOptions::default().scope;
    let ignored = [
        (
            publisher.set_iterations.is_some(),
            "--coherent-sample-count",
        ),
        (has_scope, "--access-scope"),
    ];
    if !options.has_presentation() {
        warn(
            &ignored,
            "who has neither --coherent nor --ordered",
            warnings,
        );
    }
    if publisher.shape_size != 0 {
        let ignored = [(publisher.size_modulo.is_some(), "--size-modulo")];
        warn(&ignored, "who has no -z 0", warnings);
    }
}

fn warn(options: &[(bool, &str)], whose: &str, warnings: &mut Vec<String>) {
    let given = options.iter().filter(|(is_given, _)| *is_given);
    warnings.extend(given.map(|(_, option)| format!("{option} means nothing to {whose}")));
}

#[cfg(test)]
mod tests {
    use super::super::{Request, parse};
    use super::*;

    fn warnings(line: &str) -> Vec<String> {
        match parse(line.split_whitespace()) {
            Ok(Request::Run(_, warnings)) => warnings,
            other => panic!("{line}: {other:?}"),
        }
    }

    #[test]
    fn what_is_missing_is_named_in_order() {
        let error = |line: &str| parse(line.split_whitespace()).unwrap_err().to_string();
        assert_eq!(error(""), Inconsistent::NoTopic.to_string());
        assert_eq!(error("-P -S"), Inconsistent::NoTopic.to_string());
        assert_eq!(error("-t T"), Inconsistent::NoRole.to_string());
        assert_eq!(error("-t T -PS"), Inconsistent::BothRoles.to_string());
        let line = "-S -t T -c RED --cft x>1";
        assert_eq!(error(line), Inconsistent::TwoFilters.to_string());
    }

    #[test]
    fn a_publisher_may_have_a_color_and_an_ignored_filter() {
        assert_eq!(warnings("-P -t T -c RED --cft x>1 -R").len(), 2);
        assert_eq!(warnings("-P -t T -c RED").len(), 0);
        assert_eq!(warnings("-P -t T").len(), 1);
    }

    #[test]
    fn options_of_the_other_side_are_warned_of() {
        let line = "-S -t T -z 30 --lifespan 5 --num-instances 2 --additional-payload-size 9";
        assert_eq!(warnings(line).len(), 4);
    }

    #[test]
    fn presentation_options_need_a_kind_of_access() {
        let line = "-P -t T -c RED --access-scope t --coherent-sample-count 3";
        assert_eq!(warnings(line).len(), 2);
        assert_eq!(warnings(&format!("{line} --ordered")).len(), 0);
        assert_eq!(warnings("-P -t T -c RED --size-modulo 3").len(), 1);
        assert_eq!(warnings("-P -t T -c RED --size-modulo 3 -z 0").len(), 0);
    }
}
