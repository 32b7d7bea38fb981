//! `cargo xtask release`: the files that a release consists of.

use std::fs;
use std::path::{Path, PathBuf};

use crate::firmware;
use crate::process::{self, Failure, cargo, make_folder};
use crate::setup::{self, Choice};

/// Where the files go if no other folder is named, below the checkout. It is this command's own.
const FOLDER: &str = "target/release-files";

/// What is asked for.
#[derive(Clone, Copy, Default)]
pub struct Wanted<'a> {
    /// Where the files go: a folder that is not there, or is empty.
    pub out: Option<&'a Path>,
    /// The part of the changelog that becomes the notes.
    pub notes: Option<&'a str>,
    /// Changes of the checkout that are not committed are in it, too.
    pub allow_dirty: bool,
}

/// Makes the files of a release: packages, the command, firmware of each board, licences, notes,
/// and the sums of them all.
///
/// # Errors
/// [`Failure`]: what could not be made.
pub fn command(root: &Path, choice: Choice, wanted: Wanted<'_>) -> Result<(), Failure> {
    let version = version(root)?;
    let changes = read(&root.join("CHANGELOG.md"))?;
    let notes = notes(&changes, &version, wanted.notes).map_err(Failure::Usage)?;
    let folder = match wanted.out {
        Some(out) => {
            let is_empty = fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_none());
            if out.exists() && !is_empty {
                return Err(Failure::Usage(format!(
                    "--out {}: it is there already, and stays as it is; name a folder that is not there, or an empty one",
                    out.display()
                )));
            }
            out.to_owned()
        }
        None => {
            let folder = root.join(FOLDER);
            // What an earlier call has made.
            let _ = fs::remove_dir_all(&folder);
            folder
        }
    };
    make_folder(&folder)?;
    eprintln!("Packages of version {version} …");
    packages(root, &folder, &version, wanted.allow_dirty)?;
    eprintln!("The command esm, optimised (some minutes the first time) …");
    let esm = command_esm(root, &folder, &version)?;
    let toolchain = setup::toolchain(choice)?;
    for board in firmware::boards(root)? {
        let named = |ending: &str| folder.join(format!("rover-{version}-{board}.{ending}"));
        let bin = [firmware::DEFAULT_BIN.to_owned()];
        let built = firmware::build_for(root, &board, &toolchain, &bin)?;
        let built = built.first().ok_or_else(|| Failure::Content {
            path: root.join("boards").join(&board),
            problem: "has no firmware",
        })?;
        copy(built, &named("elf"))?;
        if firmware::is_flashed(root, &board)? {
            let mut uf2 = process::command(&esm);
            uf2.args(["flash", "--board", &board]).arg(built);
            uf2.arg("--uf2").arg(named("uf2"));
            process::printed(&mut uf2, false)?;
        }
    }
    for licence in ["LICENSE-APACHE", "LICENSE-MIT"] {
        copy(&root.join(licence), &folder.join(licence))?;
    }
    write(&folder.join("NOTES.md"), &notes)?;
    let sums = sums(&folder)?;
    write(&folder.join("SHA256SUMS"), &sums)?;
    print!("{sums}");
    eprintln!("Release {version} is in {}.", folder.display());
    Ok(())
}

/// The packages that are published, as cargo packs them.
fn packages(root: &Path, folder: &Path, version: &str, allow_dirty: bool) -> Result<(), Failure> {
    let mut pack = cargo(root);
    pack.args(["package", "--workspace", "--no-verify", "--quiet"]);
    for package in kept_to_ourselves(root)? {
        pack.args(["--exclude", &package]);
    }
    if allow_dirty {
        pack.arg("--allow-dirty");
    }
    // A folder of its own: nothing of another version is in it.
    let target = root.join("target/release-packages");
    let _ = fs::remove_dir_all(&target);
    process::run(pack.arg("--target-dir").arg(&target))?;
    let packed = target.join("package");
    let ending = format!("-{version}.crate");
    let mut crates: Vec<PathBuf> = entries(&packed)?;
    crates.retain(|path| path.to_string_lossy().ends_with(&ending));
    if crates.is_empty() {
        return Err(Failure::Content {
            path: packed,
            problem: "has no packages of this version",
        });
    }
    for path in crates {
        copy(&path, &folder.join(path.file_name().unwrap_or_default()))?;
    }
    Ok(())
}

/// The packages of the workspace that are not published: they say so.
fn kept_to_ourselves(root: &Path) -> Result<Vec<String>, Failure> {
    let mut kept = Vec::new();
    let manifest = read(&root.join("Cargo.toml"))?;
    let members = manifest
        .split_once("members = [")
        .and_then(|(_, rest)| rest.split_once(']'))
        .map_or("", |(members, _)| members);
    for member in members.split('"').skip(1).step_by(2) {
        let text = read(&root.join(member).join("Cargo.toml"))?;
        if text.contains("\npublish = false\n") {
            let name = text.lines().find_map(|line| line.strip_prefix("name = \""));
            kept.extend(name.map(|name| name.trim_end_matches('"').to_owned()));
        }
    }
    Ok(kept)
}

