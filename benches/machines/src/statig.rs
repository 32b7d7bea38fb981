//! The player for [statig](https://docs.rs/statig): a hierarchical machine, each state a method.

#![expect(missing_docs, reason = "of what the macro makes")]

use statig::prelude::*;

use crate::{Action, ActionCounters, Button, Player};

/// What the states share.
struct Chart<'c> {
    counters: &'c ActionCounters,
}

#[state_machine(initial = "State::empty()", state(derive()), superstate(derive()))]
impl Chart<'_> {
    #[state]
    fn empty(&mut self, event: &Button) -> Outcome<State> {
        match event {
            Button::OpenClose => self.go(Action::OpenDrawer, State::open()),
            Button::Cd => self.go(Action::StoreCdInfo, State::stopped()),
            _ => Super,
        }
    }

    #[state]
    fn open(&mut self, event: &Button) -> Outcome<State> {
        match event {
            Button::OpenClose => self.go(Action::CloseDrawer, State::empty()),
            _ => Super,
        }
    }

    #[state]
    fn stopped(&mut self, event: &Button) -> Outcome<State> {
        match event {
            Button::Play => self.go(Action::StartPlayback, State::song_one()),
            Button::OpenClose => self.go(Action::OpenDrawer, State::open()),
            Button::Stop => self.go(Action::StoppedAgain, State::stopped()),
            _ => Super,
        }
    }

    #[state]
    fn paused(&mut self, event: &Button) -> Outcome<State> {
        match event {
            Button::EndPause => self.go(Action::ResumePlayback, State::song_one()),
            Button::Stop => self.go(Action::StopPlayback, State::stopped()),
            Button::OpenClose => self.go(Action::StopAndOpen, State::open()),
            _ => Super,
        }
    }

    #[superstate]
    fn playing(&mut self, event: &Button) -> Outcome<State> {
        match event {
            Button::Stop => self.go(Action::StopPlayback, State::stopped()),
            Button::Pause => self.go(Action::PausePlayback, State::paused()),
            Button::OpenClose => self.go(Action::StopAndOpen, State::open()),
            _ => Super,
        }
    }

    #[state(superstate = "playing")]
    fn song_one(&mut self, event: &Button) -> Outcome<State> {
        match event {
            Button::Next => self.go(Action::NextSong, State::song_two()),
            _ => Super,
        }
    }

    #[state(superstate = "playing")]
    fn song_two(&mut self, event: &Button) -> Outcome<State> {
        match event {
            Button::Next => self.go(Action::NextSong, State::song_three()),
            Button::Prev => self.go(Action::PreviousSong, State::song_one()),
            _ => Super,
        }
    }

    #[state(superstate = "playing")]
    fn song_three(&mut self, event: &Button) -> Outcome<State> {
        match event {
            Button::Prev => self.go(Action::PreviousSong, State::song_two()),
            _ => Super,
        }
    }

    #[inline(always)]
    fn go(&mut self, action: Action, to: State) -> Outcome<State> {
        self.counters.act(action);
        Transition(to)
    }
}

/// The player.
pub struct Machine<'c>(StateMachine<Chart<'c>>);

impl<'c> Machine<'c> {
    /// One that is empty.
    #[must_use]
    pub fn new(counters: &'c ActionCounters) -> Self {
        Self(Chart { counters }.state_machine())
    }
}

impl Player for Machine<'_> {
    #[inline(never)]
    fn dispatch(&mut self, button: Button) {
        self.0.handle(&button);
    }
}
