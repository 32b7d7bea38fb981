//! The signature of a task: one line of text that says everything a firmware and a mission must
//! agree on.
//!
//! ```text
//! task Cruise{in data scan:SonarScan optional within 500000;out data cmd:Twist;in flag go;out flag near;param speed:f32;}
//! ```
//!
//! First the data ports in the order of their declaration, then the flags, then the parameters. No
//! blanks but single ones between words; the time behind `within` is in microseconds, in decimal,
//! without leading zeros. Defaults, bounds, slots, execution times and descriptions are not part of
//! it. Two tasks are the same for the framework if their texts are equal. The hash of the text is a
//! short name for it: it is quick to look up, but only the text itself proves equality, since
//! anybody can construct two texts with one FNV hash.

use crate::format::MAX_TIME_US;

/// 64-bit FNV-1a hash of `bytes`.
///
/// ```
/// assert_eq!(esm_core::signature::fnv1a(b""), 0xcbf2_9ce4_8422_2325);
/// assert_eq!(esm_core::signature::fnv1a(b"a"), 0xaf63_dc4c_8601_ec8c);
/// ```
#[must_use]
pub const fn fnv1a(bytes: &[u8]) -> u64 {
    const OFFSET_BASIS: u64 = 0xcbf2_9ce4_8422_2325;
    fnv1a_continued(OFFSET_BASIS, bytes)
}

/// 64-bit FNV-1a hash of bytes that stand behind others, whose hash is known.
///
/// ```
/// use esm_core::signature::{fnv1a, fnv1a_continued};
/// assert_eq!(fnv1a_continued(fnv1a(b"a"), b"b"), fnv1a(b"ab"));
/// ```
// Long where it is inlined, and never in a hurry.
#[inline(never)]
#[must_use]
pub const fn fnv1a_continued(before: u64, bytes: &[u8]) -> u64 {
    const PRIME: u64 = 0x0000_0100_0000_01b3;
    let mut hash = before;
    let mut rest = bytes;
    while let [byte, tail @ ..] = rest {
        hash = (hash ^ *byte as u64).wrapping_mul(PRIME);
        rest = tail;
    }
    hash
}

/// Direction of a port, seen from the task.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// Read by the task.
    In,
    /// Written by the task.
    Out,
    /// Read and published again.
    InOut,
}

/// One declaration inside the braces of a signature. Names are ASCII identifiers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Port<'a> {
    /// `in data scan:SonarScan optional within 500000`
    Data {
        /// Direction.
        direction: Direction,
        /// Name of the port.
        name: &'a [u8],
        /// Name of the type that travels through it.
        type_name: &'a [u8],
        /// An input that may stay open or empty.
        optional: bool,
        /// How old a value may be that an input reads, in microseconds; 0 where any value will do.
        within_us: u32,
    },
    /// `out flag near`
    Flag {
        /// [`Direction::In`] or [`Direction::Out`].
        direction: Direction,
        /// Name of the flag.
        name: &'a [u8],
    },
    /// `param speed:f32`
    Param {
        /// Name of the parameter.
        name: &'a [u8],
        /// `bool`, `i32`, `u32` or `f32`.
        type_name: &'a [u8],
    },
}

/// How many ports of each kind a signature has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PortCounts {
    /// Data ports.
    pub data: usize,
    /// Control flags.
    pub flags: usize,
    /// Parameters.
    pub params: usize,
}

/// A signature's text, taken apart on demand. Reading one that is malformed yields fewer ports,
/// never a panic.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Signature<'a> {
    text: &'a [u8],
}

impl<'a> Signature<'a> {
    /// A view of `text`, which is not looked at yet.
    #[must_use]
    pub const fn new(text: &'a [u8]) -> Self {
        Self { text }
    }

