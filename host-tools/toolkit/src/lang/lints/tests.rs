//! What is said of small sets of files, and what is not.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fmt::Write as _;
use std::time::Duration;

use crate::lang::{Checked, Code, load_text, load_texts};
use crate::work_time;

const SUBJECTS: [Code; 4] = [Code::W102, Code::W104, Code::W106, Code::W107];

/// A line each: code, line, message.
fn told(checked: &Checked) -> String {
    let mut text = String::new();
    for found in &checked.diagnostics {
        if SUBJECTS.contains(&found.code) {
            let line = checked.position(found.span).line;
            let _ = writeln!(text, "{} {line}: {}", found.code, found.message);
        }
    }
    text
}

/// Sources, and beginnings of the lines that they are told, in order. Of those with `no` in front
/// of their name nothing is told.
fn compare(subject: Code, cases: &[(&str, String, &[&str])]) {
    let mut wrong = String::new();
    let mut without = 0;
    for (name, text, expected) in cases {
        let checked = load_text("case.esm", text);
        let all = told(&checked);
        let found: Vec<&str> = all
            .lines()
            .filter(|line| line.starts_with(subject.as_str()))
            .collect();
        let same = found.len() == expected.len()
            && found
                .iter()
                .zip(*expected)
                .all(|(found, expected)| found[5..].starts_with(expected));
        if !same {
            let _ = writeln!(
                wrong,
                "{name}: expected {expected:?}, found {found:#?} in\n{}",
                checked.render(false)
            );
        }
        without += usize::from(expected.is_empty());
    }
    assert!(wrong.is_empty(), "{wrong}");
    assert!(
        without >= 8,
        "only {without} sources of which nothing is said"
    );
}

/// A machine with an interpreter slot.
fn mission(rest: &str) -> String {
    format!("interpreter slot 1; slot 1 period 10 ms duration 1 ms;\n{rest}")
}

// ─── W102 ────────────────────────────────────────────────────────────────────────────────────────

