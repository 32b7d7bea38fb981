//! What is different between two missions, by the tables of their blobs, and what of the one that
//! runs goes on in the other after a warm swap.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use esm_core::Verified;
use esm_core::tables::{self, Tables};
use serde::Serialize;

use super::{RegionTable, Report, StateRow, TransitionRow};
use crate::trace::directory::{Directory, NoDirectory, StateId, StateKind};

/// How two missions differ in one kind of thing.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Difference {
    /// Only the second has them.
    pub added: Vec<String>,
    /// Only the first has them.
    pub gone: Vec<String>,
    /// Both have them, and they are not the same: as they were, and as they are.
    pub changed: Vec<Changed>,
}

/// A thing that is not what it was.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Changed {
    /// What it is called.
    pub name: String,
    /// As it was.
    pub from: String,
    /// As it is.
    pub to: String,
}

/// How two missions differ. States, transitions and parameters are those of containers, each
/// counted once however often it is used.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Changes {
    /// Hash of the first.
    pub from: String,
    /// Hash of the second.
    pub to: String,
    /// Whether both have their names; otherwise made-up ones are compared, which say little.
    pub has_names: bool,
    /// Event queue and interpreter's slot.
    pub settings: Difference,
    /// Slots with their timing.
    pub slots: Difference,
    /// Tasks with their signatures.
    pub tasks: Difference,
    /// States, with what they are.
    pub states: Difference,
    /// Transitions as they are written; one that changes is one that is gone and one that is added.
    pub transitions: Difference,
    /// Parameters of task states that both have.
    pub parameters: Difference,
    /// Ways of data between ports.
    pub paths: Difference,
}

/// What of a mission that runs goes on after a warm swap to another.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Migration {
    /// Paths of the current states that go on.
    pub goes_on: Vec<String>,
    /// Paths of the regions that will be active and start at `initial`.
    pub starts_anew: Vec<String>,
    /// Paths of the current states that end.
    pub ends: Vec<String>,
}

impl Changes {
    /// Compares two missions.
    #[must_use]
    pub fn between(before: &Verified<Vec<u8>>, after: &Verified<Vec<u8>>) -> Self {
        let (before, after) = (Report::of(before), Report::of(after));
        let both = |what: fn(&Report) -> BTreeMap<String, String>| {
            Difference::between(&what(&before), &what(&after))
        };
        let states = both(states);
        let mut parameters = both(parameters);
        // Those of new and old states say nothing new.
        parameters.added.clear();
        parameters.gone.clear();
        Changes {
            from: before.hash.clone(),
            to: after.hash.clone(),
            has_names: before.has_names && after.has_names,
            settings: both(settings),
            slots: both(slots),
            tasks: both(tasks),
            states,
            transitions: both(transitions),
            parameters,
            paths: both(paths),
        }
    }

    fn kinds(&self) -> [(&'static str, &Difference); 7] {
        [
            ("settings", &self.settings),
            ("slots", &self.slots),
            ("tasks", &self.tasks),
            ("states", &self.states),
            ("transitions", &self.transitions),
            ("parameters", &self.parameters),
            ("paths", &self.paths),
        ]
    }

    /// Whether nothing is different that has a name.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.kinds().iter().all(|(_, kind)| kind.len() == 0)
    }

    /// The changes for a person: of each kind at most so many.
    #[must_use]
    pub fn text(&self, most: usize) -> String {
        let mut text = String::new();
        if !self.has_names {
            text.push_str("names were left out of a blob; what is compared is made up\n");
        }
        for (kind, difference) in self.kinds() {
            difference.write(kind, most, &mut text);
        }
        if self.is_empty() {
            text.push_str("no difference\n");
        }
        text
    }
}

impl Difference {
    fn between(before: &BTreeMap<String, String>, after: &BTreeMap<String, String>) -> Self {
        let only = |here: &BTreeMap<String, String>, there: &BTreeMap<String, String>| {
            let names = here.keys().filter(|name| !there.contains_key(*name));
            names.cloned().collect()
        };
        Difference {
            added: only(after, before),
            gone: only(before, after),
            changed: before
                .iter()
                .filter_map(|(name, from)| {
                    let to = after.get(name).filter(|to| *to != from)?;
                    Some(Changed {
                        name: name.clone(),
                        from: from.clone(),
                        to: to.clone(),
                    })
                })
                .collect(),
        }
    }

