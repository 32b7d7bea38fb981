//! Odometry on the host: where a robot with two driven wheels has gone, from what its encoders
//! counted, in `f64`.
//!
//! | module | what it holds |
//! |---|---|
//! | [`arc`] | the pose after a way along an arc, exactly |
//! | [`tick_log`] | tables of encoder counts, and the way that they tell |
//! | [`umbmark`] | squares, and what they say of a robot's wheels |
//!
//! A firmware does the same in `f32` ([`rt_firmware::odometry`]); a test here compares the two.

pub mod arc;
pub mod tick_log;
pub mod umbmark;
