//! `esm new board`: a folder of the framework's checkout that builds, to begin a board with.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use clap::Args;
use toml_edit::DocumentMut;

use super::files::{self, NewFile, Report};
use super::framework;
use super::locks::{self, Rename};
use super::names::Name;
use crate::boards::{self, Firmware};
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::file;

/// Begins a board: a folder in the framework's checkout that builds
///
/// It is what another board is made of, under its own name, without what was measured on that
/// board and its programs for measuring: so it builds as it is, and one part after another is
/// exchanged for the new board's. "On real hardware", in the book's chapter on a robot of your own,
/// says what a board has.
#[derive(Debug, Args)]
#[command(after_help = "\
Example:
  esm new board my_board

With --json one object: kind, name, folder, files (below that folder), changed, next.")]
pub struct NewBoardArgs {
    /// Its name: small letters, digits and `_`
    #[arg(value_name = "NAME")]
    pub name: String,

    /// The board that it begins as
    #[arg(long, value_name = "B", default_value = boards::DEFAULT)]
    pub from: String,

    /// The framework's checkout [default: as for `esm new robot`]
    #[arg(long, value_name = "PATH")]
    pub framework: Option<PathBuf>,

    /// One JSON object, for programs
    #[arg(long)]
    pub json: bool,
}

/// Runs the command.
///
/// # Errors
/// The name is none, a board has it, or the board that it begins as has no folder.
pub fn execute(args: &NewBoardArgs, console: &mut Console) -> Result<(), CommandError> {
    let name = Name::new(&args.name).map_err(CommandError::Usage)?;
    let from = boards::find(&args.from).map_err(|error| CommandError::Usage(error.into()))?;
    let Some(firmware) = from.firmware else {
        return Err(CommandError::Usage(anyhow!(
            "the board {} is a part of this command, and has no folder: name another with --from",
            from.name
        )));
    };
    let checkout = framework::find(args.framework.as_deref(), &std::env::current_dir()?)?;
    let folder = checkout.join("boards").join(&name.snake);
    if folder.exists() {
        return Err(CommandError::Usage(anyhow!(
            "{} is there already, and stays as it is: take another name",
            folder.display()
        )));
    }
    let new = board_files(
        &checkout.join("boards").join(from.name),
        from.name,
        firmware,
        &name,
    )?;
    files::write(&folder, &new)?;
    let board = &name.snake;
    let report = Report {
        kind: "board",
        name: board,
        folder: folder.display().to_string(),
        files: files::names(&new),
        changed: Vec::new(),
        next: vec![
            format!("cargo xtask firmware --board {board}     # at the top of the checkout"),
            "board.toml: say what the new board is, what runs it, and what it has".to_owned(),
            format!(
                "esm/Cargo.toml: add a feature `{board}` and the dependency `{board}-board`, as those of {}, and hand it on \
                 in esm/src/lib.rs",
                from.name
            ),
        ],
    };
    report.tell(args.json, console)
}

/// What belongs to the other board alone: what was measured on it, and what a build has made.
const NOT_TAKEN: [&str; 5] = [
    "target",
    "costs.txt",
    "expected-size.txt",
    "measured",
    "__pycache__",
];

/// The files of the board, made of those in the folder of another.
fn board_files(
    folder: &Path,
    from: &str,
    firmware: Firmware,
    name: &Name,
) -> Result<Vec<NewFile>, CommandError> {
    let mut new = Vec::new();
    for path in paths(folder, Path::new(""))? {
        let is_program = path.starts_with("src/bin");
        if is_program && path.file_stem().is_none_or(|stem| stem != firmware.bin) {
            continue;
        }
        let text = file::read_text(&folder.join(&path), "board's file")?;
        let text = match path.file_name().and_then(|it| it.to_str()) {
            Some("board.toml") => board_toml(&text, from, name)?,
            Some("Cargo.lock") => {
                let [from, to] = [from, &name.snake].map(|board| format!("{board}-board"));
                let rename = Rename {
                    from: &from,
                    to: &to,
                };
                locks::renamed(&text, rename)
            }
            _ => renamed(&text, from, &name.snake),
        };
        let named = renamed(&path.to_string_lossy(), from, &name.snake);
        new.push(NewFile::new(named, text));
    }
    Ok(new)
}

/// The paths of all files below a folder that a new board takes, in their order.
fn paths(top: &Path, below: &Path) -> Result<Vec<PathBuf>, CommandError> {
    let folder = top.join(below);
    let unread = |error: std::io::Error| {
        CommandError::Usage(anyhow!(
            "cannot read the board's folder {}: {error}",
            folder.display()
        ))
    };
    let mut found = Vec::new();
    for entry in fs::read_dir(&folder).map_err(unread)? {
        let entry = entry.map_err(unread)?;
        if NOT_TAKEN.iter().any(|name| entry.file_name() == *name) {
            continue;
        }
        let path = below.join(entry.file_name());
        match entry.file_type().map_err(unread)?.is_dir() {
            true => found.extend(paths(top, &path)?),
            false => found.push(path),
        }
    }
    found.sort();
    Ok(found)
}