/// Builds the command, for this machine; returns where it is.
fn command_esm(root: &Path, folder: &Path, version: &str) -> Result<PathBuf, Failure> {
    process::run(process::esm_build(root).args(["--locked", "--quiet"]))?;
    let target = std::env::var_os("CARGO_TARGET_DIR");
    let target = target.map_or_else(|| root.join("target"), PathBuf::from);
    let told = process::printed(process::command("rustc").arg("-vV"), false)?;
    let host = told.lines().find_map(|line| line.strip_prefix("host: "));
    let esm = folder.join(format!("esm-{version}-{}", host.unwrap_or("host")));
    copy(&target.join("release/esm"), &esm)?;
    Ok(esm)
}

/// The version of all packages: that of the workspace.
fn version(root: &Path) -> Result<String, Failure> {
    let path = root.join("Cargo.toml");
    let text = read(&path)?;
    let section = text.split_once("[workspace.package]\n");
    section
        .and_then(|(_, section)| firmware::quoted(section, "version"))
        .ok_or(Failure::Content {
            path,
            problem: "has no `version = \"…\"` in [workspace.package]",
        })
}

/// The part of a changelog that is asked for; else what is not released yet; else that of the
/// version.
fn notes(changes: &str, version: &str, asked: Option<&str>) -> Result<String, String> {
    const UNRELEASED: &str = "Unreleased";
    let part = |name: &str| {
        let mut parts = changes.split("\n## ").skip(1);
        let found = parts.find(|part| {
            let heading = part.lines().next().unwrap_or_default();
            heading.split(',').next().unwrap_or_default().trim() == name
        })?;
        let (_, text) = found.split_once('\n')?;
        let text = text.trim();
        (!text.is_empty()).then(|| format!("{text}\n"))
    };
    let names = match asked {
        Some(asked) => vec![asked],
        None => vec![UNRELEASED, version],
    };
    names.iter().find_map(|name| part(name)).ok_or_else(|| {
        format!(
            "CHANGELOG.md has nothing under `## {}`: write what changed there, or name another part with --notes",
            names.join("`, and nothing under `## ")
        )
    })
}

/// The sums of all files in a folder, by their names, as `sha256sum --check` reads them.
fn sums(folder: &Path) -> Result<String, Failure> {
    if process::find_program("sha256sum").is_none() {
        return Err(Failure::Missing {
            what: "sha256sum".to_owned(),
            command: "sudo apt-get install coreutils".to_owned(),
        });
    }
    let mut names: Vec<_> = (entries(folder)?.iter())
        .filter_map(|path| path.file_name().map(ToOwned::to_owned))
        .collect();
    names.sort();
    let mut sum = process::command("sha256sum");
    process::printed(sum.current_dir(folder).args(names), false)
}

/// What is in a folder, by its name.
fn entries(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let of = |cause| Failure::File {
        path: folder.to_owned(),
        cause,
    };
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(of)? {
        found.push(entry.map_err(of)?.path());
    }
    found.sort();
    Ok(found)
}

fn read(path: &Path) -> Result<String, Failure> {
    fs::read_to_string(path).map_err(|cause| Failure::File {
        path: path.to_owned(),
        cause,
    })
}

fn write(path: &Path, text: &str) -> Result<(), Failure> {
    fs::write(path, text).map_err(|cause| Failure::File {
        path: path.to_owned(),
        cause,
    })
}

fn copy(from: &Path, to: &Path) -> Result<(), Failure> {
    let done = fs::copy(from, to).map(drop);
    done.map_err(|cause| Failure::File {
        path: from.to_owned(),
        cause,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    const CHANGES: &str = "# Changelog\n\n## Unreleased\n\n### Added\n\n- A thing.\n\n## 0.2.0, 2026-11-23\n\n- Another.\n";

    #[test]
    fn the_notes_are_the_part_of_the_changelog_that_is_asked_for() {
        for (version, asked, expected) in [
            ("0.2.0", None, "### Added\n\n- A thing.\n"),
            ("0.2.0", Some("0.2.0"), "- Another.\n"),
            ("0.2.0", Some("Unreleased"), "### Added\n\n- A thing.\n"),
        ] {
            assert_eq!(notes(CHANGES, version, asked).as_deref(), Ok(expected));
        }
        let released = CHANGES.replace("### Added\n\n- A thing.\n\n", "");
        assert_eq!(
            notes(&released, "0.2.0", None).as_deref(),
            Ok("- Another.\n")
        );
        let nothing = notes(&released, "0.3.0", None).unwrap_err();
        assert!(
            nothing.contains("`## Unreleased`, and nothing under `## 0.3.0`"),
            "{nothing}"
        );
        assert!(notes(CHANGES, "0.2.0", Some("0.2")).is_err());
    }

    #[test]
    fn the_tests_and_this_program_are_not_published() {
        let root = Path::new("..");
        assert_eq!(kept_to_ourselves(root).unwrap(), ["xtask", "esm-tests"]);
        assert!(
            version(root)
                .unwrap()
                .starts_with(|c: char| c.is_ascii_digit())
        );
    }
}
