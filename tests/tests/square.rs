//! The mission that drives a square, and the page that writes it step by step.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::path::{Path, PathBuf};

use esm_tests::command::root;
use esm_tests::subject;
use host_tools::host_board;
use host_tools::lang;
use host_tools::plant::Plant;
use host_tools::run::board::{Board, LinkWay};
use host_tools::run::drive::{self, Plan, Planned};
use host_tools::run::interrupt::Interrupt;
use host_tools::run::mission::Mission;
use host_tools::world::{StartPose, World};

/// How far from its start the robot may be at the end.
const MOST_M: f64 = 0.03;
const MOST_DEGREES: f64 = 3.0;

/// How a run in a world ended: the plant, when the mission was finished, and the trace.
struct Ended {
    plant: Plant,
    finished_s: Option<f64>,
    trace: String,
}

impl Ended {
    /// How far the robot is from where it was, in metres, and by how many degrees it looks further to the left.
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
    let blob = subject::build_file(file).unwrap().blob;
    let mission = Mission::new(file, esm_core::verify(blob).unwrap()).unwrap();
    let plan = Plan {
        seed,
        until_us: Some(32_000_000),
        link: LinkWay::Exchange,
        ..Plan::new(
            Board::Host {
                robot: host_board::rover,
            },
            world,
            vec![Planned::first(mission)],
        )
    };
    let interrupt = Interrupt::take_over().unwrap();
    let run = drive::drive(plan, Vec::new(), interrupt, &mut |_| ()).unwrap();
    assert!(run.summary.fault.is_none());
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
                nearest_m < 0.05,
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

/// Does to a mission what the page says is to be done with a part: what has its name gives way to it, and what is new is
/// added.
fn put(mission: &mut Vec<String>, part: String) {
    // A region by its name, a path by its first source, a state by all before its parameters, a slot by its number.
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
    assert_eq!(ends.len(), 4);
    // What the page says of where they end.
    let words: Vec<&str> = page.split_whitespace().collect();
    let words = words.join(" ");
    let [
        (open_m, open_degrees),
        (closed_m, closed_degrees),
        (last_m, _),
    ] = [ends[1], ends[2], ends[3]];
    for told in [
        format!(
            "ends {:.0} cm from where it began, and looks {:.0} degrees too far to the right",
            open_m * 100.0,
            -open_degrees
        ),
        format!(
            "it ends {:.1} cm and {:.1} degrees from its start",
            closed_m * 100.0,
            closed_degrees.abs()
        ),
    ] {
        assert!(words.contains(&told), "{told}");
    }
    assert!(last_m < MOST_M);
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
