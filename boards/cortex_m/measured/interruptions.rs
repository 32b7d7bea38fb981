//! How long slot 0 is interrupted.

use crate::chip::cortex_m_board::sys_tick;

/// Does nothing but look at the clock for a while. `each` hears of every interruption that lasts so
/// long at least: of the gap between two looks, and of the longest that was none, in ticks.
#[inline(always)]
pub fn look(shortest_ticks: u32, mut each: impl FnMut(u32, u32)) {
    const ROUNDS: u32 = 10_000;
    let mut last = sys_tick::current();
    // What a round takes that is not interrupted.
    let mut usual = 0;
    for _ in 0..ROUNDS {
        let now = sys_tick::current();
        let gap = last.wrapping_sub(now) & sys_tick::MAX;
        last = now;
        if gap < shortest_ticks {
            usual = usual.max(gap);
        } else {
            each(gap, usual);
            last = sys_tick::current();
        }
    }
}
