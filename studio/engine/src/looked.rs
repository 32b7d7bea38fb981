//! What is looked at: the recording of a run, of a file or of a robot that is connected.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;

use esm_toolkit::parameters::Value as Number;
use esm_toolkit::recording::missing::Since;
use esm_toolkit::recording::player::Recording;
use esm_toolkit::recording::told::Told;
use esm_toolkit::recording::walk::Walk;
use esm_toolkit::values::{Shape, Watched};
use serde::Deserialize;
use serde_json::{Value, json};

/// Sonars of the robot that ships, each 45° from the one before.
const SONARS: usize = 8;

/// How far sound goes there and back, in metres for a microsecond.
const ECHO_M_PER_US: f32 = 343e-6 / 2.0;

/// A term of a guard.
#[derive(Deserialize)]
pub struct Term {
    from: String,
    to: String,
    /// Which of the transitions from one state to the other.
    #[serde(default)]
    number: usize,
    term: String,
}

/// What is looked at.
enum Looked {
    Nothing,
    /// A recording that grows no more: it stays as long as the instance lives.
    Whole {
        recording: &'static Recording,
        walk: Box<Walk<'static>>,
        told: Box<Told>,
    },
    /// One that grows.
    Growing {
        recording: Box<Recording>,
        told: Box<Told>,
    },
}

thread_local! {
    static LOOKED: RefCell<Looked> = const { RefCell::new(Looked::Nothing) };
}

/// Looks at a recording from now on. Answers what ends its replay early.
pub fn at(recording: Recording) -> Option<String> {
    let recording = Box::leak(Box::new(recording));
    let (walk, _) = Walk::new(recording, true);
    let (told, ended) = Told::of(recording);
    let (walk, told) = (Box::new(walk), Box::new(told));
    LOOKED.set(Looked::Whole {
        recording,
        walk,
        told,
    });
    ended.err().map(|error| error.to_string())
}

/// Looks at a recording from now on in whose place another one comes soon. Where a time is named,
/// only if it holds that; false otherwise.
pub fn at_growing(recording: Recording, t_us: Option<u64>) -> bool {
    let (told, _) = Told::of(&recording);
    let first_us = told.span_us.map_or(u64::MAX, |span_us| span_us.0);
    if t_us.is_some_and(|t_us| t_us < first_us) {
        return false;
    }
    let (recording, told) = (Box::new(recording), Box::new(told));
    LOOKED.set(Looked::Growing { recording, told });
    true
}

fn with<T>(look: impl FnOnce(&Recording, &Told) -> T) -> Result<T, String> {
    LOOKED.with_borrow(|looked| match looked {
        Looked::Nothing => Err("there is nothing to look at yet".to_owned()),
        Looked::Whole {
            recording, told, ..
        } => Ok(look(recording, told)),
        Looked::Growing { recording, told } => Ok(look(recording, told)),
    })
}

