//! Policies as the options ask for them. What no option sets keeps the default of the standard, but for
//! RELIABILITY, which is RELIABLE on both sides.

use rtps_socket::Qos;
use rtps_socket::qos::History;

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
    match options.publisher.final_state {
        // They end as unregistered, not as disposed.
        Some(FinalState::Unregistered) => qos.autodispose_unregistered_instances(false),
        Some(FinalState::Disposed) | None => qos,
    }
}

/// Of the DataReaders.
pub(crate) fn reader(options: &Options) -> Qos {
    let mut qos = endpoint(options);
    if options.qos.strength.is_some() {
        qos = qos.exclusive_ownership(0);
    }
    if let Some(separation) = options.qos.minimum_separation {
        qos = qos.time_based_filter(separation);
    }
    qos
}

/// What both sides have to agree on.
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
    qos = match asked.history {
        None => qos,
        Some(History::KeepAll) => qos.keep_all(),
        Some(History::KeepLast(depth)) => qos.keep_last(depth),
    };
    if let Some(period) = asked.deadline {
        qos = qos.deadline(period);
    }
    qos.durability(asked.durability)
}
