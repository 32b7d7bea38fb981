//! The situations that a command has put beside a behaviour.

use crate::odometry::wrapped_rad;
use crate::tasks::{Pose, Ranges, Sector, Twist};
use esm_link::behaviours::{MAX_WATCHES, Reaction, Situation, Watch};

/// A robot that has moved by less has not moved, in metres and radians.
const MOVED_M: f32 = 0.01;
const MOVED_RAD: f32 = 0.02;
const US_PER_S: f32 = 1e6;

/// What is looked at.
#[derive(Clone, Copy, Debug)]
pub(super) struct Seen<'a> {
    /// Where the robot is in the behaviour's local frame, if anybody knows.
    pub(super) pose: Option<Pose>,
    /// How the behaviour has asked to move; still where it does not execute.
    pub(super) asked: Twist,
    /// What is around the robot.
    pub(super) ranges: Option<&'a Ranges>,
    /// Of the battery, in volts, if anybody knows.
    pub(super) battery_v: Option<f32>,
    /// Time since the last look, in microseconds.
    pub(super) period_us: u32,
}

/// What is to be done about what has come up.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Reactions {
    /// The behaviour is suspended while it lasts.
    pub(super) suspend: bool,
    /// The behaviour ends.
    pub(super) cancel: bool,
    /// So does its script.
    pub(super) end_script: bool,
    /// The flag is set while it lasts.
    pub(super) flag: bool,
    /// This step is inserted before it.
    pub(super) insert: Option<u8>,
    /// Those that were not up before.
    pub(super) came_up: [Option<Watch>; MAX_WATCHES],
}

#[derive(Clone, Copy, Debug)]
struct Watched {
    watch: Watch,
    /// How long it has lasted, for a situation that takes time, in microseconds.
    lasts_us: u32,
    is_up: bool,
}

/// Situations beside one behaviour.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watches {
    watched: [Option<Watched>; MAX_WATCHES],
    /// Where the robot was when it moved last.
    moved: Option<Pose>,
}

impl Watches {
    /// These, of which none has come up.
    pub(super) fn new(watches: [Option<Watch>; MAX_WATCHES]) -> Self {
        let begin = |watch| Watched {
            watch,
            lasts_us: 0,
            is_up: false,
        };
        Self {
            watched: watches.map(|watch| watch.map(begin)),
            moved: None,
        }
    }

    /// Looks for all of them.
    pub(super) fn look(&mut self, seen: &Seen<'_>) -> Reactions {
        let moves = self.moves(seen);
        let mut reactions = Reactions::default();
        let watches = self.watched.iter_mut().zip(&mut reactions.came_up);
        for (watched, came_up) in watches {
            let Some(watched) = watched else { continue };
            let was_up = watched.is_up;
            watched.look(seen, moves);
            *came_up = Some(watched.watch).filter(|_| watched.is_up && !was_up);
            if watched.is_up {
                match watched.watch.reaction {
                    Reaction::Suspend => reactions.suspend = true,
                    Reaction::Cancel => reactions.cancel = true,
                    Reaction::EndScript => {
                        (reactions.cancel, reactions.end_script) = (true, true);
                    }
                    Reaction::Flag => reactions.flag = true,
                    Reaction::Insert(step) if !was_up => reactions.insert = Some(step),
                    Reaction::Insert(_) => {}
                }
            }
        }
        reactions
    }

    /// Whether the robot moves, as far as it is to.
    fn moves(&mut self, seen: &Seen<'_>) -> bool {
        let Some(pose) = seen.pose else {
            return false;
        };
        let has_moved = self.moved.is_none_or(|moved| {
            let (x_m, y_m) = (pose.x_m - moved.x_m, pose.y_m - moved.y_m);
            let turned_rad = wrapped_rad(pose.heading_rad - moved.heading_rad);
            x_m * x_m + y_m * y_m > MOVED_M * MOVED_M || turned_rad.abs() > MOVED_RAD
        });
        if has_moved {
            self.moved = Some(pose);
        }
        has_moved || seen.asked == Twist::STILL
    }
}