/// A text in which the board has another name. What is said to be a package, such as a chip's
/// crate, keeps its name.
fn renamed(text: &str, from: &str, to: &str) -> String {
    let package = format!("package = \"{from}\"");
    let lines = text.split_inclusive('\n');
    let renamed = lines.map(|line| match line.contains(&package) {
        true => line.to_owned(),
        false => words_replaced(line, from, to),
    });
    renamed.collect()
}

/// A line with each word `from` replaced.
fn words_replaced(line: &str, from: &str, to: &str) -> String {
    let is_letter = |c: char| c.is_ascii_alphanumeric() || c == '_';
    let mut text = String::new();
    let mut rest = line;
    while let Some(place) = rest.find(from) {
        let (before, found) = rest.split_at(place);
        let behind = &found[from.len()..];
        text += before;
        // A linker's option has its script behind it without a blank.
        let begins = !text.ends_with(is_letter) || text.ends_with("-T");
        text += match begins && !behind.starts_with(is_letter) {
            true => to,
            false => from,
        };
        rest = behind;
    }
    text + rest
}

/// What tools know of the board: it is not the one that is meant where none is named, and nobody
/// has measured how fast it is.
fn board_toml(text: &str, from: &str, name: &Name) -> Result<String, CommandError> {
    let mut file: DocumentMut = text
        .parse()
        .map_err(|error| CommandError::Input(anyhow!("board.toml of the board {from}: {error}")))?;
    file.remove("default");
    if let Some(clock) = file.get_mut("clock").and_then(|item| item.as_table_mut()) {
        clock.remove("instruction_ns");
    }
    for (key, text) in [
        ("name", name.snake.clone()),
        (
            "description",
            format!("{}, which begins as the board {from}", name.camel),
        ),
    ] {
        if let Some(item) = file.get_mut(key).and_then(|item| item.as_value_mut()) {
            let decor = item.decor().clone();
            *item = text.into();
            *item.decor_mut() = decor;
        }
    }
    Ok(file.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_board_with_a_folder_can_be_begun_with() {
        for board in boards::all() {
            let Some(firmware) = board.firmware else {
                continue;
            };
            let folder = Path::new("../boards").join(board.name);
            let name = Name::new("my_board").unwrap();
            let new = board_files(&folder, board.name, firmware, &name).unwrap();
            let text = |path: &str| {
                let file = new.iter().find(|file| file.path == Path::new(path));
                file.unwrap_or_else(|| panic!("{path}")).text.as_str()
            };
            let manifest: DocumentMut = text("Cargo.toml").parse().unwrap();
            assert_eq!(manifest["package"]["name"].as_str(), Some("my_board-board"));
            assert_eq!(manifest["lib"]["name"].as_str(), Some("my_board"));
            let settings: DocumentMut = text("board.toml").parse().unwrap();
            assert_eq!(settings["name"].as_str(), Some("my_board"));
            assert!(settings.get("default").is_none());
            let program = format!("src/bin/{}.rs", firmware.bin);
            assert!(
                text(&program).contains("my_board::app! {"),
                "{}",
                text(&program)
            );
            let programs = new.iter().filter(|file| file.path.starts_with("src/bin"));
            assert_eq!(programs.count(), 1);
            let names = [
                "pub const NAME: &str = \"my_board\";",
                "rp_board::board! { name: \"my_board\",",
            ];
            assert!(names.iter().any(|name| text("src/lib.rs").contains(name)));
            for line in text("Cargo.lock").lines() {
                assert_ne!(line, format!("name = \"{}-board\"", board.name));
            }
        }
    }

    #[test]
    fn only_whole_words_are_the_boards() {
        for (line, expected) in [
            ("lm3s6965::app!\n", "mine::app!\n"),
            ("machine lm3s6965evb\n", "machine lm3s6965evb\n"),
            (
                "pac = { package = \"lm3s6965\" }\n",
                "pac = { package = \"lm3s6965\" }\n",
            ),
            ("name = \"lm3s6965-board\"\n", "name = \"mine-board\"\n"),
            ("name = \"lm3s6965\"\n", "name = \"mine\"\n"),
            ("my_lm3s6965, lm3s6965", "my_lm3s6965, mine"),
            ("link-arg=-Tlm3s6965.x", "link-arg=-Tmine.x"),
        ] {
            assert_eq!(renamed(line, "lm3s6965", "mine"), expected);
        }
    }
}
