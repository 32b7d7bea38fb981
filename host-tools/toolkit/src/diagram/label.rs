//! Words and symbols: what stands at a transition, in a guard, on a state.
//!
//! The language's symbols are drawn as shapes and not as letters, for few fonts have all of them.

use std::borrow::Cow;

use super::grid::{self, Spot};
use crate::model::{
    Action, Container, Guard, Model, Source, StateKind, Target, Transition, Trigger,
};
use crate::pictures::font::{self, Weight};

/// A symbol of the language.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Symbol {
    /// ↑: an event, the pulse where no name follows.
    Event,
    /// ⊙: the exit flag.
    Exit,
    /// ⊗: the timeout flag.
    Timeout,
    /// ⊘: the busy flag.
    Busy,
    /// •: a flag of the state.
    Own,
    /// ◦: a flag of the state around.
    Parent,
    /// ∧
    And,
    /// ∨
    Or,
    /// −: not; as an action, the flag is reset.
    Not,
}

impl Symbol {
    /// Its width, space around included, in ems.
    pub const fn width_em(self) -> f32 {
        match self {
            Symbol::Event => 0.62,
            Symbol::Exit | Symbol::Timeout | Symbol::Busy => 0.92,
            Symbol::Own | Symbol::Parent => 0.52,
            Symbol::And | Symbol::Or => 1.1,
            Symbol::Not => 0.66,
        }
    }

    /// As a letter, for texts that a reader's font shows.
    pub const fn letter(self) -> char {
        match self {
            Symbol::Event => '↑',
            Symbol::Exit => '⊙',
            Symbol::Timeout => '⊗',
            Symbol::Busy => '⊘',
            Symbol::Own => '•',
            Symbol::Parent => '◦',
            Symbol::And => '∧',
            Symbol::Or => '∨',
            Symbol::Not => '−',
        }
    }
}

/// A piece of a line.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Piece {
    /// Words.
    Words(String),
    /// A symbol.
    Symbol(Symbol),
}

/// How the words of a line are set.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Type {
    /// Height of the em in units of a scene.
    pub size: f32,
    /// Weight.
    pub weight: Weight,
}

/// Of transitions' labels.
pub const LABEL: Type = Type {
    size: 10.0,
    weight: Weight::Regular,
};
/// Of the names of states.
pub const NAME: Type = Type {
    size: 11.0,
    weight: Weight::Bold,
};
/// Of what stands below a name.
pub const DETAIL: Type = Type {
    size: 9.0,
    weight: Weight::Regular,
};
/// Of the names of ports.
pub const PORT: Type = Type {
    size: 8.0,
    weight: Weight::Regular,
};
/// Of the names of regions.
pub const REGION: Type = Type {
    size: 9.5,
    weight: Weight::Bold,
};

/// Labels longer than this, in units of a scene, go over to another line where they can.
const LINE_WIDTH: f32 = 120.0;
/// Lines of a label at most; what follows is left away, and a sign says so.
pub const MAX_LINES: usize = 10;
/// Characters of a name that are shown, at most; a longer one is cut, and a sign says so.
pub const MAX_NAME: usize = 40;
/// What stands for all that was cut away.
const CUT: &str = "…";

/// A name as it is shown.
pub fn name(name: &str) -> Cow<'_, str> {
    match name.char_indices().nth(MAX_NAME) {
        None => Cow::Borrowed(name),
        Some(_) => {
            let kept = name.chars().take(MAX_NAME - 1);
            Cow::Owned(kept.chain(CUT.chars()).collect())
        }
    }
}

/// A line of words and symbols.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Line(pub Vec<Piece>);

impl Line {
    /// A line of words alone.
    pub fn words(words: impl Into<String>) -> Self {
        Line(vec![Piece::Words(words.into())])
    }

