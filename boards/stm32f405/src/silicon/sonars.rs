//! Sonars: their triggers, and their echoes, timed by the capture units of TIM5 and TIM1
//! ([`captured_echo`]). Two neighbours share an echo pin, and never
//! ping at once.

use cortex_m_board::captured_echo::{self, Capture, Place};
use cortex_m_board::pings::Pings;
use rt_firmware::body::SONARS;

use super::pins::{Function, Pin};
use super::wiring;
use crate::clock::{self, TICKS_PER_US};
use crate::pac::{TIM1, TIM5, tim5};

const PINS: usize = wiring::ECHOES.len();

static PINGS: Pings<PINS> = Pings::new();

/// Where a sonar is triggered.
pub type Trigger = captured_echo::Trigger<Pin, Channels, PINS>;
/// What the echo pin of a sonar does.
pub type Echo = captured_echo::Echo<Channels, PINS>;

/// The two channels of an echo pin: 1 and 2 or 3 and 4 of TIM5, or of TIM1.
#[derive(Clone, Copy, Debug)]
pub struct Channels {
    is_tim1: bool,
    /// The one for edges up, from 0 on; the other is the next.
    up: usize,
}

impl Channels {
    /// For what is done here, the registers of TIM1 are those of TIM5 (RM0090, 17.4 and 18.4), with
    /// counts of 16 bits.
    fn timer(self) -> &'static tim5::RegisterBlock {
        // SAFETY: the registers are there for the chip's whole life; nobody else has them.
        unsafe {
            match self.is_tim1 {
                true => &*TIM1::PTR.cast(),
                false => &*TIM5::PTR,
            }
        }
    }

    /// When a channel has seen its edge; its flag is taken back by that.
    fn take_us(self, channel: usize) -> Option<u16> {
        let has_seen = self.timer().sr().read().bits() & 1 << (channel + 1) != 0;
        has_seen.then(|| self.timer().ccr(channel).read().bits() as u16)
    }
}

impl Capture for Channels {
    fn take_up_us(self) -> Option<u16> {
        self.take_us(self.up)
    }

    fn take_down_us(self) -> Option<u16> {
        self.take_us(self.up + 1)
    }

    fn now_us(self) -> u16 {
        self.timer().cnt().read().bits() as u16
    }
}

/// The sonars, in their order.
pub(crate) fn start() -> ([Trigger; SONARS], [Echo; SONARS]) {
    clock::rcc().apb1enr().modify(|_, w| w.tim5en().enabled());
    clock::rcc().apb2enr().modify(|_, w| w.tim1en().enabled());
    let channels: [Channels; PINS] = core::array::from_fn(|pin| Channels {
        is_tim1: pin >= 2,
        up: pin % 2 * 2,
    });
    start_timer(channels[0], clock::CORE_HZ / 2);
    start_timer(channels[2], clock::CORE_HZ);
    for (pin, channels) in wiring::ECHOES.into_iter().zip(channels) {
        // Diodes leave a pin that no sonar drives to its resistor.
        pin.set_function(Function::Part(if channels.is_tim1 { 1 } else { 2 }));
    }
    for pin in wiring::TRIGGERS {
        pin.set_function(Function::Output);
    }
    let place = |sonar: usize| Place {
        pings: &PINGS,
        pin: sonar / 2,
        number: (sonar % 2) as u8 + 1,
    };
    let triggers = core::array::from_fn(|sonar| Trigger {
        output: wiring::TRIGGERS[sonar],
        place: place(sonar),
        capture: channels[sonar / 2],
        ticks_per_us: TICKS_PER_US,
    });
    let echoes = core::array::from_fn(|sonar| Echo::new(place(sonar), channels[sonar / 2]));
    (triggers, echoes)
}

/// Starts a timer whose clock is so fast, at a count a microsecond. Its channels are pairs: 1 and 2
/// are at its input 1; 3 and 4 at its input 3, or at input 4 of TIM1.
fn start_timer(channels: Channels, clock_hz: u32) {
    /// Eight equal looks at the timer's clock make an edge.
    const EIGHT_LOOKS: u32 = 0b0011 << 4 | 0b0011 << 12;
    /// The first channel of a pair is at the input of its own number, the other at the same.
    const OWN_AND_OTHER: u32 = 0b01 | 0b10 << 8;
    /// The other way round.
    const OTHER_AND_OWN: u32 = 0b10 | 0b01 << 8;
    /// All channels on; the second of each pair sees edges down.
    const ENABLED: u32 = 0b0011_0001_0011_0001;
    let second = match channels.is_tim1 {
        true => OTHER_AND_OWN,
        false => OWN_AND_OTHER,
    };
    let timer = channels.timer();
    // SAFETY: bits as the registers take them.
    unsafe {
        (timer.psc()).write(|w| w.bits((clock_hz / 1_000_000 - 1) as _));
        timer.arr().write(|w| w.bits(u32::MAX));
        (timer.ccmr1_input()).write(|w| w.bits(EIGHT_LOOKS | OWN_AND_OTHER));
        (timer.ccmr2_input()).write(|w| w.bits(EIGHT_LOOKS | second));
        timer.ccer().write(|w| w.bits(ENABLED));
    }
    timer.egr().write(|w| w.ug().update());
    timer.cr1().write(|w| w.cen().enabled());
}
