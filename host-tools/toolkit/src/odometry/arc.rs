//! Arcs: what a robot drives while both of its wheels roll evenly.

/// Place and heading, in millimetres and radians.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ArcPose {
    /// Ahead of the start.
    pub x_mm: f64,
    /// To the left of the start.
    pub y_mm: f64,
    /// Counter-clockwise from the start's heading, not wrapped.
    pub heading_rad: f64,
}

impl ArcPose {
    /// The pose after a way along an arc on which the robot turns by `turn_rad`, evenly.
    ///
    /// The closed form: a robot ends at the end of the arc's chord, which looks half of the turn
    /// aside.
    pub fn moved(self, way_mm: f64, turn_rad: f64) -> Self {
        let chord_mm = way_mm * chord_by_arc(turn_rad);
        let (sine, cosine) = libm::sincos(self.heading_rad + turn_rad / 2.0);
        Self {
            x_mm: self.x_mm + chord_mm * cosine,
            y_mm: self.y_mm + chord_mm * sine,
            heading_rad: self.heading_rad + turn_rad,
        }
    }

    /// The pose after the wheels, `base_mm` apart, have rolled so far, each evenly.
    pub fn rolled(self, left_mm: f64, right_mm: f64, base_mm: f64) -> Self {
        self.moved((left_mm + right_mm) / 2.0, (right_mm - left_mm) / base_mm)
    }
}

/// Length of an arc's chord, in parts of the arc: sin(δ/2) / (δ/2) for an arc of the angle δ.
pub fn chord_by_arc(turn_rad: f64) -> f64 {
    /// Below it two terms of the series are exact: the third is less than 1e-18.
    const TINY_RAD: f64 = 1e-4;
    let half_rad = turn_rad / 2.0;
    if half_rad.abs() < TINY_RAD {
        1.0 - half_rad * half_rad / 6.0
    } else {
        libm::sin(half_rad) / half_rad
    }
}

/// The same heading in degrees, above -180 and up to 180.
pub fn wrapped_deg(angle_deg: f64) -> f64 {
    /// So near to half a turn, an angle is half a turn, on whichever side sums of rounded numbers
    /// have put it.
    const ROUNDING_DEG: f64 = 1e-9;
    if angle_deg.abs() < 180.0 - ROUNDING_DEG {
        return angle_deg;
    }
    let turned_deg = angle_deg.rem_euclid(360.0);
    if (turned_deg - 180.0).abs() < ROUNDING_DEG {
        180.0
    } else if turned_deg > 180.0 {
        turned_deg - 360.0
    } else {
        turned_deg
    }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{FRAC_PI_2, PI, TAU};

    use super::*;

    #[test]
    fn an_arc_in_one_piece_ends_where_it_ends_in_many() {
        for (way_mm, turn_rad) in [
            (1_000.0, 0.0),
            (1_000.0, 1e-9),
            (1_000.0, 2e-4),
            (-300.0, FRAC_PI_2),
            (700.0, -3.0 * PI),
            (0.0, 5.0),
        ] {
            let whole = ArcPose::default().moved(way_mm, turn_rad);
            for parts in [7, 1_000, 100_000] {
                let count = f64::from(parts);
                let walked = (0..parts).fold(ArcPose::default(), |pose, _| {
                    pose.moved(way_mm / count, turn_rad / count)
                });
                let off_mm = libm::hypot(whole.x_mm - walked.x_mm, whole.y_mm - walked.y_mm);
                assert!(off_mm < 1e-8, "{way_mm} {turn_rad} {parts}: {off_mm}");
            }
        }
    }

    #[test]
    fn the_series_meets_the_closed_form() {
        for turn_rad in [1.9e-4_f64, 2.1e-4, -1.9e-4, 1e-5] {
            let half_rad = turn_rad / 2.0;
            let closed = libm::sin(half_rad) / half_rad;
            assert!((chord_by_arc(turn_rad) - closed).abs() < 2e-16);
        }
        assert_eq!(chord_by_arc(0.0), 1.0);
        assert!(chord_by_arc(TAU).abs() < 1e-15);
    }

    #[test]
    fn headings_are_wrapped_to_half_a_turn_on_either_side() {
        for (angle_deg, expected) in [
            (0.0, 0.0),
            (180.0, 180.0),
            (-180.0, 180.0),
            (180.000_000_000_01, 180.0),
            (181.0, -179.0),
            (-181.0, 179.0),
            (360.0, 0.0),
            (-90.0, -90.0),
            (3_690.0, 90.0),
            (-1e-17, -1e-17),
            (-5.1, -5.1),
        ] {
            assert_eq!(wrapped_deg(angle_deg), expected, "{angle_deg}");
        }
    }
}
