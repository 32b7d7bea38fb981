//! Slots whose periods form a chain: each divides the next (harmonic).
//!
//! In the packing view (Grus, Hanen, Hanzálek 2024) such a schedule packs rectangles of
//! height-divisible sizes: x is the time in a frame as long as the shortest period, y the number of
//! the frame, and a slot of k frames' period takes the same x in every k-th frame. Cut where a slot
//! of the shortest period begins, a frame is one free *gap*. Slots of the shortest period stand at
//! the left of it, side by side; what they leave is one gap again. A period m times as long sees
//! that gap m times, and its slots go to the left of some of the copies; and so on. That loses
//! nothing: within a gap, what is in it can be sorted by period, in each copy alike. Gaps of equal
//! length are alike too. So only *which lengths remain* matters, and the search decides for one
//! slot after another, longest first in its period, into a gap of which length it goes.
//!
//! Three counts end a branch early, all over the whole hyperframe:
//! - a gap whose length cannot be filled by any sum of the durations still to come wastes at least
//!   the rest; all waste must fit the slack;
//! - the slots of at least a duration need as much time, and as many places, as the gaps of at
//!   least that length have.
//!
//! A search without limit is exact: if it ends without success, there is no schedule. With a limit
//! and random choices among the gaps it finds schedules of full tables quickly, begun anew again
//! and again.

use std::cmp::Reverse;

use super::SlotSpec;
use super::clock::Clock;
use super::random::Random;

/// The most slots of a chain; more are left to the other searches. Bounds the depth of the
/// recursion too.
pub(super) const MAX_CHAIN_SLOTS: usize = 512;

/// The most gaps that are kept apart.
const MAX_GAPS: usize = 4_096;

/// The most words in all tables of sums together: 32 MiB.
const MAX_SUM_WORDS: u64 = 1 << 22;

/// A slot in a chain.
#[derive(Clone, Copy, Debug)]
pub(super) struct Member {
    /// Index of the slot.
    pub(super) index: usize,
    /// The period that it counts with here, in microseconds: its own, or one of the chain that asks
    /// for less.
    pub(super) period_us: u64,
    /// Duration in microseconds.
    pub(super) duration_us: u64,
}

/// What a search came to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// Starts in the order of the members, in microseconds.
    Found(Vec<u64>),
    /// There is no schedule.
    Exhausted,
    /// The limit of steps, the clock or the number of gaps ended it.
    GivenUp,
}

/// All slots as members, if their periods form a chain and there are not too many.
pub(super) fn of_slots(slots: &[SlotSpec]) -> Option<Vec<Member>> {
    let mut periods_us: Vec<u32> = slots.iter().map(|slot| slot.period_us).collect();
    periods_us.sort_unstable();
    periods_us.dedup();
    let is_chain = periods_us
        .windows(2)
        .all(|pair| pair[0] != 0 && pair[1].is_multiple_of(pair[0]));
    (is_chain && slots.len() <= MAX_CHAIN_SLOTS).then(|| members(slots))
}

/// Slots as members, with their own periods.
pub(super) fn members(slots: &[SlotSpec]) -> Vec<Member> {
    slots
        .iter()
        .enumerate()
        .map(|(index, slot)| Member {
            index,
            period_us: slot.period_us.into(),
            duration_us: slot.duration_us.into(),
        })
        .collect()
}

/// A chain made ready to be searched, any number of times.
#[derive(Debug)]
pub(super) struct Chain {
    levels: Vec<Level>,
    members: usize,
    /// Unit of time: every duration and period is a multiple of it.
    unit_us: u64,
    /// Length of the frame in units.
    frame: u64,
    /// Time in the hyperframe that no slot takes, in units; `None` where they take more than there
    /// is.
    slack: Option<u64>,
}

/// The slots of one period.
#[derive(Debug)]
struct Level {
    period_us: u64,
    /// Copies of a gap of this period in the hyperframe.
    weight: u64,
    /// Longest first.
    items: Vec<Item>,
    /// `later[i]`: what is still to come when the first i items have their places.
    later: Vec<Later>,
}

#[derive(Clone, Copy, Debug)]
struct Item {
    member: usize,
    /// In units.
    duration: u64,
}

/// What is still to come.
#[derive(Clone, Debug, Default)]
struct Later {
    /// Bit n: some of the durations still to come sum up to n units. Empty where that table would
    /// be too large: then each sum counts as possible.
    sums: Vec<u64>,
    /// For each duration, longest first: what all slots of at least that duration need in the
    /// hyperframe.
    needs: Vec<Need>,
}

#[derive(Clone, Copy, Debug)]
struct Need {
    duration: u64,
    time: u64,
    places: u64,
}