    fn len(&self) -> usize {
        self.added.len() + self.gone.len() + self.changed.len()
    }

    fn write(&self, kind: &str, most: usize, text: &mut String) {
        if self.len() == 0 {
            return;
        }
        let counts = [
            (self.added.len(), "new"),
            (self.gone.len(), "gone"),
            (self.changed.len(), "changed"),
        ];
        let counts: Vec<String> = counts
            .iter()
            .filter(|(count, _)| *count > 0)
            .map(|(count, what)| format!("{count} {what}"))
            .collect();
        let _ = writeln!(text, "{kind}: {}", counts.join(", "));
        let changed = (self.changed.iter())
            .map(|Changed { name, from, to }| format!("  ~ {name}: {from} -> {to}"));
        let gone = self.gone.iter().map(|name| format!("  - {name}"));
        let added = self.added.iter().map(|name| format!("  + {name}"));
        for line in changed.chain(gone).chain(added).take(most) {
            let _ = writeln!(text, "{line}");
        }
        if let Some(left @ 1..) = self.len().checked_sub(most) {
            let _ = writeln!(text, "  … {left} more");
        }
    }
}

/// A time as it is written.
fn time(us: u32) -> String {
    match us {
        0 => "0 ms".to_owned(),
        us if us.is_multiple_of(1_000_000) => format!("{} s", us / 1_000_000),
        us if us.is_multiple_of(1_000) => format!("{} ms", us / 1_000),
        us => format!("{us} us"),
    }
}

fn settings(report: &Report) -> BTreeMap<String, String> {
    let queue = ("queue".to_owned(), report.queue.to_string());
    let slot = report.interpreter_slot.to_string();
    BTreeMap::from([queue, ("interpreter slot".to_owned(), slot)])
}

fn slots(report: &Report) -> BTreeMap<String, String> {
    let slots = report.slots.iter().map(|slot| {
        let timing = format!(
            "period {}, duration {}, start {}",
            time(slot.period_us),
            time(slot.duration_us),
            time(slot.start_us)
        );
        (format!("slot {}", slot.slot), timing)
    });
    slots.collect()
}

fn tasks(report: &Report) -> BTreeMap<String, String> {
    let tasks = report.tasks.iter();
    tasks
        .map(|task| (task.name.clone(), task.signature.clone()))
        .collect()
}

/// The regions of a mission, each with what its states' names begin with: nothing in the machine,
/// else the container's name.
fn regions(report: &Report) -> impl Iterator<Item = (String, &RegionTable)> {
    let containers = report.container_tables.iter().enumerate();
    containers.flat_map(|(index, container)| {
        container.regions.iter().map(move |region| {
            let name = &region.name;
            let path = match index {
                0 => name.clone(),
                _ => format!("{}/{name}", container.name),
            };
            (path, region)
        })
    })
}

fn states(report: &Report) -> BTreeMap<String, String> {
    let states = regions(report).flat_map(|(path, region)| {
        let states = region.states.iter();
        states.map(move |state| (format!("{path}/{}", state.name), what_it_is(state)))
    });
    states.collect()
}

fn what_it_is(state: &StateRow) -> String {
    let mut text = state.kind.to_owned();
    if let Some(of) = &state.of {
        let _ = write!(text, " {of}");
    }
    if let Some(slot) = state.slot {
        let _ = write!(text, " slot {slot}");
    }
    if let Some(timeout_us) = state.timeout_us {
        let _ = write!(text, " timeout {}", time(timeout_us));
    }
    text
}

fn transitions(report: &Report) -> BTreeMap<String, String> {
    let transitions = regions(report).flat_map(|(path, region)| {
        let transitions = region.transitions.iter();
        transitions
            .map(move |transition| (format!("{path}: {}", as_written(transition)), String::new()))
    });
    transitions.collect()
}

