//! The resolved model of a set of `.esm` files: what the language front end hands to everything
//! behind it.
//!
//! Names are resolved to indices, attributes to values, `use` is gone. A model is only made of a
//! set of files without errors, so whoever takes one can rely on every index in it. Every part
//! keeps the [`Span`] that it came from, for messages.

use esm_core::frames;

/// Index into [`Model::files`] and a byte range in that file's text.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
pub struct Span {
    /// Index into [`Model::files`].
    pub file: u32,
    /// First byte.
    pub start: u32,
    /// One past the last byte.
    pub end: u32,
}

/// A source file of the set.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceFile {
    /// The path as people would write it: relative where the first file was named relatively.
    pub path: String,
    /// The whole text.
    pub text: String,
}

/// Everything that a set of files says. [`Model::containers`]`[machine]` is the root.
#[derive(Clone, Debug, Default)]
pub struct Model {
    /// The files of the set, the one named on the command line first.
    pub files: Vec<SourceFile>,
    /// Index into [`Model::containers`] of the machine, if the set has one.
    pub machine: Option<usize>,
    /// Index into [`Model::slots`] of the slot that runs the interpreter.
    pub interpreter_slot: Option<usize>,
    /// Capacity of the event queue.
    pub queue: u8,
    /// All event names of the set, each once, in the order of their first declaration. Containers
    /// that declare the same name share the entry.
    pub events: Vec<String>,
    /// Slots in source order; slot 0 (non-real-time) is never among them.
    pub slots: Vec<Slot>,
    /// Tasks in source order; behind them those of the dispatchers, two for each link.
    pub tasks: Vec<Task>,
    /// Links in source order.
    pub links: Vec<Link>,
    /// Frames in source order.
    pub frames: Vec<Frame>,
    /// Containers and the machine, in source order (of the files in the order of their first use).
    pub containers: Vec<Container>,
}

/// A time slot.
#[derive(Clone, Debug)]
pub struct Slot {
    /// The number that it was declared with, 1 or above.
    pub number: u32,
    /// Period in microseconds.
    pub period_us: u32,
    /// Duration in microseconds.
    pub duration_us: u32,
    /// What the `///` lines before the declaration say, a line each; empty without any.
    pub docs: String,
    /// The declaration.
    pub span: Span,
}

/// Direction of a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Direction {
    /// Read by the task or container.
    In,
    /// Written by it.
    Out,
    /// Read and published again (data only).
    InOut,
}

/// A data port of a task or container.
#[derive(Clone, Debug)]
pub struct DataPort {
    /// Name, unique among the data ports of its owner.
    pub name: String,
    /// Direction, seen from the owner.
    pub direction: Direction,
    /// Name of the type.
    pub type_name: String,
    /// An `in` port that may stay open or empty.
    pub optional: bool,
    /// How old a value may be that an `in` or `inout` port of a task reads, in microseconds; an
    /// older one counts as none.
    pub within_us: Option<u32>,
    /// What the `///` lines before the declaration say, a line each; empty without any.
    pub docs: String,
    /// The declaration.
    pub span: Span,
}

impl DataPort {
    /// Whether an input must be on a net: one that is required, and one that wants fresh values,
    /// whatever it does without any.
    #[must_use]
    pub fn must_be_on_net(&self) -> bool {
        !self.optional || self.within_us.is_some()
    }
}

/// A control flag of a task or container.
#[derive(Clone, Debug)]
pub struct Flag {
    /// Name, unique among the flags of its owner.
    pub name: String,
    /// [`Direction::In`] or [`Direction::Out`].
    pub direction: Direction,
    /// What the `///` lines before the declaration say, a line each; empty without any.
    pub docs: String,
    /// The declaration.
    pub span: Span,
}

/// Type of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum ParamType {
    /// `bool`
    Bool,
    /// `i32`
    I32,
    /// `u32`
    U32,
    /// `f32`
    F32,
}

/// Value of a parameter.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// `true` or `false`
    Bool(bool),
    /// An `i32`
    I32(i32),
    /// A `u32`
    U32(u32),
    /// An `f32`
    F32(f32),
}

/// A parameter of a task.
#[derive(Clone, Debug)]
pub struct Param {
    /// Name, unique among the parameters of its task.
    pub name: String,
    /// Type.
    pub param_type: ParamType,
    /// Default value.
    pub default: Option<Value>,
    /// Least and greatest value.
    pub range: Option<(Value, Value)>,
    /// What the `///` lines before the declaration say, a line each; empty without any.
    pub docs: String,
    /// The declaration.
    pub span: Span,
}

/// A slot as a task or task state names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlotRef {
    /// Slot 0: runs in the time that is left.
    NonRealTime,
    /// Index into [`Model::slots`].
    Slot(usize),
}

