//! A motor's model, and how it is found in a drive.

use thiserror::Error;

use super::drive::WheelDrive;

/// A motor with its wheel: a first-order lag behind a dead zone.
///
/// At the power p, from -1 to 1, the speed v goes to k (p - f · sign p), and comes within 1/e of
/// that in the time τ. k (1 - f) is the speed at full power.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motor {
    /// Speed at full power, in metres per second.
    pub full_speed_m_per_s: f64,
    /// f: the power that friction takes.
    pub friction_power: f64,
    /// τ, in seconds.
    pub lag_s: f64,
    /// By how much the model misses what was measured (root of the mean square), in metres per
    /// second.
    pub error_m_per_s: f64,
}

impl Motor {
    /// k: speed for each unit of power above friction, in metres per second.
    pub fn gain_m_per_s(&self) -> f64 {
        self.full_speed_m_per_s / (1.0 - self.friction_power)
    }
}

/// A drive says nothing of a motor.
#[derive(Clone, Copy, Debug, PartialEq, Error)]
pub enum FitError {
    /// It hardly moved.
    #[error("the wheel turned for {0:.1} s; at least {LEAST_S} s are needed")]
    TooShort(f64),
    /// More power does not make it faster.
    #[error("the wheel does not turn faster with more power: does its encoder count backwards?")]
    NoGain,
    /// All at one speed.
    #[error("the wheel had one speed: friction does not show; drive at two speeds or more")]
    OneSpeed,
    /// The model is none of it.
    #[error(
        "the wheel does not follow its motor: the best model misses its speed by {error_mm_per_s:.0} mm/s of {speed_mm_per_s:.0}"
    )]
    NoModel {
        /// What it misses by, in mm/s.
        error_mm_per_s: f64,
        /// Its speed (root of the mean square), in mm/s.
        speed_mm_per_s: f64,
    },
}

/// So long a wheel must have turned, in seconds.
const LEAST_S: f64 = 3.0;

/// A wheel turns that is faster than this, in metres per second.
const TURNS_M_PER_S: f64 = 0.02;

/// The lags that are looked at, in seconds.
const LAGS_S: (f64, f64) = (0.005, 1.0);
/// Steps between them, each longer by the same factor.
const COARSE_STEPS: u32 = 60;
/// Then the best is looked for between its neighbours, in so many steps by the golden section.
const FINE_STEPS: u32 = 40;

/// A model that misses more than this part of the speed is none.
const WORST_PART: f64 = 0.35;

/// The most that friction may take.
const MOST_FRICTION: f64 = 0.7;

/// A model for one lag.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    gain: f64,
    /// Gain times friction.
    loss: f64,
    squares: f64,
}

/// Finds the model of a motor.
///
/// For a given lag the speed is linear in k and k f: v = k · L(p) - k f · L(sign p), where L is the
/// lag. So for each lag the two are found by least squares, and of all lags the one is taken that
/// leaves the least error: what is compared is the model's speed from the start on, not from sample
/// to sample, so that the steps of the encoders do not bias it.
///
/// # Errors
/// If the drive says nothing of the motor.
pub fn fit(drive: &WheelDrive) -> Result<Motor, FitError> {
    let samples = || drive.runs.iter().flatten();
    let turning = samples().filter(|sample| sample.speed_m_per_s.abs() > TURNS_M_PER_S);
    let turning_s = turning.count() as f64 * drive.period_s;
    if turning_s < LEAST_S {
        return Err(FitError::TooShort(turning_s));
    }
    let (shortest_s, longest_s) = LAGS_S;
    let step = libm::log(longest_s / shortest_s) / f64::from(COARSE_STEPS);
    let lag_at = |place: f64| shortest_s * libm::exp(step * place);
    let squares =
        |place: f64| candidate(drive, lag_at(place)).map_or(f64::INFINITY, |found| found.squares);
    let mut best = (f64::INFINITY, 0);
    for place in 0..=COARSE_STEPS {
        let left = squares(f64::from(place));
        if left < best.0 {
            best = (left, place);
        }
    }
    let place = golden_section(f64::from(best.1) - 1.0, f64::from(best.1) + 1.0, squares);
    let lag_s = lag_at(place);
    let found = candidate(drive, lag_s).ok_or(FitError::OneSpeed)?;
    if found.gain <= 0.0 {
        return Err(FitError::NoGain);
    }
    let friction_power = found.loss / found.gain;
    let count = samples().count() as f64;
    let speed_squares: f64 = samples().map(|sample| square(sample.speed_m_per_s)).sum();
    let error_m_per_s = libm::sqrt(found.squares / count);
    let speed_m_per_s = libm::sqrt(speed_squares / count);
    if error_m_per_s > WORST_PART * speed_m_per_s || friction_power > MOST_FRICTION {
        return Err(FitError::NoModel {
            error_mm_per_s: error_m_per_s * 1e3,
            speed_mm_per_s: speed_m_per_s * 1e3,
        });
    }
    Ok(Motor {
        full_speed_m_per_s: found.gain * (1.0 - friction_power),
        friction_power,
        lag_s,
        error_m_per_s,
    })
}

