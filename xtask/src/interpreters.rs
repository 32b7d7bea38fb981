//! Engines that read a chart when they start, for `cargo xtask bench`: their programs stand in
//! `benches/interpreters`, and what they need comes from the registries of their languages to a
//! folder below `target`, nothing of it into the system. Where that cannot be, they are left out
//! with a reason.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use crate::process::{self, Failure, command, find_program, make_folder, output};

/// Their programs.
const FOLDER: &str = "benches/interpreters";
/// Where what they need is put.
const TARGET: &str = "target/benches/interpreters";

/// What an engine is written in, and so, how it comes here.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Language {
    Rust,
    JavaScript,
    Python,
}

/// How the row ends, the package's name, its language, its program.
const ENGINES: [(&str, &str, Language, &str); 5] = [
    ("scxml", "scxml", Language::Rust, "bench-interpreters"),
    (
        "scion",
        "@scion-scxml/core",
        Language::JavaScript,
        "scion.mjs",
    ),
    ("xstate", "xstate", Language::JavaScript, "xstate.mjs"),
    (
        "transitions",
        "transitions",
        Language::Python,
        "transitions_player.py",
    ),
    ("sismic", "sismic", Language::Python, "sismic_player.py"),
];

/// An engine, and the program that measures it.
pub struct Engine {
    /// How its row ends.
    pub row: &'static str,
    /// For people, with its version.
    pub name: String,
    /// What runs it.
    pub by: String,
    /// Program and arguments, or why there is none.
    pub program: Result<Vec<OsString>, String>,
}

/// Installs what the engines need.
pub fn prepare(root: &Path) -> Vec<Engine> {
    println!(
        "Engines that read a chart when they start: their packages from crates.io, npm and PyPI are put into {TARGET} …"
    );
    let languages = [Language::Rust, Language::JavaScript, Language::Python]
        .map(|language| (language, language.prepare(root)));
    ENGINES
        .into_iter()
        .map(|(row, package, language, file)| {
            let prepared = languages.iter().find(|(of, _)| *of == language);
            let mut program =
                prepared.map_or_else(|| Err(String::new()), |(_, result)| result.clone());
            if let Ok(program) = &mut program {
                program.extend(language.argument(root, file));
            }
            Engine {
                row,
                name: language.versioned(root, package),
                by: language.version(),
                program,
            }
        })
        .collect()
}

impl Language {
    fn folder(self, root: &Path) -> PathBuf {
        root.join(FOLDER).join(match self {
            Language::Rust => "rust",
            Language::JavaScript => "node",
            Language::Python => "python",
        })
    }

    fn target(self, root: &Path) -> PathBuf {
        root.join(TARGET).join(match self {
            Language::Rust => "rust",
            Language::JavaScript => "node",
            Language::Python => "python",
        })
    }

    /// The language with the version that is here.
    fn version(self) -> String {
        let said = |program: &str| output(command(program).arg("--version")).unwrap_or_default();
        match self {
            Language::Rust => "Rust".to_owned(),
            Language::JavaScript => format!("Node {}", said("node").trim()),
            Language::Python => said("python3").trim().to_owned(),
        }
    }

    /// What starts a program of it, after what that needs was installed.
    fn prepare(self, root: &Path) -> Result<Vec<OsString>, String> {
        let (folder, target) = (self.folder(root), self.target(root));
        make_folder(&target).map_err(|failure| failure.to_string())?;
        match self {
            Language::Rust => {
                let mut cargo = command(process::host_cargo());
                cargo
                    .current_dir(&folder)
                    .args(["build", "--quiet", "--release", "--target-dir"])
                    .arg(&target);
                told(process::run(&mut cargo))?;
                Ok(Vec::new())
            }
            Language::JavaScript => {
                has("node")?;
                has("npm")?;
                // Modules are looked for beside the program.
                for file in ["package.json", "harness.mjs", "scion.mjs", "xstate.mjs"] {
                    std::fs::copy(folder.join(file), target.join(file))
                        .map_err(|cause| format!("{file}: {cause}"))?;
                }
                let mut npm = command("npm");
                npm.current_dir(&target).args([
                    "install",
                    "--silent",
                    "--ignore-scripts",
                    "--no-audit",
                    "--no-fund",
                    "--no-package-lock",
                ]);
                told(process::run(&mut npm))?;
                Ok(vec!["node".into()])
            }
            Language::Python => {
                has("python3")?;
                let python = target.join("bin/python");
                if !python.is_file() {
                    told(process::run(
                        command("python3").args(["-m", "venv"]).arg(&target),
                    ))?;
                }
                let mut pip = command(&python);
                pip.args(["-m", "pip", "install", "--quiet"])
                    .args(["--disable-pip-version-check", "--requirement"])
                    .arg(folder.join(REQUIREMENTS));
                told(process::run(&mut pip))?;
                // No files of its own in the checkout.
                Ok(vec![python.into(), "-B".into()])
            }
        }
    }

    /// The program that `file` is, for what starts it.
    fn argument(self, root: &Path, file: &str) -> Option<OsString> {
        let folder = match self {
            Language::Rust => self.target(root).join("release"),
            Language::JavaScript => self.target(root),
            Language::Python => self.folder(root),
        };
        Some(folder.join(file).into())
    }

    /// A package's name with the version that is asked for.
    fn versioned(self, root: &Path, package: &str) -> String {
        let (file, before, after) = match self {
            Language::Rust => (
                "Cargo.lock",
                format!("name = \"{package}\"\nversion = \""),
                '"',
            ),
            Language::JavaScript => ("package.json", format!("\"{package}\": \""), '"'),
            Language::Python => (REQUIREMENTS, format!("{package}=="), '\n'),
        };
        let text = std::fs::read_to_string(self.folder(root).join(file)).unwrap_or_default();
        match between(&text, &before, after) {
            Some(version) => format!("{package} {version}"),
            None => package.to_owned(),
        }
    }
}

const REQUIREMENTS: &str = "requirements.txt";

/// What stands behind `before`, up to `after`.
fn between<'t>(text: &'t str, before: &str, after: char) -> Option<&'t str> {
    let (_, rest) = text.split_once(before)?;
    rest.split(after).next()
}

fn has(program: &str) -> Result<(), String> {
    match find_program(program) {
        Some(_) => Ok(()),
        None => Err(format!("there is no `{program}` here")),
    }
}

/// A failure as the reason of a row that has nothing to tell.
fn told(result: Result<(), Failure>) -> Result<(), String> {
    result.map_err(|failure| match failure {
        Failure::Ended { command, .. } => {
            let words: Vec<&str> = command
                .split(' ')
                .filter(|word| !word.contains('/'))
                .collect();
            format!("not installed: {} failed", words.join(" "))
        }
        failure => failure.to_string(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_engine_is_named_with_the_version_that_is_installed() {
        let root = Path::new("..");
        for (_, package, language, _) in ENGINES {
            let name = language.versioned(root, package);
            let version = name.strip_prefix(package).unwrap();
            assert!(
                version
                    .trim()
                    .starts_with(|first: char| first.is_ascii_digit()),
                "{name}"
            );
        }
    }

    #[test]
    fn a_version_ends_where_its_line_or_string_does() {
        assert_eq!(between("a==1\nb==2\nc==3", "b==", '\n'), Some("2"));
        assert_eq!(between("\"a\": \"1\",", "\"a\": \"", '"'), Some("1"));
        assert_eq!(between("a==1", "b==", '\n'), None);
    }
}
