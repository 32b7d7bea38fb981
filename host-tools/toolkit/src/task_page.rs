//! A page of what a robot can do: for each of its tasks what it is for, a picture of what goes in
//! and out, and tables.
//!
//! All of it comes from the declarations alone, as `esm tasks` prints them. Equal declarations give
//! equal pages.

use std::fmt::Write as _;

use crate::clean::clean;
use crate::diagram;
use crate::lang::Checked;
use crate::lang::tree::Given;
use crate::model::{DataPort, Direction, Flag, Param, ParamType, Task, Value};
use crate::pictures::scene::Scene;
use crate::scenario::time::Time;

/// The name of the page.
pub const PAGE: &str = "tasks.md";
/// The folder of its pictures, seen from the page.
pub const PICTURES: &str = "img/tasks";

/// A page and its pictures.
#[derive(Clone, Debug)]
pub struct TaskPage {
    /// The text, as Markdown.
    pub text: String,
    /// For each task the name of its picture's file in [`PICTURES`], and the picture.
    pub pictures: Vec<(String, Scene)>,
}

/// The page of all tasks that the first file of a checked set declares; `None` where there is no
/// model. `origin` is where the declarations are from.
#[must_use]
pub fn of(checked: &Checked, origin: &str) -> Option<TaskPage> {
    let model = checked.model.as_ref()?;
    let tasks: Vec<(&Task, Option<u32>)> = (model.tasks.iter())
        .filter(|task| task.span.file == 0)
        .map(|task| (task, slot(checked, task)))
        .collect();
    let mut text = format!(
        "# Tasks of the robot\n\n\
         <!-- Written by `esm tasks --page` from {}: change it there. -->\n\n",
        plain(origin).replace("--", "- -")
    );
    text += "What the robot can do, task by task, as its firmware declares it. In a picture, what goes in stands on the \
             left,\nand what comes out on the right: dashed lines are data, with the type of what they carry, and arrows \
             are flags.\nA hollow triangle is an input that may stay without a value. `within` says how old a value may \
             be; an older one counts\nas none. `wcet` is how long the task takes at most, each time that it runs; `count` is how many \
             states of a mission can\nhave it; and of the tasks with one `exclusive` group one at a time is to run.\n\n";
    text += "| task | slot | what it is for |\n|---|---|---|\n";
    for (task, slot) in &tasks {
        let slot = slot.map_or_else(|| "–".to_owned(), |slot| slot.to_string());
        let first = sentence(&task.docs);
        let name = &task.name;
        let _ = writeln!(text, "| [`{name}`](#{}) | {slot} | {first} |", anchor(name));
    }
    let mut pictures = Vec::with_capacity(tasks.len());
    for (task, slot) in tasks {
        let file = format!("{}.svg", task.name);
        add(&mut text, task, slot, &file);
        pictures.push((file, diagram::task::draw(task, slot)));
    }
    Some(TaskPage { text, pictures })
}

/// The number of the slot that a task's declaration names. The slot itself need not be declared.
fn slot(checked: &Checked, task: &Task) -> Option<u32> {
    let file = checked.trees().get(task.span.file as usize)?;
    let tree =
        (file.tasks.iter()).find(|tree| tree.name.is_some_and(|name| name.0 == task.span))?;
    match tree.slot {
        Given::Value(number) => Some(number.value),
        Given::Absent | Given::Broken => None,
    }
}

fn add(text: &mut String, task: &Task, slot: Option<u32>, file: &str) {
    let name = &task.name;
    let _ = write!(text, "\n## {name}\n\n");
    if !task.docs.is_empty() {
        for line in task.docs.lines() {
            let _ = writeln!(text, "{}", plain(line).trim());
        }
        text.push('\n');
    }
    let _ = write!(
        text,
        "![What goes into {name} and comes out of it]({PICTURES}/{file})\n\n"
    );

    text.push_str("| slot | wcet | count | exclusive | finishes |\n|---|---|---|---|---|\n");
    let or_none = |value: Option<String>| value.unwrap_or_else(|| "–".to_owned());
    let slot = match slot {
        Some(0) => Some("0: in the time that is left".to_owned()),
        slot => slot.map(|slot| slot.to_string()),
    };
    let _ = writeln!(
        text,
        "| {} | {} | {} | {} | {} |",
        or_none(slot),
        or_none(task.wcet_us.map(time)),
        or_none(task.count.map(|count| count.to_string())),
        or_none(task.exclusive.clone()),
        if task.endless { "never" } else { "yes" }
    );
    if !task.data.is_empty() {
        text.push_str(
            "\n| data | | type | without a value | what it is |\n|---|---|---|---|---|\n",
        );
        for port in &task.data {
            add_port(text, port);
        }
    }
    if !task.flags.is_empty() {
        text.push_str("\n| flag | | what it says |\n|---|---|---|\n");
        for flag in &task.flags {
            let Flag { name, docs, .. } = flag;
            let direction = word(flag.direction);
            let _ = writeln!(text, "| `{name}` | {direction} | {} |", cell(docs));
        }
    }
    if !task.params.is_empty() {
        text.push_str(
            "\n| parameter | type | default | bounds | what it is |\n|---|---|---|---|---|\n",
        );
        for param in &task.params {
            add_param(text, param);
        }
    }
}

