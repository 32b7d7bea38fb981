//! Moves at reference speeds where there is room.

use super::law::{Behaviour, Control, Scene};
use super::list::BehaviourList;
use crate::behaviour;
use crate::declaration::Params;
use crate::tasks::{Bearings, Pose, Ranges, Sector, Twist};

/// So much room there must be on the side that the robot moves to, in metres.
const FREE_M: f32 = 0.2;

/// Follows reference speeds if there is room around: ahead or behind to drive, on both sides to
/// turn. It never ends by itself.
///
/// Source: Schoute, figure 4, `move_bhv`.
#[derive(Clone, Copy, Debug, Default)]
pub struct MoveLaw;

behaviour! {
    /// Behaviour: moves at its speeds where more than 0.2 m are free, until it is left or outside.
    impl Move runs MoveLaw {
        wcet 300 us;
        params {
            /// How fast ahead, in metres per second; negative is backwards.
            speed_m_per_s: f32 = 0.2, -0.5..=0.5;
            /// How fast to the left, in radians per second; negative is to the right.
            rate_rad_per_s: f32 = 0.0, -3.0..=3.0;
        }
    }
}

impl MoveLaw {
    /// The law, for these reference speeds.
    pub fn twist(asked: Twist, ranges: Option<&Ranges>) -> Twist {
        let is_free = |sector| ranges.is_some_and(|ranges| ranges.free_range(sector) > FREE_M);
        let mut twist = Twist::STILL;
        let speed = asked.forward_m_per_s;
        if speed > 0.0 && is_free(Sector::Front) || speed < 0.0 && is_free(Sector::Back) {
            twist.forward_m_per_s = speed;
        }
        if is_free(Sector::Left) && is_free(Sector::Right) {
            twist.turn_rad_per_s = asked.turn_rad_per_s;
        }
        twist
    }
}

impl Behaviour for MoveLaw {
    fn needs(&self, params: &Params) -> Bearings {
        Bearings::on_the_way(params.get(Move::SPEED_M_PER_S))
    }

    fn control(&mut self, scene: &Scene<'_>, params: &Params) -> Control {
        let asked = Twist {
            forward_m_per_s: params.get(Move::SPEED_M_PER_S),
            turn_rad_per_s: params.get(Move::RATE_RAD_PER_S),
        };
        Control::Move(Self::twist(asked, scene.ranges))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_drives_and_turns_where_there_is_room_as_figure_4_says() {
        let twist = |forward_m_per_s, turn_rad_per_s| Twist {
            forward_m_per_s,
            turn_rad_per_s,
        };
        // Sonars 0 and 4 look ahead and behind, 2 and 6 to the sides.
        for (sonar, range_m, asked, expected) in [
            (0, 0.21, twist(0.3, 0.5), twist(0.3, 0.5)),
            (0, 0.2, twist(0.3, 0.5), twist(0.0, 0.5)),
            (0, 0.2, twist(-0.3, 0.5), twist(-0.3, 0.5)),
            (4, 0.2, twist(-0.3, 0.5), twist(0.0, 0.5)),
            (4, 0.2, twist(0.3, 0.0), twist(0.3, 0.0)),
            (2, 0.2, twist(0.3, 0.5), twist(0.3, 0.0)),
            (6, 0.2, twist(0.3, -0.5), twist(0.3, 0.0)),
            (6, 0.0, twist(0.0, -0.5), twist(0.0, 0.0)),
        ] {
            let mut ranges = Ranges::FREE;
            ranges.range_m[sonar] = range_m;
            assert_eq!(
                MoveLaw::twist(asked, Some(&ranges)),
                expected,
                "{sonar} {asked:?}"
            );
        }
        assert_eq!(MoveLaw::twist(twist(0.3, 0.5), None), Twist::STILL);
    }
}
