//! Why a transition was not taken: which terms of its guard were missing, and since when.

use std::rc::Rc;

use super::retold::Retold;
use super::walk::Walk;
use crate::inspect::guards::Read;

/// Terms of a guard that are turned over together at most, to find out what is missing: more is
/// nothing that a person would wait for.
const MOST_MISSING: usize = 4;

/// A macro step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Since {
    /// Its number in its mission.
    pub step: u64,
    /// When it was, in microseconds since the first macro step of the first mission.
    pub t_us: u64,
    /// Whether nothing is known of what was before: the mission or the recording begins there.
    pub is_first: bool,
}

/// A flag in a guard.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Term {
    /// As the source names it.
    pub name: String,
    /// Its value.
    pub is_set: bool,
    /// Since when it has had that.
    pub since: Since,
}

/// A transition that was not taken, or was.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Missing {
    /// The event that it is taken on; `pulse` also for `*`.
    pub event: String,
    /// Its guard as in the source, if it has one.
    pub guard: Option<String>,
    /// Whether its source is current.
    pub is_current: bool,
    /// Since when it is, or is not.
    pub since: Since,
    /// The flags in its guard, when the macro step began.
    pub terms: Vec<Term>,
    /// The fewest terms that would have to be different for the guard to be true, by their places:
    /// each of these sets would do. One that is empty where the guard is true.
    pub missing: Vec<Vec<usize>>,
}

/// What may change from one macro step to the next: whether the source of a transition is current,
/// and behind it the terms of its guard.
type Signals = Vec<bool>;

/// A transition of a mission, as it is looked at from macro step to macro step.
struct Looked<'r> {
    retold: Retold<'r>,
    region: usize,
    transition: usize,
    source: usize,
    terms: Vec<Read>,
    guard: Option<String>,
    event: String,
}

impl Looked<'_> {
    fn signals(&self) -> Signals {
        let is_current = self.retold.is_active(self.region, self.source);
        let terms = self.terms.iter();
        let terms = terms.map(|term| self.retold.is_set(self.region, term.bit));
        std::iter::once(is_current).chain(terms).collect()
    }

    /// The fewest terms that make the guard true when they are turned over.
    fn missing(&self, values: &[bool]) -> Vec<Vec<usize>> {
        let holds = |turned: &[usize]| {
            self.retold.holds_of(self.transition, |bit| {
                let place = self.terms.iter().position(|term| term.bit == bit);
                place.is_some_and(|place| {
                    let value = values.get(place).copied().unwrap_or(false);
                    value != turned.contains(&place)
                })
            })
        };
        let mut sets = vec![Vec::new()];
        for _ in 0..=MOST_MISSING {
            let found: Vec<Vec<usize>> = (sets.iter()).filter(|set| holds(set)).cloned().collect();
            if !found.is_empty() {
                return found;
            }
            let larger = |set: &Vec<usize>| {
                let next = set.last().map_or(0, |last| last + 1);
                let set = set.clone();
                (next..self.terms.len()).map(move |place| [set.as_slice(), &[place]].concat())
            };
            sets = sets.iter().flat_map(larger).collect();
        }
        Vec::new()
    }
}

impl<'r> Walk<'r> {
    /// Why the transitions from one state to another were not taken in the last macro step at or
    /// before a time, in microseconds since the first macro step of the first mission. Empty where
    /// the mission of that time has none.
    pub fn missing_at(&self, t_us: u64, from: &str, to: &str) -> Vec<Missing> {
        let Some((last, stretch)) = self.place_at(t_us) else {
            return Vec::new();
        };
        let looked = self.looked(stretch, from, to);
        (looked.into_iter())
            .filter_map(|looked| self.missing_of(looked, (last, stretch), t_us))
            .collect()
    }

