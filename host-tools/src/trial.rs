//! A mission on trial, watched from the host until it is known what becomes of it.

use std::time::Duration;

use rt_firmware::link::message::{LinkError, Mode, SafeReason, Status};
use rt_firmware::link::trial::FallBack;

use crate::link_client::{ClientError, LinkClient};
use crate::serial::ByteLink;

/// How long a mission is on trial at least where nobody says more.
pub const DEFAULT_TRIAL: Duration = Duration::from_secs(10);

/// The trial of a mission whose macro steps are seldom is as long as so many of them.
const TRIAL_STEPS: u32 = 20;

/// What a mission has to run without a fault before it is confirmed: this time of its own, and so many macro steps.
const HEALTHY_US: u64 = 1_000_000;
const HEALTHY_STEPS: u64 = 5;

/// How often the robot is asked.
const LOOK_TIME: Duration = Duration::from_millis(50);

/// How long the robot's time may stand still, as often as it is looked at.
const STANDSTILL_LIMIT: Duration = Duration::from_secs(10);

/// What becomes of a mission on trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// It ran well and is confirmed.
    Confirmed,
    /// The robot is stopped, so that there was nothing to see; it is confirmed all the same.
    ConfirmedUnseen,
    /// The robot went back to the mission before, or to none.
    FellBack(FallBack),
    /// The robot went to its safe state for something that is not the mission's doing. The trial goes on.
    Safe(SafeReason),
    /// Another mission runs, or the robot was reset: nothing is known of the trial.
    Unknown,
    /// The robot's time stands still. The trial goes on.
    Standstill,
}

/// How long a mission should be on trial whose interpreter runs with this period.
pub fn trial_time(interpreter_period_us: u32) -> Duration {
    let steps = Duration::from_micros(interpreter_period_us.into()) * TRIAL_STEPS;
    DEFAULT_TRIAL.max(steps)
}

/// Watches the mission of this hash, which is on trial, until it has run well for about a second of its own time and confirms it, or until it is known
/// that this will not be.
///
/// # Errors
/// [`ClientError`]: the robot does not answer any more. It falls back by itself.
pub fn watch<L: ByteLink>(robot: &mut LinkClient<L>, mission: u32) -> Result<Outcome, ClientError> {
    watch_and(robot, mission, |_| Ok(()))
}

/// The same, with something else to do meanwhile, again and again.
///
/// # Errors
/// [`ClientError`], as whatever `meanwhile` has.
pub fn watch_and<L: ByteLink, E: From<ClientError>>(
    robot: &mut LinkClient<L>,
    mission: u32,
    mut meanwhile: impl FnMut(&mut LinkClient<L>) -> Result<(), E>,
) -> Result<Outcome, E> {
    let mut last_us = 0;
    let mut stood = Duration::ZERO;
    loop {
        let status = robot.status()?;
        if let Some(outcome) = known(&status, mission) {
            return Ok(outcome);
        }
        let stopped = status.mode.is_latched();
        if stopped || (status.t_us >= HEALTHY_US && status.steps >= HEALTHY_STEPS) {
            match robot.confirm(mission) {
                Ok(()) if stopped => return Ok(Outcome::ConfirmedUnseen),
                Ok(()) => return Ok(Outcome::Confirmed),
                // It failed in this moment: the next status says how.
                Err(error) if error.refusal() == Some(LinkError::NotOnTrial) => {}
                Err(error) => return Err(error.into()),
            }
        }
        if status.t_us != last_us {
            last_us = status.t_us;
            stood = Duration::ZERO;
        } else if stood > STANDSTILL_LIMIT {
            return Ok(Outcome::Standstill);
        }
        meanwhile(robot)?;
        std::thread::sleep(LOOK_TIME);
        stood += LOOK_TIME;
    }
}

/// How the trial of a mission ended that was on it before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// It was confirmed.
    Confirmed,
    /// The robot went back to the mission before, or to none.
    FellBack(FallBack),
    /// Another mission runs, or the robot was reset: nothing is known of the trial.
    Unknown,
    /// The robot's time stands still. The trial goes on.
    Standstill,
}

/// Waits for the end of the trial of the mission of this hash, which is to fall back to `before`. `left` is told how long it lasts still.
///
/// # Errors
/// [`ClientError`]: the robot does not answer any more, or whoever waits has had enough ([`LinkClient::stop_when`]).
pub fn outlast<L: ByteLink>(
    robot: &mut LinkClient<L>,
    mission: u32,
    before: Option<u32>,
    left: &mut dyn FnMut(Duration),
) -> Result<End, ClientError> {
    let clock = robot.clock().clone();
    let mut last_left_ms = None;
    let mut moved_at = clock.now();
    loop {
        let status = robot.status()?;
        let trial = match status.trial {
            Some(trial) if status.mission == Some(mission) => trial,
            _ => return Ok(end_of(&status, mission, before)),
        };
        left(Duration::from_millis(trial.left_ms.into()));
        if last_left_ms != Some(trial.left_ms) {
            last_left_ms = Some(trial.left_ms);
            moved_at = clock.now();
        } else if clock.since(moved_at) > STANDSTILL_LIMIT {
            return Ok(End::Standstill);
        }
        clock.pause(LOOK_TIME);
    }
}

/// What the status of a robot that has this mission not on trial any more says of how that came; `before` is the mission that it was to fall back to. What it says of the last
/// mission that was given up may be of an earlier trial.
fn end_of(status: &Status, mission: u32, before: Option<u32>) -> End {
    let runs = status.mission == Some(mission);
    match status.fell_back {
        Some(fell_back) if fell_back.mission == mission && (!runs || before == Some(mission)) => {
            End::FellBack(fell_back)
        }
        _ if runs => End::Confirmed,
        _ => End::Unknown,
    }
}

/// What a status says of the trial of this mission, if it says how it ended.
fn known(status: &Status, mission: u32) -> Option<Outcome> {
    let runs = status.mission == Some(mission);
    match (status.trial, status.fell_back) {
        (Some(_), _) if runs => match status.mode {
            // What is the mission's doing ends the trial within a macro step.
            Mode::Safe(
                reason @ (SafeReason::BodyLost
                | SafeReason::LowBattery
                | SafeReason::LinkLost
                | SafeReason::Board),
            ) => Some(Outcome::Safe(reason)),
            _ => None,
        },
        (_, Some(fell_back)) if fell_back.mission == mission && !runs => {
            Some(Outcome::FellBack(fell_back))
        }
        // The same mission again as the one before it.
        (None, Some(fell_back)) if fell_back.mission == mission => {
            Some(Outcome::FellBack(fell_back))
        }
        // Somebody else was faster.
        (None, _) if runs => Some(Outcome::Confirmed),
        _ => Some(Outcome::Unknown),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missions_with_seldom_macro_steps_are_longer_on_trial() {
        assert_eq!(trial_time(50_000), DEFAULT_TRIAL);
        assert_eq!(trial_time(2_000_000), Duration::from_secs(40));
    }
}
