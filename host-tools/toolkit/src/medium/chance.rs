//! How probable something is, and whether it happens.

/// Parts of a whole.
const WHOLE: u64 = 1_000_000_000_000;

/// A probability, in millionths of a millionth.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub struct Chance(u64);

impl Chance {
    /// It never happens.
    pub const NEVER: Chance = Chance(0);

    /// A probability from 0 to 1. None for anything else.
    #[must_use]
    pub fn new(probability: f64) -> Option<Self> {
        (0.0..=1.0)
            .contains(&probability)
            .then(|| Chance(libm::round(probability * WHOLE as f64) as u64))
    }

    /// From 0 to 1.
    #[must_use]
    pub fn probability(self) -> f64 {
        self.0 as f64 / WHOLE as f64
    }
}

/// Decides what happens: SplitMix64 (Steele, Lea, Flood 2014).
#[derive(Clone, Debug)]
pub struct Fate {
    state: u64,
}

impl Fate {
    /// What happens to number `which` of several in a run with this seed.
    #[must_use]
    pub fn new(seed: u64, which: u64) -> Self {
        let mut fate = Fate { state: seed };
        fate.state = fate.bits() ^ which;
        fate.state = fate.bits();
        fate
    }

    /// Whether it happens this time.
    pub fn decide(&mut self, chance: Chance) -> bool {
        // Nothing is drawn for what is certain: most lines are good ones.
        match chance {
            Chance::NEVER => false,
            Chance(WHOLE..) => true,
            Chance(parts) => self.bits() % WHOLE < parts,
        }
    }

    fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.state;
        mixed = (mixed ^ (mixed >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ (mixed >> 31)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_probability_is_between_none_and_all() {
        for wrong in [-0.1, 1.1, f64::NAN, f64::INFINITY] {
            assert_eq!(Chance::new(wrong), None);
        }
        assert_eq!(Chance::new(1e-5), Some(Chance(10_000_000)));
    }

    #[test]
    fn things_happen_as_often_as_is_probable_and_the_same_in_each_run() {
        for probability in [0.0, 0.01, 0.5, 1.0] {
            let chance = Chance::new(probability).unwrap();
            let times = |seed, which| {
                let mut fate = Fate::new(seed, which);
                let happened: Vec<bool> = (0..10_000).map(|_| fate.decide(chance)).collect();
                happened
            };
            let happened = times(1, 0);
            let count = happened.iter().filter(|it| **it).count() as f64;
            assert!((count / 10_000.0 - probability).abs() <= 0.01, "{count}");
            assert_eq!(happened, times(1, 0));
            if chance > Chance::NEVER && probability < 1.0 {
                assert_ne!(happened, times(1, 1));
                assert_ne!(happened, times(2, 0));
            }
        }
    }
}
