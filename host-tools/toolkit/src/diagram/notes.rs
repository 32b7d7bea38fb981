//! What the `///` lines of a mission say of what is drawn, below the picture.
//!
//! A note is a heading and lines. Notes come in the order of the source: of a container its own,
//! then those of its regions and states, then the containers inside; behind all of them the tasks
//! of the states that are shown, with their ports, flags and parameters.

use std::collections::BTreeSet;

use super::grid::CELL;
use super::label::{self, Line};
use super::paint;
use crate::clean::clean;
use crate::model::{Container, Model, StateKind, Task};
use crate::pictures::font;
use crate::pictures::scene::Scene;

/// Lines of all notes of a picture, at most; of what follows a sign says that it is left away.
pub const MAX_LINES: usize = 500;
/// Characters of a note that are looked at, at most.
const MAX_CHARACTERS: usize = 5_000;
/// Cells around the notes.
const MARGIN: i32 = 3;
/// Rows of a line.
const ROW: i32 = 2;
/// Cells that the text of a note stands to the right of its heading.
const INDENT: i32 = 2;
/// Cells that a line may have in a picture that is narrower.
const LEAST: i32 = 80;
/// Cells beyond which nobody reads a line to its end.
const MOST: i32 = 120;

/// What is said of a thing.
struct Note<'m> {
    heading: String,
    text: &'m str,
}

/// Adds the notes of what is shown of some containers, with so many levels of superstates. A narrow
/// scene grows to hold them.
pub fn add(scene: &mut Scene, model: &Model, roots: &[usize], levels: u32) {
    let notes = of_containers(model, roots, levels);
    if notes.is_empty() {
        return;
    }
    let across = ((scene.width / CELL) as i32 - 2 * MARGIN).clamp(LEAST, MOST);
    let room = CELL * (across - INDENT) as f32;
    let top = (scene.height / CELL) as i32;
    let mut rows = 0;
    let mut write = |rows: &mut i32, indent: i32, words: String, set: label::Type| {
        let at = [MARGIN + indent, top + *rows * ROW];
        paint::write_at(scene, &Line::words(words), at, set, paint::INK);
        *rows += 1;
    };
    let mut left = MAX_LINES;
    'notes: for note in notes {
        let heading = std::iter::once((0, note.heading, label::NAME));
        let lines = lines(note.text, room).into_iter();
        let text = lines.map(|line| (INDENT, line, label::LABEL));
        for (indent, words, set) in heading.chain(text) {
            if left == 0 {
                write(&mut rows, 0, "…".to_owned(), label::NAME);
                break 'notes;
            }
            left -= 1;
            write(&mut rows, indent, words, set);
        }
    }
    scene.width = scene.width.max(CELL * (across + 2 * MARGIN) as f32);
    scene.height += CELL * (rows * ROW + MARGIN) as f32;
}

fn of_containers<'m>(model: &'m Model, roots: &[usize], levels: u32) -> Vec<Note<'m>> {
    let mut notes = Vec::new();
    let mut tasks = BTreeSet::new();
    let mut known = BTreeSet::new();
    let mut shown: Vec<usize> = roots.to_vec();
    for level in 0..=levels {
        let mut inside = Vec::new();
        for index in shown {
            let Some(container) = model.containers.get(index).filter(|_| known.insert(index))
            else {
                continue;
            };
            of_container(container, &mut notes);
            let states = container.regions.iter().flat_map(|region| &region.states);
            for state in states {
                match state.kind {
                    StateKind::Simple => {}
                    StateKind::Task { task, .. } => {
                        tasks.insert(task);
                    }
                    StateKind::Super { container } if level < levels => inside.push(container),
                    StateKind::Super { .. } => {}
                }
            }
        }
        shown = inside;
    }
    for task in tasks.into_iter().filter_map(|task| model.tasks.get(task)) {
        of_task(task, &mut notes);
    }
    notes
}

fn of_container<'m>(container: &'m Container, notes: &mut Vec<Note<'m>>) {
    let (word, around) = if container.is_machine {
        ("machine", String::new())
    } else {
        ("container", format!("{}/", label::name(&container.name)))
    };
    let mut add = |heading: String, text: &'m str| {
        if !text.is_empty() {
            notes.push(Note { heading, text });
        }
    };
    let name = |name: &'m str| label::name(name);
    add(format!("{word} {}", name(&container.name)), &container.docs);
    for port in &container.data {
        add(format!("{around}{}", name(&port.name)), &port.docs);
    }
    for flag in &container.flags {
        add(format!("{around}{}", name(&flag.name)), &flag.docs);
    }
    for region in &container.regions {
        let region_name = format!("{around}{}", name(&region.name));
        add(format!("region {region_name}"), &region.docs);
        for state in &region.states {
            add(format!("{region_name}/{}", name(&state.name)), &state.docs);
        }
    }
}

