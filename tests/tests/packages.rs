//! What is published can be packed, in order, and a release is the same twice.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs;
use std::path::Path;

use esm_tests::command::{root, shell};

/// Asks for what takes minutes: each package is built from what was packed.
const VERIFY: &str = "ESM_PUBLISH_VERIFY";

/// What is published, in an order in which each comes behind what it needs.
const PUBLISHED: [&str; 8] = [
    "board-settings",
    "esm-core",
    "esm-link",
    "robot-file",
    "rt-firmware",
    "esm-toolkit",
    "esm-client",
    "host-tools",
];

#[test]
fn all_that_is_published_can_be_packed_in_order() {
    let verified = std::env::var_os(VERIFY).is_some();
    let how = if verified { "" } else { " --no-verify" };
    let line = format!("cargo publish --dry-run --workspace --allow-dirty{how}");
    let done = shell(&line, root()).good();
    let mut sent: Vec<&str> = (done.err.lines())
        .filter_map(|line| line.trim_start().strip_prefix("Uploading "))
        .filter_map(|line| line.split_whitespace().next())
        .collect();
    let place = |name: &str| sent.iter().position(|it| *it == name);
    for (before, after) in [
        ("board-settings", "robot-file"),
        ("esm-core", "esm-link"),
        ("esm-link", "rt-firmware"),
        ("rt-firmware", "esm-toolkit"),
        ("esm-toolkit", "esm-client"),
        ("esm-client", "host-tools"),
    ] {
        assert!(
            place(before).is_some() && place(before) < place(after),
            "{}",
            done.err
        );
    }
    sent.sort_unstable();
    let mut published = PUBLISHED;
    published.sort_unstable();
    assert_eq!(sent, published, "{}", done.err);
    // What somebody reads in a registry before they take it.
    for line in done
        .err
        .lines()
        .filter(|line| line.contains("manifest has no "))
    {
        assert!(
            line.contains("no documentation, homepage or repository"),
            "{line}"
        );
    }
}

#[test]
fn a_release_is_the_same_twice_and_its_sums_are_right() {
    let folder = tempfile::tempdir().unwrap();
    let release = |name: &str| {
        let out = folder.path().join(name);
        let line = format!("cargo xtask release --allow-dirty --out {}", out.display());
        let told = shell(&line, root()).good();
        let sums = fs::read_to_string(out.join("SHA256SUMS")).unwrap();
        assert_eq!(told.out, sums);
        shell("sha256sum --check --strict SHA256SUMS", &out).good();
        sums
    };
    let sums = release("one");
    assert_eq!(sums, release("two"));
    let names: Vec<&str> = sums
        .lines()
        .filter_map(|line| line.split_whitespace().nth(1))
        .collect();
    let has = |start: &str, end: &str| {
        let is_it = |name: &&&str| name.starts_with(start) && name.ends_with(end);
        names.iter().filter(is_it).count() == 1
    };
    for package in PUBLISHED {
        assert!(has(&format!("{package}-0"), ".crate"), "{package}: {sums}");
    }
    for (start, end) in [
        ("rover-", "-lm3s6965.elf"),
        ("rover-", "-pico.elf"),
        ("rover-", "-pico.uf2"),
        ("esm-0", "-gnu"),
        ("LICENSE-", "MIT"),
        ("NOTES", ".md"),
    ] {
        assert!(has(start, end), "{start}…{end}: {sums}");
    }
    let notes = fs::read_to_string(folder.path().join("one/NOTES.md")).unwrap();
    assert!(
        notes.starts_with("### ") && !notes.contains("\n## "),
        "{notes}"
    );
    // What is there stays.
    let line = format!("cargo xtask release --out {}", folder.path().display());
    let refused = shell(&line, Path::new(root())).ended(2);
    assert!(refused.err.contains("is there already"), "{}", refused.err);
}
