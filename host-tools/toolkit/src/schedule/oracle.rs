//! Whether small sets of slots have a schedule, by laying every activation out: slow, and obviously
//! right. The search is held against it.

use std::time::Duration;

use super::random::Random;
use super::{Infeasibility, Outcome, SlotSpec, check, exceeds_one, hyperperiod_us, solve};

/// One bit a microsecond of the hyperperiod.
type Occupied = Vec<u64>;

/// Whether there are starts with which no activations of any slots overlap: all starts of all slots
/// are tried, one slot after another.
pub(super) fn has_schedule(slots: &[SlotSpec]) -> bool {
    let hyperperiod_us = hyperperiod_us(slots).expect("small periods") as usize;
    let mut order: Vec<&SlotSpec> = slots.iter().collect();
    // Given starts first, then what leaves the others least: the order changes how long it takes,
    // not what comes out.
    order.sort_by_key(|slot| {
        let share = u64::from(slot.duration_us) * 1_000 / u64::from(slot.period_us.max(1));
        (
            slot.fixed_start_us.is_none(),
            std::cmp::Reverse(share),
            slot.period_us,
            slot.duration_us,
        )
    });
    place(
        &order,
        None,
        &vec![0; hyperperiod_us.div_ceil(64)],
        hyperperiod_us,
    )
}

/// Places the first of the slots everywhere, and the others after it. `previous` is the slot before
/// with its start.
fn place(
    slots: &[&SlotSpec],
    previous: Option<(&SlotSpec, u32)>,
    occupied: &Occupied,
    hyperperiod_us: usize,
) -> bool {
    let Some((slot, rest)) = slots.split_first() else {
        return true;
    };
    let starts = match slot.fixed_start_us {
        Some(start_us) if start_us >= slot.period_us => return false,
        Some(start_us) => start_us..start_us + 1,
        // The schedule as a whole can be turned.
        None if previous.is_none() => 0..1,
        // Of equal slots the later one starts later.
        None => match previous {
            Some((other, start_us)) if other.fixed_start_us.is_none() && is_equal(other, slot) => {
                start_us..slot.period_us
            }
            _ => 0..slot.period_us,
        },
    };
    starts.into_iter().any(|start_us| {
        let mut occupied = occupied.clone();
        occupy(&mut occupied, slot, start_us, hyperperiod_us)
            && place(rest, Some((slot, start_us)), &occupied, hyperperiod_us)
    })
}

fn is_equal(a: &SlotSpec, b: &SlotSpec) -> bool {
    (a.period_us, a.duration_us) == (b.period_us, b.duration_us)
}

/// Marks every microsecond of every activation. Gives whether all were free.
fn occupy(occupied: &mut Occupied, slot: &SlotSpec, start_us: u32, hyperperiod_us: usize) -> bool {
    for begin in
        (start_us as usize..hyperperiod_us + start_us as usize).step_by(slot.period_us as usize)
    {
        for at in begin..begin + slot.duration_us as usize {
            let at = at % hyperperiod_us;
            let bit = 1 << (at % 64);
            if occupied[at / 64] & bit != 0 {
                return false;
            }
            occupied[at / 64] |= bit;
        }
    }
    true
}

/// A random set of at most eight slots. Many are just feasible or just not.
pub(super) fn random_set(seed: u64) -> Vec<SlotSpec> {
    const PERIODS_US: [&[u32]; 12] = [
        &[2, 4, 8, 16],
        &[4, 8, 16, 32],
        &[3, 6, 12, 24],
        &[10, 20, 40, 80],
        &[4, 6, 8, 12, 24],
        &[6, 10, 15, 30],
        &[8, 20, 40, 10],
        &[10, 15, 20, 30, 60],
        &[8, 12, 16, 24, 48],
        &[7, 14, 21, 28, 42],
        &[9, 12, 18, 36],
        &[12, 18, 24, 36, 72],
    ];
    let mut random = Random::new(seed);
    let periods_us = PERIODS_US[random.index(PERIODS_US.len())];
    let count = 2 + random.index(7);
    // In 1/64 of the whole time.
    let wanted = 20 + random.below(44);
    let mut slots: Vec<SlotSpec> = (1..=count as u32)
        .map(|number| {
            let period_us = periods_us[random.index(periods_us.len())];
            let share = random.below(2 * wanted / count as u64 + 1);
            let duration_us = (u64::from(period_us) * share / 64).clamp(1, u64::from(period_us));
            SlotSpec {
                number,
                period_us,
                duration_us: duration_us as u32,
                fixed_start_us: None,
            }
        })
        .collect();
    // Every third set has given starts.
    if random.once_in(3) {
        for _ in 0..1 + random.index(3) {
            let at = random.index(count);
            let period_us = u64::from(slots[at].period_us);
            slots[at].fixed_start_us = Some(random.below(period_us) as u32);
        }
    }
    slots
}

