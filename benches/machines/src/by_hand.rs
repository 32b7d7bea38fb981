//! The player as a `match` on state and event: what a person writes who needs no engine.

use crate::{Action, ActionCounters, Button, Player};

#[derive(Clone, Copy)]
enum State {
    Empty,
    Open,
    Stopped,
    Paused,
    Playing(Song),
}

#[derive(Clone, Copy)]
enum Song {
    One,
    Two,
    Three,
}

/// The player.
pub struct Machine<'c> {
    state: State,
    counters: &'c ActionCounters,
}

impl<'c> Machine<'c> {
    /// One that is empty.
    #[must_use]
    pub fn new(counters: &'c ActionCounters) -> Self {
        Self {
            state: State::Empty,
            counters,
        }
    }
}

impl Player for Machine<'_> {
    #[inline(never)]
    fn dispatch(&mut self, button: Button) {
        let (action, next) = match (self.state, button) {
            (State::Empty | State::Stopped, Button::OpenClose) => (Action::OpenDrawer, State::Open),
            (State::Empty, Button::Cd) => (Action::StoreCdInfo, State::Stopped),
            (State::Open, Button::OpenClose) => (Action::CloseDrawer, State::Empty),
            (State::Stopped, Button::Play) => (Action::StartPlayback, State::Playing(Song::One)),
            (State::Stopped, Button::Stop) => (Action::StoppedAgain, State::Stopped),
            (State::Playing(_) | State::Paused, Button::Stop) => {
                (Action::StopPlayback, State::Stopped)
            }
            (State::Playing(_) | State::Paused, Button::OpenClose) => {
                (Action::StopAndOpen, State::Open)
            }
            (State::Playing(_), Button::Pause) => (Action::PausePlayback, State::Paused),
            (State::Paused, Button::EndPause) => {
                (Action::ResumePlayback, State::Playing(Song::One))
            }
            (State::Playing(Song::One), Button::Next) => {
                (Action::NextSong, State::Playing(Song::Two))
            }
            (State::Playing(Song::Two), Button::Next) => {
                (Action::NextSong, State::Playing(Song::Three))
            }
            (State::Playing(Song::Two), Button::Prev) => {
                (Action::PreviousSong, State::Playing(Song::One))
            }
            (State::Playing(Song::Three), Button::Prev) => {
                (Action::PreviousSong, State::Playing(Song::Two))
            }
            _ => return,
        };
        self.counters.act(action);
        self.state = next;
    }
}
