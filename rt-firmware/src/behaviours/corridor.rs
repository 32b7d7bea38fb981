//! An observer of where the robot is in a corridor.
//!
//! Between two pings odometry carries the estimate on; each ping of a sonar that looks at a wall
//! corrects it. Where no corridor is known yet, directions are tried out until both walls are where
//! all sonars see them.

use super::beams::{Heading, Part, Side, looks_at};
use super::pings::Ping;
use crate::odometry::{Frame, is_beyond, is_within, wrapped_rad};
use crate::tasks::{Bearing, Bearings, OnTrack, Pose, Ranges};

/// A wall that is this far from where it was expected is none, in metres: an opening, or something
/// before it.
const GATE_M: f32 = 0.15;

/// A robot that looks off the corridor's direction by more than this, in radians, hears the post of
/// an opening beside it as a wall that is a little farther …
const TURNED_RAD: f32 = 0.1;
/// … by more than this, in metres: then nobody knows which of the two it is …
const POST_M: f32 = 0.04;
/// … or by this, beside an opening on the other side: nothing contradicts a post there, a robot
/// that believes it turns towards it, and then hears it farther still.
const POST_BESIDE_OPENING_M: f32 = 0.02;
/// The edge of an opening is where a wall ends that was seen at right angles, to this, in radians.
const ALONG_RAD: f32 = 0.06;

/// Part of the offset's error that a ping to the side corrects, if both sides see their walls.
const OFFSET_GAIN: f32 = 0.25;
/// Part of the width's error.
const WIDTH_GAIN: f32 = 0.1;
/// How far a ping half ahead or behind turns the estimate, in radians for each metre by which the
/// wall is off, and each metre from the wall: an error of the heading shows as 0.7 times that.
const HEADING_GAIN: f32 = 0.15;
/// No more than this counts of the error of such a ping, in metres: before an opening the beam
/// meets its post, which is a little farther than the wall was expected. Beside one it does not
/// count at all.
const HEADING_MOST_M: f32 = 0.02;

/// Directions that are tried out: 3° apart, up to 45° to each side of the direction
/// that the robot believes in.
const TRIED: u8 = 31;
const TRIED_FIRST_RAD: f32 = -core::f32::consts::FRAC_PI_4;
const TRIED_STEP_RAD: f32 = 0.052_36;
/// A sonar costs a direction no more than this, in metres: it may see an opening.
const MOST_COST_M: f32 = 0.15;
/// What a direction costs for each radian off the axis, in metres, and for each metre between the
/// walls: of two that explain the same, the robot believes in the one that it was told, and in
/// walls rather than in what is behind their openings.
const TURNED_COST_M_PER_RAD: f32 = 0.1;
const WIDTH_COST: f32 = 0.1;
/// Sonars that agree on a wall differ by no more than this from the middle one, in metres.
const AGREED_M: f32 = 0.05;
/// The narrowest and widest corridor, in metres.
const LEAST_WIDTH_M: f32 = 0.6;
const MOST_WIDTH_M: f32 = 3.2;

/// The robot searches anew where one wall was not seen for so far, in metres, which is more than an
/// opening is wide …
const LOST_M: f32 = 1.8;
/// … or where something else was before it for so far: more than a person.
const HIDDEN_M: f32 = 0.9;

/// Trust in the walls is the part of the pings that have hit them: each counts for so much of it.
const TRUST_GAIN: f32 = 0.03;
/// With less trust than this it searches anew, and does not believe in its direction either …
const LEAST_TRUST: f32 = 0.3;
/// … unless it has followed these walls for so far, in metres: then they are walls, and what is
/// open there are doors, perhaps one on each side.
const PROVEN_M: f32 = 2.0;

/// Where a wall is: the median of what the sonars say that look to it, what they cost, how many
/// there are, and how many agree.
#[derive(Clone, Copy, Debug, Default)]
struct Fit {
    distance_m: f32,
    cost_m: f32,
    sonars: u8,
    agreed: u8,
}

