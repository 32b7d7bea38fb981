//! What the analysis says of small sets of files.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fmt::Write as _;

use super::holes::Holes;
use crate::lang::diagnostic::Sink;
use crate::lang::loader::{self, Memory};
use crate::lang::resolve::{self, Trees};

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
