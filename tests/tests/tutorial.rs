//! The six steps of the tutorial: each is without complaint, passes its scenario, and drives along
//! the line as far as the book says.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::f64::consts::{PI, TAU};

use esm_tests::command::{esm, root};
use host_tools::files::load_world;
use host_tools::host_board;
use host_tools::lang;
use host_tools::plant::{PathSample, Plant};
use host_tools::run::board::Board;
use host_tools::run::drive::{self, Plan, Planned};
use host_tools::run::interrupt::Interrupt;
use host_tools::run::mission::Mission;
use host_tools::world::{Point, World};

/// How far from the line the robot's centre gets: at a sharp corner it goes on until the sensors
/// ahead of it have been off the line for a while.
const OFF_LINE_M: f64 = 0.12;

/// A step of the tutorial.
struct StepOfTutorial {
    name: &'static str,
    /// Robot time of its run, as the book has it.
    until_s: u64,
    /// What the run drives at least.
    least_m: f64,
    /// How often it stops before the box on the line.
    stops: usize,
    /// Transitions of the run, of which the book tells: time in milliseconds, from, to.
    told: &'static [(u64, &'static str, &'static str)],
}

const STEPS: [StepOfTutorial; 6] = [
    StepOfTutorial {
        name: "1_line",
        until_s: 12,
        least_m: 2.3,
        stops: 0,
        told: &[(0, "motion/initial", "motion/Follow")],
    },
    StepOfTutorial {
        name: "2_lost",
        until_s: 20,
        least_m: 3.3,
        stops: 0,
        told: &[
            (15_500, "motion/Follow", "motion/Search"),
            (16_300, "motion/Search", "motion/Follow"),
        ],
    },
    StepOfTutorial {
        name: "3_gap",
        until_s: 40,
        least_m: 5.8,
        stops: 0,
        told: &[
            (24_280, "motion/Follow", "motion/Ahead"),
            (24_700, "motion/Ahead", "motion/Follow"),
        ],
    },
    StepOfTutorial {
        name: "4_search",
        until_s: 50,
        least_m: 7.5,
        stops: 0,
        told: &[
            (
                17_920,
                "motion/SearchRight/watch/Watch",
                "motion/SearchRight/watch/final",
            ),
            (17_940, "motion/SearchRight", "motion/Follow"),
        ],
    },
    StepOfTutorial {
        name: "5_obstacle",
        until_s: 120,
        least_m: 14.5,
        stops: 1,
        told: &[
            (61_340, "safety/Watch", "safety/Wait"),
            (61_340, "motion/Drive", "motion/Halted"),
        ],
    },
    StepOfTutorial {
        name: "6_everything",
        until_s: 120,
        least_m: 15.0,
        stops: 1,
        told: &[],
    },
];

impl StepOfTutorial {
    fn file(&self) -> String {
        format!("missions/tutorial/{}.esm", self.name)
    }

    /// The plant after its run on the host board, and the trace.
    fn driven(&self) -> (Plant, String) {
        driven(&self.file(), self.until_s)
    }
}

/// The plant after a run of a mission on the host board, and the trace.
fn driven(file: &str, until_s: u64) -> (Plant, String) {
    let folder = tempfile::tempdir().unwrap();
    let blob = folder.path().join("step.blob");
    esm(&["build", file, "-o", blob.to_str().unwrap()]).good();
    let verified = esm_core::verify(std::fs::read(&blob).unwrap()).unwrap();
    let plan = Plan {
        until_us: Some(until_s * 1_000_000),
        ..Plan::new(
            Board::Host {
                robot: host_board::rover,
            },
            load_world(&root().join("missions/worlds/track.world")).unwrap(),
            vec![Planned::first(Mission::new(&blob, verified).unwrap())],
        )
    };
    let interrupt = Interrupt::take_over().unwrap();
    let run = drive::drive(plan, Vec::new(), interrupt, &mut |_| ()).unwrap();
    assert!(run.summary.fault.is_none(), "{file}");
    (run.plant, String::from_utf8(run.told.out).unwrap())
}

