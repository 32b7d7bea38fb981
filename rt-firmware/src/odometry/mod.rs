//! Dead reckoning: where the robot is, worked out from how far its wheels have turned.
//!
//! In `f32`: a step of a fraction of a millimetre is lost only tens of kilometres from the start, the wheels slip by far more, and a core
//! without a floating-point unit takes half the time. Sine and cosine come from `libm`, so that host and target agree to the bit.

use core::f32::consts::{PI, TAU};

/// Where the robot is and which way it looks, relative to where it was switched on.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Pose {
    /// Ahead of the start, in metres.
    pub x_m: f32,
    /// To the left of the start, in metres.
    pub y_m: f32,
    /// Counter-clockwise from the start's heading, in radians, -π to π.
    pub heading_rad: f32,
}

impl Pose {
    /// Where the robot was switched on.
    pub const START: Self = Self {
        x_m: 0.0,
        y_m: 0.0,
        heading_rad: 0.0,
    };

    /// The pose after the left and the right wheel have rolled `left_m` and `right_m`, with the wheels `wheel_base_m` apart.
    ///
    /// Midpoint rule: the way is laid along the heading half-way through the turn, which is exact but for the difference between
    /// arc and chord.
    pub fn rolled(self, left_m: f32, right_m: f32, wheel_base_m: f32) -> Self {
        let way_m = (left_m + right_m) / 2.0;
        let turn_rad = (right_m - left_m) / wheel_base_m;
        let way_heading_rad = self.heading_rad + turn_rad / 2.0;
        Self {
            x_m: self.x_m + way_m * libm::cosf(way_heading_rad),
            y_m: self.y_m + way_m * libm::sinf(way_heading_rad),
            heading_rad: wrapped_rad(self.heading_rad + turn_rad),
        }
    }
}

/// The angle between -π and π that looks the same way as `angle_rad`, which is at most one turn outside.
pub fn wrapped_rad(angle_rad: f32) -> f32 {
    if angle_rad > PI {
        angle_rad - TAU
    } else if angle_rad < -PI {
        angle_rad + TAU
    } else {
        angle_rad
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::FRAC_PI_2;

    use super::*;

    const BASE_M: f32 = 0.2;

    /// A drive of `steps` equal steps.
    fn drive(steps: usize, left_m: f32, right_m: f32) -> Pose {
        (0..steps).fold(Pose::START, |pose, _| pose.rolled(left_m, right_m, BASE_M))
    }

    #[test]
    fn simple_drives_end_where_geometry_says() {
        // A quarter turn to the left about a point 0.5 m away: wheels on radii 0.4 and 0.6 m.
        let quarter = |radius_m: f32| radius_m * FRAC_PI_2 / 100.0;
        for (name, end, expected) in [
            ("straight", drive(1_000, 0.001, 0.001), (1.0, 0.0, 0.0)),
            ("back", drive(1_000, -0.002, -0.002), (-2.0, 0.0, 0.0)),
            (
                "on the spot",
                drive(100, -quarter(0.1), quarter(0.1)),
                (0.0, 0.0, FRAC_PI_2),
            ),
            (
                "left",
                drive(100, quarter(0.4), quarter(0.6)),
                (0.5, 0.5, FRAC_PI_2),
            ),
            (
                "right",
                drive(100, quarter(0.6), quarter(0.4)),
                (0.5, -0.5, -FRAC_PI_2),
            ),
        ] {
            let (x_m, y_m, heading_rad) = expected;
            assert!((end.x_m - x_m).abs() < 1e-3, "{name}: {end:?}");
            assert!((end.y_m - y_m).abs() < 1e-3, "{name}: {end:?}");
            assert!(
                (end.heading_rad - heading_rad).abs() < 1e-3,
                "{name}: {end:?}"
            );
        }
    }

    #[test]
    fn a_full_circle_comes_home_and_the_heading_stays_wrapped() {
        let step_m = 0.1 * TAU / 500.0;
        let mut pose = Pose::START;
        for _ in 0..500 {
            pose = pose.rolled(3.0 * step_m, 5.0 * step_m, BASE_M);
            assert!(pose.heading_rad.abs() <= PI + 1e-3);
        }
        assert!(pose.x_m.abs() < 1e-3 && pose.y_m.abs() < 1e-3, "{pose:?}");
        assert!(pose.heading_rad.abs() < 1e-3, "{pose:?}");
    }

    #[test]
    fn there_and_back_again() {
        let there = drive(300, 0.004, 0.005);
        let home = (0..300).fold(there, |pose, _| pose.rolled(-0.004, -0.005, BASE_M));
        assert!(home.x_m.abs() < 1e-4 && home.y_m.abs() < 1e-4, "{home:?}");
    }
}
