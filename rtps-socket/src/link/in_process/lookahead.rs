//! Whether to look into a socket again after the first datagram of a wake-up.
//!
//! To find nothing costs a system call, which a lone sample should not; not to look costs a wake-up for each datagram
//! of a stream. So where nothing is found the next look is put off, for longer each time, and as long as something is
//! found there is no pause.

/// What looking again into one socket has brought.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Lookahead {
    /// Wake-ups between two looks.
    pause: u8,
    /// Wake-ups until the next look.
    rest: u8,
}

impl Lookahead {
    const LONGEST: u8 = 63;

    /// Once per wake-up: whether it is time to look again.
    pub(super) fn is_due(&mut self) -> bool {
        let is_due = self.rest == 0;
        self.rest = self.rest.saturating_sub(1);
        is_due
    }

    /// Looked again, and found something or not.
    pub(super) fn looked(&mut self, found: bool) {
        self.pause = match found {
            true => 0,
            false => (2 * self.pause + 1).min(Self::LONGEST),
        };
        self.rest = self.pause;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many of the next `wakeups` have a look that finds nothing.
    fn looks(lookahead: &mut Lookahead, wakeups: u32) -> u32 {
        let mut looks = 0;
        for _ in 0..wakeups {
            if lookahead.is_due() {
                looks += 1;
                lookahead.looked(false);
            }
        }
        looks
    }

    #[test]
    fn lone_datagrams_are_rarely_looked_behind() {
        let mut lookahead = Lookahead::default();
        assert_eq!(looks(&mut lookahead, 6400), 6 + 99);
    }

    #[test]
    fn a_stream_is_read_on_after_one_find() {
        let mut lookahead = Lookahead::default();
        looks(&mut lookahead, 1000);
        while !lookahead.is_due() {}
        lookahead.looked(true);
        for _ in 0..100 {
            assert!(lookahead.is_due());
            lookahead.looked(true);
        }
        assert_eq!(looks(&mut lookahead, 1), 1, "the stream has ended");
        assert!(!lookahead.is_due());
    }
}
