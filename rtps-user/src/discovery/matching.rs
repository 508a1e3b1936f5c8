//! Which endpoints belong together: those of one topic and type whose policies and partitions fit (DDS 1.4 section
//! 2.2.3; RTPS 2.5 section 8.5.4.5).
//!
//! [`Matchmaker`] holds every endpoint, ours and remote ones alike, and the outcome for each pair with one of ours,
//! from the point of view of ours: two of our own make two pairs. It answers each change with the differences.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Bound;

use crate::RemoteEndpoint;
use crate::qos::{PolicyId, compatible};
use crate::wire::{EntityId, Guid, GuidPrefix, WireError};
use crate::xtypes::{Assignable, TypeHash, TypeInformation, TypeLibrary};

/// What a pair of endpoints comes to.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub enum Outcome {
    /// They communicate.
    Matched,
    /// This policy keeps them from it.
    Incompatible(PolicyId),
    /// The names of their types differ, or one has keys and the other has not, or the reader's type cannot take what is
    /// written of the writer's.
    InconsistentTopic,
}

/// What has changed for one of our endpoints.
#[derive(Clone, Debug, PartialEq)]
pub struct MatchChange {
    /// Our endpoint.
    pub local: EntityId,
    /// The other one, which may be ours as well.
    pub other: Guid,
    /// What was before.
    pub before: Option<Outcome>,
    /// What is now; nothing where they have nothing to do with each other any more. With `Matched` before and now,
    /// the other one's policies or locators have changed.
    pub now: Option<Outcome>,
}

/// All endpoints, and which belong together.
#[derive(Debug)]
pub struct Matchmaker {
    own: GuidPrefix,
    endpoints: BTreeMap<Guid, RemoteEndpoint>,
    topics: BTreeMap<String, BTreeSet<Guid>>,
    /// By the other one first, so that all that concerns one remote endpoint or participant stands together.
    pairs: BTreeMap<(Guid, EntityId), Outcome>,
    types: TypeLibrary,
    /// TypeObjects that would say whether types fit.
    wanted: BTreeSet<TypeHash>,
}

const FIRST_ENTITY: EntityId = EntityId([0; 4]);
const LAST_ENTITY: EntityId = EntityId([0xff; 4]);

impl Matchmaker {
    /// Without endpoints; those of the participant `own` are ours.
    pub fn new(own: GuidPrefix) -> Self {
        Self {
            own,
            endpoints: BTreeMap::new(),
            topics: BTreeMap::new(),
            pairs: BTreeMap::new(),
            types: TypeLibrary::default(),
            wanted: BTreeSet::new(),
        }
    }

    /// An endpoint, as others see it.
    pub fn endpoint(&self, guid: Guid) -> Option<&RemoteEndpoint> {
        self.endpoints.get(&guid)
    }

    /// All endpoints from a GUID on, in the order of their GUIDs.
    pub fn endpoints_from(&self, start: Bound<Guid>) -> impl Iterator<Item = &RemoteEndpoint> {
        let endpoints = self.endpoints.range((start, Bound::Unbounded));
        endpoints.map(|(_, endpoint)| endpoint)
    }

