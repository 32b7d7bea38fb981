//! What a robot's black box holds, in words, with the names of the missions that are known.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use esm_link::black_box::{Event, Record};
use esm_link::message::ResetReason;
use serde::Serialize;

use crate::reading::{mode_words, reset_reason};
use crate::run::mission::hash_text;
use esm_toolkit::trace::directory::Directory;

/// A record in words, in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Entry {
    /// Counts all records of the robot.
    pub sequence: u32,
    /// Robot time in microseconds: since the first macro step of the first mission after the start.
    pub t_us: u64,
    /// What happened.
    #[serde(flatten)]
    pub happened: Happened,
}

/// What happened.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
#[serde(tag = "what", rename_all = "snake_case")]
pub enum Happened {
    /// The firmware started.
    Started {
        /// Why.
        reason: &'static str,
    },
    /// The firmware ended by itself.
    Ended {
        /// Why.
        reason: &'static str,
        /// The line of a panic.
        line: Option<u32>,
        /// The instruction of a fault.
        pc: Option<u32>,
    },
    /// A mission started.
    Mission {
        /// Its hash.
        mission: String,
    },
    /// A transition was taken.
    Transition {
        /// The state that was left, if the mission is known.
        from: Option<String>,
        /// The state that was entered, if the mission is known.
        to: Option<String>,
        /// Index of the region instance.
        region: u16,
        /// Index of the transition.
        transition: u16,
    },
    /// The robot stopped, or went to its safe state.
    Mode {
        /// `stopped` or `safe`.
        mode: &'static str,
        /// Why, if it went to its safe state.
        reason: Option<&'static str>,
    },
    /// A task took longer than its slot.
    Overrun {
        /// The task's state, if the mission is known.
        state: Option<String>,
        /// Index of the task instance.
        task: u16,
        /// How long it took, in microseconds.
        took_us: u16,
    },
    /// Activations of a slot were missed.
    #[serde(rename = "missed")]
    DeadlineMiss {
        /// Index of the slot in the mission.
        slot: u8,
        /// How many.
        count: u32,
    },
}

/// Puts records into words. Those of a mission come after the record that it started.
pub fn entries(records: &[Record], missions: &BTreeMap<u32, Arc<Directory>>) -> Vec<Entry> {
    // What stands before the first start of a mission may be of any: it has no names.
    let mut running: Option<&Arc<Directory>> = None;
    let mut entries = Vec::new();
    for record in records {
        match record.event {
            Event::Mission { hash } => running = missions.get(&hash),
            Event::Started(_) => running = None,
            _ => {}
        }
        entries.push(Entry {
            sequence: record.sequence,
            t_us: record.at_us,
            happened: happened(record.event, running.map(Arc::as_ref)),
        });
    }
    entries
}

fn happened(event: Event, names: Option<&Directory>) -> Happened {
    match event {
        Event::Started(reason) => Happened::Started {
            reason: reset_reason(reason),
        },
        Event::Ended { reason, detail } => Happened::Ended {
            reason: reset_reason(reason),
            line: (reason == ResetReason::Panic).then_some(detail),
            pc: (reason == ResetReason::CpuFault).then_some(detail),
        },
        Event::Mission { hash } => Happened::Mission {
            mission: hash_text(hash),
        },
        Event::Transition {
            region_instance,
            transition,
        } => {
            let words = names
                .and_then(|names| names.transition(region_instance.into(), transition.into()))
                .map(|words| (words.from.to_owned(), words.to.to_owned()));
            let (from, to) = words.unzip();
            Happened::Transition {
                from,
                to,
                region: region_instance,
                transition,
            }
        }
        Event::Mode(mode) => {
            let (mode, reason) = mode_words(mode);
            Happened::Mode { mode, reason }
        }
        Event::Overrun {
            task_instance,
            took_us,
        } => Happened::Overrun {
            state: names.and_then(|names| task_state(names, task_instance)),
            task: task_instance,
            took_us,
        },
        Event::DeadlineMiss { slot, count } => Happened::DeadlineMiss { slot, count },
    }
}

/// The path of a task instance's state.
fn task_state(names: &Directory, task_instance: u16) -> Option<String> {
    let state = names.task_states().get(usize::from(task_instance))?;
    Some(names.state(*state)?.path.clone())
}

impl fmt::Display for Entry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Happened::Started { reason } = self.happened {
            return write!(f, "--- the robot started: {reason}");
        }
        write!(f, "{:>9.3} s  ", self.t_us as f64 / 1e6)?;
        match &self.happened {
            Happened::Started { .. } => Ok(()),
            Happened::Ended { reason, line, pc } => {
                write!(f, "the firmware ended: {reason}")?;
                match (line, pc) {
                    (Some(line), _) => write!(f, ", in line {line}"),
                    (_, Some(pc)) => write!(f, ", at {pc:#010x}"),
                    _ => Ok(()),
                }
            }
            Happened::Mission { mission } => write!(f, "mission {mission} starts"),
            Happened::Transition {
                from: Some(from),
                to: Some(to),
                ..
            } => write!(f, "{from} -> {to}"),
            Happened::Transition {
                region, transition, ..
            } => write!(f, "transition {transition} of region {region}"),
            Happened::Mode {
                reason: Some(reason),
                ..
            } => write!(f, "safe, motors off: {reason}"),
            Happened::Mode { mode, .. } => write!(f, "{mode}: motors off"),
            Happened::Overrun {
                state,
                task,
                took_us,
            } => {
                match state {
                    Some(state) => write!(f, "{state}")?,
                    None => write!(f, "task {task}")?,
                }
                let more = if *took_us == u16::MAX { " or more" } else { "" };
                write!(f, " took {took_us} us{more}, longer than its slot")
            }
            Happened::DeadlineMiss { slot, count } => {
                write!(
                    f,
                    "{count} occurrences of the slot at place {slot} were missed"
                )
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esm_link::message::{Mode, SafeReason};

    #[test]
    fn records_without_names_are_told_by_their_numbers() {
        let cases = [
            (
                Event::Started(ResetReason::BrownOut),
                "--- the robot started: the supply voltage fell",
            ),
            (
                Event::Ended {
                    reason: ResetReason::Panic,
                    detail: 12,
                },
                "    1.500 s  the firmware ended: the firmware panicked, in line 12",
            ),
            (
                Event::Ended {
                    reason: ResetReason::CpuFault,
                    detail: 0x1234,
                },
                "    1.500 s  the firmware ended: the processor met a fault, at 0x00001234",
            ),
            (
                Event::Mission { hash: 0xAB },
                "    1.500 s  mission 000000ab starts",
            ),
            (
                Event::Transition {
                    region_instance: 3,
                    transition: 7,
                },
                "    1.500 s  transition 7 of region 3",
            ),
            (
                Event::Mode(Mode::Stopped),
                "    1.500 s  stopped: motors off",
            ),
            (
                Event::Mode(Mode::Safe(SafeReason::LinkLost)),
                "    1.500 s  safe, motors off: the host has not called for too long",
            ),
            (
                Event::Overrun {
                    task_instance: 4,
                    took_us: u16::MAX,
                },
                "    1.500 s  task 4 took 65535 us or more, longer than its slot",
            ),
            (
                Event::DeadlineMiss { slot: 1, count: 9 },
                "    1.500 s  9 occurrences of the slot at place 1 were missed",
            ),
        ];
        for (event, expected) in cases {
            let record = Record {
                sequence: 1,
                at_us: 1_500_000,
                event,
            };
            let told = entries(&[record], &BTreeMap::new());
            assert_eq!(told[0].to_string(), expected);
        }
    }
}
