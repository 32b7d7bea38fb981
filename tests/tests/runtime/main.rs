//! The runtime with toy tasks: what slots, tasks, background runs and the link do, on the host.

#![allow(clippy::unwrap_used, reason = "helpers of tests fail as tests do")]

mod conformance;
mod emergency;
mod exchange;
mod keeping;
mod keys;
mod mission;
mod parameters;
mod readiness;
mod robot;
mod streams;
mod trials;
mod values;
mod warm;

use std::time::Duration;

use esm_core::format::crc32;
use esm_core::signature::fnv1a;
use esm_link::access::Access;
use esm_link::frame::checksum;
use esm_link::message::{Capacity, LinkError, MAX_CHUNK, Mode, Request, SafeReason, Swap};
use host_tools::schedule::handover::{Handover, SlotTable, lay_out};
use host_tools::time::work_limit;
use mission::Mission;
use robot::{Answer, BLOB_BYTES, signature, with_robot};

/// Interpreter every 10 ms, and a second slot every 5 ms, 2 ms after it.
const SLOTS: [(u32, u32, u32); 2] = [(10_000, 1_000, 0), (5_000, 1_000, 2_000)];

/// A source in slot 2 that is entered at once and left when it is finished.
fn counting(limit: u32) -> Mission {
    Mission::new(&SLOTS).task(signature::SOURCE, None).region(
        &[("Count", "Source", 2, &[limit]), ("Rest", "", 0, &[])],
        &["initial -> Count", "Count -> Rest [exit]"],
    )
}

/// A hog in slot 2 that takes so long.
fn hogging(takes_us: u32) -> Mission {
    Mission::new(&SLOTS)
        .task(signature::HOG, None)
        .region(&[("Hog", "Hog", 2, &[takes_us])], &["initial -> Hog"])
}

#[test]
fn a_mission_runs_from_its_upload_on() {
    with_robot(|robot| {
        assert_eq!(
            robot.ask(Request::Hello),
            Ok(Answer::Hello("toy 0.1 bench".into(), Access::Unsupported))
        );
        assert_eq!(robot.status().mode, Mode::Empty);
        assert_eq!(
            robot.ask(Request::Subscribe {
                trace: true,
                log: false,
                record: false,
            }),
            Ok(Answer::Done)
        );
        let blob = counting(3).blob();
        let hash = u32::from_le_bytes(*blob.last_chunk().unwrap());
        assert_eq!(robot.upload(&blob), Ok(Answer::Committed(hash)));
        robot.run_us(45_000);
        assert_eq!(
            robot.world.said(),
            [
                "source enters",
                "source 1 at 2000",
                "source 2 at 7000",
                "source 3 at 12000"
            ],
            "three executions, and none after it is finished"
        );
        let status = robot.status();
        assert_eq!(
            (status.mode, status.mission, status.steps, status.t_us),
            (Mode::Running, Some(hash), 5, 40_000)
        );
        assert_eq!((status.missed, status.overruns), (0, 0));
        assert_eq!(
            robot.trace,
            [
                format!("Started {{ mission: {hash}, start_us: 0 }}"),
                "Transition { micro: 0, region_instance: 0, transition: 0 }".into(),
                "Step { step: 0, micro_steps: 1, states: {0: 1}, enabled: [0] }".into(),
                "Same { micro_steps: 1 }".into(),
                "Transition { micro: 0, region_instance: 0, transition: 1 }".into(),
                "Step { step: 2, micro_steps: 1, states: {0: 2}, enabled: [] }".into(),
                "Same { micro_steps: 1 }".into(),
                "Same { micro_steps: 1 }".into(),
            ]
        );
    });
}

#[test]
fn flags_of_a_task_are_seen_by_the_next_macro_step() {
    let mission = Mission::new(&SLOTS).task(signature::SOURCE, None).region(
        &[("Count", "Source", 2, &[99]), ("Rest", "", 0, &[])],
        &["initial -> Count", "Count -> Rest [high]"],
    );
    with_robot(|robot| {
        robot.start(&mission.blob());
        robot.run_us(30_000);
        assert_eq!(
            robot.world.said(),
            ["source enters", "source 1 at 2000", "source 2 at 7000"]
        );
    });
}

#[test]
fn a_task_is_busy_until_its_input_has_a_value() {
    // The sink stands before the source in the order of the slot, so that it has to wait for the
    // slot's next activation.
    let mission = Mission::new(&SLOTS)
        .task(signature::SINK, None)
        .task(signature::SOURCE, None)
        .region(&[("Read", "Sink", 2, &[7])], &["initial -> Read"])
        .region(
            &[("Wait", "", 0, &[]), ("Count", "Source", 2, &[99])],
            &["initial -> Wait", "Wait -> Count"],
        )
        .path((1, 1, 0), (0, 0, 0));
    with_robot(|robot| {
        robot.start(&mission.blob());
        robot.run_us(9_000);
        assert_eq!(robot.world.said(), [""; 0]);
        let sink = robot.task(0);
        assert!(sink.enabled && sink.busy);
        robot.run_us(10_000);
        assert_eq!(
            robot.world.said(),
            [
                "source enters",
                "source 1 at 12000",
                "sink 7 reads 1",
                "source 2 at 17000"
            ]
        );
        assert!(!robot.task(0).busy);
    });
}

#[test]
fn a_task_whose_state_was_left_is_busy_no_more() {
    let mission = Mission::new(&SLOTS)
        .task(signature::SINK, None)
        .task(signature::SOURCE, None)
        .region(
            &[("Read", "Sink", 2, &[7]), ("Rest", "", 0, &[])],
            &["initial -> Read", "Read -> Rest [busy]"],
        )
        .region(
            &[("Idle", "", 0, &[]), ("Count", "Source", 2, &[99])],
            &["initial -> Idle"],
        )
        .path((1, 1, 0), (0, 0, 0));
    with_robot(|robot| {
        robot.start(&mission.blob());
        robot.run_us(9_000);
        assert!(robot.task(0).busy);
        robot.run_us(10_000);
        let sink = robot.task(0);
        assert!(!sink.enabled && !sink.busy);
    });
}

