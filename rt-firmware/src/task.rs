//! What a task is: typed ports, flags and parameters around one step function.
//!
//! A task is a plain struct. [`task!`](crate::task!) declares what it is connected to, and [`Task`]
//! says what it does:
//!
//! ```
//! use rt_firmware::{Io, PortType, Step, Task, task};
//!
//! /// Distances around the robot.
//! #[derive(Clone, Copy)]
//! pub struct Ranges {
//!     /// Distance to the nearest thing ahead, in metres.
//!     pub ahead_m: f32,
//! }
//! impl PortType for Ranges {
//!     const NAME: &'static str = "Ranges";
//!     const INIT: Self = Ranges { ahead_m: f32::INFINITY };
//! }
//!
//! /// How the robot is to move.
//! #[derive(Clone, Copy)]
//! pub struct Twist {
//!     /// Forward speed in metres per second.
//!     pub forward_m_s: f32,
//! }
//! impl PortType for Twist {
//!     const NAME: &'static str = "Twist";
//!     const INIT: Self = Twist { forward_m_s: 0.0 };
//! }
//!
//! /// Drives straight ahead and tells when something is near.
//! pub struct Cruise;
//!
//! task! {
//!     impl Cruise {
//!         slot 2;
//!         wcet 200 us;
//!         exclusive motion;
//!         data {
//!             in ranges: Ranges;
//!             out command: Twist;
//!         }
//!         flags {
//!             in hurry;
//!             out near;
//!         }
//!         params {
//!             speed: f32 = 0.25, 0.0..=0.5;
//!         }
//!     }
//! }
//!
//! impl Task for Cruise {
//!     fn step(&mut self, io: &mut Io<'_>) -> Step {
//!         let ranges = io.read(Self::RANGES);
//!         let speed = io.param(Self::SPEED);
//!         let speed = if io.flag(Self::HURRY) { 2.0 * speed } else { speed };
//!         *io.write(Self::COMMAND) = Twist { forward_m_s: speed };
//!         io.set(Self::NEAR, ranges.ahead_m < 0.5);
//!         Step::Run
//!     }
//! }
//!
//! assert_eq!(
//!     <Cruise as rt_firmware::Declared>::SIGNATURE,
//!     "task Cruise{in data ranges:Ranges;out data command:Twist;in flag hurry;out flag near;param speed:f32;}"
//! );
//! ```
//!
//! Generic tasks (drivers over embedded-hal traits, most often) write their generics in brackets:
//! `task! { impl[M: SetDutyCycle] Wheel<M> { … } }`.

use core::any::TypeId;
use core::marker::PhantomData;

use crate::ports::{Io, OutputPorts, ValueKind};
use crate::show::{Field, Show};

/// Greatest number of data ports of one task.
pub const MAX_DATA_PORTS: usize = 8;
/// Greatest number of control flags of one task, `in` and `out` together.
pub const MAX_FLAGS: usize = 16;
/// Greatest number of parameters of one task.
pub const MAX_PARAMS: usize = 8;

/// A type whose values travel over nets.
///
/// Values are plain data: they are never dropped, and several tasks may look at one of them at a
/// time.
pub trait PortType: Copy + Send + Sync + 'static {
    /// The name by which `.esm` files call this type. One name stands for one Rust type, which is
    /// checked at start-up.
    const NAME: &'static str;
    /// What a buffer holds before anything was written into it.
    const INIT: Self;

    /// What it is made of, as far as that can be seen from outside: a line for each field, its
    /// name, a colon, its type. [`fields!`](crate::fields!) says this, and `show` with it.
    const FIELDS: &'static str = "";

    /// Shows the fields of a value to whoever looks at it.
    fn show(&self, show: &mut Show<'_>) {
        let _ = show;
    }
}

/// Implements [`PortType`] for the types that need no declaration of their own.
macro_rules! plain_port_type {
    ($($name:ident = $init:expr;)*) => {
        $(impl PortType for $name {
            const NAME: &'static str = stringify!($name);
            const INIT: Self = $init;
            // There is but one, which needs no name.
            const FIELDS: &'static str = concat!(":", stringify!($name), "\n");
            fn show(&self, show: &mut Show<'_>) {
                Field::show(self, show);
            }
        })*
    };
}

plain_port_type! {
    bool = false;
    i32 = 0;
    u32 = 0;
    f32 = 0.0;
}

/// A type of task: what runs when a task state of a mission is executed.
///
/// One value of the type serves one task state at a time; the robot's registry says how many there
/// are.
pub trait Task: Declared + Send {
    /// A mission starts: forget everything that an earlier mission left behind.
    fn reset(&mut self) {}

    /// The task state was entered anew; called before the first [`step`](Task::step) of each
    /// activation.
    fn enter(&mut self) {}

