//! The free way of a body along its movement.

use core::f64::consts::TAU;

use crate::world::Point;

use super::pose::BodyPose;

/// The farthest that is looked, in metres: as far as a sonar hears.
const LOOK_AHEAD_M: f64 = 4.0;

/// What is nearer than this to the body is touched, in metres. Each step of the look along the
/// movement is at least as long.
const TOUCH_M: f64 = 1e-4;

/// Below this speed a body stands, in metres per second: it takes way for nothing.
pub(super) const STILL_M_PER_S: f64 = 0.01;

/// How a body moves at an instant.
#[derive(Clone, Copy, Debug)]
pub(super) struct Movement {
    pub pose: BodyPose,
    /// Speed of its centre, below 0 backwards.
    pub way_m_per_s: f64,
    /// Counter-clockwise.
    pub turn_rad_per_s: f64,
}

impl Movement {
    pub fn speed_m_per_s(&self) -> f64 {
        self.way_m_per_s.abs()
    }

    pub fn is_still(&self) -> bool {
        self.speed_m_per_s() < STILL_M_PER_S
    }

    /// Where the centre is after so much way: on a circle, or straight on. Braking both wheels
    /// alike keeps the circle.
    fn centre_after(&self, way_m: f64) -> Point {
        let turned_rad = self.turn_rad_per_s / self.speed_m_per_s() * way_m;
        let half_rad = turned_rad / 2.0;
        // The chord of the arc.
        let chord_m = match half_rad == 0.0 {
            true => way_m,
            false => way_m * libm::sin(half_rad) / half_rad,
        };
        let (sin, cos) = libm::sincos(self.pose.heading_rad + half_rad);
        let ahead_m = chord_m * self.way_m_per_s.signum();
        let Point { x_m, y_m } = self.pose.position;
        Point::new(x_m + ahead_m * cos, y_m + ahead_m * sin)
    }

    /// How far the body comes along its movement before something touches it, in metres; none where
    /// nothing does within 4 m, nor before its circle is closed, and for a body that stands.
    /// `distance_m` tells how far what may be touched is from a centre.
    ///
    /// Each step is as long as what is free around the body: nothing fits in between.
    pub fn free_way_m(&self, radius_m: f64, distance_m: impl Fn(Point) -> f64) -> Option<f64> {
        if self.is_still() {
            return None;
        }
        let circle_m = TAU * self.speed_m_per_s() / self.turn_rad_per_s.abs();
        let farthest_m = LOOK_AHEAD_M.min(circle_m);
        let mut way_m = 0.0;
        while way_m <= farthest_m {
            let free_m = distance_m(self.centre_after(way_m)) - radius_m;
            if free_m < TOUCH_M {
                return Some(way_m);
            }
            way_m += free_m;
        }
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::world::Circle;

    /// From the origin along x.
    fn moving(way_m_per_s: f64, turn_rad_per_s: f64) -> Movement {
        Movement {
            pose: BodyPose::default(),
            way_m_per_s,
            turn_rad_per_s,
        }
    }

    #[test]
    fn the_free_way_goes_along_the_movement() {
        // The body has a radius of 0.1 m, so has what may be in its way.
        for (what, movement, x_m, y_m, expected_m) in [
            ("straight ahead", moving(0.3, 0.0), 1.0, 0.0, Some(0.8)),
            ("behind", moving(0.3, 0.0), -1.0, 0.0, None),
            ("behind, backwards", moving(-0.3, 0.0), -1.0, 0.0, Some(0.8)),
            ("grazed", moving(0.3, 0.0), 1.0, 0.199, Some(0.980_025)),
            ("missed", moving(0.3, 0.0), 1.0, 0.201, None),
            ("beyond the look", moving(0.3, 0.0), 4.3, 0.0, None),
            ("standing", moving(0.0, 0.0), 0.21, 0.0, None),
            ("turning on the spot", moving(0.0, 1.0), 0.21, 0.0, None),
            // On a circle of radius 1 m to the left, whose centre is at 0, 1: a quarter of it,
            // less the angle that 0.2 m are of it.
            ("on its arc", moving(0.3, 0.3), 1.0, 1.0, Some(1.370_46)),
            ("off its arc", moving(0.3, -0.3), 1.0, 1.0, None),
            (
                "on its arc, backwards",
                moving(-0.3, 0.3),
                -1.0,
                -1.0,
                Some(1.370_46),
            ),
            ("off its arc, backwards", moving(-0.3, 0.3), -1.0, 1.0, None),
        ] {
            let other = Circle {
                centre: Point::new(x_m, y_m),
                radius_m: 0.1,
            };
            let found_m = movement.free_way_m(0.1, |centre| other.distance_m(centre));
            match (found_m, expected_m) {
                (Some(found_m), Some(expected_m)) => {
                    let off_m: f64 = found_m - expected_m;
                    assert!(off_m.abs() < 1e-3, "{what}: {found_m}");
                }
                _ => assert_eq!(found_m, expected_m, "{what}"),
            }
        }
    }
}
