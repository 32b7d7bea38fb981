//! Ejection search: any slot gets a place at once, and those in its way lose theirs.
//!
//! Each slot has a weight that grows whenever it finds no free place. A slot without a place goes
//! where the slots in its way weigh least; they wait for their next turn. Places are counted in a
//! window of the period by sweeping over the times at which a slot in the way begins or ceases to
//! be so; of equally good ones the leftmost of a random stretch is taken. So what is hard to place
//! comes to stay, and what is easy moves around it. It finds schedules of tables of any periods,
//! and never proves that there is none. The idea is that of ejection chains (Glover 1996) with the
//! weights of breakout local search (Morris 1993).

use std::cmp::Reverse;

use super::clock::Clock;
use super::random::Random;
use super::{SlotSpec, gcd};

/// Shortest periods in the window that is swept.
const WINDOW_PERIODS: u64 = 20;

/// Shortest periods in the window that is swept now and then, when the short one has no free place.
const WIDE_WINDOW_PERIODS: u64 = 100;

/// Weights are halved after as many steps, so that old troubles are forgotten.
const STEPS_PER_FORGETTING: u64 = 20_000;

/// The most slots that are searched: each step compares one with all.
pub(super) const MAX_EJECTION_SLOTS: usize = 1_024;

/// The most different periods.
const MAX_PERIODS: usize = 256;

/// A search that can be continued.
#[derive(Debug)]
pub(super) struct Ejection {
    slots: Vec<Placing>,
    /// Greatest common divisors of the different periods.
    divisors: Vec<Vec<u64>>,
    /// Indices of the slots without a place.
    waiting: Vec<usize>,
    random: Random,
    steps: u64,
    shortest_us: u64,
    /// Begin or end of a stretch and the weight that it adds, of the sweep at hand.
    edges: Vec<(u64, i64)>,
}

#[derive(Clone, Copy, Debug)]
struct Placing {
    period_us: u64,
    duration_us: u64,
    /// Index of its period.
    class: usize,
    start_us: Option<u64>,
    /// Its start is given: nothing ejects it.
    is_given: bool,
    weight: i64,
}

/// Nobody is ejected at this price.
const GIVEN_WEIGHT: i64 = 1 << 40;

impl Ejection {
    /// Begins a search; `None` where it is not made for so much.
    pub(super) fn new(slots: &[SlotSpec]) -> Option<Self> {
        let mut periods_us: Vec<u64> = slots.iter().map(|slot| slot.period_us.into()).collect();
        periods_us.sort_unstable();
        periods_us.dedup();
        if slots.len() > MAX_EJECTION_SLOTS || periods_us.len() > MAX_PERIODS {
            return None;
        }
        let shortest_us = *periods_us.first()?;
        let divisors = periods_us
            .iter()
            .map(|&a| periods_us.iter().map(|&b| gcd(a, b)).collect())
            .collect();
        let placings: Vec<Placing> = slots
            .iter()
            .map(|slot| {
                let period_us = u64::from(slot.period_us);
                Placing {
                    period_us,
                    duration_us: slot.duration_us.into(),
                    class: periods_us.partition_point(|&other| other < period_us),
                    start_us: slot.fixed_start_us.map(u64::from),
                    is_given: slot.fixed_start_us.is_some(),
                    weight: 1,
                }
            })
            .collect();
        let mut waiting: Vec<usize> = (0..slots.len())
            .filter(|&index| !placings[index].is_given)
            .collect();
        // Taken from the back: the shortest periods first, in each the longest durations.
        waiting.sort_by_key(|&index| {
            (
                Reverse(placings[index].period_us),
                placings[index].duration_us,
                index,
            )
        });
        Some(Ejection {
            slots: placings,
            divisors,
            waiting,
            random: Random::new(1),
            steps: 0,
            shortest_us,
            edges: Vec::new(),
        })
    }

    /// Goes on for at most so many steps. Gives the starts in microseconds once all slots have
    /// their place.
    pub(super) fn search(&mut self, max_steps: u64, clock: &mut Clock) -> Option<Vec<u32>> {
        for _ in 0..max_steps {
            let Some(index) = self.next() else {
                return self
                    .slots
                    .iter()
                    .map(|slot| u32::try_from(slot.start_us?).ok())
                    .collect();
            };
            if clock.tick_many(u32::try_from(self.slots.len()).unwrap_or(u32::MAX)) {
                return None;
            }
            self.steps += 1;
            self.place(index);
            if self.steps.is_multiple_of(STEPS_PER_FORGETTING) {
                for slot in &mut self.slots {
                    slot.weight = (slot.weight + 1) / 2;
                }
            }
        }
        None
    }

