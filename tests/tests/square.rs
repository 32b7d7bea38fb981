//! The mission that drives a square, and the page that writes it step by step.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::{Path, PathBuf};

use esm_tests::command::root;
use esm_tests::host_drive;
use host_tools::lang;
use host_tools::plant::Plant;
use host_tools::run::drive::Plan;
use host_tools::world::{StartPose, World};

/// How far from its start the robot may be at the end.
const MOST_M: f64 = 0.03;
const MOST_DEGREES: f64 = 2.0;
/// And from each corner, on its way.
const CORNER_M: f64 = 0.03;

/// How a run in a world ended: the plant, when the mission was finished, and the trace.
struct Ended {
    plant: Plant,
    finished_s: Option<f64>,
    trace: String,
}

impl Ended {
    /// How far the robot is from where it was, in metres, and by how many degrees it looks further
    /// to the left.
    fn off(&self, start: StartPose) -> (f64, f64) {
        let end = self.plant.pose();
        let right_m = end.position.x_m - start.position.x_m;
        let up_m = end.position.y_m - start.position.y_m;
        let turned = end.heading_rad.to_degrees() - start.heading_deg;
        (
            libm::hypot(right_m, up_m),
            (turned + 180.0).rem_euclid(360.0) - 180.0,
        )
    }
}

fn shipped() -> PathBuf {
    root().join("missions/square.esm")
}

fn driven(file: &Path, world: World, seed: u64) -> Ended {
    let run = host_drive::driven(Plan {
        seed,
        until_us: Some(32_000_000),
        ..host_drive::plan(file, world)
    });
    Ended {
        plant: run.plant,
        finished_s: run.summary.finished_s,
        trace: String::from_utf8(run.told.out).unwrap(),
    }
}

fn empty_hall() -> String {
    std::fs::read_to_string(root().join("missions/worlds/empty.world")).unwrap()
}

#[test]
fn the_square_ends_where_it_began_and_the_mission_has_finished() {
    for seed in 1..=8 {
        let world = World::parse(&empty_hall()).unwrap();
        let start = world.start;
        let ended = driven(&shipped(), world, seed);
        let (off_m, off_degrees) = ended.off(start);
        println!("seed {seed}: {off_m:.4} m, {off_degrees:.2} degrees off");
        assert!(off_m < MOST_M, "seed {seed}: {off_m} m");
        assert!(
            off_degrees.abs() < MOST_DEGREES,
            "seed {seed}: {off_degrees} degrees"
        );
        // It has been at all four corners, to a few centimetres.
        for (x_m, y_m) in [(1.0, 0.0), (1.0, 1.0), (0.0, 1.0)] {
            let nearest_m = ended.plant.statistics().path().iter().map(|sample| {
                let at = sample.pose.position;
                let (right_m, up_m) = (at.x_m - start.position.x_m, at.y_m - start.position.y_m);
                libm::hypot(right_m - x_m, up_m - y_m)
            });
            let nearest_m = nearest_m.fold(f64::INFINITY, f64::min);
            println!("    {nearest_m:.4} m from the corner at {x_m},{y_m}");
            assert!(
                nearest_m < CORNER_M,
                "seed {seed}: {nearest_m} m from {x_m},{y_m}"
            );
        }
        assert_eq!(ended.plant.collisions(), 0);
        assert!(
            ended.finished_s.is_some_and(|at_s| at_s < 30.0),
            "{:?}",
            ended.finished_s
        );
    }
}

