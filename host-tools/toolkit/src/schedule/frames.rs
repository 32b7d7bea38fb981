//! Slots spread over frames: proofs for periods that need not divide each other.
//!
//! Take a slot of the shortest period B. Between two of its activations there is a frame, and every
//! activation of every other slot lies within one frame. A slot of period T = p/q · B (in lowest
//! terms) starts in one of p parts of length B/q of p frames, its *residue* r, and again after T:
//! so it is in the frames ⌊(r + k·p)/q⌋ modulo p, for 0 ≤ k < q. Where B divides T, that is every
//! p-th frame. Slots with p₁ and p₂ frames are together in a frame if and only if one of the frames
//! of each agree modulo gcd(p₁, p₂), and any number of slots if each two of them do (Chinese
//! remainder theorem).
//!
//! So each slot needs a residue such that in no frame the durations exceed B less what all slots of
//! period B take. That leaves out where in its frame a slot starts: what has no such packing has no
//! schedule, not the other way round.
//!
//! The search takes the kind of slot (p, q, duration) for which fewest residues are left. A kind
//! that failed with a residue never takes it again below the same choices, for slots of a kind are
//! interchangeable. Residues that an exchange of classes of frames turns into each other are tried
//! once. Counts end a branch early: for each p, the slots whose p divides it share p bins, each as
//! large as the fullest of its frames leaves.

use std::collections::BTreeMap;

use super::clock::Clock;
use super::{SlotSpec, gcd};

/// The most frames until everything repeats; slots that would need more are left out.
const MAX_FRAMES: u64 = 2_048;

/// The most slots. Bounds the depth of the recursion.
const MAX_ITEMS: usize = 400;

/// The longest frame, in units, for which sums of durations are tabulated.
const MAX_TABLE: u64 = 1 << 16;

/// Classes of frames that are compared for an exchange, at one choice.
const MAX_COMPARED: usize = 64;

/// What a search came to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum End {
    /// The slots can be packed. Whether that comes from a schedule is open.
    Packed,
    /// They cannot.
    Exhausted,
    /// The limit of steps or the clock ended it.
    GivenUp,
}

/// Slots of one number of frames and one duration.
#[derive(Clone, Debug)]
struct Kind {
    /// Index into the numbers of frames.
    class: usize,
    /// In units.
    duration: u64,
    /// How many are still to be placed.
    left: usize,
    /// Residues that are known to lead nowhere.
    is_dead: Vec<bool>,
}

/// Slots of one period.
#[derive(Clone, Debug)]
struct Class {
    /// p: after so many frames they are where they were.
    frames: usize,
    /// q: how often they are in so many frames.
    turns: usize,
    /// `reach[n]`: the longest sum of at most n units of durations whose number of frames divides
    /// this one. Empty where that table would be too large.
    reach: Vec<u64>,
}

impl Class {
    /// The frames of a residue, modulo p.
    fn frames_of(&self, residue: usize) -> impl Iterator<Item = usize> {
        let Class { frames, turns, .. } = *self;
        (0..turns).map(move |turn| (residue + turn * frames) / turns % frames)
    }
}

/// A packing problem, made ready to be searched.
#[derive(Clone, Debug)]
pub(super) struct Frames {
    /// Frames until everything repeats.
    frames: usize,
    /// What slots of the frame's own period leave of it, in units; `None` where they leave nothing.
    capacity: Option<u64>,
    classes: Vec<Class>,
    /// All frames until everything repeats, as if there were slots with so many.
    whole: Class,
    kinds: Vec<Kind>,
}