impl Fit {
    /// What sonars that look to a side say of its wall, with this heading.
    fn of(side: Side, heading: Heading, ranges: &Ranges) -> Self {
        let [ahead, beside, behind] = match side {
            Side::Left => [Bearing::AheadLeft, Bearing::Left, Bearing::BehindLeft],
            Side::Right => [Bearing::AheadRight, Bearing::Right, Bearing::BehindRight],
        };
        // Where no sonar looks it is far, and not known.
        let looks = [ahead, beside, behind].map(|bearing| ranges.seen_m(bearing));
        let parts = [Part::Ahead, Part::Beside, Part::Behind];
        let mut seen = [None; 3];
        for ((seen, look), part) in seen.iter_mut().zip(looks).zip(parts) {
            // Who sees nothing agrees with nobody.
            let is_known =
                |range_m: &f32| is_beyond(*range_m, 0.0) && is_within(*range_m, Ranges::FAR_M);
            *seen = (look.filter(is_known)).map(|range_m| heading.wall_m(side, part, range_m));
        }
        let distance_m = match seen {
            [Some(a), Some(b), Some(c)] => a.min(b).max(a.max(b).min(c)),
            [Some(a), Some(b), None] | [Some(a), None, Some(b)] | [None, Some(a), Some(b)] => {
                (a + b) / 2.0
            }
            // One alone says nothing of the direction.
            _ => MOST_WIDTH_M,
        };
        let mut fit = Self {
            distance_m,
            ..Self::default()
        };
        for (look, wall_m) in looks.into_iter().zip(seen) {
            let off_m = wall_m.map_or(MOST_COST_M, |wall_m| (wall_m - distance_m).abs());
            fit.cost_m += off_m.min(MOST_COST_M);
            fit.sonars += u8::from(look.is_some());
            fit.agreed += u8::from(is_within(off_m, AGREED_M));
        }
        fit
    }
}

/// The search for a corridor: one direction in each step.
#[derive(Clone, Copy, Debug, Default)]
struct Search {
    tried: u8,
    /// The direction that the robot believes in, in the local frame.
    believed_rad: f32,
    best: Option<Candidate>,
}

/// A direction that a corridor may have.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    /// In the local frame.
    axis_rad: f32,
    cost_m: f32,
    left: Fit,
    right: Fit,
}

impl Search {
    /// Tries the next direction. Returns the best one when all are tried.
    fn step(&mut self, pose: &Pose, believed_rad: f32, ranges: &Ranges) -> Option<Candidate> {
        if self.tried == 0 {
            self.believed_rad = believed_rad;
        }
        let off_rad = TRIED_FIRST_RAD + TRIED_STEP_RAD * f32::from(self.tried);
        let axis_rad = self.believed_rad + off_rad;
        let heading = Heading::new(pose.heading_rad - axis_rad);
        let left = Fit::of(Side::Left, heading, ranges);
        let right = Fit::of(Side::Right, heading, ranges);
        let candidate = Candidate {
            axis_rad,
            cost_m: left.cost_m
                + right.cost_m
                + TURNED_COST_M_PER_RAD * off_rad.abs()
                + WIDTH_COST * (left.distance_m + right.distance_m),
            left,
            right,
        };
        if self.best.is_none_or(|best| candidate.cost_m < best.cost_m) {
            self.best = Some(candidate);
        }
        self.tried += 1;
        if self.tried < TRIED {
            return None;
        }
        self.tried = 0;
        self.best.take()
    }
}

impl Candidate {
    /// The distance between the walls, in metres, if both are seen: two sonars or more agree on
    /// each, and all but one of all that look to the sides. Where it was found before, from
    /// elsewhere, two on each are enough.
    fn width_m(&self, before: Option<&Self>) -> Option<f32> {
        let Self { left, right, .. } = self;
        let width_m = left.distance_m + right.distance_m;
        let agreed = left.agreed + right.agreed;
        let is_likely =
            left.agreed.min(right.agreed) >= 2 && (LEAST_WIDTH_M..=MOST_WIDTH_M).contains(&width_m);
        let is_sure = agreed + 1 >= left.sonars + right.sonars
            || before.is_some_and(|before| before.agrees_with(self));
        (is_likely && is_sure).then_some(width_m)
    }

