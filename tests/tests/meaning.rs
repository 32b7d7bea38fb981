//! The points of the language's meaning that are easy to get wrong, one small machine each, with
//! what must come out written down. Both the reference and the interpreter are held against it, so
//! that an error that both share is found too.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use esm_tests::scenario::{Action, Entry, Scenario};
use esm_tests::{reference, subject};

const HEAD: &str = "interpreter slot 1; slot 1 period 10 ms duration 1 ms; slot 2 period 10 ms duration 1 ms;\n\
     task Work slot 2 { in flag hurry; out flag near; }\n\
     task Save slot 0 { out flag full; }\n";

struct Case {
    says: &'static str,
    machine: &'static str,
    /// Time in milliseconds and what happens.
    entries: &'static [(u64, Change)],
    until_ms: u64,
    /// For each macro step: transitions as `from>to`, and what is current at its end.
    steps: &'static [(&'static str, &'static str)],
    fault: Option<&'static str>,
}

enum Change {
    Set(&'static str, &'static str),
    Exit(&'static str),
    Busy(&'static str),
}

impl Change {
    fn action(&self) -> Action {
        match *self {
            Change::Set(state, flag) => Action::Write {
                state: state.to_owned(),
                flag: flag.to_owned(),
                value: true,
            },
            Change::Exit(state) => Action::Exit {
                state: state.to_owned(),
            },
            Change::Busy(state) => Action::Busy {
                state: state.to_owned(),
                value: true,
            },
        }
    }
}

const CASES: &[Case] = &[
    Case {
        says: "one level a pulse: the way down through two superstates takes three",
        machine: "container Inner { region r { state A; initial -> A; } }
            container Outer { region r { super In: Inner; initial -> In; } }
            machine M { region r { super Out: Outer; initial -> Out; } }",
        entries: &[],
        until_ms: 30,
        steps: &[
            ("r/initial>r/Out", "r/Out r/Out/r/initial"),
            ("r/Out/r/initial>r/Out/r/In", "r/Out r/Out/r/In r/Out/r/In/r/initial"),
            ("r/Out/r/In/r/initial>r/Out/r/In/r/A", "r/Out r/Out/r/In r/Out/r/In/r/A"),
            ("", "r/Out r/Out/r/In r/Out/r/In/r/A"),
        ],
        fault: None,
    },
    Case {
        says: "an event in the same macro step takes the inside one level further, if its first transition is on that event",
        machine: "container In { in event Go; region r { state A; initial -> A on Go; } }
            machine M { event Go; region r { super S: In; initial -> S / send Go; } }",
        entries: &[],
        until_ms: 0,
        steps: &[("r/initial>r/S r/S/r/initial>r/S/r/A", "r/S r/S/r/A")],
        fault: None,
    },
    Case {
        says: "outer before inner: what is inside a superstate that left is not visited",
        machine: "container In { region r { state A; state B; initial -> A; A -> B; } }
            machine M { region r { super S: In; task W: Work; initial -> S; S -> W [timeout]; } }",
        entries: &[],
        until_ms: 20,
        steps: &[
            ("r/initial>r/S", "r/S r/S/r/initial"),
            ("r/S/r/initial>r/S/r/A", "r/S r/S/r/A"),
            ("r/S/r/A>r/S/r/B", "r/S r/S/r/B"),
        ],
        fault: None,
    },
    Case {
        says: "a timeout is strict: at the limit exactly nothing happens",
        machine: "machine M { region r { state A timeout 20 ms; state B; initial -> A; A -> B [timeout]; } }",
        entries: &[],
        until_ms: 30,
        steps: &[
            ("r/initial>r/A", "r/A"),
            ("", "r/A"),
            ("", "r/A"),
            ("r/A>r/B", "r/B"),
        ],
        fault: None,
    },
    Case {
        says: "a self-transition starts timer and flags anew",
        machine: "machine M { region r { task A: Work timeout 10 ms; state B; initial -> A; A -> A [.near]; A -> B [timeout]; } }",
        entries: &[(10, Change::Set("r/A", "near"))],
        until_ms: 30,
        steps: &[
            ("r/initial>r/A", "r/A"),
            ("r/A>r/A", "r/A"),
            ("", "r/A"),
            ("r/A>r/B", "r/B"),
        ],
        fault: None,
    },
    Case {
        says: "any region's final sets the exit flag, the other regions go on until the superstate is left",
        machine: "container In { region a { state A; initial -> A; A -> final; } region b { state B; initial -> B; } }
            machine M { region r { super S: In; state Done; initial -> S; S -> Done on *; } }",
        entries: &[],
        until_ms: 30,
        steps: &[
            ("r/initial>r/S", "r/S r/S/a/initial r/S/b/initial"),
            ("r/S/a/initial>r/S/a/A r/S/b/initial>r/S/b/B", "r/S r/S/a/A r/S/b/B"),
            ("r/S/a/A>r/S/a/final", "r/S r/S/a/final r/S/b/B"),
            ("r/S>r/Done", "r/Done"),
        ],
        fault: None,
    },
    Case {
        says: "a flag set in a region is seen by later regions in the same micro step, by earlier ones from the next event on",
        machine: "container In { out flag f;
              region before { state A; state B; initial -> A; A -> B [^f]; }
              region writer { state A; state B; initial -> A; A -> B / set ^f; }
              region after  { state A; state B; initial -> A; A -> B [^f]; } }
            machine M { region r { super S: In; initial -> S; } }",
        entries: &[],
        until_ms: 30,
        steps: &[
            ("r/initial>r/S", "r/S r/S/before/initial r/S/writer/initial r/S/after/initial"),
            (
                "r/S/before/initial>r/S/before/A r/S/writer/initial>r/S/writer/A r/S/after/initial>r/S/after/A",
                "r/S r/S/before/A r/S/writer/A r/S/after/A",
            ),
            (
                "r/S/writer/A>r/S/writer/B r/S/after/A>r/S/after/B",
                "r/S r/S/before/A r/S/writer/B r/S/after/B",
            ),
            ("r/S/before/A>r/S/before/B", "r/S r/S/before/B r/S/writer/B r/S/after/B"),
        ],
        fault: None,
    },
    Case {
        says: "an event goes up where it is an out event, and down again where it is an in event",
        machine: "container Up { out event E; region r { state A; initial -> A / send E; } }
            container Down { in event E; region r { state A; state B; initial -> A; A -> B on E; } }
            container Deaf { event E; region r { state A; state B; initial -> A; A -> B on E; } }
            machine M { event E;
              region down { super D: Down; initial -> D; }
              region deaf { super D: Deaf; initial -> D; }
              region up { super U: Up; state Late timeout 0 ms; initial -> Late; Late -> U [timeout]; }
              region own { state A; state B; initial -> A; A -> B on E; } }",
        entries: &[],
        until_ms: 20,
        steps: &[
            (
                "down/initial>down/D deaf/initial>deaf/D up/initial>up/Late own/initial>own/A",
                "down/D down/D/r/initial deaf/D deaf/D/r/initial up/Late own/A",
            ),
            (
                "down/D/r/initial>down/D/r/A deaf/D/r/initial>deaf/D/r/A up/Late>up/U",
                "down/D down/D/r/A deaf/D deaf/D/r/A up/U up/U/r/initial own/A",
            ),
            (
                "up/U/r/initial>up/U/r/A down/D/r/A>down/D/r/B own/A>own/B",
                "down/D down/D/r/B deaf/D deaf/D/r/A up/U up/U/r/A own/B",
            ),
        ],
        fault: None,
    },
    Case {
        says: "the busy flag of a superstate is that of any active task state inside it",
        machine: "container In { region r { task W: Work; initial -> W; } }
            machine M { region r { super S: In; state Waiting; initial -> S; S -> Waiting [busy]; } }",
        entries: &[(20, Change::Busy("r/S/r/W"))],
        until_ms: 20,
        steps: &[
            ("r/initial>r/S", "r/S r/S/r/initial"),
            ("r/S/r/initial>r/S/r/W", "r/S r/S/r/W"),
            ("r/S>r/Waiting", "r/Waiting"),
        ],
        fault: None,
    },
    Case {
        says: "the first transition in the source wins",
        machine: "machine M { region r { task A: Work; state B; state C; initial -> A; A -> B on *; A -> C [exit]; } }",
        entries: &[(10, Change::Exit("r/A"))],
        until_ms: 10,
        steps: &[("r/initial>r/A", "r/A"), ("r/A>r/B", "r/B")],
        fault: None,
    },
    Case {
        says: "a fault ends the trace; the transition that overflows the queue is not taken",
        machine: "machine M { event E; region r { state A; state B; initial -> A; A -> B / send E, send E, send E; } }",
        entries: &[],
        until_ms: 50,
        steps: &[("r/initial>r/A", "r/A")],
        fault: Some(r#"{"kind":"fault","step":1,"t_us":10000,"code":"event-queue-overflow"}"#),
    },
];

#[test]
fn small_machines_do_what_is_written_beside_them() {
    for case in CASES {
        let queue = if case.fault.is_some() { "queue 2;" } else { "" };
        let text = format!("{queue}{HEAD}{}", case.machine);
        let built = subject::build(&text).unwrap_or_else(|cause| panic!("{}: {cause}", case.says));
        let entries = case.entries.iter().map(|(at_ms, change)| Entry {
            at_us: at_ms * 1_000,
            action: change.action(),
        });
        let scenario = Scenario {
            period_us: None,
            until_us: case.until_ms * 1_000,
            entries: entries.collect(),
        };
        let reference = reference::run(&built.model, &scenario).trace;
        let interpreter = subject::simulate(&built.blob, &scenario).unwrap().trace;
        for (who, trace) in [("reference", reference), ("interpreter", interpreter)] {
            let (steps, fault) = outline(&trace);
            let expected: Vec<(String, String)> = case
                .steps
                .iter()
                .map(|&(taken, active)| (taken.to_owned(), active.to_owned()))
                .collect();
            assert_eq!(steps, expected, "{}, by the {who}", case.says);
            assert_eq!(fault.as_deref(), case.fault, "{}, by the {who}", case.says);
        }
    }
}

/// The transitions and the current states of each macro step, and the fault at the end.
fn outline(trace: &[String]) -> (Vec<(String, String)>, Option<String>) {
    let mut steps = Vec::new();
    let mut taken = Vec::new();
    for line in trace {
        let value: serde_json::Value = serde_json::from_str(line).unwrap();
        let text = |value: &serde_json::Value| value.as_str().unwrap().to_owned();
        match value["kind"].as_str().unwrap() {
            "transition" => taken.push(format!("{}>{}", text(&value["from"]), text(&value["to"]))),
            "step" => {
                let active: Vec<String> = value["active"]
                    .as_array()
                    .unwrap()
                    .iter()
                    .map(text)
                    .collect();
                steps.push((std::mem::take(&mut taken).join(" "), active.join(" ")));
            }
            _ => return (steps, Some(line.clone())),
        }
    }
    (steps, None)
}

/// A machine whose first macro step has exactly as many micro steps as it has events sent one after
/// another, and one for the pulse.
fn chain(micro_steps: usize) -> String {
    let mut text = format!("{HEAD}machine M {{ event E; region r {{\n");
    for state in 0..micro_steps {
        text += &format!("state s{state};\n");
    }
    let send = |state: usize| {
        if state + 1 < micro_steps {
            " / send E"
        } else {
            ""
        }
    };
    text += &format!("initial -> s0{};\n", send(0));
    for state in 1..micro_steps {
        text += &format!("s{} -> s{state} on E{};\n", state - 1, send(state));
    }
    text + "} }"
}

#[test]
fn a_macro_step_has_at_most_255_micro_steps() {
    let scenario = Scenario::default();
    for (micro_steps, last) in [
        (1, r#""micro_steps":1,"#),
        (254, r#""micro_steps":254,"#),
        (255, r#""micro_steps":255,"#),
        (256, r#""code":"macro-step-limit""#),
        (300, r#""code":"macro-step-limit""#),
    ] {
        let built = subject::build(&chain(micro_steps)).unwrap();
        let reference = reference::run(&built.model, &scenario).trace;
        let interpreter = subject::simulate(&built.blob, &scenario).unwrap().trace;
        assert_eq!(reference, interpreter, "{micro_steps} micro steps");
        let end = interpreter.last().unwrap();
        assert!(end.contains(last), "{micro_steps} micro steps end in {end}");
        assert_eq!(interpreter.len(), micro_steps.min(255) + 1);
    }
}

#[test]
fn a_run_of_slot_0_outlives_its_state() {
    let text = format!(
        "{HEAD}machine M {{ region r {{ task A: Save timeout 0 ms; task B: Work; initial -> A; A -> B [timeout]; }} }}"
    );
    let built = subject::build(&text).unwrap();
    let scenario = Scenario {
        period_us: None,
        until_us: 30_000,
        entries: vec![Entry {
            at_us: 30_000,
            action: Change::Exit("r/A").action(),
        }],
    };
    let trace = subject::simulate(&built.blob, &scenario).unwrap().trace;
    assert_eq!(trace, reference::run(&built.model, &scenario).trace);
    let enabled: Vec<serde_json::Value> = trace
        .iter()
        .map(|line| serde_json::from_str::<serde_json::Value>(line).unwrap())
        .filter(|line| line["kind"] == "step")
        .map(|line| line["enabled"].clone())
        .collect();
    let expected = [
        serde_json::json!(["r/A"]),
        serde_json::json!(["r/A", "r/B"]),
        serde_json::json!(["r/A", "r/B"]),
        serde_json::json!(["r/B"]),
    ];
    assert_eq!(enabled, expected);
}

#[test]
fn a_timeout_is_seen_however_long_the_period() {
    // 4,000 s is the longest limit; times go on beyond 32 bits of microseconds.
    let text = format!(
        "{HEAD}machine M {{ region r {{ state A timeout 4000 s; state B; initial -> A; A -> B [timeout]; }} }}"
    );
    let built = subject::build(&text).unwrap();
    for period_us in [3_999_999_999, 4_000_000_000, 3_000_000_000, 1_500_000_000] {
        let scenario = Scenario {
            period_us: Some(period_us),
            until_us: 20_000_000_000,
            entries: Vec::new(),
        };
        let reference = reference::run(&built.model, &scenario).trace;
        let interpreter = subject::simulate(&built.blob, &scenario).unwrap().trace;
        assert_eq!(interpreter, reference, "period {period_us} us");
        assert!(
            interpreter
                .iter()
                .any(|line| line.contains(r#""to":"r/B""#)),
            "period {period_us} us"
        );
    }
}
