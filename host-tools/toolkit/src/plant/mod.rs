//! The plant: a simulated robot's body in a [`World`], seen through its pins.
//!
//! Differential drive with lagging, unequal motors and slipping wheels, encoders, a ring of sonars,
//! a sagging battery, walls and people that stop the body, bumpers on the left and on the right of
//! its front, a gyroscope with bias, scale error and noise, sensors that tell a dark line from a
//! light floor.
//! Emulated board and host board drive this same model, by the messages of `rt_firmware::body`.
//!
//! **Deterministic to the bit.** Time is an integer; integration steps begin at fixed instants
//! whatever the calls; all functions come from `libm`; noise is a function of seed, source and
//! index. What actuators a plant gets when, and its seed, decide all that it ever answers.
//!
//! Its ADC inputs, of which 1 to 3 are for a user's own drivers:
//!
//! | ADC input | reads |
//! |---|---|
//! | 0 | the battery through its divider |
//! | 1 | a contact all around: full scale while the body touches a wall or a person, else 0 |
//! | 2 | the current that the battery gives, full scale at 4 A |
//! | 3 | auxiliary output 0 looped back: full scale while it is high, else 0 |
//! | 4, 5, 6 | the floor's darkness under the left, middle and right line sensor |

pub mod behind_pins;
mod drive;
mod floor;
mod free_way;
mod gyro;
mod noise;
mod obstacles;
mod parameters;
mod pose;
mod recorded;
mod sonar;
mod statistics;
mod touch;
pub mod variation;
mod wiring;

use rt_firmware::body::{
    ADC_FULL_SCALE, ANALOG_CHANNELS, Actuators, FULL_DUTY, Reply, Request, SONARS, Sensors,
};

pub use drive::WheelSide;
pub use noise::{Noise, Source};
pub use parameters::{
    BatteryParameters, BodyParameters, FloorParameters, GripParameters, GyroParameters,
    MotorParameters, SLIP_WINDOW_MS, SonarParameters,
};
pub use pose::BodyPose;
pub use recorded::{RecordedRanges, TableError};
pub use sonar::{PATIENCE_US, Pulse, SonarFault};
pub use statistics::{PathSample, Statistics};
pub use touch::{Encounter, Touch, Touched};
pub use wiring::WiringFault;

use crate::world::{Person, Segment, World};
use drive::{Drive, STEP_US};
use gyro::Gyro;
use obstacles::Obstacles;
use recorded::Feed;
use sonar::Sonars;
use wiring::Wiring;

/// The farthest that one call may advance a plant, in microseconds. A request for more (only a
/// broken board sends one) advances by this.
pub const ADVANCE_LIMIT_US: u64 = 60_000_000;

/// Battery current at the ADC's full scale, in amperes.
const CURRENT_FULL_SCALE_A: f64 = 4.0;

/// Why a plant cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum PlantError {
    /// The robot would stand in a wall.
    #[error(
        "the robot does not fit at the start of world `{world}`: the nearest wall is {distance_m:.3} m from its centre, \
         its radius is {radius_m:.3} m; move `start` away from the walls"
    )]
    StartInWall {
        /// The world's name.
        world: String,
        /// Distance from the start to the nearest wall, in metres.
        distance_m: f64,
        /// The body's radius, in metres.
        radius_m: f64,
    },
    /// A person would stand where the robot starts.
    #[error(
        "the robot does not fit at the start of world `{world}`: the person of line {line} is {distance_m:.3} m from \
         its centre, its radius is {radius_m:.3} m; move the person, or let the person come later, as in `from 5 s`"
    )]
    StartInPerson {
        /// The world's name.
        world: String,
        /// The person's line of the file, from 1.
        line: usize,
        /// Distance from the start to the person, in metres; 0 inside.
        distance_m: f64,
        /// The body's radius, in metres.
        radius_m: f64,
    },
}

/// A robot's body in a world.
///
/// ```
/// use esm_toolkit::{plant::{BodyParameters, Plant}, world::World};
/// use rt_firmware::body::{Actuators, Request};
///
/// let world = World::parse("world cell\n start 1,1 0\n wall 0,0 3,0 3,3 0,3 0,0").unwrap();
/// let mut plant = Plant::new(world, BodyParameters::default(), 1).unwrap();
/// let forwards = Actuators { left_duty: 300, right_duty: 300, ..Actuators::default() };
/// let first = plant.exchange(&Request { sequence: 0, start_us: 0, effect_us: 0, actuators: forwards });
/// let later = plant.exchange(&Request { sequence: 1, start_us: 500_000, effect_us: 1_000, actuators: forwards });
/// assert!(later.sensors.left_count > first.sensors.left_count);
/// ```
#[derive(Clone, Debug)]
pub struct Plant {
    world: World,
    body: BodyParameters,
    noise: Noise,
    drive: Drive,
    sonars: Sonars,
    gyro: Gyro,
    wiring: Wiring,
    aux_outputs: u8,
    now_us: u64,
    statistics: Statistics,
}

