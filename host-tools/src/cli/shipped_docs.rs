//! What the tasks that ship are for, where a robot's firmware does not say it: by default it has no
//! room for these texts, and the command has them.

use std::collections::HashMap;

use super::own_drive::ROVER;

/// How a line begins that says what something is for.
const MARK: &str = "///";
/// What stands before a robot's number of tasks of a type.
const COUNT: &str = " count ";

/// A declaration as a robot says it, with what it is for where the robot does not say it and it is
/// that of a task that ships. How many tasks of the type there are is the robot's.
pub fn with_docs(declaration: &str) -> String {
    let is_line = |line: &str| line.trim_start().starts_with(MARK);
    if declaration.lines().any(is_line) {
        return declaration.to_owned();
    }
    let shipped = shipped();
    let Some(block) = shipped.get(&plain(declaration)) else {
        return declaration.to_owned();
    };
    let mut own = declaration.lines();
    let mut text = String::new();
    for line in block.lines() {
        let line = if is_line(line) {
            Some(line)
        } else {
            own.next()
        };
        text.extend(line);
        text.push('\n');
    }
    text
}

/// The declarations that ship, by what is [`plain`] of them.
fn shipped() -> HashMap<String, &'static str> {
    // Blank lines are between them.
    let blocks = ROVER.split("\n\n");
    let tasks = blocks.filter(|block| block.lines().any(|line| line.starts_with("task ")));
    tasks.map(|block| (plain(block), block)).collect()
}

/// A declaration without what it is for, and without the number of tasks.
fn plain(declaration: &str) -> String {
    let lines = declaration.trim_end().lines();
    let mut lines = lines.filter(|line| !line.trim_start().starts_with(MARK));
    let head = lines.next().unwrap_or_default();
    let (before, count) = head.split_once(COUNT).unwrap_or((head, ""));
    let rest = count.trim_start_matches(|digit: char| digit.is_ascii_digit());
    let lines = std::iter::once([before, rest].concat()).chain(lines.map(str::to_owned));
    lines.collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn without_docs(block: &str) -> String {
        let lines = block.lines();
        let lines = lines.filter(|line| !line.trim_start().starts_with(MARK));
        lines.map(|line| format!("{line}\n")).collect()
    }

    #[test]
    fn each_task_that_ships_is_told_with_what_it_is_for() {
        let shipped = shipped();
        assert!(shipped.len() > 40);
        for block in shipped.values() {
            let told = without_docs(block);
            assert_eq!(with_docs(&told).trim_end(), block.trim_end());
            let four = told.replacen(" count 1 ", " count 4 ", 1);
            let expected = block.replacen(" count 1 ", " count 4 ", 1);
            assert_eq!(with_docs(&four).trim_end(), expected.trim_end());
        }
    }

    #[test]
    fn what_a_robot_says_itself_is_left_as_it_is() {
        for block in shipped().values() {
            assert_eq!(with_docs(block), **block);
            let other = without_docs(block).replacen("task ", "task Other", 1);
            assert_eq!(with_docs(&other), other, "a task of another name");
            let wider = without_docs(block).replacen("\n}", "\n    out flag wider;\n}", 1);
            assert_eq!(with_docs(&wider), wider, "one with a flag more");
        }
        for odd in ["", "task", "task A count {\n}\n", "\n\n"] {
            assert_eq!(with_docs(odd), odd);
        }
    }
}
