//! Why the firmware ended, kept in RAM that no start-up code clears, and told after the reset.

use core::cell::UnsafeCell;
use core::mem::MaybeUninit;
use core::panic::PanicInfo;

use cortex_m::peripheral::SCB;
use cortex_m_rt::ExceptionFrame;
use esm_link::message::{CoreFault, ResetReason};
use rt_firmware::RetainedRam;
use rt_firmware::retained_ram::CrashCause;

/// Memory that the start-up code leaves alone.
pub struct Uninit<T>(UnsafeCell<MaybeUninit<T>>);

// SAFETY: whoever reads or writes the memory does so through a pointer, and says there why it may.
unsafe impl<T> Sync for Uninit<T> {}

impl<T> Uninit<T> {
    /// The memory as the reset has left it.
    #[allow(clippy::new_without_default, reason = "for statics alone")]
    pub const fn new() -> Self {
        Uninit(UnsafeCell::new(MaybeUninit::uninit()))
    }

    /// Where it is.
    pub const fn get(&self) -> *mut T {
        self.0.get().cast()
    }
}

#[unsafe(link_section = ".uninit.kept")]
static RETAINED_RAM: Uninit<RetainedRam> = Uninit::new();

/// What is kept across a reset.
pub fn kept() -> &'static RetainedRam {
    // SAFETY: the memory is RAM, aligned for `RetainedRam`, which is made of atomic words of which
    // every bit pattern is valid; nobody has a mutable reference.
    unsafe { &*RETAINED_RAM.get() }
}

/// Ends the firmware: all that moves is stopped, the reason kept, the chip reset. From any context.
pub fn end(cause: &CrashCause<'_>, motors_off: impl FnOnce()) -> ! {
    cortex_m::interrupt::disable();
    motors_off();
    kept().end(cause);
    SCB::sys_reset()
}

/// Logs why the firmware starts.
pub fn log_reset(reset: ResetReason) {
    let words = kept().crash_report().0;
    match reset {
        ResetReason::Panic => {
            rt_firmware::error!("started again after a panic in line {=u32}", words.line)
        }
        ResetReason::CpuFault => {
            rt_firmware::error!("started again after a fault at {=u32:#x}", words.fault.pc)
        }
        ResetReason::Watchdog => {
            rt_firmware::error!("started again by the watchdog: the slots had stopped")
        }
        ResetReason::BrownOut => rt_firmware::error!("started again: the supply voltage fell"),
        ResetReason::PowerOn => rt_firmware::info!("power on"),
        ResetReason::Pin | ResetReason::Software => rt_firmware::info!("reset"),
    }
}

/// Where a panic was. Its message stays behind: formatting it would cost kilobytes of flash.
pub fn place_of<'a>(info: &'a PanicInfo<'_>) -> CrashCause<'a> {
    let (file, line) = info
        .location()
        .map_or(("", 0), |location| (location.file(), location.line()));
    CrashCause::Panic { file, line }
}

/// What the core says of a fault, on cores that say more than where it was.
#[cfg(target_has_atomic = "32")]
pub fn core_fault(frame: &ExceptionFrame) -> CoreFault {
    const MEMORY_ADDRESS_VALID: u32 = 1 << 7;
    const BUS_ADDRESS_VALID: u32 = 1 << 15;
    // SAFETY: the registers are always there, and reading them changes nothing.
    let (status, hard_status, memory_address, bus_address) = unsafe {
        let scb = &*SCB::PTR;
        (
            scb.cfsr.read(),
            scb.hfsr.read(),
            scb.mmfar.read(),
            scb.bfar.read(),
        )
    };
    let address = if status & BUS_ADDRESS_VALID != 0 {
        bus_address
    } else if status & MEMORY_ADDRESS_VALID != 0 {
        memory_address
    } else {
        0
    };
    CoreFault {
        pc: frame.pc(),
        lr: frame.lr(),
        status,
        hard_status,
        address,
    }
}

/// What the core says of a fault: where it was. Cores of ARMv6-M, which have no compare-and-swap
/// either, have no registers that say more.
#[cfg(not(target_has_atomic = "32"))]
pub fn core_fault(frame: &ExceptionFrame) -> CoreFault {
    CoreFault {
        pc: frame.pc(),
        lr: frame.lr(),
        status: 0,
        hard_status: 0,
        address: 0,
    }
}

/// Makes the handlers of panics and of the core's faults: both call `$end` with the
/// [`CrashCause`](rt_firmware::retained_ram::CrashCause), which does not return.
#[macro_export]
macro_rules! crash_handlers {
    ($end:path) => {
        #[panic_handler]
        fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
            $end(&$crate::crash::place_of(info))
        }

        // SAFETY: the handler neither returns nor trusts the state that it interrupted.
        #[cortex_m_rt::exception]
        unsafe fn HardFault(frame: &cortex_m_rt::ExceptionFrame) -> ! {
            $end(&rt_firmware::retained_ram::CrashCause::Fault(
                $crate::crash::core_fault(frame),
            ))
        }
    };
}
