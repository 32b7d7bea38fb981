//! What a robot tells of itself at one moment: how it is, what runs, what was counted.
//!
//! The parts of a reading are asked for one after another, so that they are a few milliseconds
//! apart. What does not change while a mission runs (its tables and names) is read once.

use esm_core::{Refusal, Verified};
use esm_link::message::{LinkError, Mode, ResetReason, Status, TaskCounters};
use serde::Serialize;
use thiserror::Error;

use crate::counted_links::CountedLinks;
use crate::link_client::{ClientError, LinkClient, LinkCounts};
use crate::serial::ByteLink;
use esm_toolkit::counters::{LinkReport, SlotReport};
use esm_toolkit::inspect;
use esm_toolkit::inspect::refusal::Explained;
use esm_toolkit::story;
use esm_toolkit::trace::directory::Directory;

/// Why there is no reading.
#[derive(Debug, Error)]
pub enum ReadError {
    /// The robot did not answer, or refused to.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The mission that it says it runs is none.
    #[error("the robot's mission is no valid blob: {}", Explained(*.0))]
    Blob(Refusal),
}

impl ReadError {
    /// Whether the robot lost or changed its mission between two questions, so that the next
    /// reading is of another one.
    fn is_other_mission(&self) -> bool {
        let ReadError::Client(error) = self else {
            return false;
        };
        matches!(
            error.refusal(),
            Some(LinkError::NoMission | LinkError::NoSuchIndex)
        )
    }
}

/// How often a reading begins again because the robot changed its mission meanwhile.
const ATTEMPTS: u32 = 3;

/// What does not change while a mission runs.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Known {
    /// Its hash.
    mission: u32,
    /// Name of the machine.
    machine: String,
    slots: Vec<SlotPlan>,
    tasks: Vec<TaskPlan>,
    links: CountedLinks,
}

/// When a slot runs, in microseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SlotPlan {
    /// Its number in the source.
    pub number: u32,
    /// Its period.
    pub period_us: u32,
    /// Its duration.
    pub duration_us: u32,
    /// Its first start.
    pub start_us: u32,
}

/// A task state and where it runs.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TaskPlan {
    /// Path of the state.
    pub path: String,
    /// Name of the task.
    pub task: String,
    /// Index of the slot among the mission's; `None` in slot 0.
    pub slot: Option<usize>,
}

/// A slot at the moment of a reading.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SlotReading {
    /// When it runs.
    pub plan: SlotPlan,
    /// What was counted.
    pub counted: SlotReport,
    /// When it was counted, in microseconds since the mission started: all slots of a large mission
    /// take a second to be asked for.
    pub t_us: u64,
}

/// A task state at the moment of a reading.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct TaskReading {
    /// Where it runs.
    pub plan: TaskPlan,
    /// How it is, if it was asked for.
    pub counted: Option<TaskCounters>,
}

/// What the host saw of the line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct LineReport {
    /// Requests that had to be sent again.
    pub requests_sent_again: u64,
    /// Frames from the robot that were corrupt.
    pub frames_spoiled: u64,
    /// Bytes sent to the robot.
    pub bytes_sent: u64,
}

impl From<LinkCounts> for LineReport {
    fn from(counts: LinkCounts) -> Self {
        LineReport {
            requests_sent_again: counts.retries,
            frames_spoiled: counts.bad_frames,
            bytes_sent: counts.bytes_sent,
        }
    }
}

/// What a robot tells of itself at one moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// How it is.
    pub status: Status,
    /// Robot time: microseconds since the robot started, by its own clock.
    pub robot_us: u64,
    /// Name of the machine that it runs, made up where the mission has no names.
    pub machine: Option<String>,
    /// Paths of the current local states, depth first; by numbers where the mission has no names.
    pub active: Vec<String>,
    /// Whether the mission runs and all its final states are reached, so that nothing happens any
    /// more.
    pub finished: bool,
    /// The slots of the mission.
    pub slots: Vec<SlotReading>,
    /// The task states of the mission, in the order in which they run.
    pub tasks: Vec<TaskReading>,
    /// The links of the mission.
    pub links: Vec<LinkReport>,
    /// What the host saw of the line since the session began.
    pub line: LineReport,
}

impl Reading {
    /// A reading of a robot that has no mission.
    pub fn without_mission(status: Status, robot_us: u64) -> Self {
        Reading {
            status,
            robot_us,
            machine: None,
            active: Vec::new(),
            finished: false,
            slots: Vec::new(),
            tasks: Vec::new(),
            links: Vec::new(),
            line: LineReport::default(),
        }
    }
}

