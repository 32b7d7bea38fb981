//! Angles: their sine and cosine, and which of them look the same way.

use core::f32::consts::{FRAC_2_PI, PI, TAU};

/// The angle between -π and π that looks the same way as `angle_rad`, which is at most one turn
/// outside.
pub fn wrapped_rad(angle_rad: f32) -> f32 {
    if angle_rad > PI {
        angle_rad - TAU
    } else if angle_rad < -PI {
        angle_rad + TAU
    } else {
        angle_rad
    }
}

/// Sine and cosine of an angle, which is a few turns at most: to 1e-7 within four turns, to 2e-7
/// within a hundred, and less and less exact beyond.
///
/// The angle's distance from the nearest quarter turn, an eighth at most, goes into the two power
/// series, cut where the next term is less than half of an `f32`'s last bit; the number of quarter
/// turns says which is which.
pub(crate) fn sine_and_cosine(angle_rad: f32) -> (f32, f32) {
    /// A quarter turn in two parts. The first has so few bits that its products with small numbers
    /// are exact.
    const QUARTER_RAD: f32 = 1.570_312_5;
    /// See [`QUARTER_RAD`].
    const QUARTER_REST_RAD: f32 = (core::f64::consts::FRAC_PI_2 - QUARTER_RAD as f64) as f32;
    const HALF: f32 = 0.5;
    let rounding = if angle_rad < 0.0 { -HALF } else { HALF };
    let quarters = (angle_rad * FRAC_2_PI + rounding) as i32;
    let turned = quarters as f32;
    let x = angle_rad - turned * QUARTER_RAD - turned * QUARTER_REST_RAD;
    let square = x * x;
    let series = |[a, b, c, d]: [f32; 4]| {
        let inner = square * (1.0 / c) * (1.0 - square * (1.0 / d));
        square * (1.0 / a) * (1.0 - square * (1.0 / b) * (1.0 - inner))
    };
    // Divisors of each term, from the one before: x³/3! = x·x²/(2·3) and so on.
    let sine = x - x * series([2.0 * 3.0, 4.0 * 5.0, 6.0 * 7.0, 8.0 * 9.0]);
    let cosine = 1.0 - series([1.0 * 2.0, 3.0 * 4.0, 5.0 * 6.0, 7.0 * 8.0]);
    let (sine, cosine) = if quarters & 1 == 0 {
        (sine, cosine)
    } else {
        (cosine, -sine)
    };
    if quarters & 2 == 0 {
        (sine, cosine)
    } else {
        (-sine, -cosine)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sine_and_cosine_are_right_to_the_last_bit_but_one() {
        const STEPS: i32 = 200_000;
        for (turns, most_error) in [(4.0, 1e-7), (100.0, 2e-7)] {
            for step in -STEPS..=STEPS {
                let angle_rad = step as f32 / STEPS as f32 * turns * TAU;
                let (sine, cosine) = sine_and_cosine(angle_rad);
                let (exact_sine, exact_cosine) = libm::sincos(f64::from(angle_rad));
                for (value, exact) in [(sine, exact_sine), (cosine, exact_cosine)] {
                    let error = (f64::from(value) - exact).abs();
                    assert!(error < most_error, "{angle_rad} rad: {value}, not {exact}");
                }
            }
        }
        assert_eq!(sine_and_cosine(0.0), (0.0, 1.0));
    }

    /// The same sums on every machine: a compiler that contracted them would be found here.
    #[test]
    fn sine_and_cosine_have_the_same_bits_everywhere() {
        for (angle_rad, sine_bits, cosine_bits) in [
            (0.5_f32, 0x3ef5_7744, 0x3f60_a940),
            (-2.0, 0xbf68_c7b7, 0xbed5_1132),
            (3.0, 0x3e10_81c3, 0xbf7d_7026),
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
