//! Gains as parameters, and numbers in the digits that they are told in.

use crate::tune::Gains;

/// The task whose gains are looked for.
pub const TASK: &str = "WheelSpeed";

/// Its parameters.
const PROPORTIONAL: &str = "proportional_s_per_m";
const INTEGRAL: &str = "integral_per_m";

/// Gains as parameters, in the digits that they are told in.
pub fn values_of(gains: &Gains) -> [(&'static str, String); 2] {
    [
        (
            PROPORTIONAL,
            format!("{:?}", rounded(gains.proportional_s_per_m)),
        ),
        (INTEGRAL, format!("{:?}", rounded(gains.integral_per_m))),
    ]
}

/// A number to three digits: more than a drive says.
pub fn rounded(value: f64) -> f64 {
    to_digits(value, 3)
}

/// A number to so many digits.
pub fn to_digits(value: f64, digits: i32) -> f64 {
    if value == 0.0 || !value.is_finite() {
        return 0.0;
    }
    let behind = digits - 1 - libm::floor(libm::log10(libm::fabs(value))) as i32;
    let scale = libm::pow(10.0, f64::from(behind));
    libm::round(value * scale) / scale
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits() {
        for (value, expected) in [
            (1.23456, 1.23),
            (14.29, 14.3),
            (0.067_89, 0.0679),
            (0.0, 0.0),
        ] {
            assert_eq!(rounded(value), expected);
        }
    }
}
