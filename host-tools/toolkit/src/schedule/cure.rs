//! What to change where there is no schedule: tried, not guessed.
//!
//! A reason names slots. A cure is a change of one of them, or of all in the same way, after which
//! those slots have a schedule: it is found by trying changes, small ones first, and searching for
//! a schedule of what they make. Whether the rest of the table then has its place is another
//! question, and the next search tells.

use std::cmp::Reverse;
use std::fmt;

use super::clock::Clock;
use super::infeasibility::Numbers;
use super::proof::{self, Verdict};
use super::{Infeasibility, Outcome, SlotSpec, bounds, exceeds_one, gcd, solve_within};

/// As many slots of a reason are tried, the longest of them.
const MAX_TRIED_SLOTS: usize = 12;

/// As many other periods are tried.
const MAX_TRIED_PERIODS: usize = 60;

/// Small pieces of work that all trials for one cure take together, and one trial at most.
const ALL_TICKS: u64 = 8_000_000;
const TRIAL_TICKS: u64 = 400_000;

/// Steps of one proof that a trial begins with.
const PROOF_STEPS: u64 = 300;

/// A change of slots.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Change {
    /// A slot gets a shorter duration.
    Shorten {
        /// Its number.
        slot: u32,
        /// Its duration in microseconds.
        from_us: u32,
        /// The new one.
        to_us: u32,
    },
    /// A slot gets another period.
    Period {
        /// Its number.
        slot: u32,
        /// Its period in microseconds.
        from_us: u32,
        /// The new one.
        to_us: u32,
    },
    /// Slots get a part of their durations, cut to whole microseconds.
    ShortenAll {
        /// Their numbers.
        slots: Vec<u32>,
        /// The part.
        percent: u32,
    },
    /// Slots come back less often.
    SlowAll {
        /// Their numbers.
        slots: Vec<u32>,
        /// How many times as long their periods become.
        factor: u32,
    },
}

impl Change {
    /// The slots with the change made.
    pub fn applied(&self, slots: &[SlotSpec]) -> Vec<SlotSpec> {
        let mut changed = slots.to_vec();
        for spec in &mut changed {
            match self {
                Change::Shorten { slot, to_us, .. } if *slot == spec.number => {
                    spec.duration_us = *to_us;
                }
                Change::Period { slot, to_us, .. } if *slot == spec.number => {
                    spec.period_us = *to_us;
                }
                Change::ShortenAll { slots, percent } if slots.contains(&spec.number) => {
                    let part_us = u64::from(spec.duration_us) * u64::from(*percent) / 100;
                    spec.duration_us = u32::try_from(part_us).unwrap_or(spec.duration_us).max(1);
                }
                Change::SlowAll { slots, factor } if slots.contains(&spec.number) => {
                    spec.period_us = spec.period_us.saturating_mul(*factor);
                }
                _ => {}
            }
        }
        changed
    }
}

impl fmt::Display for Change {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Change::Shorten {
                slot,
                from_us,
                to_us,
            } => write!(f, "shorten slot {slot} from {from_us} us to {to_us} us"),
            Change::Period {
                slot,
                from_us,
                to_us,
            } => write!(
                f,
                "give slot {slot} a period of {to_us} us instead of {from_us} us"
            ),
            Change::ShortenAll { slots, percent } => match slots.as_slice() {
                [slot] => write!(f, "shorten slot {slot} to {percent} % of its duration"),
                _ => write!(
                    f,
                    "shorten slots {} to {percent} % of their durations",
                    Numbers(slots)
                ),
            },
            Change::SlowAll { slots, factor } => match slots.as_slice() {
                [slot] => write!(f, "give slot {slot} a period {factor} times as long"),
                _ => write!(
                    f,
                    "give slots {} periods {factor} times as long",
                    Numbers(slots)
                ),
            },
        }
    }
}

/// What to change. `Display` says it in words.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Cure {
    /// Each of these alone takes the reason away, and gives the slots that it names a schedule.
    /// Empty where none was found.
    pub changes: Vec<Change>,
    /// What helps in general.
    pub advice: String,
}

impl fmt::Display for Cure {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (position, change) in self.changes.iter().enumerate() {
            let separator = if position > 0 { ", or " } else { "" };
            write!(f, "{separator}{change}")?;
        }
        if self.changes.is_empty() {
            f.write_str(&self.advice)?;
        }
        Ok(())
    }
}

