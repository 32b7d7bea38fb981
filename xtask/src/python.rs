//! What is in Python, in environments of its own: the client of the link with its tests, and
//! emulators of chips.

use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::time::Duration;

use crate::process::{self, Failure, command, find_program};

/// The package, below the checkout.
const CLIENT_FOLDER: &str = "clients/python";
/// The environment that the tests run in.
const ENVIRONMENT_FOLDER: &str = "target/python";
/// The mission that is uploaded.
const MISSION: &str = "missions/patrol.esm";

/// Where emulators are installed, each in a folder of its board's name.
const EMULATORS_FOLDER: &str = "target/emulators";

/// How long the environment may take to be made, and the tests to run.
const SET_UP_LIMIT: Duration = Duration::from_secs(600);
const TEST_LIMIT: Duration = Duration::from_secs(600);

/// A Python that can make environments, if there is one.
pub fn find() -> Option<PathBuf> {
    let python = find_program("python3")?;
    process::output(command(&python).args(["-c", "import venv, ensurepip"])).map(|_| python)
}

/// Installs the client and what it needs into an environment, and runs its tests against the
/// vectors and against the host board of `esm`.
///
/// # Errors
/// What did not work, or took too long.
pub fn test(root: &Path, python: &Path, esm: &Path) -> Result<(), Failure> {
    let environment = root.join(ENVIRONMENT_FOLDER);
    let own = environment.join("bin/python");
    within(
        SET_UP_LIMIT,
        command(python).args(["-m", "venv"]).arg(&environment),
    )?;
    within(
        SET_UP_LIMIT,
        command(&own)
            .args([
                "-m",
                "pip",
                "install",
                "--quiet",
                "--disable-pip-version-check",
            ])
            .arg("--force-reinstall")
            .arg(with_extra(&root.join(CLIENT_FOLDER))),
    )?;
    let blob = environment.join("mission.blob");
    process::run(
        command(esm)
            .arg("build")
            .arg(root.join(MISSION))
            .arg("-o")
            .arg(&blob)
            .args(["--board", "host"]),
    )?;
    within(
        TEST_LIMIT,
        command(&own)
            .args(["-m", "unittest", "discover", "--start-directory"])
            .arg(root.join(CLIENT_FOLDER).join("tests"))
            .env("ESM_BINARY", esm)
            .env("ESM_LINK_BLOB", &blob),
    )
}

/// Installs the emulator of a board's chip: what its `emulator/requirements.txt` names, into an
/// environment of its own.
///
/// # Errors
/// There is none for this board, or no Python; or what did not work, or took too long.
pub fn emulator(root: &Path, board: &str) -> Result<(), Failure> {
    let requirements = root.join(format!("boards/{board}/emulator/requirements.txt"));
    let Ok(wanted) = std::fs::read_to_string(&requirements) else {
        return Err(Failure::Usage(format!(
            "the board {board} has no emulator of its own: there is no boards/{board}/emulator"
        )));
    };
    let environment = root.join(EMULATORS_FOLDER).join(board);
    // What was installed last, so that nothing is asked of the network again.
    let mark = environment.join("requirements.txt");
    if std::fs::read_to_string(&mark).is_ok_and(|installed| installed == wanted) {
        eprintln!("Emulator of {board}: {}", environment.display());
        return Ok(());
    }
    let python = find().ok_or_else(|| Failure::Missing {
        what: "python3 with venv, for the emulator".into(),
        command: "apt-get install python3-venv".into(),
    })?;
    within(
        SET_UP_LIMIT,
        command(&python).args(["-m", "venv"]).arg(&environment),
    )?;
    within(
        SET_UP_LIMIT,
        command(environment.join("bin/python"))
            .args(["-m", "pip", "install", "--quiet"])
            .args(["--disable-pip-version-check", "--requirement"])
            .arg(&requirements),
    )?;
    std::fs::write(&mark, wanted).map_err(|cause| Failure::File { path: mark, cause })?;
    eprintln!("Emulator of {board}: {}", environment.display());
    Ok(())
}

/// Tests the drivers of a board at the pins of its emulated chip; `with_sensors` is the same
/// firmware with drivers of more parts.
///
/// # Errors
/// As [`emulator`]; or a test that failed.
pub fn test_pins(
    root: &Path,
    board: &str,
    firmware: &Path,
    with_sensors: &Path,
) -> Result<(), Failure> {
    emulator(root, board)?;
    within(
        TEST_LIMIT,
        command(root.join(EMULATORS_FOLDER).join(board).join("bin/python"))
            .args(["-m", "unittest", "discover", "--start-directory"])
            .arg(root.join(format!("boards/{board}/emulator/tests")))
            // What Python wrote beside its sources would have the command built anew.
            .env("PYTHONDONTWRITEBYTECODE", "1")
            .env("ESM_PINS_FIRMWARE", firmware)
            .env("ESM_SENSORS_FIRMWARE", with_sensors),
    )
}

/// The package with what it needs for robots that have a key.
fn with_extra(package: &Path) -> OsString {
    let mut package = package.as_os_str().to_owned();
    package.push("[keys]");
    package
}

fn within(limit: Duration, command: &mut std::process::Command) -> Result<(), Failure> {
    let shown = process::shown(command);
    if process::run_within(command, limit) {
        Ok(())
    } else {
        Err(Failure::Within {
            command: shown,
            limit,
        })
    }
}
