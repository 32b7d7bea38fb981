//! Missions that the board keeps: the one that the robot starts with, and what the keeper remembers
//! of trials and parameters.

use super::desk::Desk;
use super::port::LinkPort;
use super::stage::verified;
use crate::check::{check, check_slots};
use crate::link::trial::{MissionKeeper, TRIAL_AT_START_MS};
use crate::mail::{Freed, Letter};
use crate::realtime::params::SavedParams;
use crate::store::keep::Start;
use esm_link::message::{LinkError, Swap};

impl Desk<'_, '_> {
    /// Starts the mission that the board's keeper has for the robot, if it has one and may start
    /// it: the keeper looks at its missions also if not. Returns false if that is to be tried
    /// again, for the letter is under way.
    // Not inlined: what it needs of the stack is needed for nothing else.
    #[inline(never)]
    pub(super) fn start_kept(&mut self, port: &mut impl LinkPort, may_start: bool) -> bool {
        let Some(keeper) = port.keeper() else {
            return true;
        };
        if self.letter.is_none() {
            return false;
        }
        let Some(mut blob) = self.blobs.iter_mut().find_map(Option::take) else {
            return false;
        };
        let (registry, capacities) = (self.registry, &self.capacities);
        let mut start = Start::Nothing;
        blob.fill(|room| {
            start = keeper.choose(room, &mut |bytes| {
                may_start
                    && check_slots(bytes, capacities).is_ok()
                    && esm_core::verify(bytes)
                        .is_ok_and(|verified| check(&verified, registry, capacities).is_ok())
            });
            match start {
                Start::Mission { len, .. } => len,
                Start::Nothing => 0,
            }
        });
        let Start::Mission { on_trial, .. } = start else {
            self.keep(blob);
            return true;
        };
        let mission = match verified(blob) {
            Ok(mission) => self.prepare(mission, false),
            Err((blob, _)) => {
                self.keep(blob);
                return true;
            }
        };
        match (mission, &mut self.letter) {
            (Ok(mission), Some(letter)) => {
                let trial_ms = if on_trial { TRIAL_AT_START_MS } else { 0 };
                let swap = Swap {
                    warm: false,
                    trial_ms,
                };
                **letter = Letter::Swap {
                    mission,
                    swap,
                    saved: saved_params(port),
                };
                // Nobody asked for it.
                self.ticket = None;
                self.post();
            }
            (Ok(mission), None) => {
                let blob = self.rooms.take_apart(mission);
                self.keep(blob);
            }
            // It was kept.
            (Err(_), _) => {}
        }
        true
    }

    /// Takes buffers that missions were in, and lets the keeper remember which of them failed.
    pub(super) fn take_freed(&mut self, port: &mut impl LinkPort) {
        while let Some(Freed {
            mut blob,
            spare,
            fell_back,
        }) = self.freed.dequeue()
        {
            self.rooms.keep(&mut blob, spare);
            self.keep(blob);
            if let (Some(fell_back), Some(keeper)) = (fell_back, port.keeper()) {
                self.start_wanted |= keeper.trial_failed(fell_back.mission);
            }
        }
        if self.start_wanted {
            self.start_wanted = !self.start_kept(port, true);
        }
    }
}

/// Lets the keeper remember what a letter says of a trial.
pub(super) fn keep_in_mind(
    letter: &Letter<'_>,
    keeper: Option<&mut dyn MissionKeeper>,
) -> Result<(), LinkError> {
    let Some(keeper) = keeper else { return Ok(()) };
    match *letter {
        Letter::Swapped {
            mission,
            on_trial: false,
            ..
        }
        | Letter::Confirmed { mission } => keeper.trial_confirmed(mission),
        // What comes back as it went does not even begin.
        Letter::Swap { ref mission, .. } => {
            keeper.trial_failed(mission.mission().hash());
            Ok(())
        }
        Letter::Released => keeper.set_emergency_stop(false),
        _ => Ok(()),
    }
}

/// What the board keeps of parameters.
pub(super) fn saved_params(port: &mut impl LinkPort) -> SavedParams {
    let keeper = port.keeper();
    keeper.map_or(SavedParams::NONE, |keeper| keeper.saved_params())
}
