//! Drives through a door opening.

use super::law::{Behaviour, Control, Scene};
use super::list::BehaviourList;
use super::pings::Pings;
use super::situation::SafetyCheck;
use crate::behaviour;
use crate::declaration::Params;
use crate::odometry::Frame;
use crate::tasks::{Bearing, OnTrack, Pose, RIM_M, Ranges, Sector, Twist};

/// The fastest turn, in radians per second.
const TURN_MOST_RAD_PER_S: f32 = 0.8;

/// The widest opening that is a door, in metres.
const WIDEST_M: f32 = 1.4;

/// What both diagonals see comes nearer by this for each metre driven, if it is a wall that the
/// robot looks at: beams of 12° to each side meet it first at 33° to its normal, and 2 / cos 33° is
/// this. Posts, to which the beams look up at 33° to 57°, come nearer by 2 cos 33° = 1.68 at most.
const WALL_COMES_NEARER: f32 = 2.38;
/// Posts are what is together farther than the wall would be by more than this, in metres; six
/// times as much as sonars scatter.
const POSTS_FARTHER_M: f32 = 0.06;
/// Part of an error by which the wall's distance follows what is measured, with each ping: slow, or
/// it would follow the posts.
const WALL_GAIN: f32 = 0.05;
/// What has come nearer as a wall does over this way is one, in metres.
const WALL_LEAST_M: f32 = 0.03;
/// Both ranges together are below this, in metres, where it is looked at the wall.
const WALL_MOST_M: f32 = 4.0;
/// Where the two differ by more than this, in metres, they see different things.
const POSTS_DIFFER_M: f32 = 0.4;
const WALL_DIFFERS_M: f32 = 0.2;
/// A robot that looks by a radian to the left of a wall's normal sees it farther half left than
/// half right, by 1/1.4 of the sum: beams of 12° to each side meet it 33° off the normal, where the
/// range changes by its tangent, and the sonar moves with the rim.
const TURNED_BY_DIFFERENCE_RAD: f32 = 1.4;
/// The most that is believed of it, in radians: the robot stands roughly before its door.
const TURNED_MOST_RAD: f32 = 0.12;
/// Posts are nearer to the rim than this, in metres: those of the widest opening come into the
/// beams there.
const POSTS_M: f32 = 1.1;
/// The squares of the distances to two posts differ by 2 W for each metre that the robot is off the
/// middle of an opening of W, wherever it looks; W is taken to be 0.9 m.
const OFF_BY_SQUARES_PER_M: f32 = 0.55;

/// Part of an error that the diagonals correct with each ping, by the wall and by the posts, and
/// the sides.
const WALL_HEADING_GAIN: f32 = 0.1;
const DIAGONAL_GAIN: f32 = 0.3;
const SIDE_GAIN: f32 = 0.4;

/// Out of the opening the two ranges to the sides are together so much longer than in it, in
/// metres.
const WIDER_M: f32 = 0.2;
/// It ends looking along the axis, to this, in radians, and turns to it so fast, in radians per
/// second.
const ALIGNED_RAD: f32 = 0.02;
const ALIGN_RAD_PER_S: f32 = 0.3;

/// An opening is no deeper than this, in metres: what goes on is a corridor.
const DEEPEST_M: f32 = 1.0;
/// Where the way is not free and the diagonals differ by more than this, in metres, it is a post
/// that is in the way, and nobody who stands in the opening. The opening is on the side that is
/// freer, and its middle so far from the post, in metres; the robot backs off to where it began,
/// and comes anew …
const BESIDE_DIFFER_M: f32 = 0.15;
const POST_TO_MIDDLE_M: f32 = 0.35;
/// … so often.
const MOST_TRIES: u8 = 3;

/// So many looks to both sides show an opening.
const LEAST_LOOKS: u8 = 2;

/// Drives ahead through an opening, in its middle: by the ranges to the posts half ahead, and to
/// the sides.
#[derive(Clone, Copy, Debug, Default)]
pub struct PassDoorLaw {
    pings: Pings,
    /// Where the robot is, seen along the axis of the opening, from where the behaviour began.
    here: Frame,
    last: Option<Pose>,
    /// By how much the heading was corrected, in radians.
    corrected_rad: f32,
    /// Way in the last step, in metres.
    step_m: f32,
    ahead: Ahead,
    opening: Opening,
    is_beyond: bool,
    /// It backs off from a post.
    backs_off: bool,
    /// How often it has done so.
    tries: u8,
}

behaviour! {
    /// Behaviour: drives through a door opening ahead, and ends beyond it.
    impl PassDoor runs PassDoorLaw {
        wcet 400 us;
        params {
            /// How fast, in metres per second.
            speed_m_per_s: f32 = 0.15, 0.05..=0.3;
            /// The opening is no farther ahead than this, in metres.
            within_m: f32 = 2.0, 0.1..=10.0;
            /// How far behind the opening's middle to end, in metres.
            beyond_m: f32 = 0.5, 0.2..=3.0;
        }
    }
}

