//! What a robot's slots do, told once: a table for a person, an object for a program.

use std::fmt;

use serde::Serialize;

use super::view::{Load, SlotRow, rate_hz};
use crate::cli::status::{FINISHED, StatusReport};
use crate::counters::{LinkReport, Ns, SlotReport};
use crate::link_client::RobotInfo;
use crate::reading::{LineReport, Reading, TaskReading};

/// All that `esm top` knows of a robot, counted since its mission started. The keys of its JSON
/// stay; times are in nanoseconds.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TopReport {
    /// Name of the board.
    pub board: String,
    /// Name and version of the firmware.
    pub firmware: String,
    /// `empty`, `running`, `stopped`, `safe` or `emergency stop`.
    pub mode: &'static str,
    /// Whether the mission runs and all its final states are reached, so that nothing happens any
    /// more.
    pub finished: bool,
    /// Why it is in its safe state, if it is.
    pub safe_reason: Option<&'static str>,
    /// Whether the button of the emergency stop is pressed; looked at while a stop is latched.
    pub stop_pressed: bool,
    /// Hash of its mission, if it has one.
    pub mission: Option<String>,
    /// Name of its mission's machine.
    pub machine: Option<String>,
    /// Current local states, depth first.
    pub active: Vec<String>,
    /// Macro steps since the mission started.
    pub steps: u64,
    /// Mission time: since the mission started.
    pub t_ns: u64,
    /// Robot time: since the robot started.
    pub robot_ns: u64,
    /// Activations of all slots executed since the mission started.
    pub slots_executed: u32,
    /// Activations of all slots missed since the robot started.
    pub slots_missed: u32,
    /// Overruns of all slots since the robot started.
    pub overruns: u32,
    /// Longest start delay of all slots since the mission started.
    pub longest_dispatch_delay_ns: u32,
    /// Trace records dropped since the robot started.
    pub trace_dropped: u32,
    /// Whether a background task is under way.
    pub slot_0_busy: bool,
    /// The most bytes of stack in use since the robot started, where its board measures it.
    pub deepest_stack_bytes: Option<u32>,
    /// Why the robot started the last time.
    pub last_reset: &'static str,
    /// Share of the time that executions in real-time slots took since the mission started.
    pub real_time_load: Option<f64>,
    /// Share of the time that the durations of all slots add up to.
    pub real_time_reserved: f64,
    /// Share of the time that was left for slot 0.
    pub left_for_slot_0: Option<f64>,
    /// What the host saw of the line.
    pub line: LineReport,
    /// The slots.
    pub slots: Vec<TopSlot>,
    /// The tasks of slot 0.
    pub slot_0_tasks: Vec<TopTask>,
    /// The links.
    pub links: Vec<LinkReport>,
}

/// A slot.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct TopSlot {
    /// What was counted.
    #[serde(flatten)]
    pub counted: SlotReport,
    /// Its period.
    pub period_ns: u64,
    /// Its duration.
    pub duration_ns: u64,
    /// Its first start.
    pub start_ns: u64,
    /// Executions a second since the mission started.
    pub rate_hz: Option<f64>,
    /// Mean execution as a share of the duration.
    pub mean_share: f64,
    /// Longest execution as a share of the duration.
    pub longest_share: f64,
    /// Its task states, in the order in which they run.
    pub tasks: Vec<TopTask>,
}

/// A task state.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TopTask {
    /// Its path.
    pub path: String,
    /// Name of the task.
    pub task: String,
    /// Whether its task is enabled.
    pub enabled: bool,
    /// Whether it is enabled but cannot be executed.
    pub busy: bool,
    /// Executions that took longer than the slot's duration; stays at 65,535 once it is there.
    pub overruns: u16,
}

const NS_PER_US: u64 = 1_000;

impl TopReport {
    /// What a robot that says this of itself has told.
    pub fn new(info: RobotInfo, reading: Reading) -> Self {
        let load = Load::between(None, &reading);
        let slots = reading
            .slots
            .iter()
            .enumerate()
            .map(|(index, slot)| {
                let row = SlotRow {
                    plan: slot.plan,
                    counted: slot.counted.clone(),
                    rate_hz: rate_hz(None, &reading, index),
                };
                let ns = |us: u32| u64::from(us) * NS_PER_US;
                TopSlot {
                    period_ns: ns(row.plan.period_us),
                    duration_ns: ns(row.plan.duration_us),
                    start_ns: ns(row.plan.start_us),
                    rate_hz: row.rate_hz,
                    mean_share: row.mean_share(),
                    longest_share: row.longest_share(),
                    tasks: tasks_of(&reading, Some(index)),
                    counted: row.counted,
                }
            })
            .collect();
        let slot_0_tasks = tasks_of(&reading, None);
        let line = reading.line;
        let slot_0_busy = reading.status.background_busy;
        let status = StatusReport::new(info, reading);
        TopReport {
            board: status.board,
            firmware: status.firmware,
            mode: status.mode,
            finished: status.finished,
            safe_reason: status.safe_reason,
            stop_pressed: status.stop_pressed,
            mission: status.mission,
            machine: status.machine,
            active: status.active,
            steps: status.steps,
            t_ns: status.t_us.saturating_mul(NS_PER_US),
            robot_ns: status.robot_us.saturating_mul(NS_PER_US),
            slots_executed: status.slots_executed,
            slots_missed: status.slots_missed,
            overruns: status.overruns,
            longest_dispatch_delay_ns: status.longest_dispatch_delay_ns,
            trace_dropped: status.trace_dropped,
            slot_0_busy,
            deepest_stack_bytes: status.deepest_stack_bytes,
            last_reset: status.last_reset,
            real_time_load: load.used,
            real_time_reserved: load.reserved,
            left_for_slot_0: load.left(),
            line,
            slots,
            slot_0_tasks,
            links: status.links,
        }
    }
}

