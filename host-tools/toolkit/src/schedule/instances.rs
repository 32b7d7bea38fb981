//! Sets of slots to try a search on: of the kinds that robots have, in any number, the same ones
//! from the same seed.
//!
//! - **Random** ones: periods are drawn from a family with the weights that such tables have, the
//!   utilisation is shared out by UUniFast (Bini, Buttazzo 2005), durations are whole steps of 10
//!   us, none longer than half the shortest period. Whether there is a schedule nobody knows.
//! - **Planted** ones are cut from a full time line: a stretch that comes again with a period is
//!   cut in two, or its activations go to several slots by turns. So there is a schedule, and at
//!   100 % nothing is left over in it; for less, slots are made shorter.
//! - **Links**: messages on a serial line of 115,200 baud, as long as their bytes take.
//! - **Tables**: the tasks of a loop, each every so many ticks, odd numbers among them; little load
//!   and a long hyperperiod.
//!
//! The distribution of automotive periods is that of Kramer, Ziegenbein and Hamann (Real world
//! automotive benchmarks for free, 2015).

use std::fmt;

use super::SlotSpec;
use super::random::Random;

/// Durations are multiples of this, unless so many slots would take too much already if each lasted
/// one step.
const STEP_US: u32 = 10;

/// Periods that go together, with how often each is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Family {
    /// 1 ms and its doubles up to 128 ms.
    Harmonic,
    /// 1, 2, 5, 10, … 200, 1,000 ms.
    Automotive,
    /// 400, 200, 100, 50, 40, 20, 10, 5, 2 and 1 Hz.
    Robot,
    /// Those of messages on a link: 10, 20, 50, … 1,000 ms.
    Message,
}

impl Family {
    /// Period in microseconds and weight, shortest first.
    fn periods_us(self) -> &'static [(u32, u64)] {
        match self {
            Family::Harmonic => &[
                (1_000, 5),
                (2_000, 9),
                (4_000, 11),
                (8_000, 16),
                (16_000, 18),
                (32_000, 18),
                (64_000, 13),
                (128_000, 10),
            ],
            Family::Automotive => &[
                (1_000, 3),
                (2_000, 2),
                (5_000, 2),
                (10_000, 25),
                (20_000, 25),
                (50_000, 3),
                (100_000, 20),
                (200_000, 1),
                (1_000_000, 4),
            ],
            Family::Robot => &[
                (2_500, 6),
                (5_000, 8),
                (10_000, 14),
                (20_000, 25),
                (25_000, 7),
                (50_000, 8),
                (100_000, 17),
                (200_000, 8),
                (500_000, 3),
                (1_000_000, 4),
            ],
            Family::Message => &[
                (10_000, 1),
                (20_000, 3),
                (50_000, 3),
                (100_000, 6),
                (200_000, 4),
                (500_000, 3),
                (1_000_000, 5),
            ],
        }
    }
}

/// How a set is made.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Drawn.
    Random(Family),
    /// Cut from a full time line.
    Planted(Family),
    /// Messages on a serial line.
    Link,
    /// Tasks of a loop, every so many of its ticks.
    Table,
}

impl Kind {
    /// All of them.
    pub const ALL: [Kind; 10] = [
        Kind::Random(Family::Harmonic),
        Kind::Random(Family::Automotive),
        Kind::Random(Family::Robot),
        Kind::Planted(Family::Harmonic),
        Kind::Planted(Family::Automotive),
        Kind::Planted(Family::Robot),
        Kind::Link,
        Kind::Table,
        Kind::Random(Family::Message),
        Kind::Planted(Family::Message),
    ];

    /// Whether each set has a schedule.
    pub fn is_feasible(self) -> bool {
        matches!(self, Kind::Planted(_))
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self {
            Kind::Random(Family::Harmonic) => "random harmonic",
            Kind::Random(Family::Automotive) => "random automotive",
            Kind::Random(Family::Robot) => "random robot",
            Kind::Planted(Family::Harmonic) => "planted harmonic",
            Kind::Planted(Family::Automotive) => "planted automotive",
            Kind::Planted(Family::Robot) => "planted robot",
            Kind::Random(Family::Message) => "random message",
            Kind::Planted(Family::Message) => "planted message",
            Kind::Link => "link",
            Kind::Table => "table",
        };
        f.pad(name)
    }
}