    /// Our endpoints that are matched with this one.
    pub fn matched_with(&self, other: Guid) -> impl Iterator<Item = EntityId> + '_ {
        self.pairs
            .range((other, FIRST_ENTITY)..=(other, LAST_ENTITY))
            .filter(|(_, outcome)| **outcome == Outcome::Matched)
            .map(|((_, local), _)| *local)
    }

    /// Our endpoints that are matched with one of the participant; one that is matched with several comes as often.
    pub fn matched_with_participant(
        &self,
        prefix: GuidPrefix,
    ) -> impl Iterator<Item = EntityId> + '_ {
        self.pairs_of_participant(prefix).map(|(_, local)| local)
    }

    /// The endpoints of a participant, each with one of ours that it is matched with.
    pub fn pairs_of_participant(
        &self,
        prefix: GuidPrefix,
    ) -> impl Iterator<Item = (Guid, EntityId)> + '_ {
        let first = (Guid::new(prefix, FIRST_ENTITY), FIRST_ENTITY);
        let last = (Guid::new(prefix, LAST_ENTITY), LAST_ENTITY);
        self.pairs
            .range(first..=last)
            .filter(|(_, outcome)| **outcome == Outcome::Matched)
            .map(|(pair, _)| *pair)
    }

    /// What one of our endpoints is matched with.
    pub fn matches_of(&self, local: EntityId) -> impl Iterator<Item = Guid> + '_ {
        self.candidates(Guid::new(self.own, local))
            .filter(move |other| self.pairs.get(&(*other, local)) == Some(&Outcome::Matched))
    }

    /// Adds an endpoint, or takes in how it has changed.
    pub fn insert(&mut self, endpoint: RemoteEndpoint) -> Vec<MatchChange> {
        let guid = endpoint.guid;
        let mut changes = Vec::new();
        match self.endpoints.get(&guid) {
            Some(known) if *known == endpoint => return changes,
            Some(known) if known.topic != endpoint.topic => changes = self.remove(guid),
            _ => {}
        }
        self.topics
            .entry(endpoint.topic.clone())
            .or_default()
            .insert(guid);
        self.endpoints.insert(guid, endpoint);
        for other in self.candidates(guid).collect::<Vec<_>>() {
            let outcome = self.evaluate(guid, other);
            self.settle(guid, other, outcome, true, &mut changes);
            self.settle(other, guid, outcome, false, &mut changes);
        }
        changes
    }

    /// Takes an endpoint out.
    pub fn remove(&mut self, guid: Guid) -> Vec<MatchChange> {
        let mut changes = Vec::new();
        for other in self.candidates(guid).collect::<Vec<_>>() {
            self.settle(guid, other, None, false, &mut changes);
            self.settle(other, guid, None, false, &mut changes);
        }
        if let Some(endpoint) = self.endpoints.remove(&guid)
            && let Some(members) = self.topics.get_mut(&endpoint.topic)
        {
            members.remove(&guid);
            if members.is_empty() {
                self.topics.remove(&endpoint.topic);
            }
        }
        changes
    }

    /// The types that are known.
    pub fn types(&self) -> &TypeLibrary {
        &self.types
    }

    /// Takes in the types of our own endpoints, before these: a serialized TypeMapping.
    pub fn add_types(&mut self, mapping: &[u8]) -> Result<(), WireError> {
        self.types.add_mapping(mapping)
    }

    /// TypeObjects that are missing to say whether types fit; until they are there the types' names decide.
    pub fn take_wanted_types(&mut self) -> BTreeSet<TypeHash> {
        std::mem::take(&mut self.wanted)
    }

    /// Takes in TypeObjects that were missing.
    pub fn learn_types(&mut self, objects: &[(TypeHash, Vec<u8>)]) -> Vec<MatchChange> {
        let mut changes = Vec::new();
        let added = objects
            .iter()
            .filter(|(hash, object)| self.types.add(*hash, object));
        if added.count() == 0 {
            return changes;
        }
        let first = Guid::new(self.own, FIRST_ENTITY);
        let last = Guid::new(self.own, LAST_ENTITY);
        let typed = self.endpoints.range(first..=last);
        let typed = typed.filter(|(_, endpoint)| !endpoint.type_information.is_empty());
        for guid in typed.map(|(guid, _)| *guid).collect::<Vec<_>>() {
            for other in self.candidates(guid).collect::<Vec<_>>() {
                let outcome = self.evaluate(guid, other);
                self.settle(guid, other, outcome, true, &mut changes);
                self.settle(other, guid, outcome, true, &mut changes);
            }
        }
        changes
    }

    /// The endpoints of the same topic that this one may make a pair with: for a remote one, ours only.
    fn candidates(&self, guid: Guid) -> impl Iterator<Item = Guid> + use<'_> {
        let (first, last) = if guid.prefix == self.own {
            (GuidPrefix([0; 12]), GuidPrefix([0xff; 12]))
        } else {
            (self.own, self.own)
        };
        let range = Guid::new(first, FIRST_ENTITY)..=Guid::new(last, LAST_ENTITY);
        self.endpoints
            .get(&guid)
            .and_then(|endpoint| self.topics.get(&endpoint.topic))
            .into_iter()
            .flat_map(move |members| members.range(range.clone()).copied())
            .filter(move |other| other.entity.is_writer() != guid.entity.is_writer())
    }

    fn evaluate(&mut self, a: Guid, b: Guid) -> Option<Outcome> {
        let (a, b) = (self.endpoints.get(&a)?, self.endpoints.get(&b)?);
        let (writer, reader) = if a.guid.entity.is_writer() {
            (a, b)
        } else {
            (b, a)
        };
        if writer.type_name != reader.type_name
            || writer.guid.entity.has_key() != reader.guid.entity.has_key()
        {
            return Some(Outcome::InconsistentTopic);
        }
        match self.types.fit(writer, reader) {
            Assignable::Yes => {}
            Assignable::No => return Some(Outcome::InconsistentTopic),
            Assignable::Unknown(missing) => {
                self.wanted.extend(missing);
                if reader.qos.type_consistency.force_type_validation {
                    return Some(Outcome::InconsistentTopic);
                }
            }
        }
        if !writer.qos.partition.matches(&reader.qos.partition) {
            return None;
        }
        Some(match compatible(&writer.qos, &reader.qos) {
            Ok(()) => Outcome::Matched,
            Err(policy) => Outcome::Incompatible(policy),
        })
    }

    /// Notes the outcome from the point of view of `local`, where that is ours. `other` may be what has changed.
    fn settle(
        &mut self,
        local: Guid,
        other: Guid,
        now: Option<Outcome>,
        only_differences: bool,
        changes: &mut Vec<MatchChange>,
    ) {
        if local.prefix != self.own {
            return;
        }
        let pair = (other, local.entity);
        let before = match now {
            Some(outcome) => self.pairs.insert(pair, outcome),
            None => self.pairs.remove(&pair),
        };
        let is_update = !only_differences && now == Some(Outcome::Matched);
        if before != now || is_update {
            changes.push(MatchChange {
                local: local.entity,
                other,
                before,
                now,
            });
        }
    }
}