fn of_task<'m>(task: &'m Task, notes: &mut Vec<Note<'m>>) {
    let task_name = label::name(&task.name);
    let data = task.data.iter().map(|port| (&port.name, &port.docs));
    let flags = task.flags.iter().map(|flag| (&flag.name, &flag.docs));
    let params = task.params.iter().map(|param| (&param.name, &param.docs));
    let parts = data.chain(flags).chain(params);
    let own = std::iter::once((format!("task {task_name}"), &task.docs));
    let all = own.chain(parts.map(|(name, docs)| {
        let heading = format!("{task_name}.{}", label::name(name));
        (heading, docs)
    }));
    notes.extend(
        all.filter(|(_, text)| !text.is_empty())
            .map(|(heading, text)| Note { heading, text }),
    );
}

/// The lines of a text that fit into the room: broken between words, and within those that are
/// longer than a line.
fn lines(text: &str, room: f32) -> Vec<String> {
    let fits = |line: &str| font::width(line, label::LABEL.size, label::LABEL.weight) <= room;
    let cut: String = text.chars().take(MAX_CHARACTERS).collect();
    let mut lines = Vec::new();
    for paragraph in cut.lines() {
        let mut line = String::new();
        for word in clean(paragraph).split_whitespace() {
            let longer = match line.as_str() {
                "" => word.to_owned(),
                line => format!("{line} {word}"),
            };
            if fits(&longer) {
                line = longer;
                continue;
            }
            if !line.is_empty() {
                lines.push(std::mem::take(&mut line));
            }
            for letter in word.chars() {
                line.push(letter);
                if !fits(&line) {
                    line.pop();
                    lines.push(std::mem::take(&mut line));
                    line.push(letter);
                }
            }
        }
        lines.push(line);
    }
    if text.chars().nth(MAX_CHARACTERS).is_some() {
        lines.push("…".to_owned());
    }
    lines
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // a test that cannot go on has failed

    use super::*;
    use crate::diagram::{self, Options};
    use crate::lang::load_text;
    use crate::pictures::scene::Shape;

    fn texts(text: &str, options: &Options) -> (Scene, Vec<String>) {
        let scene = diagram::draw(&load_text("case.esm", text).model.unwrap(), options).unwrap();
        let words = |shape: &Shape| match shape {
            Shape::Text(text) => Some(text.words.clone()),
            _ => None,
        };
        let found = scene.shapes.iter().filter_map(words).collect();
        (scene, found)
    }

    fn with_notes() -> Options {
        Options {
            notes: true,
            ..Options::default()
        }
    }

    const MISSION: &str = "interpreter slot 1; slot 1 period 10 ms duration 1 ms;
        /// Turns.
        task Turn slot 1 {
            /// Where to.
            in flag left;
        }
        /// Nobody uses it.
        task Other slot 1 { }
        /// Gets out of the way.
        container Escape { region steps {
            /// Backwards.
            task Back: Turn; initial -> Back; Back -> final on *; } }
        /// All of it.
        machine Robot {
            /// Where it goes.
            region motion {
                super Away: Escape; super Again: Escape;
                initial -> Away; Away -> Again on *; Again -> Away on *; } }";

    #[test]
    fn notes_of_what_is_drawn_stand_below_it_once() {
        let (_, found) = texts(MISSION, &with_notes());
        let first = found.iter().position(|it| it == "All of it.").unwrap() - 1;
        assert_eq!(
            found[first..],
            [
                "machine Robot",
                "All of it.",
                "region motion",
                "Where it goes.",
                "container Escape",
                "Gets out of the way.",
                "Escape/steps/Back",
                "Backwards.",
                "task Turn",
                "Turns.",
                "Turn.left",
                "Where to.",
            ]
        );
        let (_, found) = texts(MISSION, &Options::default());
        assert!(!found.contains(&"All of it.".to_owned()));
        let shallow = Options {
            depth: Some(0),
            ..with_notes()
        };
        let (_, found) = texts(MISSION, &shallow);
        assert!(!found.contains(&"Backwards.".to_owned()), "{found:?}");
    }

    #[test]
    fn long_notes_stay_on_the_sheet_and_have_an_end() {
        let words = format!("/// {} {}\n", "many words ".repeat(100), "w".repeat(3_000));
        let text = MISSION.replace("/// All of it.\n", &words.repeat(300));
        let (scene, found) = texts(&text, &with_notes());
        assert!(found.len() < MAX_LINES + 100 && found.last().unwrap() == "Where to.");
        for shape in &scene.shapes {
            if let Shape::Text(text) = shape {
                let right = text.at[0] + font::width(&text.words, text.size, text.weight);
                assert!(right < scene.width && text.at[1] < scene.height, "{text:?}");
            }
        }
        let many: String = (0..20)
            .map(|at| format!("\n/// {}\n state A{at};", "x".repeat(MAX_CHARACTERS)))
            .collect();
        let text = format!("container C {{ region r {{ {many} initial -> A0; }} }}");
        let (_, found) = texts(&text, &with_notes());
        assert_eq!(found.last().unwrap(), "…");
    }
}
