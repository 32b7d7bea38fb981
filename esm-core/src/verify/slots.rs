//! The slots of a mission: their numbers, their times, and that no two are ever due at once.

use core::num::NonZeroU32;

use super::finding::{Entry, Finding};
use crate::format::MAX_TIME_US;
use crate::layout::Slot;
use crate::refusal::Cause;

/// Checks all slots. The interpreter's starts at 0, for the time of a machine is that of its slots.
pub(super) fn check(slots: &[Slot], interpreter_slot: usize) -> Result<(), Finding> {
    let mut highest_number = 0;
    for (index, record) in slots.iter().enumerate() {
        let slot = Entry { record, index };
        let (number, period_us) = (slot.number.get(), slot.period_us.get());
        let (start_us, duration_us) = (slot.start_us.get(), slot.duration_us.get());
        let is_in_range = number > 0
            && period_us <= MAX_TIME_US
            && duration_us <= period_us
            && start_us < period_us
            && (slot.index != interpreter_slot || start_us == 0);
        slot.ensure(is_in_range, Cause::Range)?;

        let earlier = slots.get(..slot.index).unwrap_or(&[]);
        // Most missions number their slots in ascending order.
        let is_new = number > highest_number || earlier.iter().all(|it| it.number.get() != number);
        slot.ensure(is_new && is_free(&slot, earlier), Cause::Overlap)?;
        highest_number = highest_number.max(number);
    }
    Ok(())
}

/// Whether a slot is never due together with one of those before it.
fn is_free(slot: &Slot, earlier: &[Slot]) -> bool {
    let mut divisors = match NonZeroU32::new(slot.period_us.get()) {
        Some(period_us) => Divisors::of(period_us),
        None => return false,
    };
    earlier.iter().all(|other| {
        let divisor_us = divisors.with(other.period_us.get());
        keep_apart(other, slot, divisor_us)
    })
}

/// Whether two slots never overlap, whose periods have this greatest common divisor. Slots are strictly periodic: two of
/// them never overlap if and only if they do not within the divisor (Korst, Aarts, Lenstra 1996). A slot without duration
/// may start where another does.
fn keep_apart(other: &Slot, slot: &Slot, divisor_us: NonZeroU32) -> bool {
    let duration_us = slot.duration_us.get();
    // How much later than the other one it starts, within the divisor.
    let start_us = slot.start_us.get() % divisor_us;
    let (mut after_us, is_before) = start_us.overflowing_sub(other.start_us.get() % divisor_us);
    if is_before || (after_us == 0 && duration_us == 0) {
        after_us = after_us.wrapping_add(divisor_us.get());
    }
    other.duration_us.get() <= after_us && duration_us <= divisor_us.get() - after_us
}

/// Greatest common divisors of one period with others. Few periods occur in a mission, and many slots have each: so the
/// last divisors are remembered.
struct Divisors {
    period_us: NonZeroU32,
    /// Periods with their divisors, each in the place that the period gives it.
    known: [(u32, NonZeroU32); 1 << Self::PLACE_BITS],
}

impl Divisors {
    const PLACE_BITS: u32 = 3;

    fn of(period_us: NonZeroU32) -> Self {
        let known = [(period_us.get(), period_us); _];
        Self { period_us, known }
    }

    /// The greatest common divisor with another period.
    #[cfg_attr(feature = "speed", inline(always))]
    fn with(&mut self, other_us: u32) -> NonZeroU32 {
        // The highest bits of a product depend on all bits of its factors (Knuth 6.4, Fibonacci hashing).
        const GOLDEN: u32 = 0x9E37_79B1;
        let place = other_us.wrapping_mul(GOLDEN) >> (u32::BITS - Self::PLACE_BITS);
        let (known_us, divisor_us) = &mut self.known[place as usize];
        if *known_us != other_us {
            *known_us = other_us;
            *divisor_us = greatest_common_divisor(other_us, self.period_us);
        }
        *divisor_us
    }
}

/// By Euclid.
fn greatest_common_divisor(mut a: u32, mut b: NonZeroU32) -> NonZeroU32 {
    while let Some(rest) = NonZeroU32::new(a % b) {
        a = b.get();
        b = rest;
    }
    b
}