fn as_written(transition: &TransitionRow) -> String {
    let TransitionRow {
        from,
        to,
        event,
        guard,
        actions,
    } = transition;
    let mut text = format!("{from} -> {to}");
    if event != "pulse" {
        let _ = write!(text, " on {event}");
    }
    if let Some(guard) = guard {
        let _ = write!(text, " [{guard}]");
    }
    if !actions.is_empty() {
        let _ = write!(text, " / {}", actions.join(", "));
    }
    text
}

fn parameters(report: &Report) -> BTreeMap<String, String> {
    let parameters = regions(report).flat_map(|(path, region)| {
        region.states.iter().flat_map(move |state| {
            let path = path.clone();
            let params = state.params.iter();
            params
                .map(move |(name, value)| (format!("{path}/{}.{name}", state.name), value.clone()))
        })
    });
    parameters.collect()
}

fn paths(report: &Report) -> BTreeMap<String, String> {
    let paths = report.nets.iter().flat_map(|net| {
        net.writers.iter().flat_map(move |writer| {
            let readers = net.readers.iter();
            readers.map(move |reader| (format!("{writer} -> {reader}"), net.type_name.clone()))
        })
    });
    paths.collect()
}

impl Migration {
    /// What goes on of a mission whose region instances are in these states (none where they are
    /// not active), by the rules of [`Interpreter::take_over`](esm_core::Interpreter::take_over).
    ///
    /// # Errors
    /// One of the blobs has no names, so that nothing goes on.
    pub fn between(
        before: &Tables<'_>,
        current: impl Fn(usize) -> Option<usize>,
        after: &Tables<'_>,
    ) -> Result<Self, NoDirectory> {
        let (old, new) = (Directory::of(before)?, Directory::of(after)?);
        let active: BTreeMap<&str, StateId> = old
            .regions()
            .iter()
            .filter_map(|region| {
                let id = old.state_at(region.index, current(region.index)?)?;
                Some((region.path.as_str(), id))
            })
            .collect();
        let path_of = |id| old.state(id).map(|state| state.path.clone());
        let mut carried = Migration::default();
        let mut waiting = vec![None];
        while let Some(owner) = waiting.pop() {
            for region in new.regions_of(owner) {
                let next = active.get(region.path.as_str()).and_then(|id| {
                    let next = region.find(old.state(*id)?.name())?;
                    let (here, there) = (new.index_of(next)?, old.index_of(*id)?);
                    is_same_kind(after, here, before, there).then_some(next)
                });
                match next.and_then(|next| Some((next, new.state(next)?))) {
                    Some((next, state)) => {
                        carried.goes_on.push(state.path.clone());
                        if matches!(state.kind, StateKind::Super { .. }) {
                            waiting.push(Some(next));
                        }
                    }
                    None => carried.starts_anew.push(region.path.clone()),
                }
            }
        }
        carried.goes_on.sort();
        carried.starts_anew.sort();
        carried.ends = active.values().filter_map(|id| path_of(*id)).collect();
        carried
            .ends
            .retain(|path| carried.goes_on.binary_search(path).is_err());
        Ok(carried)
    }

    /// What goes on, for a person: of each kind at most so many.
    #[must_use]
    pub fn text(&self, most: usize) -> String {
        let mut text = String::new();
        for (what, paths) in [
            ("goes on", &self.goes_on),
            ("starts anew", &self.starts_anew),
            ("ends", &self.ends),
        ] {
            if paths.is_empty() {
                continue;
            }
            let shown: Vec<&str> = paths.iter().map(String::as_str).take(most).collect();
            let _ = write!(text, "{what}: {}", shown.join(", "));
            match paths.len().checked_sub(most) {
                Some(left @ 1..) => {
                    let _ = writeln!(text, " and {left} more");
                }
                _ => text.push('\n'),
            }
        }
        text
    }
}

