//! What a host asks of the list of behaviours: to insert one, to take one off, to run a
//! script, to drive by hand.
//!
//! The list is that of the task `Behaviours` of the mission that runs. It does what it is asked in
//! the next activation of its slot.

use serde::{Deserialize, Serialize};

/// How many parameters a behaviour has at most.
pub const MAX_CALL_PARAMS: usize = 8;
/// Bytes of a parameter in a [`Call`].
pub const PARAM_BYTES: usize = 4;
/// How many situations are watched beside a behaviour at most, besides those that always are.
pub const MAX_WATCHES: usize = 3;
/// Bytes of a watched situation in a [`Call`].
pub const WATCH_BYTES: usize = 6;
/// How many steps a script has at most, with the behaviours that its situations insert.
pub const MAX_SCRIPT_STEPS: usize = 16;
/// How far ahead a movement may reach that is driven by hand, in microseconds of the robot's clock.
pub const MAX_DRIVE_US: u64 = 300_000;
/// The fastest that can be driven by hand, in metres per second.
pub const MAX_DRIVE_M_PER_S: f32 = 2.0;
/// The fastest turn by hand, in radians per second.
pub const MAX_DRIVE_RAD_PER_S: f32 = 6.3;

/// What a host asks of the list of behaviours.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum BehaviourRequest<'a> {
    /// A behaviour, behind all others. Answer:
    /// [`Response::Behaviour`](crate::message::Response::Behaviour).
    InsertAtTail(#[serde(borrow)] Call<'a>),
    /// A behaviour before the head, which is interrupted and resumes afterwards. Answer as above.
    InsertAtHead(#[serde(borrow)] Call<'a>),
    /// The behaviour of this key leaves the list. Answer:
    /// [`Response::Done`](crate::message::Response::Done), as to all that follow.
    Cancel {
        /// As the list says.
        key: u16,
    },
    /// IDLE executes in the place of the behaviour of this key, until it is resumed.
    Suspend {
        /// As the list says.
        key: u16,
    },
    /// The behaviour of this key may execute again.
    Resume {
        /// As the list says.
        key: u16,
    },
    /// A step of a script, which is put away until all are there.
    Step {
        /// Which script: what is put away of another is forgotten.
        script: u32,
        /// Which step, from 0 on.
        index: u8,
        /// What it inserts.
        #[serde(borrow)]
        call: Call<'a>,
    },
    /// The script begins, in place of one before. Its steps come onto the list one after the other,
    /// behind all others.
    Run {
        /// Which script.
        script: u32,
        /// How many steps it has. Those behind them are what its situations insert.
        steps: u8,
        /// How many there are with those.
        all: u8,
    },
    /// The script ends, and its step leaves the list.
    EndScript,
    /// Its step is suspended, and none follows.
    SuspendScript,
    /// It goes on.
    ResumeScript,
    /// Where the robot is in the global frame, or how far from where it believes itself to be
    /// there, seen from there. The task `GlobalPosition` takes it; what is on the list goes on as
    /// if nothing had happened.
    Position {
        /// [`POSITION_BYTES`](crate::position::POSITION_BYTES), as
        /// [`Correction::to_bytes`](crate::position::Correction::to_bytes) makes them.
        position: &'a [u8],
    },
    /// The script that was run last is kept in flash, beside the mission that runs: the robot runs
    /// it each time that it starts with that mission. Answered when the flash has it.
    KeepScript {
        /// Which script; 0 for none any more.
        script: u32,
    },
    /// Which script is kept? Answer:
    /// [`Response::BehaviourList`](crate::message::Response::BehaviourList), with the script and
    /// without entries. Its state is [`ScriptState::Runs`] where it is kept for the mission that
    /// runs, and [`ScriptState::Ended`] where it is for another.
    KeptScript,
}

/// A behaviour, with its parameters and situations.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Call<'a> {
    /// Hash of the signature of its task type.
    pub task: u64,
    /// The bits of all parameters, in the order of the declaration, [`PARAM_BYTES`] each, little
    /// endian.
    pub params: &'a [u8],
    /// Situations, [`WATCH_BYTES`] each.
    pub watches: &'a [u8],
}

