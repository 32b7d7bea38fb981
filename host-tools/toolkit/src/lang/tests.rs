//! Wrong files and what is said about them; right files and what they mean; files that nobody would
//! write.

use std::fmt::Write as _;
use std::time::Duration;

use proptest::prelude::*;

use super::*;
use crate::model::{Action, Guard, PathEnd, SlotRef, Source, StateKind, Target, Trigger, Value};
use crate::work_time;

/// Stands behind the text of a case, so that it changes no line or column in it.
const REST: &str = "
interpreter slot 1;
slot 1 period 10 ms duration 1 ms;
slot 2 period 10 ms duration 1 ms;
task Drive slot 2 { in flag fast; out flag near; param speed: f32 = 0.25 min 0 max 0.5; }
task Scan slot 2 { out data ranges: Ranges; }
task Steer slot 2 { in data ranges: Ranges; out data twist: Twist; }
container Turn {
  in event Go; out event Done;
  in flag left; out flag ready;
  region turn { state Back; initial -> Back; Back -> final [timeout]; }
}
";

/// Texts by path.
type Files = &'static [(&'static str, &'static str)];

/// A machine with one region around what stands in the region.
fn in_region(body: &str) -> String {
    format!("machine M {{ event E; region r {{\n{body}\n}} }}{REST}")
}

/// The errors among what was found. Warnings are tested where they are found out.
fn errors(checked: &Checked) -> impl Iterator<Item = &Diagnostic> {
    checked
        .diagnostics
        .iter()
        .filter(|diagnostic| diagnostic.severity() == Severity::Error)
}

/// What is wrong with a text, as "code line:col" for each error.
fn places(checked: &Checked) -> Vec<String> {
    let positions = Positions::new(&checked.files);
    errors(checked)
        .map(|diagnostic| {
            let position = positions.of(diagnostic.span);
            let file = match position.file {
                0 => String::new(),
                file => format!(" file {file}"),
            };
            format!(
                "{} {}:{}{file}",
                diagnostic.code, position.line, position.col
            )
        })
        .collect()
}

/// Checks a table of texts and places; says everything that differs.
fn assert_places<'c>(cases: impl IntoIterator<Item = (String, &'c [&'c str])>) {
    let mut wrong = String::new();
    for (text, expected) in cases {
        let checked = load_text("case.esm", &text);
        if places(&checked) != expected {
            let _ = writeln!(
                wrong,
                "── {text}\nexpected {expected:?}\nfound    {:?}\n{}",
                places(&checked),
                checked.json_lines()
            );
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

/// The texts of a table as they stand.
fn whole<'c>(
    cases: &'c [(&'c str, &'c [&'c str])],
) -> impl Iterator<Item = (String, &'c [&'c str])> {
    cases
        .iter()
        .map(|&(text, expected)| (text.to_owned(), expected))
}

/// The texts of a table in a region of a machine, from its second line on.
fn region<'c>(
    cases: &'c [(&'c str, &'c [&'c str])],
) -> impl Iterator<Item = (String, &'c [&'c str])> {
    cases
        .iter()
        .map(|&(text, expected)| (in_region(text), expected))
}

/// The texts of a table with the rest of a set of files behind them.
fn with_rest<'c>(
    cases: &'c [(&'c str, &'c [&'c str])],
) -> impl Iterator<Item = (String, &'c [&'c str])> {
    cases
        .iter()
        .map(|&(text, expected)| (format!("{text}{REST}"), expected))
}

// ─── E001: syntax and numbers ────────────────────────────────────────────────────────────────────

#[test]
fn what_is_right_is_not_reported() {
    assert_places(whole(&[
        ("", &[]),
        ("// nothing\n/* at all */", &[]),
        ("slot 1 rate 100 Hz duration 1 ms;", &[]),
        ("slot 1 period 10ms duration 10 ms;", &[]),
        ("queue 255;", &[]),
        ("task period { param min: bool = true; in flag ms; }", &[]),
        ("task T slot 9 wcet 0 us exclusive slots { }", &[]),
        (
            "task T endless exclusive g count 0 slot 2 wcet 1 us { }",
            &[],
        ),
        (
            "task count count 4294967295 endless { in data within: within within 1 us optional; inout data endless: count optional within 4000 s; }",
            &[],
        ),
        (
            "machine M { }\ninterpreter slot 1;\nslot 1 period 4000 s duration 0 us;",
            &[],
        ),
        ("container A { region r { initial -> final; } }", &[]),
        ("\u{FEFF}queue 1;", &[]),
    ]));
    assert_places(region(&[
        ("initial -> final on pulse;", &[]),
        (
            "task A: Drive slot 0 timeout 0 s with { speed = 0.5 }; initial -> A / set .fast, send E; A -> A on * / clear .fast;",
            &[],
        ),
        (
            "state A timeout 1 s; initial -> A; A -> A on E [not not (timeout) or timeout and (timeout)];",
            &[],
        ),
        (
            "super A: Turn; initial -> A / set .left; A -> A [exit and .ready or busy];",
            &[],
        ),
    ]));
}