#[test]
fn a_group_is_held_by_the_task_that_was_enabled_first() {
    let group = Some("motion");
    let mission = Mission::new(&SLOTS)
        .task(signature::HOG, group)
        .task(signature::SOURCE, None)
        .region(
            &[("Late", "", 0, &[]), ("First", "Hog", 2, &[1])],
            &["initial -> Late", "Late -> First"],
        )
        .region(
            &[("Second", "Hog", 2, &[2]), ("Rest", "", 0, &[])],
            &["initial -> Second", "Second -> Rest [exit]"],
        );
    let leaving = Mission::new(&SLOTS)
        .task(signature::HOG, group)
        .region(
            &[("Late", "", 0, &[]), ("First", "Hog", 2, &[1])],
            &["initial -> Late", "Late -> First"],
        )
        .region(
            &[
                ("Second", "Hog", 2, &[2]),
                ("Wait", "", 0, &[]),
                ("Rest", "", 0, &[]),
            ],
            &[
                "initial -> Second",
                "Second -> Wait / Again",
                "Wait -> Rest",
            ],
        );
    with_robot(|robot| {
        robot.start(&mission.blob());
        robot.run_us(29_000);
        assert_eq!(
            robot.world.said(),
            ["hog 2"; 6],
            "it was enabled one macro step before the other"
        );
        assert!(robot.task(0).busy && !robot.task(1).busy);
        robot.start(&leaving.blob());
        robot.world.said();
        robot.run_us(19_000);
        assert_eq!(
            robot.world.said(),
            ["hog 2", "hog 2", "hog 1", "hog 1"],
            "the holder was left in the macro step at 10 ms"
        );
    });
}

#[test]
fn a_slot_0_run_is_told_at_the_next_occurrence() {
    let mission = Mission::new(&SLOTS)
        .task(signature::THINKER, None)
        .task(signature::SINK, None)
        .region(
            &[("Think", "Thinker", 0, &[]), ("Rest", "", 0, &[])],
            &["initial -> Think", "Think -> Rest [exit]"],
        )
        .region(&[("Read", "Sink", 2, &[1])], &["initial -> Read"])
        .path((0, 0, 1), (1, 0, 0));
    with_robot(|robot| {
        robot
            .ask(Request::Subscribe {
                trace: true,
                log: false,
                record: false,
            })
            .unwrap();
        robot.background_runs = false;
        robot.start(&mission.blob());
        robot.run_us(8_000);
        assert_eq!(robot.world.said(), [""; 0], "nobody had time for it");
        assert!(robot.status().background_busy);
        while robot.background.poll() {}
        assert_eq!(
            robot.world.said(),
            ["thinks 1 of None", "thinks 2 of None", "thinks 3 of None"]
        );
        robot.run_us(10_000);
        assert_eq!(robot.world.said(), ["sink 1 reads 100", "sink 1 reads 100"]);
        let background_runs: Vec<&String> = robot
            .trace
            .iter()
            .filter(|record| record.starts_with("BackgroundRun"))
            .collect();
        // Activations: 0 interpreter, 1 and 2 slot 2, 3 interpreter.
        assert_eq!(
            background_runs,
            [
                "BackgroundRunStarted { task_instance: 0, activation: 0 }",
                "BackgroundRunEnded { task_instance: 0, activation: 3 }"
            ]
        );
        assert!(robot.trace.iter().any(|record| record
            == "Step { step: 1, micro_steps: 1, states: {0: 2, 1: 5}, enabled: [1] }"));
    });
}

#[test]
fn a_slot_0_run_starts_as_soon_as_its_input_has_a_value() {
    let mission = Mission::new(&SLOTS)
        .task(signature::SINK, None)
        .task(signature::SOURCE, None)
        .region(&[("Read", "Sink", 0, &[7])], &["initial -> Read"])
        .region(
            &[("Wait", "", 0, &[]), ("Count", "Source", 2, &[99])],
            &["initial -> Wait", "Wait -> Count"],
        )
        .path((1, 1, 0), (0, 0, 0));
    with_robot(|robot| {
        robot.background_runs = false;
        robot.start(&mission.blob());
        robot.run_us(9_000);
        assert!(robot.task(0).busy);
        assert!(!robot.background.poll());
        robot.run_us(10_000);
        assert!(!robot.task(0).busy);
        robot.world.said();
        assert!(robot.background.poll());
        assert!(robot.background.poll());
        assert_eq!(
            robot.world.said(),
            ["sink 7 reads 1", "sink 7 reads 1"],
            "what it read when it was started, though the source has gone on"
        );
    });
}

#[test]
fn a_state_that_is_entered_anew_while_its_run_goes_on_gets_another_run() {
    let mission = Mission::new(&SLOTS).task(signature::THINKER, None).region(
        &[("Think", "Thinker", 0, &[]), ("Out", "", 0, &[])],
        &["initial -> Think", "Think -> Out", "Out -> Think"],
    );
    with_robot(|robot| {
        robot
            .ask(Request::Subscribe {
                trace: true,
                log: false,
                record: false,
            })
            .unwrap();
        robot.background_runs = false;
        robot.start(&mission.blob());
        robot.run_us(25_000);
        let task = robot.task(0);
        assert!(
            task.enabled && task.busy,
            "entered anew at 20 ms, while the first run goes on"
        );
        while robot.background.poll() {}
        robot.run_us(4_000);
        let background_runs: Vec<&String> = robot
            .trace
            .iter()
            .filter(|record| record.starts_with("BackgroundRun"))
            .collect();
        assert_eq!(
            background_runs,
            [
                "BackgroundRunStarted { task_instance: 0, activation: 0 }",
                "BackgroundRunEnded { task_instance: 0, activation: 8 }",
                "BackgroundRunStarted { task_instance: 0, activation: 8 }",
            ]
        );
        assert!(!robot.task(0).busy);
        assert_eq!(robot.world.said().len(), 3);
    });
}

#[test]
fn a_run_whose_state_was_left_ends_without_an_exit() {
    let mission = Mission::new(&SLOTS).task(signature::THINKER, None).region(
        &[("Think", "Thinker", 0, &[]), ("Out", "", 0, &[])],
        &["initial -> Think", "Think -> Out"],
    );
    with_robot(|robot| {
        robot.background_runs = false;
        robot.start(&mission.blob());
        robot.run_us(15_000);
        assert!(robot.task(0).enabled, "leaving its state does not end it");
        while robot.background.poll() {}
        robot.run_us(5_000);
        assert!(!robot.task(0).enabled);
    });
}

