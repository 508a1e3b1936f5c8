//! The type that is exchanged, and how a shape moves.

use std::hash::{BuildHasher, RandomState};

use rtps_socket::DdsType;

use crate::options::PublisherOptions;

/// A coloured shape; the IDL that all vendors share, an appendable struct of this name. Their builds of it are not
/// all alike (final, bounded), so that it is matched by name alone.
#[derive(Clone, Debug, DdsType, PartialEq)]
#[dds(by_name)]
pub(crate) struct ShapeType {
    #[dds(key, bound = 128)]
    pub(crate) color: String,
    pub(crate) x: i32,
    pub(crate) y: i32,
    pub(crate) shapesize: i32,
    pub(crate) additional_payload_size: Vec<u8>,
}

/// The field that shapes move in: positions from 0 to these.
const WIDTH: i32 = 240;
const HEIGHT: i32 = 270;
/// Steps of an iteration, in either direction.
const MAX_SPEED: i32 = 5;

/// The one shape that all topics and instances of a publisher show.
pub(crate) struct Motion {
    x: Axis,
    y: Axis,
    size: i32,
    grows: bool,
    modulo: Option<i32>,
}

struct Axis {
    position: i32,
    velocity: i32,
    end: i32,
}

impl Motion {
    pub(crate) fn new(options: &PublisherOptions) -> Self {
        Self {
            x: Axis::anywhere(WIDTH),
            y: Axis::anywhere(HEIGHT),
            size: options.shape_size,
            grows: options.shape_size == 0,
            modulo: options.size_modulo,
        }
    }

    /// Puts `shape` where it is an iteration later.
    pub(crate) fn advance(&mut self, shape: &mut ShapeType) {
        self.x.advance();
        self.y.advance();
        if self.grows {
            let before = self.modulo.map_or(self.size, |modulo| self.size % modulo);
            self.size = before.saturating_add(1);
        }
        shape.x = self.x.position;
        shape.y = self.y.position;
        shape.shapesize = self.size;
    }
}

impl Axis {
    fn anywhere(end: i32) -> Self {
        let speed = 1 + random(MAX_SPEED);
        Self {
            position: random(end),
            velocity: if random(2) == 0 { speed } else { -speed },
            end,
        }
    }

    fn advance(&mut self) {
        self.position = (self.position + self.velocity).clamp(0, self.end);
        // On the edge it turns round already, or it would stand still for a step.
        let is_outbound = match self.velocity > 0 {
            true => self.position == self.end,
            false => self.position == 0,
        };
        if is_outbound {
            self.velocity = -self.velocity;
        }
    }
}

/// A number from 0 to below `end`, which is small and positive.
fn random(end: i32) -> i32 {
    let number = RandomState::new().hash_one(()) % u64::from(end.unsigned_abs());
    i32::try_from(number).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shape() -> ShapeType {
        ShapeType {
            color: "BLUE".to_owned(),
            x: 0,
            y: 0,
            shapesize: 0,
            additional_payload_size: Vec::new(),
        }
    }

    fn sizes(shape_size: i32, size_modulo: Option<i32>) -> Vec<i32> {
        let options = PublisherOptions {
            shape_size,
            size_modulo,
            ..PublisherOptions::default()
        };
        let (mut motion, mut shape) = (Motion::new(&options), shape());
        let mut next = || {
            motion.advance(&mut shape);
            shape.shapesize
        };
        (0..5).map(|_| next()).collect()
    }

    #[test]
    fn sizes_grow_where_they_shall() {
        assert_eq!(sizes(20, None), [20; 5]);
        assert_eq!(sizes(20, Some(3)), [20; 5]);
        assert_eq!(sizes(0, None), [1, 2, 3, 4, 5]);
        assert_eq!(sizes(0, Some(3)), [1, 2, 3, 1, 2]);
    }

    #[test]
    fn shapes_stay_in_their_field_and_move() {
        let (mut motion, mut shape) = (Motion::new(&PublisherOptions::default()), shape());
        for _ in 0..1000 {
            let (x, y) = (shape.x, shape.y);
            motion.advance(&mut shape);
            assert!((0..=WIDTH).contains(&shape.x) && (0..=HEIGHT).contains(&shape.y));
            assert!((x, y) != (shape.x, shape.y));
        }
    }
}
