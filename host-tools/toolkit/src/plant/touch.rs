//! Touches, and the oracle: whether a robot that obeys its stop distance could have avoided them.
//!
//! A wall is always there: who touches one could have avoided it. What is low no sonar hears: a
//! robot finds it by touching it, and no touch of it could have been avoided. A person steps in at
//! a time. What counts is how the robot moved then. Its *needed way* is what it drives on while it
//! reacts, and then until its brakes have stopped it, by the numbers of `SafetyCheck`. Its *free
//! way* is what is free along its movement, up to that person. Where the free way is no longer than
//! the needed way, no brakes help.
//!
//! That excuse ends when the robot has stood still for as long as it takes to react, for brakes may
//! swing through a standstill, or has driven more than the needed way: from
//! then on it has had its chance.

use rt_firmware::behaviours::situation::SafetyCheck;

use crate::world::Point;

use super::free_way::Movement;

/// What the body has touched.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Touched {
    /// A wall.
    Wall,
    /// Something that is too low for sonars.
    Low,
    /// A person.
    Person {
        /// The person's line of the world's file, from 1.
        line: usize,
    },
}

/// A touch of a wall or a person. It lasts until more than 5 mm are free around the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Touch {
    /// When it began, in microseconds of plant time.
    pub t_us: u64,
    /// Where the body's centre was.
    pub place: Point,
    /// What was touched.
    pub touched: Touched,
    /// Speed of the body's centre, in metres per second.
    pub speed_m_per_s: f64,
    /// How the robot moved when that person stepped in; none where what was touched had been there
    /// from the start.
    pub encounter: Option<Encounter>,
    /// Whether a robot that obeys its stop distance could have avoided it.
    pub avoidable: bool,
}

/// A person steps in while the robot moves, or stands.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Encounter {
    /// When, in microseconds of plant time.
    pub t_us: u64,
    /// Speed of the body's centre then, in metres per second.
    pub speed_m_per_s: f64,
    /// What was free along the robot's movement, up to that person, in metres; none where that
    /// person was not in the way.
    pub free_m: Option<f64>,
    /// The way of the reaction and of the brakes, in metres.
    pub needed_m: f64,
}

impl Encounter {
    /// What a person who steps in at `t_us` means for a robot that moves like this. `free_m` is the
    /// free way up to that person; none where that person is not in the way.
    pub(super) fn new(t_us: u64, movement: &Movement, free_m: Option<f64>) -> Self {
        let speed_m_per_s = movement.speed_m_per_s();
        Self {
            t_us,
            speed_m_per_s,
            free_m,
            needed_m: needed_m(speed_m_per_s),
        }
    }

    /// Whether no brakes would have helped.
    fn is_too_late(&self) -> bool {
        self.free_m.is_some_and(|free_m| free_m <= self.needed_m)
    }
}

const REACTION_S: f64 = SafetyCheck::REACTION_S as f64;
const BRAKE_M_PER_S2: f64 = SafetyCheck::BRAKE_M_PER_S2 as f64;

/// The way that a robot takes to stop, in metres: what `SafetyCheck` wants to be free, less the
/// clearance that is to be left.
fn needed_m(speed_m_per_s: f64) -> f64 {
    speed_m_per_s * REACTION_S + speed_m_per_s * speed_m_per_s / (2.0 * BRAKE_M_PER_S2)
}

/// All that have stepped in, and what of it counts still.
#[derive(Clone, Debug, Default)]
pub(super) struct Oracle {
    met: Vec<Met>,
}

#[derive(Clone, Copy, Debug)]
struct Met {
    line: usize,
    encounter: Encounter,
    /// Way of the body since the start, in metres, when it happened.
    driven_m: f64,
    /// How long the robot has stood still since, at one time, in seconds; it stays where that is
    /// the time of its reaction.
    stood_s: f64,
}

impl Met {
    /// The robot has stood still since.
    fn has_stood(&self) -> bool {
        self.stood_s >= REACTION_S
    }
}

impl Oracle {
    /// The person of this line has stepped in; the body has driven so far, in metres.
    pub fn steps_in(&mut self, line: usize, encounter: Encounter, driven_m: f64) {
        // A person steps in once.
        self.met.push(Met {
            line,
            encounter,
            driven_m,
            stood_s: 0.0,
        });
    }

