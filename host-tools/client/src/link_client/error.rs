//! What can go wrong between host and robot, in sentences that say what to do.

use std::cmp::Ordering;
use std::io;
use std::time::Duration;

use esm_link::features::Feature;
use esm_link::message::{Capacity, LinkError, PROTOCOL_VERSION};
use thiserror::Error;

use crate::keys::{KeyError, PublicKey};

/// Why a request was not done.
#[derive(Debug, Error)]
pub enum ClientError {
    /// The line itself failed.
    #[error("the line to the robot is lost: {0}")]
    Line(#[from] io::Error),
    /// The robot did not answer in time.
    #[error(
        "the robot did not answer `{request}` within {:.1} s; {}",
        waited.as_secs_f64(),
        what_to_do(*corrupt_frames)
    )]
    NoReply {
        /// What was asked.
        request: &'static str,
        /// How long was waited in all.
        waited: Duration,
        /// Frames that came corrupt meanwhile.
        corrupt_frames: u64,
    },
    /// Whoever asked has had enough ([`LinkClient::stop_when`](super::LinkClient::stop_when)).
    #[error("`{request}` was interrupted")]
    Interrupted {
        /// What was asked.
        request: &'static str,
    },
    /// The robot's firmware and this program do not speak the same.
    #[error(
        "the robot speaks version {robot} of the link, this program version {PROTOCOL_VERSION}; {}",
        match robot.cmp(&PROTOCOL_VERSION) {
            Ordering::Less => "flash a newer firmware",
            // Both are of a time before this version was released.
            Ordering::Equal => "but not the same draft of it: build firmware and esm from the same source",
            Ordering::Greater => "use a newer esm",
        }
    )]
    OtherVersion {
        /// The robot's version.
        robot: u16,
    },
    /// The robot answered something else than what was asked for.
    #[error(
        "the robot's answer to `{request}` makes no sense; its firmware and this program do not fit together"
    )]
    BadAnswer {
        /// What was asked.
        request: &'static str,
    },
    /// The robot answered in parts that are none of a whole.
    #[error(
        "the robot's answer to `{request}` makes no sense: {flaw}; its firmware and this program do not fit together, or something else than a robot answers"
    )]
    BadParts {
        /// What was asked.
        request: &'static str,
        /// What is wrong with them.
        flaw: Flaw,
    },
    /// The robot answers, and so slowly that it would never come to an end.
    #[error(
        "the robot was waited for {:.1} s in all, and `{request}` is not through; it answers too slowly, or nonsense",
        limit.as_secs_f64()
    )]
    TooSlow {
        /// What was asked.
        request: &'static str,
        /// How long all of it could have taken.
        limit: Duration,
    },
    /// The robot refused.
    #[error("the robot refused `{request}`: {}", reason(*error))]
    Refused {
        /// What was asked.
        request: &'static str,
        /// Why.
        error: LinkError,
    },
    /// The robot refused, but the session with it had ended while this was under way: it may have
    /// been done before.
    #[error(
        "the robot refused `{request}`: {}; but its session had ended while that was under way, so that it may have been done before: `esm status` tells",
        reason(*error)
    )]
    MayBeDone {
        /// What was asked.
        request: &'static str,
        /// Why.
        error: LinkError,
    },
    /// The robot's firmware was built without what was to be asked for.
    #[error(
        "the robot's firmware was built without the feature `{}`: {}; build it with that feature of its board's crate (`cargo xtask firmware` builds lm3s6965 with all of them) and flash it",
        feature.name(),
        without(*feature)
    )]
    NotBuiltIn {
        /// Which feature.
        feature: Feature,
    },
    /// The robot has a key, and this session has none.
    #[error("the robot takes this from the owner of its key alone, and no key was given")]
    NoKey,
    /// The robot has a key, and the one for it cannot be had.
    #[error("the robot takes this from the owner of its key alone: {0}")]
    Key(#[from] KeyError),
    /// The robot has another key.
    #[error(
        "the robot has the key {robot}, this one is {ours}; `--key FILE` and ESM_KEY name another"
    )]
    OtherKey {
        /// The robot's.
        robot: PublicKey,
        /// This session's.
        ours: PublicKey,
    },
    /// A key was named, and the robot says that it has none.
    #[error(
        "a key was named, and the robot says that it has none: its memory was erased, or somebody answers in its place; `esm key install` gives it a key again"
    )]
    NotLocked,
    /// Answers came, and none with the proof that it is the robot's own.
    #[error(
        "answers to `{request}` came, but none is proven to be the robot's own: somebody answers in its place, or the robot has lost what it shares with its owner"
    )]
    Unproven {
        /// What was asked.
        request: &'static str,
    },
    /// The upload does not come to an end.
    #[error("the upload failed again and again: {}", reason(*error))]
    UploadStuck {
        /// The last reason.
        error: LinkError,
    },
}

