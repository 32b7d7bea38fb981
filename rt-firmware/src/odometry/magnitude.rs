//! Comparisons of what numbers are without their sign.
//!
//! Numbers that are not negative have the order of their bits. A core without a floating-point unit
//! takes 21 instructions for a comparison of two numbers, and two for one of their bits.

/// The bits of a number without its sign.
const fn bits(value: f32) -> u32 {
    value.abs().to_bits()
}

/// Whether a number is more than so far from 0.
pub(crate) const fn is_beyond(value: f32, limit: f32) -> bool {
    bits(value) > bits(limit)
}

/// Whether a number is less than so far from 0.
pub(crate) const fn is_within(value: f32, limit: f32) -> bool {
    bits(value) < bits(limit)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn they_say_what_comparisons_of_numbers_say(
            value in proptest::num::f32::ANY.prop_filter("a number", |it| !it.is_nan()),
            limit in prop_oneof![Just(0.0_f32), Just(0.15), 0.0_f32..10.0],
        ) {
            for value in [value, limit, -limit] {
                prop_assert_eq!(is_beyond(value, limit), value.abs() > limit);
                prop_assert_eq!(is_within(value, limit), value.abs() < limit);
            }
        }
    }
}
