//! `cargo xtask bench`: figures that are measured, not checked.

use std::path::Path;
use std::process::Command;

use crate::process::{self, Failure};
use crate::setup;

/// What can be measured, and in which package the program for it is.
const BENCHES: [(&str, &str); 1] = [("schedule", "host-tools")];

/// Builds the program that measures `name` and runs it; all other arguments are its own.
///
/// # Errors
/// If there is no such program, or it fails.
pub fn command(root: &Path, mut arguments: impl Iterator<Item = String>) -> Result<(), Failure> {
    let names = BENCHES.map(|(name, _)| name).join(", ");
    let name = arguments
        .next()
        .ok_or_else(|| Failure::Usage(format!("bench needs to know what to measure: {names}")))?;
    let (name, package) = BENCHES
        .into_iter()
        .find(|(known, _)| *known == name)
        .ok_or_else(|| Failure::Usage(format!("bench {name}: there is {names}")))?;
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
            .args(arguments),
    )
}
