//! Timers.
//!
//! The time of a macro step is its number times the period, so timers count macro steps. How many
//! pass before some timer may have run out is kept; it may be too few, never too many. The macro
//! step behind them begins with setting the flags of those that have, wakes whom that concerns, and
//! finds the next. Who is left before its turn in this macro step takes its flag with it: so this
//! is no other than each one's being set when its region is looked at.
//!
//! A state's age is the number of macro steps since the one in which it was entered. Until its
//! timeout flag is set, it is at most one above the highest at which the state is not overdue,
//! which fits in 32 bits. Macro steps that are skipped are added by [`Machine::skip`].

use super::clock::Clock;
use super::events::Fault;
use super::machine::{Blob, Machine, Mark};
use crate::format::{self, Section};
use crate::layout::state;
use crate::reads::access::Access;

/// The most macro steps that a machine can be taken up after: nine thousand years at 1 kHz.
pub const MAX_STEPS: u64 = 1 << 48;

/// A timer that runs.
struct Timer {
    /// The flag of its state.
    flag: usize,
    /// Macro steps since its state was entered.
    age: u32,
    /// The highest age at which it has not run out.
    limit: u32,
}

impl<R: Access> Machine<'_, R> {
    /// The highest age at which a state is not overdue.
    pub(super) fn limit(&self, blob: Blob<'_, R>, state: R::Place) -> u32 {
        let timer = self.record(Section::Timers, self.field(blob, state, state::B));
        // Where no time passes, none runs out.
        R::word(blob, timer)
            .checked_div(self.period_us)
            .unwrap_or(u32::MAX - 1)
    }

    /// Starts the timer of a state that a region instance enters.
    #[inline(never)]
    pub(super) fn start_timer(&mut self, blob: Blob<'_, R>, region: usize, entered: R::Place) {
        self.store(self.places.entered, region, self.clock.now());
        let steps = self.clock.steps_left().min(self.limit(blob, entered) + 1);
        self.clock.look_in(steps);
    }

    /// The timer of the current state of a region instance, if that is active and its timer runs.
    #[cfg_attr(feature = "speed", inline(always))]
    fn timer(&self, blob: Blob<'_, R>, region: usize) -> Option<Timer> {
        let current = self.current_record(region);
        let shape = self.field(blob, current, state::SHAPE) as u16;
        if shape & format::STATE_HAS_TIMEOUT == 0 || !self.is_active_at(region) {
            return None;
        }
        let of_simple = shape >> format::STATE_KIND_SHIFT == format::STATE_SIMPLE;
        let own = self.first_flag(blob, region, current);
        let flag = own + if of_simple { 0 } else { format::FLAG_TIMEOUT };
        let entered = self.load(self.places.entered, region);
        (!self.flag_at(flag)).then(|| Timer {
            flag,
            age: self.clock.now().wrapping_sub(entered),
            limit: self.limit(blob, current),
        })
    }

    /// Sets the flag of each timer that has run out, and wakes its region instance, with all
    /// inside, for whom that is a flag of their instance; finds out when the next may be. A machine
    /// that was stopped has its last macro step again and again, so that no other has to look for
    /// its fault.
    #[cold]
    #[inline(never)]
    pub(super) fn run_timers(&mut self, blob: Blob<'_, R>) -> Result<(), Fault> {
        if let Some(fault) = self.fault {
            self.clock.look_in(1);
            return Err(fault);
        }
        let mut steps = u32::MAX;
        for region in 0..self.layout.regions {
            let Some(timer) = self.timer(blob, region) else {
                continue;
            };
            match timer.limit.checked_sub(timer.age) {
                Some(left) => steps = steps.min(left + 1),
                None => {
                    self.set_flag_to(timer.flag, true);
                    self.mark(region..self.next(blob, region), Mark::Awake, true);
                }
            }
        }
        self.clock.look_in(steps);
        Ok(())
    }

    /// Lets macro steps pass, to [`MAX_STEPS`] at most.
    pub(super) fn skip(&mut self, blob: Blob<'_, R>, missed: u32) {
        let rest = MAX_STEPS.saturating_sub(self.clock.begun());
        let missed = u32::try_from(rest).map_or(missed, |rest| missed.min(rest));
        if !self.clock.skip(missed) {
            self.age_timers(blob, missed);
            self.clock = Clock::at(self.clock.begun() + u64::from(missed), 1);
        }
    }

    /// Lets the timers of states run out that will be overdue when more macro steps have passed.
    /// Their true ages might not fit.
    #[cold]
    #[inline(never)]
    fn age_timers(&mut self, blob: Blob<'_, R>, missed: u32) {
        let next = (self.clock.begun() as u32).wrapping_add(missed);
        for region in 0..self.layout.regions {
            if let Some(Timer { age, limit, .. }) = self.timer(blob, region)
                && limit.saturating_sub(age) <= missed
            {
                let entered = next.wrapping_sub(limit + 1);
                self.store(self.places.entered, region, entered);
            }
        }
    }
}
