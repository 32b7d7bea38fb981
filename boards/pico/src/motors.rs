//! Two brushed motors behind H-bridges that take two inputs a motor, as a DRV8833 or an L298 does:
//! the one that is driven says which way, its duty how much, and both low let the motor run out.
//! One PWM slice a motor, at 20 kHz, which nobody hears.

use core::convert::Infallible;
use core::sync::atomic::{AtomicBool, Ordering::Relaxed};

use embedded_hal::digital::{self, OutputPin};
use embedded_hal::pwm::{self, SetDutyCycle};
use rp2040_hal::pac::PWM;
use rp2040_hal::pwm::{FreeRunning, Pwm1, Pwm2, Slice};

/// Frequency of the PWM in hertz.
pub const PWM_HZ: u32 = 20_000;
/// Counts of a period of the PWM, at a system clock of 125 MHz; the duty that is always on.
pub const PERIOD_COUNTS: u16 = (125_000_000 / PWM_HZ) as u16;

/// Which way each motor is to turn: left, right. Written by its direction, read by its power.
static BACKWARDS: [AtomicBool; 2] = [const { AtomicBool::new(false) }; 2];

/// A motor's PWM slice, with both its channels on pins.
type Pwm<I> = Slice<I, FreeRunning>;

/// How much power a motor gets, through the bridge's input that its [`Direction`] says.
pub struct Power<S> {
    slice: S,
    backwards: &'static AtomicBool,
}

/// Which way a motor is to turn; high is backwards. It takes effect with the next duty.
pub struct Direction {
    backwards: &'static AtomicBool,
}

/// The left motor's power.
pub type LeftPower = Power<Pwm<Pwm1>>;
/// The right motor's power.
pub type RightPower = Power<Pwm<Pwm2>>;

macro_rules! motor {
    ($slice:ty, $place:literal, $make:ident) => {
        /// The motor of this slice, whose pins are the bridge's two inputs: forwards, backwards.
        pub(crate) fn $make(mut slice: Pwm<$slice>) -> (Power<Pwm<$slice>>, Direction) {
            slice.set_top(PERIOD_COUNTS - 1);
            slice.enable();
            let backwards = &BACKWARDS[$place];
            (Power { slice, backwards }, Direction { backwards })
        }

        impl pwm::ErrorType for Power<Pwm<$slice>> {
            type Error = Infallible;
        }

        impl SetDutyCycle for Power<Pwm<$slice>> {
            fn max_duty_cycle(&self) -> u16 {
                PERIOD_COUNTS
            }

            fn set_duty_cycle(&mut self, duty: u16) -> Result<(), Infallible> {
                let duty = duty.min(PERIOD_COUNTS);
                let (driven, other) = if self.backwards.load(Relaxed) {
                    (
                        &mut self.slice.channel_b as &mut dyn SetDutyCycle<Error = Infallible>,
                        &mut self.slice.channel_a as &mut dyn SetDutyCycle<Error = Infallible>,
                    )
                } else {
                    (
                        &mut self.slice.channel_a as _,
                        &mut self.slice.channel_b as _,
                    )
                };
                // Never both: that would be a brake.
                other.set_duty_cycle(0)?;
                driven.set_duty_cycle(duty)
            }
        }
    };
}

motor!(Pwm1, 0, left);
motor!(Pwm2, 1, right);

impl digital::ErrorType for Direction {
    type Error = Infallible;
}

impl OutputPin for Direction {
    fn set_low(&mut self) -> Result<(), Infallible> {
        self.backwards.store(false, Relaxed);
        Ok(())
    }

    fn set_high(&mut self) -> Result<(), Infallible> {
        self.backwards.store(true, Relaxed);
        Ok(())
    }
}

/// Takes both inputs of both bridges low. From any context, also where the firmware ends.
pub fn all_off() {
    const SLICES: [usize; 2] = [1, 2];
    // SAFETY: the registers are there for the chip's whole life, and a duty of 0 is what the
    // motors' owners would write; theirs comes with the next step of a task, if one comes.
    let pwm = unsafe { &*PWM::ptr() };
    for slice in SLICES {
        // SAFETY: any bits are two duties.
        (pwm.ch(slice).cc()).write(|w| unsafe { w.bits(0) });
    }
}
