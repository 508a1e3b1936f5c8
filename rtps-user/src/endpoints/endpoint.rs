//! A writer or a reader, as far as both are driven alike.

use std::collections::VecDeque;
use std::time::Instant;

use super::{EndpointEvent, schedule::Mark};
use crate::Transmit;
use crate::reader::Reader;
use crate::wire::EntityId;
use crate::writer::Writer;

/// An endpoint, its name, and what the schedule has of it.
#[derive(Debug)]
pub(super) struct Scheduled {
    pub(super) id: EntityId,
    pub(super) endpoint: Endpoint,
    pub(super) mark: Mark,
}

impl Scheduled {
    /// Appends what has happened to it to `events`.
    pub(super) fn collect_events(&mut self, events: &mut VecDeque<EndpointEvent>) {
        while let Some(event) = self.endpoint.poll_event(self.id) {
            events.push_back(event);
        }
    }
}

/// An endpoint of either kind.
#[derive(Debug)]
pub(super) enum Endpoint {
    Writer(Box<Writer>),
    Reader(Box<Reader>),
}

impl Endpoint {
    pub(super) fn as_writer(&self) -> Option<&Writer> {
        match self {
            Self::Writer(writer) => Some(writer),
            Self::Reader(_) => None,
        }
    }

    pub(super) fn as_writer_mut(&mut self) -> Option<&mut Writer> {
        match self {
            Self::Writer(writer) => Some(writer),
            Self::Reader(_) => None,
        }
    }

    pub(super) fn as_reader(&self) -> Option<&Reader> {
        match self {
            Self::Reader(reader) => Some(reader),
            Self::Writer(_) => None,
        }
    }

    pub(super) fn as_reader_mut(&mut self) -> Option<&mut Reader> {
        match self {
            Self::Reader(reader) => Some(reader),
            Self::Writer(_) => None,
        }
    }

    pub(super) fn handle_timeout(&mut self, now: Instant) {
        match self {
            Self::Writer(writer) => writer.handle_timeout(now),
            Self::Reader(reader) => reader.handle_timeout(now),
        }
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        match self {
            Self::Writer(writer) => writer.poll_timeout(),
            Self::Reader(reader) => reader.poll_timeout(),
        }
    }

    pub(super) fn poll_transmit(&mut self, now: Instant, out: &mut Vec<u8>) -> Option<Transmit> {
        match self {
            Self::Writer(writer) => writer.poll_transmit(now, out),
            Self::Reader(reader) => reader.poll_transmit(now, out),
        }
    }

    pub(super) fn poll_event(&mut self, id: EntityId) -> Option<EndpointEvent> {
        match self {
            Self::Writer(writer) => writer
                .poll_event()
                .map(|event| EndpointEvent::of_writer(id, event)),
            Self::Reader(reader) => reader
                .poll_event()
                .map(|event| EndpointEvent::of_reader(id, event)),
        }
    }
}
