//! Uncertainty: how far a pose from odometry may be off.

use super::arc::{Arc, chord_by_arc, chord_slope};
use super::frame::{Frame, Pose};

/// The covariance of a pose: how far it may be off in x, y and heading (θ), and which of these
/// errors come together.
///
/// Wheels slip on bumps and dust, each by itself: the variance of a wheel's way grows with the way,
/// whichever direction it rolls in. A firmware that keeps no `Uncertainty` has nothing of it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Uncertainty {
    /// Variance of x, in square metres.
    pub xx_m2: f32,
    /// Covariance of x and y, in square metres.
    pub xy_m2: f32,
    /// Variance of y, in square metres.
    pub yy_m2: f32,
    /// Covariance of x and heading, in metres times radians.
    pub xt_m_rad: f32,
    /// Covariance of y and heading, in metres times radians.
    pub yt_m_rad: f32,
    /// Variance of the heading, in square radians.
    pub tt_rad2: f32,
}

impl Uncertainty {
    /// That of a pose which is known.
    pub const NONE: Self = Self {
        xx_m2: 0.0,
        xy_m2: 0.0,
        yy_m2: 0.0,
        xt_m_rad: 0.0,
        yt_m_rad: 0.0,
        tt_rad2: 0.0,
    };

    /// The uncertainty of `pose.rolled(left_m, right_m, wheel_base_m)`, where this is that of
    /// `pose`, and `variance_m` the variance of a wheel's way by the metre, in m²/m.
    ///
    /// To first order in the errors: the arc's derivatives carry the old covariance over to its
    /// end, and add that of the two ways.
    pub fn rolled(
        self,
        pose: Pose,
        left_m: f32,
        right_m: f32,
        wheel_base_m: f32,
        variance_m: f32,
    ) -> Self {
        let arc = Arc::of(pose.heading_rad, left_m, right_m, wheel_base_m);
        // How the end moves along the chord and across it when the turn or the way changes.
        let along_by_turn_m = arc.way_m * chord_slope(arc.half_rad) / 2.0;
        let across_by_turn_m = arc.chord_m / 2.0;
        let along_by_way = chord_by_arc(arc.half_rad);
        let mut carried = self.carried(arc.chord_m * arc.cosine, arc.chord_m * arc.sine);
        for (rolled_m, turn_by_way_m) in
            [(left_m, -1.0 / wheel_base_m), (right_m, 1.0 / wheel_base_m)]
        {
            // The robot's centre goes half as far as a wheel does.
            let along = along_by_way / 2.0 + along_by_turn_m * turn_by_way_m;
            let across = across_by_turn_m * turn_by_way_m;
            carried = carried.with(
                along * arc.cosine - across * arc.sine,
                along * arc.sine + across * arc.cosine,
                turn_by_way_m,
                variance_m * rolled_m.abs(),
            );
        }
        carried
    }

    /// The uncertainty of `pose.compose(by)`, where this is that of `pose`, and `by` is known: a
    /// correction by what somebody has seen. It grows by what an error of the heading makes of that
    /// way. A pose that was set, not corrected, has [`NONE`](Self::NONE).
    #[must_use]
    pub fn corrected(self, pose: Pose, by: Frame) -> Self {
        let corrected = pose.translate(by.x_m, by.y_m);
        self.carried(corrected.x_m - pose.x_m, corrected.y_m - pose.y_m)
    }

    /// After a way by which the end is this far from the start: an error of the heading at the
    /// start has turned the end about it.
    fn carried(self, x_m: f32, y_m: f32) -> Self {
        let xt_m_rad = self.xt_m_rad - y_m * self.tt_rad2;
        let yt_m_rad = self.yt_m_rad + x_m * self.tt_rad2;
        Self {
            xx_m2: self.xx_m2 - y_m * (self.xt_m_rad + xt_m_rad),
            xy_m2: self.xy_m2 + x_m * self.xt_m_rad - y_m * yt_m_rad,
            yy_m2: self.yy_m2 + x_m * (self.yt_m_rad + yt_m_rad),
            xt_m_rad,
            yt_m_rad,
            tt_rad2: self.tt_rad2,
        }
    }

