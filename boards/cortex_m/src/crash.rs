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

/// Bytes of stack that are enough to end the firmware.
pub const ROOM_TO_END: usize = 1024;

#[unsafe(link_section = ".uninit.kept")]
static RETAINED_RAM: Uninit<RetainedRam> = Uninit::new();

/// What is kept across a reset.
pub fn kept() -> &'static RetainedRam {
    // SAFETY: the memory is RAM, aligned for `RetainedRam`, which is made of atomic words of which
    // every bit pattern is valid; nobody has a mutable reference.
    unsafe { &*RETAINED_RAM.get() }
}

/// Why the firmware starts, from what was kept and from what the chip says. To be called once, at
/// the start.
pub fn begin(hardware: Option<ResetReason>) -> ResetReason {
    #[cfg(target_has_atomic = "32")]
    enable_faults();
    kept().begin(hardware)
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

/// What the core says of a fault, on cores that say more than where it was. Without a frame the
/// stack had no room for one.
#[cfg(target_has_atomic = "32")]
pub fn core_fault(frame: Option<&ExceptionFrame>) -> CoreFault {
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
        status,
        hard_status,
        address,
        ..place_of_fault(frame)
    }
}

/// What the core says of a fault: where it was. Cores of ARMv6-M, which have no compare-and-swap
/// either, have no registers that say more.
#[cfg(not(target_has_atomic = "32"))]
pub fn core_fault(frame: Option<&ExceptionFrame>) -> CoreFault {
    place_of_fault(frame)
}

fn place_of_fault(frame: Option<&ExceptionFrame>) -> CoreFault {
    let (pc, lr) = frame.map_or((CoreFault::STACK_OVERFLOW, 0), |frame| {
        (frame.pc(), frame.lr())
    });
    CoreFault {
        pc,
        lr,
        ..CoreFault::default()
    }
}

/// Lets the core call the handler of a bad access by itself: otherwise it escalates to a hard
/// fault, and a core has no second one, for the frame that a full stack has no room for.
#[cfg(target_has_atomic = "32")]
fn enable_faults() {
    const MEMORY_FAULT: u32 = 1 << 16;
    const BUS_FAULT: u32 = 1 << 17;
    // SAFETY: the register is always there; the handlers of both exceptions are those of
    // `crash_handlers`, and end the firmware.
    unsafe {
        (*SCB::PTR)
            .shcsr
            .modify(|enabled| enabled | MEMORY_FAULT | BUS_FAULT)
    };
}

/// Makes the handlers of panics and of the core's faults: all call `$end` with the
/// [`CrashCause`](rt_firmware::retained_ram::CrashCause), which does not return.
#[macro_export]
macro_rules! crash_handlers {
    ($end:path) => {
        #[panic_handler]
        fn panic(info: &core::panic::PanicInfo<'_>) -> ! {
            $end(&$crate::crash::place_of(info))
        }

        /// Handles a fault, with the frame that the core has put on the stack, or without one.
        extern "C" fn handle_fault(frame: Option<&cortex_m_rt::ExceptionFrame>) -> ! {
            $end(&rt_firmware::retained_ram::CrashCause::Fault(
                $crate::crash::core_fault(frame),
            ))
        }

        $crate::fault_handler!(HardFault);
        #[cfg(target_has_atomic = "32")]
        $crate::fault_handler!(BusFault);
        #[cfg(target_has_atomic = "32")]
        $crate::fault_handler!(MemoryManagement);
    };
}

/// Makes the handler of one of the core's exceptions, for [`crash_handlers`]. Where the stack has
/// no room for what ends the firmware, that begins at the stack's start: nothing goes back to what
/// is there, and the frame is far from it. Where it had no room for the frame either, there is
/// none.
#[doc(hidden)]
#[macro_export]
macro_rules! fault_handler {
    ($exception:ident) => {
        // SAFETY: the vector table names the function so, and nobody else does.
        #[unsafe(no_mangle)]
        #[unsafe(naked)]
        #[allow(non_snake_case, reason = "an exception of the core")]
        extern "C" fn $exception() -> ! {
            core::arch::naked_asm!(
                "mov r0, sp",
                "ldr r1, =_stack_end + {room}",
                "cmp r0, r1",
                "bhs 1f",
                "ldr r1, =_stack_start",
                "mov sp, r1",
                "ldr r1, =_stack_end",
                "cmp r0, r1",
                "bhs 1f",
                "movs r0, #0",
                "1:",
                "ldr r1, ={handler}",
                "bx r1",
                room = const $crate::crash::ROOM_TO_END,
                handler = sym handle_fault,
            )
        }
    };
}
