//! What is told about a name: its declaration, the comment that goes with it, and what has to do
//! with it.

use std::fmt::Write as _;

use crate::lang::lexer::docs_text;
use crate::lang::tree::{self, Action, Endpoint, Given, Rate, StateKind, Transition, Trigger};
use crate::model::Span;

use super::outline::{self, Declared};
use super::sets::{Set, end_of_item};

/// How many lines of a declaration are shown.
const MAX_LINES: usize = 30;

/// How much of a line is shown, in characters.
const MAX_CHARACTERS: usize = 200;

/// How many transitions are shown.
const MAX_TRANSITIONS: usize = 20;

/// What is told about the thing that is declared at a place, in Markdown.
pub(super) fn text(set: &Set, declaration: Span) -> Option<String> {
    let file = set.checked.trees().get(declaration.file as usize)?;
    let source = set.file_text(declaration.file);
    let places = set.places(declaration);
    let Some(declared) = outline::declared(file, declaration) else {
        return Some(format!(
            "`{}`: a type of data or an `exclusive` group, named in {} places",
            set.source(declaration),
            places.len()
        ));
    };
    let start = declared
        .start()
        .unwrap_or_else(|| start_of_statement(source, declaration.start));
    let end = end_of_item(source, start);
    let mut text = fenced(&clipped(&undented(source, start, end)));
    // Where it is described, other comments are not about it.
    let docs = declared.docs().map(|lines| docs_text(set.source(lines)));
    if let Some(said) = docs.or_else(|| comment(source, start, end)) {
        let _ = write!(text, "\n\n{}", clipped(&said));
    }
    match declared {
        Declared::Slot(slot) => {
            if let Some(times) = slot_times(slot) {
                let _ = write!(text, "\n\n{times}");
            }
        }
        Declared::Task(task) => {
            if let Given::Value(wcet_us) = task.wcet_us {
                let _ = write!(text, "\n\nworst case execution time {}", time(wcet_us));
            }
        }
        Declared::State(state, region) => {
            if let Given::Value(timeout_us) = state.timeout_us {
                let _ = write!(text, "\n\ntimeout after {}", time(timeout_us));
            }
            if let Some((made_of, docs)) = made_of(set, state) {
                let _ = write!(text, "\n\n{}", fenced(&clipped(&made_of)));
                if let Some(docs) = docs {
                    let _ = write!(text, "\n\n{}", clipped(&docs));
                }
            }
            text.push_str(&transitions_of_state(set, region, set.source(declaration)));
        }
        Declared::Event(_) => text.push_str(&transitions_of_event(set, &places)),
        _ => {}
    }
    Some(text)
}

/// The declaration of the task or container that a state is made of, and what its `///` lines say.
fn made_of(set: &Set, state: &tree::State) -> Option<(String, Option<String>)> {
    let name = match &state.kind {
        StateKind::Simple => None,
        StateKind::Task { task, .. } => *task,
        StateKind::Super { container } => *container,
    }?;
    let references = set.checked.references();
    let (_, declaration) = references.at(name.0.file, name.0.start)?;
    let file = set.checked.trees().get(declaration.file as usize)?;
    let source = set.file_text(declaration.file);
    let declared = outline::declared(file, declaration)?;
    let start = declared.start()?;
    let docs = declared.docs().map(|lines| docs_text(set.source(lines)));
    let whole = undented(source, start, end_of_item(source, start));
    // Of a container what it looks like from outside.
    let inside = whole.find("\n    region ").unwrap_or(whole.len());
    let outside = whole.get(..inside).unwrap_or(&whole).trim_end();
    let shown = if inside < whole.len() {
        format!("{outside}\n    …\n}}")
    } else {
        outside.to_owned()
    };
    Some((shown, docs))
}

fn transitions_of_state(set: &Set, region: &tree::Region, state: &str) -> String {
    let is_end = |end: Option<Endpoint>| match end {
        Some(Endpoint::State(name)) => set.source(name.0) == state,
        _ => false,
    };
    let from = |transition: &&Transition| is_end(Some(transition.source));
    let to = |transition: &&Transition| is_end(transition.target) && !from(transition);
    let transitions = &region.transitions;
    list(set, "Ways out", transitions.iter().filter(from))
        + &list(set, "Ways in", transitions.iter().filter(to))
}

fn transitions_of_event(set: &Set, places: &[Span]) -> String {
    let is_place = |span: Span| places.binary_search(&span).is_ok();
    let trees = set.checked.trees().iter();
    let transitions: Vec<&Transition> = trees
        .flat_map(|file| &file.containers)
        .flat_map(|container| &container.regions)
        .flat_map(|region| &region.transitions)
        .collect();
    let sends = |transition: &&&Transition| {
        transition
            .actions
            .iter()
            .any(|action| matches!(action, Action::Send(name) if is_place(name.0)))
    };
    let receives = |transition: &&&Transition| matches!(transition.trigger, Given::Value(Trigger::Event(name)) if is_place(name.0));
    list(set, "Sent by", transitions.iter().filter(sends).copied())
        + &list(
            set,
            "Received by",
            transitions.iter().filter(receives).copied(),
        )
}

