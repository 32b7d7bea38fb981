//! What is counted of each slot.

use crate::board::microseconds;
use esm_link::message::{DELAY_BUCKETS, SlotCounters};

/// Stands for no task instance.
pub(crate) const NONE: u16 = u16::MAX;

/// Bits of the ticks that the first bucket of start delays counts: those shorter than 16 ticks.
const FIRST_BUCKET_BITS: u32 = 4;
/// Bits by which each further bucket reaches farther than the one before: four times as far.
const BUCKET_BITS: u32 = 2;

/// Usual executions that are counted by themselves, at most.
const MOST_USUAL: u16 = u16::MAX / ONE_USUAL;
/// One of them, in [`SlotEntry::usual`].
const ONE_USUAL: u16 = 2;
/// In [`SlotEntry::usual`]: there was an execution since the supervision asked last.
const WAS_EXECUTED: u16 = 1;
/// Start delays from here on are not usual, in ticks.
const MOST_USUAL_DELAY: u32 = 1 << 14;

/// What is kept for a slot. Times in ticks of the board's clock. Counters stay at their greatest
/// value once they are there.
///
/// Most executions are usual: they begin as late as others of one bucket and last as long as others
/// that were no overruns. These cost two comparisons of ranges and two additions, and are counted
/// by themselves, until [`settle`](Self::settle) adds their number to the counters. What is out of
/// the ordinary is worked out elsewhere.
///
/// There is one of these for each slot that a mission may have, so it is narrow. The mean is
/// divided out when somebody asks. A bucket has 16 bits; as long as no second one is full, the
/// count of the fullest follows from the number of executions.
#[derive(Clone, Copy, Debug)]
pub struct SlotEntry {
    /// The first task instance of the slot that is enabled, or [`NONE`].
    first_enabled: u16,
    /// The first task instance of the slot, or [`NONE`].
    first_task: u16,
    duration_us: u32,
    /// The shortest execution. Those that take less than `usual_ticks` longer are usual.
    min_execution_ticks: u32,
    usual_ticks: u32,
    /// Usual delays: from here on, so many. All of them are in one bucket.
    first_delay_ticks: u16,
    usual_delays: u16,
    /// Usual executions that were not settled, and [`WAS_EXECUTED`].
    usual: u16,
    /// Sum of the executions, 48 bits: the high half and the low word, which usual executions are
    /// in at once. At 50 MHz that is 65 days of nothing but executions.
    total_execution_high: u16,
    total_execution_low: u32,
    min_delay_ticks: u32,
    max_delay_ticks: u32,
    max_execution_ticks: u32,
    /// Executions that ended, overruns included.
    executed: u32,
    overruns: u16,
    overruns_in_a_row: u16,
    /// Executions by their start delay.
    delays: [u16; DELAY_BUCKETS],
}

impl SlotEntry {
    /// A slot of which nothing happened yet.
    pub const EMPTY: SlotEntry = SlotEntry {
        first_enabled: NONE,
        first_task: NONE,
        duration_us: 0,
        min_execution_ticks: u32::MAX,
        usual_ticks: 0,
        first_delay_ticks: 0,
        usual_delays: 0,
        usual: 0,
        total_execution_high: 0,
        total_execution_low: 0,
        min_delay_ticks: u32::MAX,
        max_delay_ticks: 0,
        max_execution_ticks: 0,
        executed: 0,
        overruns: 0,
        overruns_in_a_row: 0,
        delays: [0; DELAY_BUCKETS],
    };

    /// The place of a slot before any mission, which makes it [`EMPTY`](Self::EMPTY). All zeros, so
    /// that a static of it takes no flash.
    pub(crate) const UNUSED: SlotEntry = SlotEntry {
        min_delay_ticks: 0,
        min_execution_ticks: 0,
        first_task: 0,
        first_enabled: 0,
        ..Self::EMPTY
    };