    /// Width in units of a scene.
    pub fn width(&self, set: Type) -> f32 {
        let widths = self.0.iter().map(|piece| match piece {
            Piece::Words(words) => font::width(words, set.size, set.weight),
            Piece::Symbol(symbol) => symbol.width_em() * set.size,
        });
        widths.sum()
    }

    fn push(&mut self, words: &str) {
        match self.0.last_mut() {
            Some(Piece::Words(last)) => last.push_str(words),
            _ => self.0.push(Piece::Words(words.into())),
        }
    }

    fn without_indent(mut self) -> Self {
        if let Some(Piece::Words(first)) = self.0.first_mut() {
            *first = first.trim_start().to_owned();
        }
        self
    }

    fn symbol(&mut self, symbol: Symbol) {
        self.0.push(Piece::Symbol(symbol));
    }

    fn append(&mut self, other: Line) {
        for piece in other.0 {
            match piece {
                Piece::Words(words) => self.push(&words),
                Piece::Symbol(symbol) => self.symbol(symbol),
            }
        }
    }
}

impl std::fmt::Display for Line {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for piece in &self.0 {
            match piece {
                Piece::Words(words) => f.write_str(words)?,
                Piece::Symbol(symbol) => write!(f, "{}", symbol.letter())?,
            }
        }
        Ok(())
    }
}

/// Rows that a line of a label takes, in cells.
pub const LINE_ROWS: i32 = 2;

/// Width and height of a label in cells.
pub fn size(lines: &[Line]) -> Spot {
    let widest = lines
        .iter()
        .map(|line| line.width(LABEL))
        .fold(0.0, f32::max);
    [grid::cells(widest), LINE_ROWS * lines.len() as i32]
}

/// The label of a transition of `container`: `event[guard]/actions`, in one line or several. `turn`
/// is its place among those that the same event can trigger, where there are several. Empty for the
/// plain start of a region.
pub fn of_transition(
    model: &Model,
    container: &Container,
    region: usize,
    transition: &Transition,
    turn: Option<usize>,
) -> Vec<Line> {
    let names = Names {
        model,
        container,
        region,
        transition,
    };
    let is_plain = transition.guard.is_none() && transition.actions.is_empty();
    if transition.source == Source::Initial
        && transition.trigger == Trigger::Pulse
        && is_plain
        && turn.is_none()
    {
        return Vec::new();
    }
    let mut head = Line::default();
    if let Some(turn) = turn {
        head.push(&format!("{turn}: "));
    }
    head.symbol(Symbol::Event);
    if let Trigger::Event(event) = transition.trigger {
        head.push(&names.event(event));
    }
    let mut parts = vec![head];
    if transition.trigger == Trigger::Star {
        let mut guard = Line::default();
        guard.push("[");
        guard.symbol(Symbol::Exit);
        guard.push("]");
        parts.push(guard);
    } else if let Some(guard) = &transition.guard {
        let mut terms = vec![Line::words("[")];
        names.write(guard, false, &mut terms);
        if let Some(last) = terms.last_mut() {
            last.push("]");
        }
        parts.extend(terms);
    }
    for (index, action) in transition.actions.iter().enumerate() {
        let mut part = Line::words(if index == 0 { " / " } else { " " });
        part.append(names.action(*action));
        if index + 1 < transition.actions.len() {
            part.push(",");
        }
        parts.push(part);
    }
    filled(parts, LINE_WIDTH, LABEL)
}

/// Parts in lines that are not longer than `width`, unless a part alone is; [`MAX_LINES`] of them
/// at most.
pub fn filled(parts: Vec<Line>, width: f32, set: Type) -> Vec<Line> {
    let mut lines: Vec<Line> = Vec::new();
    let mut filled = 0.0;
    for part in parts {
        let wide = part.width(set);
        let is_full = lines.len() == MAX_LINES;
        match lines.last_mut() {
            Some(last) if filled + wide <= width => {
                last.append(part);
                filled += wide;
            }
            Some(last) if is_full => {
                last.push(CUT);
                break;
            }
            Some(_) => {
                // What goes over is set in a little.
                let mut line = Line::words("   ");
                line.append(part.without_indent());
                filled = line.width(set);
                lines.push(line);
            }
            None => {
                filled = wide;
                lines.push(part);
            }
        }
    }
    lines
}

