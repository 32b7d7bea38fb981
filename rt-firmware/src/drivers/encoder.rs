//! A wheel's encoder: how far the wheel has turned since one looked last.

use super::EncoderCounter;

/// A wheel's encoder.
#[derive(Debug)]
pub struct WheelEncoder<E> {
    counter: E,
    last_count: Option<u16>,
}

impl<E: EncoderCounter> WheelEncoder<E> {
    /// The encoder on this counter.
    pub fn new(counter: E) -> Self {
        Self {
            counter,
            last_count: None,
        }
    }

    /// Counts since the last call, forwards positive; 0 the first time. Right as long as the wheel
    /// turns by less than half the counter's range between two calls.
    pub fn take_counts(&mut self) -> i16 {
        let count = self.counter.count();
        let last_count = self.last_count.replace(count).unwrap_or(count);
        count.wrapping_sub(last_count).cast_signed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Script<'a>(core::slice::Iter<'a, u16>);

    impl EncoderCounter for Script<'_> {
        fn count(&mut self) -> u16 {
            *self.0.next().unwrap()
        }
    }

    #[test]
    fn counts_are_differences_also_over_the_wrap() {
        for (counts, expected) in [
            ([500, 500, 620], [0, 0, 120]),
            ([10, 5, 65_533], [0, -5, -8]),
            ([65_530, 4, 65_530], [0, 10, -10]),
            ([0, 32_767, 65_534], [0, 32_767, 32_767]),
            ([0, 32_768, 0], [0, -32_768, -32_768]),
        ] {
            let mut encoder = WheelEncoder::new(Script(counts.iter()));
            let seen = core::array::from_fn(|_| encoder.take_counts());
            assert_eq!(expected, seen, "{counts:?}");
        }
    }
}