#[test]
fn events_that_do_nothing_are_told() {
    // Sends or receives E all the time.
    const SENDER: &str = "region s { state S; initial -> S; S -> S / send E; }";
    const RECEIVER: &str = "region g { state R; initial -> R; R -> R on E; }";
    let two = |a: &str, b: &str, machine: &str| {
        mission(&format!(
            "container A {{ {a} }}\ncontainer B {{ {b} }}\nmachine M {{ {machine}\nregion x {{ super A: A; initial -> A; }} region y {{ super B: B; initial -> B; }} }}"
        ))
    };
    let cases: Vec<(&str, String, &[&str])> = vec![
        ("sent and received", mission(&format!("machine M {{ event E; {SENDER} {RECEIVER} }}")), &[]),
        ("received only", mission(&format!("machine M {{\nevent E; {RECEIVER} }}")), &["3: event `E` is never sent"]),
        ("sent only", mission(&format!("machine M {{\nevent E; {SENDER} }}")), &["3: event `E` is never received"]),
        ("neither", mission("machine M {\nevent E; region r { state A; initial -> A; } }"), &["3: event `E` is neither sent nor received"]),
        ("by one transition both", mission("machine M { event E; region r { state A; initial -> A / send E; A -> A on E / send E; } }"), &[]),
        (
            "each of a list by itself",
            mission(&format!("machine M {{ event E,\nF,\nG; {SENDER} {RECEIVER} region r {{ state A; initial -> A on G; }} }}")),
            &["3: event `F` is neither", "4: event `G` is never sent"],
        ),
        // Over one border and two.
        ("up and down without a word between", two(&format!("out event E; {SENDER}"), &format!("in event E; {RECEIVER}"), ""), &[]),
        ("up and down with a declaration between", two(&format!("out event E; {SENDER}"), &format!("in event E; {RECEIVER}"), "event E;"), &[]),
        (
            "not let out",
            two(&format!("event E; {SENDER}"), &format!("in event E; {RECEIVER}"), ""),
            &["2: event `E` is sent in `A`, where no receiver can see it", "3: event `E` is sent, but never where `B` can see it"],
        ),
        (
            "not let in",
            two(&format!("out event E; {SENDER}"), &format!("event E; {RECEIVER}"), ""),
            &["2: event `E` is sent in `A`", "3: event `E` is sent, but never where `B`"],
        ),
        (
            "up to a machine that does not listen",
            two(&format!("out event E; {SENDER}"), "region g { state R; initial -> R; }", "event E;"),
            &["2: event `E` is never received", "4: event `E` is never received"],
        ),
        (
            "down through a container that only passes it on",
            mission(&format!(
                "container B {{ in event E; {RECEIVER} }} container A {{ in event E; region r {{ super B: B; initial -> B; }} }}
                 machine M {{ event E; {SENDER} region r {{ super A: A; initial -> A; }} }}"
            )),
            &[],
        ),
        (
            "down through a container that does not pass it on",
            mission(&format!(
                "container B {{ in event E; {RECEIVER} }}\ncontainer A {{ region r {{ super B: B; initial -> B; }} }}\nmachine M {{ event E; {SENDER} region r {{ super A: A; initial -> A; }} }}"
            )),
            &["2: event `E` is sent, but never where `B` can see it", "4: event `E` is sent in `M`, where no receiver can see it"],
        ),
        (
            "passed on for nobody",
            mission(&format!(
                "container A {{\nin event E; region r {{ state A; initial -> A; }} }} machine M {{ event E; {SENDER} {RECEIVER} region r {{ super A: A; initial -> A; }} }}"
            )),
            &["3: event `E` comes into `A`, and nobody in it receives it"],
        ),
        (
            "heard by whoever is beside the sender, and let out to somebody who does not listen",
            mission(&format!(
                "container A {{ out event E; {SENDER} }} container B {{ in event E; {RECEIVER} }}
                 container X {{ out event E; region r {{ super A: A; initial -> A; }} region s {{ super B: B; initial -> B; }} }}
                 container Y {{ out event E; region r {{ super X: X; initial -> X; }} }} machine M {{ region r {{ super Y: Y; initial -> Y; }} }}"
            )),
            &[],
        ),
        (
            "sent to a container that only lets it out",
            mission(&format!(
                "container A {{ out event E; {SENDER} {RECEIVER} }}\nmachine M {{ event E; {SENDER} region r {{ super A: A; initial -> A; }} }}"
            )),
            &["3: event `E` is sent in `M`, where no receiver can see it"],
        ),
        // A container that is used twice is right if it is in one use.
        (
            "heard in one of two uses",
            mission(&format!(
                "container A {{ out event E; {SENDER} }} container B {{ event E; {RECEIVER} region r {{ super A: A; initial -> A; }} }}
                 machine M {{ region r {{ super A: A; super B: B; initial -> A; A -> B; }} }}"
            )),
            &[],
        ),
        // What is outside of these is not known.
        ("an unused container sends out", mission(&format!("container A {{ out event E; {SENDER} }} machine M {{ region r {{ state A; initial -> A; }} }}")), &[]),
        ("no machine, out and in", format!("container A {{ out event E; {SENDER} }} container B {{ in event E; {RECEIVER} }}"), &[]),
        ("no machine, local", format!("container A {{\nevent E; {SENDER} }}"), &["2: event `E` is never received"]),
        ("no machine, in for nobody", "container A {\nin event E; region r { state A; initial -> A; } }".into(), &["2: event `E` is never received"]),
        ("no machine, both ways", format!("container A {{ in event E; out event E; {SENDER} }}"), &[]),
        // What only follows from another mistake.
        ("a misspelt sender", mission(&format!("machine M {{ event E; {RECEIVER} region r {{ state A; initial -> A / send F; }} }}")), &[]),
        ("a misspelt receiver", mission(&format!("machine M {{ event E; {SENDER} region r {{ state A; initial -> A on Ee; }} }}")), &[]),
        ("a broken transition", mission(&format!("machine M {{ event E; {RECEIVER} region r {{ state A; initial -> A / sennd E; }} }}")), &[]),
        ("an unknown container", mission(&format!("machine M {{ event E; {RECEIVER} region r {{ super A: Aa; initial -> A; }} }}")), &[]),
        ("an unknown state", mission(&format!("machine M {{ event E; {RECEIVER} region r {{ state A; initial -> B / send E; }} }}")), &[]),
        ("recursion", mission("container A { in event E; region r { super A: A; initial -> A; } } machine M { region r { super A: A; initial -> A; } }"), &[]),
        ("two machines", mission(&format!("machine M {{ event E; {RECEIVER} }} machine N {{ event E; {RECEIVER} }}")), &[]),
    ];
    compare(Code::W102, &cases);
}

