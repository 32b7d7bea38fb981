//! A small seeded source of random numbers, the same on every machine.

/// SplitMix64 (Steele, Lea, Flood 2014): one word of state, good enough to choose test cases with.
///
/// One that was [made of bytes](Random::of_bytes) lets those decide first, so that a fuzzer, which
/// changes bytes and watches what comes of it, can steer what is made.
#[derive(Clone, Debug)]
pub struct Random {
    state: u64,
    given: std::vec::IntoIter<u8>,
}

impl Random {
    /// A source whose whole sequence follows from `seed`.
    pub fn new(seed: u64) -> Self {
        Random {
            state: seed,
            given: Vec::new().into_iter(),
        }
    }

    /// A source whose decisions are those of `bytes`, one after another: a byte for a number below
    /// 257, two for a greater one, eight for 64 bits. When they have run out, it goes on as that of
    /// seed 0.
    pub fn of_bytes(bytes: &[u8]) -> Self {
        Random {
            state: 0,
            given: Vec::from(bytes).into_iter(),
        }
    }

    /// The next given bytes as one number, if there are so many.
    fn given(&mut self, count: usize) -> Option<u64> {
        (self.given.len() >= count).then(|| {
            let bytes = self.given.by_ref().take(count);
            bytes.fold(0, |number, byte| number << 8 | u64::from(byte))
        })
    }

    /// The next 64 bits.
    pub fn bits(&mut self) -> u64 {
        if let Some(number) = self.given(8) {
            return number;
        }
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut mixed = self.state;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    /// A number in `0..bound`; 0 where `bound` is 0.
    pub fn below(&mut self, bound: usize) -> usize {
        if bound == 0 {
            return 0;
        }
        let number = match bound {
            ..=0x100 => self.given(1),
            0x101..=0x1_0000 => self.given(2),
            _ => None,
        };
        let number = number.unwrap_or_else(|| self.bits());
        (number % bound as u64) as usize
    }

    /// A number in `low..=high`.
    pub fn between(&mut self, low: usize, high: usize) -> usize {
        low + self.below(high - low + 1)
    }

    /// True in `percent` of 100 cases.
    pub fn chance(&mut self, percent: usize) -> bool {
        self.below(100) < percent
    }

    /// One of `choices`; `None` where there is none.
    pub fn pick<'a, T>(&mut self, choices: &'a [T]) -> Option<&'a T> {
        choices.get(self.below(choices.len()))
    }
}
