//! What a machine takes over from the one that ran before it: a warm swap.
//!
//! A [`Pairing`] says which regions and states are the same. A region goes on if the region of its path was active, and that one's state exists here under its name and is of the same kind.
//! All else starts at `initial`. Events, slots, parameters and transitions are those of the new machine from its first macro step on. `docs/src/semantics.md` says it for people.
//!
//! Names are not looked at here, nor is anything looked for: time is proportional to the region instances of the new machine, and to the flags of what goes on.

use core::ops::Deref;

use super::{Interpreter, WORD_BITS, bit_of};
use crate::dispatcher::periods_in;
use crate::format::{self, Section};
use crate::layout::{instance, region_instance, state};
use crate::pairing::Pairing;
use crate::reads::Reads;

/// How much of a machine goes on as it was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TakenOver {
    /// Active region instances that have the state of the machine before.
    pub regions: u16,
    /// Active region instances that start anew.
    pub anew: u16,
}

impl<B: Deref<Target = [u8]>, R: Reads<B>> Interpreter<'_, B, R> {
    /// Takes over what the machine before has in common with this one: states, timers, flags, enable bits. To be called before the first macro step, between two
    /// macro steps of the other, which goes no further. A machine that stopped by a fault hands over nothing, nor does one without names.
    ///
    /// `pairing` is what was [found](Pairing::find) for the tables of both, this machine's first. That of other machines gives nonsense, but no memory is at risk.
    pub fn take_over(
        &mut self,
        before: &Interpreter<'_, B, R>,
        pairing: &Pairing<'_>,
    ) -> TakenOver {
        let mut taken_over = TakenOver::default();
        for region in 0..self.layout.regions {
            if !self.is_active_at(region) {
                continue;
            }
            if before.fault.is_none() && self.take_state(region, before, pairing).is_some() {
                taken_over.regions += 1;
            } else {
                taken_over.anew += 1;
            }
        }
        if before.fault.is_none() {
            self.take_control_flags(before, pairing);
        }
        // Whoever was asleep wakes up once more, and all timers are looked at: too often does no harm.
        self.wake_all(0..self.layout.regions);
        self.clock.look_in(1);
        taken_over
    }

    /// The state of a region instance as which the one that its pair is in goes on, with the pair and that state.
    fn goes_on(
        &self,
        region: usize,
        before: &Interpreter<'_, B, R>,
        pairing: &Pairing<'_>,
    ) -> Option<(usize, usize, usize)> {
        let pair = pairing.region(region)?;
        let old = before
            .is_region_active(pair)
            .then(|| before.current(pair))?;
        let new = pairing.state(region, old)?;
        // A pairing can be that of other machines, and what is current must be a state of its region: those are from its `initial` to the next one.
        let initial = self.field(
            self.record(Section::RegionInstances, region),
            region_instance::INITIAL,
        );
        let is_initial = |state| {
            let shape = self.field(self.record(Section::States, state), state::SHAPE) as u16;
            shape >> format::STATE_KIND_SHIFT == format::STATE_INITIAL
        };
        let is_own = (initial..self.verified.tables().state_count()).contains(&new)
            && !(initial + 1..=new).any(is_initial);
        is_own.then_some((new, pair, old))
    }

    /// Takes the current state of a region instance over. None where it starts anew.
    fn take_state(
        &mut self,
        region: usize,
        before: &Interpreter<'_, B, R>,
        pairing: &Pairing<'_>,
    ) -> Option<()> {
        let (new_index, pair, old_index) = self.goes_on(region, before, pairing)?;
        self.set_current(region, new_index);
        let new = self.record(Section::States, new_index);
        let old = before.record(Section::States, old_index);
        let shape = self.field(new, state::SHAPE) as u16;
        let old_shape = before.field(old, state::SHAPE) as u16;
        let first_flag = self.first_flag(region, new);
        let old_first = before.first_flag(pair, old);
        let around = self.record(Section::RegionInstances, region);
        let instance_index = self.field(around, region_instance::INSTANCE);
        let instance = self.record(Section::Instances, instance_index);
        match shape >> format::STATE_KIND_SHIFT {
            format::STATE_FINAL => {
                let exit = self.field(instance, instance::FIRST_FLAG) + format::FLAG_EXIT;
                self.set_flag_to(exit, true);
            }
            format::STATE_TASK | format::STATE_BACKGROUND_TASK => {
                let flags_of = |shape: u16| usize::from(shape & format::STATE_FLAGS_MASK);
                let flags = flags_of(shape).min(flags_of(old_shape));
                for bit in (0..flags).filter(|bit| *bit != format::FLAG_TIMEOUT) {
                    self.set_flag_to(first_flag + bit, before.flag(old_first + bit));
                }
                let old_around = before.record(Section::RegionInstances, pair);
                let old_instance = before.field(old_around, region_instance::INSTANCE);
                let old_instance = before.record(Section::Instances, old_instance);
                let old_task =
                    before.field(old_instance, instance::FIRST_TASK) + before.field(old, state::A);
                if before.is_enabled(old_task) {
                    let task =
                        self.field(instance, instance::FIRST_TASK) + self.field(new, state::A);
                    self.enable(task);
                }
            }
            format::STATE_SUPER => {
                let inside = instance_index + self.field(new, state::A);
                let inside = self.record(Section::Instances, inside);
                let mut inside = self.field(inside, instance::FIRST_REGION);
                let end = self.next(region);
                while inside < end {
                    let word = inside / WORD_BITS;
                    self.set_active(word, self.active(word) | bit_of(inside));
                    inside = self.next(inside);
                }
            }
            _ => {}
        }
        if shape & format::STATE_HAS_TIMEOUT != 0 {
            self.take_timer(
                region,
                (shape, first_flag),
                before,
                pair,
                (old_shape, old_first),
            );
        }
        Some(())
    }

    /// Takes the control flags of superstates over that go on: those of the same name.
    fn take_control_flags(&mut self, before: &Interpreter<'_, B, R>, pairing: &Pairing<'_>) {
        let flags = WORD_BITS * (self.layout.enabled - self.layout.flags);
        for [region, other, bit, other_bit] in pairing.flags() {
            let was_current = pairing
                .region(region)
                .is_some_and(|pair| before.current(pair) == other && before.is_region_active(pair));
            if was_current && self.is_region_active(region) && bit < flags {
                self.set_flag_to(bit, before.flag(other_bit));
            }
        }
    }

    /// Takes the time over for which a state has been current, and whether that was too long.
    fn take_timer(
        &mut self,
        region: usize,
        (shape, first_flag): (u16, usize),
        before: &Interpreter<'_, B, R>,
        pair: usize,
        (old_shape, old_first): (u16, usize),
    ) {
        let flag = |shape: u16| match shape >> format::STATE_KIND_SHIFT {
            format::STATE_SIMPLE => 0,
            _ => format::FLAG_TIMEOUT,
        };
        let mut age = 0;
        if old_shape & format::STATE_HAS_TIMEOUT != 0 {
            if before.flag(old_first + flag(old_shape)) {
                self.set_flag_to(first_flag + flag(shape), true);
            } else {
                let entered = before.load(before.parts.entered, pair);
                let steps = u64::from(before.clock.now().wrapping_sub(entered));
                let us = steps * u64::from(before.period_us);
                let limit = self.limit(self.current_record(region));
                let same = match self.period_us {
                    // Where no time passes, none has.
                    0 => 0,
                    period_us => periods_in(us, period_us),
                };
                age = u32::try_from(same).unwrap_or(u32::MAX).min(limit);
            }
        }
        let entered = self.clock.now().wrapping_sub(age);
        self.store(self.parts.entered, region, entered);
    }
}