    /// Whether two searches have found the same, but for what a robot turns meanwhile.
    fn agrees_with(&self, other: &Self) -> bool {
        let width_m = |candidate: &Self| candidate.left.distance_m + candidate.right.distance_m;
        (self.axis_rad - other.axis_rad).abs() < 1.5 * TRIED_STEP_RAD
            && (width_m(self) - width_m(other)).abs() < AGREED_M
    }
}

/// What is known of a corridor's direction.
#[derive(Clone, Copy, Debug, Default)]
enum Axis {
    /// Nothing.
    #[default]
    Unknown,
    /// Of all that were tried out this one was the best, though not good.
    Guessed(Candidate),
    /// Both walls were seen.
    Known,
}

/// What the robot knows of a corridor.
///
/// Seen along it: x from where the behaviour began, y to the left of its middle.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Corridor {
    here: Frame,
    /// From wall to wall, in metres; none where they are not known.
    width_m: Option<f32>,
    /// The pose of the last step, in the local frame; none before the first.
    last: Option<Pose>,
    search: Search,
    axis: Axis,
    left: Unseen,
    right: Unseen,
    trust: f32,
    /// Way since the walls were found, in metres.
    followed_m: f32,
    /// Way in the last step, in metres.
    step_m: f32,
}

/// How far a wall was not seen.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Unseen {
    /// Way since a ping to the side saw it, in metres.
    way_m: f32,
    /// Way since a ping to the side did not see something before it, in metres.
    hidden_m: f32,
    /// The last ping to the side saw something else.
    is_away: bool,
    /// It saw what is behind the wall.
    is_open: bool,
}

impl Unseen {
    /// It was seen just now.
    pub(super) const NOT: Self = Self {
        way_m: 0.0,
        hidden_m: 0.0,
        is_away: false,
        is_open: false,
    };

    /// Goes on by so far, with what a ping saw meanwhile.
    pub(super) fn go_on(&mut self, way_m: f32, look: Option<Look>) {
        self.way_m += way_m;
        self.hidden_m += way_m;
        self.is_away = look.map_or(self.is_away, |look| look.seen != Seen::Wall);
        self.is_open = look.map_or(self.is_open, |look| look.seen == Seen::Beyond);
        match look.map(|look| look.seen) {
            None | Some(Seen::Before) => {}
            Some(Seen::Beyond | Seen::Unsure) => self.hidden_m = 0.0,
            Some(Seen::Wall) => *self = Self::default(),
        }
    }

    /// How far it was not seen, in metres.
    pub(super) fn way_m(&self) -> f32 {
        self.way_m
    }

    /// It was not seen for so far that it is not there any more.
    pub(super) fn is_lost(&self) -> bool {
        self.way_m > LOST_M || self.hidden_m > HIDDEN_M
    }
}

/// What the diagonals of a side see whose sonar at a right angle is lost.
#[derive(Clone, Copy, Debug, Default)]
struct StandIn {
    /// The wall, if one of them sees it.
    best: Option<Look>,
    /// One of them sees something else.
    is_away: bool,
}

impl StandIn {
    fn take(&mut self, look: Look) {
        let is_wall = look.seen == Seen::Wall;
        if is_wall || self.best.is_none() {
            self.best = Some(look);
        }
        self.is_away |= !is_wall;
    }
}

/// What a ping to the side hit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Seen {
    /// The wall.
    Wall,
    /// Something behind it: it is open there.
    Beyond,
    /// Something before it.
    Before,
    /// The wall, or a post of an opening in it.
    Unsure,
}

impl Seen {
    /// What is farther than the wall by so much, heard by a sonar that may hear posts, from so much
    /// on.
    pub(super) fn of(error_m: f32, post_m: Option<f32>) -> Self {
        let is_nearer = error_m.is_sign_negative();
        if is_beyond(error_m, GATE_M) {
            if is_nearer {
                Self::Before
            } else {
                Self::Beyond
            }
        } else if !is_nearer && post_m.is_some_and(|post_m| is_beyond(error_m, post_m)) {
            Self::Unsure
        } else {
            Self::Wall
        }
    }
}

