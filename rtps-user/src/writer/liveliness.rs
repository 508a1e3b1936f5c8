//! LIVELINESS of a writer whose app asserts it: MANUAL_BY_PARTICIPANT and MANUAL_BY_TOPIC (DDS 1.4 section
//! 2.2.3.11). AUTOMATIC is the layer's business.

use std::time::{Duration, Instant};

use super::Writer;
use crate::qos::{Liveliness, LivelinessKind};

/// The lease that runs since the last assertion.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lease {
    asserted: Option<Instant>,
    deadline: Option<Instant>,
    sharing: Option<Sharing>,
}

/// What a MANUAL_BY_PARTICIPANT writer asserts for the others of its app: readers of those learn of it by a message of the
/// participant, sent at once, but not again within a part of the shortest lease.
#[derive(Clone, Copy, Debug, Default)]
struct Sharing {
    period: Duration,
    /// Whether there are others, so that it matters that this one has written.
    by_writing: bool,
    told: Option<Instant>,
    due: Option<Instant>,
}

/// What shows that a writer is alive.
#[derive(Clone, Copy, Debug, Eq, PartialEq)]
pub(super) enum Sign {
    /// It has written, of which its own readers learn.
    Change,
    /// Its app has said so.
    Assertion,
    /// Another one of its app was asserted.
    Other,
}

impl Lease {
    /// The app has shown that the writer is alive.
    pub(super) fn renew(&mut self, now: Instant, liveliness: Liveliness, sign: Sign) {
        let is_manual = liveliness.kind != LivelinessKind::Automatic;
        if is_manual {
            let lease = liveliness.lease.to_std();
            self.asserted = Some(now);
            self.deadline = lease.and_then(|lease| now.checked_add(lease));
            if let Some(sharing) = &mut self.sharing {
                sharing.note(now, sign);
            }
        }
    }

    /// When it ends, or the participant is to be told something.
    pub(super) fn deadline(&self) -> Option<Instant> {
        let due = self.sharing.and_then(|sharing| sharing.due);
        [self.deadline, due].into_iter().flatten().min()
    }

    /// Whether it ends now; that happens once.
    pub(super) fn expire(&mut self, now: Instant) -> bool {
        self.deadline.take_if(|deadline| *deadline <= now).is_some()
    }

    /// Whether others are to be told now.
    pub(super) fn expire_sharing(&mut self, now: Instant) -> bool {
        let sharing = self.sharing.as_mut();
        sharing.is_some_and(|sharing| sharing.due.take_if(|due| *due <= now).is_some())
    }
}

impl Sharing {
    fn note(&mut self, now: Instant, sign: Sign) {
        let is_news = match sign {
            Sign::Assertion => true,
            Sign::Change => self.by_writing,
            Sign::Other => false,
        };
        if is_news {
            let next = self.told.and_then(|told| told.checked_add(self.period));
            self.due = Some(next.unwrap_or(now));
        }
    }
}

impl Writer {
    /// When it was last asserted to be alive, where each writer of the app that is MANUAL_BY_PARTICIPANT asserts it for all
    /// of them.
    pub(crate) fn asserted_for_all(&self) -> Option<Instant> {
        self.lease.asserted.filter(|_| self.is_asserted_by_others())
    }

    /// Whether its lease ends now, unless another writer has asserted their liveliness meanwhile.
    pub(crate) fn depends_on_others(&self, now: Instant) -> bool {
        let is_due = self.lease.deadline.is_some_and(|deadline| deadline <= now);
        is_due && self.is_asserted_by_others()
    }

    /// Another writer was asserted to be alive at that time.
    pub(crate) fn handle_assertion(&mut self, at: Instant) {
        if self.lease.asserted.is_some_and(|asserted| asserted < at) {
            let liveliness = self.config.qos.liveliness;
            self.lease.renew(at, liveliness, Sign::Other);
        }
    }

    /// How long it is alive without an assertion, where that is not for ever and others of its app share in it.
    pub(crate) fn shared_lease(&self) -> Option<Duration> {
        let lease = self.config.qos.liveliness.lease.to_std();
        lease.filter(|_| self.is_asserted_by_others())
    }

    /// Has assertions shared, no more often than each `period`; `by_writing`: there are others,
    /// for which it is an assertion that this one writes.
    pub(crate) fn share_assertions(&mut self, period: Duration, by_writing: bool) {
        self.lease.sharing = Some(Sharing {
            period,
            by_writing,
            ..self.lease.sharing.unwrap_or_default()
        });
    }

    /// The participant's readers have been told at that time that all its writers are alive.
    pub(crate) fn note_shared(&mut self, at: Instant) {
        if let Some(sharing) = &mut self.lease.sharing {
            (sharing.told, sharing.due) = (Some(at), None);
        }
    }

    /// Whether it is MANUAL_BY_PARTICIPANT.
    pub(crate) fn is_asserted_by_others(&self) -> bool {
        self.config.qos.liveliness.kind == LivelinessKind::ManualByParticipant
    }
}
