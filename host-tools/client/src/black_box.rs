//! What a robot's black box holds, in words, with the names of the missions that are known.

use std::collections::BTreeMap;
use std::fmt;
use std::sync::Arc;

use esm_link::black_box::{Event, PoseFrame, Record};
use esm_link::message::{CoreFault, ResetReason};
use serde::Serialize;

use crate::reading::{mode_words, reset_reason};
use crate::run::mission::hash_text;
use esm_toolkit::behaviour_words::{
    TaskNames, behaviour, came_up, change, corrected, reaction, situation, state,
};
use esm_toolkit::trace::directory::Directory;

/// A record in words, in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
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
#[derive(Clone, Debug, PartialEq, Serialize)]
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
    /// A behaviour came onto the list, changed its state there, or left it.
    Behaviour {
        /// Its key on the list.
        key: u16,
        /// Its task, `IDLE` or `REMOTE_CONTROL`.
        name: String,
        /// Its state before; none where it was not on the list.
        from: Option<&'static str>,
        /// Its state since; none where it is not on the list any more.
        to: Option<&'static str>,
    },
    /// A situation came up beside a behaviour.
    Situation {
        /// The behaviour's key on the list.
        key: u16,
        /// As above.
        name: String,
        /// Which one.
        situation: &'static str,
        /// What is done about it.
        reaction: &'static str,
    },
    /// Where the robot was.
    Pose {
        /// In metres; none where the half of the record that has it was overwritten.
        x_m: Option<f64>,
        /// In metres; none as above.
        y_m: Option<f64>,
        /// In radians; none as above.
        heading_rad: Option<f64>,
        /// In the frame in which it is told where it is, not in that in which odometry counts.
        global: bool,
    },
    /// The robot was told where it is.
    Corrected {
        /// How far off it is, not where.
        by: bool,
        /// That was beyond the bounds: nothing has changed.
        refused: bool,
    },
}

const PER_M: f64 = 1_000.0;

/// Puts records into words. Those of a mission come after the record that it started. `tasks` are
/// those of the firmware, as far as they are known.
pub fn entries(
    records: &[Record],
    missions: &BTreeMap<u32, Arc<Directory>>,
    tasks: &TaskNames,
) -> Vec<Entry> {
    // What stands before the first start of a mission may be of any: it has no names.
    let mut running: Option<&Arc<Directory>> = None;
    let mut entries = Vec::new();
    for record in records {
        match record.event {
            Event::Mission { hash } => running = missions.get(&hash),
            Event::Started(_) => running = None,
            _ => {}
        }
        let mut happened = happened(record.event, running.map(Arc::as_ref), tasks);
        // A pose takes two records, of which the second one is told.
        if let Happened::Pose {
            x_m, heading_rad, ..
        } = &mut happened
        {
            let half = entries.pop_if(|entry: &mut Entry| {
                entry.sequence.wrapping_add(1) == record.sequence
                    && matches!(entry.happened, Happened::Pose { y_m: None, .. })
                    && matches!(record.event, Event::PoseY { .. })
            });
            if let Some(Entry {
                happened:
                    Happened::Pose {
                        x_m: x,
                        heading_rad: heading,
                        ..
                    },
                ..
            }) = half
            {
                (*x_m, *heading_rad) = (x, heading);
            }
        }
        entries.push(Entry {
            sequence: record.sequence,
            t_us: record.at_us,
            happened,
        });
    }
    entries
}

