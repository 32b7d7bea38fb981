//! The link of missions over CAN: CAN 1 on PB8 (RX) and PB9 (TX), behind a transceiver, and timer
//! 12, which starts frames (RM0090, 32 and 19).
//!
//! The controller sends again what has lost an arbitration, and what was disturbed: it does not
//! tell them apart.

use bxcan::filter::Mask32;
use bxcan::{Can, Fifo, FilterOwner, Instance, Interrupt as Event, RegisterBlock};
use cortex_m::peripheral::NVIC;
use cortex_m_board::can_line::{self, CanChip, CanLine, FrameOf};
use rt_firmware::frames::can::CanQueues;

use super::pins::Function;
use super::wiring;
use crate::pac::{CAN1, Interrupt, TIM12, can1, tim9};
use crate::{Stm32f405, clock};

/// Parts of a bit: one to begin, 11 up to where it is looked at, 2 behind that.
const BIT: [u32; 3] = [1, 11, 2];
/// Bits a second that the bus could have if it were divided by nothing: APB1 has 42 MHz.
const FASTEST_BPS: u32 = clock::CORE_HZ / 4 / (BIT[0] + BIT[1] + BIT[2]);

/// The controller, of which there is one.
pub struct Can1;

// SAFETY: there is one value of this type, which `start` makes once; nobody else has the registers.
unsafe impl Instance for Can1 {
    const REGISTERS: *mut RegisterBlock = CAN1::PTR.cast_mut().cast();
}

// SAFETY: CAN 1 has the filters, 28 with those of CAN 2, which is not used.
unsafe impl FilterOwner for Can1 {
    const NUM_FILTER_BANKS: u8 = 28;
}

fn controller() -> &'static can1::RegisterBlock {
    // SAFETY: the registers are there for the chip's whole life; what is written here is written
    // by the frames' interrupts, which are of one priority, and at the start.
    unsafe { &*CAN1::PTR }
}

fn timer() -> &'static tim9::RegisterBlock {
    // SAFETY: the same.
    unsafe { &*TIM12::PTR }
}

/// Asks for the controller's initialisation. Answers whether it began: a controller without a clock
/// never does.
fn can_be_set() -> bool {
    /// Looks that are longer than a bit of the slowest bus.
    const LOOKS: u32 = 10_000;
    (controller().mcr()).modify(|_, w| w.sleep().clear_bit().inrq().set_bit());
    (0..LOOKS).any(|_| {
        let status = controller().msr().read();
        status.inak().bit_is_set() && status.slak().bit_is_clear()
    })
}

impl CanChip for Stm32f405 {
    type Controller = Can<Can1>;

    fn start() -> Can<Can1> {
        const CAN_1_AND_2: Function = Function::PulledUpPart(9);
        (wiring::CAN.into_iter()).for_each(|pin| pin.set_function(CAN_1_AND_2));
        clock::rcc().apb1enr().modify(|_, w| {
            w.can1en().enabled();
            w.tim12en().enabled()
        });
        assert!(can_be_set(), "CAN 1 has no clock");
        let mut can = Can::builder(Can1).leave_disabled();
        can.modify_filters()
            .enable_bank(0, Fifo::Fifo0, Mask32::accept_all());
        can.enable_interrupt(Event::Fifo0MessagePending);
        // As the clock counts: 84 MHz by four.
        const DIVISOR: u16 = (clock::CORE_HZ / 2 / 1_000_000 / clock::TICKS_PER_US) as u16;
        // SAFETY: any bits are a prescaler.
        (timer().psc()).write(|w| unsafe { w.psc().bits(DIVISOR - 1) });
        timer().dier().write(|w| w.uie().set_bit());
        can
    }

    /// The nearest rate that the bus can have. A controller that does not answer keeps its own.
    ///
    /// Not by `bxcan`, which waits for the controller without an end: slots wait behind this.
    fn set_rate(_can: &mut Can<Can1>, rate_bps: u32) {
        let divisor = (FASTEST_BPS + rate_bps / 2) / rate_bps.max(1);
        let timing = (divisor.clamp(1, 1_024) - 1) | (BIT[1] - 1) << 16 | (BIT[2] - 1) << 20;
        if can_be_set() {
            // SAFETY: parts of a bit and a divisor as the register takes them.
            (controller().btr()).write(|w| unsafe { w.bits(timing) });
            // It is on when the bus has been silent for 11 bits, and comes back after it was off.
            (controller().mcr()).modify(|_, w| w.inrq().clear_bit().abom().set_bit());
        }
    }

    /// The timer has 16 bits: for a longer time it calls before, and is set anew.
    fn set_timer(ticks: u32) {
        let ticks = ticks.clamp(1, 1 << 16);
        // SAFETY: 16 bits are a count.
        (timer().arr()).write(|w| unsafe { w.bits((ticks - 1) as _) });
        // Count and prescaler begin anew, which is no update that interrupts.
        timer().cr1().write(|w| w.urs().set_bit());
        timer().egr().write(|w| w.ug().set_bit());
        (timer().cr1()).write(|w| w.urs().set_bit().opm().set_bit().cen().set_bit());
    }

    fn acknowledge_timer() {
        timer().cr1().reset();
        timer().sr().reset();
    }

    fn call() {
        NVIC::pend(Interrupt::TIM8_BRK_TIM12);
    }
}

/// The interrupts' end of the link.
pub struct Line(CanLine<Stm32f405>);

impl Line {
    /// Starts the link, and gives the board its device.
    pub fn start(board: &mut super::SlotBoard) -> Self {
        let queues = cortex_m::singleton!(: CanQueues<FrameOf<Stm32f405>> = CanQueues::new());
        let Some(queues) = queues else {
            panic!("the link's device is there once");
        };
        let (line, device) = can_line::start(queues);
        board.board_mut().connect(device);
        Line(line)
    }

    /// See [`CanLine::start_due`].
    pub fn start_due(&mut self) {
        self.0.start_due();
    }

    /// See [`CanLine::serve`].
    pub fn serve(&mut self) {
        self.0.serve();
    }
}
