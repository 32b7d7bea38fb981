//! Whether start times stay exact: a dispatcher that runs for days of a robot's time, against a
//! multiplication.

use esm_core::Dispatcher;
use esm_core::dispatcher::Activation;
use esm_core::tables::Slot;

/// Ticks of the board's clock in a microsecond.
const TICKS_PER_US: u64 = 50;
/// The longest period that a blob may have.
const LONGEST_PERIOD_US: u32 = 4_000_000_000;
/// How late each activation is asked for, in microseconds.
const LATE_US: u64 = 3;
/// Number of slots.
const SLOTS: usize = 16;

/// What a run showed.
#[derive(Clone, Copy, Debug)]
pub struct Exactness {
    /// Activations that were taken.
    pub activations: u64,
    /// Those that were not what the slot, its period and their number say, or out of order, or
    /// missed.
    pub wrong: u64,
    /// Nominal start of the last one, in seconds of the robot's time.
    pub robot_s: u64,
    /// How often a counter of 32 bits wraps in that time that counts microseconds.
    pub microsecond_wraps: u64,
    /// How often one wraps that counts ticks.
    pub tick_wraps: u64,
}

/// Takes so many activations of 16 slots: 15 of a second, and one of the longest period that there
/// is.
///
/// # Panics
/// If the dispatcher refuses the slots.
pub fn run(activations: u64) -> Exactness {
    let slots: [Slot; SLOTS] = core::array::from_fn(|index| {
        let (period_us, start_us) = match index {
            0 => (LONGEST_PERIOD_US, LONGEST_PERIOD_US - 1),
            _ => (1_000_000, index as u32 * 1_001),
        };
        Slot {
            number: 1,
            period_us,
            duration_us: 0,
            start_us,
        }
    });
    let Ok(mut dispatcher) = Dispatcher::<SLOTS>::new(slots.into_iter()) else {
        panic!("16 slots fit");
    };
    let mut taken = [0_u64; SLOTS];
    let mut wrong = 0;
    let mut last = dispatcher.next();
    for _ in 0..activations {
        let next = dispatcher.next();
        let slot = &slots[next.slot];
        let nominal = Activation {
            slot: next.slot,
            start_us: u64::from(slot.start_us) + taken[next.slot] * u64::from(slot.period_us),
        };
        let in_order = (last.start_us, last.slot) <= (next.start_us, next.slot);
        let right = next == nominal
            && in_order
            && dispatcher.take(next.start_us + LATE_US) == Some(nominal);
        wrong += u64::from(!right);
        taken[next.slot] += 1;
        last = next;
    }
    wrong += (0..SLOTS)
        .map(|slot| u64::from(dispatcher.missed(slot)))
        .sum::<u64>();
    Exactness {
        activations,
        wrong,
        robot_s: last.start_us / 1_000_000,
        microsecond_wraps: last.start_us >> 32,
        tick_wraps: (last.start_us * TICKS_PER_US) >> 32,
    }
}