/// Where the names in a transition come from.
struct Names<'a> {
    model: &'a Model,
    container: &'a Container,
    region: usize,
    transition: &'a Transition,
}

impl Names<'_> {
    fn event(&self, event: usize) -> Cow<'_, str> {
        name(self.model.events.get(event).map_or("", String::as_str))
    }

    fn own_flag(&self, state: Option<usize>, flag: usize) -> Cow<'_, str> {
        let kind = state
            .and_then(|state| self.container.regions.get(self.region)?.states.get(state))
            .map(|state| &state.kind);
        let flags = match kind {
            Some(StateKind::Task { task, .. }) => {
                self.model.tasks.get(*task).map(|task| &task.flags)
            }
            Some(StateKind::Super { container }) => self
                .model
                .containers
                .get(*container)
                .map(|container| &container.flags),
            Some(StateKind::Simple) | None => None,
        };
        let flag = flags.and_then(|flags| flags.get(flag));
        name(flag.map_or("", |flag| &flag.name))
    }

    fn parent_flag(&self, flag: usize) -> Cow<'_, str> {
        let flag = self.container.flags.get(flag);
        name(flag.map_or("", |flag| &flag.name))
    }

    /// Adds a guard to the last of `parts`; after a sign that joins terms, a new part begins.
    /// Guards are as deep as the parser lets them be, which is not deep.
    fn write(&self, guard: &Guard, in_brackets: bool, parts: &mut Vec<Line>) {
        let Some(line) = parts.last_mut() else {
            return;
        };
        let (terms, sign) = match guard {
            Guard::Exit => return line.symbol(Symbol::Exit),
            Guard::Timeout => return line.symbol(Symbol::Timeout),
            Guard::Busy => return line.symbol(Symbol::Busy),
            Guard::Own(flag) => {
                line.symbol(Symbol::Own);
                let state = match self.transition.source {
                    Source::State(state) => Some(state),
                    Source::Initial => None,
                };
                return line.push(&self.own_flag(state, *flag));
            }
            Guard::Parent(flag) => {
                line.symbol(Symbol::Parent);
                return line.push(&self.parent_flag(*flag));
            }
            Guard::Not(inner) => {
                line.symbol(Symbol::Not);
                let is_compound = matches!(**inner, Guard::And(_) | Guard::Or(_));
                return self.write(inner, is_compound, parts);
            }
            Guard::And(terms) => (terms, Symbol::And),
            Guard::Or(terms) => (terms, Symbol::Or),
        };
        if in_brackets {
            line.push("(");
        }
        for (index, term) in terms.iter().enumerate() {
            self.write(term, matches!(sign, Symbol::And), parts);
            if index + 1 < terms.len() {
                if let Some(line) = parts.last_mut() {
                    line.symbol(sign);
                }
                parts.push(Line::default());
            }
        }
        if let Some(line) = parts.last_mut().filter(|_| in_brackets) {
            line.push(")");
        }
    }

    fn action(&self, action: Action) -> Line {
        let mut line = Line::default();
        match action {
            Action::Send(event) => {
                line.symbol(Symbol::Event);
                line.push(&self.event(event));
            }
            Action::Own(flag, sets) => {
                if !sets {
                    line.symbol(Symbol::Not);
                }
                line.symbol(Symbol::Own);
                let state = match self.transition.target {
                    Target::State(state) => Some(state),
                    Target::Final => None,
                };
                line.push(&self.own_flag(state, flag));
            }
            Action::Parent(flag, sets) => {
                if !sets {
                    line.symbol(Symbol::Not);
                }
                line.symbol(Symbol::Parent);
                line.push(&self.parent_flag(flag));
            }
        }
        line
    }
}
