//! How mistakes are mended: in words, and as changes of the text.

use crate::model::Span;

use super::diagnostic::{Edit, Fix};
use super::lexer::{Lexer, TokenKind as T};

/// How a mistake is mended.
#[derive(Clone, Debug, Default)]
pub(super) struct Cure {
    /// In words.
    pub(super) hint: Option<String>,
    /// As changes that do it.
    pub(super) fixes: Vec<Fix>,
}

impl Cure {
    /// A cure in words alone.
    pub(super) fn say(hint: impl Into<String>) -> Self {
        Cure {
            hint: Some(hint.into()),
            fixes: Vec::new(),
        }
    }

    /// The same with a change that does it.
    #[must_use]
    pub(super) fn fix(mut self, fix: Fix) -> Self {
        self.fixes.push(fix);
        self
    }

    /// The same with a change that is one edit and has the words for its title.
    #[must_use]
    pub(super) fn edit(self, edit: Edit) -> Self {
        let title = self.hint.clone().unwrap_or_default();
        self.fix(Fix::one(title, edit))
    }

    /// "write `text`", in the place of a span.
    pub(super) fn write(span: Span, text: &str) -> Self {
        Cure::say(format!("write `{text}`")).fix(Fix::write(span, text))
    }

    /// "did you mean `text`?", in the place of a span.
    pub(super) fn meant(span: Span, text: &str) -> Self {
        Cure::say(format!("did you mean `{text}`?")).fix(Fix::write(span, text))
    }
}

impl From<String> for Cure {
    fn from(hint: String) -> Self {
        Cure::say(hint)
    }
}

/// The end of the declaration or statement that starts at a byte: behind its `;` or its closing
/// brace.
pub(crate) fn end_of_item(text: &str, start: u32) -> u32 {
    let mut lexer = Lexer::new_at(text, start);
    let mut depth = 0_usize;
    let mut end = start;
    let mut token = lexer.next_token();
    loop {
        let next = lexer.next_token();
        match token.kind {
            T::EndOfFile => return end,
            T::Semicolon if depth == 0 => return token.end,
            T::BraceOpen => depth += 1,
            T::BraceClose if depth == 0 => return end,
            T::BraceClose => {
                depth -= 1;
                // The values of a task state end with a brace too, and its statement goes on.
                if depth == 0 && next.kind != T::Semicolon {
                    return token.end;
                }
            }
            _ => {}
        }
        end = token.end;
        token = next;
    }
}

/// Removes a declaration or statement: with its lines, where nothing else stands on them.
pub(super) fn remove_item(text: &str, span: Span) -> Edit {
    let (before, behind) = around(text, span);
    let blanks = before.len() - before.trim_end_matches([' ', '\t']).len();
    let start = span.start - blanks as u32;
    let starts_line =
        before.trim_end_matches([' ', '\t']).ends_with('\n') || blanks == before.len();
    let rest = behind.trim_start_matches([' ', '\t', '\r']);
    let end = match rest.strip_prefix('\n') {
        Some(_) if starts_line => span.end + (behind.len() - rest.len() + 1) as u32,
        _ => span.end,
    };
    Edit::remove(Span { start, end, ..span })
}

/// How much of a line is looked at to see what stands on it: a line can be megabytes long.
const MAX_LOOK_BYTES: usize = 400;

/// Inserts a statement behind another one, on a line of its own where that one has its own.
pub(super) fn insert_behind(text: &str, span: Span, statement: &str) -> Edit {
    let (before, behind) = around(text, span);
    let from = before.len().saturating_sub(MAX_LOOK_BYTES);
    let near = before.bytes().skip(from).rposition(|byte| byte == b'\n');
    let starts_text = from == 0;
    let line = match near {
        Some(at) => before.get(from + at + 1..),
        None => starts_text.then_some(before),
    };
    let blanks = line.filter(|line| line.bytes().all(|byte| matches!(byte, b' ' | b'\t')));
    let seen = behind.bytes().take(MAX_LOOK_BYTES);
    let end = seen.clone().position(|byte| matches!(byte, b'\n' | b'\r'));
    let end = end.or((seen.len() < MAX_LOOK_BYTES).then_some(behind.len()));
    // A line that goes on and on is not looked at.
    let rest = end
        .and_then(|end| behind.get(..end))
        .unwrap_or("?")
        .trim_end();
    let ends_line = rest.is_empty() || rest.trim_start().starts_with("//");
    let (Some(blanks), true) = (blanks, ends_line) else {
        return Edit::behind(span, format!(" {statement}"));
    };
    // Behind the comment at the end of the line.
    let end = span.end + rest.len() as u32;
    let span = Span { end, ..span };
    Edit::behind(span, format!("\n{blanks}{statement}"))
}

