//! Parameters that a host changes while the mission runs.

use esm_core::verify;
use host_tools::compile::compile;
use host_tools::lang::load_text;
use rt_firmware::link::message::{LinkError, Request};

use crate::robot::{Answer, Bench, with_robot};

/// Two instances of a container with one task state, each executed twice between two macro steps.
fn two_hogs(takes_us: u32) -> Vec<u8> {
    blob(&format!(
        "task Hog slot 2 {{ param takes_us: u32 = {takes_us}; }}
        container Inner {{ region r {{ task H: Hog; initial -> H; }} }}
        machine M {{
            region a {{ super A: Inner; initial -> A; }}
            region b {{ super B: Inner; initial -> B; }}
        }}"
    ))
}

/// Executions of both between two macro steps.
const IN_A_FRAME: usize = 4;

fn blob(tasks_and_machine: &str) -> Vec<u8> {
    let source = format!(
        "interpreter slot 1; slot 1 period 10 ms duration 1 ms; slot 2 period 5 ms duration 1 ms; {tasks_and_machine}"
    );
    let checked = load_text("m.esm", &source);
    assert!(!checked.has_errors(), "{:?}", checked.diagnostics);
    compile(&checked.model.unwrap(), &[0, 2_000]).unwrap()
}

fn hash(blob: &[u8]) -> u32 {
    verify(blob).unwrap().hash()
}

fn get(robot: &mut Bench<'_, '_, '_>, mission: u32, param: u16) -> Result<Answer, LinkError> {
    robot.ask(Request::Param { mission, param })
}

fn set(
    robot: &mut Bench<'_, '_, '_>,
    mission: u32,
    param: u16,
    value: u32,
) -> Result<Answer, LinkError> {
    robot.ask(Request::SetParam {
        mission,
        param,
        value,
    })
}

/// What the hogs said since the last time.
fn hogs(robot: &Bench<'_, '_, '_>) -> Vec<String> {
    robot.world.said()
}

#[test]
fn between_two_macro_steps_all_instances_see_one_value() {
    let blob = two_hogs(1);
    let mission = hash(&blob);
    with_robot(|robot| {
        robot.start(&blob);
        hogs(robot);
        let mut before = 1;
        // Asked for at all times of a frame.
        for value in 2..40 {
            robot.run_us(10_000 + 700 * u64::from(value));
            assert_eq!(
                set(robot, mission, 0, value),
                Ok(Answer::ParamSet { before })
            );
            before = value;
        }
        robot.run_us(25_000);
        let said = hogs(robot);
        let frames: Vec<_> = said.chunks(IN_A_FRAME).collect();
        for frame in &frames {
            assert!(frame.iter().all(|hog| *hog == frame[0]), "{frame:?}");
        }
        let mut values: Vec<_> = frames.iter().map(|frame| frame[0].as_str()).collect();
        values.dedup();
        let expected: Vec<_> = (1..40).map(|value| format!("hog {value}")).collect();
        assert_eq!(values, expected, "each value was in force");
        assert_eq!(robot.status().missed, 0);
    });
}

#[test]
fn a_mission_that_starts_or_starts_anew_has_its_own_values() {
    let (blob, other) = (two_hogs(1), two_hogs(2));
    let mission = hash(&blob);
    with_robot(|robot| {
        robot.start(&blob);
        let own = || Answer::Param {
            value: 1,
            of_mission: 1,
        };
        assert_eq!(get(robot, mission, 0), Ok(own()));
        assert_eq!(
            set(robot, mission, 0, 7),
            Ok(Answer::ParamSet { before: 1 })
        );
        let changed = Answer::Param {
            value: 7,
            of_mission: 1,
        };
        assert_eq!(get(robot, mission, 0), Ok(changed));
        robot.run_us(20_000);
        assert_eq!(robot.status().changed_params, 1);

        assert_eq!(robot.ask(Request::Stop), Ok(Answer::Done));
        assert_eq!(
            set(robot, mission, 0, 8),
            Ok(Answer::ParamSet { before: 7 })
        );
        assert_eq!(robot.ask(Request::Start), Ok(Answer::Done));
        assert_eq!(get(robot, mission, 0), Ok(own()));
        robot.run_us(20_000);
        assert_eq!(robot.status().changed_params, 0);

        assert_eq!(
            set(robot, mission, 0, 7),
            Ok(Answer::ParamSet { before: 1 })
        );
        robot.start(&other);
        assert_eq!(get(robot, mission, 0), Err(LinkError::OtherMission));
        assert_eq!(set(robot, mission, 0, 7), Err(LinkError::OtherMission));
        let own = Answer::Param {
            value: 2,
            of_mission: 2,
        };
        assert_eq!(get(robot, hash(&other), 0), Ok(own));
    });
}

#[test]
fn a_robot_takes_what_its_own_task_declares_and_no_more() {
    // What the mission says of bounds is not what counts.
    let blob = blob(
        "task Source slot 2 { out data count: u32; out flag high; param limit: u32 = 5; }
        machine M { region a { task S: Source; initial -> S; } }",
    );
    let mission = hash(&blob);
    with_robot(|robot| {
        assert_eq!(get(robot, mission, 0), Err(LinkError::NoMission));
        assert_eq!(set(robot, mission, 0, 5), Err(LinkError::NoMission));
        robot.start(&blob);
        let outside = Err(LinkError::ParamOutside {
            min: 1,
            max: 1_000_000,
        });
        assert_eq!(set(robot, mission, 0, 0), outside);
        assert_eq!(set(robot, mission, 0, 1_000_001), outside);
        assert_eq!(get(robot, mission, 1), Err(LinkError::NoSuchIndex));
        for param in [1, u16::MAX] {
            assert_eq!(
                set(robot, mission, param, 5),
                Err(LinkError::NoSuchIndex),
                "{param}"
            );
        }
        assert_eq!(
            set(robot, mission, 0, 1_000_000),
            Ok(Answer::ParamSet { before: 5 })
        );
        robot.run_us(20_000);
        assert_eq!(robot.status().changed_params, 1);
    });
}
