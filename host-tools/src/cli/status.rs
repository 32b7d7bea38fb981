//! `esm status`: how a robot is.

use std::fmt;

use clap::Args;
use esm_link::features::Feature;
use esm_link::message::{
    BankState, CoreFault, CrashReport, FlashHealth, KeyValuesState, ResetReason, Silent, Source,
    StoreStatus, WayIn,
};
use esm_link::trial::{FallBack, Trial};
use serde::Serialize;

use super::console::Console;
use super::exit::CommandError;
use super::robot::RobotArgs;
use crate::counters::{LinkReport, SlotReport};
use crate::link_client::RobotInfo;
pub use crate::reading::mode_words;
use crate::reading::{Reader, Reading, Tasks, reset_reason};
use crate::run::mission::hash_text;
use crate::run::story;

/// Shows what a robot runs, since when, its counters and faults, and why it was last reset
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  esm status --port /dev/ttyUSB0
  esm status --port /dev/ttyUSB0 --json | jq .active")]
pub struct StatusArgs {
    #[command(flatten)]
    #[allow(missing_docs, reason = "carries the documentation of its arguments")]
    pub robot: RobotArgs,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// How a robot is, in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StatusReport {
    /// Name of the board.
    pub board: String,
    /// Name and version of the firmware.
    pub firmware: String,
    /// Features that it was built without.
    pub built_without: Vec<&'static str>,
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
    /// If it runs on trial.
    pub trial: Option<TrialReport>,
    /// The last mission that was given up on trial since the robot started.
    pub fell_back: Option<FallBackReport>,
    /// What its flash has; none of a robot that keeps no missions.
    pub kept: Option<StoreReport>,
    /// How its flash is; none of a robot that keeps nothing.
    pub flash: Option<FlashReport>,
    /// Parameters whose values differ from the mission's.
    pub changed_params: u8,
    /// Values of parameters that were saved for the mission.
    pub saved_params: u8,
    /// Current local states, depth first.
    pub active: Vec<String>,
    /// Macro steps since the mission started.
    pub steps: u64,
    /// Mission time: since the mission started, in microseconds.
    pub t_us: u64,
    /// Robot time: since the robot started, in microseconds.
    pub robot_us: u64,
    /// Slot activations executed since the mission started.
    pub slots_executed: u32,
    /// Slot activations missed since the robot started.
    pub slots_missed: u32,
    /// Executions that took too long since the robot started.
    pub overruns: u32,
    /// Longest dispatch delay since the mission started, in nanoseconds.
    pub longest_dispatch_delay_ns: u32,
    /// Trace records dropped since the robot started.
    pub trace_dropped: u32,
    /// The most bytes of stack in use since the robot started, where its board measures it.
    pub deepest_stack_bytes: Option<u32>,
    /// Why the robot started the last time.
    pub last_reset: &'static str,
    /// How its run before this one ended.
    #[serde(rename = "last_words")]
    pub crash_report: CrashReportJson,
    /// Counters of each slot.
    pub slots: Vec<SlotReport>,
    /// Counters of each link.
    pub links: Vec<LinkReport>,
}

/// How a robot's run of the firmware ended, in the form of its JSON. What is not known is `null`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct CrashReportJson {
    /// Robot time at its end, in microseconds.
    pub after_us: Option<u64>,
    /// Index, in its mission, of the task instance that was being executed.
    pub task: Option<u16>,
    /// File and line of the panic: the file's path, or the end of it.
    pub panic: Option<String>,
    /// What the processor said of its fault.
    pub fault: Option<FaultReport>,
    /// Who showed no heartbeat, so that the watchdog ran out.
    pub silent: Option<String>,
    /// Starts after a defect in a row, this one included, none of which was healthy for long.
    pub bad_starts: u32,
}

/// A fault of a processor, with its registers in hexadecimal.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FaultReport {
    /// Whether the stack was too deep for its memory: then the place is not known.
    pub stack_overflow: bool,
    /// The instruction that faulted.
    pub pc: String,
    /// Where its function was called from.
    pub lr: String,
    /// Configurable fault status.
    pub cfsr: String,
    /// Hard fault status.
    pub hfsr: String,
    /// The address of a bad access, if it is known.
    pub address: Option<String>,
}