    /// Indices of the slots, those first that found no free place most often of late.
    pub(super) fn hardest(&self) -> Vec<usize> {
        let mut indices: Vec<usize> = (0..self.slots.len()).collect();
        indices.sort_by_key(|&index| (Reverse(self.slots[index].weight), index));
        indices
    }

    /// The slot whose turn it is: in order as long as it is the first turn of most, then any.
    fn next(&mut self) -> Option<usize> {
        if self.steps <= self.slots.len() as u64 || self.waiting.is_empty() {
            return self.waiting.pop();
        }
        let position = self.random.index(self.waiting.len());
        Some(self.waiting.swap_remove(position))
    }

    /// Puts a slot where the slots in its way weigh least, and takes theirs from them.
    fn place(&mut self, index: usize) {
        let short_us = self.shortest_us.saturating_mul(WINDOW_PERIODS);
        let wide_us = self.shortest_us.saturating_mul(WIDE_WINDOW_PERIODS);
        let mut best = self.lightest(index, short_us);
        if best.0 > 0 {
            best = best.min(self.lightest(index, short_us));
        }
        if best.0 > 0 && self.slots[index].period_us > short_us && self.random.once_in(4) {
            best = best.min(self.lightest(index, wide_us));
        }
        let (weight, start_us) = best;
        if weight >= GIVEN_WEIGHT {
            // Only given starts leave it no place here: another window, another time.
            self.waiting.push(index);
            self.slots[index].weight += 1;
            return;
        }
        if weight > 0 {
            self.slots[index].weight += 1;
            for other in 0..self.slots.len() {
                if other != index && self.clashes(index, start_us, other) {
                    self.slots[other].start_us = None;
                    self.waiting.push(other);
                }
            }
        }
        self.slots[index].start_us = Some(start_us);
    }

    /// Whether a slot that starts then overlaps one that has a place.
    fn clashes(&self, index: usize, start_us: u64, other: usize) -> bool {
        let (slot, other) = (&self.slots[index], &self.slots[other]);
        let Some(other_us) = other.start_us else {
            return false;
        };
        let divisor = self.divisors[slot.class][other.class];
        let since = (start_us + divisor - other_us % divisor) % divisor;
        since < other.duration_us || since + slot.duration_us > divisor
    }

    /// The start in a random window of the period at which the slots in the way weigh least, with
    /// their weight.
    fn lightest(&mut self, index: usize, window_us: u64) -> (i64, u64) {
        let slot = self.slots[index];
        let window_us = window_us.min(slot.period_us);
        let begin_us = if window_us == slot.period_us {
            0
        } else {
            self.random.below(slot.period_us)
        };
        let end_us = begin_us + window_us;
        self.edges.clear();
        // What is in the way wherever it starts.
        let mut weight = 0;
        for (position, other) in self.slots.iter().enumerate() {
            let Some(other_us) = other.start_us.filter(|_| position != index) else {
                continue;
            };
            let price = if other.is_given {
                GIVEN_WEIGHT
            } else {
                other.weight
            };
            let divisor = self.divisors[slot.class][other.class];
            let length = slot.duration_us + other.duration_us - 1;
            if length >= divisor {
                weight += price;
                continue;
            }
            // Starts from `first` on, `length` of them, again after each divisor, are in its way.
            let first = (other_us + divisor - (slot.duration_us - 1) % divisor) % divisor;
            let into = (begin_us % divisor + divisor - first) % divisor;
            if into < length {
                self.edges.push((begin_us, price));
                self.edges
                    .push((end_us.min(begin_us + length - into), -price));
            }
            let mut from = begin_us + divisor - into;
            while from < end_us {
                self.edges.push((from, price));
                self.edges.push((end_us.min(from + length), -price));
                from += divisor;
            }
        }
        self.edges.sort_unstable();
        let mut best = (i64::MAX, begin_us);
        let mut ties = 0;
        let mut edges = self.edges.iter().copied().peekable();
        let mut at_us = begin_us;
        while at_us < end_us {
            while let Some((_, change)) = edges.next_if(|&(edge_us, _)| edge_us == at_us) {
                weight += change;
            }
            if weight < best.0 {
                best = (weight, at_us);
                ties = 1;
            } else if weight == best.0 {
                ties += 1;
                if self.random.once_in(ties) {
                    best.1 = at_us;
                }
            }
            at_us = edges.peek().map_or(end_us, |&(edge_us, _)| edge_us);
        }
        (best.0, best.1 % slot.period_us)
    }
}