/// A set of `count` slots, at least one, that take about `percent` of the time.
///
/// A kind gets as near to `percent` as its durations let it: a few slots of long periods cannot
/// take all the time. Of some thousand planted slots there may be fewer, where nothing is left that
/// can be cut.
///
/// ```
/// use esm_toolkit::schedule::instances::{Family, Kind, make};
///
/// let slots = make(Kind::Planted(Family::Robot), 50, 95, 1);
/// assert_eq!(slots.len(), 50);
/// assert_eq!(slots, make(Kind::Planted(Family::Robot), 50, 95, 1));
/// ```
pub fn make(kind: Kind, count: usize, percent: u32, seed: u64) -> Vec<SlotSpec> {
    let count = count.max(1);
    let percent = percent.min(100);
    // Sets that differ in anything have nothing in common.
    let position = Kind::ALL.iter().position(|other| *other == kind);
    let mut random = Random::new(seed);
    for value in [position.unwrap_or(0), count, percent as usize] {
        random = Random::new(random.below(u64::MAX) ^ value as u64);
    }
    let mut times_us = match kind {
        Kind::Random(family) => drawn(family.periods_us(), count, percent, &mut random),
        Kind::Planted(family) => cut(family.periods_us(), count, percent, &mut random),
        Kind::Link => messages(count, percent, &mut random),
        Kind::Table => tasks(count, percent, &mut random),
    };
    // In no order that helps anyone.
    for end in (1..times_us.len()).rev() {
        times_us.swap(end, random.index(end + 1));
    }
    times_us
        .into_iter()
        .zip(1..)
        .map(|((period_us, duration_us), number)| SlotSpec {
            number,
            period_us,
            duration_us,
            fixed_start_us: None,
        })
        .collect()
}

/// Period and duration in microseconds.
type Times = (u32, u32);

fn share((period_us, duration_us): Times) -> f64 {
    f64::from(duration_us) / f64::from(period_us)
}

fn load(times_us: &[Times]) -> f64 {
    times_us.iter().copied().map(share).sum()
}

/// One of them, by weight.
fn period(periods_us: &[(u32, u64)], random: &mut Random) -> u32 {
    let mut at = random.below(periods_us.iter().map(|(_, weight)| weight).sum());
    for &(period_us, weight) in periods_us {
        match at.checked_sub(weight) {
            Some(rest) => at = rest,
            None => return period_us,
        }
    }
    1_000
}

/// A share of the whole for each of `count`, all equally likely (UUniFast).
fn shares(count: usize, random: &mut Random) -> Vec<f64> {
    let mut left = 1.0;
    let mut shares = Vec::with_capacity(count);
    for others in (1..count).rev() {
        let fraction = random.below(1 << 32) as f64 / f64::from(u32::MAX);
        let next = left * libm::pow(fraction, 1.0 / others as f64);
        shares.push(left - next);
        left = next;
    }
    shares.push(left);
    shares
}

// ─── Random ──────────────────────────────────────────────────────────────────────────────────────

/// Periods drawn from `periods_us`, durations shared out.
fn drawn(periods_us: &[(u32, u64)], count: usize, percent: u32, random: &mut Random) -> Vec<Times> {
    let drawn_us: Vec<u32> = (0..count).map(|_| period(periods_us, random)).collect();
    let target = f64::from(percent) / 100.0;
    let least: f64 = drawn_us
        .iter()
        .map(|&period_us| share((period_us, STEP_US)))
        .sum();
    let step_us = if least > target / 2.0 { 1 } else { STEP_US };
    let shortest_us = drawn_us.iter().copied().min().unwrap_or(1);
    let longest_us = (shortest_us / 2 / step_us).max(1) * step_us;
    let shares = shares(count, random);
    // What a slot cannot take, because it would get too long, the others take: in a few rounds.
    const ROUNDS: usize = 16;
    let mut scale = target;
    let mut times_us: Vec<Times> = Vec::new();
    for _ in 0..ROUNDS {
        times_us = drawn_us
            .iter()
            .zip(&shares)
            .map(|(&period_us, share)| {
                let wanted_us = (share * scale * f64::from(period_us)) as u32;
                let whole_us = wanted_us / step_us * step_us;
                (period_us, whole_us.clamp(step_us, longest_us))
            })
            .collect();
        scale *= target / load(&times_us).max(f64::EPSILON);
    }
    trim(&mut times_us, target, step_us, random);
    times_us
}

