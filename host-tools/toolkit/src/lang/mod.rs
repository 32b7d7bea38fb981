//! The language front end: from `.esm` files to a resolved [`Model`], or to everything that is
//! wrong with them.
//!
//! ```text
//! text ─ lexer ─▶ tokens ─ parser ─▶ tree ─ resolve ─▶ Model
//!                              └──────────────┴──────▶ diagnostics ─ render ─▶ people, programs
//! ```
//!
//! The parser never fails: whatever it is given, it makes a tree of what it could read and reports
//! the rest. So one run finds the mistakes of all stages.
//!
//! ```
//! let checked = esm_toolkit::lang::load_text("wrong.esm", "task T { out flag near; out flag near; }");
//! assert_eq!(checked.json_lines(), "{\"code\":\"E003\",\"severity\":\"error\",\"file\":\"wrong.esm\",\"line\":1,\"col\":34,\
//!     \"message\":\"flag `near` is defined twice: give the second one another name or remove it\"}\n");
//! ```

pub mod analysis;
pub(crate) mod cure;
mod diagnostic;
mod forest;
pub mod format;
pub(crate) mod lexer;
mod lints;
mod loader;
mod parser;
mod references;
mod render;
mod resolve;
mod set_values;
mod source;
pub(crate) mod tree;

pub use diagnostic::{Code, Diagnostic, Edit, Fix, Severity};
pub use lexer::RESERVED_WORDS;
pub use loader::{Overlay, Store};
pub use references::References;
pub use set_values::Rewritten;
pub use source::{LoadError, MAX_FILE_BYTES, Position, Positions};

use crate::model::{Link, Model, SourceFile, Span};
use crate::schedule::{self, LaidOut, Limit, Outcome, SlotSpec};

use diagnostic::Sink;
use loader::Memory;

/// A set of files, read and checked.
#[derive(Clone, Debug)]
pub struct Checked {
    /// The files of the set, the one that was asked for first.
    pub files: Vec<SourceFile>,
    /// Everything found, sorted by file, place and code.
    pub diagnostics: Vec<Diagnostic>,
    /// What the files say; there exactly if no diagnostic is an error.
    pub model: Option<Model>,
    /// The slots whose period and duration are known, in source order: there also where other
    /// things are wrong.
    slots: Vec<SlotSpec>,
    /// Where slots that have no schedule are reported.
    first_slot: Span,
    /// Whether these are all slots, and each is one that can occur.
    slots_are_sound: bool,
    /// The frames that are sent over each link.
    links: Vec<LinkFrames>,
    has_machine: bool,
    references: References,
    /// One for each file.
    trees: Vec<tree::File>,
}

/// The frames that are sent over a link, as the search for their start times takes them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct LinkFrames {
    /// Name of the link.
    pub link: String,
    /// Names of the frames, in source order.
    pub names: Vec<String>,
    /// Their times, in the same order; their numbers are their identifiers.
    pub frames: Vec<SlotSpec>,
    /// The declaration of the first.
    first: Span,
}

impl LinkFrames {
    fn of_model(model: &Model) -> Vec<Self> {
        let of_link = |(index, link): (usize, &Link)| {
            let names = model.frames_out(index).map(|frame| frame.name.clone());
            LinkFrames {
                link: link.name.clone(),
                names: names.collect(),
                frames: SlotSpec::of_link(model, index),
                first: (model.frames_out(index).next())
                    .map_or(link.declaration, |frame| frame.declaration),
            }
        };
        model.links.iter().enumerate().map(of_link).collect()
    }
}

/// Reads a file of `store` with all that it uses, and checks the set.
///
/// # Errors
/// The file itself cannot be read. A file that it uses and that cannot be read is a diagnostic.
pub fn load_from(path: &str, store: &dyn Store) -> Result<Checked, LoadError> {
    check(path, store)
}