impl TypeLibrary {
    /// Whether the types of two endpoints fit, as far as both say what they are.
    fn fit(&self, writer: &RemoteEndpoint, reader: &RemoteEndpoint) -> Assignable {
        let unknown = Assignable::Unknown(BTreeSet::new());
        let (of_writer, of_reader) = (&writer.type_information, &reader.type_information);
        if of_writer.is_empty() || of_reader.is_empty() {
            return unknown;
        }
        if of_writer == of_reader {
            return Assignable::Yes;
        }
        let decode = |bytes: &[u8]| TypeInformation::decode(bytes).ok();
        let (Some(of_writer), Some(of_reader)) = (decode(of_writer), decode(of_reader)) else {
            return unknown;
        };
        let (of_writer, of_reader) = (of_writer.minimal.type_id, of_reader.minimal.type_id);
        if of_writer.hash().is_none() || of_reader.hash().is_none() {
            return unknown;
        }
        self.is_assignable(&of_reader, &of_writer, &reader.qos.type_consistency)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::qos::{Partition, Qos, Reliability};
    use crate::wire::EntityKind;
    use crate::xtypes::{
        Definition, Extensibility, StructMember, TypeBuilder, TypeKind, TypePair, TypeSupport,
    };

    const OURS: GuidPrefix = GuidPrefix([5; 12]);
    const THEIRS: GuidPrefix = GuidPrefix([7; 12]);

    fn guid(prefix: GuidPrefix, serial: u16, kind: EntityKind) -> Guid {
        Guid::new(prefix, EntityId::of_app(1, serial, kind))
    }

    fn endpoint(guid: Guid) -> RemoteEndpoint {
        RemoteEndpoint {
            guid,
            unicast: Vec::new(),
            addresses: Vec::new(),
            multicast: Vec::new(),
            expects_inline_qos: false,
            qos: Qos::default(),
            topic: "Square".to_owned(),
            type_name: "ShapeType".to_owned(),
            type_information: Vec::new(),
            content_filter: None,
        }
    }

    /// Our reader and a remote writer.
    fn pair() -> (Matchmaker, RemoteEndpoint, RemoteEndpoint) {
        let reader = endpoint(guid(OURS, 1, EntityKind::ReaderWithKey));
        let writer = endpoint(guid(THEIRS, 1, EntityKind::WriterWithKey));
        (Matchmaker::new(OURS), reader, writer)
    }

    fn outcomes(changes: &[MatchChange]) -> Vec<(Option<Outcome>, Option<Outcome>)> {
        changes
            .iter()
            .map(|change| (change.before, change.now))
            .collect()
    }

    const MATCHED: Option<Outcome> = Some(Outcome::Matched);

    #[test]
    fn a_match_comes_and_goes() {
        let (mut matchmaker, reader, mut writer) = pair();
        assert_eq!(matchmaker.insert(reader.clone()), []);
        assert_eq!(
            outcomes(&matchmaker.insert(writer.clone())),
            [(None, MATCHED)]
        );
        assert_eq!(matchmaker.insert(writer.clone()), [], "nothing new");
        writer.unicast = vec![([10, 0, 0, 1], 7411).into()];
        assert_eq!(
            outcomes(&matchmaker.insert(writer.clone())),
            [(MATCHED, MATCHED)]
        );
        assert_eq!(
            matchmaker
                .matches_of(reader.guid.entity)
                .collect::<Vec<_>>(),
            [writer.guid]
        );
        assert_eq!(outcomes(&matchmaker.remove(writer.guid)), [(MATCHED, None)]);
        assert_eq!(matchmaker.matched_with(writer.guid).count(), 0);
        assert_eq!(matchmaker.remove(writer.guid), []);
    }

    #[test]
    fn policies_types_and_partitions_decide() {
        let (mut matchmaker, mut reader, mut writer) = pair();
        reader.qos.reliability = Reliability::RELIABLE;
        matchmaker.insert(reader);
        let incompatible = Some(Outcome::Incompatible(PolicyId::Reliability));
        assert_eq!(
            outcomes(&matchmaker.insert(writer.clone())),
            [(None, incompatible)]
        );
        writer.qos.reliability = Reliability::RELIABLE;
        assert_eq!(
            outcomes(&matchmaker.insert(writer.clone())),
            [(incompatible, MATCHED)]
        );
        writer.qos.partition = Partition(vec!["elsewhere".to_owned()]);
        assert_eq!(
            outcomes(&matchmaker.insert(writer.clone())),
            [(MATCHED, None)]
        );
        writer.type_name = "Other".to_owned();
        assert_eq!(
            outcomes(&matchmaker.insert(writer.clone())),
            [(None, Some(Outcome::InconsistentTopic))]
        );
        writer.topic = "Circle".to_owned();
        assert_eq!(
            outcomes(&matchmaker.insert(writer)),
            [(Some(Outcome::InconsistentTopic), None)]
        );
    }

    fn described(members: Vec<StructMember>) -> TypeSupport {
        TypeBuilder::describe(|types| {
            types.define("ShapeType", |_| {
                Some(Definition::Struct {
                    extensibility: Extensibility::Final,
                    autoid_hash: false,
                    base: None,
                    members,
                })
            })
        })
    }

    #[test]
    fn types_that_are_learned_decide() {
        let x = StructMember::new("x", 0, TypePair::primitive(TypeKind::INT32));
        let (ours, theirs) = (described(vec![x]), described(Vec::new()));
        let (mut matchmaker, mut reader, mut writer) = pair();
        reader.type_information = ours.information;
        writer.type_information = theirs.information;
        matchmaker.add_types(&ours.objects).unwrap();
        matchmaker.insert(reader.clone());
        assert_eq!(outcomes(&matchmaker.insert(writer)), [(None, MATCHED)]);
        let wanted = matchmaker.take_wanted_types();
        let mut remote = TypeLibrary::default();
        remote.add_mapping(&theirs.objects).unwrap();
        let object = |hash: &TypeHash| (*hash, remote.object(*hash).unwrap().to_vec());
        let found: Vec<_> = wanted.iter().map(object).collect();
        assert_eq!(found.len(), 1);
        let inconsistent = Some(Outcome::InconsistentTopic);
        assert_eq!(
            outcomes(&matchmaker.learn_types(&found)),
            [(MATCHED, inconsistent)]
        );
        assert_eq!(matchmaker.learn_types(&found), []);
    }

    #[test]
    fn a_reader_may_insist_on_types() {
        let (mut matchmaker, mut reader, writer) = pair();
        reader.qos.type_consistency.force_type_validation = true;
        matchmaker.insert(reader);
        let inconsistent = Some(Outcome::InconsistentTopic);
        assert_eq!(outcomes(&matchmaker.insert(writer)), [(None, inconsistent)]);
    }

    #[test]
    fn two_of_ours_see_each_other_and_two_remote_ones_do_not_matter() {
        let (mut matchmaker, reader, remote_writer) = pair();
        let writer = endpoint(guid(OURS, 2, EntityKind::WriterWithKey));
        let remote_reader = endpoint(guid(THEIRS, 2, EntityKind::ReaderWithKey));
        matchmaker.insert(remote_writer);
        assert_eq!(matchmaker.insert(remote_reader), []);
        matchmaker.insert(reader.clone());
        let changes = matchmaker.insert(writer.clone());
        let pairs: BTreeSet<_> = changes
            .iter()
            .map(|change| (change.local, change.other.prefix))
            .collect();
        assert_eq!(
            pairs,
            BTreeSet::from([
                (writer.guid.entity, OURS),
                (writer.guid.entity, THEIRS),
                (reader.guid.entity, OURS)
            ])
        );
        assert_eq!(
            outcomes(&matchmaker.remove(reader.guid)).len(),
            3,
            "ours once more, and the remote writer"
        );
    }
}