/// A mission of one task that moves, and of what it needs.
fn one_movement(folder: &Path, task: &str) -> PathBuf {
    let mission = format!(
        r#"use "{}/missions/rover.esm";
        interpreter slot 1;
        slot 1 period 20 ms duration 2 ms;
        slot 2 period 20 ms duration 4 ms;
        machine Measure {{
            region position {{ task Track: Odometry; initial -> Track; }}
            region wheels {{ task Drive: WheelSpeed; initial -> Drive; }}
            region motion {{ task Go: {task}; initial -> Go / set .left; Go -> final on *; }}
            path Track.pose -> Go.pose;
            path Track.speeds -> Drive.speeds;
            path Go.twist -> Drive.twist;
        }}"#,
        root().display()
    );
    let mission = match task.starts_with("Turn") {
        true => mission,
        false => mission.replace(" / set .left", ""),
    };
    let file = folder.join("measure.esm");
    std::fs::write(&file, mission).unwrap();
    file
}

/// How a person measures a robot, with a tape and a mark on the floor: what it is told against what
/// it does, on average over floors. The measures in its firmware are such that the two agree as
/// well as a tape can say.
#[test]
fn the_rovers_measures_are_those_that_a_tape_finds() {
    const FLOORS: u64 = 6;
    let folder = tempfile::tempdir().unwrap();
    let mean = |task: &str, measure: &dyn Fn(&Ended, StartPose) -> f64| {
        let file = one_movement(folder.path(), task);
        let each = (1..=FLOORS).map(|seed| {
            let world = World::parse(&empty_hall()).unwrap();
            let start = world.start;
            let ended = driven(&file, world, seed);
            assert!(ended.trace.contains(r#""to":"motion/final""#), "{task}");
            measure(&ended, start)
        });
        each.sum::<f64>() / FLOORS as f64
    };
    let way_m = mean(
        "DriveDistance with { distance_m = 2.5 }",
        &|ended, start| ended.off(start).0,
    );
    let turn_rad = mean(
        "Turn with { angle_rad = 6.2, rate_rad_per_s = 1.2 }",
        &|ended, start| ended.plant.pose().heading_rad - start.heading_deg.to_radians(),
    );
    println!("{way_m:.4} m of 2.5, {turn_rad:.4} rad of 6.2");
    assert!((way_m / 2.5 - 1.0).abs() < 0.003, "{way_m} m");
    assert!((turn_rad / 6.2 - 1.0).abs() < 0.005, "{turn_rad} rad");
}

#[test]
fn a_box_on_a_side_stops_it_before_it_is_touched() {
    let boxed = empty_hall() + "wall 2.6,1.9 2.8,1.9 2.8,2.1 2.6,2.1 2.6,1.9\n";
    let ended = driven(&shipped(), World::parse(&boxed).unwrap(), 1);
    assert_eq!(ended.plant.collisions(), 0);
    assert!(
        ended.plant.distance_m() < 0.6,
        "{} m",
        ended.plant.distance_m()
    );
    assert_eq!(ended.finished_s, None);
    assert!(ended.trace.contains(r#""to":"motion/Halted""#));
}

/// Lines without comments, blanks around them and empty lines.
fn bare(text: &str) -> Vec<String> {
    let lines = text
        .lines()
        .map(|line| line.split("//").next().unwrap().trim());
    lines
        .filter(|line| !line.is_empty())
        .map(str::to_owned)
        .collect()
}

/// The parts of a text that stand indented in a machine: regions whole, and all else line by line.
fn parts(block: &str) -> Vec<String> {
    let mut parts: Vec<String> = Vec::new();
    let mut in_region = false;
    for line in block.lines() {
        if in_region {
            let part = parts.last_mut().unwrap();
            part.push('\n');
            part.push_str(line);
            in_region = line != "    }";
        } else if !line.is_empty() {
            parts.push(line.to_owned());
            in_region = line.starts_with("    region ");
        }
    }
    parts
}

/// Does to a mission what the page says is to be done with a part: what has its name gives way to
/// it, and what is new is added.
fn put(mission: &mut Vec<String>, part: String) {
    // A region by its name, a path by its first source, a state by all before its parameters, a
    // slot by its number.
    let key = |part: &str| {
        let words: Vec<&str> = part
            .split([' ', ',', ':'])
            .filter(|word| !word.is_empty())
            .collect();
        words[..2.min(words.len())].join(" ")
    };
    let first = key(&part);
    if part.trim_start().starts_with("task ") {
        let motion = mission
            .iter_mut()
            .find(|part| part.starts_with("    region motion"));
        let motion = motion.unwrap();
        let old = motion
            .lines()
            .find(|line| key(line) == first)
            .unwrap()
            .to_owned();
        *motion = motion.replace(&old, &part);
        return;
    }
    if let Some(old) = mission.iter_mut().find(|old| key(old) == first) {
        *old = part;
        return;
    }
    let place = match first.split(' ').next().unwrap() {
        "event" => mission
            .iter()
            .position(|part| part.starts_with("machine"))
            .map(|at| at + 1),
        "slot" => mission.iter().position(|part| part.starts_with("machine")),
        "region" => mission.iter().position(|part| part.starts_with("    path")),
        "path" => mission.iter().position(|part| part == "}"),
        _ => None,
    };
    mission.insert(
        place.unwrap_or_else(|| panic!("where does this go: {part}")),
        part,
    );
}

#[test]
fn the_page_leads_to_the_mission_step_by_step() {
    let page = std::fs::read_to_string(root().join("docs/src/square.md")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("square.esm");
    let mut mission: Vec<String> = Vec::new();
    let mut ends = Vec::new();
    let blocks: Vec<&str> = page.split("```").skip(1).step_by(2).collect();
    for block in blocks {
        if let Some(text) = block.strip_prefix("text\n") {
            if mission.is_empty() {
                mission = parts(text);
            } else {
                parts(text)
                    .into_iter()
                    .for_each(|part| put(&mut mission, part));
            }
        } else if block.contains("esm check square.esm") {
            let top = root().to_str().unwrap();
            let text = mission
                .join("\n")
                .replace("\"missions/", &format!("\"{top}/missions/"));
            std::fs::write(&file, &text).unwrap();
            let checked = lang::load(&file).unwrap();
            let complaints = checked.render(false);
            assert!(checked.model.is_some(), "{text}\n{complaints}");
            // What it does not use of the robot is no mistake of the step.
            assert!(!complaints.contains("square.esm"), "{text}\n{complaints}");
            let world = World::parse(&empty_hall()).unwrap();
            let start = world.start;
            ends.push(driven(&file, world, 1).off(start));
        }
    }
    println!("{ends:?}");
    assert_eq!(ends.len(), 3);
    // What the page says of where they end.
    let words: Vec<&str> = page.split_whitespace().collect();
    let words = words.join(" ");
    let [(closed_m, closed_degrees), (last_m, _)] = [ends[1], ends[2]];
    let told = [
        format!(
            "it ends {:.1} cm and {:.1} degrees from its start",
            closed_m * 100.0,
            closed_degrees.abs()
        ),
        format!(
            "seeds from 1 to 8, the robot ends at most {:.0} cm and {:.0} degrees off",
            MOST_M * 100.0,
            MOST_DEGREES
        ),
    ];
    for told in told {
        assert!(words.contains(&told), "{told}");
    }
    assert!(last_m < MOST_M);
    // Distances and angles are those of a square: nothing in the mission makes up for the robot.
    for plain in ["distance_m = 1.0 }", "angle_rad = 1.5708 }"] {
        assert!(page.contains(plain), "{plain}");
    }
    let shipped = std::fs::read_to_string(shipped()).unwrap();
    let sorted = |text: &str| {
        let mut parts = parts(&bare_but_indented(text));
        parts.sort();
        bare(&parts.join("\n"))
    };
    let told = mission.join("\n").replace("\"missions/", "\"");
    assert_eq!(sorted(&told), sorted(&shipped));
}

/// A text without comments and blanks at the ends of lines.
fn bare_but_indented(text: &str) -> String {
    let lines = text
        .lines()
        .map(|line| line.split("//").next().unwrap().trim_end());
    lines.collect::<Vec<_>>().join("\n")
}
