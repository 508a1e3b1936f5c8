//! The lines that other programs match: samples, and instances that are gone.

use rtps_socket::InstanceState;

use crate::shape::ShapeType;

/// A sample, as both sides print it.
pub(crate) fn sample(topic: &str, shape: &ShapeType) -> String {
    let ShapeType {
        color,
        x,
        y,
        shapesize,
        additional_payload_size: payload,
    } = shape;
    let payload = payload.last();
    let payload = payload.map_or_else(String::new, |last| format!(" {{{last}}}"));
    format!("{topic:<10} {color:<10} {x:03} {y:03} [{shapesize}]{payload}")
}

/// An instance that is gone; `None` while it is alive.
pub(crate) fn gone(topic: &str, color: &str, state: InstanceState) -> Option<String> {
    let state = match state {
        InstanceState::Alive => return None,
        InstanceState::NotAliveDisposed => "NOT_ALIVE_DISPOSED_INSTANCE_STATE",
        InstanceState::NotAliveNoWriters => "NOT_ALIVE_NO_WRITERS_INSTANCE_STATE",
    };
    Some(format!("{topic:<10} {color:<10} {state}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sample_has_columns() {
        let mut shape = ShapeType {
            color: "BLUE".to_owned(),
            x: 12,
            y: 250,
            shapesize: 20,
            additional_payload_size: Vec::new(),
        };
        let line = sample("Square", &shape);
        assert_eq!(line, "Square     BLUE       012 250 [20]");
        shape.additional_payload_size = vec![1, 255];
        shape.color = "A_LONG_COLOR".to_owned();
        let line = sample("Square_filtered", &shape);
        assert_eq!(line, "Square_filtered A_LONG_COLOR 012 250 [20] {255}");
    }

    #[test]
    fn only_who_is_gone_is_reported() {
        assert_eq!(gone("Square", "RED", InstanceState::Alive), None);
        let line = gone("Square", "RED", InstanceState::NotAliveDisposed).unwrap();
        assert_eq!(
            line,
            "Square     RED        NOT_ALIVE_DISPOSED_INSTANCE_STATE"
        );
    }
}
