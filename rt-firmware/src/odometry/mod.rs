//! Dead reckoning: where the robot is, worked out from how far its wheels have turned.
//!
//! | module | what it holds |
//! |---|---|
//! | `angle` | sine, cosine and wrapped angles |
//! | `arc` | the arc that a robot drives from one look at its wheels to the next |
//! | `frame` | [`Frame`], places seen from each other, and [`Pose`], which is one |
//! | `global` | [`GlobalFrame`], in which the robot can be told where it is |
//! | `uncertainty` | [`Uncertainty`], how far a pose may be off |
//!
//! In `f32`: a step of a fraction of a millimetre is lost only tens of kilometres from the start,
//! the wheels slip by far more, and a core without a floating-point unit takes half the time. Sine
//! and cosine are sums and products of `f32`, which host and target work out to the same bits;
//! those of `libm` are as well, but go through `f64`, whose arithmetic would be five kilobytes of a
//! small robot's flash.

mod angle;
mod arc;
mod frame;
mod global;
mod uncertainty;

pub(crate) use angle::sine_and_cosine;
pub use angle::wrapped_rad;
pub use frame::{Frame, LocalFrame, Pose};
pub use global::{GlobalFrame, OutsideBounds};
pub use uncertainty::Uncertainty;
