//! The emergency stop: what it stops, what does not end it, and what does.

use esm_link::black_box::{Event, RECORD_BYTES, Record};
use esm_link::frame::{MAX_FRAME_BYTES, encode};
use esm_link::message::{LinkError, Mode, Request, SafeReason, Swap, ToDevice};
use esm_tests::random::Random;
use rt_firmware::retained_ram::{CrashCause, RetainedRam};

use super::counting;
use super::keeping::with_kept;
use super::mission::hash;
use super::robot::{Answer, Bench, with_robot};

/// A robot that counts, and has done so for a while.
fn with_counting_robot(test: impl Fn(&mut Bench<'_, '_, '_>)) {
    for uses_what_is_ready in [true, false] {
        with_robot(|robot| {
            robot.uses_what_is_ready = uses_what_is_ready;
            robot.start(&counting(1_000).blob());
            robot.run_us(33_000);
            assert_ne!(robot.world.said(), [""; 0]);
            test(robot);
        });
    }
}

/// Lets the robot run: nothing moves, and the motors are switched off anew before each exchange
/// with the body.
fn assert_stands_still(robot: &mut Bench<'_, '_, '_>) {
    robot.board.off_at_exchanges.clear();
    let mut before = robot.board.motors_off;
    robot.run_us(50_000);
    for off in std::mem::take(&mut robot.board.off_at_exchanges) {
        assert!(off > before, "an exchange without motors off");
        before = off;
    }
    assert_eq!(robot.world.said(), [""; 0]);
    assert_eq!(robot.status().mode, Mode::EmergencyStopped);
}

#[test]
fn an_emergency_stop_switches_the_motors_off_before_the_next_exchange_of_any_slot() {
    with_counting_robot(|robot| {
        robot.board.motors_off = 0;
        let frame = robot.frame(Request::EmergencyStop);
        robot.wire.to_robot.extend(frame);
        // The link's turn alone: the timer's interrupt is still to come, and it is not one of the
        // interpreter's slot.
        let answers = robot.exchange();
        assert_eq!(answers, [(robot.last_number(), Ok(Answer::Done))]);
        assert_eq!(robot.status().mode, Mode::EmergencyStopped);
        assert_stands_still(robot);
    });
}

#[test]
fn neither_a_start_nor_a_stop_nor_a_fault_nor_a_mission_ends_an_emergency_stop() {
    with_counting_robot(|robot| {
        assert_eq!(robot.ask(Request::EmergencyStop), Ok(Answer::Done));
        assert_stands_still(robot);
        let refused = Err(LinkError::EmergencyStopped);
        assert_eq!(robot.ask(Request::Start), refused);
        assert_stands_still(robot);
        assert_eq!(robot.ask(Request::Stop), Ok(Answer::Done));
        assert_eq!(robot.ask(Request::Start), refused);
        assert_stands_still(robot);
        robot.board.body = Err(SafeReason::BodyLost);
        assert_stands_still(robot);
        robot.board.body = Ok(());
        (robot.real_time).fail_safe(&mut robot.board, SafeReason::Board);
        assert_stands_still(robot);
        robot.start(&counting(7).blob());
        assert_stands_still(robot);
        robot.try_out(&counting(8).blob(), 20);
        assert_stands_still(robot);
        assert!(robot.status().fell_back.is_some());
        assert_eq!(robot.ask(Request::Start), refused);
        assert_eq!(robot.ask(Request::Release), Ok(Answer::Done));
        robot.run_us(50_000);
        assert_eq!(robot.world.said(), [""; 0], "released is not started");
        assert_eq!(robot.status().mode, Mode::Stopped);
        assert_eq!(robot.ask(Request::Start), Ok(Answer::Done));
        robot.run_us(50_000);
        assert_ne!(robot.world.said(), [""; 0]);
        assert_eq!(robot.status().mode, Mode::Running);
        // Where there is nothing to release, nothing changes.
        assert_eq!(robot.ask(Request::Release), Ok(Answer::Done));
        assert_eq!(robot.status().mode, Mode::Running);
    });
}

#[test]
fn an_emergency_stop_does_not_wait_for_the_request_before_and_a_start_that_waits_does_not_come_through()
 {
    with_counting_robot(|robot| {
        robot.ask(Request::Stop).unwrap();
        // Until the last slot before the interpreter's is behind it: the start waits for that.
        robot.run_us(13_000 - robot.world.now_us() % 10_000);
        robot.world.said();
        let start = robot.frame(Request::Start);
        robot.wire.to_robot.extend(start);
        assert_eq!(robot.exchange(), []);
        robot.timer();
        assert_eq!(robot.exchange(), [], "the start waits");
        let stop = robot.frame(Request::EmergencyStop);
        robot.wire.to_robot.extend(stop);
        let answers = robot.exchange();
        assert_eq!(answers, [(robot.last_number(), Ok(Answer::Done))]);
        assert_stands_still(robot);
    });
}

#[test]
fn an_emergency_stop_survives_resets_and_is_in_the_flight_recorder() {
    let kept = RetainedRam::new();
    with_kept(&kept, |robot| {
        robot.start(&counting(99).blob());
        let frame = robot.frame(Request::EmergencyStop);
        robot.wire.to_robot.extend(frame);
        // The reset comes before the slots have seen it.
        assert_eq!(robot.exchange().len(), 1);
    });
    for _ in 0..2 {
        kept.end(&CrashCause::Watchdog);
        with_kept(&kept, |robot| {
            robot.world.said();
            assert_eq!(robot.status().mode, Mode::EmergencyStopped);
            robot.start(&counting(99).blob());
            assert_stands_still(robot);
            assert_eq!(robot.ask(Request::Start), Err(LinkError::EmergencyStopped));
            let Ok(Answer::Bytes(_, bytes)) = robot.ask(Request::BlackBox { from: None }) else {
                panic!("the robot tells what it holds");
            };
            let (page, _) = bytes.as_chunks::<RECORD_BYTES>();
            let noted = (page.iter().filter_map(Record::from_bytes))
                .any(|record| record.event == Event::Mode(Mode::EmergencyStopped));
            assert!(noted);
        });
    }
    with_kept(&kept, |robot| {
        robot.ask(Request::Release).unwrap();
    });
    with_kept(&kept, |robot| {
        robot.start(&counting(99).blob());
        assert_eq!(robot.status().mode, Mode::Running);
    });
}

#[test]
fn who_keeps_missions_keeps_an_emergency_stop_before_the_host_is_told() {
    with_robot(|robot| {
        robot.wire.memory.is_there = true;
        robot.ask(Request::EmergencyStop).unwrap();
        assert!(robot.wire.memory.is_emergency_stopped);
        robot.ask(Request::Release).unwrap();
        assert!(!robot.wire.memory.is_emergency_stopped);
        // Who cannot says so, and stops all the same.
        robot.wire.memory.is_full = true;
        let stopped = robot.ask(Request::EmergencyStop);
        assert_eq!(stopped, Err(LinkError::StopNotStored));
        assert_eq!(robot.status().mode, Mode::EmergencyStopped);
    });
    // The power was lost meanwhile.
    with_robot(|robot| {
        robot.wire.memory.is_there = true;
        robot.wire.memory.is_emergency_stopped = true;
        robot.link.start(&mut robot.wire);
        robot.start(&counting(99).blob());
        assert_stands_still(robot);
    });
}

#[test]
fn a_release_that_was_sent_before_an_emergency_stop_does_not_end_it() {
    for is_stopped in [false, true] {
        with_counting_robot(|robot| {
            robot.wire.memory.is_there = true;
            if is_stopped {
                robot.ask(Request::EmergencyStop).unwrap();
                robot.run_us(50_000);
            }
            let release = robot.frame(Request::Release);
            let stop = robot.frame(Request::EmergencyStop);
            robot.wire.to_robot.extend(release);
            robot.wire.to_robot.extend(stop);
            let answers = robot.exchange();
            assert_eq!(answers, [(robot.last_number(), Ok(Answer::Done))]);
            robot.timer();
            robot.exchange();
            robot.world.said();
            assert_stands_still(robot);
            assert!(robot.wire.memory.is_emergency_stopped);
            assert_eq!(robot.ask(Request::Start), Err(LinkError::EmergencyStopped));
            assert_eq!(robot.ask(Request::Release), Ok(Answer::Done));
            assert!(!robot.wire.memory.is_emergency_stopped);
            assert_eq!(robot.ask(Request::Start), Ok(Answer::Done));
        });
    }
}

#[test]
fn a_release_right_behind_an_emergency_stop_leaves_the_robot_stopped() {
    with_counting_robot(|robot| {
        let stop = robot.frame(Request::EmergencyStop);
        let release = robot.frame(Request::Release);
        robot.wire.to_robot.extend(stop);
        robot.wire.to_robot.extend(release);
        robot.exchange();
        robot.run_us(5_000);
        assert_eq!(robot.status().mode, Mode::Stopped);
        robot.world.said();
        robot.run_us(50_000);
        assert_eq!(robot.world.said(), [""; 0]);
        assert_eq!(robot.ask(Request::Start), Ok(Answer::Done));
    });
}

#[test]
fn a_press_ends_a_release_that_is_under_way() {
    with_counting_robot(|robot| {
        robot.ask(Request::EmergencyStop).unwrap();
        robot.run_us(50_000);
        let release = robot.frame(Request::Release);
        robot.wire.to_robot.extend(release);
        assert_eq!(robot.exchange(), []);
        robot.board.is_pressed = true;
        robot.timer();
        robot.board.is_pressed = false;
        let refused = Err(LinkError::EmergencyStopped);
        assert_eq!(robot.exchange(), [(robot.last_number(), refused)]);
        robot.world.said();
        assert_stands_still(robot);
    });
}

#[test]
fn a_button_that_was_pressed_for_a_moment_latches_and_one_that_is_pressed_is_not_released() {
    with_counting_robot(|robot| {
        robot.board.is_pressed = true;
        robot.timer();
        assert_eq!(
            robot.ask(Request::Release),
            Err(LinkError::EmergencyStopped)
        );
        robot.board.is_pressed = false;
        robot.world.said();
        assert_stands_still(robot);
        assert_eq!(robot.ask(Request::Release), Ok(Answer::Done));
        assert_eq!(robot.ask(Request::Start), Ok(Answer::Done));
        robot.run_us(20_000);
        assert_ne!(robot.world.said(), [""; 0]);
    });
}

/// What anybody may send to a robot without a key, and what does nothing to a robot that has one.
fn of_others(mission: u32) -> Vec<Request<'static>> {
    vec![
        Request::Abort,
        Request::Status,
        Request::Clock,
        Request::Features,
        Request::CrashReport,
        Request::Start,
        Request::Release,
        Request::States { first: 0 },
        Request::ReadBlob { offset: 0 },
        Request::Confirm { mission },
        Request::FallBack { mission },
        Request::Begin { len: 9, crc: 9 },
        Request::Chunk {
            offset: 0,
            data: &[6; 9],
        },
        Request::Commit(Swap::default()),
        Request::Watch {
            news: false,
            period_ms: 0,
        },
        Request::Values { ask: &[] },
        Request::Within {
            by_us: 20_000_000,
            request: &[6],
        },
        Request::Stop,
        Request::EmergencyStop,
    ]
}

