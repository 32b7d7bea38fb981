//! Columns: tables that leave little or no time, joined until everything repeats equally often.
//!
//! In the packing view a slot is a rectangle: x is the time in a frame, as long as the greatest
//! common divisor of all periods, y the number of the frame. k slots of period k·P and equal
//! duration, one in each of k turns, make up one rectangle of period P. So do k *groups* of slots
//! side by side, if the groups are equally long; and so do groups of such rectangles in turn. Here
//! both are called *pieces*, and what was joined is a *column*. The search begins with the longest
//! periods, and joins all pieces of a period to columns of shorter periods that divide it, until
//! all have the period of the frame. There they go side by side.
//!
//! In a table that takes all time, the last step needs no luck: joining changes nobody's share of
//! the time, so in the end the pieces fill the frame exactly. What needs luck is to make groups of
//! equal length out of *all* pieces of a period, which is number partitioning, and easy where there
//! are many; placing one slot after another fails at the last gaps instead, where there is no
//! choice left. In a table that leaves some time, a group may be shorter than its column, and the
//! sum of this *padding* is limited by the time that is left.
//!
//! Where a period has several others that divide it, the shorter periods say what they lack: pieces
//! of a length that would complete columns there are made first. Everything else is tried at
//! random, with turns of a few attempts at each period. Not all schedules are made of columns, so
//! this search proves nothing. But all of harmonic periods are, and all that are made by cutting
//! time up, in x or by handing out turns.

use super::clock::Clock;
use super::luby::luby;
use super::random::Random;
use super::{SlotSpec, gcd};

/// The most slots that are joined: sums are worked out for each of them.
const MAX_SLOTS: usize = 512;

/// The most different periods, common divisors included. Bounds the depth of the recursion too.
const MAX_LEVELS: usize = 32;

/// The longest frame, in units of the greatest common divisor of all times. With [`MAX_SLOTS`] it
/// bounds the table of sums to 8 MiB.
const MAX_FRAME: u64 = 8_192;

/// The most groups of a column.
const MAX_TURNS: usize = 256;

/// A search that can be continued.
#[derive(Debug)]
pub(super) struct Columns {
    /// By period, shortest first; the first is that of the frame, and divides all.
    levels: Vec<Level>,
    /// Level and length of each slot.
    slots: Vec<(usize, usize)>,
    /// Index and start of the slot whose start is given.
    given: Option<(usize, u64)>,
    /// Every duration and period is a multiple of it.
    unit_us: u64,
    /// Length of the frame in units, as all lengths.
    frame: usize,
    /// Time in the hyperperiod that no slot takes, in units.
    slack: u64,
    random: Random,
    /// How often all has begun.
    passes: u64,
}

#[derive(Debug)]
struct Level {
    period_us: u64,
    /// How often the period occurs in the hyperperiod.
    weight: u64,
    /// The longest of the shorter periods that divide it.
    parents: Vec<Parent>,
}

#[derive(Clone, Copy, Debug)]
struct Parent {
    level: usize,
    /// As many times shorter its period is.
    turns: usize,
}

impl Columns {
    /// Begins a search; `None` where it is not made for such slots. Durations are above 0.
    pub(super) fn new(slots: &[SlotSpec]) -> Option<Self> {
        let mut given = slots
            .iter()
            .enumerate()
            .filter_map(|(index, slot)| Some((index, u64::from(slot.fixed_start_us?))));
        let (first_given, others) = (given.next(), given.next());
        if slots.len() > MAX_SLOTS || others.is_some() {
            return None;
        }
        let periods_us = with_common_divisors(slots)?;
        let frame_us = *periods_us.first()?;
        let hyperperiod_us = super::hyperperiod_us(slots)?;
        let unit_us = slots
            .iter()
            .fold(frame_us, |unit, slot| gcd(unit, slot.duration_us.into()));
        if frame_us / unit_us > MAX_FRAME {
            return None;
        }
        let levels = periods_us
            .iter()
            .map(|&period_us| {
                Some(Level {
                    period_us,
                    weight: hyperperiod_us / period_us,
                    parents: parents(&periods_us, period_us)?,
                })
            })
            .collect::<Option<Vec<Level>>>()?;
        let pieces = slots
            .iter()
            .map(|slot| {
                let level = periods_us.partition_point(|&period| period < slot.period_us.into());
                let length = u64::from(slot.duration_us) / unit_us;
                (length <= frame_us / unit_us).then_some((level, usize::try_from(length).ok()?))
            })
            .collect::<Option<Vec<(usize, usize)>>>()?;
        let taken = pieces.iter().try_fold(0_u64, |sum, &(level, length)| {
            sum.checked_add((length as u64).checked_mul(levels.get(level)?.weight)?)
        })?;
        Some(Columns {
            slack: (hyperperiod_us / unit_us).checked_sub(taken)?,
            levels,
            slots: pieces,
            given: first_given,
            unit_us,
            frame: usize::try_from(frame_us / unit_us).ok()?,
            random: Random::new(1),
            passes: 0,
        })
    }