/// A situation that is watched beside a behaviour, and what happens then.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Watch {
    /// What may happen.
    pub situation: Situation,
    /// Its parameter.
    pub value: f32,
    /// What is done about it.
    pub reaction: Reaction,
}

/// What may happen while a behaviour executes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Situation {
    /// The robot is farther than so many metres from where the behaviour began.
    OutsideRange = 0,
    /// It was to move, and has not, for so many seconds.
    Stuck = 1,
    /// Nobody has known for so many seconds what is ahead of it.
    SensorLost = 2,
    /// The battery is below so many volts.
    LowBattery = 3,
    /// Something is nearer than so many metres, in any direction.
    Near = 4,
    /// A door opening on the left, at least so many metres wide, was passed.
    DoorLeft = 5,
    /// A door opening on the right, at least so many metres wide, was passed.
    DoorRight = 6,
    /// A wall ahead and one on the left are both nearer than so many metres.
    CornerLeft = 7,
    /// A wall ahead and one on the right are both nearer than so many metres.
    CornerRight = 8,
    /// The behaviour has been on the list for so many seconds, those left out in which it was
    /// suspended by hand.
    Lasts = 9,
    /// The behaviour has failed. It has no parameter, and is over when it is told.
    Failed = 10,
}

/// The least width that can be asked of a door, at most: no opening that is much wider is a door,
/// in metres.
pub const MAX_DOOR_M: f32 = 1.3;

impl Situation {
    /// All of them, by their numbers.
    pub const ALL: [Self; 11] = [
        Self::OutsideRange,
        Self::Stuck,
        Self::SensorLost,
        Self::LowBattery,
        Self::Near,
        Self::DoorLeft,
        Self::DoorRight,
        Self::CornerLeft,
        Self::CornerRight,
        Self::Lasts,
        Self::Failed,
    ];

    /// What scripts call it, and its parameter; that is empty where it has none.
    pub const fn names(self) -> (&'static str, &'static str) {
        match self {
            Self::OutsideRange => ("outside_range", "radius_m"),
            Self::Stuck => ("stuck", "after_s"),
            Self::SensorLost => ("sensor_lost", "after_s"),
            Self::LowBattery => ("low_battery", "below_v"),
            Self::Near => ("near", "range_m"),
            Self::DoorLeft => ("door_left", "least_m"),
            Self::DoorRight => ("door_right", "least_m"),
            Self::CornerLeft => ("corner_left", "range_m"),
            Self::CornerRight => ("corner_right", "range_m"),
            Self::Lasts => ("lasts", "after_s"),
            Self::Failed => ("failed", ""),
        }
    }

    /// The most that its parameter can be; the least is 0.
    pub const fn most(self) -> f32 {
        match self {
            Self::DoorLeft | Self::DoorRight => MAX_DOOR_M,
            Self::Failed => 0.0,
            _ => f32::MAX,
        }
    }

    /// Whether this can be done about it. What has failed is over: only what follows can be said.
    pub const fn takes(self, reaction: Reaction) -> bool {
        let follows = matches!(
            reaction,
            Reaction::Cancel | Reaction::EndScript | Reaction::GoOn(_) | Reaction::Replace(_)
        );
        follows || !matches!(self, Self::Failed)
    }

    /// Whether it is something that the robot drives past, or up to.
    pub const fn is_landmark(self) -> bool {
        matches!(
            self,
            Self::DoorLeft | Self::DoorRight | Self::CornerLeft | Self::CornerRight
        )
    }
}

/// What is done about a situation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reaction {
    /// IDLE executes in the behaviour's place until the situation has passed.
    Suspend,
    /// The behaviour ends. A script goes on with its next step.
    Cancel,
    /// The behaviour ends, and its script with it.
    EndScript,
    /// The flag `noticed` of the task `Behaviours` is set while it lasts.
    Flag,
    /// This step of the script is inserted before it, once for each time the situation comes up.
    Insert(u8),
    /// The behaviour ends, and the script goes on with this step, which is a later one.
    GoOn(u8),
    /// The behaviour ends, and this step, which is a later one, takes its place on the list. When
    /// that one is over, the script goes on behind the step that was replaced.
    Replace(u8),
}

