//! What was measured, and how it is told to the host.

use core::fmt::{Display, Write};
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};

use crate::chip::clock::TICKS_PER_US;
use crate::chip::cortex_m_board::console::Console;

/// Nanoseconds that an instruction takes (`-icount shift=8`).
const INSTRUCTION_NS: u32 = 1 << 8;

/// What so many instructions take, in ticks.
pub const fn ticks_of(instructions: u32) -> u32 {
    instructions * INSTRUCTION_NS * TICKS_PER_US / 1_000
}

/// Shortest, longest and sum of what was measured, in ticks.
pub struct Range {
    min: AtomicU32,
    max: AtomicU32,
    sum: AtomicU32,
    count: AtomicU32,
}

impl Range {
    /// Nothing was measured.
    pub const fn new() -> Self {
        Self {
            min: AtomicU32::new(u32::MAX),
            max: AtomicU32::new(0),
            sum: AtomicU32::new(0),
            count: AtomicU32::new(0),
        }
    }

    /// Takes one more in.
    pub fn note(&self, ticks: u32) {
        self.min.store(self.min.load(Relaxed).min(ticks), Relaxed);
        self.max.store(self.max.load(Relaxed).max(ticks), Relaxed);
        self.sum
            .store(self.sum.load(Relaxed).wrapping_add(ticks), Relaxed);
        self.count.store(self.count.load(Relaxed) + 1, Relaxed);
    }

    /// Tells name, least, most, mean and count.
    pub fn print(&self, name: impl Display) {
        let count = self.count.load(Relaxed);
        let _ = writeln!(
            Console,
            "{name} {} {} {} {count}",
            tenths(self.min.load(Relaxed)),
            tenths(self.max.load(Relaxed)),
            tenths(self.sum.load(Relaxed) / count.max(1)),
        );
    }
}

/// Tenths of instructions.
fn tenths(ticks: u32) -> u32 {
    let tenths = u64::from(ticks) * 10_000 / u64::from(INSTRUCTION_NS * TICKS_PER_US);
    u32::try_from(tenths).unwrap_or(u32::MAX)
}