#[test]
fn syntax_errors_are_placed_at_the_token_found() {
    assert_places(whole(&[
        ("slot 1 period 1 ms duration 1 ms", &["E001 1:33"]),
        ("slot 1 period 1 ms duration 1 ms\n\n", &["E001 2:1"]),
        (
            "slot 1 period 1 ms duration 9 us\nslot 2 period 1 ms duration 9 us;",
            &["E001 1:33"],
        ),
        ("slot 1 duration 1 ms period 1 ms;", &["E001 1:8"]),
        ("slot 1 period 1 ms;", &["E001 1:19"]),
        ("slot 1 perod 1 ms duration 1 ms;", &["E001 1:8"]),
        ("slot 1 rate 100 hz duration 1 ms;", &["E001 1:17"]),
        ("slot one period 1 ms duration 1 ms;", &["E001 1:6"]),
        (
            "slot 1 period 1 ms rate 1 Hz duration 1 ms;",
            &["E001 1:20"],
        ),
        ("slot 1 period ms duration 1 ms;", &["E001 1:15"]),
        ("slot 1 period 1.5 ms duration 1 ms;", &["E001 1:15"]),
        ("slot 1 period -1 ms duration 1 ms;", &["E001 1:15"]),
        ("slot 1 period 1 min duration 1 ms;", &["E001 1:17"]),
        ("slot 1 period 1 duration 1 ms;", &["E001 1:17"]),
        ("use tasks;", &["E001 1:5"]),
        ("use \"tasks.esm;", &["E001 1:5"]),
        ("interpreter 1;", &["E001 1:13"]),
        ("queue;", &["E001 1:6"]),
        ("task T { out flag near }", &["E001 1:24"]),
        ("task T { flag near; }", &["E001 1:10"]),
        ("task T { inout flag near; }", &["E001 1:16"]),
        ("task T { in data x Ranges; }", &["E001 1:20"]),
        (
            "task T { in data on: Ranges; out data on: Ranges; param on: u32 = 1; }",
            &["E001 1:18", "E003 1:39"],
        ),
        ("task T { in data history: Ranges; }", &["E001 1:18"]),
        ("task T { param p: f64 = 1; }", &["E001 1:19"]),
        ("task T { param p: i32 = ; }", &["E001 1:25"]),
        ("task T { param p: i32 min 1; }", &["E001 1:28"]),
        ("task T slt 1 { }", &["E001 1:8"]),
        ("taks T { out flag f; }", &["E001 1:1"]),
        ("T endless { in data d: X; }", &["E001 1:1"]),
        ("T count 2 { in data d: X; }", &["E001 1:1"]),
        ("task T endles cuont 2 { }", &["E001 1:8", "E001 1:15"]),
        ("task T count { }", &["E001 1:14"]),
        ("task T count -1 { }", &["E001 1:14"]),
        ("task T count 4294967296 endless { }", &["E001 1:14"]),
        (
            "task T { in data d: X within; in data d: X; }",
            &["E001 1:29", "E003 1:39"],
        ),
        (
            "task T { in data d: X within optional; in data e: X witin 5 ms; }",
            &["E001 1:30", "E001 1:53"],
        ),
        (
            "task T { in data d: X within 5 optional; inout data e: X within 0 us; }",
            &["E001 1:32", "E001 1:65"],
        ),
        (
            "task T { in data d: within 5 ms; in data d: within within 5 ms; }",
            &["E001 1:21", "E003 1:42"],
        ),
        (
            "task T { in data d: X within 4001 s; in data e: X 5 ms; }",
            &["E001 1:30", "E001 1:51"],
        ),
        // A value is as old as it is where it is read.
        (
            "task T { out data d: X within 5 ms; out data e: X optional within 5 ms optional; in data e: X; }",
            &["E001 1:24", "E001 1:60", "E003 1:72", "E003 1:90"],
        ),
        (
            "container C { in data d: X within 5 ms; inout data e: X optional within 5 ms within 6 ms; in data e: X; region r { initial -> final; } }",
            &["E001 1:28", "E001 1:66", "E001 1:78", "E003 1:99"],
        ),
        ("task Größe { }", &["E001 1:6"]),
        ("container C { }", &["E001 1:15"]),
        (
            "container C { event ; region r { initial -> final; } }",
            &["E001 1:21"],
        ),
        (
            "container C { inout event E; region r { initial -> final; } }",
            &["E001 1:21"],
        ),
        (
            "container C { state A; region r { initial -> final; } }",
            &["E001 1:15"],
        ),
        (
            "container C { region r { initial -> final; }",
            &["E001 1:45"],
        ),
        (
            "container C { region r { initial -> final; } } }",
            &["E001 1:48"],
        ),
        (
            "foo slot 1;\nbar \"a\";\n",
            &["E001 1:1", "E001 2:1", "E013 2:5"],
        ),
        ("foo bar;\nqueue 300;", &["E001 1:1", "E001 2:7"]),
        (";;;", &["E001 1:1"]),
        ("\0queue 1;", &["E001 1:1"]),
        ("queue 1; /* open\nqueue 2;", &["E001 1:10"]),
        ("container C { region r { /* open", &["E001 1:26"]),
    ]));
    assert_places(region(&[
        ("initial -> A; state A", &["E001 2:22"]),
        ("initial -> A; state A timeout;", &["E001 2:30"]),
        ("initial -> A; state A timeout 10;", &["E001 2:33"]),
        ("initial -> A; state A slot 2;", &["E001 2:23"]),
        (
            "initial -> A; state A: Drive; A -> A [.near];",
            &["E001 2:22"],
        ),
        ("initial -> A; stat A;", &["E001 2:20"]),
        ("initial -> A; state A; A -> A on;", &["E001 2:33"]),
        ("initial -> A; state A; A - > A;", &["E001 2:26"]),
        ("initial -> A; state A; A => A;", &["E001 2:26"]),
        ("initial -> A; state A; A A;", &["E001 2:26"]),
        ("initial -> A; state A; A -> ;", &["E001 2:29"]),
        ("initial -> A; state A; A -> A when E;", &["E001 2:31"]),
        ("initial -> A; state A; A -> initial;", &["E001 2:29"]),
        ("initial -> A; state A; final -> A;", &["E001 2:24"]),
        ("initial -> A; state A; A -> A [];", &["E001 2:32"]),
        ("initial -> A; state A; A -> A [timeout;", &["E001 2:39"]),
        (
            "initial -> A; state A; A -> A [timeout and];",
            &["E001 2:43"],
        ),
        ("initial -> A; state A; A -> A [near];", &["E001 2:32"]),
        (
            "initial -> A; state A; A -> A [timeout && timeout];",
            &["E001 2:40"],
        ),
        (
            "initial -> A; state A; A -> A [timeout] on E;",
            &["E001 2:41"],
        ),
        ("initial -> A; state A; A -> A / ;", &["E001 2:33"]),
        (
            "initial -> A; state A; A -> A / send E send E;",
            &["E001 2:40"],
        ),
        ("initial -> A; state A; A -> A / set near;", &["E001 2:37"]),
        ("initial -> A; task A Drive;", &["E001 2:22"]),
        (
            "initial -> A; task A: Drive with speed = 0.1;",
            &["E001 2:34"],
        ),
        (
            "initial -> A; task A: Drive with { speed 1 };",
            &["E001 2:42"],
        ),
        (
            "initial -> A; task A: Drive with { speed = 0.1 } slot 2;",
            &["E001 2:50"],
        ),
        // A `}` too many: the names behind it are still known.
        (
            "initial -> A; state A; } state B; A -> B; B -> A;",
            &["E001 2:26"],
        ),
    ]));
}

#[test]
fn a_syntax_error_costs_no_name_that_can_be_read() {
    assert_places(whole(&[
        // The region's end is missing, then the container's.
        (
            "container C { region r { state A; initial -> A;\nregion q { state B; initial -> B; } path B.x -> B.y; }",
            &["E001 2:1", "E002 2:44", "E002 2:51"],
        ),
        (
            "container C { region r { initial -> final; }\nmachine M { region r { super A: C; initial -> A; } }\ninterpreter slot 1; slot 1 period 1 s duration 1 s;",
            &["E001 2:1"],
        ),
    ]));
    assert_places(region(&[
        (
            "task A: Drve2; initial -> A; A -> A [.anything] / set .thing;",
            &["E002 2:9"],
        ),
        ("state ; initial -> A; A -> B;", &["E001 2:7"]),
        (
            "frobnicate A B; initial -> A; A -> B; state C; C -> D;",
            &["E001 2:12", "E002 2:53"],
        ),
    ]));
    assert_places(with_rest(&[
        // Of a container whose word is misspelt everything is known.
        (
            "contaner C { region r { initial -> final; } }\nmachine M { region r { super A: C; initial -> A; } }",
            &["E001 1:1"],
        ),
        (
            "task T slot 2 { out flag ; }\nmachine M { region r { task A: T; initial -> A; A -> A [.x]; } }",
            &["E001 1:26"],
        ),
        (
            "task T slot 2 { in data x y: Ranges; }\nmachine M { region r { task A: T; task S: Scan; initial -> A; } path S.ranges -> A.x; }",
            &["E001 1:27"],
        ),
        (
            "machine M { in flag f; region r { initial -> final [^f]; } }",
            &["E001 1:13", "E005 1:54"],
        ),
    ]));
}

#[test]
fn numbers_out_of_their_range() {
    assert_places(whole(&[
        ("slot 0 period 1 ms duration 1 ms;", &["E001 1:6"]),
        ("slot 4294967296 period 1 ms duration 1 ms;", &["E001 1:6"]),
        ("slot 1 period 4001 s duration 1 ms;", &["E001 1:15"]),
        ("slot 1 period 4000000001 us duration 1 ms;", &["E001 1:15"]),
        ("slot 1 period 0 us duration 0 us;", &["E001 1:15"]),
        ("slot 1 rate 0 Hz duration 1 ms;", &["E001 1:13"]),
        (
            "slot 1 period 99999999999999999999 s duration 1 ms;",
            &["E001 1:15"],
        ),
        ("queue 0;", &["E001 1:7"]),
        ("queue 256;", &["E001 1:7"]),
        ("interpreter slot 0;", &["E001 1:18"]),
        ("task T wcet 5000 s { }", &["E001 1:13"]),
    ]));
    assert_places(region(&[(
        "state A timeout 4001000 ms; initial -> A;",
        &["E001 2:17"],
    )]));
}