impl Infeasibility {
    /// What to change. `slots` are those that were searched.
    pub fn cure(&self, slots: &[SlotSpec]) -> Cure {
        let named = |numbers: &[u32]| -> Vec<SlotSpec> {
            slots
                .iter()
                .filter(|slot| numbers.contains(&slot.number))
                .copied()
                .collect()
        };
        let changes = match self {
            Infeasibility::TooLong {
                slot,
                duration_us,
                period_us,
            } => {
                let shorten = (*period_us > 0).then_some(Change::Shorten {
                    slot: *slot,
                    from_us: *duration_us,
                    to_us: *period_us,
                });
                let slow = Change::Period {
                    slot: *slot,
                    from_us: *period_us,
                    to_us: (*duration_us).max(1),
                };
                shorten.into_iter().chain([slow]).collect()
            }
            Infeasibility::Utilisation { heaviest, .. } => {
                let all: Vec<u32> = slots.iter().map(|slot| slot.number).collect();
                // The others may take all the time there is, and then they have to give, too.
                [heaviest, &all]
                    .into_iter()
                    .map(|numbers| lighter(slots, numbers))
                    .find(|changes| !changes.is_empty())
                    .unwrap_or_default()
            }
            Infeasibility::Crowded { slots: numbers, .. }
            | Infeasibility::Packing { slots: numbers, .. }
            | Infeasibility::Orders { slots: numbers, .. } => {
                Trials::new(ALL_TICKS).find(&named(numbers))
            }
            Infeasibility::Exhausted { .. } => Trials::new(ALL_TICKS).find(slots),
            Infeasibility::FixedStarts { .. } => Vec::new(),
        };
        Cure {
            changes,
            advice: self.advice(),
        }
    }
}

/// Some of the slots made lighter, until all together ask for no more time than there is.
fn lighter(slots: &[SlotSpec], numbers: &[u32]) -> Vec<Change> {
    /// Beyond it, nobody means the same slot any more.
    const MAX_FACTOR: u32 = 16;
    let fits = |change: &Change| {
        let changed = change.applied(slots);
        let times_us = changed
            .iter()
            .map(|slot| (slot.period_us, slot.duration_us));
        !exceeds_one(times_us)
    };
    let shorten = |percent| Change::ShortenAll {
        slots: numbers.to_vec(),
        percent,
    };
    let slow = |factor| Change::SlowAll {
        slots: numbers.to_vec(),
        factor,
    };
    let shorter = (1..100).rev().map(shorten).find(|change| fits(change));
    let slower = (2..=MAX_FACTOR).map(slow).find(|change| fits(change));
    shorter.into_iter().chain(slower).collect()
}

/// Trials of changes, as far as the work for them is bounded.
pub(super) struct Trials {
    ticks_left: u64,
}

impl Trials {
    pub(super) fn new(ticks_left: u64) -> Self {
        Trials { ticks_left }
    }

    /// Searches with all the work that is left.
    pub(super) fn solve(&mut self, slots: &[SlotSpec]) -> Outcome {
        let mut clock = Clock::of_pieces(self.ticks_left);
        let outcome = solve_within(slots, &mut clock);
        self.ticks_left = clock.ticks_left();
        outcome
    }

    /// The smallest change of a duration, and that of a period, after which slots have a schedule.
    fn find(&mut self, core: &[SlotSpec]) -> Vec<Change> {
        let shorter = self.shorter(core).or_else(|| self.all_shorter(core));
        // Twice or half the period at most.
        let is_near = |slot: &SlotSpec, to_us: u32| {
            to_us.max(slot.period_us) / 2 <= to_us.min(slot.period_us)
        };
        let other = self.other_period(core, &is_near);
        shorter.into_iter().chain(other).collect()
    }

    /// Whether a schedule is found for slots.
    pub(super) fn works(&mut self, slots: &[SlotSpec]) -> bool {
        if self.ticks_left == 0 {
            return false;
        }
        let mut clock = Clock::of_pieces(TRIAL_TICKS.min(self.ticks_left));
        let before = clock.ticks_left();
        // What is refuted need not be explained here.
        let is_refuted = bounds::single_slots(slots).is_some()
            || bounds::windows(slots, &mut clock).is_some()
            || proof::packing(slots, &mut { PROOF_STEPS }, &mut clock) == Verdict::Refuted;
        let works = !is_refuted && matches!(solve_within(slots, &mut clock), Outcome::Feasible(_));
        // One for the trial itself: it comes to an end however little work each is.
        let spent = before - clock.ticks_left();
        self.ticks_left = self.ticks_left.saturating_sub(spent + 1_000);
        works
    }

