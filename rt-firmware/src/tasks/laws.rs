//! Laws that several tasks move by.

use core::f32::consts::FRAC_1_SQRT_2;

use super::values::{Chassis, Pose, Twist, WheelSpeeds};
use crate::odometry::LocalFrame;

/// How to come to a goal and stand there: slower as it comes near, never slower than what friction
/// lets move, never faster than wanted. All are for one dimension, in metres or in radians.
#[derive(Clone, Copy, Debug)]
pub struct Approach {
    /// Speed for each unit that is still to go, per second.
    pub per_s: f32,
    /// The slowest speed.
    pub slowest_per_s: f32,
    /// Nearer than this is at the goal.
    pub tolerance: f32,
    /// Who is slower than this stands.
    pub standing_per_s: f32,
}

impl Approach {
    /// The speed for the way that is left, `most_per_s` at most: back where the goal is behind,
    /// none at the goal.
    pub fn speed(self, left: f32, most_per_s: f32) -> f32 {
        if left.abs() < self.tolerance {
            return 0.0;
        }
        let speed_per_s = (left.abs() * self.per_s).max(self.slowest_per_s);
        speed_per_s.min(most_per_s).copysign(left)
    }

    /// Whether the goal is reached: near enough, and in the last step, which moved by `moved` in
    /// `period_us`, nothing rolls any more that would carry it away again.
    pub fn is_reached(self, left: f32, moved: f32, period_us: u32) -> bool {
        let standing = self.standing_per_s * (period_us as f32 / 1e6);
        left.abs() < self.tolerance && moved.abs() < standing
    }
}

/// A straight line on the floor: from a pose on, the way that it looked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Track {
    start: LocalFrame,
}

/// Where a robot is, seen from a [`Track`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnTrack {
    /// How far along the line, in metres; negative behind its start.
    pub along_m: f32,
    /// How far to the left of it, in metres.
    pub left_m: f32,
    /// How far the robot looks to the left of the line's direction, in radians, -π to π.
    pub turned_rad: f32,
}

impl Track {
    /// The line from here on.
    pub fn from_pose(start: &Pose) -> Self {
        Self {
            start: LocalFrame::from(*start),
        }
    }

    /// Where this pose is.
    pub fn locate(&self, pose: &Pose) -> OnTrack {
        let seen = self.start.see(*pose);
        OnTrack {
            along_m: seen.x_m,
            left_m: seen.y_m,
            turned_rad: seen.heading_rad,
        }
    }
}

impl OnTrack {
    /// Turning speed for each radian off the direction, per second.
    const TURN_PER_S: f32 = 2.0;
    /// How far off the direction to look for each metre beside the line, in radians.
    const RAD_PER_M: f32 = 3.0;
    /// No farther off the direction than this, in radians.
    const MOST_RAD: f32 = 0.5;

    /// The turning speed in rad/s that brings a robot back onto the line and keeps it there, while
    /// it drives forwards or backwards along it.
    pub fn back_on_rad_per_s(&self, is_backwards: bool) -> f32 {
        let towards = (-self.left_m * Self::RAD_PER_M).clamp(-Self::MOST_RAD, Self::MOST_RAD);
        let wanted_rad = if is_backwards { -towards } else { towards };
        (wanted_rad - self.turned_rad) * Self::TURN_PER_S
    }
}

/// Distance of the sonars from the robot's centre, in metres.
pub const RIM_M: f32 = 0.11;

/// A wall beside the robot, as the sonar sees it that looks there, and the one half ahead of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WallSight {
    /// Range of the sonar at a right angle, in metres from the rim.
    pub beside_m: f32,
    /// Range of the sonar at 45° ahead of it, in metres from the rim.
    pub diagonal_m: f32,
}

impl WallSight {
    /// Turning speed for each metre too far from the wall.
    const DISTANCE_GAIN_RAD_PER_S_M: f32 = 2.5;
    /// Turning speed for each unit of the wall's slope against the heading.
    const SLOPE_GAIN_RAD_PER_S: f32 = 1.2;
    /// Steering takes no notice of distances and slopes beyond these.
    const DISTANCE_ERROR_LIMIT_M: f32 = 0.15;
    const SLOPE_LIMIT: f32 = 0.5;
    /// The wall is lost when it is farther away than this many times the distance to keep.
    const LOST_FACTOR: f32 = 2.5;
    /// Something at 45° is in the way when it is nearer than this part of the distance to keep; a
    /// wall that is followed well is farther there than the distance itself.
    const DIAGONAL_PART: f32 = 0.75;

    /// The turning speed towards the wall, in rad/s, that keeps the robot's rim `distance_m` from
    /// it, in metres.
    pub fn towards_rad_per_s(&self, distance_m: f32) -> f32 {
        let limit_m = Self::DISTANCE_ERROR_LIMIT_M;
        let too_far_m = (self.beside_m - distance_m).clamp(-limit_m, limit_m);
        Self::DISTANCE_GAIN_RAD_PER_S_M * too_far_m + Self::SLOPE_GAIN_RAD_PER_S * self.slope()
    }

    /// How fast the wall recedes, in metres for each metre driven: worked out from the beam to the
    /// side and the one at 45°, which meet a parallel wall at the same distance beside the robot.
    fn slope(&self) -> f32 {
        let beside_m = self.beside_m + RIM_M;
        let diagonal_m = (self.diagonal_m + RIM_M) * FRAC_1_SQRT_2;
        ((diagonal_m - beside_m) / diagonal_m).clamp(-Self::SLOPE_LIMIT, Self::SLOPE_LIMIT)
    }

