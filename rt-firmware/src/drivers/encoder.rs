//! A wheel's encoder: how far the wheel has turned since one looked last.

use super::EncoderCounter;

/// A wheel's encoder.
#[derive(Debug)]
pub struct WheelEncoder<E> {
    counter: E,
    last_count: Option<u32>,
}

impl<E: EncoderCounter> WheelEncoder<E> {
    /// Bits of a count that the counter does not have.
    const UNUSED_BITS: u32 = {
        assert!(
            1 <= E::BITS && E::BITS <= u32::BITS,
            "a counter has 1 to 32 bits"
        );
        u32::BITS - E::BITS
    };

    /// The encoder on this counter.
    pub fn new(counter: E) -> Self {
        Self {
            counter,
            last_count: None,
        }
    }

    /// Counts since the last call, forwards positive; 0 the first time. Right as long as the wheel
    /// turns by less than half the counter's range between two calls.
    pub fn take_counts(&mut self) -> i32 {
        let count = self.counter.wide_count();
        let last_count = self.last_count.replace(count).unwrap_or(count);
        // The counter's sign is made that of the number.
        (count.wrapping_sub(last_count) << Self::UNUSED_BITS).cast_signed() >> Self::UNUSED_BITS
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A counter of so many bits that has these counts, one a look.
    struct Script<'a, const BITS: u32>(core::slice::Iter<'a, u32>);

    impl<const BITS: u32> EncoderCounter for Script<'_, BITS> {
        const BITS: u32 = BITS;

        fn count(&mut self) -> u16 {
            self.wide_count() as u16
        }

        fn wide_count(&mut self) -> u32 {
            *self.0.next().unwrap()
        }
    }

    #[track_caller]
    fn assert_counts<const BITS: u32>(cases: &[([u32; 3], [i32; 3])]) {
        for (counts, expected) in cases {
            let mut encoder = WheelEncoder::new(Script::<BITS>(counts.iter()));
            let seen = core::array::from_fn(|_| encoder.take_counts());
            assert_eq!(*expected, seen, "{BITS} bits: {counts:?}");
        }
    }

    #[test]
    fn counts_are_differences_also_over_the_wrap() {
        assert_counts::<16>(&[
            ([500, 500, 620], [0, 0, 120]),
            ([10, 5, 65_533], [0, -5, -8]),
            ([65_530, 4, 65_530], [0, 10, -10]),
            ([0, 32_767, 65_534], [0, 32_767, 32_767]),
            ([0, 32_768, 0], [0, -32_768, -32_768]),
        ]);
        assert_counts::<32>(&[
            ([500, 500, 620], [0, 0, 120]),
            ([65_530, 65_540, 65_530], [0, 10, -10]),
            ([0, 40_000, 0], [0, 40_000, -40_000]),
            ([u32::MAX - 5, 4, u32::MAX - 5], [0, 10, -10]),
            ([0, 0x7fff_ffff, 0xffff_fffe], [0, i32::MAX, i32::MAX]),
            ([0, 0x8000_0000, 0], [0, i32::MIN, i32::MIN]),
        ]);
        assert_counts::<24>(&[([0xff_fffb, 5, 0xff_fffb], [0, 10, -10])]);
    }

    /// A counter that says no more than its lowest 16 bits is one of 16.
    #[test]
    fn a_counter_has_16_bits_unless_it_says_more() {
        struct Plain(u16);
        impl EncoderCounter for Plain {
            fn count(&mut self) -> u16 {
                self.0 = self.0.wrapping_add(0x7000);
                self.0
            }
        }
        let mut encoder = WheelEncoder::new(Plain(0));
        for expected in [0, 0x7000, 0x7000, 0x7000] {
            assert_eq!(encoder.take_counts(), expected);
        }
    }
}