/// The number of [`Reaction::Insert`] with the step 0.
const INSERT: u8 = 16;
/// The number of [`Reaction::GoOn`] with the step 0.
const GO_ON: u8 = 32;
/// The number of [`Reaction::Replace`] with the step 0.
const REPLACE: u8 = 48;

impl Reaction {
    /// What scripts call them, by their [kinds](Self::kind).
    pub const NAMES: [&str; 7] = [
        "suspend", "cancel", "end", "flag", "insert", "go_on", "replace",
    ];

    /// Its number on the link.
    pub const fn number(self) -> u8 {
        match self {
            Self::Suspend => 0,
            Self::Cancel => 1,
            Self::EndScript => 2,
            Self::Flag => 3,
            Self::Insert(step) => INSERT + step,
            Self::GoOn(step) => GO_ON + step,
            Self::Replace(step) => REPLACE + step,
        }
    }

    /// What it does, without the step of a script: its number in the flight recorder.
    pub const fn kind(self) -> u8 {
        match self {
            Self::Insert(_) => 4,
            Self::GoOn(_) => 5,
            Self::Replace(_) => 6,
            other => other.number(),
        }
    }

    /// The step of a script that it names.
    pub const fn step(self) -> Option<u8> {
        match self {
            Self::Insert(step) | Self::GoOn(step) | Self::Replace(step) => Some(step),
            Self::Suspend | Self::Cancel | Self::EndScript | Self::Flag => None,
        }
    }

    /// The reaction of this number.
    pub fn of_number(number: u8) -> Option<Self> {
        Some(match number {
            0 => Self::Suspend,
            1 => Self::Cancel,
            2 => Self::EndScript,
            3 => Self::Flag,
            _ => {
                let step = |first: u8| {
                    let step = number.checked_sub(first)?;
                    (usize::from(step) < MAX_SCRIPT_STEPS).then_some(step)
                };
                return step(INSERT)
                    .map(Self::Insert)
                    .or_else(|| step(GO_ON).map(Self::GoOn))
                    .or_else(|| step(REPLACE).map(Self::Replace));
            }
        })
    }
}

impl Watch {
    /// Its bytes in a [`Call`]: situation, reaction, bits of the value, little endian. A step that
    /// a reaction names is below [`MAX_SCRIPT_STEPS`].
    pub fn to_bytes(self) -> [u8; WATCH_BYTES] {
        let [a, b, c, d] = self.value.to_le_bytes();
        [self.situation as u8, self.reaction.number(), a, b, c, d]
    }

    /// Reads its bytes. None where they are none, or the value is negative, no number, or above
    /// [`Situation::most`], or the situation does not take the reaction.
    pub fn of_bytes([situation, reaction, value @ ..]: [u8; WATCH_BYTES]) -> Option<Self> {
        let value = f32::from_le_bytes(value);
        let situation = Situation::ALL.get(usize::from(situation)).copied()?;
        let reaction = Reaction::of_number(reaction)?;
        let is_one = (0.0..=situation.most()).contains(&value) && situation.takes(reaction);
        is_one.then_some(Self {
            situation,
            value,
            reaction,
        })
    }
}

/// What stands on the list, as [`Response::BehaviourList`](crate::message::Response::BehaviourList)
/// says it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ListEntry {
    /// Names it in requests.
    pub key: u16,
    /// The lower half of the hash of its task's signature; 0 of IDLE and REMOTE_CONTROL.
    pub task: u16,
    /// Its state in figure 2, as the book numbers them.
    pub state: u8,
    /// Who has put it there.
    pub origin: Origin,
    /// It was suspended by hand.
    pub is_held: bool,
}

/// Who has put a behaviour onto the list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Origin {
    /// A task state of the mission.
    Mission = 0,
    /// A request.
    Link = 1,
    /// The script.
    Script = 2,
    /// It is REMOTE_CONTROL.
    Remote = 3,
    /// It is IDLE.
    Idle = 4,
}