    /// With one more error of that variance, by which x, y and heading change so much.
    fn with(self, x: f32, y: f32, heading_rad: f32, variance: f32) -> Self {
        Self {
            xx_m2: self.xx_m2 + variance * x * x,
            xy_m2: self.xy_m2 + variance * x * y,
            yy_m2: self.yy_m2 + variance * y * y,
            xt_m_rad: self.xt_m_rad + variance * x * heading_rad,
            yt_m_rad: self.yt_m_rad + variance * y * heading_rad,
            tt_rad2: self.tt_rad2 + variance * heading_rad * heading_rad,
        }
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::TAU;

    use super::*;
    use crate::odometry::wrapped_rad;

    const BASE_M: f32 = 0.2;
    /// A wheel is off by 3 mm (one standard deviation) after a metre.
    const VARIANCE_M: f32 = 1e-5;

    /// Where a robot is after so many steps, and how far that may be off.
    fn driven(steps: u32, left_m: f32, right_m: f32) -> (Pose, Uncertainty) {
        (0..steps).fold((Pose::START, Uncertainty::NONE), |(pose, uncertain), _| {
            (
                pose.rolled(left_m, right_m, BASE_M),
                uncertain.rolled(pose, left_m, right_m, BASE_M, VARIANCE_M),
            )
        })
    }

    #[test]
    fn on_a_straight_way_it_grows_as_the_closed_form_says() {
        for way_m in [1.0_f32, 5.0, -2.0] {
            let step_m = way_m / 1_000.0;
            let (_, found) = driven(1_000, step_m, step_m);
            let length_m = way_m.abs();
            let tt_rad2 = 2.0 * VARIANCE_M * length_m / (BASE_M * BASE_M);
            for (name, found, expected) in [
                ("x", found.xx_m2, VARIANCE_M * length_m / 2.0),
                ("y", found.yy_m2, tt_rad2 * way_m * way_m / 3.0),
                ("heading", found.tt_rad2, tt_rad2),
                ("y and heading", found.yt_m_rad, tt_rad2 * way_m / 2.0),
            ] {
                let off = (found / expected - 1.0).abs();
                assert!(
                    off < 2e-3,
                    "{name} after {way_m} m: {found}, not {expected}"
                );
            }
            assert!(found.xy_m2.abs() + found.xt_m_rad.abs() < 1e-9, "{found:?}");
        }
    }

    #[test]
    fn one_long_arc_is_as_uncertain_as_its_wheels_ways_say() {
        // Derivatives by differences, in `f64`.
        let (left_m, right_m) = (0.3, 0.5);
        let start = Pose {
            x_m: 1.0,
            y_m: 2.0,
            heading_rad: 0.7,
        };
        let end = |left_m: f64, right_m: f64| {
            let (way_m, turn_rad) = ((left_m + right_m) / 2.0, (right_m - left_m) / 0.2);
            let chord_m = way_m * libm::sin(turn_rad / 2.0) / (turn_rad / 2.0);
            let (sine, cosine) = libm::sincos(0.7 + turn_rad / 2.0);
            [chord_m * cosine, chord_m * sine, turn_rad]
        };
        const DELTA_M: f64 = 1e-6;
        let slopes = [(DELTA_M, 0.0), (0.0, DELTA_M)].map(|(left, right)| {
            let more = end(left_m + left, right_m + right);
            let less = end(left_m - left, right_m - right);
            [0, 1, 2].map(|place| (more[place] - less[place]) / (2.0 * DELTA_M))
        });
        let expected = |row: usize, column: usize| {
            let ways = slopes.iter().zip([left_m, right_m]);
            ways.map(|(slope, way_m)| slope[row] * slope[column] * way_m)
                .sum::<f64>()
        };
        let found = Uncertainty::NONE.rolled(start, left_m as f32, right_m as f32, BASE_M, 1.0);
        for (found, expected) in [
            (found.xx_m2, expected(0, 0)),
            (found.xy_m2, expected(0, 1)),
            (found.yy_m2, expected(1, 1)),
            (found.xt_m_rad, expected(0, 2)),
            (found.yt_m_rad, expected(1, 2)),
            (found.tt_rad2, expected(2, 2)),
        ] {
            let most = 1e-5 * (1.0 + expected.abs());
            assert!(
                (f64::from(found) - expected).abs() < most,
                "{found}, not {expected}"
            );
        }
    }

    /// Twice carried along is carried along both ways, and a way forth and back changes nothing.
    #[test]
    fn a_correction_carries_it_along_as_a_way_does() {
        let (pose, uncertain) = driven(100, 0.02, 0.021);
        let by = Frame {
            x_m: 0.3,
            y_m: -0.2,
            heading_rad: 0.4,
        };
        let corrected = uncertain.corrected(pose, by);
        // An error of the heading, of one standard deviation, turns the new pose about the old one.
        let (along_m, across_m) = {
            let moved = pose.compose(by);
            (moved.x_m - pose.x_m, moved.y_m - pose.y_m)
        };
        let expected = Uncertainty {
            xx_m2: uncertain.xx_m2 - 2.0 * across_m * uncertain.xt_m_rad
                + across_m * across_m * uncertain.tt_rad2,
            yy_m2: uncertain.yy_m2
                + 2.0 * along_m * uncertain.yt_m_rad
                + along_m * along_m * uncertain.tt_rad2,
            ..corrected
        };
        assert!((corrected.xx_m2 - expected.xx_m2).abs() < 1e-8);
        assert!((corrected.yy_m2 - expected.yy_m2).abs() < 1e-8);
        assert_eq!(corrected.tt_rad2, uncertain.tt_rad2);
        let back = corrected.corrected(pose.compose(by), by.inverse());
        assert!((back.xx_m2 - uncertain.xx_m2).abs() < 1e-8, "{back:?}");
        assert!((back.xy_m2 - uncertain.xy_m2).abs() < 1e-8, "{back:?}");
        assert!((back.yy_m2 - uncertain.yy_m2).abs() < 1e-8, "{back:?}");
    }

    /// Random numbers of a normal distribution, the same in each run: an xorshift generator and
    /// the polar method of Box and Muller.
    struct Normal(u64);

    impl Normal {
        fn uniform(&mut self) -> f64 {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            (self.0 >> 11) as f64 / (1_u64 << 53) as f64
        }

        fn next(&mut self) -> f32 {
            let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.uniform()));
            (radius * libm::cos(core::f64::consts::TAU * self.uniform())) as f32
        }
    }

    /// Four thousand robots whose wheels slip: their poses spread as is said, to 8 % of what the
    /// deviations allow. So many samples tell a variance to 2.2 % (one standard deviation).
    #[test]
    fn robots_that_slip_spread_as_it_says() {
        const ROBOTS: usize = 4_000;
        const STEPS: u32 = 100;
        let mut normal = Normal(1);
        for (name, left_m, right_m) in [
            ("straight", 0.02, 0.02),
            ("a wide curve", 0.018, 0.022),
            (
                "three turns to the right",
                0.02 + 0.003 * TAU,
                0.02 - 0.003 * TAU,
            ),
            ("backwards", -0.021, -0.02),
        ] {
            let mean = driven(STEPS, left_m, right_m);
            let mut sums = [[0.0_f64; 3]; 3];
            for _ in 0..ROBOTS {
                let slipped = (0..STEPS).fold(Pose::START, |pose, _| {
                    let mut slip = |way_m: f32| {
                        let deviation_m = libm::sqrtf(VARIANCE_M * way_m.abs());
                        way_m + deviation_m * normal.next()
                    };
                    pose.rolled(slip(left_m), slip(right_m), BASE_M)
                });
                let off = [
                    slipped.x_m - mean.0.x_m,
                    slipped.y_m - mean.0.y_m,
                    wrapped_rad(slipped.heading_rad - mean.0.heading_rad),
                ]
                .map(f64::from);
                for (row, sums) in off.iter().zip(&mut sums) {
                    for (column, sum) in off.iter().zip(sums) {
                        *sum += row * column / ROBOTS as f64;
                    }
                }
            }
            let said = mean.1;
            for (row, column, said) in [
                (0, 0, said.xx_m2),
                (0, 1, said.xy_m2),
                (1, 1, said.yy_m2),
                (0, 2, said.xt_m_rad),
                (1, 2, said.yt_m_rad),
                (2, 2, said.tt_rad2),
            ] {
                let scale = libm::sqrt(sums[row][row] * sums[column][column]);
                let off = (f64::from(said) - sums[row][column]) / scale;
                assert!(off.abs() < 0.08, "{name}, {row} and {column}: off by {off}");
            }
        }
    }
}