/// Makes slots shorter, a step at a time, until they take no more than `target`, where they do.
fn trim(times_us: &mut [Times], target: f64, step_us: u32, random: &mut Random) {
    let mut too_much = load(times_us) - target;
    while too_much > 1e-12 && times_us.iter().any(|times| times.1 > step_us) {
        let at = random.index(times_us.len());
        let (period_us, duration_us) = &mut times_us[at];
        if *duration_us > step_us {
            *duration_us -= step_us;
            too_much -= share((*period_us, step_us));
        }
    }
}

// ─── Planted ─────────────────────────────────────────────────────────────────────────────────────

/// Cuts a time line up.
fn cut(periods_us: &[(u32, u64)], count: usize, percent: u32, random: &mut Random) -> Vec<Times> {
    // Many slots need long periods: the frame that is cut up is one of the shorter ones.
    let base_us = periods_us[random.index(periods_us.len() / 2)].0;
    // A stretch that is longer is cut before any other.
    let longest_us = (base_us / (2 + u32::try_from(random.below(8)).unwrap_or(0)) / STEP_US)
        .clamp(2, 100)
        * STEP_US;
    let mut pieces: Vec<Times> = vec![(base_us, base_us)];
    /// Tries for each slot before it counts as impossible to cut another one off.
    const TRIES: usize = 100;
    for _ in 0..TRIES * count {
        if pieces.len() >= count {
            break;
        }
        let too_long = pieces.iter().position(|piece| piece.1 > longest_us);
        let at = too_long.unwrap_or_else(|| random.index(pieces.len()));
        let (period_us, length_us) = pieces[at];
        let turns = if too_long.is_some() {
            None
        } else {
            turns(periods_us, period_us, count - pieces.len() + 1, random)
        };
        match turns {
            Some(turns) if random.below(4) > 0 || length_us < 2 * STEP_US => {
                pieces[at].0 = period_us * turns;
                let piece = pieces[at];
                pieces.extend((1..turns).map(|_| piece));
            }
            _ if length_us >= 2 * STEP_US => {
                let steps = u64::from(length_us / STEP_US);
                let cut_us = STEP_US * (1 + u32::try_from(random.below(steps - 1)).unwrap_or(0));
                pieces[at].1 = cut_us;
                pieces.push((period_us, length_us - cut_us));
            }
            _ => {}
        }
    }
    trim(&mut pieces, f64::from(percent) / 100.0, STEP_US, random);
    pieces
}

/// Among how many slots, at most `most`, the activations of a stretch can go by turns.
fn turns(
    periods_us: &[(u32, u64)],
    period_us: u32,
    most: usize,
    random: &mut Random,
) -> Option<u32> {
    let turns: Vec<u32> = periods_us
        .iter()
        .map(|&(longer_us, _)| longer_us)
        .filter(|longer_us| *longer_us > period_us && longer_us.is_multiple_of(period_us))
        .map(|longer_us| longer_us / period_us)
        .filter(|turns| *turns as usize <= most && *turns <= 10)
        .collect();
    turns.get(random.index(turns.len())).copied()
}

// ─── Links and tables ────────────────────────────────────────────────────────────────────────────