#[test]
fn each_step_is_without_errors_and_warnings() {
    for step in &STEPS {
        let loaded = lang::load(&root().join(step.file())).unwrap();
        let complaints: Vec<_> = loaded.render(false).lines().map(str::to_owned).collect();
        // What a step does not use of the robot yet is no mistake of the step.
        let about_the_step = complaints.iter().any(|line| line.contains(&step.file()));
        assert!(!about_the_step, "{complaints:#?}");
        assert!(loaded.model.is_some(), "{complaints:#?}");
    }
}

#[test]
fn each_step_passes_its_scenario() {
    for step in &STEPS {
        let scenario = format!("missions/tutorial/{}.scenario", step.name);
        esm(&["sim", &step.file(), &scenario]).good();
    }
}

#[test]
fn each_step_stays_near_the_line_for_its_distance_and_stops_before_the_box() {
    for step in &STEPS {
        let (plant, trace) = step.driven();
        let what = step.name;
        for (t_ms, from, to) in step.told {
            let taken = has_taken(&trace, *t_ms, from, to);
            assert!(taken, "{what}: {from} -> {to} at {t_ms} ms");
        }
        assert_eq!(plant.collisions(), 0, "{what}");
        assert!(
            plant.distance_m() >= step.least_m,
            "{what}: {} m",
            plant.distance_m()
        );
        let path = plant.statistics().path();
        for sample in path {
            let off_m2 = squared_distance_to_line_m2(plant.world(), sample.pose.position);
            assert!(
                off_m2 < OFF_LINE_M * OFF_LINE_M,
                "{what}: {off_m2} m² off the line at {sample:?}"
            );
        }
        assert_eq!(stops_before_the_box(path), step.stops, "{what}");
    }
}

