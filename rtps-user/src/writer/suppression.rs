//! What was just sent again need not be sent again at once (nackSuppressionDuration, RTPS 2.5 section 8.4.7.1).

use std::time::{Duration, Instant};

use super::{Position, WriterTiming};

/// The last answer to the requests of one reader. The time until the same may be sent once more doubles while
/// the reader's first missing piece stays the same, so that a reader without room is not flooded.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Suppression {
    answer: Option<Answer>,
    delay: Duration,
}

#[derive(Clone, Copy, Debug)]
struct Answer {
    from: Position,
    /// Not included.
    to: Position,
    at: Instant,
}

impl Suppression {
    /// When a request whose first piece is `first` may be answered.
    pub(super) fn allowed_at(&self, now: Instant, first: Position) -> Instant {
        match self.answer {
            Some(answer) if (answer.from..answer.to).contains(&first) => answer.at + self.delay,
            _ => now,
        }
    }

    /// An answer begins with the piece `first`.
    pub(super) fn begin(&mut self, now: Instant, first: Position, timing: &WriterTiming) {
        let is_repeated = self.answer.is_some_and(|answer| answer.from == first);
        self.delay = if is_repeated {
            (self.delay * 2).min(timing.nack_suppression_max)
        } else {
            timing.nack_suppression
        };
        self.answer = Some(Answer {
            from: first,
            to: first,
            at: now,
        });
    }

    /// The answer has got to `to`, not included.
    pub(super) fn proceed(&mut self, now: Instant, to: Position) {
        if let Some(answer) = &mut self.answer {
            answer.to = to;
            answer.at = now;
        }
    }
}
