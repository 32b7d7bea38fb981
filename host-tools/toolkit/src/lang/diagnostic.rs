//! What is wrong with a set of files: codes, severities, and one [`Diagnostic`] a mistake.

use std::fmt;

use crate::model::Span;

/// The code of a diagnostic: what kind of mistake it is. The numbers never change their meaning.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Code {
    /// Syntax error, or a number out of its range.
    E001,
    /// Unknown name.
    E002,
    /// Defined twice.
    E003,
    /// Region without an initial transition.
    E004,
    /// `^` at the root, or a flag used against its direction.
    E005,
    /// A guard, trigger or flag that its state does not have.
    E006,
    /// Recursive use of a container.
    E007,
    /// A data path that cannot work, or a required input left open.
    E008,
    /// Task state without slot or parameter value; a parameter value that does not fit.
    E009,
    /// More time asked for than there is.
    E010,
    /// No schedule.
    E011,
    /// A capacity of the target is exceeded.
    E012,
    /// What makes a set of files a whole is wrong: machines, interpreter slot, `use`.
    E013,
    /// A link or a frame that cannot work.
    E014,
    /// State that nothing reaches.
    W101,
    /// Event that does nothing.
    W102,
    /// Two transitions that can be taken at once.
    W103,
    /// Events that cause each other in a circle.
    W104,
    /// Two task states of one `exclusive` group that can be active together.
    W105,
    /// Timeout not above the interpreter's period.
    W106,
    /// Declared and not used.
    W107,
    /// State without a way out.
    W108,
    /// `timeout` read of a state without a limit.
    W109,
    /// Two writers of one net that can be active together.
    W110,
    /// A state in which the last value of another stays on a net.
    W111,
    /// `within` below the period of every writer.
    W112,
}

impl Code {
    /// All codes, in order.
    pub const ALL: [Code; 26] = [
        Code::E001,
        Code::E002,
        Code::E003,
        Code::E004,
        Code::E005,
        Code::E006,
        Code::E007,
        Code::E008,
        Code::E009,
        Code::E010,
        Code::E011,
        Code::E012,
        Code::E013,
        Code::E014,
        Code::W101,
        Code::W102,
        Code::W103,
        Code::W104,
        Code::W105,
        Code::W106,
        Code::W107,
        Code::W108,
        Code::W109,
        Code::W110,
        Code::W111,
        Code::W112,
    ];

    /// The code as it is written, `"E001"`.
    pub fn as_str(self) -> &'static str {
        match self {
            Code::E001 => "E001",
            Code::E002 => "E002",
            Code::E003 => "E003",
            Code::E004 => "E004",
            Code::E005 => "E005",
            Code::E006 => "E006",
            Code::E007 => "E007",
            Code::E008 => "E008",
            Code::E009 => "E009",
            Code::E010 => "E010",
            Code::E011 => "E011",
            Code::E012 => "E012",
            Code::E013 => "E013",
            Code::E014 => "E014",
            Code::W101 => "W101",
            Code::W102 => "W102",
            Code::W103 => "W103",
            Code::W104 => "W104",
            Code::W105 => "W105",
            Code::W106 => "W106",
            Code::W107 => "W107",
            Code::W108 => "W108",
            Code::W109 => "W109",
            Code::W110 => "W110",
            Code::W111 => "W111",
            Code::W112 => "W112",
        }
    }

    /// Whether the code stands for an error or for a warning.
    pub fn severity(self) -> Severity {
        if self < Code::W101 {
            Severity::Error
        } else {
            Severity::Warning
        }
    }
}

impl fmt::Display for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.as_str())
    }
}

/// How bad a diagnostic is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Severity {
    /// The files cannot be built.
    Error,
    /// They can, but probably do not do what was meant.
    Warning,
}

impl Severity {
    /// `"error"` or `"warning"`.
    pub fn as_str(self) -> &'static str {
        match self {
            Severity::Error => "error",
            Severity::Warning => "warning",
        }
    }
}

/// One mistake: what, where, and how to put it right.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Diagnostic {
    /// What kind of mistake.
    pub code: Code,
    /// Where. Its start is the place that is reported.
    pub span: Span,
    /// What is wrong, as a sentence without a full stop.
    pub message: String,
    /// What to do about it, where that is known.
    pub hint: Option<String>,
    /// Other places that have to do with it, and what they have to do with it.
    pub related: Vec<(Span, String)>,
    /// Changes of the text, each of which makes it go away. The first is the likeliest one.
    pub fixes: Vec<Fix>,
}

/// A change of the text that mends a mistake.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fix {
    /// What it does, as a menu says it: "write `[timeout]`".
    pub title: String,
    /// What it changes, in order; no two places overlap.
    pub edits: Vec<Edit>,
}

/// A part of a text and what replaces it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Edit {
    /// What is replaced; an empty place where something is inserted.
    pub span: Span,
    /// What stands there afterwards.
    pub text: String,
}

impl Edit {
    /// Replaces what a span covers.
    pub fn replace(span: Span, text: impl Into<String>) -> Self {
        let text = text.into();
        Edit { span, text }
    }

    /// Removes what a span covers.
    pub fn remove(span: Span) -> Self {
        Edit::replace(span, "")
    }