fn with_walk<T>(look: impl FnOnce(&Walk<'_>) -> T) -> Result<T, String> {
    LOOKED.with_borrow(|looked| match looked {
        Looked::Nothing => Err("there is nothing to look at yet".to_owned()),
        Looked::Whole { walk, .. } => Ok(look(walk)),
        Looked::Growing { recording, .. } => Ok(look(&Walk::new(recording, true).0)),
    })
}

/// What the machine had to choose from at a time.
///
/// # Errors
/// There is nothing to look at yet.
pub fn choices(t_us: u64) -> Result<Value, String> {
    with_walk(|walk| {
        let Some(choices) = walk.choices_at(t_us) else {
            return Value::Null;
        };
        let micro_steps: Vec<Value> = (choices.micro_steps.iter())
            .map(|micro| {
                let choices: Vec<Value> = (micro.choices.iter())
                    .map(|it| {
                        json!({
                            "from": it.from, "to": it.to, "event": it.event,
                            "heard": it.is_heard, "guard": it.guard, "terms": it.terms,
                            "holds": it.holds, "taken": it.is_taken,
                        })
                    })
                    .collect();
                json!({ "event": micro.event, "choices": choices })
            })
            .collect();
        json!({
            "step": choices.step, "t_us": choices.t_us, "micro_steps": micro_steps,
        })
    })
}

/// Why the transitions from one state to another were not taken in the macro step of a time.
///
/// # Errors
/// There is nothing to look at yet.
pub fn missing(t_us: u64, from: &str, to: &str) -> Result<Value, String> {
    let since = |it: Since| json!({ "step": it.step, "t_us": it.t_us, "first": it.is_first });
    with_walk(|walk| {
        let all = walk.missing_at(t_us, from, to).into_iter().map(|it| {
            let terms: Vec<Value> = (it.terms.into_iter())
                .map(|term| {
                    json!({
                        "name": term.name, "set": term.is_set, "since": since(term.since),
                    })
                })
                .collect();
            json!({
                "event": it.event, "guard": it.guard, "current": it.is_current,
                "since": since(it.since), "terms": terms, "missing": it.missing,
            })
        });
        all.collect()
    })
}

/// The values of a term of a guard over time.
///
/// # Errors
/// There is nothing to look at yet.
pub fn term(term: &Term) -> Result<Value, String> {
    let transition = (term.from.as_str(), term.to.as_str(), term.number);
    with_walk(|walk| json!(walk.term_over_time(transition, &term.term)))
}

/// A number as curves have it; none of what is none.
fn number(value: &Number) -> Option<f32> {
    let number = match *value {
        Number::Bool(value) => f32::from(u8::from(value)),
        Number::I32(value) => value as f32,
        Number::U32(value) => value as f32,
        Number::F32(value) => value,
    };
    number.is_finite().then_some(number)
}

/// The curves that the recorded values make, by name: unit, net, and place in its values.
fn known_curves(recording: &Recording) -> BTreeMap<String, &'static str> {
    let mut curves = BTreeMap::new();
    let mut seen: Vec<Arc<[Watched]>> = Vec::new();
    for sample in recording.samples().flatten() {
        if seen.iter().any(|nets| Arc::ptr_eq(nets, &sample.nets)) {
            continue;
        }
        for watched in sample.nets.iter() {
            for (place, field) in watched.fields.iter().enumerate() {
                curves.insert(watched.name_of(place), field.label().1);
            }
        }
        seen.push(sample.nets);
    }
    curves
}

/// Which numbers on nets there are, each with its unit.
///
/// # Errors
/// There is nothing to look at yet.
pub fn curves() -> Result<Value, String> {
    with(|recording, _| json!(known_curves(recording).into_iter().collect::<Vec<_>>()))
}

/// Values that are watched together, and where among them one stands.
type PlaceOf = (Arc<[Watched]>, Option<(usize, usize)>);

/// A region, by its mission and its number there, and the state that it is in from then on.
type Change = ((usize, usize), Option<String>);

/// A number over time: pairs of a time and what it was then.
///
/// # Errors
/// There is nothing to look at yet.
pub fn curve(name: &str, from_us: u64) -> Result<Value, String> {
    with(|recording, told| {
        let mut place_of: Option<PlaceOf> = None;
        let mut points: Vec<(u64, f32)> = Vec::new();
        for sample in recording.samples().flatten() {
            let Some((t_us, _)) = told.place(&sample, recording).filter(|it| it.0 >= from_us)
            else {
                continue;
            };
            let known = (place_of.as_ref()).filter(|(nets, _)| Arc::ptr_eq(nets, &sample.nets));
            let place = match known {
                Some((_, place)) => *place,
                None => {
                    let nets = sample.nets.iter().enumerate();
                    let place = nets.into_iter().find_map(|(net, watched)| {
                        let mut places = 0..watched.fields.len();
                        let place = places.find(|place| watched.name_of(*place) == name)?;
                        Some((net, place))
                    });
                    place_of = Some((Arc::clone(&sample.nets), place));
                    place
                }
            };
            let value = place.and_then(|(net, place)| {
                let values = sample.values.get(net)?.as_ref()?;
                number(values.get(place)?)
            });
            points.extend(value.map(|value| (t_us, value)));
        }
        json!(points)
    })
}

