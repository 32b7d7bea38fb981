//! The I2C bus of the robot's sensors, at 400 kHz. Whoever asks waits: a byte takes 22.5 µs, and
//! what takes longer than its bytes may is given up ([`bounded_i2c`](cortex_m_board::bounded_i2c)).
//!
//! The chip's block is reached by its registers, for the loops of both HALs wait without a bound: a
//! sensor that holds the clock low would stop the robot's tasks until the watchdog resets it.

use core::sync::atomic::AtomicU32;

use cortex_m_board::bounded_i2c::{Bounded, Controller};

use crate::chip::SYSTEM_HZ;
use crate::clock;
use crate::free_pins::{FreePins, take};
use crate::hal::gpio::{FunctionI2C, PullUp};
use crate::hal::pac::{I2C0, I2C1, IO_BANK0, RESETS, SIO, i2c0};
use crate::wiring::I2cPins;

/// The bus's clock in hertz: the fast mode, which all sensors here have.
pub const BUS_HZ: u32 = 400_000;

/// When the bus hung.
static HUNG_US: AtomicU32 = AtomicU32::new(0);

/// Numbers of a pin's functions (data sheet of the RP2040, table 289; of the RP2350, table 646).
const IS_I2C: u8 = 3;
const IS_SIO: u8 = 5;

/// The bus. Its drivers share it: they belong to real-time tasks, of which none interrupts another.
pub type Bus = Bounded<Block>;

/// The block of the bus, at its pins.
#[derive(Clone, Copy, Debug)]
pub struct Block {
    pins: I2cPins,
}

/// The bus at these pins.
///
/// # Panics
/// If another part has one of them.
pub(crate) fn start(pins: I2cPins, free: &mut FreePins) -> Bus {
    let _wires = [pins.sda, pins.scl].map(|pin| take!(free, pin, FunctionI2C, PullUp));
    let block = Block { pins };
    block.begin();
    Bounded(block)
}

impl Block {
    /// Every second pair of pins belongs to the other block.
    fn is_first(self) -> bool {
        (self.pins.sda / 2).is_multiple_of(2)
    }

    fn registers(self) -> &'static i2c0::RegisterBlock {
        // SAFETY: the registers are there for the chip's whole life. The drivers that have the bus
        // are of tasks that do not interrupt each other.
        unsafe {
            &*if self.is_first() {
                I2C0::ptr()
            } else {
                I2C1::ptr()
            }
        }
    }

    /// Clocks whoever holds the data low in the middle of a byte to its end: nine clocks, by hand
    /// (UM10204, section 3.1.16).
    fn let_go(self) {
        // SAFETY: of the outputs, bits that are written are set or cleared, and the others left;
        // the pin is the bus's.
        let (sio, io) = unsafe { (&*SIO::ptr(), &*IO_BANK0::ptr()) };
        let pin = 1 << self.pins.scl;
        // SAFETY: functions that the pin has.
        let function = |is: u8| unsafe {
            let control = io.gpio(self.pins.scl.into()).gpio_ctrl();
            control.modify(|_, w| w.funcsel().bits(is));
        };
        // SAFETY: as above. Low is driven; high is left to the resistor.
        unsafe { sio.gpio_out_clr().write(|w| w.bits(pin)) };
        function(IS_SIO);
        for half in 0..18 {
            match half % 2 {
                // SAFETY: as above.
                0 => unsafe { sio.gpio_oe_set().write(|w| w.bits(pin)) },
                // SAFETY: as above.
                _ => unsafe { sio.gpio_oe_clr().write(|w| w.bits(pin)) },
            };
            let began = clock::count();
            while clock::count().wrapping_sub(began) < 3 {}
        }
        function(IS_I2C);
    }
}

impl Controller for Block {
    /// Twice its nine bits.
    const BYTE_US: u32 = 45;
    const MARGIN_US: u32 = 50;

    fn hung_us(&self) -> &'static AtomicU32 {
        &HUNG_US
    }

    fn now_us(&self) -> u32 {
        clock::count()
    }

    /// Begins anew, whatever was: takes 60 µs.
    fn begin(&self) {
        /// Low for three fifths of a period: 1.5 µs, of which a sensor asks for 1.3 (UM10204, table
        /// 10).
        const LOW: u16 = (SYSTEM_HZ / BUS_HZ * 3 / 5) as u16;
        const HIGH: u16 = (SYSTEM_HZ / BUS_HZ) as u16 - LOW;
        /// Data changes 0.3 µs after the clock fell, whose edge takes as long (the same).
        const HOLD: u16 = (SYSTEM_HZ / 1_000_000 * 3 / 10) as u16;
        /// What lasts 50 ns is no edge (the same).
        const SPIKE: u8 = (SYSTEM_HZ / 20_000_000) as u8;
        // SAFETY: the bus's own block; all else that there is to be reset was when the board
        // started, or is by functions of the boot ROM, which change single bits.
        let resets = unsafe { &*RESETS::ptr() };
        let is_first = self.is_first();
        for held in [true, false] {
            resets.reset().modify(|_, w| match is_first {
                true => w.i2c0().bit(held),
                false => w.i2c1().bit(held),
            });
        }
        let is_ready = || {
            let done = resets.reset_done().read();
            if is_first {
                done.i2c0().bit()
            } else {
                done.i2c1().bit()
            }
        };
        while !is_ready() {}
        self.let_go();
        let block = self.registers();
        block.ic_con().modify(|_, w| w.speed().fast());
        // SAFETY: any numbers are times.
        unsafe {
            block
                .ic_fs_scl_lcnt()
                .write(|w| w.ic_fs_scl_lcnt().bits(LOW));
            block
                .ic_fs_scl_hcnt()
                .write(|w| w.ic_fs_scl_hcnt().bits(HIGH));
            block
                .ic_sda_hold()
                .modify(|_, w| w.ic_sda_tx_hold().bits(HOLD));
            block.ic_fs_spklen().write(|w| w.ic_fs_spklen().bits(SPIKE));
        }
    }

    fn address(&self, address: u8) {
        let block = self.registers();
        block.ic_enable().write(|w| w.enable().disabled());
        // SAFETY: any address of seven bits.
        (block.ic_tar()).write(|w| unsafe { w.ic_tar().bits(address.into()) });
        block.ic_enable().write(|w| w.enable().enabled());
        block.ic_clr_intr().read();
    }

    fn has_room(&self) -> bool {
        self.registers().ic_status().read().tfnf().bit()
    }

    fn put(&self, byte: u8, is_read: bool, turns: bool, is_last: bool) {
        self.registers().ic_data_cmd().write(|w| {
            w.restart()
                .bit(turns)
                .stop()
                .bit(is_last)
                .cmd()
                .bit(is_read);
            // SAFETY: any byte can be sent.
            unsafe { w.dat().bits(byte) }
        });
    }

    fn take(&self) -> Option<u8> {
        let has_byte = self.registers().ic_status().read().rfne().bit();
        has_byte.then(|| self.registers().ic_data_cmd().read().dat().bits())
    }

    fn is_refused(&self) -> bool {
        self.registers().ic_raw_intr_stat().read().tx_abrt().bit()
    }

    fn has_stopped(&self) -> bool {
        self.registers().ic_raw_intr_stat().read().stop_det().bit()
    }

    fn is_idle(&self) -> bool {
        !self.registers().ic_status().read().mst_activity().bit()
    }
}
