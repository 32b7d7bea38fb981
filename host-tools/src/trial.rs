//! A mission on trial, watched from the host until it is known what becomes of it.

use std::time::{Duration, Instant};

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

/// How long the robot's time may stand still.
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
    let mut moved_at = Instant::now();
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
            moved_at = Instant::now();
        } else if moved_at.elapsed() > STANDSTILL_LIMIT {
            return Ok(Outcome::Standstill);
        }
        meanwhile(robot)?;
        std::thread::sleep(LOOK_TIME);
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