    /// The values of a term of the guard of a transition over time: its first, and each that is
    /// another than the one before. `number` counts the transitions from one state to the other.
    pub fn term_over_time(
        &self,
        (from, to, number): (&str, &str, usize),
        term: &str,
    ) -> Vec<(u64, bool)> {
        let mut changes: Vec<(u64, bool)> = Vec::new();
        let mut known: Option<(usize, Option<Looked<'r>>)> = None;
        for (chunk, stretch) in self.places() {
            if known.as_ref().is_none_or(|(known, _)| *known != stretch) {
                let looked = self.looked(stretch, from, to).into_iter().nth(number);
                known = Some((stretch, looked));
            }
            let Some((_, Some(looked))) = &mut known else {
                continue;
            };
            let Some(bit) = (looked.terms.iter()).find(|it| it.name == term) else {
                continue;
            };
            let bit = bit.bit;
            self.run(chunk, |made, _, _| {
                looked.retold.begin(&made);
                let is_set = looked.retold.is_set(looked.region, bit);
                if changes.last().is_none_or(|(_, last)| *last != is_set) {
                    changes.push((self.time_of_step(stretch, made.step), is_set));
                }
                true
            });
        }
        changes
    }

    /// The transitions from one state to another in the mission of a stretch.
    fn looked(&self, stretch: usize, from: &str, to: &str) -> Vec<Looked<'r>> {
        let Some((mission, guards)) = self.mission_of(stretch) else {
            return Vec::new();
        };
        let directory = &*mission.directory;
        let tables = mission.verified.tables();
        let Some(id) = directory.find(from) else {
            return Vec::new();
        };
        let Some(source) = directory.index_of(id) else {
            return Vec::new();
        };
        (tables.transitions_of(source))
            .filter_map(|transition| {
                let words = directory.transition(id.region, transition)?;
                let guard = guards.read(transition);
                (words.to == to).then(|| Looked {
                    retold: Retold::new(mission, Rc::clone(guards)),
                    region: id.region,
                    transition,
                    source,
                    terms: guard.terms,
                    guard: guard.text,
                    event: words.event.to_owned(),
                })
            })
            .collect()
    }

    fn missing_of(
        &self,
        mut looked: Looked<'r>,
        (last, stretch): (usize, usize),
        t_us: u64,
    ) -> Option<Missing> {
        let mut now: Option<Signals> = None;
        let mut since: Vec<Option<Since>> = vec![None; looked.terms.len() + 1];
        let mut first = None;
        // From chunk to chunk towards the beginning, until each signal was another one.
        for (chunk, at) in self.places().rev() {
            if chunk > last {
                continue;
            }
            if at != stretch || since.iter().all(Option::is_some) {
                break;
            }
            let mut begins: Vec<Option<u64>> = vec![None; since.len()];
            let mut before: Option<Signals> = None;
            let mut first_step = None;
            self.run(chunk, |made, _, _| {
                if self.time_of_step(stretch, made.step) > t_us {
                    return false;
                }
                looked.retold.begin(&made);
                let signals = looked.signals();
                for (place, signal) in signals.iter().enumerate() {
                    let last = before.as_ref().and_then(|before| before.get(place));
                    if last.is_some_and(|last| last != signal)
                        && let Some(begin) = begins.get_mut(place)
                    {
                        *begin = Some(made.step);
                    }
                }
                first_step.get_or_insert(made.step);
                before = Some(signals);
                true
            });
            let Some(first_step) = first_step else {
                continue;
            };
            // What is now, of the first chunk that is looked at; of an earlier one, what was where
            // the next one began.
            let ends = before.unwrap_or_default();
            let known = now.get_or_insert_with(|| ends.clone());
            for (place, entry) in since.iter_mut().enumerate().filter(|it| it.1.is_none()) {
                let at = match (ends.get(place) == known.get(place), begins.get(place)) {
                    (false, _) => first,
                    (true, Some(Some(step))) => Some(*step),
                    (true, _) => None,
                };
                *entry = at.map(|step| Since {
                    step,
                    t_us: self.time_of_step(stretch, step),
                    is_first: false,
                });
            }
            first = Some(first_step);
        }
        let now = now?;
        let first = first?;
        let mut since = since.into_iter().map(|it| {
            it.unwrap_or_else(|| Since {
                step: first,
                t_us: self.time_of_step(stretch, first),
                is_first: true,
            })
        });
        let (is_current, values) = now.split_first()?;
        let of_source = since.next()?;
        let missing = looked.missing(values);
        let terms = (looked.terms.into_iter().zip(values).zip(since))
            .map(|((term, is_set), since)| Term {
                name: term.name,
                is_set: *is_set,
                since,
            })
            .collect();
        Some(Missing {
            event: looked.event,
            guard: looked.guard,
            is_current: *is_current,
            since: of_source,
            terms,
            missing,
        })
    }
}
