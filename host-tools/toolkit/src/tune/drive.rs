//! What a recording tells of the wheels: their set points, powers and speeds, sample by sample.

use thiserror::Error;

use crate::parameters::Value;
use crate::recording::player::Recording;
use crate::recording::samples::{BadSamples, Sample};

/// What a wheel was to do, got and did at one moment.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelSample {
    /// How fast it was to roll, in metres per second.
    pub set_m_per_s: f64,
    /// What its motor got from now on, -1 to 1.
    pub power: f64,
    /// How fast it has rolled since the sample before, in metres per second.
    pub speed_m_per_s: f64,
}

/// The drive of one wheel.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct WheelDrive {
    /// Time between two samples, in seconds.
    pub period_s: f64,
    /// Samples without a gap between them.
    pub runs: Vec<Vec<WheelSample>>,
}

impl WheelDrive {
    /// By how much the wheel missed its set point while it was to roll (root of the mean square),
    /// in metres per second. What it does in a period it can have been told one before at the
    /// latest.
    pub fn error_m_per_s(&self) -> f64 {
        let (mut squares, mut count) = (0.0, 0_u64);
        for pair in self.runs.iter().flat_map(|run| run.windows(2)) {
            if let [before, now] = pair
                && before.set_m_per_s != 0.0
            {
                let lack = before.set_m_per_s - now.speed_m_per_s;
                squares += lack * lack;
                count += 1;
            }
        }
        if count == 0 {
            return 0.0;
        }
        libm::sqrt(squares / count as f64)
    }
}

/// A recording tells too little of the wheels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum DriveError {
    /// The values make no sense.
    #[error(transparent)]
    Samples(#[from] BadSamples),
    /// They are not there.
    #[error(
        "the recording has no values of wheels: what is needed are `WheelSpeed`'s `control` and `Odometry`'s `speeds`, both on a net, as in missions/tune.esm"
    )]
    NoWheels,
    /// They are too far apart.
    #[error(
        "the values are {} ms apart, and a motor is faster than that: record with `--sample '0 s'`, in a mission whose interpreter has a period of at most {} ms",
        .0 / 1_000,
        LONGEST_PERIOD_US / 1_000
    )]
    TooFarApart(u64),
}

/// The longest time between two samples, in microseconds.
pub const LONGEST_PERIOD_US: u64 = 20_000;

/// What is looked for, by the names of fields: left and right of each.
const SET_POINTS: [&str; 2] = ["left_set_m_per_s", "right_set_m_per_s"];
const POWERS: [&str; 2] = ["left_power", "right_power"];
const SPEEDS: [&str; 2] = ["left_m_per_s", "right_m_per_s"];

/// What a recording tells of the left and of the right wheel.
///
/// # Errors
/// If it tells too little.
pub fn wheels_of(recording: &Recording) -> Result<[WheelDrive; 2], DriveError> {
    let mut moments = Vec::new();
    for sample in recording.samples() {
        let sample = sample?;
        if let Some(wheels) = wheels_at(&sample) {
            moments.push(((sample.stretch, sample.mission), sample.t_us, wheels));
        }
    }
    let steps = moments.windows(2).filter_map(|pair| match pair {
        [(drive, from_us, _), (next, to_us, _)] if drive == next => to_us.checked_sub(*from_us),
        _ => None,
    });
    let mut steps_us: Vec<u64> = steps.filter(|step_us| *step_us > 0).collect();
    steps_us.sort_unstable();
    let period_us = *(steps_us.get(steps_us.len() / 2)).ok_or(DriveError::NoWheels)?;
    if period_us > LONGEST_PERIOD_US {
        return Err(DriveError::TooFarApart(period_us));
    }
    let mut drives = [(); 2].map(|()| WheelDrive {
        period_s: period_us as f64 / 1e6,
        runs: Vec::new(),
    });
    let mut before = None;
    for (drive, t_us, wheels) in moments {
        let goes_on = before == Some((drive, t_us.saturating_sub(period_us)));
        before = Some((drive, t_us));
        for (drive, wheel) in drives.iter_mut().zip(wheels) {
            match drive.runs.last_mut() {
                Some(run) if goes_on => run.push(wheel),
                _ => drive.runs.push(vec![wheel]),
            }
        }
    }
    Ok(drives)
}

/// The wheels at one moment, if the sample tells of them.
fn wheels_at(sample: &Sample) -> Option<[WheelSample; 2]> {
    let field = |name: &str| {
        sample
            .nets
            .iter()
            .zip(&sample.values)
            .find_map(|(net, values)| {
                let at = (net.fields.iter()).position(|field| *field.name == *name)?;
                match values.as_deref()?.get(at)? {
                    Value::F32(value) => Some(f64::from(*value)),
                    _ => None,
                }
            })
    };
    let wheel = |side: usize| {
        Some(WheelSample {
            set_m_per_s: field(SET_POINTS.get(side)?)?,
            power: field(POWERS.get(side)?)?,
            speed_m_per_s: field(SPEEDS.get(side)?)?,
        })
    };
    Some([wheel(0)?, wheel(1)?])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wheel_misses_its_set_point_by_what_it_does_one_period_later() {
        let sample = |set_m_per_s, speed_m_per_s| WheelSample {
            set_m_per_s,
            power: 0.0,
            speed_m_per_s,
        };
        let drive = WheelDrive {
            period_s: 0.01,
            runs: vec![
                vec![sample(0.3, 0.0), sample(0.3, 0.27), sample(0.0, 0.26)],
                vec![sample(0.0, 9.0), sample(0.0, 9.0)],
            ],
        };
        let expected = libm::sqrt((0.03 * 0.03 + 0.04 * 0.04) / 2.0);
        assert!((drive.error_m_per_s() - expected).abs() < 1e-12);
        assert_eq!(WheelDrive::default().error_m_per_s(), 0.0);
    }
}
