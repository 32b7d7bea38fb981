//! Dead reckoning: where the robot is, worked out from how far its wheels have turned.
//!
//! | module | what it holds |
//! |---|---|
//! | `angle` | sine, cosine and wrapped angles |
//! | `arc` | the arc that a robot drives from one look at its wheels to the next |
//! | `frame` | [`Frame`], places seen from each other, and [`Pose`], which is one |
//! | `global` | [`GlobalFrame`], in which the robot can be told where it is |
//! | `magnitude` | comparisons of numbers without their sign |
//! | `records` | a pose as the flight recorder keeps it |
//! | `uncertainty` | [`Uncertainty`], how far a pose may be off |
//!
//! In `f32`: a step of a fraction of a millimetre is lost only tens of kilometres from the start,
//! the wheels slip by far more, and a core without a floating-point unit takes half the time. Sine
//! and cosine are worked out in whole numbers, to the same bits on host and target, in an eighth of
//! the instructions that sums and products of `f32` took; those of `libm` go through `f64`, whose
//! arithmetic would be five kilobytes of a small robot's flash. That is faster than `micromath`,
//! too, whose sine is right to 1e-3: so there is one for odometry and for steering.

mod angle;
mod arc;
mod frame;
mod global;
mod magnitude;
mod records;
mod uncertainty;

pub(crate) use angle::sine_and_cosine;
pub use angle::wrapped_rad;
pub use frame::{Frame, LocalFrame, Pose};
pub use global::{GlobalFrame, OutsideBounds};
pub(crate) use magnitude::{is_beyond, is_within};
pub(crate) use records::pose_events;
pub use uncertainty::Uncertainty;
