//! The syntax tree: what a file says, before anything is looked up.
//!
//! A tree is made of every text, however wrong. What could not be read is `None` or
//! [`Given::Broken`], so that later passes say nothing about it. Names are spans: their text is in
//! the file.

use crate::model::{Direction, ParamType, Span};

/// A name where it stands. Its text is what the span covers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Name(pub Span);

/// Something that may be absent, or there but unreadable (and then already reported).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Given<T> {
    /// It is not there.
    #[default]
    Absent,
    /// It is there and wrong.
    Broken,
    /// It is there.
    Value(T),
}

impl<T> Given<T> {
    /// What was read of something that is there.
    pub fn from_read(read: Option<T>) -> Self {
        read.map_or(Given::Broken, Given::Value)
    }

    /// Whether it is there, readable or not.
    pub fn is_given(&self) -> bool {
        !matches!(self, Given::Absent)
    }

    /// The value, if it is there and readable.
    pub fn value(self) -> Option<T> {
        match self {
            Given::Value(value) => Some(value),
            Given::Absent | Given::Broken => None,
        }
    }
}

/// A file. Each kind of declaration is in source order.
#[derive(Clone, Debug, Default)]
pub struct File {
    /// `use`
    pub uses: Vec<Use>,
    /// `interpreter slot`
    pub interpreters: Vec<Interpreter>,
    /// `queue`
    pub queues: Vec<Queue>,
    /// `slot`
    pub slots: Vec<Slot>,
    /// `task`
    pub tasks: Vec<Task>,
    /// `container` and `machine`
    pub containers: Vec<Container>,
    /// `link`
    pub links: Vec<Link>,
    /// `frame`
    pub frames: Vec<Frame>,
    /// Names in what had to be skipped between the declarations: nobody may call them unknown.
    pub skipped: Vec<Name>,
    /// Whether a comment that is never closed hides the rest of it.
    pub is_cut: bool,
    /// Whether something in it was not understood, or its end is missing: there may be more than
    /// what is here.
    pub has_gaps: bool,
}

/// `use "path";`
#[derive(Clone, Copy, Debug)]
pub struct Use {
    /// The whole, from the word on.
    pub span: Span,
    /// What stands between the quotation marks.
    pub path: Option<Span>,
}

/// A number where it stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Number {
    /// Its value.
    pub value: u32,
    /// The digits.
    pub span: Span,
}

/// `interpreter slot 1;`
#[derive(Clone, Copy, Debug)]
pub struct Interpreter {
    /// The whole, from the word on.
    pub span: Span,
    /// Number of the slot.
    pub slot: Option<Number>,
}

/// `queue 32;`
#[derive(Clone, Copy, Debug)]
pub struct Queue {
    /// The whole, from the word on.
    pub span: Span,
    /// The capacity, 1 to 255.
    pub capacity: Option<u8>,
}

/// How often a slot occurs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rate {
    /// `period 10 ms`, in microseconds, above 0.
    PeriodUs(u32),
    /// `rate 100 Hz`, above 0.
    Hertz(u32),
}

/// `slot 1 period 10 ms duration 1 ms;`
#[derive(Clone, Copy, Debug)]
pub struct Slot {
    /// The `///` lines before it.
    pub docs: Option<Span>,
    /// The whole, from the word on.
    pub span: Span,
    /// Its number, 1 or above.
    pub number: Option<Number>,
    /// How often it occurs.
    pub rate: Option<Rate>,
    /// How long it lasts, in microseconds.
    pub duration_us: Option<u32>,
}

/// `task Cruise slot 2 { … }`
#[derive(Clone, Debug)]
pub struct Task {
    /// The `///` lines before it.
    pub docs: Option<Span>,
    /// From the word to the brace.
    pub span: Span,
    /// Its name.
    pub name: Option<Name>,
    /// `slot 2`
    pub slot: Given<Number>,
    /// `wcet 100 us`, in microseconds.
    pub wcet_us: Given<u32>,
    /// `exclusive motor`
    pub exclusive: Given<Name>,
    /// `count 2`
    pub count: Given<u32>,
    /// `endless`
    pub endless: bool,
    /// Its data ports.
    pub data: Vec<DataPort>,
    /// Its flags.
    pub flags: Vec<Flag>,
    /// Its parameters.
    pub params: Vec<Param>,
    /// Names in what had to be skipped.
    pub skipped: Vec<Name>,
    /// Whether a comment that is never closed hides the rest of it.
    pub is_cut: bool,
    /// Whether something in it was not understood, or its end is missing: there may be more than
    /// what is here.
    pub has_gaps: bool,
}

