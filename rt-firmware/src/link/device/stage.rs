//! The commit of an upload: it is checked from its length to its capacities, prepared, and handed
//! over.
//!
//! *Invariant:* where a blob is refused, the mission that runs is as it was, and the buffer is
//! back.

use core::sync::atomic::Ordering;

use esm_core::{BlobBuffer, Refusal, Verified};

use super::handler::{Reaction, RequestHandler, Upload};
use super::port::{LinkPort, saved_params};
use crate::check::{check, check_slots};
use crate::features::WARM;
use crate::realtime::mailbox::{Command, Content};
use crate::realtime::staging::StagedMission;
use esm_link::access::Access;
use esm_link::frame::checksum;
use esm_link::keys::SignedUpload;
use esm_link::message::{LinkError, Swap};

impl<'m> RequestHandler<'_, 'm> {
    /// Checks the blob that was uploaded, and hands it over.
    // Not inlined: what it needs of the stack is needed for no other request.
    #[inline(never)]
    pub(super) fn commit<'a>(&mut self, swap: Swap, port: &mut impl LinkPort) -> Reaction<'a> {
        self.tell_of_mission(true);
        match self.stage(swap, port) {
            Ok(()) => self.post(),
            Err(error) => {
                self.tell_of_mission(false);
                Reaction::Answer(Err(error))
            }
        }
    }

    /// Checks the blob that was uploaded, and puts it into the command.
    fn stage(&mut self, swap: Swap, port: &mut impl LinkPort) -> Result<(), LinkError> {
        // The upload stays: it can be taken cold.
        if swap.warm && !WARM {
            return Err(LinkError::NotBuiltIn);
        }
        self.refuse_on_trial()?;
        // The mission store is to know how the last trial ended. Another mission may be started for
        // that.
        self.take_freed(port);
        if self.command.is_none() {
            return Err(LinkError::Busy);
        }
        let upload = self.upload.as_ref().ok_or(LinkError::NoUpload)?;
        if upload.received() != upload.len && !mutant!(IncompleteTaken) {
            return Err(LinkError::Incomplete {
                received: upload.received(),
            });
        }
        let crc = upload.crc;
        let signed = upload.signed;
        if signed.is_none()
            && !mutant!(UnsignedTaken)
            && self.keys.access(port.key_store()) == Access::Locked
        {
            return Err(LinkError::NotSigned);
        }
        let Some(Upload { blob, .. }) = self.upload.take() else {
            return Err(LinkError::NoUpload);
        };
        if checksum(&blob) != crc && !mutant!(WholeUnchecked) {
            self.keep(blob);
            return Err(LinkError::WrongChecksum);
        }
        if let Err(error) = check_slots(&blob, &self.capacities) {
            self.keep(blob);
            return Err(error);
        }
        // Moved once only: it would be on the stack as often as it is moved.
        match verified(blob) {
            Ok(mission) => match check(&mission, self.registry, &self.capacities) {
                Ok(()) => self.hand_over(mission, signed.as_ref(), swap, port),
                Err(error) => {
                    self.keep(mission.into_bytes());
                    Err(error)
                }
            },
            Err((blob, refusal)) => {
                self.keep(blob);
                Err(LinkError::Invalid(refusal))
            }
        }
    }

    /// Prepares a mission that was checked, and puts it into the command.
    // Not inlined: what it needs of the stack is not needed while the blob is checked.
    #[inline(never)]
    fn hand_over(
        &mut self,
        verified: Verified<BlobBuffer<'m>>,
        signed: Option<&SignedUpload>,
        swap: Swap,
        port: &mut impl LinkPort,
    ) -> Result<(), LinkError> {
        // Moved once only, as above.
        match self.memories.prepare(verified, swap.warm, self.registry) {
            Ok(mission) => self.put(mission, signed, swap, port),
            Err((error, blob)) => {
                if let Some(blob) = blob {
                    self.keep(blob);
                }
                Err(error)
            }
        }
    }

    /// Puts a mission into the command, if its upload counts and the mission store takes it on.
    // Not inlined, as above. A mission without memory of its own is small enough.
    #[cfg_attr(feature = "warm", inline(never))]
    fn put(
        &mut self,
        mission: StagedMission<'m>,
        signed: Option<&SignedUpload>,
        swap: Swap,
        port: &mut impl LinkPort,
    ) -> Result<(), LinkError> {
        let accepted = self
            .accept(signed, port)
            .and_then(|()| match port.mission_store() {
                Some(mission_store) => mission_store.trial_begins(mission.mission().bytes()),
                None => Ok(()),
            });
        match (accepted, &mut self.command) {
            (Ok(()), Some(content)) => {
                **content = Content::Command(Command::Swap {
                    mission,
                    swap,
                    saved: saved_params(port),
                });
                Ok(())
            }
            (accepted, _) => {
                let blob = self.memories.take_apart(mission);
                self.keep(blob);
                Err(accepted.err().unwrap_or(LinkError::Busy))
            }
        }
    }

    /// Tells the real-time side that a mission is to come, so that it looks for it in time.
    pub(super) fn tell_of_mission(&self, is_coming: bool) {
        if WARM {
            self.heartbeats
                .mission_is_coming
                .store(is_coming, Ordering::Relaxed);
        }
    }
}

/// Checks a blob by itself, before the robot has a say.
// Not inlined: nothing else should run on top of what the verifier needs of the stack.
#[inline(never)]
pub(super) fn verified(
    blob: BlobBuffer<'_>,
) -> Result<Verified<BlobBuffer<'_>>, (BlobBuffer<'_>, Refusal)> {
    esm_core::verify(blob)
}
