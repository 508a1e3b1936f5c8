//! Coherent sets of GROUP scope: readers of one subscriber show their parts of them together (RTPS 2.5 section 8.7.6).

use std::collections::BTreeSet;

use rtps_user::reader::GroupSet;
use rtps_user::wire::EntityId;

use super::Core;
use super::audience::GroupId;

impl Core {
    /// Has the sets wait in a reader until those of its subscriber have all their parts.
    pub(crate) fn stage_groups(&mut self, reader: EntityId) {
        if let Some(entity) = self.entities.get_mut(&reader)
            && entity.declaration.group.is_some()
            && let Some(reader) = self.endpoints.reader_mut(reader)
        {
            entity.stages_groups = reader.stage_groups();
            self.stages_groups |= entity.stages_groups;
        }
    }

    /// Something has happened to an endpoint that sets may have waited for.
    pub(super) fn review_group(&mut self, id: EntityId) {
        if self.stages_groups
            && let Some(entity) = self.entities.get(&id)
            && entity.stages_groups
            && let Some(group) = entity.declaration.group
        {
            self.release_groups(group);
        }
    }

    /// Makes the sets visible of which no reader of the subscriber awaits a part; those of one publisher in order.
    pub(crate) fn release_groups(&mut self, group: GroupId) {
        let members = self.audience.members(group).to_vec();
        let staged: BTreeSet<GroupSet> = members
            .iter()
            .filter_map(|member| self.endpoints.reader(*member))
            .flat_map(|reader| reader.staged_groups())
            .collect();
        let mut held_up = None;
        for set in staged {
            let publisher = (set.participant, set.writers);
            let readers = || {
                members
                    .iter()
                    .filter_map(|member| self.endpoints.reader(*member))
            };
            if held_up == Some(publisher) || readers().any(|reader| reader.awaits_group(&set)) {
                held_up = Some(publisher);
                continue;
            }
            for member in &members {
                if let Some(reader) = self.endpoints.reader_mut(*member) {
                    reader.release_group(&set);
                }
            }
        }
    }
}
