//! Whole runs on the host board.

use super::board::{Board, LinkWay};
use super::drive::{Heard, Plan, Planned, Run, RunError, drive};
use super::mission::Mission;
use crate::host_board;
use crate::interrupt::Interrupt;
use crate::lockstep::plant_side::PlantFault;
use esm_toolkit::compile::compile;
use esm_toolkit::compile::test_models::{container, flag, model, port, pulse, region, state, task};
use esm_toolkit::model::{
    Action, DataPort, Direction, Model, Param, ParamType, Path, PathEnd, SlotRef, Span, StateKind,
    Task, Trigger, Value,
};
use esm_toolkit::recording::entered::Entered;
use esm_toolkit::recording::file::BackgroundRunEnd;
use esm_toolkit::world::World;

/// A port of the rover that wants values of the last five periods, and does without.
fn fresh(name: &str, type_name: &str) -> DataPort {
    DataPort {
        optional: true,
        within_us: Some(100_000),
        ..port(name, Direction::In, type_name)
    }
}

/// A port that does without values.
fn spare(name: &str, type_name: &str) -> DataPort {
    DataPort {
        optional: true,
        ..port(name, Direction::In, type_name)
    }
}

/// Tasks of the rover, in the order of [`State`]s below.
fn tasks() -> Vec<Task> {
    let with = |name: &str, ports: &[(&str, Direction, &str)], params: &[&str]| Task {
        data: ports
            .iter()
            .map(|(name, direction, type_name)| port(name, *direction, type_name))
            .collect(),
        params: params
            .iter()
            .map(|name| Param {
                name: (*name).to_owned(),
                param_type: ParamType::F32,
                default: None,
                range: None,
                docs: String::new(),
                span: Span::default(),
            })
            .collect(),
        ..task(name, Vec::new())
    };
    use Direction::{In, Out};
    vec![
        Task {
            data: vec![
                spare("yaw_rate", "YawRate"),
                port("pose", Out, "Pose"),
                port("speeds", Out, "WheelSpeeds"),
            ],
            ..with("Odometry", &[], &[])
        },
        Task {
            flags: vec![flag("blocked", Out)],
            data: vec![
                fresh("twist", "Twist"),
                fresh("speeds", "WheelSpeeds"),
                port("control", Out, "WheelControl"),
            ],
            ..with(
                "WheelSpeed",
                &[],
                &[
                    "acceleration_m_per_s2",
                    "jerk_m_per_s3",
                    "proportional_s_per_m",
                    "integral_per_m",
                ],
            )
        },
        Task {
            flags: vec![flag("low", Out)],
            ..with("BatteryMonitor", &[("battery", Out, "Battery")], &["low_v"])
        },
        Task {
            data: vec![
                port("pose", In, "Pose"),
                port("battery", In, "Battery"),
                spare("control", "WheelControl"),
            ],
            ..with("Logger", &[], &[])
        },
        Task {
            flags: vec![flag("left", In)],
            data: vec![fresh("pose", "Pose"), port("twist", Out, "Twist")],
            ..with("Turn", &[], &["angle_rad", "rate_rad_per_s"])
        },
    ]
}

