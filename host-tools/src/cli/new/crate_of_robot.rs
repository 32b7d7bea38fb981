//! The robot's crate that something new is added to, and what is entered in its registry.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use toml_edit::DocumentMut;

use crate::cli::exit::CommandError;
use crate::cli::file;

/// A crate of a robot.
pub struct RobotCrate {
    /// Its folder.
    pub folder: PathBuf,
    /// Its name, as Rust writes it.
    pub name: String,
    /// Its `src/lib.rs`.
    pub library: String,
}

/// Where the registry stands, below the crate's folder.
pub const LIBRARY: &str = "src/lib.rs";

impl RobotCrate {
    /// The crate in `folder`, or in the nearest folder above that has one.
    ///
    /// # Errors
    /// There is none, or it cannot be read.
    pub fn find(folder: &Path) -> Result<Self, CommandError> {
        let whole = folder.canonicalize().map_err(|error| {
            CommandError::Usage(anyhow!("{} is no folder: {error}", folder.display()))
        })?;
        for folder in whole.ancestors() {
            let manifest = folder.join("Cargo.toml");
            if !manifest.is_file() {
                continue;
            }
            let text = file::read_text(&manifest, "manifest")?;
            if let Some(name) = name_of_robot(&text) {
                return Ok(Self {
                    library: file::read_text(&folder.join(LIBRARY), "robot's library")?,
                    folder: folder.to_owned(),
                    name,
                });
            }
        }
        Err(CommandError::Usage(anyhow!(
            "{} is in no robot's crate: go to its folder, or name it with --robot DIR; `esm new robot NAME` makes one",
            folder.display()
        )))
    }
}

/// The name of the crate that a manifest is of, if it is a robot's: it depends on the framework.
fn name_of_robot(manifest: &str) -> Option<String> {
    let manifest: DocumentMut = manifest.parse().ok()?;
    manifest.get("dependencies")?.get("esm")?;
    let name = manifest.get("package")?.get("name")?.as_str()?;
    Some(name.replace('-', "_"))
}

/// A task that a registry is to have.
pub struct Entry<'a> {
    /// The module of the crate that has it, where it is a new one.
    pub module: Option<&'a str>,
    /// Its field of the registry.
    pub field: &'a str,
    /// Its type, as the library can name it.
    pub task: &'a str,
}

impl Entry<'_> {
    fn in_registry(&self) -> String {
        format!("{}: {}[1],", self.field, self.task)
    }

    fn in_constructor(&self) -> String {
        format!("{}: TaskPool::from_fn({}::default),", self.field, self.task)
    }

    /// The lines that a person adds, and where.
    pub fn by_hand(&self) -> Vec<String> {
        let mut lines = Vec::new();
        if let Some(module) = self.module {
            lines.push(format!("{LIBRARY}: add `pub mod {module};`"));
        }
        lines.push(format!(
            "{LIBRARY}: add `{}` to registry!",
            self.in_registry()
        ));
        let constructor = self.in_constructor();
        lines.push(format!(
            "{LIBRARY}: add `{constructor}` where the robot is made"
        ));
        lines
    }
}

/// The library with an entry more. `None` where it is not laid out as `esm new robot` does it, so
/// that only a person knows where the lines go.
pub fn entered(library: &str, entry: &Entry<'_>) -> Option<String> {
    let mut lines: Vec<String> = library.lines().map(str::to_owned).collect();
    // From the end to the beginning, so that places stay what they are.
    let registry = one(&lines, |line| line == "registry! {")?;
    let registry_end = registry + lines[registry..].iter().position(|line| line == "    }")?;
    let of_pool = |line: &str| line.contains(": TaskPool::");
    let first_pool = registry_end + lines[registry_end..].iter().position(|it| of_pool(it))?;
    let indent = indent_of(&lines[first_pool]);
    let closing = format!("{}}}", " ".repeat(indent.checked_sub(4)?));
    let pools_end = first_pool
        + lines[first_pool..]
            .iter()
            .position(|line| *line == closing)?;
    // All pools stand together: else there are two robots here.
    if lines[pools_end..].iter().any(|line| of_pool(line)) {
        return None;
    }
    let is_there = |line: &String| line.trim_start().starts_with(&format!("{}: ", entry.field));
    if lines[registry..pools_end].iter().any(is_there) {
        return None;
    }
    for line in laid_out(&entry.in_constructor(), indent).into_iter().rev() {
        lines.insert(pools_end, line);
    }
    lines.insert(registry_end, format!("        {}", entry.in_registry()));
    if let Some(module) = entry.module {
        let named = |line: &String| {
            let name = line.strip_prefix("pub mod ")?.strip_suffix(';')?;
            Some(name.to_owned())
        };
        let modules: Vec<(usize, String)> = (lines.iter().enumerate())
            .filter_map(|(place, line)| Some((place, named(line)?)))
            .collect();
        let behind = modules.iter().rfind(|(_, name)| name.as_str() < module);
        let place = match behind {
            Some((place, _)) => place + 1,
            None => modules.first()?.0,
        };
        if place >= registry {
            return None;
        }
        lines.insert(place, format!("pub mod {module};"));
    }
    Some(lines.join("\n") + "\n")
}

