//! New readings of sonars, each once.

use crate::tasks::{Bearing, MAX_SONARS, Ranges};

/// A reading is that of a new ping if it is younger than the last one that was used by more than
/// this, in microseconds. A sonar pings every 80 ms, and what it said stays on its net for 40 ms.
const APART_US: u32 = 50_000;

/// What a new ping measured.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Ping {
    /// Where the sonar looks.
    pub bearing: Bearing,
    /// Free way from the rim, in metres; [`Ranges::FAR_M`] where nothing is in range.
    pub range_m: f32,
    /// Time since the ping, in microseconds.
    pub age_us: u32,
}

/// Which readings were used.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pings {
    /// Time since the ping of each sonar that was used last, in microseconds.
    used_us: [u32; MAX_SONARS],
}

impl Default for Pings {
    fn default() -> Self {
        Self::NONE
    }
}

impl Pings {
    /// None was used.
    pub const NONE: Self = Self {
        used_us: [u32::MAX; MAX_SONARS],
    };

    /// The readings that are new after `period_us`. What is not known is not among them.
    pub fn fresh<'a>(
        &'a mut self,
        ranges: &'a Ranges,
        period_us: u32,
    ) -> impl Iterator<Item = Ping> + 'a {
        const US_PER_MS: u32 = 1_000;
        let rows = self.used_us.iter_mut().zip(ranges.readings());
        rows.filter_map(move |(used_us, reading)| {
            *used_us = used_us.saturating_add(period_us);
            let range_m = reading.range_m?;
            let age_us = u32::from(reading.age_ms) * US_PER_MS;
            if age_us.saturating_add(APART_US) >= *used_us {
                return None;
            }
            *used_us = age_us;
            Some(Ping {
                bearing: reading.bearing,
                range_m,
                age_us,
            })
        })
    }
}

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use super::*;

    #[test]
    fn each_ping_is_used_once_and_what_is_unknown_never() {
        let mut pings = Pings::default();
        let mut ranges = Ranges::FREE;
        ranges.range_m[3] = 0.0;
        // Ages as a ring publishes them every 40 ms, read every 20 ms.
        for (age_ms, is_new) in [
            (40, true),
            (40, false),
            (80, false),
            (80, false),
            (40, true),
            (40, false),
            (80, false),
            (80, false),
            (120, false), // An echo was lost.
            (120, false),
            (160, false),
            (160, false),
            (40, true),
        ] {
            ranges.age_ms = [age_ms; MAX_SONARS];
            let fresh: Vec<Bearing> = (pings.fresh(&ranges, 20_000))
                .map(|ping| ping.bearing)
                .collect();
            assert_eq!(fresh.len(), if is_new { 7 } else { 0 }, "{age_ms}");
            assert!(!fresh.contains(&Bearing::BehindLeft), "it is unknown");
        }
    }
}