impl Frames {
    /// The packing of slots into frames of their shortest period. Slots for which there is no room
    /// in the tables are left out, which weakens it.
    pub(super) fn new(slots: &[SlotSpec]) -> Self {
        let mut members: Vec<&SlotSpec> = slots.iter().collect();
        members.sort_by_key(|slot| (slot.period_us, slot.number));
        let frame_us = u64::from(members.first().map_or(1, |slot| slot.period_us.max(1)));
        let mut unit_us = frame_us;
        let mut taken_us = 0;
        // (p, q, duration) and how many.
        let mut counts: BTreeMap<(u64, u64, u64), usize> = BTreeMap::new();
        let mut frames = 1;
        let mut items = 0;
        for slot in members {
            let (period_us, duration_us) = (u64::from(slot.period_us), u64::from(slot.duration_us));
            let common = gcd(period_us, frame_us).max(1);
            let (turns, every) = (frame_us / common, period_us / common);
            let all = frames / gcd(frames, every).max(1) * every;
            if duration_us == 0 || turns > every || (every > 1 && all > MAX_FRAMES) {
                continue;
            }
            if every == 1 {
                taken_us += duration_us;
            } else if items < MAX_ITEMS {
                items += 1;
                frames = all;
                *counts.entry((every, turns, duration_us)).or_default() += 1;
            }
            unit_us = gcd(unit_us, duration_us);
        }
        let capacity = frame_us.checked_sub(taken_us).map(|us| us / unit_us);
        let mut classes: Vec<Class> = Vec::new();
        let mut kinds = Vec::new();
        for ((every, turns, duration_us), left) in counts {
            let [every, turns] = [every, turns].map(|number| usize::try_from(number).unwrap_or(1));
            if classes
                .last()
                .is_none_or(|class| (class.frames, class.turns) != (every, turns))
            {
                classes.push(Class {
                    frames: every,
                    turns,
                    reach: Vec::new(),
                });
            }
            kinds.push(Kind {
                class: classes.len() - 1,
                duration: duration_us / unit_us,
                left,
                is_dead: vec![false; every],
            });
        }
        let mut packing = Frames {
            frames: usize::try_from(frames).unwrap_or(1),
            capacity,
            classes,
            whole: Class {
                frames: usize::try_from(frames).unwrap_or(1),
                turns: 1,
                reach: Vec::new(),
            },
            kinds,
        };
        packing.tabulate_sums();
        packing
    }

    fn tabulate_sums(&mut self) {
        let Some(length) = self
            .capacity
            .filter(|&capacity| capacity <= MAX_TABLE)
            .and_then(|capacity| usize::try_from(capacity).ok())
        else {
            return;
        };
        let kinds_frames: Vec<usize> = self
            .kinds
            .iter()
            .map(|kind| self.classes.get(kind.class).map_or(1, |class| class.frames))
            .collect();
        for class in self.classes.iter_mut().chain([&mut self.whole]) {
            let mut can_be = vec![false; length + 1];
            can_be[0] = true;
            for (kind, &frames) in self.kinds.iter().zip(&kinds_frames) {
                if !class.frames.is_multiple_of(frames) {
                    continue;
                }
                let Ok(duration) = usize::try_from(kind.duration) else {
                    continue;
                };
                for _ in 0..kind.left.min(length / duration.max(1)) {
                    for at in (duration..=length).rev() {
                        can_be[at] |= can_be[at - duration];
                    }
                }
            }
            let mut longest = 0;
            class.reach = (0_u64..)
                .zip(can_be)
                .map(|(sum, can_be)| {
                    if can_be {
                        longest = sum;
                    }
                    longest
                })
                .collect();
        }
    }

    /// Searches until it has made all the steps that are left, which it counts down.
    pub(super) fn search(&self, steps_left: &mut u64, clock: &mut Clock) -> End {
        let Some(capacity) = self.capacity else {
            return End::Exhausted;
        };
        let mut search = Search {
            classes: &self.classes,
            whole: &self.whole,
            kinds: self.kinds.clone(),
            gaps: vec![capacity; self.frames],
            steps_left,
            clock,
        };
        search.extend()
    }
}

struct Search<'s> {
    classes: &'s [Class],
    whole: &'s Class,
    kinds: Vec<Kind>,
    /// What is left of each frame, in units.
    gaps: Vec<u64>,
    steps_left: &'s mut u64,
    clock: &'s mut Clock,
}