    /// Goes on for about as much work, in pieces as the clock counts them. Gives the starts in
    /// microseconds once all slots have their place.
    pub(super) fn search(&mut self, max_work: u64, clock: &mut Clock) -> Option<Vec<u32>> {
        /// Attempts at levels before all begins anew, beyond one for each: so many often, more of
        /// them seldom.
        const SPARE_ATTEMPTS: u64 = 40;
        let mut joining = Joining {
            levels: &self.levels,
            frame: self.frame,
            pieces: Vec::new(),
            pools: Vec::new(),
            slack: 0,
            attempts_left: 0,
            work: 0,
            random: &mut self.random,
            clock,
            sums: Vec::new(),
        };
        while joining.work < max_work && !joining.clock.is_over() {
            joining.slack = self.slack;
            self.passes += 1;
            joining.attempts_left = self.levels.len() as u64 + SPARE_ATTEMPTS * luby(self.passes);
            joining.pieces.clear();
            joining.pools = vec![Vec::new(); self.levels.len()];
            for (index, &(level, length)) in self.slots.iter().enumerate() {
                joining.pieces.push(Piece {
                    length,
                    content: Content::Slot(index),
                });
                joining.pools[level].push(index);
            }
            if joining.join_from(self.levels.len() - 1) {
                let mut starts_us = vec![0; self.slots.len()];
                joining.lay_out(&joining.pools[0], 0, self.unit_us, &mut starts_us);
                return self.turned(&starts_us);
            }
        }
        None
    }

    /// The starts, all moved so that the given one is right.
    fn turned(&self, starts_us: &[u64]) -> Option<Vec<u32>> {
        let period_us = |index: usize| self.levels[self.slots[index].0].period_us;
        let later_us = self.given.map_or(0, |(index, start_us)| {
            start_us + period_us(index) - starts_us[index]
        });
        (0..starts_us.len())
            .map(|index| u32::try_from((starts_us[index] + later_us) % period_us(index)).ok())
            .collect()
    }
}

/// The different periods and all their common divisors, shortest first; `None` where there are more
/// than [`MAX_LEVELS`].
fn with_common_divisors(slots: &[SlotSpec]) -> Option<Vec<u64>> {
    let mut periods_us: Vec<u64> = slots.iter().map(|slot| slot.period_us.into()).collect();
    periods_us.sort_unstable();
    periods_us.dedup();
    if periods_us.len() > MAX_LEVELS {
        return None;
    }
    let mut at = 0;
    while at < periods_us.len() {
        for other in 0..at {
            let divisor_us = gcd(periods_us[at], periods_us[other]);
            if !periods_us.contains(&divisor_us) {
                periods_us.push(divisor_us);
            }
        }
        if periods_us.len() > MAX_LEVELS {
            return None;
        }
        at += 1;
    }
    periods_us.sort_unstable();
    Some(periods_us)
}

/// Those of the periods that divide one and no other such; `None` where one has more than
/// [`MAX_TURNS`] turns in it.
fn parents(periods_us: &[u64], period_us: u64) -> Option<Vec<Parent>> {
    let divides = |divisor: u64, of: u64| divisor < of && of.is_multiple_of(divisor);
    periods_us
        .iter()
        .enumerate()
        .filter(|&(_, &shorter_us)| {
            let is_between = |&other: &u64| divides(shorter_us, other) && divides(other, period_us);
            divides(shorter_us, period_us) && !periods_us.iter().any(is_between)
        })
        .map(|(level, &shorter_us)| {
            let turns = usize::try_from(period_us / shorter_us).ok()?;
            (turns <= MAX_TURNS).then_some(Parent { level, turns })
        })
        .collect()
}

// ─── Pieces ──────────────────────────────────────────────────────────────────────────────────────

/// A rectangle.
#[derive(Debug)]
struct Piece {
    length: usize,
    content: Content,
}