/// Whether a state can go on as another: both are of one kind, and tasks have one signature.
fn is_same_kind(after: &Tables<'_>, here: usize, before: &Tables<'_>, there: usize) -> bool {
    let kind = |tables: &Tables<'_>, state: usize| {
        let task = tables.task_state_at(state);
        let task = task.and_then(|record| tables.task(tables.task_state(record)?.task));
        let real_time = match tables.state(state)?.kind {
            tables::StateKind::Task { real_time, .. } => Some(real_time),
            _ => None,
        };
        let kind = std::mem::discriminant(&tables.state(state)?.kind);
        Some((kind, real_time, task.map(|task| task.signature_hash)))
    };
    kind(after, here) == kind(before, there)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::compile::compile;
    use crate::lang;
    use esm_core::{Interpreter, StateMapping};
    use std::time::Duration;

    fn blob(text: &str) -> Verified<Vec<u8>> {
        let mut checked = lang::load_text("m.esm", text);
        let schedule = checked.lay_out(Duration::from_secs(5)).expect("it fits");
        let model = checked.model.expect("it is right");
        esm_core::verify(compile(&model, &schedule).unwrap()).unwrap()
    }

    const BEFORE: &str =
        "interpreter slot 1; slot 1 period 20 ms duration 1 ms; slot 2 period 40 ms duration 2 ms;
        task Beep slot 2 { param pitch: f32 = 440; }
        machine M { event Go;
          region r { state A; task B: Beep; initial -> A; A -> B on Go; }
          region old { state X; initial -> X / send Go; } }";

    const AFTER: &str = "interpreter slot 1; slot 1 period 20 ms duration 1 ms; slot 2 period 80 ms duration 2 ms;
        task Beep slot 2 { param pitch: f32 = 880; }
        machine M { event Go;
          region r { state A timeout 1 s; task B: Beep; state C; initial -> A; A -> B on Go; B -> C [exit]; }
          region fresh { state X; initial -> X / send Go; } }";

    #[test]
    fn what_is_different_is_told_by_name() {
        let changes = Changes::between(&blob(BEFORE), &blob(AFTER));
        assert_eq!(changes.text(1).lines().next(), Some("slots: 1 changed"));
        let text = changes.text(9);
        for expected in [
            "  ~ r/A: state -> state timeout 1 s",
            "  + r/C",
            "  - old/X",
            "  + r: B -> C [exit]",
            "  ~ r/B.pitch: 440 -> 880",
        ] {
            assert!(
                text.lines().any(|line| line == expected),
                "{expected}\n{text}"
            );
        }
        assert!(
            text.contains("period 40 ms") && text.contains("-> period 80 ms"),
            "{text}"
        );
        assert!(changes.text(0).contains("  … 1 more"));
        let same = Changes::between(&blob(BEFORE), &blob(BEFORE));
        assert!(same.is_empty());
        assert_eq!(same.text(9), "no difference\n");
    }

    #[test]
    fn what_goes_on_is_what_the_interpreter_takes_over() {
        let (before, after) = (blob(BEFORE), blob(AFTER));
        let (old_tables, new_tables) = (before.clone(), after.clone());
        let (mut a, mut b) = (vec![0; before.arena_words()], vec![0; after.arena_words()]);
        let mut old = Interpreter::new(before, &mut a).unwrap();
        let mut new = Interpreter::new(after, &mut b).unwrap();
        for _ in 0..3 {
            old.macro_step(&mut ()).unwrap();
        }
        let current = |region| old.is_region_active(region).then(|| old.current(region));
        let carried = Migration::between(&old_tables.tables(), current, &new_tables.tables());
        let carried = carried.unwrap();
        assert_eq!(carried.goes_on, ["r/B"]);
        assert_eq!(carried.starts_anew, ["fresh"]);
        assert_eq!(carried.ends, ["old/X"]);
        assert_eq!(
            carried.text(9),
            "goes on: r/B\nstarts anew: fresh\nends: old/X\n"
        );
        let mut table = [0; 64];
        let mut mapping = StateMapping::new(&mut table);
        let found = mapping.find(&new_tables.tables(), &old_tables.tables(), |_| 0);
        found.unwrap();
        let taken_over = new.take_over(&old, &mapping);
        assert_eq!((taken_over.regions, taken_over.anew), (1, 1));
    }
}
