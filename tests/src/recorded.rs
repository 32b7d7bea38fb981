//! Runs on the host board that are recorded, and what a recording of each shipped mission takes.

use std::fmt;
use std::path::Path;
use std::time::Duration;

use host_tools::compile::compile;
use host_tools::files::load_world;
use host_tools::recording::writer::Counts;
use host_tools::run::board::Board;
use host_tools::run::drive::{self, Plan, Planned};
use host_tools::run::in_memory::InMemory;
use host_tools::run::interrupt::Interrupt;
use host_tools::run::mission::Mission;
use host_tools::schedule::handover::Handover;
use host_tools::time::work_limit;
use host_tools::{host_board, lang};

use crate::command::root;

/// A run that is recorded.
#[derive(Clone, Copy, Debug)]
pub struct RecordedRun {
    /// Missions with their times in seconds, and whether they take over warm.
    pub missions: &'static [(u64, &'static str, bool)],
    /// Name of the world.
    pub world: &'static str,
    /// Seed of the noise in the robot's body.
    pub seed: u64,
    /// Robot time.
    pub until_s: u64,
}

/// What came of a run.
pub struct Made {
    /// The file.
    pub recording: Vec<u8>,
    /// What its writer counted.
    pub counts: Counts,
    /// Macro steps and transitions that the run's summary tells.
    pub steps: u64,
    /// See [`Made::steps`].
    pub transitions: u64,
    /// The robot's trace.
    pub trace: String,
}

/// The most bytes that a recording takes for a transition, on average over the shipped missions.
pub const MOST_BYTES_A_TRANSITION: f64 = 4.0;

/// Robot time for which each is recorded, unless another is told.
pub const SECONDS: u64 = 120;

/// Each shipped mission in the worlds that it is made for. The last one keeps to the clock on the
/// wall, since it counts the silence of its host.
pub const SHIPPED: [(&str, &[&str]); 22] = [
    ("patrol", &["office", "corridor"]),
    ("follow_wall", &["office", "corridor"]),
    ("watch_timing", &["office"]),
    ("stand_by", &["office"]),
    ("tutorial/1_line", &["track"]),
    ("tutorial/2_lost", &["track"]),
    ("tutorial/3_gap", &["track"]),
    ("tutorial/4_search", &["track"]),
    ("tutorial/5_obstacle", &["track"]),
    ("tutorial/6_everything", &["track"]),
    ("square", &["empty"]),
    ("guard", &["visitors"]),
    ("landmark", &["corridor"]),
    ("errand", &["office_floor"]),
    ("follow_me", &["visitors"]),
    ("wander", &["cluttered"]),
    ("bump", &["low_boxes"]),
    ("dock", &["dock"]),
    ("by_hand", &["empty"]),
    ("tune", &["empty"]),
    ("wall_rules", &["office"]),
    ("on_a_lead", &["office"]),
];

/// The most robot time that a mission is given which keeps to the clock on the wall, in seconds.
const MOST_WALL_S: u64 = 10;

/// What a recording of a mission takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Row {
    /// The mission.
    pub mission: &'static str,
    /// The world.
    pub world: &'static str,
    /// Robot time, in seconds.
    pub seconds: u64,
    /// Macro steps.
    pub steps: u64,
    /// Transitions.
    pub transitions: u64,
    /// Bytes of records.
    pub record_bytes: u64,
    /// Bytes of the file, which holds the mission, too.
    pub file_bytes: u64,
}

/// Bytes for each of some transitions.
pub fn bytes_a_transition(bytes: u64, transitions: u64) -> f64 {
    bytes as f64 / transitions.max(1) as f64
}

impl fmt::Display for Row {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "| {} | {} | {} | {} | {} | {} | {:.2} | {} |",
            self.mission,
            self.world,
            self.seconds,
            self.steps,
            self.transitions,
            self.record_bytes,
            bytes_a_transition(self.record_bytes, self.transitions),
            self.file_bytes
        )
    }
}

/// Records each shipped mission for so much robot time.
///
/// # Panics
/// If a mission does not compile or run.
pub fn record_shipped(seconds: u64) -> Vec<Row> {
    let worlds = |(mission, worlds): &(&'static str, &'static [&'static str])| {
        let mission = *mission;
        worlds.iter().map(move |world| (mission, *world))
    };
    let runs = SHIPPED.iter().flat_map(worlds);
    runs.map(|(name, world)| {
        let keeps_to_the_wall = mission(name)
            .task_names
            .iter()
            .any(|task| task == "LinkMonitor");
        let seconds = if keeps_to_the_wall {
            seconds.min(MOST_WALL_S)
        } else {
            seconds
        };
        let planned = Planned {
            at_us: 0,
            mission: mission(name),
            warm: false,
            handover: Handover::default(),
        };
        let made = made(vec![planned], world, 1, seconds);
        Row {
            mission: name,
            world,
            seconds,
            steps: made.counts.steps,
            transitions: made.transitions,
            record_bytes: made.counts.record_bytes,
            file_bytes: made.recording.len() as u64,
        }
    })
    .collect()
}

/// A shipped mission.
///
/// # Panics
/// If it does not compile.
pub fn mission(name: &str) -> Mission {
    let path = root().join(format!("missions/{name}.esm"));
    try_mission(&path).unwrap_or_else(|problem| panic!("{name}: {problem}"))
}

fn try_mission(path: &Path) -> Result<Mission, String> {
    let mut checked = lang::load(path).map_err(|error| error.to_string())?;
    let schedule = checked.lay_out(work_limit(Duration::from_secs(60)));
    let (Some(schedule), Some(model)) = (schedule, checked.model.as_ref()) else {
        return Err("it has errors".to_owned());
    };
    let blob = compile(model, &schedule).map_err(|error| error.to_string())?;
    let verified = esm_core::verify(blob).map_err(|(_, refusal)| format!("{refusal:?}"))?;
    Mission::new(path, verified).map_err(|error| error.to_string())
}

impl RecordedRun {
    /// Its recording and its trace.
    ///
    /// # Panics
    /// If it does not come to its end, or its recording has a gap.
    pub fn made(&self) -> Made {
        let missions = self.missions.iter().map(|(at_s, name, warm)| Planned {
            at_us: at_s * 1_000_000,
            mission: mission(name),
            warm: *warm,
            handover: Handover::default(),
        });
        made(missions.collect(), self.world, self.seed, self.until_s)
    }
}

fn made(missions: Vec<Planned>, world: &str, seed: u64, until_s: u64) -> Made {
    let recording = InMemory::default();
    let world = root().join(format!("missions/worlds/{world}.world"));
    let world = load_world(&world).unwrap_or_else(|error| panic!("{error}"));
    let plan = Plan {
        seed,
        until_us: Some(until_s * 1_000_000),
        record: Some(Box::new(recording.clone())),
        ..Plan::new(
            Board::Host {
                robot: host_board::rover,
            },
            world,
            missions,
        )
    };
    let run = Interrupt::take_over()
        .map_err(|error| error.to_string())
        .and_then(|interrupt| {
            drive::drive(plan, Vec::new(), interrupt, &mut |_| ()).map_err(|it| it.to_string())
        })
        .unwrap_or_else(|problem| panic!("{problem}"));
    let counts = run.recorded.unwrap_or_default();
    assert_eq!(counts.gaps, 0, "{counts:?}");
    let recording = recording.bytes().to_vec();
    Made {
        recording,
        counts,
        steps: run.summary.macro_steps,
        transitions: run.summary.transitions,
        trace: String::from_utf8_lossy(&run.told.out).into_owned(),
    }
}
