//! Warm swaps on a robot: tasks, nets, time and slots go on.

use esm_link::message::{LinkError, Mode, Request, Swap};

use crate::SLOTS;
use crate::mission::Mission;
use crate::robot::{Answer, Bench, signature, with_robot};

/// A source that a sink of this number listens to. With more states before them all tasks have
/// other numbers.
pub fn listening(name: u32, with_more: bool) -> Vec<u8> {
    let mission = Mission::new(&SLOTS)
        .task(signature::SOURCE, None)
        .task(signature::SINK, None)
        .task(signature::HOG, None);
    let first = ["initial -> Count"];
    let second = ["initial -> Listen"];
    let (source, sink, wait) = (
        ("Count", "Source", 2, &[1_000][..]),
        ("Listen", "Sink", 2, &[name][..]),
        ("Wait", "Hog", 2, &[1][..]),
    );
    let other = ("Other", "Sink", 2, &[99][..]);
    let mission = if with_more {
        mission
            .region(&[other, source], &first)
            .region(&[wait, sink], &second)
            .path((0, 1, 0), (1, 1, 0))
    } else {
        mission
            .region(&[source], &first)
            .region(&[sink], &second)
            .path((0, 0, 0), (1, 0, 0))
    };
    mission.blob()
}

fn swap(
    robot: &mut Bench<'_, '_, '_>,
    blob: &[u8],
    warm: bool,
    trial_ms: u32,
) -> Result<Answer, LinkError> {
    robot.send(blob);
    let swapped = robot.ask(Request::Commit(Swap { warm, trial_ms }));
    // What comes from here on is the new mission's.
    robot.world.said();
    swapped
}

/// A robot on which the source has counted to seven.
fn counted_to_seven(test: impl FnOnce(&mut Bench<'_, '_, '_>)) {
    with_robot(|robot| {
        robot.start(&listening(1, false));
        robot.run_us(36_000);
        let said = robot.world.said();
        assert_eq!(said.last().map(String::as_str), Some("sink 1 reads 7"));
        test(robot);
    });
}

#[test]
fn tasks_and_values_go_on_where_they_were() {
    for with_more in [false, true] {
        counted_to_seven(|robot| {
            assert!(swap(robot, &listening(2, with_more), true, 0).is_ok());
            robot.run_us(20_000);
            let said = robot.world.said();
            // Nothing is entered anew, and time goes on: 2 ms after each 5.
            assert_eq!(
                said[..4],
                [
                    "source 9 at 42000",
                    "sink 2 reads 9",
                    "source 10 at 47000",
                    "sink 2 reads 10"
                ],
                "{with_more}: {said:?}"
            );
            let status = robot.status();
            assert_eq!((status.mode, status.missed), (Mode::Running, 0));
            assert!(robot.task(u16::from(with_more)).enabled, "{with_more}");
        });
    }
}

#[test]
fn a_cold_swap_and_one_of_a_robot_that_stands_start_anew() {
    counted_to_seven(|robot| {
        assert!(swap(robot, &listening(2, true), false, 0).is_ok());
        robot.run_us(10_000);
        assert_eq!(robot.world.said()[0], "source enters");
    });
    counted_to_seven(|robot| {
        robot.ask(Request::Stop).unwrap();
        assert!(swap(robot, &listening(2, true), true, 0).is_ok());
        robot.ask(Request::Start).unwrap();
        robot.run_us(10_000);
        assert_eq!(robot.world.said()[0], "source enters");
    });
}

#[test]
fn missions_can_follow_each_other_warm_for_ever_and_fall_back_cold() {
    counted_to_seven(|robot| {
        for round in 0..20 {
            let next = listening(round, round % 2 == 0);
            assert!(swap(robot, &next, true, 0).is_ok());
            robot.run_us(10_000);
            let said = robot.world.said();
            assert!(!said.iter().any(|said| said == "source enters"), "{said:?}");
        }
        assert_eq!(robot.status().missed, 0);
        assert!(swap(robot, &listening(50, false), true, 50).is_ok());
        robot.run_us(20_000);
        robot.world.said();
        robot.run_us(60_000);
        let said = robot.world.said();
        assert!(
            said.iter().any(|said| said == "source enters"),
            "the one before starts anew: {said:?}"
        );
        assert_eq!(robot.status().missed, 0);
    });
}

#[test]
fn who_held_a_group_holds_it_still() {
    let hogs = |more: bool| {
        let mission = Mission::new(&SLOTS).task(signature::HOG, Some("motion"));
        let first = ("First", "Hog", 2, &[1][..]);
        let second = ("Second", "Hog", 2, &[2][..]);
        let simple = ("Simple", "", 0, &[][..]);
        let states = if more {
            [[simple, second], [simple, first]]
        } else {
            [[simple, second], [first, simple]]
        };
        // The second region's is entered first.
        mission
            .region(&states[0], &["initial -> Simple", "Simple -> Second"])
            .region(&states[1], &["initial -> First"])
            .blob()
    };
    with_robot(|robot| {
        robot.start(&hogs(false));
        robot.run_us(50_000);
        robot.world.said();
        assert!(swap(robot, &hogs(true), true, 0).is_ok());
        robot.run_us(20_000);
        let said = robot.world.said();
        assert!(
            !said.is_empty() && said.iter().all(|said| said == "hog 1"),
            "{said:?}"
        );
    });
}

#[test]
fn a_run_in_slot_0_begins_anew() {
    let thinking = |name: u32| {
        Mission::new(&SLOTS)
            .task(signature::THINKER, None)
            .task(signature::HOG, None)
            .region(
                &[("Think", "Thinker", 0, &[]), ("Done", "", 0, &[])],
                &["initial -> Think", "Think -> Done [exit]"],
            )
            .region(&[("Hog", "Hog", 2, &[name])], &["initial -> Hog"])
            .blob()
    };
    with_robot(|robot| {
        robot.background_runs = false;
        robot.start(&thinking(1));
        robot.run_us(30_000);
        robot.background.poll();
        assert!(robot.world.said().contains(&"thinks 1 of None".to_owned()));
        assert!(swap(robot, &thinking(2), true, 0).is_ok());
        robot.background_runs = true;
        robot.run_us(40_000);
        let said = robot.world.said();
        let thoughts: Vec<&str> = said
            .iter()
            .map(String::as_str)
            .filter(|said| said.starts_with("thinks"))
            .collect();
        // What is left of the old run, of which nothing is kept; then a whole one.
        let run = ["thinks 1 of None", "thinks 2 of None", "thinks 3 of None"];
        assert_eq!(thoughts, [&run[1..], &run[..]].concat());
    });
}
