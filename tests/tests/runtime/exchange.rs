//! Missions are exchanged before the macro step that is the next one's first: what happens in
//! between, and what is refused before.

use esm_link::message::{Capacity, LinkError, Mode, Request, Swap};

use crate::mission::{Mission, hash};
use crate::robot::{Answer, Bench, TICKS_PER_US, with_robot};
use crate::warm::listening;
use crate::{SLOTS, counting};

/// The last activation of any slot before the macro step at 50 ms, and how long before that step
/// the missions are exchanged.
const LAST_US: u64 = 47_000;
const CHANGED_US: u64 = 48_000;
const STEP_US: u64 = 50_000;

/// A robot that is asked between two macro steps for something that changes the mission, and has
/// exchanged the missions: nothing else was due.
fn exchanged(
    request: Request<'_>,
    prepare: impl Fn(&mut Bench<'_, '_, '_>),
    test: impl Fn(&mut Bench<'_, '_, '_>),
) {
    for uses_what_is_ready in [true, false] {
        with_robot(|robot| {
            robot.uses_what_is_ready = uses_what_is_ready;
            let wanted = Request::Subscribe {
                trace: true,
                log: false,
                record: false,
            };
            assert_eq!(robot.ask(wanted), Ok(Answer::Done));
            prepare(robot);
            robot.run_until_us(LAST_US - 1_000);
            robot.trace.clear();
            let frame = robot.frame(request);
            robot.wire.to_robot.extend(frame);
            assert_eq!(robot.exchange(), [], "there is nothing to answer yet");
            robot.run_until_us(LAST_US);
            assert!(!told_of_a_start(robot), "a slot is due first");
            let next_ticks = robot.timer();
            assert_eq!(next_ticks, CHANGED_US * TICKS_PER_US);
            robot.run_until_us(CHANGED_US);
            assert!(told_of_a_start(robot), "{:?}", robot.trace);
            assert_eq!(robot.timer(), STEP_US * TICKS_PER_US);
            robot.world.said();
            test(robot);
        });
    }
}

/// Has the robot start one mission, and brings it the next.
fn starts_and_has(before: &[u8], next: &[u8]) -> impl Fn(&mut Bench<'_, '_, '_>) {
    move |robot| {
        robot.start(before);
        robot.send(next);
    }
}

fn told_of_a_start(robot: &Bench<'_, '_, '_>) -> bool {
    robot.trace.iter().any(|told| told.starts_with("Started"))
}

#[test]
fn the_mission_before_is_what_runs_until_the_first_macro_step_of_the_next() {
    let (before, next) = (listening(1, false), listening(2, true));
    for warm in [false, true] {
        let swap = Swap { warm, trial_ms: 0 };
        exchanged(
            Request::Commit(swap),
            starts_and_has(&before, &next),
            |robot| {
                let asked = robot.last_number();
                assert_eq!(robot.exchange(), [], "not before its time");
                robot.world.pass_us(STEP_US - CHANGED_US);
                robot.timer();
                let swapped = Ok(Answer::Committed(hash(&next)));
                assert_eq!(robot.exchange(), [(asked, swapped)]);
                robot.run_us(5_000);
                // Counted since the robot's start, each 5 ms; or from one on.
                let first = if warm {
                    "source 11 at 52000"
                } else {
                    "source enters"
                };
                assert_eq!(robot.world.said()[0], first);
                assert_eq!(robot.status().missed, 0);
            },
        );
    }
    exchanged(
        Request::Commit(Swap::default()),
        starts_and_has(&before, &next),
        |robot| {
            assert_eq!(robot.status().mission, Some(hash(&before)));
            assert_eq!(robot.world.said(), [""; 0]);
            robot.world.pass_us(STEP_US - CHANGED_US);
            robot.timer();
            assert_eq!(robot.status().mission, Some(hash(&next)));
        },
    );
}

#[test]
fn an_emergency_stop_between_exchange_and_macro_step_stops_whichever_it_is() {
    let (before, next) = (listening(1, false), listening(2, true));
    for warm in [false, true] {
        let swap = Swap { warm, trial_ms: 0 };
        exchanged(
            Request::Commit(swap),
            starts_and_has(&before, &next),
            |robot| {
                robot.board.motors_off = 0;
                let frame = robot.frame(Request::EmergencyStop);
                robot.wire.to_robot.extend(frame);
                let stopped = (robot.last_number(), Ok(Answer::Done));
                assert_eq!(robot.exchange(), [stopped]);
                robot.timer();
                assert!(robot.board.motors_off > 0, "at once");
                robot.run_us(50_000);
                assert_eq!(robot.world.said(), [""; 0], "neither of them moves");
                let status = robot.status();
                assert_eq!(status.mode, Mode::EmergencyStopped);
                assert_eq!(status.mission, Some(hash(&next)));
                assert_eq!(robot.ask(Request::Release), Ok(Answer::Done));
                assert_eq!(robot.ask(Request::Start), Ok(Answer::Done));
                robot.run_us(20_000);
                let said = robot.world.said();
                assert_eq!(said[0], "source enters", "from its beginning");
                assert!(said.contains(&"sink 2 reads 1".into()), "{said:?}");
            },
        );
    }
}

#[test]
fn a_robot_falls_back_before_the_macro_step_too() {
    let (before, tried) = (listening(1, false), listening(2, true));
    let request = Request::FallBack {
        mission: hash(&tried),
    };
    exchanged(
        request,
        |robot| {
            robot.start(&before);
            robot.run_us(5_000);
            robot.try_out(&tried, 1_000);
        },
        |robot| {
            let asked = robot.last_number();
            robot.world.pass_us(STEP_US - CHANGED_US);
            robot.timer();
            assert_eq!(robot.exchange(), [(asked, Ok(Answer::Done))]);
            robot.run_us(5_000);
            assert_eq!(robot.world.said()[0], "source enters");
            let status = robot.status();
            assert_eq!((status.mission, status.missed), (Some(hash(&before)), 0));
        },
    );
}

#[test]
fn a_swap_that_is_asked_for_when_the_macro_step_is_due_waits_for_the_next() {
    with_robot(|robot| {
        robot.start(&counting(1_000).blob());
        let next = counting(7).blob();
        robot.send(&next);
        robot.run_until_us(STEP_US - 1_000);
        let frame = robot.frame(Request::Commit(Swap::default()));
        robot.wire.to_robot.extend(frame);
        robot.world.pass_us(1_000);
        assert_eq!(robot.exchange(), []);
        robot.timer();
        assert_eq!(robot.exchange(), [], "that one is the mission's before");
        robot.run_until_us(STEP_US + 9_999);
        robot.world.pass_us(1);
        robot.timer();
        let swapped = Ok(Answer::Committed(hash(&next)));
        assert_eq!(robot.exchange(), [(robot.last_number(), swapped)]);
        assert_eq!(robot.status().missed, 0);
    });
}

#[test]
fn what_two_missions_have_in_common_must_fit_into_the_table() {
    // Each state of one region is that of the other.
    let names: Vec<String> = (0..140).map(|number| format!("S{number}")).collect();
    let states: Vec<(&str, &str, u32, &[u32])> =
        (names.iter().map(|name| (&name[..], "", 0, &[][..]))).collect();
    let wide = |states: &[_]| {
        let region = Mission::new(&SLOTS).region(states, &["initial -> S0"]);
        region.blob()
    };
    let (blob, other) = (wide(&states), wide(&states[..139]));
    with_robot(|robot| {
        robot.start(&blob);
        robot.send(&other);
        let warm = Request::Commit(Swap {
            warm: true,
            trial_ms: 0,
        });
        // Two for the region, and one for each state of the mission before with its `initial` and
        // `final`.
        let refused = LinkError::CapacityExceeded {
            what: Capacity::Pairs,
            needed: 2 + 140 + 2,
            available: 128,
        };
        assert_eq!(robot.ask(warm), Err(refused));
        robot.run_us(20_000);
        let status = robot.status();
        assert_eq!((status.mission, status.missed), (Some(hash(&blob)), 0));
        // Nothing is lost by it: both buffers and the table are there.
        for round in 0..4 {
            let next = if round % 2 == 0 { &other } else { &blob };
            assert_eq!(robot.upload(next), Ok(Answer::Committed(hash(next))));
        }
        let (small, next) = (listening(1, false), listening(2, true));
        robot.start(&small);
        robot.send(&next);
        assert_eq!(robot.ask(warm), Ok(Answer::Committed(hash(&next))));
    });
}
