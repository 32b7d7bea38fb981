//! What the analysis says of small sets of files.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::time::Duration;

use proptest::prelude::*;

use super::holes::Holes;
use super::sharing;
use crate::lang::diagnostic::{Code, Sink};
use crate::lang::loader::{self, Memory};
use crate::lang::resolve::{self, Trees};
use crate::lang::{Positions, load_text};
use crate::model::Model;
use crate::work_time;

/// What could not be read or resolved of a text.
fn holes_of(text: &str) -> Holes {
    let mut sink = Sink::default();
    let set = loader::load(
        "case.esm",
        &Memory::new(&[("case.esm", text.as_bytes())]),
        &mut sink,
    )
    .unwrap();
    let trees = Trees {
        files: &set.files,
        trees: &set.trees,
        lacks_files: set.lacks_files,
    };
    resolve::resolve(&trees, &mut sink).holes
}

/// The holes in a few words, one for each.
fn in_words(holes: &Holes) -> String {
    let mut words = String::new();
    let mut add = |is_hole: bool, what: &str| {
        if is_hole {
            let _ = write!(words, "{}{what}", if words.is_empty() { "" } else { ", " });
        }
    };
    add(holes.set, "set");
    add(holes.slots, "slots");
    for task in &holes.tasks {
        add(task.declarations, "task");
        add(task.is_twin, "task twin");
    }
    for container in &holes.containers {
        add(container.declarations, "declarations");
        add(container.paths, "paths");
        add(container.is_twin, "container twin");
        for region in &container.regions {
            add(region.body, "body");
            for state in &region.states {
                add(state.kind, "kind");
                add(state.limit, "limit");
                add(state.is_twin, "twin");
            }
            for loose in &region.transitions {
                add(loose.source.is_none(), "source");
                add(loose.target.is_none(), "target");
                add(loose.source.is_some() && loose.target.is_some(), "trigger");
            }
            add(!region.guards.is_empty(), "guard");
            add(!region.actions.is_empty(), "actions");
        }
    }
    words
}

