//! The player for [smlang](https://docs.rs/smlang): a flat table of transitions, so the songs are
//! states beside the others, and what leaves `Playing` stands for all three.

use smlang::statemachine;

use crate::{Action, ActionCounters, Button, Player};

statemachine! {
    transitions: {
        *Empty + OpenClose / open_drawer = Open,
        Empty + Cd / store_cd_info = Stopped,
        Open + OpenClose / close_drawer = Empty,
        Stopped + Play / start_playback = SongOne,
        Stopped + OpenClose / open_drawer = Open,
        Stopped + Stop / stopped_again = Stopped,
        SongOne | SongTwo | SongThree + Stop / stop_playback = Stopped,
        SongOne | SongTwo | SongThree + Pause / pause_playback = Paused,
        SongOne | SongTwo | SongThree + OpenClose / stop_and_open = Open,
        SongOne + Next / next_song = SongTwo,
        SongTwo + Next / next_song = SongThree,
        SongTwo + Prev / previous_song = SongOne,
        SongThree + Prev / previous_song = SongTwo,
        Paused + EndPause / resume_playback = SongOne,
        Paused + Stop / stop_playback = Stopped,
        Paused + OpenClose / stop_and_open = Open,
    }
}

/// What the actions need.
struct Context<'c> {
    counters: &'c ActionCounters,
}

/// One method an action.
macro_rules! actions {
    ($($method:ident $action:ident)*) => {
        impl StateMachineContext for Context<'_> {
            $(
                #[inline(always)]
                fn $method(&mut self) -> Result<(), ()> {
                    self.counters.act(Action::$action);
                    Ok(())
                }
            )*
        }
    };
}

actions! {
    start_playback StartPlayback
    open_drawer OpenDrawer
    close_drawer CloseDrawer
    store_cd_info StoreCdInfo
    stop_playback StopPlayback
    pause_playback PausePlayback
    resume_playback ResumePlayback
    stop_and_open StopAndOpen
    stopped_again StoppedAgain
    next_song NextSong
    previous_song PreviousSong
}

/// The player.
pub struct Machine<'c>(StateMachine<Context<'c>>);

impl<'c> Machine<'c> {
    /// One that is empty.
    #[must_use]
    pub fn new(counters: &'c ActionCounters) -> Self {
        Self(StateMachine::new(Context { counters }))
    }
}

impl Player for Machine<'_> {
    #[inline(never)]
    fn dispatch(&mut self, button: Button) {
        let event = match button {
            Button::Play => Events::Play,
            Button::EndPause => Events::EndPause,
            Button::Stop => Events::Stop,
            Button::Pause => Events::Pause,
            Button::OpenClose => Events::OpenClose,
            Button::Cd => Events::Cd,
            Button::Next => Events::Next,
            Button::Prev => Events::Prev,
        };
        // An event that no transition waits for is an error there, and nothing in the chart.
        let _ = self.0.process_event(event);
    }
}
