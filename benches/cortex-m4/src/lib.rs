//! Measuring on the emulated board: a timer that counts instructions, and the emulator's console.
//!
//! The emulator gives each instruction the same time (`-icount`), many ticks of the board's timer:
//! so differences of the timer are instructions, exactly. Lines of the output are
//! `row NAME EVENTS TICKS` and `tell NAME NUMBERS`.
#![no_std]

mod timer;

use core::fmt::{self, Write};

pub use bench_machines;
use bench_machines::{ActionCounters, Meter, Player, play};
pub use cortex_m_rt as rt;
use semihosting::sys::arm_compat::sys_writec;
pub use timer::Timer;

/// What the emulator prints.
pub struct Console;

impl Write for Console {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        text.bytes().for_each(sys_writec);
        Ok(())
    }
}

/// Counts instructions.
pub struct Instructions {
    timer: Timer,
    /// Ticks that measuring nothing takes.
    own: u32,
}

impl Instructions {
    /// With the board's timer, which it starts.
    #[must_use]
    pub fn new() -> Self {
        let timer = Timer::start();
        let started = timer.now();
        let own = timer.now().wrapping_sub(started);
        Self { timer, own }
    }

    fn print(&self, row: &str, events: usize, ticks: u32) {
        let _ = writeln!(
            Console,
            "row {row} {events} {}",
            ticks.saturating_sub(self.own)
        );
    }
}

impl Default for Instructions {
    fn default() -> Self {
        Self::new()
    }
}

impl Meter for Instructions {
    #[inline(always)]
    fn measure(&mut self, row: &str, events: usize, mut work: impl FnMut()) {
        self.measure_once(row, events, &mut work);
    }

    #[inline(always)]
    fn measure_once(&mut self, row: &str, events: usize, work: impl FnOnce()) {
        let started = self.timer.now();
        work();
        let ticks = self.timer.now().wrapping_sub(started);
        self.print(row, events, ticks);
    }

    fn tell(&mut self, row: &str, numbers: &[u32]) {
        let _ = write!(Console, "tell {row}");
        for number in numbers {
            let _ = write!(Console, " {number}");
        }
        let _ = writeln!(Console);
    }
}

/// Measures one engine's player, and tells how large its machine is.
#[inline(always)]
pub fn peer<'c, P: Player>(
    rows: [&str; 2],
    counters: &'c ActionCounters,
    make: impl FnOnce(&'c ActionCounters) -> P,
) {
    let mut meter = Instructions::new();
    let mut player = make(counters);
    play(&mut meter, rows, &mut player, counters);
    meter.tell("ram", &[size_of::<P>() as u32]);
}

/// Ends the emulator.
pub fn end() -> ! {
    semihosting::process::exit(0)
}

#[panic_handler]
fn panic(panic: &core::panic::PanicInfo<'_>) -> ! {
    // No text of the panic: formatting it would be most of the smallest programs.
    let line = panic.location().map_or(0, core::panic::Location::line);
    let _ = writeln!(Console, "panic {line}");
    semihosting::process::exit(1)
}