/// What has been seen of the opening at the sides.
#[derive(Clone, Copy, Debug, Default)]
struct Opening {
    /// Where the robot was first and last between the posts, along the axis.
    between_m: Option<(f32, f32)>,
    /// The least sum of the ranges to both sides, in metres.
    least_m: f32,
    looks: u8,
    is_passed: bool,
}

/// What the diagonals see.
#[derive(Clone, Copy, Debug, Default)]
enum Ahead {
    /// Nothing that is known.
    #[default]
    Unknown,
    /// The wall beside the opening.
    Wall {
        /// The sum of the ranges to it, and where the robot was along the axis, in metres.
        sum_m: f32,
        along_m: f32,
        /// Where it was seen first.
        from_m: f32,
    },
    /// The posts of the opening.
    Posts,
}

impl Ahead {
    /// After a look at the sum of both ranges from a place along the axis. What the robot turns
    /// cancels out in the sum.
    fn after(self, seen_m: f32, at_m: f32) -> Self {
        match self {
            Self::Posts => self,
            Self::Unknown if seen_m < WALL_MOST_M => Self::Wall {
                sum_m: seen_m,
                along_m: at_m,
                from_m: at_m,
            },
            Self::Unknown => self,
            Self::Wall {
                sum_m,
                along_m,
                from_m,
            } => {
                let expected_m = sum_m - WALL_COMES_NEARER * (at_m - along_m);
                let error_m = seen_m - expected_m;
                if error_m > POSTS_FARTHER_M && seen_m < 2.0 * POSTS_M {
                    Self::Posts
                } else if error_m.abs() > POSTS_FARTHER_M {
                    Self::Unknown
                } else {
                    Self::Wall {
                        sum_m: expected_m + error_m * WALL_GAIN,
                        along_m: at_m,
                        from_m,
                    }
                }
            }
        }
    }
}

impl Opening {
    /// Looks to both sides from a place along the axis. Returns whether posts are there.
    fn look(&mut self, along_m: f32, left_m: f32, right_m: f32) -> bool {
        let sum_m = left_m + right_m;
        let is_narrow = sum_m + 2.0 * RIM_M < WIDEST_M;
        match &mut self.between_m {
            None if is_narrow => {
                (self.between_m, self.least_m, self.looks) = (Some((along_m, along_m)), sum_m, 1);
                true
            }
            None => false,
            Some(_) if self.is_passed => false,
            Some((_, last_m)) if is_narrow && sum_m < self.least_m + WIDER_M => {
                *last_m = along_m;
                self.least_m = self.least_m.min(sum_m);
                self.looks = self.looks.saturating_add(1);
                true
            }
            Some(_) => {
                if self.looks < LEAST_LOOKS {
                    self.between_m = None;
                } else {
                    self.is_passed = true;
                }
                false
            }
        }
    }

    /// Where its middle is along the axis, once the robot is through.
    fn middle_m(&self) -> Option<f32> {
        let (first_m, last_m) = self.between_m.filter(|_| self.is_passed)?;
        Some((first_m + last_m) / 2.0)
    }
}

impl PassDoorLaw {
    /// How far to the left of a wall's normal the robot looks, by the ranges of its diagonals to
    /// that wall, in radians; none where they do not see one wall.
    pub fn turned_by_wall_rad(left_m: f32, right_m: f32) -> Option<f32> {
        let difference_m = left_m - right_m;
        (difference_m.abs() < WALL_DIFFERS_M)
            .then(|| TURNED_BY_DIFFERENCE_RAD * difference_m / (left_m + right_m))
    }

    /// How far to the left of the middle between two posts the robot is, by the ranges of its
    /// diagonals to them, in metres; none where they do not see both.
    pub fn off_by_posts_m(left_m: f32, right_m: f32) -> Option<f32> {
        let sees_both = left_m.max(right_m) < POSTS_M && (left_m - right_m).abs() < POSTS_DIFFER_M;
        let square_m2 = |range_m: f32| (range_m + RIM_M) * (range_m + RIM_M);
        sees_both.then(|| (square_m2(right_m) - square_m2(left_m)) * OFF_BY_SQUARES_PER_M)
    }

    fn look(&mut self, scene: &Scene<'_>) {
        let Some(ranges) = scene.ranges else {
            return;
        };
        let [mut ahead_left, mut ahead_right, mut left, mut right] = [None; 4];
        for ping in self.pings.fresh(ranges, scene.period_us) {
            let place = match ping.bearing {
                Bearing::AheadLeft => &mut ahead_left,
                Bearing::AheadRight => &mut ahead_right,
                Bearing::Left => &mut left,
                Bearing::Right => &mut right,
                _ => continue,
            };
            *place = Some(ping);
        }
        let live = ranges.live();
        // One side that is lost is as far as it would be from where the robot believes to be.
        let farther_right_m = 2.0 * self.here.y_m;
        let sides = match (left, right) {
            (Some(left), Some(right)) => Some((left.age_us, left.range_m, right.range_m)),
            (Some(left), None) if !live.has(Bearing::Right) => {
                Some((left.age_us, left.range_m, left.range_m + farther_right_m))
            }
            (None, Some(right)) if !live.has(Bearing::Left) => {
                Some((right.age_us, right.range_m - farther_right_m, right.range_m))
            }
            _ => None,
        };
        if let Some((age_us, left_m, right_m)) = sides {
            let periods = age_us as f32 / scene.period_us as f32;
            let along_m = self.here.x_m - self.step_m * periods;
            if self.opening.look(along_m, left_m, right_m) {
                let off_m = (right_m - left_m) / 2.0;
                self.here.y_m += (off_m - self.here.y_m) * SIDE_GAIN;
            }
        }
        if self.opening.between_m.is_none()
            && !self.backs_off
            && let (Some(left), Some(right)) = (ahead_left, ahead_right)
        {
            self.correct_by_diagonals(left.range_m, right.range_m);
        }
    }