/// Messages with so many bytes, each of ten bits, every so many milliseconds.
fn messages(count: usize, percent: u32, random: &mut Random) -> Vec<Times> {
    const BAUD: u64 = 115_200;
    const BITS: u64 = 10;
    const MAX_BYTES: u64 = 40;
    let periods_us = Family::Message.periods_us();
    let lasts_us =
        |bytes: u64| u32::try_from((bytes * BITS * 1_000_000).div_ceil(BAUD)).unwrap_or(u32::MAX);
    let mut times_us: Vec<Times> = (0..count)
        .map(|_| {
            let bytes = 4 + random.below(MAX_BYTES - 3);
            (period(periods_us, random), lasts_us(bytes))
        })
        .collect();
    // Too much: in rounds, those that take more than most come less often, then get shorter.
    let target = f64::from(percent) / 100.0;
    let mut taken = load(&times_us);
    while taken > target {
        let mean = taken / count as f64;
        let before = taken;
        for times in times_us.iter_mut().filter(|times| share(**times) >= mean) {
            let slower = periods_us
                .iter()
                .find(|(period_us, _)| *period_us > times.0);
            let changed = match slower {
                Some(&(slower_us, _)) => (slower_us, times.1),
                None => (times.0, lasts_us(4)),
            };
            taken -= share(*times) - share(changed);
            *times = changed;
            if taken <= target {
                break;
            }
        }
        if taken >= before {
            break;
        }
    }
    times_us
}

/// Tasks of a loop of 50 Hz, some in each of its ticks, others every so many.
fn tasks(count: usize, percent: u32, random: &mut Random) -> Vec<Times> {
    const TICK_US: u32 = 20_000;
    let periods_us: [(u32, u64); 10] = [
        (1, 14),
        (2, 3),
        (5, 12),
        (7, 1),
        (10, 4),
        (16, 2),
        (50, 3),
        (100, 1),
        (250, 1),
        (500, 1),
    ]
    .map(|(ticks, weight)| (ticks * TICK_US, weight));
    drawn(&periods_us, count, percent, random)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::schedule::{MAX_SLOTS, exceeds_one, utilisation};

    #[test]
    fn sets_have_as_many_slots_and_take_as_much_time_as_asked_for() {
        for kind in Kind::ALL {
            for (count, percent) in [(10, 95), (45, 30), (200, 98), (500, 83)] {
                let slots = make(kind, count, percent, 7);
                assert_eq!(slots.len(), count, "{kind}");
                let times_us = || slots.iter().map(|slot| (slot.period_us, slot.duration_us));
                let percent_taken = utilisation(times_us()) * 100.0;
                assert!(
                    percent_taken <= f64::from(percent) + 1e-6,
                    "{kind} {count}: {percent_taken} %"
                );
                // Messages and tasks are too short for more.
                if !matches!(kind, Kind::Link | Kind::Table) || count >= 200 {
                    assert!(
                        percent_taken > f64::from(percent) - 2.0,
                        "{kind} {count}: {percent_taken} %"
                    );
                }
                assert!(times_us().all(|(period_us, duration_us)| 0 < duration_us && duration_us <= period_us));
            }
        }
    }

    #[test]
    fn a_seed_gives_the_same_set_and_another_seed_another_one() {
        for kind in Kind::ALL {
            assert_eq!(make(kind, 30, 90, 1), make(kind, 30, 90, 1));
            assert_ne!(make(kind, 30, 90, 1), make(kind, 30, 90, 2), "{kind}");
        }
    }

    #[test]
    fn what_is_planted_leaves_nothing_over() {
        for kind in Kind::ALL.into_iter().filter(|kind| kind.is_feasible()) {
            for seed in 0..5 {
                let slots = make(kind, 60, 100, seed);
                let times_us = slots.iter().map(|slot| (slot.period_us, slot.duration_us));
                assert!(!exceeds_one(times_us.clone()));
                assert!(
                    exceeds_one(times_us.chain([(u32::MAX, 1)])),
                    "{kind} {seed}"
                );
            }
        }
    }

    #[test]
    fn as_many_slots_as_are_laid_out_can_be_made() {
        for kind in Kind::ALL {
            assert!(make(kind, MAX_SLOTS, 83, 0).len() <= MAX_SLOTS);
        }
    }
}