#[test]
fn overruns_are_counted_one_by_one_and_end_in_the_safe_state() {
    for (takes_us, overruns, mode) in [
        (1_000, 0, Mode::Running),
        (1_001, 4, Mode::Safe(SafeReason::Overruns)),
        (2_500, 4, Mode::Safe(SafeReason::Overruns)),
    ] {
        with_robot(|robot| {
            robot.start(&hogging(takes_us).blob());
            robot.board.motors_off = 0;
            robot.run_us(60_000);
            let status = robot.status();
            assert_eq!(
                (status.mode, status.overruns),
                (mode, overruns),
                "{takes_us} µs"
            );
            let slot = robot.slot(1);
            assert_eq!((slot.number, slot.overruns, slot.missed), (2, overruns, 0));
            assert_eq!(slot.max_execution_ns, takes_us * 1_000);
            assert_eq!(slot.min_execution_ns, takes_us * 1_000);
            assert_eq!(slot.mean_execution_ns(), u64::from(takes_us) * 1_000);
            // In the safe state activations begin, and nothing is executed.
            let executed = if overruns == 0 { 12 } else { overruns };
            assert_eq!(slot.executed, executed);
            let delays: u32 = slot.delays.iter().copied().map(u32::from).sum();
            assert_eq!(delays, executed);
            assert_eq!(u32::from(robot.task(0).overruns), overruns);
            assert_eq!(robot.board.motors_off > 0, mode != Mode::Running);
            assert_eq!(
                robot.world.said().len() as u32,
                if overruns == 0 { 12 } else { overruns }
            );
        });
    }
}

#[test]
fn an_overrun_raises_a_flag_that_the_next_macro_step_sees() {
    // The hog in slot 2 runs from 10 ms on. It takes too long at 12 ms, which the monitor, before
    // it in the slot, finds at 17 ms.
    let mission = |takes_us| {
        Mission::new(&SLOTS)
            .task(signature::SLOT_MONITOR, None)
            .task(signature::HOG, None)
            .task(signature::SOURCE, None)
            .region(
                &[
                    ("Watch", "SlotMonitor", 2, &[8]),
                    ("Told", "Source", 2, &[99]),
                ],
                &["initial -> Watch", "Watch -> Told [overrun]"],
            )
            .region(
                &[("Wait", "", 0, &[]), ("Hog", "Hog", 2, &[takes_us])],
                &["initial -> Wait", "Wait -> Hog"],
            )
    };
    for (takes_us, said) in [
        (1_000, vec!["hog 1000", "hog 1000"]),
        (
            1_001,
            vec![
                "hog 1001",
                "hog 1001",
                "source enters",
                "source 1 at 22000",
                "hog 1001",
            ],
        ),
    ] {
        with_robot(|robot| {
            robot.start(&mission(takes_us).blob());
            robot.run_us(24_000);
            let mut told = robot.world.said();
            told.truncate(said.len());
            assert_eq!(told, said);
        });
    }
}

#[test]
fn a_missed_occurrence_raises_a_flag_too() {
    let mission = Mission::new(&SLOTS)
        .task(signature::SLOT_MONITOR, None)
        .task(signature::SOURCE, None)
        .region(
            &[
                ("Watch", "SlotMonitor", 2, &[8]),
                ("Told", "Source", 2, &[99]),
            ],
            &["initial -> Watch", "Watch -> Told [missed]"],
        );
    with_robot(|robot| {
        robot.start(&mission.blob());
        robot.run_us(4_000);
        // Slot 2 at 7 ms is left out; it goes on at 12 ms, before the interpreter's activation,
        // which is late.
        robot.world.pass_us(9_000);
        robot.run_us(6_000);
        assert_eq!(robot.status().missed, 1);
        assert_eq!(robot.world.said(), ["source enters", "source 1 at 17000"]);
    });
}

#[test]
fn the_limit_of_a_supervising_task_holds_while_its_state_is_active() {
    let watched = |limit, leave: &'static str| {
        Mission::new(&SLOTS)
            .task(signature::SLOT_MONITOR, None)
            .task(signature::HOG, None)
            .region(
                &[("Watch", "SlotMonitor", 2, &[limit]), ("Rest", "", 0, &[])],
                &["initial -> Watch", leave],
            )
            .region(&[("Hog", "Hog", 2, &[1_500])], &["initial -> Hog"])
    };
    let never = "Rest -> Watch";
    for (what, mission, overruns) in [
        ("the board's own limit is 3", hogging(1_500), 4),
        ("none is allowed", watched(0, never), 1),
        ("fewer than the board's", watched(1, never), 2),
        ("more than the board's", watched(8, never), 9),
        (
            "left after two, then the board's",
            watched(8, "Watch -> Rest [overrun]"),
            4,
        ),
    ] {
        with_robot(|robot| {
            robot.start(&mission.blob());
            robot.run_us(80_000);
            let status = robot.status();
            assert_eq!(
                (status.mode, status.overruns),
                (Mode::Safe(SafeReason::Overruns), overruns),
                "{what}"
            );
            // The limit does not outlive its mission.
            robot.start(&hogging(1_500).blob());
            robot.run_us(80_000);
            assert_eq!(robot.status().overruns, overruns + 4, "{what}");
        });
    }
}

#[test]
fn missed_occurrences_are_counted_exactly() {
    // The second slot starts at 2, 7, 12, … ms; at 5 ms everything stands still for some time.
    for (still_us, missed, mode) in [
        (6_000, [0, 0], Mode::Running),
        (7_000, [0, 1], Mode::Running),
        (12_000, [0, 2], Mode::Running),
        (16_000, [1, 2], Mode::Running),
        (32_000, [2, 6], Mode::Safe(SafeReason::DeadlineMiss)),
    ] {
        with_robot(|robot| {
            robot.start(&counting(99).blob());
            let start_us = robot.world.now_us();
            robot.run_until_us(start_us + 5_000);
            robot.world.pass_us(still_us);
            robot.run_us(0);
            let counted = [robot.slot(0).missed, robot.slot(1).missed];
            assert_eq!(counted, missed, "{still_us} µs");
            let status = robot.status();
            assert_eq!(
                (status.missed, status.mode),
                (missed[0] + missed[1], mode),
                "{still_us} µs"
            );
        });
    }
}

#[test]
fn what_a_late_swap_leaves_out_of_the_old_mission_is_counted() {
    with_robot(|robot| {
        robot.start(&counting(99).blob());
        let start_us = robot.world.now_us();
        robot.run_until_us(start_us + 8_000);
        robot.send(&hogging(1).blob());
        let commit = robot.frame(Request::Commit(Swap::default()));
        robot.wire.to_robot.extend(&commit);
        robot.exchange();
        robot.world.pass_us(25_000);
        robot.run_us(0);
        // The new mission starts at 30 ms: of the old one, 10 and 20 ms are missing, and 12, 17, 22
        // and 27 ms of the second slot.
        assert_eq!(robot.status().missed, 6);
        assert_eq!([robot.slot(0).missed, robot.slot(1).missed], [0, 0]);
        robot.run_us(10_000);
        assert_eq!(robot.status().missed, 6);
    });
}

