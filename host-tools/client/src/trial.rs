//! A mission on trial, watched from the host until it is known what becomes of it.

use std::time::Duration;

use esm_link::message::{LinkError, Mode, SafeReason, Status};
use esm_link::trial::FallBack;

use crate::link_client::{ClientError, LinkClient};
use crate::serial::ByteLink;

/// How long a mission is on trial at least where nobody says more.
pub const DEFAULT_TRIAL: Duration = Duration::from_secs(10);

/// The trial of a mission whose macro steps are seldom is as long as so many of them.
const TRIAL_STEPS: u32 = 20;

/// What a mission has to run without a fault before it is confirmed: this time of its own, and so
/// many macro steps.
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
    /// The robot is stopped, so that the mission did not run; it is confirmed all the same.
    ConfirmedStopped,
    /// The robot went back to the mission before, or to none.
    FellBack(FallBack),
    /// The robot went to its safe state for something that is not the mission's doing. The trial
    /// goes on.
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

/// A mission on trial, with what the robot said before: it says which mission it gave up last, but
/// not when, and that may have been the same mission on an earlier trial.
#[derive(Clone, Copy, Debug)]
pub struct Tried {
    mission: u32,
    /// What it falls back to.
    before: Option<u32>,
    /// The last mission that was given up before this trial began.
    given_up: Option<FallBack>,
    /// Its macro steps when it was last seen on trial.
    steps: Option<u64>,
    /// How long it can last.
    limit: Duration,
}

/// The longest that a trial can be.
pub const LONGEST_TRIAL: Duration = Duration::from_secs(3600);

/// How much later than it should a trial may be seen to end: the robot's clock is not this one.
const SLACK: Duration = Duration::from_secs(10);

impl Tried {
    /// The mission of this hash, on trial for such a time since a commit before which the robot
    /// said this of itself.
    pub fn since(status: &Status, mission: u32, time: Duration) -> Self {
        Tried {
            mission,
            before: status.mission,
            given_up: status.fell_back,
            steps: None,
            limit: time + SLACK,
        }
    }

    /// The mission that a robot says is on trial, if one is.
    pub fn found(status: &Status) -> Option<Self> {
        let (trial, mission) = status.trial.zip(status.mission)?;
        Some(Tried {
            mission,
            before: trial.before,
            given_up: status.fell_back,
            steps: Some(status.steps),
            limit: Duration::from_millis(trial.left_ms.into()).min(LONGEST_TRIAL) + SLACK,
        })
    }

    /// How long it can last at most, as it is seen from here.
    pub fn limit(&self) -> Duration {
        self.limit
    }

    /// What a status says of the end of the trial; none while it goes on.
    fn end(&mut self, status: &Status) -> Option<End> {
        let runs = status.mission == Some(self.mission);
        if status.trial.is_some() && runs {
            self.steps = Some(status.steps);
            return None;
        }
        let is_fallen_back = if status.fell_back != self.given_up {
            true
        } else if runs {
            // From its beginning, or as it went on.
            let has_begun_anew = self.steps.is_none_or(|steps| status.steps < steps);
            self.before == Some(self.mission) && has_begun_anew
        } else {
            // Where there was none before, the robot may have found one in its flash.
            self.before.is_none() || self.before == status.mission
        };
        let given_up = status.fell_back.filter(|it| it.mission == self.mission);
        Some(match given_up {
            Some(fell_back) if is_fallen_back => End::FellBack(fell_back),
            _ if runs => End::Confirmed,
            _ => End::Unknown,
        })
    }
}