    /// Whether there is no wall at this distance, in metres.
    pub fn is_lost(&self, distance_m: f32) -> bool {
        self.beside_m > Self::LOST_FACTOR * distance_m
    }

    /// Whether something is so near at 45° that the robot would scrape along it.
    pub fn scrapes(&self, distance_m: f32) -> bool {
        self.diagonal_m < Self::DIAGONAL_PART * distance_m
    }
}

impl WheelSpeeds {
    /// Both in the same proportion, so that the robot keeps to its curve, and neither faster than
    /// this, in metres per second.
    pub fn at_most(self, most_m_per_s: f32) -> Self {
        let fastest_m_per_s = self.left_m_per_s.abs().max(self.right_m_per_s.abs());
        if fastest_m_per_s <= most_m_per_s {
            return self;
        }
        let part = most_m_per_s / fastest_m_per_s;
        Self {
            left_m_per_s: self.left_m_per_s * part,
            right_m_per_s: self.right_m_per_s * part,
        }
    }
}

impl Chassis {
    /// A wheel that is to be slower than this stands, in metres per second.
    pub const STANDING_M_PER_S: f32 = 0.005;

    /// The speeds of the wheels that move the robot like this.
    pub fn wheel_speeds(&self, twist: &Twist) -> WheelSpeeds {
        let turn_m_per_s = twist.turn_rad_per_s * self.wheel_base_m / 2.0;
        WheelSpeeds {
            left_m_per_s: twist.forward_m_per_s - turn_m_per_s,
            right_m_per_s: twist.forward_m_per_s + turn_m_per_s,
        }
    }

    /// The share of full power, from -1 to 1, that a wheel needs for this speed in metres per
    /// second: on a flat floor, with a fresh battery. A controller does the rest, where there is
    /// one.
    pub fn rolling_power(&self, speed_m_per_s: f32) -> f32 {
        speed_m_per_s / self.full_speed_m_per_s * (1.0 - self.friction_power)
            + self.friction_power.copysign(speed_m_per_s)
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::FRAC_PI_2;

    use super::*;

    #[test]
    fn an_approach_is_fast_far_away_and_slow_near_by() {
        let approach = Approach {
            per_s: 2.0,
            slowest_per_s: 0.05,
            tolerance: 0.004,
            standing_per_s: 0.05,
        };
        for (left, speed) in [
            (10.0, 0.3),
            (0.15, 0.3),
            (0.1, 0.2),
            (0.01, 0.05),
            (0.003, 0.0),
            (0.0, 0.0),
            (-0.003, 0.0),
            (-0.01, -0.05),
            (-1.0, -0.3),
        ] {
            assert!((approach.speed(left, 0.3) - speed).abs() < 1e-6, "{left}");
        }
        // A mission may want less than what is slowest.
        assert_eq!(approach.speed(1.0, 0.0), 0.0);
        for (left, moved, is_reached) in [
            (0.003, 0.0005, true),
            (-0.003, -0.0005, true),
            (0.003, 0.002, false),
            (-0.003, -0.002, false),
            (0.005, 0.0, false),
        ] {
            // The same speed in half the time.
            let reached = approach.is_reached(left, moved / 2.0, 10_000);
            assert_eq!(reached, is_reached, "{left} {moved}");
            let reached = approach.is_reached(left, moved, 20_000);
            assert_eq!(reached, is_reached, "{left} {moved}");
        }
    }

    #[test]
    fn a_pose_is_seen_from_a_line() {
        let line = Track::from_pose(&Pose {
            x_m: 1.0,
            y_m: 2.0,
            heading_rad: FRAC_PI_2,
        });
        let seen = line.locate(&Pose {
            x_m: 0.5,
            y_m: 5.0,
            heading_rad: 3.0 * FRAC_PI_2 / 2.0,
        });
        let expected = [3.0, 0.5, FRAC_PI_2 / 2.0];
        for (value, expected) in [seen.along_m, seen.left_m, seen.turned_rad]
            .iter()
            .zip(expected)
        {
            assert!((value - expected).abs() < 1e-5, "{seen:?}");
        }
    }

    #[test]
    fn a_robot_beside_a_line_gets_back_onto_it_forwards_and_backwards() {
        for is_backwards in [false, true] {
            for (left_m, turned_rad) in [(0.2, 0.0), (-0.2, 0.4), (0.0, -1.0), (0.5, 1.0)] {
                let line = Track::from_pose(&Pose::START);
                let mut pose = Pose {
                    x_m: 0.0,
                    y_m: left_m,
                    heading_rad: turned_rad,
                };
                // 20 s at 0.2 m/s, in steps of 20 ms.
                for _ in 0..1_000 {
                    let turn_rad = line.locate(&pose).back_on_rad_per_s(is_backwards) * 0.02;
                    let way_m = if is_backwards { -0.004 } else { 0.004 };
                    let half_base_m = turn_rad * 0.1;
                    pose = pose.rolled(way_m - half_base_m, way_m + half_base_m, 0.2);
                }
                let seen = line.locate(&pose);
                assert!(
                    seen.left_m.abs() < 0.005 && seen.turned_rad.abs() < 0.02,
                    "{is_backwards} {left_m} {turned_rad}: {seen:?}"
                );
            }
        }
    }
}
