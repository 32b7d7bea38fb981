//! The behaviours that a firmware declares.

use std::fmt::Write as _;

use serde::Serialize;

use crate::cli::console::Console;
use crate::cli::exit::CommandError;
use crate::model::{Param, ParamType, Task, Value};
use crate::script::is_behaviour;

/// What `--json` prints.
#[derive(Debug, Serialize)]
struct Report<'r> {
    firmware: &'r str,
    behaviours: Vec<Behaviour<'r>>,
}

/// A behaviour, in the form of its JSON.
#[derive(Debug, Serialize)]
struct Behaviour<'r> {
    name: &'r str,
    docs: &'r str,
    /// How many task states of it a mission may have.
    count: Option<u32>,
    params: Vec<Parameter<'r>>,
}

/// A parameter, in the form of its JSON.
#[derive(Debug, Serialize)]
struct Parameter<'r> {
    name: &'r str,
    #[serde(rename = "type")]
    kind: &'static str,
    default: Option<Number>,
    min: Option<Number>,
    max: Option<Number>,
    docs: &'r str,
}

/// A value, as JSON has it.
#[derive(Debug, Serialize)]
#[serde(untagged)]
enum Number {
    Bool(bool),
    I32(i32),
    U32(u32),
    F32(f32),
}

/// Tells what behaviours a firmware has.
///
/// # Errors
/// If that cannot be told.
pub(super) fn tell(
    firmware: &str,
    tasks: &[Task],
    json: bool,
    console: &mut Console,
) -> Result<(), CommandError> {
    let behaviours = tasks.iter().filter(|task| is_behaviour(task));
    let report = Report {
        firmware,
        behaviours: behaviours.map(behaviour).collect(),
    };
    if json {
        console.json_line(&report)
    } else {
        console.text(&table(&report))
    }
}

fn behaviour(task: &Task) -> Behaviour<'_> {
    Behaviour {
        name: &task.name,
        docs: &task.docs,
        count: task.count,
        params: task.params.iter().map(parameter).collect(),
    }
}

fn parameter(param: &Param) -> Parameter<'_> {
    let number = |value: Value| match value {
        Value::Bool(value) => Number::Bool(value),
        Value::I32(value) => Number::I32(value),
        Value::U32(value) => Number::U32(value),
        Value::F32(value) => Number::F32(value),
    };
    Parameter {
        name: &param.name,
        kind: match param.param_type {
            ParamType::Bool => "bool",
            ParamType::I32 => "i32",
            ParamType::U32 => "u32",
            ParamType::F32 => "f32",
        },
        default: param.default.map(number),
        min: param.range.map(|(min, _)| number(min)),
        max: param.range.map(|(_, max)| number(max)),
        docs: &param.docs,
    }
}

/// What a person reads.
fn table(report: &Report<'_>) -> String {
    let mut text = String::new();
    if report.behaviours.is_empty() {
        let _ = writeln!(
            text,
            "{} has no behaviours; the board `host` and the Pico have, and `cargo xtask firmware --with behaviours` \
             builds a firmware for the emulator that has",
            report.firmware
        );
    }
    for (place, behaviour) in report.behaviours.iter().enumerate() {
        if place > 0 {
            text.push('\n');
        }
        let _ = writeln!(text, "{}", behaviour.name);
        for line in behaviour.docs.lines() {
            let _ = writeln!(text, "  {line}");
        }
        for param in &behaviour.params {
            let mut range = param.kind.to_owned();
            if let Some(default) = &param.default {
                let _ = write!(range, " = {default}");
            }
            if let (Some(min), Some(max)) = (&param.min, &param.max) {
                let _ = write!(range, ", {min} to {max}");
            }
            let docs = param.docs.lines().collect::<Vec<_>>().join(" ");
            let _ = writeln!(text, "    {:<16} {range:<34} {docs}", param.name);
        }
    }
    text
}

impl std::fmt::Display for Number {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Bool(value) => value.fmt(f),
            Self::I32(value) => value.fmt(f),
            Self::U32(value) => value.fmt(f),
            Self::F32(value) => value.fmt(f),
        }
    }
}
