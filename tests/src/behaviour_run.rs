//! Runs of one behaviour on the host board.

use std::path::Path;

use host_tools::lockstep::plant_side::SonarBreak;
use host_tools::plant::{PathSample, Plant, SonarFault};
use host_tools::run::drive::Plan;
use host_tools::world::World;

use crate::command::root;
use crate::host_drive;

/// What became of a behaviour.
pub struct BehaviourRun {
    /// The body in its world, at the end.
    pub plant: Plant,
    /// When it had ended, in microseconds.
    pub ended_us: Option<u64>,
    /// Whether it had failed then.
    pub failed: bool,
}

impl BehaviourRun {
    /// Where the body was until the behaviour ended, and for half a second behind that, in which it
    /// brakes.
    pub fn path(&self) -> impl Iterator<Item = &PathSample> {
        const BRAKES_US: u64 = 500_000;
        let until_us = self
            .ended_us
            .map_or(u64::MAX, |ended_us| ended_us + BRAKES_US);
        let path = self.plant.statistics().path().iter();
        path.take_while(move |sample| sample.t_us <= until_us)
    }
}

/// Drives a behaviour, written as in a mission (`GoTo with { x_m = 2.0 }`), until it ends, or for
/// so many seconds.
///
/// # Panics
/// If it does not compile, or the run does not come to its end.
#[track_caller]
pub fn behave(behaviour: &str, world: World, seed: u64, until_s: u64) -> BehaviourRun {
    behave_with(behaviour, world, seed, until_s, &[])
}

/// The same on a robot whose sonars die, each at a robot time in milliseconds.
///
/// # Panics
/// As [`behave`].
#[track_caller]
pub fn behave_with(
    behaviour: &str,
    world: World,
    seed: u64,
    until_s: u64,
    dead: &[(usize, u64)],
) -> BehaviourRun {
    let mission = format!(
        r#"use "{rover}";
        interpreter slot 1;
        slot 1 period 20 ms duration 2 ms;
        slot 2 period 10 ms duration 4 ms;
        slot 3 period 40 ms duration 2 ms;
        machine Behave {{
            region sonars {{ task Listen: SonarRing; initial -> Listen; }}
            region position {{ task Track: Odometry; initial -> Track; }}
            region ready {{
                // The sonars have a whole picture.
                state Wait timeout 400 ms;
                task Go: {behaviour};
                state Failed;
                state Done;
                initial -> Wait;
                Wait -> Go [timeout];
                Go -> Failed [exit and .failed];
                Go -> Done on *;
            }}
            region behaviours {{ task Run: Behaviours; initial -> Run; }}
            region wheels {{ task Drive: WheelSpeed; initial -> Drive; }}
            path Run.made -> Run.list, Go.list;
            path Track.pose -> Listen.pose, Run.pose, Go.pose;
            path Listen.ranges -> Run.ranges, Go.ranges;
            path Run.twist -> Drive.twist;
            path Track.speeds -> Drive.speeds;
        }}"#,
        rover = root().join("missions/rover.esm").display()
    );
    let folder = tempfile::tempdir().expect("a folder");
    let file = folder.path().join("behave.esm");
    std::fs::write(&file, mission).expect("a mission");
    let breaks = dead.iter().map(|(sonar, at_ms)| SonarBreak {
        sonar: *sonar,
        fault: SonarFault::Dead,
        robot_us: at_ms * 1_000,
    });
    run(&file, world, seed, until_s, breaks.collect())
}

fn run(
    file: &Path,
    world: World,
    seed: u64,
    until_s: u64,
    sonar_breaks: Vec<SonarBreak>,
) -> BehaviourRun {
    let run = host_drive::driven(Plan {
        seed,
        sonar_breaks,
        until_us: Some(until_s * 1_000_000),
        ..host_drive::plan(file, world)
    });
    let trace = String::from_utf8(run.told.out).expect("a trace is text");
    let entered_us = |state: &str| {
        let to = format!(r#""to":"ready/{state}""#);
        let line = trace.lines().find(|line| line.contains(&to))?;
        let entry: serde_json::Value = serde_json::from_str(line).ok()?;
        entry["t_us"].as_u64()
    };
    let (failed_us, done_us) = (entered_us("Failed"), entered_us("Done"));
    BehaviourRun {
        plant: run.plant,
        ended_us: failed_us.or(done_us),
        failed: failed_us.is_some(),
    }
}