    /// Duration of the slot in microseconds.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn duration_us(&self) -> u32 {
        self.duration_us
    }

    pub(crate) fn set_duration_us(&mut self, duration_us: u32) {
        self.duration_us = duration_us;
    }

    /// Counts from the beginning.
    pub(crate) fn begin_anew(&mut self) {
        *self = SlotEntry {
            duration_us: self.duration_us,
            first_task: self.first_task,
            ..Self::EMPTY
        };
    }

    /// The first task instance of the slot, or [`NONE`].
    pub(crate) fn first_task(&self) -> u16 {
        self.first_task
    }

    /// The first task instance of the slot that is enabled, or [`NONE`].
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn first_enabled(&self) -> u16 {
        self.first_enabled
    }

    pub(crate) fn set_first_enabled(&mut self, instance: u16) {
        self.first_enabled = instance;
    }

    /// Puts a task instance before the first one, and gives the one that was the first, or
    /// [`NONE`].
    pub(crate) fn put_first(&mut self, instance: u16) -> u16 {
        core::mem::replace(&mut self.first_task, instance)
    }

    /// Overruns since the last activation without one.
    pub(crate) fn overruns_in_a_row(&self) -> u16 {
        self.overruns_in_a_row
    }

    /// Counts an execution, if it is a usual one. False if it is not, and nothing was counted.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn count(&mut self, delay_ticks: u32, took_ticks: u32) -> bool {
        let delay = delay_ticks.wrapping_sub(self.first_delay_ticks.into());
        let longer = took_ticks.wrapping_sub(self.min_execution_ticks);
        let usual = self.usual.wrapping_add(ONE_USUAL) | WAS_EXECUTED;
        let (total, carry) = self.total_execution_low.overflowing_add(took_ticks);
        if delay >= self.usual_delays.into()
            || longer >= self.usual_ticks
            || usual / ONE_USUAL == 0
            || carry
        {
            return false;
        }
        self.usual = usual;
        self.total_execution_low = total;
        true
    }

    /// Adds the number of usual executions to the counters.
    fn settle(&mut self) {
        let usual = self.usual / ONE_USUAL;
        if usual == 0 {
            return;
        }
        self.usual &= WAS_EXECUTED;
        // There was room for them, or else none would have been usual.
        self.executed = self.executed.saturating_add(usual.into());
        self.count_delays(self.first_delay_ticks.into(), usual);
        self.look_for_room();
    }

    /// No execution is usual any more where the number of them may not have room for so many.
    fn look_for_room(&mut self) {
        if self.executed > u32::MAX - u32::from(MOST_USUAL) {
            self.usual_ticks = 0;
        }
    }

    fn count_delays(&mut self, delay_ticks: u32, executions: u16) {
        if let Some(count) = self.delays.get_mut(bucket(delay_ticks)) {
            *count = count.saturating_add(executions);
        }
    }

    /// Counts any execution. Returns whether it took longer than `duration_ticks`.
    #[inline(never)]
    pub(crate) fn count_unusual(
        &mut self,
        delay_ticks: u32,
        took_ticks: u32,
        duration_ticks: u32,
    ) -> bool {
        self.settle();
        self.usual |= WAS_EXECUTED;
        self.count_delays(delay_ticks, 1);
        self.min_delay_ticks = self.min_delay_ticks.min(delay_ticks);
        self.max_delay_ticks = self.max_delay_ticks.max(delay_ticks);
        self.min_execution_ticks = self.min_execution_ticks.min(took_ticks);
        self.max_execution_ticks = self.max_execution_ticks.max(took_ticks);
        let (low, carry) = self.total_execution_low.overflowing_add(took_ticks);
        let high = self.total_execution_high.checked_add(u16::from(carry));
        // The sum and the number of its terms stand still together, so that the mean stays one.
        if let (Some(executed), Some(high)) = (self.executed.checked_add(1), high) {
            self.executed = executed;
            (self.total_execution_low, self.total_execution_high) = (low, high);
        }
        let overrun = took_ticks > duration_ticks;
        if overrun {
            self.overruns = self.overruns.saturating_add(1);
            self.overruns_in_a_row = self.overruns_in_a_row.saturating_add(1);
            // So that the next one is looked at, too.
            self.usual_ticks = 0;
        } else {
            self.overruns_in_a_row = 0;
            // The shortest is not longer than this one, which is no overrun.
            let longest = self.max_execution_ticks.min(duration_ticks);
            self.usual_ticks = (longest - self.min_execution_ticks).saturating_add(1);
            self.look_for_room();
        }
        self.usual_delays = 0;
        if delay_ticks < MOST_USUAL_DELAY {
            // Those of its bucket that are not shorter, nor longer, than any before.
            let (first, end) = ends_of_bucket(delay_ticks);
            let first = first.max(self.min_delay_ticks);
            let end = end.min(self.max_delay_ticks.saturating_add(1));
            self.first_delay_ticks = first as u16;
            self.usual_delays = (end - first) as u16;
        }
        overrun
    }

    /// Whether there was an execution since this was asked last.
    pub(crate) fn take_executed(&mut self) -> bool {
        let was_executed = self.usual & WAS_EXECUTED != 0;
        self.usual &= !WAS_EXECUTED;
        was_executed
    }

    /// What was counted, for the link; `missed` is the dispatcher's number.
    pub(crate) fn counters(&self, number: u32, missed: u32, ticks_per_us: u32) -> SlotCounters {
        let mut settled = *self;
        settled.settle();
        settled.settled_counters(number, missed, ticks_per_us)
    }

    fn settled_counters(&self, number: u32, missed: u32, ticks_per_us: u32) -> SlotCounters {
        let ns = |ticks| nanoseconds(ticks, ticks_per_us);
        // Before the first one, the shortest is the greatest number there is.
        let shortest = |ticks, longest| if ticks > longest { 0 } else { ns(ticks) };
        let total =
            u64::from(self.total_execution_high) << u32::BITS | u64::from(self.total_execution_low);
        SlotCounters {
            number,
            missed,
            overruns: self.overruns.into(),
            executed: self.executed,
            total_execution_ns: total_nanoseconds(total, ticks_per_us),
            min_execution_ns: shortest(self.min_execution_ticks, self.max_execution_ticks),
            max_execution_ns: ns(self.max_execution_ticks),
            min_delay_ns: shortest(self.min_delay_ticks, self.max_delay_ticks),
            max_delay_ns: ns(self.max_delay_ticks),
            first_bucket_ns: ns(1 << FIRST_BUCKET_BITS),
            delays: self.delays,
        }
    }
}

