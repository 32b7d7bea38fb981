//! Macro steps of the CD player of `tests/data/cd51.esm`, and pulses with nothing to do.
//!
//! A macro step is measured from the flag that a task sets, as the runtime hands it over, to the
//! end, with an observer that counts transitions. Nothing else runs meanwhile. The interpreter is
//! the one that the firmware runs, with the settings of its profile.

use core::hint::black_box;

use crate::chip::cortex_m_board::sys_tick;
use esm_core::{Interpreter, Observer, TransitionTaken, verify};

/// Room for the player's machine.
const ARENA_WORDS: usize = 64;
/// The task state whose flags are set: the first.
const PANEL: usize = 0;
/// Macro steps after which nothing happens any more.
const REST_STEPS: usize = 8;
/// Pulses that are measured.
const PULSES: usize = 51;

/// Flags of the panel, as they are declared there.
const PLAY: usize = 0;
const END_PAUSE: usize = 1;
const STOP: usize = 2;
const PAUSE: usize = 3;
const OPEN_CLOSE: usize = 4;
const CD: usize = 5;
const NEXT: usize = 6;
const PREV: usize = 7;

/// What is pressed before and after the songs, and what again and again between.
const BEFORE: [usize; 4] = [OPEN_CLOSE, OPEN_CLOSE, CD, PLAY];
const SONGS: [usize; 4] = [NEXT, NEXT, PREV, PREV];
const AFTER: [usize; 7] = [PAUSE, END_PAUSE, PAUSE, STOP, STOP, OPEN_CLOSE, OPEN_CLOSE];
/// Rounds of [`SONGS`]: with what is around, 51 macro steps.
const ROUNDS: usize = 10;
/// Transitions of all of them: the panel's, and one that its event leads to. Where the superstate
/// is entered, the region inside takes one more, in the next macro step.
const TRANSITIONS: u32 = 2 * 51 + 2;

/// Counts transitions.
struct Count(u32);

impl Observer for Count {
    fn transition(&mut self, _taken: TransitionTaken) {
        self.0 += 1;
    }
}

/// Measures ticks of macro steps, for which `note` is given true, and of pulses. None if the
/// machine did not do what the chart says.
pub fn measure(blob: &[u8], note: &mut impl FnMut(bool, u32)) -> Option<()> {
    let mut arena = [0; ARENA_WORDS];
    let verified = verify(blob).ok()?;
    let mut player = Interpreter::new(verified, &mut arena).ok()?;
    let places = player.tables().task_places(PANEL)?;
    let mut count = Count(0);
    for _ in 0..REST_STEPS {
        player.macro_step(&mut count).ok()?;
    }
    count = Count(0);
    let own = ticks(|| ());
    let songs = core::iter::repeat_n(SONGS, ROUNDS).flatten();
    for button in BEFORE.into_iter().chain(songs).chain(AFTER) {
        // As an executor has it: a bit for each flag that its task wrote.
        let pressed = black_box(1 << button);
        let ticks = ticks(|| {
            player.set_flags_at(&places, pressed, pressed);
            // A fault shows in the count.
            let _ = player.macro_step(&mut count);
        });
        note(true, ticks.saturating_sub(own));
    }
    if count.0 != TRANSITIONS {
        return None;
    }
    for _ in 0..PULSES {
        let ticks = ticks(|| {
            let _ = player.macro_step(&mut count);
        });
        note(false, ticks.saturating_sub(own));
    }
    (count.0 == TRANSITIONS).then_some(())
}

/// The ticks that some work takes.
#[inline(always)]
fn ticks(work: impl FnOnce()) -> u32 {
    let before = sys_tick::current();
    work();
    let after = sys_tick::current();
    before.wrapping_sub(after) & sys_tick::MAX
}
