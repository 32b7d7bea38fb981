//! The face of a state: what its box says, how large it is, where its ports are.

use super::grid::{self, Area, LANE, Spot};
use super::label::{self, Line, Piece, Symbol};
use crate::model::{Container, DataPort, Direction, Model, SlotRef, Span, State, StateKind, Value};
use crate::scenario::time::Time;

/// Rows from one port to the next.
pub const PORT_ROWS: i32 = 2;
/// Cells between the edge of a box and the name of a port.
pub const PORT_NAME_GAP: i32 = 1;
/// Rows of a line below the name of a state.
pub const DETAIL_ROWS: i32 = 2;
/// Rows of the name of a task state or simple state.
pub const NAME_ROWS: i32 = 3;
/// Rows below the last line of a box.
pub const FOOT_ROWS: i32 = 1;
/// Cells between the names of ports on the left and on the right.
const BETWEEN_NAMES: i32 = 2;
/// Cells on each side of a name.
pub const MARGIN: i32 = 2;
/// Cells across a state, at least: so wide that transitions to and fro, with their labels between,
/// can be straight.
const LEAST_WIDTH: i32 = 16;
/// Width and height of the marks of `initial` and `final`.
const MARK: i32 = 2;

/// Rows of a heading without declarations.
const HEADING_ROWS: i32 = 4;
/// Cells that a loop reaches out to the right of its state.
pub const LOOP_REACH: i32 = 3;

/// What a box stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// The mark of `initial`.
    Initial,
    /// The mark of `final`.
    Final,
    /// A simple state.
    Simple,
    /// A task state.
    Task,
    /// A superstate, with its inside or without.
    Super,
    /// The machine, or a container on its own.
    Root,
}

/// A side of a box on which ports are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// What is read: `in` and `inout`.
    Left,
    /// What is written: `out`.
    Right,
}

/// A data port of a box.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Port {
    /// Index into the data ports of the task or container.
    pub index: usize,
    /// The side of the box on which it is.
    pub side: Side,
    /// Its row, from the top of the box.
    pub row: i32,
    /// Its name, with the number of its net where that has no lines.
    pub name: String,
    /// Direction.
    pub direction: Direction,
    /// Whether it may stay open.
    pub optional: bool,
}

impl Port {
    /// Cells that the name takes.
    pub fn name_cells(&self) -> i32 {
        grid::cells(Line::words(&self.name).width(label::PORT))
    }

    /// Where the name stands: inside the box, next to the port.
    pub fn name_area(&self, in_box: Area) -> Area {
        let size = [self.name_cells(), PORT_ROWS];
        let top = in_box.top + self.row - PORT_ROWS / 2;
        match self.side {
            Side::Left => Area::new([in_box.left + PORT_NAME_GAP, top], size),
            Side::Right => Area::new([in_box.right - PORT_NAME_GAP - size[0], top], size),
        }
    }
}

/// A transition from a state to itself: a loop at the right side of the box.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Loop {
    /// The row at which it begins, from the top of the box.
    pub row: i32,
    /// Rows between its two ends.
    pub rows: i32,
    /// Width and height of the label.
    pub label: Spot,
}

/// Rows of a heading that holds so many lines of declarations below the name.
pub const fn heading_rows(declarations: usize) -> i32 {
    HEADING_ROWS + DETAIL_ROWS * declarations as i32
}

/// What a box shows.
#[derive(Clone, Debug)]
pub struct Face {
    /// What it stands for.
    pub kind: Kind,
    /// The name.
    pub name: Line,
    /// The state's name in the source; `initial` and `final` of the marks.
    pub state: String,
    /// Where the source declares the state; of the marks nothing is declared.
    pub span: Option<Span>,
    /// The lines below it; those of a superstate that shows its inside stand in the heading.
    pub details: Vec<Line>,
    /// The data ports.
    pub ports: Vec<Port>,
    /// Transitions to itself.
    pub loops: Vec<Loop>,
    /// Index of the container, of a superstate.
    pub container: Option<usize>,
    /// Width and height; of a superstate that shows its inside, the least.
    pub size: Spot,
}

