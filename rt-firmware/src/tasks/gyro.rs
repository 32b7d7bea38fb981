//! Measures how fast the robot turns.

use embedded_hal::i2c::I2c;

use super::values::{WheelSpeeds, YawRate};
use crate::drivers::{RAD_PER_S_PER_COUNT, WAKES_IN_US, YawGyro};
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// How long the wheels must have stood until the robot counts as one that stands, in microseconds:
/// it may swing a little when it stops.
const STANDS_AFTER_US: u32 = 300_000;

/// Readings of a robot that stands until its bias is known: half a second, in a slot of 10 ms.
/// Their mean is within 0.01 °/s then, of which 0.6° are made in a minute.
const READINGS_OF_BIAS: u16 = 50;

/// The bias is the mean of so many readings at most; later ones count as one of so many, so that it
/// follows the temperature within some seconds.
const MOST_READINGS: u16 = 256;

/// No bias is larger, in counts: 10 °/s, three times what the data sheet gives. Who is turned
/// faster while the wheels stand does not stand.
const LARGEST_BIAS_COUNTS: f32 = 1_312.0;

/// A robot that stands reads as its bias, to so many counts: 2 °/s, thirty times the noise.
const STANDING_COUNTS: f32 = 262.0;

/// A gyroscope that reads the same so often hangs: its noise is some counts. A second, in a slot of
/// 10 ms.
const HANGS_AFTER: u8 = 100;

/// Reads a gyroscope. What it reads while the robot stands is its bias, which is taken off; before
/// that is known, and while the gyroscope does not answer, there is no rate.
///
/// The bias belongs to the sensor, not to a mission: it is kept when missions are swapped.
#[derive(Debug)]
pub struct Gyro<B> {
    /// None where the robot has no gyroscope.
    sensor: Option<YawGyro<B>>,
    state: Sensor,
    bias: Bias,
    /// The last reading, and how often in a row it was the same.
    last: i16,
    same: u8,
    /// Rates so far; wraps.
    count: u8,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Sensor {
    /// To be woken.
    Asleep,
    /// It measures in so many microseconds.
    Wakes(u32),
    Measures,
}

task! {
    /// Measures with a gyroscope how fast the robot turns. Let it stand for a second and a half
    /// first: what it reads then is its bias.
    impl[B: I2c + Send] Gyro<B> {
        slot 2;
        wcet 800 us;
        endless;
        data {
            /// How fast the wheels roll. While they stand, the bias is measured.
            in speeds: WheelSpeeds optional within 100 ms;
            /// How fast the robot turns.
            out yaw_rate: YawRate;
        }
        flags {
            /// The gyroscope does not answer, or always says the same.
            out faulty;
        }
        params {
            /// What its rate is to be multiplied with: as many turns as it made by those measured.
            scale: f32 = 1.0, 0.9..=1.1;
        }
    }
}

/// What a gyroscope reads that stands.
#[derive(Clone, Copy, Debug)]
struct Bias {
    counts: f32,
    readings: u16,
    stands_us: u32,
}

impl Bias {
    const UNKNOWN: Self = Self {
        counts: 0.0,
        readings: 0,
        stands_us: 0,
    };

    /// It, if it is known.
    fn known(&self) -> Option<f32> {
        (self.readings >= READINGS_OF_BIAS).then_some(self.counts)
    }