/// Free time in every frame of its period.
#[derive(Clone, Copy, Debug)]
struct Gap {
    start_us: u64,
    /// In units.
    length: u64,
}

impl Chain {
    /// Makes a chain of members whose periods divide one another. Durations are above 0.
    pub(super) fn new(members: &[Member]) -> Self {
        let mut periods_us: Vec<u64> = members.iter().map(|member| member.period_us).collect();
        periods_us.sort_unstable();
        periods_us.dedup();
        let longest_us = periods_us.last().copied().unwrap_or(1).max(1);
        let shortest_us = periods_us.first().copied().unwrap_or(1).max(1);
        let unit_us = members
            .iter()
            .fold(shortest_us, |unit, member| {
                super::gcd(unit, member.duration_us)
            })
            .max(1);
        let frame = shortest_us / unit_us;
        let words = frame / u64::from(u64::BITS) + 1;
        let with_sums = words.saturating_mul(members.len() as u64 + 1) <= MAX_SUM_WORDS;
        let mut levels: Vec<Level> = periods_us
            .iter()
            .map(|&period_us| {
                let mut items: Vec<Item> = members
                    .iter()
                    .enumerate()
                    .filter(|(_, member)| member.period_us == period_us)
                    .map(|(position, member)| Item {
                        member: position,
                        duration: member.duration_us / unit_us,
                    })
                    .collect();
                items.sort_by_key(|item| (Reverse(item.duration), item.member));
                Level {
                    period_us,
                    weight: longest_us / period_us.max(1),
                    items,
                    later: Vec::new(),
                }
            })
            .collect();
        let mut sums = if with_sums {
            let mut sums = vec![0; usize::try_from(words).unwrap_or(0)];
            if let Some(first) = sums.first_mut() {
                *first = 1;
            }
            sums
        } else {
            Vec::new()
        };
        // From the end: what comes later is known first.
        let mut coming: Vec<(u64, u64)> = Vec::new();
        for level in levels.iter_mut().rev() {
            let mut later = vec![Later {
                sums: sums.clone(),
                needs: needs(&coming),
            }];
            for item in level.items.iter().rev() {
                add_to_sums(&mut sums, item.duration);
                let at = coming.partition_point(|&(duration, _)| duration > item.duration);
                coming.insert(at, (item.duration, level.weight));
                later.push(Later {
                    sums: sums.clone(),
                    needs: needs(&coming),
                });
            }
            later.reverse();
            level.later = later;
        }
        let taken: u64 = coming
            .iter()
            .map(|(duration, weight)| duration * weight)
            .sum();
        Chain {
            levels,
            members: members.len(),
            unit_us,
            frame,
            slack: (frame * (longest_us / shortest_us)).checked_sub(taken),
        }
    }

    /// Searches for at most `max_steps` steps. With `random`, gaps are tried in a random order that
    /// leans towards the tightest.
    pub(super) fn search(
        &self,
        max_steps: u64,
        random: Option<&mut Random>,
        clock: &mut Clock,
    ) -> End {
        let Some(slack) = self.slack else {
            return End::Exhausted;
        };
        let mut search = Search {
            chain: self,
            slack,
            steps_left: max_steps,
            is_cut: false,
            random,
            clock,
            starts_us: vec![0; self.members],
        };
        let whole = Gap {
            start_us: 0,
            length: self.frame,
        };
        let is_found = self
            .levels
            .first()
            .is_none_or(|first| search.level(0, first.period_us, &[whole]));
        match (is_found, search.is_cut) {
            (true, _) => End::Found(search.starts_us),
            (false, true) => End::GivenUp,
            (false, false) => End::Exhausted,
        }
    }
}

/// What all slots of at least each duration need; `coming` holds duration and weight, longest
/// first.
fn needs(coming: &[(u64, u64)]) -> Vec<Need> {
    let mut needs: Vec<Need> = Vec::new();
    let (mut time, mut places) = (0, 0);
    for &(duration, weight) in coming {
        time += duration * weight;
        places += weight;
        let need = Need {
            duration,
            time,
            places,
        };
        match needs.last_mut() {
            Some(last) if last.duration == duration => *last = need,
            _ => needs.push(need),
        }
    }
    needs
}

/// Adds to the set of sums all that one more duration makes possible.
fn add_to_sums(sums: &mut [u64], duration: u64) {
    let bits = u64::from(u64::BITS);
    let Ok(words) = usize::try_from(duration / bits) else {
        return;
    };
    let shift = u32::try_from(duration % bits).unwrap_or(0);
    for at in (words..sums.len()).rev() {
        let mut moved = sums[at - words] << shift;
        if shift > 0 && at > words {
            moved |= sums[at - words - 1] >> (u64::BITS - shift);
        }
        sums[at] |= moved;
    }
}