/// Checks one text that uses no other. `name` stands for its path in messages.
pub fn load_text(name: &str, text: &str) -> Checked {
    load_texts(&[(name, text)])
}

/// Checks a set of texts by path and content, as if they were files; the first is the one asked
/// for. Paths separate with `/`.
pub fn load_texts(files: &[(&str, &str)]) -> Checked {
    let files: Vec<(&str, &[u8])> = files
        .iter()
        .map(|&(path, text)| (path, text.as_bytes()))
        .collect();
    load_files(&files)
}

/// [`load_texts`] for files that may be no text: what is not UTF-8 is reported, as it is for a file
/// on disk.
pub fn load_files(files: &[(&str, &[u8])]) -> Checked {
    let path = files.first().map_or("", |file| file.0);
    // Only an empty list has no first file; it is checked as an empty text.
    check(path, &Memory::new(files)).unwrap_or_else(|_| load_files(&[("", b"")]))
}

/// Diagnostics of some files for people: the source line with the place marked, the cause, the fix.
pub fn messages(files: &[SourceFile], diagnostics: &[Diagnostic], colour: bool) -> String {
    render::for_people(files, diagnostics, colour)
}

/// The same for programs, as [`Checked::json_lines`].
pub fn json_messages(files: &[SourceFile], diagnostics: &[Diagnostic]) -> String {
    render::json_lines(files, diagnostics)
}

/// Whether a text can be the name of something: an identifier that is not reserved.
pub fn is_name(text: &str) -> bool {
    let mut lexer = lexer::Lexer::new(text);
    let token = lexer.next_token();
    token.kind == lexer::TokenKind::Identifier
        && token.end as usize == text.len()
        && token.start == 0
}

fn check(path: &str, store: &dyn Store) -> Result<Checked, LoadError> {
    let mut sink = Sink::default();
    let set = loader::load(path, store, &mut sink)?;
    let trees = resolve::Trees {
        files: &set.files,
        trees: &set.trees,
        lacks_files: set.lacks_files,
    };
    let resolved = resolve::resolve(&trees, &mut sink);
    let model = resolved.model;
    analysis::check(&model, &resolved.holes, &resolved.activity, &mut sink);
    lints::check(
        &trees,
        &model,
        &resolved.holes,
        &resolved.activity,
        &mut sink,
    );
    let has_errors = sink.has_errors();
    let diagnostics = sink.into_sorted();
    Ok(Checked {
        slots: SlotSpec::of_model(&model)
            .into_iter()
            .zip(&resolved.known_slots)
            .filter_map(|(slot, &is_known)| is_known.then_some(slot))
            .collect(),
        first_slot: model
            .slots
            .first()
            .map(|slot| slot.span)
            .unwrap_or_default(),
        // A search after E010 would only say the same in other words.
        slots_are_sound: resolved.slots_are_whole
            && diagnostics
                .iter()
                .all(|diagnostic| diagnostic.code != Code::E010),
        links: LinkFrames::of_model(&model),
        has_machine: model.machine.is_some(),
        references: resolved.references,
        trees: set.trees,
        files: set.files,
        diagnostics,
        model: (!has_errors).then_some(model),
    })
}

/// Diagnostics for people, with what is unused in libraries only counted.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Folded<'c> {
    /// All other diagnostics.
    pub text: String,
    /// The first code among them, errors before warnings.
    pub first_code: Option<Code>,
    /// Files, by path, and the number of unused declarations in each.
    pub unused: Vec<(&'c str, usize)>,
}

impl Checked {
    /// Whether anything found is an error.
    pub fn has_errors(&self) -> bool {
        self.diagnostics
            .iter()
            .any(|diagnostic| diagnostic.severity() == Severity::Error)
    }

    /// The file that was asked for, with these values of parameters in all task states of `task`.
    /// None where something is wrong with it.
    pub fn with_values(&self, task: &str, values: &[(&str, String)]) -> Option<Rewritten> {
        if self.has_errors() {
            return None;
        }
        let (file, tree) = (self.files.first()?, self.trees.first()?);
        set_values::rewritten(&file.text, tree, task, values)
    }

