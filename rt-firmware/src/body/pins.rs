//! The pin image and the HAL objects that are borrowed from it.
//!
//! Every pin is an atomic of its own that is only loaded and stored, so that the image works on
//! cores without compare-and-swap and needs no critical section. One side writes a pin, the other
//! reads it.

use core::array;
use core::convert::Infallible;
use core::sync::atomic::{AtomicBool, AtomicU16, Ordering::Relaxed};

use embedded_hal::digital::{self, InputPin, OutputPin};
use embedded_hal::pwm::{self, SetDutyCycle};

#[cfg(feature = "imu")]
use super::imu::ImuBus;
pub use crate::drivers::LINE_SENSORS;
use crate::drivers::{AnalogIn, EchoPulse, EchoTimer, EncoderCounter};

/// Number of sonars in the ring.
pub const SONARS: usize = 8;

/// Number of banks in the array of sonars, of [`SONARS`] each. All sonars of a bank are triggered
/// by one pin; sonar *i* of each bank answers on echo pin *i*, which it shares with sonar *i* of
/// the ring.
pub const ARRAY_BANKS: usize = 3;

/// Number of analogue inputs: the battery, three for the user's own drivers, three that look at the
/// floor.
pub const ANALOG_CHANNELS: usize = 7;

/// The analogue input that measures the battery.
pub const BATTERY_CHANNEL: usize = 0;

/// The first of the analogue inputs that measure the floor's reflectance: left, middle, right.
pub const LINE_CHANNEL: usize = 4;

/// Number of digital outputs for the user's own drivers.
pub const AUX_OUTPUTS: usize = 4;

/// Number of bumpers: contact switches on the left and on the right of the body's front.
pub const BUMPERS: usize = 2;

/// PWM duty that means "always on".
pub const FULL_DUTY: u16 = 1_000;

/// ADC counts at the reference voltage (12 bits).
pub const ADC_FULL_SCALE: u16 = 4_095;

/// A motor that no task has written for longer than this is switched off, in microseconds, whatever
/// is written to the other.
///
/// Long enough for a swap of missions to go unnoticed, short enough that a robot at walking pace
/// goes on for a hand's breadth.
pub const DEADMAN_US: u64 = 250_000;

/// What the board drives: a snapshot of its output pins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Actuators {
    /// Duty of the left motor, `-FULL_DUTY..=FULL_DUTY`; positive is forwards.
    pub left_duty: i16,
    /// Duty of the right motor, `-FULL_DUTY..=FULL_DUTY`; positive is forwards.
    pub right_duty: i16,
    /// Bit *i* is set if sonar *i* was triggered since the last snapshot.
    pub sonar_triggers: u8,
    /// Bit *i* is the level of auxiliary output *i*.
    pub aux_outputs: u8,
    /// Bit *i* is set if bank *i* of the array of sonars was triggered since the last snapshot.
    pub array_triggers: u8,
}

/// What the board measures: a snapshot of its input pins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Sensors {
    /// Count of the left wheel's encoder; wraps.
    pub left_count: u16,
    /// Count of the right wheel's encoder; wraps.
    pub right_count: u16,
    /// How long the echo pin of each sonar has been high since its last trigger, in microseconds; 0
    /// while it has not been.
    pub echo_us: [u16; SONARS],
    /// Bit *i* is set while the echo pin of sonar *i* is high: its time still grows.
    pub echo_high: u8,
    /// ADC counts, `0..=ADC_FULL_SCALE`; [`BATTERY_CHANNEL`] is the battery, [`LINE_CHANNEL`] and
    /// the next two look at the floor.
    pub adc_counts: [u16; ANALOG_CHANNELS],
    /// Whether the emergency stop's button pulls its input low: it is pressed. Otherwise a resistor
    /// holds it high.
    pub stop_is_low: bool,
    /// Whether the switch of each bumper pulls its input low, left and right: something pushes the
    /// bumper. Otherwise a resistor holds it high.
    pub bumper_is_low: [bool; BUMPERS],
    /// How fast the gyroscope is turned counter-clockwise, in counts of 1/131.2 °/s, with its bias.
    pub yaw_counts: i16,
}

/// The pins of one motor driver.
#[derive(Debug)]
pub(super) struct MotorPins {
    duty: AtomicU16,
    backwards: AtomicBool,
    /// Set by each write of a duty, taken by the deadman check.
    written: AtomicBool,
}

impl MotorPins {
    const fn new() -> Self {
        Self {
            duty: AtomicU16::new(0),
            backwards: AtomicBool::new(false),
            written: AtomicBool::new(false),
        }
    }

