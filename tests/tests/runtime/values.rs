//! Telemetry: values on nets, as they were between two macro steps, for as long as their mission
//! runs.

use esm_link::message::{Capacity, LinkError, Request, Swap};
use esm_link::telemetry::MAX_VALUE_WORDS;

use crate::mission::{Mission, hash};
use crate::robot::{Answer, Bench, Values, signature, with_robot};
use crate::warm::listening;
use crate::{SLOTS, counting};

fn ask(what: u16, mission: u32, numbers: &[u16]) -> Vec<u8> {
    let mission = [mission as u16, (mission >> 16) as u16];
    let all = [&[what], &mission[..], numbers].concat();
    all.iter().flat_map(|number| number.to_le_bytes()).collect()
}

/// Asks for values: a sample each so many milliseconds at most, of these nets.
pub fn ask_values(mission: u32, period_ms: u16, nets: &[u16]) -> Vec<u8> {
    ask(1, mission, &[&[period_ms], nets].concat())
}

/// Asks what values on a net are made of.
pub fn ask_fields(mission: u32, net: u16, offset: u16) -> Vec<u8> {
    ask(0, mission, &[net, offset])
}

/// Asks for values, and takes away those that came before. Answers the number that the new ones
/// have.
fn want(robot: &mut Bench<'_, '_, '_>, blob: &[u8], period_ms: u16, nets: &[u16]) -> u8 {
    let ask = ask_values(hash(blob), period_ms, nets);
    assert_eq!(robot.ask(Request::Values { ask: &ask }), Ok(Answer::Done));
    robot.values.clear();
    robot.last_number()
}

/// The source counts at 2 and 7 ms of each 10, and the interpreter starts at 0.
fn counted_at(t_us: u64) -> u32 {
    2 * (t_us / 10_000) as u32
}

#[test]
fn a_sample_has_what_was_on_the_nets_when_its_macro_step_was_made() {
    with_robot(|robot| {
        let blob = listening(1, false);
        robot.start(&blob);
        for (period_ms, apart_us) in [(0, 10_000), (10, 10_000), (25, 30_000), (30, 30_000)] {
            let number = want(robot, &blob, period_ms, &[0]);
            robot.run_us(200_000);
            let times: Vec<u64> = robot
                .values
                .iter()
                .map(|values| match values {
                    Values::Sample(of, 1, t_us, words) if *of == number => {
                        assert_eq!(words, &[counted_at(*t_us)], "at {t_us} us");
                        *t_us
                    }
                    other => panic!("{other:?}"),
                })
                .collect();
            assert!(times.len() >= 6, "{times:?}");
            assert!(
                times.windows(2).all(|pair| pair[1] - pair[0] == apart_us),
                "each {period_ms} ms: {times:?}"
            );
        }
        assert_eq!(robot.samples_dropped, 0);
    });
}

#[test]
fn a_net_that_nothing_was_written_to_has_no_value() {
    with_robot(|robot| {
        // The thinker reads what the source counts, thinks about it in slot 0, and somebody listens
        // to both.
        let blob = Mission::new(&SLOTS)
            .task(signature::SOURCE, None)
            .task(signature::SINK, None)
            .task(signature::THINKER, None)
            .region(&[("Count", "Source", 2, &[1_000])], &["initial -> Count"])
            .region(&[("Listen", "Sink", 2, &[1])], &["initial -> Listen"])
            .region(&[("Think", "Thinker", 0, &[])], &["initial -> Think"])
            .path((0, 0, 0), (2, 0, 0))
            .path((2, 0, 1), (1, 0, 0))
            .blob();
        robot.background_runs = false;
        robot.start(&blob);
        want(robot, &blob, 0, &[1, 0]);
        robot.run_us(50_000);
        let Some(Values::Sample(_, first, _, before)) = robot.values.last().cloned() else {
            panic!("{:?}", robot.values);
        };
        robot.background_runs = true;
        robot.run_us(50_000);
        let Some(Values::Sample(_, both, t_us, after)) = robot.values.last().cloned() else {
            panic!("{:?}", robot.values);
        };
        // Which of the two nets is number 0 is the compiler's affair.
        assert_eq!((first.count_ones(), before.len()), (1, 1));
        assert_eq!((both, after.len()), (0b11, 2));
        assert!(after.contains(&counted_at(t_us)), "{after:?}");
        assert!(after.iter().any(|word| *word >= 100), "{after:?}");
    });
}

