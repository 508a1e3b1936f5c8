//! Policies as the options ask for them. What no option sets keeps the default of the standard, but for
//! RELIABILITY, which is RELIABLE on both sides.

use rtps_socket::Qos;

use crate::options::{FinalState, Options};

/// Of the Publisher or Subscriber.
pub(crate) fn group(options: &Options) -> Qos {
    let qos = Qos::default().partition(options.partition.clone());
    match options.has_presentation() {
        true => {
            let (scope, coherent, ordered) = (
                options.qos.scope,
                options.qos.is_coherent,
                options.qos.is_ordered,
            );
            qos.presentation(scope, coherent, ordered)
        }
        false => qos,
    }
}

/// Of the DataWriters.
pub(crate) fn writer(options: &Options) -> Qos {
    let mut qos = endpoint(options);
    if let Some(strength) = options.qos.strength {
        qos = qos.exclusive_ownership(strength);
    }
    if let Some(lifespan) = options.qos.lifespan {
        qos = qos.lifespan(lifespan);
    }
    let only_unregisters = options.publisher.final_state == Some(FinalState::Unregistered);
    qos.with(|policies| {
        if only_unregisters {
            policies
                .writer_data_lifecycle
                .autodispose_unregistered_instances = false;
        }
    })
}

/// Of the DataReaders.
pub(crate) fn reader(options: &Options) -> Qos {
    let mut qos = endpoint(options);
    if options.qos.strength.is_some() {
        qos = qos.exclusive_ownership(0);
    }
    if let Some(separation) = options.qos.minimum_separation {
        let separation = rtps_user::wire::Duration::from_std(separation);
        qos = qos.with(|policies| policies.time_based_filter.0 = separation);
    }
    qos
}

/// What both sides agree on.
fn endpoint(options: &Options) -> Qos {
    let asked = &options.qos;
    let mut qos = match asked.is_reliable {
        true => Qos::reliable(),
        false => Qos::best_effort(),
    };
    qos = match asked.is_xcdr2 {
        true => qos.xcdr2(),
        false => qos.xcdr1(),
    };
    if let Some(period) = asked.deadline {
        qos = qos.deadline(period);
    }
    qos.with(|policies| {
        policies.durability = asked.durability;
        if let Some(history) = asked.history {
            policies.history = history;
        }
    })
}
