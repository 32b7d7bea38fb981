//! What a task declares: its ports, flags and parameters, with the types of values and the handles
//! that stand for them.

use core::any::TypeId;
use core::marker::PhantomData;
#[cfg(any(feature = "links", feature = "telemetry"))]
use core::ptr::NonNull;

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

    /// Bytes of its fields in the payload of a frame; 0 of a type that cannot travel.
    const PAYLOAD_BYTES: usize = 0;

    /// Writes its fields into a payload of [`PAYLOAD_BYTES`](Self::PAYLOAD_BYTES).
    fn put(&self, payload: &mut [u8]) {
        let _ = payload;
    }

    /// Reads its fields from such a payload.
    fn take(&mut self, payload: &[u8]) {
        let _ = payload;
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
            const PAYLOAD_BYTES: usize = <Self as Field>::BYTES;
            fn put(&self, payload: &mut [u8]) {
                crate::show::put_first(self, payload);
            }
            fn take(&mut self, payload: &[u8]) {
                crate::show::take_first(self, payload);
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

/// Shows the value in a buffer, if there is one, and says what values of its type are made of.
#[cfg(feature = "telemetry")]
pub(crate) type Tell = unsafe fn(Option<NonNull<()>>, &mut Show<'_>) -> &'static str;

/// What is known of a type of values.
pub(crate) struct Kind {
    type_id: TypeId,
    name: &'static str,
    #[cfg(feature = "telemetry")]
    tell: Tell,
    #[cfg(feature = "links")]
    codec: Codec,
}

/// How a value in a buffer becomes a payload, and back.
#[cfg(feature = "links")]
pub(crate) struct Codec {
    /// Bytes of the payload; 0 of a type that cannot travel.
    pub(crate) payload_bytes: usize,
    /// Bytes of a buffer of such a value, and what its address is a multiple of.
    pub(crate) buffer_bytes: usize,
    pub(crate) buffer_align: usize,
    /// Writes the value in a buffer into a payload.
    pub(crate) put: unsafe fn(NonNull<()>, &mut [u8]),
    /// Makes the value of a payload in a buffer, whatever was there.
    pub(crate) take: unsafe fn(&[u8], NonNull<()>),
}

impl Kind {
    /// Of these values, and of buffers that hold such.
    pub(crate) const fn new<V: PortType>(
        #[cfg(feature = "telemetry")] tell: Tell,
        #[cfg(feature = "links")] codec: Codec,
    ) -> Self {
        Kind {
            type_id: TypeId::of::<V>(),
            name: V::NAME,
            #[cfg(feature = "telemetry")]
            tell,
            #[cfg(feature = "links")]
            codec,
        }
    }
}

/// A type of values, as a port declares it.
#[doc(hidden)]
#[derive(Clone, Copy)]
pub struct ValueKind(&'static Kind);

impl ValueKind {
    pub(crate) const fn new(kind: &'static Kind) -> Self {
        ValueKind(kind)
    }

    /// [`PortType::NAME`] of the type.
    pub fn name(self) -> &'static str {
        self.0.name
    }

    /// The Rust type.
    pub(crate) fn type_id(self) -> TypeId {
        self.0.type_id
    }

    /// How a value of this kind is told.
    #[cfg(feature = "telemetry")]
    pub(crate) fn tell(self) -> Tell {
        self.0.tell
    }

    /// How a value of this kind travels.
    #[cfg(feature = "links")]
    pub(crate) fn codec(self) -> &'static Codec {
        &self.0.codec
    }

    /// Whether both are one `Kind`.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn is_same(self, other: ValueKind) -> bool {
        core::ptr::eq(self.0, other.0)
    }

    /// Whether both are one type. As a rule a type has one `Kind`; where it has several, the types
    /// decide.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn is(self, other: ValueKind) -> bool {
        self.is_same(other) || self.has_type_of(other)
    }

    #[cold]
    #[inline(never)]
    fn has_type_of(self, other: ValueKind) -> bool {
        self.0.type_id == other.0.type_id
    }
}

impl core::fmt::Debug for ValueKind {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.0.type_id.fmt(f)
    }
}