/// A robot that turns on the spot, by `angle_rad` each time, and keeps a diary.
fn turning(angle_rad: f32) -> Model {
    let task_state = |name: &str, task, slot, params: &[f32]| {
        let params = params.iter().map(|value| Value::F32(*value)).collect();
        state(name, StateKind::Task { task, slot, params })
    };
    let real_time = SlotRef::Slot(1);
    let always = |name: &str, state| region(name, vec![state], vec![pulse(None, Some(0))]);
    let regions = vec![
        always("pose", task_state("Pose", 0, real_time, &[])),
        always(
            "wheels",
            task_state("Wheels", 1, real_time, &[1.0, 30.0, 0.8, 4.0]),
        ),
        always("battery", task_state("Battery", 2, real_time, &[6.0])),
        region(
            "diary",
            vec![task_state("Write", 3, SlotRef::NonRealTime, &[])],
            vec![
                pulse(None, Some(0)),
                pulse(Some(0), Some(0)).on(Trigger::Star),
            ],
        ),
        region(
            "motion",
            vec![task_state("Turn", 4, real_time, &[angle_rad, 1.2])],
            vec![
                pulse(None, Some(0)).act(Action::Own(0, true)),
                pulse(Some(0), Some(0))
                    .on(Trigger::Star)
                    .act(Action::Own(0, true)),
            ],
        ),
    ];
    let end = |region, port| PathEnd::State {
        region,
        state: 0,
        port,
    };
    let path = |from, to: &[PathEnd]| Path {
        from: vec![from],
        to: to.to_vec(),
        span: Span::default(),
    };
    let mut machine = container("Turning", &[], regions);
    machine.paths = vec![
        path(end(0, 1), &[end(3, 0), end(4, 0)]),
        path(end(0, 2), &[end(1, 1)]),
        path(end(2, 0), &[end(3, 1)]),
        path(end(4, 1), &[end(1, 0)]),
    ];
    let mut turning = model(&[], tasks(), vec![machine]);
    for slot in &mut turning.slots {
        (slot.period_us, slot.duration_us) = (20_000, 5_000);
    }
    turning
}

fn mission(name: &str, model: &Model) -> Mission {
    let blob = compile(model, &[0, 5_000]).unwrap();
    let verified = esm_core::verify(blob)
        .map_err(|(_, refusal)| refusal)
        .unwrap();
    Mission::new(std::path::Path::new(name), verified).unwrap()
}

fn plan(missions: Vec<(u64, Mission)>, replay: Option<Entered>) -> Plan {
    let world = World::parse("world cell\n start 1,1 0\n wall 0,0 3,0 3,3 0,3 0,0").unwrap();
    let board = Board::Host {
        robot: host_board::rover,
    };
    let missions = missions.into_iter().map(|(at_us, mission)| Planned {
        at_us,
        ..Planned::first(mission)
    });
    Plan {
        seed: 3,
        until_us: Some(6_000_000),
        replay,
        ..Plan::new(board, world, missions.collect())
    }
}

