//! `cargo xtask mutants`: small changes for the worse, each of which a test must notice.
//!
//! The changes stand in `tests/mutants`, not in the source. All those of a package are woven into
//! one copy of it below `target/mutants`, each behind a number that the environment names. So a
//! package is compiled once, and each mutant is one run of its tests. What the package depends on
//! is taken from the checkout and not compiled again.

mod table;
mod weave;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use crate::process::{self, Failure, cargo};
use table::{Mutant, Table};

/// Where the tables are.
const TABLES: &str = "tests/mutants";

/// Where changed copies of packages are.
const COPIES: &str = "target/mutants";

/// Names the mutant that a test program has.
const VARIABLE: &str = "ESM_MUTANT";

/// A mutant may make a test run for ever: after this time it is noticed. Any test has ended before,
/// on a busy machine, too.
const TIME_LIMIT: Duration = Duration::from_secs(600);

/// As in `.cargo/config.toml`, which test programs that are started without cargo do not see.
const SEED: (&str, &str) = ("PROPTEST_RNG_SEED", "1");

/// What a copy knows of its mutants. Its tests alone have any.
const SWITCH: &str = r#"
/// Which mutant this is.
#[cfg(test)]
pub(crate) mod esm_mutant {
    extern crate std;

    pub(crate) fn is_on(number: usize) -> bool {
        static ON: std::sync::OnceLock<Option<usize>> = std::sync::OnceLock::new();
        let on = ON.get_or_init(|| std::env::var("ESM_MUTANT").ok()?.parse().ok());
        *on == Some(number)
    }
}

/// None.
#[cfg(not(test))]
pub(crate) mod esm_mutant {
    pub(crate) const fn is_on(_number: usize) -> bool {
        false
    }
}
"#;

/// Runs the mutants of these names, or all of them.
///
/// # Errors
/// [`Failure::Checks`] if a mutant is not noticed, [`Failure::Usage`] for a name that no table has,
/// [`Failure::Mutant`] for a table that does not fit the source.
pub fn command(root: &Path, names: &[String]) -> Result<(), Failure> {
    let tables = tables(root)?;
    let all = || tables.iter().flat_map(|(_, table)| &table.mutants);
    if let Some(unknown) = names
        .iter()
        .find(|name| !all().any(|mutant| mutant.name == **name))
    {
        return Err(Failure::Usage(format!("there is no mutant {unknown}")));
    }
    let is_wanted = |mutant: &Mutant| names.is_empty() || names.contains(&mutant.name);
    let mut unnoticed = 0;
    for (path, table) in &tables {
        let wanted: Vec<(usize, &Mutant)> = (table.mutants.iter().enumerate())
            .filter(|(_, mutant)| is_wanted(mutant))
            .collect();
        if wanted.is_empty() {
            continue;
        }
        let program = build(root, path, table)?;
        let folder = root.join(COPIES).join(table.short()).join(&table.package);
        check_tests(&program, path, &wanted)?;
        unnoticed += run_all(&program, &folder, table, &wanted)?;
    }
    match unnoticed {
        0 => Ok(()),
        failed => Err(Failure::Checks { failed }),
    }
}

/// The tables, with where they are.
fn tables(root: &Path) -> Result<Vec<(PathBuf, Table)>, Failure> {
    let folder = root.join(TABLES);
    let of_folder = |cause| Failure::File {
        path: folder.clone(),
        cause,
    };
    let mut paths = Vec::new();
    for entry in fs::read_dir(&folder).map_err(of_folder)? {
        let path = entry.map_err(of_folder)?.path();
        if path
            .extension()
            .is_some_and(|extension| extension == "mutants")
        {
            paths.push(path);
        }
    }
    paths.sort();
    let mut tables = Vec::new();
    for path in paths {
        let table = Table::parse(&read(&path)?).map_err(|(line, problem)| Failure::Mutant {
            place: format!("{}:{line}", path.display()),
            problem,
        })?;
        tables.push((path, table));
    }
    Ok(tables)
}

