//! What holds for any expression.

use proptest::prelude::*;

use super::*;

/// LIKE by its definition, exponential time and all.
fn like_by_definition(pattern: &[char], text: &[char]) -> bool {
    match (pattern, text) {
        ([], []) => true,
        (['%', rest @ ..], _) => (0..=text.len()).any(|at| like_by_definition(rest, &text[at..])),
        (['_', pattern @ ..], [_, text @ ..]) => like_by_definition(pattern, text),
        ([wanted, pattern @ ..], [found, text @ ..]) => {
            wanted == found && like_by_definition(pattern, text)
        }
        _ => false,
    }
}

/// A condition and what it should be for `x = -3` and an absent `note`.
fn conditions() -> impl Strategy<Value = (String, Option<bool>)> {
    let known = ((-5i64..0), 0usize..6).prop_map(|(number, place)| {
        let (sign, relation): (_, fn(i64, i64) -> bool) = [
            ("=", (|a, b| a == b) as fn(i64, i64) -> bool),
            ("<>", |a, b| a != b),
            ("<", |a, b| a < b),
            ("<=", |a, b| a <= b),
            (">", |a, b| a > b),
            (">=", |a, b| a >= b),
        ][place];
        (format!("x {sign} {number}"), Some(relation(-3, number)))
    });
    let leaf = prop_oneof![4 => known, 1 => Just(("note = 1".to_owned(), None))];
    leaf.prop_recursive(6, 40, 4, |inner| {
        let several = || prop::collection::vec(inner.clone(), 1..4);
        prop_oneof![
            several().prop_map(|parts| joined(&parts, " AND ", false)),
            several().prop_map(|parts| joined(&parts, " OR ", true)),
            inner.prop_map(|(text, holds)| (format!("NOT ({text})"), holds.map(|holds| !holds))),
        ]
    })
}

fn joined(
    parts: &[(String, Option<bool>)],
    operator: &str,
    decisive: bool,
) -> (String, Option<bool>) {
    let texts: Vec<_> = parts.iter().map(|(text, _)| format!("({text})")).collect();
    let is_there = |wanted| parts.iter().any(|(_, holds)| *holds == wanted);
    let holds = match () {
        () if is_there(Some(decisive)) => Some(decisive),
        () if is_there(None) => None,
        () => Some(!decisive),
    };
    (texts.join(operator), holds)
}

proptest! {
    #[test]
    fn logic_is_that_of_sql((text, wanted) in conditions()) {
        match parse(&text, &[]) {
            Ok(expression) => prop_assert_eq!(expression.evaluate(&Shape), wanted == Some(true)),
            Err(error) => prop_assert!(
                matches!(error, ParseError::TooDeep | ParseError::TooLong | ParseError::TooManyPredicates)
            ),
        }
    }

    #[test]
    fn like_matches_by_its_definition(pattern in "[ab%_ä]{0,8}", text in "[abä]{0,8}") {
        let characters = |text: &str| text.chars().collect::<Vec<_>>();
        let wanted = like_by_definition(&characters(&pattern), &characters(&text));
        let compiled = pattern::Pattern::like(&pattern).unwrap();
        prop_assert_eq!(compiled.matches(&text), wanted);
    }

    #[test]
    fn any_text_is_parsed_or_refused(text in ".{0,200}", parameter in ".{0,20}") {
        if let Ok(expression) = parse(&text, &[&parameter]) {
            expression.evaluate(&Shape);
        }
    }

    #[test]
    fn anything_of_the_right_words_is_parsed_or_refused(words in prop::collection::vec(words(), 0..40)) {
        if let Ok(expression) = parse(&words.join(" "), &["1", "RED"]) {
            expression.evaluate(&Shape);
            let _ = expression.bind(type_of);
        }
    }

    #[test]
    fn integers_compare_exactly(a in any::<i64>(), b in any::<u64>()) {
        struct Pair(i64, u64);
        impl Fields for Pair {
            fn field(&self, path: &[&str]) -> Option<Value<'_>> {
                Some(if path == ["a"] { Value::Int(self.0) } else { Value::UInt(self.1) })
            }
        }
        let expression = parse(&format!("a < b AND a = {a} AND b = {b:#x}"), &[]).unwrap();
        prop_assert_eq!(expression.evaluate(&Pair(a, b)), i128::from(a) < i128::from(b));
    }
}

fn words() -> impl Strategy<Value = &'static str> {
    prop::sample::select(vec![
        "(", ")", "x", "color", "fill", "at.y", "AND", "OR", "NOT", "BETWEEN", "LIKE", "MATCH",
        "=", "<", ">=", "<>", "1", "-3.5", "'RED'", "'%a_'", "%0", "%1", "TRUE", "GREEN",
    ])
}