/// A look to the side.
#[derive(Clone, Copy, Debug)]
pub(super) struct Look {
    pub seen: Seen,
    /// Where the robot was along the corridor, in metres.
    pub along_m: f32,
    /// How far the wall is from the robot's centre, in metres.
    pub wall_m: f32,
    /// The robot looked along the corridor, so that a wall is no post.
    pub is_along: bool,
    /// By how much what was hit is farther, in metres.
    error_m: f32,
}

impl Look {
    /// A look at something that is where this says.
    pub fn new(seen: Seen, along_m: f32, wall_m: f32) -> Self {
        Self {
            seen,
            along_m,
            wall_m,
            is_along: true,
            error_m: 0.0,
        }
    }
}

impl Corridor {
    /// Where the robot is in it.
    pub fn place(&self) -> OnTrack {
        OnTrack {
            along_m: self.here.x_m,
            left_m: if self.is_known() { self.here.y_m } else { 0.0 },
            turned_rad: self.here.heading_rad,
        }
    }

    /// Whether both walls are known.
    pub fn is_known(&self) -> bool {
        self.width_m.is_some()
    }

    /// Whether its direction is known, or guessed.
    pub fn has_axis(&self) -> bool {
        !matches!(self.axis, Axis::Unknown)
    }

    /// Distance from the robot's centre to the wall on a side, in metres.
    pub fn wall_m(&self, side: Side) -> Option<f32> {
        let half_m = self.width_m? / 2.0;
        Some(match side {
            Side::Left => half_m - self.here.y_m,
            Side::Right => half_m + self.here.y_m,
        })
    }

    /// Carries the estimate on to a new pose.
    pub fn go_on(&mut self, pose: &Pose) {
        let Some(last) = self.last.replace(*pose) else {
            self.here.heading_rad = pose.heading_rad;
            return;
        };
        let moved = last.to_local(*pose);
        self.here = self.here.compose(moved);
        self.step_m = moved.x_m;
    }

    /// Goes on with the search for walls, where they are not known.
    pub fn search(&mut self, pose: &Pose, ranges: &Ranges) {
        let believed_rad = match self.axis {
            Axis::Known => pose.heading_rad - self.here.heading_rad,
            Axis::Unknown | Axis::Guessed(_) => 0.0,
        };
        let Some(found) = self.search.step(pose, believed_rad, ranges) else {
            return;
        };
        let before = match &self.axis {
            Axis::Guessed(before) => Some(before),
            Axis::Known | Axis::Unknown => None,
        };
        self.width_m = found.width_m(before);
        let is_better = match (self.width_m, &self.axis) {
            (Some(_), _) | (None, Axis::Unknown) => true,
            (None, Axis::Guessed(before)) => found.cost_m < before.cost_m,
            // Odometry is better than a guess.
            (None, Axis::Known) => false,
        };
        if is_better {
            self.here.heading_rad = wrapped_rad(pose.heading_rad - found.axis_rad);
            self.here.y_m = (found.right.distance_m - found.left.distance_m) / 2.0;
            self.axis = Axis::Guessed(found);
        }
        if self.width_m.is_some() {
            self.axis = Axis::Known;
            (self.left, self.right) = (Unseen::default(), Unseen::default());
            (self.trust, self.followed_m) = (1.0, 0.0);
        }
    }

