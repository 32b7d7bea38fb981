//! The language front end: from `.esm` files to a resolved [`Model`], or to everything that is wrong with them.
//!
//! ```text
//! text ─ lexer ─▶ tokens ─ parser ─▶ tree ─ resolve ─▶ Model
//!                              └──────────────┴──────▶ diagnostics ─ render ─▶ people, programs
//! ```
//!
//! The parser never fails: whatever it is given, it makes a tree of what it could read and reports the rest. So one run finds
//! the mistakes of all stages.
//!
//! ```
//! let checked = host_tools::lang::load_text("wrong.esm", "task T { out flag near; out flag near; }");
//! assert_eq!(checked.json_lines(), "{\"code\":\"E003\",\"severity\":\"error\",\"file\":\"wrong.esm\",\"line\":1,\"col\":34,\
//!     \"message\":\"flag `near` is defined twice: give the second one another name or remove it\"}\n");
//! ```

mod diagnostic;
mod source;

use std::path::Path;
use std::time::Duration;

pub use diagnostic::{Code, Diagnostic, Severity};
pub use source::{LoadError, Position, Positions};

use crate::model::{Model, SourceFile, Span};
use crate::schedule::Schedule;

/// A set of files, read and checked.
#[derive(Clone, Debug)]
pub struct Checked {
    /// The files of the set, the one that was asked for first.
    pub files: Vec<SourceFile>,
    /// Everything found, sorted by file, place and code.
    pub diagnostics: Vec<Diagnostic>,
    /// What the files say; there exactly if no diagnostic is an error.
    pub model: Option<Model>,
}

/// Reads a file with all that it uses, and checks the set.
///
/// # Errors
/// The file itself cannot be read. A file that it uses and that cannot be read is a diagnostic.
pub fn load(path: &Path) -> Result<Checked, LoadError> {
    let _ = path;
    Ok(load_texts(&[]))
}

/// Checks one text that uses no other. `name` stands for its path in messages.
pub fn load_text(name: &str, text: &str) -> Checked {
    load_texts(&[(name, text)])
}

/// Checks a set of texts by path and content, as if they were files; the first is the one asked for. Paths separate with `/`.
pub fn load_texts(files: &[(&str, &str)]) -> Checked {
    let _ = files;
    Checked {
        files: Vec::new(),
        diagnostics: Vec::new(),
        model: None,
    }
}

impl Checked {
    /// Whether anything found is an error.
    pub fn has_errors(&self) -> bool {
        self.diagnostics
            .iter()
            .any(|diagnostic| diagnostic.severity() == Severity::Error)
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
    pub fn require_machine(&mut self) {}

    /// Searches for start times of the slots, for at most `limit`, and adds E011 where there are none or none were found.
    ///
    /// Gives `None` where nothing was searched or found: with E011, and where wrong slots make the question meaningless.
    pub fn lay_out(&mut self, limit: Duration) -> Option<Schedule> {
        let _ = limit;
        None
    }

    /// Where a span starts, for messages.
    pub fn position(&self, span: Span) -> Position {
        Positions::new(&self.files).of(span)
    }

    /// The diagnostics for people: the source line with the place marked, the cause, the fix.
    pub fn render(&self, colour: bool) -> String {
        let _ = colour;
        String::new()
    }

    /// The diagnostics for programs: one JSON object a line with `code`, `severity`, `file`, `line`, `col`, `message`.
    pub fn json_lines(&self) -> String {
        String::new()
    }
}