#[test]
fn the_time_of_a_macro_step_is_nominal_also_after_missed_ones() {
    with_robot(|robot| {
        robot
            .ask(Request::Subscribe {
                trace: true,
                log: false,
                record: false,
            })
            .unwrap();
        robot.start(&counting(99).blob());
        robot.run_us(5_000);
        robot.world.pass_us(17_345);
        robot.run_us(0);
        let status = robot.status();
        assert_eq!((status.steps, status.t_us), (3, 20_000));
        let slot = robot.slot(0);
        assert_eq!((slot.min_delay_ns, slot.max_delay_ns), (0, 2_345_000));
        // 16 ticks of 12 MHz; 2,345 us are below 4^6 times that, and not below 4^5 times.
        assert_eq!((slot.first_bucket_ns, slot.executed), (1_333, 2));
        assert_eq!(slot.delays, [1, 0, 0, 0, 0, 0, 1, 0]);
        // Step 1 was left out, so that the next one is told with its number.
        let told: Vec<&String> = (robot.trace.iter())
            .skip_while(|record| !record.starts_with("DeadlineMiss { slot: 0"))
            .filter(|record| !record.starts_with("DeadlineMiss"))
            .collect();
        assert_eq!(
            told,
            ["Step { step: 2, micro_steps: 1, states: {0: 1}, enabled: [0] }"]
        );
    });
}

#[test]
fn a_swap_takes_place_at_the_interpreters_next_occurrence_and_misses_nothing() {
    with_robot(|robot| {
        robot.start(&counting(99).blob());
        let epoch_us = robot.world.now_us();
        robot.run_until_us(epoch_us + 33_000);
        robot.world.said();
        let other = hogging(1).blob();
        robot.send(&other);
        assert_eq!(robot.status().steps, 4, "sending takes no time here");
        assert!(matches!(
            robot.ask(Request::Commit(Swap::default())),
            Ok(Answer::Committed(_))
        ));
        assert_eq!(robot.world.now_us(), epoch_us + 40_000);
        robot.run_until_us(epoch_us + 55_000);
        assert_eq!(
            robot.world.said(),
            ["source 8 at 37000", "hog 1", "hog 1", "hog 1"],
            "the old mission up to the swap, the new one from its own start"
        );
        let status = robot.status();
        assert_eq!((status.steps, status.t_us, status.missed), (2, 10_000, 0));
        // Nominal starts go on over the swap, and each activation is told once.
        let starts: Vec<u64> = robot
            .board
            .activations
            .iter()
            .map(|activation| activation.start_us)
            .collect();
        assert_eq!(
            starts,
            [
                0, 2, 7, 10, 12, 17, 20, 22, 27, 30, 32, 37, 40, 42, 47, 50, 52
            ]
            .map(|ms| ms * 1_000)
        );
        // Both buffers are used again and again.
        for _ in 0..3 {
            robot.start(&counting(5).blob());
            robot.start(&other);
        }
        robot.run_us(10_000);
        assert_eq!(robot.status().mode, Mode::Running);
    });
}

/// A source in slot 2 among these slots.
fn counting_among(slots: &[(u32, u32, u32)]) -> Mission {
    Mission::new(slots).task(signature::SOURCE, None).region(
        &[("Count", "Source", 2, &[1_000_000])],
        &["initial -> Count"],
    )
}

/// Nominal starts of a slot since the robot's first macro step.
fn starts_us(robot: &robot::Bench<'_, '_, '_>, slot: usize) -> Vec<u64> {
    let activations = robot.board.activations.iter();
    let of_slot = activations.filter(|activation| activation.slot == slot);
    of_slot.map(|activation| activation.start_us).collect()
}

#[test]
fn a_slot_that_two_missions_have_goes_on_without_a_gap_and_without_a_double() {
    // Period and start of the slot; the interpreter's are 10 ms and 0.
    for (period_us, start_us) in [
        (5_000, 2_000),
        (7_000, 500),
        (10_000, 9_700),
        (25_000, 3_000),
        (40_000, 39_700),
    ] {
        let both = [(10_000, 400, 0), (period_us, 300, start_us)];
        let mut other = both.to_vec();
        other.push((20_000, 100, 10_850));
        for swap_us in (0..90_000).step_by(9_999) {
            with_robot(|robot| {
                let (first, second) = (counting_among(&both), counting_among(&other));
                robot.start(&first.blob());
                let epoch_us = robot.world.now_us();
                robot.run_until_us(epoch_us + swap_us);
                robot.start(&second.blob());
                robot.run_us(50_000);
                // There and back again.
                robot.start(&first.blob());
                robot.run_us(50_000);
                for (slot, period_us) in [(0, 10_000), (1, period_us)] {
                    let starts_us = starts_us(robot, slot);
                    let apart = |pair: &[u64]| pair[1] - pair[0] == u64::from(period_us);
                    assert!(
                        starts_us.len() > 1 && starts_us.windows(2).all(apart),
                        "slot {slot}, {period_us} µs, swap at {swap_us} µs: {starts_us:?}"
                    );
                }
                assert_eq!(robot.status().missed, 0);
            });
        }
    }
}

