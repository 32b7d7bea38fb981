//! What was found of a robot's motors, and how it is told.

use std::fmt::Write as _;
use std::path::Path;

use anyhow::anyhow;
use serde::Serialize;

use super::numbers::rounded;
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::recording::player::Recording;
use crate::tune::{Gains, Motor, SIDES, fit, wheels_of};

/// What was found.
#[derive(Clone, Debug)]
pub struct Found {
    /// Time between two samples, in seconds.
    pub period_s: f64,
    /// The left and the right motor.
    pub motors: [Motor; 2],
    /// Gains for both.
    pub gains: Gains,
    /// By how much the wheels missed their set points (root of the mean square of both), in metres
    /// per second.
    pub speed_error_m_per_s: f64,
}

impl Found {
    /// What a recording says.
    ///
    /// # Errors
    /// It says too little, or a wheel does not follow its motor.
    pub fn of(recording: &Recording) -> Result<Self, CommandError> {
        let wheels = wheels_of(recording).map_err(|error| CommandError::Input(error.into()))?;
        let motor = |side: usize| {
            let (wheel, name) = wheels.get(side).zip(SIDES.get(side)).ok_or_else(defect)?;
            fit(wheel).map_err(|error| CommandError::Input(anyhow!("{name} wheel: {error}")))
        };
        let motors = [motor(0)?, motor(1)?];
        let [left, right] = &wheels;
        let errors = [left, right].map(|wheel| wheel.error_m_per_s());
        let squares: f64 = errors.iter().map(|error| error * error / 2.0).sum();
        Ok(Found {
            period_s: left.period_s,
            gains: Gains::for_motors(&motors, left.period_s),
            motors,
            speed_error_m_per_s: libm::sqrt(squares),
        })
    }

    /// The mean of both motors' speeds at full power, in metres per second, and of the powers that
    /// friction takes.
    pub fn feed_forward(&self) -> (f64, f64) {
        let [left, right] = self.motors;
        (
            (left.full_speed_m_per_s + right.full_speed_m_per_s) / 2.0,
            (left.friction_power + right.friction_power) / 2.0,
        )
    }
}

fn defect() -> CommandError {
    CommandError::Input(anyhow!("a robot has two wheels"))
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'r> {
    period_s: f64,
    motors: Vec<MotorReport>,
    gains: GainsReport,
    speed_error_m_per_s: ErrorReport,
    written: &'r [&'r Path],
}

#[derive(Serialize)]
struct MotorReport {
    side: &'static str,
    full_speed_m_per_s: f64,
    friction_power: f64,
    lag_s: f64,
    error_m_per_s: f64,
}

#[derive(Serialize)]
struct GainsReport {
    proportional_s_per_m: f64,
    integral_per_m: f64,
}

#[derive(Serialize)]
struct ErrorReport {
    before: f64,
    after: Option<f64>,
}

/// Tells what was found, and how it drove with it.
///
/// # Errors
/// If standard output cannot be written to.
pub fn report(
    found: &Found,
    after: Option<f64>,
    written: &[&Path],
    json: bool,
    console: &mut Console,
) -> Result<(), CommandError> {
    let motors = SIDES.iter().zip(&found.motors);
    let gains = GainsReport {
        proportional_s_per_m: rounded(found.gains.proportional_s_per_m),
        integral_per_m: rounded(found.gains.integral_per_m),
    };
    if json {
        return console.json_line(&Report {
            period_s: found.period_s,
            motors: motors
                .map(|(side, motor)| MotorReport {
                    side,
                    full_speed_m_per_s: rounded(motor.full_speed_m_per_s),
                    friction_power: rounded(motor.friction_power),
                    lag_s: rounded(motor.lag_s),
                    error_m_per_s: rounded(motor.error_m_per_s),
                })
                .collect(),
            gains,
            speed_error_m_per_s: ErrorReport {
                before: rounded(found.speed_error_m_per_s),
                after: after.map(rounded),
            },
            written,
        });
    }
    let mut text = String::new();
    for (side, motor) in motors {
        let _ = writeln!(
            text,
            "  {side:<6} {} m/s at full power, friction {} of it, lag {:.0} ms; the model misses {:.0} mm/s",
            rounded(motor.full_speed_m_per_s),
            rounded(motor.friction_power),
            motor.lag_s * 1e3,
            motor.error_m_per_s * 1e3
        );
    }
    let _ = writeln!(
        text,
        "  gains  proportional_s_per_m = {:?}, integral_per_m = {:?}",
        gains.proportional_s_per_m, gains.integral_per_m
    );
    let before_mm = found.speed_error_m_per_s * 1e3;
    let _ = match after {
        Some(after) => writeln!(
            text,
            "  wheels off their set points by {:.1} mm/s with these gains, {before_mm:.1} mm/s without",
            after * 1e3
        ),
        None => writeln!(text, "  wheels off their set points by {before_mm:.1} mm/s"),
    };
    let (full_speed_m_per_s, friction_power) = found.feed_forward();
    let _ = writeln!(
        text,
        "  for the robot's file: full_speed_m_per_s = {:?}, friction_power = {:?}",
        rounded(full_speed_m_per_s),
        rounded(friction_power)
    );
    console.text(&text)
}
