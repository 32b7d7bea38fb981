//! Frames: places on the floor with a heading, each seen from another one.

use super::angle::{sine_and_cosine, wrapped_rad};

/// A frame of coordinates on the floor: where it is in another one, and which way its x-axis looks
/// there.
///
/// Frames are the moves of a rigid body in the plane. With [`compose`](Self::compose) they are a
/// group: [`START`](Self::START) changes nothing, and [`inverse`](Self::inverse) takes a frame
/// back. As sums of `f32` they are so but for rounding, which is 1e-7 of the greatest distance.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Frame {
    /// Ahead of the start, in metres.
    pub x_m: f32,
    /// To the left of the start, in metres.
    pub y_m: f32,
    /// Counter-clockwise from the start's heading, in radians, -π to π.
    pub heading_rad: f32,
}

/// Where the robot is and which way it looks, relative to where it was switched on: the frame of
/// its body.
pub type Pose = Frame;

impl Frame {
    /// The frame that others are seen from. As a pose: where the robot was switched on.
    pub const START: Self = Self {
        x_m: 0.0,
        y_m: 0.0,
        heading_rad: 0.0,
    };

    /// The frame that is `inner` as seen from this one.
    pub fn compose(self, inner: Self) -> Self {
        Self {
            heading_rad: wrapped_rad(self.heading_rad + inner.heading_rad),
            ..self.translate(inner.x_m, inner.y_m)
        }
    }

    /// Where the frame that this one is seen from is, as seen from this one.
    pub fn inverse(self) -> Self {
        self.to_local(Self::START)
    }

    /// This frame, turned on its spot by an angle of at most half a turn.
    pub fn rotate(self, angle_rad: f32) -> Self {
        Self {
            heading_rad: wrapped_rad(self.heading_rad + angle_rad),
            ..self
        }
    }

    /// This frame, moved along its own axes: ahead, and to the left.
    pub fn translate(self, ahead_m: f32, left_m: f32) -> Self {
        let (sine, cosine) = sine_and_cosine(self.heading_rad);
        Self {
            x_m: self.x_m + ahead_m * cosine - left_m * sine,
            y_m: self.y_m + ahead_m * sine + left_m * cosine,
            ..self
        }
    }

    /// A frame as seen from this one. Both are seen from the same.
    pub fn to_local(self, global: Self) -> Self {
        LocalFrame::from(self).see(global)
    }

    /// A frame that is seen from this one, as seen from where this one is seen from: what
    /// [`to_local`](Self::to_local) undoes, and [`compose`](Self::compose) by another name.
    pub fn to_global(self, local: Self) -> Self {
        self.compose(local)
    }
}

/// A frame that many others are to be seen from: sine and cosine of its heading are worked out
/// once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LocalFrame {
    frame: Frame,
    sine: f32,
    cosine: f32,
}

impl From<Frame> for LocalFrame {
    fn from(frame: Frame) -> Self {
        let (sine, cosine) = sine_and_cosine(frame.heading_rad);
        Self {
            frame,
            sine,
            cosine,
        }
    }
}

impl LocalFrame {
    /// The frame that others are seen from.
    pub const START: Self = Self {
        frame: Frame::START,
        sine: 0.0,
        cosine: 1.0,
    };

    /// A frame as seen from this one.
    pub fn see(&self, global: Frame) -> Frame {
        let Self {
            frame,
            sine,
            cosine,
        } = self;
        let (x_m, y_m) = (global.x_m - frame.x_m, global.y_m - frame.y_m);
        Frame {
            x_m: x_m * cosine + y_m * sine,
            y_m: y_m * cosine - x_m * sine,
            heading_rad: wrapped_rad(global.heading_rad - frame.heading_rad),
        }
    }