    /// Executes the task once. For a real-time task this is called once in each activation of its
    /// slot and must end within the slot's duration; for a task in slot 0 it is called again and
    /// again, preempted by every slot, until it returns [`Step::Finished`].
    fn step(&mut self, io: &mut Io<'_>) -> Step;
}

/// What a step says about the task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// The task goes on in the next activation of its slot.
    Run,
    /// The task has done its work: its exit flag is set and it is not executed again until its
    /// state is entered anew.
    Finished,
}

/// The way data flows through a port, or control through a flag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Into the task.
    In,
    /// Out of the task.
    Out,
    /// The task changes a value and publishes it again.
    InOut,
}

impl Direction {
    const fn word(self) -> &'static str {
        match self {
            Self::In => "in",
            Self::Out => "out",
            Self::InOut => "inout",
        }
    }
}

/// A data port as its task declares it.
#[derive(Clone, Copy, Debug)]
pub struct PortDeclaration {
    /// Name of the port.
    pub name: &'static str,
    /// [`PortType::NAME`] of the values.
    pub type_name: &'static str,
    /// The Rust type of the values.
    pub type_id: TypeId,
    /// The same for the executor.
    #[doc(hidden)]
    pub kind: ValueKind,
    /// The way data flows.
    pub direction: Direction,
    /// Whether the task is executed although the port's net holds no value.
    pub optional: bool,
    /// How old a value may be, in microseconds, where the task says so: what is older counts as
    /// none.
    pub within_us: Option<u32>,
    /// What the port is for.
    #[doc(hidden)]
    pub docs: Docs,
}

/// A control flag as its task declares it.
#[derive(Clone, Copy, Debug)]
pub struct FlagDeclaration {
    /// Name of the flag.
    pub name: &'static str,
    /// [`Direction::In`] or [`Direction::Out`].
    pub direction: Direction,
    /// What the flag is for.
    #[doc(hidden)]
    pub docs: Docs,
}

/// The type of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParamKind {
    /// `bool`
    Bool,
    /// `i32`
    I32,
    /// `u32`
    U32,
    /// `f32`
    F32,
}

impl ParamKind {
    const fn word(self) -> &'static str {
        match self {
            Self::Bool => "bool",
            Self::I32 => "i32",
            Self::U32 => "u32",
            Self::F32 => "f32",
        }
    }
}

/// A parameter as its task declares it.
#[derive(Clone, Copy, Debug)]
pub struct ParamDeclaration {
    /// Name of the parameter.
    pub name: &'static str,
    /// Its type.
    pub kind: ParamKind,
    /// Bits of its least and its greatest value, where it has bounds.
    pub bounds: Option<[u32; 2]>,
    /// What stands behind the type in `.esm` text: default value and bounds.
    pub attributes: &'static str,
    /// What the parameter is for.
    #[doc(hidden)]
    pub docs: Docs,
}

impl ParamDeclaration {
    /// Whether a value, given by its bits, is one of the type and within the bounds. NaN is within
    /// none.
    pub fn admits(&self, bits: u32) -> bool {
        let Some([least, greatest]) = self.bounds else {
            return self.kind != ParamKind::Bool || bits <= 1;
        };
        match self.kind {
            ParamKind::F32 => {
                (f32::from_bits(least)..=f32::from_bits(greatest)).contains(&f32::from_bits(bits))
            }
            ParamKind::I32 => {
                (least.cast_signed()..=greatest.cast_signed()).contains(&bits.cast_signed())
            }
            ParamKind::U32 | ParamKind::Bool => (least..=greatest).contains(&bits),
        }
    }
}

/// Everything that a task type declares about itself.
#[derive(Clone, Copy, Debug)]
pub struct Declaration {
    /// Name of the task type.
    pub name: &'static str,
    /// Data ports in declaration order.
    pub ports: &'static [PortDeclaration],
    /// Control flags in declaration order.
    pub flags: &'static [FlagDeclaration],
    /// Parameters in declaration order.
    pub params: &'static [ParamDeclaration],
    /// FNV-1a hash of the signature's text, [`Declared::SIGNATURE`].
    pub signature_hash: u64,
    /// The task never finishes.
    pub endless: bool,
    /// What stands behind the name in `.esm` text: default slot, execution time, group, `endless`.
    pub attributes: &'static str,
    /// What the task is for.
    #[doc(hidden)]
    pub docs: Docs,
}

/// What something is for, as lines of `.esm` text with their ends.
#[cfg(feature = "docs")]
#[doc(hidden)]
#[derive(Clone, Copy, Debug)]
pub struct Docs(pub &'static str);

/// What something is for: a firmware without the feature `docs` does not say it.
#[cfg(not(feature = "docs"))]
#[doc(hidden)]
#[derive(Clone, Copy, Debug)]
pub struct Docs;

impl Docs {
    const fn text(self) -> &'static str {
        #[cfg(feature = "docs")]
        let Docs(text) = self;
        #[cfg(not(feature = "docs"))]
        let text = "";
        text
    }
}