/// Removes a name from a list of names, or the whole declaration where it is the only one.
pub(super) fn remove_from_list(text: &str, name: Span) -> Option<Edit> {
    let (before, behind) = around(text, name);
    let before = before.trim_end();
    if before.ends_with(',') {
        let start = before.len() as u32 - 1;
        return Some(Edit::remove(Span { start, ..name }));
    }
    let rest = behind.trim_start();
    if let Some(rest) = rest.strip_prefix(',') {
        let rest = rest.trim_start();
        let end = name.end + (behind.len() - rest.len()) as u32;
        return Some(Edit::remove(Span { end, ..name }));
    }
    let before = before.strip_suffix("event")?.trim_end();
    let start = ["in", "out"]
        .iter()
        .find_map(|word| before.strip_suffix(word))
        .map_or(before.len(), |before| before.trim_end().len());
    if !rest.starts_with(';') {
        return None;
    }
    let declaration = text.get(start..)?;
    let start = start + declaration.len() - declaration.trim_start().len();
    let end = name.end + (behind.len() - rest.len() + 1) as u32;
    let start = start as u32;
    let span = Span { start, end, ..name };
    // Comments may stand between.
    let is_plain = !text.get(start as usize..end as usize)?.contains('/');
    is_plain.then(|| remove_item(text, span))
}

/// Removes the action that ends with a name: with its comma, or with the slash where it is the only
/// one.
pub(super) fn remove_action(text: &str, name: Span, word: &str) -> Option<Edit> {
    let (before, behind) = around(text, name);
    let before = before.strip_suffix(['.', '^'])?.trim_end();
    let before = before.strip_suffix(word)?.trim_end();
    let rest = behind.trim_start();
    // What ends a comment separates nothing.
    let line = before.lines().next_back()?;
    if line.ends_with("*/") || line.contains("//") {
        return None;
    }
    let last = before.chars().next_back()?;
    let start = before.len() as u32 - 1;
    match last {
        ',' => Some(Edit::remove(Span { start, ..name })),
        '/' if rest.starts_with(',') => {
            let rest = rest.get(1..)?.trim_start();
            let end = name.end + (behind.len() - rest.len()) as u32;
            let start = start + 1;
            Some(Edit::replace(Span { start, end, ..name }, " "))
        }
        '/' => {
            let start = before.get(..start as usize)?.trim_end().len() as u32;
            Some(Edit::remove(Span { start, ..name }))
        }
        _ => None,
    }
}

/// How the guard of a transition is written.
struct WrittenGuard<'t> {
    /// What holds it: what is between the brackets, or `on *`, which is a guard too.
    span: Span,
    /// Its words; none where it is `on *`.
    words: Option<&'t str>,
    has_and: bool,
    has_or: bool,
}

impl<'t> WrittenGuard<'t> {
    /// The guard of the transition at a span, if it has one that is written on one line and without
    /// a comment.
    fn find(text: &'t str, transition: Span) -> Option<Self> {
        let mut lexer = Lexer::new_at(text, transition.start);
        let mut guard = WrittenGuard {
            span: transition,
            words: None,
            has_and: false,
            has_or: false,
        };
        let mut open = None;
        let mut on = None;
        loop {
            let token = lexer.next_token();
            if token.start >= transition.end {
                return None;
            }
            match token.kind {
                T::EndOfFile | T::Semicolon => return None,
                T::On => on = Some(token.start),
                T::Star if open.is_none() => {
                    let (start, end) = (on?, token.end);
                    guard.span = Span {
                        start,
                        end,
                        ..transition
                    };
                    return Some(guard);
                }
                T::BracketOpen => open = Some(token.end),
                T::And => guard.has_and = true,
                T::Or => guard.has_or = true,
                T::BracketClose => {
                    let (start, end) = (open?, token.start);
                    guard.span = Span {
                        start,
                        end,
                        ..transition
                    };
                    let words = text.get(start as usize..end as usize)?;
                    guard.words = Some(words);
                    let is_plain = !words.is_empty() && !words.contains(['/', '\n', '\r']);
                    return is_plain.then_some(guard);
                }
                _ => {}
            }
        }
    }