/// A data port as its task declares it.
#[derive(Clone, Copy, Debug)]
pub struct PortDeclaration {
    /// Name of the port.
    pub name: &'static str,
    /// The type of the values.
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

impl PortDeclaration {
    /// [`PortType::NAME`] of the values.
    pub fn type_name(&self) -> &'static str {
        self.kind.name()
    }
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
    /// FNV-1a hash of the signature's text, [`Declared::SIGNATURE`](crate::Declared::SIGNATURE).
    pub signature_hash: u64,
    /// The task never finishes.
    pub endless: bool,
    /// What stands behind the name in `.esm` text: default slot, execution time, group, `endless`.
    pub attributes: &'static str,
    /// What the task is for.
    #[doc(hidden)]
    pub docs: Docs,
}

/// What something is for: what stands behind `///` in `.esm` text, in lines with their ends.
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

    /// Tells the lines, each as a comment behind `indent`.
    fn tell(self, indent: &str, tell: &mut dyn FnMut(&[u8])) {
        let lines = self.text().as_bytes();
        for line in lines.split_inclusive(|byte| *byte == b'\n') {
            for piece in [indent.as_bytes(), b"///", line] {
                tell(piece);
            }
        }
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
    /// Whether `text` is this task's [signature](crate::Declared::SIGNATURE), to the byte.
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
                port.type_name(),
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
        const INDENT: &str = "    ";
        let mut line =
            |indent: &str, docs: Docs, pieces: &[&str], number: Option<u32>, end: &str| {
                docs.tell(indent, tell);
                let pieces = core::iter::once(indent).chain(pieces.iter().copied());
                pieces.for_each(|piece| tell(piece.as_bytes()));
                if let Some(number) = number {
                    tell_number(number, tell);
                }
                tell(end.as_bytes());
            };
        let head = ["task ", self.name, self.attributes, " count "];
        line("", self.docs, &head, Some(count), " {\n");
        for port in self.ports {
            let optional = if port.optional { " optional" } else { "" };
            let (within, time, end) = match port.within_us {
                None => ("", None, ";\n"),
                Some(us) if us % 1_000_000 == 0 => (" within ", Some(us / 1_000_000), " s;\n"),
                Some(us) if us % 1_000 == 0 => (" within ", Some(us / 1_000), " ms;\n"),
                Some(us) => (" within ", Some(us), " us;\n"),
            };
            let pieces = [
                port.direction.word(),
                " data ",
                port.name,
                ": ",
                port.type_name(),
                optional,
                within,
            ];
            line(INDENT, port.docs, &pieces, time, end);
        }
        for flag in self.flags {
            let pieces = [flag.direction.word(), " flag ", flag.name];
            line(INDENT, flag.docs, &pieces, None, ";\n");
        }
        for param in self.params {
            let pieces = [
                "param ",
                param.name,
                ": ",
                param.kind.word(),
                param.attributes,
            ];
            line(INDENT, param.docs, &pieces, None, ";\n");
        }
        tell(b"}\n");
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

/// The parameters of a task state, or of a behaviour that a command has inserted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Params([u32; MAX_PARAMS]);

impl Params {
    /// The value of a parameter.
    pub fn get<P: ParamType>(&self, param: Param<P>) -> P {
        let bits = self.0.get(usize::from(param.index));
        P::from_bits(bits.copied().unwrap_or(0))
    }
}

impl From<[u32; MAX_PARAMS]> for Params {
    fn from(bits: [u32; MAX_PARAMS]) -> Self {
        Self(bits)
    }
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

/// Whether a value is within bounds, at compile time.
#[doc(hidden)]
pub const fn is_within_bounds_f32(least: f32, value: f32, greatest: f32) -> bool {
    least <= value && value <= greatest
}

/// Whether a value is within bounds, at compile time.
#[doc(hidden)]
pub const fn is_within_bounds_i32(least: i32, value: i32, greatest: i32) -> bool {
    least <= value && value <= greatest
}

/// Whether a value is within bounds, at compile time.
#[doc(hidden)]
pub const fn is_within_bounds_u32(least: u32, value: u32, greatest: u32) -> bool {
    least <= value && value <= greatest
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_told_in_decimal() {
        for number in [0, 7, 10, 255, 1_000_000, 4_000_000_000, u32::MAX] {
            let mut told = Vec::new();
            tell_number(number, &mut |piece| told.extend_from_slice(piece));
            assert_eq!(told, number.to_string().into_bytes());
        }
    }
}
