//! Machines and scenarios as text, and what must come of them.

use super::{FailureCause, Outcome, run};
use crate::samples::{FLOOD, ROVER, directory_and_blob};
use crate::scenario;
use crate::scenario::Mistake;
use crate::scenario::ports::Ports;
use crate::sim;

struct Ran {
    outcome: Outcome,
    /// The lines of the trace.
    trace: Vec<String>,
}

fn bind(machine: &str, text: &str) -> Result<Ran, Vec<Mistake>> {
    let (directory, blob) = directory_and_blob(machine);
    let verified = esm_core::verify(blob).unwrap();
    let ports = Ports::of(&verified.tables(), &directory);
    let bound = scenario::bind::bind(&scenario::parse(text)?, &directory, &ports)?;
    let mut trace = Vec::new();
    let outcome = run(verified, &directory, &bound, &mut trace).unwrap();
    let trace = String::from_utf8(trace)
        .unwrap()
        .lines()
        .map(String::from)
        .collect();
    Ok(Ran { outcome, trace })
}

fn simulated(machine: &str, text: &str) -> Ran {
    bind(machine, text).unwrap_or_else(|mistakes| panic!("{mistakes:?}"))
}

#[test]
fn a_trace_says_what_happened_to_the_letter() {
    let ran = simulated(ROVER, "at 5 ms set motion/Cruise.near\nuntil 30 ms");
    let expected = [
        r#"{"kind":"transition","step":0,"micro":0,"t_us":0,"event":"pulse","from":"motion/initial","to":"motion/Cruise","sent":[],"set":[],"cleared":[]}"#,
        r#"{"kind":"transition","step":0,"micro":0,"t_us":0,"event":"pulse","from":"safety/initial","to":"safety/Watch","sent":[],"set":[],"cleared":[]}"#,
        r#"{"kind":"step","step":0,"t_us":0,"micro_steps":1,"active":["motion/Cruise","safety/Watch"],"enabled":["motion/Cruise"]}"#,
        r#"{"kind":"transition","step":1,"micro":0,"t_us":10000,"event":"pulse","from":"motion/Cruise","to":"motion/Escape","sent":["Obstacle"],"set":["motion/Escape.fast"],"cleared":[]}"#,
        r#"{"kind":"transition","step":1,"micro":1,"t_us":10000,"event":"Obstacle","from":"safety/Watch","to":"safety/Note","sent":[],"set":[],"cleared":[]}"#,
        r#"{"kind":"step","step":1,"t_us":10000,"micro_steps":2,"active":["motion/Escape","motion/Escape/turn/initial","safety/Note"],"enabled":["safety/Note"]}"#,
        r#"{"kind":"transition","step":2,"micro":0,"t_us":20000,"event":"pulse","from":"motion/Escape/turn/initial","to":"motion/Escape/turn/Back","sent":[],"set":["motion/Escape/turn/Back.fast"],"cleared":[]}"#,
        r#"{"kind":"step","step":2,"t_us":20000,"micro_steps":1,"active":["motion/Escape","motion/Escape/turn/Back","safety/Note"],"enabled":["motion/Escape/turn/Back","safety/Note"]}"#,
        r#"{"kind":"step","step":3,"t_us":30000,"micro_steps":1,"active":["motion/Escape","motion/Escape/turn/Back","safety/Note"],"enabled":["motion/Escape/turn/Back","safety/Note"]}"#,
    ];
    assert_eq!(ran.trace, expected);
    assert_eq!((ran.outcome.steps, ran.outcome.transitions), (4, 5));
}

#[test]
fn flags_through_the_caret_carry_the_path_of_the_superstate() {
    let ran = simulated(
        ROVER,
        "at 0 s set motion/Cruise.near\nat 5 ms set motion/Cruise.near\nat 35 ms exit motion/Escape/turn/Back\nuntil 40 ms",
    );
    let line = ran
        .trace
        .iter()
        .find(|line| line.contains("\"to\":\"motion/Escape/turn/Turn\""))
        .unwrap();
    assert!(
        line.ends_with(
            r#""sent":[],"set":["motion/Escape.done"],"cleared":["motion/Escape.idle"]}"#
        ),
        "{line}"
    );
}