impl Search<'_> {
    /// Places what is left in every way that can matter.
    fn extend(&mut self) -> End {
        if self.kinds.iter().all(|kind| kind.left == 0) {
            return End::Packed;
        }
        let work = u32::try_from(self.gaps.len() * self.classes.len()).unwrap_or(u32::MAX);
        if *self.steps_left == 0 || self.clock.tick_many(work) {
            return End::GivenUp;
        }
        *self.steps_left -= 1;
        let bins = self.bins();
        if !self.can_work(&bins) {
            return End::Exhausted;
        }
        let Some((chosen, residues)) = self.choose(&bins) else {
            return End::Exhausted;
        };
        let duration = self.kinds[chosen].duration;
        let class = &self.classes[self.kinds[chosen].class];
        self.kinds[chosen].left -= 1;
        let mut end = End::Exhausted;
        let mut tried: Vec<usize> = Vec::new();
        for &residue in &residues {
            // Known to lead nowhere as soon as one like it did.
            let is_like_one = tried
                .iter()
                .rev()
                .take(MAX_COMPARED)
                .any(|&other| self.is_exchangeable(class, other, residue));
            if !is_like_one {
                self.take(class, residue, duration);
                end = self.extend();
                self.give_back(class, residue, duration);
                if end != End::Exhausted {
                    break;
                }
            }
            tried.push(residue);
            self.kinds[chosen].is_dead[residue] = true;
        }
        for residue in tried {
            self.kinds[chosen].is_dead[residue] = false;
        }
        self.kinds[chosen].left += 1;
        end
    }

    fn take(&mut self, class: &Class, residue: usize, duration: u64) {
        for frame in class.frames_of(residue) {
            for gap in self.gaps.iter_mut().skip(frame).step_by(class.frames) {
                *gap -= duration;
            }
        }
    }

    fn give_back(&mut self, class: &Class, residue: usize, duration: u64) {
        for frame in class.frames_of(residue) {
            for gap in self.gaps.iter_mut().skip(frame).step_by(class.frames) {
                *gap += duration;
            }
        }
    }

    /// For each class with slots left, what the frames that are equal modulo p leave: the least of
    /// them. Empty for the others.
    fn bins(&self) -> Vec<Vec<u64>> {
        let mut is_needed = vec![false; self.classes.len()];
        for kind in self.kinds.iter().filter(|kind| kind.left > 0) {
            is_needed[kind.class] = true;
        }
        self.classes
            .iter()
            .zip(is_needed)
            .map(|(class, is_needed)| {
                if !is_needed {
                    return Vec::new();
                }
                let (first, rest) = self.gaps.split_at(class.frames);
                let mut bins = first.to_vec();
                for turn in rest.chunks(class.frames) {
                    for (bin, &gap) in bins.iter_mut().zip(turn) {
                        *bin = gap.min(*bin);
                    }
                }
                bins
            })
            .collect()
    }

    /// The kind for which fewest residues are left, with these; `None` where one has no residue
    /// left.
    fn choose(&self, bins: &[Vec<u64>]) -> Option<(usize, Vec<usize>)> {
        let mut best: Option<(usize, usize)> = None;
        for (position, kind) in self.kinds.iter().enumerate() {
            if kind.left == 0 {
                continue;
            }
            let count = self.residues(kind, &bins[kind.class]).count();
            if count == 0 {
                return None;
            }
            let is_better = best.is_none_or(|(best_count, best_position)| {
                let best = &self.kinds[best_position];
                (count, best.duration) < (best_count, kind.duration)
            });
            if is_better {
                best = Some((count, position));
            }
        }
        let (_, position) = best?;
        let kind = &self.kinds[position];
        // The tightest first: it makes packings, and what cannot be packed is found out either way.
        let mut residues: Vec<(u64, usize)> = self.residues(kind, &bins[kind.class]).collect();
        residues.sort_unstable();
        let residues = residues.into_iter().map(|(_, residue)| residue).collect();
        Some((position, residues))
    }

    /// What the residues leave that a kind can still take, with these.
    fn residues(&self, kind: &Kind, bins: &[u64]) -> impl Iterator<Item = (u64, usize)> {
        let class = &self.classes[kind.class];
        kind.is_dead
            .iter()
            .enumerate()
            .filter(|(_, is_dead)| !**is_dead)
            .map(|(residue, _)| {
                let left = class.frames_of(residue).map(|frame| bins[frame]).min();
                (left.unwrap_or(0), residue)
            })
            .filter(|(left, _)| kind.duration <= *left)
    }

    /// Whether no count speaks against what is left.
    fn can_work(&self, bins: &[Vec<u64>]) -> bool {
        self.classes
            .iter()
            .zip(bins)
            .filter(|(_, bins)| !bins.is_empty())
            .all(|(class, bins)| self.fits_bins(class, bins))
            && self.fits_bins(self.whole, &self.gaps)
    }

    /// Counts for the slots whose number of frames divides that of a class: they share its bins.
    fn fits_bins(&self, class: &Class, bins: &[u64]) -> bool {
        // (duration, how many), longest first.
        let mut needed: Vec<(u64, u64)> = self
            .kinds
            .iter()
            .filter(|kind| kind.left > 0)
            .filter_map(|kind| {
                let Class { frames, turns, .. } = self.classes[kind.class];
                let many = (class.frames / frames * turns * kind.left) as u64;
                class
                    .frames
                    .is_multiple_of(frames)
                    .then_some((kind.duration, many))
            })
            .collect();
        needed.sort_unstable_by(|a, b| b.cmp(a));
        // (what is left, of how many bins).
        let mut sizes: Vec<(u64, u64)> = Vec::new();
        let mut sorted = bins.to_vec();
        sorted.sort_unstable();
        for bin in sorted {
            match sizes.last_mut() {
                Some((size, many)) if *size == bin => *many += 1,
                _ => sizes.push((bin, 1)),
            }
        }
        let reach = |size: u64| {
            usize::try_from(size)
                .ok()
                .and_then(|size| class.reach.get(size))
                .copied()
                .unwrap_or(size)
        };
        let (mut time, mut places) = (0, 0);
        for (position, &(duration, many)) in needed.iter().enumerate() {
            time += duration * many;
            places += many;
            if needed
                .get(position + 1)
                .is_some_and(|next| next.0 == duration)
            {
                continue;
            }
            let (mut free_time, mut free_places) = (0, 0);
            for &(size, bins) in sizes.iter().rev().take_while(|(size, _)| *size >= duration) {
                free_time += reach(size) * bins;
                free_places += size / duration * bins;
            }
            if time > free_time || places > free_places {
                return false;
            }
        }
        true
    }

    /// Whether an exchange of two classes of frames, which changes nothing for the slots that are
    /// left, turns one residue into the other.
    ///
    /// Frames that are `from` modulo m change places with those `shift` further on. That keeps
    /// slots in every p-th frame in one piece if m divides p, and any slots if p divides the shift.
    /// It changes nothing if the frames that change places leave equally much. With m = 1 all
    /// frames move on together.
    fn is_exchangeable(&self, class: &Class, from: usize, to: usize) -> bool {
        let frames = class.frames;
        let (from, to) = (from.min(to), from.max(to));
        let distance = match class.turns {
            1 => to - from,
            // So many frames further on, it is as many parts of a frame as the residues are apart.
            turns => match (1..frames).find(|frame| (from + frame * turns) % frames == to) {
                Some(distance) => distance,
                None => return false,
            },
        };
        let shift = self.shift(frames, distance);
        let mut modulus = if class.turns == 1 { frames } else { 1 };
        for kind in self.kinds.iter().filter(|kind| kind.left > 0) {
            let others = &self.classes[kind.class];
            if !shift.is_multiple_of(others.frames) {
                modulus = match others.turns {
                    1 => gcd(modulus as u64, others.frames as u64) as usize,
                    _ => 1,
                };
            }
        }
        let all = self.gaps.len();
        if modulus > 1 && shift.is_multiple_of(modulus) {
            return false;
        }
        (from % modulus..all)
            .step_by(modulus)
            .all(|frame| self.gaps[frame] == self.gaps[(frame + shift) % all])
    }

    /// A number of frames that is `distance` modulo `frames`, and 0 modulo as much as possible of
    /// the rest.
    fn shift(&self, frames: usize, distance: usize) -> usize {
        // The part of all frames that has no prime in common with where the distance differs
        // from 0.
        let mut foreign = self.gaps.len();
        let differing = frames / gcd(frames as u64, distance as u64) as usize;
        loop {
            let common = gcd(foreign as u64, differing as u64) as usize;
            if common <= 1 {
                break;
            }
            foreign /= common;
        }
        (0..self.gaps.len() / frames)
            .map(|turn| distance + turn * frames)
            .find(|shift| shift.is_multiple_of(foreign))
            .unwrap_or(distance)
    }
}

