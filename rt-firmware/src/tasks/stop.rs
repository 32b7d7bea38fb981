//! Stands still.

use super::values::Twist;
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Asks for no movement, as long as its state is active.
#[derive(Clone, Copy, Debug, Default)]
pub struct Stop;

task! {
    /// Asks for no movement.
    impl Stop {
        slot 2;
        wcet 100 us;
        exclusive motion;
        endless;
        data {
            /// How it wants to move: not at all.
            out twist: Twist;
        }
    }
}

impl Task for Stop {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        *io.write(Self::TWIST) = Twist::STILL;
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    #[test]
    fn it_asks_for_no_movement() {
        let mut bench = TaskBench::new(Stop);
        assert_eq!(bench.step(), Some(Step::Run));
        assert_eq!(bench.output(Stop::TWIST), Some(Twist::STILL));
    }
}
