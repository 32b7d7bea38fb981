//! Which way round the robot drives.
//!
//! A ring of sonars looks to all sides alike. So a robot that has lost a sonar with which it must
//! look ahead turns around once, and from then on drives with its back ahead: its laws see a robot
//! whose front that is.

use core::f32::consts::PI;

use super::turn_rate::rate_rad_per_s;
use crate::odometry::wrapped_rad;
use crate::tasks::{Bearings, Pose, Ranges, Twist};

/// Whether robots turn around. A small one does without, and stands.
const TURNS_AROUND: bool = cfg!(feature = "all-behaviours");

/// How many ends of its own a robot knows of beside its front.
const OTHER_ENDS: usize = TURNS_AROUND as usize;

/// Which end of the robot is ahead.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct WayRound([Turned; OTHER_ENDS]);

#[derive(Clone, Copy, Debug, PartialEq)]
struct Turned {
    is_reversed: bool,
    /// The heading that the robot turns to before the other end is ahead, in radians.
    to_rad: Option<f32>,
}

impl WayRound {
    /// The front is ahead.
    pub const FORWARDS: Self = Self(
        [Turned {
            is_reversed: false,
            to_rad: None,
        }; OTHER_ENDS],
    );

    /// Whether the back is ahead.
    pub fn is_reversed(self) -> bool {
        self.0.iter().any(|turned| turned.is_reversed)
    }

    /// The robot's pose, as its laws see it.
    pub fn pose(self, pose: Pose) -> Pose {
        if self.is_reversed() {
            pose.rotate(PI)
        } else {
            pose
        }
    }

    /// What is around the robot, as its laws see it; `room` is for what differs from the ranges.
    pub fn ranges<'a>(
        self,
        ranges: Option<&'a Ranges>,
        room: &'a mut Option<Ranges>,
    ) -> Option<&'a Ranges> {
        if !self.is_reversed() {
            return ranges;
        }
        *room = ranges.map(Ranges::reversed);
        room.as_ref()
    }

    /// How the robot is to move for what its laws say.
    pub fn twist(self, twist: Twist) -> Twist {
        if self.is_reversed() {
            Twist {
                forward_m_per_s: -twist.forward_m_per_s,
                ..twist
            }
        } else {
            twist
        }
    }

    /// Whether the robot is to turn around, or does so. `ranges` are as the laws see them.
    pub fn is_to_change(self, ranges: Option<&Ranges>, needs: impl Fn() -> Bearings) -> bool {
        let sees_more = || ranges.is_some_and(|ranges| is_better(ranges, needs()));
        (self.0.iter()).any(|turned| turned.to_rad.is_some() || sees_more())
    }

    /// Looks at the sonars that are needed, in the laws' eyes. Says how to turn, as long as the
    /// robot turns around; then the other end is ahead. `pose` is the robot's own.
    pub fn turn_around(
        &mut self,
        pose: &Pose,
        ranges: Option<&Ranges>,
        needs: impl Fn() -> Bearings,
    ) -> Option<Twist> {
        if !self.is_to_change(ranges, needs) {
            return None;
        }
        let turned = self.0.first_mut()?;
        let back_rad = wrapped_rad(pose.heading_rad + PI);
        let to_rad = *turned.to_rad.get_or_insert(back_rad);
        let rate = rate_rad_per_s(wrapped_rad(pose.heading_rad - to_rad));
        if rate.is_none() {
            *turned = Turned {
                is_reversed: !turned.is_reversed,
                to_rad: None,
            };
        }
        Some(Twist {
            forward_m_per_s: 0.0,
            turn_rad_per_s: rate.unwrap_or(0.0),
        })
    }
}

/// Whether a robot that has lost a sonar sees more of what it needs to see with its other end
/// ahead.
fn is_better(ranges: &Ranges, needs: Bearings) -> bool {
    if ranges.dead | ranges.deaf == 0 {
        return false;
    }
    let live = ranges.live();
    needs.without(live.reversed()).count() < needs.without(live).count()
}

#[cfg(all(test, feature = "all-behaviours"))]
mod tests {
    use super::*;
    use crate::behaviours::{BehaviourList, GoTo, TurnTo};
    use crate::tasks::Bearing;
    use crate::{Step, TaskBench};

    /// Ranges of a ring in which these are dead.
    fn dead(sonars: &[u8]) -> Ranges {
        let mut ranges = Ranges::FREE;
        for sonar in sonars {
            ranges.dead |= 1 << sonar;
            ranges.range_m[usize::from(*sonar)] = 0.0;
        }
        ranges
    }