impl Watched {
    fn look(&mut self, seen: &Seen<'_>, moves: bool) {
        let value = self.watch.value;
        let mut lasts = |is_so: bool| {
            self.lasts_us = if is_so {
                self.lasts_us.saturating_add(seen.period_us)
            } else {
                0
            };
            is_so && self.lasts_us as f32 >= value * US_PER_S
        };
        self.is_up = match self.watch.situation {
            Situation::OutsideRange => (seen.pose)
                .is_some_and(|pose| pose.x_m * pose.x_m + pose.y_m * pose.y_m > value * value),
            Situation::Stuck => lasts(!moves),
            Situation::SensorLost => {
                let front_m = seen.ranges.map(|ranges| ranges.free_range(Sector::Front));
                lasts(front_m.is_none_or(|front_m| front_m <= 0.0))
            }
            // Who watches what nobody measures is told so at once.
            Situation::LowBattery => seen.battery_v.is_none_or(|voltage_v| voltage_v < value),
            Situation::Near => (seen.ranges).is_none_or(|ranges| ranges.nearest_m() < value),
        };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FORWARDS: Twist = Twist {
        forward_m_per_s: 0.2,
        turn_rad_per_s: 0.0,
    };

    fn watches(situation: Situation, value: f32, reaction: Reaction) -> Watches {
        let watch = Watch {
            situation,
            value,
            reaction,
        };
        Watches::new([Some(watch), None, None])
    }

    fn seen(x_m: f32, ranges: Option<&Ranges>) -> Seen<'_> {
        Seen {
            pose: Some(Pose { x_m, ..Pose::START }),
            asked: FORWARDS,
            ranges,
            battery_v: Some(7.0),
            period_us: 100_000,
        }
    }

    fn near(range_m: f32) -> Ranges {
        let mut ranges = Ranges::FREE;
        ranges.range_m[7] = range_m;
        ranges
    }

    #[test]
    fn situations_come_up_at_their_values() {
        let free = Ranges::FREE;
        let close = near(0.3);
        for (situation, value, seen, is_up) in [
            (Situation::OutsideRange, 2.0, seen(1.99, None), false),
            (Situation::OutsideRange, 2.0, seen(-2.01, None), true),
            (Situation::LowBattery, 6.6, seen(0.0, None), false),
            (Situation::LowBattery, 7.1, seen(0.0, None), true),
            (
                Situation::LowBattery,
                1.0,
                Seen {
                    battery_v: None,
                    ..seen(0.0, None)
                },
                true,
            ),
            (Situation::Near, 0.3, seen(0.0, Some(&close)), false),
            (Situation::Near, 0.31, seen(0.0, Some(&close)), true),
            (Situation::Near, 0.31, seen(0.0, Some(&free)), false),
            (Situation::Near, 0.31, seen(0.0, None), true),
        ] {
            let reactions = watches(situation, value, Reaction::Cancel).look(&seen);
            assert_eq!(reactions.cancel, is_up, "{situation:?} {value} {seen:?}");
        }
    }

    #[test]
    fn a_robot_is_stuck_that_is_to_move_and_has_not_for_so_long() {
        let mut stuck = watches(Situation::Stuck, 0.5, Reaction::Cancel);
        let mut look = |x_m, asked| {
            let seen = Seen {
                asked,
                ..seen(x_m, None)
            };
            stuck.look(&seen).cancel
        };
        // It moves, and then stands although it is to move.
        assert!((0..20).all(|step| !look(step as f32 * 0.02, FORWARDS)));
        assert!((0..4).all(|_| !look(0.38, FORWARDS)));
        // It is not to move: the time begins anew.
        assert!(!look(0.38, Twist::STILL));
        assert!((0..4).all(|_| !look(0.385, FORWARDS)));
        assert!(look(0.38, FORWARDS));
    }

    #[test]
    fn sensors_are_lost_where_nobody_has_known_for_so_long_what_is_ahead() {
        let mut lost = watches(Situation::SensorLost, 0.3, Reaction::Flag);
        let unknown = near(0.0);
        let free = Ranges::FREE;
        for (ranges, is_up) in [
            (Some(&free), false),
            (Some(&unknown), false),
            (None, false),
            (Some(&unknown), true),
            (Some(&free), false),
            (None, false),
        ] {
            assert_eq!(lost.look(&seen(0.0, ranges)).flag, is_up);
        }
    }

    #[test]
    fn a_step_is_inserted_once_for_each_time_the_situation_comes_up() {
        let mut insert = watches(Situation::Near, 0.5, Reaction::Insert(4));
        let (close, free) = (near(0.3), Ranges::FREE);
        for (ranges, expected) in [
            (&close, Some(4)),
            (&close, None),
            (&free, None),
            (&close, Some(4)),
        ] {
            assert_eq!(insert.look(&seen(0.0, Some(ranges))).insert, expected);
        }
    }
}
