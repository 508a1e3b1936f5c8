//! What an endpoint is created from.

use std::sync::Arc;

use rtps_user::layer::protocol::{Endpoint, MAX_PROTOCOL_MESSAGE, ToLayer};
use rtps_user::qos::{ContentFilter, DataRepresentation};
use rtps_user::wire::{EntityId, EntityKind};
use rtps_user::writer::BareKey;
use rtps_user::xtypes::TypeSupport;

use super::Group;
use crate::cdr::DdsType;
use crate::driver::{Declaration, Inherits, MakeFilter};
use crate::error::CreateError;
use crate::filter::PayloadFilter;
use crate::link::encode;
use crate::qos::{check_consistency, policies};

/// Bytes of the largest description of a type, so that there is room for the policies beside it.
const MAX_TYPE: usize = MAX_PROTOCOL_MESSAGE / 4;

/// See the module.
#[derive(Clone)]
pub(crate) struct Template {
    pub(crate) topic: String,
    pub(crate) type_name: String,
    /// What others are told of the type; may be nothing.
    pub(crate) types: TypeSupport,
    /// What a reader wants of its topic, if not all.
    pub(crate) content_filter: Option<ContentFilter>,
    /// The same, for the reader itself.
    pub(crate) payload_filter: Option<PayloadFilter>,
    /// How a writer understands what remote readers want.
    pub(crate) make_filter: Option<MakeFilter>,
    /// What a writer's keys become for readers that take no DHEADERs in them, where they have some.
    pub(crate) bare_key: Option<BareKey>,
    pub(crate) qos: policies::Qos,
    /// The publisher or subscriber, if that is not its own.
    pub(crate) group: Option<Arc<Group>>,
    pub(crate) inherits: Inherits,
    /// Whether others learn of it at once.
    pub(crate) is_enabled: bool,
}

impl Template {
    /// Of an endpoint with a publisher or subscriber of its own, of a type of which nothing is said.
    pub(crate) fn new(topic: &str, type_name: &str, qos: policies::Qos) -> Self {
        Self {
            topic: topic.to_owned(),
            type_name: type_name.to_owned(),
            types: TypeSupport::default(),
            content_filter: None,
            payload_filter: None,
            make_filter: None,
            bare_key: None,
            qos,
            group: None,
            inherits: Inherits::default(),
            is_enabled: true,
        }
    }

    /// Says what the type is, unless that takes too much for the layer to be told.
    pub(crate) fn describe<T: DdsType>(&mut self) {
        let types = T::type_support();
        if types.information.len() + types.objects.len() <= MAX_TYPE {
            self.types = types;
        } else {
            tracing::warn!(
                "type {} is too large to be described: others know its name alone",
                T::TYPE_NAME
            );
        }
    }

    /// Refuses what no endpoint can be created with.
    pub(super) fn check(&self) -> Result<(), CreateError> {
        for name in [&self.topic, &self.type_name] {
            if name.is_empty() || name.len() > 255 || name.contains('\0') {
                return Err(CreateError::InvalidName(name.clone()));
            }
        }
        // As long as any.
        let entity = EntityId::of_app(u8::MAX, u16::MAX, EntityKind::WriterNoKey);
        check_endpoint(self.endpoint(entity))
    }

    pub(super) fn into_declaration(self, entity: EntityId) -> Declaration {
        Declaration {
            endpoint: self.endpoint(entity),
            group: self.group.map(|group| group.id()),
            inherits: self.inherits,
            is_enabled: self.is_enabled,
            make_filter: self.make_filter,
            bare_key: self.bare_key,
        }
    }

    fn endpoint(&self, entity: EntityId) -> Endpoint {
        Endpoint {
            entity,
            topic: self.topic.clone(),
            type_name: self.type_name.clone(),
            type_information: self.types.information.clone(),
            type_objects: self.types.objects.clone(),
            content_filter: self.content_filter.clone(),
            qos: self.qos.clone(),
        }
    }
}

/// Refuses policies that make no sense, and what does not fit in one packet of the layer protocol.
pub(super) fn check_endpoint(endpoint: Endpoint) -> Result<(), CreateError> {
    let qos = &endpoint.qos;
    if qos.representation.contains(&DataRepresentation::Xml) {
        return Err(CreateError::UnsupportedRepresentation);
    }
    check_consistency(qos).map_err(CreateError::Inconsistent)?;
    let declaration = ToLayer::Declare(Box::new(endpoint));
    let (size, limit) = (encode(&declaration).len(), MAX_PROTOCOL_MESSAGE);
    match size > limit {
        true => Err(CreateError::TooLarge { size, limit }),
        false => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::InconsistentPolicy;
    use crate::qos::{PolicyId, Qos};

    #[test]
    fn nonsense_is_refused() {
        let check = |topic: &str, type_name: &str, qos: &policies::Qos| {
            Template::new(topic, type_name, qos.clone()).check()
        };
        let qos = Qos::default().into_writer();
        assert_eq!(check("Square", "ShapeType", &qos), Ok(()));
        let long = "x".repeat(256);
        for (topic, type_name) in [("", "T"), ("T", ""), (&long, "T"), ("a\0b", "T")] {
            assert!(matches!(
                check(topic, type_name, &qos),
                Err(CreateError::InvalidName(_))
            ));
        }
        let nothing = Qos::default().keep_last(0).into_writer();
        let policy = PolicyId::History;
        assert_eq!(
            check("T", "T", &nothing),
            Err(CreateError::Inconsistent(InconsistentPolicy::NoHistory {
                policy
            }))
        );
        let much = Qos::default()
            .user_data([1; 60_000])
            .group_data([1; 60_000]);
        let too_much = much.clone().topic_data([1; 20_000]).into_writer();
        assert_eq!(check("T", "T", &much.into_writer()), Ok(()));
        assert!(matches!(
            check("T", "T", &too_much),
            Err(CreateError::TooLarge {
                limit: MAX_PROTOCOL_MESSAGE,
                ..
            })
        ));
    }
}
