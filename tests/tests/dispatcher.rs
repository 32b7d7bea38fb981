//! The dispatcher against what it means: the sorted list of all activations, whenever they are
//! asked for.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use esm_core::Dispatcher;
use esm_core::dispatcher::Activation;
use esm_core::tables::Slot;
use esm_tests::random::Random;
use esm_tests::{environment, exactness};

/// The longest period that a blob may have.
const LONGEST_PERIOD_US: u32 = 4_000_000_000;
const CAPACITY: usize = 256;

fn slot(period_us: u32, start_us: u32) -> Slot {
    Slot {
        number: 1,
        period_us,
        duration_us: 0,
        start_us,
    }
}

/// Slots of periods from a microsecond to the longest, some of them equal.
fn random_slots(random: &mut Random) -> Vec<Slot> {
    let most = 1 << random.below(9);
    let count = 1 + random.below(most);
    (0..count)
        .map(|_| {
            let period_us = match random.below(4) {
                0 => 1_000 << random.below(8),
                1 => 1 + random.below(100),
                2 => 1 + random.below(LONGEST_PERIOD_US as usize),
                _ => 1 + random.below(1_000_000),
            };
            slot(period_us as u32, random.below(period_us) as u32)
        })
        .collect()
}

/// The meaning: each slot's next nominal start; who is asked for is looked up among all of them.
struct List {
    slots: Vec<Slot>,
    next_us: Vec<u64>,
    missed: Vec<u64>,
}

impl List {
    fn new(slots: &[Slot], from_us: u64) -> Self {
        let first_us = |slot: &Slot| {
            let starts = u64::from(slot.start_us);
            let past = from_us.saturating_sub(starts);
            starts + past.div_ceil(u64::from(slot.period_us)) * u64::from(slot.period_us)
        };
        List {
            slots: slots.to_vec(),
            next_us: slots.iter().map(first_us).collect(),
            missed: vec![0; slots.len()],
        }
    }

    fn next(&self) -> Activation {
        let (start_us, slot) = self.next_us.iter().zip(0..).min().unwrap();
        Activation {
            slot,
            start_us: *start_us,
        }
    }

    fn take(&mut self, now_us: u64) -> Option<Activation> {
        let Activation { slot, start_us } = self.next();
        let period_us = u64::from(self.slots[slot].period_us);
        let missed = now_us.checked_sub(start_us)? / period_us;
        self.missed[slot] += missed;
        let start_us = start_us + missed * period_us;
        self.next_us[slot] = start_us + period_us;
        Some(Activation { slot, start_us })
    }
}

#[test]
fn occurrences_are_those_of_a_sorted_list_however_late_they_are_asked_for() {
    const STEPS: usize = 2_000;
    for seed in 0..environment::number("ESM_DISPATCHERS", 200) {
        let mut random = Random::new(seed);
        let slots = random_slots(&mut random);
        let from_us = match random.below(3) {
            0 => 0,
            // Around where 32 bits end, and where days have passed.
            1 => (1 << 32) - random.below(1_000_000) as u64,
            _ => random.below(1 << 40) as u64,
        };
        let mut list = List::new(&slots, from_us);
        let mut dispatcher = Dispatcher::<CAPACITY>::idle();
        dispatcher
            .restart_at(slots.iter().copied(), from_us)
            .unwrap();
        let mut now_us = from_us;
        for _ in 0..STEPS {
            let next = list.next();
            assert_eq!(dispatcher.next(), next, "seed {seed}");
            let late_us = match random.below(16) {
                0 => random.below(1 << 34),
                1 | 2 => random.below(100_000),
                3..=5 => random.below(100),
                _ => 0,
            };
            now_us = now_us.max(next.start_us) + late_us as u64;
            let taken = list.take(now_us);
            assert_eq!(dispatcher.take(now_us), taken, "seed {seed}");
        }
        for (slot, missed) in list.missed.iter().enumerate() {
            let expected = u32::try_from(*missed).unwrap_or(u32::MAX);
            assert_eq!(dispatcher.missed(slot), expected, "seed {seed}");
        }
    }
}

/// What runs here lasts for 55 hours of a robot's time. `cargo xtask bench dispatch` takes a
/// billion activations.
#[test]
fn nothing_drifts() {
    let run = exactness::run(environment::number("ESM_OCCURRENCES", 3_000_000));
    assert_eq!(run.wrong, 0);
    assert!(
        run.microsecond_wraps > 10 && run.tick_wraps > 500,
        "{run:?}"
    );
}