impl Face {
    /// The mark of `initial` or `final`.
    pub fn pseudo(kind: Kind) -> Self {
        Face {
            kind,
            name: Line::default(),
            state: match kind {
                Kind::Final => "final".to_owned(),
                _ => "initial".to_owned(),
            },
            span: None,
            details: Vec::new(),
            ports: Vec::new(),
            loops: Vec::new(),
            container: None,
            size: [2 * LANE, MARK],
        }
    }

    /// The face of a state. `is_open` says that the inside of a superstate will be shown; `number`
    /// gives the net of a port where nets are told by numbers.
    pub fn of_state(
        model: &Model,
        state: &State,
        shows_data: bool,
        is_open: bool,
        number: impl Fn(usize) -> Option<usize>,
    ) -> Self {
        let mut face = Face {
            kind: Kind::Simple,
            name: Line::words(label::name(&state.name)),
            state: state.name.clone(),
            span: Some(state.span),
            details: Vec::new(),
            ports: Vec::new(),
            loops: Vec::new(),
            container: None,
            size: [0, 0],
        };
        let mut data: &[DataPort] = &[];
        match &state.kind {
            StateKind::Simple => {}
            StateKind::Task { task, slot, params } => {
                face.kind = Kind::Task;
                if let Some(task) = model.tasks.get(*task) {
                    let slot = match slot {
                        SlotRef::NonRealTime => 0,
                        SlotRef::Slot(index) => {
                            model.slots.get(*index).map_or(0, |slot| slot.number)
                        }
                    };
                    face.details.push(Line::words(format!(
                        "{} · slot {slot}",
                        label::name(&task.name)
                    )));
                    for (param, value) in task.params.iter().zip(params) {
                        if param.default != Some(*value) {
                            let line =
                                format!("{} = {}", label::name(&param.name), literal(*value));
                            face.details.push(Line::words(line));
                        }
                    }
                    data = &task.data;
                }
            }
            StateKind::Super { container } => {
                face.kind = Kind::Super;
                face.container = Some(*container);
                if let Some(container) = model.containers.get(*container) {
                    let inner = label::name(&container.name);
                    if is_open {
                        face.details = declarations(model, container);
                        face.name = Line::words(format!("{} : {inner}", label::name(&state.name)));
                    } else {
                        face.details.push(Line::words(format!(": {inner} …")));
                    }
                    data = &container.data;
                }
            }
        }
        if let Some(timeout) = state.timeout_us {
            let limit = Line(vec![
                Piece::Symbol(Symbol::Timeout),
                Piece::Words(format!(" {}", Time { us: timeout.into() })),
            ]);
            if is_open {
                face.name.0.push(Piece::Words("   ".into()));
                face.name.0.extend(limit.0);
            } else {
                face.details.push(limit);
            }
        }
        let text_rows = if is_open {
            heading_rows(face.details.len())
        } else {
            NAME_ROWS + DETAIL_ROWS * face.details.len() as i32
        };
        if shows_data {
            face.ports = ports(data, text_rows + PORT_ROWS / 2, number);
        }
        face.size = face.least_size(text_rows, is_open);
        face
    }

    fn least_size(&self, text_rows: i32, is_open: bool) -> Spot {
        let name = grid::cells(self.name.width(label::NAME)) + 2 * MARGIN;
        let details = self.details.iter();
        let widest = details.map(|line| grid::cells(line.width(label::DETAIL)) + 2 * MARGIN);
        let names = widest_name(&self.ports, Side::Left) + widest_name(&self.ports, Side::Right);
        let ports = names + if names > 0 { BETWEEN_NAMES } else { 0 };
        let width = widest.chain([name, ports, LEAST_WIDTH]).max().unwrap_or(0);
        let step = 2 * LANE;
        let foot = if is_open { 0 } else { FOOT_ROWS };
        [
            (width + step - 1) / step * step,
            text_rows + port_rows(&self.ports) + foot,
        ]
    }