/// A task declaration.
#[derive(Clone, Debug)]
pub struct Task {
    /// Name.
    pub name: String,
    /// Slot, where the declaration names one.
    pub slot: Option<SlotRef>,
    /// Worst-case execution time in microseconds.
    pub wcet_us: Option<u32>,
    /// Name of its `exclusive` group.
    pub exclusive: Option<String>,
    /// How many task states of it a firmware has room for, where the declaration says so.
    pub count: Option<u32>,
    /// Whether it never finishes.
    pub endless: bool,
    /// Data ports in source order.
    pub data: Vec<DataPort>,
    /// Flags in source order, both directions.
    pub flags: Vec<Flag>,
    /// Parameters in source order.
    pub params: Vec<Param>,
    /// Which dispatcher it is, where it is one: no file declares it then.
    pub dispatcher: Option<Dispatcher>,
    /// What the `///` lines before the declaration say, a line each; empty without any.
    pub docs: String,
    /// The name in the declaration.
    pub span: Span,
}

/// A dispatcher of a link.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Dispatcher {
    /// Index into [`Model::links`].
    pub link: usize,
    /// [`Direction::Out`] for `transmit`, [`Direction::In`] for `receive`.
    pub direction: Direction,
}

/// A line between processors.
#[derive(Clone, Debug)]
pub struct Link {
    /// Name.
    pub name: String,
    /// Bits a second, 1 to 100,000,000; `None` where it could not be read.
    pub rate_bps: Option<u32>,
    /// What the medium and the identifier take of each frame.
    pub header_bytes: u8,
    /// Bits that a byte takes on the wire, 1 to 20.
    pub bits: u8,
    /// How long the line is silent between two frames, in microseconds.
    pub gap_us: u32,
    /// Index into [`Model::tasks`] of the dispatcher that sends.
    pub transmit: usize,
    /// Index into [`Model::tasks`] of the dispatcher that receives.
    pub receive: usize,
    /// What the `///` lines before the declaration say, a line each; empty without any.
    pub docs: String,
    /// The name in the declaration.
    pub span: Span,
    /// The whole declaration.
    pub declaration: Span,
}

/// What crosses a link.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Name.
    pub name: String,
    /// Identifier, at most [`frames::MAX_ID`].
    pub id: u16,
    /// Index into [`Model::links`].
    pub link: usize,
    /// Whether it is sent or received.
    pub direction: Direction,
    /// What it carries.
    pub content: Content,
    /// Bytes of its payload, 1 to [`frames::MAX_PAYLOAD_BYTES`]; `None` where they could not be
    /// read.
    pub payload_bytes: Option<u8>,
    /// Its period in microseconds; `None` where it could not be read.
    pub period_us: Option<u32>,
    /// How old a received value may be in microseconds; three periods where nothing is said.
    pub late_us: Option<u32>,
    /// What the `///` lines before the declaration say, a line each; empty without any.
    pub docs: String,
    /// The name in the declaration.
    pub span: Span,
    /// The whole declaration.
    pub declaration: Span,
}

/// What a frame carries.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Content {
    /// The value of a data port: its type.
    Value(String),
    /// Flags by their names, the first in the lowest bit.
    Flags(Vec<String>),
}

impl Frame {
    /// How long it takes on its link with the gap behind it, in microseconds.
    #[must_use]
    pub fn duration_us(&self, link: &Link) -> Option<u64> {
        let payload = self.payload_bytes.filter(|bytes| *bytes > 0)?;
        let bytes = u32::from(link.header_bytes) + u32::from(payload);
        let (bits, rate_bps) = (link.bits.into(), link.rate_bps?);
        Some(frames::duration_us(bytes, bits, rate_bps, link.gap_us))
    }

    /// How old a received value may be, in microseconds.
    #[must_use]
    pub fn late_us(&self) -> u64 {
        let periods = frames::LATE_PERIODS * u64::from(self.period_us.unwrap_or(0));
        self.late_us.map_or(periods, u64::from)
    }
}

impl Model {
    /// The frames that are sent over a link, in source order.
    pub fn frames_out(&self, link: usize) -> impl Iterator<Item = &Frame> {
        (self.frames.iter())
            .filter(move |frame| frame.link == link && frame.direction == Direction::Out)
    }
}

/// How a container lists an event. `in` and `out` can both hold; neither is a local event.
#[derive(Clone, Debug)]
pub struct ContainerEvent {
    /// Index into [`Model::events`].
    pub event: usize,
    /// Forwarded down into this container.
    pub forwarded_in: bool,
    /// Forwarded up out of this container.
    pub forwarded_out: bool,
    /// The (first) declaration.
    pub span: Span,
}

