//! How robot time goes with a board's clock.

/// When the robot's time began, by the clock of a device. Ticks a microsecond are the device's.
#[derive(Clone, Copy, Debug, Default)]
pub struct RobotClock {
    origin_ticks: u64,
}

impl RobotClock {
    /// An activation starts at this time by the one and by the other.
    #[inline(always)]
    pub fn note(&mut self, start_us: u64, start_ticks: u64, ticks_per_us: u32) {
        self.origin_ticks = start_ticks.wrapping_sub(start_us * u64::from(ticks_per_us));
    }

    /// The clock at a robot time.
    #[must_use]
    pub fn ticks(&self, robot_us: u64, ticks_per_us: u32) -> u64 {
        self.origin_ticks
            .wrapping_add(robot_us * u64::from(ticks_per_us))
    }

    /// The robot time at a time of the clock; none where that is behind `until_us`.
    #[must_use]
    pub fn us_by(&self, until_us: u64, at_ticks: u64, ticks_per_us: u32) -> Option<u64> {
        let before_ticks = self.ticks(until_us, ticks_per_us).checked_sub(at_ticks)?;
        let before_ticks = u32::try_from(before_ticks).unwrap_or(u32::MAX);
        Some(until_us.saturating_sub((before_ticks / ticks_per_us.max(1)).into()))
    }
}
