//! Landmarks that the robot drives past: door openings and corners, from what its sonars hear over
//! the way.
//!
//! Each side has a wall, which is where several pings in a row agree. What is farther than that is
//! open; [`Openings`] says which of it is a door. A wall ahead is where the sonar ahead and one
//! half ahead agree, and with a wall to a side it makes a corner.
//!
//! Source: Schoute, "Behaviour-based control framework for an autonomous mobile robot", section
//! 3.2, `LANDMARK`.

use super::beams::{Heading, Part, Side, looks_at};
use super::corridor::{Look, Seen, Unseen};
use super::openings::Openings;
use super::pings::{Ping, Pings};
use crate::odometry::{Frame, wrapped_rad};
use crate::tasks::{Bearing, Pose, RIM_M, Ranges};

/// A wall that the robot drives along is no farther than this from its centre, in metres.
const MOST_WALL_M: f32 = 2.0;
/// Pings in a row that differ by no more than this, in metres, and go on for so far, are a wall:
/// the beam's own width hides less.
const AGREED_M: f32 = 0.05;
const AGREED_WAY_M: f32 = 0.1;
/// Part by which each ping corrects the distance of the wall, and the direction along it.
const WALL_GAIN: f32 = 0.3;
const HEADING_GAIN: f32 = 0.1;
/// A robot that has turned by more than this off the direction in which it drove along a wall, in
/// radians, does not know it any more …
const TURNED_RAD: f32 = 0.35;
/// … and by more than this it does not see where an opening begins.
const ALONG_RAD: f32 = 0.1;
/// Who moves by more than this within this time, in metres and in microseconds, was put somewhere
/// else.
const LEAP_M: f32 = 0.1;
const LEAP_US: u32 = 100_000;

/// The sonar ahead and one half ahead agree on a wall to this, in metres: 0.2 rad off its normal.
const AHEAD_M: f32 = 0.1;
/// So many pings in a row must have seen a wall ahead.
const AHEAD_PINGS: u8 = 3;
/// The wall beside a corner was seen no longer ago than this, in metres.
const BESIDE_WAY_M: f32 = 0.3;

/// Where activations are no farther apart than this, in microseconds, each does one thing.
const SHORT_US: u32 = 10_000;
/// Places of what waits.
const LEFT: usize = 0;
const RIGHT: usize = 1;
const AHEAD: usize = 2;

/// What is beside the way on one side.
#[derive(Clone, Copy, Debug)]
struct Flank {
    /// Distance of the wall from the robot's centre, in metres; none where there is none.
    wall_m: Option<f32>,
    /// The heading along it, in radians.
    heading_rad: f32,
    /// What was heard last where there is no wall: how far away, and since where along the way.
    heard: Option<(f32, f32)>,
    unseen: Unseen,
    openings: Openings,
    /// Width of the door that has ended in this look, in metres.
    door_m: Option<f32>,
}

impl Flank {
    /// Nothing was heard.
    const NONE: Self = Self {
        wall_m: None,
        heading_rad: 0.0,
        heard: None,
        unseen: Unseen::NOT,
        openings: Openings::NONE,
        door_m: None,
    };

    /// Goes on by so far, and forgets the wall where the robot has turned off its direction.
    fn go_on(&mut self, way_m: f32, heading_rad: f32) {
        self.door_m = None;
        self.unseen.go_on(way_m.abs(), None);
        if wrapped_rad(heading_rad - self.heading_rad).abs() > TURNED_RAD {
            *self = Self {
                heading_rad,
                ..Self::NONE
            };
        }
    }

    /// Takes a ping that hit something so far from the robot's centre, at a place along the way.
    fn hear(&mut self, distance_m: f32, along_m: f32, heading_rad: f32) {
        let Some(wall_m) = self.wall_m else {
            self.find(distance_m, along_m, heading_rad);
            return;
        };
        let off_rad = wrapped_rad(heading_rad - self.heading_rad);
        let seen = Seen::of(distance_m - wall_m, None);
        let mut look = Look::new(seen, along_m, wall_m);
        look.is_along = off_rad.abs() < ALONG_RAD;
        let door = self.openings.look(&look);
        self.door_m = door.map(|door| door.width_m);
        self.unseen.go_on(0.0, Some(look));
        if look.seen == Seen::Wall {
            self.wall_m = Some(wall_m + WALL_GAIN * (distance_m - wall_m));
            self.heading_rad = wrapped_rad(self.heading_rad + HEADING_GAIN * off_rad);
        } else if self.unseen.is_lost() {
            *self = Self {
                heading_rad,
                ..Self::NONE
            };
        }
    }

