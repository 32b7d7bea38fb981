//! Random numbers that depend on nothing but their key.
//!
//! A generator with a state gives other numbers when somebody draws one more or in another order.
//! Here a number is a function of (seed, source, index): ping 17 of sonar 3 has the same noise
//! however the run is cut into calls.
//!
//! The function is the output mix of SplitMix64 (Steele, Lea, Flood 2014), applied once a part of
//! the key.

/// Who draws a number. Each source has its own sequence.
#[derive(Clone, Copy, Debug)]
pub enum Source {
    /// Slip of the left wheel.
    LeftSlip,
    /// Slip of the right wheel.
    RightSlip,
    /// Range noise of a sonar.
    Range {
        /// The sonar.
        sonar: u8,
    },
    /// Whether a sonar misses its echo.
    Miss {
        /// The sonar.
        sonar: u8,
    },
    /// Whether a noisy sonar hears something else, and from where.
    Stray {
        /// The sonar.
        sonar: u8,
    },
    /// Noise of the battery's ADC input.
    Battery,
    /// Noise of the ADC input of a sensor that looks at the floor.
    Floor {
        /// The sensor.
        sensor: u8,
    },
    /// The bias with which the gyroscope was switched on.
    GyroBias,
    /// Noise of the gyroscope.
    Gyro,
    /// Which sonar dies, and when.
    DeadSonar,
    /// By how much earlier or later a person steps in.
    StepIn {
        /// The person, in the order of the world's file, from 0.
        person: u16,
    },
    /// By how much earlier or later a person steps away.
    StepAway {
        /// The person.
        person: u16,
    },
}

impl Source {
    fn key(self) -> u64 {
        match self {
            Self::LeftSlip => 1,
            Self::RightSlip => 2,
            Self::Battery => 3,
            Self::DeadSonar => 4,
            Self::GyroBias => 5,
            Self::Gyro => 6,
            Self::Range { sonar } => 0x100 + u64::from(sonar),
            Self::Miss { sonar } => 0x200 + u64::from(sonar),
            Self::Floor { sensor } => 0x300 + u64::from(sensor),
            Self::Stray { sonar } => 0x400 + u64::from(sonar),
            Self::StepIn { person } => 0x1_0000 + u64::from(person),
            Self::StepAway { person } => 0x2_0000 + u64::from(person),
        }
    }
}

/// All random numbers of one run.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    seed: u64,
}

impl Noise {
    /// The numbers that belong to `seed`.
    pub fn new(seed: u64) -> Self {
        Self { seed }
    }

    /// Number `index` of `source`, evenly spread over 0 ≤ x < 1.
    pub fn uniform(&self, source: Source, index: u64) -> f64 {
        unit(mix(mix(mix(self.seed) ^ source.key()) ^ index))
    }

    /// Number `index` of `source`, spread like a bell: mean 0, standard deviation 1, never beyond
    /// ±6.
    ///
    /// The sum of twelve even numbers: near enough to a normal distribution for a sensor, and free
    /// of logarithms.
    pub fn bell(&self, source: Source, index: u64) -> f64 {
        let key = mix(mix(mix(self.seed) ^ source.key()) ^ index);
        let sum: f64 = (0..12).map(|part| unit(mix(key.wrapping_add(part)))).sum();
        sum - 6.0
    }
}

/// SplitMix64's output for the state `key`.
fn mix(key: u64) -> u64 {
    let key = key.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let key = (key ^ (key >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let key = (key ^ (key >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    key ^ (key >> 31)
}

/// The upper 53 bits of `bits` as a fraction: as many as an `f64` holds exactly.
fn unit(bits: u64) -> f64 {
    const SCALE: f64 = 1.0 / (1_u64 << 53) as f64;
    (bits >> 11) as f64 * SCALE
}

#[cfg(test)]
mod tests {
    use super::*;

    /// First output of SplitMix64 with the state 0, from its authors' reference code.
    #[test]
    fn mixes_as_published() {
        assert_eq!(mix(0), 0xE220_A839_7B1D_CDAF);
    }

    #[test]
    fn numbers_are_spread_as_promised() {
        const COUNT: u64 = 20_000;
        let noise = Noise::new(1);
        let source = Source::Range { sonar: 2 };
        let uniform: Vec<f64> = (0..COUNT).map(|i| noise.uniform(source, i)).collect();
        assert!(uniform.iter().all(|x| (0.0..1.0).contains(x)));
        let mean = |numbers: &[f64]| numbers.iter().sum::<f64>() / COUNT as f64;
        assert!((mean(&uniform) - 0.5).abs() < 0.01);
        let bell: Vec<f64> = (0..COUNT).map(|i| noise.bell(source, i)).collect();
        let squares: Vec<f64> = bell.iter().map(|x| x * x).collect();
        assert!(mean(&bell).abs() < 0.02);
        assert!((mean(&squares) - 1.0).abs() < 0.03);
    }

    #[test]
    fn seeds_and_sources_differ() {
        let draw = |seed, source| Noise::new(seed).uniform(source, 5);
        assert_ne!(draw(1, Source::LeftSlip), draw(2, Source::LeftSlip));
        assert_ne!(draw(1, Source::LeftSlip), draw(1, Source::RightSlip));
        assert_ne!(
            draw(1, Source::Range { sonar: 3 }),
            draw(1, Source::Miss { sonar: 3 })
        );
    }
}