#[test]
fn what_cannot_be_read_or_resolved_is_a_hole() {
    let region = |body: &str| {
        format!(
            "task T slot 0 {{ out flag f; }} container C {{ out flag g; region r {{ {body} }} }}"
        )
    };
    let cases = [
        (region("task A: T; initial -> A [^g]; A -> final [.f];"), ""),
        // Nothing is lost of these.
        (region("state A; initial -> A A -> final;"), ""),
        (region("state A; initial => A;"), ""),
        (region("state A; A -> final;"), "body"),
        // Of these something is.
        (region("state A; initial -> A; A -> B;"), "target"),
        (region("state A; initial -> A; B -> A;"), "source"),
        (region("state A; initial -> A; A -> A on E;"), "trigger"),
        (region("state A; initial -> A; A -> final on *;"), "trigger"),
        (region("state A; initial -> A; A -> final [exit];"), "guard"),
        (region("state A; initial -> A; A -> final [^h];"), "guard"),
        (region("state A; initial -> A; A -> final [^g ^g];"), "guard"),
        (region("state A; initial -> A / set ^h;"), "actions"),
        (region("state A; initial -> A / send E;"), "actions"),
        (region("super A: D; initial -> A;"), "kind"),
        (region("task A: U; initial -> A;"), "kind"),
        (region("state A timeout 5000 s; initial -> A;"), "limit"),
        (region("state A; state A; initial -> A;"), "twin"),
        (region("state A; initial -> A; final -> A;"), "body"),
        (region("state A; sttae; initial -> A;"), "body"),
        (region("state A; initial -> A ? 3;"), "body"),
        (region("state A; initial -> A; region"), "declarations, paths, body"),
        ("use \"none.esm\";".into(), "set, slots"),
        ("slot 1 period 1 ms;".into(), "set, slots"),
        ("something;".into(), "set"),
        ("task T { out flag; }".into(), "task"),
        ("task T { data x; }".into(), "task"),
        ("task T { } task T { }".into(), "task twin"),
        ("container C { inout flag f; region r { state A; initial -> A; } }".into(), "declarations"),
        ("container C { event ; region r { state A; initial -> A; } }".into(), "declarations, paths"),
        ("container C { region r { state A; initial -> A; } path A.x -> y; }".into(), "paths"),
        ("container C { region r { state A; initial -> A; } path x; }".into(), "declarations, paths"),
        ("machine M { region r { state A; initial -> A; } } machine N { region r { state A; initial -> A; } }".into(), "container twin"),
    ];
    let mut wrong = String::new();
    for (text, expected) in &cases {
        let found = in_words(&holes_of(text));
        if found != *expected {
            let _ = writeln!(wrong, "{text}\n  expected {expected}\n  found    {found}");
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

// ─── Warnings ────────────────────────────────────────────────────────────────────────────────────

/// What stands behind the text of a case, so that it changes no line or column in it.
const REST: &str = "
interpreter slot 1;
slot 1 period 10 ms duration 1 ms;
slot 2 period 10 ms duration 4 ms;
slot 3 period 100 ms duration 1 ms;
task T slot 2 { in flag go; out flag near; out flag far; }
task Left slot 2 exclusive motors { out data twist: Twist; }
task Right slot 2 exclusive motors { out data twist: Twist; }
task Same slot 2 exclusive motors { inout data twist: Twist; }
task Lamp slot 2 exclusive light { }
task Reader slot 2 { in data twist: Twist optional; }
task Needs slot 2 { in data twist: Twist; }
task Fresh slot 2 { in data twist: Twist optional within 50 ms; }
task Patient slot 2 { in data twist: Twist within 100 ms; }
task Pass slot 2 { inout data twist: Twist within 50 ms; }
task Two slot 2 { in data a: Twist within 20 ms; in data b: Twist optional within 99999 us; }
task Slow slot 3 { out data twist: Twist; }
task Ever slot 2 endless { out flag near; }
";

/// The warnings of this module with some code, and all errors, as "code line:col".
fn found(text: &str, code: Code) -> Vec<String> {
    let checked = load_text("case.esm", text);
    let positions = Positions::new(&checked.files);
    checked
        .diagnostics
        .iter()
        .filter(|diagnostic| diagnostic.code == code || diagnostic.code < Code::W101)
        .map(|diagnostic| {
            let position = positions.of(diagnostic.span);
            format!("{} {}:{}", diagnostic.code, position.line, position.col)
        })
        .collect()
}

/// Checks a table of texts and places; says everything that differs.
fn assert_found(code: Code, cases: &[(&str, String, &[&str])]) {
    let mut wrong = String::new();
    for (what, text, expected) in cases {
        let text = format!("{text}{REST}");
        let found = found(&text, code);
        if found != *expected {
            let all = load_text("case.esm", &text).render(false);
            let _ = writeln!(
                wrong,
                "── {what}\n{text}\nexpected {expected:?}\nfound    {found:?}\n{all}"
            );
        }
    }
    assert!(wrong.is_empty(), "{wrong}");
}

/// A machine with one region around what stands in it, on the second line.
fn machine(body: &str) -> String {
    format!("machine M {{ event E, F; region r {{\n{body}\n}} }}")
}

/// A container with flags and one region around what stands in it, on the second line, in a set
/// without a machine.
fn library(body: &str) -> String {
    format!("container C {{ in event E; in flag told; out flag done; region r {{\n{body}\n}} }}")
}

/// A container in a machine that uses it in one region.
fn used(inside: &str, outside: &str) -> String {
    format!(
        "container C {{ in event E; in flag told; out flag done; region r {{\n{inside}\n}} }} machine M {{ event E; region r {{\nsuper S: C; {outside}\n}} }}"
    )
}

#[test]
fn states_that_nothing_leads_to() {
    assert_found(Code::W101, &[
        ("behind the end of an endless task", machine("task A: Ever; state B; initial -> A; A -> B on *; B -> A;"), &["W101 2:15"]),
        ("behind `exit` of an endless task", machine("task A: Ever; state B; initial -> A; A -> B [exit and .near]; B -> A;"), &["W101 2:15"]),
        ("behind something else of an endless task", machine("task A: Ever; state B; initial -> A; A -> B [not exit and .near]; B -> A;"), &[]),
        ("no transition", machine("state A; state B; initial -> A; A -> A; B -> A;"), &["W101 2:10"]),
        ("a circle beside", machine("state A; state B; state D; initial -> A; B -> D; D -> B;"), &["W101 2:10", "W101 2:19"]),
        ("only itself", machine("state A; task B: T; initial -> A; B -> B;"), &["W101 2:10"]),
        ("behind a default", machine("state A; state B; initial -> A; A -> A; A -> B;"), &["W101 2:10"]),
        ("behind a default on the same event", machine("state A; state B; initial -> A; A -> A on E; A -> B on E;"), &["W101 2:10"]),
        ("behind a default from initial", machine("state A; state B; initial -> A; initial -> B;"), &["W101 2:10"]),
        ("a guard that excludes itself", machine("task A: T; state B; initial -> A; A -> B [.near and not .near];"), &["W101 2:12"]),
        ("all cases before it", machine("task A: T; state B; initial -> A; A -> A [.near]; A -> A [not .near]; A -> B [.far];"), &["W101 2:12"]),
        ("covered by two", machine("task A: T; state B; initial -> A; A -> A [.near and .far]; A -> A [.near and not .far]; A -> B [.near];"), &["W101 2:12"]),
        // That is W109, and the rest follows from it.
        ("timeout without a limit", machine("state A; state B; initial -> A; A -> B [timeout];"), &[]),
        ("exit of what never ends", used("state A; initial -> A; A -> A on E;", "state B; initial -> S; S -> B on *;"), &["W101 4:13"]),
        ("end behind a guard that is never true", used("state A; initial -> A; A -> final [timeout];", "state B; initial -> S; S -> B [exit];"), &[]),
        ("a flag that nobody sets", used("state A; initial -> A; A -> A on E;", "state B; initial -> S; S -> B [.done];"), &["W101 4:13"]),
        ("a flag that is only cleared", used("state A; initial -> A; A -> A on E / clear ^done;", "state B; initial -> S; S -> B [.done];"), &["W101 4:13"]),
        ("a flag that is only set where nothing leads", used("state A; state D; initial -> A; D -> A / set ^done;", "state B; initial -> S; S -> B [.done];"), &["W101 2:10", "W101 4:13"]),
        ("an input that nobody sets", used("state A; state B; initial -> A; A -> B [^told];", "initial -> S; S -> S on E;"), &["W101 2:10"]),
        ("busy without a task", used("state A; initial -> A; A -> A on E;", "state B; initial -> S; S -> B [busy];"), &["W101 4:13"]),
        ("not what is inside", used("state A; state B; initial -> A; B -> A;", "state D; initial -> D; D -> D on E; S -> D on E;"), &["W101 4:1"]),
        ("in a container that is not used", format!("{}\n{}", library("state A; state B; initial -> A; A -> A; B -> A;"), machine("state A; initial -> A;")), &["W101 2:10"]),
        ("in a set without a machine", library("state A; state B; initial -> A; A -> A; B -> A;"), &["W101 2:10"]),
        ("once for a container used twice", used("state A; state B; initial -> A; A -> A on E; B -> A;", "super S2: C; initial -> S; S -> S2 on E; S2 -> S on E;"), &["W101 2:10"]),
        ("beside an error that it does not follow from", machine("state A; state B; task D: T; initial -> A; D -> A [.none]; B -> A;"), &["W101 2:10", "W101 2:19", "E002 2:53"]),

        // What may be entered.
        ("a default behind a guard", machine("task A: T; state B; initial -> A; A -> A [.near]; A -> B;"), &[]),
        ("another event", machine("state A; state B; initial -> A; A -> A on E; A -> B on F;"), &[]),
        ("guards that leave something", machine("task A: T; state B; initial -> A; A -> A [.near and .far]; A -> B [.near];"), &[]),
        ("guards that complement each other", machine("task A: T; state B; initial -> A; A -> A [.near]; A -> B [not .near];"), &[]),
        ("timeout with a limit", machine("state A timeout 1 s; state B; initial -> A; A -> B [timeout];"), &[]),
        ("exit of a task", machine("task A: T; state B; initial -> A; A -> B on *;"), &[]),
        ("busy of a task", machine("task A: T; state B; initial -> A; A -> B [busy];"), &[]),
        ("one region of several ends", "container C { region a { state A; initial -> A; A -> A; } region b { initial -> final; } }\nmachine M { region r { super S: C; state B; initial -> S; S -> B on *; } }".into(), &[]),
        ("a flag set inside", used("state A; initial -> A / set ^done; A -> A on E;", "state B; initial -> S; S -> B [.done];"), &[]),
        ("a flag set on a way in", used("state A; state B; initial -> A; A -> B [^told];", "initial -> S; S -> S on E / set .told;"), &[]),
        ("an input of a library", library("state A; state B; initial -> A; A -> B [^told];"), &[]),
        ("an input of a container that is not used", format!("{}\n{}", library("state A; state B; initial -> A; A -> B [^told];"), machine("state A; initial -> A;")), &[]),
        ("busy with a task deep inside", "container D { region r { task X: T; initial -> X; } }\ncontainer C { region r { super Y: D; initial -> Y; } }\nmachine M { region r { super S: C; state B; initial -> S; S -> B [busy]; } }".into(), &[]),
        ("flags that free each other", "container C { in flag a; out flag b; region r { state X; state Y; initial -> X; X -> Y [^a]; Y -> X / set ^b; } }\nmachine M { region r { super S: C; state Z; initial -> S; S -> Z [.b]; Z -> S; S -> S on E / set .a; } event E; }".into(), &[]),
        ("nobody sends the event", machine("state A; state B; initial -> A; A -> B on E;"), &[]),
        ("too many flags to tell", {
            let flags: String = (0..201).map(|flag| format!("out flag f{flag}; ")).collect();
            let all: Vec<String> = (0..201).map(|flag| format!(".f{flag}")).collect();
            format!("{}\ntask Many slot 2 {{ {flags} }}", machine(&format!("task A: Many; state B; initial -> A; A -> B [({}) and not .f0 and .f0];", all.join(" or "))))
        }, &[]),

        // What may lie in a hole.
        ("a target that is unknown", machine("state A; state B; initial -> A; A -> Bee;"), &["E002 2:38"]),
        ("a source that is unknown", machine("state A; state B; initial -> A; Aa -> B;"), &["E002 2:33"]),
        ("an event that is unknown", machine("state A; state B; initial -> A; A -> B on G;"), &["E002 2:43"]),
        ("a guard that is unknown", machine("task A: T; state B; state D; initial -> A; A -> B [.nea]; A -> D;"), &["E002 2:53"]),
        ("a statement that was not understood", machine("state A; state B; initial -> A; A B;"), &["E001 2:35"]),
        ("an action that is unknown", used("state A; initial -> A / set ^don;", "state B; initial -> S; S -> B [.done];"), &["E002 2:30"]),
        ("a transition inside that ends somewhere", used("state A; initial -> A; A -> fina;", "state B; initial -> S; S -> B on *;"), &["E002 2:29"]),
        ("no start", machine("state A; state B; A -> B;"), &["E004 1:32"]),
        ("a state that is there twice", machine("state A; state A; initial -> A;"), &["E003 2:16"]),
        ("a state of an unknown container", machine("super A: None; state B; initial -> A; A -> B [.f];"), &["E002 2:10"]),
        ("a limit that was not read", machine("state A timeout 5000 s; state B; initial -> A; A -> B [timeout];"), &["E001 2:17"]),
        ("what an unknown state does not touch", used("state A; initial -> A;", "super X: Cc; state B; initial -> X; X -> S; S -> B [.done];"), &["E002 4:22", "W101 4:26"]),
        ("a file that is missing", format!("use \"none.esm\"; {}", used("state A; state B; initial -> A; A -> B [^told];", "initial -> S;")), &["E013 1:1"]),
    ]);
}

#[test]
fn transitions_that_compete() {
    assert_found(
        Code::W103,
        &[
            (
                "two flags",
                machine("task A: T; state B; initial -> A; A -> B [.near]; A -> A [.far];"),
                &["W103 2:51"],
            ),
            (
                "a flag and less",
                machine(
                    "task A: T; state B; initial -> A; A -> B [.near and .far]; A -> A [.near];",
                ),
                &["W103 2:60"],
            ),
            (
                "one that is always taken",
                machine("task A: T; state B; initial -> A; A -> B; A -> A [.near];"),
                &["W103 2:43"],
            ),
            (
                "exit",
                machine("task A: T; state B; initial -> A; A -> B on *; A -> A [.near];"),
                &["W103 2:48"],
            ),
            (
                "exit behind",
                machine("task A: T; state B; initial -> A; A -> B [.near]; A -> A on *;"),
                &["W103 2:51"],
            ),
            (
                "on an event",
                machine(
                    "task A: T; state B; initial -> A; A -> B on E [.near]; A -> A on E [not .far];",
                ),
                &["W103 2:56"],
            ),
            (
                "each later one",
                machine(
                    "task A: T; state B; initial -> A; A -> B [.near]; A -> A [.far]; A -> A [busy];",
                ),
                &["W103 2:51", "W103 2:66"],
            ),
            (
                "with one that is not the first",
                machine(
                    "task A: T; state B; initial -> A; A -> B [.near]; A -> A [.far and not .near]; A -> B [.far and not .near];",
                ),
                &["W103 2:80"],
            ),
            (
                "from initial",
                library(
                    "state A; state B; initial -> A [^told]; initial -> B [not ^done]; initial -> A;",
                ),
                &["W103 2:41"],
            ),
            (
                "the same guard",
                machine("task A: T; state B; initial -> A; A -> B [.near]; A -> A [.near];"),
                &["W103 2:51"],
            ),
            (
                "not next to each other",
                machine(
                    "task A: T; state B; initial -> A; A -> B [.near]; B -> A; A -> A on E; A -> A [.far];",
                ),
                &["W103 2:72"],
            ),
            (
                "in a set without a machine",
                library("task A: T; initial -> A; A -> A [.near]; A -> A [^told];"),
                &["W103 2:42"],
            ),
            (
                "beside an error",
                machine(
                    "task A: T; state B; initial -> A; A -> B [.near]; A -> A [.far]; A -> A [.x];",
                ),
                &["W103 2:51", "E002 2:75"],
            ),
            (
                "a default",
                machine("task A: T; state B; initial -> A; A -> B [.near]; A -> A;"),
                &[],
            ),
            (
                "two without a guard",
                machine("task A: T; state B; initial -> A; A -> B; A -> A;"),
                &[],
            ),
            (
                "guards that complement each other",
                machine("task A: T; state B; initial -> A; A -> B [.near]; A -> A [not .near];"),
                &[],
            ),
            (
                "guards that exclude each other",
                machine(
                    "task A: T; state B; initial -> A; A -> B [.near and .far]; A -> A [.near and not .far];",
                ),
                &[],
            ),
            (
                "different events",
                machine(
                    "task A: T; state B; initial -> A; A -> B on E [.near]; A -> A on F [.near]; A -> A [.near];",
                ),
                &[],
            ),
            (
                "different states",
                machine("task A: T; task B: T; initial -> A; A -> B [.near]; B -> A [.near];"),
                &[],
            ),
            (
                "timeout without a limit",
                machine("task A: T; state B; initial -> A; A -> B [.near]; A -> A [timeout];"),
                &[],
            ),
            (
                "exit of what never ends",
                used(
                    "state A; initial -> A; A -> A / set ^done;",
                    "state B; initial -> S; S -> B [.done]; S -> S on *;",
                ),
                &[],
            ),
            (
                "a flag that nobody sets",
                used(
                    "state A; initial -> A; A -> final;",
                    "state B; initial -> S; S -> B on *; S -> S [.done];",
                ),
                &[],
            ),
            (
                "a guard that is never true",
                machine(
                    "task A: T; state B; initial -> A; A -> B [.near]; A -> A [.far and not .far];",
                ),
                &[],
            ),
            (
                "a guard that is unknown",
                machine("task A: T; state B; initial -> A; A -> B [.nea]; A -> A [.far];"),
                &["E002 2:44"],
            ),
            (
                "a flag that may be meant to be set",
                used(
                    "state A; initial -> A / set ^don; A -> final;",
                    "state B; initial -> S; S -> B on *; S -> S [.done];",
                ),
                &["E002 2:30"],
            ),
        ],
    );
}

/// Two regions side by side, on lines of their own, in a machine.
fn beside(first: &str, second: &str) -> String {
    format!("machine M {{ event E; region a {{\n{first}\n}} region b {{\n{second}\n}} }}")
}

/// A container on line 2 with a `Left` inside, and a machine with two regions on lines 4 and 6.
fn with_container(first: &str, second: &str) -> String {
    format!(
        "container C {{ region r {{\ntask L: Left; initial -> L; L -> L on *;\n}} }} machine M {{ event E; region a {{\n{first}\n}} region b {{\n{second}\n}} }}"
    )
}

#[test]
fn exclusive_tasks_that_are_active_together() {
    assert_found(Code::W105, &[
        ("side by side", beside("task A: Left; initial -> A;", "task B: Right; initial -> B;"), &["W105 4:1"]),
        ("the same task", beside("task A: Left; initial -> A;", "task B: Left; initial -> B;"), &["W105 4:1"]),
        ("each later one once", beside("task A: Left; initial -> A;", "task B: Right; task D: Left; initial -> B; B -> D;"), &["W105 4:1", "W105 4:16"]),
        ("inside and outside", with_container("super S: C; initial -> S;", "task B: Right; initial -> B;"), &["W105 6:1"]),
        ("outside first", "machine M { region a { task B: Right; initial -> B; } region b { super S: C; initial -> S; } }\ncontainer C { region r { task L: Left; initial -> L; } }".into(), &["W105 2:26"]),
        ("with itself", with_container("super S: C; initial -> S;", "super S: C; initial -> S;"), &["W105 2:1"]),
        ("deep inside both", format!("{}\ncontainer D {{ region r {{ super X: C; initial -> X; }} }}", with_container("super S: D; initial -> S;", "super S: D; initial -> S;")), &["W105 2:1"]),
        ("behind two regions, in the first of them", "machine M { region a { task A: Left; super S: C; initial -> A; A -> S; } region b {\ntask B: Right; initial -> B; } }\ncontainer C { region r { task L: Left; initial -> L; } }".into(), &["W105 2:1", "W105 3:26"]),
        ("in a set without a machine", "container C { region a { task A: Left; initial -> A; } region b { task B: Right; initial -> B; } }".into(), &["W105 1:67"]),
        ("non-real-time", beside("task A: Left slot 0; initial -> A;", "task B: Right slot 0; initial -> B;"), &["W105 4:1"]),
        ("beside an error", beside("task A: Left; initial -> A; A -> A on G;", "task B: Right; initial -> B;"), &["E002 2:39", "W105 4:1"]),

        ("in one region", machine("task A: Left; task B: Right; initial -> A; A -> B; B -> A;"), &[]),
        ("different groups", beside("task A: Left; initial -> A;", "task B: Lamp; initial -> B;"), &[]),
        ("one that is in no group", beside("task A: Left; initial -> A;", "task B: T; initial -> B;"), &[]),
        ("one that nothing leads to", beside("task A: Left; initial -> A;", "state S; task B: Right; initial -> S;"), &[]),
        ("one behind a guard that is never true", beside("task A: Left; initial -> A;", "state S; task B: Right; initial -> S; S -> B [timeout];"), &[]),
        ("used twice in one region", with_container("super S: C; super S2: C; initial -> S; S -> S2;", "state X; initial -> X;"), &[]),
        ("inside and beside in one region", with_container("super S: C; task B: Right; initial -> S; S -> B;", "state X; initial -> X;"), &[]),
        ("in a container that is not used", format!("container D {{ region a {{ task A: Left; initial -> A; }} region b {{ task B: Right; initial -> B; }} }}\n{}", machine("state A; initial -> A;")), &[]),
        ("in a superstate that is never entered", with_container("super S: C; state X; initial -> X;", "task B: Right; initial -> B;"), &[]),
        ("used twice, and once never entered", with_container("super S: C; initial -> S;", "super S: C; state X; initial -> X;"), &[]),
        ("entered only from a container that is not used", format!("{}\ncontainer D {{ region r {{ super S: C; initial -> S; }} region q {{ super S: C; initial -> S; }} }}", with_container("super S: C; state X; initial -> X;", "super S: C; state X; initial -> X;")), &[]),
        ("in two containers of a library", "container C { region a { task A: Left; initial -> A; } }\ncontainer D { region b { task B: Right; initial -> B; } }".into(), &[]),
        ("a task that is unknown", beside("task A: Left; initial -> A;", "task B: Rihgt; initial -> B;"), &["E002 4:9"]),
        ("a transition that is unknown", beside("task A: Left; initial -> A;", "state S; task B: Right; initial -> S; S -> Bee;"), &["E002 4:44"]),
        ("recursion", "container C { region a { task A: Left; super S: C; initial -> A; A -> S; } region b { task B: Right; initial -> B; } }".into(), &["E007 1:40"]),
    ]);
}

#[test]
fn states_without_a_way_out() {
    assert_found(Code::W108, &[
        ("the last state", machine("state A; state B; initial -> A; A -> B;"), &["W108 2:10"]),
        ("a task state", machine("task A: T; initial -> A;"), &["W108 2:1"]),
        ("a superstate and what is in it", used("state A; initial -> A;", "initial -> S;"), &["W108 2:1", "W108 4:1"]),
        ("only inside", used("state A; initial -> A; A -> final;", "initial -> S;"), &["W108 4:1"]),
        ("in one instance of two", used("state A; initial -> A;", "super S2: C; initial -> S; S -> S2;"), &["W108 2:1", "W108 4:13"]),
        ("beside a way out", machine("state A; state B; initial -> A; A -> A; A -> B;"), &["W108 2:10"]),
        ("two levels down", "container D { region r { state X; initial -> X; } }\ncontainer C { region r { super Y: D; initial -> Y; } }\nmachine M { region r { super S: C; initial -> S; } }".into(), &["W108 1:26", "W108 2:26", "W108 3:24"]),
        ("beside an error", machine("state A; state B; task D: Tt; initial -> A; A -> D; D -> B;"), &["W108 2:10", "E002 2:27"]),

        ("a superstate around an endless task", used("task A: Ever; initial -> A;", "initial -> S;"), &["W108 4:1"]),
        ("a state of an unknown task beside an endless one", machine("task A: Ever; task B: Evr; initial -> A; A -> B;"), &["E002 2:23"]),
        ("a state of a task that may stand in a file that is missing", format!("use \"none.esm\"; {}", machine("task A: None; initial -> A;")), &["E013 1:1"]),

        ("an endless task", machine("task A: Ever; initial -> A;"), &[]),
        ("an endless task inside", used("task A: Ever; state B; initial -> B; B -> A;", "initial -> S; S -> S on E;"), &[]),
        ("itself", machine("state A; initial -> A; A -> A;"), &[]),
        ("to final", machine("state A; initial -> A; A -> final;"), &[]),
        ("on an event", machine("state A; state B; initial -> A; A -> B; B -> A on E;"), &[]),
        ("a transition that is never taken", machine("state A; initial -> A; A -> A [timeout];"), &[]),
        ("around it", used("state A; initial -> A;", "initial -> S; S -> S on E;"), &[]),
        ("two levels up", "container D { region r { state X; initial -> X; } }\ncontainer C { region r { super Y: D; initial -> Y; } }\nmachine M { region r { super S: C; initial -> S; S -> final on *; } }".into(), &[]),
        ("in a library", library("state A; initial -> A;"), &[]),
        ("in a container that is not used", format!("{}\n{}", library("state A; initial -> A;"), machine("state A; initial -> A; A -> A;")), &[]),
        ("the only way out is unknown", machine("state A; initial -> A; A -> Bee;"), &["E002 2:29"]),
        ("some way out is unknown", machine("state A; initial -> A; Aa -> A;"), &["E002 2:24"]),
        ("something was not understood", machine("state A; initial -> A; A B;"), &["E001 2:26"]),
        ("around it something is unknown", used("state A; initial -> A;", "initial -> S; S -> None;"), &["E002 4:32"]),
    ]);
}

#[test]
fn timeouts_of_states_without_a_limit() {
    assert_found(Code::W109, &[
        ("of a simple state", machine("state A; initial -> A; A -> A [timeout];"), &["W109 2:32"]),
        ("of a task state", machine("task A: T; initial -> A; A -> A [.near and not timeout];"), &["W109 2:48"]),
        ("of a superstate", used("state A; initial -> A; A -> A;", "initial -> S; S -> S [exit or timeout];"), &["W109 4:43"]),
        ("each time", machine("state A; initial -> A; A -> A on E [timeout]; A -> A [timeout];"), &["W109 2:37", "W109 2:55"]),
        ("twice in one guard", machine("task A: T; initial -> A; A -> A [timeout and .near or timeout];"), &["W109 2:34", "W109 2:55"]),
        ("in a set without a machine", library("state A; initial -> A; A -> A [timeout];"), &["W109 2:32"]),
        ("of a state that nothing leads to", machine("state A; state B; initial -> A; A -> A; B -> A [timeout];"), &["W109 2:49"]),
        ("beside an unknown flag", machine("task A: T; initial -> A; A -> A [.none or timeout];"), &["E002 2:35", "W109 2:43"]),

        ("with a limit", machine("state A timeout 1 s; initial -> A; A -> A [timeout];"), &[]),
        ("with a limit of 0", machine("state A timeout 0 s; initial -> A; A -> A [timeout];"), &[]),
        ("of a task state with a limit", machine("task A: T timeout 1 s; initial -> A; A -> A [timeout];"), &[]),
        ("of a superstate with a limit", "container C { region r { state A; initial -> A; } }\nmachine M { region r { super S: C timeout 1 s; initial -> S; S -> S [timeout]; } }".into(), &[]),
        ("a limit that is not read", machine("state A; initial -> A; A -> A;"), &[]),
        ("a limit that is out of range", machine("state A timeout 5000 s; initial -> A; A -> A [timeout];"), &["E001 2:17"]),
        ("a limit that is no time", machine("state A timeout soon; initial -> A; A -> A [timeout];"), &["E001 2:17"]),
        ("of initial", machine("state A; initial -> A [timeout]; A -> A;"), &["E006 2:24"]),
        ("of a state that is unknown", machine("state A; initial -> A; Aa -> A [timeout];"), &["E002 2:24"]),
    ]);
}

/// Two regions with a writer each, and a path on line 6.
fn writing(first: &str, second: &str, path: &str) -> String {
    format!(
        "machine M {{ event E; region a {{\n{first}\n}} region b {{\n{second}\n}} region c {{ task R: Reader; initial -> R; }}\n{path} }}"
    )
}

/// A container with a writer inside, and two regions and a path that use it.
fn writing_inside(first: &str, second: &str, path: &str) -> String {
    format!(
        "{}\ncontainer C {{ in flag told; out data twist: Twist; region r {{ task L: Left; state W; initial -> L; L -> W; W -> L [^told]; }} path L.twist -> twist; }}",
        writing(first, second, path)
    )
}

#[test]
fn writers_of_one_net_that_are_active_together() {
    assert_found(Code::W110, &[
        ("on one path", writing("task A: Left; initial -> A;", "task B: Right; initial -> B;", "path A.twist, B.twist -> R.twist;"), &["W110 6:1"]),
        ("on two paths", writing("task A: Left; initial -> A;", "task B: Right; initial -> B;", "path A.twist -> R.twist; path B.twist -> R.twist;"), &["W110 6:26"]),
        ("the later one is in the earlier region", writing("task A: Left; initial -> A;", "task B: Right; initial -> B;", "path B.twist -> R.twist; path A.twist -> R.twist;"), &["W110 6:26"]),
        ("inside and outside", writing_inside("super S: C; initial -> S;", "task B: Right; initial -> B;", "path S.twist -> R.twist; path B.twist -> R.twist;"), &["W110 6:26"]),
        ("a container used twice", writing_inside("super S: C; initial -> S;", "super Z: C; initial -> Z;", "path S.twist -> R.twist; path Z.twist -> R.twist;"), &["W110 6:26"]),
        ("two nets joined outside", "container D { out data x: Twist; out data y: Twist;\nregion a { task A: Left; initial -> A; } region b { task B: Right; initial -> B; }\npath A.twist -> x; path B.twist -> y; }\nmachine M { region a { super S: D; initial -> S; } region c { task R: Reader; initial -> R; }\npath S.x, S.y -> R.twist; }".into(), &["W110 3:20"]),
        ("two nets joined inside", "container D { in data x: Twist; in data y: Twist; region a { task R: Reader; initial -> R; } path x, y -> R.twist; }\nmachine M { region a { task A: Left; initial -> A; } region b { task B: Right; initial -> B; } region c { super S: D; initial -> S; }\npath A.twist -> S.x; path B.twist -> S.y; }".into(), &["W110 3:22"]),
        ("in a set without a machine", "container D { region a { task A: Left; initial -> A; } region b { task B: Right; initial -> B; } region c { task R: Reader; initial -> R; }\npath A.twist, B.twist -> R.twist; }".into(), &["W110 2:1"]),
        ("a third one", writing("task A: Left; initial -> A;", "task B: Right; task D: Left; initial -> B; B -> D;", "path A.twist -> R.twist; path B.twist -> R.twist; path D.twist -> R.twist;"), &["W110 6:26", "W110 6:51"]),
        ("a third one in the region of the first", writing("task A: Left; task D: Left; initial -> A; A -> D;", "task B: Right; initial -> B;", "path A.twist -> R.twist; path B.twist -> R.twist; path D.twist -> R.twist;"), &["W110 6:26", "W110 6:51"]),
        ("beside an error", writing("task A: Left; initial -> A; A -> A [.x];", "task B: Right; initial -> B;", "path A.twist, B.twist -> R.twist;"), &["E002 2:38", "W110 6:1"]),

        ("in one region", writing("task A: Left; task B: Right; initial -> A; A -> B;", "state X; initial -> X;", "path A.twist, B.twist -> R.twist;"), &[]),
        ("two nets", writing("task A: Left; initial -> A;", "task B: Right; initial -> B;", "path A.twist -> R.twist;"), &[]),
        ("nothing leads to one", writing("task A: Left; initial -> A;", "state X; task B: Right; initial -> X;", "path A.twist, B.twist -> R.twist;"), &[]),
        ("one behind a guard that is never true", writing("task A: Left; initial -> A;", "state X; task B: Right; initial -> X; X -> B [timeout];", "path A.twist, B.twist -> R.twist;"), &[]),
        ("one publishes again", writing("task A: Left; initial -> A;", "task B: Same; initial -> B;", "path A.twist -> B.twist; path B.twist -> R.twist;"), &[]),
        ("a container used twice with two nets", writing_inside("super S: C; initial -> S;", "super Z: C; initial -> Z;", "path S.twist -> R.twist;"), &[]),
        ("a container used twice in one region", writing_inside("super S: C; super Z: C; initial -> S; S -> Z;", "state X; initial -> X;", "path S.twist, Z.twist -> R.twist;"), &[]),
        ("in a container that is not used", format!("container D {{ region a {{ task A: Left; initial -> A; }} region b {{ task B: Right; initial -> B; }} region c {{ task R: Reader; initial -> R; }}\npath A.twist, B.twist -> R.twist; }} {}", machine("state A; initial -> A;")), &[]),
        ("a path with an unknown end", writing("task A: Left; initial -> A;", "task B: Right; initial -> B;", "path A.twist, B.twist -> R.twits;"), &["E002 6:28"]),
        ("a path the wrong way round", writing("task A: Left; initial -> A;", "task B: Right; initial -> B;", "path A.twist -> B.twist, R.twist;"), &["E008 6:1"]),
        ("recursion", "container D { region a { task A: Left; super S: D; initial -> A; A -> S; } region b { task B: Right; initial -> B; } region c { task R: Reader; initial -> R; }\npath A.twist, B.twist -> R.twist; }".into(), &["E007 1:40"]),
    ]);
}

#[test]
fn states_in_which_the_last_value_of_another_stays() {
    let left = "task A: Left; state H; initial -> A; A -> H;";
    let none = "state X; initial -> X;";
    let to_reader = "path A.twist -> R.twist;";
    let reader_inside = "container D { in data x: Twist optional; region q { task R: Reader; initial -> R; } path x -> R.twist; }";
    assert_found(Code::W111, &[
        ("a simple state", writing(left, none, to_reader), &["W111 2:15"]),
        ("each", writing("task A: Left; state H; state I; initial -> A; A -> H; H -> I;", none, to_reader), &["W111 2:15", "W111 2:24"]),
        ("once for two nets", writing("task A: Left; task B: Right; state H; initial -> A; A -> B; B -> H;", "task Q: Reader; initial -> Q;", "path A.twist -> R.twist; path B.twist -> Q.twist;"), &["W111 2:1", "W111 2:15", "W111 2:30"]),
        ("once for two readers", writing(left, "task Q: Reader; initial -> Q;", "path A.twist -> Q.twist, R.twist;"), &["W111 2:15"]),
        ("one that comes before any value", writing("state H; task A: Left; initial -> H; H -> A;", none, to_reader), &["W111 2:1"]),
        ("one that reads itself", writing("task A: Left; task H: Reader; initial -> A; A -> H;", none, "path A.twist -> H.twist, R.twist;"), &["W111 2:15"]),
        ("one that passes it on", writing("task A: Left; task H: Same; initial -> A; A -> H;", none, "path A.twist -> H.twist; path H.twist -> R.twist;"), &["W111 2:15"]),
        ("one that writes another net", writing("task A: Left; task H: Right; initial -> A; A -> H;", "task Q: Fresh; initial -> Q;", "path A.twist -> R.twist; path H.twist -> Q.twist;"), &["W111 2:15"]),
        ("a reader that needs it", writing(left, "task N: Needs; initial -> N;", "path A.twist -> N.twist;"), &["W111 2:15"]),
        ("a reader that passes it on", writing(left, "task N: Same; initial -> N;", "path A.twist -> N.twist;"), &["W111 2:15"]),
        ("beside a reader of fresh values", writing(left, "task N: Fresh; initial -> N;", "path A.twist -> N.twist, R.twist;"), &["W111 2:15"]),
        ("a reader that is entered later", writing(left, "state X; task N: Needs; initial -> X; X -> N on E;", "path A.twist -> N.twist;"), &["W111 2:15"]),
        ("a writer outside that is never entered", writing(left, "state X; task B: Right; initial -> X;", "path A.twist, B.twist -> R.twist;"), &["W111 2:15"]),
        ("what passes it on outside", writing(left, "task B: Same; initial -> B;", "path A.twist -> B.twist; path B.twist -> R.twist;"), &["W111 2:15"]),
        ("a reader inside", format!("machine M {{ region a {{\n{left}\n}} region b {{ super S: D; initial -> S; }} path A.twist -> S.x; }} {reader_inside}"), &["W111 2:15"]),
        ("a reader inside, used twice", format!("machine M {{ region a {{\n{left}\n}} region b {{ super S: D; super Z: D; initial -> S; S -> Z; }} path A.twist -> Z.x; }} {reader_inside}"), &["W111 2:15"]),
        ("a writer inside: there and outside", writing_inside("super S: C; state H; initial -> S; S -> H;", none, "path S.twist -> R.twist;"), &["W111 2:13", "W111 7:77"]),
        ("a writer that is not always active inside", writing_inside("task A: Left; super S: C; initial -> A; A -> S;", none, "path A.twist, S.twist -> R.twist;"), &["W111 7:77"]),
        ("in one use of two", writing_inside("super S: C; initial -> S;", "super Z: C; initial -> Z;", "path S.twist -> R.twist; region d { task Q: Reader; initial -> Q; } region e { task B: Left; initial -> B; } path Z.twist, B.twist -> Q.twist;"), &["W111 7:77"]),
        ("the net leads through the container", "container D { in data x: Twist; out data y: Twist; region q {\ntask A: Left; state H; initial -> A; A -> H;\n} path A.twist -> y; region p { task Q: Reader; initial -> Q; } path x -> Q.twist; }\nmachine M { region a { super S: D; initial -> S; } path S.y -> S.x; }".into(), &["W111 2:15"]),
        ("in a set without a machine", format!("container D {{ region a {{\n{left}\n}} region c {{ task R: Reader; initial -> R; }} {to_reader} }}"), &["W111 2:15"]),
        ("beside an error", writing("task A: Left; state H; initial -> A; A -> A [.x]; A -> H;", none, to_reader), &["W111 2:15", "E002 2:47"]),

        ("a reader of fresh values", writing(left, "task N: Fresh; initial -> N;", "path A.twist -> N.twist;"), &[]),
        ("the other state writes, too", writing("task A: Left; task B: Right; initial -> A; A -> B;", none, "path A.twist, B.twist -> R.twist;"), &[]),
        ("no other state", writing("task A: Left; initial -> A; A -> A;", none, to_reader), &[]),
        ("final", writing("task A: Left; initial -> A; A -> final;", none, to_reader), &[]),
        ("somebody outside writes", writing(left, "task B: Right; initial -> B;", "path A.twist, B.twist -> R.twist;"), &[]),
        ("somebody outside writes at times", writing(left, "task B: Right; state X; initial -> B; B -> X; X -> B;", "path A.twist, B.twist -> R.twist;"), &[]),
        ("somebody inside of one outside writes", writing_inside(left, "super Z: C; initial -> Z;", "path A.twist, Z.twist -> R.twist;"), &[]),
        ("somebody outside may write", writing(left, "state X; task B: Right; initial -> X; X -> B [.what];", "path A.twist, B.twist -> R.twist;"), &["E006 4:48"]),
        ("nobody else reads", writing("task A: Left; task H: Reader; state I; initial -> A; A -> H; H -> I;", none, "path A.twist -> H.twist;"), &[]),
        ("a reader that is never entered", writing(left, "state X; task N: Needs; initial -> X;", "path A.twist -> N.twist;"), &[]),
        ("a writer that is never entered", writing("task A: Left; state H; initial -> H; H -> H;", none, to_reader), &[]),
        ("a state that is never entered", writing("task A: Left; state H; initial -> A; A -> A;", none, to_reader), &[]),
        ("a reader that is in the region, too", writing_inside("super S: C; task Q: Reader; initial -> S; S -> Q;", none, "path S.twist -> Q.twist;"), &[]),
        ("a reader beside another use", "container D { out data y: Twist; in data x: Twist; region q { task A: Left; initial -> A; A -> final; } region p { task Q: Reader; initial -> Q; } path A.twist -> y; path x -> Q.twist; }\nmachine M { region a { super S: D; super Z: D; initial -> S; S -> Z; Z -> S; } path S.y -> Z.x; path Z.y -> S.x; }".into(), &[]),
        ("a net that leads out of the set", format!("container D {{ out data y: Twist; region a {{\n{left}\n}} region c {{ task R: Reader; initial -> R; }} path A.twist -> R.twist, y; }}"), &[]),
        ("in a container that is not used", format!("container D {{ region a {{\n{left}\n}} region c {{ task R: Reader; initial -> R; }} {to_reader} }} {}", machine("state A; initial -> A;")), &[]),
        ("a path with an unknown end", writing(left, "task B: Right; initial -> B;", "path A.twist, B.twits -> R.twist;"), &["E002 6:17"]),
        ("a state of an unknown task", writing(left, "task B: Rihgt; initial -> B;", to_reader), &["E002 4:9"]),
        ("recursion", "container D { region a { task A: Left; super S: D; initial -> A; A -> S; } region c { task R: Reader; initial -> R; }\npath A.twist -> R.twist; }".into(), &["E007 1:40"]),
    ]);
}

#[test]
fn values_that_are_too_old_before_the_next_can_come() {
    let slow = "task A: Slow; initial -> A;";
    let fresh = "task F: Fresh; initial -> F;";
    let to_fresh = "path A.twist -> F.twist;";
    assert_found(Code::W112, &[
        ("a slow writer", writing(slow, fresh, to_fresh), &["W112 4:1"]),
        ("a writer in a slow slot", writing("task A: Left slot 3; initial -> A;", fresh, to_fresh), &["W112 4:1"]),
        ("two slow writers", writing("task A: Slow; task B: Left slot 3; initial -> A; A -> B;", fresh, "path A.twist, B.twist -> F.twist;"), &["W112 4:1"]),
        ("a quick one that is never entered", writing("task A: Slow; task B: Left; initial -> A;", fresh, "path A.twist, B.twist -> F.twist;"), &["W112 4:1"]),
        ("what passes it on is no writer", writing(slow, "task P: Same; task F: Fresh; initial -> P; P -> F;", "path A.twist -> P.twist, F.twist;"), &["W112 4:15"]),
        ("what passes it on reads", writing(slow, "task F: Pass; initial -> F;", to_fresh), &["W112 4:1"]),
        ("once for two ports", writing(slow, "task F: Two; initial -> F;", "path A.twist -> F.a, F.b;"), &["W112 4:1"]),
        ("each reader", writing(slow, "task F: Fresh; task G: Fresh; initial -> F; F -> G;", "path A.twist -> F.twist, G.twist;"), &["W112 4:1", "W112 4:16"]),
        ("in one use of two", "container D { in data x: Twist; region q {\ntask F: Fresh; initial -> F;\n} path x -> F.twist; }\nmachine M { region a { task A: Slow; initial -> A; } region b { task B: Left; initial -> B; } region s { super S: D; initial -> S; } region z { super Z: D; initial -> Z; } path A.twist -> S.x; path B.twist -> Z.x; }".into(), &["W112 2:1"]),
        ("in a set without a machine", "container D { region a { task A: Slow; initial -> A; } region b {\ntask F: Fresh; initial -> F;\n} path A.twist -> F.twist; }".into(), &["W112 2:1"]),

        ("a quick writer", writing("task A: Left; initial -> A;", fresh, to_fresh), &[]),
        ("a slow task in a quick slot", writing("task A: Slow slot 2; initial -> A;", fresh, to_fresh), &[]),
        ("just within the period", writing(slow, "task F: Patient; initial -> F;", to_fresh), &[]),
        ("one quick writer of two", writing("task A: Slow; task B: Left; initial -> A; A -> B;", fresh, "path A.twist, B.twist -> F.twist;"), &[]),
        ("a writer without a period", writing("task A: Slow slot 0; initial -> A;", fresh, to_fresh), &[]),
        ("one writer without a period of two", writing("task A: Slow; task B: Left slot 0; initial -> A; A -> B;", fresh, "path A.twist, B.twist -> F.twist;"), &[]),
        ("a reader that is never entered", writing(slow, "state X; task F: Fresh; initial -> X;", to_fresh), &[]),
        ("a reader that takes any value", writing(slow, "state X; initial -> X;", "path A.twist -> R.twist;"), &[]),
        ("a net that leads out of the set", "container D { in data x: Twist; region b {\ntask F: Fresh; initial -> F;\n} region a { task A: Slow; initial -> A; } path A.twist, x -> F.twist; }".into(), &[]),
        ("a slot that is not known", writing("task A: Left slot 9; initial -> A;", fresh, to_fresh), &["E002 2:19"]),
    ]);
}

#[test]
fn tasks_that_share_a_slot_and_are_active_together() {
    let long = |second: &str| {
        format!(
            "task Long slot 2 wcet 3 ms {{ }} {}",
            beside("task A: Long; initial -> A;", second)
        )
    };
    assert_found(
        Code::E010,
        &[
            (
                "side by side",
                long("task B: Long; initial -> B;"),
                &["E010 8:1"],
            ),
            (
                "behind an event",
                long("state S; task B: Long; initial -> S; S -> B on E;"),
                &["E010 8:1"],
            ),
            (
                "behind a guard that is never true",
                long("state S; task B: Long; initial -> S; S -> B [timeout];"),
                &[],
            ),
            (
                "behind a default",
                long("state S; task B: Long; initial -> S; S -> S; S -> B;"),
                &[],
            ),
            (
                "behind what is unknown",
                long("state S; task B: Long; initial -> S; S -> Bb;"),
                &["E002 4:43"],
            ),
        ],
    );
}

// ─── The sum of a slot, in two ways ──────────────────────────────────────────────────────────────

/// Tasks by wcet in milliseconds and `exclusive` group.
const TASKS: [(u64, Option<&str>); 5] = [
    (1, None),
    (3, None),
    (4, Some("a")),
    (5, Some("a")),
    (2, Some("b")),
];

/// What a state is.
#[derive(Clone, Copy, Debug)]
enum Part {
    /// Index into [`TASKS`].
    Task(usize),
    /// An instance of an earlier container, by index.
    Super(usize),
}

/// The states of each region of each container. The last container is the machine.
type Nesting = Vec<Vec<Vec<Part>>>;

fn nesting() -> impl Strategy<Value = Nesting> {
    let region = prop::collection::vec((0..TASKS.len(), any::<bool>(), 0..8_usize), 1..3);
    let container = prop::collection::vec(region, 1..3);
    prop::collection::vec(container, 1..5).prop_map(|containers| {
        let part = |place: usize, (task, is_task, container): (usize, bool, usize)| {
            if is_task || place == 0 {
                Part::Task(task)
            } else {
                Part::Super(container % place)
            }
        };
        let containers = containers.into_iter().enumerate();
        let containers = containers.map(|(place, regions)| {
            let regions = regions.into_iter();
            let regions =
                regions.map(|states| states.into_iter().map(|it| part(place, it)).collect());
            regions.collect()
        });
        containers.collect()
    })
}

/// A set of files with such a nesting, in which every state can be entered.
fn text_of(nesting: &Nesting) -> String {
    let mut text = String::from(
        "slot 1 period 1 s duration 10 ms; slot 2 period 1 s duration 9 ms; interpreter slot 1;\n",
    );
    for (task, (wcet, group)) in TASKS.iter().enumerate() {
        let group = group.map_or(String::new(), |group| format!("exclusive {group}"));
        let _ = writeln!(text, "task T{task} slot 2 wcet {wcet} ms {group} {{ }}");
    }
    for (place, regions) in nesting.iter().enumerate() {
        let word = if place + 1 == nesting.len() {
            "machine"
        } else {
            "container"
        };
        let _ = writeln!(text, "{word} C{place} {{");
        for (region, states) in regions.iter().enumerate() {
            let _ = writeln!(text, "region r{region} {{ initial -> S0;");
            for (state, part) in states.iter().enumerate() {
                let next = (state + 1) % states.len();
                let _ = match part {
                    Part::Task(task) => writeln!(text, "task S{state}: T{task};"),
                    Part::Super(container) => writeln!(text, "super S{state}: C{container};"),
                };
                let _ = writeln!(text, "S{state} -> S{next};");
            }
            text += "}\n";
        }
        text += "}\n";
    }
    text
}

/// Each set of tasks that can be active together in an instance of a container.
fn active(nesting: &Nesting, container: usize) -> Vec<Vec<usize>> {
    let mut together: Vec<Vec<usize>> = vec![Vec::new()];
    for states in &nesting[container] {
        let of_region: Vec<Vec<usize>> = states
            .iter()
            .flat_map(|part| match *part {
                Part::Task(task) => vec![vec![task]],
                Part::Super(container) => active(nesting, container),
            })
            .collect();
        together = together
            .iter()
            .flat_map(|before| of_region.iter().map(|more| [&before[..], more].concat()))
            .collect();
        // Only what differs: there are many ways to the same tasks.
        for tasks in &mut together {
            tasks.sort_unstable();
        }
        together.sort_unstable();
        together.dedup();
    }
    together
}

/// How long tasks that are active together take at most, in milliseconds: of a group the longest
/// alone.
fn time_of(tasks: &[usize]) -> u64 {
    let mut of_groups: BTreeMap<&str, u64> = BTreeMap::new();
    let mut sum = 0;
    for &task in tasks {
        match TASKS[task] {
            (wcet, None) => sum += wcet,
            (wcet, Some(group)) => {
                let longest = of_groups.entry(group).or_default();
                *longest = wcet.max(*longest);
            }
        }
    }
    sum + of_groups.values().sum::<u64>()
}

proptest! {
    #[test]
    fn the_sum_of_a_slot_is_that_of_the_longest_tasks_that_can_be_active_together(nesting in nesting()) {
        let text = text_of(&nesting);
        let needed = active(&nesting, nesting.len() - 1).iter().map(|tasks| time_of(tasks)).max();
        let expected = needed.filter(|needed| *needed > 9).map(|needed| {
            format!("tasks that can be active together in slot 2 take up to {needed}000 us, it lasts 9000 us")
        });
        let checked = load_text("case.esm", &text);
        let found: Vec<&String> =
            checked.diagnostics.iter().filter(|found| found.code == Code::E010).map(|found| &found.message).collect();
        prop_assert_eq!(found, Vec::from_iter(&expected), "{}", text);
    }
}

/// The tasks at the ends of paths.
fn tasks_at(nesting: &Nesting, paths: &[String]) -> Vec<usize> {
    let number = |name: &str| name[1..].parse::<usize>().unwrap();
    let mut tasks: Vec<usize> = paths
        .iter()
        .map(|path| {
            let mut container = nesting.len() - 1;
            let mut task = None;
            for step in path.split('/').collect::<Vec<_>>().chunks(2) {
                match nesting[container][number(step[0])][number(step[1])] {
                    Part::Task(of_state) => task = Some(of_state),
                    Part::Super(inside) => container = inside,
                }
            }
            task.unwrap()
        })
        .collect();
    tasks.sort_unstable();
    tasks
}

/// How many task states the instances of a container have.
fn count(nesting: &Nesting, container: usize) -> usize {
    let of_part = |part: &Part| match *part {
        Part::Task(_) => 1,
        Part::Super(inside) => count(nesting, inside),
    };
    nesting[container].iter().flatten().map(of_part).sum()
}

proptest! {
    #[test]
    fn the_worst_case_of_a_slot_is_named(nesting in nesting()) {
        let text = text_of(&nesting).replace("duration 9 ms", "duration 900 ms");
        let model = load_text("case.esm", &text).model.unwrap();
        let found = &sharing::of_model(&model)[1];
        let sets = active(&nesting, nesting.len() - 1);
        let worst_ms = sets.iter().map(|tasks| time_of(tasks)).max().unwrap();
        prop_assert_eq!(found.worst_us, Some(worst_ms * 1_000), "{}", text);
        // They can be active together, take as long, and of a group there is one.
        let together = tasks_at(&nesting, &found.together);
        prop_assert_eq!(together.iter().map(|&task| TASKS[task].0).sum::<u64>(), worst_ms);
        let is_part = |of: &Vec<usize>| {
            let mut of = of.clone();
            together.iter().all(|task| of.iter().position(|it| it == task).map(|at| of.remove(at)).is_some())
        };
        prop_assert!(sets.iter().any(is_part), "{:?} {}", found.together, text);
        prop_assert_eq!(found.tasks.len() as u64 + found.left_out, count(&nesting, nesting.len() - 1) as u64);
        prop_assert!(found.together.iter().all(|path| found.left_out > 0 || found.tasks.contains(path)));
        prop_assert_eq!((found.slot, found.duration_us, found.without_wcet), (2, 900_000, 0));
    }
}

// ─── Values that stay, in two ways ───────────────────────────────────────────────────────────────

/// What the tasks of a [`Nesting`] do with the one net there is, by their index.
const PORTS: [&str; 5] = [
    "out data n: X;",
    "in data n: X;",
    "in data n: X within 1 s;",
    "",
    "in data n: X optional;",
];

/// A set of files with such a nesting and one net, which goes through all containers. And the line
/// of each state, by container, region and number.
fn text_with_net(nesting: &Nesting) -> (String, BTreeMap<[usize; 3], usize>) {
    let mut lines = vec!["slot 1 period 10 ms duration 1 ms; interpreter slot 1;".to_owned()];
    for (task, ports) in PORTS.iter().enumerate() {
        lines.push(format!("task T{task} slot 1 {{ {ports} }}"));
    }
    let mut places = BTreeMap::new();
    for (place, regions) in nesting.iter().enumerate() {
        let is_machine = place + 1 == nesting.len();
        let (word, port) = match is_machine {
            true => ("machine", ""),
            false => ("container", "inout data n: X;"),
        };
        lines.push(format!("{word} C{place} {{ {port}"));
        let (mut from, mut to) = (Vec::new(), Vec::new());
        if !is_machine {
            from.push("n".to_owned());
        }
        for (region, states) in regions.iter().enumerate() {
            lines.push(format!("region r{region} {{ initial -> S0;"));
            for (state, part) in states.iter().enumerate() {
                let next = (state + 1) % states.len();
                let end = format!("r{region}.S{state}.n");
                let declared = match part {
                    Part::Task(task) => {
                        match PORTS[*task].split(' ').next() {
                            Some("out") => from.push(end),
                            Some("in") => to.push(end),
                            _ => {}
                        }
                        format!("task S{state}: T{task};")
                    }
                    Part::Super(container) => {
                        from.push(end);
                        format!("super S{state}: C{container};")
                    }
                };
                lines.push(format!("{declared} S{state} -> S{next};"));
                places.insert([place, region, state], lines.len());
            }
            lines.push("}".to_owned());
        }
        // An `inout` port can stand on both sides.
        if to.is_empty() {
            to.extend(
                from.iter()
                    .find(|end| *end == "n" || is_super(nesting, place, end))
                    .cloned(),
            );
        }
        if !from.is_empty() && !to.is_empty() {
            lines.push(format!("path {} -> {};", from.join(", "), to.join(", ")));
        }
        lines.push("}".to_owned());
    }
    (lines.join("\n"), places)
}

/// Whether an end such as `r0.S1.n` is one of a superstate.
fn is_super(nesting: &Nesting, container: usize, end: &str) -> bool {
    let mut steps = end
        .split('.')
        .filter_map(|step| step.get(1..)?.parse::<usize>().ok());
    let (Some(region), Some(state)) = (steps.next(), steps.next()) else {
        return false;
    };
    matches!(nesting[container][region][state], Part::Super(_))
}

/// The states of an instance of a container, each with its way from the machine on: container,
/// region and state in turn.
fn ways(
    nesting: &Nesting,
    container: usize,
    before: &[[usize; 3]],
    found: &mut Vec<Vec<[usize; 3]>>,
) {
    for (region, states) in nesting[container].iter().enumerate() {
        for (state, part) in states.iter().enumerate() {
            let way = [before, &[[container, region, state]]].concat();
            found.push(way.clone());
            if let Part::Super(inside) = part {
                ways(nesting, *inside, &way, found);
            }
        }
    }
}

proptest! {
    #[test]
    fn values_stay_where_pairs_of_states_say_so(nesting in nesting()) {
        let (text, places) = text_with_net(&nesting);
        let checked = load_text("case.esm", &text);
        // A net without a writer is none.
        if checked.has_errors() {
            return Ok(());
        }
        let mut all = Vec::new();
        ways(&nesting, nesting.len() - 1, &[], &mut all);
        let ports = |way: &Vec<[usize; 3]>| {
            let [container, region, state] = *way.last().unwrap();
            match nesting[container][region][state] {
                Part::Task(task) => PORTS[task],
                Part::Super(_) => "",
            }
        };
        let is_writer = |way: &Vec<[usize; 3]>| ports(way).starts_with("out");
        let is_reader = |way: &Vec<[usize; 3]>| ports(way).starts_with("in") && !ports(way).contains("within");
        let is_inside = |way: &Vec<[usize; 3]>, state: &Vec<[usize; 3]>| way.starts_with(state);
        // Two states are active together if their ways part in two regions.
        let are_together = |a: &Vec<[usize; 3]>, b: &Vec<[usize; 3]>| {
            let parting = a.iter().zip(b).find(|(a, b)| a != b);
            parting.is_some_and(|(a, b)| a[1] != b[1])
        };
        let mut expected: Vec<usize> = Vec::new();
        for state in &all {
            let writes = |it: &Vec<[usize; 3]>| all.iter().any(|way| is_writer(way) && is_inside(way, it));
            let (own, around) = state.split_last().unwrap();
            let beside = |it: &&Vec<[usize; 3]>| {
                it.split_last().is_some_and(|(last, before)| before == around && last[1] == own[1] && last[2] != own[2])
            };
            let together = |what: &dyn Fn(&Vec<[usize; 3]>) -> bool| {
                all.iter().any(|way| what(way) && !is_inside(way, state) && are_together(way, state))
            };
            if !writes(state) && all.iter().filter(beside).any(writes) && together(&is_reader) && !together(&is_writer) {
                expected.push(places[own]);
            }
        }
        expected.sort_unstable();
        expected.dedup();
        let positions = Positions::new(&checked.files);
        let found: Vec<usize> = checked
            .diagnostics
            .iter()
            .filter(|found| found.code == Code::W111)
            .map(|found| positions.of(found.span).line as usize)
            .collect();
        prop_assert_eq!(found, expected, "{}", text);
    }
}

// ─── Slots that tasks share ──────────────────────────────────────────────────────────────────────

/// A machine whose interpreter runs in slot 1.
fn shared(slots: &str, rest: &str) -> Model {
    let text = format!("interpreter slot 1; slot 1 period 20 ms duration 1 ms; {slots} {rest}");
    let checked = load_text("case.esm", &text);
    checked
        .model
        .clone()
        .unwrap_or_else(|| panic!("{}", checked.render(false)))
}

#[test]
fn tasks_without_wcet_count_as_nothing_and_are_told() {
    let model = shared(
        "slot 2 period 20 ms duration 4 ms;",
        "task A slot 2 { } task B slot 2 wcet 1 ms { } task C { }
         machine M { region r { task S: A; task T: B; initial -> S; S -> T; T -> S; } region q { task U: C slot 2; initial -> U; U -> U; } }",
    );
    let found = &sharing::of_model(&model)[1];
    assert_eq!(found.worst_us, Some(1_000));
    assert_eq!(found.together, ["r/T", "q/U"]);
    assert_eq!(found.tasks, ["r/S", "r/T", "q/U"]);
    assert_eq!(found.without_wcet, 2);
}

#[test]
fn a_state_that_is_never_entered_is_no_task_of_its_slot() {
    let model = shared(
        "slot 2 period 20 ms duration 4 ms;",
        "task A slot 2 wcet 1 ms { } machine M { region r { task S: A; task T: A; initial -> S; S -> S; T -> S; } }",
    );
    assert_eq!(sharing::of_model(&model)[1].tasks, ["r/S"]);
}

#[test]
fn without_a_machine_paths_begin_with_a_container() {
    let found = load_text(
        "case.esm",
        "slot 2 period 20 ms duration 4 ms; task A slot 2 wcet 1 ms { }
         container C { region r { task S: A; initial -> S; S -> S; } }
         container D { region q { super T: C; initial -> T; T -> T; } }",
    );
    let found = &sharing::of_model(&found.model.unwrap())[0];
    assert_eq!(
        (found.worst_us, &found.together[..]),
        (Some(1_000), &["C/r/S".to_owned()][..])
    );
    assert_eq!(found.tasks, ["D/q/T/r/S"]);
}

/// Regions side by side, each with a task of a group of its own and, in every second region, one of
/// the same group as the region before.
#[test]
fn exclusive_groups_beyond_the_limit_make_no_sum_too_great() {
    let machine = |regions: usize, members: usize, duration_us: usize| {
        let tasks: String = (0..regions)
            .map(|at| {
                format!(
                    "task T{at} slot 2 wcet 100 us exclusive g{} {{ }}",
                    at / members
                )
            })
            .collect();
        let regions: String = (0..regions)
            .map(|at| format!("region r{at} {{ task S: T{at}; initial -> S; S -> S; }}"))
            .collect();
        load_text(
            "case.esm",
            &format!(
                "interpreter slot 1; slot 1 period 20 ms duration 1 ms; slot 2 period 20 ms duration {duration_us} us; {tasks} machine M {{ {regions} }}"
            ),
        )
    };
    // A group of which one task is active at a time needs no telling apart.
    for (regions, members, duration_us, expected) in [
        (20, 1, 2_000, Some(2_000)),
        (16, 2, 800, Some(800)),
        (2 * sharing::MAX_GROUPS_IN_SLOT + 4, 2, 1_000, None),
    ] {
        let model = machine(regions, members, duration_us).model.unwrap();
        assert_eq!(
            sharing::of_model(&model)[1].worst_us,
            expected,
            "{regions} regions"
        );
    }
    for (regions, members, duration_us) in [(20, 1, 1_999), (16, 2, 799)] {
        assert!(
            machine(regions, members, duration_us).model.is_none(),
            "{regions} regions"
        );
    }
}

#[test]
fn what_is_too_much_to_be_named_is_counted() {
    // Each container has the one before it twice.
    let levels: String = (1..60).map(|at| {
        format!("container C{at} {{ region a {{ super S: C{0}; initial -> S; S -> S; }} region b {{ super S: C{0}; initial -> S; S -> S; }} }}", at - 1)
    }).collect();
    let model = shared(
        "slot 2 period 20 ms duration 4 ms;",
        &format!("task A slot 2 {{ }} container C0 {{ region r {{ task S: A; initial -> S; S -> S; }} }} {levels}
                  machine M {{ region r {{ super S: C59; initial -> S; S -> S; }} }}"),
    );
    let found = &sharing::of_model(&model)[1];
    assert_eq!(
        (found.tasks.len(), found.together.len()),
        (sharing::MAX_NAMED, sharing::MAX_NAMED)
    );
    assert_eq!(found.left_out, (1 << 59) - sharing::MAX_NAMED as u64);
    assert_eq!(found.worst_us, Some(0));
}

#[test]
fn slots_of_one_period_whose_tasks_never_meet_could_be_one() {
    let slots = "slot 2 period 20 ms duration 4 ms; slot 3 period 20 ms duration 2 ms; slot 4 period 40 ms duration 2 ms;
                 slot 5 period 20 ms duration 1 ms; slot 6 period 20 ms duration 1 ms;";
    let tasks = "task A slot 2 wcet 1 ms { } task B slot 3 wcet 1 ms { } task C slot 4 wcet 1 ms { } task D slot 5 wcet 1 ms { } task E slot 1 { }";
    let model = shared(
        slots,
        &format!(
            "{tasks} machine M {{
            region r {{ task S: A; task T: B; task U: C; initial -> S; S -> T; T -> U; U -> S; }}
            region q {{ task V: D; task W: A; task X: E; initial -> V; V -> W; W -> X; X -> V; }}
        }}"
        ),
    );
    // 2 and 3 meet through W and T, 3 and 5 through T and V; slot 4 has another period, slot 6 no
    // task, slot 1 runs the interpreter.
    assert_eq!(sharing::spare_slots(&model), []);
    let model = shared(
        slots,
        &format!(
            "{tasks} machine M {{
            region r {{ task S: A; task T: B; task U: C; initial -> S; S -> T; T -> U; U -> S; }}
            region q {{ task V: D; task X: E; initial -> V; V -> X; X -> V; }}
        }}"
        ),
    );
    let expected = sharing::Spare {
        first: 2,
        second: 3,
        period_us: 20_000,
        duration_us: 4_000,
    };
    assert_eq!(sharing::spare_slots(&model), [expected]);
}