#[test]
fn a_token_that_is_missing_is_one_message() {
    let file = right_file();
    for (start, end) in tokens_of(&file) {
        let checked = load_text("case.esm", &format!("{}{}", &file[..start], &file[end..]));
        // A few are not needed for a right file: signs, `not`, digits.
        assert!(
            errors(&checked).count() <= 1,
            "without `{}` at byte {start}:\n{}",
            &file[start..end],
            checked.json_lines()
        );
    }
}

/// Byte ranges of the tokens of a text.
fn tokens_of(text: &str) -> Vec<(usize, usize)> {
    let mut lexer = lexer::Lexer::new(text);
    std::iter::from_fn(|| {
        let token = lexer.next_token();
        (token.kind != lexer::TokenKind::EndOfFile)
            .then_some((token.start as usize, token.end as usize))
    })
    .collect()
}

// ─── E002, E003, E004 ────────────────────────────────────────────────────────────────────────────

#[test]
fn unknown_names() {
    assert_places(region(&[
        ("state A; initial -> B;", &["E002 2:21"]),
        ("state A; initial -> A; B -> A;", &["E002 2:24"]),
        ("state A; inital -> A;", &["E002 2:10"]),
        (
            "state A; initial -> A; A -> A on F / send G, send E;",
            &["E002 2:34", "E002 2:43"],
        ),
        ("state A; initial -> A; A -> A on Done;", &["E002 2:34"]),
        ("task A: Driv; initial -> A;", &["E002 2:9"]),
        ("super A: Trun; initial -> A;", &["E002 2:10"]),
        ("super A: M; initial -> A;", &["E002 2:10"]),
        ("task A: Drive slot 7; initial -> A;", &["E002 2:20"]),
        (
            "task A: Drive with { sped = 0.1 }; initial -> A;",
            &["E002 2:22"],
        ),
        (
            "task A: Drive; initial -> A / set .slow; A -> A [.far];",
            &["E002 2:36", "E002 2:51"],
        ),
        (
            "super A: Turn; initial -> A / set .right; A -> A [.done];",
            &["E002 2:36", "E002 2:52"],
        ),
    ]));
    assert_places(with_rest(&[
        (
            "task T slot 3 { }\nmachine M { region r { task A: T; initial -> A; } }",
            &["E002 1:13"],
        ),
        // A slot that is missing is told once, where it is needed first.
        (
            "task T slot 3 { } task S slot 3 { }\nmachine M { region r { task A: S; task B: T slot 3; task D: T slot 4; task F: T slot 4; initial -> A; } }",
            &["E002 1:13", "E002 2:68"],
        ),
        (
            "task T slot 3 { } task S slot 3 { } task T slot 4 { }\nmachine M { region r { task A: S; task B: S slot 3; initial -> A; } }",
            &["E002 1:31", "E003 1:42"],
        ),
        // One that only tasks name that nobody uses is not missing.
        ("task T slot 3 { }\nmachine M { }", &[]),
        (
            "task T slot 3 { }\nmachine M { region r { task A: Drive slot 3; task B: Ttt; initial -> A; } }",
            &["E002 2:43", "E002 2:54"],
        ),
        (
            "container C { region r { initial -> final [^x] / set ^y, send Z; } }\nmachine M { }",
            &["E002 1:45", "E002 1:55", "E002 1:63"],
        ),
        (
            "machine M { region r { task A: Scan; task B: Steer; initial -> A; } path A.ranges -> B.ranges, C.ranges; }",
            &["E002 1:96"],
        ),
        (
            "machine M { region r { task A: Scan; task B: Steer; initial -> A; } path A.rangs -> B.ranges; }",
            &["E002 1:76"],
        ),
        (
            "machine M { region r { task A: Scan; task B: Steer; initial -> A; } path q.A.ranges -> B.ranges; }",
            &["E002 1:74"],
        ),
        (
            "machine M { region r { task A: Scan; task B: Steer; initial -> A; } path ranges -> B.ranges; }",
            &["E002 1:74"],
        ),
        // The same state in two regions needs the region's name.
        (
            "machine M { region r { task A: Scan; initial -> A; } region q { task A: Steer; initial -> A; }\n path r.A.ranges -> A.ranges; }",
            &["E002 2:21"],
        ),
        (
            "machine M { region r { task A: Scan; initial -> A; } region q { task A: Steer; initial -> A; }\n path r.A.ranges -> q.A.ranges; }",
            &[],
        ),
    ]));
    assert_places(whole(&[
        (
            "interpreter slot 3;\nslot 1 period 1 ms duration 1 ms;\nmachine M { }",
            &["E002 1:18"],
        ),
        // Without a machine slots need not be there.
        (
            "interpreter slot 3;\ntask T slot 4 { }\ncontainer C { region r { task A: T slot 5; initial -> A; } }",
            &[],
        ),
    ]));
}

#[test]
fn what_is_meant_is_proposed() {
    for (text, hint) in [
        ("state Cruise; initial -> Curise;", "did you mean `Cruise`?"),
        ("inital -> final;", "did you mean `initial`?"),
        ("initial -> fianl;", "did you mean `final`?"),
        ("initial -> final on e;", "did you mean `E`?"),
        ("task A: Drve; initial -> A;", "did you mean `Drive`?"),
        ("super A: Tern; initial -> A;", "did you mean `Turn`?"),
        (
            "task A: Drive with { speeed = 0.1 }; initial -> A;",
            "did you mean `speed`?",
        ),
        (
            "task A: Drive; initial -> A; A -> A [.naer];",
            "did you mean `near`?",
        ),
        (
            "state A tiemout 1 s; initial -> A;",
            "did you mean `timeout`?",
        ),
        (
            "state A timeout 1 mss; initial -> A;",
            "write `us`, `ms` or `s` behind the number",
        ),
        (
            "state A; initial -> A; A -> A [timeout || timeout];",
            "write `or`",
        ),
    ] {
        let checked = load_text("case.esm", &in_region(text));
        let hints: Vec<_> = errors(&checked)
            .map(|found| found.hint.as_deref())
            .collect();
        assert_eq!(hints, [Some(hint)], "{text}");
    }
}

#[test]
fn second_definitions() {
    assert_places(region(&[
        ("state A; initial -> A; task A: Drive;", &["E003 2:29"]),
        (
            "state A timeout 1 s timeout 2 s; initial -> A;",
            &["E003 2:21"],
        ),
        (
            "task A: Drive slot 1 timeout 1 s slot 2; initial -> A;",
            &["E003 2:34"],
        ),
        (
            "task A: Drive with { speed = 0.1, speed = 0.2 }; initial -> A;",
            &["E003 2:35"],
        ),
    ]));
    assert_places(whole(&[
        ("task T { }\ntask T { }", &["E003 2:6"]),
        (
            "task T slot 0 wcet 1 us slot 0 wcet 2 us { }",
            &["E003 1:25", "E003 1:32"],
        ),
        ("task T exclusive a exclusive a { }", &["E003 1:20"]),
        (
            "task T endless count 1 endless count 2 { }",
            &["E003 1:24", "E003 1:32"],
        ),
        (
            "task T { in data d: X within 1 s optional within 2 s optional; in data d: X; }",
            &["E003 1:43", "E003 1:54", "E003 1:72"],
        ),
        (
            "task T { in flag f; out flag f; in data f: X; param f: i32 = 0; }",
            &["E003 1:30"],
        ),
        (
            "task T { in data d: X optional optional; out data d: X; }",
            &["E003 1:32", "E003 1:51"],
        ),
        (
            "task T { param p: i32 = 0; param p: i32 = 0; }",
            &["E003 1:34"],
        ),
        (
            "slot 1 period 1 s duration 1 us;\nslot 1 period 1 s duration 1 us;",
            &["E003 2:6"],
        ),
        (
            "slot 1 period 1 s period 1 s duration 1 us;",
            &["E003 1:19"],
        ),
        ("interpreter slot 1;\ninterpreter slot 1;", &["E003 2:1"]),
        ("queue 1;\nqueue 1;", &["E003 2:1"]),
        (
            "container C { event A, B, A; region r { initial -> final; } region r { initial -> final; } }",
            &["E003 1:27", "E003 1:68"],
        ),
        (
            "container C { in event A; out event A; region r { initial -> final; } }",
            &[],
        ),
        (
            "container C { in event A; event A; in event A; region r { initial -> final; } }",
            &["E003 1:33", "E003 1:45"],
        ),
        (
            "container C { region r { initial -> final; } }\ncontainer C { region r { initial -> final; } }",
            &["E003 2:11"],
        ),
        // Tasks, containers and slots have a name space each.
        (
            "task T { }\ncontainer T { region T { state T; initial -> T; } }",
            &[],
        ),
    ]));
}