/// Tells a number in decimal, digit by digit.
fn tell_number(number: u32, tell: &mut dyn FnMut(&[u8])) {
    const MAX_DIGITS: u32 = u32::MAX.ilog10() + 1;
    for place in (0..MAX_DIGITS).rev() {
        let unit = 10u32.pow(place);
        if unit == 1 || unit <= number {
            tell(&[b'0' + (number / unit % 10) as u8]);
        }
    }
}

impl Declaration {
    /// Whether `text` is this task's [signature](Declared::SIGNATURE), to the byte.
    ///
    /// It is put together from the declaration's parts, piece by piece: a second copy of all names
    /// would cost a small robot kilobytes of flash.
    pub fn has_signature(&self, text: &[u8]) -> bool {
        let mut text = Unread(text);
        let mut same = text.starts(&["task ", self.name, "{"]);
        for port in self.ports {
            let optional = if port.optional { " optional" } else { "" };
            let direction = port.direction.word();
            let pieces = [
                direction,
                " data ",
                port.name,
                ":",
                port.type_name,
                optional,
            ];
            same = same && text.starts(&pieces);
            if let Some(within_us) = port.within_us {
                same = same && text.starts(&[" within "]) && text.starts_with_number(within_us);
            }
            same = same && text.starts(&[";"]);
        }
        for flag in self.flags {
            same = same && text.starts(&[flag.direction.word(), " flag ", flag.name, ";"]);
        }
        for param in self.params {
            same = same && text.starts(&["param ", param.name, ":", param.kind.word(), ";"]);
        }
        same && text.0 == b"}"
    }

    /// Tells the declaration as `.esm` text, piece by piece, with what it is for, default slot,
    /// ranges and default values. `count` is how many of the task a firmware has room for.
    pub fn tell_source(&self, count: u32, tell: &mut dyn FnMut(&[u8])) {
        let mut texts = |pieces: &[&str], number: Option<u32>, end: &str| {
            pieces.iter().for_each(|piece| tell(piece.as_bytes()));
            if let Some(number) = number {
                tell_number(number, tell);
            }
            tell(end.as_bytes());
        };
        let head = [
            self.docs.text(),
            "task ",
            self.name,
            self.attributes,
            " count ",
        ];
        texts(&head, Some(count), " {\n");
        for port in self.ports {
            let optional = if port.optional { " optional" } else { "" };
            let (within, time, unit) = match port.within_us {
                None => ("", None, ""),
                Some(us) if us % 1_000_000 == 0 => (" within ", Some(us / 1_000_000), " s"),
                Some(us) if us % 1_000 == 0 => (" within ", Some(us / 1_000), " ms"),
                Some(us) => (" within ", Some(us), " us"),
            };
            let direction = port.direction.word();
            let names = ["    ", direction, " data ", port.name, ": ", port.type_name];
            texts(&[port.docs.text()], None, "");
            texts(&names, None, optional);
            texts(&[within], time, unit);
            texts(&[";\n"], None, "");
        }
        for flag in self.flags {
            let pieces = [
                flag.docs.text(),
                "    ",
                flag.direction.word(),
                " flag ",
                flag.name,
            ];
            texts(&pieces, None, ";\n");
        }
        for param in self.params {
            let pieces = [
                param.docs.text(),
                "    param ",
                param.name,
                ": ",
                param.kind.word(),
                param.attributes,
            ];
            texts(&pieces, None, ";\n");
        }
        texts(&["}\n"], None, "");
    }
}

/// What of a text has not been compared yet.
struct Unread<'a>(&'a [u8]);

impl Unread<'_> {
    /// Takes these pieces from the start; false if the text does not start with them.
    fn starts(&mut self, pieces: &[&str]) -> bool {
        pieces.iter().all(|piece| {
            let rest = self.0.strip_prefix(piece.as_bytes());
            self.0 = rest.unwrap_or_default();
            rest.is_some()
        })
    }

    /// Takes this number in decimal from the start; false if the text does not start with it.
    fn starts_with_number(&mut self, number: u32) -> bool {
        const MAX_DIGITS: u32 = u32::MAX.ilog10() + 1;
        (0..MAX_DIGITS)
            .rev()
            .map(|place| 10u32.pow(place))
            .filter(|unit| *unit == 1 || *unit <= number)
            .all(|unit| {
                let digit = b'0' + (number / unit % 10) as u8;
                let rest = self.0.strip_prefix(&[digit]);
                self.0 = rest.unwrap_or_default();
                rest.is_some()
            })
    }
}

/// A type with a declaration; implemented by [`task!`](crate::task!).
pub trait Declared {
    /// Canonical text of the signature, which blobs are compiled against. A robot does not keep it:
    /// see [`Declaration::has_signature`].
    const SIGNATURE: &'static str;
    /// What the type declares.
    const DECLARATION: Declaration;
    /// Buffers of the data ports; made of [`Buffered`](crate::ports::Buffered) and
    /// [`Unbuffered`](crate::ports::Unbuffered) in port order.
    type Outputs: OutputPorts;
}