    /// Looks for a wall where there is none.
    fn find(&mut self, distance_m: f32, along_m: f32, heading_rad: f32) {
        let from_m = match self.heard {
            Some((heard_m, from_m)) if (distance_m - heard_m).abs() < AGREED_M => from_m,
            _ => along_m,
        };
        self.heard = Some((distance_m, from_m));
        self.heading_rad = heading_rad;
        if distance_m <= MOST_WALL_M && (along_m - from_m).abs() >= AGREED_WAY_M {
            *self = Self {
                wall_m: Some(distance_m),
                heading_rad,
                ..Self::NONE
            };
        }
    }

    /// Distance of the wall, if it is beside the robot.
    fn beside_m(&self) -> Option<f32> {
        (self.wall_m).filter(|_| self.unseen.way_m() <= BESIDE_WAY_M)
    }
}

/// What the robot has driven past, and what is ahead of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Landmarks {
    pings: Pings,
    /// What was heard last to the left, to the right and ahead, and was not looked at yet. So that
    /// no activation has all to do, each does one thing: hear what is new, go on to where the robot
    /// is, look at what one sonar has heard.
    waiting: [Option<Ping>; 3],
    /// Where the robot was when it was looked at last, and how long ago that is, in microseconds.
    last: Option<Pose>,
    since_us: u32,
    /// It was looked at since what waits was heard.
    has_gone_on: bool,
    /// How fast it was until then, in metres a microsecond.
    m_per_us: f32,
    /// Way so far, in metres, backwards less.
    along_m: f32,
    left: Flank,
    right: Flank,
    /// Range of the wall ahead that was seen last, in metres, and how many pings in a row have seen
    /// one.
    ahead_m: f32,
    ahead_pings: u8,
}

impl Landmarks {
    /// Nothing was seen.
    pub(super) const NONE: Self = Self {
        pings: Pings::NONE,
        waiting: [None; 3],
        last: None,
        since_us: 0,
        has_gone_on: false,
        m_per_us: 0.0,
        along_m: 0.0,
        left: Flank::NONE,
        right: Flank::NONE,
        ahead_m: 0.0,
        ahead_pings: 0,
    };

    /// Looks around, once in each activation.
    /// Where others have much to do in this one, it only listens.
    pub(super) fn look(
        &mut self,
        pose: Option<&Pose>,
        ranges: Option<&Ranges>,
        period_us: u32,
        is_busy: bool,
    ) {
        let (Some(pose), Some(ranges)) = (pose, ranges) else {
            (self.left.door_m, self.right.door_m) = (None, None);
            return;
        };
        self.since_us = self.since_us.saturating_add(period_us);
        for ping in self.waiting.iter_mut().flatten() {
            ping.age_us = ping.age_us.saturating_add(period_us);
        }
        let mut is_any_new = false;
        for ping in self.pings.fresh(ranges, period_us) {
            is_any_new = true;
            let place = match looks_at(ping.bearing) {
                Some((Side::Left, Part::Beside)) => LEFT,
                Some((Side::Right, Part::Beside)) => RIGHT,
                None if ping.bearing == Bearing::Ahead => AHEAD,
                _ => continue,
            };
            if let Some(waiting) = self.waiting.get_mut(place) {
                *waiting = Some(ping);
            }
        }
        (self.left.door_m, self.right.door_m) = (None, None);
        // Slots that are farther apart have time for all of it.
        let is_at_once = period_us > SHORT_US;
        self.has_gone_on &= !is_any_new;
        if ((is_any_new || is_busy) && !is_at_once) || self.waiting.iter().all(Option::is_none) {
            return;
        }
        if !self.has_gone_on {
            self.go_on(pose, period_us);
            if !is_at_once {
                return;
            }
        }
        for place in [LEFT, RIGHT, AHEAD] {
            let waiting = self.waiting.get_mut(place).and_then(Option::take);
            let Some(ping) = waiting else { continue };
            self.hear(place, &ping, pose, ranges);
            if !is_at_once {
                return;
            }
        }
    }