/// `in data ranges: Ranges optional within 500 ms;`
#[derive(Clone, Copy, Debug)]
pub struct DataPort {
    /// The `///` lines before it.
    pub docs: Option<Span>,
    /// The whole, from the direction on.
    pub span: Span,
    /// Direction, seen from the owner.
    pub direction: Direction,
    /// Its name.
    pub name: Option<Name>,
    /// Name of its type.
    pub type_name: Option<Name>,
    /// Whether it may stay open.
    pub optional: bool,
    /// `within 500 ms`, in microseconds.
    pub within_us: Given<u32>,
}

/// `out flag near;`
#[derive(Clone, Copy, Debug)]
pub struct Flag {
    /// The `///` lines before it.
    pub docs: Option<Span>,
    /// The whole, from the direction on.
    pub span: Span,
    /// `In` or `Out`; `None` where that is broken.
    pub direction: Option<Direction>,
    /// Its name.
    pub name: Option<Name>,
}

/// `param speed: f32 = 0.25 min 0 max 0.5;`
#[derive(Clone, Copy, Debug)]
pub struct Param {
    /// The `///` lines before it.
    pub docs: Option<Span>,
    /// The whole, from the word on.
    pub span: Span,
    /// Its name.
    pub name: Option<Name>,
    /// Its type.
    pub param_type: Option<ParamType>,
    /// Default value.
    pub default: Given<Literal>,
    /// Least and greatest value.
    pub range: Given<(Literal, Literal)>,
}

/// A literal. Its text (without the sign) is what the span covers from its last token on; it is
/// read when its type is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Literal {
    /// What it looks like.
    pub kind: LiteralKind,
    /// Whether a `-` stands before it.
    pub negative: bool,
    /// The digits or the word, without the sign.
    pub digits: Span,
    /// The whole, with the sign.
    pub span: Span,
}

/// What a literal looks like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LiteralKind {
    /// `true`, `false`
    Bool(bool),
    /// Digits alone.
    Integer,
    /// Digits with a point or an exponent.
    Float,
}

/// `link radio rate 115200 bps header 4 bytes;`
#[derive(Clone, Copy, Debug)]
pub struct Link {
    /// The `///` lines before it.
    pub docs: Option<Span>,
    /// The whole, from the word on.
    pub span: Span,
    /// Its name.
    pub name: Option<Name>,
    /// `rate 115200 bps`
    pub rate_bps: Given<Number>,
    /// `header 4 bytes`
    pub header_bytes: Given<Number>,
    /// `gap 1 ms`, in microseconds.
    pub gap_us: Given<u32>,
    /// `bits 10`
    pub bits: Given<Number>,
}

/// `frame pose 7 out on radio: Pose payload 12 bytes period 100 ms;`
#[derive(Clone, Debug)]
pub struct Frame {
    /// The `///` lines before it.
    pub docs: Option<Span>,
    /// The whole, from the word on.
    pub span: Span,
    /// Its name.
    pub name: Option<Name>,
    /// Its identifier.
    pub number: Option<Number>,
    /// `In` or `Out`; `None` where that is broken.
    pub direction: Option<Direction>,
    /// The link that it crosses.
    pub link: Option<Name>,
    /// What it carries.
    pub content: Given<FrameContent>,
    /// `payload 12 bytes`
    pub payload_bytes: Given<Number>,
    /// `period 100 ms` or `rate 10 Hz`
    pub rate: Given<Rate>,
    /// `late 300 ms`, in microseconds.
    pub late_us: Given<u32>,
    /// The word `late`.
    pub late_word: Option<Span>,
}

/// What a frame carries.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum FrameContent {
    /// `: Pose`, the value of a data port.
    Value(Name),
    /// `flags lost, low`, the first in the lowest bit.
    Flags(Vec<Name>),
}

/// `container Escape { … }` or `machine Rover { … }`
#[derive(Clone, Debug)]
pub struct Container {
    /// The `///` lines before it.
    pub docs: Option<Span>,
    /// Whether it is a machine.
    pub is_machine: bool,
    /// From the word to the brace.
    pub span: Span,
    /// Its name.
    pub name: Option<Name>,
    /// Its events, each listing once.
    pub events: Vec<Event>,
    /// Its flags.
    pub flags: Vec<Flag>,
    /// Its data ports.
    pub data: Vec<DataPort>,
    /// Its regions.
    pub regions: Vec<Region>,
    /// Its data paths.
    pub paths: Vec<Path>,
    /// Names in what had to be skipped.
    pub skipped: Vec<Name>,
    /// Whether a comment that is never closed hides the rest of it.
    pub is_cut: bool,
    /// Whether something in it was not understood, or its end is missing: there may be more than
    /// what is here.
    pub has_gaps: bool,
}

/// How an event is listed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EventListing {
    /// `event E;`
    Local,
    /// `in event E;`
    In,
    /// `out event E;`
    Out,
}

/// One name of an event declaration.
#[derive(Clone, Copy, Debug)]
pub struct Event {
    /// The `///` lines before it.
    pub docs: Option<Span>,
    /// How it is listed.
    pub listing: EventListing,
    /// Its name.
    pub name: Option<Name>,
}

