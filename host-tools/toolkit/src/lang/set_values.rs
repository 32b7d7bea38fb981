//! Values of parameters, written into the text of a mission.

use super::diagnostic::{Edit, Fix};
use super::tree::{File, State, StateKind};
use crate::model::Span;

/// A mission with other values of parameters.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Rewritten {
    /// Its text.
    pub text: String,
    /// How many task states have them.
    pub states: usize,
}

/// The text of a file with these values in all task states of `task`: a value that stands there is
/// replaced, one that does not is added.
pub(super) fn rewritten(
    text: &str,
    tree: &File,
    task: &str,
    values: &[(&str, String)],
) -> Option<Rewritten> {
    let regions = (tree.containers.iter()).flat_map(|container| &container.regions);
    let mut edits = Vec::new();
    let mut states = 0;
    for state in regions.flat_map(|region| &region.states) {
        let of_task = edits_of(state, text, task, values);
        states += usize::from(of_task.is_some());
        edits.extend(of_task.into_iter().flatten());
    }
    Some(Rewritten {
        text: Fix::new("write the values", edits).apply(text)?,
        states,
    })
}

/// What changes in a state. None if it is none of this task.
fn edits_of(state: &State, text: &str, task: &str, values: &[(&str, String)]) -> Option<Vec<Edit>> {
    let StateKind::Task {
        task: name, with, ..
    } = &state.kind
    else {
        return None;
    };
    let word = |start: u32, end: u32| text.get(start as usize..end as usize);
    let is_task = name.is_some_and(|name| word(name.0.start, name.0.end) == Some(task));
    if !is_task {
        return None;
    }
    let mut edits = Vec::new();
    let mut added = Vec::new();
    for (name, value) in values {
        let given = with.iter().find_map(|(given, literal)| {
            let is_this = word(given.0.start, given.0.end) == Some(*name);
            literal.filter(|_| is_this)
        });
        match given {
            Some(literal) => edits.push(Edit::replace(literal.span, value.as_str())),
            None => added.push(format!("{name} = {value}")),
        }
    }
    if !added.is_empty() {
        let added = added.join(", ");
        let last = with.iter().rev().find_map(|(_, literal)| *literal);
        edits.push(match last {
            Some(literal) => Edit::behind(literal.span, format!(", {added}")),
            None => {
                let end = text
                    .get(..state.span.end as usize)?
                    .trim_end_matches(';')
                    .len() as u32;
                let place = Span {
                    start: end,
                    end,
                    ..state.span
                };
                Edit::replace(place, format!(" with {{ {added} }}"))
            }
        });
    }
    Some(edits)
}

#[cfg(test)]
mod tests {
    use super::super::load_texts;

    fn rewritten(states: &str) -> Option<(String, usize)> {
        let text = format!(
            "interpreter slot 1; slot 1 period 20 ms duration 1 ms; slot 2 period 20 ms duration 1 ms;
            task W slot 2 wcet 1 us {{ param a: f32 = 1.0 min 0.0 max 9.0; param b: f32 = 1.0 min 0.0 max 9.0; }}
            task V slot 2 wcet 1 us {{ param a: f32 = 1.0 min 0.0 max 9.0; }}
            machine M {{ region r {{ {states} initial -> A; A -> B on pulse; B -> A on pulse; }} }}"
        );
        let checked = load_texts(&[("m.esm", &text)]);
        let values = [("a", "2.5".to_owned()), ("b", "0.5".to_owned())];
        let done = checked.with_values("W", &values)?;
        let from = done.text.find("region r { ")? + "region r { ".len();
        let to = done.text.find(" initial ->")?;
        Some((done.text[from..to].to_owned(), done.states))
    }

    #[test]
    fn values_are_replaced_and_added_in_the_states_of_the_task() {
        for (states, expected, count) in [
            (
                "task A: W; task B: V;",
                "task A: W with { a = 2.5, b = 0.5 }; task B: V;",
                1,
            ),
            (
                "task A: W timeout 1 s with { b = 3.0 }; task B: W with { a = 1.0, b = 2.0 };",
                "task A: W timeout 1 s with { b = 0.5, a = 2.5 }; task B: W with { a = 2.5, b = 0.5 };",
                2,
            ),
            (
                "task A: V with { a = 3.0 }; state B;",
                "task A: V with { a = 3.0 }; state B;",
                0,
            ),
        ] {
            let found = rewritten(states);
            assert_eq!(found, Some((expected.to_owned(), count)), "{states}");
        }
    }

    #[test]
    fn a_file_with_errors_stays_as_it_is() {
        assert_eq!(rewritten("task A: W with { c = 1.0 }; state B;"), None);
    }
}