/// Compiles the tests of a copy that has all mutants of a table.
fn build(root: &Path, path: &Path, table: &Table) -> Result<PathBuf, Failure> {
    let copy = root.join(COPIES).join(table.short());
    copy_workspace(root, &copy, table)?;
    for (file, woven) in
        weave::weave(table, |file| read(&root.join(file))).map_err(|failure| failure.or_at(path))?
    {
        write(&copy.join(file), &woven)?;
    }
    let library = Path::new(&table.package).join("src/lib.rs");
    let library = copy.join(library);
    let text = read(&library)? + SWITCH;
    write(&library, &text)?;
    let mut command = cargo(&copy);
    command
        .args([
            "test",
            "--lib",
            "--no-run",
            "--message-format",
            "json-render-diagnostics",
        ])
        .args(["--manifest-path"])
        .arg(copy.join(&table.package).join("Cargo.toml"))
        .args(["--target-dir"])
        .arg(root.join("target"))
        .args(["--features", &table.features.join(",")]);
    let printed = process::printed(&mut command, false)?;
    let program = printed
        .lines()
        .filter_map(|line| line.split_once("\"executable\":\"")?.1.split('"').next())
        .next_back();
    program.map(PathBuf::from).ok_or(Failure::Content {
        path: copy,
        problem: "cargo names no test program",
    })
}

/// Tests that mutants name must be there. That they pass without a mutant is seen where all tests
/// of the package are run.
fn check_tests(program: &Path, path: &Path, mutants: &[(usize, &Mutant)]) -> Result<(), Failure> {
    let listed = process::printed(process::command(program).arg("--list"), true)?;
    let tests: Vec<&str> = (listed.lines())
        .filter_map(|line| line.strip_suffix(": test"))
        .collect();
    for (_, mutant) in mutants {
        if !tests.iter().any(|test| mutant.is_noticed_by(test)) {
            return Err(Failure::Mutant {
                place: path.display().to_string(),
                problem: format!("{} is no test", mutant.test),
            });
        }
    }
    Ok(())
}

/// Runs mutants, as many at a time as there are processors. Returns how many nobody noticed.
fn run_all(
    program: &Path,
    folder: &Path,
    table: &Table,
    mutants: &[(usize, &Mutant)],
) -> Result<usize, Failure> {
    let next = AtomicUsize::new(0);
    let unnoticed = AtomicUsize::new(0);
    let failure = Mutex::new(None);
    let workers = std::thread::available_parallelism().map_or(1, usize::from);
    std::thread::scope(|scope| {
        for _ in 0..workers {
            scope.spawn(|| {
                while let Some((number, mutant)) = mutants.get(next.fetch_add(1, Ordering::Relaxed))
                {
                    let outcome = match start(program, folder, mutant, *number) {
                        Ok(outcome) => outcome,
                        Err(cause) => {
                            if let Ok(mut failure) = failure.lock() {
                                *failure = Some(cause);
                            }
                            return;
                        }
                    };
                    let noticed = match outcome {
                        Outcome { ended: true, .. } => {
                            unnoticed.fetch_add(1, Ordering::Relaxed);
                            "NOT NOTICED"
                        }
                        Outcome { failed: None, .. } => "it does not end well",
                        Outcome {
                            failed: Some(ref test),
                            ..
                        } => test,
                    };
                    println!(
                        "{:9} {:24} {:96} {noticed}",
                        table.short(),
                        mutant.name,
                        mutant.what
                    );
                }
            });
        }
    });
    match failure.into_inner() {
        Ok(Some(failure)) => Err(failure),
        _ => Ok(unnoticed.into_inner()),
    }
}

/// How a run of tests went.
struct Outcome {
    /// All of them passed.
    ended: bool,
    /// The first that failed.
    failed: Option<String>,
}