/// The bucket that counts a start delay: the position of its highest bit says which, without a
/// search.
#[cfg_attr(feature = "speed", inline(always))]
fn bucket(delay_ticks: u32) -> usize {
    let bits = u32::BITS - (delay_ticks >> FIRST_BUCKET_BITS).leading_zeros();
    (bits.div_ceil(BUCKET_BITS) as usize).min(DELAY_BUCKETS - 1)
}

/// The first start delay of the bucket that counts this one, and the first of the next bucket.
fn ends_of_bucket(delay_ticks: u32) -> (u32, u32) {
    let reach = FIRST_BUCKET_BITS + bucket(delay_ticks) as u32 * BUCKET_BITS;
    match reach {
        FIRST_BUCKET_BITS => (0, 1 << FIRST_BUCKET_BITS),
        _ => (1 << (reach - BUCKET_BITS), 1 << reach),
    }
}

/// Nanoseconds in a microsecond.
const NS_PER_US: u32 = 1_000;

/// Ticks in nanoseconds; saturates after four seconds.
pub(crate) fn nanoseconds(ticks: u32, ticks_per_us: u32) -> u32 {
    let ticks_per_us = ticks_per_us.max(1);
    let (us, rest) = (ticks / ticks_per_us, ticks % ticks_per_us);
    us.checked_mul(NS_PER_US)
        .and_then(|ns| ns.checked_add(rest * NS_PER_US / ticks_per_us))
        .unwrap_or(u32::MAX)
}

/// A sum of ticks in nanoseconds; saturates after 584 years.
fn total_nanoseconds(ticks: u64, ticks_per_us: u32) -> u64 {
    let ticks_per_us = ticks_per_us.max(1);
    let us = microseconds(ticks, ticks_per_us);
    // Less than a microsecond's ticks.
    let rest = (ticks - us * u64::from(ticks_per_us)) as u32;
    us.checked_mul(u64::from(NS_PER_US))
        .and_then(|ns| ns.checked_add(u64::from(rest * NS_PER_US / ticks_per_us)))
        .unwrap_or(u64::MAX)
}

#[cfg(test)]
mod tests {
    use proptest::collection::vec;
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn ticks_become_nanoseconds() {
        for (ticks, ticks_per_us, ns) in [
            (0, 50, 0),
            (1, 50, 20),
            (49, 50, 980),
            (51, 50, 1_020),
            (7, 1, 7_000),
            (5, 12, 416),
            (u32::MAX, 12, 357_913_941_250_u64),
        ] {
            assert_eq!(
                nanoseconds(ticks, ticks_per_us),
                u32::try_from(ns).unwrap_or(u32::MAX),
                "{ticks} ticks"
            );
            assert_eq!(
                total_nanoseconds(u64::from(ticks), ticks_per_us),
                ns,
                "{ticks} ticks"
            );
        }
        assert_eq!(total_nanoseconds(u64::MAX, 1), u64::MAX);
        assert_eq!(
            total_nanoseconds(u64::MAX / 50, 50),
            7_378_697_629_483_820_640
        );
    }

    #[test]
    fn a_bucket_reaches_four_times_as_far_as_the_one_before() {
        for (delay_ticks, expected) in [
            (0, 0),
            (15, 0),
            (16, 1),
            (63, 1),
            (64, 2),
            (255, 2),
            (256, 3),
            (1_023, 3),
            (1_024, 4),
            (4_095, 4),
            (4_096, 5),
            (16_383, 5),
            (16_384, 6),
            (65_535, 6),
            (65_536, 7),
            (u32::MAX, 7),
        ] {
            assert_eq!(bucket(delay_ticks), expected, "{delay_ticks} ticks");
        }
        assert_eq!(DELAY_BUCKETS, 8);
    }

