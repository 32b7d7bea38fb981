//! A clock that never wraps, made of a counter of a few bits that does.
//!
//! The counter runs free and interrupts nobody. One context, the slot timer's interrupt, moves a
//! base to the present at least once in each of the counter's rounds; everybody else adds to the
//! base what the counter has counted since. So time needs no lock: one context writes the base, and
//! the others notice if they were interrupted while they read it.

use core::sync::atomic::{AtomicU32, Ordering, fence};

/// Time in ticks of a counter of `BITS` bits, 32 at most, that counts up.
///
/// The base is a time of the clock, so that its lowest `BITS` bits are what the counter showed.
pub struct Clock<const BITS: u32> {
    /// The base, twice: while one is written, the other holds.
    bases: [Base; 2],
    /// Number of times that the base was moved; its last bit tells which of the two holds.
    moves: AtomicU32,
    /// Low half of the base, for the context that moves it.
    low: AtomicU32,
}

/// A time in ticks, in two halves.
struct Base {
    low: AtomicU32,
    high: AtomicU32,
}

impl Base {
    fn ticks(&self) -> u64 {
        u64::from(self.high.load(Ordering::Relaxed)) << 32
            | u64::from(self.low.load(Ordering::Relaxed))
    }
}

impl<const BITS: u32> Clock<BITS> {
    const MASK: u32 = u32::MAX >> (32 - BITS);

    /// A clock that shows what its counter does: less than a round of it.
    pub const fn new() -> Self {
        Clock {
            bases: [const {
                Base {
                    low: AtomicU32::new(0),
                    high: AtomicU32::new(0),
                }
            }; 2],
            moves: AtomicU32::new(0),
            low: AtomicU32::new(0),
        }
    }

    /// Ticks that the counter went on from a time to where it stands at `count`, in less than a
    /// round. Bits above the counter's do not matter.
    #[cfg_attr(feature = "speed", inline(always))]
    fn since(low_ticks: u32, count: u32) -> u32 {
        count.wrapping_sub(low_ticks) & Self::MASK
    }

    fn base(&self, moves: u32) -> &Base {
        let [even, odd] = &self.bases;
        if moves.is_multiple_of(2) { even } else { odd }
    }

    /// The time in ticks. From any context. `count` reads the counter.
    pub fn now(&self, count: impl Fn() -> u32) -> u64 {
        loop {
            let moves = self.moves.load(Ordering::Acquire);
            let base = self.base(moves).ticks();
            let ticks = base + u64::from(Self::since(base as u32, count()));
            // What was read above was read before this.
            fence(Ordering::Acquire);
            // Moved meanwhile: what was read may be of two bases. The next attempt meets no move,
            // since moves are further apart than this takes.
            if self.moves.load(Ordering::Relaxed) == moves {
                return ticks;
            }
        }
    }

    /// Moves the base to when the counter stands at `count`, and returns that time. For one context
    /// alone, at least once in each round of the counter.
    pub fn advance(&self, count: u32) -> u64 {
        let moves = self.moves.load(Ordering::Relaxed);
        let base = self.base(moves).ticks();
        let ticks = base + u64::from(Self::since(base as u32, count));
        let moves = moves.wrapping_add(1);
        let next = self.base(moves);
        next.low.store(ticks as u32, Ordering::Relaxed);
        next.high.store((ticks >> 32) as u32, Ordering::Relaxed);
        self.low.store(ticks as u32, Ordering::Relaxed);
        self.moves.store(moves, Ordering::Release);
        ticks
    }

    /// How often the base was moved; wraps. From any context.
    pub fn moves(&self) -> u32 {
        self.moves.load(Ordering::Relaxed)
    }

    /// The low half of the time when the counter stands at `count`. For the context that moves the
    /// base, which it leaves where it is.
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn low(&self, count: u32) -> u32 {
        let low_ticks = self.low.load(Ordering::Relaxed);
        low_ticks.wrapping_add(Self::since(low_ticks, count))
    }
}

impl<const BITS: u32> Default for Clock<BITS> {
    fn default() -> Self {
        Self::new()
    }
}

#[cfg(test)]
mod tests {
    use core::cell::Cell;

    use super::*;

    /// Rounds of 2^32 ticks that are run through.
    const ROUNDS: u64 = 5;

    /// Runs a clock over every wrap of its counter and of its halves, with moves of the base so
    /// many ticks apart.
    fn run<const BITS: u32>(steps_ticks: &[u64]) {
        let clock = Clock::<BITS>::new();
        let (mut ticks, mut steps) = (0, steps_ticks.iter().cycle());
        // What is above the counter's bits may be anything.
        let count = |ticks: u64| ticks as u32 | (ticks >> 3) as u32 & !Clock::<BITS>::MASK;
        while ticks < ROUNDS << 32 {
            let step = *steps.next().unwrap();
            for later in [0, 1, step / 2, step] {
                let now = ticks + later;
                assert_eq!(clock.now(|| count(now)), now);
                assert_eq!(clock.low(count(now)), now as u32);
            }
            ticks += step;
            assert_eq!(clock.advance(count(ticks)), ticks);
        }
    }

    #[test]
    fn time_is_exact_over_every_wrap_of_the_counter_and_of_its_halves() {
        // Up to the last tick of a round of the counter.
        run::<24>(&[5_000_000, 1, 16_777_215, 999_999, 16_777_213]);
        run::<32>(&[u64::from(u32::MAX), 1, 5, 1 << 31]);
        run::<16>(&[65_535, 65_534, 65_535]);
    }

    #[test]
    fn a_reader_that_is_interrupted_reads_again() {
        for before in [0, (1 << 24) - 1, (1 << 32) - 3, (7 << 32) - 1] {
            let clock = Clock::<24>::new();
            let mut ticks = 0;
            while ticks < before {
                ticks = before.min(ticks + 0xFF_FFFF);
                clock.advance(ticks as u32);
            }
            let reads = Cell::new(0);
            let now = clock.now(|| {
                reads.set(reads.get() + 1);
                if reads.get() == 1 {
                    // Twice, so that what the reader looks at is written over.
                    clock.advance((before + 4) as u32);
                    clock.advance((before + 9) as u32);
                }
                (before + 9 + reads.get()) as u32
            });
            assert_eq!((now, reads.get()), (before + 11, 2));
        }
    }
}
