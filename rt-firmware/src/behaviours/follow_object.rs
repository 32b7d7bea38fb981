//! Follows what is nearest ahead.

use super::law::{Behaviour, Control, Scene};
use super::list::BehaviourList;
use crate::behaviour;
use crate::declaration::Params;
use crate::tasks::{Bearing, Pose, Ranges, Twist};

/// Speed for each metre too far away, in 1/s; the fastest way back, in metres per second; and what
/// counts as the right distance, in metres.
const SPEED_PER_M: f32 = 1.0;
const BACK_MOST_M_PER_S: f32 = 0.1;
const RIGHT_M: f32 = 0.03;
/// How fast it turns to what is at its side, in radians per second.
const TURN_RAD_PER_S: f32 = 0.8;
/// How fast it turns towards a side where the same thing shows as well, in radians per second …
const TURN_A_LITTLE_RAD_PER_S: f32 = 0.3;
/// … which it is if it is no farther than this from what is ahead, in metres.
const SAME_M: f32 = 0.3;

/// Keeps a distance to the nearest thing ahead, and turns to it. Where nothing is within reach it
/// turns to where it was last.
#[derive(Clone, Copy, Debug, Default)]
pub struct FollowObjectLaw {
    lost_us: u32,
    /// The turning speed with which it was seen last, in radians per second.
    turned_rad_per_s: f32,
}

behaviour! {
    /// Behaviour: keeps a distance to the nearest thing ahead. It fails where that is lost.
    impl FollowObject runs FollowObjectLaw {
        wcet 300 us;
        params {
            /// The distance to keep, in metres from the rim.
            distance_m: f32 = 0.5, 0.3..=2.0;
            /// What is farther is not followed, in metres from the rim.
            reach_m: f32 = 1.5, 0.5..=4.0;
            /// How fast at most, in metres per second.
            speed_m_per_s: f32 = 0.3, 0.05..=0.5;
            /// How long to look for what is lost, in seconds.
            lost_s: f32 = 5.0, 0.0..=600.0;
        }
    }
}

impl FollowObjectLaw {
    /// How to move; none where nothing is within reach ahead or half ahead.
    pub fn twist(
        ranges: &Ranges,
        distance_m: f32,
        reach_m: f32,
        most_m_per_s: f32,
    ) -> Option<Twist> {
        let [ahead_m, left_m, right_m] = [Bearing::Ahead, Bearing::AheadLeft, Bearing::AheadRight]
            .map(|bearing| {
                let range_m = ranges.free_m(bearing);
                // What is not known is not followed.
                if range_m > 0.0 && range_m < reach_m {
                    range_m
                } else {
                    f32::INFINITY
                }
            });
        let aside_m = left_m.min(right_m);
        let side = if left_m < right_m { 1.0 } else { -1.0 };
        if aside_m < ahead_m {
            return Some(Twist {
                forward_m_per_s: 0.0,
                turn_rad_per_s: TURN_RAD_PER_S * side,
            });
        }
        if ahead_m == f32::INFINITY {
            return None;
        }
        let too_far_m = ahead_m - distance_m;
        let forward_m_per_s = if too_far_m.abs() < RIGHT_M {
            0.0
        } else {
            (too_far_m * SPEED_PER_M).clamp(-BACK_MOST_M_PER_S, most_m_per_s)
        };
        let shows_aside = aside_m < ahead_m + SAME_M && (left_m - right_m).abs() > SAME_M;
        Some(Twist {
            forward_m_per_s,
            turn_rad_per_s: if shows_aside {
                TURN_A_LITTLE_RAD_PER_S * side
            } else {
                0.0
            },
        })
    }
}

impl Behaviour for FollowObjectLaw {
    fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control {
        let seen = scene.ranges.and_then(|ranges| {
            Self::twist(
                ranges,
                params.get(FollowObject::DISTANCE_M),
                params.get(FollowObject::REACH_M),
                params.get(FollowObject::SPEED_M_PER_S),
            )
        });
        if let Some(twist) = seen {
            self.lost_us = 0;
            if twist.turn_rad_per_s != 0.0 {
                self.turned_rad_per_s = twist.turn_rad_per_s;
            }
            return Control::Move(twist);
        }
        self.lost_us = self.lost_us.saturating_add(scene.period_us);
        if self.lost_us as f32 > params.get(FollowObject::LOST_S) * 1e6 {
            return Control::Failed;
        }
        Control::Move(Twist {
            forward_m_per_s: 0.0,
            turn_rad_per_s: self.turned_rad_per_s,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ranges(ahead_m: f32, left_m: f32, right_m: f32) -> Ranges {
        let mut ranges = Ranges::FREE;
        ranges.range_m[0] = ahead_m;
        ranges.range_m[1] = left_m;
        ranges.range_m[7] = right_m;
        ranges
    }

    #[test]
    fn it_keeps_its_distance_and_turns_to_what_is_nearest() {
        for ((ahead_m, left_m, right_m), expected) in [
            ((0.5, 4.0, 4.0), Some((0.0, 0.0))),
            ((0.7, 4.0, 4.0), Some((0.2, 0.0))),
            ((1.4, 4.0, 4.0), Some((0.3, 0.0))),
            ((0.42, 4.0, 4.0), Some((-0.08, 0.0))),
            ((0.3, 4.0, 4.0), Some((-0.1, 0.0))),
            ((4.0, 0.9, 4.0), Some((0.0, 0.8))),
            ((1.4, 4.0, 0.9), Some((0.0, -0.8))),
            ((0.7, 0.8, 4.0), Some((0.2, 0.3))),
            ((0.7, 0.8, 0.9), Some((0.2, 0.0))),
            ((4.0, 4.0, 4.0), None),
            ((0.0, 0.0, 2.0), None),
        ] {
            let twist = FollowObjectLaw::twist(&ranges(ahead_m, left_m, right_m), 0.5, 1.5, 0.3);
            match (twist, expected) {
                (None, None) => {}
                (Some(twist), Some((forward, turn))) => assert!(
                    (twist.forward_m_per_s - forward).abs() < 1e-5
                        && (twist.turn_rad_per_s - turn).abs() < 1e-6,
                    "{ahead_m} {left_m} {right_m}: {twist:?}"
                ),
                (twist, _) => panic!("{ahead_m} {left_m} {right_m}: {twist:?}"),
            }
        }
    }

    #[test]
    fn it_looks_where_it_saw_it_last_and_fails_after_a_while() {
        let mut bench = crate::TaskBench::new(FollowObject::default());
        bench
            .period_us(20_000)
            .param(FollowObject::DISTANCE_M, 0.5)
            .param(FollowObject::REACH_M, 1.5)
            .param(FollowObject::SPEED_M_PER_S, 0.3)
            .param(FollowObject::LOST_S, 1.0)
            .give(FollowObject::LIST, BehaviourList::EMPTY)
            .give(FollowObject::POSE, Pose::START)
            .give(FollowObject::RANGES, ranges(4.0, 4.0, 0.9));
        bench.step();
        bench.give(FollowObject::RANGES, Ranges::FREE);
        for step in 0..50 {
            assert_eq!(bench.step(), Some(crate::Step::Run), "{step}");
            let mut list: BehaviourList = bench.output(FollowObject::LIST).expect("a list");
            assert_eq!(list.take_asked().turn_rad_per_s, -0.8);
            bench.give(FollowObject::LIST, list);
        }
        assert_eq!(bench.step(), Some(crate::Step::Finished));
        assert!(bench.flag(FollowObject::FAILED));
    }
}