    /// Corrects the estimate by new pings, where the walls are known. Returns what those to the
    /// left and to the right saw. Where a sonar at a right angle is not live, the diagonals of its
    /// side show that the wall is still there.
    pub fn correct(
        &mut self,
        pings: impl Iterator<Item = Ping>,
        live: Bearings,
        period_us: u32,
    ) -> [Option<Look>; 2] {
        let heading = Heading::new(self.here.heading_rad);
        let (mut left, mut right) = (None, None);
        let (mut left_wall, mut right_wall) = (StandIn::default(), StandIn::default());
        // Where only one side sees its wall, nothing contradicts a post.
        let is_blind = !(live.has(Bearing::Left) && live.has(Bearing::Right));
        let is_open = [self.right.is_open, self.left.is_open];
        let hears_posts = is_blind || is_beyond(self.here.heading_rad, TURNED_RAD);
        let post_m = is_open.map(|other_is_open| match (other_is_open, hears_posts) {
            (true, _) => Some(POST_BESIDE_OPENING_M),
            (false, true) => Some(POST_M),
            (false, false) => None,
        });
        let mut turn_rad = 0.0;
        for ping in pings {
            let Some((side, part)) = looks_at(ping.bearing) else {
                continue;
            };
            let Some(wall_m) = self.wall_m(side) else {
                continue;
            };
            let error_m = heading.wall_m(side, part, ping.range_m) - wall_m;
            let is_wall = Seen::of(error_m, None) == Seen::Wall;
            self.trust += (f32::from(u8::from(is_wall)) - self.trust) * TRUST_GAIN;
            let [left_post_m, right_post_m] = post_m;
            let (beside, look, stand_in, post_m) = match side {
                Side::Left => (Bearing::Left, &mut left, &mut left_wall, left_post_m),
                Side::Right => (Bearing::Right, &mut right, &mut right_wall, right_post_m),
            };
            // Of most pings half ahead or behind nobody asks for this, and it takes a division.
            let seen = || Look {
                seen: Seen::of(error_m, post_m.filter(|_| part == Part::Beside)),
                along_m: self.here.x_m - self.step_m * (ping.age_us as f32 / period_us as f32),
                wall_m,
                is_along: is_within(self.here.heading_rad, ALONG_RAD),
                error_m,
            };
            if part == Part::Beside {
                *look = Some(seen());
                continue;
            }
            // It may be open beside the robot as soon as one of them does not see the wall.
            if !live.has(beside) {
                stand_in.take(seen());
            }
            if is_wall && !self.unseen(side).is_away {
                let error_m = error_m.clamp(-HEADING_MOST_M, HEADING_MOST_M);
                let turned_rad = HEADING_GAIN * error_m / wall_m.max(LEAST_WIDTH_M / 2.0);
                turn_rad += match (side, part) {
                    (Side::Left, Part::Ahead) | (Side::Right, Part::Behind) => -turned_rad,
                    _ => turned_rad,
                };
            }
        }
        self.here.heading_rad = wrapped_rad(self.here.heading_rad + turn_rad);
        let gain = if is_blind || is_open.contains(&true) {
            OFFSET_GAIN / 2.0
        } else {
            OFFSET_GAIN
        };
        self.correct_offset(left, right, gain);
        let way_m = self.step_m.abs();
        self.left.go_on(way_m, left.or(left_wall.best));
        self.right.go_on(way_m, right.or(right_wall.best));
        self.left.is_away |= left_wall.is_away;
        self.right.is_away |= right_wall.is_away;
        if self.left.is_lost() || self.right.is_lost() {
            // It keeps its direction until it has found another.
            (self.width_m, self.search) = (None, Search::default());
        }
        self.followed_m += way_m;
        if self.trust < LEAST_TRUST && self.followed_m < PROVEN_M {
            (self.width_m, self.search) = (None, Search::default());
            self.axis = Axis::Unknown;
        }
        [left, right]
    }

    fn unseen(&self, side: Side) -> &Unseen {
        match side {
            Side::Left => &self.left,
            Side::Right => &self.right,
        }
    }

    fn correct_offset(&mut self, left: Option<Look>, right: Option<Look>, gain: f32) {
        let error_m = |look: Option<Look>| {
            look.filter(|look| look.seen == Seen::Wall)
                .map(|look| look.error_m)
        };
        let offset_m = match (error_m(left), error_m(right)) {
            (Some(left_m), Some(right_m)) => {
                let wider_m = WIDTH_GAIN * (left_m + right_m);
                self.width_m = self.width_m.map(|width_m| width_m + wider_m);
                (right_m - left_m) / 2.0
            }
            (Some(left_m), None) => -left_m,
            (None, Some(right_m)) => right_m,
            (None, None) => return,
        };
        self.here.y_m += gain * offset_m;
    }
}