/// Expectations hold, in scenarios that would fail if any of the rules were otherwise.
#[test]
fn scenarios_hold() {
    let cases = [
        (
            "a state is current from the macro step that enters it",
            "at 0 s expect motion/Cruise\nuntil 0 s",
        ),
        (
            "an expectation between two macro steps waits for the next",
            "at 1 ms set motion/Cruise.near\nat 1 ms expect motion/Escape\nat 0 s expect not motion/Escape\nuntil 10 ms",
        ),
        (
            "a line between two macro steps waits for the next",
            "at 9999 us set motion/Cruise.near\nat 0 ms expect not motion/Cruise.near\nat 10 ms expect motion/Escape\nuntil 10 ms",
        ),
        (
            "a line at a macro step takes effect before it",
            "at 10 ms set motion/Cruise.near\nat 10 ms expect motion/Escape\nuntil 10 ms",
        ),
        (
            "times come before places in the file",
            "until 10 ms\nat 10 ms expect motion/Cruise\nat 8 ms clear motion/Cruise.near\nat 7 ms set motion/Cruise.near",
        ),
        (
            "equal times take effect in the order of the file",
            "at 7 ms clear motion/Cruise.near\nat 7 ms set motion/Cruise.near\nat 10 ms expect motion/Escape\nuntil 10 ms",
        ),
        (
            "entering resets flags, the first time too",
            "at 0 s set motion/Cruise.near\nat 0 s expect not motion/Cruise.near\nat 10 ms expect motion/Cruise\nuntil 10 ms",
        ),
        (
            "a state that is not current keeps what is written to it",
            "at 10 ms set motion/Escape/turn/Back.near\nat 50 ms expect motion/Escape/turn/Back.near\nuntil 50 ms",
        ),
        (
            "the flags of a left state stay as they were",
            "at 10 ms set motion/Cruise.near\nat 20 ms expect motion/Cruise.near\nat 20 ms expect motion/Escape\nuntil 20 ms",
        ),
        (
            "a report of a state that is not current sets its flag",
            "at 10 ms exit motion/Escape/turn/Turn\nat 10 ms expect motion/Escape/turn/Turn.exit\nat 10 ms expect motion/Cruise\nuntil 10 ms",
        ),
        (
            "entering resets a report that came too early",
            "at 10 ms set motion/Cruise.near\nat 10 ms exit motion/Escape/turn/Back\nat 10 ms expect motion/Escape/turn/Back.exit\nat 20 ms expect motion/Escape/turn/Back\nat 20 ms expect not motion/Escape/turn/Back.exit\nat 30 ms expect motion/Escape/turn/Back\nuntil 30 ms",
        ),
        (
            "what is inside a superstate that is not current is not current",
            "at 10 ms expect not motion/Escape/turn/initial\nat 10 ms expect not motion/Escape/turn/Back\nuntil 10 ms",
        ),
        (
            "pseudo-states can be looked at",
            "at 10 ms set motion/Cruise.near\nat 10 ms expect motion/Escape/turn/initial\nat 20 ms exit motion/Escape/turn/Back\nat 20 ms expect not motion/Escape/turn/initial\nuntil 20 ms",
        ),
        (
            "uses of a container have flags and states of their own",
            "at 10 ms set motion/Cruise.near\nat 30 ms exit motion/Escape/turn/Back\nat 40 ms exit motion/Escape/turn/Turn\nat 40 ms expect motion/Escape/turn/final\nat 40 ms expect motion/Escape.done\nat 40 ms expect motion/Escape.exit\nat 50 ms expect motion/Again\nat 50 ms expect not motion/Again.done\nat 60 ms expect motion/Again/turn/Back\nat 60 ms expect not motion/Again/turn/Back.fast\nuntil 60 ms",
        ),
        (
            "timeouts are strict",
            "at 30 ms expect not safety/Watch.timeout\nat 30 ms expect safety/Watch\nat 40 ms expect safety/Watch\nuntil 40 ms",
        ),
        (
            "a timer starts with its state",
            "at 10 ms set motion/Cruise.near\nat 40 ms expect not motion/Escape/turn/Back.timeout\nat 50 ms expect motion/Escape/turn/Turn\nuntil 50 ms",
        ),
        (
            "busy is what the scenario says",
            "at 10 ms busy motion/Cruise\nat 20 ms expect motion/Cruise.busy\nat 30 ms free motion/Cruise\nat 30 ms expect not motion/Cruise.busy\nuntil 30 ms",
        ),
        (
            "a superstate is busy while an active task state in it is",
            "at 10 ms set motion/Cruise.near\nat 20 ms busy motion/Again/turn/Back\nat 30 ms expect not motion/Escape.busy\nat 30 ms expect not motion/Again.busy\nat 40 ms busy motion/Escape/turn/Back\nat 40 ms expect motion/Escape.busy\nuntil 40 ms",
        ),
        (
            "another period makes other times",
            "period 7 ms\nat 8 ms set motion/Cruise.near\nat 7 ms expect motion/Cruise\nat 14 ms expect motion/Escape\nuntil 20 ms",
        ),
    ];
    for (law, text) in cases {
        let ran = simulated(ROVER, text);
        assert_eq!(ran.outcome.failures, [], "{law}");
        assert!(ran.outcome.met > 0 && ran.outcome.is_good(), "{law}");
    }
}