/// The best model with this lag. None where the drive does not tell gain from friction.
fn candidate(drive: &WheelDrive, lag_s: f64) -> Option<Candidate> {
    let keeps = libm::exp(-drive.period_s / lag_s);
    let [mut pp, mut ps, mut ss, mut pv, mut sv, mut vv] = [0.0; 6];
    for run in &drive.runs {
        // What was before is not known: as if it had been so for long.
        let first = run.first().map_or(0.0, |sample| sample.power);
        let (mut power, mut sign) = (first, sign_of(first));
        let mut given = first;
        for sample in run {
            power = keeps * power + (1.0 - keeps) * given;
            sign = keeps * sign + (1.0 - keeps) * sign_of(given);
            given = sample.power;
            let speed = sample.speed_m_per_s;
            pp += power * power;
            ps += power * sign;
            ss += sign * sign;
            pv += power * speed;
            sv += sign * speed;
            vv += speed * speed;
        }
    }
    /// Below it all is one speed.
    const LEAST_DETERMINANT: f64 = 1e-3;
    let determinant = pp * ss - ps * ps;
    if determinant <= LEAST_DETERMINANT * pp * ss {
        return None;
    }
    let mut gain = (pv * ss - sv * ps) / determinant;
    let mut loss = (pv * ps - sv * pp) / determinant;
    if loss < 0.0 {
        // No friction pushes.
        (gain, loss) = (pv / pp, 0.0);
    }
    let squares = vv - 2.0 * (gain * pv - loss * sv) + gain * gain * pp - 2.0 * gain * loss * ps
        + loss * loss * ss;
    Some(Candidate {
        gain,
        loss,
        squares: squares.max(0.0),
    })
}

fn sign_of(power: f64) -> f64 {
    if power == 0.0 { 0.0 } else { power.signum() }
}

fn square(value: f64) -> f64 {
    value * value
}

/// Where a function with one valley is least, between two places.
fn golden_section(mut from: f64, mut to: f64, value: impl Fn(f64) -> f64) -> f64 {
    /// 2 / (1 + √5).
    const PART: f64 = 0.618_033_988_749_895;
    let mut inner = (to - PART * (to - from), from + PART * (to - from));
    let mut values = (value(inner.0), value(inner.1));
    for _ in 0..FINE_STEPS {
        if values.0 <= values.1 {
            to = inner.1;
            inner = (to - PART * (to - from), inner.0);
            values = (value(inner.0), values.0);
        } else {
            from = inner.0;
            inner = (inner.1, from + PART * (to - from));
            values = (values.1, value(inner.1));
        }
    }
    (from + to) / 2.0
}

#[cfg(test)]
mod tests {
    use super::super::drive::WheelSample;
    use super::*;

    const PERIOD_S: f64 = 0.01;

    /// What a motor does with powers, each for so many seconds. Speeds are told in steps, as an
    /// encoder does.
    fn driven(motor: Motor, powers: &[(f64, f64)], step_m_per_s: f64) -> WheelDrive {
        let mut speed = 0.0;
        let mut given = 0.0;
        let keeps = libm::exp(-PERIOD_S / motor.lag_s);
        let mut run = Vec::new();
        for (power, time_s) in powers {
            for _ in 0..(time_s / PERIOD_S) as usize {
                let above = f64::max(f64::abs(given) - motor.friction_power, 0.0) * sign_of(given);
                speed = keeps * speed + (1.0 - keeps) * motor.gain_m_per_s() * above;
                given = *power;
                run.push(WheelSample {
                    set_m_per_s: 0.0,
                    power: given,
                    speed_m_per_s: libm::round(speed / step_m_per_s) * step_m_per_s,
                });
            }
        }
        WheelDrive {
            period_s: PERIOD_S,
            runs: vec![run],
        }
    }

    const POWERS: [(f64, f64); 8] = [
        (0.0, 0.5),
        (0.3, 1.0),
        (0.0, 0.5),
        (-0.3, 1.0),
        (0.7, 1.5),
        (0.0, 0.5),
        (-0.7, 1.5),
        (0.2, 1.0),
    ];

    #[test]
    fn the_model_of_a_motor_is_found_again() {
        for (full_speed_m_per_s, friction_power, lag_s) in
            [(0.68, 0.05, 0.08), (0.4, 0.0, 0.02), (1.5, 0.12, 0.3)]
        {
            let motor = Motor {
                full_speed_m_per_s,
                friction_power,
                lag_s,
                error_m_per_s: 0.0,
            };
            let found = fit(&driven(motor, &POWERS, 0.014)).expect("a model");
            assert!(
                (found.full_speed_m_per_s / full_speed_m_per_s - 1.0).abs() < 0.02,
                "{found:?}"
            );
            assert!(
                (found.friction_power - friction_power).abs() < 0.01,
                "{found:?}"
            );
            assert!((found.lag_s / lag_s - 1.0).abs() < 0.1, "{found:?}");
            assert!(found.error_m_per_s < 0.01, "{found:?}");
        }
    }

    #[test]
    fn a_drive_that_says_nothing_is_refused_with_the_reason() {
        let motor = Motor {
            full_speed_m_per_s: 0.6,
            friction_power: 0.05,
            lag_s: 0.08,
            error_m_per_s: 0.0,
        };
        let stood = driven(motor, &[(0.0, 10.0)], 0.001);
        assert_eq!(fit(&stood), Err(FitError::TooShort(0.0)));
        let mut backwards = driven(motor, &POWERS, 0.001);
        for sample in backwards.runs.iter_mut().flatten() {
            sample.speed_m_per_s = -sample.speed_m_per_s;
        }
        assert_eq!(fit(&backwards), Err(FitError::NoGain));
        let steady = driven(motor, &[(0.5, 10.0)], 0.001);
        assert_eq!(fit(&steady), Err(FitError::OneSpeed));
        let mut apart = driven(motor, &POWERS, 0.001);
        for (index, sample) in apart.runs.iter_mut().flatten().enumerate() {
            sample.speed_m_per_s = if index / 37 % 3 == 0 {
                0.3
            } else {
                sample.power
            };
        }
        let no_model = fit(&apart);
        assert!(
            matches!(no_model, Err(FitError::NoModel { .. })),
            "{no_model:?}"
        );
    }
}
