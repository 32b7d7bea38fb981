//! Parameters of a mission by their names, and their values as text.

use std::collections::HashMap;
use std::fmt;

use esm_core::Verified;
use esm_core::signature::Port;
use serde::Serialize;

use crate::trace::directory::{Directory, NoDirectory};

/// What a parameter's value can be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterType {
    /// `false` or `true`.
    Bool,
    /// A whole number.
    I32,
    /// A whole number that is not negative.
    U32,
    /// A number.
    F32,
}

impl ParameterType {
    fn of(name: &[u8]) -> Option<Self> {
        match name {
            b"bool" => Some(Self::Bool),
            b"i32" => Some(Self::I32),
            b"u32" => Some(Self::U32),
            b"f32" => Some(Self::F32),
            _ => None,
        }
    }

    /// Its name in a declaration.
    pub fn name(self) -> &'static str {
        match self {
            Self::Bool => "bool",
            Self::I32 => "i32",
            Self::U32 => "u32",
            Self::F32 => "f32",
        }
    }

    /// Bits of the value that a text says; `None` if it is none of the type. What numbers a task
    /// takes is the robot's to say.
    pub fn parse(self, text: &str) -> Option<u32> {
        match self {
            Self::Bool => text.parse::<bool>().ok().map(u32::from),
            Self::I32 => text.parse().ok().map(i32::cast_unsigned),
            Self::U32 => text.parse().ok(),
            Self::F32 => text.parse().ok().map(f32::to_bits),
        }
    }

    /// The value with these bits.
    pub fn value(self, bits: u32) -> Value {
        match self {
            Self::Bool => Value::Bool(bits != 0),
            Self::I32 => Value::I32(bits.cast_signed()),
            Self::U32 => Value::U32(bits),
            Self::F32 => Value::F32(f32::from_bits(bits)),
        }
    }
}

impl fmt::Display for ParameterType {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The value of a parameter: as text, the shortest that reads back as the same value, and in JSON a
/// number or a boolean.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(untagged)]
#[allow(missing_docs, reason = "as in `ParameterType`")]
pub enum Value {
    Bool(bool),
    I32(i32),
    U32(u32),
    F32(f32),
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Value::Bool(value) => value.fmt(f),
            Value::I32(value) => value.fmt(f),
            Value::U32(value) => value.fmt(f),
            Value::F32(value) => value.fmt(f),
        }
    }
}

/// A parameter of a task state. All instances of the task state share it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parameter {
    /// Its names: the path of each instance of the task state, a dot, the name that the task gives
    /// it. There is one at least.
    pub names: Vec<String>,
    /// Its index in the blob.
    pub index: u16,
    /// What its value can be.
    pub kind: ParameterType,
}

impl Parameter {
    /// The first of its names.
    pub fn name(&self) -> &str {
        self.names.first().map_or("", String::as_str)
    }
}

/// The parameters of a mission, in the order of its task instances.
///
/// # Errors
/// The blob has no names.
pub fn parameters_of<B>(blob: &Verified<B>) -> Result<Vec<Parameter>, NoDirectory>
where
    B: std::ops::Deref<Target = [u8]>,
{
    let tables = blob.tables();
    let directory = Directory::of(&tables)?;
    let mut parameters: Vec<Parameter> = Vec::new();
    let mut known: HashMap<u16, usize> = HashMap::new();
    for (instance, state) in directory.task_states().iter().enumerate() {
        let (Some(state), Some(task_state)) =
            (directory.state(*state), tables.task_state_of(instance))
        else {
            continue;
        };
        let Some(task) = tables.task(task_state.task) else {
            continue;
        };
        let declared = task.signature.ports().filter_map(|port| match port {
            Port::Param { name, type_name } => Some((name, ParameterType::of(type_name)?)),
            _ => None,
        });
        for ((name, kind), index) in declared.zip(task_state.first_param..) {
            let Ok(index) = u16::try_from(index) else {
                continue;
            };
            let name = format!("{}.{}", state.path, String::from_utf8_lossy(name));
            let at = *known.entry(index).or_insert(parameters.len());
            match parameters.get_mut(at) {
                Some(parameter) => parameter.names.push(name),
                None => parameters.push(Parameter {
                    names: vec![name],
                    index,
                    kind,
                }),
            }
        }
    }
    Ok(parameters)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_are_named_by_the_paths_of_all_their_states() {
        let source = "
            interpreter slot 1;
            slot 1 period 10 ms duration 1 ms;
            task Go slot 1 { param speed: f32 = 0.5; param steps: i32 = -3; }
            container Inner { region r { task A: Go; initial -> A; } }
            machine M {
                region m { super S: Inner; super Z: Inner; initial -> S; S -> Z on pulse; }
                region n { task B: Go with { steps = 7 }; initial -> B; }
            }";
        let checked = crate::lang::load_text("m.esm", source);
        assert!(!checked.has_errors(), "{:?}", checked.diagnostics);
        let blob = crate::compile::compile(&checked.model.unwrap(), &[0]).unwrap();
        let blob = esm_core::verify(blob).unwrap();
        let found: Vec<_> = parameters_of(&blob)
            .unwrap()
            .into_iter()
            .map(|parameter| {
                let bits = blob.tables().param(usize::from(parameter.index)).unwrap();
                (
                    parameter.names.join(" "),
                    parameter.kind.value(bits).to_string(),
                )
            })
            .collect();
        let expected = [
            ("m/S/r/A.speed m/Z/r/A.speed", "0.5"),
            ("m/S/r/A.steps m/Z/r/A.steps", "-3"),
            ("n/B.speed", "0.5"),
            ("n/B.steps", "7"),
        ];
        assert_eq!(
            found,
            expected.map(|(names, value)| (names.to_owned(), value.to_owned()))
        );
    }

    #[test]
    fn values_read_back_as_they_were_written() {
        for (kind, text) in [
            (ParameterType::Bool, "true"),
            (ParameterType::Bool, "false"),
            (ParameterType::I32, "-2147483648"),
            (ParameterType::U32, "4294967295"),
            (ParameterType::F32, "0.3"),
            (ParameterType::F32, "-1"),
        ] {
            let bits = kind.parse(text).unwrap();
            assert_eq!(kind.value(bits).to_string(), text);
        }
        for (kind, text) in [
            (ParameterType::Bool, "1"),
            (ParameterType::I32, "0.5"),
            (ParameterType::U32, "-1"),
            (ParameterType::F32, "fast"),
        ] {
            assert_eq!(kind.parse(text), None, "{kind} {text}");
        }
    }
}
