//! No file imports what imports it, in any package; nor does a part of the firmware's crates.

use std::collections::BTreeMap;
use std::path::Path;

use esm_tests::command::root;
use esm_tests::imports::{Package, between_tops, circles, of_package, sources};

/// The circles of a made-up package, by its files.
fn of(files: &[(&str, &str)]) -> Vec<String> {
    let files: BTreeMap<&str, &str> = files.iter().copied().collect();
    let read = |file: &Path| Some((*files.get(file.to_str()?)?).to_owned());
    let found = circles(&Package::read(&read, "lib.rs").imports());
    found.iter().map(|circle| circle.join(" ")).collect()
}

const TWO: (&str, &str) = ("lib.rs", "pub mod a;\npub mod b;\n");
const LEAF: (&str, &str) = ("b.rs", "pub struct B;\n");

#[test]
fn a_circle_that_is_planted_is_found() {
    for (what, a) in [
        ("a plain use", "use crate::b::B;\npub struct A;"),
        ("a tree", "use crate::{\n    b::{B, C},\n};\npub struct A;"),
        (
            "a path in the code",
            "pub struct A;\nfn f() { let _ = crate::b::B; }",
        ),
        (
            "a path to the parent",
            "pub struct A;\nfn f(_: super::b::B) {}",
        ),
        (
            "an inner module",
            "pub mod inner { use super::super::b::B; }\npub struct A;",
        ),
        (
            "a character",
            "const Q: char = '\"';\nuse crate::b::B;\npub struct A;",
        ),
    ] {
        let back = ("b.rs", "use super::a::A;\npub struct B;\n");
        assert_eq!(of(&[TWO, ("a.rs", a), back]), ["a.rs b.rs"], "{what}");
        assert_eq!(of(&[TWO, ("a.rs", a), LEAF]), [] as [&str; 0], "{what}");
    }
}

#[test]
fn tests_comments_and_texts_import_nothing() {
    for (what, b) in [
        (
            "a comment",
            "// use crate::a::A;\n/* crate::a::A */\npub struct B;",
        ),
        (
            "a text",
            "const T: &str = \"crate::a::A\";\nconst U: &str = r#\"crate::a::\"#;",
        ),
        (
            "a test",
            "pub struct B;\n#[cfg(test)]\nmod tests { use crate::a::A; fn f() {} }",
        ),
        (
            "a test's file",
            "pub struct B;\n#[cfg(test)]\nmod tests;\npub(in crate::a) fn f() {}",
        ),
        (
            "another module's name",
            "pub struct B;\nfn f() { a::A::new() }",
        ),
        (
            "a test's import",
            "#[cfg(test)]\nuse crate::a::{A, C};\npub struct B;",
        ),
        (
            "an import for links in comments",
            "#[cfg(doc)]\nuse crate::a::{A, C};\n/// [`A`]\npub struct B;",
        ),
    ] {
        let a = ("a.rs", "use crate::b::B;\npub struct A;");
        assert_eq!(of(&[TWO, a, ("b.rs", b)]), [] as [&str; 0], "{what}");
    }
}

#[test]
fn a_parent_that_hands_on_names_is_not_what_its_children_import() {
    let root = (
        "lib.rs",
        "mod a;\nmod b;\npub use b::B;\nuse a::g as inner;\npub fn f() { inner() }",
    );
    let uses_b = ("a.rs", "use super::B;\npub fn g() {}");
    let uses_f = ("a.rs", "use super::f;\npub fn g() { f() }");
    assert_eq!(of(&[root, uses_b, LEAF]), [] as [&str; 0]);
    assert_eq!(of(&[root, uses_f, LEAF]), ["a.rs lib.rs"]);
}

/// Circles that are still there, by package: each is to be broken, and none may join them.
const KNOWN: &[(&str, &[&str])] = &[
    (
        "host-tools/client",
        &[
            "link_client/mod.rs link_client/signing.rs",
            "serial/mod.rs serial/pacing.rs serial/port.rs serial/takeover.rs serial/wire.rs",
        ],
    ),
    (
        "host-tools/toolkit",
        &[
            "diagram/body.rs diagram/drawing.rs diagram/face.rs diagram/mod.rs",
            "inspect/mod.rs inspect/source/mod.rs",
            "lang/parser/cures.rs lang/parser/mod.rs lang/parser/values.rs",
            "lang/resolve/mod.rs lang/resolve/slots.rs lang/resolve/tasks.rs",
        ],
    ),
];

/// Packages that are being rebuilt: what is found in them is told, and fails nothing yet.
const REBUILT: [&str; 3] = ["esm-core", "esm-link", "rt-firmware"];

#[test]
fn no_file_imports_what_imports_it() {
    let mut wrong = Vec::new();
    for package in [
        "esm-core",
        "esm-link",
        "rt-firmware",
        "host-tools",
        "host-tools/client",
        "host-tools/toolkit",
    ] {
        let found = circles(&of_package(&sources(root(), package)));
        let found: Vec<String> = found.iter().map(|circle| circle.join(" ")).collect();
        let known = KNOWN.iter().find(|(of, _)| *of == package);
        let known = known.map_or(&[][..], |it| it.1);
        for circle in &found {
            if REBUILT.contains(&package) {
                println!("{package}: {circle}");
            } else if !known.contains(&circle.as_str()) {
                wrong.push(format!("{package}: {circle}"));
            }
        }
        for circle in known
            .iter()
            .filter(|it| !found.iter().any(|found| found == *it))
        {
            wrong.push(format!("{package}: no longer there: {circle}"));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Parts of a package that import each other in a circle have no order from top to bottom.
#[test]
#[ignore = "rt-firmware still has such circles: it says which"]
fn arrows_between_the_parts_of_the_firmware_run_downwards() {
    let mut wrong = Vec::new();
    for package in REBUILT {
        let tops = between_tops(&of_package(&sources(root(), package)));
        let found = circles(&tops);
        wrong.extend(
            found
                .iter()
                .map(|circle| format!("{package}: {}", circle.join(" "))),
        );
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
