//! Missions that the board keeps: the one that the robot starts with, and what the mission store
//! remembers of trials and parameters.

use super::handler::RequestHandler;
use super::port::{LinkPort, saved_params};
use super::stage::verified;
use crate::check::{check, check_slots};
use crate::mission_store::{MissionStore, Start, TRIAL_AT_START_MS};
use crate::realtime::mailbox::{Command, Content, Freed, Reply};
use esm_link::message::{LinkError, Swap};

impl RequestHandler<'_, '_> {
    /// Starts the mission that the board's mission store has for the robot, if it has one and may
    /// start it: the mission store looks at its missions also if not. Returns false if that is to
    /// be tried again, for the command is under way.
    // Not inlined: what it needs of the stack is needed for nothing else.
    #[inline(never)]
    pub(super) fn start_kept(&mut self, port: &mut impl LinkPort, may_start: bool) -> bool {
        let Some(mission_store) = port.mission_store() else {
            return true;
        };
        if self.command.is_none() {
            return false;
        }
        let Some(mut blob) = self.blobs.iter_mut().find_map(Option::take) else {
            return false;
        };
        let (registry, capacities) = (self.registry, &self.capacities);
        let mut start = Start::Nothing;
        blob.fill(|room| {
            start = mission_store.choose(room, &mut |bytes| {
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
            Ok(mission) => self.memories.prepare(mission, false, self.registry),
            Err((blob, _)) => {
                self.keep(blob);
                return true;
            }
        };
        match (mission, &mut self.command) {
            (Ok(mission), Some(content)) => {
                let trial_ms = if on_trial { TRIAL_AT_START_MS } else { 0 };
                let swap = Swap {
                    warm: false,
                    trial_ms,
                };
                **content = Content::Command(Command::Swap {
                    mission,
                    swap,
                    saved: saved_params(port),
                });
                // Nobody asked for it.
                self.pending = None;
                self.post();
            }
            (Ok(mission), None) => {
                let blob = self.memories.take_apart(mission);
                self.keep(blob);
            }
            (Err((_, blob)), _) => {
                if let Some(blob) = blob {
                    self.keep(blob);
                }
            }
        }
        true
    }

    /// Takes buffers that missions were in, and lets the mission store remember which of them
    /// failed.
    pub(super) fn take_freed(&mut self, port: &mut impl LinkPort) {
        while let Some(Freed {
            mut blob,
            spare,
            fell_back,
        }) = self.freed.dequeue()
        {
            self.memories.keep(&mut blob, spare);
            self.keep(blob);
            if let (Some(fell_back), Some(mission_store)) = (fell_back, port.mission_store()) {
                self.start_wanted |= mission_store.trial_failed(fell_back.mission);
            }
        }
        if self.start_wanted {
            self.start_wanted = !self.start_kept(port, true);
        }
    }
}

/// Lets the mission store remember what came back says of a trial.
pub(super) fn persist_trial(
    content: &Content<'_>,
    mission_store: Option<&mut dyn MissionStore>,
) -> Result<(), LinkError> {
    let Some(mission_store) = mission_store else {
        return Ok(());
    };
    match content {
        Content::Reply(
            Reply::Swapped {
                mission,
                on_trial: false,
                ..
            }
            | Reply::Confirmed { mission },
        ) => mission_store.trial_confirmed(*mission),
        // What comes back as it went does not even begin.
        Content::Command(Command::Swap { mission, .. }) => {
            mission_store.trial_failed(mission.mission().hash());
            Ok(())
        }
        Content::Reply(Reply::Released) => mission_store.set_emergency_stop(false),
        _ => Ok(()),
    }
}
