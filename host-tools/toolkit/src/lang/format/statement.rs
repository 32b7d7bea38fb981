//! One statement, or the first line of a declaration: blanks between its tokens, and line breaks
//! where it is too long.

use crate::lang::lexer::{Comment, TokenKind as T};

use super::lines::{Lines, comment_lines};
use super::{INDENT, MAX_COLUMNS};

/// Whether a line may end before a piece.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Break {
    /// It goes with the piece before.
    Never,
    /// It does, where the line would be too long.
    Filling,
    /// It does, where the statement is too long for one line: before guard, actions, values, the
    /// arrow of a path.
    Part,
    /// It must: a `//` comment stands before, or this is one with a line of its own.
    Always,
}

/// A token or comment.
struct Piece<'t> {
    text: &'t str,
    is_comment: bool,
    after_blank: bool,
    breaks: Break,
    /// Columns of it and of what must follow in the same line, the blank before it not counted.
    columns: usize,
}

impl Piece<'_> {
    /// The columns that count: a `//` comment may reach as far as it likes.
    fn own_columns(&self) -> usize {
        if !self.is_comment {
            self.text.chars().count()
        } else if self.text.starts_with("//") {
            0
        } else {
            comment_lines(self.text)
                .map(|line| line.chars().count())
                .sum()
        }
    }
}

/// The pieces of a statement.
#[derive(Default)]
pub(super) struct Statement<'t> {
    pieces: Vec<Piece<'t>>,
    first_token: Option<T>,
    last_token: Option<T>,
    /// Whether a `//` comment was the last piece.
    ends_with_line_comment: bool,
}

impl<'t> Statement<'t> {
    pub(super) fn is_empty(&self) -> bool {
        self.pieces.is_empty()
    }

    /// The last token so far.
    pub(super) fn last_token(&self) -> Option<T> {
        self.last_token
    }

    /// Adds a token.
    pub(super) fn token(&mut self, kind: T, text: &'t str) {
        let first = *self.first_token.get_or_insert(kind);
        let is_path = first == T::Path;
        // Ports of paths, and dispatchers of links.
        let has_tight_dots = matches!(first, T::Path | T::Task);
        let is_tight = self.last_token.is_none_or(|last| {
            // A comment has blanks on both sides, whatever the tokens want.
            let follows_comment = self.pieces.last().is_some_and(|piece| piece.is_comment);
            stands_tight_before(kind)
                || !follows_comment && stands_tight_behind(last)
                || !follows_comment && kind == T::Dot && has_tight_dots
        });
        let breaks = match kind {
            _ if self.ends_with_line_comment => Break::Always,
            T::BracketOpen | T::Slash | T::With => Break::Part,
            T::Arrow if is_path => Break::Part,
            T::And | T::Or => Break::Filling,
            _ if self.last_token == Some(T::Comma) => Break::Filling,
            _ => Break::Never,
        };
        self.push(text, false, !is_tight, breaks);
        self.last_token = Some(kind);
    }

    /// Adds a comment between two tokens.
    pub(super) fn comment(&mut self, comment: Comment<'t>) {
        let has_own_line = comment.is_line && comment.breaks_before > 0;
        let breaks = if self.ends_with_line_comment || has_own_line {
            Break::Always
        } else {
            Break::Never
        };
        self.push(comment.text, true, true, breaks);
        self.ends_with_line_comment = comment.is_line;
    }

    fn push(&mut self, text: &'t str, is_comment: bool, after_blank: bool, breaks: Break) {
        self.pieces.push(Piece {
            text,
            is_comment,
            after_blank,
            breaks,
            columns: 0,
        });
        self.ends_with_line_comment = false;
    }

    /// Writes the statement to a line that has been started, and forgets it.
    pub(super) fn write(&mut self, indent: usize, lines: &mut Lines) {
        let has_parts = self.measure() + indent > MAX_COLUMNS;
        // What fills lines stands further right than the parts that it fills.
        let part_indent = indent + INDENT;
        let is_of_parts = has_parts && self.pieces.iter().any(|piece| piece.breaks == Break::Part);
        let filling_indent = if is_of_parts {
            part_indent + INDENT
        } else {
            part_indent
        };
        for piece in &self.pieces {
            let blank = usize::from(piece.after_blank);
            let is_too_long = lines.columns() + blank + piece.columns > MAX_COLUMNS;
            let next_indent = match piece.breaks {
                Break::Always => Some(part_indent),
                Break::Part if has_parts || is_too_long => Some(part_indent),
                Break::Filling if is_too_long => Some(filling_indent),
                _ => None,
            };
            match next_indent {
                Some(indent) => lines.new_line(indent),
                None if piece.after_blank => lines.push(" "),
                None => {}
            }
            if piece.is_comment {
                lines.comment(piece.text);
            } else {
                lines.push(piece.text);
            }
        }
        *self = Statement {
            // The room for the pieces is used again.
            pieces: std::mem::take(&mut self.pieces),
            ..Statement::default()
        };
        self.pieces.clear();
    }

    /// Works out how many columns each piece needs up to the next place where a line may end. Gives
    /// the columns of the whole.
    fn measure(&mut self) -> usize {
        let mut whole = 0;
        let mut to_next_break = 0;
        for piece in self.pieces.iter_mut().rev() {
            let columns = piece.own_columns();
            piece.columns = columns + to_next_break;
            whole += columns + usize::from(piece.after_blank);
            to_next_break = match piece.breaks {
                Break::Never => piece.columns + usize::from(piece.after_blank),
                Break::Filling | Break::Part | Break::Always => 0,
            };
        }
        whole
    }
}

/// Whether no blank stands before a token.
fn stands_tight_before(kind: T) -> bool {
    matches!(
        kind,
        T::Semicolon | T::Comma | T::Colon | T::ParenthesisClose | T::BracketClose
    )
}

/// Whether no blank stands behind a token.
fn stands_tight_behind(kind: T) -> bool {
    matches!(
        kind,
        T::ParenthesisOpen | T::BracketOpen | T::Dot | T::Caret | T::Minus
    )
}