    /// The robot stands still, or moves, for so long.
    pub fn passes(&mut self, is_still: bool, time_s: f64) {
        for met in &mut self.met {
            if !met.has_stood() {
                met.stood_s = if is_still { met.stood_s + time_s } else { 0.0 };
            }
        }
    }

    /// The body, which has driven so far in metres, touches something.
    pub fn judge(
        &self,
        t_us: u64,
        place: Point,
        touched: Touched,
        speed_m_per_s: f64,
        driven_m: f64,
    ) -> Touch {
        let met = match touched {
            Touched::Wall | Touched::Low => None,
            Touched::Person { line } => self.met.iter().find(|met| met.line == line),
        };
        let is_excused = met.is_some_and(|met| {
            let is_in_time = driven_m - met.driven_m <= met.encounter.needed_m;
            met.encounter.is_too_late() && !met.has_stood() && is_in_time
        });
        Touch {
            t_us,
            place,
            touched,
            speed_m_per_s,
            encounter: met.map(|met| met.encounter),
            avoidable: !is_excused && touched != Touched::Low,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::pose::BodyPose;
    use super::*;

    #[test]
    fn the_needed_way_is_the_stop_distance_less_the_clearance() {
        for speed_m_per_s in [0.0, 0.1, 0.3, 0.6] {
            let stop_m = SafetyCheck::stop_distance_m(speed_m_per_s as f32);
            let expected_m = f64::from(stop_m - SafetyCheck::CLEARANCE_M);
            let way_m = needed_m(speed_m_per_s);
            assert!((way_m - expected_m).abs() < 1e-6, "{way_m}");
        }
    }

    #[test]
    fn a_person_who_steps_in_too_near_is_an_excuse_until_the_robot_has_had_its_chance() {
        /// Needed at 0.3 m/s: 0.06 m to react and 0.05625 m to brake.
        const NEEDED_M: f64 = 0.116_25;
        for (what, free_m, driven_m, stood_s, avoidable) in [
            ("too near", Some(0.1), 0.1, 0.0, false),
            (
                "just too near",
                Some(NEEDED_M - 1e-6),
                NEEDED_M - 1e-6,
                0.0,
                false,
            ),
            (
                "far enough",
                Some(NEEDED_M + 1e-6),
                NEEDED_M + 1e-6,
                0.0,
                true,
            ),
            ("not in the way, then steered into", None, 0.05, 0.0, true),
            (
                "missed at first, then driven into",
                Some(0.1),
                2.0,
                0.0,
                true,
            ),
            ("stood before, and drove on", Some(0.1), 0.1, 0.21, true),
            ("swung through a standstill", Some(0.1), 0.1, 0.1, false),
        ] {
            let movement = Movement {
                pose: BodyPose::default(),
                way_m_per_s: 0.3,
                turn_rad_per_s: 0.0,
            };
            let encounter = Encounter::new(1_000, &movement, free_m);
            assert!(
                (encounter.needed_m - NEEDED_M).abs() < 1e-7,
                "{encounter:?}"
            );
            let mut oracle = Oracle::default();
            oracle.steps_in(4, encounter, 5.0);
            // Two times that are each too short, with a movement between, are none.
            for (is_still, time_s) in [(true, 0.15), (false, 0.01), (true, stood_s)] {
                oracle.passes(is_still, time_s);
            }
            let judge =
                |touched| oracle.judge(2_000, Point::default(), touched, 0.3, 5.0 + driven_m);
            let touch = judge(Touched::Person { line: 4 });
            assert_eq!(touch.avoidable, avoidable, "{what}");
            assert_eq!(touch.encounter, Some(encounter), "{what}");
            let low = judge(Touched::Low);
            assert!(!low.avoidable && low.encounter.is_none(), "{low:?}");
            for touched in [Touched::Wall, Touched::Person { line: 5 }] {
                let touch = judge(touched);
                assert!(touch.avoidable && touch.encounter.is_none(), "{touch:?}");
            }
        }
    }
}
