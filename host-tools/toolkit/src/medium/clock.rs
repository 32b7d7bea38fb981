//! A processor's clock against plant time.

/// Billionths: a clock without drift runs at so many.
const WHOLE: u128 = 1_000_000_000;
/// Picoseconds in a microsecond.
const PS_IN_US: u128 = 1_000_000;
/// A clock that gains or loses more, in millionths, is none.
pub const MAX_DRIFT_PPM: i32 = 100_000;

/// The clock of a processor. It counts microseconds since the processor's robot time began.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clock {
    /// Plant time at which it read 0, in picoseconds.
    began_ps: u64,
    /// What it runs at, in billionths.
    rate: u128,
}

impl Clock {
    /// A clock that read 0 at a plant time and gains `drift_ppb` billionths; a negative number is
    /// one that loses. Beyond [`MAX_DRIFT_PPM`] it is as if it were that.
    #[must_use]
    pub fn new(began_ps: u64, drift_ppb: i32) -> Self {
        let limit = MAX_DRIFT_PPM * 1_000;
        let drift_ppb = i64::from(drift_ppb.clamp(-limit, limit));
        Clock {
            began_ps,
            rate: WHOLE.saturating_add_signed(drift_ppb.into()),
        }
    }

    /// When this clock reaches a time, in picoseconds of plant time.
    #[must_use]
    pub fn plant_ps(&self, local_us: u64) -> u64 {
        let since_ps = self.stretched_ps(u128::from(local_us) * PS_IN_US);
        self.began_ps.saturating_add(since_ps)
    }

    /// How much plant time passes in a time that has so many picoseconds by this clock.
    #[must_use]
    pub fn stretched_ps(&self, local_ps: u128) -> u64 {
        let plant_ps = local_ps.saturating_mul(WHOLE).div_ceil(self.rate);
        u64::try_from(plant_ps).unwrap_or(u64::MAX)
    }

    /// What this clock reads at a plant time: the last whole microsecond.
    #[must_use]
    pub fn local_us(&self, plant_ps: u64) -> u64 {
        let since_ps = u128::from(plant_ps.saturating_sub(self.began_ps));
        (since_ps * self.rate / (PS_IN_US * WHOLE)) as u64
    }
}

/// A processor from one reset to the next: what it was given before is gone, and its clock begins
/// anew.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Life {
    /// Its clock.
    pub clock: Clock,
    /// What has arrived before this plant time is gone, in picoseconds.
    pub from_ps: u64,
    /// It ends here: nothing of it starts any more, and what is being sent ends within.
    pub to_ps: u64,
}

impl Life {
    /// One that neither begins nor ends within a run.
    #[must_use]
    pub fn whole(clock: Clock) -> Self {
        Life {
            clock,
            from_ps: 0,
            to_ps: u64::MAX,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn a_clock_that_gains_reaches_a_time_early() {
        let day_us = 24 * 3_600 * 1_000_000;
        for (drift_ppb, expected_ps) in [
            (0, 86_400_000_000_000_000),
            // A day is 8.64 s longer or shorter, less 100 millionths of that.
            (100_000, 86_391_360_863_913_609),
            (-100_000, 86_408_640_864_086_409),
        ] {
            let clock = Clock::new(7, drift_ppb);
            assert_eq!(clock.plant_ps(day_us), 7 + expected_ps);
            assert_eq!(clock.local_us(7 + expected_ps), day_us);
            assert_eq!(clock.local_us(7 + expected_ps - 1), day_us - 1);
        }
    }

    proptest! {
        #[test]
        fn a_clock_reads_a_time_when_it_reaches_it(
            began_ps in 0..1_u64 << 60,
            drift_ppb in -100_000_000..=100_000_000,
            local_us in 0..100_000_000_000_u64,
        ) {
            let clock = Clock::new(began_ps, drift_ppb);
            prop_assert_eq!(clock.local_us(clock.plant_ps(local_us)), local_us);
            prop_assert!(clock.plant_ps(local_us) < clock.plant_ps(local_us + 1));
        }
    }
}