    /// A frame that is seen from this one, as seen from where this one is seen from: what
    /// [`see`](Self::see) undoes.
    pub fn to_global(&self, local: Frame) -> Frame {
        let Self {
            frame,
            sine,
            cosine,
        } = self;
        Frame {
            x_m: frame.x_m + local.x_m * cosine - local.y_m * sine,
            y_m: frame.y_m + local.x_m * sine + local.y_m * cosine,
            heading_rad: wrapped_rad(frame.heading_rad + local.heading_rad),
        }
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::{FRAC_PI_2, FRAC_PI_4, PI};

    use proptest::prelude::*;

    use super::*;

    /// Coordinates go to 100 m. Three frames in a row add up to 300 m, of which `f32` keeps 3e-5 m,
    /// and sine and cosine are right to 1e-7.
    const MOST_M: f32 = 3e-4;
    const MOST_RAD: f32 = 2e-6;

    fn frame(x_m: f32, y_m: f32, heading_rad: f32) -> Frame {
        Frame {
            x_m,
            y_m,
            heading_rad,
        }
    }

    fn frames() -> impl Strategy<Value = Frame> {
        (-100.0_f32..=100.0, -100.0_f32..=100.0, -PI..=PI)
            .prop_map(|(x_m, y_m, heading_rad)| frame(x_m, y_m, heading_rad))
    }

    #[track_caller]
    fn assert_near(found: Frame, expected: Frame) {
        let off_rad = wrapped_rad(found.heading_rad - expected.heading_rad);
        let is_near = (found.x_m - expected.x_m).abs() < MOST_M
            && (found.y_m - expected.y_m).abs() < MOST_M
            && off_rad.abs() < MOST_RAD
            && found.heading_rad.abs() <= PI;
        assert!(is_near, "{found:?}, not {expected:?}");
    }

    proptest! {
        #[test]
        fn frames_are_a_group(a in frames(), b in frames(), c in frames()) {
            assert_near(a.compose(b).compose(c), a.compose(b.compose(c)));
            assert_near(a.compose(Frame::START), a);
            assert_near(Frame::START.compose(a), a);
            assert_near(a.compose(a.inverse()), Frame::START);
            assert_near(a.inverse().compose(a), Frame::START);
            assert_near(a.compose(b).inverse(), b.inverse().compose(a.inverse()));
        }

        #[test]
        fn what_is_seen_from_a_frame_is_where_it_was(a in frames(), b in frames()) {
            assert_near(a.to_global(a.to_local(b)), b);
            assert_near(a.to_local(a.to_global(b)), b);
            assert_near(a.to_local(b), a.inverse().compose(b));
            assert_near(a.to_local(a), Frame::START);
        }

        #[test]
        fn a_frame_is_moved_and_turned_along_its_own_axes(a in frames(), b in frames()) {
            let moved = a.translate(b.x_m, b.y_m);
            assert_near(moved, a.compose(frame(b.x_m, b.y_m, 0.0)));
            assert_near(moved.rotate(b.heading_rad), a.compose(b));
            assert_near(a.rotate(b.heading_rad).rotate(-b.heading_rad), a);
        }
    }

    /// The laws hold in a mirror, too.
    #[test]
    fn frames_are_where_a_sketch_has_them() {
        let corner = frame(1.0, 2.0, FRAC_PI_2);
        for (found, expected) in [
            (
                corner.compose(frame(3.0, 4.0, FRAC_PI_4)),
                (-3.0, 5.0, 3.0 * FRAC_PI_4),
            ),
            (corner.compose(frame(0.0, 0.0, PI)), (1.0, 2.0, -FRAC_PI_2)),
            (corner.translate(0.5, 0.0), (1.0, 2.5, FRAC_PI_2)),
            (corner.translate(0.0, 0.5), (0.5, 2.0, FRAC_PI_2)),
            (corner.rotate(-FRAC_PI_2), (1.0, 2.0, 0.0)),
            (corner.inverse(), (-2.0, 1.0, -FRAC_PI_2)),
            (
                corner.to_local(frame(0.0, 2.0, 0.0)),
                (0.0, 1.0, -FRAC_PI_2),
            ),
        ] {
            let (x_m, y_m, heading_rad) = expected;
            assert_near(found, frame(x_m, y_m, heading_rad));
        }
    }
}
