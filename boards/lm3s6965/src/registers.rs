//! The device registers that this board uses, and no others.
//!
//! The chip's crate (`pac`) has interrupt numbers only, so the addresses stand here, from the
//! LM3S6965 data sheet. What is written to them and why is the business of the module that owns the
//! part: [`clock`](crate::clock), [`slot_timer`](crate::slot_timer), [`uart`](crate::uart),
//! [`watchdog`](crate::watchdog).

use core::ptr;

/// A 32-bit device register. Values of this type exist in this module only, one for each register
/// in the tables below.
#[derive(Clone, Copy)]
pub struct Register(u32);

impl Register {
    /// The register's value; for some registers, reading has an effect of its own.
    #[inline(always)]
    pub fn read(self) -> u32 {
        // SAFETY: the address is that of a device register, all of which are aligned and mapped for
        // the chip's whole life; it is volatile because hardware changes it.
        unsafe { ptr::read_volatile(self.0 as *const u32) }
    }

    /// Writes the register.
    #[inline(always)]
    pub fn write(self, value: u32) {
        // SAFETY: as for `read`; no register below is a DMA address, so a write can only change
        // what the part does, not Rust's memory.
        unsafe { ptr::write_volatile(self.0 as *mut u32, value) }
    }
}

/// System control: clocks and resets.
pub mod system_control {
    use super::Register;

    /// What a brown-out leads to, and how long the supply is looked at for it.
    pub const PBORCTL: Register = Register(0x400F_E030);
    /// What caused the last resets; a bit stays set until it is cleared.
    pub const RESC: Register = Register(0x400F_E05C);
    /// Run-mode clock configuration.
    pub const RCC: Register = Register(0x400F_E060);
    /// Raw interrupt status; has the PLL's lock bit.
    pub const RIS: Register = Register(0x400F_E050);
    /// Clock gating of watchdog and analogue parts.
    pub const RCGC0: Register = Register(0x400F_E100);
    /// Clock gating of timers and UARTs.
    pub const RCGC1: Register = Register(0x400F_E104);
    /// Clock gating of GPIO ports.
    pub const RCGC2: Register = Register(0x400F_E108);
}

/// General-purpose timer 0.
pub mod timer0 {
    use super::Register;

    /// Width of the timer.
    pub const CFG: Register = Register(0x4003_0000);
    /// Mode of half A, which is the whole timer if it is 32 bits wide.
    pub const TAMR: Register = Register(0x4003_0004);
    /// Control: enable bits.
    pub const CTL: Register = Register(0x4003_000C);
    /// Interrupt mask.
    pub const IMR: Register = Register(0x4003_0018);
    /// Interrupt clear.
    pub const ICR: Register = Register(0x4003_0024);
    /// Load value, in ticks of the system clock.
    pub const TAILR: Register = Register(0x4003_0028);
}

/// General-purpose timer 1.
pub mod timer1 {
    use super::Register;

    /// Width of the timer.
    pub const CFG: Register = Register(0x4003_1000);
    /// Mode of half A, which is the whole timer if it is 32 bits wide.
    pub const TAMR: Register = Register(0x4003_1004);
    /// Control: enable bits.
    pub const CTL: Register = Register(0x4003_100C);
    /// Interrupt mask.
    pub const IMR: Register = Register(0x4003_1018);
    /// Interrupt clear.
    pub const ICR: Register = Register(0x4003_1024);
    /// Load value, in ticks of the system clock.
    pub const TAILR: Register = Register(0x4003_1028);
}

/// General-purpose timer 2.
#[cfg(feature = "links")]
pub mod timer2 {
    use super::Register;

    /// Width of the timer.
    pub const CFG: Register = Register(0x4003_2000);
    /// Mode of half A, which is the whole timer if it is 32 bits wide.
    pub const TAMR: Register = Register(0x4003_2004);
    /// Control: enable bits.
    pub const CTL: Register = Register(0x4003_200C);
    /// Interrupt mask.
    pub const IMR: Register = Register(0x4003_2018);
    /// Interrupt clear.
    pub const ICR: Register = Register(0x4003_2024);
    /// Load value, in ticks of the system clock.
    pub const TAILR: Register = Register(0x4003_2028);
}

/// The first UART (ARM PrimeCell PL011).
pub mod uart0 {
    use super::Register;

    /// Data.
    pub const DR: Register = Register(0x4000_C000);
    /// Flags.
    pub const FR: Register = Register(0x4000_C018);
    /// Integer part of the baud-rate divisor.
    pub const IBRD: Register = Register(0x4000_C024);
    /// Fractional part of the baud-rate divisor, in 64ths.
    pub const FBRD: Register = Register(0x4000_C028);
    /// Line control; a write makes the divisor take effect.
    pub const LCRH: Register = Register(0x4000_C02C);
    /// Control.
    pub const CTL: Register = Register(0x4000_C030);
    /// Interrupt mask.
    pub const IM: Register = Register(0x4000_C038);
    /// Interrupt clear.
    pub const ICR: Register = Register(0x4000_C044);
}

/// The second UART.
#[cfg(feature = "links")]
pub mod uart1 {
    use super::Register;

    /// Data.
    pub const DR: Register = Register(0x4000_D000);
    /// Flags.
    pub const FR: Register = Register(0x4000_D018);
    /// Integer part of the baud-rate divisor.
    pub const IBRD: Register = Register(0x4000_D024);
    /// Fractional part of the baud-rate divisor, in 64ths.
    pub const FBRD: Register = Register(0x4000_D028);
    /// Line control; a write makes the divisor take effect.
    pub const LCRH: Register = Register(0x4000_D02C);
    /// Control.
    pub const CTL: Register = Register(0x4000_D030);
    /// Interrupt mask.
    pub const IM: Register = Register(0x4000_D038);
    /// Interrupt clear.
    pub const ICR: Register = Register(0x4000_D044);
}

/// GPIO port D, whose pins 2 and 3 are UART1's.
#[cfg(feature = "links")]
pub mod gpio_d {
    use super::Register;

    /// Alternate function select.
    pub const AFSEL: Register = Register(0x4000_7420);
    /// Digital enable.
    pub const DEN: Register = Register(0x4000_751C);
}

/// GPIO port A, whose pins 0 and 1 are UART0's.
pub mod gpio_a {
    use super::Register;

    /// Alternate function select.
    pub const AFSEL: Register = Register(0x4000_4420);
    /// Digital enable.
    pub const DEN: Register = Register(0x4000_451C);
}

/// The watchdog timer.
pub mod watchdog0 {
    use super::Register;

    /// Load value, in ticks of the system clock; a write starts the count anew.
    pub const LOAD: Register = Register(0x4000_0000);
    /// What is left of the count, which goes down.
    pub const VALUE: Register = Register(0x4000_0004);
    /// Control: once its interrupt is enabled, only a reset stops it.
    pub const CTL: Register = Register(0x4000_0008);
    /// Interrupt clear; any write starts the count anew.
    pub const ICR: Register = Register(0x4000_000C);
    /// Lock: any value but the key makes the others read-only.
    pub const LOCK: Register = Register(0x4000_0C00);
}
