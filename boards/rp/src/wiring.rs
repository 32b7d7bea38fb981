//! What is at which pin, as a robot's file says it: the build script of a robot's firmware makes
//! the constants of it (`robot_file::build`), which has been checked then. Pins are the numbers of
//! the chip, `GP0` is 0.

use rt_firmware::body::{AUX_OUTPUTS, BUMPERS};
pub use rt_firmware::drivers::BusSonarKind;

/// Whether the firmware has the feature `bumpers`: a robot's file that has them is refused without.
pub const HAS_BUMPERS: bool = cfg!(feature = "bumpers");
/// The same of the feature `imu`, and a gyroscope.
pub const HAS_IMU: bool = cfg!(feature = "imu");
/// The same of the feature `ranges`, and sonars at a bus.
pub const HAS_RANGES: bool = cfg!(feature = "ranges");

/// A robot's parts and their pins.
#[derive(Clone, Copy, Debug)]
pub struct Wiring<const SONARS: usize> {
    /// The left wheel.
    pub left: Wheel,
    /// The right wheel.
    pub right: Wheel,
    /// The sonars, in the order of the robot's measures. Those of one echo pin never ping at once.
    pub sonars: [Sonar; SONARS],
    /// The battery, behind its divider: an analogue pin.
    pub battery: u8,
    /// The sensors that look at the floor, left, middle and right, where they are: analogue pins.
    pub floor: [Option<u8>; 3],
    /// The button of the emergency stop.
    pub stop_button: Button,
    /// Contact switches of the bumpers, left and right, where they are.
    pub bumpers: Option<[Button; BUMPERS]>,
    /// The bus of sensors on I2C, where there is one.
    pub i2c: Option<I2cPins>,
    /// Whether a BMI160 is at the bus.
    pub has_gyro: bool,
    /// Outputs for the robot's own drivers, where they are.
    pub outputs: [Option<u8>; AUX_OUTPUTS],
}

/// A motor and its encoder.
#[derive(Clone, Copy, Debug)]
pub struct Wheel {
    /// The motor's bridge.
    pub motor: Bridge,
    /// The lower of the encoder's two pins; the other is the next.
    pub encoder: u8,
    /// Whether the count goes down where A is ahead of B, A being at the lower pin.
    pub encoder_reversed: bool,
}

/// How an H-bridge is driven. The pins of duties are different outputs of the PWM.
#[derive(Clone, Copy, Debug)]
pub enum Bridge {
    /// Two inputs: the one that is driven says which way (DRV8833, L298, L9110; TB6612 with its PWM
    /// input tied high).
    TwoInputs {
        /// Its duty is the power forwards.
        forwards: u8,
        /// Its duty is the power backwards.
        backwards: u8,
    },
    /// An input for the power and one for the direction (DRV8835 in its phase mode, or a bridge
    /// with an inverter before its second input).
    PwmAndDirection {
        /// Its duty is the power.
        pwm: u8,
        /// Its level is the direction.
        direction: u8,
        /// Whether it is low where the wheel is to turn backwards.
        is_backwards_low: bool,
    },
}

/// A sonar.
#[derive(Clone, Copy, Debug)]
pub enum Sonar {
    /// It answers a trigger with a pulse.
    Pulse {
        /// Where it is triggered.
        trigger: u8,
        /// Where it answers.
        echo: u8,
    },
    /// It is at the bus.
    AtBus {
        /// Which one it is.
        kind: BusSonarKind,
        /// Its address, of 7 bits.
        address: u8,
    },
}

/// A button, or a contact switch.
#[derive(Clone, Copy, Debug)]
pub struct Button {
    /// Its pin.
    pub pin: u8,
    /// Whether the pin is high while it is pressed. One that is not connected is not pressed.
    pub is_pressed_high: bool,
}

/// The wires of an I2C bus: two pins of one block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct I2cPins {
    /// Data.
    pub sda: u8,
    /// Clock.
    pub scl: u8,
}