    /// The whole text.
    #[must_use]
    pub const fn text(self) -> &'a [u8] {
        self.text
    }

    /// [`fnv1a`] of the text.
    #[must_use]
    pub const fn hash(self) -> u64 {
        fnv1a(self.text)
    }

    /// Name of the task; empty if the text is malformed. That of a dispatcher is its link's, a dot,
    /// and `transmit` or `receive`.
    #[must_use]
    pub fn name(self) -> &'a [u8] {
        self.split().map_or(&[], |(name, _)| name)
    }

    /// The ports in the order of the text, up to the first malformed one.
    #[must_use]
    pub fn ports(self) -> Ports<'a> {
        Ports {
            rest: self.split().map_or(&[], |(_, body)| body),
        }
    }

    /// The types of the data ports, in the order of the text.
    pub fn data_types(self) -> impl Iterator<Item = &'a [u8]> + Clone {
        self.ports().filter_map(|port| match port {
            Port::Data { type_name, .. } => Some(type_name),
            _ => None,
        })
    }

    /// Counts the ports, if the whole text is well formed: `None` otherwise. The one place where a
    /// text is judged.
    #[must_use]
    pub fn counts(self) -> Option<PortCounts> {
        let (name, body) = self.split()?;
        let (first, rest) = identifier(name)?;
        let is_name = !first.is_empty()
            && match rest.split_first() {
                None => true,
                Some((b'.', rest)) => identifier(rest).is_some_and(|(_, rest)| rest.is_empty()),
                Some(_) => false,
            };
        if !is_name {
            return None;
        }
        let mut ports = Ports { rest: body };
        let mut counts = PortCounts::default();
        for port in ports.by_ref() {
            match port {
                Port::Data { .. } if counts.flags == 0 && counts.params == 0 => counts.data += 1,
                Port::Flag { .. } if counts.params == 0 => counts.flags += 1,
                Port::Param { .. } => counts.params += 1,
                _ => return None,
            }
        }
        ports.rest.is_empty().then_some(counts)
    }

    /// The name and what stands between the braces.
    fn split(self) -> Option<(&'a [u8], &'a [u8])> {
        let text = self.text.strip_prefix(b"task ")?;
        let end = text.iter().position(|byte| *byte == b'{')?;
        let (name, rest) = text.split_at_checked(end)?;
        Some((name, rest.strip_prefix(b"{")?.strip_suffix(b"}")?))
    }
}

/// Iterator over the ports of a [`Signature`].
#[derive(Clone, Debug)]
pub struct Ports<'a> {
    rest: &'a [u8],
}

impl<'a> Iterator for Ports<'a> {
    type Item = Port<'a>;

    fn next(&mut self) -> Option<Port<'a>> {
        let (port, rest) = port(self.rest)?;
        self.rest = rest;
        Some(port)
    }
}

/// Reads one declaration with its semicolon.
fn port(text: &[u8]) -> Option<(Port<'_>, &[u8])> {
    let (first, text) = word(text, b' ')?;
    if first == b"param" {
        let (name, text) = word(text, b':')?;
        let (type_name, text) = word(text, b';')?;
        return Some((Port::Param { name, type_name }, text));
    }
    let direction = match first {
        b"in" => Direction::In,
        b"out" => Direction::Out,
        b"inout" => Direction::InOut,
        _ => return None,
    };
    match word(text, b' ')? {
        (b"flag", text) => {
            let (name, text) = word(text, b';')?;
            Some((Port::Flag { direction, name }, text))
        }
        (b"data", text) => {
            let (name, text) = word(text, b':')?;
            let (type_name, text) = identifier(text)?;
            let (optional, text) = match text.strip_prefix(b" optional") {
                Some(text) => (true, text),
                None => (false, text),
            };
            let (within_us, text) = match text.strip_prefix(b" within ") {
                Some(text) if direction != Direction::Out => time_us(text)?,
                Some(_) => return None,
                None => (0, text),
            };
            let port = Port::Data {
                direction,
                name,
                type_name,
                optional,
                within_us,
            };
            Some((port, text.strip_prefix(b";")?))
        }
        _ => None,
    }
}

/// Splits off a time from 1 to [`MAX_TIME_US`], in decimal and without leading zeros: each time has
/// one text.
fn time_us(text: &[u8]) -> Option<(u32, &[u8])> {
    let mut time_us = 0_u32;
    let mut rest = text;
    while let Some((digit @ b'0'..=b'9', tail)) = rest.split_first() {
        let digit = u32::from(digit - b'0');
        time_us = time_us.checked_mul(10)?.checked_add(digit)?;
        if time_us == 0 {
            return None;
        }
        rest = tail;
    }
    (1..=MAX_TIME_US)
        .contains(&time_us)
        .then_some((time_us, rest))
}