/// The declaration of a task type.
pub const fn declaration_of<T: Declared>() -> &'static Declaration {
    const { &T::DECLARATION }
}

/// Declares a handle type: a place in a task's list of ports, flags or parameters, with the type of
/// what is there.
macro_rules! handle {
    ($(#[$doc:meta])* $name:ident) => {
        $(#[$doc])*
        pub struct $name<T> {
            pub(crate) index: u8,
            of: PhantomData<fn() -> T>,
        }

        impl<T> $name<T> {
            /// The handle with the given place in the declaration; [`task!`](crate::task!) makes
            /// these.
            #[doc(hidden)]
            pub const fn at(index: u8) -> Self {
                Self { index, of: PhantomData }
            }
        }

        impl<T> Clone for $name<T> {
            fn clone(&self) -> Self {
                *self
            }
        }

        impl<T> Copy for $name<T> {}
    };
}

handle! {
    /// A data port that the task reads. The task is executed only while there is a value.
    In
}
handle! {
    /// A data port that the task reads if there is a value.
    OptIn
}
handle! {
    /// A data port that the task writes.
    Out
}
handle! {
    /// A data port whose value the task changes and publishes again. The task is executed only
    /// while there is a value.
    InOut
}
handle! {
    /// A data port whose value, if there is one, the task changes and publishes again.
    OptInOut
}
handle! {
    /// A parameter, constant as long as a mission runs.
    Param
}

/// A control flag that transitions set and the task reads.
#[derive(Clone, Copy)]
pub struct InFlag {
    pub(crate) index: u8,
}

/// A control flag that the task sets and transitions read.
#[derive(Clone, Copy)]
pub struct OutFlag {
    pub(crate) index: u8,
}

impl InFlag {
    /// The flag with the given place in the declaration; [`task!`](crate::task!) makes these.
    #[doc(hidden)]
    pub const fn at(index: u8) -> Self {
        Self { index }
    }
}

impl OutFlag {
    /// The flag with the given place in the declaration; [`task!`](crate::task!) makes these.
    #[doc(hidden)]
    pub const fn at(index: u8) -> Self {
        Self { index }
    }
}

/// A type that a parameter can have.
pub trait ParamType: Copy {
    /// The type as declarations name it.
    const KIND: ParamKind;
    /// The value whose bits these are.
    fn from_bits(bits: u32) -> Self;
    /// The bits of the value, as blobs carry them.
    fn to_bits(self) -> u32;
}

impl ParamType for bool {
    const KIND: ParamKind = ParamKind::Bool;
    fn from_bits(bits: u32) -> Self {
        bits != 0
    }
    fn to_bits(self) -> u32 {
        u32::from(self)
    }
}

impl ParamType for i32 {
    const KIND: ParamKind = ParamKind::I32;
    fn from_bits(bits: u32) -> Self {
        bits.cast_signed()
    }
    fn to_bits(self) -> u32 {
        self.cast_unsigned()
    }
}

impl ParamType for u32 {
    const KIND: ParamKind = ParamKind::U32;
    fn from_bits(bits: u32) -> Self {
        bits
    }
    fn to_bits(self) -> u32 {
        self
    }
}

impl ParamType for f32 {
    const KIND: ParamKind = ParamKind::F32;
    fn from_bits(bits: u32) -> Self {
        f32::from_bits(bits)
    }
    fn to_bits(self) -> u32 {
        f32::to_bits(self)
    }
}

/// The place of `name` in a list of names, at compile time.
#[doc(hidden)]
pub const fn place_of(names: &[&str], name: &str) -> u8 {
    let mut place = 0;
    while place < names.len() {
        if same_text(names[place], name) {
            assert!(place <= u8::MAX as usize);
            return place as u8;
        }
        place += 1;
    }
    panic!("the declaration has no such name")
}

/// Whether two texts are equal, at compile time.
#[doc(hidden)]
pub const fn same_text(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    if a.len() != b.len() {
        return false;
    }
    let mut i = 0;
    while i < a.len() {
        if a[i] != b[i] {
            return false;
        }
        i += 1;
    }
    true
}

/// Whether Rust's way to write a literal is the language's too, at compile time: no `_`, no suffix,
/// no exponent.
#[doc(hidden)]
pub const fn is_esm_literal(text: &str) -> bool {
    if same_text(text, "true") || same_text(text, "false") {
        return true;
    }
    let mut rest = text.as_bytes();
    while let [first, tail @ ..] = rest {
        if !matches!(first, b'0'..=b'9' | b'.' | b'-') {
            return false;
        }
        rest = tail;
    }
    true
}

/// The longest time that a mission may state, in microseconds.
const LONGEST_US: u64 = 4_000_000_000;

/// A time in microseconds, at compile time.
#[doc(hidden)]
pub const fn microseconds(time: u64, unit: &str) -> u32 {
    let unit_us = if same_text(unit, "us") {
        1
    } else if same_text(unit, "ms") {
        1_000
    } else if same_text(unit, "s") {
        1_000_000
    } else {
        panic!("the units of time are us, ms and s")
    };
    assert!(time <= LONGEST_US / unit_us, "a time is at most 4000 s");
    (time * unit_us) as u32
}

/// Hash of a signature, at compile time.
#[doc(hidden)]
pub const fn signature_hash(text: &str) -> u64 {
    esm_core::signature::fnv1a(text.as_bytes())
}

/// Declares the ports, flags and parameters of a task type; see [the module](mod@crate::task) for
/// an example.
///
/// ```text
/// task! {
///     /// What it is for.                     // optional, for each port, flag and parameter, too
///     impl NAME {                             // or: impl[M: SetDutyCycle] NAME<M> {
///         slot 2;                             // optional: what `esm tasks` suggests
///         wcet 500 us;                        // optional
///         exclusive GROUP;                    // optional
///         endless;                            // optional: it never finishes
///         monitor;                            // optional: it says something in each execution
///         data   { in a: A; in b: B optional within 100 ms; out c: C; inout d: D; }
///         flags  { in go; out near; }
///         params { speed: f32 = 0.25, 0.0..=0.5; limit: u32; }
///     }
/// }
/// ```
///
/// A port that is `within` a time, in `us`, `ms` or `s`, has no value where the last one is older.
///
/// A flag has no age. So a task on whose flags the robot's safety rests says `monitor;`: in each
/// execution it sets or clears a flag, writes an output, or calls [`Io::beat`]. Where it does
/// nothing of that [`SILENT_EXECUTIONS`](crate::ports::SILENT_EXECUTIONS) times in a row, it is
/// taken for broken, and the robot goes to its safe state. A mission does not see this in the
/// task's declaration.
///
/// What the comments with three slashes say is for those who write missions: `esm tasks` prints it.
/// A firmware that is built without the feature `docs` has no room for it.
///
/// Sections that have nothing in them are left out. Each name becomes an associated constant in
/// upper case (`NAME::SPEED`) of the handle type that [`Io`] asks for. The name of a port's type is
/// its [`PortType::NAME`].
#[macro_export]
macro_rules! task {
    (
        $(#[doc = $doc:literal])*
        impl $([$($generics:tt)*])? $name:ident $(<$($argument:tt),+ $(,)?>)? {
            $(slot $slot:literal;)?
            $(wcet $wcet:literal $wcet_unit:ident;)?
            $(exclusive $group:ident;)?
            $(endless $endless:tt)?
            $(monitor $monitor:tt)?
            $(data { $($(#[doc = $port_doc:literal])* $direction:ident $port:ident : $port_type:ident $($attribute:ident $($time:literal $unit:ident)?)* ;)* })?
            $(flags { $($(#[doc = $flag_doc:literal])* $flag_direction:ident $flag:ident ;)* })?
            $(params { $($(#[doc = $param_doc:literal])* $param:ident : $param_type:ident $(= $default:literal)? $(, $min:literal ..= $max:literal)? ;)* })?
        }
    ) => {
        $crate::pastey::paste! {
            impl $(<$($generics)*>)? $name $(<$($argument),+>)? {
                $($(
                    #[doc = concat!("Data port `", stringify!($port), "`.")]
                    $(#[doc = $port_doc])*
                    pub const [<$port:upper>]: $crate::__task_port!($direction $port_type $($attribute)*) =
                        <$crate::__task_port!($direction $port_type $($attribute)*)>::at(
                            $crate::task::place_of(Self::__PORT_NAMES, stringify!($port)),
                        );
                )*)?
                $($(
                    #[doc = concat!("Control flag `", stringify!($flag), "`.")]
                    $(#[doc = $flag_doc])*
                    pub const [<$flag:upper>]: $crate::__task_flag!($flag_direction) =
                        <$crate::__task_flag!($flag_direction)>::at(
                            $crate::task::place_of(Self::__FLAG_NAMES, stringify!($flag)),
                        );
                )*)?
                $($(
                    #[doc = concat!("Parameter `", stringify!($param), "`.")]
                    $(#[doc = $param_doc])*
                    pub const [<$param:upper>]: $crate::task::Param<$param_type> = $crate::task::Param::at(
                        $crate::task::place_of(Self::__PARAM_NAMES, stringify!($param)),
                    );
                )*)?
                #[allow(dead_code)]
                const __PORT_NAMES: &'static [&'static str] = &[$($(stringify!($port),)*)?];
                #[allow(dead_code)]
                const __FLAG_NAMES: &'static [&'static str] = &[$($(stringify!($flag),)*)?];
                #[allow(dead_code)]
                const __PARAM_NAMES: &'static [&'static str] = &[$($(stringify!($param),)*)?];
            }
        }

        impl $(<$($generics)*>)? $crate::task::Declared for $name $(<$($argument),+>)? {
            const SIGNATURE: &'static str = concat!(
                "task ", stringify!($name), "{",
                $($(stringify!($direction), " data ", stringify!($port), ":", stringify!($port_type), $(" ", stringify!($attribute), $(" ", $crate::__task_us!($time $unit),)?)* ";",)*)?
                $($(stringify!($flag_direction), " flag ", stringify!($flag), ";",)*)?
                $($("param ", stringify!($param), ":", stringify!($param_type), ";",)*)?
                "}"
            );
            const DECLARATION: $crate::task::Declaration = {
                $($(
                    assert!(
                        $crate::task::same_text(<$port_type as $crate::task::PortType>::NAME, stringify!($port_type)),
                        "a port's type is written as its PortType::NAME"
                    );
                    $crate::__task_attributes!($direction $($attribute $($time $unit)?)*);
                )*)?
                $($(
                    $(assert!($crate::task::is_esm_literal(stringify!($default)), "a default is written as in a mission: 2000, not 2_000u32");)?
                    $(
                        assert!($crate::task::is_esm_literal(stringify!($min)), "bounds are written as in a mission");
                        assert!($crate::task::is_esm_literal(stringify!($max)), "bounds are written as in a mission");
                    )?
                )*)?
                assert!(Self::__PORT_NAMES.len() <= $crate::task::MAX_DATA_PORTS, "too many data ports");
                assert!(Self::__FLAG_NAMES.len() <= $crate::task::MAX_FLAGS, "too many flags");
                assert!(Self::__PARAM_NAMES.len() <= $crate::task::MAX_PARAMS, "too many parameters");
                $crate::task::Declaration {
                    name: stringify!($name),
                    ports: &[$($(
                        $crate::task::PortDeclaration {
                            name: stringify!($port),
                            type_name: stringify!($port_type),
                            type_id: ::core::any::TypeId::of::<$port_type>(),
                            kind: $crate::ports::ValueKind::of::<$port_type>(),
                            direction: $crate::__task_direction!($direction),
                            optional: false $(|| $crate::task::same_text(stringify!($attribute), "optional"))*,
                            within_us: $crate::__task_within!($($($time $unit)?)*),
                            docs: $crate::__task_docs!("    " $($port_doc)*),
                        },
                    )*)?],
                    flags: &[$($(
                        $crate::task::FlagDeclaration {
                            name: stringify!($flag),
                            direction: $crate::__task_direction!($flag_direction),
                            docs: $crate::__task_docs!("    " $($flag_doc)*),
                        },
                    )*)?],
                    params: &[$($(
                        $crate::task::ParamDeclaration {
                            name: stringify!($param),
                            kind: <$param_type as $crate::task::ParamType>::KIND,
                            bounds: $crate::__task_bounds!($param_type $($min $max)?),
                            attributes: concat!(
                                $(" = ", stringify!($default),)? $(" min ", stringify!($min), " max ", stringify!($max),)?
                            ),
                            docs: $crate::__task_docs!("    " $($param_doc)*),
                        },
                    )*)?],
                    signature_hash: $crate::task::signature_hash(<Self as $crate::task::Declared>::SIGNATURE),
                    endless: false $(|| $crate::__task_endless!($endless))?,
                    attributes: concat!(
                        $(" slot ", stringify!($slot),)?
                        $(" wcet ", stringify!($wcet), " ", stringify!($wcet_unit),)?
                        $(" exclusive ", stringify!($group),)?
                        $($crate::__task_endless!($endless " endless"),)?
                    ),
                    docs: $crate::__task_docs!("" $($doc)*),
                }
            };
            type Outputs = $crate::__task_outputs!(
                ($crate::__task_last!($($monitor)?)); [$($($direction $port_type,)*)?] $($($direction $port_type,)*)?
            );
        }
    };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __task_port {
    (out $type:ident) => { $crate::task::Out<$type> };
    (in $type:ident optional $(within)?) => { $crate::task::OptIn<$type> };
    (in $type:ident $(within)?) => { $crate::task::In<$type> };
    (inout $type:ident optional $(within)?) => { $crate::task::OptInOut<$type> };
    (inout $type:ident $(within)?) => { $crate::task::InOut<$type> };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __task_flag {
    (in) => {
        $crate::task::InFlag
    };
    (out) => {
        $crate::task::OutFlag
    };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __task_direction {
    (in) => {
        $crate::task::Direction::In
    };
    (out) => {
        $crate::task::Direction::Out
    };
    (inout) => {
        $crate::task::Direction::InOut
    };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __task_bounds {
    ($type:ident) => {
        None
    };
    (f32 $min:literal $max:literal) => {
        // Casts, since `0..=5` is a range of f32 too where it is written in a mission.
        Some([f32::to_bits($min as f32), f32::to_bits($max as f32)])
    };
    (i32 $min:literal $max:literal) => {
        Some([i32::cast_unsigned($min), i32::cast_unsigned($max)])
    };
    (u32 $min:literal $max:literal) => {
        Some([$min, $max])
    };
    (bool $min:literal $max:literal) => {
        Some([$min as u32, $max as u32])
    };
}

/// What stands for `endless;`.
#[doc(hidden)]
#[macro_export]
macro_rules! __task_endless {
    (;) => {
        true
    };
    (; $text:literal) => {
        $text
    };
}

/// The lines that say what something is for.
#[cfg(feature = "docs")]
#[doc(hidden)]
#[macro_export]
macro_rules! __task_docs {
    ($indent:literal $($doc:literal)*) => {
        $crate::task::Docs(concat!($($indent, "///", $doc, "\n",)*))
    };
}

/// No lines that say what something is for.
#[cfg(not(feature = "docs"))]
#[doc(hidden)]
#[macro_export]
macro_rules! __task_docs {
    ($indent:literal $($doc:literal)*) => {
        $crate::task::Docs
    };
}

/// What may stand behind a data port, in this order.
#[doc(hidden)]
#[macro_export]
macro_rules! __task_attributes {
    ($direction:tt) => {};
    (in optional) => {};
    (inout optional) => {};
    (in $(optional)? within $time:literal $unit:ident) => {
        assert!($time > 0, "a time is above 0");
        assert!(
            $crate::task::is_esm_literal(stringify!($time)),
            "a time is written as in a mission: 2000 ms, not 2_000 ms"
        );
    };
    (inout $(optional)? within $time:literal $unit:ident) => {
        assert!($time > 0, "a time is above 0");
        assert!(
            $crate::task::is_esm_literal(stringify!($time)),
            "a time is written as in a mission: 2000 ms, not 2_000 ms"
        );
    };
}

/// A time in microseconds, as a text.
#[doc(hidden)]
#[macro_export]
macro_rules! __task_us {
    ($time:literal us) => {
        $time
    };
    ($time:literal ms) => {
        concat!($time, "000")
    };
    ($time:literal s) => {
        concat!($time, "000000")
    };
}

/// The time of a port's `within`, if it has one.
#[doc(hidden)]
#[macro_export]
macro_rules! __task_within {
    () => {
        None
    };
    ($time:literal $unit:ident) => {
        Some($crate::task::microseconds($time, stringify!($unit)))
    };
}

#[doc(hidden)]
#[macro_export]
macro_rules! __task_outputs {
    (($last:ty); [$($all:tt)*]) => { $last };
    (($last:ty); [$($all:tt)*] in $type:ident, $($rest:tt)*) => {
        ($crate::ports::Unbuffered, $crate::__task_outputs!(($last); [$($all)*] $($rest)*))
    };
    (($last:ty); [$($all_direction:tt $all_type:ident,)*] $direction:tt $type:ident, $($rest:tt)*) => {
        (
            $crate::ports::Buffered<$type, {
                $crate::ports::buffers_for(stringify!($direction), stringify!($type), &[$((stringify!($all_direction), stringify!($all_type))),*])
            }>,
            $crate::__task_outputs!(($last); [$($all_direction $all_type,)*] $($rest)*)
        )
    };
}

/// What stands behind the last port's buffers.
#[doc(hidden)]
#[macro_export]
macro_rules! __task_last {
    () => {
        ()
    };
    (;) => {
        $crate::ports::Silence
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Clone, Copy)]
    struct Scan;
    impl PortType for Scan {
        const NAME: &'static str = "Scan";
        const INIT: Self = Scan;
    }

    #[derive(Clone, Copy)]
    struct Twist;
    impl PortType for Twist {
        const NAME: &'static str = "Twist";
        const INIT: Self = Twist;
    }

    struct Everything<A, B> {
        _owned: (A, B),
    }

    task! {
        /// Has all that a task can have.
        ///
        /// And "more".
        impl[A: Send, B: Send + Copy] Everything<A, B> {
            slot 3;
            wcet 1 ms;
            exclusive motion;
            endless;
            data {
                /// What it sees.
                in scan: Scan optional within 80 ms;
                inout pose: Twist within 4000 s;
                in odd: Scan within 1234567 us;
                out cmd: Twist;
            }
            flags {
                /// Go!
                in go;
                out near;
            }
            params {
                /// In metres per second.
                speed: f32 = 0.25, -1.0..=0.5;
                limit: u32;
            }
        }
    }

    struct Nothing;
    task! { impl Nothing {} }

    #[test]
    fn signature_and_source_say_what_was_declared() {
        let cases = [
            (
                *declaration_of::<Everything<u8, u8>>(),
                Everything::<u8, u8>::SIGNATURE,
                "task Everything{in data scan:Scan optional within 80000;inout data pose:Twist within 4000000000;\
                 in data odd:Scan within 1234567;out data cmd:Twist;in flag go;out flag near;\
                 param speed:f32;param limit:u32;}",
                "/// Has all that a task can have.\n///\n/// And \"more\".\n\
                 task Everything slot 3 wcet 1 ms exclusive motion endless count 7 {\n    /// What it sees.\n    \
                 in data scan: Scan optional within 80 ms;\n    inout data pose: Twist within 4000 s;\n    \
                 in data odd: Scan within 1234567 us;\n    out data cmd: Twist;\n    /// Go!\n    in flag go;\n    \
                 out flag near;\n    /// In metres per second.\n    param speed: f32 = 0.25 min -1.0 max 0.5;\n    \
                 param limit: u32;\n}\n",
            ),
            (
                *declaration_of::<Nothing>(),
                Nothing::SIGNATURE,
                "task Nothing{}",
                "task Nothing count 7 {\n}\n",
            ),
        ];
        for (declaration, text, signature, source) in cases {
            assert_eq!(text, signature);
            assert!(declaration.has_signature(text.as_bytes()));
            // Any byte that is another, missing or too many makes it another signature.
            for end in 0..text.len() {
                assert!(!declaration.has_signature(&text.as_bytes()[..end]), "{end}");
                let mut other = text.as_bytes().to_vec();
                other[end] ^= 1;
                assert!(!declaration.has_signature(&other), "{end}");
            }
            assert!(!declaration.has_signature(std::format!("{text};").as_bytes()));
            assert_eq!(declaration.signature_hash, signature_hash(signature));
            let mut told = Vec::new();
            declaration.tell_source(7, &mut |piece| told.extend_from_slice(piece));
            let source = match cfg!(feature = "docs") {
                true => source.to_owned(),
                false => (source.split_inclusive('\n'))
                    .filter(|line| !line.trim_start().starts_with("///"))
                    .collect(),
            };
            assert_eq!(String::from_utf8(told).unwrap(), source);
        }
    }

    #[test]
    fn numbers_are_told_in_decimal() {
        for number in [0, 7, 10, 255, 1_000_000, 4_000_000_000, u32::MAX] {
            let mut told = Vec::new();
            tell_number(number, &mut |piece| told.extend_from_slice(piece));
            assert_eq!(told, number.to_string().into_bytes());
        }
    }

    #[test]
    fn literals_are_those_of_missions() {
        for (text, is_one) in [
            ("0", true),
            ("-12", true),
            ("0.25", true),
            ("-1.5", true),
            ("true", true),
            ("false", true),
            ("20_000", false),
            ("1u32", false),
            ("2.0f32", false),
            ("1e3", false),
            ("0x10", false),
        ] {
            assert_eq!(is_esm_literal(text), is_one, "{text}");
        }
    }

    #[test]
    fn a_parameter_admits_what_is_within_its_bounds() {
        struct Bounded;
        task! {
            impl Bounded {
                params {
                    speed: f32 = 0, -1..=0.5;
                    steps: i32 = 0, -3..=4;
                    count: u32 = 1, 1..=9;
                    free: f32;
                    switch: bool;
                }
            }
        }
        let param = |index: u8| &declaration_of::<Bounded>().params[usize::from(index)];
        let f32 = f32::to_bits;
        let i32 = i32::cast_unsigned;
        for (param, within, outside) in [
            (
                param(Bounded::SPEED.index),
                [f32(-1.0), f32(-0.0), f32(0.5)],
                [f32(-1.01), f32(0.51), f32(f32::NAN)],
            ),
            (
                param(Bounded::STEPS.index),
                [i32(-3), i32(0), i32(4)],
                [i32(-4), i32(5), i32(i32::MIN)],
            ),
            (param(Bounded::COUNT.index), [1, 5, 9], [0, 10, u32::MAX]),
        ] {
            for bits in within {
                assert!(param.admits(bits), "{}: {bits:#x}", param.name);
            }
            for bits in outside {
                assert!(!param.admits(bits), "{}: {bits:#x}", param.name);
            }
        }
        assert!(param(Bounded::FREE.index).admits(f32(f32::INFINITY)));
        let switch = param(Bounded::SWITCH.index);
        assert!(switch.admits(0) && switch.admits(1) && !switch.admits(2));
    }

    #[test]
    fn handles_know_their_places() {
        type E = Everything<u8, u8>;
        assert_eq!(
            (E::SCAN.index, E::POSE.index, E::ODD.index, E::CMD.index),
            (0, 1, 2, 3)
        );
        assert_eq!((E::GO.index, E::NEAR.index), (0, 1));
        assert_eq!((E::SPEED.index, E::LIMIT.index), (0, 1));
    }
}
