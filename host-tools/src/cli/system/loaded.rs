//! A system file with all that it names.

use std::collections::BTreeMap;
use std::io::Write;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use esm_core::Verified;

use super::then::ThenOn;
use crate::boards;
use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::cli::mission::{self, Audience};
use crate::cli::{file, stage};
use crate::compile::NameTable;
use crate::host_board;
use crate::lang::{self, Checked, Code, Diagnostic, Severity};
use crate::model::{Model, SourceFile};
use crate::system::declaration::{Processor, System};
use crate::system::ends::{self, Mission};
use crate::system::read::read;
use crate::world::World;

/// A system, and everything that was found out about it.
pub struct Loaded {
    /// What the file says; none where it has errors.
    pub system: Option<System>,
    /// The mission of each processor; none where it could not be read.
    pub missions: Vec<Option<LoadedMission>>,
    /// Missions that take over: when, by plant time in microseconds, on which processor.
    pub then: Vec<(u64, usize, LoadedMission)>,
    /// The world that the file names.
    pub world: Option<World>,
    /// The system file, and behind it the files of all missions.
    files: Vec<SourceFile>,
    /// What is wrong with the system itself.
    diagnostics: Vec<Diagnostic>,
}

/// The mission of a processor.
pub struct LoadedMission {
    /// Its file.
    pub path: PathBuf,
    /// Its blob; none where it has errors.
    pub blob: Option<Verified<Vec<u8>>>,
    checked: Checked,
    /// An earlier processor has it, too: what is wrong with it is told there.
    is_told: bool,
    first_file: usize,
}

impl Loaded {
    /// Reads a system file and compiles its missions.
    ///
    /// # Errors
    /// If the file cannot be read. All else is a diagnostic.
    pub fn load(path: &Path) -> Result<Self, CommandError> {
        let text = file::read_text(path, "system file")?;
        let (system, mut diagnostics) = read(&text);
        let mut files = vec![SourceFile {
            path: path.display().to_string(),
            text,
        }];
        let mut missions = Vec::new();
        let mut world = None;
        if let Some(system) = &system {
            let mut first_files = BTreeMap::new();
            for processor in &system.processors {
                let loaded = mission_of(path, processor, &mut files, &mut first_files);
                missions.push(match loaded? {
                    Ok(loaded) => Some(loaded),
                    Err(wrong) => {
                        diagnostics.push(wrong);
                        None
                    }
                });
            }
            let declared: Vec<Mission<'_>> =
                missions.iter().map(|it| declared(it.as_ref())).collect();
            diagnostics.extend(ends::check(system, &declared));
            if let Some(named) = &system.world {
                match stage::world(Some(&beside(path, &named.text)), Some(path)) {
                    Ok(found) => world = Some(found),
                    Err(CommandError::Input(error)) => {
                        let message = format!("{error:#}");
                        diagnostics.push(Diagnostic::new(Code::E013, named.span, message));
                    }
                    Err(other) => return Err(other),
                }
            }
        }
        diagnostics.sort_by_key(|found| (found.span, found.code));
        Ok(Loaded {
            system,
            missions,
            then: Vec::new(),
            world,
            files,
            diagnostics,
        })
    }

    /// Compiles the missions that take over, and holds both ends of each link against each other
    /// once all have. Meanwhile the ends may differ.
    ///
    /// # Errors
    /// If a processor is unknown or a mission cannot be read. All else is a diagnostic.
    pub fn exchange(&mut self, then: &[ThenOn]) -> Result<(), CommandError> {
        let Some(system) = self.system.as_ref().filter(|_| !then.is_empty()) else {
            return Ok(());
        };
        let mut first_files = BTreeMap::new();
        let of_missions = self.missions.iter().flatten();
        first_files.extend(of_missions.map(|it| (it.path.clone(), it.first_file)));
        for ThenOn {
            at,
            processor,
            file,
        } in then
        {
            let mut names = system.processors.iter().map(|it| it.name.text.as_str());
            let Some(index) = names.position(|name| name == processor) else {
                let names: Vec<&str> =
                    (system.processors.iter().map(|it| it.name.text.as_str())).collect();
                return Err(CommandError::Usage(anyhow!(
                    "the system has no processor `{processor}`: it has {}",
                    names.join(", ")
                )));
            };
            let board = (system.processors.get(index)).and_then(|it| it.board.as_ref());
            let board = board.map(|it| it.text.as_str());
            let loaded = load_mission(file, board, &mut self.files, &mut first_files)?;
            let loaded = loaded.map_err(|why| CommandError::Input(anyhow!("{why}")))?;
            self.then.push((at.us, index, loaded));
        }
        // Who takes over last, in the order of time.
        self.then.sort_by_key(|(at_us, ..)| *at_us);
        let last = |index: usize| self.then.iter().rfind(|(_, of, _)| *of == index);
        let declared: Vec<Mission<'_>> = (self.missions.iter().enumerate())
            .map(|(index, first)| {
                declared(last(index).map_or(first.as_ref(), |(.., loaded)| Some(loaded)))
            })
            .collect();
        for found in ends::check(system, &declared) {
            if !self.diagnostics.contains(&found) {
                self.diagnostics.push(found);
            }
        }
        self.diagnostics
            .sort_by_key(|found| (found.span, found.code));
        Ok(())
    }

