//! Drives along a line on the floor.

use super::values::{Line, Twist};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Micrometres in a metre.
const UM_PER_M: f32 = 1e6;

/// Drives along the line under the sensors, and straight on where there is none. As long as it does
/// not know where the line is, it stands and leaves its flags as they are.
///
/// Exactly one of `seen` and `lost` is set from the first step on in which it knows. `left` is set
/// while the line is to the left, or, if it is lost, where it went out of sight to the left.
#[derive(Clone, Copy, Debug, Default)]
pub struct FollowLine;

task! {
    /// Drives along a dark line on the floor, and straight on where there is none. Where it does
    /// not know, it stands.
    impl FollowLine {
        slot 2;
        wcet 200 us;
        exclusive motion;
        endless;
        data {
            /// Where the line is.
            in line: Line optional within 100 ms;
            /// How it wants to move.
            out twist: Twist;
        }
        flags {
            /// There is a line.
            out seen;
            /// There is none. One of `seen` and `lost` is set, as soon as it knows.
            out lost;
            /// The line is to the left, or went out of sight there.
            out left;
        }
        params {
            /// How fast, in metres per second.
            speed_m_per_s: f32 = 0.2, 0.0..=0.4;
            /// How sharply it steers: rad/s for each metre off the line.
            gain_rad_per_s_m: f32 = 100.0, 0.0..=400.0;
        }
    }
}

impl Task for FollowLine {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let Some(line) = io.try_read(Self::LINE).copied() else {
            *io.write(Self::TWIST) = Twist::STILL;
            return Step::Run;
        };
        let seen = line.is_seen();
        let left_m = if seen {
            f32::from(line.left_um) / UM_PER_M
        } else {
            0.0
        };
        *io.write(Self::TWIST) = Twist {
            forward_m_per_s: io.param(Self::SPEED_M_PER_S),
            turn_rad_per_s: io.param(Self::GAIN_RAD_PER_S_M) * left_m,
        };
        io.set(Self::SEEN, seen);
        io.set(Self::LOST, !seen);
        io.set(Self::LEFT, line.left_um > 0);
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    #[test]
    fn it_stands_without_a_word_of_the_line() {
        let mut bench = TaskBench::new(FollowLine);
        bench.param(FollowLine::SPEED_M_PER_S, 0.2);
        assert_eq!(bench.step(), Some(Step::Run));
        assert_eq!(bench.output(FollowLine::TWIST), Some(Twist::STILL));
        assert!(!bench.flag(FollowLine::SEEN) && !bench.flag(FollowLine::LOST));
        bench.give(FollowLine::LINE, Line::default()).step();
        assert_ne!(bench.output(FollowLine::TWIST), Some(Twist::STILL));
        bench.take_away(FollowLine::LINE).step();
        assert_eq!(bench.output(FollowLine::TWIST), Some(Twist::STILL));
    }

    #[test]
    fn it_steers_towards_the_line_and_goes_straight_on_without_one() {
        for (left_um, dark_sensors, turn_rad_per_s, left) in [
            (0, 1, 0.0, false),
            (5_000, 2, 0.5, true),
            (-10_000, 1, -1.0, false),
            (0, 3, 0.0, false),
            (12_000, 0, 0.0, true),
            (-12_000, 0, 0.0, false),
        ] {
            let line = Line {
                left_um,
                dark_sensors,
            };
            let mut bench = TaskBench::new(FollowLine);
            bench
                .param(FollowLine::SPEED_M_PER_S, 0.2)
                .param(FollowLine::GAIN_RAD_PER_S_M, 100.0);
            bench.give(FollowLine::LINE, line).step();
            let twist = bench.output(FollowLine::TWIST).unwrap();
            assert_eq!(twist.forward_m_per_s, 0.2, "{line:?}");
            assert!(
                (twist.turn_rad_per_s - turn_rad_per_s).abs() < 1e-6,
                "{line:?}: {twist:?}"
            );
            assert_eq!(bench.flag(FollowLine::SEEN), dark_sensors > 0, "{line:?}");
            assert_eq!(bench.flag(FollowLine::LOST), dark_sensors == 0, "{line:?}");
            assert_eq!(bench.flag(FollowLine::LEFT), left, "{line:?}");
        }
    }
}
