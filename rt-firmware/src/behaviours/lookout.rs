//! What tells that a situation is up, for those that ship.

use super::beams::Side;
use super::landmarks::Landmarks;
use super::situation::{Circumstances, is_outside};
use crate::odometry::wrapped_rad;
use crate::tasks::{Pose, Sector, Twist};
use esm_link::behaviours::Situation;

/// A robot that has moved by less has not moved, in metres and radians.
const MOVED_M: f32 = 0.01;
const MOVED_RAD: f32 = 0.02;
const US_PER_S: f32 = 1e6;

/// How long a door that was passed is up, in microseconds: long enough for a mission to see it.
const PASSED_US: u32 = 1_000_000;

/// Where the robot was when it moved last.
#[derive(Clone, Copy, Debug)]
pub(super) struct Stillness(Option<Pose>);

impl Stillness {
    /// Nobody has looked.
    pub(super) const NONE: Self = Self(None);

    /// Whether the robot moves, as far as it is to.
    pub(super) fn moves(&mut self, seen: &Circumstances<'_>) -> bool {
        let Some(pose) = seen.pose else {
            return false;
        };
        let has_moved = self.0.is_none_or(|moved| {
            let (x_m, y_m) = (pose.x_m - moved.x_m, pose.y_m - moved.y_m);
            let turned_rad = wrapped_rad(pose.heading_rad - moved.heading_rad);
            x_m * x_m + y_m * y_m > MOVED_M * MOVED_M || turned_rad.abs() > MOVED_RAD
        });
        if has_moved {
            self.0 = Some(pose);
        }
        has_moved || seen.asked == Twist::STILL
    }
}

/// Looks for one situation.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lookout {
    situation: Situation,
    /// Its parameter.
    value: f32,
    /// How long it has lasted, for a situation that takes time, or how long it is still up, for one
    /// that is over at once; in microseconds.
    lasts_us: u32,
}

impl Lookout {
    /// For this situation with this parameter, which is not up.
    pub(super) const fn new(situation: Situation, value: f32) -> Self {
        Self {
            situation,
            value,
            lasts_us: 0,
        }
    }

    /// What is looked for.
    pub(super) fn situation(&self) -> Situation {
        self.situation
    }

    /// Its parameter is another one from now on.
    pub(super) fn set(&mut self, value: f32) {
        self.value = value;
    }

    /// Whether it is up. `moves` as [`Stillness`] says.
    pub(super) fn look(
        &mut self,
        seen: &Circumstances<'_>,
        landmarks: &Landmarks,
        moves: bool,
    ) -> bool {
        let value = self.value;
        match self.situation {
            Situation::OutsideRange => seen.pose.is_some_and(|pose| is_outside(&pose, value)),
            Situation::Stuck => self.lasts(!moves, seen.period_us),
            Situation::SensorLost => {
                let front_m = seen.ranges.map(|ranges| ranges.free_range(Sector::Front));
                let is_lost = front_m.is_none_or(|front_m| front_m <= 0.0);
                self.lasts(is_lost, seen.period_us)
            }
            // Who watches what nobody measures is told so at once.
            Situation::LowBattery => seen.battery_v.is_none_or(|voltage_v| voltage_v < value),
            Situation::Near => (seen.ranges).is_none_or(|ranges| ranges.nearest_m() < value),
            Situation::DoorLeft => self.was_passed(landmarks.door_m(Side::Left), seen.period_us),
            Situation::DoorRight => self.was_passed(landmarks.door_m(Side::Right), seen.period_us),
            Situation::CornerLeft => is_within(landmarks.corner_m(Side::Left), value),
            Situation::CornerRight => is_within(landmarks.corner_m(Side::Right), value),
            Situation::Lasts => self.lasts(true, seen.period_us),
            // Whoever executes the behaviour is told by its law.
            Situation::Failed => false,
        }
    }

    /// Whether it has been so for as many seconds as the situation takes.
    fn lasts(&mut self, is_so: bool, period_us: u32) -> bool {
        self.lasts_us = if is_so {
            self.lasts_us.saturating_add(period_us)
        } else {
            0
        };
        is_so && self.lasts_us as f32 >= self.value * US_PER_S
    }

    /// Whether something as wide as the situation takes was passed just now.
    fn was_passed(&mut self, width_m: Option<f32>, period_us: u32) -> bool {
        self.lasts_us = if width_m.is_some_and(|width_m| width_m >= self.value) {
            PASSED_US
        } else {
            self.lasts_us.saturating_sub(period_us)
        };
        self.lasts_us > 0
    }
}

fn is_within(seen_m: Option<f32>, range_m: f32) -> bool {
    seen_m.is_some_and(|seen_m| seen_m < range_m)
}