fn add_port(text: &mut String, port: &DataPort) {
    let without = match (port.direction, port.optional, port.within_us) {
        (Direction::Out, ..) => "–".to_owned(),
        (_, true, None) => "runs".to_owned(),
        (_, true, Some(within_us)) => {
            format!("runs, also where it is older than {}", time(within_us))
        }
        (_, false, None) => "waits".to_owned(),
        (_, false, Some(within_us)) => {
            format!("waits, also where it is older than {}", time(within_us))
        }
    };
    let _ = writeln!(
        text,
        "| `{}` | {} | `{}` | {without} | {} |",
        port.name,
        word(port.direction),
        port.type_name,
        cell(&port.docs)
    );
}

fn add_param(text: &mut String, param: &Param) {
    let type_name = match param.param_type {
        ParamType::Bool => "bool",
        ParamType::I32 => "i32",
        ParamType::U32 => "u32",
        ParamType::F32 => "f32",
    };
    let default = param
        .default
        .map_or_else(|| "none: a mission gives it".to_owned(), literal);
    let bounds = match param.range {
        Some((least, most)) => format!("{} to {}", literal(least), literal(most)),
        None => "–".to_owned(),
    };
    let _ = writeln!(
        text,
        "| `{}` | {type_name} | {default} | {bounds} | {} |",
        param.name,
        cell(&param.docs)
    );
}

fn word(direction: Direction) -> &'static str {
    match direction {
        Direction::In => "in",
        Direction::Out => "out",
        Direction::InOut => "in and out",
    }
}

fn time(us: u32) -> String {
    Time { us: us.into() }.to_string()
}

/// A value as the language writes it: numbers with a point have one.
fn literal(value: Value) -> String {
    match value {
        Value::Bool(value) => value.to_string(),
        Value::I32(value) => value.to_string(),
        Value::U32(value) => value.to_string(),
        Value::F32(value) => format!("{value:?}"),
    }
}

/// The place of a heading, as renderers of Markdown call it.
fn anchor(name: &str) -> String {
    name.to_lowercase()
}

/// The first sentence of a text, for a cell.
fn sentence(docs: &str) -> String {
    let whole = cell(docs);
    match whole.find(". ") {
        Some(end) => whole[..=end].to_owned(),
        None => whole,
    }
}

/// A text as a cell of a table: in one line, without what would end the cell.
fn cell(docs: &str) -> String {
    let words: Vec<&str> = docs.split_whitespace().collect();
    plain(&words.join(" ")).replace('|', "\\|")
}

/// A text of anybody's: it does nothing to a terminal, and brings no HTML of its own. What stands
/// between backticks is code anyway.
fn plain(text: &str) -> String {
    let text = clean(text);
    let mut plain = String::with_capacity(text.len());
    let mut parts = text.split('`').peekable();
    let mut is_code = false;
    while let Some(part) = parts.next() {
        // A backtick that has no partner begins no code.
        let closed = parts.peek().is_some();
        if is_code && closed {
            plain += part;
        } else {
            plain += &part.replace('&', "&amp;").replace('<', "&lt;");
        }
        if closed {
            plain.push('`');
        }
        is_code = !is_code;
    }
    plain
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test that cannot go on has failed

    use super::*;
    use crate::lang::load_text;

    fn page(text: &str) -> TaskPage {
        of(&load_text("robot.esm", text), "robot.esm").unwrap()
    }

    #[test]
    fn a_page_says_all_that_a_declaration_says() {
        let page = page(
            "/// Follows a line. It stands where there is none.
            task Follow slot 2 wcet 300 us exclusive motion endless count 4 {
                /// Where the line is.
                in data line: Line optional within 100 ms;
                in data pose: Pose within 2 s;
                in data map: Map;
                inout data budget: Budget optional;
                out data twist: Twist;
                /// To the left | to the right.
                in flag left;
                out flag seen;
                /// How sharply.
                param gain: f32 = 1.0 min 0.0 max 2.5;
                param tries: u32;
                param mirrored: bool = false;
            }
            task Other { }",
        );
        for line in [
            "| [`Follow`](#follow) | 2 | Follows a line. |",
            "Follows a line. It stands where there is none.",
            "![What goes into Follow and comes out of it](img/tasks/Follow.svg)",
            "| 2 | 300 us | 4 | motion | never |",
            "| `line` | in | `Line` | runs, also where it is older than 100 ms | Where the line is. |",
            "| `pose` | in | `Pose` | waits, also where it is older than 2 s |  |",
            "| `map` | in | `Map` | waits |  |",
            "| `budget` | in and out | `Budget` | runs |  |",
            "| `twist` | out | `Twist` | – |  |",
            "| `left` | in | To the left \\| to the right. |",
            "| `seen` | out |  |",
            "| `gain` | f32 | 1.0 | 0.0 to 2.5 | How sharply. |",
            "| `tries` | u32 | none: a mission gives it | – |  |",
            "| `mirrored` | bool | false | – |  |",
            "| – | – | – | – | yes |",
        ] {
            assert!(
                page.text.lines().any(|told| told == line),
                "{line}\n{}",
                page.text
            );
        }
        let files: Vec<&str> = page
            .pictures
            .iter()
            .map(|(file, _)| file.as_str())
            .collect();
        assert_eq!(files, ["Follow.svg", "Other.svg"]);
    }

    #[test]
    fn what_a_stranger_says_brings_no_html() {
        let page =
            page("/// <script>a</script> `Vec<u8>` & <b>`\ntask Odd {\n /// <i>\n in flag it; }");
        for line in [
            "&lt;script>a&lt;/script> `Vec<u8>` &amp; &lt;b>`",
            "| `it` | in | &lt;i> |",
        ] {
            assert!(
                page.text.lines().any(|told| told == line),
                "{line}\n{}",
                page.text
            );
        }
    }
}