    fn signed_duty(&self) -> i16 {
        // The cast is exact: no duty above FULL_DUTY is ever stored.
        let duty = self.duty.load(Relaxed) as i16;
        if self.backwards.load(Relaxed) {
            -duty
        } else {
            duty
        }
    }

    pub(super) fn off(&self) {
        self.duty.store(0, Relaxed);
    }

    /// Whether the duty was written since the last call.
    pub(super) fn take_written(&self) -> bool {
        let written = self.written.load(Relaxed);
        self.written.store(false, Relaxed);
        written
    }
}

/// All pins between the board and the robot's body.
///
/// Tasks reach it through [`PinImage::parts`]; the board's slot code carries it to the plant with a
/// [`PlantExchange`](super::PlantExchange).
#[derive(Debug)]
pub struct PinImage {
    left: MotorPins,
    right: MotorPins,
    /// A trigger pulse is shorter than a slot, so the image latches it until the next snapshot.
    sonar_triggers: [AtomicBool; SONARS],
    #[cfg(feature = "sonar-array")]
    array_triggers: [AtomicBool; ARRAY_BANKS],
    aux_outputs: [AtomicBool; AUX_OUTPUTS],
    left_count: AtomicU16,
    right_count: AtomicU16,
    echo_us: [AtomicU16; SONARS],
    echo_high: [AtomicBool; SONARS],
    adc_counts: [AtomicU16; ANALOG_CHANNELS],
    stop_is_low: AtomicBool,
    #[cfg(feature = "bumpers")]
    bumper_is_low: [AtomicBool; BUMPERS],
    #[cfg(feature = "imu")]
    yaw_counts: AtomicU16,
}

impl Default for PinImage {
    fn default() -> Self {
        Self::new()
    }
}

impl PinImage {
    /// All outputs low, all inputs 0, but for those of the emergency stop's button and of the
    /// bumpers, which are high.
    pub const fn new() -> Self {
        Self {
            left: MotorPins::new(),
            right: MotorPins::new(),
            sonar_triggers: [const { AtomicBool::new(false) }; SONARS],
            #[cfg(feature = "sonar-array")]
            array_triggers: [const { AtomicBool::new(false) }; ARRAY_BANKS],
            aux_outputs: [const { AtomicBool::new(false) }; AUX_OUTPUTS],
            left_count: AtomicU16::new(0),
            right_count: AtomicU16::new(0),
            echo_us: [const { AtomicU16::new(0) }; SONARS],
            echo_high: [const { AtomicBool::new(false) }; SONARS],
            adc_counts: [const { AtomicU16::new(0) }; ANALOG_CHANNELS],
            stop_is_low: AtomicBool::new(false),
            #[cfg(feature = "bumpers")]
            bumper_is_low: [const { AtomicBool::new(false) }; BUMPERS],
            #[cfg(feature = "imu")]
            yaw_counts: AtomicU16::new(0),
        }
    }