/// Which task states are asked for how they are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tasks {
    /// None.
    None,
    /// All.
    All,
    /// Those of the slot with this index: an answer takes a slot's activation, so that all of a
    /// large mission take seconds.
    OfSlot(usize),
}

/// Reads a robot again and again.
#[derive(Default)]
pub struct Reader {
    known: Option<Known>,
    directory: Option<Directory>,
}

impl Reader {
    /// Asks the robot for everything, and for those tasks.
    ///
    /// # Errors
    /// [`ReadError`]
    pub fn read<L: ByteLink>(
        &mut self,
        robot: &mut LinkClient<L>,
        tasks: Tasks,
    ) -> Result<Reading, ReadError> {
        let mut attempt = 1;
        loop {
            match self.read_once(robot, tasks) {
                Ok(None) if attempt < ATTEMPTS => {}
                Err(error) if error.is_other_mission() && attempt < ATTEMPTS => {}
                Ok(Some(reading)) => return Ok(reading),
                // A robot that changes its mission faster than it answers has none to tell of.
                Ok(None) => {
                    let status = robot.status()?;
                    return Ok(Reading::without_mission(status, robot.robot_us()?));
                }
                Err(error) => return Err(error),
            }
            attempt += 1;
        }
    }

    /// Whether the mission of this hash, which runs, has reached all its final states. False where
    /// another one runs
    /// by now.
    ///
    /// # Errors
    /// [`ReadError`]
    pub fn has_finished<L: ByteLink>(
        &mut self,
        robot: &mut LinkClient<L>,
        mission: u32,
    ) -> Result<bool, ReadError> {
        match self.ask_whether_finished(robot, mission) {
            Err(error) if error.is_other_mission() => Ok(false),
            asked => asked,
        }
    }

    fn ask_whether_finished<L: ByteLink>(
        &mut self,
        robot: &mut LinkClient<L>,
        mission: u32,
    ) -> Result<bool, ReadError> {
        let known = self.know(robot, mission)?;
        let (Some(directory), true) = (&self.directory, known.mission == mission) else {
            return Ok(false);
        };
        let current = robot.current_states()?.states;
        let current = |region: usize| current.get(region).copied().map_or(0, usize::from);
        Ok(directory.has_finished(current))
    }

    /// Name of the machine of the mission of this hash, which runs; none where another one runs by
    /// now. Made up where the mission has no names.
    ///
    /// # Errors
    /// [`ReadError`]
    pub fn machine<L: ByteLink>(
        &mut self,
        robot: &mut LinkClient<L>,
        mission: u32,
    ) -> Result<Option<String>, ReadError> {
        let known = self.know(robot, mission)?;
        Ok((known.mission == mission).then_some(known.machine))
    }

    /// A reading, or none where the mission changed meanwhile.
    fn read_once<L: ByteLink>(
        &mut self,
        robot: &mut LinkClient<L>,
        tasks: Tasks,
    ) -> Result<Option<Reading>, ReadError> {
        let before = robot.status()?;
        let clock = robot.clock().clone();
        let began = clock.now();
        let mut reading = Reading::without_mission(before, robot.robot_us()?);
        if let Some(mission) = before.mission {
            let known = self.know(robot, mission)?;
            let mut asked = Vec::new();
            reading.machine = Some(known.machine.clone());
            for (index, &plan) in (0..=u8::MAX).zip(&known.slots) {
                let counted = SlotReport::from(robot.slot_counters(index)?);
                asked.push(clock.since(began));
                reading.slots.push(SlotReading {
                    plan,
                    counted,
                    t_us: before.t_us,
                });
            }
            for (index, plan) in (0..=u16::MAX).zip(&known.tasks) {
                let is_wanted = match tasks {
                    Tasks::None => false,
                    Tasks::All => true,
                    Tasks::OfSlot(slot) => plan.slot == Some(slot),
                };
                let counted = match is_wanted {
                    true => Some(robot.task_counters(index)?),
                    false => None,
                };
                reading.tasks.push(TaskReading {
                    plan: plan.clone(),
                    counted,
                });
            }
            reading.links = known.links.ask(robot)?;
            if let Some(directory) = &self.directory {
                let current = robot.current_states()?.states;
                let current = |region: usize| current.get(region).copied().map_or(0, usize::from);
                reading.active = directory
                    .active(current)
                    .filter_map(|state| Some(directory.state(state)?.path.clone()))
                    .collect();
                reading.finished = directory.has_finished(current);
            }
            reading.status = robot.status()?;
            reading.finished &= reading.status.mode == Mode::Running;
            if known.mission != mission || reading.status.mission != before.mission {
                return Ok(None);
            }
            let passed = clock.since(began).as_secs_f64();
            for (slot, asked) in reading.slots.iter_mut().zip(asked) {
                let share = asked.as_secs_f64() / passed;
                slot.t_us = time_between(before.t_us, reading.status.t_us, share);
            }
        }
        reading.line = robot.counts().into();
        Ok(Some(reading))
    }

