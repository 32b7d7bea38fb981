//! One layout for every file.
//!
//! The layouter works on tokens: it takes them from the lexer, the comments from the gaps between
//! them, and writes both again with other blanks. So it cannot change what a file says; and because
//! the text has been parsed without a mistake before, a token alone tells where a statement ends,
//! what a `{` opens, and where a line may be broken. Nothing in it looks at how the text was laid
//! out before, but for three things that a person decides: which comment stands behind a statement
//! and which before one, where an empty line separates, and where a `//` comment ends a line in the
//! middle of a statement. All three are written so that they read the same again.
//!
//! It takes time in proportion to the text, and memory for one statement and one run of
//! neighbouring lines beside it.

mod lines;
mod statement;

use crate::model::SourceFile;

use super::diagnostic::{Code, Diagnostic, Sink};
use super::lexer::{Comments, Lexer, TokenKind as T};
use super::loader::Set;
use super::render;
pub use lines::MAX_COLUMNS;
use lines::{INDENT, Lines};
use statement::Statement;

/// Why a text was not laid out: it has syntax errors.
#[derive(Clone, Debug)]
pub struct Refusal {
    file: SourceFile,
    /// The syntax errors, by place.
    pub diagnostics: Vec<Diagnostic>,
}

impl Refusal {
    /// The syntax errors for people: the source line with the place marked, the cause, the fix.
    pub fn render(&self, colour: bool) -> String {
        render::for_people(std::slice::from_ref(&self.file), &self.diagnostics, colour)
    }
}

/// Lays out a file. `name` stands for its path in messages. A byte order mark is taken off, and
/// lines end with a line feed.
///
/// # Errors
/// The text has syntax errors, or is not UTF-8.
///
/// ```
/// let text = esm_toolkit::lang::format::format("m.esm", b"slot 1 /* decides */\n  period 20ms duration 2ms  ;// fast\n").unwrap();
/// assert_eq!(text, "slot 1 /* decides */ period 20 ms duration 2 ms;    // fast\n");
/// ```
pub fn format(name: &str, bytes: &[u8]) -> Result<String, Box<Refusal>> {
    let mut sink = Sink::default();
    let mut set = Set::default();
    set.add(name.to_owned(), bytes, &mut sink);
    let Some(file) = set.files.pop() else {
        return Ok(String::new());
    };
    let mut diagnostics = sink.into_sorted();
    // What is defined twice, an attribute for instance, can be laid out all the same.
    diagnostics.retain(|diagnostic| diagnostic.code == Code::E001);
    if diagnostics.is_empty() {
        Ok(layout(&file.text))
    } else {
        Err(Box::new(Refusal { file, diagnostics }))
    }
}

/// What stands before the item that comes next in a body.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Before {
    /// Nothing: the body starts.
    Start,
    /// A statement or comment.
    Line,
    /// A declaration with a body.
    Block,
}

/// A comment on lines of its own, and whether an empty line stands before it.
struct OwnLine<'t> {
    text: &'t str,
    after_empty_line: bool,
}

struct Layouter<'t> {
    lines: Lines,
    depth: usize,
    before: Before,
    /// Comments before the next item: they are written with it, when it is known what it is.
    comments: Vec<OwnLine<'t>>,
    /// Whether an empty line stands directly before the next item.
    item_after_empty_line: bool,
    statement: Statement<'t>,
}

/// Lays out a text without syntax errors.
fn layout(text: &str) -> String {
    let mut layouter = Layouter {
        lines: Lines::with_capacity(text.len()),
        depth: 0,
        before: Before::Start,
        comments: Vec::new(),
        item_after_empty_line: false,
        statement: Statement::default(),
    };
    let mut lexer = Lexer::new(text);
    let mut gap_start = 0;
    loop {
        let token = lexer.next_token();
        let is_end = token.kind == T::EndOfFile;
        let gap_end = if is_end {
            text.len()
        } else {
            token.start as usize
        };
        let gap = text.get(gap_start..gap_end).unwrap_or("");
        if layouter.statement.is_empty() {
            layouter.between_items(gap, gap_start == 0);
        } else {
            for comment in Comments::new(gap) {
                layouter.statement.comment(comment);
            }
        }
        if is_end {
            layouter.end_of_body();
            return layouter.lines.into_text();
        }
        gap_start = token.end as usize;
        let word = text.get(token.start as usize..gap_start).unwrap_or("");
        layouter.token(token.kind, word);
    }
}

impl<'t> Layouter<'t> {
    /// Takes in a gap outside of statements.
    fn between_items(&mut self, gap: &'t str, is_start_of_file: bool) {
        let mut comments = Comments::new(gap);
        let mut is_behind = !is_start_of_file;
        for comment in comments.by_ref() {
            is_behind &= comment.breaks_before == 0;
            if is_behind {
                self.lines.comment_behind(comment.text);
            } else {
                self.comments.push(OwnLine {
                    text: comment.text,
                    after_empty_line: comment.breaks_before > 1,
                });
            }
        }
        self.item_after_empty_line = comments.breaks() > 1;
    }

    fn token(&mut self, kind: T, word: &'t str) {
        if kind == T::BraceClose && self.statement.is_empty() {
            return self.close();
        }
        let opens_values = self.statement.last_token() == Some(T::With);
        self.statement.token(kind, word);
        match kind {
            T::BraceOpen if !opens_values => self.open(),
            T::Semicolon => self.end_of_statement(),
            _ => {}
        }
    }

    fn end_of_statement(&mut self) {
        self.lead(self.before == Before::Block);
        let indent = self.depth * INDENT;
        self.lines
            .start_line(indent, lines::Behind::in_column(self.depth));
        self.statement.write(indent, &mut self.lines);
        self.before = Before::Line;
    }

    /// The first line of a declaration with a body.
    fn open(&mut self) {
        self.lead(self.before != Before::Start);
        let indent = self.depth * INDENT;
        self.lines.start_line(indent, lines::Behind::OneBlank);
        self.statement.write(indent, &mut self.lines);
        self.depth += 1;
        self.before = Before::Start;
    }

    fn close(&mut self) {
        let is_empty = self.before == Before::Start && self.comments.is_empty();
        self.end_of_body();
        self.depth = self.depth.saturating_sub(1);
        if !(is_empty && self.lines.close_at_once("}")) {
            self.lines
                .start_line(self.depth * INDENT, lines::Behind::OneBlank);
            self.lines.push("}");
        }
        self.before = Before::Block;
    }

    /// Comments behind the last item of a body.
    fn end_of_body(&mut self) {
        self.item_after_empty_line = false;
        self.lead(false);
    }

    /// Writes what stands before an item: comments, and empty lines where they are or must be.
    fn lead(&mut self, must_separate: bool) {
        let has_empty_line = self.item_after_empty_line
            || self.comments.iter().any(|comment| comment.after_empty_line);
        let mut separates = must_separate && !has_empty_line;
        for comment in std::mem::take(&mut self.comments) {
            self.empty_line(comment.after_empty_line || std::mem::take(&mut separates));
            self.lines
                .start_line(self.depth * INDENT, lines::Behind::OneBlank);
            self.lines.comment(comment.text);
            self.before = Before::Line;
        }
        self.empty_line(self.item_after_empty_line || separates);
    }

    /// An empty line, but none at the start of a body.
    fn empty_line(&mut self, is_wanted: bool) {
        if is_wanted && self.before != Before::Start {
            self.lines.empty_line();
        }
    }
}

#[cfg(test)]
mod tests;