#[cfg(test)]
mod tests {
    use super::super::random::Random;
    use super::*;

    /// Slots that have a packing, and with it a fullest frame that nothing is left of.
    fn packed(random: &mut Random) -> Vec<SlotSpec> {
        const FRAME_US: u64 = 60;
        // Periods of p/q frames.
        const CLASSES: [(u64, u64); 7] = [(2, 1), (3, 1), (4, 1), (6, 1), (3, 2), (5, 2), (12, 1)];
        const FRAMES: u64 = 60;
        let mut loads = [0; FRAMES as usize];
        let mut slots = Vec::new();
        for number in 2..9 {
            let (frames, turns) = CLASSES[random.index(CLASSES.len())];
            let (residue, duration_us) = (random.below(frames), 1 + random.below(9));
            let mut activation = residue;
            while activation < FRAMES * turns {
                loads[(activation / turns) as usize] += duration_us;
                activation += frames;
            }
            slots.push((number, FRAME_US * frames / turns, duration_us));
        }
        let fullest = loads.iter().max().copied().unwrap_or(0);
        slots.push((1, FRAME_US, FRAME_US - fullest));
        slots
            .into_iter()
            .map(|(number, period_us, duration_us)| SlotSpec {
                number,
                period_us: u32::try_from(period_us).expect("small"),
                duration_us: u32::try_from(duration_us).expect("small"),
                fixed_start_us: None,
            })
            .collect()
    }