    /// The HAL objects of all pins, for the drivers. Meant to be called once: two objects of one
    /// output would write over each other.
    pub fn parts(&self) -> Parts<'_> {
        Parts {
            left_pwm: MotorPwm { motor: &self.left },
            left_direction: DirectionPin { motor: &self.left },
            right_pwm: MotorPwm { motor: &self.right },
            right_direction: DirectionPin { motor: &self.right },
            left_encoder: EncoderCount {
                count: &self.left_count,
            },
            right_encoder: EncoderCount {
                count: &self.right_count,
            },
            sonar_triggers: self
                .sonar_triggers
                .each_ref()
                .map(|latch| TriggerPin { latch }),
            echo_timers: self.echo_timers(),
            #[cfg(feature = "sonar-array")]
            array_triggers: self
                .array_triggers
                .each_ref()
                .map(|latch| TriggerPin { latch }),
            #[cfg(feature = "sonar-array")]
            array_echo_timers: self.echo_timers(),
            analog: self
                .adc_counts
                .each_ref()
                .map(|counts| AnalogChannel { counts }),
            aux_outputs: self.aux_outputs.each_ref().map(|level| AuxOutput { level }),
            #[cfg(feature = "bumpers")]
            bumpers: self.bumper_is_low.each_ref().map(|is_low| InPin { is_low }),
            #[cfg(feature = "imu")]
            imu: ImuBus::new(&self.yaw_counts),
        }
    }

    fn echo_timers(&self) -> [EchoCapture<'_>; SONARS] {
        array::from_fn(|sonar| EchoCapture {
            echo_us: &self.echo_us[sonar],
            high: &self.echo_high[sonar],
        })
    }

    /// The input of the emergency stop's button. It is not one of the [`parts`](Self::parts), which
    /// the robot's tasks are made of: the button works below them.
    pub fn stop_button(&self) -> StopPin<'_> {
        InPin {
            is_low: &self.stop_is_low,
        }
    }

    /// Brings the body to its safe state: motors off, auxiliary outputs low. Can be called from any
    /// context, a panic handler included.
    pub fn safe(&self) {
        self.motors_off();
        for output in &self.aux_outputs {
            output.store(false, Relaxed);
        }
    }

    /// Switches both motors off and leaves everything else as it is.
    pub fn motors_off(&self) {
        self.left.off();
        self.right.off();
    }

    /// The levels of the outputs now. Takes the latched sonar triggers: the next snapshot has only
    /// those that come after this one.
    pub fn take_actuators(&self) -> Actuators {
        Actuators {
            left_duty: self.left.signed_duty(),
            right_duty: self.right.signed_duty(),
            sonar_triggers: take_bits(&self.sonar_triggers),
            aux_outputs: bits(&self.aux_outputs),
            #[cfg(feature = "sonar-array")]
            array_triggers: take_bits(&self.array_triggers),
            #[cfg(not(feature = "sonar-array"))]
            array_triggers: 0,
        }
    }

    /// The same, which takes no triggers: a look ahead of the next snapshot.
    pub fn actuators(&self) -> Actuators {
        Actuators {
            left_duty: self.left.signed_duty(),
            right_duty: self.right.signed_duty(),
            sonar_triggers: bits(&self.sonar_triggers),
            aux_outputs: bits(&self.aux_outputs),
            #[cfg(feature = "sonar-array")]
            array_triggers: bits(&self.array_triggers),
            #[cfg(not(feature = "sonar-array"))]
            array_triggers: 0,
        }
    }

    /// The left and the right motor.
    pub(super) fn motors(&self) -> [&MotorPins; 2] {
        [&self.left, &self.right]
    }

    /// Puts new values on the inputs.
    pub fn set_sensors(&self, sensors: &Sensors) {
        self.left_count.store(sensors.left_count, Relaxed);
        self.right_count.store(sensors.right_count, Relaxed);
        store_all(&self.echo_us, &sensors.echo_us);
        for (sonar, high) in self.echo_high.iter().enumerate() {
            high.store(sensors.echo_high >> sonar & 1 != 0, Relaxed);
        }
        store_all(&self.adc_counts, &sensors.adc_counts);
        self.stop_is_low.store(sensors.stop_is_low, Relaxed);
        #[cfg(feature = "bumpers")]
        for (pin, is_low) in self.bumper_is_low.iter().zip(sensors.bumper_is_low) {
            pin.store(is_low, Relaxed);
        }
        #[cfg(feature = "imu")]
        (self.yaw_counts).store(sensors.yaw_counts.cast_unsigned(), Relaxed);
    }

    /// The values on the inputs now.
    pub fn sensors(&self) -> Sensors {
        Sensors {
            left_count: self.left_count.load(Relaxed),
            right_count: self.right_count.load(Relaxed),
            echo_us: self.echo_us.each_ref().map(|echo_us| echo_us.load(Relaxed)),
            echo_high: bits(&self.echo_high),
            adc_counts: self
                .adc_counts
                .each_ref()
                .map(|counts| counts.load(Relaxed)),
            stop_is_low: self.stop_is_low.load(Relaxed),
            #[cfg(feature = "bumpers")]
            bumper_is_low: (self.bumper_is_low.each_ref()).map(|is_low| is_low.load(Relaxed)),
            #[cfg(not(feature = "bumpers"))]
            bumper_is_low: [false; BUMPERS],
            #[cfg(feature = "imu")]
            yaw_counts: self.yaw_counts.load(Relaxed).cast_signed(),
            #[cfg(not(feature = "imu"))]
            yaw_counts: 0,
        }
    }
}

fn bits(pins: &[AtomicBool]) -> u8 {
    pins.iter()
        .rev()
        .fold(0, |bits, pin| bits << 1 | u8::from(pin.load(Relaxed)))
}

/// The latches that are set, which are not any more.
fn take_bits(latches: &[AtomicBool]) -> u8 {
    let set = bits(latches);
    for latch in latches {
        latch.store(false, Relaxed);
    }
    set
}

fn store_all<const N: usize>(pins: &[AtomicU16; N], values: &[u16; N]) {
    for (pin, value) in pins.iter().zip(values) {
        pin.store(*value, Relaxed);
    }
}