    /// Goes on to where the robot is now.
    fn go_on(&mut self, pose: &Pose, period_us: u32) {
        let moved = self.last.map_or(Frame::START, |last| last.to_local(*pose));
        let since_us = core::mem::take(&mut self.since_us).max(period_us);
        if moved.x_m.abs().max(moved.y_m.abs()) > LEAP_M && since_us <= LEAP_US {
            let waiting = self.waiting;
            *self = Self {
                waiting,
                ..Self::NONE
            };
        }
        self.has_gone_on = true;
        self.last = Some(*pose);
        self.m_per_us = moved.x_m / since_us as f32;
        self.along_m += moved.x_m;
        self.left.go_on(moved.x_m, pose.heading_rad);
        self.right.go_on(moved.x_m, pose.heading_rad);
    }

    /// Looks at what a sonar has heard.
    fn hear(&mut self, place: usize, ping: &Ping, pose: &Pose, ranges: &Ranges) {
        let flank = match place {
            LEFT => &mut self.left,
            RIGHT => &mut self.right,
            _ => return self.look_ahead(ping, ranges),
        };
        // As fast as on the last piece of the way, the robot was so far back at the ping.
        let before_us = ping.age_us.saturating_sub(self.since_us);
        let along_m = self.along_m - self.m_per_us * before_us as f32;
        flank.hear(ping.range_m + RIM_M, along_m, pose.heading_rad);
    }

    fn look_ahead(&mut self, ping: &Ping, ranges: &Ranges) {
        let distance_m = ping.range_m + RIM_M;
        let diagonals = [
            (Side::Left, Bearing::AheadLeft, &self.left),
            (Side::Right, Bearing::AheadRight, &self.right),
        ];
        let is_wall = diagonals.into_iter().any(|(side, bearing, flank)| {
            let range_m = ranges.free_m(bearing);
            let seen_m = Heading::new(0.0).wall_m(side, Part::Ahead, range_m);
            // What the wall beside it explains says nothing of one ahead.
            let is_beside = (flank.wall_m).is_some_and(|wall_m| seen_m > wall_m - AHEAD_M);
            let is_known = range_m > 0.0 && range_m < Ranges::FAR_M;
            is_known && !is_beside && (seen_m - distance_m).abs() <= AHEAD_M
        });
        self.ahead_pings = if is_wall && ping.range_m < Ranges::FAR_M {
            self.ahead_pings.saturating_add(1)
        } else {
            0
        };
        self.ahead_m = ping.range_m;
    }

    fn flank(&self, side: Side) -> &Flank {
        match side {
            Side::Left => &self.left,
            Side::Right => &self.right,
        }
    }

    /// Width of the door on this side whose end the last look has seen, in metres.
    pub(super) fn door_m(&self, side: Side) -> Option<f32> {
        self.flank(side).door_m
    }

