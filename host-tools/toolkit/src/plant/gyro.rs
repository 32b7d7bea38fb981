//! A gyroscope on the body, as its data register shows it.

use super::noise::{Noise, Source};
use super::parameters::GyroParameters;

/// How often it measures, in microseconds: the 100 Hz that a BMI160 is set to after a reset.
pub(super) const PERIOD_US: u64 = 10_000;

/// The same in seconds.
const PERIOD_S: f64 = PERIOD_US as f64 / 1e6;

/// Counts for each degree per second, in the range of 250 °/s.
const COUNTS_PER_DEG_PER_S: f64 = 131.2;

/// A gyroscope that was switched on when the plant was.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gyro {
    parameters: GyroParameters,
    /// Where the body looked at the last measurement.
    heading_rad: f64,
    counts: i16,
}

impl Gyro {
    pub fn new(parameters: GyroParameters, heading_rad: f64) -> Self {
        Self {
            parameters,
            heading_rad,
            counts: 0,
        }
    }

    /// What it has measured last: how fast it was turned counter-clockwise.
    pub fn counts(&self) -> i16 {
        self.counts
    }

    /// Measures at `end_us`, in microseconds of plant time, how fast the body has turned since the
    /// last time, [`PERIOD_US`] ago.
    pub fn measure(&mut self, end_us: u64, heading_rad: f64, noise: &Noise) {
        let turned_rad = heading_rad - self.heading_rad;
        self.heading_rad = heading_rad;
        let GyroParameters {
            bias_deg_per_s,
            drift_deg_per_s2,
            scale_error,
            noise_deg_per_s,
        } = self.parameters;
        let rate_deg_per_s = turned_rad / PERIOD_S * 180.0 / core::f64::consts::PI;
        let side = 2.0 * noise.uniform(Source::GyroBias, 0) - 1.0;
        let bias_deg_per_s = side * bias_deg_per_s + drift_deg_per_s2 * (end_us as f64 / 1e6);
        let scatter_deg_per_s = noise_deg_per_s * noise.bell(Source::Gyro, end_us / PERIOD_US);
        let deg_per_s = rate_deg_per_s * (1.0 + scale_error) + bias_deg_per_s + scatter_deg_per_s;
        // The cast stays at the ends of the range.
        self.counts = libm::round(deg_per_s * COUNTS_PER_DEG_PER_S) as i16;
    }
}