    /// Counts an execution as a slot does.
    fn count(slot: &mut SlotEntry, delay: u32, took: u32, duration: u32) -> bool {
        !slot.count(delay, took) && slot.count_unusual(delay, took, duration)
    }

    #[test]
    fn usual_executions_are_counted_like_others() {
        let mut slot = SlotEntry::EMPTY;
        let (mut overruns, mut total, mut delays) = (0, 0, [0; DELAY_BUCKETS]);
        let executions = [
            (3, 50),
            (3, 50),
            (3, 50),
            (20, 50),
            (20, 50),
            (3, 120),
            (3, 120),
            (3, 50),
            (3, 50),
        ];
        for round in 0..20 {
            for (delay, took) in executions {
                let overrun = count(&mut slot, delay, took, 100);
                assert_eq!(overrun, took > 100, "round {round}");
                overruns += u32::from(overrun);
                total += u64::from(took);
                delays[bucket(delay)] += 1;
                assert!(slot.take_executed());
                assert!(!slot.take_executed());
            }
        }
        let expected = SlotCounters {
            number: 1,
            overruns,
            executed: 180,
            total_execution_ns: total * 1_000,
            min_execution_ns: 50_000,
            max_execution_ns: 120_000,
            min_delay_ns: 3_000,
            max_delay_ns: 20_000,
            first_bucket_ns: 16_000,
            delays,
            missed: 0,
        };
        assert_eq!(slot.counters(1, 0, 1), expected);
    }

    #[test]
    fn a_slot_counts_what_happens() {
        let mut slot = SlotEntry::EMPTY;
        let nothing = SlotCounters {
            number: 3,
            first_bucket_ns: 16_000,
            ..SlotCounters::default()
        };
        assert_eq!(slot.counters(3, 0, 1), nothing);
        for (delay, execution, overrun, in_a_row) in [
            (2, 90, false, 0),
            (1, 101, true, 1),
            (90, 150, true, 2),
            (3, 100, false, 0),
        ] {
            assert_eq!(count(&mut slot, delay, execution, 100), overrun);
            assert_eq!(slot.overruns_in_a_row(), in_a_row);
        }
        let expected = SlotCounters {
            number: 3,
            missed: 5,
            overruns: 2,
            executed: 4,
            total_execution_ns: 441_000,
            min_execution_ns: 90_000,
            max_execution_ns: 150_000,
            min_delay_ns: 1_000,
            max_delay_ns: 90_000,
            first_bucket_ns: 16_000,
            delays: [3, 0, 1, 0, 0, 0, 0, 0],
        };
        assert_eq!(slot.counters(3, 5, 1), expected);
        assert_eq!(expected.mean_execution_ns(), 110_250);
    }

    #[test]
    fn a_counter_that_is_full_stays_full() {
        let mut slot = SlotEntry {
            executed: 70_000,
            total_execution_low: u32::MAX,
            total_execution_high: u16::MAX - 1,
            overruns: u16::MAX,
            overruns_in_a_row: u16::MAX,
            delays: [u16::MAX; DELAY_BUCKETS],
            ..SlotEntry::EMPTY
        };
        assert!(count(&mut slot, 0, 5, 1));
        let counters = slot.counters(1, 0, 1);
        assert_eq!(counters.delays, [u16::MAX; DELAY_BUCKETS]);
        assert_eq!((counters.executed, counters.overruns), (70_001, 65_535));
        assert_eq!(slot.overruns_in_a_row(), u16::MAX);
        let total_ticks = (u64::from(u16::MAX) << u32::BITS) + 4;
        assert_eq!(counters.total_execution_ns, total_ticks * 1_000);
        // Whichever of sum and number is full, they stand still together.
        count(&mut slot, 0, u32::MAX, 1);
        assert_eq!(
            slot.counters(1, 0, 1),
            SlotCounters {
                max_execution_ns: u32::MAX,
                ..counters
            }
        );
        let mut slot = SlotEntry {
            executed: u32::MAX,
            ..SlotEntry::EMPTY
        };
        count(&mut slot, 0, 5, 10);
        let counters = slot.counters(1, 0, 1);
        assert_eq!(
            (counters.executed, counters.total_execution_ns),
            (u32::MAX, 0)
        );
    }