#[test]
fn of_an_event_that_nobody_sees_the_border_is_named() {
    let check = |text: &str, expected: &[(&str, &str)]| {
        let checked = load_text("case.esm", text);
        let found: Vec<(String, String)> = checked
            .diagnostics
            .iter()
            .filter(|found| found.code == Code::W102)
            .map(|found| {
                let places: Vec<String> = found
                    .related
                    .iter()
                    .map(|(span, what)| format!("{} {what}", checked.position(*span).line))
                    .collect();
                (places.join("; "), found.hint.clone().unwrap())
            })
            .collect();
        assert_eq!(found.len(), expected.len(), "{found:#?}");
        for ((places, hint), (expected_places, expected_hint)) in found.iter().zip(expected) {
            assert_eq!(places, expected_places, "{text}");
            assert!(hint.starts_with(expected_hint), "{hint}\n{text}");
        }
    };
    let inner =
        "container Inner {\nevent E; region r { state A; initial -> A;\nA -> A / send E; } }\n";
    let out = inner.replace("event E", "out event E");
    let middle = "container Middle { region r { super I: Inner; initial -> I; } }\n";
    let top = "machine M {\nevent E; region r { super S: Middle; initial -> S;\nS -> S on E; } }";
    check(
        &mission(&format!("{inner}{middle}{top}")),
        &[
            (
                "4 sent here; 8 received here, in `M`",
                "container `Inner` does not list it as `out event`: write `out event E;` there",
            ),
            (
                "8 received here; 4 sent here, in `Inner`",
                "container `Inner` does not list it as `out event`",
            ),
        ],
    );
    check(
        &mission(&format!("{out}{middle}{top}")),
        &[
            (
                "4 sent here; 8 received here, in `M`",
                "container `Middle` does not list it as `out event`",
            ),
            (
                "8 received here; 4 sent here, in `Inner`",
                "container `Middle` does not list it as `out event`",
            ),
        ],
    );
    check(
        &mission(
            "container Inner { in event E;\nregion r { state A; initial -> A on E; } }
             container Middle { region r { super I: Inner; initial -> I; } }
             machine M { event E; region r { super S: Middle; initial -> S; }\nregion s { state A; initial -> A / send E; } }",
        ),
        &[
            ("3 received here; 6 sent here, in `M`", "container `Middle` does not list it as `in event`"),
            ("6 sent here; 3 received here, in `Inner`", "container `Middle` does not list it as `in event`"),
        ],
    );
}

// ─── W104 ────────────────────────────────────────────────────────────────────────────────────────

