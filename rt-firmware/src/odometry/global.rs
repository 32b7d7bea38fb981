//! The global frame: where the robot is as it was told, beside where its wheels have taken it.

use super::frame::{Frame, LocalFrame, Pose};
use esm_link::position::{Correction, MAX_POSITION_M};

/// A correction is no number, or beyond its [bounds](esm_link::position).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OutsideBounds;

/// Where the frame in which odometry counts lies in the global frame.
///
/// A correction moves that, and not what odometry counts: whoever goes by odometry's pose, as all
/// behaviours do with their local frames, does not notice it.
///
/// Source: Schoute, "Behaviour-based control framework for an autonomous mobile robot", section 4:
/// `set_position` and `set_diff_position`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GlobalFrame(LocalFrame);

impl Default for GlobalFrame {
    fn default() -> Self {
        Self::START
    }
}

impl GlobalFrame {
    /// The origin is where the robot was switched on, which nobody has corrected.
    pub const START: Self = Self(LocalFrame::START);

    /// Where the robot is in the global frame, if odometry counts that it is there.
    pub fn pose(&self, counted: Pose) -> Pose {
        self.0.to_global(counted)
    }

    /// The robot is there ([`Correction::Set`]), or so far from where it was believed to be, seen
    /// from there ([`Correction::Difference`]), while odometry counts that it is at `counted`.
    ///
    /// # Errors
    /// [`OutsideBounds`], also where a difference would take it farther from the origin than a
    /// position may be. Then nothing has changed.
    pub fn correct(
        &mut self,
        counted: Pose,
        correction: Correction,
        by: Frame,
    ) -> Result<(), OutsideBounds> {
        if !correction.allows(by.x_m, by.y_m, by.heading_rad) {
            return Err(OutsideBounds);
        }
        let pose = match correction {
            // The greatest heading is half a turn, rounded up.
            Correction::Set => Pose {
                heading_rad: 0.0,
                ..by
            }
            .rotate(by.heading_rad),
            Correction::Difference => self.pose(counted).compose(by),
        };
        if pose.x_m.abs().max(pose.y_m.abs()) > MAX_POSITION_M {
            return Err(OutsideBounds);
        }
        self.0 = LocalFrame::from(pose.compose(counted.inverse()));
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use core::f32::consts::{FRAC_PI_2, PI};

    use proptest::prelude::*;

    use super::*;
    use crate::odometry::wrapped_rad;

    /// What `f32` keeps of a kilometre.
    const MOST_M: f32 = 1e-3;
    const MOST_RAD: f32 = 2e-6;

    fn pose(x_m: f32, y_m: f32, heading_rad: f32) -> Pose {
        Pose {
            x_m,
            y_m,
            heading_rad,
        }
    }

    fn is_near(found: Pose, expected: Pose) -> bool {
        (found.x_m - expected.x_m).abs() < MOST_M
            && (found.y_m - expected.y_m).abs() < MOST_M
            && wrapped_rad(found.heading_rad - expected.heading_rad).abs() < MOST_RAD
    }

    fn poses(most_m: f32, most_rad: f32) -> impl Strategy<Value = Pose> {
        (-most_m..=most_m, -most_m..=most_m, -most_rad..=most_rad)
            .prop_map(|(x_m, y_m, heading_rad)| pose(x_m, y_m, heading_rad))
    }

    #[test]
    fn as_long_as_nobody_corrects_it_is_what_odometry_counts_to_the_bit() {
        let counted = pose(1.234, -5.678, 0.9);
        assert_eq!(GlobalFrame::START.pose(counted), counted);
    }

    #[test]
    fn a_robot_that_was_told_where_it_is_counts_on_from_there() {
        let mut global = GlobalFrame::START;
        let counted = pose(3.0, 0.0, 0.0);
        let told = pose(10.0, 20.0, FRAC_PI_2);
        assert_eq!(global.correct(counted, Correction::Set, told), Ok(()));
        assert!(is_near(global.pose(counted), told));
        // A metre ahead, and a quarter to the left.
        let after = pose(4.0, 0.0, FRAC_PI_2);
        assert!(is_near(global.pose(after), pose(10.0, 21.0, PI)));
        // It is 0.1 m farther ahead than it believes: it looks along -x by now.
        let ahead = pose(0.1, 0.0, 0.0);
        assert_eq!(global.correct(after, Correction::Difference, ahead), Ok(()));
        assert!(is_near(global.pose(after), pose(9.9, 21.0, PI)));
    }

    #[test]
    fn what_is_refused_changes_nothing() {
        let mut global = GlobalFrame::START;
        let edge = pose(999.5, 0.0, 0.0);
        assert_eq!(global.correct(Pose::START, Correction::Set, edge), Ok(()));
        for (correction, by) in [
            (Correction::Set, pose(1_001.0, 0.0, 0.0)),
            (Correction::Set, pose(0.0, f32::NAN, 0.0)),
            (Correction::Set, pose(0.0, 0.0, f32::INFINITY)),
            (Correction::Difference, pose(-1.1, 0.0, 0.0)),
            (Correction::Difference, pose(0.0, 0.0, 0.7)),
            // Within its own bounds, and beyond those of a position.
            (Correction::Difference, pose(0.9, 0.0, 0.0)),
        ] {
            let before = global;
            let refused = global.correct(Pose::START, correction, by);
            assert_eq!(refused, Err(OutsideBounds), "{by:?}");
            assert_eq!(global, before);
        }
    }

    proptest! {
        #[test]
        fn corrections_take_the_robot_where_they_say(
            counted in poses(100.0, PI),
            told in poses(900.0, 3.15),
            by in poses(1.0, 0.6),
            moved in poses(1.0, PI),
        ) {
            let mut global = GlobalFrame::START;
            prop_assert_eq!(global.correct(counted, Correction::Set, told), Ok(()));
            prop_assert!(is_near(global.pose(counted), told));
            let corrected = global.pose(counted).compose(by);
            prop_assert_eq!(global.correct(counted, Correction::Difference, by), Ok(()));
            prop_assert!(is_near(global.pose(counted), corrected));
            // The robot moves as it did before.
            let after = global.pose(counted.compose(moved));
            prop_assert!(is_near(after, corrected.compose(moved)));
        }
    }
}