/// The HAL objects of a [`PinImage`], one field a pin, to be moved into drivers.
#[derive(Debug)]
pub struct Parts<'a> {
    /// Duty of the left motor.
    pub left_pwm: MotorPwm<'a>,
    /// Direction of the left motor; high is backwards.
    pub left_direction: DirectionPin<'a>,
    /// Duty of the right motor.
    pub right_pwm: MotorPwm<'a>,
    /// Direction of the right motor; high is backwards.
    pub right_direction: DirectionPin<'a>,
    /// Encoder of the left wheel.
    pub left_encoder: EncoderCount<'a>,
    /// Encoder of the right wheel.
    pub right_encoder: EncoderCount<'a>,
    /// Trigger inputs of the sonars, counter-clockwise from the one that looks ahead.
    pub sonar_triggers: [TriggerPin<'a>; SONARS],
    /// Echo timers of the sonars, in the same order.
    pub echo_timers: [EchoCapture<'a>; SONARS],
    /// Trigger inputs of the banks of the array of sonars.
    #[cfg(feature = "sonar-array")]
    pub array_triggers: [TriggerPin<'a>; ARRAY_BANKS],
    /// Echo timers of the array, which are those of the ring: of the sonars that were triggered
    /// last.
    #[cfg(feature = "sonar-array")]
    pub array_echo_timers: [EchoCapture<'a>; SONARS],
    /// Analogue inputs; [`BATTERY_CHANNEL`] is the battery, [`LINE_CHANNEL`] and the next two look
    /// at the floor.
    pub analog: [AnalogChannel<'a>; ANALOG_CHANNELS],
    /// Digital outputs for the user's own drivers.
    pub aux_outputs: [AuxOutput<'a>; AUX_OUTPUTS],
    /// Inputs of the bumpers' switches, left and right.
    #[cfg(feature = "bumpers")]
    pub bumpers: [InPin<'a>; BUMPERS],
    /// The bus of the inertial measurement unit.
    #[cfg(feature = "imu")]
    pub imu: ImuBus<'a>,
}

/// PWM output of one motor.
#[derive(Debug)]
pub struct MotorPwm<'a> {
    motor: &'a MotorPins,
}

impl pwm::ErrorType for MotorPwm<'_> {
    type Error = Infallible;
}

impl SetDutyCycle for MotorPwm<'_> {
    fn max_duty_cycle(&self) -> u16 {
        FULL_DUTY
    }

    /// A duty above [`FULL_DUTY`] counts as full.
    fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
        self.motor.duty.store(duty.min(FULL_DUTY), Relaxed);
        self.motor.written.store(true, Relaxed);
        Ok(())
    }
}

/// Direction output of one motor; high is backwards.
#[derive(Debug)]
pub struct DirectionPin<'a> {
    motor: &'a MotorPins,
}

impl digital::ErrorType for DirectionPin<'_> {
    type Error = Infallible;
}

impl OutputPin for DirectionPin<'_> {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.motor.backwards.store(false, Relaxed);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.motor.backwards.store(true, Relaxed);
        Ok(())
    }
}

/// Trigger input of one sonar: going high starts a ping.
#[derive(Debug)]
pub struct TriggerPin<'a> {
    latch: &'a AtomicBool,
}

impl digital::ErrorType for TriggerPin<'_> {
    type Error = Infallible;
}

impl OutputPin for TriggerPin<'_> {
    /// Changes nothing: the falling edge means nothing to a sonar, and the pulse must outlast it
    /// until the next snapshot.
    fn set_low(&mut self) -> Result<(), Infallible> {
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.latch.store(true, Relaxed);
        Ok(())
    }
}

/// One digital output for the user's own driver.
#[derive(Debug)]
pub struct AuxOutput<'a> {
    level: &'a AtomicBool,
}

impl digital::ErrorType for AuxOutput<'_> {
    type Error = Infallible;
}

impl OutputPin for AuxOutput<'_> {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.level.store(false, Relaxed);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.level.store(true, Relaxed);
        Ok(())
    }
}

/// The input of the emergency stop's button; low is pressed.
pub type StopPin<'a> = InPin<'a>;

/// An input that a switch pulls low: of the emergency stop's button, of a bumper.
#[derive(Debug)]
pub struct InPin<'a> {
    is_low: &'a AtomicBool,
}

impl digital::ErrorType for InPin<'_> {
    type Error = Infallible;
}

impl InputPin for InPin<'_> {
    fn is_high(&mut self) -> Result<bool, Infallible> {
        Ok(!self.is_low.load(Relaxed))
    }

    fn is_low(&mut self) -> Result<bool, Infallible> {
        Ok(self.is_low.load(Relaxed))
    }
}

/// Counter of one wheel's encoder.
#[derive(Debug)]
pub struct EncoderCount<'a> {
    count: &'a AtomicU16,
}