#[test]
fn circles_of_events_are_told_once_at_their_first_send() {
    let machine = |body: &str| {
        mission(&format!(
            "machine M {{ event A, B, C; region r {{ state S; initial -> S / send A;\n{body} }} }}"
        ))
    };
    let cases: Vec<(&str, String, &[&str])> = vec![
        ("itself", machine("S -> S on A / send A;"), &["3: events cause each other in a circle within one macro step: `A` → `A`"]),
        ("two", machine("S -> S on A / send B;\nS -> S on B / send A;"), &["3: events cause each other in a circle within one macro step: `A` → `B` → `A`"]),
        ("three, and where the first stands", machine("S -> S on C\n/ send A;\nS -> S on A / send B; S -> S on B / send C;"), &["4: events cause each other in a circle within one macro step: `C` → `A` → `B` → `C`"]),
        ("two circles that share an event are one", machine("S -> S on A / send B, send C; S -> S on B / send A; S -> S on C / send A;"), &["3: events cause each other in a circle within one macro step: `A` → `B` → `A`"]),
        ("two circles", machine("S -> S on A / send A;\nS -> S on B / send B;"), &["3: ", "4: "]),
        ("a chain", machine("S -> S on A / send B; S -> S on B / send C;"), &[]),
        ("over the pulse", machine("S -> S on A / send B; S -> S / send A; S -> S on B;"), &[]),
        ("over the end of a task", mission("task T slot 1 { } machine M { event A; region r { task S: T; initial -> S; S -> S on * / send A; } region s { state S; initial -> S on A; } }"), &[]),
        (
            "over borders",
            mission(
                "container P { in event A; out event B; region r { state S; initial -> S;\nS -> S on A / send B; } }
                 machine M { event A, B; region r { super P: P; initial -> P; } region s { state S; initial -> S;\nS -> S on B / send A; } }",
            ),
            &["3: events cause each other in a circle within one macro step: `A` → `B` → `A`"],
        ),
        (
            "names alone make no circle",
            mission(
                "container P { in event A; event B; region r { state S; initial -> S; S -> S on A / send B; S -> S on B; } }
                 machine M { event A, B; region r { super P: P; initial -> P; } region s { state S; initial -> S / send B; S -> S on B / send A; } }",
            ),
            &[],
        ),
        (
            "let out and not in",
            mission(
                "container P { out event A; out event B; region r { state S; initial -> S / send A; S -> S on A / send B; } }
                 machine M { event A, B; region r { super P: P; initial -> P; } region s { state S; initial -> S; S -> S on B / send A; } }",
            ),
            &[],
        ),
        (
            "let in and not out",
            mission(
                "container P { in event A; in event B; region r { state S; initial -> S; S -> S on A / send B; } }
                 machine M { event A, B; region r { super P: P; initial -> P; } region s { state S; initial -> S / send B; S -> S on B / send A; } }",
            ),
            &[],
        ),
        (
            "a container's own events in two uses are not the same",
            mission(
                "container P { in event A; out event B; region r { state S; initial -> S; S -> S on A / send B; } }
                 container X { event A, B; region r { super P: P; initial -> P; P -> P on B; } region s { state S; initial -> S / send A; } }
                 container Y { event A, B; region r { super P: P; initial -> P; P -> P on B; } region s { state S; initial -> S / send B; S -> S on B; S -> S / send A; } }
                 machine M { region r { super X: X; initial -> X; } region s { super Y: Y; initial -> Y; } }",
            ),
            &[],
        ),
        (
            "a container that is used twice has one circle",
            mission(
                "container P { event A; region r { state S; initial -> S / send A;\nS -> S on A / send A; } }
                 machine M { region r { super P: P; initial -> P; } region s { super Q: P; initial -> Q; } }",
            ),
            &["3: "],
        ),
        ("in an unused container", mission("container P { event A; region r { state S; initial -> S / send A; S -> S on A / send A; } } machine M { region r { state S; initial -> S; } }"), &[]),
        ("without a machine", "container P { event A; region r { state S; initial -> S / send A;\nS -> S on A / send A; } }".into(), &["2: "]),
        ("a guard that is never true", machine("S -> S on A [timeout] / send A;"), &[]),
        ("behind a default", machine("S -> S on A; S -> S on A / send A;"), &[]),
        ("from a state that is never entered", machine("state T; T -> S on A / send A;"), &[]),
        ("a trigger that is not known", machine("S -> S on A / send B; S -> S on D / send A;"), &[]),
        ("a guard that is not known", machine("S -> S on A [nonsense] / send A;"), &[]),
        ("flags are no events", mission("container C { in flag f; out flag g; region r { state S; initial -> S; S -> S [^f] / set ^g; } } machine M { region r { super S: C; initial -> S; S -> S [.g] / set .f; } }"), &[]),
    ];
    compare(Code::W104, &cases);
}

