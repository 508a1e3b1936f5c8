//! Expressions against a sample of every kind of member; what is refused; and what hostile readers may send.

mod properties;

use super::condition::Relation;
use super::*;

const COLORS: &[(&str, i64)] = &[("RED", 0), ("GREEN", 1), ("BLUE", 5)];

/// A shape with a nested point, an absent member and an enumerated one.
struct Shape;

impl Fields for Shape {
    fn field(&self, path: &[&str]) -> Option<Value<'_>> {
        Some(match path {
            ["color"] => Value::Str("PURPLE"),
            ["x"] => Value::Int(-3),
            ["size"] => Value::UInt(u64::MAX),
            ["weight"] => Value::Float(2.5),
            ["ratio"] => Value::Float(f64::from(0.1f32)),
            ["void"] => Value::Float(f64::NAN),
            ["visible"] => Value::Bool(true),
            ["grade"] => Value::Char('B'),
            ["fill"] => Value::Int(1),
            ["at", "y"] => Value::Int(7),
            ["legs", "1", "length"] => Value::Int(40),
            _ => return None,
        })
    }
}

fn type_of(path: &[&str]) -> Option<FieldType> {
    let kind = match path {
        ["color"] => Kind::String,
        ["x" | "size" | "note"] | ["at", "y"] | ["legs", _, "length"] => Kind::Integer,
        ["weight" | "void"] => Kind::Float,
        ["ratio"] => Kind::Float32,
        ["visible"] => Kind::Bool,
        ["grade"] => Kind::Char,
        ["fill"] => Kind::Enum(COLORS),
        _ => return None,
    };
    Some(FieldType {
        kind,
        is_key: false,
    })
}

fn parse(text: &str, parameters: &[&str]) -> Result<Expression, ParseError> {
    let parameters: Vec<_> = parameters.iter().map(ToString::to_string).collect();
    Expression::parse(text, &parameters)
}

fn holds_with(text: &str, parameters: &[&str]) -> bool {
    let expression = parse(text, parameters).unwrap_or_else(|error| panic!("{text}: {error}"));
    let bound = expression.bind(type_of);
    bound
        .unwrap_or_else(|error| panic!("{text}: {error}"))
        .evaluate(&Shape)
}

#[track_caller]
fn check(wanted: bool, expressions: &[&str]) {
    for text in expressions {
        assert_eq!(holds_with(text, &[]), wanted, "{text}");
    }
}

#[test]
fn comparisons_that_hold() {
    check(
        true,
        &[
            "",
            "  ",
            "color = 'PURPLE'",
            "color=\"PURPLE\"",
            "color = `PURPLE'",
            "color = `PURPLE`",
            "'PURPLE' = color",
            "color <> 'RED'",
            "color != 'RED'",
            "color > 'PURPL'",
            "x = -3",
            "x=-3",
            "-4 < x",
            "x >= -3.0",
            "x < +.5",
            "x < 1e3",
            "x < 1.5E-3",
            "x = -0x3",
            "size = 0xFFFFffffFFFFffff",
            "size > 18446744073709551614",
            "x < size",
            "size > x",
            "weight > x",
            "weight = 2.5",
            "weight <= 3",
            "visible = TRUE",
            "visible <> false",
            "grade = 'B'",
            "grade > 'A'",
            "grade < 'BC'",
            "grade BETWEEN 'A' AND 'Z'",
            "grade < color",
            "color > grade",
            "ratio = 0.1",
            "0.1 >= ratio",
            "ratio BETWEEN 0.1 AND 0.1",
            "ratio < 1",
            "ratio < 1e300",
            "ratio <> 0.10001",
            "at.y = 7",
            "legs[1].length = 40",
        ],
    );
}