    /// The slot that has to give up the smallest part of its duration.
    fn shorter(&mut self, core: &[SlotSpec]) -> Option<Change> {
        let unit_us = core.iter().fold(0, |unit, slot| {
            gcd(gcd(unit, slot.duration_us.into()), slot.period_us.into())
        });
        let unit_us = u32::try_from(unit_us).unwrap_or(1).max(1);
        let mut candidates: Vec<&SlotSpec> = core.iter().collect();
        candidates.sort_by_key(|slot| (Reverse(slot.duration_us), slot.number));
        let mut best: Option<(u64, Change)> = None;
        for slot in candidates.into_iter().take(MAX_TRIED_SLOTS) {
            let shorten = |units: u32| Change::Shorten {
                slot: slot.number,
                from_us: slot.duration_us,
                to_us: units * unit_us,
            };
            // In units: so much works, so much does not.
            let (mut works, mut fails) = (0, slot.duration_us.div_ceil(unit_us));
            // What is no better than the best one known is not looked for.
            let worst = best.as_ref().map_or(0, |(kept, _)| {
                u32::try_from(u64::from(fails) * kept / 1_000_000).unwrap_or(0)
            });
            let first = worst.max(1);
            if first >= fails || !self.works(&shorten(first).applied(core)) {
                continue;
            }
            works = works.max(first);
            while works + 1 < fails {
                let middle = works + (fails - works) / 2;
                if self.works(&shorten(middle).applied(core)) {
                    works = middle;
                } else {
                    fails = middle;
                }
            }
            let kept = u64::from(works * unit_us) * 1_000_000 / u64::from(slot.duration_us.max(1));
            if best.as_ref().is_none_or(|(best_kept, _)| kept > *best_kept) {
                best = Some((kept, shorten(works)));
            }
        }
        best.map(|(_, change)| change)
    }

    /// All shortened alike, where one alone does not suffice.
    fn all_shorter(&mut self, core: &[SlotSpec]) -> Option<Change> {
        let shorten = |percent| Change::ShortenAll {
            slots: core.iter().map(|slot| slot.number).collect(),
            percent,
        };
        let (mut works, mut fails) = (0, 100);
        while works + 1 < fails {
            let middle = works + (fails - works) / 2;
            if self.works(&shorten(middle).applied(core)) {
                works = middle;
            } else {
                fails = middle;
            }
        }
        (works > 0).then(|| shorten(works))
    }

    /// A slot with another period, the nearest that works: one of the others', or a multiple of one
    /// of them.
    pub(super) fn other_period(
        &mut self,
        core: &[SlotSpec],
        is_allowed: &dyn Fn(&SlotSpec, u32) -> bool,
    ) -> Option<Change> {
        let mut periods_us: Vec<u32> = core.iter().map(|slot| slot.period_us).collect();
        periods_us.sort_unstable();
        periods_us.dedup();
        // (by how much, shorter ones later, slot, period).
        let mut candidates: Vec<(u64, bool, u32, u32)> = Vec::new();
        for slot in core {
            for &base_us in &periods_us {
                let below = slot.period_us / base_us.max(1);
                for factor in [below, below.saturating_add(1)] {
                    let to_us = base_us.saturating_mul(factor);
                    let is_possible = to_us != slot.period_us
                        && to_us >= slot.duration_us.max(1)
                        && slot.fixed_start_us.is_none_or(|start_us| start_us < to_us);
                    let (short, long) = (to_us.min(slot.period_us), to_us.max(slot.period_us));
                    if is_possible && is_allowed(slot, to_us) {
                        let ratio = u64::from(long) * 1_000_000 / u64::from(short.max(1));
                        candidates.push((ratio, to_us < slot.period_us, slot.number, to_us));
                    }
                }
            }
        }
        candidates.sort_unstable();
        candidates.dedup();
        candidates
            .into_iter()
            .take(MAX_TRIED_PERIODS)
            .filter_map(|(_, _, number, to_us)| {
                let slot = core.iter().find(|slot| slot.number == number)?;
                Some(Change::Period {
                    slot: number,
                    from_us: slot.period_us,
                    to_us,
                })
            })
            .find(|change| self.works(&change.applied(core)))
    }
}
