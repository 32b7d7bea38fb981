//! Missions on trial: how they end, and that the robot says so.

use esm_link::message::{LinkError, Mode, Request, SafeReason, Status, Swap};
use esm_link::trial::{FallBack, FallBackReason, Trial};

use crate::mission::{Mission, hash};
use crate::robot::{Answer, Bench, signature, with_robot};
use crate::{SLOTS, counting, hogging};

/// How long missions are on trial here.
const TRIAL_MS: u32 = 100;

/// Its first macro step stops it.
fn flooding() -> Vec<u8> {
    let region = (
        [("A", "", 0, &[][..]), ("B", "", 0, &[])],
        ["initial -> A", "A -> B / Again", "B -> B on Again / Again"],
    );
    Mission::new(&SLOTS).region(&region.0, &region.1).blob()
}

/// It does nothing, as its number says.
fn idle(number: u32) -> Vec<u8> {
    Mission::new(&SLOTS)
        .task(signature::HOG, None)
        .region(&[("Hog", "Hog", 2, &[number])], &["initial -> Hog"])
        .blob()
}

fn subscribe(robot: &mut Bench<'_, '_, '_>) {
    let wanted = Request::Subscribe {
        trace: true,
        log: false,
        record: false,
    };
    assert_eq!(robot.ask(wanted), Ok(Answer::Done));
}