#[test]
fn comparisons_that_do_not_hold() {
    check(
        false,
        &[
            "color = 'PURPLE '",
            "color = 'purple'",
            "x = 3",
            "-3 > x",
            "x > size",
            "visible = FALSE",
            "grade = 'b'",
            "grade = 'BC'",
            "grade > color",
            "ratio > 0.1",
            "ratio <> 0.1",
            "ratio = weight",
            "fill = 5",
            "size < 0",
        ],
    );
}

#[test]
fn ranges_and_patterns() {
    check(
        true,
        &[
            "x BETWEEN -3 AND -3",
            "x between -4 and 0",
            "x NOT BETWEEN 0 AND 9",
            "weight BETWEEN 2 AND 2.5",
            "color BETWEEN 'P' AND 'Q'",
            "fill BETWEEN RED AND 'BLUE'",
            "color LIKE 'PURPLE'",
            "color LIKE '%'",
            "color LIKE 'P%'",
            "color LIKE '%P%E'",
            "color LIKE '_URPL_'",
            "color LIKE '%%_%LE%'",
            "color NOT LIKE 'R%'",
            "color MATCH 'RED,PUR*'",
            "color match 'PURPL?'",
            "color MATCH '[A-P]*E'",
        ],
    );
    check(
        false,
        &[
            "x BETWEEN 0 AND -9",
            "x NOT BETWEEN -3 AND 0",
            "color LIKE ''",
            "color LIKE 'PURPL'",
            "color LIKE '%URP'",
            "color LIKE '_PURPLE'",
            "color LIKE '%L'",
            "color LIKE 'PURPLE_'",
            "color LIKE 'P*'",
            "color MATCH 'P'",
            "color NOT MATCH 'P*'",
        ],
    );
}

#[test]
fn and_binds_closer_than_or_and_not_closest() {
    check(
        true,
        &[
            "x = -3 OR x = 1 AND x = 2",
            "NOT x = 1 AND x = -3",
            "NOT (x = 1 OR x = 2)",
            "NOT NOT x = -3",
            "(x = -3)",
            "((x = -3) and (at.y = 7)) or color = 'RED'",
            "x BETWEEN -9 AND 0 AND at.y = 7",
        ],
    );
    check(
        false,
        &[
            "(x = -3 OR x = 1) AND x = 2",
            "NOT x = -3 OR x = 1",
            "NOT (NOT x = 1 AND x = -3)",
        ],
    );
}

#[test]
fn enumerated_literals_are_named_with_or_without_quotes() {
    check(
        true,
        &[
            "fill = GREEN",
            "fill = 'GREEN'",
            "GREEN = fill",
            "RED < fill",
            "fill < BLUE",
            "fill <> 'RED'",
            "fill = 1",
            "fill > x",
        ],
    );
    assert!(holds_with("fill = %0", &["GREEN"]));
    assert!(holds_with("fill = %0", &["'GREEN'"]));
    assert!(holds_with("fill = %0", &["1"]));
    assert!(!holds_with("fill = %0", &["BLUE"]));
}

#[test]
fn what_is_absent_neither_holds_nor_not() {
    check(
        false,
        &[
            "note = 1",
            "NOT note = 1",
            "note <> 1",
            "note NOT BETWEEN 1 AND 2",
            "legs[9].length > 0",
            "void = 1",
            "void <> 1",
            "note = 1 AND x = -3",
            "NOT (note = 1 AND x = -3)",
        ],
    );
    check(
        true,
        &[
            "note = 1 OR x = -3",
            "x = -3 OR note = 1",
            "NOT (note = 1 AND x = 1)",
        ],
    );
}