/// How much of a gap no sum of durations can fill.
fn waste(length: u64, sums: &[u64]) -> u64 {
    if sums.is_empty() {
        return 0;
    }
    let bits = u64::from(u64::BITS);
    let mut at = usize::try_from(length / bits)
        .unwrap_or(usize::MAX)
        .min(sums.len() - 1);
    // The bits above the length are out of reach.
    let mut word = sums[at] & (u64::MAX >> (bits - 1 - length % bits));
    while word == 0 && at > 0 {
        at -= 1;
        word = sums[at];
    }
    // Bit 0, the empty sum, is always set.
    let reached = at as u64 * bits + u64::from(word.checked_ilog2().unwrap_or(0));
    length.saturating_sub(reached)
}

struct Search<'c> {
    chain: &'c Chain,
    slack: u64,
    steps_left: u64,
    is_cut: bool,
    random: Option<&'c mut Random>,
    clock: &'c mut Clock,
    starts_us: Vec<u64>,
}

impl Search<'_> {
    /// Lays out the slots of a level and of all later ones, in gaps that repeat every `every_us`.
    fn level(&mut self, number: usize, every_us: u64, gaps: &[Gap]) -> bool {
        let chain = self.chain;
        let Some(level) = chain.levels.get(number) else {
            return true;
        };
        let turns = level.period_us / every_us;
        let open = gaps.iter().filter(|gap| gap.length > 0);
        let count = open.clone().count();
        if turns.saturating_mul(count as u64) > MAX_GAPS as u64 {
            self.is_cut = true;
            return false;
        }
        let mut copies: Vec<Gap> = (0..turns)
            .flat_map(|turn| {
                open.clone().map(move |gap| Gap {
                    start_us: gap.start_us + turn * every_us,
                    length: gap.length,
                })
            })
            .collect();
        self.item(number, level, 0, &mut copies, u64::MAX)
    }

    /// Places item `at` of a level and all that follow. `previous` is the length of the gap that
    /// the item before went into.
    fn item(
        &mut self,
        number: usize,
        level: &Level,
        at: usize,
        gaps: &mut Vec<Gap>,
        previous: u64,
    ) -> bool {
        let Some(&item) = level.items.get(at) else {
            return self.level(number + 1, level.period_us, gaps);
        };
        // A step costs about as many operations as there are gaps.
        let pieces = u32::try_from(gaps.len()).unwrap_or(u32::MAX);
        if self.steps_left == 0 || self.clock.tick_many(pieces) {
            self.is_cut = true;
            return false;
        }
        self.steps_left -= 1;
        // Equal slots are interchangeable: they go into gaps of falling length.
        let is_twin = at > 0 && level.items[at - 1].duration == item.duration;
        let longest = if is_twin { previous } else { u64::MAX };
        let mut choices: Vec<(u64, usize)> = gaps
            .iter()
            .enumerate()
            .filter(|(_, gap)| item.duration <= gap.length && gap.length <= longest)
            .map(|(position, gap)| (gap.length, position))
            .collect();
        choices.sort_unstable();
        choices.dedup_by_key(|choice| choice.0);
        if let Some(random) = &mut self.random {
            /// One in as many slots does not go into the tightest gap first.
            const RARITY: u64 = 4;
            while choices.len() > 1 && random.once_in(RARITY) {
                let to_front = random.index(choices.len());
                choices[..=to_front].rotate_right(1);
            }
        }
        for (length, position) in choices {
            let gap = gaps[position];
            gaps[position] = Gap {
                start_us: gap.start_us + item.duration * self.chain.unit_us,
                length: length - item.duration,
            };
            if self.can_work(level, at + 1, gaps) {
                self.starts_us[item.member] = gap.start_us;
                if self.item(number, level, at + 1, gaps, length) {
                    return true;
                }
            }
            gaps[position] = gap;
            if self.is_cut {
                return false;
            }
        }
        false
    }

    /// Whether no count speaks against what is left.
    fn can_work(&self, level: &Level, placed: usize, gaps: &[Gap]) -> bool {
        let Some(later) = level.later.get(placed) else {
            return true;
        };
        let mut wasted = 0;
        for gap in gaps {
            wasted += level.weight * waste(gap.length, &later.sums);
            if wasted > self.slack {
                return false;
            }
        }
        later.needs.iter().all(|need| {
            let (mut time, mut places) = (0, 0);
            for gap in gaps.iter().filter(|gap| gap.length >= need.duration) {
                time += gap.length;
                places += gap.length / need.duration;
            }
            time * level.weight >= need.time && places * level.weight >= need.places
        })
    }
}