#[test]
fn a_slot_that_must_move_has_the_gap_that_is_told_before() {
    // Slot 3 of the second mission leaves no room where slot 2 runs.
    let slots = |starts_us: &[u32]| [(10_000, 1_000, starts_us[0]), (20_000, 2_000, starts_us[1])];
    let more = |starts_us: &[u32]| {
        let [first, second] = slots(starts_us);
        [first, second, (10_000, 6_000, starts_us[2])]
    };
    let table =
        |mission: &Mission| SlotTable::of(&esm_core::verify(mission.blob()).unwrap().tables());
    for (second_us, third_us) in [(7_000, 1_000), (1_000, 4_000)] {
        for from_us in [3_000, 14_000] {
            let running = counting_among(&slots(&[0, from_us]));
            let next = counting_among(&more(&[0, second_us, third_us]));
            let schedule = lay_out(
                &table(&running),
                &table(&next),
                work_limit(Duration::from_secs(1)),
            );
            let next = counting_among(&more(&schedule.starts_us));
            let told = Handover::between(&table(&running), &table(&next));
            assert_eq!(told.slots_kept, [1]);
            let [moved] = told.slots_moved[..] else {
                panic!("{told:?}")
            };
            let mut longest_gap_us = 0;
            for swap_us in [31_000, 41_000] {
                with_robot(|robot| {
                    robot.start(&running.blob());
                    robot.run_us(swap_us);
                    robot.start(&next.blob());
                    robot.run_us(60_000);
                    let starts_us = starts_us(robot, 1);
                    let gaps = starts_us.windows(2).map(|pair| pair[1] - pair[0]);
                    let odd: Vec<u64> = gaps.filter(|gap_us| *gap_us != 20_000).collect();
                    assert_eq!(odd.len(), 1, "one gap is another one: {starts_us:?}");
                    longest_gap_us = longest_gap_us.max(odd[0]);
                });
            }
            assert_eq!(
                (moved.slot, moved.longest_gap_us),
                (2, longest_gap_us),
                "{moved:?}"
            );
        }
    }
}

#[test]
fn the_time_of_a_mission_counts_from_where_it_takes_over_whatever_the_slots_count_from() {
    let slots = [(10_000, 400, 0), (25_000, 300, 3_000)];
    with_robot(|robot| {
        robot.start(&counting_among(&slots).blob());
        let epoch_us = robot.world.now_us();
        robot.run_until_us(epoch_us + 33_000);
        assert_eq!(
            robot.world.said(),
            ["source enters", "source 1 at 3000", "source 2 at 28000"]
        );
        robot.start(&counting_among(&slots).blob());
        assert_eq!(robot.world.now_us(), epoch_us + 40_000);
        robot.run_us(38_000);
        assert_eq!(
            robot.world.said(),
            ["source enters", "source 1 at 13000", "source 2 at 38000"],
            "its slot is at 53 and 78 ms, 13 and 38 ms after it took over"
        );
        let status = robot.status();
        assert_eq!((status.steps, status.t_us), (4, 30_000));
    });
}

#[test]
fn with_another_interpreter_period_all_slots_start_anew() {
    with_robot(|robot| {
        robot.start(&counting_among(&[(10_000, 400, 0), (25_000, 300, 3_000)]).blob());
        let epoch_us = robot.world.now_us();
        robot.run_until_us(epoch_us + 33_000);
        robot.start(&counting_among(&[(5_000, 400, 0), (25_000, 300, 3_000)]).blob());
        robot.run_us(54_000);
        assert_eq!(starts_us(robot, 1), [3_000, 28_000, 43_000, 68_000, 93_000]);
    });
}

#[test]
fn a_mission_that_is_started_again_finds_its_slots_where_they_are() {
    with_robot(|robot| {
        robot.start(&counting_among(&[(10_000, 400, 0), (25_000, 300, 3_000)]).blob());
        let epoch_us = robot.world.now_us();
        robot.run_until_us(epoch_us + 31_000);
        robot.ask(Request::Stop).unwrap();
        robot.run_until_us(epoch_us + 62_000);
        robot.ask(Request::Start).unwrap();
        robot.run_until_us(epoch_us + 110_000);
        assert_eq!(
            starts_us(robot, 1),
            [3_000, 28_000, 53_000, 78_000, 103_000]
        );
        assert_eq!(robot.status().t_us, 40_000, "its time starts anew");
    });
}

#[test]
fn a_slot_that_starts_with_the_interpreter_and_before_it_does_not_occur_twice() {
    // A slot without duration may start where another does; the order of the slots decides.
    let mission = counting_among(&[(20_000, 0, 0), (10_000, 400, 0)]).interpreter(1);
    for swap_us in [35_000, 45_000] {
        with_robot(|robot| {
            robot.start(&mission.blob());
            let epoch_us = robot.world.now_us();
            robot.run_until_us(epoch_us + swap_us);
            robot.start(&mission.blob());
            robot.run_until_us(epoch_us + 100_000);
            let expected: Vec<u64> = (0..=5).map(|index| index * 20_000).collect();
            assert_eq!(starts_us(robot, 0), expected, "swap at {swap_us} µs");
        });
    }
}

#[test]
fn a_new_mission_starts_with_empty_nets_and_fresh_tasks() {
    let with_sink = Mission::new(&SLOTS)
        .task(signature::SINK, None)
        .task(signature::SOURCE, None)
        .region(&[("Read", "Sink", 2, &[1])], &["initial -> Read"])
        .region(&[("Count", "Source", 2, &[99])], &["initial -> Count"])
        .path((1, 0, 0), (0, 0, 0));
    with_robot(|robot| {
        for _ in 0..2 {
            robot.start(&with_sink.blob());
            robot.world.said();
            robot.run_us(8_000);
            assert_eq!(
                robot.world.said(),
                [
                    "source enters",
                    "source 1 at 2000",
                    "sink 1 reads 1",
                    "source 2 at 7000"
                ]
            );
        }
    });
}

#[test]
fn a_slot_0_run_of_the_old_mission_leaves_no_trace_in_the_new_one() {
    let thinking = Mission::new(&SLOTS).task(signature::THINKER, None).region(
        &[("Think", "Thinker", 0, &[]), ("Rest", "", 0, &[])],
        &["initial -> Think", "Think -> Rest [exit]"],
    );
    with_robot(|robot| {
        robot.background_runs = false;
        robot.start(&thinking.blob());
        robot.run_us(5_000);
        robot.background.poll();
        robot.start(&thinking.blob());
        robot.run_us(1_000);
        let task = robot.task(0);
        assert!(
            task.enabled && task.busy,
            "its task is still at the old run"
        );
        while robot.background.poll() {}
        assert_eq!(robot.world.said().len(), 3);
        robot.run_us(12_000);
        assert!(
            robot.task(0).enabled,
            "the old run's end is not the new one's"
        );
        while robot.background.poll() {}
        robot.run_us(10_000);
        assert_eq!(robot.world.said().len(), 3);
        assert!(!robot.task(0).enabled);
    });
}

