//! How fast to turn to a heading.
//!
//! Source: Schoute, figure 4, `turn_bhv`.

/// Nearer than this is at the heading, in radians.
const REACHED_RAD: f32 = 0.02;
/// Farther than this the robot turns at full rate, in radians.
const FAR_RAD: f32 = 1.0;
/// Nearer than this it turns at the slowest rate, in radians.
const NEAR_RAD: f32 = 0.5;
/// The full rate in radians per second, and per radian of what is left.
const FULL_RAD_PER_S: f32 = 0.6;
/// The slowest rate, in radians per second.
const SLOW_RAD_PER_S: f32 = 0.3;

/// The turning rate for a heading in the local frame; none where it is reached.
pub fn rate_rad_per_s(heading_rad: f32) -> Option<f32> {
    let left_rad = heading_rad.abs();
    if left_rad < REACHED_RAD {
        return None;
    }
    let rate = if left_rad > FAR_RAD {
        FULL_RAD_PER_S
    } else if left_rad > NEAR_RAD {
        FULL_RAD_PER_S * left_rad
    } else {
        SLOW_RAD_PER_S
    };
    Some(rate.copysign(-heading_rad))
}
