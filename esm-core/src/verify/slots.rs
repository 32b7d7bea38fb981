//! The slots of a mission: their numbers, their times, and that no two are ever due at once.

use core::num::NonZeroU32;

use super::finding::{Entry, Finding};
use crate::format::MAX_TIME_US;
use crate::layout::Slot;
use crate::refusal::Cause;

/// Checks all slots. The interpreter's starts at 0, for the time of a machine is that of its slots.
pub(super) fn check(slots: &[Slot], interpreter_slot: usize) -> Result<(), Finding> {
    for (index, record) in slots.iter().enumerate() {
        let slot = Entry { record, index };
        let period_us = slot.period_us.get();
        let (start_us, duration_us) = (slot.start_us.get(), slot.duration_us.get());
        let is_in_range = slot.number.get() > 0
            && period_us <= MAX_TIME_US
            && duration_us <= period_us
            && start_us < period_us
            && (index != interpreter_slot || start_us == 0);
        slot.ensure(is_in_range, Cause::Range)?;
        slot.ensure(is_free(&slot, slots.iter().take(index)), Cause::Overlap)?;
    }
    Ok(())
}

/// Whether a slot has a number of its own, and is never due together with one of those before it.
fn is_free<'a>(slot: &Slot, mut earlier: impl Iterator<Item = &'a Slot>) -> bool {
    let Some(period_us) = NonZeroU32::new(slot.period_us.get()) else {
        return false;
    };
    // Slots with one period often stand together: the last divisor is kept.
    let (mut other_period_us, mut divisor_us) = (period_us.get(), period_us);
    earlier.all(|other| {
        if other.period_us.get() != other_period_us {
            other_period_us = other.period_us.get();
            divisor_us = greatest_common_divisor(other_period_us, period_us);
        }
        other.number != slot.number && keep_apart(other, slot, divisor_us)
    })
}

/// Whether two slots never overlap, whose periods have this greatest common divisor. Slots are
/// strictly periodic: two of them never overlap if and only if they do not within the divisor
/// (Korst, Aarts, Lenstra 1996). A slot without duration may start where another does.
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

/// By Euclid.
fn greatest_common_divisor(mut a: u32, mut b: NonZeroU32) -> NonZeroU32 {
    while let Some(rest) = NonZeroU32::new(a % b) {
        a = b.get();
        b = rest;
    }
    b
}
