//! Parameters that a host changes while the mission runs.

use esm_link::message::{LinkError, Request};
use host_tools::compile::compile;
use host_tools::lang::load_text;
use rt_firmware::realtime::params::SavedParams;

use crate::mission::hash;
use crate::robot::{Answer, Bench, Memo, TICKS_PER_US, with_robot};

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
            saved: None,
        };
        assert_eq!(get(robot, mission, 0), Ok(own()));
        assert_eq!(
            set(robot, mission, 0, 7),
            Ok(Answer::ParamSet { before: 1 })
        );
        let changed = Answer::Param {
            value: 7,
            of_mission: 1,
            saved: None,
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
            saved: None,
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

/// A robot with a flash, that forgets all else at a start.
fn restarted(keeps: &mut Memo, test: impl FnOnce(&mut Bench<'_, '_, '_>)) {
    with_robot(|robot| {
        keeps.is_there = true;
        std::mem::swap(&mut robot.wire.memory, keeps);
        test(robot);
        std::mem::swap(&mut robot.wire.memory, keeps);
    });
}

fn save(robot: &mut Bench<'_, '_, '_>, mission: u32) -> Result<Answer, LinkError> {
    robot.ask(Request::SaveParams { mission })
}

fn value_of(value: u32, of_mission: u32, saved: Option<u32>) -> Result<Answer, LinkError> {
    Ok(Answer::Param {
        value,
        of_mission,
        saved,
    })
}

#[test]
fn a_mission_starts_with_what_was_saved_for_it_and_no_other_does() {
    let (blob, other) = (two_hogs(1), two_hogs(2));
    let (mission, another) = (hash(&blob), hash(&other));
    let mut flash = Memo::default();
    restarted(&mut flash, |robot| {
        robot.start(&blob);
        assert_eq!(
            set(robot, mission, 0, 7),
            Ok(Answer::ParamSet { before: 1 })
        );
        assert_eq!(get(robot, mission, 0), value_of(7, 1, None));
        assert_eq!(save(robot, another), Err(LinkError::OtherMission));
        assert_eq!(save(robot, mission), Ok(Answer::ParamsSaved { count: 1 }));
        assert_eq!(get(robot, mission, 0), value_of(7, 1, Some(7)));
        let status = robot.status();
        assert_eq!((status.changed_params, status.saved_params), (1, 1));

        // What is changed after that is forgotten.
        set(robot, mission, 0, 8).unwrap();
        assert_eq!(get(robot, mission, 0), value_of(8, 1, Some(7)));
        robot.ask(Request::Stop).unwrap();
        robot.ask(Request::Start).unwrap();
        assert_eq!(get(robot, mission, 0), value_of(7, 1, Some(7)));
        hogs(robot);
        robot.run_us(25_000);
        let said = hogs(robot);
        assert!(
            said.len() >= IN_A_FRAME && said.iter().all(|hog| hog == "hog 7"),
            "{said:?}"
        );

        robot.start(&other);
        assert_eq!(get(robot, another, 0), value_of(2, 2, None));
        assert_eq!(robot.status().saved_params, 0);
        robot.start(&blob);
        assert_eq!(get(robot, mission, 0), value_of(7, 1, Some(7)));
    });
    restarted(&mut flash, |robot| {
        robot.start(&other);
        assert_eq!(get(robot, another, 0), value_of(2, 2, None));
        robot.start(&blob);
        assert_eq!(get(robot, mission, 0), value_of(7, 1, Some(7)));
        assert_eq!(robot.status().missed, 0);

        // Nothing differs: nothing is saved.
        set(robot, mission, 0, 1).unwrap();
        assert_eq!(get(robot, mission, 0), value_of(1, 1, Some(7)));
        assert_eq!(save(robot, mission), Ok(Answer::ParamsSaved { count: 0 }));
        assert_eq!(get(robot, mission, 0), value_of(1, 1, None));
        robot.start(&blob);
        assert_eq!(get(robot, mission, 0), value_of(1, 1, None));
    });
    restarted(&mut flash, |robot| {
        robot.start(&blob);
        assert_eq!(get(robot, mission, 0), value_of(1, 1, None));
    });
}

#[test]
fn a_mission_that_comes_back_from_a_trial_has_what_was_saved_for_it() {
    let (blob, other) = (two_hogs(1), two_hogs(2));
    let (mission, another) = (hash(&blob), hash(&other));
    restarted(&mut Memo::default(), |robot| {
        robot.start(&blob);
        set(robot, mission, 0, 7).unwrap();
        save(robot, mission).unwrap();
        robot.try_out(&other, 1_000);
        set(robot, another, 0, 9).unwrap();
        assert_eq!(save(robot, another), Err(LinkError::OnTrial));
        robot.ask(Request::FallBack { mission: another }).unwrap();
        assert_eq!(get(robot, mission, 0), value_of(7, 1, Some(7)));
    });
}

#[test]
fn a_value_for_a_mission_whose_trial_ends_meanwhile_is_not_given_to_the_mission_before() {
    let (blob, other) = (two_hogs(1), two_hogs(2));
    let (mission, another) = (hash(&blob), hash(&other));
    with_robot(|robot| {
        robot.start(&blob);
        robot.try_out(&other, 100);
        // Its last macro step is behind it, and the next one is that of the mission before.
        let over_us = robot.world.now_us() + 100_000;
        robot.run_until_us(over_us - over_us % 10_000 - 3_000);
        assert_eq!(robot.status().mission, Some(another));
        let frame = robot.frame(Request::SetParam {
            mission: another,
            param: 0,
            value: 9,
        });
        robot.wire.to_robot.extend(frame);
        let asked = robot.last_number();
        let mut answers = robot.exchange();
        while answers.is_empty() {
            let next_ticks = robot.timer();
            answers = robot.exchange();
            let us = (next_ticks / TICKS_PER_US).saturating_sub(robot.world.now_us());
            robot.world.pass_us(us);
        }
        assert_eq!(answers, [(asked, Err(LinkError::OtherMission))]);
        assert_eq!(robot.status().mission, Some(mission));
        assert_eq!(get(robot, mission, 0), value_of(1, 1, None));
    });
}

#[test]
fn what_the_flash_does_not_take_is_not_counted_on_and_a_robot_without_one_says_so() {
    let blob = two_hogs(1);
    let mission = hash(&blob);
    with_robot(|robot| {
        robot.start(&blob);
        set(robot, mission, 0, 7).unwrap();
        assert_eq!(save(robot, mission), Err(LinkError::NoStore));
    });
    restarted(&mut Memo::default(), |robot| {
        assert_eq!(save(robot, mission), Err(LinkError::NoMission));
        robot.start(&blob);
        set(robot, mission, 0, 7).unwrap();
        robot.wire.memory.is_worn = true;
        assert_eq!(save(robot, mission), Err(LinkError::FlashRefused));
        assert_eq!(get(robot, mission, 0), value_of(7, 1, None));
        robot.ask(Request::Stop).unwrap();
        robot.ask(Request::Start).unwrap();
        assert_eq!(get(robot, mission, 0), value_of(1, 1, None));
    });
}

#[test]
fn a_value_that_this_firmware_does_not_take_is_not_used_and_told() {
    let blob = blob(
        "task Source slot 2 { out data count: u32; out flag high; param limit: u32 = 5; }
        machine M { region a { task S: Source; initial -> S; } }",
    );
    let mission = hash(&blob);
    for (param, value, expected) in [
        (0, 0, value_of(5, 5, Some(0))),
        (0, 1_000_001, value_of(5, 5, Some(1_000_001))),
        (0, 1_000_000, value_of(1_000_000, 5, Some(1_000_000))),
        (7, 6, value_of(5, 5, None)),
    ] {
        let mut bytes = mission.to_le_bytes().to_vec();
        bytes.extend(u16::to_le_bytes(param));
        bytes.extend(u32::to_le_bytes(value));
        let mut flash = Memo {
            saved: Some(SavedParams::from_bytes(&bytes)),
            ..Memo::default()
        };
        restarted(&mut flash, |robot| {
            robot.start(&blob);
            assert_eq!(get(robot, mission, 0), expected, "{param}: {value}");
            assert_eq!(robot.status().saved_params, 1);
        });
    }
}
