//! The canonical text of a task declaration; its grammar stands in [`esm_core::signature`].

use std::fmt::Write as _;

use crate::model::{Direction, ParamType, Task};

/// The signature of a task.
#[must_use]
pub fn text(task: &Task) -> String {
    let mut text = format!("task {}{{", task.name);
    for port in &task.data {
        let optional = if port.optional { " optional" } else { "" };
        let within = match port.within_us {
            Some(within_us) => format!(" within {within_us}"),
            None => String::new(),
        };
        let direction = direction(port.direction);
        // Writing into a string cannot fail.
        let _ = write!(
            text,
            "{direction} data {}:{}{optional}{within};",
            port.name, port.type_name
        );
    }
    for flag in &task.flags {
        let _ = write!(text, "{} flag {};", direction(flag.direction), flag.name);
    }
    for param in &task.params {
        let param_type = match param.param_type {
            ParamType::Bool => "bool",
            ParamType::I32 => "i32",
            ParamType::U32 => "u32",
            ParamType::F32 => "f32",
        };
        let _ = write!(text, "param {}:{param_type};", param.name);
    }
    text.push('}');
    text
}

fn direction(direction: Direction) -> &'static str {
    match direction {
        Direction::In => "in",
        Direction::Out => "out",
        Direction::InOut => "inout",
    }
}