    /// Adds a diagnostic of a later pass at its place in the order. An error takes the model away.
    pub fn add(&mut self, diagnostic: Diagnostic) {
        if diagnostic.severity() == Severity::Error {
            self.model = None;
        }
        let at = self.diagnostics.partition_point(|other| {
            (other.span, other.code) <= (diagnostic.span, diagnostic.code)
        });
        self.diagnostics.insert(at, diagnostic);
    }

    /// Demands that the set has a machine, as building and running do: without one it adds E013.
    pub fn require_machine(&mut self) {
        // What could not be read may be the machine.
        let is_whole = |found: &Diagnostic| !matches!(found.code, Code::E001 | Code::E013);
        if !self.has_machine && self.diagnostics.iter().all(is_whole) {
            self.add(
                Diagnostic::new(Code::E013, Span::default(), "there is no machine to run")
                    .hint("declare one: `machine M { region r { … } }`"),
            );
        }
    }

    /// The slots in source order, as the search for a schedule takes them. All of them only where
    /// no error is about slots: one whose period or duration is not known is left out.
    pub fn slots(&self) -> &[SlotSpec] {
        &self.slots
    }

    /// Searches for start times of the slots, for at most `limit`, and adds E011 where there are
    /// none or none were found.
    ///
    /// Gives `None` where slots are wrong already, so that the question has no meaning.
    pub fn solve_slots(&mut self, limit: impl Into<Limit>) -> Option<Outcome> {
        if !self.slots_are_sound {
            return None;
        }
        let limit = limit.into();
        let outcome = schedule::solve(&self.slots, limit);
        let diagnostic = match &outcome {
            Outcome::Feasible(_) => None,
            Outcome::Infeasible(reason) => Some(
                Diagnostic::new(
                    Code::E011,
                    self.first_slot,
                    format!("there is no schedule for these slots: {reason}"),
                )
                .hint(reason.cure(&self.slots).to_string()),
            ),
            Outcome::Undecided if self.slots.len() > schedule::MAX_SLOTS => Some(
                Diagnostic::new(
                    Code::E011,
                    self.first_slot,
                    format!(
                        "there are {} slots, and more than {} are not laid out",
                        self.slots.len(),
                        schedule::MAX_SLOTS
                    ),
                )
                .hint("let tasks share slots: one slot runs any number of them, one after another"),
            ),
            Outcome::Undecided => Some(
                Diagnostic::new(
                    Code::E011,
                    self.first_slot,
                    format!("no schedule was found {limit}, and no proof that there is none"),
                )
                .hint("shorten durations, or let periods be multiples of each other: `esm schedule --snap` proposes how; with `--limit` it searches longer"),
            ),
        };
        if let Some(diagnostic) = diagnostic {
            self.add(diagnostic);
        }
        Some(outcome)
    }

    /// The frames that are sent over each link, in source order. All of them only where no error is
    /// about frames.
    pub fn links(&self) -> &[LinkFrames] {
        &self.links
    }