#[test]
fn parameters_are_read_as_the_member_wants() {
    assert!(holds_with("color = %0", &["PURPLE"]));
    assert!(holds_with("color = %0", &["'PURPLE'"]));
    assert!(holds_with("color = %0", &["\"PURPLE\""]));
    assert!(!holds_with("color = %0", &["'BLUE'"]));
    assert!(!holds_with("color = %0", &["17"]));
    assert!(holds_with("x = %1 AND visible = %0", &["TRUE", " -3 "]));
    assert!(holds_with("x BETWEEN %0 AND %1", &["-4", "0x10"]));
    assert!(holds_with("color LIKE %0", &["'PUR%'"]));
    assert!(holds_with("color LIKE %0", &["PUR%"]));
    assert!(holds_with("%0 < weight", &["2.25"]));
    assert!(holds_with("ratio = %0", &["0.1"]));
    assert!(holds_with("grade = %0 OR grade = %1", &["7", "B"]));
    assert!(holds_with("visible = %0", &["true"]));
    assert!(holds_with("at.y = %0", &["7.0"]));
    let last = vec!["B"; 100];
    assert!(holds_with("grade = %99", &last));
    let text = "color = %0";
    let expression = parse(text, &["RED"]).unwrap();
    assert!(!expression.evaluate(&Shape));
    let other = expression.with_parameters(&["PURPLE".into()]).unwrap();
    assert!(other.evaluate(&Shape));
    assert_eq!(
        (other.text(), other.parameters()),
        (text, &["PURPLE".into()][..])
    );
}

#[test]
fn quotes_stand_for_themselves_twice() {
    let expression = parse("color = 'it''s' OR color = ''", &[]).unwrap();
    assert_eq!(
        expression.bind(type_of).map(|bound| bound.members().len()),
        Ok(2)
    );
    assert!(matches!(
        parse("color = 'it''", &[]),
        Err(ParseError::UnterminatedText(8))
    ));
}

#[test]
fn keywords_may_be_names_of_members() {
    let expression = parse("match = 1 AND like = 2 AND and.or = 3", &[]).unwrap();
    assert_eq!(
        expression.members(),
        [vec!["match"], vec!["like"], vec!["and", "or"]]
    );
}

#[test]
fn members_are_listed() {
    let expression = parse("a.b[2].c < d OR NOT (e BETWEEN 1 AND 2)", &[]).unwrap();
    assert_eq!(
        expression.members(),
        [vec!["a", "b", "2", "c"], vec!["d"], vec!["e"]]
    );
}

#[test]
fn what_is_no_expression_is_refused() {
    let expected = |what, position| ParseError::Expected { what, position };
    let refused = [
        ("x", expected("a comparison, BETWEEN, LIKE or MATCH", 1)),
        ("x =", expected("a member or a constant", 3)),
        ("x = 1 y = 2", expected("AND, OR or the end", 6)),
        ("x = 1)", expected("AND, OR or the end", 5)),
        ("(x = 1", expected("AND, OR or a closing parenthesis", 6)),
        ("()", expected("a member or a constant", 1)),
        ("1 = 1", expected("a member", 0)),
        ("1 BETWEEN 0 AND 2", expected("one of = <> < <= > >=", 2)),
        ("x BETWEEN 1 OR 2", expected("AND", 12)),
        ("x BETWEEN a.b AND 2", expected("a constant", 10)),
        ("color LIKE 3", expected("a text", 11)),
        ("x = 1 AND", expected("a member or a constant", 9)),
        (
            "x NOT = 1",
            expected("a comparison, BETWEEN, LIKE or MATCH", 6),
        ),
        ("x = %1", ParseError::MissingParameter(1)),
        ("x = %", ParseError::UnexpectedCharacter(4)),
        ("x = %100", ParseError::UnexpectedCharacter(4)),
        ("x ! 1", ParseError::UnexpectedCharacter(2)),
        ("x = 1; y = 2", ParseError::UnexpectedCharacter(5)),
        ("grün = 1", ParseError::UnexpectedCharacter(2)),
        ("x = 0x", ParseError::InvalidNumber(4)),
        ("x = 1.2.3", ParseError::InvalidNumber(4)),
        ("x = 18446744073709551616", ParseError::InvalidNumber(4)),
        ("x = -9223372036854775809", ParseError::InvalidNumber(4)),
        ("x = 1e999", ParseError::InvalidNumber(4)),
        ("x = -inf", ParseError::InvalidNumber(4)),
        ("x..y = 1", ParseError::InvalidName(0)),
        ("x[] = 1", ParseError::InvalidName(0)),
        ("x[1 = 1", ParseError::InvalidName(0)),
        ("x[y] = 1", ParseError::InvalidName(0)),
        ("x.1 = 1", ParseError::InvalidName(0)),
        ("x = 'abc", ParseError::UnterminatedText(4)),
        ("x = 'abc\"", ParseError::UnterminatedText(4)),
    ];
    for (text, error) in refused {
        assert_eq!(parse(text, &["1"]), Err(error), "{text}");
    }
}