#[test]
fn a_stop_is_latched_until_start() {
    with_robot(|robot| {
        robot.start(&counting(99).blob());
        robot.run_us(5_000);
        robot.board.motors_off = 0;
        assert_eq!(robot.ask(Request::Stop), Ok(Answer::Done));
        assert_eq!(robot.board.motors_off, 1);
        robot.world.said();
        robot.run_us(50_000);
        assert_eq!(robot.world.said(), [""; 0]);
        assert!(robot.board.motors_off > 4, "again and again");
        assert_eq!(robot.status().mode, Mode::Stopped);
        robot.start(&counting(1).blob());
        robot.run_us(20_000);
        assert_eq!(
            (robot.status().mode, robot.world.said().len()),
            (Mode::Stopped, 0),
            "also with a new mission"
        );
        assert_eq!(robot.ask(Request::Start), Ok(Answer::Done));
        robot.run_us(5_000);
        assert_eq!(robot.world.said(), ["source enters", "source 1 at 2000"]);
        assert_eq!(robot.status().mode, Mode::Running);
    });
}

#[test]
fn what_breaks_ends_in_the_safe_state_until_start() {
    let flooding = Mission::new(&SLOTS).region(
        &[("A", "", 0, &[]), ("B", "", 0, &[])],
        &["initial -> A", "A -> B / Again", "B -> B on Again / Again"],
    );
    with_robot(|robot| {
        robot
            .ask(Request::Subscribe {
                trace: true,
                log: false,
                record: false,
            })
            .unwrap();
        robot.start(&flooding.blob());
        robot.run_us(30_000);
        assert_eq!(robot.status().mode, Mode::Safe(SafeReason::MacroStepLimit));
        assert!(
            robot
                .trace
                .iter()
                .any(|record| record == "Fault { step: 1, code: MacroStepLimit }")
        );
        assert_eq!(robot.trace.last().unwrap(), "MotorsOff { reason: Some(1) }");
        robot.start(&counting(99).blob());
        assert_eq!(
            robot.status().mode,
            Mode::Running,
            "a new mission, a new chance"
        );
        robot.board.body = Err(SafeReason::BodyLost);
        robot.run_us(10_000);
        assert_eq!(robot.status().mode, Mode::Safe(SafeReason::BodyLost));
        robot.board.body = Ok(());
        robot.run_us(50_000);
        assert_eq!(robot.status().mode, Mode::Safe(SafeReason::BodyLost));
        assert_eq!(robot.ask(Request::Start), Ok(Answer::Done));
        assert_eq!(robot.status().mode, Mode::Running);
    });
}

#[test]
fn the_watchdog_is_fed_with_and_without_a_mission() {
    with_robot(|robot| {
        robot.run_us(100_000);
        assert!((10..=11).contains(&robot.board.fed), "{}", robot.board.fed);
        robot.start(&counting(1).blob());
        let before = robot.board.fed;
        robot.run_us(100_000);
        // Each time that nothing is due any more.
        assert!(
            robot.board.fed - before >= 10,
            "{}",
            robot.board.fed - before
        );
    });
}

#[test]
fn a_mission_that_does_not_fit_is_refused_and_the_robot_drives_on() {
    let hogs = |count: usize| {
        (0..count).fold(
            Mission::new(&SLOTS).task(signature::HOG, None),
            |mission, _| mission.region(&[("Hog", "Hog", 2, &[1])], &["initial -> Hog"]),
        )
    };
    let slots: Vec<(u32, u32, u32)> = (0..5).map(|slot| (10_000, 100, slot * 1_000)).collect();
    let many_regions = (0..40).fold(Mission::new(&SLOTS), |mission, _| {
        mission.region(&[("A", "", 0, &[])], &["initial -> A"])
    });
    let cases = [
        (
            Mission::new(&SLOTS)
                .task("task Fly{}", None)
                .region(&[("A", "Fly", 2, &[])], &["initial -> A"]),
            LinkError::UnknownTask { task: 0 },
        ),
        (
            Mission::new(&SLOTS)
                .task(signature::HOG, None)
                .task("task Sink{in data count:u32;}", None)
                .task(signature::SOURCE, None)
                .region(
                    &[
                        ("A", "Sink", 2, &[]),
                        ("B", "Source", 2, &[1]),
                        ("C", "Hog", 2, &[1]),
                    ],
                    &["initial -> A"],
                )
                .path((0, 1, 0), (0, 0, 0)),
            LinkError::SignatureDiffers { task: 0 },
        ),
        (
            hogs(3),
            LinkError::TooManyInstances {
                task: 0,
                needed: 3,
                available: 2,
            },
        ),
        (
            hogs(3).declared_twice(2),
            LinkError::TooManyInstances {
                task: 0,
                needed: 3,
                available: 2,
            },
        ),
        (
            counting(0),
            LinkError::ParamOutOfRange { task: 0, param: 0 },
        ),
        (
            Mission::new(&slots).region(&[("A", "", 0, &[])], &["initial -> A"]),
            LinkError::CapacityExceeded {
                what: Capacity::Slots,
                needed: 5,
                available: 4,
            },
        ),
        (
            many_regions,
            LinkError::CapacityExceeded {
                what: Capacity::ArenaWords,
                needed: 67,
                available: 64,
            },
        ),
    ];
    with_robot(|robot| {
        robot.start(&counting(1_000_000).blob());
        for (mission, expected) in cases {
            assert_eq!(robot.upload(&mission.blob()), Err(expected));
        }
        robot.world.said();
        robot.run_us(50_000);
        assert!(robot.world.said().len() >= 10);
        assert_eq!(robot.status().mode, Mode::Running);
    });
}

#[test]
fn slots_are_counted_before_they_are_held_against_each_other() {
    let slots: Vec<(u32, u32, u32)> = (0..5).map(|slot| (10_000, 100, slot * 1_000)).collect();
    let mut blob = Mission::new(&slots)
        .region(&[("A", "", 0, &[])], &["initial -> A"])
        .blob();
    // The first slot's period becomes 0, which the verifier would refuse.
    let period: [u8; 4] = 10_000_u32.to_le_bytes();
    let place = blob
        .windows(4)
        .position(|bytes| *bytes == period)
        .expect("it is there");
    blob[place..place + 4].fill(0);
    let end = blob.len() - 4;
    let crc = esm_core::format::crc32(&blob[..end]).to_le_bytes();
    blob[end..].copy_from_slice(&crc);
    let expected = LinkError::CapacityExceeded {
        what: Capacity::Slots,
        needed: 5,
        available: 4,
    };
    with_robot(|robot| assert_eq!(robot.upload(&blob), Err(expected)));
}

