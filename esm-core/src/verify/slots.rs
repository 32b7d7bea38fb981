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

#[cfg(test)]
mod tests {
    use std::vec::Vec;

    use proptest::prelude::*;
    use zerocopy::little_endian::U32;

    use super::*;
    use crate::format::Section;
    use crate::refusal::Refusal;

    /// Number, period, duration and start of a slot.
    type Numbers = (u32, u32, u32, u32);

    fn checked(slots: &[Numbers], interpreter_slot: usize) -> Result<(), (usize, Cause)> {
        let records: Vec<Slot> = slots
            .iter()
            .map(|&(number, period_us, duration_us, start_us)| Slot {
                number: U32::new(number),
                period_us: U32::new(period_us),
                duration_us: U32::new(duration_us),
                start_us: U32::new(start_us),
            })
            .collect();
        check(&records, interpreter_slot).map_err(|finding| match Refusal::from(finding) {
            Refusal::Record {
                section: Section::Slots,
                index,
                cause,
            } => (usize::from(index), cause),
            other => panic!("no finding about a slot: {other:?}"),
        })
    }

    /// What the check must say, where `overlap` tells of any two slots whether they do.
    fn expected(
        slots: &[Numbers],
        interpreter_slot: usize,
        overlap: impl Fn(Numbers, Numbers) -> bool,
    ) -> Result<(), (usize, Cause)> {
        for (index, &slot) in slots.iter().enumerate() {
            let (number, period_us, duration_us, start_us) = slot;
            if number == 0
                || period_us == 0
                || period_us > MAX_TIME_US
                || duration_us > period_us
                || start_us >= period_us
                || (index == interpreter_slot && start_us != 0)
            {
                return Err((index, Cause::Range));
            }
            let mut earlier = slots[..index].iter();
            if earlier.any(|&other| other.0 == number || overlap(other, slot)) {
                return Err((index, Cause::Overlap));
            }
        }
        Ok(())
    }

    /// Compares each execution of one slot with each of another, until both begin anew together.
    fn overlap_at_some_time(one: Numbers, other: Numbers) -> bool {
        let [one, other] = [one, other].map(|(_, period_us, duration_us, start_us)| {
            [period_us, duration_us, start_us].map(i64::from)
        });
        let starts = |[period, _, start]: [i64; 3], count: i64| {
            (-count..2 * count).map(move |number| start + number * period)
        };
        starts(one, other[0]).any(|start| {
            starts(other, one[0])
                .any(|other_start| start < other_start + other[1] && other_start < start + one[1])
        })
    }

    /// The same for any periods, by their greatest common divisor: `distance` later than the one
    /// the other starts, and again the divisor later.
    fn overlap_within_divisor(one: Numbers, other: Numbers) -> bool {
        let divisor = (1..=u64::from(one.1.min(other.1)))
            .rev()
            .find(|divisor| {
                u64::from(one.1).is_multiple_of(*divisor)
                    && u64::from(other.1).is_multiple_of(*divisor)
            })
            .expect("1 divides all");
        let distance =
            (u64::from(other.3) % divisor + divisor - u64::from(one.3) % divisor) % divisor;
        let ends_first =
            |distance| u64::from(one.2) <= distance && distance + u64::from(other.2) <= divisor;
        // Both start at once: one of them must be without duration.
        !(ends_first(distance) || (distance == 0 && ends_first(divisor)))
    }

    /// Slots with few different periods, so that these repeat, most of them right in themselves.
    /// Numbers ascend, descend, or are any.
    fn slots(periods: &'static [u32]) -> impl Strategy<Value = Vec<Numbers>> {
        let slot = (
            0..8_u32,
            prop::sample::select(periods),
            // Short ones, so that some fit beside each other.
            prop_oneof![Just(0), 0..200_u32, 0..1_000_u32],
            any::<u32>(),
            prop::bool::weighted(0.02),
        );
        (prop::collection::vec(slot, 0..7), 0..3_u8).prop_map(|(slots, order)| {
            let mut slots: Vec<Numbers> = slots
                .into_iter()
                .map(|(number, period_us, thousandths, start, is_wrong)| {
                    let duration_us = u64::from(period_us) * u64::from(thousandths) / 1_000;
                    let start_us = if is_wrong { start } else { start % period_us };
                    (number, period_us, duration_us as u32, start_us)
                })
                .collect();
            let count = slots.len() as u32;
            for (index, slot) in (0..).zip(&mut slots) {
                match order {
                    0 => slot.0 = index + 1,
                    1 => slot.0 = count - index,
                    _ => {}
                }
            }
            slots
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        #[test]
        fn slots_are_free_if_no_two_executions_overlap(
            slots in slots(&[1, 2, 6, 7, 8, 12, 12, 20, 24]),
            interpreter_slot in 0..40_usize,
        ) {
            let expected = expected(&slots, interpreter_slot, overlap_at_some_time);
            prop_assert_eq!(checked(&slots, interpreter_slot), expected);
        }

        #[test]
        fn periods_of_any_length_are_compared_within_their_divisor(
            slots in slots(&[500, 1_000, 1_000, 1_500, 2_000, 6_930, 7_919, 10_000]),
            interpreter_slot in 0..40_usize,
        ) {
            let expected = expected(&slots, interpreter_slot, overlap_within_divisor);
            prop_assert_eq!(checked(&slots, interpreter_slot), expected);
        }
    }

    #[test]
    fn both_definitions_say_the_same_and_both_verdicts_occur() {
        let mut verdicts = [0; 2];
        for (one_us, other_us) in [(6, 6), (6, 4), (6, 9), (5, 7), (8, 4)] {
            for one_duration in 0..=one_us {
                for other_duration in 0..=other_us {
                    for start in 0..other_us {
                        let one = (1, one_us, one_duration, 0);
                        let other = (2, other_us, other_duration, start);
                        let overlap = overlap_at_some_time(one, other);
                        assert_eq!(overlap, overlap_within_divisor(one, other));
                        assert_eq!(checked(&[one, other], 0).is_err(), overlap);
                        verdicts[usize::from(overlap)] += 1;
                    }
                }
            }
        }
        assert!(verdicts.iter().all(|count| *count > 50), "{verdicts:?}");
    }

    #[test]
    fn longest_periods_are_in_range() {
        let longest = (1, MAX_TIME_US, MAX_TIME_US / 2, 0);
        let beside = (2, MAX_TIME_US, MAX_TIME_US / 2, MAX_TIME_US / 2);
        assert_eq!(checked(&[longest, beside], 0), Ok(()));
        let prime = (2, 3_999_999_979, 1, 1);
        assert_eq!(checked(&[longest, prime], 0), Err((1, Cause::Overlap)));
        let longer = (1, MAX_TIME_US + 1, 0, 0);
        assert_eq!(checked(&[longer], 0), Err((0, Cause::Range)));
    }
}
