//! Says where the robot is in the global frame.

use super::position::{CorrectionState, GlobalPose};
use crate::list_command::Answer;
use crate::odometry::{Frame, GlobalFrame, OutsideBounds, Pose, pose_events};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};
use esm_link::black_box::{Event, PoseFrame};
use esm_link::message::LinkError;
use esm_link::position::Correction;

/// Knows where the frame in which odometry counts lies in the global one, and takes corrections of
/// that. It belongs to the robot, not to a mission: it stays when missions are swapped.
#[derive(Clone, Copy, Debug, Default)]
pub struct GlobalPosition {
    global: GlobalFrame,
}

task! {
    /// Says where the robot is in the global frame: where odometry has it, as it was set and
    /// corrected by tasks, and over the link (`esm position`). Odometry's pose does not change, so
    /// that who goes by that does not notice.
    impl GlobalPosition {
        slot 3;
        wcet 200 us;
        endless;
        data {
            /// Where odometry has it.
            in pose: Pose optional within 100 ms;
            /// A value for `global`, once.
            out made: GlobalPose;
            /// Where it is in the global frame, and what it is told of that.
            inout global: GlobalPose optional;
        }
    }
}

impl GlobalPosition {
    /// Takes a correction, if anybody knows where odometry has the robot.
    fn correct(
        &mut self,
        counted: Option<Pose>,
        (correction, by): (Correction, Frame),
    ) -> Option<Result<(), OutsideBounds>> {
        Some(self.global.correct(counted?, correction, by))
    }

    /// Notes what became of a correction, and where the robot is since.
    fn note(
        &self,
        io: &mut Io<'_>,
        counted: Option<Pose>,
        correction: Correction,
        corrected: Option<Result<(), OutsideBounds>>,
    ) {
        let (Some(counted), Some(corrected)) = (counted, corrected) else {
            return;
        };
        io.note(Event::Corrected {
            is_difference: correction == Correction::Difference,
            is_refused: corrected.is_err(),
        });
        let events = pose_events(&self.global.pose(counted), PoseFrame::Global);
        events.into_iter().for_each(|event| io.note(event));
    }
}

impl Task for GlobalPosition {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let counted = io.try_read(Self::POSE).copied();
        if let Some(asked) = io.take_position() {
            let corrected = self.correct(counted, asked);
            self.note(io, counted, asked.0, corrected);
            io.answer_list_command(match corrected {
                Some(Ok(())) => Answer::Done,
                Some(Err(OutsideBounds)) => Answer::Refused(LinkError::PositionOutside),
                None => Answer::Refused(LinkError::NoPosition),
            });
        }
        let Some(global) = io.try_update(Self::GLOBAL) else {
            *io.write(Self::MADE) = GlobalPose::START;
            return Step::Run;
        };
        let asked = global.asked();
        let corrected = asked.and_then(|asked| self.correct(counted, asked));
        if let Some(corrected) = corrected {
            global.state = if corrected.is_ok() {
                CorrectionState::Applied
            } else {
                CorrectionState::Refused
            } as u8;
        }
        if let Some(counted) = counted {
            global.is_at(self.global.pose(counted));
        }
        if let Some((correction, _)) = asked {
            self.note(io, counted, correction, corrected);
        }
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::FRAC_PI_2;

    use super::*;
    use crate::TaskBench;
    use crate::list_command::ListCommand;
    use esm_link::position::Correction::{Difference, Set};

    type Place = GlobalPosition;

    /// What the robot is told, where it is then in the global frame, and what becomes of it.
    struct Told {
        correction: Correction,
        x_m: f32,
        heading_rad: f32,
        is_at: (f32, f32),
        state: CorrectionState,
    }

    const fn told(
        correction: Correction,
        x_m: f32,
        heading_rad: f32,
        is_at: (f32, f32),
        state: CorrectionState,
    ) -> Told {
        Told {
            correction,
            x_m,
            heading_rad,
            is_at,
            state,
        }
    }

    /// Before each of them it drives 10 mm ahead, as odometry counts.
    const TOLD: [Told; 4] = [
        told(Set, 10.0, FRAC_PI_2, (10.0, 0.0), CorrectionState::Applied),
        told(Difference, 0.5, 0.0, (10.0, 0.51), CorrectionState::Applied),
        told(
            Difference,
            f32::NAN,
            0.0,
            (10.0, 0.52),
            CorrectionState::Refused,
        ),
        told(Set, 2_000.0, 0.0, (10.0, 0.53), CorrectionState::Refused),
    ];

    fn at(x_m: f32) -> Pose {
        Pose { x_m, ..Pose::START }
    }

    fn by(x_m: f32, heading_rad: f32) -> Frame {
        Frame {
            x_m,
            y_m: 0.0,
            heading_rad,
        }
    }

    /// A bench with a value on its net, and what stands there.
    fn bench() -> TaskBench<'static> {
        let mut bench = TaskBench::new(Place::default());
        bench.give(Place::POSE, at(0.0)).step();
        let made: GlobalPose = bench.output(Place::MADE).unwrap();
        bench.give(Place::GLOBAL, made).step();
        bench
    }

    fn net(bench: &TaskBench<'_>) -> GlobalPose {
        bench.output(Place::GLOBAL).unwrap()
    }

    #[track_caller]
    fn is_at(bench: &TaskBench<'_>, (x_m, y_m): (f32, f32)) {
        let global = net(bench);
        let (off_x_m, off_y_m) = (global.x_m - x_m, global.y_m - y_m);
        assert!(off_x_m.abs() < 1e-5 && off_y_m.abs() < 1e-5, "{global:?}");
    }

    #[test]
    fn tasks_correct_it_once_each_and_are_told_what_became_of_it() {
        let mut bench = bench();
        is_at(&bench, (0.0, 0.0));
        for (told, count) in TOLD.into_iter().zip(1_u8..) {
            let mut global = net(&bench);
            let by = by(told.x_m, told.heading_rad);
            let number = global.ask(told.correction, by).unwrap();
            bench.give(Place::GLOBAL, global);
            bench.give(Place::POSE, at(f32::from(count) * 0.01));
            for _ in 0..2 {
                bench.step();
                is_at(&bench, told.is_at);
                assert_eq!(net(&bench).state_of(number), Some(told.state));
            }
        }
    }

    #[test]
    fn so_does_the_link() {
        let mut bench = bench();
        for (told, count) in TOLD.into_iter().zip(1_u8..) {
            bench.give(Place::POSE, at(f32::from(count) * 0.01));
            let by = by(told.x_m, told.heading_rad);
            bench.list_command(ListCommand::Position(told.correction, by));
            bench.step();
            is_at(&bench, told.is_at);
            let answer = match told.state {
                CorrectionState::Applied => Answer::Done,
                _ => Answer::Refused(LinkError::PositionOutside),
            };
            assert_eq!(bench.list_answer(), Some(answer));
        }
    }

    #[test]
    fn where_nobody_knows_what_odometry_counts_nothing_is_corrected() {
        let mut bench = bench();
        bench.take_away(Place::POSE);
        bench.list_command(ListCommand::Position(Set, by(1.0, 0.0)));
        let mut global = net(&bench);
        let number = global.ask(Set, by(2.0, 0.0)).unwrap();
        bench.give(Place::GLOBAL, global).step();
        let refused = Answer::Refused(LinkError::NoPosition);
        assert_eq!(bench.list_answer(), Some(refused));
        assert_eq!(net(&bench).state_of(number), None, "it waits");
        bench.give(Place::POSE, at(0.0)).step();
        is_at(&bench, (2.0, 0.0));
    }
}
