//! Dead reckoning: where the robot is, worked out from how far its wheels have turned.
//!
//! In `f32`: a step of a fraction of a millimetre is lost only tens of kilometres from the start,
//! the wheels slip by far more, and a core without a floating-point unit takes half the time. Sine
//! and cosine are sums and products of `f32`, which host and target work out to the same bits;
//! those of `libm` are as well, but go through `f64`, whose arithmetic would be five kilobytes of a
//! small robot's flash.

use core::f32::consts::{FRAC_2_PI, PI, TAU};

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

    /// A frame as seen from this one. Both are seen from the same.
    pub fn to_local(self, global: Self) -> Self {
        let (sine, cosine) = sine_and_cosine(self.heading_rad);
        let (x_m, y_m) = (global.x_m - self.x_m, global.y_m - self.y_m);
        Self {
            x_m: x_m * cosine + y_m * sine,
            y_m: y_m * cosine - x_m * sine,
            heading_rad: wrapped_rad(global.heading_rad - self.heading_rad),
        }
    }

    /// The pose after the left and the right wheel have rolled `left_m` and `right_m`, with the
    /// wheels `wheel_base_m` apart.
    ///
    /// Midpoint rule: the way is laid along the heading half-way through the turn, which is exact
    /// but for the difference between arc and chord.
    pub fn rolled(self, left_m: f32, right_m: f32, wheel_base_m: f32) -> Self {
        let way_m = (left_m + right_m) / 2.0;
        let turn_rad = (right_m - left_m) / wheel_base_m;
        let (sine, cosine) = sine_and_cosine(self.heading_rad + turn_rad / 2.0);
        Self {
            x_m: self.x_m + way_m * cosine,
            y_m: self.y_m + way_m * sine,
            heading_rad: wrapped_rad(self.heading_rad + turn_rad),
        }
    }
}

/// The angle between -π and π that looks the same way as `angle_rad`, which is at most one turn
/// outside.
pub fn wrapped_rad(angle_rad: f32) -> f32 {
    if angle_rad > PI {
        angle_rad - TAU
    } else if angle_rad < -PI {
        angle_rad + TAU
    } else {
        angle_rad
    }
}

/// Sine and cosine of an angle, which is a few turns at most: to 1e-7 within four turns, to 2e-7
/// within a hundred, and less and less exact beyond.
///
/// The angle's distance from the nearest quarter turn, an eighth at most, goes into the two power
/// series, cut where the next term is less than half of an `f32`'s last bit; the number of quarter
/// turns says which is which.
pub(crate) fn sine_and_cosine(angle_rad: f32) -> (f32, f32) {
    /// A quarter turn in two parts. The first has so few bits that its products with small numbers
    /// are exact.
    const QUARTER_RAD: f32 = 1.570_312_5;
    /// See [`QUARTER_RAD`].
    const QUARTER_REST_RAD: f32 = (core::f64::consts::FRAC_PI_2 - QUARTER_RAD as f64) as f32;
    const HALF: f32 = 0.5;
    let rounding = if angle_rad < 0.0 { -HALF } else { HALF };
    let quarters = (angle_rad * FRAC_2_PI + rounding) as i32;
    let turned = quarters as f32;
    let x = angle_rad - turned * QUARTER_RAD - turned * QUARTER_REST_RAD;
    let square = x * x;
    let series = |[a, b, c, d]: [f32; 4]| {
        let inner = square * (1.0 / c) * (1.0 - square * (1.0 / d));
        square * (1.0 / a) * (1.0 - square * (1.0 / b) * (1.0 - inner))
    };
    // Divisors of each term, from the one before: x³/3! = x·x²/(2·3) and so on.
    let sine = x - x * series([2.0 * 3.0, 4.0 * 5.0, 6.0 * 7.0, 8.0 * 9.0]);
    let cosine = 1.0 - series([1.0 * 2.0, 3.0 * 4.0, 5.0 * 6.0, 7.0 * 8.0]);
    let (sine, cosine) = if quarters & 1 == 0 {
        (sine, cosine)
    } else {
        (cosine, -sine)
    };
    if quarters & 2 == 0 {
        (sine, cosine)
    } else {
        (-sine, -cosine)
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::FRAC_PI_2;

    use super::*;

    const BASE_M: f32 = 0.2;

    #[test]
    fn sine_and_cosine_are_right_to_the_last_bit_but_one() {
        const STEPS: i32 = 200_000;
        for (turns, most_error) in [(4.0, 1e-7), (100.0, 2e-7)] {
            for step in -STEPS..=STEPS {
                let angle_rad = step as f32 / STEPS as f32 * turns * TAU;
                let (sine, cosine) = sine_and_cosine(angle_rad);
                let (exact_sine, exact_cosine) = libm::sincos(f64::from(angle_rad));
                for (value, exact) in [(sine, exact_sine), (cosine, exact_cosine)] {
                    let error = (f64::from(value) - exact).abs();
                    assert!(error < most_error, "{angle_rad} rad: {value}, not {exact}");
                }
            }
        }
        assert_eq!(sine_and_cosine(0.0), (0.0, 1.0));
    }

    /// The same sums on every machine: a compiler that contracted them would be found here.
    #[test]
    fn sine_and_cosine_have_the_same_bits_everywhere() {
        for (angle_rad, sine_bits, cosine_bits) in [
            (0.5_f32, 0x3ef5_7744, 0x3f60_a940),
            (-2.0, 0xbf68_c7b7, 0xbed5_1132),
            (3.0, 0x3e10_81c3, 0xbf7d_7026),
        ] {
            let (sine, cosine) = sine_and_cosine(angle_rad);
            assert_eq!(
                (sine.to_bits(), cosine.to_bits()),
                (sine_bits, cosine_bits),
                "{angle_rad} rad"
            );
        }
    }

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