#[test]
fn the_last_macro_step_is_the_last_multiple_not_above_until() {
    let cases = [
        ("until 0 s", 1),
        ("until 9 ms", 1),
        ("until 10 ms", 2),
        ("until 29999 us", 3),
        ("period 3 ms\nuntil 9 ms", 4),
    ];
    for (text, steps) in cases {
        assert_eq!(simulated(ROVER, text).outcome.steps, steps, "{text}");
    }
}

#[test]
fn a_run_in_slot_0_stays_enabled_until_its_end() {
    let text = "at 10 ms set motion/Cruise.near\nat 50 ms exit safety/Note\nuntil 60 ms";
    let enabled = |machine: &str| -> Vec<bool> {
        let steps = simulated(machine, text)
            .trace
            .into_iter()
            .filter(|line| line.contains("\"kind\":\"step\""));
        steps
            .map(|line| {
                line.split("\"enabled\"")
                    .nth(1)
                    .is_some_and(|enabled| enabled.contains("safety/Note"))
            })
            .collect()
    };
    // Entered at 10 ms; its own exit ends it at 50 ms.
    assert_eq!(
        enabled(ROVER),
        [false, true, true, true, true, false, false]
    );
    // The same where the state is left at 20 ms: leaving does not end the run.
    let leaving = ROVER.replace("Note -> Watch on *;", "Note -> Watch;");
    assert_eq!(
        enabled(&leaving),
        [false, true, true, true, true, false, false]
    );
    assert!(
        simulated(&leaving, text).trace.iter().any(|line| line
            .contains("\"from\":\"safety/Note\"")
            && line.contains("\"t_us\":20000"))
    );
}

#[test]
fn a_failed_expectation_says_what_was_there_instead() {
    let ran = simulated(
        ROVER,
        "at 10 ms set motion/Cruise.near\nat 20 ms expect not motion/Cruise.near\n at 15 ms expect safety/Watch\nuntil 20 ms",
    );
    let failures: Vec<String> = ran
        .outcome
        .failures
        .iter()
        .map(|failure| format!("{}: {failure}", failure.name.place))
        .collect();
    let expected = [
        "3:18: expected `safety/Watch` at 15 ms, but after the macro step at 20 ms current was motion/Escape, \
         motion/Escape/turn/Back, safety/Note",
        "2:21: expected not `motion/Cruise.near` at 20 ms, but of `motion/Cruise` near was set; after the macro step at 20 ms \
         current was motion/Escape, motion/Escape/turn/Back, safety/Note",
    ];
    assert_eq!(failures, expected);
    assert!(!ran.outcome.is_good());
}

#[test]
fn an_expectation_that_no_macro_step_follows_fails() {
    let cases = [
        ("at 21 ms expect motion/Cruise\nuntil 20 ms", 20_000),
        ("at 15 ms expect motion/Cruise\nuntil 19 ms", 10_000),
    ];
    for (text, last_us) in cases {
        let outcome = simulated(ROVER, text).outcome;
        let causes: Vec<_> = outcome
            .failures
            .into_iter()
            .map(|failure| failure.cause)
            .collect();
        assert_eq!(causes, [FailureCause::AfterUntil { last_us }], "{text}");
    }
}

/// Two regions that answer each other for ever.
const PING_PONG: &str = "
    interpreter slot 1;
    slot 1 period 10 ms duration 1 ms;
    machine PingPong {
        event Ping, Pong;
        region first { state A; state B; initial -> A; A -> B / send Ping; B -> B on Pong / send Ping; }
        region second { state A; initial -> A; A -> A on Ping / send Pong; }
    }";

#[test]
fn a_fault_ends_the_trace_and_fails_what_comes_after() {
    let cases = [
        (FLOOD, "event-queue-overflow"),
        (PING_PONG, "macro-step-limit"),
    ];
    for (machine, code) in cases {
        let ran = simulated(
            machine,
            "at 0 s expect first/A\nat 10 ms expect first/B\nat 20 ms expect first/B\nuntil 50 ms",
        );
        let last = format!("{{\"kind\":\"fault\",\"step\":1,\"t_us\":10000,\"code\":\"{code}\"}}");
        assert_eq!(ran.trace.last(), Some(&last));
        assert_eq!(
            ran.trace
                .iter()
                .filter(|line| line.contains("\"kind\":\"step\""))
                .count(),
            1,
            "no step line in a faulted macro step"
        );
        let (at, fault) = ran.outcome.fault.unwrap();
        assert_eq!((at.step, at.t_us, fault.code()), (1, 10_000, code));
        assert_eq!(ran.outcome.met, 1);
        let causes: Vec<_> = ran
            .outcome
            .failures
            .iter()
            .map(|failure| failure.cause.clone())
            .collect();
        assert_eq!(
            causes,
            [
                FailureCause::AfterFault { t_us: 10_000 },
                FailureCause::AfterFault { t_us: 10_000 }
            ],
            "{code}"
        );
        assert!(!ran.outcome.is_good());
    }
}