/// Runs the tests of a mutant.
fn start(
    program: &Path,
    folder: &Path,
    mutant: &Mutant,
    number: usize,
) -> Result<Outcome, Failure> {
    let mut command = process::command(program);
    command
        .current_dir(folder)
        .arg(&mutant.test)
        .arg("--test-threads=1")
        .env(SEED.0, SEED.1)
        .env(VARIABLE, number.to_string())
        .envs(mutant.variables.iter().map(|(name, value)| (name, value)))
        .stdin(Stdio::null());
    if !mutant.test.ends_with("::") {
        command.arg("--exact");
    }
    let log = folder.join(format!("mutant-{number}.log"));
    let mut child = process::spawn_into(&mut command, &log)?;
    let of_child = |cause| Failure::Start {
        command: process::shown(&command),
        cause,
    };
    let started = Instant::now();
    let ended = loop {
        if let Some(status) = child.try_wait().map_err(of_child)? {
            break status.success();
        }
        if started.elapsed() > TIME_LIMIT {
            child.kill().map_err(of_child)?;
            child.wait().map_err(of_child)?;
            break false;
        }
        std::thread::sleep(Duration::from_millis(5));
    };
    let said = String::from_utf8_lossy(&fs::read(&log).unwrap_or_default()).into_owned();
    let failed = said
        .lines()
        .find_map(|line| line.strip_prefix("test ")?.strip_suffix(" ... FAILED"));
    Ok(Outcome {
        ended,
        failed: failed.map(str::to_owned),
    })
}

/// Copies a package into a workspace of its own. What it reads beside itself is linked to.
fn copy_workspace(root: &Path, copy: &Path, table: &Table) -> Result<(), Failure> {
    let manifest = workspace_manifest(root, &read(&root.join("Cargo.toml"))?, &table.package);
    write(&copy.join("Cargo.toml"), &manifest)?;
    let lock = copy.join("Cargo.lock");
    if !lock.exists() {
        write(&lock, &read(&root.join("Cargo.lock"))?)?;
    }
    let mut folder = PathBuf::new();
    for part in Path::new(&table.package) {
        link_beside(&root.join(&folder), &copy.join(&folder), part)?;
        folder.push(part);
    }
    copy_package(&root.join(&folder), &copy.join(&folder))?;
    let manifest = copy.join(&folder).join("Cargo.toml");
    let text = absolute_paths(&root.join(&folder), &read(&manifest)?, true);
    write(&manifest, &text)
}

/// Links to what is in a folder, but for `part` and for what a workspace has of its own.
fn link_beside(from: &Path, to: &Path, part: &std::ffi::OsStr) -> Result<(), Failure> {
    process::make_folder(to)?;
    let of = |path: &Path| {
        let path = path.to_owned();
        move |cause| Failure::File { path, cause }
    };
    for entry in fs::read_dir(from).map_err(of(from))? {
        let name = entry.map_err(of(from))?.file_name();
        let is_own = [
            "target",
            ".git",
            ".cargo",
            "Cargo.toml",
            "Cargo.lock",
            "rust-toolchain.toml",
        ];
        let link = to.join(&name);
        if name == part || is_own.iter().any(|own| name == **own) || link.is_symlink() {
            continue;
        }
        std::os::unix::fs::symlink(from.join(&name), &link).map_err(of(&link))?;
    }
    Ok(())
}

/// Copies a package without others that are in it. Files that are as they were stay untouched, so
/// that cargo does not compile them again.
fn copy_package(from: &Path, to: &Path) -> Result<(), Failure> {
    process::make_folder(to)?;
    let of_folder = |cause| Failure::File {
        path: from.to_owned(),
        cause,
    };
    for entry in fs::read_dir(from).map_err(of_folder)? {
        let entry = entry.map_err(of_folder)?;
        let (path, copy) = (entry.path(), to.join(entry.file_name()));
        if !path.is_dir() {
            let bytes = fs::read(&path).map_err(|cause| Failure::File { path, cause })?;
            write_bytes(&copy, &bytes)?;
        } else if entry.file_name() != "target" && !path.join("Cargo.toml").exists() {
            copy_package(&path, &copy)?;
        }
    }
    remove_gone(from, to)
}