    /// A reading, after which the wheels stand still or do not.
    fn take(&mut self, counts: f32, wheels_stand: bool, passed_us: u32) {
        let is_still = match self.known() {
            Some(bias) => (counts - bias).abs() < STANDING_COUNTS,
            None => counts.abs() < LARGEST_BIAS_COUNTS,
        };
        if !wheels_stand || !is_still {
            self.stands_us = 0;
            if self.known().is_none() {
                self.readings = 0;
            }
            return;
        }
        self.stands_us = self.stands_us.saturating_add(passed_us);
        if self.stands_us < STANDS_AFTER_US {
            return;
        }
        self.readings = (self.readings + 1).min(MOST_READINGS);
        self.counts += (counts - self.counts) / f32::from(self.readings);
    }
}

impl<B: I2c> Gyro<B> {
    /// The gyroscope at this bus; none where the robot has none, which is a fault.
    pub fn new(bus: Option<B>) -> Self {
        Self {
            sensor: bus.map(YawGyro::new),
            state: Sensor::Asleep,
            bias: Bias::UNKNOWN,
            last: 0,
            same: 0,
            count: 0,
        }
    }

    /// What it reads; none while it does not measure. It is woken where it sleeps, and where it
    /// hangs. The flag says whether it is at fault.
    fn read(&mut self, passed_us: u32) -> (Option<i16>, bool) {
        let Some(sensor) = &mut self.sensor else {
            return (None, true);
        };
        match self.state {
            Sensor::Asleep => match sensor.wake() {
                Ok(()) => self.state = Sensor::Wakes(WAKES_IN_US),
                Err(_) => return (None, true),
            },
            Sensor::Wakes(in_us) => {
                self.state = match in_us.checked_sub(passed_us) {
                    Some(in_us) => Sensor::Wakes(in_us),
                    None => Sensor::Measures,
                };
            }
            Sensor::Measures => {
                let Ok(counts) = sensor.counts() else {
                    self.state = Sensor::Asleep;
                    return (None, true);
                };
                let is_same = counts == self.last;
                self.same = if is_same {
                    self.same.saturating_add(1)
                } else {
                    0
                };
                self.last = counts;
                if self.same < HANGS_AFTER {
                    return (Some(counts), false);
                }
                // It has another reading to hang at once it is woken.
                self.state = Sensor::Asleep;
            }
        }
        (None, self.same >= HANGS_AFTER)
    }
}

impl<B: I2c + Send> Task for Gyro<B> {
    fn enter(&mut self) {
        self.bias.stands_us = 0;
    }

    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let (counts, is_faulty) = self.read(io.period_us());
        io.set(Self::FAULTY, is_faulty);
        let Some(counts) = counts.map(f32::from) else {
            return Step::Run;
        };
        let speeds = io.try_read(Self::SPEEDS);
        let wheels_stand =
            speeds.is_some_and(|it| it.left_m_per_s == 0.0 && it.right_m_per_s == 0.0);
        self.bias.take(counts, wheels_stand, io.period_us());
        if let Some(bias) = self.bias.known() {
            let rate_rad_per_s = (counts - bias) * RAD_PER_S_PER_COUNT;
            let scale = io.param(Self::SCALE);
            self.count = self.count.wrapping_add(1);
            *io.write(Self::YAW_RATE) = YawRate {
                yaw_rate_rad_per_s: rate_rad_per_s * scale,
                count: self.count,
            };
        }
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;
    use crate::body::{ImuBus, PinImage, Sensors};

    type Task<'a> = Gyro<ImuBus<'a>>;

    const STILL: WheelSpeeds = WheelSpeeds {
        left_m_per_s: 0.0,
        right_m_per_s: 0.0,
    };
    const ROLLS: WheelSpeeds = WheelSpeeds {
        left_m_per_s: -0.1,
        right_m_per_s: 0.1,
    };

    struct Rig<'a> {
        pins: &'a PinImage,
        bench: TaskBench<'a>,
        steps: i16,
    }

    impl<'a> Rig<'a> {
        fn new(pins: &'a PinImage) -> Self {
            let mut bench = TaskBench::new(Task::new(Some(pins.parts().imu)));
            bench.period_us(20_000).param(Task::SCALE, 1.0);
            Self {
                pins,
                bench,
                steps: 0,
            }
        }