#[test]
fn a_net_of_another_type_is_refused_with_the_task_that_is_on_it() {
    let mission = Mission::new(&SLOTS)
        .task(signature::HOG, None)
        .task(signature::SINK, None)
        .task(signature::SOURCE, None)
        .region(&[("Hog", "Hog", 2, &[1])], &["initial -> Hog"])
        .region(&[("Read", "Sink", 2, &[1])], &["initial -> Read"])
        .region(&[("Count", "Source", 2, &[9])], &["initial -> Count"])
        .path((2, 0, 0), (1, 0, 0));
    let right = mission.blob();
    let type_hash = fnv1a(b"u32").to_le_bytes();
    let places: Vec<usize> = (0..right.len())
        .filter(|at| right[*at..].starts_with(&type_hash))
        .collect();
    let [place] = places[..] else {
        panic!("there is one net: {places:?}")
    };
    let mut wrong = right.clone();
    wrong[place..][..type_hash.len()].copy_from_slice(&fnv1a(b"f32").to_le_bytes());
    let (body, crc) = wrong.split_last_chunk_mut().unwrap();
    *crc = crc32(body).to_le_bytes();
    with_robot(|robot| {
        robot.start(&right);
        assert_eq!(
            robot.upload(&wrong),
            Err(LinkError::NetTypeDiffers { task: 1, port: 0 })
        );
        robot.world.said();
        robot.run_us(10_000);
        assert!(
            robot
                .world
                .said()
                .iter()
                .any(|said| said.starts_with("sink")),
            "the robot drives on"
        );
    });
}

#[test]
fn a_blob_that_is_spoiled_is_refused() {
    let blob = counting(1).blob();
    with_robot(|robot| {
        assert_eq!(
            robot.ask(Request::Commit(Swap::default())),
            Err(LinkError::NoUpload)
        );
        assert_eq!(
            robot.ask(Request::Chunk {
                offset: 0,
                data: &[1]
            }),
            Err(LinkError::NoUpload)
        );
        let too_long = BLOB_BYTES as u32 + 1;
        let refused = LinkError::CapacityExceeded {
            what: Capacity::BlobBytes,
            needed: too_long,
            available: BLOB_BYTES as u32,
        };
        assert_eq!(
            robot.ask(Request::Begin {
                len: too_long,
                crc: 0
            }),
            Err(refused)
        );

        let len = blob.len() as u32;
        assert_eq!(
            robot.ask(Request::Begin {
                len,
                crc: checksum(&blob)
            }),
            Ok(Answer::Received(0))
        );
        assert_eq!(
            robot.ask(Request::Commit(Swap::default())),
            Err(LinkError::Incomplete { received: 0 })
        );
        assert_eq!(
            robot.ask(Request::Chunk {
                offset: 5,
                data: &[1]
            }),
            Err(LinkError::WrongOffset { expected: 0 })
        );
        for at in 0..blob.len() {
            let mut changed = blob.clone();
            changed[at] ^= 0x10;
            robot.send(&changed);
            assert!(
                matches!(
                    robot.ask(Request::Commit(Swap::default())),
                    Err(LinkError::Invalid(_))
                ),
                "byte {at}"
            );
        }
        assert_eq!(
            robot.ask(Request::Begin { len, crc: 1 }),
            Ok(Answer::Received(0))
        );
        for (part, data) in blob.chunks(MAX_CHUNK).enumerate() {
            robot
                .ask(Request::Chunk {
                    offset: (part * MAX_CHUNK) as u32,
                    data,
                })
                .unwrap();
        }
        assert_eq!(
            robot.ask(Request::Chunk {
                offset: len,
                data: &[1]
            }),
            Err(LinkError::TooLong)
        );
        assert_eq!(
            robot.ask(Request::Commit(Swap::default())),
            Err(LinkError::WrongChecksum)
        );
        assert_eq!(robot.status().mode, Mode::Empty);
        robot.start(&blob);
    });
}

#[test]
fn an_upload_goes_on_where_it_was_interrupted() {
    let blob = counting(1).blob();
    let begin = Request::Begin {
        len: blob.len() as u32,
        crc: checksum(&blob),
    };
    with_robot(|robot| {
        robot.ask(begin).unwrap();
        robot
            .ask(Request::Chunk {
                offset: 0,
                data: &blob[..50],
            })
            .unwrap();
        robot.ask(Request::Hello).unwrap();
        assert_eq!(robot.ask(begin), Ok(Answer::Received(50)));
        assert_eq!(robot.ask(Request::Abort), Ok(Answer::Done));
        assert_eq!(robot.ask(begin), Ok(Answer::Received(0)));
    });
}

#[test]
fn chunks_sent_ahead_are_taken_in_order_and_answered_for_all_before_them() {
    let blob = counting(1).blob();
    let begin = Request::Begin {
        len: blob.len() as u32,
        crc: checksum(&blob),
    };
    let chunk = |range: std::ops::Range<usize>| Request::Chunk {
        offset: range.start as u32,
        data: &blob[range],
    };
    with_robot(|robot| {
        robot.ask(begin).unwrap();
        // Three at once, of which the second overlaps with the first, and the third is doubled.
        let frames = [0..50, 40..90, 90..100, 90..100].map(|range| robot.frame(chunk(range)));
        robot.wire.to_robot.extend(frames.concat());
        let answers = robot.exchange();
        assert_eq!(
            answers.last(),
            Some(&(robot.last_number(), Ok(Answer::Received(100)))),
            "the last answer speaks for all"
        );
        // The frame of a chunk was lost: those behind it are not taken.
        let frames = [110..120, 120..130].map(|range| robot.frame(chunk(range)));
        robot.wire.to_robot.extend(frames.concat());
        let last = robot.exchange().pop();
        assert_eq!(
            last,
            Some((
                robot.last_number(),
                Err(LinkError::WrongOffset { expected: 100 })
            ))
        );
        let end = blob.len();
        for (range, there) in [
            (0..20, 100),
            (20..100, 100),
            (100..150, 150),
            (150..end, end),
            (0..20, end),
            (end..end, end),
        ] {
            let answer = robot.ask(chunk(range.clone()));
            assert_eq!(answer, Ok(Answer::Received(there as u32)), "{range:?}");
        }
        assert!(matches!(
            robot.ask(Request::Commit(Swap::default())),
            Ok(Answer::Committed(_))
        ));
    });
}