/// Sends frames of others, and lets the robot run between them.
fn disturb(robot: &mut Bench<'_, '_, '_>, random: &mut Random, mission: u32, most: usize) {
    let others = of_others(mission);
    for _ in 0..random.below(most) {
        // Mostly under the number of the stop.
        let seq = random.between(1, 3) as u8;
        let frame = framed(seq, others[random.below(others.len())]);
        robot.wire.to_robot.extend(frame);
        robot.run_us(4_000 * random.below(3) as u64);
    }
}

#[test]
fn no_frames_of_others_make_the_answer_to_a_stop_false() {
    let mut random = Random::new(16);
    for case in 0..400 {
        with_robot(|robot| {
            let blob = counting(1_000_000).blob();
            robot.start(&blob);
            robot.run_us(30_000);
            let mission = hash(&blob);
            disturb(robot, &mut random, mission, 8);
            let (number, stop) = match case % 2 {
                0 => (2, Request::Stop),
                _ => (2, Request::EmergencyStop),
            };
            robot.kinds.clear();
            let off_before = robot.board.motors_off;
            robot.wire.to_robot.extend(framed(number, stop));
            disturb(robot, &mut random, mission, 4);
            // Another stop of the same kind under the same number is one, too.
            let answer = (number, stop.kind());
            for turn in 1..100 {
                robot.exchange();
                if robot.kinds.contains(&answer) {
                    break;
                }
                robot.run_us(1_000);
                if turn % 40 == 0 {
                    // Another stop behind it took its place: who hears nothing sends it again.
                    robot.wire.to_robot.extend(framed(number, stop));
                }
            }
            assert!(robot.kinds.contains(&answer), "case {case}: no answer");
            robot.run_us(0);
            assert!(
                robot.board.motors_off > off_before,
                "case {case}: it was answered, and not done"
            );
        });
    }
}

fn framed(seq: u8, request: Request<'_>) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME_BYTES];
    let length = encode(&ToDevice { seq, request }, &mut frame).expect("it fits");
    frame[..length].to_vec()
}
