//! The queue of a reader's events; its length is bounded whether or not anybody polls it.

use std::collections::VecDeque;

use super::{ReaderEvent, RejectedReason};
use crate::wire::{Guid, KeyHash};

/// More than so many events nobody has cared for; the oldest go.
const MAX_EVENTS: usize = 1024;

#[derive(Debug, Default)]
pub(super) struct Events {
    data_available: bool,
    queue: VecDeque<ReaderEvent>,
}

impl Events {
    pub(super) fn data_available(&mut self) {
        self.data_available = true;
    }

    /// `more` samples are lost; joins with what is already lost of the same writer.
    pub(super) fn lost(&mut self, writer: Guid, more: u64) {
        if more == 0 {
            return;
        }
        if let Some(ReaderEvent::SampleLost {
            writer: last,
            count,
        }) = self.queue.back_mut()
            && *last == writer
        {
            *count = count.saturating_add(more);
            return;
        }
        self.push(ReaderEvent::SampleLost {
            writer,
            count: more,
        });
    }

    /// A sample met a limit.
    pub(super) fn rejected(&mut self, writer: Guid, instance: KeyHash, reason: RejectedReason) {
        self.push(ReaderEvent::SampleRejected {
            writer,
            instance,
            reason,
        });
    }

    pub(super) fn push(&mut self, event: ReaderEvent) {
        if self.queue.len() >= MAX_EVENTS {
            self.queue.pop_front();
        }
        self.queue.push_back(event);
    }

    pub(super) fn pop(&mut self) -> Option<ReaderEvent> {
        if std::mem::take(&mut self.data_available) {
            return Some(ReaderEvent::DataAvailable);
        }
        self.queue.pop_front()
    }
}