    /// What holds where it does not.
    fn negated(&self) -> String {
        let words = self.words.unwrap_or("exit").trim();
        if self.has_and || self.has_or {
            return format!("not ({words})");
        }
        match words.strip_prefix("not ") {
            Some(words) => words.trim_start().to_owned(),
            None => format!("not {words}"),
        }
    }
}

/// Excludes from the guard of a transition what others are taken at.
pub(super) fn exclude_guards(text: &str, transition: Span, others: &[Span]) -> Option<Fix> {
    let guard = WrittenGuard::find(text, transition)?;
    let mut excluded = String::new();
    for other in others {
        excluded += " and ";
        excluded += &WrittenGuard::find(text, *other)?.negated();
    }
    let edits = match guard.words {
        None => vec![Edit::replace(guard.span, format!("[exit{excluded}]"))],
        Some(_) if guard.has_or => vec![
            Edit::before(guard.span, "("),
            Edit::behind(guard.span, format!("){excluded}")),
        ],
        Some(_) => vec![Edit::behind(guard.span, &*excluded)],
    };
    Some(Fix::new(format!("add `{}`", excluded.trim_start()), edits))
}

/// Makes a transition that is taken at `[timeout]`, and at nothing else, one that is taken at the
/// next macro step.
pub(super) fn without_timeout(text: &str, transition: Span) -> Option<Edit> {
    let guard = WrittenGuard::find(text, transition)?;
    if guard.words?.trim() != "timeout" {
        return None;
    }
    let (start, end) = (guard.span.start.checked_sub(1)?, guard.span.end + 1);
    let before = text.get(..start as usize)?;
    let blanks = before.len() - before.trim_end_matches(' ').len();
    let start = start - blanks as u32;
    Some(Edit::remove(Span {
        start,
        end,
        ..transition
    }))
}

/// Removes the limit of time from the declaration of a state.
pub(super) fn remove_limit(text: &str, declaration: Span) -> Option<Edit> {
    let mut lexer = Lexer::new_at(text, declaration.start);
    let mut limit = None;
    let mut before = declaration.start;
    loop {
        let token = lexer.next_token();
        if token.start >= declaration.end {
            return None;
        }
        match (token.kind, limit) {
            (T::EndOfFile | T::Semicolon, _) => return None,
            (T::Timeout, None) => limit = Some(before),
            // The unit behind the number.
            (T::Identifier, Some(start)) => {
                let end = token.end;
                let words = text.get(start as usize..end as usize)?;
                let span = Span {
                    start,
                    end,
                    ..declaration
                };
                return (!words.contains('/')).then(|| Edit::remove(span));
            }
            _ => {}
        }
        before = token.end;
    }
}