/// What is wrong with the parts of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Flaw {
    /// It is longer than it can be.
    #[error("it has {said} {unit}, and {most} are the most there can be")]
    TooLong {
        /// What the robot says.
        said: u64,
        /// The most.
        most: u64,
        /// Of what.
        unit: &'static str,
    },
    /// Its length is another one in each part.
    #[error("it has {before} bytes at first and {now} later")]
    OtherLength {
        /// What the first part said.
        before: usize,
        /// What a later one said.
        now: usize,
    },
    /// A part is empty, and the whole is not there.
    #[error("it ends after {there} of {total}")]
    NoEnd {
        /// What is there.
        there: usize,
        /// What the robot says there is.
        total: usize,
    },
    /// More came than there is.
    #[error("{there} bytes came of {total}")]
    Overfull {
        /// What came.
        there: usize,
        /// What the robot says there is.
        total: usize,
    },
    /// A later part tells what was told before.
    #[error("it goes back")]
    GoesBack,
}

impl ClientError {
    /// Why the robot refused, if it was a refusal.
    pub fn refusal(&self) -> Option<LinkError> {
        match self {
            ClientError::Refused { error, .. }
            | ClientError::MayBeDone { error, .. }
            | ClientError::UploadStuck { error } => Some(*error),
            _ => None,
        }
    }
}

/// What to do where nothing came of use, but so many corrupt frames.
fn what_to_do(corrupt_frames: u64) -> String {
    match corrupt_frames {
        0 => "is it switched on, and is the rate of its line right?".into(),
        1 => "one frame came, and it was spoiled; is the rate of the line right, and is its cable sound?".into(),
        frames => format!(
            "{frames} frames came spoiled: the line is too bad. Look at cable, plugs and ground, take a shorter cable, or give the line a lower rate at both ends; then try again, an upload goes on where it was"
        ),
    }
}

/// What a robot does not do whose firmware was built without this.
pub fn without(feature: Feature) -> &'static str {
    match feature {
        Feature::Record => "what enters its machine cannot be recorded",
        Feature::Log => "it keeps no log",
        Feature::StatusEvent => "it tells no news",
        Feature::Params => "parameters are read and changed with a new mission alone",
        Feature::Warm => "each mission begins anew, without `--warm`",
        Feature::Keys => "it can have no key, and takes commands from anyone",
        Feature::Store => "it keeps nothing in a flash, or has none",
        Feature::BlackBox => "it has no flight recorder",
        Feature::Telemetry => "it tells nothing of values on nets",
        Feature::Behaviours => "it has no behaviours",
        Feature::Selftest => "it tells nothing of what its board measures of itself",
        Feature::Links => {
            "its missions have no links; for boards that can have them, `cargo xtask firmware --with links` builds a firmware with them"
        }
    }
}

/// A refusal in words, as far as the robot's numbers go. [`refusal_with_names`] knows the mission's
/// names too.
pub fn reason(error: LinkError) -> String {
    refusal_with_names(error, |_| None)
}

