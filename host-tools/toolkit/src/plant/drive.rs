//! Motors, wheels, battery, and the body that they push over the floor, into walls and people;
//! the bumpers before it.

use core::str::FromStr;

use crate::world::{Circle, Point};

use super::free_way::Movement;
use super::noise::{Noise, Source};
use super::obstacles::Obstacles;
use super::parameters::{BodyParameters, MotorParameters, SLIP_WINDOW_MS};
use super::pose::BodyPose;
use super::touch::{Encounter, Oracle, Touch};

/// Length of one integration step, in microseconds. Steps begin at its multiples, so cutting a run
/// into calls changes nothing.
pub(super) const STEP_US: u64 = 1_000;

/// The same in seconds.
const STEP_S: f64 = STEP_US as f64 / 1e6;

/// A touch ends when the body is this far from all walls and people, in metres; less would count
/// one scrape many times.
const CONTACT_END_M: f64 = 0.005;

/// How far the body's bumpers give way until their switches close, seen from their rest, in metres:
/// they stand so far before the body. The switches of common bumpers close within 1 to 4 mm.
const BUMPER_M: f64 = 0.003;

/// Both bumpers give way to what pushes so near to the middle of the front, as an angle to each
/// side: there they overlap.
const BOTH_BUMPERS_RAD: f64 = 0.2;

/// Which wheel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum WheelSide {
    /// The left one.
    Left,
    /// The right one.
    Right,
}

impl FromStr for WheelSide {
    type Err = ();

    fn from_str(text: &str) -> Result<Self, ()> {
        match text {
            "left" => Ok(WheelSide::Left),
            "right" => Ok(WheelSide::Right),
            _ => Err(()),
        }
    }
}

/// One motor with its wheel.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Wheel {
    /// Part of the battery's voltage that the motor sees, -1 to 1.
    pub duty: f64,
    /// Turning speed.
    speed_rad_per_s: f64,
    /// Turned since the start.
    angle_rad: f64,
    /// Speed of the floor under the wheel.
    ground_m_per_s: f64,
    /// Something holds it.
    is_stuck: bool,
}

impl Wheel {
    /// How far it has turned since the start, forwards positive.
    pub fn angle_rad(&self) -> f64 {
        self.angle_rad
    }

    /// Lets something hold the wheel from now on.
    pub fn stick(&mut self) {
        self.is_stuck = true;
    }

    /// Turns the wheel for one step and returns the current that the motor takes from the battery,
    /// in amperes.
    fn turn(
        &mut self,
        motor: &MotorParameters,
        strength: f64,
        battery_v: f64,
        approach: f64,
    ) -> f64 {
        let voltage_v = self.duty * battery_v;
        let driving_v = (voltage_v.abs() - motor.dead_v).max(0.0);
        let goal_rad_per_s = motor.speed_rad_per_s_v * strength * driving_v.copysign(voltage_v);
        let lack_rad_per_s = goal_rad_per_s - self.speed_rad_per_s;
        self.speed_rad_per_s += lack_rad_per_s * approach;
        if self.is_stuck {
            self.speed_rad_per_s = 0.0;
        }
        self.angle_rad += self.speed_rad_per_s * STEP_S;
        let back_emf_v = self.speed_rad_per_s / motor.speed_rad_per_s_v;
        // The switch passes current for `duty` of the time, and none back.
        ((voltage_v - back_emf_v) * self.duty / motor.winding_ohm).max(0.0)
    }

    /// Lets the floor follow the wheel's rim as fast as the grip allows.
    fn grip(&mut self, wheel_radius_m: f64, slip: f64, acceleration_m_per_s2: f64) {
        let rim_m_per_s = self.speed_rad_per_s * wheel_radius_m * (1.0 - slip);
        let most_m_per_s = acceleration_m_per_s2 * STEP_S;
        let change_m_per_s = rim_m_per_s - self.ground_m_per_s;
        self.ground_m_per_s += change_m_per_s.clamp(-most_m_per_s, most_m_per_s);
    }
}

/// The moving part of the plant.
#[derive(Clone, Debug)]
pub(super) struct Drive {
    body: BodyParameters,
    pub obstacles: Obstacles,
    pub pose: BodyPose,
    pub left: Wheel,
    pub right: Wheel,
    charge_as: f64,
    pub current_a: f64,
    pub battery_v: f64,
    /// Part of the way to its goal that a motor's speed goes in one step.
    approach: f64,
    /// No wall and no person is nearer to the centre than this, in metres. Saves looking at all of
    /// them in most steps.
    clearance_m: f64,
    pub in_contact: bool,
    oracle: Oracle,
    pub distance_m: f64,
}

impl Drive {
    pub fn new(body: BodyParameters, obstacles: Obstacles, pose: BodyPose) -> Self {
        Self {
            body,
            obstacles,
            pose,
            left: Wheel::default(),
            right: Wheel::default(),
            charge_as: body.battery.capacity_as,
            current_a: body.battery.idle_a,
            battery_v: body.battery.full_v,
            approach: 1.0 - libm::exp(-STEP_S / body.motor.lag_s),
            clearance_m: 0.0,
            in_contact: false,
            oracle: Oracle::default(),
            distance_m: 0.0,
        }
    }

