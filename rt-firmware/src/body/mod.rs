//! The robot's body as a board without one sees it: an image of the pins, and the messages that
//! keep it in step with the simulated plant.
//!
//! A real board has timers, counters and converters behind its pins. The emulated board and the
//! host board have none, so their pins are a [`PinImage`]: drivers write and read it through the
//! same `embedded-hal` objects as on hardware ([`Parts`]), and once in each slot activation the
//! board carries it to the plant and back with a [`PlantExchange`].
//!
//! ```text
//!  drivers ── Parts ──▶ PinImage ── PlantExchange::request ──▶ bytes ──▶ plant
//!          ◀─        ◀──          ◀─ PlantExchange::accept ─── bytes ◀──
//! ```
//!
//! The image carries what pins carry (PWM duty, encoder counts, echo times, ADC counts, levels),
//! never speeds or poses.

mod exchange;
pub mod flash;
#[cfg(feature = "links")]
pub mod frames;
#[cfg(feature = "imu")]
mod imu;
pub mod line;
mod pins;

pub use exchange::{
    Freshness, PlantExchange, REPLY_BYTES, REQUEST_BYTES, Reply, Request, STALE_FRAME_LIMIT,
};
#[cfg(feature = "imu")]
pub use imu::{ImuBus, NoAnswer};
pub use pins::{
    ADC_FULL_SCALE, ANALOG_CHANNELS, ARRAY_BANKS, AUX_OUTPUTS, Actuators, AnalogChannel, AuxOutput,
    BATTERY_CHANNEL, BUMPERS, DEADMAN_US, DirectionPin, EchoCapture, EncoderCount, FULL_DUTY,
    InPin, LINE_CHANNEL, LINE_SENSORS, MotorPwm, Parts, PinImage, SONARS, Sensors, StopPin,
    TriggerPin,
};
