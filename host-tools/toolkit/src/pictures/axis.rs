//! Round numbers along an axis.

pub use crate::duration::time;

/// Positions of marks along an axis from `start` to `end`: multiples of 1, 2 or 5 times a power of
/// ten, at most `most` steps between them. Empty where the axis has no length or is not finite.
pub fn ticks(start: f64, end: f64, most: usize) -> Vec<f64> {
    let step = step(start, end, most);
    if step <= 0.0 {
        return Vec::new();
    }
    // Multiples are counted, not added up, so that no error grows along the axis.
    let first = libm::ceil(start / step - TOLERANCE);
    let count = (libm::floor(end / step + TOLERANCE) - first) as usize + 1;
    (0..count.min(most + 1))
        .map(|index| (first + index as f64) * step)
        .collect()
}

/// The round step that [`ticks`] uses; 0 where there is none.
pub fn step(start: f64, end: f64, most: usize) -> f64 {
    let least = (end - start) / most.max(1) as f64;
    if !least.is_finite() || least <= 0.0 {
        return 0.0;
    }
    let magnitude = libm::pow(10.0, libm::floor(libm::log10(least)));
    let round = [1.0, 2.0, 5.0, 10.0]
        .into_iter()
        .find(|digit| digit * magnitude >= least * (1.0 - TOLERANCE));
    round.unwrap_or(10.0) * magnitude
}

/// Share of a step by which an end of the axis may miss a mark that stands there but for rounding.
const TOLERANCE: f64 = 1e-9;

/// A number without the decimals that say nothing.
pub fn number(value: f64) -> String {
    let text = format!("{value:.3}");
    let text = text.trim_end_matches('0').trim_end_matches('.');
    if text == "-0" {
        "0".into()
    } else {
        text.into()
    }
}

/// What time is told in.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unit {
    /// `us`
    Microseconds,
    /// `ms`
    Milliseconds,
    /// `s`
    Seconds,
}

impl Unit {
    /// The unit in which a stretch of time has numbers that are easy to read.
    pub fn of(length_us: u64) -> Self {
        match length_us {
            ..3_000 => Unit::Microseconds,
            3_000..5_000_000 => Unit::Milliseconds,
            _ => Unit::Seconds,
        }
    }

    /// A time in this unit.
    pub fn of_us(self, us: u64) -> f64 {
        us as f64
            / match self {
                Unit::Microseconds => 1.0,
                Unit::Milliseconds => 1e3,
                Unit::Seconds => 1e6,
            }
    }

    /// What it is called.
    pub fn name(self) -> &'static str {
        match self {
            Unit::Microseconds => "µs",
            Unit::Milliseconds => "ms",
            Unit::Seconds => "s",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_stand_at_round_numbers() {
        let cases: [(f64, f64, usize, &[f64]); 7] = [
            (0.0, 10.0, 5, &[0.0, 2.0, 4.0, 6.0, 8.0, 10.0]),
            (0.0, 9.9, 5, &[0.0, 2.0, 4.0, 6.0, 8.0]),
            (-0.3, 1.1, 4, &[0.0, 0.5, 1.0]),
            (0.0, 0.3, 3, &[0.0, 0.1, 0.2, 0.30000000000000004]),
            (
                0.0,
                120.0,
                12,
                &[
                    0.0, 10.0, 20.0, 30.0, 40.0, 50.0, 60.0, 70.0, 80.0, 90.0, 100.0, 110.0, 120.0,
                ],
            ),
            (1.0, 1.0, 5, &[]),
            (0.0, f64::INFINITY, 5, &[]),
        ];
        for (start, end, most, expected) in cases {
            assert_eq!(
                ticks(start, end, most),
                expected,
                "{start}..{end} in at most {most} steps"
            );
        }
    }

    #[test]
    fn numbers_are_short() {
        for (value, text) in [
            (0.0, "0"),
            (-0.0, "0"),
            (0.5, "0.5"),
            (120.0, "120"),
            (0.30000000000000004, "0.3"),
        ] {
            assert_eq!(number(value), text);
        }
    }
}