/// Watches a mission on trial until it has run well for about a second of its own time and confirms
/// it, or until it is known that this will not be. There is something else to do meanwhile, again
/// and again.
///
/// # Errors
/// [`ClientError`]: the robot does not answer any more, and falls back by itself. Or whatever
/// `meanwhile` has.
pub fn watch_and<L: ByteLink, E: From<ClientError>>(
    robot: &mut LinkClient<L>,
    mut trial: Tried,
    mut meanwhile: impl FnMut(&mut LinkClient<L>) -> Result<(), E>,
) -> Result<Outcome, E> {
    let clock = robot.clock().clone();
    let begun = clock.now();
    let mut last_us = 0;
    let mut stood = Duration::ZERO;
    loop {
        let status = robot.status()?;
        if let Some(end) = trial.end(&status) {
            // If it is confirmed, somebody else was faster.
            return Ok(end.into());
        }
        if let Some(reason) = outer_reason(status.mode) {
            return Ok(Outcome::Safe(reason));
        }
        let stopped = status.mode.is_latched();
        if stopped || (status.t_us >= HEALTHY_US && status.steps >= HEALTHY_STEPS) {
            match robot.confirm(trial.mission) {
                Ok(()) if stopped => return Ok(Outcome::ConfirmedStopped),
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
        // A robot on whose word no trial ever ends.
        if clock.since(begun) > trial.limit {
            return Ok(Outcome::Unknown);
        }
        meanwhile(robot)?;
        clock.pause(LOOK_TIME);
        stood += LOOK_TIME;
    }
}

/// Why a robot is in its safe state, if that is not the mission's doing: what is ends the trial
/// within a macro step.
fn outer_reason(mode: Mode) -> Option<SafeReason> {
    match mode {
        Mode::Safe(
            reason @ (SafeReason::BodyLost
            | SafeReason::LowBattery
            | SafeReason::LinkLost
            | SafeReason::Board
            | SafeReason::MonitorSilent),
        ) => Some(reason),
        _ => None,
    }
}

/// How the trial of a mission ended.
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

impl From<End> for Outcome {
    fn from(end: End) -> Self {
        match end {
            End::Confirmed => Outcome::Confirmed,
            End::FellBack(fell_back) => Outcome::FellBack(fell_back),
            End::Unknown => Outcome::Unknown,
            End::Standstill => Outcome::Standstill,
        }
    }
}

/// Waits for the end of a trial. `left` is told how long it lasts still.
///
/// # Errors
/// [`ClientError`]: the robot does not answer any more, or whoever waits has had enough
/// ([`LinkClient::stop_when`]).
pub fn outlast<L: ByteLink>(
    robot: &mut LinkClient<L>,
    mut trial: Tried,
    left: &mut dyn FnMut(Duration),
) -> Result<End, ClientError> {
    let clock = robot.clock().clone();
    let mut last_left_ms = None;
    let begun = clock.now();
    let mut moved_at = begun;
    loop {
        let status = robot.status()?;
        if let Some(end) = trial.end(&status) {
            return Ok(end);
        }
        let left_ms = status.trial.map(|trial| trial.left_ms);
        left(Duration::from_millis(left_ms.unwrap_or(0).into()));
        if last_left_ms != left_ms {
            last_left_ms = left_ms;
            moved_at = clock.now();
        } else if clock.since(moved_at) > STANDSTILL_LIMIT {
            return Ok(End::Standstill);
        }
        if clock.since(begun) > trial.limit {
            return Ok(End::Unknown);
        }
        clock.pause(LOOK_TIME);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::status;
    use esm_link::trial::{FallBackReason, Trial};

    #[test]
    fn missions_with_seldom_macro_steps_are_longer_on_trial() {
        assert_eq!(trial_time(50_000), DEFAULT_TRIAL);
        assert_eq!(trial_time(2_000_000), Duration::from_secs(40));
    }

    #[test]
    fn the_end_of_a_trial_is_not_that_of_an_earlier_one() {
        const OLD: u32 = 1;
        const NEW: u32 = 2;
        const OTHER: u32 = 3;
        let gave_up = |mission| FallBack {
            mission,
            reason: FallBackReason::NotConfirmed,
        };
        let asked = FallBack {
            mission: NEW,
            reason: FallBackReason::Asked,
        };
        // What ran before, what was given up before; what runs then, in which macro step after the
        // 50th, and what was given up last.
        for (what, before, earlier, (runs, steps, last), end) in [
            (
                "confirmed",
                Some(OLD),
                None,
                (Some(NEW), 60, None),
                End::Confirmed,
            ),
            (
                "fallen back",
                Some(OLD),
                None,
                (Some(OLD), 3, Some(gave_up(NEW))),
                End::FellBack(gave_up(NEW)),
            ),
            (
                "fallen back to none",
                None,
                None,
                (None, 0, Some(gave_up(NEW))),
                End::FellBack(gave_up(NEW)),
            ),
            (
                "confirmed, and given up on an earlier trial",
                Some(OLD),
                Some(gave_up(NEW)),
                (Some(NEW), 60, Some(gave_up(NEW))),
                End::Confirmed,
            ),
            (
                "the same mission as before, confirmed, and given up on an earlier trial",
                Some(NEW),
                Some(gave_up(NEW)),
                (Some(NEW), 60, Some(gave_up(NEW))),
                End::Confirmed,
            ),
            (
                "the same mission as before, given up again",
                Some(NEW),
                Some(gave_up(NEW)),
                (Some(NEW), 3, Some(gave_up(NEW))),
                End::FellBack(gave_up(NEW)),
            ),
            (
                "the same mission as before, given up again for another reason",
                Some(NEW),
                Some(gave_up(NEW)),
                (Some(NEW), 60, Some(asked)),
                End::FellBack(asked),
            ),
            (
                "given up again",
                Some(OLD),
                Some(gave_up(NEW)),
                (Some(OLD), 3, Some(gave_up(NEW))),
                End::FellBack(gave_up(NEW)),
            ),
            (
                "given up again, and another mission was in the flash",
                None,
                Some(gave_up(NEW)),
                (Some(OTHER), 3, Some(gave_up(NEW))),
                End::FellBack(gave_up(NEW)),
            ),
            (
                "another mission runs, and it was given up on an earlier trial",
                Some(OLD),
                Some(gave_up(NEW)),
                (Some(OTHER), 3, Some(gave_up(NEW))),
                End::Unknown,
            ),
            (
                "reset",
                Some(OLD),
                Some(gave_up(NEW)),
                (Some(OLD), 3, None),
                End::Unknown,
            ),
        ] {
            let committed = Status {
                fell_back: earlier,
                ..status(before, 500)
            };
            let seen = Status {
                trial: Some(Trial {
                    left_ms: 1_000,
                    before,
                }),
                fell_back: earlier,
                ..status(Some(NEW), 50)
            };
            let ended = Status {
                fell_back: last,
                ..status(runs, steps)
            };
            let mut trials = [
                Tried::since(&committed, NEW, DEFAULT_TRIAL),
                Tried::found(&seen).unwrap(),
            ];
            for trial in &mut trials {
                assert_eq!(trial.end(&seen), None, "{what}");
                assert_eq!(trial.end(&ended), Some(end), "{what}");
            }
        }
    }
}
