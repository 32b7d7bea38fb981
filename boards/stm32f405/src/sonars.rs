//! Sonars: their triggers, and their echoes, timed by the capture units of TIM5 and TIM1 to a
//! microsecond, without the processor.
//!
//! Each echo pin leads to two channels of its timer, of which one keeps the time of the edge up and
//! the other that of the edge down. Two neighbours share a pin, and never ping at once.

use core::convert::Infallible;
use core::sync::atomic::{AtomicU16, Ordering::Relaxed};

use cortex_m_board::sys_tick;
use embedded_hal::digital::{self, OutputPin};
use rt_firmware::body::SONARS;
use rt_firmware::drivers::{EchoPulse, EchoTimer};

use crate::clock::{self, TICKS_PER_US};
use crate::pac::{TIM1, TIM5, tim5};
use crate::pins::{Function, Pin};
use crate::{parts, wiring};

/// How long a trigger is high, in microseconds: an HC-SR04 asks for 10.
pub const TRIGGER_US: u32 = 10;

/// The last ping at each echo pin: its number, and which of the two neighbours it was. One task has
/// all sonars, so load and store suffice.
static PINGS: [AtomicU16; wiring::ECHOES.len()] =
    [const { AtomicU16::new(0) }; wiring::ECHOES.len()];

/// A timer that times echoes.
#[derive(Clone, Copy, Debug)]
enum Timer {
    Tim5,
    Tim1,
}

impl Timer {
    /// For what is done here, the registers of TIM1 are those of TIM5 (RM0090, 17.4 and 18.4), with
    /// counts of 16 bits.
    fn registers(self) -> &'static tim5::RegisterBlock {
        // SAFETY: the registers are there for the chip's whole life; nobody else has them.
        unsafe {
            match self {
                Timer::Tim5 => &*TIM5::PTR,
                Timer::Tim1 => &*TIM1::PTR.cast(),
            }
        }
    }
}

/// An echo pin's two channels of a timer, as numbers of its registers from 0 on.
#[derive(Clone, Copy, Debug)]
struct Capture {
    timer: Timer,
    up: usize,
    down: usize,
}

impl Capture {
    /// Flags of both channels in the status register.
    fn flags(self) -> u32 {
        self.flag(self.up) | self.flag(self.down)
    }

    /// A channel's flag there.
    fn flag(self, channel: usize) -> u32 {
        1 << (channel + 1)
    }

    fn has_seen(self, channel: usize) -> bool {
        self.timer.registers().sr().read().bits() & self.flag(channel) != 0
    }

    /// When the channel's edge was, in microseconds; its flag is taken back by that.
    fn at_us(self, channel: usize) -> u16 {
        self.timer.registers().ccr(channel).read().bits() as u16
    }

    fn now_us(self) -> u16 {
        self.timer.registers().cnt().read().bits() as u16
    }

    /// Forgets what it has seen.
    fn clear(self) {
        // SAFETY: flags are taken back by zeros, and ones leave them.
        (self.timer.registers().sr()).write(|w| unsafe { w.bits(!self.flags()) });
    }
}

/// Where a sonar is triggered.
#[derive(Debug)]
pub struct Trigger {
    pin: Pin,
    sonar: usize,
    capture: Capture,
    /// What SysTick showed when the pin went up.
    began: u32,
}

/// What the echo pin of a sonar does.
#[derive(Debug)]
pub struct Echo {
    sonar: usize,
    capture: Capture,
    /// The ping that the rest belongs to.
    ping: u16,
    up_us: Option<u16>,
    lasted_us: Option<u16>,
}

/// The sonars, in their order.
pub(crate) fn start() -> ([Trigger; SONARS], [Echo; SONARS]) {
    const TIMERS_1_AND_2: u8 = 1;
    const TIMERS_3_TO_5: u8 = 2;
    parts::rcc().apb1enr().modify(|_, w| w.tim5en().enabled());
    parts::rcc().apb2enr().modify(|_, w| w.tim1en().enabled());
    start_timer(Timer::Tim5.registers(), clock::CORE_HZ / 2, true);
    start_timer(Timer::Tim1.registers(), clock::CORE_HZ, false);
    let captures = [
        (Timer::Tim5, 0, 1),
        (Timer::Tim5, 2, 3),
        (Timer::Tim1, 0, 1),
        (Timer::Tim1, 2, 3),
    ]
    .map(|(timer, up, down)| Capture { timer, up, down });
    for (place, pin) in wiring::ECHOES.into_iter().enumerate() {
        let part = if place < 2 {
            TIMERS_3_TO_5
        } else {
            TIMERS_1_AND_2
        };
        // Diodes leave a pin that no sonar drives to its resistor.
        pin.set_function(Function::Part(part));
    }
    for pin in wiring::TRIGGERS {
        pin.set_function(Function::Output);
    }
    let sonars: [usize; SONARS] = core::array::from_fn(|sonar| sonar);
    let triggers = sonars.map(|sonar| Trigger {
        pin: wiring::TRIGGERS[sonar],
        sonar,
        capture: captures[sonar / 2],
        began: 0,
    });
    let echoes = sonars.map(|sonar| Echo {
        sonar,
        capture: captures[sonar / 2],
        ping: 0,
        up_us: None,
        lasted_us: None,
    });
    (triggers, echoes)
}