/// Transitions under a heading; nothing where there are none.
fn list<'t>(set: &Set, heading: &str, transitions: impl Iterator<Item = &'t Transition>) -> String {
    let mut lines: Vec<String> = Vec::new();
    for transition in transitions {
        if lines.len() == MAX_TRANSITIONS {
            lines.push("…".to_owned());
            break;
        }
        let words: Vec<&str> = set.source(transition.span).split_whitespace().collect();
        lines.push(clipped_line(&words.join(" ")));
    }
    if lines.is_empty() {
        return String::new();
    }
    format!("\n\n{heading}\n\n{}", fenced(&lines.join("\n")))
}

/// A rate, duration and share for people.
fn slot_times(slot: &tree::Slot) -> Option<String> {
    let period_us = match slot.rate? {
        Rate::PeriodUs(period_us) => period_us,
        Rate::Hertz(hertz) => 1_000_000 / hertz.max(1),
    };
    let duration_us = slot.duration_us?;
    let share = f64::from(duration_us) / f64::from(period_us.max(1)) * 100.0;
    let rate = 1e6 / f64::from(period_us.max(1));
    Some(
        format!(
            "every {} ({rate:.6} Hz), {} long: {share:.1} % of the time",
            time(period_us),
            time(duration_us),
        )
        .replace(".000000 Hz", " Hz"),
    )
}

/// A time in the greatest unit in which it is a whole number.
fn time(time_us: u32) -> String {
    match time_us {
        0 => "0 s".to_owned(),
        _ if time_us.is_multiple_of(1_000_000) => format!("{} s", time_us / 1_000_000),
        _ if time_us.is_multiple_of(1_000) => format!("{} ms", time_us / 1_000),
        _ => format!("{time_us} us"),
    }
}

fn fenced(source: &str) -> String {
    format!("```esm\n{source}\n```")
}

/// As much of a text as anybody reads.
fn clipped(text: &str) -> String {
    let mut lines: Vec<String> = text.lines().take(MAX_LINES).map(clipped_line).collect();
    if text.lines().nth(MAX_LINES).is_some() {
        lines.push("…".to_owned());
    }
    lines.join("\n")
}

fn clipped_line(line: &str) -> String {
    let mut clipped: String = line.chars().take(MAX_CHARACTERS).collect();
    if line.chars().nth(MAX_CHARACTERS).is_some() {
        clipped.push('…');
    }
    clipped
}

/// Where the statement around a byte starts: behind the `;` or brace before it, and behind
/// comments.
fn start_of_statement(source: &str, at: u32) -> u32 {
    let mut lexer = crate::lang::lexer::Lexer::new(source);
    let mut start = 0;
    let mut is_first = true;
    loop {
        use crate::lang::lexer::TokenKind as T;
        let token = lexer.next_token();
        if std::mem::take(&mut is_first) {
            start = token.start;
        }
        if token.start >= at || token.kind == T::EndOfFile {
            return start;
        }
        is_first = matches!(token.kind, T::Semicolon | T::BraceOpen | T::BraceClose);
    }
}

/// A part of a text without the blanks that all its lines but the first start with.
fn undented(source: &str, start: u32, end: u32) -> String {
    let before = source.get(..start as usize).unwrap_or("");
    let line_start = before.rfind('\n').map_or(0, |at| at + 1);
    let indent = before.len() - line_start;
    let part = source.get(start as usize..end as usize).unwrap_or("");
    part.lines()
        .map(|line| {
            let blanks = line.len() - line.trim_start_matches([' ', '\t']).len();
            line.get(blanks.min(indent)..).unwrap_or("")
        })
        .collect::<Vec<_>>()
        .join("\n")
}

/// The `//` lines directly above a declaration, and the comment behind it.
fn comment(source: &str, start: u32, end: u32) -> Option<String> {
    let before = source.get(..start as usize)?;
    let line_start = before.rfind('\n').map_or(0, |at| at + 1);
    let mut lines: Vec<&str> = before
        .get(..line_start)?
        .lines()
        .rev()
        .map_while(|line| line.trim().strip_prefix("//"))
        .map(str::trim)
        .collect();
    lines.reverse();
    let behind = source.get(end as usize..)?.lines().next().unwrap_or("");
    lines.extend(behind.trim().strip_prefix("//").map(str::trim));
    (!lines.is_empty()).then(|| lines.join("\n"))
}
