//! The situations that a command has put beside a behaviour.

use super::landmarks::Landmarks;
use super::lookout::{Lookout, Stillness};
use super::situation::Circumstances;
use esm_link::behaviours::{MAX_WATCHES, Reaction, Situation, Watch};

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
    /// The script goes on with this step.
    pub(super) go_on: Option<u8>,
    /// This step takes its place.
    pub(super) replace: Option<u8>,
    /// Those that were not up before, and what is done about them.
    pub(super) came_up: [Option<(Situation, Reaction)>; MAX_WATCHES],
}

#[derive(Clone, Copy, Debug)]
struct Watched {
    lookout: Lookout,
    reaction: Reaction,
    is_up: bool,
}

/// Situations beside one behaviour.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watches {
    watched: [Option<Watched>; MAX_WATCHES],
    stillness: Stillness,
}

impl Watches {
    /// These, of which none has come up.
    pub(super) fn new(watches: [Option<Watch>; MAX_WATCHES]) -> Self {
        let begin = |watch: Watch| Watched {
            lookout: Lookout::new(watch.situation, watch.value),
            reaction: watch.reaction,
            is_up: false,
        };
        Self {
            watched: watches.map(|watch| watch.map(begin)),
            stillness: Stillness::NONE,
        }
    }

    /// Whether one of them is a landmark.
    pub(super) fn has_landmarks(&self) -> bool {
        let mut watched = self.watched.iter().flatten();
        watched.any(|watched| watched.lookout.situation().is_landmark())
    }

    /// What is to be done where the behaviour has failed; by default its script ends.
    pub(super) fn when_failed(&self) -> Reaction {
        let mut watched = self.watched.iter().flatten();
        let of_failed = watched.find(|it| it.lookout.situation() == Situation::Failed);
        of_failed.map_or(Reaction::EndScript, |watched| watched.reaction)
    }

    /// Looks for all of them. Nothing lasts while the behaviour is held by hand.
    pub(super) fn look(
        &mut self,
        seen: &Circumstances<'_>,
        landmarks: &Landmarks,
        is_held: bool,
    ) -> Reactions {
        let moves = self.stillness.moves(seen);
        let mut reactions = Reactions::default();
        let watches = self.watched.iter_mut().zip(&mut reactions.came_up);
        for (watched, came_up) in watches {
            let Some(watched) = watched else { continue };
            let situation = watched.lookout.situation();
            if is_held && situation == Situation::Lasts {
                continue;
            }
            let was_up = watched.is_up;
            watched.is_up = watched.lookout.look(seen, landmarks, moves);
            if !watched.is_up {
                continue;
            }
            if !was_up {
                info!("situation {}", situation.names().0);
                *came_up = Some((situation, watched.reaction));
            }
            match watched.reaction {
                Reaction::Suspend => reactions.suspend = true,
                Reaction::Cancel => reactions.cancel = true,
                Reaction::EndScript => (reactions.cancel, reactions.end_script) = (true, true),
                Reaction::Flag => reactions.flag = true,
                Reaction::Insert(step) if !was_up => reactions.insert = Some(step),
                Reaction::Insert(_) => {}
                Reaction::GoOn(step) => (reactions.cancel, reactions.go_on) = (true, Some(step)),
                Reaction::Replace(step) => {
                    (reactions.cancel, reactions.replace) = (true, Some(step));
                }
            }
        }
        reactions
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tasks::{Pose, Ranges, Twist};

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

    fn seen(x_m: f32, ranges: Option<&Ranges>) -> Circumstances<'_> {
        Circumstances {
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
                Circumstances {
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
            let reactions =
                watches(situation, value, Reaction::Cancel).look(&seen, &Landmarks::NONE, false);
            assert_eq!(reactions.cancel, is_up, "{situation:?} {value} {seen:?}");
        }
    }

    #[test]
    fn a_robot_is_stuck_that_is_to_move_and_has_not_for_so_long() {
        let mut stuck = watches(Situation::Stuck, 0.5, Reaction::Cancel);
        let mut look = |x_m, asked| {
            let seen = Circumstances {
                asked,
                ..seen(x_m, None)
            };
            stuck.look(&seen, &Landmarks::NONE, false).cancel
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
            assert_eq!(
                lost.look(&seen(0.0, ranges), &Landmarks::NONE, false).flag,
                is_up
            );
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
            assert_eq!(
                insert
                    .look(&seen(0.0, Some(ranges)), &Landmarks::NONE, false)
                    .insert,
                expected
            );
        }
    }

    #[test]
    fn what_lasts_for_too_long_is_told_and_time_stands_still_while_it_is_held() {
        let mut lasts = watches(Situation::Lasts, 0.5, Reaction::GoOn(3));
        let mut look = |is_held| {
            lasts
                .look(&seen(0.0, None), &Landmarks::NONE, is_held)
                .go_on
        };
        assert!((0..4).all(|_| look(false).is_none()));
        assert!((0..20).all(|_| look(true).is_none()));
        assert_eq!(look(false), Some(3));
    }

    #[test]
    fn what_follows_a_failure_is_what_is_said_of_it() {
        for (situation, reaction, follows) in [
            (Situation::Failed, Reaction::Cancel, Reaction::Cancel),
            (Situation::Failed, Reaction::GoOn(2), Reaction::GoOn(2)),
            (Situation::Lasts, Reaction::GoOn(2), Reaction::EndScript),
        ] {
            let mut watches = watches(situation, 0.0, reaction);
            assert_eq!(watches.when_failed(), follows);
            let looked = watches.look(&seen(0.0, None), &Landmarks::NONE, false);
            assert_eq!(looked.cancel, situation == Situation::Lasts);
        }
    }
}