impl Plant {
    /// A plant at time 0, standing at the world's start. Runs with equal `seed` and actuators are
    /// equal.
    pub fn new(world: World, body: BodyParameters, seed: u64) -> Result<Self, PlantError> {
        let pose = BodyPose {
            position: world.start.position,
            heading_rad: world.start.heading_deg * core::f64::consts::PI / 180.0,
        };
        let obstacles = Obstacles::new(&world);
        let walls_m = obstacles.distance_to_walls_m(pose.position);
        let distance_m = walls_m.min(obstacles.distance_to_low_m(pose.position));
        if distance_m < body.radius_m {
            return Err(PlantError::StartInWall {
                world: world.name,
                distance_m,
                radius_m: body.radius_m,
            });
        }
        for person in obstacles.people() {
            let distance_m = person.circle.distance_m(pose.position).max(0.0);
            if distance_m < body.radius_m {
                return Err(PlantError::StartInPerson {
                    world: world.name,
                    line: person.line,
                    distance_m,
                    radius_m: body.radius_m,
                });
            }
        }
        let drive = Drive::new(body, obstacles, pose);
        let mut statistics = Statistics::default();
        statistics.sample(0, pose, &world);
        Ok(Self {
            world,
            body,
            noise: Noise::new(seed),
            drive,
            sonars: Sonars::new(body.sonar),
            gyro: Gyro::new(body.gyro, pose.heading_rad),
            wiring: Wiring::default(),
            aux_outputs: 0,
            now_us: 0,
            statistics,
        })
    }

    /// Lets time pass until `time_us`, in microseconds of plant time; a time that has passed
    /// changes nothing. Body and people move in whole milliseconds: in between they are where they
    /// were at the last one.
    pub fn advance_to(&mut self, time_us: u64) {
        let time_us = time_us.min(self.now_us.saturating_add(ADVANCE_LIMIT_US));
        if time_us <= self.now_us {
            return;
        }
        for step in self.now_us / STEP_US..time_us / STEP_US {
            if let Some(touch) = self.drive.step(step, &self.noise) {
                self.statistics.add_touch(touch);
            }
            let end_us = (step + 1) * STEP_US;
            if end_us.is_multiple_of(gyro::PERIOD_US) {
                let heading_rad = self.drive.pose.heading_rad;
                self.gyro.measure(end_us, heading_rad, &self.noise);
            }
            if end_us.is_multiple_of(Statistics::SAMPLE_PERIOD_US) {
                self.statistics.sample(end_us, self.drive.pose, &self.world);
            }
        }
        self.now_us = time_us;
    }

    /// Puts new levels on the body's inputs, from now on.
    pub fn apply(&mut self, actuators: &Actuators) {
        let share = |duty: i16| (f64::from(duty) / f64::from(FULL_DUTY)).clamp(-1.0, 1.0);
        let duties = [actuators.left_duty, actuators.right_duty].map(share);
        [self.drive.left.duty, self.drive.right.duty] = self.wiring.duties(duties);
        self.aux_outputs = actuators.aux_outputs;
        let Drive {
            pose, obstacles, ..
        } = &self.drive;
        (self.sonars).trigger(actuators, self.now_us, *pose, obstacles, &self.noise);
    }

    /// Breaks a sonar, counted counter-clockwise from the one that looks ahead, from its next ping
    /// on.
    pub fn break_sonar(&mut self, sonar: usize, fault: SonarFault) {
        self.sonars.break_sonar(sonar, fault);
    }

    /// Wires something of the body as it should not be, from now on.
    pub fn miswire(&mut self, fault: WiringFault) {
        self.wiring.add(fault);
    }

    /// How far the wheels have turned forwards since the start, left and right, in radians.
    pub fn wheels_turned_rad(&self) -> [f64; 2] {
        [self.drive.left.angle_rad(), self.drive.right.angle_rad()]
    }

    /// Lets something hold a wheel from now on.
    pub fn stick_wheel(&mut self, side: WheelSide) {
        match side {
            WheelSide::Left => self.drive.left.stick(),
            WheelSide::Right => self.drive.right.stick(),
        }
    }

    /// From now on the sonars measure what was recorded, and nothing of the world: column *i* of
    /// the table is sonar *i* of the ring or of the array, whichever pings.
    pub fn measure_from(&mut self, ranges: RecordedRanges) {
        self.sonars.measure_from(Feed::new(ranges));
    }