impl CrashReportJson {
    /// What these words say; `file` is the end of the path of the file that panicked.
    pub fn new(words: CrashReport, file: String) -> Self {
        let hex = |register: u32| format!("{register:#010x}");
        let CrashReport {
            reason,
            after_us,
            task,
            line,
            fault,
            silent,
            bad_starts,
        } = words;
        CrashReportJson {
            after_us: (after_us > 0).then_some(after_us),
            task,
            panic: (reason == ResetReason::Panic).then(|| format!("{file}:{line}")),
            fault: (reason == ResetReason::CpuFault).then(|| FaultReport {
                stack_overflow: fault.pc == CoreFault::STACK_OVERFLOW,
                pc: hex(fault.pc),
                lr: hex(fault.lr),
                cfsr: hex(fault.status),
                hfsr: hex(fault.hard_status),
                address: (fault.address != 0).then(|| hex(fault.address)),
            }),
            silent: silent.map(|who| match who {
                Silent::Slot(slot) => {
                    format!("the slot at place {slot} was executed no more")
                }
                Silent::Link => "the link got no turn".to_owned(),
                Silent::Background => "a slot-0 task did not return, or had no time left".to_owned(),
                Silent::BackgroundForLink => {
                    "what came over its line left slot-0 tasks no time; that is not counted against the mission"
                        .to_owned()
                }
            }),
            bad_starts,
        }
    }
}

impl fmt::Display for CrashReportJson {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if let Some(panic) = &self.panic {
            write!(f, ", at {panic}")?;
        }
        if let Some(silent) = &self.silent {
            write!(f, ": {silent}")?;
        }
        if let Some(task) = self.task {
            write!(f, ", in task number {task} of its mission")?;
        }
        if let Some(after_us) = self.after_us {
            write!(f, ", after {:.1} s", after_us as f64 / 1e6)?;
        }
        if let Some(fault) = &self.fault {
            let FaultReport {
                pc, lr, cfsr, hfsr, ..
            } = fault;
            if fault.stack_overflow {
                write!(
                    f,
                    ": the stack was too deep for its memory; the task keeps too much on it, or \
                     calls itself without an end"
                )?;
            }
            write!(f, " (pc {pc}, lr {lr}, cfsr {cfsr}, hfsr {hfsr}")?;
            if let Some(address) = &fault.address {
                write!(f, ", address {address}")?;
            }
            write!(f, ")")?;
        }
        if self.bad_starts > 1 {
            write!(f, "; {} starts like this in a row", self.bad_starts)?;
        }
        Ok(())
    }
}

/// A mission on trial, in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct TrialReport {
    /// Time until the robot goes back by itself, in milliseconds.
    pub left_ms: u32,
    /// Hash of the mission that it goes back to, if there was one.
    pub before: Option<String>,
}

/// What a robot's flash has, in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct StoreReport {
    /// Where the mission is that runs: `slot A`, `slot B` or `firmware`; none if none runs.
    pub runs: Option<&'static str>,
    /// What is in bank A.
    pub slot_a: &'static str,
    /// What is in bank B.
    pub slot_b: &'static str,
}

impl From<StoreStatus> for StoreReport {
    fn from(kept: StoreStatus) -> Self {
        let [slot_a, slot_b] = kept.slots.map(slot_state);
        StoreReport {
            runs: match kept.runs {
                Source::Nothing => None,
                Source::A => Some("slot A"),
                Source::B => Some("slot B"),
                Source::Firmware => Some("firmware"),
            },
            slot_a,
            slot_b,
        }
    }
}

/// How a robot's flash is, in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FlashReport {
    /// How its records are: `new`, `whole`, `once`, `unreadable` or `older`.
    pub records: &'static str,
    /// Who gets into a robot whose records are damaged: `key`, `anybody` or `nobody`; none where
    /// they are not.
    pub way_in: Option<&'static str>,
    /// Places of its records that were neither blank nor whole at the start.
    pub flaws: u16,
    /// How often a slot for a mission was erased, both counted together.
    pub mission_erases: u32,
    /// How often an area for records was erased, both counted together.
    pub record_erases: u32,
}

impl From<FlashHealth> for FlashReport {
    fn from(health: FlashHealth) -> Self {
        let (records, way_in) = match health.records {
            KeyValuesState::New => ("new", None),
            KeyValuesState::Whole => ("whole", None),
            KeyValuesState::Once => ("once", None),
            KeyValuesState::Unreadable(way_in) => ("unreadable", Some(way_in)),
            KeyValuesState::Older(way_in) => ("older", Some(way_in)),
        };
        FlashReport {
            records,
            way_in: way_in.map(|way_in| match way_in {
                WayIn::Key => "key",
                WayIn::NoKey => "anybody",
                WayIn::Erase => "nobody",
            }),
            flaws: health.flaws,
            mission_erases: health.mission_erases,
            record_erases: health.record_erases,
        }
    }
}