/// The text before a span, and that behind it.
fn around(text: &str, span: Span) -> (&str, &str) {
    (
        text.get(..span.start as usize).unwrap_or(""),
        text.get(span.end as usize..).unwrap_or(""),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The text with an edit made; `<…>` marks the span.
    fn edited(text: &str, edit: impl Fn(&str, Span) -> Option<Edit>) -> Option<String> {
        let (before, marked) = text.split_once('<')?;
        let (marked, behind) = marked.rsplit_once('>')?;
        let (start, end) = (before.len(), before.len() + marked.len());
        let plain = [before, marked, behind].concat();
        let span = Span {
            file: 0,
            start: start as u32,
            end: end as u32,
        };
        let edit = edit(&plain, span)?;
        let mut changed = plain.clone();
        changed.replace_range(edit.span.start as usize..edit.span.end as usize, &edit.text);
        Some(changed)
    }

    #[test]
    fn items_go_with_their_lines() {
        for (text, expected) in [
            ("a;\n  <b;>\n  c;\n", "a;\n  c;\n"),
            ("<b;>\nc;", "c;"),
            ("a; <b;> c;", "a; c;"),
            ("a;\n  <b;> // why\n", "a;\n // why\n"),
            ("a;\n<b;>", "a;\n"),
        ] {
            let found = edited(text, |text, span| Some(remove_item(text, span)));
            assert_eq!(found.as_deref(), Some(expected), "{text:?}");
        }
    }

    #[test]
    fn statements_get_lines_like_those_before() {
        for (text, expected) in [
            ("  <a;>\n  c;", "  a;\n  b;\n  c;"),
            ("  <a;> // why\n", "  a; // why\n  b;\n"),
            ("{ <a;> }", "{ a; b; }"),
            ("<a;>", "a;\nb;"),
        ] {
            let found = edited(text, |text, span| Some(insert_behind(text, span, "b;")));
            assert_eq!(found.as_deref(), Some(expected), "{text:?}");
        }
    }

    #[test]
    fn guards_are_excluded_from_later_ones() {
        for (earlier, later, expected) in [
            (
                "A -> B [.a];",
                "A -> C [.b];",
                Some("A -> C [.b and not .a];"),
            ),
            (
                "A -> B [not .a];",
                "A -> C [.b];",
                Some("A -> C [.b and .a];"),
            ),
            (
                "A -> B [.a or .c];",
                "A -> C [ .b or .d ] / send E;",
                Some("A -> C [( .b or .d ) and not (.a or .c)] / send E;"),
            ),
            (
                "A -> B on *;",
                "A -> C [.b];",
                Some("A -> C [.b and not exit];"),
            ),
            (
                "A -> B [.a];",
                "A -> C on *;",
                Some("A -> C [exit and not .a];"),
            ),
            ("A -> B;", "A -> C [.b];", None),
            ("A -> B [.a /* why */];", "A -> C [.b];", None),
        ] {
            let text = format!("{earlier} {later}");
            let (split, end) = (earlier.len() as u32, text.len() as u32);
            let file = 0;
            let (first, second) = (
                Span {
                    file,
                    start: 0,
                    end: split,
                },
                Span {
                    file,
                    start: split + 1,
                    end,
                },
            );
            let fix = exclude_guards(&text, second, &[first]);
            let changed = fix.map(|fix| {
                let mut changed = text.clone();
                for edit in fix.edits.iter().rev() {
                    let place = edit.span.start as usize..edit.span.end as usize;
                    changed.replace_range(place, &edit.text);
                }
                changed.split_off(split as usize + 1)
            });
            assert_eq!(changed.as_deref(), expected, "{text}");
        }
    }

    #[test]
    fn limits_go_with_what_reads_them() {
        for (text, expected) in [
            ("<state A timeout 5 ms;>", Some("state A;")),
            (
                "<task A: T timeout 5ms with { p = 1 };>",
                Some("task A: T with { p = 1 };"),
            ),
            ("<state timeouts;>", None),
        ] {
            assert_eq!(edited(text, remove_limit).as_deref(), expected, "{text}");
        }
        for (text, expected) in [
            ("<A -> B [timeout];>", Some("A -> B;")),
            (
                "<A -> B on pulse [timeout] / send E;>",
                Some("A -> B on pulse / send E;"),
            ),
            ("<A -> B [timeout and .a];>", None),
        ] {
            assert_eq!(edited(text, without_timeout).as_deref(), expected, "{text}");
        }
    }

    #[test]
    fn names_go_with_their_commas() {
        for (text, expected) in [
            ("event A, <B>, C;", Some("event A, C;")),
            ("event <A>, B;", Some("event B;")),
            ("x {\n  in event <A>;\n}", Some("x {\n}")),
            ("x { event <A>; }", Some("x { }")),
            ("event /* b */ <A>;", None),
        ] {
            let found = edited(text, remove_from_list);
            assert_eq!(found.as_deref(), expected, "{text:?}");
        }
        for (text, expected) in [
            ("A -> B / clear .<f>;", Some("A -> B;")),
            ("A -> B / clear .<f>, send E;", Some("A -> B / send E;")),
            ("A -> B / send E, clear .<f>;", Some("A -> B / send E;")),
            ("A -> B / /* x */ clear .<f>;", None),
        ] {
            let found = edited(text, |text, span| remove_action(text, span, "clear"));
            assert_eq!(found.as_deref(), expected, "{text:?}");
        }
    }
}