/// Sets that are tried in an ordinary run; `ESM_SETS` asks for another number.
const SETS: u64 = 200;

#[test]
fn the_search_decides_small_sets_as_an_exhaustive_oracle_does() {
    let sets = std::env::var("ESM_SETS").map_or(SETS, |text| {
        text.parse().expect("ESM_SETS is a whole number")
    });
    let (mut feasible, mut changes, mut reasons) =
        (0, 0, std::collections::BTreeMap::<&str, u32>::new());
    for seed in 0..sets {
        let slots = random_set(seed);
        let has_schedule = has_schedule(&slots);
        match solve(&slots, Duration::from_secs(60)) {
            Outcome::Feasible(schedule) => {
                assert!(
                    has_schedule && check(&slots, &schedule.starts_us).is_ok(),
                    "seed {seed}: {slots:?}"
                );
                feasible += 1;
            }
            Outcome::Infeasible(reason) => {
                assert!(
                    !has_schedule,
                    "seed {seed} has a schedule, and not that {reason}: {slots:?}"
                );
                *reasons.entry(kind(&reason)).or_default() += 1;
                changes += check_cures(seed, &slots, &reason);
            }
            Outcome::Undecided => panic!("seed {seed} is decided by trying all starts: {slots:?}"),
        }
    }
    println!(
        "{feasible} of {sets} are feasible; the others: {reasons:?}, {changes} changes would help"
    );
    if sets >= SETS {
        assert!(
            feasible > sets / 5 && feasible < sets - sets / 5,
            "both answers are asked for: {feasible}"
        );
        assert!(
            reasons.len() >= 4,
            "several kinds of proof are asked for: {reasons:?}"
        );
    }
}

/// Each change that a cure proposes takes the reason away: the slots that it names have a schedule
/// then. Gives how many there are.
fn check_cures(seed: u64, slots: &[SlotSpec], reason: &Infeasibility) -> usize {
    let named: Vec<SlotSpec> = match reason {
        Infeasibility::Crowded { slots: numbers, .. }
        | Infeasibility::Packing { slots: numbers, .. }
        | Infeasibility::Orders { slots: numbers, .. } => slots
            .iter()
            .filter(|slot| numbers.contains(&slot.number))
            .copied()
            .collect(),
        _ => slots.to_vec(),
    };
    let changes = reason.cure(slots).changes;
    for change in &changes {
        let changed = change.applied(&named);
        let times_us = changed
            .iter()
            .map(|slot| (slot.period_us, slot.duration_us));
        let is_cured = match reason {
            Infeasibility::Utilisation { .. } => !exceeds_one(times_us),
            _ => has_schedule(&changed),
        };
        assert!(
            is_cured,
            "seed {seed}: to {change} does not help against that {reason}: {slots:?}"
        );
    }
    changes.len()
}

fn kind(reason: &Infeasibility) -> &'static str {
    match reason {
        Infeasibility::TooLong { .. } => "too long",
        Infeasibility::Utilisation { .. } => "utilisation",
        Infeasibility::Crowded { .. } => "crowded",
        Infeasibility::Packing { .. } => "packing",
        Infeasibility::Orders { .. } => "orders",
        Infeasibility::FixedStarts { .. } => "given starts",
        Infeasibility::Exhausted { .. } => "exhausted",
    }
}