fn happened(event: Event, names: Option<&Directory>, tasks: &TaskNames) -> Happened {
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
        Event::Behaviour {
            key,
            task,
            from,
            to,
        } => Happened::Behaviour {
            key,
            name: behaviour(key, task, tasks),
            from: state(from),
            to: state(to),
        },
        Event::Situation {
            key,
            task,
            situation: number,
            reaction: done,
        } => Happened::Situation {
            key,
            name: behaviour(key, task, tasks),
            situation: situation(number),
            reaction: reaction(done),
        },
        Event::PoseX { x_mm, heading_mrad } => Happened::Pose {
            x_m: Some(f64::from(x_mm) / PER_M),
            y_m: None,
            heading_rad: Some(f64::from(heading_mrad) / PER_M),
            global: false,
        },
        Event::PoseY { y_mm, frame } => Happened::Pose {
            x_m: None,
            y_m: Some(f64::from(y_mm) / PER_M),
            heading_rad: None,
            global: frame == PoseFrame::Global,
        },
        Event::Corrected {
            is_difference,
            is_refused,
        } => Happened::Corrected {
            by: is_difference,
            refused: is_refused,
        },
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
                    (_, Some(CoreFault::STACK_OVERFLOW)) => {
                        write!(f, ": the stack was too deep for its memory")
                    }
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
            Happened::Behaviour {
                key,
                name,
                from,
                to,
            } => f.write_str(&change(name, *key, *from, *to)),
            Happened::Situation {
                key,
                name,
                situation,
                reaction,
            } => f.write_str(&came_up(name, *key, situation, reaction)),
            Happened::Pose {
                x_m,
                y_m,
                heading_rad,
                global,
            } => {
                let number = |value: &Option<f64>| {
                    value.map_or_else(|| "?".to_owned(), |value| format!("{value:.3}"))
                };
                let frame = if *global {
                    "in the global frame"
                } else {
                    "as odometry counts"
                };
                write!(
                    f,
                    "  at x {} m, y {} m, heading {} rad, {frame}",
                    number(x_m),
                    number(y_m),
                    number(heading_rad)
                )
            }
            Happened::Corrected { by, refused } => f.write_str(corrected(*by, *refused)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use esm_link::black_box::SAFETY_CHECK;
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
                Event::Ended {
                    reason: ResetReason::CpuFault,
                    detail: CoreFault::STACK_OVERFLOW,
                },
                "    1.500 s  the firmware ended: the processor met a fault: the stack was too deep \
                 for its memory",
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
            (
                Event::Behaviour {
                    key: 3,
                    task: 0x12ab,
                    from: None,
                    to: Some(0),
                },
                "    1.500 s  the behaviour of task 12ab (3) comes onto the list: INITIAL",
            ),
            (
                Event::Behaviour {
                    key: 0,
                    task: 0,
                    from: Some(1),
                    to: None,
                },
                "    1.500 s  IDLE (0): EXECUTE -> DESTROY",
            ),
            (
                Event::Situation {
                    key: 3,
                    task: 0,
                    situation: SAFETY_CHECK,
                    reaction: 0,
                },
                "    1.500 s  REMOTE_CONTROL (3): SAFETY_CHECK has come up -> suspend",
            ),
            (
                Event::PoseY {
                    y_mm: -1_250,
                    frame: PoseFrame::Global,
                },
                "    1.500 s    at x ? m, y -1.250 m, heading ? rad, in the global frame",
            ),
            (
                Event::Corrected {
                    is_difference: true,
                    is_refused: false,
                },
                "    1.500 s  the robot is told how far off it is",
            ),
        ];
        for (event, expected) in cases {
            let record = Record {
                sequence: 1,
                at_us: 1_500_000,
                event,
            };
            let told = entries(&[record], &BTreeMap::new(), &TaskNames::new());
            assert_eq!(told[0].to_string(), expected);
        }
    }

    #[test]
    fn both_halves_of_a_pose_are_one_entry_with_names_of_tasks() {
        let events = [
            Event::Behaviour {
                key: 1,
                task: 7,
                from: Some(1),
                to: Some(3),
            },
            Event::PoseX {
                x_mm: 1_500,
                heading_mrad: -500,
            },
            Event::PoseY {
                y_mm: -2,
                frame: PoseFrame::Counted,
            },
        ];
        let records: Vec<Record> = (0..)
            .zip(events)
            .map(|(sequence, event)| Record {
                sequence,
                at_us: 1_500_000,
                event,
            })
            .collect();
        let tasks = TaskNames::from([(7, "GoTo".to_owned())]);
        let told = entries(&records, &BTreeMap::new(), &tasks);
        let lines: Vec<String> = told.iter().map(Entry::to_string).collect();
        assert_eq!(
            lines,
            [
                "    1.500 s  GoTo (1): EXECUTE -> RESUME",
                "    1.500 s    at x 1.500 m, y -0.002 m, heading -0.500 rad, as odometry counts",
            ]
        );
    }
}