impl FlashReport {
    /// How its records are, and what to do about it.
    fn records_in_words(&self) -> String {
        let records = match self.records {
            "new" => "nothing was ever kept",
            "whole" => "whole",
            "once" => {
                "whole, but its flash takes no second copy: the next damage loses them, replace it"
            }
            "older" => {
                "DAMAGED, what can be read is not what was kept last: the robot is stopped and takes nothing"
            }
            _ => "DAMAGED, none can be read: the robot is stopped and takes nothing",
        };
        let way = match self.way_in {
            Some("key") => {
                "; its owner gets in with the key that it had: `esm key install` with that key"
            }
            Some("anybody") => "; it had no key: `esm key install` with a new one",
            Some(_) => "; erase its flash at the programmer, for it does not know its key any more",
            None => "",
        };
        let flaws = match self.flaws {
            0 => String::new(),
            flaws if self.way_in.is_some() => format!(" ({flaws} damaged places)"),
            flaws => format!(
                "; {flaws} places were damaged or cut by a loss of power, and nothing was lost"
            ),
        };
        format!("{records}{way}{flaws}")
    }
}

/// What is in a slot, in a word or two.
fn slot_state(state: BankState) -> &'static str {
    match state {
        BankState::Runs => "runs",
        BankState::OnTrial => "on trial",
        BankState::Spare => "spare",
        BankState::Empty => "empty",
        BankState::Unsealed => "unsealed",
        BankState::BrokenHeader => "broken header",
        BankState::OtherFormat => "other format",
        BankState::TooLong => "too long",
        BankState::NoRoom { .. } => "no room",
        BankState::BrokenPayload => "broken payload",
        BankState::Unreadable => "unreadable",
        BankState::Refused => "refused",
        BankState::TrialFailed => "trial failed",
        BankState::TrialNotRecorded => "trial not recorded",
        BankState::GivenUp => "given up",
    }
}

/// A mission that was given up, in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FallBackReport {
    /// Its hash.
    pub mission: String,
    /// Why.
    pub reason: &'static str,
}

impl From<Trial> for TrialReport {
    fn from(trial: Trial) -> Self {
        TrialReport {
            left_ms: trial.left_ms,
            before: trial.before.map(hash_text),
        }
    }
}

impl From<FallBack> for FallBackReport {
    fn from(fell_back: FallBack) -> Self {
        FallBackReport {
            mission: hash_text(fell_back.mission),
            reason: story::fall_back_reason(fell_back.reason),
        }
    }
}

/// Runs the command.
///
/// # Errors
/// What kept it from ending well.
pub fn execute(args: &StatusArgs, console: &mut Console) -> Result<(), CommandError> {
    let (mut robot, info) = args.robot.connect(console)?;
    let reading = Reader::default().read(&mut robot, Tasks::None)?;
    let (words, file) = robot.crash_report()?;
    let left_out = robot.built_in()?.left_out();
    let report = StatusReport {
        built_without: left_out.into_iter().map(Feature::name).collect(),
        crash_report: CrashReportJson::new(words, file),
        ..StatusReport::new(info, reading)
    };
    if args.json {
        console.json_line(&report)
    } else {
        console.text(&report.to_string())
    }
}

/// What is said of a mission that runs and has reached all its final states.
pub(super) const FINISHED: &str = "finished, all final states are reached";

/// What lets such a mission run once more.
pub(super) const RUN_ANEW: &str = "`esm stop`, then `esm start` runs it from its beginning";

impl StatusReport {
    /// What a robot that says this of itself has told; nothing of how its last run ended, and of
    /// what its firmware lacks.
    pub fn new(info: RobotInfo, reading: Reading) -> Self {
        let status = reading.status;
        let (mode, safe_reason) = mode_words(status.mode);
        StatusReport {
            board: info.board,
            firmware: info.firmware,
            built_without: Vec::new(),
            mode,
            finished: reading.finished,
            safe_reason,
            stop_pressed: status.stop_pressed,
            mission: status.mission.map(hash_text),
            machine: reading.machine,
            trial: status.trial.map(TrialReport::from),
            fell_back: status.fell_back.map(FallBackReport::from),
            kept: status.kept.map(StoreReport::from),
            flash: status.flash.map(FlashReport::from),
            changed_params: status.changed_params,
            saved_params: status.saved_params,
            active: reading.active,
            steps: status.steps,
            t_us: status.t_us,
            robot_us: reading.robot_us,
            slots_executed: status.executed,
            slots_missed: status.missed,
            overruns: status.overruns,
            longest_dispatch_delay_ns: status.max_delay_ns,
            trace_dropped: status.trace_dropped,
            deepest_stack_bytes: status.stack_bytes,
            last_reset: reset_reason(status.reset),
            crash_report: CrashReportJson::default(),
            slots: (reading.slots.into_iter())
                .map(|slot| slot.counted)
                .collect(),
            links: reading.links,
        }
    }
}

