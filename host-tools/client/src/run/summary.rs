//! What a person wants to know of a run when it is over.

use std::fmt;

use esm_link::message::Status;
use serde::Serialize;

use esm_toolkit::counters::{LinkReport, SlotReport};
use esm_toolkit::plant::Plant;
use esm_toolkit::schedule::handover::Handover;

use super::touches::TouchSummary;

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
    /// Where the robot's body was at the end; `None` where no plant can tell.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub end: Option<EndPose>,
    /// Whether Ctrl-C ended the run; left out where it did not.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub interrupted: bool,
    /// How often the robot ran into a wall or a person.
    pub collisions: u32,
    /// How many of these touches a robot that obeys its stop distance could have avoided.
    pub avoidable: u32,
    /// Each of them.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub touches: Vec<TouchSummary>,
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

/// Where a robot's body was at the end of a run, on the map of its world.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct EndPose {
    /// The centre, to the right, in metres.
    pub x_m: f64,
    /// The centre, upwards, in metres.
    pub y_m: f64,
    /// Which way it looks: counter-clockwise from x, in degrees, above -180 and up to 180.
    pub heading_deg: f64,
    /// From where the centre was at the start, in metres.
    pub from_start_m: f64,
    /// What the heading differs by from that at the start, in degrees, above -180 and up to 180.
    pub turned_deg: f64,
}

impl EndPose {
    /// Where a plant's body is now.
    pub fn of(plant: &Plant) -> Self {
        let (pose, start) = (plant.pose(), &plant.world().start);
        let (x_m, y_m) = (pose.position.x_m, pose.position.y_m);
        let heading_deg = pose.heading_rad.to_degrees();
        let (right_m, up_m) = (x_m - start.position.x_m, y_m - start.position.y_m);
        EndPose {
            x_m,
            y_m,
            heading_deg: wrapped_deg(heading_deg),
            from_start_m: libm::hypot(right_m, up_m),
            turned_deg: wrapped_deg(heading_deg - start.heading_deg),
        }
    }
}

impl fmt::Display for EndPose {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "at {}, {} m, heading {}°: {} m and {}° from its start",
            Rounded::<2>(self.x_m),
            Rounded::<2>(self.y_m),
            Rounded::<1>(self.heading_deg),
            Rounded::<3>(self.from_start_m),
            Rounded::<1>(self.turned_deg)
        )
    }
}

/// The same direction, above -180 degrees and up to 180.
fn wrapped_deg(angle_deg: f64) -> f64 {
    let turned = angle_deg.rem_euclid(360.0);
    if turned > 180.0 {
        turned - 360.0
    } else {
        turned
    }
}

/// A number with that many decimals, and no minus before a zero.
struct Rounded<const DECIMALS: usize>(f64);

impl<const DECIMALS: usize> fmt::Display for Rounded<DECIMALS> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = format!("{:.DECIMALS$}", self.0);
        let is_zero = text.chars().all(|it| matches!(it, '-' | '0' | '.'));
        f.write_str(if is_zero {
            text.trim_start_matches('-')
        } else {
            &text
        })
    }
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
    /// What it counted of its links in the same time.
    pub links: Vec<LinkReport>,
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
        if self.interrupted {
            row("ended by", "Ctrl-C".to_owned())?;
        }
        row("distance", format!("{:.2} m", self.distance_m))?;
        if let Some(end) = &self.end {
            row("end", end.to_string())?;
        }
        let hardest = (self.hardest_collision_m_per_s).map_or_else(String::new, |speed| {
            format!(", the hardest at {speed:.2} m/s")
        });
        let avoidable = match self.collisions {
            0 => String::new(),
            _ => format!(", {} of them avoidable", self.avoidable),
        };
        row(
            "collisions",
            format!("{}{avoidable}{hardest}", self.collisions),
        )?;
        for touch in &self.touches {
            row("", touch.to_string())?;
        }
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
            for (title, counted) in mission.links.iter().flat_map(LinkReport::rows) {
                row(&title, counted)?;
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn directions_are_wrapped_and_rounded_for_people() {
        for (angle_deg, expected) in [
            (0.0, "0.0"),
            (-0.01, "0.0"),
            (180.0, "180.0"),
            (-180.0, "180.0"),
            (270.0, "-90.0"),
            (359.96, "0.0"),
            (725.04, "5.0"),
            (-450.0, "-90.0"),
        ] {
            let text = Rounded::<1>(wrapped_deg(angle_deg)).to_string();
            assert_eq!(text, expected, "{angle_deg}");
        }
    }
}