    #[test]
    fn it_turns_around_where_that_shows_it_more_of_what_it_needs_to_see() {
        let doors = Bearings::FRONT.with(Bearings::of(&[Bearing::Left]));
        for (lost, needs, turns) in [
            (&[][..], Bearings::FRONT, false),
            (&[0], Bearings::FRONT, true),
            (&[1], Bearings::FRONT, true),
            (&[7], Bearings::FRONT, true),
            (&[2], Bearings::FRONT, false),
            (&[4], Bearings::FRONT, false),
            (&[2], doors, true),
            (&[6], doors, false),
            // Neither end sees all: it stands, where it did before.
            (&[0, 4], Bearings::FRONT, false),
            (&[0, 1, 4], Bearings::FRONT, true),
            (&[0], Bearings::NONE, false),
        ] {
            let mut way_round = WayRound::FORWARDS;
            let twist = way_round.turn_around(&Pose::START, Some(&dead(lost)), || needs);
            assert_eq!(twist.is_some(), turns, "{lost:?} {needs:?}");
        }
        // Nobody drives with an end ahead at which there is no sonar.
        let mut ahead_alone = dead(&[0]);
        ahead_alone.sonars = 1;
        let mut way_round = WayRound::FORWARDS;
        let twist = way_round.turn_around(&Pose::START, Some(&ahead_alone), || Bearings::FRONT);
        assert_eq!(twist, None);
    }

    #[test]
    fn what_the_laws_see_is_the_same_before_and_after() {
        const PERIOD_S: f32 = 0.02;
        let start = Pose {
            x_m: 1.0,
            y_m: -2.0,
            heading_rad: 2.5,
        };
        let (mut pose, mut way_round, mut turned_s) = (start, WayRound::FORWARDS, 0.0);
        let ranges = dead(&[0]);
        loop {
            let mut room = None;
            let seen = way_round.ranges(Some(&ranges), &mut room);
            let Some(twist) = way_round.turn_around(&pose, seen, || Bearings::FRONT) else {
                break;
            };
            pose = pose.rotate(twist.turn_rad_per_s * PERIOD_S);
            turned_s += PERIOD_S;
            assert!(turned_s < 10.0, "{pose:?}");
        }
        assert!(way_round.is_reversed());
        let seen = way_round.pose(pose);
        assert!(
            (seen.heading_rad - start.heading_rad).abs() < 0.021,
            "{seen:?}"
        );
        assert_eq!((seen.x_m, seen.y_m), (start.x_m, start.y_m));
        let ahead = Twist {
            forward_m_per_s: 0.2,
            turn_rad_per_s: 0.1,
        };
        let back = Twist {
            forward_m_per_s: -0.2,
            turn_rad_per_s: 0.1,
        };
        assert_eq!(way_round.twist(ahead), back);
        let mut room = None;
        let seen = way_round.ranges(Some(&ranges), &mut room).unwrap();
        assert_eq!((seen.ahead_m(), seen.behind_m()), (Ranges::FAR_M, 0.0));
    }

    #[test]
    fn a_behaviour_that_has_lost_its_front_turns_around_and_goes_on_with_its_back_ahead() {
        const PERIOD_US: u32 = 20_000;
        let mut bench = TaskBench::new(GoTo::default());
        bench
            .period_us(PERIOD_US)
            .param(GoTo::X_M, 1.0)
            .param(GoTo::SPEED_M_PER_S, 0.25)
            .give(GoTo::LIST, BehaviourList::EMPTY)
            .give(GoTo::RANGES, Ranges::FREE);
        let mut pose = Pose::START;
        let mut turned_rad = 0.0_f32;
        for step in 0..1_000 {
            if step == 50 {
                bench.give(GoTo::RANGES, dead(&[0]));
            }
            bench.give(GoTo::POSE, pose);
            if bench.step() == Some(Step::Finished) {
                break;
            }
            let mut list: BehaviourList = bench.output(GoTo::LIST).unwrap();
            let twist = list.take_asked();
            list.look();
            bench.give(GoTo::LIST, list);
            let period_s = PERIOD_US as f32 * 1e-6;
            turned_rad += twist.turn_rad_per_s * period_s;
            pose = (pose.translate(twist.forward_m_per_s * period_s, 0.0))
                .rotate(twist.turn_rad_per_s * period_s);
        }
        assert!(!bench.flag(GoTo::FAILED));
        assert!(
            (pose.x_m - 1.0).abs() < 0.04 && pose.y_m.abs() < 0.04,
            "{pose:?}"
        );
        assert!((turned_rad.abs() - PI).abs() < 0.1, "{turned_rad}");
    }

    #[test]
    fn who_only_turns_does_not_turn_around_for_it() {
        let mut bench = TaskBench::new(TurnTo::default());
        bench
            .give(TurnTo::LIST, BehaviourList::EMPTY)
            .give(TurnTo::POSE, Pose::START)
            .give(TurnTo::RANGES, dead(&[0]));
        bench.step();
        let list: BehaviourList = bench.output(TurnTo::LIST).unwrap();
        assert_eq!(list.way_round, WayRound::FORWARDS);
    }
}
