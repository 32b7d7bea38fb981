//! Spreads the load of a schedule, so that slot 0 gets some time again and again.
//!
//! Time is looked at as frames as long as the shortest period, and a schedule is the better the
//! more time its fullest frame leaves free; of two that are equal in that, the better is the one
//! whose frames are fuller evenly (the sum of the squares of their loads is smaller). Period by
//! period, all slots whose starts are not given leave their places and go back, longest first, each
//! into the longest gap. Where that is no better, all stays as it was.
//!
//! What would be much work is left alone: it is counted, so that equal slots get equal starts.

use std::cmp::Reverse;

use super::clock::Clock;
use super::construct::{Layout, Placed, Taste};
use super::{SlotSpec, gcd, hyperperiod_us};

/// The most frames of a hyperperiod.
const MAX_FRAMES: u64 = 1 << 16;

/// The most activations of all slots in a hyperperiod, those of the shortest period left out: they
/// are in every frame.
const MAX_ACTIVATIONS: u64 = 1 << 18;

/// The most stretches on the circle of a period.
const MAX_STRETCHES: u64 = 1 << 14;

/// As many times shorter than the shortest period may a frame be, where that divides not all of the
/// others.
const MAX_PARTS: u64 = 8;

/// How much time is taken in each frame of a hyperperiod, in microseconds.
#[derive(Clone, Debug)]
pub(super) struct Loads {
    frame_us: u64,
    /// When the first frame begins.
    begin_us: u64,
    loads_us: Vec<u64>,
}

impl Loads {
    /// The loads of a schedule. `None` where there are too many frames or activations, or periods
    /// have little in common.
    pub(super) fn of(slots: &[SlotSpec], starts_us: &[u32]) -> Option<Self> {
        let shortest_us = slots.iter().map(|slot| slot.period_us).min()?.into();
        let frame_us = slots.iter().fold(shortest_us, |common_us, slot| {
            gcd(common_us, slot.period_us.into())
        });
        let hyperperiod_us = hyperperiod_us(slots)?;
        let frames = hyperperiod_us.checked_div(frame_us)?;
        let activations: u64 = slots
            .iter()
            .filter(|slot| u64::from(slot.period_us) > shortest_us)
            .map(|slot| hyperperiod_us / u64::from(slot.period_us))
            .sum();
        if frames > MAX_FRAMES
            || activations > MAX_ACTIVATIONS
            || frame_us * MAX_PARTS < shortest_us
        {
            return None;
        }
        let position = slots
            .iter()
            .position(|slot| u64::from(slot.period_us) == shortest_us)?;
        let mut loads = Loads {
            frame_us,
            begin_us: u64::from(*starts_us.get(position)?) % frame_us,
            loads_us: vec![0; usize::try_from(frames).ok()?],
        };
        for (slot, &start_us) in slots.iter().zip(starts_us) {
            loads.change(slot, start_us, |load_us, part_us| *load_us += part_us);
        }
        Some(loads)
    }

    /// Changes the load of each frame in which a slot takes time.
    fn change(&mut self, slot: &SlotSpec, start_us: u32, change: impl Fn(&mut u64, u64)) {
        let frames = self.loads_us.len() as u64;
        let whole_us = frames * self.frame_us;
        let mut start = (u64::from(start_us) + whole_us - self.begin_us) % whole_us;
        for _ in 0..whole_us / u64::from(slot.period_us).max(1) {
            let mut from = start;
            let end = start + u64::from(slot.duration_us);
            while from < end {
                let frame = from / self.frame_us;
                let part_us = end.min((frame + 1) * self.frame_us) - from;
                let frame = usize::try_from(frame % frames).unwrap_or(0);
                if let Some(load_us) = self.loads_us.get_mut(frame) {
                    change(load_us, part_us);
                }
                from += part_us;
            }
            start += u64::from(slot.period_us);
        }
    }

    /// The load of the fullest frame in microseconds, and how uneven they are: the less, the
    /// better.
    pub(super) fn rating(&self) -> (u64, u128) {
        (
            self.loads_us.iter().copied().max().unwrap_or(0),
            self.loads_us
                .iter()
                .map(|&load_us| u128::from(load_us) * u128::from(load_us))
                .sum(),
        )
    }
}

/// Moves slots so that the fullest frame leaves more time free, or frames are more even. The starts
/// are those of a schedule before and after.
pub(super) fn even_out(slots: &[SlotSpec], starts_us: &mut [u32]) {
    // The work is counted, so that a schedule found just in time is spread as one found early.
    let mut clock = Clock::of_pieces(u64::MAX);
    if slots.iter().any(|slot| slot.duration_us == 0) {
        return;
    }
    let Some(mut loads) = Loads::of(slots, starts_us) else {
        return;
    };
    let mut rating = loads.rating();
    let mut periods_us: Vec<u64> = slots.iter().map(|slot| slot.period_us.into()).collect();
    periods_us.sort_unstable();
    periods_us.dedup();
    // A slot that is in every frame is as well where it is.
    let frame_us = loads.frame_us;
    for &period_us in periods_us.iter().filter(|us| **us > frame_us) {
        let Some(moved) = placed_anew(slots, starts_us, period_us, &periods_us, &mut clock) else {
            continue;
        };
        let before = loads.clone();
        for placed in &moved {
            let (Some(slot), Some(&start_us)) =
                (slots.get(placed.index), starts_us.get(placed.index))
            else {
                return;
            };
            loads.change(slot, start_us, |load_us, part_us| *load_us -= part_us);
            let start_us = u32::try_from(placed.start_us).unwrap_or(start_us);
            loads.change(slot, start_us, |load_us, part_us| *load_us += part_us);
        }
        if loads.rating() < rating {
            rating = loads.rating();
            for placed in &moved {
                if let (Some(start_us), Ok(new_us)) = (
                    starts_us.get_mut(placed.index),
                    u32::try_from(placed.start_us),
                ) {
                    *start_us = new_us;
                }
            }
        } else {
            loads = before;
        }
    }
}

