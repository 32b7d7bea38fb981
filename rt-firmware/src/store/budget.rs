//! How often a flash may be erased: nobody wears it out by asking.
//!
//! What erases is paid for from an allowance, which fills up with time. There is one each for what
//! wears other parts of the flash, or is asked for by others, so that none is used up by another.
//! An emergency stop costs nothing: each release that is kept has paid for the stop that follows
//! it.
//!
//! What is left survives a reset in retained RAM, so that nobody gets a full allowance by forcing
//! resets. It is full when power comes.

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

/// How much may be kept at once, and how much in an hour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Allowance {
    /// At once, after a long rest.
    pub burst: u32,
    /// In the long run, in an hour.
    pub per_hour: u32,
}

/// Missions that are uploaded, and the counters of those that are signed: a signed one takes two.
/// Each erases one slot of two.
pub const UPLOADS: Allowance = Allowance {
    burst: 250,
    per_hour: 30,
};
/// Saved parameters, and releases of an emergency stop, which take two. Each erases both areas of
/// the records.
pub const RECORDS: Allowance = Allowance {
    burst: 30,
    per_hour: 6,
};
/// Keys that are installed or removed.
pub const KEYS: Allowance = Allowance {
    burst: 10,
    per_hour: 2,
};

/// What one kept thing costs of an allowance.
pub(super) const ONE: u32 = 1;
/// A release pays for the stop after it, too.
pub(super) const RELEASE_AND_STOP: u32 = 2;

/// Time is counted in units of 2^20 microseconds, a little more than a second: without a division.
const UNIT_BITS: u32 = 20;
/// Such units in an hour: 3,600,000,000 us / 2^20 us.
const UNITS_PER_HOUR: u32 = 3_433;

/// What is left of an allowance.
#[derive(Clone, Copy, Debug)]
pub(super) struct Budget<'m> {
    /// In units of time.
    left: u32,
    full: u32,
    each: u32,
    /// Where it survives a reset.
    retained: Option<&'m AtomicU32>,
}

impl<'m> Budget<'m> {
    pub(super) const fn new(allowance: Allowance) -> Self {
        let each = UNITS_PER_HOUR.div_ceil(allowance.per_hour);
        let full = each * allowance.burst;
        Budget {
            left: full,
            full,
            each,
            retained: None,
        }
    }

    /// Goes on with what was left before a reset, and keeps what is left there from now on.
    pub(super) fn retain(&mut self, retained: &'m AtomicU32) {
        self.retained = Some(retained);
        self.set_left(retained.load(Relaxed).min(self.full));
    }

    fn set_left(&mut self, left: u32) {
        self.left = left;
        if let Some(retained) = self.retained {
            retained.store(left, Relaxed);
        }
    }

    /// So much time has passed, in units.
    pub(super) fn fill(&mut self, units: u32) {
        self.set_left(self.left.saturating_add(units).min(self.full));
    }

    /// Takes so many out.
    ///
    /// # Errors
    /// There are not so many: the seconds until there are.
    pub(super) fn take(&mut self, count: u32) -> Result<(), u32> {
        let cost = self.each * count;
        match self.left.checked_sub(cost) {
            Some(left) => {
                self.set_left(left);
                Ok(())
            }
            None => {
                let units = cost - self.left;
                // 2^20 microseconds are 1.0486 seconds; and the unit that has begun.
                Err(units + units / 20 + 2)
            }
        }
    }
}

/// The unit of time that this is in.
pub(super) fn unit(now_us: u64) -> u32 {
    (now_us >> UNIT_BITS) as u32
}