#[test]
fn regions_without_a_start() {
    assert_places(whole(&[
        ("container C { region turn { } }", &["E004 1:22"]),
        (
            "container C { region turn { state A; A -> A; } }",
            &["E004 1:22"],
        ),
        (
            "container C { region turn { state A; initial -> ; } }",
            &["E001 1:49"],
        ),
    ]));
}

// ─── E005, E006, E007 ────────────────────────────────────────────────────────────────────────────

#[test]
fn flags_against_their_direction() {
    assert_places(region(&[
        ("initial -> final [^x];", &["E005 2:20"]),
        ("initial -> final / set ^x;", &["E005 2:25"]),
        (
            "task A: Drive; initial -> A / set .near; A -> A [.fast];",
            &["E005 2:36", "E005 2:51"],
        ),
        (
            "super A: Turn; initial -> A / clear .ready; A -> A [.left];",
            &["E005 2:38", "E005 2:54"],
        ),
    ]));
    assert_places(whole(&[(
        "container C { in flag i; out flag o; region r { initial -> final [^i and ^o] / set ^o, set ^i; } }",
        &["E005 1:93"],
    )]));
}

#[test]
fn what_a_state_does_not_have() {
    assert_places(region(&[
        (
            "state A; initial -> A; A -> A [exit or busy or timeout];",
            &["E006 2:32", "E006 2:40"],
        ),
        (
            "state A; initial -> A / set .x; A -> A [.y];",
            &["E006 2:30", "E006 2:42"],
        ),
        (
            "initial -> final [timeout and .x];",
            &["E006 2:19", "E006 2:32"],
        ),
        ("initial -> final / set .x;", &["E006 2:25"]),
        ("initial -> final on *;", &["E006 2:21"]),
        ("state A; initial -> A; A -> A on *;", &["E006 2:34"]),
        (
            "task A: Drive; initial -> A; A -> A on * [.near];",
            &["E006 2:43"],
        ),
    ]));
}

#[test]
fn containers_that_contain_themselves() {
    let container = |name: &str, used: &[&str]| {
        let states: String = (0..)
            .zip(used)
            .map(|(n, used)| format!("super s{n}: {used}; "))
            .collect();
        format!("container {name} {{ region r {{ {states}initial -> final; }} }}\n")
    };
    let cases: [(String, &[&str]); 4] = [
        (container("A", &["A"]), &["E007 1:26"]),
        (
            container("A", &["B"]) + &container("B", &["A"]),
            &["E007 2:26"],
        ),
        (
            container("A", &["B", "C"]) + &container("B", &["C"]) + &container("C", &[]),
            &[],
        ),
        (
            container("A", &["C"]) + &container("B", &["A"]) + &container("C", &["B", "B"]),
            &["E007 2:26"],
        ),
    ];
    assert_places(cases);
}

// ─── E008, E009 ──────────────────────────────────────────────────────────────────────────────────

#[test]
fn data_paths() {
    let base = "task Out slot 2 { out data o: X; }\ntask In slot 2 { in data i: X; }\ntask Opt slot 2 { in data i: X optional; }\ntask Y slot 2 { out data o: Y; inout data io: X optional; }\n";
    let case = |text: &str| format!("{base}{text}{REST}");
    let machine = |paths: &str| {
        case(&format!(
            "machine M {{ region r {{ task A: Out; task B: In; task C: Opt; task D: Y; initial -> A; }}\n{paths} }}"
        ))
    };
    let cases: Vec<(String, &[&str])> = vec![
        (machine("path A.o -> B.i;"), &[]),
        (machine("path A.o -> B.i, C.i; path A.o -> D.io;"), &[]),
        (machine("path D.io -> B.i;"), &[]),
        (machine("path A.o, D.o -> B.i;"), &["E008 6:1"]),
        (machine("path A.o -> B.i; path D.o -> C.i;"), &["E008 6:18"]),
        (machine("path A.o -> B.i; path D.o -> B.i;"), &["E008 6:18"]),
        (machine("path B.i -> A.o;"), &["E008 6:1"]),
        (machine("path C.i -> B.i;"), &["E008 6:1"]),
        (machine("path A.o -> B.i, A.o;"), &["E008 6:1"]),
        // An input that is left open.
        (machine(""), &["E008 5:37"]),
        (machine("path A.o -> C.i;"), &["E008 5:37"]),
        // What could not be read may have led there.
        (machine("path A.o -> B.j;"), &["E002 6:15"]),
        (machine("path A.o -> Bb.i;"), &["E002 6:13"]),
        (machine("path A.o > B.i;"), &["E001 6:10"]),
        // Through a container: inside and outside are one net.
        (
            case(
                "container C { out data o: Z; region r { task A: Out; initial -> A; } path A.o -> o; }\nmachine M { region r { super S: C; task B: In; initial -> S; } path S.o -> B.i; }",
            ),
            &["E008 5:70"],
        ),
        (
            case(
                "container C { out data o: X; region r { task A: Out; initial -> A; } path A.o -> o; }\nmachine M { region r { super S: C; task B: In; initial -> S; } path S.o -> B.i; }",
            ),
            &[],
        ),
        (
            case(
                "container C { out data o: X; region r { task A: Out; initial -> A; } }\nmachine M { region r { super S: C; task B: In; initial -> S; } path S.o -> B.i; }",
            ),
            &["E008 6:64"],
        ),
        (
            case(
                "container C { in data i: X; region r { task B: In; initial -> B; } path i -> B.i; }\nmachine M { region r { super S: C; initial -> S; } }",
            ),
            &["E008 6:24"],
        ),
        (
            case(
                "container C { in data i: X; region r { task B: In; initial -> B; } path B.i -> i; }\nmachine M { }",
            ),
            &["E008 5:68"],
        ),
        (
            case(
                "container C { in data i: Z; region r { task B: In; initial -> B; } path i -> B.i; }\nmachine M { }",
            ),
            &["E008 5:68"],
        ),
    ];
    assert_places(cases);
}

