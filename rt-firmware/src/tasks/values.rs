//! What travels over the nets between the shipped tasks, and the robot's measures that several of them need.

use crate::body::{LINE_SENSORS, SONARS};
use crate::task::PortType;

pub use crate::odometry::Pose;

impl PortType for Pose {
    const NAME: &'static str = "Pose";
    const INIT: Self = Self::START;

    fields! { x_m: f32, y_m: f32, heading_rad: f32 }
}

/// How the robot shall move.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Twist {
    /// Speed of the robot's centre in metres per second; positive is forwards.
    pub forward_m_per_s: f32,
    /// Turning speed in radians per second; positive is to the left.
    pub turn_rad_per_s: f32,
}

impl Twist {
    /// No movement.
    pub const STILL: Self = Self {
        forward_m_per_s: 0.0,
        turn_rad_per_s: 0.0,
    };
}

impl PortType for Twist {
    const NAME: &'static str = "Twist";
    const INIT: Self = Self::STILL;

    fields! { forward_m_per_s: f32, turn_rad_per_s: f32 }
}

/// How fast the wheels roll, as the encoders tell.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct WheelSpeeds {
    /// Left wheel, in metres per second.
    pub left_m_per_s: f32,
    /// Right wheel, in metres per second.
    pub right_m_per_s: f32,
}

impl PortType for WheelSpeeds {
    const NAME: &'static str = "WheelSpeeds";
    const INIT: Self = Self {
        left_m_per_s: 0.0,
        right_m_per_s: 0.0,
    };

    fields! { left_m_per_s: f32, right_m_per_s: f32 }
}

/// Free way around the robot, from its rim.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ranges {
    /// Range of each sonar in metres, counter-clockwise from the one that looks ahead; [`Ranges::FAR_M`] where nothing is seen.
    pub range_m: [f32; SONARS],
}

impl Ranges {
    /// What stands for "nothing there", in metres: the farthest that a sonar hears.
    pub const FAR_M: f32 = 4.0;

    /// Nothing anywhere.
    pub const FREE: Self = Self {
        range_m: [Self::FAR_M; SONARS],
    };

    /// Straight ahead, in metres.
    pub const fn ahead_m(&self) -> f32 {
        self.range_m[0]
    }

    /// 45° to the left, in metres.
    pub const fn ahead_left_m(&self) -> f32 {
        self.range_m[1]
    }

    /// To the left, in metres.
    pub const fn left_m(&self) -> f32 {
        self.range_m[2]
    }

    /// Straight behind, in metres.
    pub const fn behind_m(&self) -> f32 {
        self.range_m[4]
    }

    /// To the right, in metres.
    pub const fn right_m(&self) -> f32 {
        self.range_m[6]
    }

    /// 45° to the right, in metres.
    pub const fn ahead_right_m(&self) -> f32 {
        self.range_m[7]
    }

    /// The nearest of all, in metres.
    pub fn nearest_m(&self) -> f32 {
        self.range_m.into_iter().fold(Self::FAR_M, f32::min)
    }
}

impl PortType for Ranges {
    const NAME: &'static str = "Ranges";
    const INIT: Self = Self::FREE;

    fields! { range_m: [f32; 8] }
}

/// State of the battery.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Battery {
    /// Voltage under the present load, smoothed, in volts.
    pub voltage_v: f32,
}

impl PortType for Battery {
    const NAME: &'static str = "Battery";
    const INIT: Self = Self { voltage_v: 0.0 };

    fields! { voltage_v: f32 }
}

/// A dark line on the floor, as the sensors ahead of the wheels see it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Line {
    /// How far to the left of the middle sensor the line is, in micrometres. As long as no sensor sees it: the distance of the outermost
    /// sensor on the side where it went out of sight.
    pub left_um: i16,
    /// How many sensors see it.
    pub dark_sensors: u8,
}

impl Line {
    /// Whether a sensor sees it.
    pub const fn is_seen(&self) -> bool {
        self.dark_sensors > 0
    }

    /// Whether it goes across: all sensors see it, which are wider apart than a line is.
    pub const fn is_crossing(&self) -> bool {
        self.dark_sensors as usize == LINE_SENSORS
    }
}

impl PortType for Line {
    const NAME: &'static str = "Line";
    const INIT: Self = Self {
        left_um: 0,
        dark_sensors: 0,
    };

    fields! { left_um: i16, dark_sensors: u8 }
}

/// The measures of a robot with two driven wheels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Chassis {
    /// Distance between the wheels, in metres.
    pub wheel_base_m: f32,
    /// Way of a wheel's rim for one encoder count, in metres.
    pub metres_per_count: f32,
    /// Speed of a wheel at full power and a fresh battery, in metres per second.
    pub full_speed_m_per_s: f32,
    /// Share of full power that friction takes before a wheel turns at all.
    pub friction_power: f32,
}
