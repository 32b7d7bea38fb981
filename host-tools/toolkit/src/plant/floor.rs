//! The sensors that look at the floor: how dark it is under each.

use rt_firmware::body::LINE_SENSORS;

use super::noise::{Noise, Source};
use super::parameters::FloorParameters;
use super::pose::BodyPose;
use crate::world::{LinePiece, Point};

impl FloorParameters {
    /// What the ADC reads at `now_us`, in counts, for the sensors from the left to the right.
    pub(super) fn counts(
        &self,
        pose: BodyPose,
        lines: &[LinePiece],
        noise: &Noise,
        now_us: u64,
    ) -> [f64; LINE_SENSORS] {
        let (sin, cos) = libm::sincos(pose.heading_rad);
        // From the left to the right, around the middle of the row.
        [(0, 1.0), (1, 0.0), (2, -1.0)].map(|(sensor, place)| {
            let left_m = self.pitch_m * place;
            let spot = Point::new(
                pose.position.x_m + self.ahead_m * cos - left_m * sin,
                pose.position.y_m + self.ahead_m * sin + left_m * cos,
            );
            let span_counts = self.line_counts - self.floor_counts;
            self.floor_counts
                + span_counts * self.darkness(spot, lines)
                + self.noise_counts * noise.bell(Source::Floor { sensor }, now_us)
        })
    }

    /// The part of a sensor's spot that lies on the nearest line, 0 to 1: it grows evenly while the
    /// line's edge goes across the spot.
    fn darkness(&self, spot: Point, lines: &[LinePiece]) -> f64 {
        let part = |line: &LinePiece| {
            let distance_m = libm::sqrt(line.middle.squared_distance_m2(spot));
            let beyond_edge_m = distance_m - line.width_m / 2.0;
            (0.5 - beyond_edge_m / self.spot_m).clamp(0.0, 1.0)
        };
        lines.iter().map(part).fold(0.0, f64::max)
    }
}