#[test]
fn slots_and_parameters_of_task_states() {
    assert_places(whole(&[
        (
            "task T { }\ncontainer C { region r { task A: T; initial -> A; } }",
            &["E009 2:26"],
        ),
        (
            "task T slot 0 { param p: i32; }\ncontainer C { region r { task A: T; initial -> A; } }",
            &["E009 2:26"],
        ),
        (
            "task T slot 0 { param p: i32; }\ncontainer C { region r { task A: T with { p = 1 }; initial -> A; } }",
            &[],
        ),
        ("task T { param p: bool = 1; }", &["E009 1:26"]),
        ("task T { param p: i32 = 1.0; }", &["E009 1:25"]),
        (
            "task T { param p: i32 = 2147483648; param q: i32 = -2147483648; }",
            &["E009 1:25"],
        ),
        ("task T { param p: u32 = -1; }", &["E009 1:25"]),
        (
            "task T { param p: f32 = 1e39; param q: f32 = 3; }",
            &["E009 1:25"],
        ),
        ("task T { param p: f32 = 2 min 0 max 1; }", &["E009 1:25"]),
        ("task T { param p: f32 = 1 min 2 max 1; }", &["E009 1:37"]),
        ("task T { param p: i32 = 1 min 0.5 max 1; }", &["E009 1:31"]),
        (
            "task T slot 0 { param p: f32 = 1 min 0 max 1; }\ncontainer C { region r { task A: T with { p = 1.5 }; task B: T with { p = true }; initial -> A; } }",
            &["E009 2:47", "E009 2:75"],
        ),
    ]));
}

// ─── E010, E011, E013 ────────────────────────────────────────────────────────────────────────────

#[test]
fn more_task_states_than_there_is_room_for() {
    assert_places(with_rest(&[
        (
            "task T slot 2 count 1 { }\nmachine M { region r { task A: T; task B: T; task D: T; initial -> A; } }",
            &["E012 2:35"],
        ),
        (
            "task T slot 2 count 0 { }\nmachine M { region r { task A: T; initial -> A; } }",
            &["E012 2:24"],
        ),
        // Each use of a container counts anew.
        (
            "task T slot 2 count 3 { }\ncontainer C { region r { task A: T; task B: T; initial -> A; } }\nmachine M { region r { super S: C; super Z: C; initial -> S; } }",
            &["E012 2:37"],
        ),
        (
            "task T slot 2 count 4 { }\ncontainer C { region r { task A: T; task B: T; initial -> A; } }\nmachine M { region r { super S: C; super Z: C; initial -> S; } }",
            &[],
        ),
        (
            "task T slot 2 count 2 { } task U slot 2 count 1 { }\ncontainer C { region r { task A: T; task B: U; initial -> A; } }\nmachine M { region r { super S: C; task A: T; super Z: C; initial -> S; } }",
            &["E012 2:26", "E012 2:37"],
        ),
        // There is no first one too many without a machine, and what no machine uses needs no room.
        (
            "task T slot 2 count 1 { }\ncontainer C { region r { task A: T; task B: T; initial -> A; } }",
            &[],
        ),
        (
            "task T slot 2 count 1 { }\ncontainer C { region r { task A: T; task B: T; initial -> A; } }\nmachine M { }",
            &[],
        ),
        (
            "task T slot 2 { }\nmachine M { region r { task A: T; task B: T; initial -> A; } }",
            &[],
        ),
        (
            "task T slot 2 count 0 { }\ncontainer C { region r { task A: T; super S: C; initial -> A; } }\nmachine M { region r { super S: C; initial -> S; } }",
            &["E007 2:37"],
        ),
    ]));
    // As many as nobody could lay out.
    let levels: String = (1..80)
        .map(|at| format!("container C{at} {{ region a {{ super S: C{0}; super Z: C{0}; initial -> S; }} }}\n", at - 1))
        .collect();
    let text = format!(
        "container C0 {{ region r {{ task A: T; initial -> A; }} }}\n{levels}task T slot 2 count 4000000000 {{ }} machine M {{ region r {{ super S: C79; initial -> S; }} }}{REST}"
    );
    let checked = load_text("case.esm", &text);
    assert_eq!(places(&checked), ["E012 1:27"]);
}

#[test]
fn more_time_than_there_is() {
    let machine = |tasks: &str, states: &str| {
        format!(
            "interpreter slot 1; slot 1 period 10 ms duration 1 ms;\nslot 2 period 10 ms duration 1 ms;\n{tasks}\nmachine M {{ {states} }}"
        )
    };
    let tasks = "task A slot 2 wcet 600 us { } task B slot 2 wcet 600 us { } task X slot 2 wcet 600 us exclusive x { }";
    let cases: Vec<(String, &[&str])> = vec![
        ("slot 1 period 1 ms duration 2 ms;".into(), &["E010 1:1"]),
        ("slot 1 rate 3 Hz duration 2 ms;".into(), &["E010 1:1"]),
        (
            "slot 1 period 2 ms duration 1 ms;\nslot 2 period 3 ms duration 2 ms;".into(),
            &["E010 1:1"],
        ),
        // Only slots that fit count.
        (
            "slot 1 period 2 ms duration 1 ms;\nslot 2 period 3 ms duration 4 ms;".into(),
            &["E010 2:1"],
        ),
        (machine("task A slot 2 wcet 2 ms { }", ""), &["E010 3:1"]),
        (
            machine(
                "task A slot 0 wcet 2 ms { }",
                "region r { task S: A slot 2; initial -> S; }",
            ),
            &["E010 4:24"],
        ),
        // One state of a region at a time, all regions together.
        (
            machine(
                tasks,
                "region r { task S: A; task T: B; initial -> S; S -> T; }",
            ),
            &[],
        ),
        (
            machine(
                tasks,
                "region r { task S: A; initial -> S; } region q { task T: B; initial -> T; }",
            ),
            &["E010 2:1"],
        ),
        (
            machine(
                tasks,
                "region r { task S: A; initial -> S; } region q { task T: B; initial -> final; }",
            ),
            &[],
        ),
        (
            machine(
                tasks,
                "region r { task S: X; initial -> S; } region q { task T: X; initial -> T; }",
            ),
            &[],
        ),
        (
            machine(
                tasks,
                "region r { task S: X; initial -> S; } region q { task T: X; initial -> T; } region p { task U: A; initial -> U; }",
            ),
            &["E010 2:1"],
        ),
        // Inside a superstate.
        (
            machine(
                "task A slot 2 wcet 600 us { } container C { region r { task S: A; initial -> S; } }",
                "region r { super S: C; initial -> S; } region q { super T: C; initial -> T; }",
            ),
            &["E010 2:1"],
        ),
    ];
    assert_places(cases);
}

#[test]
fn too_many_slots_are_told_as_such() {
    let text: String = (1..=schedule::MAX_SLOTS + 1)
        .map(|number| format!("slot {number} period 4000 s duration 1 us;\n"))
        .collect();
    let mut checked = load_text("case.esm", &text);
    assert_eq!(checked.lay_out(Duration::from_secs(5)), None);
    let told: Vec<_> = checked.diagnostics.iter().map(|it| it.text()).collect();
    let expected = "there are 4097 slots, and more than 4096 are not laid out";
    assert!(told.len() == 1 && told[0].contains(expected), "{told:?}");
}

#[test]
fn slots_without_a_schedule() {
    for (text, limit, expected) in [
        (
            "slot 1 period 4 us duration 1 us;\nslot 2 period 6 us duration 1 us;\n",
            5,
            vec![],
        ),
        (
            "slot 1 period 3 us duration 1 us;\nslot 2 period 4 us duration 1 us;\n",
            5,
            vec!["E011 1:1"],
        ),
        // Not after E010, and not where a slot is not known.
        (
            "slot 1 period 3 us duration 1 us;\nslot 2 rate 3 Hz duration 1 us;\n",
            5,
            vec!["E010 2:1"],
        ),
        (
            "slot 1 period 3 us duration 1 us;\nslot 0 period 4 us duration 1 us;\n",
            5,
            vec!["E001 2:6"],
        ),
        // Also where something else is wrong.
        (
            "slot 1 period 3 us duration 1 us;\nslot 2 period 4 us duration 1 us;\nqueue 0;",
            5,
            vec!["E011 1:1", "E001 3:7"],
        ),
    ] {
        let mut checked = load_text("case.esm", text);
        let schedule = checked.lay_out(Duration::from_secs(limit));
        assert_eq!(places(&checked), expected, "{text}");
        assert_eq!(schedule.is_some(), expected.is_empty(), "{text}");
        assert_eq!(checked.model.is_some(), expected.is_empty(), "{text}");
    }
}

