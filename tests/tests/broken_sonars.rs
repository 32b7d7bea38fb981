//! Each mission that ships, with each sonar broken in each way while it drives: no robot runs into
//! a wall at more than a slow speed.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use esm_tests::command::root;
use esm_tests::host_drive;
use host_tools::files::load_world;
use host_tools::lockstep::plant_side::SonarBreak;
use host_tools::plant::SonarFault;
use host_tools::run::drive::Plan;
use rt_firmware::body::SONARS;
use serde_json::Value;

/// When a sonar breaks: the robots are on their way then.
const BREAK_S: u64 = 5;
/// And how long they are watched in all.
const RUN_S: u64 = 20;

/// A robot that is slower than this is slow, in metres per second: 0.15 is what `Back`, and
/// `RoundCorner` in a mission, ask for, and what the wheels make of it is a little more. The
/// missions drive at 0.3 where they see that the way is free.
const SLOW_M_PER_S: f64 = 0.18;

/// The sonars that break alone: those ahead and to the right, where the missions drive, and the one
/// behind.
const TRIED: [usize; 4] = [0, 4, 6, 7];

/// A mission that drives, and a world for it.
struct Subject {
    mission: &'static str,
    world: &'static str,
}

const SUBJECTS: [Subject; 7] = [
    Subject {
        mission: "missions/patrol.esm",
        world: "office",
    },
    Subject {
        mission: "missions/follow_wall.esm",
        world: "corridor",
    },
    Subject {
        mission: "missions/watch_timing.esm",
        world: "office",
    },
    Subject {
        mission: "missions/on_a_lead.esm",
        world: "corridor",
    },
    Subject {
        mission: "missions/square.esm",
        world: "empty",
    },
    Subject {
        mission: "missions/tutorial/5_obstacle.esm",
        world: "track",
    },
    Subject {
        mission: "missions/tutorial/6_everything.esm",
        world: "track",
    },
];

/// How a run ended.
struct Ended {
    collisions: u32,
    hardest_m_per_s: f64,
    /// Way in metres from two seconds after the sonar has broken: along both axes, so no shorter
    /// than it is.
    later_m: f64,
    trace: String,
}

impl Subject {
    fn driven(&self, sonar_breaks: Vec<SonarBreak>) -> Ended {
        let world = format!("missions/worlds/{}.world", self.world);
        let world = load_world(&root().join(world)).unwrap();
        let run = host_drive::driven(Plan {
            until_us: Some(RUN_S * 1_000_000),
            sonar_breaks,
            ..host_drive::plan(&root().join(self.mission), world)
        });
        let later = |t_us: u64| t_us >= (BREAK_S + 2) * 1_000_000;
        let path = run.plant.statistics().path();
        let pieces = path.iter().zip(&path[1..]);
        let later_m = (pieces.filter(|(from, _)| later(from.t_us)))
            .map(|(from, to)| {
                let (from, to) = (from.pose.position, to.pose.position);
                (to.x_m - from.x_m).abs() + (to.y_m - from.y_m).abs()
            })
            .sum();
        Ended {
            collisions: run.plant.collisions(),
            hardest_m_per_s: run.plant.hardest_collision_m_per_s(),
            later_m,
            trace: String::from_utf8(run.told.out).unwrap(),
        }
    }
}

fn broken(sonar: usize, fault: SonarFault) -> SonarBreak {
    SonarBreak {
        sonar,
        fault,
        robot_us: BREAK_S * 1_000_000,
    }
}

fn says_fault(trace: &str) -> bool {
    let lines = trace
        .lines()
        .map(|line| serde_json::from_str::<Value>(line).unwrap());
    lines
        .filter(|line| line["kind"] == "transition")
        .any(|line| line["to"] == "sonars/Broken")
}

/// The law of all of them, for each sonar alone.
fn each_sonar(subject: &Subject, fault: SonarFault) {
    for sonar in TRIED {
        let ended = subject.driven(vec![broken(sonar, fault)]);
        let what = format!("{}, sonar {sonar} {fault}", subject.mission);
        println!(
            "{what}: {} collisions, {:.3} m/s, {:.2} m later, {}",
            ended.collisions,
            ended.hardest_m_per_s,
            ended.later_m,
            says_fault(&ended.trace)
        );
        assert!(ended.hardest_m_per_s <= SLOW_M_PER_S, "{what}");
        if fault == SonarFault::Dead {
            assert_eq!(ended.collisions, 0, "{what}");
            assert!(says_fault(&ended.trace), "{what}");
            assert!(ended.later_m < 0.1, "{what}: {} m", ended.later_m);
        }
    }
}

/// And for all of them together: nobody sees anything.
fn all_sonars(subject: &Subject, fault: SonarFault) {
    let breaks = (0..SONARS).map(|sonar| broken(sonar, fault)).collect();
    let ended = subject.driven(breaks);
    let what = format!("{}, all sonars {fault}", subject.mission);
    println!(
        "{what}: {} collisions, {:.3} m/s",
        ended.collisions, ended.hardest_m_per_s
    );
    assert_eq!(ended.collisions, 0, "{what}");
}

#[test]
fn a_mission_with_all_its_sonars_drives_and_says_nothing_of_a_fault() {
    for subject in &SUBJECTS {
        let ended = subject.driven(Vec::new());
        let what = subject.mission;
        assert_eq!(ended.collisions, 0, "{what}");
        assert!(!says_fault(&ended.trace), "{what}");
        assert!(ended.later_m > 1.0, "{what}: {} m", ended.later_m);
    }
}

#[test]
fn a_dead_sonar_stops_each_mission() {
    for subject in &SUBJECTS {
        each_sonar(subject, SonarFault::Dead);
        all_sonars(subject, SonarFault::Dead);
    }
}

#[test]
fn a_deaf_sonar_lets_no_mission_run_fast_into_a_wall() {
    for subject in &SUBJECTS {
        each_sonar(subject, SonarFault::Deaf);
    }
}

#[test]
fn a_blind_sonar_lets_no_mission_run_fast_into_a_wall() {
    for subject in &SUBJECTS {
        each_sonar(subject, SonarFault::Blind);
        all_sonars(subject, SonarFault::Blind);
    }
}
