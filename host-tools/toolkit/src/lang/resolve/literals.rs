//! Values of parameters: from a literal and a type to a [`Value`].

use std::cmp::Ordering;
use std::fmt;

use crate::lang::tree::{Literal, LiteralKind};
use crate::model::{ParamType, Value};

/// Why a literal is no value of a type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Misfit {
    /// It is of another kind.
    Kind,
    /// The type has no number of this size.
    Size,
}

/// Reads a literal as a value of a type. `digits` is its text without the sign.
pub(super) fn value(
    literal: Literal,
    digits: &str,
    param_type: ParamType,
) -> Result<Value, Misfit> {
    let is_integer = literal.kind == LiteralKind::Integer;
    match (param_type, literal.kind) {
        (ParamType::Bool, LiteralKind::Bool(value)) => Ok(Value::Bool(value)),
        (ParamType::I32, _) if is_integer => integer(literal, digits)
            .and_then(|value| i32::try_from(value).ok())
            .map(Value::I32)
            .ok_or(Misfit::Size),
        (ParamType::U32, _) if is_integer => integer(literal, digits)
            .and_then(|value| u32::try_from(value).ok())
            .map(Value::U32)
            .ok_or(Misfit::Size),
        (ParamType::F32, LiteralKind::Integer | LiteralKind::Float) => {
            let magnitude: f32 = digits.parse().map_err(|_| Misfit::Kind)?;
            if magnitude.is_infinite() {
                return Err(Misfit::Size);
            }
            Ok(Value::F32(if literal.negative {
                -magnitude
            } else {
                magnitude
            }))
        }
        _ => Err(Misfit::Kind),
    }
}

/// The number that digits and sign stand for, if it fits 64 bits.
fn integer(literal: Literal, digits: &str) -> Option<i64> {
    let magnitude: i64 = digits.parse().ok()?;
    Some(if literal.negative {
        -magnitude
    } else {
        magnitude
    })
}

/// The order of two values of one type.
pub(super) fn compare(a: Value, b: Value) -> Option<Ordering> {
    match (a, b) {
        (Value::Bool(a), Value::Bool(b)) => Some(a.cmp(&b)),
        (Value::I32(a), Value::I32(b)) => Some(a.cmp(&b)),
        (Value::U32(a), Value::U32(b)) => Some(a.cmp(&b)),
        (Value::F32(a), Value::F32(b)) => a.partial_cmp(&b),
        _ => None,
    }
}

/// Whether a value lies in a range, its ends included.
pub(super) fn is_within(value: Value, (least, greatest): (Value, Value)) -> bool {
    compare(least, value).is_none_or(Ordering::is_le)
        && compare(value, greatest).is_none_or(Ordering::is_le)
}

/// The value of a range that is nearest to one outside of it.
pub(super) fn nearest_in(value: Value, (least, greatest): (Value, Value)) -> Written {
    let is_below = compare(value, least) == Some(Ordering::Less);
    Written(if is_below { least } else { greatest })
}

/// What was probably meant by digits that are no value of a type.
pub(super) fn meant(digits: &str, param_type: ParamType) -> Option<&str> {
    match (param_type, digits) {
        (ParamType::Bool, "0") => Some("false"),
        (ParamType::Bool, "1") => Some("true"),
        (ParamType::I32 | ParamType::U32, _) => {
            let (whole, rest) = digits.split_once('.')?;
            rest.bytes().all(|digit| digit == b'0').then_some(whole)
        }
        _ => None,
    }
}

/// Some value of a parameter: the least that it can have, else 0.
pub(super) fn some_value(param_type: ParamType, range: Option<(Value, Value)>) -> Written {
    let zero = match param_type {
        ParamType::Bool => Value::Bool(false),
        ParamType::I32 => Value::I32(0),
        ParamType::U32 => Value::U32(0),
        ParamType::F32 => Value::F32(0.0),
    };
    Written(match range {
        Some((least, greatest)) if !is_within(zero, (least, greatest)) => least,
        _ => zero,
    })
}

/// A type as it is written.
pub(super) fn type_word(param_type: ParamType) -> &'static str {
    match param_type {
        ParamType::Bool => "bool",
        ParamType::I32 => "i32",
        ParamType::U32 => "u32",
        ParamType::F32 => "f32",
    }
}

/// How a value of a type is written, for hints.
pub(super) fn how_to_write(param_type: ParamType) -> &'static str {
    match param_type {
        ParamType::Bool => "write `true` or `false`",
        ParamType::I32 => "write a whole number from -2147483648 to 2147483647",
        ParamType::U32 => "write a whole number from 0 to 4294967295",
        ParamType::F32 => "write a number such as `0.5` or `2`",
    }
}

/// A value as it is written.
pub(super) struct Written(pub Value);

impl fmt::Display for Written {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Value::Bool(value) => value.fmt(f),
            Value::I32(value) => value.fmt(f),
            Value::U32(value) => value.fmt(f),
            Value::F32(value) => value.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Span;

    #[test]
    fn literals_and_their_values() {
        use LiteralKind::{Bool, Float, Integer};
        use ParamType::{Bool as B, F32, I32, U32};
        let cases = [
            (B, Bool(true), false, "true", Ok(Value::Bool(true))),
            (B, Integer, false, "1", Err(Misfit::Kind)),
            (I32, Integer, true, "2147483648", Ok(Value::I32(i32::MIN))),
            (I32, Integer, false, "2147483648", Err(Misfit::Size)),
            (I32, Float, false, "1.0", Err(Misfit::Kind)),
            (U32, Integer, false, "4294967295", Ok(Value::U32(u32::MAX))),
            (U32, Integer, true, "1", Err(Misfit::Size)),
            (U32, Integer, true, "0", Ok(Value::U32(0))),
            (
                U32,
                Integer,
                false,
                "99999999999999999999999",
                Err(Misfit::Size),
            ),
            (F32, Integer, false, "3", Ok(Value::F32(3.0))),
            (F32, Float, true, "0.5", Ok(Value::F32(-0.5))),
            (F32, Float, false, "1e39", Err(Misfit::Size)),
            (F32, Bool(true), false, "true", Err(Misfit::Kind)),
        ];
        for (param_type, kind, negative, digits, expected) in cases {
            let literal = Literal {
                kind,
                negative,
                digits: Span::default(),
                span: Span::default(),
            };
            assert_eq!(
                value(literal, digits, param_type),
                expected,
                "{param_type:?} {digits}"
            );
        }
    }

    #[test]
    fn the_ends_belong_to_a_range() {
        let range = (Value::I32(-1), Value::I32(3));
        for (value, inside) in [(-2, false), (-1, true), (3, true), (4, false)] {
            assert_eq!(is_within(Value::I32(value), range), inside, "{value}");
        }
    }
}