    /// What happens to a slot, and what somebody wants to know of it.
    #[derive(Clone, Copy, Debug)]
    enum Event {
        /// Executions that begin so late and last so long, so many of them.
        Executed(u32, u32, u32),
        /// The link reads the counters.
        Read,
        /// The supervision asks.
        Asked,
    }

    fn event() -> impl Strategy<Value = Event> {
        let delay = prop_oneof![
            6 => 40..44u32,
            2 => 0..300u32,
            1 => 16_000..17_000u32,
            1 => 60_000..200_000u32,
            1 => Just(u32::MAX),
        ];
        let took = prop_oneof![
            8 => 500..504u32,
            2 => 0..1_100u32,
            1 => Just(10_000_000),
        ];
        let times = prop_oneof![20 => 1..4u32, 1 => 30_000..70_000u32];
        let executed = (delay, took, times);
        prop_oneof![
            6 => executed.prop_map(|(delay, took, times)| Event::Executed(delay, took, times)),
            1 => Just(Event::Read),
            1 => Just(Event::Asked),
        ]
    }

    /// Each counter by itself, as one would write it who need not hurry.
    #[derive(Default)]
    struct Plain {
        counters: SlotCounters,
        total_ticks: u64,
        in_a_row: u16,
        was_executed: bool,
    }

    impl Plain {
        fn count(&mut self, delay: u32, took: u32, duration: u32) -> bool {
            let ns = |ticks: u32| ticks.saturating_mul(NS_PER_US);
            let counters = &mut self.counters;
            let is_first = counters.executed == 0;
            self.was_executed = true;
            counters.executed += 1;
            self.total_ticks += u64::from(took);
            counters.total_execution_ns = self.total_ticks * u64::from(NS_PER_US);
            let least = |least: u32, ticks: u32| {
                if is_first {
                    ns(ticks)
                } else {
                    least.min(ns(ticks))
                }
            };
            counters.min_delay_ns = least(counters.min_delay_ns, delay);
            counters.min_execution_ns = least(counters.min_execution_ns, took);
            counters.max_delay_ns = counters.max_delay_ns.max(ns(delay));
            counters.max_execution_ns = counters.max_execution_ns.max(ns(took));
            let bucket = &mut counters.delays[bucket(delay)];
            *bucket = bucket.saturating_add(1);
            let is_overrun = took > duration;
            if is_overrun {
                counters.overruns = (counters.overruns + 1).min(u16::MAX.into());
                self.in_a_row = self.in_a_row.saturating_add(1);
            } else {
                self.in_a_row = 0;
            }
            is_overrun
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]
        #[test]
        fn whatever_happens_in_whichever_order_is_counted_once(
            events in vec(event(), 1..60),
        ) {
            const DURATION: u32 = 1_000;
            let mut slot = SlotEntry::EMPTY;
            let mut plain = Plain::default();
            plain.counters.number = 1;
            plain.counters.first_bucket_ns = 16 * NS_PER_US;
            for event in events {
                match event {
                    Event::Executed(delay, took, times) => for _ in 0..times {
                        let is_overrun = count(&mut slot, delay, took, DURATION);
                        prop_assert_eq!(is_overrun, plain.count(delay, took, DURATION));
                        prop_assert_eq!(slot.overruns_in_a_row(), plain.in_a_row);
                    },
                    Event::Read => prop_assert_eq!(slot.counters(1, 0, 1), plain.counters),
                    Event::Asked => {
                        let was_executed = core::mem::take(&mut plain.was_executed);
                        prop_assert_eq!(slot.take_executed(), was_executed);
                    }
                }
            }
            prop_assert_eq!(slot.counters(1, 0, 1), plain.counters);
        }
    }

    #[test]
    fn a_bucket_ends_where_the_next_one_begins() {
        for delay in (0..70_000).chain([u32::MAX]) {
            let (first, end) = ends_of_bucket(delay);
            if delay < MOST_USUAL_DELAY {
                assert!((first..end).contains(&delay), "{delay}");
                assert_eq!(bucket(first), bucket(end - 1), "{delay}");
                assert_eq!(bucket(end), bucket(delay) + 1, "{delay}");
            }
        }
    }

    #[test]
    fn what_is_kept_for_a_slot_stays_narrow() {
        assert_eq!(size_of::<SlotEntry>(), 64);
    }

    #[test]
    fn the_first_task_of_a_slot_is_the_one_put_there_last() {
        let mut slot = SlotEntry::EMPTY;
        assert_eq!(slot.first_task(), NONE);
        assert_eq!(slot.put_first(4), NONE);
        assert_eq!(slot.put_first(2), 4);
        assert_eq!(slot.first_task(), 2);
    }
}
