//! Drives up to a dock.

use super::approach::ApproachLaw;
use super::law::{Behaviour, Control, Scene};
use super::list::BehaviourList;
use super::situation::SafetyCheck;
use crate::behaviour;
use crate::declaration::Params;
use crate::tasks::{Pose, Ranges, Twist};

/// What is so far from where the dock is expected is not the dock, in metres: noise of a sonar, and
/// what odometry is wrong by after some metres.
const OFF_M: f32 = 0.15;
/// Nearer than this the robot comes to what is the dock, and to nothing else, in metres from its
/// rim.
const LAST_M: f32 = 0.45;

/// Drives straight ahead to a dock that stands at a known distance, slower as it comes near, and
/// ends just before it, or as it touches it. Only the dock it comes so near to: before all else it
/// stops as all behaviours do.
#[derive(Clone, Copy, Debug, Default)]
pub struct DockLaw;

behaviour! {
    /// Behaviour: drives to the dock that stands `distance_m` ahead, up to `gap_m`, and ends.
    impl Dock runs DockLaw {
        wcet 300 us;
        params {
            /// Where the dock stands, in metres ahead of the rim where it begins.
            distance_m: f32 = 1.0, 0.1..=5.0;
            /// How near to come, in metres from the rim.
            gap_m: f32 = 0.05, 0.03..=0.2;
            /// How fast at most, in metres per second.
            speed_m_per_s: f32 = 0.15, 0.05..=0.3;
        }
    }
}

/// The dock, as the robot sees it.
#[derive(Clone, Copy, Debug)]
struct Seen {
    /// What is free ahead, in metres; 0 where nobody knows.
    ahead_m: f32,
    /// What would be free if nothing stood before the dock, by odometry, in metres.
    expected_m: f32,
}

impl Seen {
    fn new(scene: &Scene<'_>, distance_m: f32) -> Self {
        Self {
            ahead_m: scene.ranges.map_or(0.0, Ranges::ahead_m),
            expected_m: distance_m - scene.pose().x_m,
        }
    }

    /// Whether what is ahead is the dock.
    fn is_dock(&self) -> bool {
        (self.ahead_m - self.expected_m).abs() < OFF_M
    }
}

impl Behaviour for DockLaw {
    /// What docks is in front.
    fn is_front_first(&self) -> bool {
        true
    }

    fn clearance_m(&self, scene: &Scene<'_>, params: &Params) -> f32 {
        let seen = Seen::new(scene, params.get(Dock::DISTANCE_M));
        if seen.expected_m < LAST_M && seen.is_dock() {
            0.0
        } else {
            SafetyCheck::CLEARANCE_M
        }
    }

    fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control {
        let seen = Seen::new(scene, params.get(Dock::DISTANCE_M));
        let gap_m = params.get(Dock::GAP_M);
        if seen.expected_m < gap_m - OFF_M {
            return Control::Failed;
        }
        if seen.ahead_m <= 0.0 {
            return Control::Move(Twist::STILL);
        }
        let most_m_per_s = params.get(Dock::SPEED_M_PER_S);
        let speed = ApproachLaw::speed_m_per_s(seen.ahead_m, gap_m, most_m_per_s);
        if speed.is_none() && seen.is_dock() {
            return Control::Done;
        }
        // So near something else, the safety check has it wait.
        let forward_m_per_s = speed.unwrap_or(most_m_per_s);
        Control::Move(ApproachLaw::twist(&scene.pose(), forward_m_per_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    const PERIOD_US: u32 = 10_000;

    /// A robot that docks, as ideal motion takes it: the dock is a metre ahead.
    struct Robot {
        bench: TaskBench<'static>,
        x_m: f32,
    }

    impl Robot {
        fn new() -> Self {
            let mut bench = TaskBench::new(Dock::default());
            bench
                .period_us(PERIOD_US)
                .param(Dock::DISTANCE_M, 1.0)
                .param(Dock::GAP_M, 0.05)
                .param(Dock::SPEED_M_PER_S, 0.15)
                .give(Dock::LIST, BehaviourList::EMPTY);
            Self { bench, x_m: 0.0 }
        }

        /// One activation with so much free ahead. Whether it goes on.
        fn step(&mut self, ahead_m: f32) -> bool {
            let mut ranges = Ranges::FREE;
            ranges.range_m[0] = ahead_m;
            let pose = Pose {
                x_m: self.x_m,
                ..Pose::START
            };
            self.bench.give(Dock::RANGES, ranges).give(Dock::POSE, pose);
            let step = self.bench.step();
            let mut list: BehaviourList = self.bench.output(Dock::LIST).unwrap();
            self.x_m += list.take_asked().forward_m_per_s * PERIOD_US as f32 / 1e6;
            list.look();
            self.bench.give(Dock::LIST, list);
            step == Some(crate::Step::Run)
        }

        /// Drives until it ends, or stands for a second; `ahead_m` says what is free where.
        fn drive(&mut self, ahead_m: impl Fn(f32) -> f32) -> bool {
            let mut stands = 0;
            while stands < 100 {
                let before_m = self.x_m;
                if !self.step(ahead_m(self.x_m)) {
                    return true;
                }
                stands = if self.x_m == before_m { stands + 1 } else { 0 };
            }
            false
        }
    }

    #[test]
    fn it_ends_just_before_the_dock_wherever_that_stands_within_reason() {
        for off_m in [-0.14, 0.0, 0.14] {
            let mut robot = Robot::new();
            assert!(robot.drive(|x_m| 1.0 + off_m - x_m), "{off_m}");
            assert!(!robot.bench.flag(Dock::FAILED), "{off_m}");
            let gap_m = 1.0 + off_m - robot.x_m;
            assert!((0.048..=0.05).contains(&gap_m), "{off_m}: {gap_m}");
        }
    }

    #[test]
    fn a_touch_is_enough() {
        let mut robot = Robot::new();
        let touches = |x_m| if x_m < 0.9 { 1.0 - x_m } else { 0.001 };
        assert!(robot.drive(touches));
        assert!(!robot.bench.flag(Dock::FAILED));
        assert!((robot.x_m - 0.9).abs() < 0.002, "{}", robot.x_m);
    }

    #[test]
    fn before_what_is_not_the_dock_it_stands_as_all_do_and_goes_on_afterwards() {
        // Somebody stands 0.5 m ahead; then nobody; then somebody right before the dock.
        let mut robot = Robot::new();
        assert!(!robot.drive(|x_m| 0.5 - x_m));
        assert!(robot.bench.flag(Dock::SUSPENDED));
        let gap_m = 0.5 - robot.x_m;
        assert!(gap_m >= SafetyCheck::CLEARANCE_M, "{gap_m}");
        while robot.x_m < 0.75 {
            assert!(robot.step(1.0 - robot.x_m));
        }
        assert!(!robot.drive(|_| 0.05), "it is not the dock");
        assert!(robot.x_m < 0.76 && robot.bench.flag(Dock::SUSPENDED));
        assert!(robot.drive(|x_m| 1.0 - x_m));
        assert!(!robot.bench.flag(Dock::FAILED));
    }

    #[test]
    fn it_fails_where_there_is_no_dock_and_stands_where_nobody_knows() {
        let mut robot = Robot::new();
        assert!(robot.drive(|_| 2.0));
        assert!(robot.bench.flag(Dock::FAILED));
        assert!((1.1..1.11).contains(&robot.x_m), "{}", robot.x_m);
        let mut robot = Robot::new();
        assert!(!robot.drive(|_| 0.0));
        assert_eq!(robot.x_m, 0.0);
    }
}