/// A container, or the machine.
#[derive(Clone, Debug)]
pub struct Container {
    /// Name.
    pub name: String,
    /// Whether it is the machine.
    pub is_machine: bool,
    /// Events that it sees, in source order.
    pub events: Vec<ContainerEvent>,
    /// Flags in source order.
    pub flags: Vec<Flag>,
    /// Data ports in source order.
    pub data: Vec<DataPort>,
    /// Regions in source order.
    pub regions: Vec<Region>,
    /// Data paths in source order.
    pub paths: Vec<Path>,
    /// What the `///` lines before the declaration say, a line each; empty without any.
    pub docs: String,
    /// The name in the declaration.
    pub span: Span,
}

/// A region: one thread of control of its container.
#[derive(Clone, Debug)]
pub struct Region {
    /// Name.
    pub name: String,
    /// States in source order; `initial` and `final` are not among them.
    pub states: Vec<State>,
    /// Transitions in source order, of all sources.
    pub transitions: Vec<Transition>,
    /// What the `///` lines before the declaration say, a line each; empty without any.
    pub docs: String,
    /// The name in the declaration.
    pub span: Span,
}

/// A local state of a region.
#[derive(Clone, Debug)]
pub struct State {
    /// Name, unique in its region.
    pub name: String,
    /// What kind of state it is.
    pub kind: StateKind,
    /// Timeout in microseconds.
    pub timeout_us: Option<u32>,
    /// What the `///` lines before the declaration say, a line each; empty without any.
    pub docs: String,
    /// The name in the declaration.
    pub span: Span,
    /// The whole declaration, from its word on: where things that concern the whole state are
    /// reported.
    pub declaration: Span,
}

/// Kind of a state.
#[derive(Clone, Debug)]
pub enum StateKind {
    /// Simple state.
    Simple,
    /// Task state: an instance of a task.
    Task {
        /// Index into [`Model::tasks`].
        task: usize,
        /// Its slot, from the state or else from the task.
        slot: SlotRef,
        /// One value for each parameter of the task, in the task's order.
        params: Vec<Value>,
    },
    /// Superstate: an instance of a container.
    Super {
        /// Index into [`Model::containers`].
        container: usize,
    },
}

/// Where a transition starts.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Source {
    /// The initial pseudo-state.
    Initial,
    /// Index into [`Region::states`].
    State(usize),
}

/// Where a transition ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Target {
    /// The final pseudo-state.
    Final,
    /// Index into [`Region::states`].
    State(usize),
}

/// What triggers a transition.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Trigger {
    /// The pulse; a transition without `on` too.
    Pulse,
    /// `on *`: the pulse, guarded by the exit flag of the source. [`Transition::guard`] is then
    /// `None`.
    Star,
    /// Index into [`Model::events`].
    Event(usize),
}

/// A guard.
#[derive(Clone, Debug, PartialEq)]
pub enum Guard {
    /// Exit flag of the source.
    Exit,
    /// Timeout flag of the source.
    Timeout,
    /// Busy flag of the source.
    Busy,
    /// `.F`: index into the flags of the source's task or container.
    Own(usize),
    /// `^F`: index into the flags of the container in which the transition is written.
    Parent(usize),
    /// `not`
    Not(Box<Guard>),
    /// `and`, two or more terms
    And(Vec<Guard>),
    /// `or`, two or more terms
    Or(Vec<Guard>),
}

/// An action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// `send E`: index into [`Model::events`].
    Send(usize),
    /// `set .F` / `clear .F`: index into the flags of the target's task or container.
    Own(usize, bool),
    /// `set ^F` / `clear ^F`: index into the flags of the container in which the transition is
    /// written.
    Parent(usize, bool),
}

/// A transition.
#[derive(Clone, Debug)]
pub struct Transition {
    /// Source.
    pub source: Source,
    /// Target.
    pub target: Target,
    /// Trigger.
    pub trigger: Trigger,
    /// Guard, where one is written.
    pub guard: Option<Guard>,
    /// Actions in source order.
    pub actions: Vec<Action>,
    /// The whole transition.
    pub span: Span,
}

/// One end of a data path, resolved.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PathEnd {
    /// Index into [`Container::data`] of the container that holds the path.
    Container {
        /// Index into [`Container::data`].
        port: usize,
    },
    /// A port of a task state or superstate of that container.
    State {
        /// Index into [`Container::regions`].
        region: usize,
        /// Index into [`Region::states`].
        state: usize,
        /// Index into the data ports of the state's task or container.
        port: usize,
    },
}

/// A data path: all its ends belong to one net.
#[derive(Clone, Debug)]
pub struct Path {
    /// Ends before the arrow.
    pub from: Vec<PathEnd>,
    /// Ends behind the arrow.
    pub to: Vec<PathEnd>,
    /// The whole path.
    pub span: Span,
}