    /// Searches for start times of the frames of each link, for at most `limit` each, and adds E011
    /// where there are none or none were found.
    ///
    /// Gives `None` where links or frames are wrong already.
    pub fn solve_links(&mut self, limit: impl Into<Limit>) -> Option<Vec<Outcome>> {
        if self.links.is_empty() {
            return Some(Vec::new());
        }
        let mut errors = self.diagnostics.iter().map(|diagnostic| diagnostic.code);
        if errors.any(|code| matches!(code, Code::E001 | Code::E010 | Code::E014)) {
            return None;
        }
        let limit = limit.into();
        let mut outcomes = Vec::with_capacity(self.links.len());
        let mut diagnostics = Vec::new();
        for link in &self.links {
            let outcome = schedule::solve(&link.frames, limit);
            let found = match &outcome {
                Outcome::Feasible(_) => None,
                Outcome::Infeasible(reason) => Some((
                    format!(
                        "there is no schedule for the frames of link `{}`: {}",
                        link.link,
                        reason.of_frames()
                    ),
                    "give them periods that are multiples of each other, smaller payloads, or a faster link",
                )),
                Outcome::Undecided => Some((
                    format!(
                        "no schedule was found {limit} for the frames of link `{}`, and no proof that there is none",
                        link.link
                    ),
                    "give them periods that are multiples of each other; with `--limit` it searches longer",
                )),
            };
            if let Some((message, hint)) = found {
                diagnostics.push(Diagnostic::new(Code::E011, link.first, message).hint(hint));
            }
            outcomes.push(outcome);
        }
        diagnostics.into_iter().for_each(|found| self.add(found));
        Some(outcomes)
    }

    /// [`Checked::solve_slots`] and [`Checked::solve_links`] for those who want a schedule of all
    /// or nothing.
    pub fn lay_out(&mut self, limit: impl Into<Limit>) -> Option<LaidOut> {
        let limit = limit.into();
        let slots = self.solve_slots(limit);
        let frames = self.lay_out_frames(limit);
        Some(LaidOut {
            starts_us: starts(slots?)?,
            frame_starts_us: frames?,
        })
    }

    /// [`Checked::solve_links`] for those who want start times or nothing: for each link those of
    /// the frames that are sent over it.
    pub fn lay_out_frames(&mut self, limit: impl Into<Limit>) -> Option<Vec<Vec<u32>>> {
        self.solve_links(limit)?.into_iter().map(starts).collect()
    }

    /// Which places of the files name the same thing.
    pub fn references(&self) -> &References {
        &self.references
    }

    /// The syntax tree of each file.
    pub(crate) fn trees(&self) -> &[tree::File] {
        &self.trees
    }

    /// Where a span starts, for messages. For many spans make [`Positions`] once.
    pub fn position(&self, span: Span) -> Position {
        Positions::new(&self.files).of(span)
    }

    /// The diagnostics for people: the source line with the place marked, the cause, the fix.
    pub fn render(&self, colour: bool) -> String {
        render::for_people(&self.files, &self.diagnostics, colour)
    }

    /// The same without what is unused (W107) in other files than the one that was asked for: a
    /// mission seldom uses all of a library. How many of these each file has stands beside it.
    pub fn render_folded(&self, colour: bool) -> Folded<'_> {
        let (folded, shown): (Vec<_>, Vec<_>) = self
            .diagnostics
            .iter()
            .cloned()
            .partition(|found| found.code == Code::W107 && found.span.file != 0);
        let mut unused: Vec<(&str, usize)> = Vec::new();
        // Sorted by file, as the diagnostics are.
        for found in &folded {
            let path = self
                .files
                .get(found.span.file as usize)
                .map_or("", |file| file.path.as_str());
            match unused.last_mut() {
                Some((last, count)) if *last == path => *count += 1,
                _ => unused.push((path, 1)),
            }
        }
        Folded {
            text: render::for_people(&self.files, &shown, colour),
            first_code: shown.iter().map(|found| found.code).min(),
            unused,
        }
    }

    /// The diagnostics for programs: one JSON object a line with `code`, `severity`, `file`,
    /// `line`, `col`, `message`.
    pub fn json_lines(&self) -> String {
        render::json_lines(&self.files, &self.diagnostics)
    }
}

/// The start times of an outcome, where it has some.
fn starts(outcome: Outcome) -> Option<Vec<u32>> {
    match outcome {
        Outcome::Feasible(schedule) => Some(schedule.starts_us),
        Outcome::Infeasible(_) | Outcome::Undecided => None,
    }
}

#[cfg(test)]
mod link_tests;
#[cfg(test)]
mod tests;