#[test]
fn sets_that_are_no_whole() {
    assert_places(whole(&[
        (
            "machine A { }\nmachine B { }\ninterpreter slot 1; slot 1 period 1 s duration 1 s;",
            &["E013 2:1"],
        ),
        ("queue 3;\nmachine A { }", &["E013 2:1"]),
    ]));
    let cases: &[(Files, &[&str])] = &[
        (
            &[
                ("a.esm", "use \"b.esm\"; task A { }"),
                ("b.esm", "use \"c.esm\"; task B { }"),
                ("c.esm", "task C { }"),
            ],
            &[],
        ),
        // Read once, however it is named.
        (
            &[
                (
                    "d/a.esm",
                    "use \"b.esm\"; use \"./c.esm\"; use \"../d/c.esm\";",
                ),
                ("d/b.esm", "use \"c.esm\";"),
                ("d/c.esm", "task C { }"),
            ],
            &[],
        ),
        (&[("a.esm", "queue 1;\nuse \"a.esm\";")], &["E013 2:1"]),
        (
            &[
                ("a.esm", "use \"b.esm\";"),
                ("b.esm", "queue 1; use \"a.esm\";"),
            ],
            &["E013 1:10 file 1"],
        ),
        (
            &[
                ("a.esm", "task A { } use \"b.esm\";"),
                ("b.esm", "task A { }"),
            ],
            &["E003 1:6 file 1"],
        ),
        // Whatever is in the file that cannot be read is not also unknown.
        (
            &[(
                "a.esm",
                "use \"b.esm\"; machine M { region r { task S: T slot 2; super U: V; initial -> S; S -> U [.x]; } }",
            )],
            &["E013 1:1"],
        ),
        (
            &[
                ("a.esm", "use \"d/b.esm\";"),
                ("d/b.esm", "use \"c.esm\";"),
                ("c.esm", ""),
            ],
            &["E013 1:1 file 1"],
        ),
    ];
    for (files, expected) in cases {
        assert_eq!(places(&load_texts(files)), *expected, "{files:?}");
    }
}

/// What somebody does who copies the line of the message must be right.
#[test]
fn a_slot_that_the_tasks_of_another_file_lack_is_proposed_as_they_need_it() {
    const LIBRARY: &str = "task Look slot 3 wcet 4500 us endless { }
task Move slot 3 wcet 1 ms endless { }
task Turn slot 3 wcet 2 ms endless { }
task Rest slot 4 { }";
    const MISSION: &str = "use \"robot.esm\"; interpreter slot 1;
slot 1 period 20 ms duration 2 ms;
machine M { region r { task A: Look; initial -> A; }
region s { task B: Move; task C: Turn; initial -> B; B -> C [timeout]; } }";
    let checked = load_texts(&[("m.esm", MISSION), ("robot.esm", LIBRARY)]);
    let [found] = &errors(&checked).collect::<Vec<_>>()[..] else {
        panic!("{}", checked.json_lines());
    };
    let line = "slot 3 period 40 ms duration 7 ms;";
    let hint = format!("declare it in your mission: `{line}`");
    assert_eq!(found.hint.as_deref(), Some(hint.as_str()));
    let [(user, what)] = &found.related[..] else {
        panic!("{found:?}");
    };
    assert_eq!(what, "the task is used here");
    let user = checked.position(*user);
    assert_eq!((user.file, user.line, user.col), (0, 3, 32));
    let mended = format!("{MISSION}\n{line}");
    let timed = mended.replace("task B: Move", "task B: Move timeout 1 s");
    let checked = load_texts(&[("m.esm", timed.as_str()), ("robot.esm", LIBRARY)]);
    assert!(!checked.has_errors(), "{}", checked.json_lines());
}

#[test]
fn a_slot_that_is_missing_is_proposed_for_those_who_need_it_and_shown_with_one_of_them() {
    const TASKS: &str = "task Look slot 3 wcet 1 ms endless { }
task Move slot 3 wcet 2 ms endless { }
task Long slot 3 wcet 1000 s endless { }";
    const SLOTS: &str = "interpreter slot 1; slot 1 period 20 ms duration 2 ms;";
    for (mission, expected, user) in [
        // The first task of the library that is used, whichever state comes first.
        (
            "machine M { region r { task A: Move; initial -> A; } region s { task B: Look; initial -> B; } }",
            "slot 3 period 20 ms duration 3 ms;",
            Some("B: Look"),
        ),
        // A container that is used twice.
        (
            "container C { region r { task A: Move; initial -> A; } }
machine M { region r { super S: C; initial -> S; } region s { super T: C; initial -> T; } }",
            "slot 3 period 20 ms duration 4 ms;",
            Some("A: Move"),
        ),
        // A state with another slot needs it no more than it needs the time.
        (
            "machine M { region r { task A: Move slot 1; initial -> A; } }",
            "slot 3 period 10 ms duration 1 ms;",
            None,
        ),
        // A state that names the slot itself.
        (
            "machine M { region r { task A: Move slot 5; initial -> A; } }",
            "slot 5 period 10 ms duration 2 ms;",
            None,
        ),
        (
            "machine M { region r { task A: Long; initial -> A; } }",
            "slot 3 period 4000000 ms duration 1000000 ms;",
            Some("A: Long"),
        ),
    ] {
        let text = format!("use \"robot.esm\"; {SLOTS}\n{mission}");
        let checked = load_texts(&[("m.esm", &text), ("robot.esm", TASKS)]);
        let found = errors(&checked)
            .find(|found| {
                found
                    .hint
                    .as_ref()
                    .is_some_and(|hint| hint.contains(expected))
            })
            .unwrap_or_else(|| panic!("{mission}: {}", checked.json_lines()));
        let shown = found.related.first().map(|(place, _)| {
            let end = place.end as usize;
            text[..end].rsplit("task ").next().unwrap().to_owned()
        });
        assert_eq!(shown.as_deref(), user, "{mission}");
    }
}

#[test]
fn the_interpreter_is_offered_a_slot_that_no_task_runs_in() {
    for (slots, expected) in [
        (
            "slot 1 period 10 ms duration 1 ms; slot 2 period 10 ms duration 1 ms; slot 4 period 10 ms duration 1 ms;",
            &[
                "write `interpreter slot 2;`",
                "write `interpreter slot 3; slot 3 period 20 ms duration 2 ms;`",
            ][..],
        ),
        (
            "slot 1 period 10 ms duration 1 ms; slot 4 period 10 ms duration 1 ms;",
            &["write `interpreter slot 2; slot 2 period 20 ms duration 2 ms;`"],
        ),
    ] {
        let text = format!(
            "task T slot 1 endless {{ }} {slots}\nmachine M {{ region r {{ task A: T slot 4; initial -> A; }} }}"
        );
        let checked = load_text("case.esm", &text);
        let [found] = &errors(&checked).collect::<Vec<_>>()[..] else {
            panic!("{}", checked.json_lines());
        };
        let titles: Vec<&str> = found.fixes.iter().map(|fix| fix.title.as_str()).collect();
        assert_eq!(titles, expected);
        for fix in &found.fixes {
            let mended = load_text("case.esm", &fix.apply(&text).unwrap());
            assert!(!mended.has_errors(), "{}", mended.json_lines());
        }
    }
}

#[test]
fn a_machine_can_be_demanded() {
    let mut checked = load_text("case.esm", "queue 3;");
    assert!(checked.model.is_some());
    checked.require_machine();
    assert_eq!(places(&checked), ["E013 1:1"]);
    assert!(checked.model.is_none());
    let mut checked = load_text("case.esm", &in_region("initial -> final;"));
    checked.require_machine();
    assert!(!checked.has_errors());
}

