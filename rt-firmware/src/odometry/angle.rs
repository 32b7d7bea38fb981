//! Angles: their sine and cosine, and which of them look the same way.

use core::f32::consts::{PI, TAU};

use super::magnitude::is_beyond;

/// The angle between -π and π that looks the same way as `angle_rad`, which is at most one turn
/// outside.
pub fn wrapped_rad(angle_rad: f32) -> f32 {
    if !is_beyond(angle_rad, PI) {
        angle_rad
    } else if angle_rad.is_sign_negative() {
        angle_rad + TAU
    } else {
        angle_rad - TAU
    }
}

/// Sine and cosine of an angle, to 6e-8 up to a million turns; not a number where the angle is not.
///
/// In whole numbers, for a core without a floating-point unit takes a hundred instructions to add
/// two `f32`: the angle becomes a part of a turn, whose distance from the nearest quarter turn, an
/// eighth at most, goes into the two power series, cut where the next term is less than half of an
/// `f32`'s last bit; the number of quarter turns says which is which.
pub(crate) fn sine_and_cosine(angle_rad: f32) -> (f32, f32) {
    if !angle_rad.is_finite() {
        return (f32::NAN, f32::NAN);
    }
    let turned = turn_of(angle_rad);
    let quarters = turned.wrapping_add(1 << (QUARTER_BITS - 1)) >> QUARTER_BITS;
    let rest = turned.wrapping_sub(quarters << QUARTER_BITS).cast_signed();
    let square = product(rest, rest);
    let sine = product(rest, series(square, [S1, S3, S5, S7, S9]));
    let cosine = series(square, [ONE, C2, C4, C6, C8]);
    let (sine, cosine) = match quarters {
        0 => (sine, cosine),
        1 => (cosine, -sine),
        2 => (-sine, -cosine),
        _ => (-cosine, sine),
    };
    (float(sine), float(cosine))
}

/// A quarter turn, of which 2³² parts are a turn.
const QUARTER_BITS: u32 = 30;
/// 1 in parts of 2⁻³⁰, in which the series are worked out.
const ONE: i32 = 1 << QUARTER_BITS;

/// The factors of sin(π/2·y) = y·(S1 - y²·(S3 - …)) and cos(π/2·y) = 1 - y²·(C2 - …): powers of π/2
/// over factorials.
const S1: i32 = factor(1);
const S3: i32 = factor(3);
const S5: i32 = factor(5);
const S7: i32 = factor(7);
const S9: i32 = factor(9);
const C2: i32 = factor(2);
const C4: i32 = factor(4);
const C6: i32 = factor(6);
const C8: i32 = factor(8);

const fn factor(power: u32) -> i32 {
    let (mut factor, mut n) = (1.0, 1);
    while n <= power {
        factor *= core::f64::consts::FRAC_PI_2 / n as f64;
        n += 1;
    }
    (factor * ONE as f64 + 0.5) as i32
}

fn series(square: i32, [a, b, c, d, e]: [i32; 5]) -> i32 {
    let inner = c - product(square, d - product(square, e));
    a - product(square, b - product(square, inner))
}

/// Of two numbers in parts of 2⁻³⁰.
fn product(a: i32, b: i32) -> i32 {
    ((i64::from(a) * i64::from(b)) >> QUARTER_BITS) as i32
}

/// An angle in parts of 2⁻³² turns, without its whole turns.
fn turn_of(angle_rad: f32) -> u32 {
    /// 2⁶⁴/2π, in two halves.
    const PER_RAD: (u64, u64) = (0x28be_60db, 0x9391_054a);
    const MANTISSA_BITS: u32 = f32::MANTISSA_DIGITS - 1;
    /// The exponent that an `f32` stores for an angle of so many bits without a point.
    const WHOLE: u32 = f32::MAX_EXP.unsigned_abs() - 1 + MANTISSA_BITS;
    let bits = angle_rad.to_bits();
    let exponent = (bits >> MANTISSA_BITS) & 0xff;
    let mantissa = u64::from((bits & ((1 << MANTISSA_BITS) - 1)) | (1 << MANTISSA_BITS));
    let turned = mantissa * PER_RAD.0 + ((mantissa * PER_RAD.1) >> 32);
    let turned = if exponent > WHOLE {
        turned.checked_shl(exponent - WHOLE)
    } else {
        turned.checked_shr(WHOLE - exponent)
    };
    let turned = turned.unwrap_or(0) as u32;
    if angle_rad.is_sign_negative() {
        turned.wrapping_neg()
    } else {
        turned
    }
}

/// A number in parts of 2⁻³⁰.
fn float(value: i32) -> f32 {
    const PART: f32 = 1.0 / ONE as f32;
    value as f32 * PART
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_are_right_to_the_last_bit_but_one() {
        const STEPS: i32 = 200_000;
        for turns in [0.001, 4.0, 1e6] {
            for step in -STEPS..=STEPS {
                let angle_rad = step as f32 / STEPS as f32 * turns * TAU;
                let (sine, cosine) = sine_and_cosine(angle_rad);
                let (exact_sine, exact_cosine) = libm::sincos(f64::from(angle_rad));
                for (value, exact) in [(sine, exact_sine), (cosine, exact_cosine)] {
                    let error = (f64::from(value) - exact).abs();
                    assert!(error < 6e-8, "{angle_rad} rad: {value}, not {exact}");
                }
            }
        }
        assert_eq!(sine_and_cosine(0.0), (0.0, 1.0));
        assert_eq!(sine_and_cosine(-0.0), (0.0, 1.0));
        for huge_rad in [f32::MAX, -f32::MAX] {
            let (sine, cosine) = sine_and_cosine(huge_rad);
            assert!(sine.abs() <= 1.0 && cosine.abs() <= 1.0);
        }
        for none in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let (sine, cosine) = sine_and_cosine(none);
            assert!(sine.is_nan() && cosine.is_nan());
        }
    }

    #[test]
    fn sine_and_cosine_have_the_same_bits_everywhere() {
        for (angle_rad, sine_bits, cosine_bits) in [
            (0.5_f32, 0x3ef5_7744, 0x3f60_a940),
            (-2.0, 0xbf68_c7b7, 0xbed5_1133),
            (3.0, 0x3e10_81c4, 0xbf7d_7026),
        ] {
            let (sine, cosine) = sine_and_cosine(angle_rad);
            assert_eq!(
                (sine.to_bits(), cosine.to_bits()),
                (sine_bits, cosine_bits),
                "{angle_rad} rad"
            );
        }
    }
}
