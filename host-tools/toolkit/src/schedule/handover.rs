//! What becomes of the slots when a mission follows another on a robot that is on.
//!
//! Where the interpreter's slots of the two have one period, the starts of all slots go on counting
//! from where they did; so a slot that both have, with the same number and period, goes on as if
//! nothing had been if it has the same start in both. [`lay_out`] finds starts for the mission to
//! come in which as few of these slots as possible move, and [`Handover`] says which do and how
//! long each is not heard of.

use std::fmt;
use std::time::Duration;

use esm_core::tables::Tables;
use serde::Serialize;

use super::{Limit, Outcome, Schedule, SlotSpec, gcd, solve};

/// How long one search of several may take. Tables of robots are laid out in milliseconds, or
/// cannot be.
const ONE_SEARCH: Duration = Duration::from_secs(1);

/// The slots of a compiled mission, each with its start.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SlotTable {
    slots: Vec<SlotSpec>,
    /// Index of the interpreter's.
    interpreter: usize,
}

impl SlotTable {
    /// The slots of a blob.
    pub fn of(tables: &Tables<'_>) -> Self {
        SlotTable {
            slots: tables
                .slots()
                .map(|slot| SlotSpec {
                    number: slot.number,
                    period_us: slot.period_us,
                    duration_us: slot.duration_us,
                    fixed_start_us: Some(slot.start_us),
                })
                .collect(),
            interpreter: tables.interpreter_slot(),
        }
    }

    /// Start of each slot in microseconds, in their order.
    pub fn starts_us(&self) -> Vec<u32> {
        let starts_us = self.slots.iter().map(|slot| slot.fixed_start_us);
        starts_us.map(Option::unwrap_or_default).collect()
    }

    fn interpreter_period_us(&self) -> u32 {
        self.slots
            .get(self.interpreter)
            .map_or(0, |slot| slot.period_us)
    }

    /// The start of the slot with this number and period.
    fn start_us(&self, number: u32, period_us: u32) -> Option<u32> {
        self.slots
            .iter()
            .find(|slot| (slot.number, slot.period_us) == (number, period_us))
            .and_then(|slot| slot.fixed_start_us)
    }
}

/// Starts for a mission that is to follow the `running` one, `next` being the mission's slots with
/// starts that would do without it. Searches for at most about `limit`. What it gives has been
/// checked; with another period of the interpreter, and where the search finds nothing, it is the
/// starts of `next`.
///
/// Slots that both have keep their starts: all of them if that is possible, else all but one (the
/// one with the longest period for which it is), else as many as can, those with short periods
/// first.
pub fn lay_out(running: &SlotTable, next: &SlotTable, limit: impl Into<Limit>) -> Schedule {
    let mut best = Schedule {
        starts_us: next.starts_us(),
    };
    if running.interpreter_period_us() != next.interpreter_period_us() {
        return best;
    }
    let shared = shared(running, next);
    let limit = limit.into();
    let began = limit.passed();
    let fixed = |kept: &[Shared]| -> Option<Schedule> {
        let left = (limit.time()).checked_sub(limit.passed().saturating_sub(began))?;
        let mut slots = next.slots.clone();
        for (index, slot) in slots.iter_mut().enumerate() {
            let kept = kept.iter().find(|shared| shared.index == index);
            slot.fixed_start_us = match kept {
                _ if index == next.interpreter => Some(0),
                Some(kept) => Some(kept.start_us),
                None => None,
            };
        }
        match solve(&slots, limit.with_time(left.min(ONE_SEARCH))) {
            Outcome::Feasible(schedule) => Some(schedule),
            Outcome::Infeasible(_) | Outcome::Undecided => None,
        }
    };
    if let Some(schedule) = fixed(&shared) {
        return schedule;
    }
    for moved in (0..shared.len()).rev() {
        let mut kept = shared.clone();
        kept.remove(moved);
        if let Some(schedule) = fixed(&kept) {
            return schedule;
        }
    }
    let mut kept: Vec<Shared> = Vec::new();
    for slot in shared {
        kept.push(slot);
        let already = best.starts_us.get(slot.index) == Some(&slot.start_us);
        let found = if already { None } else { fixed(&kept) };
        match found {
            Some(schedule) => best = schedule,
            None if already => {}
            None => {
                kept.pop();
            }
        }
    }
    best
}