// ─── Files ───────────────────────────────────────────────────────────────────────────────────────

#[test]
fn columns_count_characters() {
    assert_places(whole(&[
        ("/* äöü → */ queue 0;", &["E001 1:19"]),
        (
            "/* \r\n */ queue 0;\r\n\tqueue 0;",
            &["E001 2:11", "E003 3:2", "E001 3:8"],
        ),
    ]));
}

// ─── The model ───────────────────────────────────────────────────────────────────────────────────

#[test]
fn the_model_says_what_the_files_say() {
    let text = format!(
        "machine M {{
           event E, F;
           region r {{
             state A timeout 5 ms;
             task D: Drive slot 0 with {{ speed = 0.5 }};
             super T: Turn;
             initial -> A on pulse / send F;
             A -> D on E [timeout and not timeout or timeout] / set .fast;
             D -> T on * / clear .left;
             D -> final [.near];
           }}
           region view {{ task S: Scan; task U: Steer; initial -> S; }}
           path S.ranges -> view.U.ranges;
         }}{REST}"
    );
    let checked = load_text("case.esm", &text);
    let model = checked.model.expect("a right file");
    let machine = &model.containers[model.machine.expect("a machine")];
    assert_eq!(model.events, ["E", "F", "Go", "Done"]);
    assert_eq!((model.queue, model.interpreter_slot), (32, Some(0)));
    let region = &machine.regions[0];
    assert_eq!(region.states[0].timeout_us, Some(5_000));
    let StateKind::Task { slot, params, .. } = &region.states[1].kind else {
        panic!("a task state");
    };
    assert_eq!(
        (*slot, params.as_slice()),
        (SlotRef::NonRealTime, &[Value::F32(0.5)][..])
    );
    let transitions = &region.transitions;
    assert_eq!(
        (transitions[0].source, transitions[0].trigger),
        (Source::Initial, Trigger::Pulse)
    );
    assert_eq!(transitions[0].actions, [Action::Send(1)]);
    let timeout = || Guard::Timeout;
    let expected = Guard::Or(vec![
        Guard::And(vec![timeout(), Guard::Not(Box::new(timeout()))]),
        timeout(),
    ]);
    assert_eq!(transitions[1].guard.as_ref(), Some(&expected));
    assert_eq!(transitions[1].actions, [Action::Own(0, true)]);
    assert_eq!(
        (transitions[2].trigger, transitions[2].guard.as_ref()),
        (Trigger::Star, None)
    );
    assert_eq!(
        (transitions[3].target, transitions[3].guard.as_ref()),
        (Target::Final, Some(&Guard::Own(1)))
    );
    let end = |state| PathEnd::State {
        region: 1,
        state,
        port: 0,
    };
    assert_eq!(
        (
            machine.paths[0].from.as_slice(),
            machine.paths[0].to.as_slice()
        ),
        (&[end(0)][..], &[end(1)][..])
    );
    let turn = &model.containers[1];
    assert!(turn.events[0].forwarded_in && !turn.events[0].forwarded_out);
}

// ─── Messages ────────────────────────────────────────────────────────────────────────────────────

#[test]
fn messages_for_people() {
    let text =
        "slot 1 period 1 ms duration 2 ms;\ntask T slot 1 { out flag naer; out flag naer; }\r\n";
    let checked = load_text("robot.esm", text);
    let expected = "\
error[E010]: slot 1 lasts 2000 us, longer than its period of 1000 us
 --> robot.esm:1:1
  |
1 | slot 1 period 1 ms duration 2 ms;
  | ^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^^
  |
  = help: shorten the duration or lengthen the period

error[E003]: flag `naer` is defined twice
 --> robot.esm:2:41
  |
2 | task T slot 1 { out flag naer; out flag naer; }
  |                                         ^^^^
  |
 ::: robot.esm:2:26
  |
2 | task T slot 1 { out flag naer; out flag naer; }
  |                          ---- first defined here
  |
  = help: give the second one another name or remove it

";
    assert_eq!(checked.render(false), expected);
    assert!(checked.render(true).contains("\u{1b}["));
}

#[test]
fn messages_for_programs() {
    let checked = load_text("robot.esm", "queue \"\\\";");
    assert_eq!(
        checked.json_lines(),
        r#"{"code":"E001","severity":"error","file":"robot.esm","line":1,"col":7,"message":"expected the capacity of the event queue, found `\"\\\"`"}
"#
    );
}

#[test]
fn of_long_lines_the_place_is_shown() {
    let text = format!(
        "{}queue 0;{}",
        "/* ä */ ".repeat(50_000),
        " ".repeat(50_000)
    );
    let rendered = load_text("long.esm", &text).render(false);
    assert!(rendered.len() < 2_000, "{} bytes", rendered.len());
    assert!(rendered.contains("queue 0;"), "{rendered}");
}

#[test]
fn codes_are_written_as_they_are_named() {
    for code in Code::ALL {
        assert_eq!(format!("{code:?}"), code.as_str());
        assert_eq!(
            code.severity() == Severity::Error,
            code.as_str().starts_with('E')
        );
    }
    assert!(Code::ALL.is_sorted());
}

// ─── Files that nobody would write ───────────────────────────────────────────────────────────────

/// Checks a text, and that it neither takes long nor says too much.
fn endures(name: &str, text: &str, must_fail: bool) {
    let start = work_time::taken();
    let checked = load_text("case.esm", text);
    let json = checked.json_lines();
    assert_eq!(
        checked.has_errors(),
        must_fail,
        "{name}: {}",
        json.lines().take(3).collect::<String>()
    );
    assert!(
        json.len() < 10_000_000,
        "{name}: {} bytes of messages",
        json.len()
    );
    // Far above what it takes, far below what anything quadratic would.
    let took = work_time::taken() - start;
    assert!(took < Duration::from_secs(30), "{name}: {took:?}");
}

#[test]
fn deep_nesting_ends_with_a_message() {
    let guard = |guard: String| in_region(&format!("state A; initial -> A; A -> A [{guard}];"));
    let n = 100_000;
    assert_places([
        (guard("(".repeat(n)), &["E001 2:132"][..]),
        (
            guard(format!("{}timeout{}", "(".repeat(n), ")".repeat(n))),
            &["E001 2:132"][..],
        ),
        (
            guard(format!("{}timeout", "not ".repeat(n))),
            &["E001 2:432"][..],
        ),
        (
            guard(format!("{}timeout{}", "(".repeat(100), ")".repeat(100))),
            &[][..],
        ),
        (guard(vec!["timeout"; n].join(" or ")), &[][..]),
    ]);
    endures("braces", &"{".repeat(n), true);
    endures(
        "regions",
        &format!("machine M {{ {}", "region r { ".repeat(n)),
        true,
    );
    endures("containers", &"container C { ".repeat(n), true);
    endures("comments", &"/*".repeat(n), true);
}

#[test]
fn long_garbage_ends_with_a_message() {
    let n = 200_000;
    for garbage in [
        ";", "}", "{", "x", "x ", "0", "\"", "\0", "\u{80}", "->", "on ", "in ", "state ", "x;",
        "task t{", "A->", "/**/;", "with{", "x ->x\n",
    ] {
        endures(garbage, &garbage.repeat(n), true);
        endures(garbage, &in_region(&garbage.repeat(n / 4)), true);
    }
}

/// A machine whose region has as many states, each with a transition to the next one.
fn ring(states: usize) -> String {
    let mut body = String::from("initial -> S0;\n");
    for state in 0..states {
        let next = (state + 1) % states;
        let _ = writeln!(
            body,
            "state S{state} timeout 1 ms; S{state} -> S{next} on E [timeout];"
        );
    }
    in_region(&body)
}

