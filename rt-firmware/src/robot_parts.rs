//! What a robot of one's own is made of, on whichever board: the rover's parts, and outputs for its
//! own drivers.

use core::marker::PhantomData;

use embedded_hal::digital::OutputPin;
use embedded_hal::pwm::SetDutyCycle;

use crate::body::{
    AUX_OUTPUTS, AnalogChannel, AuxOutput, DirectionPin, EchoCapture, EncoderCount, MotorPwm,
    Parts, SONARS, TriggerPin,
};
use crate::drivers::{AnalogIn, EchoTimer, EncoderCounter};
use crate::rover::{Extras, PinExtras, RoverParts, split_pins};

/// The types of a board's pins. A registry that is generic over them is a robot on every board:
///
/// ```
/// use rt_firmware::robot_parts::{PartTypes, RobotParts};
/// use rt_firmware::rover::Measures;
/// use rt_firmware::tasks::{Cruise, Odometry, WheelSpeed};
/// use rt_firmware::{TaskPool, registry};
///
/// registry! {
///     /// A robot that drives ahead.
///     pub struct Mine[P: PartTypes, const SONARS: usize]<P, SONARS> marks P {
///         odometry: Odometry<P::LeftEncoder, P::RightEncoder>[1],
///         wheel_speed: WheelSpeed<P::Pwm, P::Direction, P::Pwm, P::Direction>[1],
///         cruise: Cruise[1],
///     }
/// }
///
/// impl<P: PartTypes, const SONARS: usize> Mine<P, SONARS> {
///     pub fn new(parts: RobotParts<P, SONARS>, measures: &Measures<SONARS>) -> Self {
///         let hardware = parts.rover.into_tasks(measures);
///         Self {
///             marks: Default::default(),
///             odometry: TaskPool::new([hardware.odometry]),
///             wheel_speed: TaskPool::new([hardware.wheel_speed]),
///             cruise: TaskPool::new([Cruise]),
///         }
///     }
/// }
///
/// let pins = rt_firmware::body::PinImage::new();
/// let mut robot = Mine::new(pins.parts().into(), &Measures::ROVER);
/// assert_eq!(robot.banks().len(), 3);
/// ```
pub trait PartTypes {
    /// PWM of a motor.
    type Pwm: SetDutyCycle + Send;
    /// Direction of a motor; high is backwards.
    type Direction: OutputPin + Send;
    /// Encoder of the left wheel.
    type LeftEncoder: EncoderCounter + Send;
    /// Encoder of the right wheel.
    type RightEncoder: EncoderCounter + Send;
    /// Trigger of a sonar.
    type Trigger: OutputPin + Send;
    /// Echo timer of a sonar.
    type EchoTimer: EchoTimer + Send;
    /// Analogue input.
    type Analog: AnalogIn + Send;
    /// Digital output for the robot's own drivers.
    type Output: OutputPin + Send;
    /// Parts that not every robot has.
    type Extras: Extras;
}

/// The rover's parts on a board with these types.
pub type PartsOf<P, const N: usize = SONARS> = RoverParts<
    <P as PartTypes>::Pwm,
    <P as PartTypes>::Direction,
    <P as PartTypes>::Pwm,
    <P as PartTypes>::Direction,
    <P as PartTypes>::LeftEncoder,
    <P as PartTypes>::RightEncoder,
    <P as PartTypes>::Trigger,
    <P as PartTypes>::EchoTimer,
    <P as PartTypes>::Analog,
    N,
    <P as PartTypes>::Extras,
>;

/// What a board gives a robot of one's own.
pub struct RobotParts<P: PartTypes, const N: usize = SONARS> {
    /// What the rover is made of.
    pub rover: PartsOf<P, N>,
    /// Outputs for the robot's own drivers. One that is not connected takes what is written and
    /// does nothing.
    pub outputs: [P::Output; AUX_OUTPUTS],
}

/// The types of a [`PinImage`](crate::body::PinImage).
#[derive(Clone, Copy, Debug)]
pub struct PinParts<'a>(PhantomData<&'a ()>);

impl<'a> PartTypes for PinParts<'a> {
    type Pwm = MotorPwm<'a>;
    type Direction = DirectionPin<'a>;
    type LeftEncoder = EncoderCount<'a>;
    type RightEncoder = EncoderCount<'a>;
    type Trigger = TriggerPin<'a>;
    type EchoTimer = EchoCapture<'a>;
    type Analog = AnalogChannel<'a>;
    type Output = AuxOutput<'a>;
    type Extras = PinExtras<'a>;
}

impl<'a> From<Parts<'a>> for RobotParts<PinParts<'a>> {
    /// Takes what every board has and drops the rest; [`split_pins`] keeps it.
    fn from(parts: Parts<'a>) -> Self {
        let (rover, spare) = split_pins(parts);
        Self {
            rover,
            outputs: spare.aux_outputs,
        }
    }
}