// ─── Size ────────────────────────────────────────────────────────────────────────────────────────

/// What takes seconds if the work grows with the square of the size takes minutes in a debug build.
#[test]
fn large_sets_that_ask_for_much_take_little_time() {
    const SIZE: usize = 4_000;
    let lines = |line: &dyn Fn(usize) -> String| (0..SIZE).map(line).collect::<String>();
    // Flags become possible one after another, and each time the state that reads them all is
    // looked at.
    let flags = format!(
        "container C {{ {} region a {{ state A; initial -> A; {} }} region b {{ initial -> S0; {} }} }}",
        lines(&|n| format!("out flag f{n};\n")),
        lines(&|n| format!("A -> A on X{n};\nA -> A [^f{n}];\n")),
        lines(&|n| format!("state S{n}; S{n} -> S{} / set ^f{n};\n", (n + 1) % SIZE)),
    );
    // Each later transition is compared with thousands of earlier ones before one is found that it
    // competes with.
    let guards = machine(&format!(
        "task A: T; state B; initial -> A; {} A -> B [.far]; {}",
        lines(&|_| "A -> B [.near];\nA -> B [timeout];\n".into()),
        lines(&|_| "A -> B [.far and not .near];\n".into()),
    ));
    // Every container has a task of every slot inside.
    let slots = format!(
        "{} container C0 {{ {} }} {} machine M {{ region r {{ super S: C{SIZE}; initial -> S; S -> S on *; }} }}",
        lines(&|n| format!(
            "slot {} period 1 s duration 1 us; task T{n} slot {} wcet 1 us {{ }}\n",
            n + 10,
            n + 10
        )),
        lines(&|n| format!("region r{n} {{ task A: T{n}; initial -> A; }}\n")),
        lines(&|n| format!(
            "container C{} {{ region r {{ super S: C{n}; initial -> S; }} region s {{ super S: C{n}; initial -> S; }} }}\n",
            n + 1
        )),
    );
    for (what, text) in [("flags", flags), ("guards", guards), ("slots", slots)] {
        let started = work_time::taken();
        let checked = load_text("case.esm", &format!("{text}{REST}"));
        assert!(!checked.diagnostics.is_empty());
        let took = work_time::taken() - started;
        assert!(took < Duration::from_secs(60), "{what}: {took:?}");
    }
}