/// The slots of the mission of a time, with the task states that each executes.
///
/// # Errors
/// There is nothing to look at yet.
pub fn slots(t_us: u64) -> Result<Value, String> {
    with(|recording, told| {
        let run = (told.missions.iter()).rposition(|mission| mission.start_us <= t_us);
        let mission = run.and_then(|run| {
            let name = told.mission(run);
            recording.missions.iter().find(|it| it.name == name)
        });
        let Some((run, mission)) = run.zip(mission) else {
            return Value::Null;
        };
        let tables = mission.verified.tables();
        let interpreter = tables.interpreter_slot();
        let mut slots: Vec<(Value, Vec<String>)> = (tables.slots().enumerate())
            .map(|(index, slot)| {
                let told = json!({
                    "number": slot.number, "start_us": slot.start_us, "period_us": slot.period_us,
                    "duration_us": slot.duration_us, "interpreter": index == interpreter,
                });
                (told, Vec::new())
            })
            .collect();
        for (instance, state) in mission.directory.task_states().iter().enumerate() {
            let slot = tables.task_state_of(instance).and_then(|it| it.slot);
            let entry = slot.and_then(|slot| slots.get_mut(slot));
            if let Some((entry, state)) = entry.zip(mission.directory.state(*state)) {
                entry.1.push(state.path.clone());
            }
        }
        let slots: Vec<Value> = (slots.into_iter())
            .map(|(mut slot, tasks)| {
                slot["tasks"] = json!(tasks);
                slot
            })
            .collect();
        let start_us = told.missions.get(run).map_or(0, |it| it.start_us);
        json!({ "start_us": start_us, "slots": slots })
    })
}

/// The states that were current from a time on, where that has changed.
fn active(told: &Told) -> Vec<(u64, Vec<String>)> {
    // Where a region is in the order of the source, so that outer states stand before inner ones.
    let mut changes: BTreeMap<u64, Vec<Change>> = BTreeMap::new();
    for (run, mission) in told.missions.iter().enumerate() {
        for (number, region) in mission.regions.iter().enumerate() {
            for span in &region.spans {
                let path = format!("{}/{}", region.path, span.state);
                let begins = changes.entry(span.start_us).or_default();
                begins.push(((run, number), Some(path)));
                let ends = changes.entry(span.end_us).or_default();
                ends.insert(0, ((run, number), None));
            }
        }
    }
    let mut now: BTreeMap<(usize, usize), String> = BTreeMap::new();
    let mut all: Vec<(u64, Vec<String>)> = Vec::new();
    for (t_us, changed) in changes {
        for (place, path) in changed {
            match path {
                Some(path) => drop(now.insert(place, path)),
                None => drop(now.remove(&place)),
            }
        }
        let paths: Vec<String> = now.values().cloned().collect();
        // What was current at the end stays what is known last.
        let is_end = paths.is_empty();
        if !is_end && all.last().is_none_or(|(_, last)| *last != paths) {
            all.push((t_us, paths));
        }
    }
    all
}