/// Whether a trace has a transition at this time.
fn has_taken(trace: &str, t_ms: u64, from: &str, to: &str) -> bool {
    let told = format!(r#""t_us":{},"event":"#, t_ms * 1_000);
    let states = format!(r#""from":"{from}","to":"{to}""#);
    let mut lines = trace.lines();
    lines.any(|line| line.contains(&told) && line.contains(&states))
}

const SOLUTIONS: &str = "missions/tutorial/solutions";

/// The transitions of a trace, a line each.
fn transitions(trace: &str) -> Vec<&str> {
    let lines = trace.lines();
    lines
        .filter(|line| line.contains(r#""kind":"transition""#))
        .collect()
}

#[test]
fn the_solutions_do_what_the_book_says_of_them() {
    let done = esm(&["test", SOLUTIONS]).good();
    assert!(
        done.out.contains("3 scenarios of 3 missions: 3 ok"),
        "{done:#?}"
    );
    let chapter = std::fs::read_to_string(root().join("docs/src/tutorial.md")).unwrap();
    let solution = |name: &str| {
        let file = format!("{SOLUTIONS}/{name}.esm");
        assert!(chapter.contains(&format!("(../../{file})")), "{file}");
        let loaded = lang::load(&root().join(&file)).unwrap();
        assert!(loaded.model.is_some(), "{}", loaded.render(false));
        file
    };
    // Each runs against the wall behind the first sharp corner, at whichever speed.
    for (file, until_s) in [(STEPS[0].file(), 30), (solution("1_line"), 60)] {
        let (plant, _) = driven(&file, until_s);
        let way_m = plant.distance_m();
        assert!(
            plant.collisions() == 1 && (3.4..3.6).contains(&way_m),
            "{file}: {way_m}"
        );
    }
    // It turns at the gap and drives back: to the left of it, on the line that leads there.
    let (plant, trace) = driven(&STEPS[1].file(), 30);
    assert!(has_taken(&trace, 20_480, "motion/Follow", "motion/Search"));
    let path = plant.statistics().path();
    let end = path.last().unwrap().pose;
    assert!(
        end.position.x_m < 2.7 && (end.heading_rad.rem_euclid(TAU) - PI).abs() < 0.7,
        "{end:?}"
    );

    let until_s = STEPS[2].until_s;
    let (_, before) = STEPS[2].driven();
    let (_, after) = driven(&solution("3_gap"), until_s);
    let (before, after) = (transitions(&before), transitions(&after));
    let first = before
        .iter()
        .zip(&after)
        .find(|(before, after)| before != after);
    let (before, after) = first.unwrap();
    for (line, t_ms) in [(before, 16_020), (after, 15_720)] {
        assert!(
            has_taken(line, t_ms, "motion/Ahead", "motion/TurnRight"),
            "{line}"
        );
    }
    let (_, before) = STEPS[3].driven();
    let (_, after) = driven(&solution("4_search"), STEPS[3].until_s);
    assert_eq!(transitions(&before), transitions(&after));

    let (plant, trace) = driven(&solution("5_obstacle"), STEPS[4].until_s);
    assert!(has_taken(&trace, 61_340, "motion/Drive", "motion/Halted"));
    assert!(has_taken(&trace, 62_380, "motion/Halted", "motion/About"));
    assert_eq!(plant.collisions(), 0);
}

/// What the book quotes of `esm check` is what it says.
#[test]
fn the_book_quotes_the_errors_as_they_are() {
    let chapter = std::fs::read_to_string(root().join("docs/src/tutorial.md")).unwrap();
    let text = std::fs::read_to_string(root().join(STEPS[0].file())).unwrap();
    let rover = root().join("missions/rover.esm");
    let text = text.replace("../rover.esm", rover.to_str().unwrap());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("line.esm");
    let mistakes = [
        (
            "path Look.line -> Follow.line;",
            "error[E008]: task state `Follow` needs data on port `line`, and no path leads there",
        ),
        (
            &format!("use {rover:?};"),
            "error[E002]: unknown task `LineSensor`",
        ),
    ];
    for (left_out, quoted) in mistakes {
        assert!(text.contains(left_out), "{left_out}");
        std::fs::write(&path, text.replace(left_out, "")).unwrap();
        let told = esm(&["check", path.to_str().unwrap()]).ended(1).err;
        assert!(told.contains(quoted) && chapter.contains(quoted), "{told}");
    }
}

fn squared_distance_to_line_m2(world: &World, point: Point) -> f64 {
    let pieces = world.lines.iter();
    let squared = pieces.map(|line| line.middle.squared_distance_m2(point));
    squared.fold(f64::INFINITY, f64::min)
}

/// How often it stood still for more than a second, less than 30 cm from the box to its rim, from
/// whichever side it comes.
fn stops_before_the_box(path: &[PathSample]) -> usize {
    const BOX: Point = Point::new(0.5, 0.95);
    const HALF_BOX_M: f64 = 0.08;
    const RADIUS_M: f64 = 0.12;
    let stands = |window: &[PathSample]| {
        let [first, .., last] = window else {
            return false;
        };
        let moved_m2 = first.pose.position.squared_distance_m2(last.pose.position);
        let to_box_m2 = last.pose.position.squared_distance_m2(BOX);
        // A centimetre: it turns around on the spot, not quite.
        let near_m = HALF_BOX_M + RADIUS_M + 0.3;
        moved_m2 < 1e-4 && to_box_m2 < near_m * near_m
    };
    let standing: Vec<bool> = path.windows(11).map(stands).collect();
    let begins = standing
        .windows(2)
        .filter(|pair| matches!(pair, [false, true]));
    begins.count()
}

/// The world's line is what the picture shows of a run.
#[test]
fn the_picture_of_a_run_shows_the_line() {
    let out = tempfile::tempdir().unwrap();
    let folder = out.path().to_str().unwrap();
    let mission = STEPS[0].file();
    esm(&[
        "run", &mission, "--board", "host", "--world", "track", "--until", "1 s", "--out", folder,
    ])
    .good();
    let picture = std::fs::read_to_string(out.path().join("path.svg")).unwrap();
    let world = load_world(&root().join("missions/worlds/track.world")).unwrap();
    let drawn = picture.matches("#b9bfc8").count();
    assert!(drawn >= world.lines.len(), "{drawn} pieces in {picture}");
}

#[test]
fn the_book_runs_each_step_as_it_is_tested() {
    let chapter = std::fs::read_to_string(root().join("docs/src/tutorial.md")).unwrap();
    for step in &STEPS {
        let (file, until_s) = (step.file(), step.until_s);
        let run =
            |board: &str| format!("esm run {file}{board} --world track --until '{until_s} s'");
        let told = chapter.contains(&run(" --board host")) || chapter.contains(&run(""));
        assert!(told, "{}", run(" --board host"));
    }
}