    #[test]
    fn what_has_a_packing_is_packed() {
        let mut random = Random::new(7);
        for set in 0..400 {
            let slots = packed(&mut random);
            let mut clock = Clock::new(std::time::Duration::MAX);
            let end = Frames::new(&slots).search(&mut 5_000, &mut clock);
            assert_eq!(end, End::Packed, "set {set}: {slots:?}");
        }
    }

    fn slot(number: u32, period_us: u32, duration_us: u32) -> SlotSpec {
        SlotSpec {
            number,
            period_us,
            duration_us,
            fixed_start_us: None,
        }
    }

    /// All time and all places are taken, so that each count is met and none is exceeded.
    #[test]
    fn what_fills_every_frame_to_the_last_unit_is_packed() {
        let mut slots = vec![slot(1, 12, 6)];
        slots.extend([2, 3].map(|number| slot(number, 24, 3)));
        slots.extend([4, 5, 6].map(|number| slot(number, 36, 3)));
        let mut clock = Clock::new(std::time::Duration::MAX);
        let mut end = |slots: &[SlotSpec]| Frames::new(slots).search(&mut 100, &mut clock);
        assert_eq!(end(&slots), End::Packed);
        slots[0].duration_us += 1;
        assert_eq!(end(&slots), End::Exhausted);
    }

    #[test]
    fn what_overfills_a_frame_is_not() {
        // Slots of every 2nd and of every 3rd frame meet, whatever their residues are.
        let mut clock = Clock::new(std::time::Duration::MAX);
        let mut slots = [slot(1, 10, 4), slot(2, 20, 3), slot(3, 30, 4)];
        assert_eq!(
            Frames::new(&slots).search(&mut 100, &mut clock),
            End::Exhausted
        );
        slots[2].duration_us = 3;
        assert_eq!(
            Frames::new(&slots).search(&mut 100, &mut clock),
            End::Packed
        );
    }
}