impl Origin {
    const ALL: [Self; 5] = [
        Self::Mission,
        Self::Link,
        Self::Script,
        Self::Remote,
        Self::Idle,
    ];
}

/// Bytes of a [`ListEntry`].
pub const ENTRY_BYTES: usize = 6;
const HELD: u8 = 0x80;

impl ListEntry {
    /// Its bytes: key and task, little endian, state, origin, whose top bit says that it is held.
    pub const fn to_bytes(self) -> [u8; ENTRY_BYTES] {
        let [key_low, key_high] = self.key.to_le_bytes();
        let [task_low, task_high] = self.task.to_le_bytes();
        let held = if self.is_held { HELD } else { 0 };
        let origin = self.origin as u8 | held;
        [key_low, key_high, task_low, task_high, self.state, origin]
    }

    /// Reads its bytes. None where the origin is none.
    pub fn of_bytes([a, b, c, d, state, origin]: [u8; ENTRY_BYTES]) -> Option<Self> {
        Some(Self {
            key: u16::from_le_bytes([a, b]),
            task: u16::from_le_bytes([c, d]),
            state,
            origin: Origin::ALL.get(usize::from(origin & !HELD)).copied()?,
            is_held: origin & HELD != 0,
        })
    }
}

/// How a script is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ScriptStatus {
    /// Which one; 0 where none was run.
    pub script: u32,
    /// How many steps it has.
    pub steps: u8,
    /// How many of them have ended.
    pub ended: u8,
    /// What it does.
    pub state: ScriptState,
}

/// What a script does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ScriptState {
    /// None was run.
    #[default]
    None,
    /// A step is on the list.
    Runs,
    /// It is suspended.
    Suspended,
    /// All steps have ended.
    Done,
    /// A step has failed, a situation has ended it, or it was ended by hand.
    Ended,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn situations_are_read_as_they_were_written() {
        for situation in Situation::ALL {
            for reaction in [
                Reaction::Suspend,
                Reaction::Cancel,
                Reaction::EndScript,
                Reaction::Flag,
                Reaction::Insert(0),
                Reaction::Insert(15),
                Reaction::GoOn(0),
                Reaction::GoOn(15),
                Reaction::Replace(0),
                Reaction::Replace(15),
            ] {
                let watch = Watch {
                    situation,
                    value: situation.most().min(1.25),
                    reaction,
                };
                let takes = situation.takes(reaction).then_some(watch);
                assert_eq!(Watch::of_bytes(watch.to_bytes()), takes);
            }
        }
        let good = Watch {
            situation: Situation::Near,
            value: 0.0,
            reaction: Reaction::Cancel,
        };
        let bytes = good.to_bytes();
        for (place, byte) in [
            (0, 11),
            (1, 4),
            (1, 15),
            (1, 64),
            (5, 0x7f),
            (5, 0xff),
            (5, 0xbf),
        ] {
            let mut bad = bytes;
            bad[place] = byte;
            if place == 5 {
                bad[4] = 0x80;
            }
            assert_eq!(Watch::of_bytes(bad), None, "{place}: {byte}");
        }
        // A door of 1.3 m, and of the next number.
        for (wider, is_one) in [(0, true), (1, false)] {
            let mut door = bytes;
            door[0] = Situation::DoorLeft as u8;
            door[2..].copy_from_slice(&(MAX_DOOR_M.to_bits() + wider).to_le_bytes());
            assert_eq!(Watch::of_bytes(door).is_some(), is_one);
        }
    }

    #[test]
    fn entries_are_read_as_they_were_written() {
        for origin in Origin::ALL {
            for is_held in [false, true] {
                let entry = ListEntry {
                    key: 0x1234,
                    task: 0xfedc,
                    state: 3,
                    origin,
                    is_held,
                };
                assert_eq!(ListEntry::of_bytes(entry.to_bytes()), Some(entry));
            }
        }
        assert_eq!(ListEntry::of_bytes([0, 0, 0, 0, 0, 5]), None);
    }
}