#[derive(Debug)]
enum Content {
    /// Index of the slot.
    Slot(usize),
    /// Groups of pieces, one in each turn of the period.
    Column {
        period_us: u64,
        groups: Vec<Vec<usize>>,
    },
}

/// A column to be, of pieces by their position in a stock.
#[derive(Debug)]
struct Column {
    /// Level that it goes to.
    level: usize,
    length: usize,
    groups: Vec<Vec<usize>>,
    /// What its groups lack in length.
    padding: usize,
}

/// Pieces of one period that are chosen from.
struct Stock {
    /// In rising order.
    lengths: Vec<usize>,
    /// What it costs to use a piece: about [`PIECE_COST`], with noise, so that another choice of
    /// equally many is made each time.
    costs: Vec<u16>,
    is_used: Vec<bool>,
}

/// What a piece costs in a group: few long pieces are better than many short ones, which will be
/// needed.
const PIECE_COST: u16 = 8;

impl Stock {
    fn new(lengths: Vec<usize>, noise: u64, random: &mut Random) -> Self {
        let costs = lengths
            .iter()
            .map(|_| PIECE_COST + u16::try_from(random.below(noise)).unwrap_or(0))
            .collect();
        Stock {
            is_used: vec![false; lengths.len()],
            costs,
            lengths,
        }
    }

    /// The longest piece that is left.
    fn longest(&self) -> Option<usize> {
        self.is_used.iter().rposition(|&is_used| !is_used)
    }

    /// The sum of what is left.
    fn rest(&self) -> usize {
        let left = self.lengths.iter().zip(&self.is_used);
        left.filter(|(_, is_used)| !**is_used)
            .map(|(length, _)| length)
            .sum()
    }

    fn set_used(&mut self, groups: &[Vec<usize>], is_used: bool) {
        for &position in groups.iter().flatten() {
            self.is_used[position] = is_used;
        }
    }

    /// The length of any piece, used or not.
    fn any_length(&self, random: &mut Random) -> usize {
        self.lengths
            .get(random.index(self.lengths.len()))
            .copied()
            .unwrap_or(0)
    }
}

/// How much padding there may be, and what it costs.
#[derive(Clone, Copy, Debug)]
struct Padding {
    most: usize,
    /// Cost of a unit, in 1/256.
    price: u64,
}

const NO_PADDING: Padding = Padding { most: 0, price: 0 };

/// The padding that columns leave.
fn left_of(padding: Padding, columns: &[Column]) -> Padding {
    let taken: usize = columns.iter().map(|column| column.padding).sum();
    Padding {
        most: padding.most.saturating_sub(taken),
        ..padding
    }
}

/// How an attempt at a level goes about it: another way each time, since each suits other tables.
struct Habits {
    /// How often in 100 columns are as long as the longest piece.
    longest_in_100: u64,
    /// How often in 64 equal pieces are not joined at once.
    parted_in_64: u64,
    /// Whether what the parents lack is made first, and the rest goes to one of them.
    is_asked: bool,
    padding: Padding,
}

/// Puts things in any order (Fisher, Yates).
fn shuffle<T>(things: &mut [T], random: &mut Random) {
    for last in (1..things.len()).rev() {
        things.swap(last, random.index(last + 1));
    }
}

/// One of the options.
fn any_of<const N: usize>(options: [u64; N], random: &mut Random) -> u64 {
    options.get(random.index(N)).copied().unwrap_or(0)
}

// ─── Search ──────────────────────────────────────────────────────────────────────────────────────

struct Joining<'c> {
    levels: &'c [Level],
    frame: usize,
    pieces: Vec<Piece>,
    /// The pieces of each level that are not in a column.
    pools: Vec<Vec<usize>>,
    /// Time in the hyperperiod that may still become padding.
    slack: u64,
    attempts_left: u64,
    work: u64,
    random: &'c mut Random,
    clock: &'c mut Clock,
    /// Working space of [`Joining::fill`].
    sums: Vec<u16>,
}