fn carried_out(plan: Plan) -> Run<Vec<u8>> {
    let interrupt = Interrupt::take_over().unwrap();
    let run = drive(plan, Vec::new(), interrupt, &mut |_: Heard<'_>| ()).unwrap();
    if let Some(path) = std::env::var_os("ESM_DUMP") {
        std::fs::write(path, &run.told.out).unwrap();
    }
    run
}

#[test]
fn equal_runs_have_equal_traces_up_to_the_last_macro_step() {
    if let Some(path) = std::env::var_os("ESM_BLOB") {
        std::fs::write(path, &mission("turning.esm", &turning(1.0)).blob).unwrap();
    }
    let run = || carried_out(plan(vec![(0, mission("turning.esm", &turning(1.0)))], None));
    let (first, second) = (run(), run());
    let text = String::from_utf8(first.told.out).unwrap();
    assert_eq!(text.as_bytes(), second.told.out);
    let steps = text
        .lines()
        .filter(|line| line.contains("\"kind\":\"step\""));
    assert_eq!(steps.count(), 301, "one each 20 ms, the last one at 6 s");
    assert!(text.lines().last().unwrap().contains("\"t_us\":6000000"));
    assert!(
        text.contains("\"from\":\"motion/Turn\",\"to\":\"motion/Turn\""),
        "it turns and turns"
    );
    assert_eq!(first.summary.slots_missed, 0);
    assert_eq!(first.summary.collisions, 0);
    assert_eq!(first.plant.now_us(), 6_000_000);
    assert!(first.plant.pose().heading_rad > 4.0);
}

#[test]
fn a_mission_takes_over_at_its_time_and_a_replay_is_the_same_run() {
    let missions = || {
        vec![
            (0, mission("one.esm", &turning(1.0))),
            (3_000_000, mission("two.esm", &turning(0.5))),
        ]
    };
    let first = carried_out(plan(missions(), None));
    assert_eq!(first.entered.starts_us, [0, 3_000_000]);
    assert!(
        !first.entered.ends.is_empty(),
        "the diary is written in slot 0"
    );
    // Both slots start once each 20 ms; the macro step at 6 s is the last thing that is executed.
    let executed: Vec<Vec<u32>> = (first.summary.missions.iter())
        .map(|mission| mission.slots.iter().map(|slot| slot.executed).collect())
        .collect();
    assert_eq!(executed, [[150, 150], [151, 150]]);
    let last = &first.summary.missions[1].slots[0];
    assert_eq!((last.slot, last.missed, last.overruns), (1, 0, 0));
    let summary = first.summary.to_string();
    assert!(
        summary.contains("slot 1                   151 executed"),
        "{summary}"
    );
    let entered = first.entered.clone();
    let again = carried_out(plan(missions(), Some(entered.clone())));
    assert_eq!(first.told.out, again.told.out);
    assert_eq!(again.entered, entered);
    let late = |end: &BackgroundRunEnd| BackgroundRunEnd {
        activation: end.activation + 7,
        ..*end
    };
    let mut other = entered;
    other.ends = other.ends.iter().map(late).collect();
    let other = carried_out(plan(missions(), Some(other)));
    assert_ne!(
        first.told.out, other.told.out,
        "ends come from the recording"
    );
}

#[test]
fn uploads_in_virtual_time_take_what_the_wire_takes_and_repeat() {
    let run = || {
        let missions = vec![
            (0, mission("one.esm", &turning(1.0))),
            (2_000_000, mission("two.esm", &turning(0.5))),
        ];
        carried_out(Plan {
            link: LinkWay::Exchange,
            ..plan(missions, None)
        })
    };
    let (first, second) = (run(), run());
    assert_eq!(first.told.out, second.told.out);
    assert_eq!(first.summary, second.summary);
    let [_, next] = &first.summary.missions[..] else {
        panic!("two missions: {:?}", first.summary)
    };
    // What is asked before and after the bytes takes a tenth of a second at most.
    let on_the_wire_s = next.bytes as f64 * 10.0 / 115_200.0;
    let late_s = next.upload_s - on_the_wire_s;
    assert!((0.0..0.1).contains(&late_s), "{next:?}");
    assert!(next.started_s >= 2.0 + on_the_wire_s, "{next:?}");
    assert_eq!(first.summary.slots_missed, 0);
}

#[test]
fn a_run_whose_body_falls_silent_ends_in_time_and_says_why() {
    let mut plan = plan(vec![(0, mission("one.esm", &turning(1.0)))], None);
    plan.plant_fault = Some(PlantFault::FrozenFrom {
        robot_us: 2_000_000,
    });
    let run = carried_out(plan);
    assert_eq!(
        run.summary.fault.as_deref(),
        Some("the robot's body does not answer")
    );
    let text = String::from_utf8(run.told.out).unwrap();
    // Six exchanges in a row without an answer, from two seconds on: the machine stops in the
    // sixth.
    assert!(
        text.lines().last().unwrap().contains("\"t_us\":2040000"),
        "{}",
        text.lines().last().unwrap()
    );
    assert_eq!(run.plant.now_us(), 1_985_000, "the last exchange before");
    assert_eq!(run.summary.robot_time_s, 6.0);
}

#[test]
fn a_replay_of_other_missions_is_refused() {
    let one = || vec![(0, mission("one.esm", &turning(1.0)))];
    let mut entered = carried_out(plan(one(), None)).entered;
    entered.missions = vec![0];
    let interrupt = Interrupt::take_over().unwrap();
    let refused = drive(
        plan(one(), Some(entered)),
        Vec::new(),
        interrupt,
        &mut |_| (),
    );
    assert!(matches!(refused, Err(RunError::OtherMissions { .. })));
}

#[test]
fn a_mission_with_a_task_that_the_robot_lacks_is_refused_by_its_name() {
    let mut stranger = turning(1.0);
    for task in &mut stranger.tasks {
        if task.name == "Turn" {
            task.name = "Somersault".into();
        }
    }
    let interrupt = Interrupt::take_over().unwrap();
    let plan = plan(vec![(0, mission("stranger.esm", &stranger))], None);
    match drive(plan, Vec::new(), interrupt, &mut |_| ()) {
        Err(error @ RunError::Refused { .. }) => {
            assert!(error.to_string().contains("`Somersault`"), "{error}");
        }
        _ => panic!("it was taken"),
    }
}
