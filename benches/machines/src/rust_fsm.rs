//! The player for [rust-fsm](https://docs.rs/rust-fsm): a flat Mealy machine. A transition gives an
//! output, and who drives the machine acts on it.

use ::rust_fsm::state_machine;

use crate::{Action, ActionCounters, Button, Player};

state_machine! {
    #[state_machine(input(crate::Button), output(crate::Action))]
    chart(Empty)

    Empty => {
        OpenClose => Open [OpenDrawer],
        Cd => Stopped [StoreCdInfo]
    },
    Open(OpenClose) => Empty [CloseDrawer],
    Stopped => {
        Play => SongOne [StartPlayback],
        OpenClose => Open [OpenDrawer],
        Stop => Stopped [StoppedAgain]
    },
    SongOne => {
        Next => SongTwo [NextSong],
        Stop => Stopped [StopPlayback],
        Pause => Paused [PausePlayback],
        OpenClose => Open [StopAndOpen]
    },
    SongTwo => {
        Next => SongThree [NextSong],
        Prev => SongOne [PreviousSong],
        Stop => Stopped [StopPlayback],
        Pause => Paused [PausePlayback],
        OpenClose => Open [StopAndOpen]
    },
    SongThree => {
        Prev => SongTwo [PreviousSong],
        Stop => Stopped [StopPlayback],
        Pause => Paused [PausePlayback],
        OpenClose => Open [StopAndOpen]
    },
    Paused => {
        EndPause => SongOne [ResumePlayback],
        Stop => Stopped [StopPlayback],
        OpenClose => Open [StopAndOpen]
    }
}

/// The player.
pub struct Machine<'c> {
    machine: chart::StateMachine,
    counters: &'c ActionCounters,
}

impl<'c> Machine<'c> {
    /// One that is empty.
    #[must_use]
    pub fn new(counters: &'c ActionCounters) -> Self {
        Self {
            machine: chart::StateMachine::new(),
            counters,
        }
    }
}

impl Player for Machine<'_> {
    #[inline(never)]
    fn dispatch(&mut self, button: Button) {
        // An event that no transition waits for is an error there, and nothing in the chart.
        if let Ok(Some(action)) = self.machine.consume(&button) {
            let action: Action = action;
            self.counters.act(action);
        }
    }
}