        /// So many steps with these counts, and a noise of a count.
        fn steps(&mut self, steps: u32, yaw_counts: i16, speeds: WheelSpeeds) -> &mut Self {
            for _ in 0..steps {
                self.steps += 1;
                self.pins.set_sensors(&Sensors {
                    yaw_counts: yaw_counts + self.steps % 2,
                    ..Sensors::default()
                });
                self.bench.give(Task::SPEEDS, speeds).step();
            }
            self
        }

        fn rate_deg_per_s(&self) -> Option<f32> {
            let rate = self.bench.output(Task::YAW_RATE)?;
            Some(rate.yaw_rate_rad_per_s.to_degrees())
        }
    }

    #[test]
    fn what_it_reads_while_the_robot_stands_is_its_bias() {
        let pins = PinImage::new();
        let mut rig = Rig::new(&pins);
        // It wakes for 5 steps, 15 are too early, 50 make the bias.
        rig.steps(68, 400, STILL);
        assert_eq!(rig.rate_deg_per_s(), None);
        rig.steps(4, 400, STILL);
        assert!(rig.rate_deg_per_s().expect("a rate").abs() < 0.02);
        rig.steps(10, 400 + 1_312, ROLLS);
        let rate = rig.rate_deg_per_s().expect("a rate");
        assert!((rate - 10.0).abs() < 0.02, "{rate}");
        rig.bench.param(Task::SCALE, 0.99);
        rig.steps(1, 400 + 1_312, ROLLS);
        let rate = rig.rate_deg_per_s().expect("a rate");
        assert!((rate - 9.9).abs() < 0.02, "{rate}");
        assert!(!rig.bench.flag(Task::FAULTY));
    }

    #[test]
    fn the_bias_follows_while_the_robot_stands_and_not_while_somebody_turns_it() {
        let pins = PinImage::new();
        let mut rig = Rig::new(&pins);
        rig.steps(100, 100, STILL).steps(1_500, 140, STILL);
        assert!(rig.rate_deg_per_s().expect("a rate").abs() < 0.02);
        // By hand, with standing wheels: a rate, and no bias.
        rig.steps(1_500, 140 + 656, STILL);
        let rate = rig.rate_deg_per_s().expect("a rate");
        assert!((rate - 5.0).abs() < 0.02, "{rate}");
        // Driving straight on neither.
        rig.steps(1_500, 200, ROLLS).steps(1, 140, ROLLS);
        assert!(rig.rate_deg_per_s().expect("a rate").abs() < 0.02);
    }

    #[test]
    fn nobody_who_turns_from_the_start_has_a_bias() {
        let pins = PinImage::new();
        let mut rig = Rig::new(&pins);
        rig.steps(500, 2_000, STILL).steps(500, 100, ROLLS);
        assert_eq!(rig.rate_deg_per_s(), None);
        rig.bench.take_away(Task::SPEEDS);
        for _ in 0..200 {
            rig.bench.step();
        }
        assert_eq!(rig.rate_deg_per_s(), None, "nobody knows that it stands");
    }

    #[test]
    fn one_that_always_says_the_same_is_faulty_until_it_says_something_else() {
        let pins = PinImage::new();
        let mut rig = Rig::new(&pins);
        rig.steps(100, 50, STILL);
        assert!(!rig.bench.flag(Task::FAULTY));
        pins.set_sensors(&Sensors {
            yaw_counts: 77,
            ..Sensors::default()
        });
        for step in 0..400 {
            rig.bench.step();
            let expected = step >= i32::from(HANGS_AFTER);
            assert_eq!(rig.bench.flag(Task::FAULTY), expected, "{step}");
        }
        rig.steps(20, 50, STILL);
        assert!(!rig.bench.flag(Task::FAULTY));
        // No gyroscope at all.
        let mut bench = TaskBench::new(Task::new(None));
        bench.step();
        assert!(bench.flag(Task::FAULTY));
        assert!(bench.output(Task::YAW_RATE).is_none());
    }
}
