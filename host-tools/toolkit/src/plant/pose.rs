//! Where a body is.

use crate::world::Point;

/// Where the body is and which way it looks.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct BodyPose {
    /// The body's centre.
    pub position: Point,
    /// Counter-clockwise from x, in radians, not wrapped.
    pub heading_rad: f64,
}
