//! What a task does that is a situation.

use super::list::{BehaviourList, CameUp};
use super::situation::{Circumstances, Situation};
use crate::odometry::LocalFrame;
use crate::ports::Io;
use crate::task::{OptIn, OptInOut, OutFlag, Param, Step};
use crate::tasks::{Battery, Pose, Ranges, Twist};
use esm_link::behaviours::Reaction;

/// The most that the parameter `reaction` may be.
const SUSPEND: u32 = 1;
const CANCEL: u32 = 2;

/// The ports, flags and parameters that all situations have.
#[derive(Clone, Copy)]
pub struct SituationPorts {
    /// The list of behaviours.
    pub list: OptInOut<BehaviourList>,
    /// Where the robot is.
    pub pose: OptIn<Pose>,
    /// What is around it.
    pub ranges: OptIn<Ranges>,
    /// The battery.
    pub battery: OptIn<Battery>,
    /// It is up.
    pub up: OutFlag,
    /// What becomes of the behaviour then.
    pub reaction: Param<u32>,
    /// Its name, for the log.
    pub name: &'static str,
}

/// A situation that is looked for while its state is active.
#[derive(Debug, Default)]
pub struct SituationRunner<S> {
    situation: S,
    watch: SituationWatch,
}

#[derive(Debug, Default)]
struct SituationWatch {
    /// Centred where the robot was when the state was entered, as soon as somebody knows.
    centre: Option<LocalFrame>,
    is_up: bool,
}

impl<S: Situation + Default> SituationRunner<S> {
    /// Its state was entered anew.
    pub fn enter(&mut self) {
        *self = Self::default();
    }

    /// Looks for the situation, and does what is to be done about it.
    pub fn step(&mut self, io: &mut Io<'_>, ports: &SituationPorts) -> Step {
        self.watch.step(io, ports, &mut self.situation)
    }
}

