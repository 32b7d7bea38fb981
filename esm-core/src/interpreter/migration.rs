//! What a machine takes over from the one that ran before it: a warm swap.
//!
//! A [`StateMapping`] says which regions and states are the same. A region goes on if the region of
//! its path was active, and that one's state exists here under its name and is of the same kind.
//! All else starts at `initial`. Events, slots, parameters and transitions are those of the new
//! machine from its first macro step on. `docs/src/semantics.md` says it for people.
//!
//! Names are not looked at here, nor is anything looked for: time is proportional to the region
//! instances of the new machine, and to the flags of what goes on.

use super::machine::{Blob, Machine, Mark};
use crate::dispatcher::periods_in;
use crate::format::{self, Section};
use crate::layout::{instance, region_instance, state};
use crate::reads::access::Access;
use crate::state_mapping::StateMapping;

/// How much of a machine goes on as it was.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct TakenOver {
    /// Active region instances that have the state of the machine before.
    pub regions: u16,
    /// Active region instances that start anew.
    pub anew: u16,
}

/// A machine, and the blob that it runs.
pub(super) type Running<'b, 'm, R> = (&'b Machine<'m, R>, Blob<'b, R>);

impl<R: Access> Machine<'_, R> {
    /// Takes over what the machine before has in common with this one: states, timers, flags,
    /// enable bits. `states` is the number of states of this one's tables.
    pub(super) fn take_over(
        &mut self,
        blob: Blob<'_, R>,
        before: Running<'_, '_, R>,
        mapping: &StateMapping<'_>,
        states: usize,
    ) -> TakenOver {
        let mut taken_over = TakenOver::default();
        for region in 0..self.layout.regions {
            if !self.is_active_at(region) {
                continue;
            }
            if before.0.fault.is_none()
                && self
                    .take_state(blob, region, before, mapping, states)
                    .is_some()
            {
                taken_over.regions += 1;
            } else {
                taken_over.anew += 1;
            }
        }
        if before.0.fault.is_none() {
            self.take_control_flags(before.0, mapping);
        }
        // Whoever was asleep wakes up once more, and all timers are looked at: too often does no
        // harm.
        self.mark(0..self.layout.regions, Mark::Awake, true);
        self.clock.look_in(1);
        taken_over
    }

    /// The state of a region instance as which the one that its pair is in goes on, with the pair
    /// and that state.
    fn goes_on(
        &self,
        blob: Blob<'_, R>,
        region: usize,
        before: &Machine<'_, R>,
        mapping: &StateMapping<'_>,
        states: usize,
    ) -> Option<(usize, usize, usize)> {
        let pair = mapping.region(region)?;
        let old = before
            .is_marked(pair, Mark::Active)
            .then(|| before.current(pair))?;
        let new = mapping.state(region, old)?;
        // A pairing can be that of other machines, and what is current must be a state of its
        // region: those are from its `initial` to the next one.
        let record = self.record(Section::RegionInstances, region);
        let initial = self.field(blob, record, region_instance::INITIAL);
        let is_initial = |state| {
            let state = self.record(Section::States, state);
            let shape = self.field(blob, state, state::SHAPE) as u16;
            shape >> format::STATE_KIND_SHIFT == format::STATE_INITIAL
        };
        let is_own = (initial..states).contains(&new) && !(initial + 1..=new).any(is_initial);
        is_own.then_some((new, pair, old))
    }

    /// Takes the current state of a region instance over. None where it starts anew.
    fn take_state(
        &mut self,
        blob: Blob<'_, R>,
        region: usize,
        (before, old_blob): Running<'_, '_, R>,
        mapping: &StateMapping<'_>,
        states: usize,
    ) -> Option<()> {
        let (new_index, pair, old_index) = self.goes_on(blob, region, before, mapping, states)?;
        self.set_current(region, new_index);
        let new = self.record(Section::States, new_index);
        let old = before.record(Section::States, old_index);
        let shape = self.field(blob, new, state::SHAPE) as u16;
        let old_shape = before.field(old_blob, old, state::SHAPE) as u16;
        let first_flag = self.first_flag(blob, region, new);
        let old_first = before.first_flag(old_blob, pair, old);
        let around = self.record(Section::RegionInstances, region);
        let instance_index = self.field(blob, around, region_instance::INSTANCE);
        let instance = self.record(Section::Instances, instance_index);
        match shape >> format::STATE_KIND_SHIFT {
            format::STATE_FINAL => {
                let exit = self.field(blob, instance, instance::FIRST_FLAG) + format::FLAG_EXIT;
                self.set_flag_to(exit, true);
            }
            format::STATE_TASK | format::STATE_BACKGROUND_TASK => {
                let flags_of = |shape: u16| usize::from(shape & format::STATE_FLAGS_MASK);
                let flags = flags_of(shape).min(flags_of(old_shape));
                for bit in (0..flags).filter(|bit| *bit != format::FLAG_TIMEOUT) {
                    self.set_flag_to(first_flag + bit, before.flag(old_first + bit));
                }
                let old_around = before.record(Section::RegionInstances, pair);
                let old_instance = before.field(old_blob, old_around, region_instance::INSTANCE);
                let old_instance = before.record(Section::Instances, old_instance);
                let old_task = before.field(old_blob, old_instance, instance::FIRST_TASK)
                    + before.field(old_blob, old, state::A);
                if before.is_enabled(old_task) {
                    let task = self.field(blob, instance, instance::FIRST_TASK)
                        + self.field(blob, new, state::A);
                    self.enable(task);
                }
            }
            format::STATE_SUPER => {
                let inside = instance_index + self.field(blob, new, state::A);
                let inside = self.record(Section::Instances, inside);
                let mut inside = self.field(blob, inside, instance::FIRST_REGION);
                let end = self.next(blob, region);
                while inside < end {
                    self.activate(inside);
                    inside = self.next(blob, inside);
                }
            }
            _ => {}
        }
        if shape & format::STATE_HAS_TIMEOUT != 0 {
            self.take_timer(
                blob,
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
    fn take_control_flags(&mut self, before: &Machine<'_, R>, mapping: &StateMapping<'_>) {
        let flags = self.layout.flag_bits;
        for [region, other, bit, other_bit] in mapping.flags() {
            let was_current = mapping.region(region).is_some_and(|pair| {
                before.current(pair) == other && before.is_marked(pair, Mark::Active)
            });
            if was_current && self.is_marked(region, Mark::Active) && bit < flags {
                self.set_flag_to(bit, before.flag(other_bit));
            }
        }
    }

    /// Takes the time over for which a state has been current, and whether that was too long.
    fn take_timer(
        &mut self,
        blob: Blob<'_, R>,
        region: usize,
        (shape, first_flag): (u16, usize),
        before: &Machine<'_, R>,
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
                let entered = before.load(before.places.entered, pair);
                let steps = u64::from(before.clock.now().wrapping_sub(entered));
                let us = steps * u64::from(before.period_us);
                let limit = self.limit(blob, self.current_record(region));
                let same = match self.period_us {
                    // Where no time passes, none has.
                    0 => 0,
                    period_us => periods_in(us, period_us),
                };
                age = u32::try_from(same).unwrap_or(u32::MAX).min(limit);
            }
        }
        let entered = self.clock.now().wrapping_sub(age);
        self.store(self.places.entered, region, entered);
    }
}