/// `region motion { … }`
#[derive(Clone, Debug)]
pub struct Region {
    /// The `///` lines before it.
    pub docs: Option<Span>,
    /// From the word to the brace.
    pub span: Span,
    /// Its name.
    pub name: Option<Name>,
    /// Its states.
    pub states: Vec<State>,
    /// Its transitions.
    pub transitions: Vec<Transition>,
    /// Whether something broken in it starts with `initial`, or was skipped and may hold one.
    pub may_have_initial: bool,
    /// Names in what had to be skipped.
    pub skipped: Vec<Name>,
    /// Whether a comment that is never closed hides the rest of it.
    pub is_cut: bool,
    /// Whether something in it was not understood, or its end is missing: there may be more than
    /// what is here.
    pub has_gaps: bool,
}

/// A state of any kind.
#[derive(Clone, Debug)]
pub struct State {
    /// The `///` lines before it.
    pub docs: Option<Span>,
    /// The whole, from the word on.
    pub span: Span,
    /// Its name.
    pub name: Option<Name>,
    /// What it is.
    pub kind: StateKind,
    /// `timeout 1 s`, in microseconds.
    pub timeout_us: Given<u32>,
}

/// What a state is.
#[derive(Clone, Debug)]
pub enum StateKind {
    /// `state A;`
    Simple,
    /// `task A: T;`
    Task {
        /// Name of the task; of the link, where it is a dispatcher.
        task: Option<Name>,
        /// `.transmit` ([`Direction::Out`]) or `.receive` ([`Direction::In`]) of a link.
        dispatcher: Given<(Direction, Name)>,
        /// `slot 2`
        slot: Given<Number>,
        /// The word `slot`.
        slot_word: Option<Span>,
        /// `with { speed = 0.3 }`
        with: Vec<(Name, Option<Literal>)>,
        /// Whether a part of `with` could not be read.
        with_broken: bool,
    },
    /// `super A: C;`
    Super {
        /// Name of the container.
        container: Option<Name>,
    },
}

/// An end of a transition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Endpoint {
    /// `initial` before the arrow, `final` behind it.
    Pseudo,
    /// A state.
    State(Name),
}

/// `A -> B on E [guard] / actions;`
#[derive(Clone, Debug)]
pub struct Transition {
    /// The whole.
    pub span: Span,
    /// Before the arrow.
    pub source: Endpoint,
    /// Behind it.
    pub target: Option<Endpoint>,
    /// `on …`
    pub trigger: Given<Trigger>,
    /// `[…]`
    pub guard: Given<GuardTerm>,
    /// `/ …`
    pub actions: Vec<Action>,
}

/// What triggers a transition.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trigger {
    /// `on pulse`
    Pulse,
    /// `on *`, with the place of the star
    Star(Span),
    /// `on E`
    Event(Name),
}

/// A guard, or a part of one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct GuardTerm {
    /// From its first to its last token; brackets are not part of it.
    pub span: Span,
    /// What it says.
    pub kind: GuardKind,
}

/// What a guard says.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum GuardKind {
    /// `exit`, `timeout`, `busy`
    System(SystemFlag),
    /// `.F`
    Own(Name),
    /// `^F`
    Parent(Name),
    /// `not`
    Not(Box<GuardTerm>),
    /// `and`, two or more terms
    And(Vec<GuardTerm>),
    /// `or`, two or more terms
    Or(Vec<GuardTerm>),
}

/// A flag that the system keeps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SystemFlag {
    /// `exit`
    Exit,
    /// `timeout`
    Timeout,
    /// `busy`
    Busy,
}

/// An action.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// `send E`
    Send(Name),
    /// `set .F`, `clear .F`
    Own(Name, bool),
    /// `set ^F`, `clear ^F`
    Parent(Name, bool),
}

/// `path A.x -> B.y;`
#[derive(Clone, Debug)]
pub struct Path {
    /// The whole, from the word on.
    pub span: Span,
    /// Ends before the arrow.
    pub from: Vec<PathEnd>,
    /// Ends behind it.
    pub to: Vec<PathEnd>,
    /// Whether a part of it could not be read.
    pub broken: bool,
}

/// An end of a data path.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PathEnd {
    /// `port`
    Container(Name),
    /// `state.port`
    State(Name, Name),
    /// `region.state.port`
    Region(Name, Name, Name),
}

impl State {
    /// What attributes can be written behind: the name of a simple state, or of what another state
    /// is made of.
    pub fn place_of_attributes(&self) -> Option<Span> {
        let name = match self.kind {
            StateKind::Simple => self.name,
            StateKind::Task {
                dispatcher: Given::Value((_, word)),
                ..
            } => Some(word),
            StateKind::Task { task, .. } => task,
            StateKind::Super { container } => container,
        };
        name.map(|name| name.0)
    }
}
