//! PARTITION matching (DDS 1.4 section 2.2.3.13): names with the wildcards of POSIX `fnmatch`.

use super::Partition;

impl Partition {
    /// Whether a publisher with one and a subscriber with the other have a partition in common.
    pub fn matches(&self, other: &Self) -> bool {
        self.names()
            .any(|ours| other.names().any(|theirs| names_match(ours, theirs)))
    }

    /// The names; the empty one where none is given.
    fn names(&self) -> impl Iterator<Item = &str> {
        let default = self.0.is_empty().then_some("");
        self.0.iter().map(String::as_str).chain(default)
    }
}

/// A pattern matches names, never another pattern, not even itself.
fn names_match(a: &str, b: &str) -> bool {
    match (is_pattern(a), is_pattern(b)) {
        (false, false) => a == b,
        (true, false) => glob_matches(a.as_bytes(), b.as_bytes()),
        (false, true) => glob_matches(b.as_bytes(), a.as_bytes()),
        (true, true) => false,
    }
}

fn is_pattern(name: &str) -> bool {
    name.contains(['*', '?', '['])
}

/// Matches without recursion: after a mismatch only the last `*` takes one byte more, so that the time is at most
/// the product of the lengths.
pub(crate) fn glob_matches(pattern: &[u8], name: &[u8]) -> bool {
    let (mut at, mut position) = (0, 0);
    let mut retry = None;
    while position < name.len() {
        if pattern.get(at) == Some(&b'*') {
            at += 1;
            retry = Some((at, position));
        } else if let Some(length) = match_one(&pattern[at..], name[position]) {
            at += length;
            position += 1;
        } else if let Some((after_star, taken)) = retry {
            at = after_star;
            position = taken + 1;
            retry = Some((after_star, position));
        } else {
            return false;
        }
    }
    pattern[at..].iter().all(|byte| *byte == b'*')
}

/// Matches one byte against a literal, `?`, or `[...]`; gives the length of that piece of the pattern.
fn match_one(pattern: &[u8], byte: u8) -> Option<usize> {
    match *pattern.first()? {
        b'?' => Some(1),
        b'[' => match match_class(pattern, byte) {
            Some((length, true)) => Some(length),
            Some((_, false)) => None,
            // Without a closing bracket it stands for itself.
            None => (byte == b'[').then_some(1),
        },
        literal => (literal == byte).then_some(1),
    }
}

/// Reads `[abc]`, `[a-z]`, `[!a]` or `[^a]`; gives its length and whether `byte` is in it, or nothing where the
/// bracket is not closed.
fn match_class(pattern: &[u8], byte: u8) -> Option<(usize, bool)> {
    let negated = matches!(pattern.get(1), Some(b'!' | b'^'));
    let first = if negated { 2 } else { 1 };
    let mut at = first;
    let mut found = false;
    loop {
        match (*pattern.get(at)?, pattern.get(at + 1), pattern.get(at + 2)) {
            // A bracket in the first place is a member.
            (b']', _, _) if at > first => return Some((at + 1, found != negated)),
            (low, Some(b'-'), Some(&high)) if high != b']' => {
                found |= (low..=high).contains(&byte);
                at += 3;
            }
            (member, _, _) => {
                found |= member == byte;
                at += 1;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn partition(names: &[&str]) -> Partition {
        Partition(names.iter().map(ToString::to_string).collect())
    }

    fn both_ways(a: &[&str], b: &[&str]) -> bool {
        let (a, b) = (partition(a), partition(b));
        assert_eq!(a.matches(&b), b.matches(&a));
        a.matches(&b)
    }

    #[test]
    fn names() {
        assert!(both_ways(&[], &[]));
        assert!(both_ways(&[], &[""]));
        assert!(!both_ways(&[], &["a"]));
        assert!(both_ways(&["a", "b"], &["c", "b"]));
        assert!(!both_ways(&["A"], &["a"]));
    }

    #[test]
    fn patterns() {
        assert!(both_ways(&["*"], &[]));
        assert!(both_ways(&["a*c"], &["abbc"]));
        assert!(both_ways(&["a*b*c"], &["aXbYbZc"]));
        assert!(!both_ways(&["a*c"], &["abbd"]));
        assert!(both_ways(&["?"], &["x"]));
        assert!(!both_ways(&["?"], &[""]));
        assert!(both_ways(&["robot[0-3]"], &["robot2"]));
        assert!(!both_ways(&["robot[!0-3]"], &["robot2"]));
        assert!(both_ways(&["[]a]"], &["]"]));
        assert!(glob_matches(b"a[b*", b"a[bc"));
    }

    #[test]
    fn two_patterns_never_match() {
        assert!(!both_ways(&["*"], &["*"]));
        assert!(!both_ways(&["a?"], &["a*"]));
    }

    #[test]
    fn many_stars_do_not_take_long() {
        let pattern = "*a".repeat(120);
        let name = "a".repeat(250) + "b";
        assert!(!both_ways(&[&pattern], &[&name]));
    }

    proptest! {
        #[test]
        fn a_star_takes_anything(before in "[a-z]{0,9}", middle in ".{0,9}", after in "[a-z]{0,9}") {
            let pattern = format!("{before}*{after}");
            let name = format!("{before}{middle}{after}");
            prop_assert!(glob_matches(pattern.as_bytes(), name.as_bytes()));
        }

        #[test]
        fn nothing_panics(pattern in "[\\[\\]!^a*?-]{0,12}", name in "[\\[\\]!^a-]{0,12}") {
            glob_matches(pattern.as_bytes(), name.as_bytes());
        }
    }
}
