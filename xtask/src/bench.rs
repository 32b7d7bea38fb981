//! `cargo xtask bench`: figures that are measured, not checked.

use std::path::Path;
use std::process::Command;

use crate::firmware;
use crate::process::{self, Failure};
use crate::setup::{self, Choice};

/// What can be measured, in which package the program for it is, and the firmware that it needs.
const BENCHES: [(&str, &str, Option<&str>); 4] = [
    ("schedule", "host-tools", None),
    ("dispatch", "esm-tests", Some("bench_dispatch")),
    ("day", "esm-tests", None),
    ("idle", "esm-tests", Some("bench_idle")),
];

/// Builds the program that measures `name` and runs it; all other arguments are its own.
///
/// # Errors
/// If there is no such program, or it fails.
pub fn command(root: &Path, mut arguments: impl Iterator<Item = String>) -> Result<(), Failure> {
    let names = BENCHES.map(|(name, ..)| name).join(", ");
    let name = arguments
        .next()
        .ok_or_else(|| Failure::Usage(format!("bench needs to know what to measure: {names}")))?;
    let (name, package, bin) = BENCHES
        .into_iter()
        .find(|(known, ..)| *known == name)
        .ok_or_else(|| Failure::Usage(format!("bench {name}: there is {names}")))?;
    let mut firmware = Vec::new();
    if let Some(bin) = bin {
        setup::emulator()?;
        let toolchain = setup::toolchain(Choice::from_environment()?)?;
        firmware = firmware::build(root, &toolchain, firmware::RELEASE, &[bin.to_owned()])?;
    }
    process::run(
        Command::new(setup::host_cargo())
            .current_dir(root)
            .args([
                "bench",
                "--quiet",
                "--package",
                package,
                "--bench",
                name,
                "--",
            ])
            .args(firmware)
            .args(arguments),
    )
}
