//! What a robot notes about its behaviours, in words.

use std::collections::BTreeMap;

use esm_link::behaviours::{Reaction, Situation};
use esm_link::black_box::{OWN_SITUATION, SAFETY_CHECK};

/// The states of a behaviour, by their numbers.
///
/// Source: Schoute, "Behaviour-based control framework for an autonomous mobile robot", figure 2.
pub const STATES: [&str; 5] = ["INITIAL", "EXECUTE", "SUSPEND", "RESUME", "DESTROY"];

/// Names of task types by the lower halves of the hashes of their signatures.
pub type TaskNames = BTreeMap<u16, String>;

/// The name of a state, of which a robot says that it has this number; none is that of a behaviour
/// which is not on the list.
pub fn state(number: Option<u8>) -> Option<&'static str> {
    let state = STATES.get(usize::from(number?));
    Some(state.copied().unwrap_or("?"))
}

/// What a behaviour is called: by its task where that is known.
pub fn behaviour(key: u16, task: u16, names: &TaskNames) -> String {
    match (key, task) {
        (0, _) => "IDLE".to_owned(),
        (_, 0) => "REMOTE_CONTROL".to_owned(),
        (_, task) => (names.get(&task).cloned())
            .unwrap_or_else(|| format!("the behaviour of task {task:04x}")),
    }
}

/// What a situation is called.
pub fn situation(number: u8) -> &'static str {
    match number {
        SAFETY_CHECK => "SAFETY_CHECK",
        OWN_SITUATION => "a situation of its own",
        number => {
            let known = Situation::ALL.get(usize::from(number));
            known.map_or("?", |situation| situation.names().0)
        }
    }
}

/// What is done about a situation, as scripts say it.
pub fn reaction(kind: u8) -> &'static str {
    let names = Reaction::NAMES.get(usize::from(kind));
    names.copied().unwrap_or("?")
}

/// A change of a behaviour's state, in words.
pub fn change(name: &str, key: u16, from: Option<&str>, to: Option<&str>) -> String {
    match (from, to) {
        (None, Some(to)) => format!("{name} ({key}) comes onto the list: {to}"),
        (Some(from), Some(to)) => format!("{name} ({key}): {from} -> {to}"),
        (Some(from), None) => format!("{name} ({key}): {from} -> DESTROY"),
        (None, None) => format!("{name} ({key}): ?"),
    }
}

/// A situation that has come up, in words.
pub fn came_up(name: &str, key: u16, situation: &str, reaction: &str) -> String {
    format!("{name} ({key}): {situation} has come up -> {reaction}")
}

/// What became of what the robot was told of its position.
pub fn corrected(is_difference: bool, is_refused: bool) -> &'static str {
    match (is_difference, is_refused) {
        (false, false) => "the robot is told where it is",
        (true, false) => "the robot is told how far off it is",
        (false, true) => "the robot is told where it is, which is beyond the bounds: refused",
        (true, true) => "the robot is told how far off it is, which is beyond the bounds: refused",
    }
}
