//! Measures where a line on the floor is.

use super::values::Line;
use crate::drivers::{AnalogIn, LineArray};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Distance between two sensors, in micrometres.
pub const SENSOR_PITCH_UM: i16 = 12_000;

/// A sensor sees the line when it is as dark as this, in thousandths: half of its spot.
const SEEN: u16 = 500;

/// What is less dark than this is floor with a stain on it, and must not pull the line's middle to
/// one side.
const STAIN: u16 = 150;

/// Publishes where the line is: the middle of what is dark under the sensors.
#[derive(Debug)]
pub struct LineSensor<A> {
    array: LineArray<A>,
    line: Line,
}

task! {
    /// Measures where a dark line on the floor is.
    impl[A: AnalogIn + Send] LineSensor<A> {
        slot 2;
        wcet 200 us;
        endless;
        data {
            /// Where it is.
            out line: Line;
        }
    }
}

impl<A: AnalogIn> LineSensor<A> {
    /// A task that reads these sensors.
    pub fn new(array: LineArray<A>) -> Self {
        Self {
            array,
            line: Line::default(),
        }
    }
}

impl<A: AnalogIn + Send> Task for LineSensor<A> {
    fn reset(&mut self) {
        self.line = Line::default();
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        self.line = seen(self.array.darkness(), self.line);
        *io.write(Self::LINE) = self.line;
        Step::Run
    }
}

/// The line under the sensors, which was at `last` before.
fn seen(darkness: [u16; 3], last: Line) -> Line {
    let dark_sensors = darkness.iter().filter(|dark| **dark >= SEEN).count() as u8;
    if dark_sensors == 0 {
        return Line {
            left_um: last.left_um.signum() * SENSOR_PITCH_UM,
            dark_sensors,
        };
    }
    let [left, middle, right] = darkness.map(|dark| if dark < STAIN { 0 } else { i32::from(dark) });
    // One of the three is at least `SEEN`, and the quotient no more than the pitch.
    let left_um = i32::from(SENSOR_PITCH_UM) * (left - right) / (left + middle + right);
    Line {
        left_um: left_um as i16,
        dark_sensors,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_is_where_it_is_dark_and_stays_on_the_side_where_it_went() {
        let at = |left_um, dark_sensors| Line {
            left_um,
            dark_sensors,
        };
        for (darkness, last_um, expected) in [
            ([0, 1_000, 0], 0, at(0, 1)),
            ([100, 1_000, 0], 0, at(0, 1)),
            ([500, 1_000, 0], 0, at(4_000, 2)),
            ([1_000, 0, 0], 0, at(12_000, 1)),
            ([0, 700, 700], 0, at(-6_000, 2)),
            ([1_000, 1_000, 1_000], 0, at(0, 3)),
            ([100, 90, 499], 300, at(12_000, 0)),
            ([0, 0, 0], -1, at(-12_000, 0)),
            ([0, 0, 0], 0, at(0, 0)),
        ] {
            assert_eq!(seen(darkness, at(last_um, 1)), expected, "{darkness:?}");
        }
    }
}