#[test]
fn a_circle_is_shown_send_by_send() {
    let checked = load_text(
        "case.esm",
        &mission(
            "machine M { event A, B; region r { state S; initial -> S / send A;\nS -> S on A / set /* send */ .x, send /* send */ B;\nS -> S on B / send A; } }"
                .replace("set /* send */ .x, ", "/* send */ ")
                .as_str(),
        ),
    );
    let circle = checked
        .diagnostics
        .iter()
        .find(|found| found.code == Code::W104)
        .unwrap();
    let text = &checked.files[0].text;
    let places: Vec<(&str, &str)> = circle
        .related
        .iter()
        .map(|(span, what)| (&text[span.start as usize..span.end as usize], what.as_str()))
        .collect();
    assert_eq!(
        places,
        [
            ("send /* send */ B", "`B` is sent when `A` comes"),
            ("send A", "`A` is sent when `B` comes"),
        ]
    );
    assert_eq!(circle.span, circle.related[0].0);
}

// ─── W106 ────────────────────────────────────────────────────────────────────────────────────────

#[test]
fn timeouts_that_are_over_at_once_are_told() {
    let limit = |limit: &str| {
        mission(&format!(
            "machine M {{ region r {{\nstate A timeout {limit}; initial -> A; A -> A [timeout]; }} }}"
        ))
    };
    let cases: Vec<(&str, String, &[&str])> = vec![
        ("below", limit("9 ms"), &["3: the timeout of `A`, 9000 us, is not above the interpreter's period of 10000 us"]),
        ("equal", limit("10 ms"), &["3: the timeout of `A`, 10000 us"]),
        ("zero", limit("0 us"), &["3: the timeout of `A`, 0 us"]),
        ("just above", limit("10001 us"), &[]),
        ("far above", limit("4 s"), &[]),
        ("no limit", mission("machine M { region r { state A; initial -> A; } }"), &[]),
        ("a limit that is not one", limit("5000 s"), &[]),
        ("a task state", mission("task T slot 1 { } machine M { region r {\ntask A: T timeout 1 ms; initial -> A; } }"), &["3: "]),
        ("a superstate", mission("container C { region r { state A; initial -> A; } } machine M { region r {\nsuper A: C timeout 1 ms; initial -> A; } }"), &["3: "]),
        ("in a container that nobody uses", mission("container C { region r {\nstate A timeout 1 ms; initial -> A; } } machine M { region r { state A; initial -> A; } }"), &["3: "]),
        ("no interpreter", "slot 1 period 10 ms duration 1 ms; container C { region r { state A timeout 1 ms; initial -> A; } }".into(), &[]),
        ("an interpreter without a slot", "interpreter slot 3; slot 1 period 10 ms duration 1 ms; container C { region r { state A timeout 1 ms; initial -> A; } }".into(), &[]),
        ("a slot that cannot be read", "interpreter slot 1; slot 1 period duration 1 ms; machine M { region r { state A timeout 1 ms; initial -> A; } }".into(), &[]),
        ("a rate", "interpreter slot 1; slot 1 rate 1000 Hz duration 100 us; machine M { region r { state A timeout 2 ms; initial -> A; } }".into(), &[]),
        ("another slot is slower", mission("slot 2 period 100 ms duration 1 ms; machine M { region r { state A timeout 50 ms; initial -> A; } }"), &[]),
    ];
    compare(Code::W106, &cases);
}

// ─── W107 ────────────────────────────────────────────────────────────────────────────────────────