    /// Range of the corner between a wall ahead and one on this side: of the farther of the two, in
    /// metres from the rim. None where there is no corner.
    pub(super) fn corner_m(&self, side: Side) -> Option<f32> {
        let beside_m = self.flank(side).beside_m()? - RIM_M;
        (self.ahead_pings >= AHEAD_PINGS).then_some(self.ahead_m.max(beside_m))
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;
    use crate::tasks::MAX_SONARS;

    const PERIOD_US: u32 = 20_000;
    const STEP_M: f32 = 0.005;

    /// A robot that drives along x at y = 0, and what is around it.
    struct Drive {
        /// Distance of the wall on the left, open from one place to another, in metres; the right
        /// is free.
        wall_m: f32,
        open_m: (f32, f32),
        /// Where a wall across the way is, and how wide it is to each side.
        ahead: Option<(f32, f32)>,
    }

    impl Drive {
        /// What the robot hears there.
        fn ranges(&self, x_m: f32, step: usize) -> Ranges {
            const SINE_33: f32 = 0.5446;
            const COSINE_33: f32 = 0.8387;
            let mut ranges = Ranges::FREE;
            ranges.range_m = [Ranges::FAR_M; MAX_SONARS];
            // A ping each 80 ms, published at once.
            ranges.age_ms = [20 * (step % 4) as u16; MAX_SONARS];
            let place = |bearing: Bearing| ranges.bearings.iter().position(|it| *it == bearing);
            let (ahead, left) = (place(Bearing::Ahead), place(Bearing::Left));
            let diagonals = [place(Bearing::AheadLeft), place(Bearing::AheadRight)];
            let is_open = (self.open_m.0..self.open_m.1).contains(&x_m);
            ranges.range_m[left.unwrap()] = if is_open { 3.0 } else { self.wall_m - RIM_M };
            // Where a beam ends that looks 45° off, and is 12° wide to each side.
            let across_m =
                |wall_m: f32| (wall_m - RIM_M * core::f32::consts::FRAC_1_SQRT_2) / COSINE_33;
            let mut to_left_m = if is_open { 3.0 } else { across_m(self.wall_m) };
            if let Some((wall_m, half_m)) = self.ahead {
                let left_m = wall_m - x_m;
                ranges.range_m[ahead.unwrap()] = left_m - RIM_M;
                let slant_m = across_m(left_m);
                if slant_m * SINE_33 < half_m {
                    to_left_m = to_left_m.min(slant_m);
                    ranges.range_m[diagonals[1].unwrap()] = slant_m;
                }
            }
            ranges.range_m[diagonals[0].unwrap()] = to_left_m;
            ranges
        }

        /// Doors that were passed, where, and the nearest corner on each side, up to there.
        fn drives(&self, to_m: f32, turned_rad: f32) -> (Vec<(f32, f32)>, [Option<f32>; 2]) {
            let mut landmarks = Landmarks::NONE;
            let mut doors = Vec::new();
            let mut corners = [None; 2];
            for step in 0.. {
                let x_m = step as f32 * STEP_M;
                if x_m > to_m {
                    break;
                }
                let pose = Pose {
                    x_m,
                    heading_rad: if x_m > 0.6 { turned_rad } else { 0.0 },
                    ..Pose::START
                };
                landmarks.look(Some(&pose), Some(&self.ranges(x_m, step)), PERIOD_US, false);
                let door = landmarks.door_m(Side::Left);
                doors.extend(door.map(|width_m| (x_m, width_m)));
                assert_eq!(landmarks.door_m(Side::Right), None);
                corners = [Side::Left, Side::Right].map(|side| landmarks.corner_m(side));
            }
            (doors, corners)
        }
    }

    const ALONG: Drive = Drive {
        wall_m: 0.9,
        open_m: (0.0, 0.0),
        ahead: None,
    };

    #[test]
    fn a_door_is_told_once_behind_its_end_and_with_its_width() {
        // What the beam hides at 0.9 m is added: 0.34 m.
        for (open_m, turned_rad, width_m) in [
            ((1.0, 1.5), 0.0, Some(0.84)),
            ((1.0, 1.9), 0.0, Some(1.24)),
            ((1.0, 1.1), 0.0, None),
            ((1.0, 2.3), 0.0, None),
            // It began in the opening, and it turned away before.
            ((0.0, 0.5), 0.0, None),
            ((1.0, 1.5), 0.4, Some(0.84)),
            ((0.62, 1.12), 0.4, None),
        ] {
            let (doors, _) = Drive { open_m, ..ALONG }.drives(3.0, turned_rad);
            let found = doors.first().map(|(_, width_m)| *width_m);
            assert_eq!(doors.len(), usize::from(width_m.is_some()), "{open_m:?}");
            let off_m = found.unwrap_or(0.0) - width_m.unwrap_or(0.0);
            assert!(off_m.abs() < 0.05, "{open_m:?} {turned_rad}: {found:?}");
            if let Some((x_m, _)) = doors.first() {
                assert!((0.0..0.1).contains(&(x_m - open_m.1)), "{x_m}");
            }
        }
    }

    #[test]
    fn a_corner_is_a_wall_ahead_and_one_beside_and_somebody_ahead_is_none() {
        let along = |ahead| Drive { ahead, ..ALONG };
        let corner = |drive: Drive, to_m| drive.drives(to_m, 0.0).1;
        // The farther one counts: the wall ahead, and then the one to the left, whose range is
        // 0.79 m.
        for (to_m, range_m) in [(1.5, 1.39), (2.1, 0.79), (2.3, 0.79)] {
            let [Some(left_m), None] = corner(along(Some((3.0, 5.0))), to_m) else {
                panic!("no corner on the left alone");
            };
            assert!((left_m - range_m).abs() < 0.03, "{to_m}: {left_m}");
        }
        // Somebody is as wide as half a metre.
        for to_m in [1.9, 2.1, 2.3, 2.5] {
            assert_eq!(corner(along(Some((3.0, 0.25))), to_m), [None, None]);
        }
        // No wall beside it.
        let open_m = (0.0, 9.0);
        let across = Drive {
            open_m,
            ahead: Some((3.0, 5.0)),
            ..ALONG
        };
        assert_eq!(corner(across, 2.3), [None, None]);
    }
}
