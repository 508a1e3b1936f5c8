//! What a reader may expect of a writer.

/// Of the samples of one writer, since the two have known each other.
#[derive(Clone, Debug)]
pub(super) struct Expectation {
    /// The last number that has come.
    last: u32,
    /// What is missing up to this is no fault.
    excused_until: u32,
    /// Whether nothing else may be missing.
    is_complete: bool,
    /// It gets the multiples of this number alone.
    every: u32,
}

impl Expectation {
    /// What comes after the number `past`.
    pub(super) fn new(past: u32, is_complete: bool, every: u32) -> Self {
        Self {
            last: past,
            excused_until: past,
            is_complete,
            every,
        }
    }

    /// The writer need not have kept what it had written.
    pub(super) fn excuse(&mut self, written: u32) {
        self.excused_until = written;
    }

    /// Takes what has come now.
    pub(super) fn check(&mut self, numbers: &[u32]) {
        for number in numbers {
            assert!(*number > self.last, "{number} after {}", self.last);
            assert_eq!(number % self.every, 0, "it is not wanted");
            if self.is_complete {
                let before = *number - self.every;
                let is_excused = before <= self.last || before <= self.excused_until;
                assert!(is_excused, "{number} after {}", self.last);
            }
            self.last = *number;
        }
    }

    /// Each set that has come now has come as a whole, where `sets` says for each number which number its set begins with.
    pub(super) fn check_sets(&self, numbers: &[u32], sets: &[u32]) {
        let set_of = |number: u32| sets.get(number as usize).copied().filter(|set| *set > 0);
        for members in numbers.chunk_by(|a, b| set_of(*a).is_some() && set_of(*a) == set_of(*b)) {
            let Some(set) = set_of(members[0]) else {
                continue;
            };
            let whole = (set..).take_while(|number| set_of(*number) == Some(set));
            let whole: Vec<u32> = whole.collect();
            assert_eq!(members, whole, "a part of a set");
        }
    }

    /// Everything has come that had to.
    pub(super) fn check_end(&self, written: u32, newest_alive: Option<u32>) {
        if self.is_complete {
            let wanted = written - written % self.every;
            let is_excused = wanted <= self.excused_until;
            assert!(
                self.last == wanted || is_excused,
                "{} of {written}",
                self.last
            );
        } else if let Some(newest) = newest_alive {
            assert!(self.last >= newest, "{} of {newest}", self.last);
        }
    }
}
