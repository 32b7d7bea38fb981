//! Tells what the robot touches.

use embedded_hal::digital::InputPin;

use super::values::{Bearing, Contact, Ranges};
use crate::body::BUMPERS;
use crate::drivers::Bumper;
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Looks at the switches of two bumpers, on the left and on the right of the body's front, which
/// both give way where something is straight ahead.
///
/// It passes the ranges on, and where a bumper is touched there is no free way any more, whatever
/// the sonars say: ahead and half left, or half right. Who looks at these ranges before moving, as
/// each behaviour's SAFETY_CHECK does, does not push on, and may back off.
#[derive(Debug)]
pub struct Bumpers<P> {
    /// None where the robot has no bumpers: nothing is known of them then.
    bumpers: Option<[Bumper<P>; BUMPERS]>,
}

task! {
    /// Tells what the robot touches with its bumpers, and passes the ranges on with it: where it
    /// touches something there is no free way.
    impl[P: InputPin + Send] Bumpers<P> {
        slot 2;
        wcet 100 us;
        endless;
        monitor;
        data {
            /// What the sonars see.
            in ranges: Ranges optional within 100 ms;
            /// What it touches.
            out contact: Contact;
            /// What the sonars see and the bumpers feel.
            out felt: Ranges;
        }
        flags {
            /// It touches something.
            out touched;
            /// It touches something with the left bumper.
            out left;
            /// It touches something with the right bumper.
            out right;
        }
    }
}

impl<P: InputPin> Bumpers<P> {
    /// Bumpers whose switches are at these inputs, left and right. Where there are none, all are
    /// taken for touched.
    pub fn new(pins: Option<[P; BUMPERS]>) -> Self {
        Self {
            bumpers: pins.map(|pins| pins.map(Bumper::new)),
        }
    }
}

impl<P: InputPin + Send> Task for Bumpers<P> {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let passed_us = io.period_us();
        let touched = match &mut self.bumpers {
            Some(bumpers) => bumpers.each_mut().map(|it| it.is_touched(passed_us)),
            None => [true; BUMPERS],
        };
        let [left, right] = touched;
        io.set(Self::TOUCHED, left || right);
        io.set(Self::LEFT, left);
        io.set(Self::RIGHT, right);
        *io.write(Self::CONTACT) = Contact { left, right };
        let ranges = io.try_read(Self::RANGES).copied();
        if let Some(mut felt) = ranges {
            for (is_touched, bearing) in [
                (left || right, Bearing::Ahead),
                (left, Bearing::AheadLeft),
                (right, Bearing::AheadRight),
            ] {
                if is_touched {
                    felt.touch(bearing);
                }
            }
            *io.write(Self::FELT) = felt;
        }
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::behaviours::situation::SafetyCheck;
    use crate::body::{InPin, PinImage, Sensors};
    use crate::tasks::Twist;

    type Task<'a> = Bumpers<InPin<'a>>;

    fn is_free(forward_m_per_s: f32, felt: &Ranges) -> bool {
        let twist = Twist {
            forward_m_per_s,
            turn_rad_per_s: 0.0,
        };
        SafetyCheck::is_free(&twist, Some(felt))
    }

    #[test]
    fn what_is_touched_is_no_free_way_and_backing_off_is_allowed() {
        let pins = PinImage::new();
        let mut bench = TaskBench::new(Task::new(Some(pins.parts().bumpers)));
        bench.period_us(20_000).give(Task::RANGES, Ranges::FREE);
        for bumper_is_low in [[false, false], [true, false], [false, true], [true, true]] {
            pins.set_sensors(&Sensors {
                bumper_is_low,
                ..Sensors::default()
            });
            // What was touched before has come to rest by then.
            bench.step();
            bench.step();
            bench.step();
            let [left, right] = bumper_is_low;
            let touched = left || right;
            assert_eq!(bench.flag(Task::TOUCHED), touched);
            assert_eq!(
                (bench.flag(Task::LEFT), bench.flag(Task::RIGHT)),
                (left, right)
            );
            assert_eq!(bench.output(Task::CONTACT), Some(Contact { left, right }));
            let felt = bench.output(Task::FELT).expect("ranges");
            assert_eq!(is_free(0.1, &felt), !touched, "{felt:?}");
            assert!(is_free(-0.3, &felt), "{felt:?}");
            let free = |bearing| felt.free_m(bearing) == Ranges::FAR_M;
            assert_eq!(free(Bearing::Ahead), !touched);
            assert_eq!(
                (free(Bearing::AheadLeft), free(Bearing::AheadRight)),
                (!left, !right)
            );
            assert!(free(Bearing::Left) && free(Bearing::Right));
        }
    }

    #[test]
    fn without_ranges_it_passes_none_on_and_without_bumpers_all_is_touched() {
        let pins = PinImage::new();
        let mut bench = TaskBench::new(Task::new(Some(pins.parts().bumpers)));
        bench.step();
        assert!(bench.output(Task::FELT).is_none());
        assert!(!bench.flag(Task::TOUCHED));
        let mut bench = TaskBench::new(Task::new(None));
        bench.give(Task::RANGES, Ranges::FREE).step();
        assert!(bench.flag(Task::TOUCHED));
        assert!(!is_free(0.1, &bench.output(Task::FELT).expect("ranges")));
    }
}
