//! No file imports what imports it, in any package, and no part of a package does.

use std::collections::BTreeMap;
use std::path::Path;

use esm_tests::command::root;
use esm_tests::imports::{Imports, Package, between_tops, circles, of_package, sources};

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

/// Every package of the workspace but its tests.
const PACKAGES: [&str; 7] = [
    "esm-core",
    "esm-link",
    "rt-firmware",
    "host-tools",
    "host-tools/client",
    "host-tools/toolkit",
    "xtask",
];

/// The circles of all packages, in what `of` makes of the imports of their files.
fn circles_of_packages(of: fn(&Imports) -> Imports) -> String {
    let mut found = String::new();
    for package in PACKAGES {
        let imports = of(&of_package(&sources(root(), package)));
        for circle in circles(&imports) {
            found += &format!("{package}: {}\n", circle.join(" "));
        }
    }
    found
}

#[test]
fn no_file_imports_what_imports_it() {
    let wrong = circles_of_packages(Imports::clone);
    assert!(wrong.is_empty(), "{wrong}");
}

/// Parts of a package that import each other in a circle have no order from top to bottom.
#[test]
fn arrows_between_the_parts_of_a_package_run_downwards() {
    let wrong = circles_of_packages(between_tops);
    assert!(wrong.is_empty(), "{wrong}");
}
