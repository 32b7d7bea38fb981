//! Gains of the speed controller for motors that are known.

use super::motor::Motor;

/// Gains of `WheelSpeed`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gains {
    /// Power for each m/s of speed that is lacking.
    pub proportional_s_per_m: f64,
    /// Power for each metre that has been lost by lacking speed.
    pub integral_per_m: f64,
}

/// Dead time of the loop in periods: what is measured is the mean of the last one, and power is
/// given at the end of the next.
const DEAD_PERIODS: f64 = 1.5;

impl Gains {
    /// Gains for wheels with motors like these, in a loop with this period.
    ///
    /// A PI controller by the rules of S. Skogestad, "Simple analytic rules for model reduction and
    /// PID controller tuning", Journal of Process Control 13, 2003: for a first-order lag τ with
    /// the gain k and the dead time θ, K = τ / (k (τc + θ)) and Ti = min(τ, 4 (τc + θ)). The time
    /// constant τc of the closed loop is the motor's own: set points come with the power that they
    /// need, so that the controller has only the rest to do, and a faster one would act on the
    /// steps of the encoders. Both wheels get the same: the means of what each would.
    pub fn for_motors(motors: &[Motor], period_s: f64) -> Self {
        let count = motors.len().max(1) as f64;
        let mut mean = Gains {
            proportional_s_per_m: 0.0,
            integral_per_m: 0.0,
        };
        for motor in motors {
            let gain_m_per_s = motor.gain_m_per_s();
            let dead_s = DEAD_PERIODS * period_s;
            let closed_s = motor.lag_s + dead_s;
            let proportional = motor.lag_s / (gain_m_per_s * closed_s);
            mean.proportional_s_per_m += proportional / count;
            mean.integral_per_m += proportional / motor.lag_s.min(4.0 * closed_s) / count;
        }
        mean
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_faster_or_stronger_motor_gets_other_gains() {
        let motor = Motor {
            full_speed_m_per_s: 0.7,
            friction_power: 0.0,
            lag_s: 0.085,
            error_m_per_s: 0.0,
        };
        let gains = Gains::for_motors(&[motor], 0.01);
        // 0.085 / (0.7 · 0.1), and that by 0.085.
        assert!(
            (gains.proportional_s_per_m - 1.214).abs() < 1e-3,
            "{gains:?}"
        );
        assert!((gains.integral_per_m - 14.29).abs() < 0.01, "{gains:?}");
        let stronger = Motor {
            full_speed_m_per_s: 1.4,
            ..motor
        };
        let mean = Gains::for_motors(&[motor, stronger], 0.01);
        let expected = gains.proportional_s_per_m * 0.75;
        assert!(
            (mean.proportional_s_per_m - expected).abs() < 1e-6,
            "{mean:?}"
        );
    }
}
