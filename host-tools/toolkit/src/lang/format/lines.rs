//! Lines as they are written, and the column that the comments behind neighbouring lines share.

/// The most columns of a line, its trailing comment not counted. A word that is longer stands alone
/// in its line.
pub const MAX_COLUMNS: usize = 100;

/// Columns by which what is inside stands further right.
pub(super) const INDENT: usize = 4;

/// Where comments stand behind statements of the file, if these are short enough.
const FILE_COLUMN: usize = 40;

/// Where comments stand behind statements in a body, if these are short enough.
const BODY_COLUMN: usize = 52;

/// The last column that comments share. Behind a longer line a comment follows at once.
const LAST_COLUMN: usize = 80;

/// Shared columns are multiples of this.
const COLUMN_STEP: usize = 4;

/// The least blanks before a comment in a column.
const LEAST_GAP: usize = 2;

/// How comments behind a line are placed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Behind {
    /// In a column with those of the neighbouring lines, this one or one further right.
    Column(usize),
    /// After one blank.
    OneBlank,
}

impl Behind {
    /// The column of statements at a depth.
    pub(super) fn in_column(depth: usize) -> Self {
        Behind::Column(if depth == 0 { FILE_COLUMN } else { BODY_COLUMN })
    }
}

/// A comment behind a line of the group.
struct CommentBehind {
    /// Where the line ends, in the text of the group.
    at: usize,
    /// Columns of the line.
    columns: usize,
    /// The comment, or several, with one blank between them.
    text: String,
}

/// Lines of output. The last lines are kept back until it is known in which column their comments
/// stand.
pub(super) struct Lines {
    text: String,
    group: String,
    comments: Vec<CommentBehind>,
    behind: Behind,
    /// Columns of the last line so far.
    columns: usize,
    /// Whether the last line is an empty one that belongs to no group.
    is_separated: bool,
}

impl Lines {
    pub(super) fn with_capacity(bytes: usize) -> Self {
        Lines {
            text: String::with_capacity(bytes + bytes / 8),
            group: String::new(),
            comments: Vec::new(),
            behind: Behind::OneBlank,
            columns: 0,
            is_separated: true,
        }
    }

    /// Columns of the line that is being written.
    pub(super) fn columns(&self) -> usize {
        self.columns
    }

    /// Starts a line. One that has a column goes with the lines of the same column directly before
    /// it.
    pub(super) fn start_line(&mut self, indent: usize, behind: Behind) {
        if self.is_separated || self.behind != behind || behind == Behind::OneBlank {
            self.end_group();
        }
        self.behind = behind;
        self.is_separated = false;
        self.new_line(indent);
    }

    /// Goes on in a new line of the same statement.
    pub(super) fn new_line(&mut self, indent: usize) {
        if !self.group.is_empty() {
            self.group.push('\n');
        }
        self.group.extend(std::iter::repeat_n(' ', indent));
        self.columns = indent;
    }

    /// Adds to the line; the text has no line breaks.
    pub(super) fn push(&mut self, text: &str) {
        self.group.push_str(text);
        self.columns += text.chars().count();
    }

    /// Adds a comment to the line. What stands inside of one that has several lines stays where it
    /// is.
    pub(super) fn comment(&mut self, text: &str) {
        for (index, line) in comment_lines(text).enumerate() {
            if index > 0 {
                self.group.push('\n');
                self.columns = 0;
            }
            self.push(line);
        }
    }

    /// Adds a comment behind the line.
    pub(super) fn comment_behind(&mut self, text: &str) {
        let at = self.group.len();
        if self.comments.last().is_none_or(|last| last.at != at) {
            self.comments.push(CommentBehind {
                at,
                columns: self.columns,
                text: String::new(),
            });
        }
        if let Some(comment) = self.comments.last_mut() {
            if !comment.text.is_empty() {
                comment.text.push(' ');
            }
            for (index, line) in comment_lines(text).enumerate() {
                if index > 0 {
                    comment.text.push('\n');
                }
                comment.text.push_str(line);
            }
        }
    }

    /// Adds to the line at once what closes the body that it has opened, unless a comment stands
    /// there already.
    pub(super) fn close_at_once(&mut self, text: &str) -> bool {
        let is_free = self
            .comments
            .last()
            .is_none_or(|comment| comment.at != self.group.len());
        if is_free {
            self.push(text);
        }
        is_free
    }

    /// An empty line. It separates: comments before and behind it share no column.
    pub(super) fn empty_line(&mut self) {
        self.end_group();
        self.text.push('\n');
        self.is_separated = true;
    }

    /// The whole text; each line has its end.
    pub(super) fn into_text(mut self) -> String {
        self.end_group();
        self.text
    }

    fn end_group(&mut self) {
        if self.group.is_empty() {
            return;
        }
        let column = match self.behind {
            Behind::OneBlank => 0,
            Behind::Column(least) => self
                .comments
                .iter()
                .map(|comment| (comment.columns + LEAST_GAP).next_multiple_of(COLUMN_STEP))
                .filter(|&column| column <= LAST_COLUMN)
                .fold(least, usize::max),
        };
        let mut from = 0;
        for comment in self.comments.drain(..) {
            self.text
                .push_str(self.group.get(from..comment.at).unwrap_or(""));
            let gap = match self.behind {
                Behind::OneBlank => 1,
                Behind::Column(_) => column.saturating_sub(comment.columns).max(LEAST_GAP),
            };
            self.text.extend(std::iter::repeat_n(' ', gap));
            self.text.push_str(&comment.text);
            from = comment.at;
        }
        self.text.push_str(self.group.get(from..).unwrap_or(""));
        self.text.push('\n');
        self.group.clear();
    }
}

/// The lines of a comment without the blanks at their ends.
pub(super) fn comment_lines(text: &str) -> impl Iterator<Item = &str> {
    text.split('\n')
        .map(|line| line.trim_end_matches([' ', '\t', '\r', '\x0B', '\x0C']))
}