#[test]
fn what_nothing_uses_is_told() {
    let plain = "machine M { region r { state A; initial -> A; } }";
    let one_task = |task: &str, state: &str, rest: &str| {
        mission(&format!(
            "task T slot 1 {{\n{task} }}\nmachine M {{ region r {{ {state} initial -> A; {rest} }} }}"
        ))
    };
    let cases: Vec<(&str, String, &[&str])> = vec![
        ("slot", mission(&format!("slot 2 period 10 ms duration 1 ms; {plain}")), &["2: slot 2 is not used"]),
        ("slot of a task that is not used", mission(&format!("slot 2 period 10 ms duration 1 ms;\ntask T slot 2 {{ }} {plain}")), &["3: task `T` is not used"]),
        ("slot of a task state", mission("slot 2 period 10 ms duration 1 ms; task T { } machine M { region r { task A: T slot 2; initial -> A; } }"), &[]),
        ("slot without a machine", "slot 1 period 10 ms duration 1 ms;".into(), &[]),
        ("task", mission(&format!("task T slot 1 {{ in flag f; out data d: D; param p: u32 = 1; }} {plain}")), &["2: task `T` is not used"]),
        ("task without a machine", "task T slot 1 { out flag f; }".into(), &[]),
        ("container", mission(&format!("container C {{ in flag f; out data d: D; region r {{ state A; initial -> A; }} }} {plain}")), &["2: container `C` is not used"]),
        (
            "container in an unused container",
            mission(&format!("container C {{ region r {{ state A; initial -> A; }} }}\ncontainer D {{ region r {{ super A: C; initial -> A; }} }} {plain}")),
            &["3: container `D` is not used"],
        ),
        ("flag that a guard reads", one_task("out flag f;", "task A: T;", "A -> A [not .f];"), &[]),
        ("flag that an action sets", one_task("in flag f;", "task A: T;", "A -> A / clear .f;"), &[]),
        ("flags of a task", one_task("out flag f;\nin flag g;", "task A: T;", ""), &["3: no transition reads or sets `out` flag `f` of task `T`", "4: no transition sets or reads `in` flag `g` of task `T`"]),
        (
            "flags of a container inside and outside",
            mission("container C { in flag f; out flag g;\nout flag h; region r { state A; initial -> A [^f]; A -> A / set ^g; } } machine M { region r { super A: C; initial -> A; } }"),
            &["3: no transition reads or sets `out` flag `h` of container `C`"],
        ),
        ("param", one_task("param p: u32 = 1;\nparam q: u32 = 1;", "task A: T with { q = 2 };", ""), &["3: parameter `p` of task `T` is given by no `with`"]),
        ("optional input", one_task("in data d: D optional;", "task A: T;", ""), &["3: data port `d` of task `T` is on no path"]),
        ("output", one_task("out data d: D;", "task A: T;", ""), &["3: data port `d` of task `T` is on no path"]),
        ("required input is an error", one_task("in data d: D;", "task A: T;", ""), &[]),
        (
            "connected",
            mission("task T slot 1 { out data d: D; } task U slot 1 { in data d: D; } machine M { region r { task A: T; initial -> A; } region s { task B: U; initial -> B; } path A.d -> B.d; }"),
            &[],
        ),
        (
            "out of a container and no further",
            mission("task T slot 1 {\nout data d: D; } container C {\nout data d: D; region r { task A: T; initial -> A; } path A.d -> d; } machine M { region r { super A: C; initial -> A; } }"),
            &["3: nobody reads output `d` of task `T`", "4: nobody reads output `d` of container `C`"],
        ),
        (
            "read in one of two uses",
            mission(
                "task T slot 1 { out data d: D; } task U slot 1 { in data d: D; } container C { out data d: D; region r { task A: T; initial -> A; } path A.d -> d; }
                 machine M { region r { super A: C; super B: C; initial -> A; A -> B; } region s { task U: U; initial -> U; } path B.d -> U.d; }",
            ),
            &[],
        ),
        (
            "through a container that only passes it on",
            mission(
                "task T slot 1 { out data d: D; } task U slot 1 { in data d: D; } container C { in data i: D; out data o: D; region r { state A; initial -> A; } path i -> o; }
                 machine M { region r { super C: C; initial -> C; } region s { task U: U; initial -> U; } region t { task T: T; initial -> T; } path T.d -> C.i; path C.o -> U.d; }",
            ),
            &[],
        ),
        // What only follows from another mistake.
        ("misspelt task", mission("task Cruise slot 1 { out flag f; } machine M { region r { task A: Crise; initial -> A; } }"), &[]),
        ("misspelt container", mission("container Cave { region r { state A; initial -> A; } } machine M { region r { super A: Cabe; initial -> A; } }"), &[]),
        ("misspelt flag", one_task("out flag near;", "task A: T;", "A -> A [.nar];"), &[]),
        ("misspelt parameter", one_task("param speed: u32 = 1;", "task A: T with { sped = 2 };", ""), &[]),
        ("misspelt port", one_task("out data d: D;", "task A: T;", "} path A.e -> A.e; region s { state A; initial -> A;"), &[]),
        ("unknown slot", "interpreter slot 1; slot 1 period 10 ms duration 1 ms; slot 2 period 10 ms duration 1 ms; task T slot 3 { } machine M { region r { task A: T; initial -> A; } }".into(), &[]),
        ("a file that is missing", mission(&format!("use \"gone.esm\"; task T slot 1 {{ }} {plain}")), &[]),
        ("a second definition", mission("task T slot 1 { }\ntask T slot 1 { } machine M { region r { task A: T; initial -> A; } }"), &[]),
        ("two flags of one name", one_task("out flag f; out flag f;", "task A: T;", "A -> A [.f];"), &[]),
        ("broken transition", one_task("out flag f;", "task A: T;", "A -> A [.f"), &[]),
        ("two machines", mission(&format!("task T slot 1 {{ }} {plain} machine N {{ region r {{ state A; initial -> A; }} }}")), &[]),
    ];
    compare(Code::W107, &cases);
}