    /// How to move towards the opening, or back from a post of it that is in the way.
    fn twist(&mut self, speed_m_per_s: f32, ranges: Option<&Ranges>) -> Control {
        let twist = |here: &Frame, is_backwards: bool| {
            let place = OnTrack {
                along_m: here.x_m,
                left_m: here.y_m,
                turned_rad: here.heading_rad,
            };
            let turn_rad_per_s = place.back_on_rad_per_s(is_backwards);
            Twist {
                forward_m_per_s: if is_backwards {
                    -speed_m_per_s
                } else {
                    speed_m_per_s
                },
                turn_rad_per_s: turn_rad_per_s.clamp(-TURN_MOST_RAD_PER_S, TURN_MOST_RAD_PER_S),
            }
        };
        let ahead = twist(&self.here, false);
        let is_blocked = || {
            let is_before = self.opening.between_m.is_none() && self.tries < MOST_TRIES;
            is_before && !SafetyCheck::is_free(&ahead, ranges)
        };
        if self.backs_off {
            self.backs_off = self.here.x_m > 0.0;
            // From there the diagonals see the wall again.
            self.ahead = Ahead::Unknown;
        } else if let Some(ranges) = ranges.filter(|ranges| ranges.free_range(Sector::Front) > 0.0)
            && is_blocked()
        {
            let freer_left_m = ranges.ahead_left_m() - ranges.ahead_right_m();
            if freer_left_m.abs() > BESIDE_DIFFER_M {
                self.here.y_m = -POST_TO_MIDDLE_M.copysign(freer_left_m);
                (self.backs_off, self.tries) = (true, self.tries + 1);
            }
        }
        Control::Move(if self.backs_off {
            twist(&self.here, true)
        } else {
            ahead
        })
    }

    fn correct_by_diagonals(&mut self, left_m: f32, right_m: f32) {
        let here = &mut self.here;
        self.ahead = self.ahead.after(left_m + right_m, here.x_m);
        match self.ahead {
            Ahead::Unknown => {}
            Ahead::Wall {
                along_m, from_m, ..
            } => {
                if along_m - from_m < WALL_LEAST_M {
                    return;
                }
                let Some(turned_rad) = Self::turned_by_wall_rad(left_m, right_m) else {
                    return;
                };
                let wrong_rad = (turned_rad - here.heading_rad) * WALL_HEADING_GAIN;
                let before_rad = self.corrected_rad;
                self.corrected_rad =
                    (before_rad + wrong_rad).clamp(-TURNED_MOST_RAD, TURNED_MOST_RAD);
                here.heading_rad += self.corrected_rad - before_rad;
            }
            Ahead::Posts => {
                if let Some(off_m) = Self::off_by_posts_m(left_m, right_m) {
                    here.y_m += (off_m - here.y_m) * DIAGONAL_GAIN;
                }
            }
        }
    }
}

impl Behaviour for PassDoorLaw {
    fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control {
        let pose = scene.pose();
        match self.last.replace(pose) {
            None => self.here = pose,
            Some(last) => {
                let moved = last.to_local(pose);
                (self.here, self.step_m) = (self.here.compose(moved), moved.x_m);
            }
        }
        self.look(scene);
        let middle_m = self.opening.middle_m();
        let end_m = middle_m.map(|middle_m| middle_m + params.get(PassDoor::BEYOND_M));
        self.is_beyond |= end_m.is_some_and(|end_m| self.here.x_m >= end_m);
        if self.is_beyond {
            let turned_rad = self.here.heading_rad;
            return if turned_rad.abs() < ALIGNED_RAD {
                Control::Done
            } else {
                Control::Move(Twist {
                    forward_m_per_s: 0.0,
                    turn_rad_per_s: ALIGN_RAD_PER_S.copysign(-turned_rad),
                })
            };
        }
        let begins_by_m = match self.opening.between_m {
            Some((first_m, _)) => first_m + DEEPEST_M,
            None => params.get(PassDoor::WITHIN_M),
        };
        if middle_m.is_none() && self.here.x_m > begins_by_m {
            return Control::Failed;
        }
        self.twist(params.get(PassDoor::SPEED_M_PER_S), scene.ranges)
    }
}