#[test]
fn chunks_are_taken_while_the_wire_takes_no_answer() {
    let blob = counting(1).blob();
    with_robot(|robot| {
        robot
            .ask(Request::Begin {
                len: blob.len() as u32,
                crc: checksum(&blob),
            })
            .unwrap();
        robot.wire.stuck = true;
        for (offset, data) in (0u32..).step_by(16).zip(blob.chunks(16)) {
            let frame = robot.frame(Request::Chunk { offset, data });
            robot.wire.to_robot.extend(frame);
            assert_eq!(robot.exchange(), []);
            assert!(robot.wire.to_robot.is_empty(), "byte {offset} waits");
        }
        robot.wire.stuck = false;
        let all = Ok(Answer::Received(blob.len() as u32));
        assert_eq!(robot.exchange(), [(robot.last_number(), all)]);
    });
}

#[test]
fn a_request_that_is_sent_again_is_answered_again_and_done_once() {
    let blob = counting(1).blob();
    with_robot(|robot| {
        robot
            .ask(Request::Begin {
                len: blob.len() as u32,
                crc: checksum(&blob),
            })
            .unwrap();
        let chunk = robot.frame(Request::Chunk {
            offset: 0,
            data: &blob[..20],
        });
        for _ in 0..3 {
            robot.wire.to_robot.extend(&chunk);
            let answers: Vec<_> = robot
                .exchange()
                .into_iter()
                .map(|(_, answer)| answer)
                .collect();
            assert_eq!(answers, [Ok(Answer::Received(20))]);
        }
        robot.ask(Request::Abort).unwrap();
        robot.send(&blob);
        // Twice before the answer is there, once after it.
        let commit = robot.frame(Request::Commit(Swap::default()));
        robot.wire.to_robot.extend(&commit);
        robot.wire.to_robot.extend(&commit);
        assert_eq!(robot.exchange(), []);
        robot.real_time.on_timer(&mut robot.board);
        assert!(matches!(
            robot.exchange()[..],
            [(_, Ok(Answer::Committed(_)))]
        ));
        robot.wire.to_robot.extend(&commit);
        assert!(matches!(
            robot.exchange()[..],
            [(_, Ok(Answer::Committed(_)))]
        ));
    });
}

#[test]
fn the_link_is_in_step_again_after_noise() {
    with_robot(|robot| {
        let frame = robot.frame(Request::Status);
        for cut in 0..frame.len() {
            robot.wire.to_robot.extend(&frame[cut + 1..]);
            robot.wire.to_robot.extend([0xff; 200]);
            robot.wire.to_robot.push_back(0);
            robot.exchange();
            assert_eq!(robot.ask(Request::Stop), Ok(Answer::Done), "cut at {cut}");
        }
    });
}

#[test]
fn a_request_of_another_version_is_told_so() {
    with_robot(|robot| {
        let mut frame = [0; 32];
        let len = esm_link::frame::encode(&(9u8, 200u8, 1u8), &mut frame).unwrap();
        robot.wire.to_robot.extend(&frame[..len]);
        assert_eq!(robot.exchange(), [(9, Err(LinkError::Malformed))]);
    });
}

#[test]
fn the_robot_tells_its_tasks_its_mission_and_its_states() {
    let blob = counting(1).blob();
    with_robot(|robot| {
        assert_eq!(
            robot.ask(Request::ReadBlob { offset: 0 }),
            Err(LinkError::NoMission)
        );
        robot.start(&blob);
        let mut read = vec![];
        loop {
            let Ok(Answer::Bytes(total, data)) = robot.ask(Request::ReadBlob {
                offset: read.len() as u32,
            }) else {
                panic!()
            };
            assert_eq!(total as usize, blob.len());
            if data.is_empty() {
                break;
            }
            read.extend(data);
        }
        assert_eq!(read, blob);
        assert_eq!(
            robot.ask(Request::States { first: 0 }),
            Ok(Answer::Bytes(1, vec![1, 0]))
        );
        let Ok(Answer::Bytes(total, text)) = robot.ask(Request::Task {
            index: 2,
            offset: 0,
        }) else {
            panic!()
        };
        let expected = "task Hog exclusive motion count 2 {\n    param takes_us: u32;\n}\n";
        assert_eq!(
            (total as usize, String::from_utf8(text).unwrap()),
            (expected.len(), expected.into())
        );
        assert_eq!(
            robot.ask(Request::Task {
                index: 5,
                offset: 0
            }),
            Err(LinkError::NoSuchIndex)
        );
        assert_eq!(
            robot.ask(Request::SlotCounters { slot: 2 }),
            Err(LinkError::NoSuchIndex)
        );
        assert_eq!(
            robot.ask(Request::TaskCounters { task_instance: 1 }),
            Err(LinkError::NoSuchIndex)
        );
    });
}

#[test]
fn requests_are_answered_while_the_log_flows() {
    with_robot(|robot| {
        let text: Vec<u8> = (0..2_000u32).map(|i| i as u8).collect();
        robot
            .ask(Request::Subscribe {
                trace: false,
                log: true,
                record: false,
            })
            .unwrap();
        robot.wire.log.extend(&text);
        for _ in 0..5 {
            robot.status();
        }
        assert_eq!(robot.log, text);
    });
}

#[test]
fn without_a_reader_the_trace_is_not_written() {
    with_robot(|robot| {
        robot.start(&counting(1).blob());
        robot.run_us(2_000_000);
        assert_eq!(robot.status().trace_dropped, 0);
        robot
            .ask(Request::Subscribe {
                trace: true,
                log: false,
                record: false,
            })
            .unwrap();
        robot.run_us(20_000);
        assert!(
            robot.trace[0].starts_with("Step { step: 2"),
            "whole at first: {:?}",
            robot.trace
        );
        assert_eq!(robot.trace[1], "Same { micro_steps: 1 }");
    });
}

#[test]
fn many_robots_run_at_a_time() {
    let blob = counting(50).blob();
    std::thread::scope(|threads| {
        for _ in 0..4 {
            threads.spawn(|| {
                with_robot(|robot| {
                    robot.start(&blob);
                    robot.run_us(1_000_000);
                    assert_eq!(robot.world.said().len(), 51);
                });
            });
        }
    });
}

#[test]
fn ticks_and_microseconds_agree_for_days() {
    with_robot(|robot| {
        let days_us = 40 * 24 * 3_600 * 1_000_000;
        robot.world.pass_us(days_us);
        robot.start(&counting(1).blob());
        robot.run_us(20_000);
        assert_eq!(robot.slot(1).max_delay_ns, 0);
        assert_eq!(robot.status().t_us, 20_000);
        assert_eq!(robot.world.now_us(), days_us + 20_000);
    });
}