impl Joining<'_> {
    /// Joins the pieces of a level and of all with shorter periods.
    fn join_from(&mut self, level: usize) -> bool {
        /// As many ways to join a level are followed.
        const WAYS: usize = 10;
        if level == 0 {
            return self.pools.first().is_some_and(|pool| {
                pool.iter().map(|&id| self.pieces[id].length).sum::<usize>() <= self.frame
            });
        }
        if self.pools[level].is_empty() {
            return self.join_from(level - 1);
        }
        for _ in 0..WAYS {
            if self.attempts_left == 0 {
                return false;
            }
            self.attempts_left -= 1;
            let (pools, pieces, slack) = (self.pools.clone(), self.pieces.len(), self.slack);
            let is_joined = self.join(level);
            if is_joined && self.join_from(level - 1) {
                return true;
            }
            self.pools = pools;
            self.pieces.truncate(pieces);
            self.slack = slack;
            if !is_joined {
                return false;
            }
        }
        false
    }

    /// Joins all pieces of a level to columns, and adds these to their levels.
    fn join(&mut self, level: usize) -> bool {
        /// Trials, in each of which some columns of the last one remain.
        const TRIALS: usize = 20;
        const ATTEMPT_WORK: usize = 64;
        let mut ids = std::mem::take(&mut self.pools[level]);
        // However little it fills, an attempt is work.
        self.count_work(ATTEMPT_WORK);
        // Equal pieces in any order.
        shuffle(&mut ids, self.random);
        ids.sort_by_key(|&id| self.pieces[id].length);
        let lengths = ids.iter().map(|&id| self.pieces[id].length).collect();
        let noise = any_of([1, 2, 4, 8], self.random);
        let mut stock = Stock::new(lengths, noise, self.random);
        let levels = self.levels;
        let parents = &levels[level].parents;
        let habits = self.habits(level);
        let mut columns: Vec<Column> = Vec::new();
        for _ in 0..TRIALS {
            let mut targets = parents.as_slice();
            if habits.is_asked {
                if columns.is_empty() {
                    for parent in parents {
                        self.supply(*parent, &mut stock, habits.padding, &mut columns);
                    }
                }
                let any = self.random.index(parents.len());
                targets = parents.get(any..=any).unwrap_or(parents);
            }
            self.join_equal(targets, &mut stock, &habits, &mut columns);
            if self.join_rest(targets, parents, &mut stock, &habits, &mut columns)
                && (self.slack > 0 || self.can_be_shared_out(level, &columns))
            {
                self.settle(level, &ids, columns);
                return true;
            }
            if self.clock.is_over() {
                return false;
            }
            // Any columns remain, often most of them.
            let count = columns.len();
            let mut kept = self.random.index(count + 1);
            if self.random.once_in(2) {
                kept = kept.max(count / 3 * 2);
            }
            if habits.is_asked && self.random.once_in(3) {
                kept = 0;
            }
            shuffle(&mut columns, self.random);
            for column in columns.drain(kept..) {
                stock.set_used(&column.groups, false);
            }
        }
        false
    }

    fn count_work(&mut self, work: usize) {
        self.work += work as u64;
        self.clock
            .tick_many(u32::try_from(work).unwrap_or(u32::MAX));
    }

    fn habits(&mut self, level: usize) -> Habits {
        let weight = self.levels[level].weight;
        let several = self.levels[level].parents.len() > 1;
        let fair = self.slack / weight;
        // The last level may use up what is left.
        let most = if level == 1 {
            fair
        } else {
            fair / any_of([1, 2, 4], self.random)
        };
        let slots = self.pieces.len() as u64;
        let price = (u64::from(PIECE_COST) * 256)
            .saturating_mul(slots)
            .saturating_mul(weight)
            .checked_div(self.slack)
            .unwrap_or(0);
        Habits {
            longest_in_100: any_of([100, 90, 70, 50], self.random),
            parted_in_64: any_of([0, 4, 16, 32, 48, 64], self.random),
            is_asked: (several || self.random.once_in(2)) && !self.random.once_in(8),
            padding: Padding {
                most: usize::try_from(most).unwrap_or(usize::MAX),
                price: price.saturating_mul(any_of([1, 2, 4, 8], self.random)) / 4,
            },
        }
    }

    /// Columns of the lengths that a parent lacks to complete its own, in any order.
    fn supply(
        &mut self,
        parent: Parent,
        stock: &mut Stock,
        padding: Padding,
        columns: &mut Vec<Column>,
    ) {
        let mut wanted = self.wanted(parent.level);
        shuffle(&mut wanted, self.random);
        for lengths in wanted {
            let before = columns.len();
            let is_supplied = lengths.into_iter().all(|length| {
                let column = self.column(stock, None, length, parent, left_of(padding, columns));
                let is_made = column.is_some();
                columns.extend(column);
                is_made
            });
            if !is_supplied {
                for column in columns.drain(before..) {
                    stock.set_used(&column.groups, false);
                }
            }
        }
    }

    /// What a level lacks: for each column that it cannot complete alone, the lengths of the holes.
    fn wanted(&mut self, level: usize) -> Vec<Vec<usize>> {
        let mut lengths: Vec<usize> = self.pools[level]
            .iter()
            .map(|&id| self.pieces[id].length)
            .collect();
        lengths.sort_unstable();
        let mut stock = Stock::new(lengths, 4, self.random);
        let mut wanted = Vec::new();
        let levels = self.levels;
        while let Some(longest) = stock.longest() {
            let parents = &levels[level].parents;
            let Some(parent) = parents.get(self.random.index(parents.len())) else {
                break;
            };
            let least = stock.lengths[longest];
            let length = match self.random.below(8) {
                0 => stock.any_length(self.random),
                1 => least + stock.any_length(self.random),
                _ => least,
            };
            let length = if (least..=self.frame).contains(&length) {
                length
            } else {
                least
            };
            stock.is_used[longest] = true;
            let mut holes = Vec::new();
            for turn in 0..parent.turns {
                let mut hole = if turn == 0 { length - least } else { length };
                if let Some((positions, _)) = self.fill(&stock, hole, NO_PADDING) {
                    stock.set_used(&[positions], true);
                    continue;
                }
                if turn == 0 || !self.random.once_in(3) {
                    hole -= self.fill_partly(&mut stock, hole);
                }
                if hole > 0 {
                    holes.push(hole);
                }
            }
            if !holes.is_empty() {
                wanted.push(holes);
            }
            if self.clock.is_over() {
                break;
            }
        }
        wanted
    }

    /// Puts some of the longest pieces into a hole. Gives the sum of their lengths.
    fn fill_partly(&mut self, stock: &mut Stock, hole: usize) -> usize {
        let mut sum = 0;
        for position in (0..stock.lengths.len()).rev() {
            let length = stock.lengths[position];
            if !stock.is_used[position] && sum + length <= hole && !self.random.once_in(5) {
                stock.is_used[position] = true;
                sum += length;
                if self.random.once_in(2) {
                    break;
                }
            }
        }
        sum
    }

    /// Joins equal pieces.
    fn join_equal(
        &mut self,
        targets: &[Parent],
        stock: &mut Stock,
        habits: &Habits,
        columns: &mut Vec<Column>,
    ) {
        let mut end = stock.lengths.len();
        while let Some(&length) = end.checked_sub(1).and_then(|last| stock.lengths.get(last)) {
            let begin = stock.lengths.partition_point(|&other| other < length);
            let mut equal: Vec<usize> = (begin..end)
                .filter(|&position| !stock.is_used[position])
                .collect();
            end = begin;
            loop {
                let mut fitting = targets.iter().filter(|target| target.turns <= equal.len());
                let count = fitting.clone().count();
                if count == 0 || self.random.below(64) < habits.parted_in_64 {
                    break;
                }
                let Some(target) = fitting.nth(self.random.index(count)) else {
                    break;
                };
                let groups: Vec<Vec<usize>> = equal
                    .drain(equal.len() - target.turns..)
                    .map(|position| vec![position])
                    .collect();
                stock.set_used(&groups, true);
                columns.push(Column {
                    level: target.level,
                    length,
                    groups,
                    padding: 0,
                });
            }
        }
    }

    /// Joins all that is left, the longest piece first. Gives whether that worked out.
    fn join_rest(
        &mut self,
        targets: &[Parent],
        parents: &[Parent],
        stock: &mut Stock,
        habits: &Habits,
        columns: &mut Vec<Column>,
    ) -> bool {
        while let Some(longest) = stock.longest() {
            let padding = left_of(habits.padding, columns);
            let most = stock.rest().saturating_add(padding.most);
            let column = self
                .options(longest, targets, parents, stock, habits)
                .into_iter()
                .filter(|(target, length)| length.saturating_mul(target.turns) <= most)
                .find_map(|(target, length)| {
                    self.column(stock, Some(longest), length, target, padding)
                });
            match column {
                Some(column) if !self.clock.is_over() => columns.push(column),
                _ => return false,
            }
        }
        true
    }

    /// Columns that are tried with the longest piece that is left, by level and length.
    fn options(
        &mut self,
        longest: usize,
        targets: &[Parent],
        parents: &[Parent],
        stock: &Stock,
        habits: &Habits,
    ) -> Vec<(Parent, usize)> {
        const RANDOM_OPTIONS: usize = 6;
        let least = stock.lengths[longest];
        let rest = stock.rest();
        let mut options: Vec<(Parent, usize)> = Vec::new();
        for _ in 0..RANDOM_OPTIONS {
            let Some(&target) = targets.get(self.random.index(targets.len())) else {
                break;
            };
            let length = if self.random.below(100) < habits.longest_in_100 {
                least
            } else if self.random.once_in(2) {
                // A length that there is already, here or where the column goes.
                let pool = &self.pools[target.level];
                let any = self.random.index(pool.len() + stock.lengths.len());
                match pool.get(any) {
                    Some(&id) => self.pieces[id].length,
                    None => stock
                        .lengths
                        .get(any - pool.len())
                        .copied()
                        .unwrap_or(least),
                }
            } else {
                least + stock.any_length(self.random)
            };
            options.push((target, length));
        }
        for &parent in parents {
            options.push((parent, least));
            // All that is left in one column.
            if rest.is_multiple_of(parent.turns) {
                options.push((parent, rest / parent.turns));
            }
        }
        options.retain(|(_, length)| (least..=self.frame).contains(length));
        let mut tried: Vec<(usize, usize)> = Vec::new();
        options.retain(|(parent, length)| {
            let is_new = !tried.contains(&(parent.level, *length));
            tried.push((parent.level, *length));
            is_new
        });
        options
    }

    /// A column of a length, with a certain piece in it or of any; its pieces are used then.
    fn column(
        &mut self,
        stock: &mut Stock,
        first: Option<usize>,
        length: usize,
        parent: Parent,
        mut padding: Padding,
    ) -> Option<Column> {
        let most = padding.most;
        let mut groups: Vec<Vec<usize>> = Vec::with_capacity(parent.turns);
        for turn in 0..parent.turns {
            let begun: Vec<usize> = first.filter(|_| turn == 0).into_iter().collect();
            let begun_length = begun.first().map_or(0, |&position| stock.lengths[position]);
            if let Some(&position) = begun.first() {
                stock.is_used[position] = true;
            }
            groups.push(begun);
            let Some((positions, padded)) = self.fill(stock, length - begun_length, padding) else {
                stock.set_used(&groups, false);
                return None;
            };
            for &position in &positions {
                stock.is_used[position] = true;
            }
            if let Some(group) = groups.last_mut() {
                group.extend(positions);
            }
            padding.most -= padded;
        }
        Some(Column {
            level: parent.level,
            length,
            groups,
            padding: most - padding.most,
        })
    }

    /// The cheapest pieces whose lengths sum up to a length, all but for some padding. Gives their
    /// positions and the padding.
    fn fill(
        &mut self,
        stock: &Stock,
        length: usize,
        padding: Padding,
    ) -> Option<(Vec<usize>, usize)> {
        /// No choice of pieces has that sum.
        const NEVER: u16 = u16::MAX;
        let width = length + 1;
        // A row for no piece, and one more for each: what the sums from 0 to the length cost at
        // least.
        self.sums.clear();
        self.sums.resize(width, NEVER);
        self.sums[0] = 0;
        let mut choice: Vec<usize> = Vec::new();
        for (position, &piece) in stock.lengths.iter().enumerate() {
            if piece > length {
                break;
            }
            if stock.is_used[position] {
                continue;
            }
            let begin = choice.len() * width;
            self.sums.extend_from_within(begin..);
            let (old, new) = self.sums.split_at_mut(begin + width);
            let cost = stock.costs[position];
            for (new, old) in new[piece..].iter_mut().zip(&old[begin..]) {
                *new = (*new).min(old.saturating_add(cost));
            }
            choice.push(position);
        }
        /// Entries that are worked out together.
        const LANES: usize = 16;
        let work = 8 + self.sums.len() / LANES;
        self.work += work as u64;
        self.clock
            .tick_many(u32::try_from(work).unwrap_or(u32::MAX));
        let last = &self.sums[choice.len() * width..];
        let (_, padded) = (0..=padding.most.min(length))
            .filter(|padded| last[length - padded] != NEVER)
            .map(|padded| {
                let price = padding.price.saturating_mul(padded as u64) / 256;
                (price.saturating_add(last[length - padded].into()), padded)
            })
            .min()?;
        let mut sum = length - padded;
        let mut positions = Vec::new();
        for (row, &position) in choice.iter().enumerate().rev() {
            if self.sums[(row + 1) * width + sum] != self.sums[row * width + sum] {
                positions.push(position);
                sum -= stock.lengths[position];
            }
        }
        Some((positions, padded))
    }

    /// Whether the columns leave sums to their levels that these can share out in turn, as far as
    /// that is known yet. Without slack only.
    fn can_be_shared_out(&self, level: usize, columns: &[Column]) -> bool {
        self.levels[level].parents.iter().all(|parent| {
            let target = &self.levels[parent.level];
            let [only] = target.parents.as_slice() else {
                return true;
            };
            // What comes from other levels later is not known.
            let comes_more = (parent.level + 1..level).any(|child| {
                let parents = &self.levels[child].parents;
                parents.iter().any(|other| other.level == parent.level)
            });
            let own: usize = self.pools[parent.level]
                .iter()
                .map(|&id| self.pieces[id].length)
                .sum();
            let added: usize = columns
                .iter()
                .filter(|column| column.level == parent.level)
                .map(|column| column.length)
                .sum();
            comes_more || (own + added).is_multiple_of(only.turns)
        })
    }

    /// Makes pieces of columns.
    fn settle(&mut self, level: usize, ids: &[usize], columns: Vec<Column>) {
        for column in columns {
            self.slack = self
                .slack
                .saturating_sub(column.padding as u64 * self.levels[level].weight);
            self.pools[column.level].push(self.pieces.len());
            let groups = column
                .groups
                .into_iter()
                .map(|group| group.into_iter().map(|position| ids[position]).collect())
                .collect();
            self.pieces.push(Piece {
                length: column.length,
                content: Content::Column {
                    period_us: self.levels[column.level].period_us,
                    groups,
                },
            });
        }
    }

    /// Lays pieces out side by side, with all that is in them.
    fn lay_out(&self, ids: &[usize], start_us: u64, unit_us: u64, starts_us: &mut [u64]) {
        let mut at_us = start_us;
        for &id in ids {
            let piece = &self.pieces[id];
            match &piece.content {
                Content::Slot(index) => starts_us[*index] = at_us,
                Content::Column { period_us, groups } => {
                    for (turn, group) in (0..).zip(groups) {
                        self.lay_out(group, at_us + turn * period_us, unit_us, starts_us);
                    }
                }
            }
            at_us += piece.length as u64 * unit_us;
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use proptest::prelude::*;

    use super::super::check;
    use super::super::instances::{Family, Kind, make};
    use super::*;
    use crate::schedule::tests::slots;

    /// The starts that are found with much work.
    fn search(slots: &[SlotSpec]) -> Option<Vec<u32>> {
        const MUCH: u64 = 20_000_000;
        let mut clock = Clock::new(Duration::from_secs(600));
        Columns::new(slots)?.search(MUCH, &mut clock)
    }

    #[test]
    fn tables_without_any_slack_are_laid_out() {
        for family in [Family::Harmonic, Family::Automotive, Family::Robot] {
            for (count, seed) in [(10, 1), (20, 2), (40, 3), (40, 4)] {
                let slots = make(Kind::Planted(family), count, 100, seed);
                let taken: f64 = slots
                    .iter()
                    .map(|slot| f64::from(slot.duration_us) / f64::from(slot.period_us))
                    .sum();
                assert!(taken > 1.0 - 1e-9, "{family:?} {seed} is full: {taken}");
                let Some(starts_us) = search(&slots) else {
                    panic!("{family:?} {count} {seed} has a schedule");
                };
                assert_eq!(check(&slots, &starts_us), Ok(()));
                assert_eq!(search(&slots), Some(starts_us), "equal slots, equal answer");
            }
        }
    }

    #[test]
    fn a_little_slack_becomes_padding() {
        for family in [Family::Harmonic, Family::Automotive, Family::Robot] {
            for (percent, seed) in [(99, 1), (97, 2), (95, 3)] {
                let slots = make(Kind::Planted(family), 50, percent, seed);
                let Some(starts_us) = search(&slots) else {
                    panic!("{family:?} {percent} {seed} has a schedule");
                };
                assert_eq!(check(&slots, &starts_us), Ok(()));
            }
        }
    }

    #[test]
    fn the_whole_is_turned_so_that_a_given_start_is_kept() {
        let mut slots = make(Kind::Planted(Family::Automotive), 40, 100, 1);
        for index in [0, 7, 39] {
            let start_us = slots[index].period_us - 10;
            slots[index].fixed_start_us = Some(start_us);
            let Some(starts_us) = search(&slots) else {
                panic!("a schedule can be turned");
            };
            assert_eq!(check(&slots, &starts_us), Ok(()));
            slots[index].fixed_start_us = None;
        }
    }

    /// Columns of 10 ms need both those of 2 ms, which go into two turns, and those of 5 ms, which
    /// go into five.
    #[test]
    fn periods_that_do_not_divide_each_other_share_the_frame() {
        let slots = slots(&[
            (2_000, 300),
            (2_000, 300),
            (5_000, 700),
            (5_000, 700),
            (5_000, 700),
            (5_000, 700),
            (10_000, 700),
            (10_000, 600),
            (10_000, 100),
        ]);
        let starts_us = search(&slots).expect("1,000 us are 300 us and 700 us");
        assert_eq!(check(&slots, &starts_us), Ok(()));
    }

    #[test]
    fn what_it_is_not_made_for_is_left_to_others() {
        let many: Vec<(u32, u32)> = (0..=MAX_SLOTS).map(|_| (10_000_000, 1_000)).collect();
        let primes = [3, 5, 7, 11, 13, 17, 19, 23, 29, 31, 37, 41, 43, 47, 53, 59];
        let odd: Vec<(u32, u32)> = (0..=MAX_LEVELS)
            .map(|index| (1_000 * primes[index % 16] * primes[index / 16], 1))
            .collect();
        let cases: &[(&str, &[(u32, u32)])] = &[
            ("no slots", &[]),
            ("many slots", &many),
            ("many periods", &odd),
            ("longer than the frame", &[(4_000, 2_100), (6_000, 100)]),
            ("more than all time", &[(4_000, 2_000), (4_000, 2_001)]),
            ("a frame of many units", &[(10_000, 1), (20_000, 3)]),
            ("many turns", &[(1_000, 100), (257_000, 100)]),
        ];
        for (name, times_us) in cases {
            assert!(Columns::new(&slots(times_us)).is_none(), "{name}");
        }
        let mut two_given = slots(&[(4_000, 1_000), (4_000, 1_000)]);
        assert!(Columns::new(&two_given).is_some());
        two_given[0].fixed_start_us = Some(0);
        assert!(Columns::new(&two_given).is_some());
        two_given[1].fixed_start_us = Some(2_000);
        assert!(Columns::new(&two_given).is_none(), "two given starts");
    }

    #[test]
    fn sums_of_pieces_are_cheapest_and_padding_has_its_price() {
        let mut clock = Clock::new(Duration::from_secs(600));
        let mut random = Random::new(1);
        let stock = Stock::new(vec![2, 3, 3, 5, 9], 1, &mut random);
        let mut joining = Joining {
            levels: &[],
            frame: 20,
            pieces: Vec::new(),
            pools: Vec::new(),
            slack: 0,
            attempts_left: 0,
            work: 0,
            random: &mut random,
            clock: &mut clock,
            sums: Vec::new(),
        };
        let padding = |most, price| Padding { most, price };
        let unit = u64::from(PIECE_COST) * 256;
        let cases = [
            (0, NO_PADDING, Some((vec![], 0))),
            (5, NO_PADDING, Some((vec![3], 0))),
            (8, NO_PADDING, Some((vec![3, 1], 0))),
            (22, NO_PADDING, Some((vec![4, 3, 2, 1, 0], 0))),
            (1, NO_PADDING, None),
            (21, NO_PADDING, None),
            (1, padding(1, unit), Some((vec![], 1))),
            (6, padding(2, unit / 2), Some((vec![3], 1))),
            (6, padding(2, unit * 2), Some((vec![2, 1], 0))),
            (23, padding(2, unit * 2), Some((vec![4, 3, 2, 1, 0], 1))),
            (25, padding(2, unit * 2), None),
        ];
        for (length, padding, expected) in cases {
            assert_eq!(
                joining.fill(&stock, length, padding),
                expected,
                "{length} {padding:?}"
            );
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Whatever it finds, the checker finds right.
        #[test]
        fn what_is_found_is_a_schedule(
            times_us in proptest::collection::vec(
                (prop::sample::select(vec![4_u32, 8, 12, 20, 24, 40, 60]), 1..4_u32),
                1..8,
            ),
            given in prop::option::of(0..4_u32),
        ) {
            let mut slots = slots(&times_us);
            slots[0].fixed_start_us = given;
            let mut clock = Clock::new(Duration::from_secs(600));
            let found = Columns::new(&slots).and_then(|mut columns| columns.search(2_000, &mut clock));
            if let Some(starts_us) = found {
                prop_assert_eq!(check(&slots, &starts_us), Ok(()));
            }
        }
    }
}