/// A line of the constructor as `cargo fmt` lays it out: one that is too wide is three.
fn laid_out(line: &str, indent: usize) -> Vec<String> {
    /// What a line has at most.
    const COLUMNS: usize = 100;
    let blanks = " ".repeat(indent);
    match (line.split_once('('), line.strip_suffix("),")) {
        (Some((before, behind)), Some(_)) if indent + line.len() > COLUMNS => vec![
            format!("{blanks}{before}("),
            format!("{blanks}    {},", behind.trim_end_matches("),")),
            format!("{blanks}),"),
        ],
        _ => vec![format!("{blanks}{line}")],
    }
}

/// The only line that is so.
fn one(lines: &[String], is_it: impl Fn(&str) -> bool) -> Option<usize> {
    let mut found = lines.iter().enumerate().filter(|(_, line)| is_it(line));
    match (found.next(), found.next()) {
        (Some((place, _)), None) => Some(place),
        _ => None,
    }
}

fn indent_of(line: &str) -> usize {
    line.len() - line.trim_start().len()
}

#[cfg(test)]
mod tests {
    use super::*;

    const LIBRARY_TEXT: &str = "\
pub mod b;
pub mod d;

registry! {
    /// A robot.
    pub struct Mine {
        turn: Turn[1],
    }
}

impl Mine {
    pub fn new() -> Self {
        Self {
            turn: TaskPool::new([Turn::default()]),
        }
    }
}
";

    #[test]
    fn a_task_is_entered_at_its_three_places() {
        for (module, modules) in [
            ("a", "pub mod a;\npub mod b;\npub mod d;\n"),
            ("c", "pub mod b;\npub mod c;\npub mod d;\n"),
            ("e", "pub mod b;\npub mod d;\npub mod e;\n"),
        ] {
            let task = format!("{module}::Wave");
            let entry = Entry {
                module: Some(module),
                field: "wave",
                task: &task,
            };
            let text = entered(LIBRARY_TEXT, &entry).unwrap();
            assert!(text.starts_with(modules), "{text}");
            let registry =
                format!("        turn: Turn[1],\n        wave: {module}::Wave[1],\n    }}\n");
            assert!(text.contains(&registry), "{text}");
            let pool = format!(
                "            turn: TaskPool::new([Turn::default()]),\n            wave: TaskPool::from_fn({module}::Wave::default),\n        }}\n"
            );
            assert!(text.contains(&pool), "{text}");
            assert_eq!(text.lines().count(), LIBRARY_TEXT.lines().count() + 3);
            // Once is enough.
            assert_eq!(entered(&text, &entry), None);
        }
    }

    #[test]
    fn what_is_laid_out_otherwise_is_left_to_a_person() {
        let entry = Entry {
            module: Some("c"),
            field: "wave",
            task: "c::Wave",
        };
        for (from, to) in [
            ("registry! {\n", "registry!(\n"),
            ("TaskPool::new", "pool"),
            ("pub mod b;\npub mod d;\n", ""),
            ("    }\n}\n\nimpl", "  }\n}\n\nimpl"),
        ] {
            let text = LIBRARY_TEXT.replacen(from, to, 1);
            assert_ne!(text, LIBRARY_TEXT);
            assert_eq!(entered(&text, &entry), None, "{text}");
        }
        let twice = format!("{LIBRARY_TEXT}{LIBRARY_TEXT}");
        assert_eq!(entered(&twice, &entry), None);
        assert_eq!(entry.by_hand().len(), 3);
    }

    #[test]
    fn a_robot_is_what_depends_on_the_framework() {
        let robot = "[package]\nname = \"my-robot\"\n[dependencies]\nesm = { path = \"/esm\" }\n";
        assert_eq!(name_of_robot(robot).as_deref(), Some("my_robot"));
        let firmware = "[package]\nname = \"f\"\n[dependencies]\nmy_robot = { path = \"..\" }\n";
        assert_eq!(name_of_robot(firmware), None);
        assert_eq!(name_of_robot("no manifest ["), None);
    }
}