/// The poses and ranges of the samples, as the page shows a robot: by its own odometry.
fn shown(recording: &Recording, told: &Told, moved_us: u64) -> Vec<Value> {
    let mut shown = Vec::new();
    for sample in recording.samples().flatten() {
        let Some((t_us, _)) = told.place(&sample, recording) else {
            continue;
        };
        let mut pairs = sample.nets.iter().zip(&sample.values);
        let pose = pairs.find_map(|(watched, values)| {
            (watched.shape() == Shape::Pose).then_some(values.as_deref()?)
        });
        let Some(
            [
                Number::F32(x_m),
                Number::F32(y_m),
                Number::F32(heading_rad),
                ..,
            ],
        ) = pose
        else {
            continue;
        };
        let mut pairs = sample.nets.iter().zip(&sample.values);
        let ranges = pairs.find_map(|(watched, values)| {
            let values = values.as_deref()?;
            let fields = watched.fields.iter().zip(values);
            let echoes: Vec<Option<u32>> = fields
                .filter(|(field, _)| field.is_range())
                .map(|(field, value)| {
                    let range_m = field.range_m(value);
                    range_m
                        .is_finite()
                        .then_some((range_m / ECHO_M_PER_US) as u32)
                })
                .collect();
            (echoes.len() == SONARS).then_some(echoes)
        });
        let echoes = ranges.unwrap_or_default();
        let t_us = t_us + moved_us;
        shown.push(json!([t_us, x_m, y_m, heading_rad, null, null, echoes]));
    }
    shown
}

/// What there is to see of a recording over time, in the order of time.
#[derive(Default)]
pub struct Lists {
    /// The states that were current from a time on.
    pub active: Vec<(u64, Vec<String>)>,
    /// Transitions that were taken.
    pub transitions: Vec<Value>,
    /// Where the robot was.
    pub shown: Vec<Value>,
    /// Faults.
    pub faults: Vec<Value>,
    /// Runs of missions: name, start, end.
    pub missions: Vec<(String, u64, u64)>,
    /// First and last moment.
    pub span_us: Option<(u64, u64)>,
}

impl Lists {
    /// Those of a recording, all times moved by `moved_us`.
    pub fn of(recording: &Recording, told: &Told, moved_us: u64) -> Self {
        let transitions = told.transitions.iter().filter_map(|then| {
            let words = told.words(then)?;
            let sent = words.sent;
            let t_us = then.t_us + moved_us;
            Some(json!([t_us, words.from, words.to, words.event, sent]))
        });
        let faults = (told.faults.iter()).map(|fault| json!([fault.t_us + moved_us, fault.code]));
        let missions = told.missions.iter().map(|it| {
            let name = it.name.clone();
            (name, it.start_us + moved_us, it.end_us + moved_us)
        });
        let mut active = active(told);
        active.iter_mut().for_each(|(t_us, _)| *t_us += moved_us);
        Lists {
            active,
            transitions: transitions.collect(),
            shown: shown(recording, told, moved_us),
            faults: faults.collect(),
            missions: missions.collect(),
            span_us: told.span_us.map(|(first, last)| {
                // Of a machine under way whose next macro step is not known of, nothing was told.
                let has_run = recording.stretches.iter().any(|it| it.made > 0);
                (
                    first + moved_us,
                    if has_run { last } else { first } + moved_us,
                )
            }),
        }
    }

    /// As the page is told of it: the first so many of states, transitions and places it knows.
    pub fn told(&self, recording: &Recording, told: &Told, known: [usize; 3]) -> Value {
        let (start_us, end_us) = self.span_us.unwrap_or((0, 0));
        let of_last = told.missions.last();
        let last =
            of_last.and_then(|last| recording.missions.iter().find(|it| it.name == last.name));
        let missions = self.missions.iter().map(|(name, start_us, end_us)| {
            json!({ "name": name, "start_us": start_us, "end_us": end_us })
        });
        json!({
            "board": recording.head.board,
            "firmware": recording.head.firmware,
            "hash": last.map(|it| esm_toolkit::mission_hash::hash_text(it.verified.hash())),
            "period_us": last.map(|it| it.directory.interpreter_period_us()),
            "missions": missions.collect::<Vec<_>>(),
            "start_us": start_us,
            "end_us": end_us,
            "kept": known,
            "active": self.active.get(known[0]..),
            "transitions": self.transitions.get(known[1]..),
            "shown": self.shown.get(known[2]..),
            "faults": self.faults,
        })
    }
}

/// All that there is to see of what is looked at.
///
/// # Errors
/// There is nothing to look at yet.
pub fn all() -> Result<Value, String> {
    with(|recording, told| Lists::of(recording, told, 0).told(recording, told, [0; 3]))
}
