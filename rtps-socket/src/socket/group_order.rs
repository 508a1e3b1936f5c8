//! The order of samples across the readers of a subscriber (PRESENTATION with ordered access of GROUP scope, DDS 1.4
//! section 2.2.2.5.2.10).

use std::collections::BTreeMap;

use rtps_user::reader::SampleInfo;
use rtps_user::wire::{Guid, GuidPrefix, SequenceNumber};

/// The readers of samples, one entry for each sample, in the order in which the publishers have written them. Those of
/// several publishers stand as they have arrived.
pub(super) fn in_order(mut samples: Vec<(Guid, SampleInfo)>) -> Vec<Guid> {
    samples.sort_by_key(|(_, info)| info.reception);
    let mut readers: Vec<Guid> = samples.iter().map(|(reader, _)| *reader).collect();
    // Participants rather than publishers, of which a sample does not say which it is from: each publisher's order is kept.
    let mut numbered: BTreeMap<GuidPrefix, Vec<(usize, SequenceNumber, Guid)>> = BTreeMap::new();
    for (place, (reader, info)) in samples.iter().enumerate() {
        if let Some(number) = info.group_sequence {
            let of_participant = numbered.entry(info.writer.prefix).or_default();
            of_participant.push((place, number, *reader));
        }
    }
    for mut of_participant in numbered.into_values() {
        let places: Vec<usize> = of_participant.iter().map(|(place, ..)| *place).collect();
        of_participant.sort_by_key(|(_, number, _)| *number);
        for (place, (.., reader)) in places.into_iter().zip(of_participant) {
            readers[place] = reader;
        }
    }
    readers
}

#[cfg(test)]
mod tests {
    use std::time::{Duration, Instant};

    use rtps_user::reader::{InstanceState, SampleState, ViewState};
    use rtps_user::wire::EntityId;

    use super::*;

    fn guid(participant: u8, entity: u8) -> Guid {
        Guid::new(GuidPrefix([participant; 12]), EntityId([0, 0, entity, 7]))
    }

    #[test]
    fn numbers_of_a_publisher_count_more_than_arrival() {
        let start = Instant::now();
        let sample = |reader: u8, participant: u8, millis: u64, number: Option<i64>| {
            let info = SampleInfo {
                valid_data: true,
                instance: Default::default(),
                writer: guid(participant, 1),
                sequence: SequenceNumber(1),
                source_timestamp: None,
                group_sequence: number.map(SequenceNumber),
                reception: start + Duration::from_millis(millis),
                sample_state: SampleState::NotRead,
                view_state: ViewState::New,
                instance_state: InstanceState::Alive,
                disposed_generation_count: 0,
                no_writers_generation_count: 0,
                sample_rank: 0,
                generation_rank: 0,
                absolute_generation_rank: 0,
            };
            (guid(0, reader), info)
        };
        let samples = vec![
            sample(1, 8, 1, Some(2)),
            sample(2, 8, 2, Some(1)),
            sample(3, 9, 3, None),
            sample(1, 8, 4, Some(4)),
            sample(2, 8, 5, Some(3)),
        ];
        let order: Vec<_> = in_order(samples)
            .iter()
            .map(|reader| reader.entity.0[2])
            .collect();
        assert_eq!(order, [2, 1, 3, 2, 1]);
    }
}