/// A robot that runs one mission and has another on trial.
fn on_trial(
    before: &[u8],
    tried: &[u8],
    trial_ms: u32,
    test: impl Fn(&mut Bench<'_, '_, '_>, Status),
) {
    with_robot(|robot| {
        subscribe(robot);
        robot.start(before);
        robot.run_us(50_000);
        robot.try_out(tried, trial_ms);
        let status = robot.status();
        assert_eq!(status.mission, Some(hash(tried)));
        test(robot, status);
        let status = robot.status();
        assert_eq!(status.trial, None, "it is over");
    });
}

#[test]
fn a_mission_that_is_confirmed_stays() {
    let (before, tried) = (idle(1), idle(2));
    on_trial(&before, &tried, TRIAL_MS, |robot, status| {
        let Some(Trial {
            left_ms,
            before: back,
        }) = status.trial
        else {
            panic!("{status:?}");
        };
        assert!((TRIAL_MS - 15..=TRIAL_MS).contains(&left_ms), "{left_ms}");
        assert_eq!(back, Some(hash(&before)));
        robot.run_us(50_000);
        let other = robot.ask(Request::Confirm {
            mission: hash(&before),
        });
        assert_eq!(other, Err(LinkError::NotOnTrial), "that one is not");
        let mission = hash(&tried);
        assert_eq!(robot.ask(Request::Confirm { mission }), Ok(Answer::Done));
        robot.run_us(500_000);
        let status = robot.status();
        assert_eq!((status.mission, status.fell_back), (Some(mission), None));
        assert_eq!(
            robot.ask(Request::Confirm { mission }),
            Err(LinkError::NotOnTrial)
        );
        assert_eq!(
            robot.ask(Request::FallBack { mission }),
            Err(LinkError::NotOnTrial)
        );
        // Both buffers are of use again.
        for number in 3..6 {
            robot.start(&idle(number));
        }
        assert_eq!(robot.status().missed, 0);
    });
}

#[test]
fn a_mission_that_fails_or_is_not_confirmed_is_given_up_without_a_missed_slot() {
    let failed = FallBackReason::Failed;
    let cases = [
        ("nobody confirms", idle(2), FallBackReason::NotConfirmed),
        ("it faults", flooding(), failed(SafeReason::MacroStepLimit)),
        (
            "its tasks take too long",
            hogging(1_500).blob(),
            failed(SafeReason::Overruns),
        ),
    ];
    for (what, tried, reason) in cases {
        let before = idle(1);
        on_trial(&before, &tried, TRIAL_MS, |robot, begun| {
            robot.run_us(u64::from(TRIAL_MS) * 1_000 + 10_000);
            let status = robot.status();
            assert_eq!(status.mission, Some(hash(&before)), "{what}");
            assert_eq!(status.mode, Mode::Running, "{what}");
            assert_eq!(status.missed, begun.missed, "{what}");
            let fell_back = FallBack {
                mission: hash(&tried),
                reason,
            };
            assert_eq!(status.fell_back, Some(fell_back), "{what}");
            let record = format!(
                "FellBack {{ mission: {}, reason: {} }}",
                hash(&tried),
                reason.number()
            );
            let told = robot.trace.iter().position(|told| *told == record);
            let next = told.and_then(|told| robot.trace.get(told + 1));
            let expected = format!("Started {{ mission: {},", hash(&before));
            assert!(
                next.is_some_and(|next| next.starts_with(&expected)),
                "{what}: {next:?}"
            );
            robot.world.said();
            robot.run_us(20_000);
            assert_eq!(robot.world.said(), ["hog 1"; 4], "{what}: it drives on");
            // Both buffers are of use again.
            for number in 3..6 {
                robot.start(&idle(number));
            }
        });
    }
}

#[test]
fn a_mission_that_had_failed_before_a_trial_is_not_started_by_its_end() {
    let (failing, tried) = (flooding(), idle(2));
    for is_asked in [false, true] {
        with_robot(|robot| {
            robot.start(&failing);
            robot.run_us(50_000);
            let safe = Mode::Safe(SafeReason::MacroStepLimit);
            assert_eq!(robot.status().mode, safe);
            robot.try_out(&tried, TRIAL_MS);
            assert_eq!(robot.status().mode, Mode::Running);
            if is_asked {
                let mission = hash(&tried);
                assert_eq!(robot.ask(Request::FallBack { mission }), Ok(Answer::Done));
            }
            robot.run_us(u64::from(TRIAL_MS) * 1_000 + 10_000);
            let status = robot.status();
            assert_eq!(status.mission, Some(hash(&failing)));
            assert_eq!((status.mode, status.steps), (safe, 0));
            let off = robot.board.motors_off;
            robot.run_us(50_000);
            assert!(robot.board.motors_off > off, "it stands still");
            assert_eq!(robot.ask(Request::Start), Ok(Answer::Done));
            robot.run_us(50_000);
            assert_eq!(robot.status().mode, safe, "it has failed again");
        });
    }
}

#[test]
fn a_mission_that_fails_is_given_up_at_the_next_macro_step() {
    on_trial(&idle(1), &flooding(), TRIAL_MS, |robot, _| {
        let start = |trace: &[String]| {
            let starts = trace.iter().filter_map(|told| {
                let (_, us) = told
                    .split_once("Started { mission: ")?
                    .1
                    .split_once("start_us: ")?;
                us.trim_end_matches(" }").parse::<u64>().ok()
            });
            starts.collect::<Vec<_>>()
        };
        robot.run_us(30_000);
        let starts = start(&robot.trace);
        let [_, tried, again] = starts[..] else {
            panic!("{starts:?}");
        };
        // The second macro step is the one that faults.
        assert_eq!(again - tried, 20_000);
    });
}

#[test]
fn a_mission_is_given_up_when_it_is_asked_for() {
    let (before, tried) = (idle(1), idle(2));
    on_trial(&before, &tried, TRIAL_MS, |robot, _| {
        let other = Request::FallBack {
            mission: hash(&before),
        };
        assert_eq!(robot.ask(other), Err(LinkError::NotOnTrial));
        let asked = Request::FallBack {
            mission: hash(&tried),
        };
        assert_eq!(robot.ask(asked), Ok(Answer::Done));
        let status = robot.status();
        assert_eq!(status.mission, Some(hash(&before)));
        let reason = FallBackReason::Asked;
        assert_eq!(status.fell_back.map(|it| it.reason), Some(reason));
    });
}

#[test]
fn the_first_mission_falls_back_to_none() {
    with_robot(|robot| {
        let tried = idle(1);
        robot.try_out(&tried, TRIAL_MS);
        assert_eq!(robot.status().trial.map(|trial| trial.before), Some(None));
        let motors_off = robot.board.motors_off;
        robot.run_us(200_000);
        let status = robot.status();
        assert_eq!((status.mode, status.mission), (Mode::Empty, None));
        assert_eq!(status.fell_back.map(|it| it.mission), Some(hash(&tried)));
        assert!(robot.board.motors_off > motors_off);
        for number in 3..6 {
            robot.start(&idle(number));
        }
        assert_eq!(robot.status().mode, Mode::Running);
    });
}

#[test]
fn no_upload_begins_during_a_trial() {
    let begin = Request::Begin { len: 100, crc: 1 };
    let (before, tried) = (idle(1), idle(2));
    on_trial(&before, &tried, TRIAL_MS, |robot, _| {
        assert_eq!(robot.ask(begin), Err(LinkError::OnTrial));
        let mission = hash(&tried);
        assert_eq!(robot.ask(Request::Confirm { mission }), Ok(Answer::Done));
        assert_eq!(robot.ask(begin), Ok(Answer::Received(0)));
    });
    // The first mission leaves a buffer, and is the only one to fall back from all the same.
    with_robot(|robot| {
        robot.try_out(&tried, TRIAL_MS);
        assert_eq!(robot.ask(begin), Err(LinkError::OnTrial));
    });
}

#[test]
fn an_upload_that_overtook_the_beginning_of_a_trial_waits_for_its_end() {
    with_robot(|robot| {
        let (tried, next) = (idle(1), idle(2));
        robot.send(&tried);
        let frame = robot.frame(Request::Commit(Swap {
            warm: false,
            trial_ms: TRIAL_MS,
        }));
        robot.wire.to_robot.extend(frame);
        assert_eq!(robot.exchange(), [], "the real-time side has it");
        robot.send(&next);
        robot.run_us(20_000);
        let commit = Request::Commit(Swap::default());
        assert_eq!(robot.ask(commit), Err(LinkError::OnTrial));
        let mission = hash(&tried);
        assert_eq!(robot.ask(Request::Confirm { mission }), Ok(Answer::Done));
        assert_eq!(robot.ask(commit), Ok(Answer::Committed(hash(&next))));
    });
}

#[test]
fn motors_do_not_start_again_for_a_mission_that_could_not_help() {
    let (before, tried) = (idle(1), idle(2));
    on_trial(&before, &tried, TRIAL_MS, |robot, _| {
        robot.board.body = Err(SafeReason::LowBattery);
        robot.run_us(10_000);
        robot.board.body = Ok(());
        let status = robot.status();
        assert_eq!(status.mission, Some(hash(&tried)), "its trial goes on");
        robot.run_us(200_000);
        let status = robot.status();
        assert_eq!(status.mission, Some(hash(&before)));
        assert_eq!(status.mode, Mode::Safe(SafeReason::LowBattery));
    });
    on_trial(&before, &tried, TRIAL_MS, |robot, _| {
        assert_eq!(robot.ask(Request::Stop), Ok(Answer::Done));
        robot.run_us(200_000);
        let status = robot.status();
        assert_eq!(status.mission, Some(hash(&before)));
        assert_eq!(status.mode, Mode::Stopped);
    });
}

#[test]
fn a_mission_that_starts_anew_is_on_trial_for_no_longer() {
    let (before, tried) = (idle(1), idle(2));
    on_trial(&before, &tried, TRIAL_MS, |robot, _| {
        robot.ask(Request::Stop).unwrap();
        robot.run_us(60_000);
        robot.ask(Request::Start).unwrap();
        let status = robot.status();
        assert_eq!(status.mission, Some(hash(&tried)));
        assert!(status.trial.is_some_and(|trial| trial.left_ms < 40));
        robot.run_us(60_000);
        assert_eq!(robot.status().mission, Some(hash(&before)));
    });
}

#[test]
fn who_remembers_missions_hears_of_each_trial_before_the_host_does() {
    with_robot(|robot| {
        robot.wire.memory.is_there = true;
        let (first, second, third) = (idle(1), idle(2), idle(3));
        robot.start(&first);
        let stays = |blob: &[u8]| format!("{:08x} stays", hash(blob));
        let failed = |blob: &[u8]| format!("{:08x} failed", hash(blob));
        let begun = format!("{} bytes", first.len());
        let mut expected = vec![begun.clone(), stays(&first)];
        assert_eq!(robot.wire.memory.told, expected, "without a trial");
        robot.try_out(&second, TRIAL_MS);
        let mission = hash(&second);
        robot.ask(Request::Confirm { mission }).unwrap();
        expected.extend([begun.clone(), stays(&second)]);
        assert_eq!(robot.wire.memory.told, expected);
        robot.try_out(&third, TRIAL_MS);
        robot.run_us(200_000);
        expected.extend([begun, failed(&third)]);
        assert_eq!(robot.wire.memory.told, expected);
        // Who cannot remember it does not let it take over.
        robot.wire.memory.is_full = true;
        assert_eq!(robot.upload(&first), Err(LinkError::Busy));
        assert_eq!(robot.status().mission, Some(hash(&second)));
        robot.wire.memory.is_full = false;
        robot.start(&first);
    });
}

#[test]
fn a_confirmation_that_was_not_kept_can_be_asked_for_again() {
    for trial_ms in [0, TRIAL_MS] {
        with_robot(|robot| {
            robot.wire.memory.is_there = true;
            let (first, second) = (idle(1), idle(2));
            robot.start(&first);
            robot.wire.memory.refuses_confirmation = true;
            let mission = hash(&second);
            if trial_ms > 0 {
                robot.try_out(&second, trial_ms);
            } else {
                assert_eq!(robot.upload(&second), Err(LinkError::FlashRefused));
            }
            for _ in 0..2 {
                let confirmed = robot.ask(Request::Confirm { mission });
                assert_eq!(confirmed, Err(LinkError::FlashRefused), "{trial_ms}");
                let status = robot.status();
                assert_eq!((status.mission, status.trial), (Some(mission), None));
            }
            let other = hash(&first);
            let confirmed = robot.ask(Request::Confirm { mission: other });
            assert_eq!(confirmed, Err(LinkError::NotOnTrial), "it does not run");
            robot.wire.memory.refuses_confirmation = false;
            let confirmed = robot.ask(Request::Confirm { mission });
            assert_eq!(confirmed, Ok(Answer::Done), "{trial_ms}");
            let last = robot.wire.memory.told.last();
            assert_eq!(last, Some(&format!("{mission:08x} stays")));
            let confirmed = robot.ask(Request::Confirm { mission });
            assert_eq!(confirmed, Err(LinkError::NotOnTrial), "once is enough");
        });
    }
}

#[test]
fn a_mission_without_a_trial_stays_in_its_safe_state() {
    with_robot(|robot| {
        robot.start(&counting(99).blob());
        robot.start(&flooding());
        robot.run_us(30_000);
        let status = robot.status();
        assert_eq!(status.mode, Mode::Safe(SafeReason::MacroStepLimit));
        assert_eq!((status.trial, status.fell_back), (None, None));
    });
}