/// The task states of the slot with this index, as far as they were asked for.
fn tasks_of(reading: &Reading, slot: Option<usize>) -> Vec<TopTask> {
    let tasks = reading.tasks.iter().filter(|task| task.plan.slot == slot);
    tasks
        .filter_map(|TaskReading { plan, counted }| {
            let counted = (*counted)?;
            Some(TopTask {
                path: plan.path.clone(),
                task: plan.task.clone(),
                enabled: counted.enabled,
                busy: counted.busy,
                overruns: counted.overruns,
            })
        })
        .collect()
}

/// A table, with a line of start delays and a line for each task below each slot.
impl fmt::Display for TopReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{} on {}", self.firmware, self.board)?;
        let robot_s = self.robot_ns as f64 / 1e9;
        writeln!(f, "robot time {robot_s:.1} s")?;
        match self.safe_reason {
            Some(reason) => writeln!(f, "safe, motors off: {reason}")?,
            None if self.stop_pressed => writeln!(f, "{}, its button is pressed", self.mode)?,
            None if self.mode == "emergency stop" => writeln!(f, "{}, latched", self.mode)?,
            None if self.mission.is_none() => {
                writeln!(f, "no mission: `esm upload FILE --port P` gives it one")?;
            }
            None if self.finished => writeln!(f, "{FINISHED}")?,
            None => writeln!(f, "{}", self.mode)?,
        }
        if let (Some(machine), Some(mission)) = (&self.machine, &self.mission) {
            let seconds = self.t_ns as f64 / 1e9;
            writeln!(
                f,
                "mission {machine} ({mission}), mission time {seconds:.1} s, {} macro steps",
                self.steps
            )?;
        }
        if !self.active.is_empty() {
            writeln!(f, "states  {}", self.active.join(", "))?;
        }
        if !self.slots.is_empty() {
            writeln!(
                f,
                "slots   take {} of the time, {} at most; {} is left for slot 0",
                percent(self.real_time_load),
                percent(Some(self.real_time_reserved)),
                percent(self.left_for_slot_0)
            )?;
        }
        writeln!(
            f,
            "link    {} requests sent again, {} frames spoiled",
            self.line.requests_sent_again, self.line.frames_spoiled
        )?;
        if self.slots.is_empty() {
            return Ok(());
        }
        writeln!(f)?;
        writeln!(
            f,
            "{:>5} {:>9} {:>9} {:>10} {:>8} {:>8} {:>7} {:>9} {:>9} {:>9} {:>6} {:>6} {:>9} {:>9}",
            "slot",
            "period",
            "duration",
            "executed",
            "rate",
            "overruns",
            "missed",
            "shortest",
            "mean",
            "longest",
            "mean%",
            "most%",
            "soonest",
            "latest"
        )?;
        for slot in &self.slots {
            let counted = &slot.counted;
            writeln!(
                f,
                "{:>5} {:>9} {:>9} {:>10} {:>8} {:>8} {:>7} {:>9} {:>9} {:>9} {:>6} {:>6} {:>9} {:>9}",
                counted.slot,
                Ns(slot.period_ns),
                Ns(slot.duration_ns),
                counted.executed,
                hertz(slot.rate_hz),
                counted.overruns,
                counted.missed,
                Ns(counted.shortest_execution_ns.into()),
                Ns(counted.mean_execution_ns),
                Ns(counted.longest_execution_ns.into()),
                percent(Some(slot.mean_share)),
                percent(Some(slot.longest_share)),
                Ns(counted.shortest_delay_ns.into()),
                Ns(counted.longest_delay_ns.into())
            )?;
        }
        for slot in &self.slots {
            writeln!(f)?;
            writeln!(f, "slot {}", slot.counted.slot)?;
            if slot.counted.executed > 0 {
                writeln!(f, "  start delays {}", slot.counted.delays_in_words())?;
            }
            for task in &slot.tasks {
                writeln!(f, "  {task}")?;
            }
        }
        if !self.slot_0_tasks.is_empty() {
            writeln!(f)?;
            writeln!(f, "slot 0")?;
            for task in &self.slot_0_tasks {
                writeln!(f, "  {task}")?;
            }
        }
        for link in &self.links {
            writeln!(f)?;
            for (title, counted) in link.rows() {
                writeln!(f, "{title}: {counted}")?;
            }
        }
        Ok(())
    }
}

impl fmt::Display for TopTask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mode = match (self.enabled, self.busy) {
            (_, true) => "busy",
            (true, false) => "enabled",
            (false, false) => "off",
        };
        write!(
            f,
            "{} ({}): {mode}, {} overruns",
            self.path, self.task, self.overruns
        )
    }
}

/// A share as a person reads it.
pub(super) fn percent(share: Option<f64>) -> String {
    match share {
        Some(share) if share < 0.9995 => format!("{:.1}%", share * 100.0),
        Some(share) => format!("{:.0}%", share * 100.0),
        None => "-".to_owned(),
    }
}

/// A rate as a person reads it.
pub(super) fn hertz(rate_hz: Option<f64>) -> String {
    match rate_hz {
        Some(rate) if rate < 9.95 => format!("{rate:.2}/s"),
        Some(rate) => format!("{rate:.0}/s"),
        None => "-".to_owned(),
    }
}
