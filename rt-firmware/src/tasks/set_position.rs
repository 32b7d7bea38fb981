//! Tell where the robot is in the global frame.

use super::position::{Asking, GlobalPose};
use crate::odometry::Frame;
use crate::ports::Io;
use crate::task;
use crate::task::{OptInOut, OutFlag, Param, Step, Task};
use esm_link::position::Correction;

/// Sets the global position once, and ends when it is so.
#[derive(Clone, Copy, Debug, Default)]
pub struct SetPosition(Option<Asking>);

/// Corrects the global position once by a difference, and ends when it is so.
#[derive(Clone, Copy, Debug, Default)]
pub struct CorrectPosition(Option<Asking>);

task! {
    /// Says where the robot is in the global frame, and ends when `GlobalPosition` has taken that.
    /// What executes does not notice.
    impl SetPosition {
        slot 2;
        wcet 200 us;
        data {
            /// Where it is, and what was told of that.
            inout global: GlobalPose optional;
        }
        flags {
            /// It was refused, or nobody took it for 0.1 s.
            out failed;
        }
        params {
            /// In the global frame, in metres.
            x_m: f32 = 0.0, -1000.0..=1000.0;
            /// In the global frame, in metres.
            y_m: f32 = 0.0, -1000.0..=1000.0;
            /// Counter-clockwise from the x-axis, in radians.
            heading_rad: f32 = 0.0, -3.15..=3.15;
        }
    }
}

task! {
    /// Says how far the robot is from where it was believed to be in the global frame, seen from
    /// there, and ends when `GlobalPosition` has taken that. What executes does not notice.
    impl CorrectPosition {
        slot 2;
        wcet 200 us;
        data {
            /// Where it is, and what was told of that.
            inout global: GlobalPose optional;
        }
        flags {
            /// It was refused, or nobody took it for 0.1 s.
            out failed;
        }
        params {
            /// Ahead, in metres.
            x_m: f32 = 0.0, -1.0..=1.0;
            /// To the left, in metres.
            y_m: f32 = 0.0, -1.0..=1.0;
            /// Counter-clockwise, in radians.
            heading_rad: f32 = 0.0, -0.6..=0.6;
        }
    }
}

/// What the parameters of a task say.
fn frame(io: &Io<'_>, x_m: Param<f32>, y_m: Param<f32>, heading_rad: Param<f32>) -> Frame {
    Frame {
        x_m: io.param(x_m),
        y_m: io.param(y_m),
        heading_rad: io.param(heading_rad),
    }
}

/// Asks until it is so.
fn step(
    asking: &mut Asking,
    io: &mut Io<'_>,
    global: OptInOut<GlobalPose>,
    failed: OutFlag,
) -> Step {
    let period_us = io.period_us();
    match asking.step(io.try_update(global), period_us) {
        None => Step::Run,
        Some(ended) => {
            io.set(failed, ended.is_err());
            Step::Finished
        }
    }
}

impl Task for SetPosition {
    fn enter(&mut self) {
        self.0 = None;
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let pose = frame(io, Self::X_M, Self::Y_M, Self::HEADING_RAD);
        let asking = (self.0).get_or_insert(Asking::new(Correction::Set, pose));
        step(asking, io, Self::GLOBAL, Self::FAILED)
    }
}

impl Task for CorrectPosition {
    fn enter(&mut self) {
        self.0 = None;
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let by = frame(io, Self::X_M, Self::Y_M, Self::HEADING_RAD);
        let asking = (self.0).get_or_insert(Asking::new(Correction::Difference, by));
        step(asking, io, Self::GLOBAL, Self::FAILED)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::tasks::CorrectionState;

    #[test]
    fn it_asks_once_and_ends_when_it_was_taken() {
        for (state, has_failed) in [
            (CorrectionState::Applied, false),
            (CorrectionState::Refused, true),
        ] {
            let mut bench = TaskBench::new(SetPosition::default());
            bench.param(SetPosition::X_M, 3.0);
            assert_eq!(bench.step(), Some(Step::Run), "nobody has made the value");
            bench.give(SetPosition::GLOBAL, GlobalPose::START);
            assert_eq!(bench.step(), Some(Step::Run));
            let mut told: GlobalPose = bench.output(SetPosition::GLOBAL).unwrap();
            let pose = Frame {
                x_m: 3.0,
                ..Frame::START
            };
            assert_eq!(told.asked(), Some((Correction::Set, pose)));
            assert_eq!(bench.step(), Some(Step::Run));
            assert_eq!(bench.output(SetPosition::GLOBAL), Some(told));
            told.state = state as u8;
            bench.give(SetPosition::GLOBAL, told);
            assert_eq!(bench.step(), Some(Step::Finished));
            assert_eq!(bench.flag(SetPosition::FAILED), has_failed);
            // Entered anew it asks anew, whatever was taken last.
            bench.enter_anew();
            assert_eq!(bench.step(), Some(Step::Run));
            let again: GlobalPose = bench.output(SetPosition::GLOBAL).unwrap();
            assert_ne!(again.number, told.number);
        }
    }

    #[test]
    fn it_fails_where_nobody_takes_it() {
        let mut bench = TaskBench::new(SetPosition::default());
        bench.give(SetPosition::GLOBAL, GlobalPose::START);
        let steps = (0..100).take_while(|_| bench.step() == Some(Step::Run));
        assert_eq!(steps.count(), 10, "so many periods of 10 ms");
        assert!(bench.flag(SetPosition::FAILED));
    }

    #[test]
    fn a_difference_is_one() {
        let mut bench = TaskBench::new(CorrectPosition::default());
        bench
            .param(CorrectPosition::Y_M, -0.25)
            .give(CorrectPosition::GLOBAL, GlobalPose::START);
        bench.step();
        let told: GlobalPose = bench.output(CorrectPosition::GLOBAL).unwrap();
        assert!(matches!(told.asked(), Some((Correction::Difference, by)) if by.y_m == -0.25));
    }
}