/// Starts a timer whose clock is so fast, at a count a microsecond. Channels of one input are pairs:
/// 1 and 2 are at input 1. The second pair of its channels
/// is at its input 3, or at its input 4.
fn start_timer(timer: &tim5::RegisterBlock, clock_hz: u32, is_at_3: bool) {
    /// Eight equal looks at the timer's clock make an edge.
    const EIGHT_LOOKS: u32 = 0b0011 << 4 | 0b0011 << 12;
    /// The first channel of a pair is at the input of its own number, the other at the same.
    const OWN_AND_OTHER: u32 = 0b01 | 0b10 << 8;
    /// The other way round.
    const OTHER_AND_OWN: u32 = 0b10 | 0b01 << 8;
    /// All channels on; the second of each pair sees edges down.
    const ENABLED: u32 = 0b0011_0001_0011_0001;
    let second = if is_at_3 {
        OWN_AND_OTHER
    } else {
        OTHER_AND_OWN
    };
    // SAFETY: bits as the registers take them.
    unsafe {
        timer
            .psc()
            .write(|w| w.bits((clock_hz / 1_000_000 - 1) as _));
        timer.arr().write(|w| w.bits(u32::MAX));
        (timer.ccmr1_input()).write(|w| w.bits(EIGHT_LOOKS | OWN_AND_OTHER));
        (timer.ccmr2_input()).write(|w| w.bits(EIGHT_LOOKS | second));
        timer.ccer().write(|w| w.bits(ENABLED));
    }
    timer.egr().write(|w| w.ug().update());
    timer.cr1().write(|w| w.cen().enabled());
}

/// The number that a ping has beside its sonar's: which of the two at an echo pin.
fn neighbour(sonar: usize) -> u16 {
    (sonar % 2) as u16
}

impl digital::ErrorType for Trigger {
    type Error = Infallible;
}

impl OutputPin for Trigger {
    fn set_high(&mut self) -> Result<(), Infallible> {
        let last = &PINGS[self.sonar / 2];
        // Even steps: the lowest bit says whose it is. 0 is no ping at all.
        let number = (last.load(Relaxed) | 1).wrapping_add(1).max(2);
        last.store(number | neighbour(self.sonar), Relaxed);
        self.capture.clear();
        self.pin.set_level(true);
        self.began = sys_tick::count();
        Ok(())
    }

    /// Waits until the trigger was high for long enough.
    fn set_low(&mut self) -> Result<(), Infallible> {
        /// Looks at the clock, which are more than the time has instructions.
        const LOOKS: u32 = TRIGGER_US * clock::CORE_HZ / 1_000_000;
        for _ in 0..LOOKS {
            let since = sys_tick::count().wrapping_sub(self.began) & sys_tick::MAX;
            if since > TRIGGER_US * TICKS_PER_US {
                break;
            }
        }
        self.pin.set_level(false);
        Ok(())
    }
}

impl EchoTimer for Echo {
    fn pulse(&mut self) -> EchoPulse {
        let ping = PINGS[self.sonar / 2].load(Relaxed);
        if ping == 0 || ping & 1 != neighbour(self.sonar) {
            return EchoPulse::None;
        }
        if ping != self.ping {
            self.ping = ping;
            self.up_us = None;
            self.lasted_us = None;
        }
        let capture = self.capture;
        // Down first: what comes between two looks is seen by the next.
        let has_ended = capture.has_seen(capture.down);
        if self.up_us.is_none() && capture.has_seen(capture.up) {
            self.up_us = Some(capture.at_us(capture.up));
        }
        let Some(up_us) = self.up_us else {
            if has_ended {
                // The end of a pulse from before the trigger.
                capture.at_us(capture.down);
            }
            return EchoPulse::None;
        };
        if has_ended && self.lasted_us.is_none() {
            /// An end before the beginning was that of a pulse from before the trigger.
            const LONGEST_US: u16 = u16::MAX / 2;
            let us = capture.at_us(capture.down).wrapping_sub(up_us);
            self.lasted_us = (us <= LONGEST_US).then_some(us);
        }
        match self.lasted_us {
            Some(us) => EchoPulse::Over { us },
            None => EchoPulse::High {
                us: capture.now_us().wrapping_sub(up_us),
            },
        }
    }
}