#[test]
fn what_the_type_does_not_have_is_refused() {
    let unknown = |name: &str| BindError::UnknownMember(name.into());
    let incomparable = |name: &str| BindError::Incomparable(name.into());
    let refused = [
        ("colour = 'RED'", unknown("colour")),
        ("at.z = 1", unknown("at.z")),
        ("legs[0].width = 1", unknown("legs[0].width")),
        ("color = RED", unknown("RED")),
        ("x = 'three'", incomparable("x")),
        ("color = 3", incomparable("color")),
        ("x = TRUE", incomparable("x")),
        ("visible = 1", incomparable("visible")),
        ("grade = 3", incomparable("grade")),
        ("ratio = '0.1'", incomparable("ratio")),
        ("grade = x", incomparable("grade")),
        ("fill = 'PURPLE'", incomparable("fill")),
        ("fill = PURPLE", incomparable("fill")),
        ("x BETWEEN 1 AND 'b'", incomparable("x")),
        ("x LIKE '1%'", incomparable("x")),
        ("x = color", incomparable("x")),
    ];
    for (text, error) in refused {
        let bound = parse(text, &[]).unwrap().bind(type_of);
        assert_eq!(bound, Err(error), "{text}");
    }
}

#[test]
fn hostile_expressions_are_refused() {
    let deep = |depth| format!("{}x = 1{}", "(".repeat(depth), ")".repeat(depth));
    assert!(parse(&deep(MAX_DEPTH), &[]).is_ok());
    assert_eq!(parse(&deep(MAX_DEPTH + 1), &[]), Err(ParseError::TooDeep));
    assert_eq!(parse(&"(".repeat(MAX_LEN), &[]), Err(ParseError::TooDeep));
    let wide = |count| vec!["x=1"; count].join(" OR ");
    assert!(parse(&wide(MAX_PREDICATES), &[]).is_ok());
    assert_eq!(
        parse(&wide(MAX_PREDICATES + 1), &[]),
        Err(ParseError::TooManyPredicates)
    );
    let long = "x".repeat(MAX_LEN + 1);
    assert_eq!(parse(&long, &[]), Err(ParseError::TooLong));
    assert_eq!(parse("x = 1", &[&long]), Err(ParseError::TooLong));
    let path = |count| format!("{} = 1", vec!["x"; count].join("."));
    assert!(parse(&path(MAX_PATH), &[]).is_ok());
    assert_eq!(
        parse(&path(MAX_PATH + 1), &[]),
        Err(ParseError::InvalidName(0))
    );
    let pattern = |len| format!("x LIKE '{}'", "%".repeat(len));
    assert!(parse(&pattern(MAX_PATTERN), &[]).is_ok());
    assert_eq!(
        parse(&pattern(MAX_PATTERN + 1), &[]),
        Err(ParseError::PatternTooLong)
    );
    // Many negations are no nesting.
    assert!(holds_with(&format!("{}x = -3", "NOT ".repeat(1000)), &[]));
}

#[test]
fn the_mirror_of_a_mirror_is_the_relation() {
    for relation in [
        Relation::Equal,
        Relation::NotEqual,
        Relation::Less,
        Relation::LessOrEqual,
        Relation::Greater,
        Relation::GreaterOrEqual,
    ] {
        assert_eq!(relation.mirrored().mirrored(), relation);
    }
}
