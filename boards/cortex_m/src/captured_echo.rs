//! Sonars whose echoes are timed by capture units of a chip's timer, to a microsecond and without
//! the processor: one channel keeps the time of the edge up, another that of the edge down.

use core::convert::Infallible;

use embedded_hal::digital::{self, OutputPin};
use rt_firmware::drivers::{EchoPulse, EchoTimer};

use crate::pings::{Ping, Pings};
use crate::sys_tick;

/// How long a trigger is high, in microseconds: an HC-SR04 asks for 10.
pub const TRIGGER_US: u32 = 10;

/// The two channels of a timer at an echo pin, whose counts are microseconds, in 16 bits.
pub trait Capture: Copy {
    /// When the pin went up, if it has since that was asked for last.
    fn take_up_us(self) -> Option<u16>;

    /// When the pin went down, if it has since that was asked for last.
    fn take_down_us(self) -> Option<u16>;

    /// The timer's count.
    fn now_us(self) -> u16;
}

/// A sonar: at which echo pin, which of those that share it, from 1 on, and who tells the pings of
/// it from theirs.
#[derive(Clone, Copy)]
pub struct Place<const PINS: usize> {
    /// The pings of all.
    pub pings: &'static Pings<PINS>,
    /// The echo pin.
    pub pin: usize,
    /// Which of its sonars.
    pub number: u8,
}

/// Where a sonar is triggered.
pub struct Trigger<O, C, const PINS: usize> {
    /// The pin.
    pub output: O,
    /// Which sonar it is.
    pub place: Place<PINS>,
    /// What times its echo.
    pub capture: C,
    /// Ticks of SysTick in a microsecond.
    pub ticks_per_us: u32,
}

impl<O, C, const PINS: usize> digital::ErrorType for Trigger<O, C, PINS> {
    type Error = Infallible;
}

impl<O, C, const PINS: usize> OutputPin for Trigger<O, C, PINS>
where
    O: OutputPin<Error = Infallible>,
    C: Capture,
{
    fn set_low(&mut self) -> Result<(), Infallible> {
        Ok(())
    }

    /// Sends the trigger, and waits for as long as it lasts.
    fn set_high(&mut self) -> Result<(), Infallible> {
        self.place.pings.begin(self.place.pin, self.place.number);
        // What was captured is of a ping before.
        let _ = (self.capture.take_up_us(), self.capture.take_down_us());
        let ticks = TRIGGER_US * self.ticks_per_us;
        let begun = sys_tick::count();
        self.output.set_high()?;
        // A look takes a tick at most, on any chip that is fast enough for slots.
        for _ in 0..64 * ticks {
            if sys_tick::count().wrapping_sub(begun) & sys_tick::MAX > ticks {
                break;
            }
        }
        self.output.set_low()
    }
}

/// What the echo pin of a sonar does.
pub struct Echo<C, const PINS: usize> {
    place: Place<PINS>,
    capture: C,
    /// The ping that the rest belongs to.
    ping: Ping,
    up_us: Option<u16>,
    lasted_us: Option<u16>,
}

impl<C, const PINS: usize> Echo<C, PINS> {
    /// That of this sonar.
    pub fn new(place: Place<PINS>, capture: C) -> Self {
        Echo {
            place,
            capture,
            ping: Ping::default(),
            up_us: None,
            lasted_us: None,
        }
    }
}

impl<C: Capture, const PINS: usize> EchoTimer for Echo<C, PINS> {
    fn pulse(&mut self) -> EchoPulse {
        /// An end before the beginning was that of a pulse from before the trigger.
        const LONGEST_US: u16 = u16::MAX / 2;
        let ping = self.place.pings.last(self.place.pin);
        if !ping.is_of(self.place.number) {
            return EchoPulse::None;
        }
        if ping != self.ping {
            self.ping = ping;
            self.up_us = None;
            self.lasted_us = None;
        }
        // Down first: what comes between the two looks is seen by the next.
        let down_us = self.capture.take_down_us();
        self.up_us = self.up_us.or_else(|| self.capture.take_up_us());
        let Some(up_us) = self.up_us else {
            return EchoPulse::None;
        };
        let lasted_us = down_us.map(|down_us| down_us.wrapping_sub(up_us));
        let lasted_us = lasted_us.filter(|us| *us <= LONGEST_US);
        self.lasted_us = self.lasted_us.or(lasted_us);
        match self.lasted_us {
            Some(us) => EchoPulse::Over { us },
            None => EchoPulse::High {
                us: self.capture.now_us().wrapping_sub(up_us),
            },
        }
    }
}