    /// Reads the mission, unless it is the one that was read before.
    fn know<L: ByteLink>(
        &mut self,
        robot: &mut LinkClient<L>,
        mission: u32,
    ) -> Result<Known, ReadError> {
        if let Some(known) = self.known.as_ref().filter(|known| known.mission == mission) {
            return Ok(known.clone());
        }
        let blob = robot.running_blob()?;
        let verified = esm_core::verify(blob).map_err(|(_, refusal)| ReadError::Blob(refusal))?;
        // A firmware compares texts with those of its own tasks; here there are none to compare
        // with.
        esm_core::texts::check(&verified.tables()).map_err(ReadError::Blob)?;
        let known = Known::of(&verified);
        // A mission runs as well without names, and where its paths are too long there only is less
        // to say about it.
        self.directory = Directory::named_or_numbered(&verified.tables()).ok();
        self.known = Some(known.clone());
        Ok(known)
    }
}

/// Robot time when so much of the time between two answers had passed: it goes as the clock on the
/// wall does, or stands still. A robot may say any numbers.
fn time_between(before_us: u64, now_us: u64, share: f64) -> u64 {
    let passed_us = now_us.saturating_sub(before_us);
    let part_us = (passed_us as f64 * share) as u64;
    before_us.saturating_add(part_us.min(passed_us))
}

impl Known {
    fn of(verified: &Verified<Vec<u8>>) -> Self {
        let tables = verified.tables();
        let report = inspect::Report::of(verified);
        Known {
            mission: verified.hash(),
            machine: report.machine,
            links: CountedLinks::of(report.links, &tables),
            slots: tables
                .slots()
                .map(|slot| SlotPlan {
                    number: slot.number,
                    period_us: slot.period_us,
                    duration_us: slot.duration_us,
                    start_us: slot.start_us,
                })
                .collect(),
            tasks: report
                .task_states
                .into_iter()
                .enumerate()
                .map(|(instance, row)| TaskPlan {
                    path: row.path,
                    task: row.task,
                    slot: tables.task_state_of(instance).and_then(|state| state.slot),
                })
                .collect(),
        }
    }
}

/// The mode in a word, and why the robot is in its safe state, if it is.
pub fn mode_words(mode: Mode) -> (&'static str, Option<&'static str>) {
    match mode {
        Mode::Empty => ("empty", None),
        Mode::Running => ("running", None),
        Mode::Stopped => ("stopped", None),
        Mode::EmergencyStopped => ("emergency stop", None),
        Mode::Safe(reason) => ("safe", Some(story::safe_reason(reason))),
    }
}

/// Why a robot started the last time, in words.
pub fn reset_reason(reason: ResetReason) -> &'static str {
    match reason {
        ResetReason::PowerOn => "power on",
        ResetReason::Pin => "reset pin",
        ResetReason::Watchdog => "watchdog",
        ResetReason::Panic => "the firmware panicked",
        ResetReason::CpuFault => "the processor met a fault",
        ResetReason::BrownOut => "the supply voltage fell",
        ResetReason::Software => "the firmware asked for it",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_between_two_answers_is_between_them_whatever_they_are() {
        assert_eq!(time_between(1_000, 2_000, 0.25), 1_250);
        let times = [0, 1, 1 << 53, u64::MAX / 2, u64::MAX - 1, u64::MAX];
        for (before_us, now_us) in times
            .iter()
            .flat_map(|before| times.map(|now| (*before, now)))
        {
            for share in [0.0, 0.1, 0.5, 1.0, 1.5, f64::NAN, f64::INFINITY] {
                let time_us = time_between(before_us, now_us, share);
                let bounds = before_us..=now_us.max(before_us);
                assert!(
                    bounds.contains(&time_us),
                    "{before_us}, {now_us}, {share}: {time_us}"
                );
            }
        }
    }
}
