//! One CD player, written for each of the engines that are compared, and what drives and measures
//! them, on the host and on a board alike.
//!
//! The chart is the composite CD player of Boost.SML's benchmark: a drawer, a disc, and three songs
//! inside `Playing`. An engine gets one event at a time from [`SCRIPT`]; what it does about it is
//! an action, which is an opaque call that counts in a volatile cell. So nothing of the machine can
//! be optimised away, and the counts tell afterwards whether it was the same machine.
//!
//! [`drive`] runs compiled missions; the other modules are one engine each. How much is measured by
//! what is a [`Meter`]'s business.
#![no_std]

#[cfg(test)]
extern crate std;

pub mod by_hand;
pub mod drive;
pub mod esm;
pub mod rust_fsm;
pub mod smlang;
pub mod statig;

use core::hint::black_box;

use vcell::VolatileCell;

/// What a person does to the player. The order is that of the panel's flags in `cd51.esm`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Button {
    /// Plays the disc from its first song.
    Play,
    /// Goes on after a pause.
    EndPause,
    /// Stops.
    Stop,
    /// Pauses.
    Pause,
    /// Opens or closes the drawer.
    OpenClose,
    /// A disc was found.
    Cd,
    /// The next song.
    Next,
    /// The song before.
    Prev,
}

/// What the player does about it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs, reason = "the names are those of the chart")]
pub enum Action {
    StartPlayback,
    OpenDrawer,
    CloseDrawer,
    StoreCdInfo,
    StopPlayback,
    PausePlayback,
    ResumePlayback,
    StopAndOpen,
    StoppedAgain,
    NextSong,
    PreviousSong,
}

/// Kinds of [`Action`].
pub const ACTIONS: usize = 11;

/// The actions of one pass through [`SCRIPT`], in the order of [`Action`].
pub const EXPECTED: [u32; ACTIONS] = [1, 2, 2, 1, 1, 2, 1, 0, 1, 20, 20];

/// Events of a pass.
pub const SCRIPT_EVENTS: usize = 51;

/// What is done to the player in one pass, which ends where it began.
pub const SCRIPT: [Button; SCRIPT_EVENTS] = script();

const fn script() -> [Button; SCRIPT_EVENTS] {
    use Button::{Cd, EndPause, Next, OpenClose, Pause, Play, Prev, Stop};
    const BEFORE: [Button; 4] = [OpenClose, OpenClose, Cd, Play];
    const SONGS: [Button; 4] = [Next, Next, Prev, Prev];
    const AFTER: [Button; 7] = [Pause, EndPause, Pause, Stop, Stop, OpenClose, OpenClose];
    let mut script = [Play; SCRIPT_EVENTS];
    let mut at = 0;
    while at < SCRIPT_EVENTS {
        script[at] = if at < BEFORE.len() {
            BEFORE[at]
        } else if at < SCRIPT_EVENTS - AFTER.len() {
            SONGS[(at - BEFORE.len()) % SONGS.len()]
        } else {
            AFTER[at + AFTER.len() - SCRIPT_EVENTS]
        };
        at += 1;
    }
    script
}

/// Counts, of actions or of transitions.
pub struct Counters<const N: usize>([VolatileCell<u32>; N]);

impl<const N: usize> Default for Counters<N> {
    fn default() -> Self {
        Self::new()
    }
}

impl<const N: usize> Counters<N> {
    /// All at zero.
    #[must_use]
    pub fn new() -> Self {
        Self(core::array::from_fn(|_| VolatileCell::new(0)))
    }

    /// Counts one. No caller can look inside.
    #[inline(never)]
    pub fn count(&self, index: usize) {
        if let Some(cell) = self.0.get(index) {
            cell.set(cell.get().wrapping_add(1));
        }
    }

    /// Counts one action.
    #[inline(always)]
    pub fn act(&self, action: Action) {
        self.count(action as usize);
    }

    /// All of them.
    #[must_use]
    pub fn read(&self) -> [u32; N] {
        core::array::from_fn(|index| self.0.get(index).map_or(0, VolatileCell::get))
    }
}

/// Counts of [`Action`]s.
pub type ActionCounters = Counters<ACTIONS>;

/// A player that can be driven.
pub trait Player {
    /// Handles one event to its end.
    fn dispatch(&mut self, button: Button);
}

/// Measures work, and tells.
pub trait Meter {
    /// Does `work`, which handles `events` events, and notes what it took under `row`. It is done
    /// as often as the meter wants.
    fn measure(&mut self, row: &str, events: usize, work: impl FnMut());

    /// The same for work that can only be done once.
    fn measure_once(&mut self, row: &str, events: usize, work: impl FnOnce());

    /// Tells numbers under a name: counts, or sizes.
    fn tell(&mut self, row: &str, numbers: &[u32]);
}

/// A machine that does nothing: what the measuring itself takes.
pub struct Nothing;

impl Player for Nothing {
    #[inline(never)]
    fn dispatch(&mut self, button: Button) {
        black_box(button);
    }
}

/// Plays the script once.
#[inline(always)]
pub fn pass(player: &mut impl Player) {
    // Read where it stands, so that no engine is specialised for it.
    for button in black_box(&SCRIPT) {
        player.dispatch(*button);
    }
}

/// Events that nothing waits for, to measure how quickly an engine finds that out.
const IDLE_EVENTS: usize = 16;

/// Measures a player: the script, and events that it does not wait for; `cd51-NAME`,
/// `idle-event-NAME`.
pub fn play<P: Player>(
    meter: &mut impl Meter,
    [script_row, idle_row]: [&str; 2],
    player: &mut P,
    counters: &ActionCounters,
) {
    // What an engine does when it starts is done before it is measured.
    pass(player);
    let before = counters.read();
    pass(player);
    let after = counters.read();
    let counts: [u32; ACTIONS] =
        core::array::from_fn(|action| after[action].wrapping_sub(before[action]));
    meter.tell(script_row, &counts);
    meter.measure(script_row, SCRIPT_EVENTS, || pass(player));
    // The player is empty again, and there is nothing to go on with.
    let unheard = black_box([Button::EndPause; IDLE_EVENTS]);
    meter.measure(idle_row, IDLE_EVENTS, || {
        for button in &unheard {
            player.dispatch(*button);
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts_of_a_pass(player: &mut impl Player, counters: &ActionCounters) -> [u32; ACTIONS] {
        pass(player);
        let first = counters.read();
        pass(player);
        assert_eq!(
            counters.read(),
            first.map(|count| 2 * count),
            "passes differ"
        );
        first
    }

    #[test]
    fn every_engine_does_what_the_chart_says() {
        let of = ActionCounters::new;
        let counters = [of(), of(), of(), of()];
        let [hand, statig, smlang, fsm] = &counters;
        let counts = [
            (
                "by hand",
                counts_of_a_pass(&mut by_hand::Machine::new(hand), hand),
            ),
            (
                "statig",
                counts_of_a_pass(&mut statig::Machine::new(statig), statig),
            ),
            (
                "smlang",
                counts_of_a_pass(&mut smlang::Machine::new(smlang), smlang),
            ),
            (
                "rust-fsm",
                counts_of_a_pass(&mut rust_fsm::Machine::new(fsm), fsm),
            ),
        ];
        for (engine, counts) in counts {
            assert_eq!(counts, EXPECTED, "{engine}");
        }
    }
}