impl SituationWatch {
    // Apart from the situation, so that it is there once for all of them.
    fn step(
        &mut self,
        io: &mut Io<'_>,
        ports: &SituationPorts,
        situation: &mut dyn Situation,
    ) -> Step {
        let params = io.params();
        let (pose, ranges) = (io.try_read(ports.pose).copied(), io.try_read(ports.ranges));
        let battery_v = io.try_read(ports.battery).map(|battery| battery.voltage_v);
        let period_us = io.period_us();
        let Some(list) = io.try_update(ports.list) else {
            // Nobody can be on it, nor knows anybody which way round the robot drives.
            self.is_up = false;
            io.set(ports.up, false);
            return Step::Run;
        };
        let way_round = list.way_round;
        let pose = pose.map(|pose| way_round.pose(pose));
        if self.centre.is_none() {
            self.centre = pose.map(LocalFrame::from);
        }
        let key = list.in_turn();
        let executes = key.is_some() && list.head() == key;
        let mut room = None;
        let seen = Circumstances {
            pose: pose.zip(self.centre).map(|(pose, centre)| centre.see(pose)),
            asked: if executes { list.asked() } else { Twist::STILL },
            ranges: way_round.ranges(ranges, &mut room),
            battery_v,
            period_us,
        };
        let was_up = self.is_up;
        self.is_up = situation.look(&seen, &params);
        if let Some(key) = key.filter(|_| self.is_up) {
            match params.get(ports.reaction) {
                SUSPEND => list.bar(key),
                CANCEL if !was_up => {
                    list.end(key);
                }
                _ => {}
            }
        }
        if self.is_up && !was_up {
            info!("situation {}", ports.name);
            if let Some(key) = key {
                list.come_up(CameUp {
                    key,
                    situation: situation.number(),
                    reaction: match params.get(ports.reaction) {
                        SUSPEND => Reaction::Suspend,
                        CANCEL => Reaction::Cancel,
                        _ => Reaction::Flag,
                    },
                });
            }
        }
        io.set(ports.up, self.is_up);
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::behaviours::{DoorLeft, LowBattery, Move, Near, OutsideRange, Stuck};
    use crate::task::Task;

    const PERIOD_US: u32 = 20_000;
    const FORWARDS: Twist = Twist {
        forward_m_per_s: 0.2,
        turn_rad_per_s: 0.0,
    };

    /// A state `Move` and a situation beside it, on a list whose owner looks at it after both.
    struct Robot {
        behaviour: TaskBench<'static>,
        situation: TaskBench<'static>,
        list: BehaviourList,
        /// The situation's region stands before the behaviour's.
        is_first: bool,
    }

    impl Robot {
        fn with(situation: impl Task + 'static) -> Self {
            let mut behaviour = TaskBench::new(Move::default());
            (behaviour.period_us(PERIOD_US)).param(Move::SPEED_M_PER_S, 0.2);
            let mut situation = TaskBench::new(situation);
            situation.period_us(PERIOD_US);
            let mut robot = Self {
                behaviour,
                situation,
                list: BehaviourList::EMPTY,
                is_first: false,
            };
            robot.is_at(Pose::START).sees(1.0);
            robot
        }

        fn is_at(&mut self, pose: Pose) -> &mut Self {
            self.behaviour.give(Move::POSE, pose);
            self.situation.give(Near::POSE, pose);
            self
        }

        /// Something is so far to the right.
        fn sees(&mut self, range_m: f32) -> &mut Self {
            let mut ranges = Ranges::FREE;
            ranges.range_m[6] = range_m;
            self.behaviour.give(Move::RANGES, ranges);
            self.situation.give(Near::RANGES, ranges);
            self
        }

        /// How it moves in the next activation, and whether the situation is up then.
        fn moves(&mut self) -> (Twist, bool) {
            for is_situation in [self.is_first, !self.is_first] {
                let (bench, port) = if is_situation {
                    (&mut self.situation, Near::LIST)
                } else {
                    (&mut self.behaviour, Move::LIST)
                };
                bench.give(port, self.list).step();
                self.list = bench.output(port).unwrap();
            }
            let twist = self.list.take_asked();
            self.list.look();
            (twist, self.situation.flag(Near::UP))
        }
    }

    #[test]
    fn what_is_up_is_told_and_does_nothing_unless_a_reaction_says_so() {
        let mut robot = Robot::with(Near::default());
        robot.situation.param(Near::RANGE_M, 0.5);
        assert_eq!(robot.moves(), (FORWARDS, false));
        assert_eq!(robot.sees(0.4).moves(), (FORWARDS, true));
        assert_eq!(robot.sees(0.6).moves(), (FORWARDS, false));
    }

    #[test]
    fn a_behaviour_is_suspended_while_it_is_up_and_resumes_by_itself_half_a_second_later() {
        for is_first in [false, true] {
            let mut robot = Robot::with(Near::default());
            robot.is_first = is_first;
            robot
                .situation
                .param(Near::RANGE_M, 0.5)
                .param(Near::REACTION, SUSPEND);
            robot.moves();
            robot.sees(0.4).moves();
            for _ in 0..100 {
                assert_eq!(robot.moves(), (Twist::STILL, true));
                assert!(robot.behaviour.flag(Move::SUSPENDED));
            }
            robot.sees(0.6);
            let stands = (0..100)
                .take_while(|_| robot.moves().0 == Twist::STILL)
                .count();
            assert!((25..=28).contains(&stands), "{stands} activations");
            assert!(!robot.behaviour.flag(Move::SUSPENDED));
        }
    }

    #[test]
    fn one_that_suspends_and_whose_state_is_left_holds_nobody_any_more() {
        let mut robot = Robot::with(Near::default());
        robot
            .situation
            .param(Near::RANGE_M, 0.5)
            .param(Near::REACTION, SUSPEND);
        robot.sees(0.4).moves();
        assert_eq!(robot.moves().0, Twist::STILL);
        let alone = |robot: &mut Robot| {
            robot.behaviour.give(Move::LIST, robot.list).step();
            robot.list = robot.behaviour.output(Move::LIST).unwrap();
            let twist = robot.list.take_asked();
            robot.list.look();
            twist
        };
        let stands = (0..100)
            .take_while(|_| alone(&mut robot) == Twist::STILL)
            .count();
        assert!((25..=28).contains(&stands), "{stands} activations");
    }

    #[test]
    fn a_behaviour_is_cancelled_once_for_each_time_it_comes_up() {
        let mut robot = Robot::with(Near::default());
        robot
            .situation
            .param(Near::RANGE_M, 0.5)
            .param(Near::REACTION, CANCEL);
        robot.moves();
        robot.sees(0.4).moves();
        assert_eq!(robot.moves(), (Twist::STILL, true));
        assert!(robot.behaviour.flag(Move::FAILED) && robot.list.is_empty());
        // The next one executes though it is up; when it comes up anew that one is cancelled, too.
        robot.behaviour.enter_anew();
        assert_eq!(robot.moves(), (FORWARDS, true));
        assert_eq!(robot.moves(), (FORWARDS, true));
        robot.sees(0.6).moves();
        robot.sees(0.4).moves();
        assert_eq!(robot.moves().0, Twist::STILL);
    }

    #[test]
    fn a_robot_is_stuck_that_does_not_move_as_its_behaviour_says_in_whatever_order() {
        for is_first in [false, true] {
            let mut robot = Robot::with(Stuck::default());
            robot.is_first = is_first;
            robot.situation.param(Stuck::AFTER_S, 1.0);
            let until_up = (0..100).take_while(|_| !robot.moves().1).count();
            assert!((49..=52).contains(&until_up), "{until_up} activations");
            // Nobody executes, and so it is not to move.
            while robot.list.head().is_some() {
                robot.list.end(robot.list.head().unwrap());
            }
            robot.moves();
            assert_eq!(robot.moves(), (Twist::STILL, false));
        }
    }

    #[test]
    fn outside_is_counted_from_where_the_state_was_entered() {
        let mut robot = Robot::with(OutsideRange::default());
        robot.situation.param(OutsideRange::RADIUS_M, 1.0);
        let at = |x_m| Pose { x_m, ..Pose::START };
        robot.is_at(at(5.0)).moves();
        assert!(!robot.is_at(at(5.9)).moves().1);
        assert!(robot.is_at(at(6.1)).moves().1);
        robot.situation.enter_anew();
        assert!(!robot.moves().1);
        assert!(!robot.is_at(at(5.2)).moves().1);
    }

    #[test]
    fn a_battery_that_nobody_measures_counts_as_low() {
        let mut robot = Robot::with(LowBattery::default());
        robot.situation.param(LowBattery::BELOW_V, 6.6);
        assert!(robot.moves().1);
        for (voltage_v, is_up) in [(6.5, true), (6.7, false)] {
            robot.situation.give(Near::BATTERY, Battery { voltage_v });
            assert_eq!(robot.moves().1, is_up, "{voltage_v} V");
        }
    }

    #[test]
    fn a_door_that_was_passed_is_up_for_a_second() {
        let mut robot = Robot::with(DoorLeft::default());
        robot.situation.param(DoorLeft::LEAST_M, 0.7);
        let mut up = 0;
        for step in 0..400 {
            let x_m = step as f32 * 0.005;
            let mut ranges = Ranges::FREE;
            ranges.age_ms = [20 * (step % 4) as u16; crate::tasks::MAX_SONARS];
            // The wall on the left is open for 0.5 m, and the beam hides more.
            ranges.range_m[2] = if (0.5..1.0).contains(&x_m) { 3.0 } else { 0.8 };
            robot.situation.give(Near::RANGES, ranges);
            up += usize::from(robot.is_at(Pose { x_m, ..Pose::START }).moves().1);
        }
        assert_eq!(up, 50, "activations of 20 ms");
    }
}
