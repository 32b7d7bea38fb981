//! Drivers of the robot's parts, over `embedded-hal` 1.0 and three small traits of our own for what
//! it lacks.
//!
//! A driver never names a chip. It turns pins into quantities with units and back, and knows
//! nothing of tasks or nets.

mod battery;
mod bumper;
mod bus_sonar;
mod encoder;
#[cfg(feature = "imu")]
mod gyro;
mod hal;
mod line;
mod motor;
mod sonar;
mod stop_button;
#[cfg(test)]
mod test_wire;

pub use battery::BatteryGauge;
pub use bumper::{Bumper, FREE_AFTER_US};
pub use bus_sonar::{BusSonar, BusSonarKind, NotSent};
pub use encoder::WheelEncoder;
#[cfg(feature = "imu")]
pub use gyro::{GyroError, RAD_PER_S_PER_COUNT, WAKES_IN_US, YawGyro};
pub use hal::{AnalogIn, EchoPulse, EchoTimer, EncoderCounter};
pub use line::{LINE_SENSORS, LineArray};
pub use motor::{DcMotor, MotorError};
pub use sonar::{Answer, LONGEST_ECHO_US, Sonar, Sound, answer_to};
pub use stop_button::{STOP_DEBOUNCE_US, StopButton};