#[test]
fn unused_declarations_of_a_library_are_told_in_its_file() {
    let checked = load_texts(&[
        (
            "m.esm",
            &mission(
                "use \"tasks.esm\"; machine M { region r { state A; initial -> A; A -> A; } }",
            ),
        ),
        ("tasks.esm", "task T slot 1 { }"),
    ]);
    assert_eq!(told(&checked), "W107 1: task `T` is not used\n");
    let unused = checked
        .diagnostics
        .iter()
        .find(|found| found.code == Code::W107);
    assert_eq!(unused.unwrap().span.file, 1);
    let alone = load_texts(&[("tasks.esm", "task T slot 1 { }")]);
    assert_eq!(told(&alone), "");
}

// ─── Size ────────────────────────────────────────────────────────────────────────────────────────

#[test]
fn large_and_deeply_shared_sets_of_files_take_little_time() {
    // Each container uses the one before it twice: 2^60 instances, and events pass through all of
    // them.
    let mut shared = mission(
        "container C0 { in event E; out event F; region r { state A; initial -> A; A -> A on E / send F; } }\n",
    );
    for level in 1..=60 {
        let inside = level - 1;
        let _ = writeln!(
            shared,
            "container C{level} {{ in event E; out event F; region r {{ super A: C{inside}; super B: C{inside}; initial -> A; A -> B; }} }}"
        );
    }
    shared += "machine M { event E, F; region r { super A: C60; initial -> A; } region s { state S; initial -> S / send E; S -> S on F / send E; } }";
    let mut wide = mission(
        "task T slot 1 { out flag f; in data d: D optional; }\nmachine M { event E; region r {\n",
    );
    for state in 0..20_000 {
        let _ = writeln!(
            wide,
            "task S{state}: T; S{state} -> S{} on E [.f] / send E;",
            (state + 1) % 20_000
        );
    }
    wide += "initial -> S0; } }";
    // One circle through all events, and a circle for each two of them.
    let mut circles = mission("machine M {\n");
    let mut pairs = mission("machine M {\n");
    let (mut in_circles, mut in_pairs) = (String::new(), String::new());
    for event in 0..20_000 {
        for text in [&mut circles, &mut pairs] {
            let _ = writeln!(text, "event E{event};");
        }
        let _ = writeln!(
            in_circles,
            "A -> A on E{event} / send E{};",
            (event + 1) % 20_000
        );
        let _ = writeln!(in_pairs, "A -> A on E{event} / send E{};", event ^ 1);
    }
    circles += &format!("region r {{ state A; initial -> A; {in_circles} }} }}");
    pairs += &format!("region r {{ state A; initial -> A; {in_pairs} }} }}");
    for text in [shared, wide, circles, pairs] {
        let started = work_time::taken();
        let checked = load_text("large.esm", &text);
        assert!(!checked.has_errors(), "{}", checked.render(false));
        // Seconds in a debug build; what must not happen takes hours.
        let took = work_time::taken() - started;
        assert!(took < Duration::from_secs(20), "{took:?}");
    }
}