impl EncoderCounter for EncoderCount<'_> {
    fn count(&mut self) -> u16 {
        self.count.load(Relaxed)
    }
}

/// Echo timer of one sonar.
#[derive(Debug)]
pub struct EchoCapture<'a> {
    echo_us: &'a AtomicU16,
    high: &'a AtomicBool,
}

impl EchoTimer for EchoCapture<'_> {
    fn pulse(&mut self) -> EchoPulse {
        match (self.echo_us.load(Relaxed), self.high.load(Relaxed)) {
            (0, false) => EchoPulse::None,
            (us, true) => EchoPulse::High { us },
            (us, false) => EchoPulse::Over { us },
        }
    }
}

/// One analogue input.
#[derive(Debug)]
pub struct AnalogChannel<'a> {
    counts: &'a AtomicU16,
}

impl AnalogIn for AnalogChannel<'_> {
    fn counts(&mut self) -> u16 {
        self.counts.load(Relaxed)
    }

    fn full_scale(&self) -> u16 {
        ADC_FULL_SCALE
    }
}

/// Values for tests in which every field differs.
#[cfg(test)]
pub(super) fn distinct_sensors() -> Sensors {
    Sensors {
        left_count: 0x0102,
        right_count: 0xFEFD,
        echo_us: array::from_fn(|i| 1_000 + i as u16),
        echo_high: 0b0101_0110,
        adc_counts: array::from_fn(|i| 2_000 + i as u16),
        stop_is_low: true,
        bumper_is_low: [false, true],
        yaw_counts: -300,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn duty_and_direction_make_a_signed_duty() {
        for (duty, backwards, expected) in [
            (0, false, 0),
            (250, false, 250),
            (250, true, -250),
            (FULL_DUTY, true, -1_000),
            (u16::MAX, false, 1_000),
        ] {
            let pins = PinImage::new();
            let mut parts = pins.parts();
            parts.left_pwm.set_duty_cycle(duty).unwrap();
            parts.left_direction.set_state(backwards.into()).unwrap();
            let actuators = pins.take_actuators();
            assert_eq!(actuators.left_duty, expected, "{duty} {backwards}");
            assert_eq!(actuators.right_duty, 0);
        }
    }

    #[test]
    fn a_trigger_pulse_is_seen_by_exactly_one_snapshot() {
        let pins = PinImage::new();
        let mut parts = pins.parts();
        for sonar in [0, 5] {
            parts.sonar_triggers[sonar].set_high().unwrap();
            parts.sonar_triggers[sonar].set_low().unwrap();
        }
        assert_eq!(pins.take_actuators().sonar_triggers, 0b0010_0001);
        assert_eq!(pins.take_actuators().sonar_triggers, 0);
    }

    #[test]
    fn safe_switches_off_motors_and_auxiliary_outputs() {
        let pins = PinImage::new();
        let mut parts = pins.parts();
        parts.left_pwm.set_duty_cycle(10).unwrap();
        parts.right_pwm.set_duty_cycle(10).unwrap();
        parts.aux_outputs[3].set_high().unwrap();
        assert_eq!(pins.take_actuators().aux_outputs, 0b1000);
        pins.safe();
        assert_eq!(pins.take_actuators(), Actuators::default());
    }

    #[test]
    fn drivers_read_what_the_plant_put_on_the_inputs() {
        let pins = PinImage::new();
        let sensors = distinct_sensors();
        pins.set_sensors(&sensors);
        let mut parts = pins.parts();
        assert_eq!(parts.left_encoder.count(), sensors.left_count);
        assert_eq!(parts.right_encoder.count(), sensors.right_count);
        assert_eq!(
            parts.echo_timers.each_mut().map(|echo| echo.pulse()),
            array::from_fn(|sonar| {
                let us = sensors.echo_us[sonar];
                match sensors.echo_high >> sonar & 1 {
                    0 => EchoPulse::Over { us },
                    _ => EchoPulse::High { us },
                }
            })
        );
        assert_eq!(
            parts.analog.each_mut().map(|channel| channel.counts()),
            sensors.adc_counts
        );
        assert_eq!(pins.sensors(), sensors);
        assert_eq!(pins.stop_button().is_low(), Ok(true));
        let bumpers = parts.bumpers.each_mut().map(|bumper| bumper.is_low());
        assert_eq!(bumpers, [Ok(false), Ok(true)]);
        pins.set_sensors(&Sensors::default());
        assert_eq!(parts.echo_timers[0].pulse(), EchoPulse::None);
        assert_eq!(pins.stop_button().is_high(), Ok(true));
    }
}