/// A refusal in words. `task_name` gives the name of a task type of the blob.
pub fn refusal_with_names(error: LinkError, task_name: impl Fn(usize) -> Option<String>) -> String {
    let task = |index: u16| match task_name(usize::from(index)) {
        Some(name) => format!("the task `{name}`"),
        None => format!("the mission's task number {index}"),
    };
    match error {
        LinkError::Malformed => "it did not understand the request".into(),
        LinkError::NoUpload => "no upload is under way".into(),
        LinkError::WrongOffset { expected } => {
            format!("the upload stands at byte {expected}")
        }
        LinkError::TooLong => "more bytes came than were announced".into(),
        LinkError::Incomplete { received } => {
            format!("only {received} bytes of the mission have arrived")
        }
        LinkError::WrongChecksum => "the mission was spoiled on its way; upload it again".into(),
        LinkError::Invalid(refusal) => {
            format!("the mission is no valid blob ({refusal:?}); build it again")
        }
        LinkError::UnknownTask { task: index } if task(index).contains('.') => format!(
            "its firmware was built without links, and {} is the dispatcher of one",
            task(index)
        ),
        LinkError::UnknownTask { task: index } => format!(
            "its firmware lacks {}; `esm tasks` lists what it has",
            task(index)
        ),
        LinkError::SignatureDiffers { task: index } => format!(
            "its firmware has {} with other ports, flags or parameters; `esm tasks` prints the declaration that fits",
            task(index)
        ),
        LinkError::TooManyInstances {
            task: index,
            needed,
            available,
        } => format!(
            "the mission has {needed} states of {}, its firmware has room for {available}",
            task(index)
        ),
        LinkError::CapacityExceeded {
            what,
            needed,
            available,
        } => {
            let what = match what {
                Capacity::BlobBytes => "bytes",
                Capacity::ArenaWords => "words of memory for its state",
                Capacity::Slots => "slots",
                Capacity::TaskInstances => "task states",
                Capacity::Nets => "nets",
                Capacity::ExclusiveGroups => "exclusive groups",
                Capacity::Links => "links",
                Capacity::Frames => "frames",
                Capacity::ScriptSteps => {
                    return format!(
                        "the script has {needed} steps, with those that its situations insert, and the robot has room for {available}: make two of it"
                    );
                }
                Capacity::Pairs => {
                    return format!(
                        "the mission has {needed} entries in common with the one that runs, the robot has room for {available}: upload it without `--warm`"
                    );
                }
            };
            format!("the mission needs {needed} {what}, the robot has room for {available}")
        }
        LinkError::NoMission => "it has no mission; upload one first".into(),
        LinkError::NoSuchIndex => "it has nothing of that number".into(),
        LinkError::Busy => "it still works on the request before".into(),
        LinkError::OnTrial => "a mission is on trial, and the one before is kept until then; `esm confirm` or `esm fallback` first".into(),
        LinkError::NoStore => "it has no flash that it could keep this in; write it into the mission, and upload that".into(),
        LinkError::NotBuiltIn => "its firmware was built without this".into(),
        LinkError::EmergencyStopped => "an emergency stop is latched there; once its button is up, `esm start --release` ends it".into(),
        LinkError::NoBehaviours => "no task `Behaviours` executes there that knows where the robot is: the mission has none, or is stopped; `esm status` says how it is, `missions/by_hand.esm` has one".into(),
        LinkError::NotABehaviour => "its firmware has no such behaviour; `esm behaviours` lists what it has".into(),
        LinkError::ListFull => "its list of behaviours has no room; `esm behaviours show` says what stands there, `esm behaviours cancel` takes one off".into(),
        LinkError::NotOnList => "no behaviour of this key is on its list, or none that this can be done to; `esm behaviours show` lists them".into(),
        LinkError::NoScript => "there is no script under way, or not all of its steps have arrived; `esm script run` sends them".into(),
        LinkError::NoSituation => "a situation is none, or its value is no number or negative".into(),
        LinkError::TooFast => "that is no speed, or faster than a robot may be driven by hand: 2 m/s and 6.3 rad/s at most".into(),
        LinkError::PositionOutside => "that is no position, or beyond what it takes: 1,000 m along each axis; a correction, 1 m and 0.6 rad".into(),
        LinkError::NoPosition => "no task `GlobalPosition` executes there that knows where the robot is: the mission has none, or is stopped; `esm status` says how it is, `missions/by_hand.esm` has one".into(),
        LinkError::PayloadDiffers { frame, needed: 0 } => format!("no task of its firmware has the type of frame {frame} of the mission, counted from 0; `esm tasks` lists what it has"),
        LinkError::PayloadDiffers { frame, needed } => format!("the value of frame {frame} of the mission, counted from 0, is {needed} bytes long there: write `payload {needed} bytes`"),
        LinkError::StopCame => "a stop came meanwhile, and the robot stands still; if nobody needs that any more, `esm start` it again".into(),
        LinkError::Late => "it came to this later than you waited for it, and has not done it".into(),
        LinkError::StopNotStored => "the emergency stop is as you want it, but the robot's flash did not take that: a loss of power undoes it".into(),
        LinkError::NotOnTrial => "that mission is not on trial: it was confirmed, or given up; `esm status` says which runs".into(),
        LinkError::FlashRefused => "its flash did not take it; what was in it before is what it starts with".into(),
        LinkError::FlashBudget { s } => format!(
            "its flash was erased too often of late, and would wear out: nothing has changed; try again in {s} s. A key keeps others from using it up: `esm key install`"
        ),
        LinkError::OtherMission => "another mission runs there by now; ask again".into(),
        LinkError::ParamNoValue => "that is no value of the parameter's type; NaN and infinity are no numbers there".into(),
        // The bits mean something to who knows the parameter's type.
        LinkError::ParamOutside { .. } => "the value is outside of what its task takes; `esm tasks` prints the bounds".into(),
        LinkError::TooManyParams { available } => format!(
            "{available} parameters differ from the mission's already, and it can keep no more; `esm param set` one of them back to the mission's value, or build the mission with them"
        ),
        LinkError::NoAnswer => {
            "its real-time side did not answer in time; `esm status` says how it is".into()
        }
        LinkError::NetTypeDiffers { task: index, port } => format!(
            "a path joins data port number {port} of {} with ports of another type; build the mission again",
            task(index)
        ),
        LinkError::ParamOutOfRange { task: index, param } => format!(
            "parameter number {param} of {} is outside of what its firmware allows; `esm tasks` prints the bounds",
            task(index)
        ),
        LinkError::NeedsKey => {
            "it has a key, whose owner must sign this; `--key FILE` names the key".into()
        }
        LinkError::NotSigned => {
            "it has a key, whose owner must sign the mission; `--key FILE` names the key".into()
        }
        LinkError::WrongSignature => "its key has not signed what it has got".into(),
        LinkError::OldCounter { last } => format!(
            "the mission was signed as number {last} or before, and the robot has accepted number {last}: it is an old upload; upload it again"
        ),
        LinkError::NoChallenge => "the signature is of no use any more; try again".into(),
        LinkError::NoKey => "it has no key; `esm key install` gives it one".into(),
        LinkError::NoKeySupport => "its firmware has no room for a key".into(),
        LinkError::NotStored => {
            "its memory for its key cannot be read, or did not take this; `esm key show --port` tells what holds now".into()
        }
        LinkError::NoSession => "it takes this from its owner's session alone; `--key FILE` names the key".into(),
        LinkError::WrongProof => "the key does not fit to what it keeps of its owner".into(),
        LinkError::CounterTooFar { last } => format!(
            "the number of the upload is too far from {last}, the last one that it has accepted; upload it again"
        ),
        LinkError::DeadlineTooFar => "the command was to be good for too long; try again".into(),
        LinkError::TooSoon { ms } => {
            format!("somebody has sent it a wrong signature; it looks at the next in {ms} ms")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refusals_name_the_task() {
        let name = |index: usize| {
            ["Cruise", "Avoid"]
                .get(index)
                .map(|name| (*name).to_owned())
        };
        let cases = [
            (
                LinkError::UnknownTask { task: 1 },
                "its firmware lacks the task `Avoid`; `esm tasks` lists what it has",
            ),
            (
                LinkError::UnknownTask { task: 9 },
                "its firmware lacks the mission's task number 9; `esm tasks` lists what it has",
            ),
            (
                LinkError::SignatureDiffers { task: 0 },
                "its firmware has the task `Cruise` with other ports, flags or parameters; `esm tasks` prints the declaration that fits",
            ),
            (
                LinkError::NetTypeDiffers { task: 1, port: 0 },
                "a path joins data port number 0 of the task `Avoid` with ports of another type; build the mission again",
            ),
            (
                LinkError::ParamOutOfRange { task: 0, param: 2 },
                "parameter number 2 of the task `Cruise` is outside of what its firmware allows; `esm tasks` prints the bounds",
            ),
            (
                LinkError::CapacityExceeded {
                    what: Capacity::BlobBytes,
                    needed: 5000,
                    available: 4096,
                },
                "the mission needs 5000 bytes, the robot has room for 4096",
            ),
        ];
        for (error, expected) in cases {
            assert_eq!(refusal_with_names(error, name), expected);
        }
    }
}