#[test]
fn large_machines_are_read() {
    endures("ring", &ring(100_000), false);
}

#[test]
fn large_machines_with_many_mistakes_are_read() {
    endures(
        "unknown states",
        &ring(50_000).replace("-> S", "-> Q"),
        true,
    );
    let paths = "path A.x -> B.y; path r.A.q -> q.B.z;".repeat(20_000);
    endures(
        "paths",
        &format!("machine M {{ region r {{ task A: Scan; initial -> A; }} {paths} }}{REST}"),
        true,
    );
    let many: String = (0..50_000)
        .map(|n| format!("task T{n} slot {n} {{ }}\n"))
        .collect();
    endures("tasks", &(many + REST), false);
}

#[test]
fn containers_nest_without_bound() {
    let mut text = String::from("container C0 { region r { task A: Drive; initial -> A; } }\n");
    for level in 1..20_000 {
        let inner = level - 1;
        let _ = writeln!(
            text,
            "container C{level} {{ region r {{ super S: C{inner}; initial -> S; }} region q {{ super S: C{inner}; initial -> S; }} }}"
        );
    }
    endures("nested", &(text + REST), false);
}

// ─── Laws ────────────────────────────────────────────────────────────────────────────────────────

/// Words and signs of the language, and some that are not.
fn token() -> impl Strategy<Value = &'static str> {
    prop::sample::select(vec![
        "use",
        "interpreter",
        "queue",
        "slot",
        "task",
        "container",
        "machine",
        "event",
        "in",
        "out",
        "inout",
        "flag",
        "data",
        "param",
        "region",
        "state",
        "super",
        "initial",
        "final",
        "on",
        "pulse",
        "send",
        "set",
        "clear",
        "and",
        "or",
        "not",
        "exit",
        "timeout",
        "busy",
        "path",
        "with",
        "true",
        "history",
        "A",
        "B",
        "r",
        "period",
        "rate",
        "Hz",
        "duration",
        "wcet",
        "ms",
        "1",
        "0",
        "2.5",
        "99999999999999999999",
        "\"a.esm\"",
        "\"",
        ";",
        ";",
        ",",
        ":",
        ".",
        "^",
        "=",
        "-",
        "->",
        "->",
        "*",
        "/",
        "{",
        "{",
        "}",
        "}",
        "[",
        "]",
        "(",
        ")",
        "é",
        "\0",
        "/*",
        "*/",
        "//",
        "\n",
        "min",
        "max",
        "f32",
        "optional",
        "exclusive",
        "within",
        "count",
        "endless",
    ])
}

/// A right file that uses all of the grammar.
fn right_file() -> String {
    let machine = in_region(
        "state A timeout 5 ms; task D: Drive slot 0 timeout 1 s with { speed = 0.5 }; super T: Turn;
         initial -> A on pulse / send E; A -> D on E [timeout and not (timeout or timeout)] / set .fast;
         D -> T on * / clear .left; T -> final [.ready and exit]; T -> T on E [not busy] / set .left, send E;",
    );
    format!(
        "queue 9;
         task Log slot 0 wcet 5 us exclusive log count 3 endless {{ in data twist: Twist optional within 80 ms; inout data pose: Pose within 1 s; param n: i32 = -3 min -5 max 7; }}
         container View {{
           event Found, Lost; in data ranges: Ranges; out data pose: Pose; out flag seen;
           region log {{ task L: Log; task O: Own; initial -> L; L -> O on Found [^seen] / set ^seen, send Lost; O -> L on Lost; }}
           region steer {{ task S: Steer timeout 3 s; initial -> S; S -> S [timeout] / send Found; }}
           path ranges -> steer.S.ranges;
           path S.twist -> L.twist, O.twist;
           path O.pose -> L.pose, pose;
         }}
         task Own slot 0 {{ in data twist: Twist; out data pose: Pose; }}
         {machine}"
    )
}

/// What must hold of every text: an answer, places inside of it, in order, and a model only without
/// errors.
fn assert_lawful(text: &str) -> Result<(), TestCaseError> {
    let mut checked = load_text("case.esm", text);
    checked.lay_out(Duration::from_millis(50));
    for diagnostic in &checked.diagnostics {
        prop_assert!(diagnostic.span.start <= diagnostic.span.end);
        prop_assert!(diagnostic.span.end as usize <= checked.files[0].text.len() + 3);
        prop_assert!(!diagnostic.message.is_empty());
    }
    let keys: Vec<_> = checked
        .diagnostics
        .iter()
        .map(|found| (found.span, found.code))
        .collect();
    prop_assert!(keys.is_sorted());
    prop_assert_eq!(checked.model.is_some(), !checked.has_errors());
    prop_assert_eq!(
        checked.json_lines().lines().count(),
        checked.diagnostics.len()
    );
    let again = load_text("case.esm", text);
    prop_assert!(again.diagnostics.len() <= checked.diagnostics.len());
    checked.render(false);
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn any_characters_are_endured(text in any::<String>()) {
        assert_lawful(&text)?;
    }

    #[test]
    fn any_tokens_are_endured(tokens in proptest::collection::vec(token(), 0..200)) {
        assert_lawful(&tokens.join(" "))?;
    }

    #[test]
    fn any_tokens_in_a_region_are_endured(tokens in proptest::collection::vec(token(), 0..100)) {
        assert_lawful(&in_region(&tokens.join(" ")))?;
    }

    /// One token more or less in a right file.
    #[test]
    fn a_changed_file_is_endured(at in any::<prop::sample::Index>(), length in 0..12_usize, put in token()) {
        let file = right_file();
        let boundary = |at: usize| (0..=at.min(file.len())).rev().find(|&at| file.is_char_boundary(at)).unwrap_or(0);
        let start = boundary(at.index(file.len()));
        let end = boundary(start + length).max(start);
        assert_lawful(&format!("{} {put} {}", &file[..start], &file[end..]))?;
        assert_lawful(&format!("{}{}", &file[..start], &file[end..]))?;
        assert_lawful(&file[..start])?;
    }

    #[test]
    fn any_bytes_are_endured(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
        let checked = load_files(&[("a.esm", &bytes)]);
        prop_assert!(std::str::from_utf8(&bytes).is_ok() || checked.has_errors());
    }
}

#[test]
fn a_name_has_an_end() {
    let long = "x".repeat(1_000);
    let text = |name: &str| format!("task {name} {{ out flag a; out flag {name}; }}");
    assert_eq!(load_text("t.esm", &text(&long)).diagnostics, []);
    let checked = load_text("t.esm", &text(&(long + "x")));
    let [found] = &checked.diagnostics[..] else {
        panic!("{}", checked.render(false));
    };
    assert_eq!((found.code, found.span.start), (Code::E001, 5));
    assert!(found.text().ends_with("a name has at most 1000 characters"));
}

#[test]
fn of_a_long_line_what_is_near_is_shown() {
    let text = format!(
        "{}task T {{ flag }} {}",
        "/* ä */".repeat(1_000),
        "; ".repeat(1_000)
    );
    let rendered = load_text("t.esm", &text).render(false);
    assert!(rendered.contains("task T { flag }"), "{rendered}");
    assert!(rendered.lines().all(|line| line.len() < 400), "{rendered}");
}

#[test]
fn what_a_file_says_does_not_steer_the_terminal() {
    let text = "use \"\u{1b}[2J\u{7}.esm\";\n";
    let checked = load_text("t.esm", text);
    let [found] = &checked.diagnostics[..] else {
        panic!("{}", checked.render(false));
    };
    let said = "cannot read `\\u{1b}[2J\\u{7}.esm`";
    assert!(found.message.starts_with(said), "{}", found.message);
    assert!(!checked.render(false).contains(['\u{1b}', '\u{7}']));
}
