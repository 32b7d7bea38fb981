//! Drives a distance straight ahead or backwards.

use super::laws::{Approach, Track};
use super::values::{Pose, Twist};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// It slows down over the last centimetres, and never so far that friction would end the way early:
/// it rolls by 3 cm/s then, and 2.4 mm more when it is to stand, which ends at the goal. An encoder
/// count is 0.14 mm.
const APPROACH: Approach = Approach {
    per_s: 3.0,
    slowest_per_s: 0.03,
    tolerance: 0.003,
    standing_per_s: 0.01,
};

/// Drives along the line on which the robot stood when the state was entered, and finishes when it
/// stands `distance_m` farther along it. It looks at nothing but the pose.
#[derive(Clone, Copy, Debug, Default)]
pub struct DriveDistance {
    line: Option<Track>,
    /// How far along the line it was at the last step.
    last_m: f32,
}

task! {
    /// Drives straight on for a distance, or back where that is negative, and finishes when it
    /// stands there. It holds the line on which it began. It does not see obstacles: let another
    /// region stop it. Without a pose it stands.
    impl DriveDistance {
        slot 2;
        wcet 300 us;
        exclusive motion;
        data {
            /// Where the robot is. Ten periods of the slot that usually tells it: then it is at
            /// most 5 cm off at full speed.
            in pose: Pose optional within 100 ms;
            /// How it wants to move.
            out twist: Twist;
        }
        params {
            /// How far, in metres; negative is backwards.
            distance_m: f32 = 1.0, -20.0..=20.0;
            /// How fast at most, in metres per second.
            speed_m_per_s: f32 = 0.25, 0.0..=0.5;
        }
    }
}

impl Task for DriveDistance {
    fn enter(&mut self) {
        *self = Self::default();
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let Some(pose) = io.try_read(Self::POSE) else {
            *io.write(Self::TWIST) = Twist::STILL;
            return Step::Run;
        };
        let line = self.line.unwrap_or_else(|| Track::from_pose(pose));
        self.line = Some(line);
        let seen = line.locate(pose);
        let distance_m = io.param(Self::DISTANCE_M);
        let left_m = distance_m - seen.along_m;
        let moved_m = seen.along_m - core::mem::replace(&mut self.last_m, seen.along_m);
        if APPROACH.is_reached(left_m, moved_m, io.period_us()) {
            *io.write(Self::TWIST) = Twist::STILL;
            return Step::Finished;
        }
        let speed_m_per_s = APPROACH.speed(left_m, io.param(Self::SPEED_M_PER_S));
        *io.write(Self::TWIST) = Twist {
            forward_m_per_s: speed_m_per_s,
            turn_rad_per_s: seen.back_on_rad_per_s(left_m < 0.0),
        };
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    /// Moves a robot that follows perfectly until it has finished, and returns where it is.
    fn driven(start: Pose, distance_m: f32) -> Pose {
        let mut bench = TaskBench::new(DriveDistance::default());
        bench.period_us(20_000);
        bench
            .param(DriveDistance::DISTANCE_M, distance_m)
            .param(DriveDistance::SPEED_M_PER_S, 0.3);
        let mut pose = start;
        for _ in 0..2_000 {
            bench.give(DriveDistance::POSE, pose);
            if bench.step() == Some(Step::Finished) {
                assert_eq!(bench.output(DriveDistance::TWIST), Some(Twist::STILL));
                return pose;
            }
            let twist = bench.output(DriveDistance::TWIST).unwrap();
            let (way_m, turn_m) = (
                twist.forward_m_per_s * 0.02,
                twist.turn_rad_per_s * 0.02 * 0.1,
            );
            pose = pose.rolled(way_m - turn_m, way_m + turn_m, 0.2);
        }
        panic!("never finished");
    }

    #[test]
    fn it_drives_its_distance_whichever_way_it_looks() {
        for distance_m in [1.0, 0.2, -0.5, 3.0, 0.0] {
            for heading_rad in [0.0, 1.0, 3.1, -2.0] {
                let start = Pose {
                    x_m: -2.0,
                    y_m: 1.0,
                    heading_rad,
                };
                let seen = Track::from_pose(&start).locate(&driven(start, distance_m));
                assert!(
                    (seen.along_m - distance_m).abs() < 0.006 && seen.left_m.abs() < 0.001,
                    "{distance_m} {heading_rad}: {seen:?}"
                );
            }
        }
    }

    #[test]
    fn without_a_pose_it_stands_and_goes_on_afterwards() {
        let mut bench = TaskBench::new(DriveDistance::default());
        bench
            .param(DriveDistance::DISTANCE_M, 1.0)
            .param(DriveDistance::SPEED_M_PER_S, 0.3);
        let forward =
            |bench: &TaskBench<'_>| bench.output(DriveDistance::TWIST).unwrap().forward_m_per_s;
        assert_eq!(bench.step(), Some(Step::Run));
        assert_eq!(forward(&bench), 0.0);
        bench.give(DriveDistance::POSE, Pose::START).step();
        assert_eq!(forward(&bench), 0.3);
        bench.take_away(DriveDistance::POSE).step();
        assert_eq!(forward(&bench), 0.0);
        // The way that it rolled meanwhile counts.
        let far = Pose {
            x_m: 0.9, // three times a tenth of a metre that is left
            ..Pose::START
        };
        bench.give(DriveDistance::POSE, far).step();
        assert!((forward(&bench) - 0.3).abs() < 1e-6);
    }
}