/// A slot that two missions have.
#[derive(Clone, Copy, Debug)]
struct Shared {
    /// Its index in the mission to come.
    index: usize,
    period_us: u32,
    /// Its start in the one that runs.
    start_us: u32,
}

/// The slots that both missions have, but the interpreter's; short periods first.
fn shared(running: &SlotTable, next: &SlotTable) -> Vec<Shared> {
    let mut shared: Vec<Shared> = next
        .slots
        .iter()
        .enumerate()
        .filter(|(index, _)| *index != next.interpreter)
        .filter_map(|(index, slot)| {
            let start_us = running.start_us(slot.number, slot.period_us)?;
            Some(Shared {
                index,
                period_us: slot.period_us,
                start_us,
            })
        })
        .collect();
    shared.sort_by_key(|slot| (slot.period_us, slot.index));
    shared
}

// ─── What is told ────────────────────────────────────────────────────────────────────────────────

/// What becomes of the slots that two missions have when one follows the other, in the form of its
/// JSON.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Handover {
    /// Numbers of the slots that go on as they run.
    pub slots_kept: Vec<u32>,
    /// The slots that do not.
    pub slots_moved: Vec<MovedSlot>,
    /// Whether the interpreter gets another period, so that all slots start anew.
    pub interpreter_period_changes: bool,
}

/// A slot that two missions have, and that does not go on as it runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct MovedSlot {
    /// Its number.
    pub slot: u32,
    /// Its period in microseconds.
    pub period_us: u32,
    /// Its start in the mission that runs, in microseconds.
    pub from_us: u32,
    /// Its start in the mission to come.
    pub to_us: u32,
    /// The longest that it can take from its last start in the one mission to its first start in
    /// the other, in microseconds, wherever the one takes over.
    pub longest_gap_us: u64,
}

impl Handover {
    /// What becomes of the slots of `running` when the mission with the slots `next` follows.
    pub fn between(running: &SlotTable, next: &SlotTable) -> Self {
        let interpreter_us = running.interpreter_period_us();
        let mut handover = Handover {
            interpreter_period_changes: interpreter_us != next.interpreter_period_us(),
            ..Handover::default()
        };
        for slot in &next.slots {
            let to_us = slot.fixed_start_us.unwrap_or_default();
            let Some(from_us) = running.start_us(slot.number, slot.period_us) else {
                continue;
            };
            let goes_on = from_us == to_us && !handover.interpreter_period_changes;
            if goes_on {
                handover.slots_kept.push(slot.number);
                continue;
            }
            let longest_gap_us = if handover.interpreter_period_changes {
                longest_gap_anew_us(interpreter_us, slot.period_us, from_us, to_us)
            } else {
                longest_gap_us(interpreter_us, slot.period_us, from_us, to_us)
            };
            handover.slots_moved.push(MovedSlot {
                slot: slot.number,
                period_us: slot.period_us,
                from_us,
                to_us,
                longest_gap_us,
            });
        }
        handover
    }

    /// Whether every slot that both have goes on as it runs.
    pub fn is_seamless(&self) -> bool {
        self.slots_moved.is_empty()
    }
}

impl fmt::Display for Handover {
    /// A line for each slot that does not go on as it runs.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.interpreter_period_changes {
            f.write_str("the interpreter gets another period, so that all slots start anew")?;
            if self.slots_moved.is_empty() {
                return Ok(());
            }
            f.write_str(":\n")?;
        }
        for (position, moved) in self.slots_moved.iter().enumerate() {
            let MovedSlot {
                slot,
                period_us,
                from_us,
                to_us,
                longest_gap_us,
            } = moved;
            if position > 0 {
                f.write_str("\n")?;
            }
            write!(f, "slot {slot} does not go on as it runs: ")?;
            if from_us != to_us {
                write!(f, "its start moves from {from_us} us to {to_us} us; ")?;
            }
            write!(
                f,
                "once, up to {longest_gap_us} us pass from one occurrence to the next, where its period is {period_us} us"
            )?;
        }
        Ok(())
    }
}