    /// Inserts a text at the start of a span.
    pub fn before(span: Span, text: impl Into<String>) -> Self {
        let end = span.start;
        Edit::replace(Span { end, ..span }, text)
    }

    /// Inserts a text behind a span.
    pub fn behind(span: Span, text: impl Into<String>) -> Self {
        let start = span.end;
        Edit::replace(Span { start, ..span }, text)
    }
}

impl Fix {
    /// A fix with a title, which says what to do, and with what it changes.
    pub fn new(title: impl Into<String>, mut edits: Vec<Edit>) -> Self {
        edits.sort_by_key(|edit| edit.span);
        Fix {
            title: visible(title.into()),
            edits,
        }
    }

    /// The text of a file with its edits made. They must not reach into another file.
    pub fn apply(&self, text: &str) -> Option<String> {
        let mut text = text.to_owned();
        for edit in self.edits.iter().rev() {
            let place = edit.span.start as usize..edit.span.end as usize;
            text.get(place.clone())?;
            text.replace_range(place, &edit.text);
        }
        Some(text)
    }

    /// A fix that is one edit.
    pub fn one(title: impl Into<String>, edit: Edit) -> Self {
        Fix::new(title, vec![edit])
    }

    /// Writes a name for another one.
    pub fn write(span: Span, text: impl Into<String>) -> Self {
        let text = text.into();
        Fix::one(format!("write `{text}`"), Edit::replace(span, text))
    }
}

impl Diagnostic {
    /// A diagnostic with neither hint nor related places.
    pub fn new(code: Code, span: Span, message: impl Into<String>) -> Self {
        Diagnostic {
            code,
            span,
            message: visible(message.into()),
            hint: None,
            related: Vec::new(),
            fixes: Vec::new(),
        }
    }

    /// The same with a hint.
    #[must_use]
    pub fn hint(mut self, hint: impl Into<String>) -> Self {
        self.hint = Some(visible(hint.into()));
        self
    }

    /// The same with one more related place.
    #[must_use]
    pub fn related(mut self, span: Span, what: impl Into<String>) -> Self {
        self.related.push((span, visible(what.into())));
        self
    }

    /// The same with one more fix.
    #[must_use]
    pub fn fix(mut self, fix: Fix) -> Self {
        self.fixes.push(fix);
        self
    }

    /// Error or warning: what its code says.
    pub fn severity(&self) -> Severity {
        self.code.severity()
    }

    /// Message and hint in one line, for those who show no more than that.
    pub fn text(&self) -> String {
        match &self.hint {
            Some(hint) => format!("{}: {hint}", self.message),
            None => self.message.clone(),
        }
    }
}

/// The text with control characters spelt out: what a file says must not steer the terminal of
/// whoever reads a message about it.
fn visible(text: String) -> String {
    if !text.contains(char::is_control) {
        return text;
    }
    let mut visible = String::with_capacity(text.len());
    for character in text.chars() {
        if character.is_control() {
            visible.extend(character.escape_default());
        } else {
            visible.push(character);
        }
    }
    visible
}

/// The most diagnostics that one set of files gets. More than anybody reads, and few enough for
/// megabytes of garbage.
const MAX_DIAGNOSTICS: usize = 10_000;

/// Collects diagnostics, up to [`MAX_DIAGNOSTICS`]. No warning takes the place of an error.
#[derive(Debug, Default)]
pub(super) struct Sink {
    errors: Vec<Diagnostic>,
    warnings: Vec<Diagnostic>,
    omitted: usize,
}

impl Sink {
    /// Takes one more diagnostic.
    pub(super) fn push(&mut self, diagnostic: Diagnostic) {
        let list = match diagnostic.severity() {
            Severity::Error => &mut self.errors,
            Severity::Warning => &mut self.warnings,
        };
        if list.len() < MAX_DIAGNOSTICS {
            list.push(diagnostic);
        } else {
            self.omitted += 1;
        }
    }

    /// Counts an error whose message nobody will see, where no more is kept. Returns whether that
    /// is so: it then need not be put into words.
    pub(super) fn omits_error(&mut self) -> bool {
        let is_full = self.errors.len() >= MAX_DIAGNOSTICS;
        self.omitted += usize::from(is_full);
        is_full
    }

    /// Whether a warning of some code has come.
    pub(super) fn has(&self, code: Code) -> bool {
        self.warnings.iter().any(|found| found.code == code)
    }

    /// Whether an error has come.
    pub(super) fn has_errors(&self) -> bool {
        !self.errors.is_empty()
    }

    /// All diagnostics, sorted by file, place and code. If some were left out, the last one that
    /// came says how many.
    pub(super) fn into_sorted(self) -> Vec<Diagnostic> {
        let mut list = self.errors;
        let room = MAX_DIAGNOSTICS.saturating_sub(list.len());
        let omitted = self.omitted + self.warnings.len().saturating_sub(room);
        list.extend(self.warnings.into_iter().take(room));
        if omitted > 0
            && let Some(last) = list.last_mut()
        {
            last.hint = Some(format!(
                "{omitted} more messages are left out: correct these first"
            ));
        }
        list.sort_by_key(|diagnostic| (diagnostic.span, diagnostic.code));
        list
    }
}