    /// When recorded ranges end, in microseconds of plant time: one row after the last row, so that
    /// the robot has acted by it. None before the last row is over, and where nothing was recorded.
    pub fn recorded_end_us(&self) -> Option<u64> {
        self.sonars.recorded_end_us()
    }

    /// What the body's outputs read now.
    pub fn sensors(&self) -> Sensors {
        let (echo_us, echo_high) = self.sonars.echoes(self.now_us);
        let wheels = [&self.drive.left, &self.drive.right];
        let [left_count, right_count] =
            (self.wiring).counts(wheels.map(|wheel| self.drive.encoder_count(wheel)));
        Sensors {
            left_count,
            right_count,
            echo_us,
            echo_high,
            adc_counts: self.adc_counts(),
            stop_is_low: false,
            bumper_is_low: self.drive.bumpers_pushed(),
            yaw_counts: self.wiring.yaw_counts(self.gyro.counts()),
        }
    }

    /// What the sonars answer to their last triggers, if they do: of those that are to come, or
    /// under way.
    pub fn pulses(&self) -> [Option<Pulse>; SONARS] {
        self.sonars.pulses(self.now_us)
    }

    /// One exchange with a board: the actuators take effect at `effect_us`, the reply holds the
    /// sensors at `start_us`.
    pub fn exchange(&mut self, request: &Request) -> Reply {
        self.advance_to(request.effect_us);
        self.apply(&request.actuators);
        self.advance_to(request.start_us);
        Reply {
            sequence: request.sequence,
            sensors: self.sensors(),
        }
    }

    fn adc_counts(&self) -> [u16; ANALOG_CHANNELS] {
        let full_scale = f64::from(ADC_FULL_SCALE);
        let battery = &self.body.battery;
        let noise_counts = battery.noise_counts * self.noise.bell(Source::Battery, self.now_us);
        let battery_counts =
            self.drive.battery_v / battery.full_scale_v * full_scale + noise_counts;
        let level = |high: bool| if high { full_scale } else { 0.0 };
        let [left, middle, right] =
            (self.body.floor).counts(self.drive.pose, &self.world.lines, &self.noise, self.now_us);
        [
            self.wiring.battery_counts(battery_counts),
            level(self.drive.in_contact),
            self.drive.current_a / CURRENT_FULL_SCALE_A * full_scale,
            level(self.aux_outputs & 1 != 0),
            left,
            middle,
            right,
        ]
        .map(|counts| counts.clamp(0.0, full_scale) as u16)
    }

    /// Plant time, in microseconds.
    pub fn now_us(&self) -> u64 {
        self.now_us
    }

    /// Where the body really is.
    pub fn pose(&self) -> BodyPose {
        self.drive.pose
    }

    /// Voltage of the battery under its load, in volts.
    pub fn battery_v(&self) -> f64 {
        self.drive.battery_v
    }

    /// Levels of the auxiliary outputs: bit *i* is output *i*.
    pub fn aux_outputs(&self) -> u8 {
        self.aux_outputs
    }

    /// The world that it stands in.
    pub fn world(&self) -> &World {
        &self.world
    }

    /// The body that it is.
    pub fn body(&self) -> &BodyParameters {
        &self.body
    }

    /// Distance from the body's centre to the nearest wall, in metres.
    pub fn distance_to_walls_m(&self) -> f64 {
        let Drive {
            pose, obstacles, ..
        } = &self.drive;
        obstacles.distance_to_walls_m(pose.position)
    }

    /// The walls that stand there now and did not from the start.
    pub fn added_walls(&self) -> &[Segment] {
        self.drive.obstacles.added_walls(&self.world)
    }

    /// The people who stand there now.
    pub fn people(&self) -> impl Iterator<Item = &Person> {
        self.drive.obstacles.people()
    }

    /// Way of the body's centre since the start, in metres.
    pub fn distance_m(&self) -> f64 {
        self.drive.distance_m
    }

    /// How often the body ran into a wall or a person.
    pub fn collisions(&self) -> u32 {
        // So many that they cannot be counted do not fit into a run.
        self.statistics.touches().len() as u32
    }

    /// Speed of the body's centre at the hardest of its collisions, in metres per second; 0 without
    /// one.
    pub fn hardest_collision_m_per_s(&self) -> f64 {
        let speeds = self.statistics.touches().iter();
        (speeds.map(|touch| touch.speed_m_per_s)).fold(0.0, f64::max)
    }

    /// Path, rooms and touches since the start.
    pub fn statistics(&self) -> &Statistics {
        &self.statistics
    }
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod touch_tests;