/// Removes from a copy what is no more in the folder that it is of: a module that was moved would
/// be there twice.
fn remove_gone(from: &Path, to: &Path) -> Result<(), Failure> {
    let of_copy = |cause| Failure::File {
        path: to.to_owned(),
        cause,
    };
    for entry in fs::read_dir(to).map_err(of_copy)? {
        let entry = entry.map_err(of_copy)?;
        if from.join(entry.file_name()).exists() {
            continue;
        }
        let gone = entry.path();
        let is_folder = entry.file_type().map_err(of_copy)?.is_dir();
        let removed = match is_folder {
            true => fs::remove_dir_all(&gone),
            false => fs::remove_file(&gone),
        };
        removed.map_err(|cause| Failure::File { path: gone, cause })?;
    }
    Ok(())
}

/// The workspace of the checkout with one member, and without lints.
fn workspace_manifest(root: &Path, manifest: &str, package: &str) -> String {
    let mut text = String::new();
    let (mut is_left_out, mut is_list) = (false, false);
    for line in manifest.lines() {
        if line.starts_with('[') {
            is_left_out = line.starts_with("[workspace.lints");
        }
        is_list |= line.starts_with("members = ") || line.starts_with("exclude = ");
        if !is_left_out && !is_list {
            text += line;
            text.push('\n');
        }
        is_list &= !line.contains(']');
        if line == "[workspace]" {
            text += &format!("members = [{package:?}]\n");
        }
    }
    text += "\n[workspace.lints.rust]\nwarnings = \"allow\"\n";
    absolute_paths(root, &text, false)
}

/// Paths of dependencies from the root of the file system on; `upward_only` leaves those alone that
/// stay in the folder.
fn absolute_paths(folder: &Path, manifest: &str, upward_only: bool) -> String {
    let mut text = String::new();
    for line in manifest.lines() {
        match line.split_once("path = \"") {
            Some((before, rest))
                if before.contains('{') && (!upward_only || rest.starts_with("..")) =>
            {
                let (path, after) = rest.split_once('"').unwrap_or((rest, ""));
                let path = folder.join(path);
                let path = path.canonicalize().unwrap_or(path);
                text += &format!("{before}path = \"{}\"{after}", path.display());
            }
            _ => text += line,
        }
        text.push('\n');
    }
    text
}

fn read(path: &Path) -> Result<String, Failure> {
    fs::read_to_string(path).map_err(|cause| Failure::File {
        path: path.to_owned(),
        cause,
    })
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    write_bytes(path, text.as_bytes())
}

/// Writes a file, unless it is so already.
fn write_bytes(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    if fs::read(path).is_ok_and(|there| there == bytes) {
        return Ok(());
    }
    if let Some(folder) = path.parent() {
        process::make_folder(folder)?;
    }
    fs::write(path, bytes).map_err(|cause| Failure::File {
        path: path.to_owned(),
        cause,
    })
}

#[cfg(test)]
mod tests {
    use super::{absolute_paths, workspace_manifest};
    use std::path::Path;

    #[test]
    fn a_copy_is_a_workspace_of_one_member_without_lints() {
        let manifest = "[workspace]\nresolver = \"3\"\nmembers = [\n    \"a\",\n    \"b\",\n]\n\
                        exclude = [\"c\"]\n\n[workspace.dependencies]\na = { path = \"a\" }\n\
                        b = \"1\"\n\n[workspace.lints.clippy]\nall = \"warn\"\n\n[profile.dev]\n";
        assert_eq!(
            workspace_manifest(Path::new("/nowhere"), manifest, "b/c"),
            "[workspace]\nmembers = [\"b/c\"]\nresolver = \"3\"\n\n[workspace.dependencies]\n\
             a = { path = \"/nowhere/a\" }\nb = \"1\"\n\n[profile.dev]\n\n\
             [workspace.lints.rust]\nwarnings = \"allow\"\n"
        );
    }

    #[test]
    fn paths_that_leave_a_package_are_made_absolute_and_others_are_not() {
        let manifest =
            "[[bin]]\npath = \"src/bin/a.rs\"\n[dependencies]\na = { path = \"../a\" }\n";
        assert_eq!(
            absolute_paths(Path::new("/nowhere/b"), manifest, true),
            "[[bin]]\npath = \"src/bin/a.rs\"\n[dependencies]\na = { path = \"/nowhere/b/../a\" }\n"
        );
    }
}
