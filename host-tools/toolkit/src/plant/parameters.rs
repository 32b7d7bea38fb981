//! The numbers that make a body: geometry, motors, battery, sonars, line sensors, gyroscope.
//!
//! They are those of the real thing, so to speak: the firmware has its own, calibrated ones
//! (`rt_firmware::rover`), and the two are equal only as far as a person with a ruler gets them
//! equal.

/// A robot's body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyParameters {
    /// Radius of the round body, in metres.
    pub radius_m: f64,
    /// Distance between the points where the wheels touch the ground, in metres.
    pub wheel_base_m: f64,
    /// Radius of the wheels, in metres.
    pub wheel_radius_m: f64,
    /// Encoder counts in one turn of a wheel.
    pub counts_per_revolution: f64,
    /// The motors.
    pub motor: MotorParameters,
    /// How the wheels hold the ground.
    pub grip: GripParameters,
    /// The battery.
    pub battery: BatteryParameters,
    /// The sonars, all alike.
    pub sonar: SonarParameters,
    /// The sensors that look at the floor, all alike.
    pub floor: FloorParameters,
    /// The gyroscope.
    pub gyro: GyroParameters,
}

/// A gear motor with its wheel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotorParameters {
    /// Speed of the wheel without load, in rad/s for each volt above `dead_v`.
    pub speed_rad_per_s_v: f64,
    /// Voltage below which friction holds the wheel.
    pub dead_v: f64,
    /// Time in which the speed comes within 1/e of where it goes, in seconds.
    pub lag_s: f64,
    /// Resistance of the winding, in ohms.
    pub winding_ohm: f64,
    /// By how much weaker the right motor is than the left one.
    pub right_weaker: f64,
}

/// How the wheels hold the ground.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GripParameters {
    /// Acceleration beyond which a wheel spins or slides, in m/s².
    pub acceleration_m_per_s2: f64,
    /// Greatest part of a wheel's way that is lost on the floor's unevenness; a new part is drawn
    /// for each [`SLIP_WINDOW_MS`].
    pub slip: f64,
}

/// How long the floor under a wheel is alike, in milliseconds.
pub const SLIP_WINDOW_MS: u64 = 100;

/// A battery with its divider to the ADC.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BatteryParameters {
    /// Voltage when full, without load.
    pub full_v: f64,
    /// Voltage when empty, without load; it falls evenly in between.
    pub empty_v: f64,
    /// Charge when full, in ampere-seconds.
    pub capacity_as: f64,
    /// Inner resistance, in ohms.
    pub inner_ohm: f64,
    /// What the electronics take, in amperes.
    pub idle_a: f64,
    /// Battery volts at the ADC's full scale.
    pub full_scale_v: f64,
    /// Standard deviation of a conversion, in counts.
    pub noise_counts: f64,
}

/// A sonar on the rim of the body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SonarParameters {
    /// Distance of the sonars from the body's centre, in metres.
    pub rim_m: f64,
    /// Half the width of the beam, in radians.
    pub half_beam_rad: f64,
    /// The nearest that a sonar can tell, in metres; what is nearer reads as this.
    pub min_range_m: f64,
    /// The farthest from which an echo comes back, in metres.
    pub max_range_m: f64,
    /// A wall that is met at an angle whose cosine is below this reflects the ping away.
    pub min_incidence_cos: f64,
    /// Standard deviation of a range: this many metres …
    pub noise_m: f64,
    /// … and this part of the range.
    pub noise_part: f64,
    /// Probability that an echo is not heard.
    pub miss_probability: f64,
    /// Temperature of the air, in °C, which says how fast sound is.
    pub air_c: f64,
}

/// A row of sensors under the body's front: an infrared LED and a phototransistor each, with a
/// resistor to the supply, so that less light reads as more counts. The numbers are estimates for
/// parts a few millimetres above the floor and electrical tape on a light floor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloorParameters {
    /// Distance of the row ahead of the body's centre, in metres.
    pub ahead_m: f64,
    /// Distance between two sensors of the row, in metres.
    pub pitch_m: f64,
    /// Diameter of the spot that a sensor sees, in metres.
    pub spot_m: f64,
    /// ADC counts over bare floor.
    pub floor_counts: f64,
    /// ADC counts over a line.
    pub line_counts: f64,
    /// Standard deviation of a conversion, in counts.
    pub noise_counts: f64,
}

/// A gyroscope: that of a BMI160. The numbers are of its data sheet (Bosch Sensortec,
/// BST-BMI160-DS000, section 1, table of the gyroscope), which names typical ones.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GyroParameters {
    /// The largest bias when it is switched on, to both sides, in degrees per second; the seed says
    /// which one it is. The data sheet has 3 °/s.
    pub bias_deg_per_s: f64,
    /// By how much the bias grows in each second, in degrees per second: 0.05 °/s for each kelvin,
    /// as the data sheet says, of a body that gets warmer by 5 K in ten minutes.
    pub drift_deg_per_s2: f64,
    /// By which part its rates are too large. The data sheet allows 3 %; 1 % is a usual one.
    pub scale_error: f64,
    /// Standard deviation of a measurement, in degrees per second. The data sheet has 0.07 °/s at
    /// 47 Hz.
    pub noise_deg_per_s: f64,
}

impl Default for BodyParameters {
    /// The shipped rover: 24 cm across, 0.6 m/s at full duty, two lithium cells.
    fn default() -> Self {
        Self {
            radius_m: 0.12,
            wheel_base_m: 0.2015,
            wheel_radius_m: 0.0328,
            counts_per_revolution: 1_440.0,
            motor: MotorParameters {
                speed_rad_per_s_v: 2.7,
                dead_v: 0.45,
                lag_s: 0.08,
                winding_ohm: 4.0,
                right_weaker: 0.04,
            },
            grip: GripParameters {
                acceleration_m_per_s2: 2.5,
                slip: 0.03,
            },
            battery: BatteryParameters {
                full_v: 8.3,
                empty_v: 6.4,
                capacity_as: 7_200.0,
                inner_ohm: 0.18,
                idle_a: 0.12,
                full_scale_v: 9.9,
                noise_counts: 2.0,
            },
            sonar: SonarParameters {
                rim_m: 0.11,
                half_beam_rad: 0.21,
                min_range_m: 0.02,
                max_range_m: 4.0,
                min_incidence_cos: 0.26,
                noise_m: 0.002,
                noise_part: 0.004,
                miss_probability: 0.02,
                air_c: 20.0,
            },
            floor: FloorParameters {
                ahead_m: 0.09,
                pitch_m: 0.0121,
                spot_m: 0.006,
                floor_counts: 460.0,
                line_counts: 3_400.0,
                noise_counts: 12.0,
            },
            gyro: GyroParameters {
                bias_deg_per_s: 3.0,
                drift_deg_per_s2: 0.05 * 5.0 / 600.0,
                scale_error: 0.01,
                noise_deg_per_s: 0.07,
            },
        }
    }
}
