//! Requests to the list of behaviours: they are looked at here, so that the real-time side gets
//! nothing that it would have to refuse for what it says.

use super::handler::{Reaction, RequestHandler};
use crate::declaration::{Declaration, Direction, MAX_PARAMS, Params};
use crate::features::BEHAVIOURS;
use crate::list_command::{Call, LIST_TYPE, ListCommand};
use crate::odometry::Pose;
use crate::ports::Registry;
use crate::realtime::mailbox::Command;
use crate::realtime::params;
use esm_link::behaviours::{
    self, BehaviourRequest, MAX_DRIVE_M_PER_S, MAX_DRIVE_RAD_PER_S, MAX_DRIVE_US, MAX_WATCHES,
    PARAM_BYTES, WATCH_BYTES, Watch,
};
use esm_link::message::{LinkError, Request};
use esm_link::position::Correction;

impl RequestHandler<'_, '_> {
    /// Asks the owner of the list, at this time on the board's clock.
    pub(super) fn ask_behaviours<'a>(
        &mut self,
        request: &Request<'_>,
        now_us: u64,
    ) -> Reaction<'a> {
        if !BEHAVIOURS {
            return Reaction::Answer(Err(LinkError::NotBuiltIn));
        }
        let command = match *request {
            Request::Behaviours(ref request) => {
                let command = command_of(request, self.registry);
                #[cfg(feature = "behaviours")]
                if command.is_ok() {
                    self.script_keeper.note(request);
                }
                command
            }
            Request::Drive {
                forward_m_per_s,
                turn_rad_per_s,
                until_us,
            } => checked_drive(forward_m_per_s, turn_rad_per_s, until_us, now_us),
            Request::EndDrive => Ok(ListCommand::EndDrive),
            _ => Ok(ListCommand::Read),
        };
        match command {
            Ok(command) => self.ask(Command::Behaviours(command)),
            Err(error) => Reaction::Answer(Err(error)),
        }
    }
}

fn command_of(
    request: &BehaviourRequest<'_>,
    registry: Registry<'_>,
) -> Result<ListCommand, LinkError> {
    Ok(match *request {
        BehaviourRequest::InsertAtTail(ref call) => ListCommand::Insert {
            at_head: false,
            call: alone(call, registry)?,
        },
        BehaviourRequest::InsertAtHead(ref call) => ListCommand::Insert {
            at_head: true,
            call: alone(call, registry)?,
        },
        BehaviourRequest::Cancel { key } => ListCommand::Cancel(key),
        BehaviourRequest::Suspend { key } => ListCommand::Hold(key, true),
        BehaviourRequest::Resume { key } => ListCommand::Hold(key, false),
        BehaviourRequest::Step {
            script,
            index,
            ref call,
        } => ListCommand::Step {
            script,
            index,
            call: checked(call, registry)?,
        },
        BehaviourRequest::Run { script, steps, all } => ListCommand::Run { script, steps, all },
        BehaviourRequest::EndScript => ListCommand::EndScript,
        BehaviourRequest::SuspendScript => ListCommand::HoldScript(true),
        BehaviourRequest::ResumeScript => ListCommand::HoldScript(false),
        BehaviourRequest::Position { position } => checked_position(position)?,
        // They are answered before, where there are behaviours.
        BehaviourRequest::KeepScript { .. } | BehaviourRequest::KeptScript => {
            return Err(LinkError::NoStore);
        }
    })
}

/// A position or a correction that is one, within its bounds.
fn checked_position(position: &[u8]) -> Result<ListCommand, LinkError> {
    let (correction, [x_m, y_m, heading_rad]) =
        Correction::of_bytes(position).ok_or(LinkError::Malformed)?;
    if !correction.allows(x_m, y_m, heading_rad) {
        return Err(LinkError::PositionOutside);
    }
    let pose = Pose {
        x_m,
        y_m,
        heading_rad,
    };
    Ok(ListCommand::Position(correction, pose))
}

/// A movement that is one, and holds for no longer than it may.
fn checked_drive(
    forward_m_per_s: f32,
    turn_rad_per_s: f32,
    until_us: u64,
    now_us: u64,
) -> Result<ListCommand, LinkError> {
    // NaN is within nothing.
    let is_within = |value: f32, most: f32| (-most..=most).contains(&value);
    if !is_within(forward_m_per_s, MAX_DRIVE_M_PER_S)
        || !is_within(turn_rad_per_s, MAX_DRIVE_RAD_PER_S)
    {
        return Err(LinkError::TooFast);
    }
    match until_us.checked_sub(now_us) {
        None => Err(LinkError::Late),
        Some(ahead_us) if ahead_us > MAX_DRIVE_US => Err(LinkError::DeadlineTooFar),
        Some(_) => Ok(ListCommand::Drive {
            forward_m_per_s,
            turn_rad_per_s,
            until_us,
        }),
    }
}

/// A behaviour that is of no script, and so has no situation that names a step of one.
fn alone(call: &behaviours::Call<'_>, registry: Registry<'_>) -> Result<Call, LinkError> {
    let call = checked(call, registry)?;
    let mut watches = call.watches.iter().flatten();
    if watches.any(|watch| watch.reaction.step().is_some()) {
        return Err(LinkError::NoSituation);
    }
    Ok(call)
}

/// A behaviour of this firmware, with parameters that it takes and situations that there are.
pub(super) fn checked(
    call: &behaviours::Call<'_>,
    registry: Registry<'_>,
) -> Result<Call, LinkError> {
    let bank = registry.find(call.task).ok_or(LinkError::NotABehaviour)?;
    let declared = registry.declaration(usize::from(bank));
    let declared = declared
        .filter(|declared| is_behaviour(declared))
        .ok_or(LinkError::NotABehaviour)?;
    let (given, []) = call.params.as_chunks::<PARAM_BYTES>() else {
        return Err(LinkError::Malformed);
    };
    if given.len() != declared.params.len() {
        return Err(LinkError::Malformed);
    }
    let mut bits = [0; MAX_PARAMS];
    for ((place, given), declared) in bits.iter_mut().zip(given).zip(declared.params) {
        *place = u32::from_le_bytes(*given);
        params::check(declared, *place)?;
    }
    let (given, []) = call.watches.as_chunks::<WATCH_BYTES>() else {
        return Err(LinkError::NoSituation);
    };
    if given.len() > MAX_WATCHES {
        return Err(LinkError::NoSituation);
    }
    let mut watches = [None; MAX_WATCHES];
    for (place, given) in watches.iter_mut().zip(given) {
        *place = Some(Watch::of_bytes(*given).ok_or(LinkError::NoSituation)?);
    }
    Ok(Call {
        task: call.task,
        params: Params::from(bits),
        watches,
    })
}

/// Whether a task stands on the list: it changes one that it has not made.
fn is_behaviour(declared: &Declaration) -> bool {
    let has = |direction| {
        let mut lists = (declared.ports.iter()).filter(|port| port.type_name() == LIST_TYPE);
        lists.any(|port| port.direction == direction)
    };
    has(Direction::InOut) && !has(Direction::Out)
}
