//! A pose as the flight recorder keeps it.

use super::frame::Pose;
use esm_link::black_box::{Event, PoseFrame};

/// Where the robot is: two events, for one has no room for it.
pub(crate) fn pose_events(pose: &Pose, frame: PoseFrame) -> [Event; 2] {
    const PER_M: f32 = 1_000.0;
    // Rounded to the nearest; too large a number becomes the greatest one, and no number 0.
    let thousandths = |value: f32| {
        let scaled = value * PER_M;
        (scaled + 0.5_f32.copysign(scaled)) as i32
    };
    [
        Event::PoseX {
            x_mm: thousandths(pose.x_m),
            heading_mrad: thousandths(pose.heading_rad) as i16,
        },
        Event::PoseY {
            y_mm: thousandths(pose.y_m),
            frame,
        },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_is_told_to_the_millimetre() {
        let pose = Pose {
            x_m: -1.234_6,
            y_m: 999.999_9,
            heading_rad: -2.999_7,
        };
        let expected = [
            Event::PoseX {
                x_mm: -1_235,
                heading_mrad: -3_000,
            },
            Event::PoseY {
                y_mm: 1_000_000,
                frame: PoseFrame::Counted,
            },
        ];
        assert_eq!(pose_events(&pose, PoseFrame::Counted), expected);
    }
}