    /// One step of [`STEP_US`]; `index` counts them from 0. Returns the touch that begins in it, if
    /// one does.
    pub fn step(&mut self, index: u64, noise: &Noise) -> Option<Touch> {
        self.turn_wheels();
        let window = index * STEP_US / 1_000 / SLIP_WINDOW_MS;
        let end_us = (index + 1) * STEP_US;
        let grip = &self.body.grip;
        for (wheel, source) in [
            (&mut self.left, Source::LeftSlip),
            (&mut self.right, Source::RightSlip),
        ] {
            let slip = grip.slip * noise.uniform(source, window);
            wheel.grip(self.body.wheel_radius_m, slip, grip.acceleration_m_per_s2);
        }
        let touch = self.move_body(end_us);
        self.let_people_pass(end_us);
        touch
    }

    fn turn_wheels(&mut self) {
        let BodyParameters { motor, battery, .. } = &self.body;
        let charge = self.charge_as / battery.capacity_as;
        let open_v = battery.empty_v + (battery.full_v - battery.empty_v) * charge;
        self.battery_v = open_v - battery.inner_ohm * self.current_a;
        let right_strength = 1.0 - motor.right_weaker;
        self.current_a = battery.idle_a
            + self.left.turn(motor, 1.0, self.battery_v, self.approach)
            + (self.right).turn(motor, right_strength, self.battery_v, self.approach);
        self.charge_as = (self.charge_as - self.current_a * STEP_S).max(0.0);
    }

    /// How the floor passes under the wheels.
    fn movement(&self) -> Movement {
        let (left, right) = (self.left.ground_m_per_s, self.right.ground_m_per_s);
        Movement {
            pose: self.pose,
            way_m_per_s: (left + right) / 2.0,
            turn_rad_per_s: (right - left) / self.body.wheel_base_m,
        }
    }

    fn move_body(&mut self, end_us: u64) -> Option<Touch> {
        let movement = self.movement();
        self.oracle.passes(movement.is_still(), STEP_S);
        let way_m = movement.way_m_per_s * STEP_S;
        let turn_rad = movement.turn_rad_per_s * STEP_S;
        let (sin, cos) = libm::sincos(self.pose.heading_rad + turn_rad / 2.0);
        self.pose.heading_rad += turn_rad;
        let goal = Point::new(
            self.pose.position.x_m + way_m * cos,
            self.pose.position.y_m + way_m * sin,
        );
        // The body is round: turning on the spot touches nothing.
        if self.is_free(goal, way_m.abs()) {
            self.pose.position = goal;
            self.distance_m += way_m.abs();
            return None;
        }
        self.left.ground_m_per_s = 0.0;
        self.right.ground_m_per_s = 0.0;
        if self.in_contact {
            return None;
        }
        self.in_contact = true;
        Some(self.oracle.judge(
            end_us,
            self.pose.position,
            self.obstacles.nearest(goal),
            movement.speed_m_per_s(),
            self.distance_m,
        ))
    }

    /// People step in and away at the end of a step, in microseconds of plant time. Nobody who
    /// steps in touches the body: this is no collision, and it holds nothing.
    fn let_people_pass(&mut self, time_us: u64) {
        let body = Circle {
            centre: self.pose.position,
            radius_m: self.body.radius_m,
        };
        let (changed, stepped_in) = self.obstacles.update(time_us, body, CONTACT_END_M);
        if changed {
            // What is near has to be looked at anew.
            self.clearance_m = 0.0;
        }
        for person in stepped_in {
            let movement = self.movement();
            let distance_m = |centre| person.circle.distance_m(centre);
            let free_m = movement.free_way_m(self.body.radius_m, distance_m);
            let encounter = Encounter::new(time_us, &movement, free_m);
            (self.oracle).steps_in(person.line, encounter, self.distance_m);
        }
    }

    /// Whether the body fits at `goal`, which is `way_m` away. One step is far shorter than the
    /// body's radius, so neither wall nor person fits in between.
    fn is_free(&mut self, goal: Point, way_m: f64) -> bool {
        let radius_m = self.body.radius_m;
        let clearance_m = self.clearance_m - way_m;
        if clearance_m > radius_m + CONTACT_END_M {
            self.clearance_m = clearance_m;
            return true;
        }
        let distance_m = self.obstacles.distance_m(goal);
        if distance_m < radius_m {
            return false;
        }
        self.clearance_m = distance_m;
        if distance_m > radius_m + CONTACT_END_M {
            self.in_contact = false;
        }
        true
    }

    /// Which bumpers are pushed, left and right: those on whose side of the front something is
    /// nearer to the body than they stand before it.
    pub fn bumpers_pushed(&self) -> [bool; 2] {
        let reach_m = self.body.radius_m + BUMPER_M;
        if self.clearance_m > reach_m {
            return [false; 2];
        }
        let Point { x_m, y_m } = self.pose.position;
        let (sin, cos) = libm::sincos(self.pose.heading_rad);
        let near = self.obstacles.near_points(self.pose.position, reach_m);
        let sides = near.map(|point| {
            let (x_m, y_m) = (point.x_m - x_m, point.y_m - y_m);
            let (ahead_m, left_m) = (x_m * cos + y_m * sin, y_m * cos - x_m * sin);
            let angle_rad = libm::atan2(left_m, ahead_m);
            let is_in_front = angle_rad.abs() <= core::f64::consts::FRAC_PI_2;
            [angle_rad, -angle_rad].map(|to_side| is_in_front && to_side > -BOTH_BUMPERS_RAD)
        });
        sides.fold([false; 2], |a, b| [a[0] || b[0], a[1] || b[1]])
    }

    /// What the encoder of `wheel` counts.
    pub fn encoder_count(&self, wheel: &Wheel) -> u16 {
        let counts = wheel.angle_rad / core::f64::consts::TAU * self.body.counts_per_revolution;
        // Two casts: the first keeps the sign, the second wraps as a 16-bit counter does.
        libm::floor(counts) as i64 as u16
    }
}
