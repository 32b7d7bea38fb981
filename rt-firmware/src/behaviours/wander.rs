//! Drives about.

use super::law::{Behaviour, Control, Scene};
use super::list::BehaviourList;
use crate::behaviour;
use crate::declaration::Params;
use crate::tasks::{Pose, Ranges, Sector, Twist};

/// How fast it turns away from what is near, in radians per second.
const TURN_RAD_PER_S: f32 = 0.8;
/// The way is free again if so much more is free than where it was not, in metres.
const FREER_M: f32 = 0.2;
/// Half ahead so much of it must be free.
const DIAGONAL_PART: f32 = 0.6;
/// Speed for each metre that is free beyond what is near, in 1/s, and the slowest, in metres per
/// second.
const SPEED_PER_M: f32 = 1.0;
const SLOW_M_PER_S: f32 = 0.08;

/// Drives ahead, and turns away from what is near, to the side with more space. What is not known
/// is near.
#[derive(Clone, Copy, Debug, Default)]
pub struct WanderLaw {
    passed_us: u32,
    /// It turns, with this speed, in radians per second; 0 while it drives.
    turning_rad_per_s: f32,
}

behaviour! {
    /// Behaviour: drives about and turns away from what is near, and ends after a time.
    impl Wander runs WanderLaw {
        wcet 300 us;
        params {
            /// How long, in seconds, without the time in which it waits.
            time_s: f32 = 60.0, 1.0..=3600.0;
            /// How fast at most, in metres per second.
            speed_m_per_s: f32 = 0.25, 0.05..=0.4;
            /// What is nearer ahead is near, in metres from the rim.
            near_m: f32 = 0.5, 0.4..=2.0;
        }
    }
}

impl WanderLaw {
    /// How to move, after a movement that turned with this speed.
    pub fn twist(ranges: &Ranges, turning_rad_per_s: f32, near_m: f32, most_m_per_s: f32) -> Twist {
        let ahead_m = ranges.ahead_m();
        let is_free = |free_m: f32| {
            ahead_m > free_m
                && ranges.ahead_left_m() > free_m * DIAGONAL_PART
                && ranges.ahead_right_m() > free_m * DIAGONAL_PART
        };
        if turning_rad_per_s != 0.0 && !is_free(near_m + FREER_M) {
            // It goes on to the same side: in a corner it would turn to and fro.
            return Twist {
                forward_m_per_s: 0.0,
                turn_rad_per_s: turning_rad_per_s,
            };
        }
        if !is_free(near_m) {
            let (left_m, right_m) = (
                ranges.free_range(Sector::Left),
                ranges.free_range(Sector::Right),
            );
            let side = if left_m < right_m { -1.0 } else { 1.0 };
            return Twist {
                forward_m_per_s: 0.0,
                turn_rad_per_s: TURN_RAD_PER_S * side,
            };
        }
        Twist {
            forward_m_per_s: ((ahead_m - near_m) * SPEED_PER_M).clamp(SLOW_M_PER_S, most_m_per_s),
            turn_rad_per_s: 0.0,
        }
    }
}

impl Behaviour for WanderLaw {
    fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control {
        self.passed_us = self.passed_us.saturating_add(scene.period_us);
        if self.passed_us as f32 > params.get(Wander::TIME_S) * 1e6 {
            return Control::Done;
        }
        let Some(ranges) = scene.ranges else {
            return Control::Move(Twist::STILL);
        };
        let twist = Self::twist(
            ranges,
            self.turning_rad_per_s,
            params.get(Wander::NEAR_M),
            params.get(Wander::SPEED_M_PER_S),
        );
        self.turning_rad_per_s = twist.turn_rad_per_s;
        Control::Move(twist)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_drives_where_it_is_free_and_turns_on_until_it_is() {
        // Ranges of sonars, how it turned before, and how it moves.
        for (seen, turning, expected) in [
            (&[][..], 0.0, (0.25, 0.0)),
            (&[(0, 0.6)], 0.0, (0.1, 0.0)),
            (&[(0, 0.5)], 0.0, (0.0, 0.8)),
            (&[(0, 0.5), (2, 1.0)], 0.0, (0.0, -0.8)),
            (&[(1, 0.29), (2, 1.0)], 0.0, (0.0, -0.8)),
            (&[(0, 0.5), (2, 1.0)], 0.8, (0.0, 0.8)),
            (&[(0, 0.65)], 0.8, (0.0, 0.8)),
            (&[(0, 0.71)], 0.8, (0.21, 0.0)),
            (&[(0, 0.0)], 0.0, (0.0, 0.8)),
        ] {
            let mut ranges = Ranges::FREE;
            for (sonar, range_m) in seen {
                let sonar: usize = *sonar;
                ranges.range_m[sonar] = *range_m;
            }
            let twist = WanderLaw::twist(&ranges, turning, 0.5, 0.25);
            assert!(
                (twist.forward_m_per_s - expected.0).abs() < 1e-5
                    && twist.turn_rad_per_s == expected.1,
                "{seen:?} {turning}: {twist:?}"
            );
        }
    }

    #[test]
    fn it_ends_after_its_time_and_stands_without_ranges() {
        let mut bench = crate::TaskBench::new(Wander::default());
        bench
            .period_us(20_000)
            .param(Wander::TIME_S, 1.0)
            .give(Wander::LIST, BehaviourList::EMPTY)
            .give(Wander::POSE, Pose::START);
        for step in 0..50 {
            assert_eq!(bench.step(), Some(crate::Step::Run), "{step}");
            let mut list: BehaviourList = bench.output(Wander::LIST).expect("a list");
            assert_eq!(list.take_asked(), Twist::STILL);
            bench.give(Wander::LIST, list);
        }
        assert_eq!(bench.step(), Some(crate::Step::Finished));
        assert!(!bench.flag(Wander::FAILED));
    }
}