#[test]
fn an_overflowing_transition_leaves_no_line() {
    let ran = simulated(FLOOD, "until 10 ms");
    let sends: Vec<&String> = ran
        .trace
        .iter()
        .filter(|line| line.contains("\"sent\":[\"E\",\"E\"]"))
        .collect();
    // The queue holds four: after the first micro step one E, then two, three, four; the next pair
    // does not fit.
    let micro: Vec<&str> = sends
        .iter()
        .filter_map(|line| line.split("\"micro\":").nth(1)?.split(',').next())
        .collect();
    assert_eq!(micro, ["1", "2", "3"]);
}

#[test]
fn the_root_is_finished_when_a_region_reaches_final() {
    let machine = "
        interpreter slot 1; slot 1 period 10 ms duration 1 ms;
        machine M {
            region one { state A; initial -> A; A -> final; }
            region two { state B; initial -> B; B -> B; }
        }";
    let ran = simulated(
        machine,
        "at 0 s expect one/A\nat 10 ms expect one/final\nat 30 ms expect two/B\nuntil 30 ms",
    );
    assert!(ran.outcome.is_good() && ran.outcome.finished);
    assert_eq!(ran.outcome.active, ["one/final", "two/B"]);
    assert_eq!(ran.outcome.transitions, 6, "the other region goes on");
}

#[test]
fn names_that_do_not_fit_are_told_with_their_place() {
    let cases = [
        (
            "expect motoin/Cruise",
            "1:16",
            "the machine has no region `motoin`: did you mean `motion`?",
        ),
        (
            "expect motion/Curise",
            "1:23",
            "region `motion` has no state `Curise`: did you mean `Cruise`?",
        ),
        (
            "expect motion/Escape/trun/Back",
            "1:30",
            "`motion/Escape` has no region `trun`: did you mean `turn`?",
        ),
        (
            "expect motion/Escape/turn/Forth",
            "1:35",
            "region `motion/Escape/turn` has no state `Forth`",
        ),
        (
            "expect motion/Cruise/turn/Back",
            "1:30",
            "`motion/Cruise` is no superstate: there is nothing inside it",
        ),
        ("expect motion", "1:16", "`motion` is a region"),
        ("expect motion//Cruise", "1:23", "is no path"),
        ("expect .near", "1:16", "is no path"),
        (
            "expect motion/Cruise.nera",
            "1:30",
            "`motion/Cruise` has no flag `nera`: did you mean `near`?",
        ),
        (
            "expect motion/Cruise.near.near",
            "1:30",
            "`motion/Cruise` has no flag `near.near`",
        ),
        (
            "expect safety/Watch.exit",
            "1:29",
            "`safety/Watch` has no flag `exit`",
        ),
        (
            "expect motion/initial.timeout",
            "1:31",
            "`motion/initial` has no flag `timeout`",
        ),
        (
            "set motion/Cruise",
            "1:26",
            "a flag must follow, as in `motion/Cruise.near`",
        ),
        (
            "set motion/Cruise.fast",
            "1:27",
            "`set` and `clear` take an out flag",
        ),
        (
            "clear motion/Cruise.exit",
            "1:29",
            "`set` and `clear` take an out flag",
        ),
        (
            "set motion/Escape.done",
            "1:13",
            "`set` and `clear` take an out flag of a task state",
        ),
        (
            "exit motion/Escape",
            "1:14",
            "`motion/Escape` is no task state",
        ),
        ("exit motion/Cruise.near", "1:27", "leave `.near` out"),
        (
            "busy safety/Watch",
            "1:14",
            "`safety/Watch` is no task state",
        ),
    ];
    for (line, place, message) in cases {
        let Err(mistakes) = bind(ROVER, &format!("at 1 ms {line}\nuntil 1 ms")) else {
            panic!("{line}: was taken");
        };
        assert_eq!(mistakes.len(), 1, "{line}");
        assert_eq!(mistakes[0].place.to_string(), place, "{line}");
        let said = mistakes[0].cause.to_string();
        assert!(said.contains(message), "{line}: {said}");
    }
}

#[test]
fn milliseconds_keep_what_says_something() {
    for (us, text) in [
        (0, "0"),
        (1, "0.001"),
        (1_500, "1.5"),
        (10_000, "10"),
        (1_000_000, "1000"),
    ] {
        assert_eq!(sim::milliseconds(us), text);
    }
}