/// Splits off an identifier and the character behind it.
#[inline(never)]
fn word(text: &[u8], end: u8) -> Option<(&[u8], &[u8])> {
    let (word, rest) = identifier(text)?;
    let (found, rest) = rest.split_first()?;
    (*found == end).then_some((word, rest))
}

/// Splits off an identifier of at least one character.
#[inline(never)]
fn identifier(text: &[u8]) -> Option<(&[u8], &[u8])> {
    let end = text.iter().position(|byte| !is_identifier_part(*byte));
    let length = end.unwrap_or(text.len());
    (length > 0)
        .then(|| text.split_at_checked(length))
        .flatten()
}

/// Whether a character can stand in an identifier.
pub(crate) fn is_identifier_part(byte: u8) -> bool {
    byte.is_ascii_alphanumeric() || byte == b'_'
}

#[cfg(test)]
mod tests {
    use super::*;

    const CRUISE: &[u8] =
        b"task Cruise{in data scan:SonarScan optional within 500000;inout data pose:Pose within 1;out data cmd:Twist;in flag go;out flag near;param speed:f32;}";

    #[test]
    fn a_signature_reads_back_port_by_port() {
        let signature = Signature::new(CRUISE);
        assert_eq!(signature.name(), b"Cruise");
        let expected = [
            Port::Data {
                direction: Direction::In,
                name: b"scan",
                type_name: b"SonarScan",
                optional: true,
                within_us: 500_000,
            },
            Port::Data {
                direction: Direction::InOut,
                name: b"pose",
                type_name: b"Pose",
                optional: false,
                within_us: 1,
            },
            Port::Data {
                direction: Direction::Out,
                name: b"cmd",
                type_name: b"Twist",
                optional: false,
                within_us: 0,
            },
            Port::Flag {
                direction: Direction::In,
                name: b"go",
            },
            Port::Flag {
                direction: Direction::Out,
                name: b"near",
            },
            Port::Param {
                name: b"speed",
                type_name: b"f32",
            },
        ];
        assert!(signature.ports().eq(expected));
    }

    #[test]
    fn only_well_formed_texts_have_counts() {
        let counts = |data, flags, params| {
            Some(PortCounts {
                data,
                flags,
                params,
            })
        };
        let cases: &[(&[u8], Option<PortCounts>)] = &[
            (CRUISE, counts(3, 2, 1)),
            (b"task Idle{}", counts(0, 0, 0)),
            (b"task A{inout data x:T;}", counts(1, 0, 0)),
            (b"task A{in data x:T within 4000000000;}", counts(1, 0, 0)),
            (b"task A{in flag f;in data x:T;}", None),
            (b"task A{param p:f32;in flag f;}", None),
            (b"task A{in data x:T}", None),
            (b"task A{in data x;}", None),
            (b"task A{in data x:T optional ;}", None),
            (b"task A{in data x:T within 1 optional;}", None),
            (b"task A{in data x:T within 1 within 1;}", None),
            (b"task A{out data x:T within 1;}", None),
            (b"task A{in data x:T within;}", None),
            (b"task A{in data x:T within ;}", None),
            (b"task A{in data x:T within 0;}", None),
            (b"task A{in data x:T within 01;}", None),
            (b"task A{in data x:T within -1;}", None),
            (b"task A{in data x:T within 1 ;}", None),
            (b"task A{in data x:T within 1ms;}", None),
            (b"task A{in data x:T within 4000000001;}", None),
            (b"task A{in data x:T within 4294967297;}", None),
            (b"task A{in data x:T within 99999999999;}", None),
            (b"task radio.transmit{in flag f;}", counts(0, 1, 0)),
            (b"task radio.{}", None),
            (b"task .transmit{}", None),
            (b"task a.b.c{}", None),
            (b"task a b{}", None),
            (b"task A{sideways flag f;}", None),
            (b"task {}", None),
            (b"task A", None),
            (b"", None),
        ];
        for (text, expected) in cases {
            assert_eq!(Signature::new(text).counts(), *expected, "{text:?}");
        }
    }
}