impl fmt::Display for StatusReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut row = |name: &str, value: String| writeln!(f, "{name:<24} {value}");
        row("robot", format!("{} on {}", self.firmware, self.board))?;
        if !self.built_without.is_empty() {
            row("built without", self.built_without.join(", "))?;
        }
        let mode = match self.safe_reason {
            Some(reason) => format!("safe, motors off: {reason}"),
            None if self.stop_pressed => {
                "emergency stop, its button is pressed: let go of it, then `esm start --release`"
                    .to_owned()
            }
            None if self.mode == "emergency stop" => {
                "emergency stop, latched: motors off until `esm start --release`".to_owned()
            }
            None if self.mode == "stopped" => "stopped: motors off until `esm start`".to_owned(),
            None if self.finished => format!("{FINISHED}: {RUN_ANEW}"),
            None => self.mode.to_owned(),
        };
        row("mode", mode)?;
        let robot_s = self.robot_us as f64 / 1e6;
        row("robot time", format!("{robot_s:.1} s since it started"))?;
        row(
            "last reset",
            format!("{}{}", self.last_reset, self.crash_report),
        )?;
        if let Some(mission) = &self.mission {
            let seconds = self.t_us as f64 / 1e6;
            let named = match &self.machine {
                Some(machine) => format!("{machine} ({mission})"),
                None => mission.clone(),
            };
            row(
                "mission",
                format!(
                    "{named}, mission time {seconds:.1} s, {} macro steps",
                    self.steps
                ),
            )?;
            row("current states", self.active.join(", "))?;
        }
        if self.changed_params > 0 || self.saved_params > 0 {
            row(
                "parameters",
                format!(
                    "{} differ from the mission's, {} saved: `esm param get`",
                    self.changed_params, self.saved_params
                ),
            )?;
        }
        if let Some(TrialReport { left_ms, before }) = &self.trial {
            let seconds = f64::from(*left_ms) / 1e3;
            let before = before.as_deref().unwrap_or("no mission, motors off");
            row(
                "on trial",
                format!(
                    "for {seconds:.1} s more, then back to {before}: `esm confirm`, `esm fallback`"
                ),
            )?;
        }
        if let Some(FallBackReport { mission, reason }) = &self.fell_back {
            row("last fall-back", format!("gave {mission} up: {reason}"))?;
        }
        if let Some(StoreReport {
            runs,
            slot_a,
            slot_b,
        }) = &self.kept
        {
            let from = match runs {
                Some("firmware") => "runs the firmware's own mission",
                Some(_) => "runs a mission of the flash",
                None => "no mission to run",
            };
            row(
                "kept",
                format!("{from}; slot A: {slot_a}, slot B: {slot_b}"),
            )?;
        }
        if let Some(flash) = &self.flash {
            row("records", flash.records_in_words())?;
            row(
                "flash wear",
                format!(
                    "{} erases of a slot for missions, {} of an area for records; each counts for one of two places",
                    flash.mission_erases, flash.record_erases
                ),
            )?;
        }
        row("slots executed", self.slots_executed.to_string())?;
        // Those of the slots below begin anew with each mission.
        let since_reset = |count: u32| format!("{count} since the robot started");
        row("slots missed", since_reset(self.slots_missed))?;
        row("overruns", since_reset(self.overruns))?;
        row(
            "longest dispatch delay",
            format!("{} us", f64::from(self.longest_dispatch_delay_ns) / 1e3),
        )?;
        if self.trace_dropped > 0 {
            row("trace records dropped", self.trace_dropped.to_string())?;
        }
        if let Some(bytes) = self.deepest_stack_bytes {
            row("deepest stack", format!("{bytes} bytes"))?;
        }
        for slot in &self.slots {
            row(&format!("slot {}", slot.slot), slot.to_string())?;
            if slot.is_timed() {
                row("  start delays", slot.delays_in_words())?;
            }
        }
        for (title, counted) in self.links.iter().flat_map(LinkReport::rows) {
            row(&title, counted)?;
        }
        Ok(())
    }
}
