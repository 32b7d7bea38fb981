//! What a person wants to know of a run when it is over.

use std::fmt;

use esm_link::message::Status;
use serde::Serialize;

use esm_toolkit::counters::SlotReport;
use esm_toolkit::schedule::handover::Handover;

/// A run in figures.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Summary {
    /// The board that it ran on.
    pub board: String,
    /// The world that it drove in.
    pub world: String,
    /// Robot time, in seconds.
    pub robot_time_s: f64,
    /// Time on the wall that it took, uploads and start included, in seconds; `None` for a run that
    /// repeats to the byte, whose summary does, too.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub wall_time_s: Option<f64>,
    /// Way of the robot's centre, in metres.
    pub distance_m: f64,
    /// How often the robot ran into a wall.
    pub collisions: u32,
    /// Speed at the hardest of them, in metres per second; `None` without one.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hardest_collision_m_per_s: Option<f64>,
    /// Rooms that it came into, in the order of the first time.
    pub rooms_entered: Vec<String>,
    /// Macro steps that the trace holds.
    pub macro_steps: u64,
    /// Transitions taken.
    pub transitions: u64,
    /// Slot activations that were executed.
    pub slots_executed: u64,
    /// Slot activations that did not start within their period.
    pub slots_missed: u64,
    /// Task executions that took longer than their slot.
    pub overruns: u64,
    /// Longest time from the nominal start of an activation to its first instruction, in
    /// nanoseconds.
    pub longest_dispatch_delay_ns: u32,
    /// The deepest that the stack was, in bytes; `None` where the board does not tell.
    pub deepest_stack_bytes: Option<u32>,
    /// What ended the last mission, if it faulted.
    pub fault: Option<String>,
    /// Robot time at which the last mission had reached all its final states, in seconds, if it
    /// has.
    pub finished_s: Option<f64>,
    /// The missions, in the order in which they ran.
    pub missions: Vec<MissionSummary>,
    /// Requests that had to be sent again.
    pub link_retries: u64,
}

/// A mission's way to the robot.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct MissionSummary {
    /// The file.
    pub file: String,
    /// Hash of its blob, in hex.
    pub hash: String,
    /// Size of its blob, in bytes.
    pub bytes: usize,
    /// Robot time of its first macro step, in seconds.
    pub started_s: f64,
    /// Time that its upload took on the clock of the line, in seconds: the wall's, or that of the
    /// plant exchange.
    pub upload_s: f64,
    /// Slot activations missed from the upload's first byte to the first macro step.
    pub slots_missed_in_upload: u64,
    /// What the robot counted of its slots: up to the end of the run, or to where the upload of the
    /// next mission began.
    pub slots: Vec<SlotReport>,
    /// What becomes of the slots that it shares with the mission before.
    #[serde(flatten)]
    pub handover: Handover,
}

impl Summary {
    /// What a robot's own counters say, and nothing else.
    pub fn of_status(status: Status) -> Self {
        Summary {
            slots_executed: status.executed.into(),
            slots_missed: status.missed.into(),
            overruns: status.overruns.into(),
            longest_dispatch_delay_ns: status.max_delay_ns,
            deepest_stack_bytes: status.stack_bytes,
            ..Summary::default()
        }
    }
}

impl fmt::Display for Summary {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut row = |name: &str, value: String| writeln!(f, "  {name:<24} {value}");
        row(
            "robot time",
            format!(
                "{:.3} s on {} in {}{}",
                self.robot_time_s,
                self.board,
                self.world,
                (self.wall_time_s)
                    .map_or_else(String::new, |wall| format!(" ({wall:.1} s on the wall)"))
            ),
        )?;
        row("distance", format!("{:.2} m", self.distance_m))?;
        let hardest = (self.hardest_collision_m_per_s).map_or_else(String::new, |speed| {
            format!(", the hardest at {speed:.2} m/s")
        });
        row("collisions", format!("{}{hardest}", self.collisions))?;
        let rooms = match self.rooms_entered.as_slice() {
            [] => "none".to_owned(),
            rooms => format!("{} ({})", rooms.len(), rooms.join(", ")),
        };
        row("rooms entered", rooms)?;
        row(
            "macro steps",
            format!("{}, {} transitions", self.macro_steps, self.transitions),
        )?;
        row("slots executed", self.slots_executed.to_string())?;
        row("slots missed", self.slots_missed.to_string())?;
        if self.overruns > 0 {
            row("overruns", self.overruns.to_string())?;
        }
        row(
            "longest dispatch delay",
            format!("{:.1} us", f64::from(self.longest_dispatch_delay_ns) / 1e3),
        )?;
        if let Some(bytes) = self.deepest_stack_bytes {
            row("deepest stack", format!("{bytes} bytes"))?;
        }
        for mission in &self.missions {
            row(
                "upload",
                format!(
                    "{} ({}): {} bytes in {:.2} s, running from {:.3} s, {} slots missed meanwhile",
                    mission.file,
                    mission.hash,
                    mission.bytes,
                    mission.upload_s,
                    mission.started_s,
                    mission.slots_missed_in_upload
                ),
            )?;
            for slot in &mission.slots {
                row(&format!("slot {}", slot.slot), slot.to_string())?;
                if slot.is_timed() {
                    row("  start delays", slot.delays_in_words())?;
                }
            }
            for moved in &mission.handover.slots_moved {
                row(
                    "",
                    format!(
                        "slot {} starts anew: up to {} us between two occurrences, its period is {} us",
                        moved.slot, moved.longest_gap_us, moved.period_us
                    ),
                )?;
            }
        }
        if self.link_retries > 0 {
            row("requests sent again", self.link_retries.to_string())?;
        }
        if let Some(at_s) = self.finished_s {
            row(
                "finished",
                format!("at {at_s:.3} s, all final states are reached"),
            )?;
        }
        match &self.fault {
            Some(fault) => row("fault", fault.clone()),
            None => Ok(()),
        }
    }
}