/// The slots of a period whose starts are not given, each in the longest gap that it finds. `None`
/// where not all find one, or that is much work.
fn placed_anew(
    slots: &[SlotSpec],
    starts_us: &[u32],
    period_us: u64,
    periods_us: &[u64],
    clock: &mut Clock,
) -> Option<Vec<Placed>> {
    let (mut free, others): (Vec<_>, Vec<_>) =
        slots
            .iter()
            .zip(starts_us)
            .enumerate()
            .partition(|(_, (slot, _))| {
                u64::from(slot.period_us) == period_us && slot.fixed_start_us.is_none()
            });
    let mut others: Vec<Placed> = others
        .into_iter()
        .map(|(index, (slot, &start_us))| Placed::new(index, slot, start_us.into()))
        .collect();
    let stretches: u64 = others
        .iter()
        .map(|placed| period_us / gcd(placed.period_us, period_us))
        .sum();
    if stretches > MAX_STRETCHES {
        return None;
    }
    // Frames begin where the first slot of the shortest period does.
    others.sort_by_key(|placed| (placed.period_us, placed.index));
    free.sort_by_key(|(index, (slot, _))| (Reverse(slot.duration_us), *index));
    let count = others.len();
    let mut layout = Layout::new(&others, periods_us, Taste::Widest);
    let all_placed = free
        .into_iter()
        .all(|(index, (slot, _))| layout.place(index, slot, clock));
    all_placed.then(|| layout.into_placed().split_off(count))
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::schedule::instances::{Family, Kind, make};
    use crate::schedule::tests::slots;
    use crate::schedule::{Outcome, check, solve};

    #[test]
    fn loads_are_counted_frame_by_frame() {
        let slots = slots(&[(10, 2), (20, 3), (40, 4)]);
        // The last one goes from the first frame into the second.
        let loads = Loads::of(&slots, &[1, 3, 9]).expect("few frames");
        assert_eq!(loads.loads_us, [2 + 3 + 2, 2 + 2, 2 + 3, 2]);
        assert_eq!(loads.rating().0, 7);
    }

    #[test]
    fn what_stands_in_one_frame_is_spread_over_all() {
        let mut slots = slots(&[(20, 2), (100, 3), (100, 3), (100, 3), (100, 3), (100, 3)]);
        slots[1].fixed_start_us = Some(2);
        let mut starts_us = [0, 2, 5, 8, 11, 14];
        even_out(&slots, &mut starts_us);
        assert_eq!(check(&slots, &starts_us), Ok(()));
        assert_eq!(starts_us, [0, 2, 22, 42, 62, 82]);
    }

    #[test]
    fn it_never_gets_worse() {
        for kind in Kind::ALL {
            for (count, percent) in [(10, 80), (40, 40), (40, 90), (60, 98)] {
                let mut slots = make(kind, count, percent, 3);
                let Outcome::Feasible(schedule) = solve(&slots, Duration::from_secs(2)) else {
                    continue;
                };
                // As bad as can be while all stay in order: turned, and one start given.
                let mut starts_us = schedule.starts_us;
                slots[0].fixed_start_us = Some(starts_us[0]);
                let before = Loads::of(&slots, &starts_us).map(|loads| loads.rating());
                even_out(&slots, &mut starts_us);
                let after = Loads::of(&slots, &starts_us).map(|loads| loads.rating());
                assert_eq!(
                    check(&slots, &starts_us),
                    Ok(()),
                    "{kind} {count} {percent}"
                );
                assert!(
                    after <= before,
                    "{kind} {count} {percent}: {before:?} {after:?}"
                );
            }
        }
    }

    #[test]
    fn a_search_leaves_time_in_every_frame() {
        let mut times_us = vec![(20_000, 3_000), (20_000, 2_000)];
        times_us.extend([(100_000, 1_000); 20]);
        let slots = slots(&times_us);
        let Outcome::Feasible(schedule) = solve(&slots, Duration::from_secs(10)) else {
            panic!("there is much room");
        };
        let loads = Loads::of(&slots, &schedule.starts_us).expect("few frames");
        assert_eq!(loads.loads_us, [9_000; 5]);
    }

    #[test]
    fn equal_slots_are_spread_equally() {
        let slots = make(Kind::Random(Family::Robot), 60, 80, 1);
        let limit = Duration::from_secs(10);
        assert_eq!(solve(&slots, limit), solve(&slots, limit));
    }
}
