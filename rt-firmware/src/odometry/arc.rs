//! Arcs: what a robot drives while both of its wheels roll evenly.

use super::angle::{sine_and_cosine, wrapped_rad};
use super::frame::Pose;

/// The arc that a robot drives from one look at its wheels to the next.
pub(super) struct Arc {
    /// Its length, in metres; negative is backwards.
    pub way_m: f32,
    /// Half of the angle that the robot turns by.
    pub half_rad: f32,
    /// Length of its chord, in metres.
    pub chord_m: f32,
    /// Sine of the chord's direction: of the heading half-way through the turn.
    pub sine: f32,
    /// Its cosine.
    pub cosine: f32,
}

impl Arc {
    /// The arc of a robot that looks there, and whose wheels roll so far, `wheel_base_m` apart.
    pub fn of(heading_rad: f32, left_m: f32, right_m: f32, wheel_base_m: f32) -> Self {
        let way_m = (left_m + right_m) / 2.0;
        let half_rad = (right_m - left_m) / (2.0 * wheel_base_m);
        Self::with(heading_rad, way_m, half_rad)
    }

    /// The arc of this length of a robot that looks there and turns by twice this angle.
    fn with(heading_rad: f32, way_m: f32, half_rad: f32) -> Self {
        let (sine, cosine) = sine_and_cosine(heading_rad + half_rad);
        Self {
            way_m,
            half_rad,
            chord_m: way_m * chord_by_arc(half_rad),
            sine,
            cosine,
        }
    }
}

impl Pose {
    /// The pose after the left and the right wheel have rolled `left_m` and `right_m`, each evenly,
    /// with the wheels `wheel_base_m` apart. The robot turns by less than a full turn.
    pub fn rolled(self, left_m: f32, right_m: f32, wheel_base_m: f32) -> Self {
        self.along(&Arc::of(self.heading_rad, left_m, right_m, wheel_base_m))
    }

    /// The pose after a way on which the robot has turned evenly by `turned_rad`,
    /// counter-clockwise, by less than a full turn.
    pub fn turned(self, way_m: f32, turned_rad: f32) -> Self {
        self.along(&Arc::with(self.heading_rad, way_m, turned_rad / 2.0))
    }

    fn along(self, arc: &Arc) -> Self {
        Self {
            x_m: self.x_m + arc.chord_m * arc.cosine,
            y_m: self.y_m + arc.chord_m * arc.sine,
            heading_rad: wrapped_rad(self.heading_rad + 2.0 * arc.half_rad),
        }
    }
}

/// Below it chords are worked out by series.
const SERIES_RAD: f32 = 0.25;

/// Length of an arc's chord in parts of the arc, sin(h)/h for an arc of the angle 2h: to 2e-7. The
/// first term that the series leaves out, h⁶/5040, is less than half of the last bit.
pub(super) fn chord_by_arc(half_rad: f32) -> f32 {
    if half_rad.abs() < SERIES_RAD {
        let square = half_rad * half_rad;
        1.0 - square * (1.0 / 6.0) * (1.0 - square * (1.0 / 20.0))
    } else {
        sine_and_cosine(half_rad).0 / half_rad
    }
}

/// How [`chord_by_arc`] changes with h: to 2e-6. The first term that the series leaves out is
/// h⁵/840.
pub(super) fn chord_slope(half_rad: f32) -> f32 {
    if half_rad.abs() < SERIES_RAD {
        half_rad * (-1.0 / 3.0) * (1.0 - half_rad * half_rad * (1.0 / 10.0))
    } else {
        let (sine, cosine) = sine_and_cosine(half_rad);
        (cosine - sine / half_rad) / half_rad
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::{FRAC_PI_2, PI, TAU};

    use super::*;

    const BASE_M: f32 = 0.2;

    /// What `f32` loses over a thousand steps.
    const MOST_M: f32 = 1e-4;
    const MOST_RAD: f32 = 1e-4;

    /// A drive of `steps` equal steps.
    fn drive(steps: usize, left_m: f32, right_m: f32) -> Pose {
        (0..steps).fold(Pose::START, |pose, _| pose.rolled(left_m, right_m, BASE_M))
    }

    #[test]
    fn who_turns_as_the_wheels_roll_goes_as_they_do() {
        for (left_m, right_m) in [(0.01, 0.01), (0.01, -0.01), (0.004, 0.006), (0.3, 0.2)] {
            let pose = drive(7, 0.02, 0.03);
            let by_wheels = pose.rolled(left_m, right_m, BASE_M);
            let by_turn = pose.turned((left_m + right_m) / 2.0, (right_m - left_m) / BASE_M);
            let off = |a: f32, b: f32| (a - b).abs() < 1e-6;
            assert!(off(by_wheels.x_m, by_turn.x_m) && off(by_wheels.y_m, by_turn.y_m));
            assert!(off(by_wheels.heading_rad, by_turn.heading_rad));
        }
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
            assert!((end.x_m - x_m).abs() < MOST_M, "{name}: {end:?}");
            assert!((end.y_m - y_m).abs() < MOST_M, "{name}: {end:?}");
            assert!(
                (end.heading_rad - heading_rad).abs() < MOST_RAD,
                "{name}: {end:?}"
            );
        }
    }

    #[test]
    fn an_arc_in_one_piece_ends_where_geometry_says() {
        for turn_rad in [1e-4, 0.1, 0.49, 0.51, 1.0, FRAC_PI_2, PI, 6.0, -0.3, -2.0] {
            // About a point 0.5 m to the left, or to the right.
            let radius_m = 0.5_f32.copysign(turn_rad);
            let [left_m, right_m] =
                [-1.0, 1.0].map(|side| (radius_m + side * BASE_M / 2.0) * turn_rad);
            let end = Pose::START.rolled(left_m, right_m, BASE_M);
            let (sine, cosine) = libm::sincos(f64::from(turn_rad));
            let x_m = f64::from(radius_m) * sine;
            let y_m = f64::from(radius_m) * (1.0 - cosine);
            assert!(
                (f64::from(end.x_m) - x_m).abs() < 1e-6,
                "{turn_rad}: {end:?}"
            );
            assert!(
                (f64::from(end.y_m) - y_m).abs() < 1e-6,
                "{turn_rad}: {end:?}"
            );
            assert!(
                wrapped_rad(end.heading_rad - turn_rad).abs() < 2e-6,
                "{turn_rad}"
            );
        }
    }

    #[test]
    fn chords_and_their_slopes_are_as_exact_as_is_said() {
        for step in -4_000..=4_000 {
            let half_rad = step as f32 / 1_000.0;
            let exact = f64::from(half_rad);
            let (chord, slope) = match step {
                0 => (1.0, 0.0),
                _ => {
                    let chord = libm::sin(exact) / exact;
                    (chord, (libm::cos(exact) - chord) / exact)
                }
            };
            let error = (f64::from(chord_by_arc(half_rad)) - chord).abs();
            assert!(error < 2e-7, "{half_rad}: {error}");
            let error = (f64::from(chord_slope(half_rad)) - slope).abs();
            assert!(error < 2e-6, "{half_rad}: {error}");
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