    /// What the mission of each processor declares, as far as nothing is wrong with it.
    pub fn models(&self) -> Vec<Option<&Model>> {
        let missions = self.missions.iter();
        missions
            .map(|it| it.as_ref().and_then(|it| it.checked.model.as_ref()))
            .collect()
    }

    /// All missions.
    pub fn all_missions(&self) -> impl Iterator<Item = &LoadedMission> {
        let then = self.then.iter().map(|(.., loaded)| loaded);
        self.missions.iter().flatten().chain(then)
    }

    /// Tells all that is wrong, with the missions as well.
    ///
    /// # Errors
    /// If standard output cannot be written to.
    pub fn tell(&self, audience: Audience, console: &mut Console) -> Result<(), CommandError> {
        match audience {
            Audience::Program => {
                let text = lang::json_messages(&self.files, &self.diagnostics);
                console.json_out().write_all(text.as_bytes())?;
            }
            Audience::Person => mission::tell_found(&self.files, &self.diagnostics, console),
        }
        for loaded in self.all_missions().filter(|it| !it.is_told) {
            mission::tell(&loaded.checked, audience, console)?;
        }
        Ok(())
    }

    /// How many errors there are, and how many warnings. What libraries have and a mission does not
    /// use is not among them.
    pub fn counts(&self) -> (u64, u64) {
        let of_missions = self.all_missions().filter(|it| !it.is_told);
        let of_missions = of_missions.flat_map(|it| &it.checked.diagnostics);
        let is_told = |found: &&Diagnostic| found.code != Code::W107 || found.span.file == 0;
        let all = self.diagnostics.iter().chain(of_missions.filter(is_told));
        all.fold((0, 0), |(errors, warnings), it| match it.severity() {
            Severity::Error => (errors + 1, warnings),
            Severity::Warning => (errors, warnings + 1),
        })
    }
}

/// A path of a system file: from its folder on, where there is such a file.
fn beside(system: &Path, named: &str) -> PathBuf {
    let there = system.parent().map(|folder| folder.join(named));
    match there {
        Some(there) if there.exists() => there,
        _ => PathBuf::from(named),
    }
}

/// What a mission declares, as far as nothing is wrong with it.
fn declared(loaded: Option<&LoadedMission>) -> Mission<'_> {
    Mission {
        model: loaded.and_then(|it| it.checked.model.as_ref()),
        first_file: loaded.map_or(0, |it| it.first_file as u32),
    }
}

/// The mission of a processor, or why there is none.
fn mission_of(
    system: &Path,
    processor: &Processor,
    files: &mut Vec<SourceFile>,
    first_files: &mut BTreeMap<PathBuf, usize>,
) -> Result<Result<LoadedMission, Diagnostic>, CommandError> {
    let path = system.parent().unwrap_or(Path::new(""));
    let path = path.join(&processor.mission.text);
    let board = processor.board.as_ref().map(|it| it.text.as_str());
    let loaded = load_mission(&path, board, files, first_files)?;
    let unread = |why| Diagnostic::new(Code::E013, processor.mission.span, why);
    Ok(loaded.map_err(unread))
}

/// A mission for a board, or why it cannot be read.
fn load_mission(
    path: &Path,
    board: Option<&str>,
    files: &mut Vec<SourceFile>,
    first_files: &mut BTreeMap<PathBuf, usize>,
) -> Result<Result<LoadedMission, String>, CommandError> {
    if let Err(CommandError::Input(error)) = mission::refuse_blob(path) {
        return Ok(Err(format!("{error:#}")));
    }
    let mut checked = match lang::load(path) {
        Ok(checked) => checked,
        Err(error) => return Ok(Err(format!("{error}{}", file::meant(path)))),
    };
    let board = boards::find(board.unwrap_or(host_board::BOARD));
    checked.require_machine();
    let blob = mission::lay_out_and_compile(&mut checked, board.ok(), NameTable::Kept)?;
    let is_told = first_files.contains_key(path);
    let first_file = *first_files.entry(path.to_owned()).or_insert_with(|| {
        files.extend(checked.files.iter().cloned());
        files.len() - checked.files.len()
    });
    Ok(Ok(LoadedMission {
        path: path.to_owned(),
        blob,
        checked,
        is_told,
        first_file,
    }))
}