/// The longest time from a slot's last start before a take-over to its first one at or after it, in
/// microseconds, where the take-over is at a multiple of `interpreter_us` and the slot's start,
/// counted from the same origin, moves from `from_us` to `to_us`.
fn longest_gap_us(interpreter_us: u32, period_us: u32, from_us: u32, to_us: u32) -> u64 {
    let [period_us, from_us, to_us] = [period_us, from_us, to_us].map(u64::from);
    // Within the slot's period, take-overs fall on the multiples of this, and on each of them.
    let step_us = gcd(interpreter_us.into(), period_us).max(1);
    if from_us == to_us {
        return period_us;
    }
    // The next new start after an old one is a whole period too early where the take-over is behind
    // it, and not behind the next old one.
    let is_skipped = to_us > from_us || from_us / step_us * step_us > to_us;
    (to_us + period_us - from_us) % period_us + if is_skipped { period_us } else { 0 }
}

/// The same where the take-over becomes the origin of the new starts.
fn longest_gap_anew_us(interpreter_us: u32, period_us: u32, from_us: u32, to_us: u32) -> u64 {
    let [period_us, from_us, to_us] = [period_us, from_us, to_us].map(u64::from);
    let step_us = gcd(interpreter_us.into(), period_us).max(1);
    // The nearest that a take-over can be before an old start: from the start before that, the rest
    // of the period has passed.
    period_us - from_us % step_us + to_us
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::check;
    use super::*;

    /// (number, period, duration, start) of each slot; the first runs the interpreter.
    fn table(slots: &[(u32, u32, u32, u32)]) -> SlotTable {
        SlotTable {
            slots: slots
                .iter()
                .map(|&(number, period_us, duration_us, start_us)| SlotSpec {
                    number,
                    period_us,
                    duration_us,
                    fixed_start_us: Some(start_us),
                })
                .collect(),
            interpreter: 0,
        }
    }

    /// The longest gap, by looking at all take-overs until they repeat.
    fn longest_gap_seen_us(
        interpreter_us: u32,
        period_us: u32,
        from_us: u32,
        to_us: u32,
        anew: bool,
    ) -> u64 {
        let [interpreter_us, period_us, from_us, to_us] =
            [interpreter_us, period_us, from_us, to_us].map(u64::from);
        // From the second period of the slot on, so that it was there before.
        let take_overs = (0..=2 * period_us).map(|index| 2 * period_us + index * interpreter_us);
        let take_overs = take_overs.map(|time| time.next_multiple_of(interpreter_us));
        take_overs
            .map(|take_over_us| {
                let old = (0..).map(|index| from_us + index * period_us);
                let last_us = old.take_while(|start_us| *start_us < take_over_us).last();
                let origin_us = if anew { take_over_us } else { 0 };
                let mut new = (0..).map(|index| origin_us + to_us + index * period_us);
                let first_us = new.find(|start_us| *start_us >= take_over_us);
                first_us.unwrap() - last_us.unwrap()
            })
            .max()
            .unwrap()
    }

    proptest! {
        #[test]
        fn the_longest_gap_is_the_longest_of_all_take_overs(
            interpreter_us in 1_u32..30,
            period_us in 1_u32..30,
            from in any::<prop::sample::Index>(),
            to in any::<prop::sample::Index>(),
        ) {
            let from_us = from.index(period_us as usize) as u32;
            let to_us = to.index(period_us as usize) as u32;
            prop_assert_eq!(
                longest_gap_us(interpreter_us, period_us, from_us, to_us),
                longest_gap_seen_us(interpreter_us, period_us, from_us, to_us, false)
            );
            prop_assert_eq!(
                longest_gap_anew_us(interpreter_us, period_us, from_us, to_us),
                longest_gap_seen_us(interpreter_us, period_us, from_us, to_us, true)
            );
        }
    }

    const LIMIT: Duration = Duration::from_secs(5);

    #[test]
    fn as_few_slots_move_as_need_to() {
        let running = table(&[
            (1, 10_000, 1_000, 0),
            (2, 10_000, 1_000, 4_000),
            (3, 20_000, 2_000, 6_000),
            (4, 40_000, 1_000, 8_500),
        ]);
        // What is asked for, at starts that a search would have found without the running mission;
        // which slots go on, and which move.
        type Case<'c> = (&'c str, &'c [(u32, u32, u32, u32)], &'c [u32], &'c [u32]);
        let cases: &[Case<'_>] = &[
            (
                "the same slots",
                &[
                    (1, 10_000, 1_000, 0),
                    (2, 10_000, 1_000, 1_000),
                    (3, 20_000, 2_000, 2_000),
                ],
                &[1, 2, 3],
                &[],
            ),
            (
                "a further one, another duration",
                &[
                    (1, 10_000, 1_000, 0),
                    (2, 10_000, 1_500, 1_000),
                    (7, 10_000, 3_000, 3_000),
                ],
                &[1, 2],
                &[],
            ),
            (
                "a slot with another period is another slot",
                &[(1, 10_000, 1_000, 0), (3, 40_000, 2_000, 1_000)],
                &[1],
                &[],
            ),
            (
                "slot 2 grows into slot 3, which moves: its period is longer",
                &[
                    (1, 10_000, 1_000, 0),
                    (2, 10_000, 3_000, 1_000),
                    (3, 20_000, 2_000, 4_000),
                ],
                &[1, 2],
                &[3],
            ),
            (
                "a long slot leaves room at the end of the period alone",
                &[
                    (1, 10_000, 1_000, 0),
                    (9, 10_000, 7_000, 1_000),
                    (2, 10_000, 1_000, 8_000),
                    (4, 40_000, 1_000, 9_000),
                ],
                &[1],
                &[2, 4],
            ),
            (
                "the interpreter changes places",
                &[(2, 10_000, 1_000, 0), (1, 10_000, 1_000, 1_000)],
                &[],
                &[2, 1],
            ),
        ];
        for (what, slots, kept, moved) in cases {
            let mut next = table(slots);
            let schedule = lay_out(&running, &next, LIMIT);
            for (slot, start_us) in next.slots.iter_mut().zip(&schedule.starts_us) {
                slot.fixed_start_us = Some(*start_us);
            }
            assert_eq!(check(&next.slots, &schedule.starts_us), Ok(()), "{what}");
            assert_eq!(schedule.starts_us.first(), Some(&0), "{what}");
            let handover = Handover::between(&running, &next);
            let numbers: Vec<u32> = handover.slots_moved.iter().map(|slot| slot.slot).collect();
            assert_eq!(
                (&*handover.slots_kept, &*numbers),
                (*kept, *moved),
                "{what}"
            );
        }
    }

    #[test]
    fn what_moves_is_told_with_the_longest_gap() {
        let running = table(&[(1, 10_000, 1_000, 0), (2, 20_000, 1_000, 4_000)]);
        let cases = [
            (
                table(&[(1, 10_000, 1_000, 0), (2, 20_000, 1_000, 4_000)]),
                "",
            ),
            (
                table(&[(1, 10_000, 1_000, 0), (2, 20_000, 1_000, 6_000)]),
                "slot 2 does not go on as it runs: its start moves from 4000 us to 6000 us; once, up to 22000 us pass from one occurrence to \
                 the next, where its period is 20000 us",
            ),
            (
                table(&[(1, 10_000, 1_000, 0), (2, 20_000, 1_000, 2_000)]),
                "slot 2 does not go on as it runs: its start moves from 4000 us to 2000 us; once, up to 18000 us pass from one occurrence to \
                 the next, where its period is 20000 us",
            ),
            (
                table(&[(1, 5_000, 1_000, 0), (2, 20_000, 1_000, 4_000)]),
                "the interpreter gets another period, so that all slots start anew:\nslot 2 does not go on as it runs: once, up to 20000 us \
                 pass from one occurrence to the next, where its period is 20000 us",
            ),
            (
                table(&[(1, 5_000, 1_000, 0)]),
                "the interpreter gets another period, so that all slots start anew",
            ),
        ];
        for (next, told) in cases {
            let handover = Handover::between(&running, &next);
            assert_eq!(handover.to_string(), told);
            assert_eq!(handover.is_seamless(), handover.slots_moved.is_empty());
        }
    }
}
