//! Asks for one movement, always the same.

use super::values::Twist;
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Asks for the movement of its parameters. It looks at nothing: what it drives into is for other
/// regions of the mission to see.
#[derive(Clone, Copy, Debug, Default)]
pub struct Steer;

task! {
    /// Asks for one movement, always the same. It looks at nothing: let another region watch.
    impl Steer {
        slot 2;
        wcet 100 us;
        exclusive motion;
        endless;
        data {
            /// How it wants to move.
            out twist: Twist;
        }
        params {
            /// How fast ahead, in metres per second; negative is backwards.
            speed_m_per_s: f32 = 0.2, -0.5..=0.5;
            /// How fast to the left, in radians per second; negative is to the right.
            rate_rad_per_s: f32 = 0.0, -3.0..=3.0;
        }
    }
}

impl Task for Steer {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        *io.write(Self::TWIST) = Twist {
            forward_m_per_s: io.param(Self::SPEED_M_PER_S),
            turn_rad_per_s: io.param(Self::RATE_RAD_PER_S),
        };
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    #[test]
    fn it_asks_for_what_its_parameters_say() {
        let mut bench = TaskBench::new(Steer);
        bench
            .param(Steer::SPEED_M_PER_S, -0.25)
            .param(Steer::RATE_RAD_PER_S, 1.5);
        assert_eq!(bench.step(), Some(Step::Run));
        let twist = bench.output(Steer::TWIST).expect("a twist");
        assert_eq!((twist.forward_m_per_s, twist.turn_rad_per_s), (-0.25, 1.5));
    }
}