#[test]
fn values_end_with_their_mission_and_outlast_a_stop() {
    with_robot(|robot| {
        let blob = listening(1, false);
        robot.start(&blob);
        let number = want(robot, &blob, 0, &[0]);
        // Standing still makes no macro steps; started again, the same mission has the same nets.
        robot.ask(Request::Stop).unwrap();
        robot.values.clear();
        robot.run_us(100_000);
        assert_eq!(robot.values, []);
        robot.ask(Request::Start).unwrap();
        robot.run_us(30_000);
        assert!(
            matches!(robot.values[..], [Values::Sample(of, ..), ..] if of == number),
            "{:?}",
            robot.values
        );
        // Warm or not, another one has others.
        for (other, warm) in [(listening(2, true), true), (listening(1, false), false)] {
            robot.send(&other);
            let trial_ms = 0;
            let swapped = robot.ask(Request::Commit(Swap { warm, trial_ms }));
            assert!(matches!(swapped, Ok(Answer::Committed(_))), "{swapped:?}");
            robot.run_us(50_000);
            let ended = |values: &Values| matches!(values, Values::Ended(_));
            let ends = robot.values.iter().filter(|values| ended(values)).count();
            assert_eq!(ends, 1);
            assert!(robot.values.last().is_some_and(ended), "{:?}", robot.values);
            want(robot, &other, 0, &[0]);
            robot.run_us(50_000);
            assert!(!robot.values.is_empty());
        }
        // A new session has none, and is told of none.
        robot.ask(Request::Hello).unwrap();
        robot.values.clear();
        robot.run_us(50_000);
        robot.start(&counting(3).blob());
        robot.run_us(50_000);
        assert_eq!(robot.values, []);
    });
}

#[test]
fn what_cannot_be_told_is_refused_and_what_was_goes_on() {
    with_robot(|robot| {
        let blob = listening(1, false);
        let mission = hash(&blob);
        let one = ask_values(mission, 0, &[0]);
        let refused = robot.ask(Request::Values { ask: &one });
        assert_eq!(refused, Err(LinkError::NoMission));
        robot.start(&blob);
        let number = want(robot, &blob, 0, &[0; MAX_VALUE_WORDS]);
        let too_many = |needed| LinkError::CapacityExceeded {
            what: Capacity::Nets,
            needed,
            available: 20,
        };
        for (ask, error) in [
            (ask_values(mission ^ 1, 0, &[0]), LinkError::OtherMission),
            (ask_values(mission, 0, &[1]), LinkError::NoSuchIndex),
            (
                ask_values(mission, 0, &[0, u16::MAX]),
                LinkError::NoSuchIndex,
            ),
            (ask_values(mission, 0, &[0; 21]), too_many(21)),
            // As much of it as the robot looks at.
            (ask_values(mission, 0, &[0; 80]), too_many(60)),
            (ask(2, mission, &[0, 0]), LinkError::Malformed),
            (one[1..].to_vec(), LinkError::Malformed),
            (one[..6].to_vec(), LinkError::Malformed),
        ] {
            let refused = robot.ask(Request::Values { ask: &ask });
            assert_eq!(refused, Err(error), "{ask:?}");
        }
        robot.values.clear();
        robot.run_us(50_000);
        assert!(
            matches!(robot.values[..], [Values::Sample(of, ..), ..] if of == number),
            "{:?}",
            robot.values
        );
        let ended = robot.ask(Request::Values { ask: &[] });
        assert_eq!(ended, Ok(Answer::Done));
        robot.values.clear();
        robot.run_us(50_000);
        assert_eq!(robot.values, []);
    });
}

#[test]
fn the_robot_says_what_values_are_made_of() {
    with_robot(|robot| {
        let blob = listening(1, false);
        let mission = hash(&blob);
        let fields = |robot: &mut Bench<'_, '_, '_>, mission, net, offset| {
            let ask = ask_fields(mission, net, offset);
            robot.ask(Request::Values { ask: &ask })
        };
        assert_eq!(fields(robot, mission, 0, 0), Err(LinkError::NoMission));
        robot.start(&blob);
        let text = |text: &[u8]| Ok(Answer::Bytes(5, text.to_vec()));
        assert_eq!(fields(robot, mission, 0, 0), text(b":u32\n"));
        assert_eq!(fields(robot, mission, 0, 2), text(b"32\n"));
        for offset in [5, 900, u16::MAX] {
            assert_eq!(fields(robot, mission, 0, offset), text(b""));
        }
        for (mission, net, error) in [
            (mission, 1, LinkError::NoSuchIndex),
            (mission, u16::MAX, LinkError::NoSuchIndex),
            (mission ^ 1, 0, LinkError::OtherMission),
        ] {
            assert_eq!(fields(robot, mission, net, 0), Err(error));
        }
    });
}