    /// Cells to the right of the box that its loops take.
    pub fn beside(&self) -> i32 {
        let widest = self.loops.iter().map(|one| LOOP_REACH + 1 + one.label[0]);
        widest.max().unwrap_or(0)
    }

    /// Adds loops with these labels, below the ports of the right side.
    pub fn add_loops(&mut self, labels: &[&[Line]]) {
        let ports = self.ports.iter().filter(|port| port.side == Side::Right);
        let mut row = ports.map(|port| port.row + PORT_ROWS).max().unwrap_or(1);
        for lines in labels {
            let label = label::size(lines);
            let rows = label[1].max(2);
            self.loops.push(Loop { row, rows, label });
            row += rows + 1;
        }
        if !labels.is_empty() {
            self.size[1] = self.size[1].max(row);
        }
    }
}

/// The width of declarations in a heading, in units of a scene, at most.
const DECLARATIONS_WIDTH: f32 = 240.0;

/// The flags and events of a container, in the words of the source:
/// `in flag left · event Halt, Resume`.
pub fn declarations(model: &Model, container: &Container) -> Vec<Line> {
    let flags = |direction: Direction| {
        let flags = container.flags.iter();
        let chosen = flags.filter(move |flag| flag.direction == direction);
        chosen.map(|flag| flag.name.as_str())
    };
    let events = |forwarded: (bool, bool)| {
        let events = container.events.iter();
        let chosen =
            events.filter(move |event| (event.forwarded_in, event.forwarded_out) == forwarded);
        chosen.filter_map(|event| model.events.get(event.event).map(String::as_str))
    };
    let groups: [(&str, Vec<&str>); 6] = [
        ("in flag", flags(Direction::In).collect()),
        ("out flag", flags(Direction::Out).collect()),
        ("event", events((false, false)).collect()),
        ("in event", events((true, false)).collect()),
        ("out event", events((false, true)).collect()),
        ("in out event", events((true, true)).collect()),
    ];
    let mut parts = Vec::new();
    for (kind, names) in groups {
        for (index, name) in names.iter().enumerate() {
            let name = label::name(name);
            let before = match index {
                0 if parts.is_empty() => format!("{kind} "),
                0 => format!(" · {kind} "),
                _ => " ".to_owned(),
            };
            let after = if index + 1 < names.len() { "," } else { "" };
            parts.push(Line::words(format!("{before}{name}{after}")));
        }
    }
    label::filled(parts, DECLARATIONS_WIDTH, label::DETAIL)
}

/// Ports in rows, the first at `row`.
pub fn ports(data: &[DataPort], row: i32, number: impl Fn(usize) -> Option<usize>) -> Vec<Port> {
    let mut next = [row; 2];
    data.iter()
        .enumerate()
        .map(|(index, port)| {
            let side = match port.direction {
                Direction::In | Direction::InOut => Side::Left,
                Direction::Out => Side::Right,
            };
            let row = next[side as usize];
            next[side as usize] += PORT_ROWS;
            Port {
                index,
                side,
                row,
                name: match number(index) {
                    Some(number) => format!("{} #{number}", label::name(&port.name)),
                    None => label::name(&port.name).into_owned(),
                },
                direction: port.direction,
                optional: port.optional,
            }
        })
        .collect()
}

/// Rows that ports take.
pub fn port_rows(ports: &[Port]) -> i32 {
    let on = |side: Side| ports.iter().filter(|port| port.side == side).count() as i32;
    PORT_ROWS * on(Side::Left).max(on(Side::Right))
}

/// Cells that the names of a side take, with the gap to the edge; 0 where there are none.
pub fn widest_name(ports: &[Port], side: Side) -> i32 {
    let names = ports.iter().filter(|port| port.side == side);
    names
        .map(|port| port.name_cells() + PORT_NAME_GAP)
        .max()
        .unwrap_or(0)
}

fn literal(value: Value) -> String {
    match value {
        Value::Bool(value) => value.to_string(),
        Value::I32(value) => value.to_string(),
        Value::U32(value) => value.to_string(),
        Value::F32(value) => value.to_string(),
    }
}
