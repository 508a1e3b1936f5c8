//! Any text as the expression of a content filter, the first line, and its parameters, the others; what is understood
//! is bound to a type and applied to a sample.

#![no_main]

use libfuzzer_sys::fuzz_target;
use rtps_socket::DdsType;
use rtps_socket::cdr::{Representation, to_payload};
use rtps_socket::filter::{Expression, bind, payload_filter};
use rtps_user::wire::PayloadKind;

#[derive(DdsType)]
struct Sample {
    #[dds(key)]
    color: String,
    x: i32,
    size: u64,
    weight: f64,
    visible: bool,
    grade: char,
    fill: Fill,
    at: Point,
    legs: Vec<Point>,
    note: Option<String>,
}

#[derive(DdsType)]
struct Point {
    x: f32,
    y: i16,
}

#[derive(DdsType)]
enum Fill {
    Red,
    Green,
}

fn sample() -> Sample {
    Sample {
        color: "BLUE".to_owned(),
        x: -3,
        size: 9,
        weight: 2.5,
        visible: true,
        grade: 'B',
        fill: Fill::Green,
        at: Point { x: 0.5, y: 7 },
        legs: vec![Point { x: 1.0, y: 2 }],
        note: None,
    }
}

fuzz_target!(|text: &str| {
    let mut lines = text.split('\n');
    let expression = lines.next().unwrap_or_default();
    let parameters: Vec<String> = lines.take(100).map(str::to_owned).collect();
    let Ok(parsed) = Expression::parse(expression, &parameters) else {
        return;
    };
    let sample = sample();
    parsed.evaluate(&sample);
    assert_eq!(parsed.with_parameters(&parameters).as_ref(), Ok(&parsed));
    let Ok(bound) = bind::<Sample>(parsed) else {
        return;
    };
    let passes = bound.evaluate(&sample);
    let mut payload = Vec::new();
    to_payload(&sample, Representation::Xcdr1, &mut payload).expect("a payload");
    let filter = payload_filter::<Sample>(bound);
    assert_eq!(filter(PayloadKind::Data, &payload), passes);
});
