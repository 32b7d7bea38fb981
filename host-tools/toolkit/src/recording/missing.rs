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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::planted::Planted;
    use crate::recording::player::Recording;

    /// A machine with a guard of three flags, and one that needs an event.
    const ALERT: &str = "
        interpreter slot 1;
        slot 1 period 20 ms duration 1 ms;
        slot 2 period 20 ms duration 1 ms;
        task Sense slot 2 { out flag near; out flag low; out flag calm; }
        machine Alert {
            event Far;
            region watch {
                task Look: Sense;
                state Wait;
                state Done;
                initial -> Look;
                Look -> Done [.near and (.low or .calm)];
                Look -> Wait [exit];
                Wait -> Look on Far;
            }
        }";

    fn recorded(reports: &[(u64, &str)], gap: bool) -> Recording {
        let first = Planted::new().run(("alert", ALERT), 0, 0..3000, reports);
        let planted = match gap {
            false => first,
            true => (first.gap()).run(("alert", ALERT), 500_000_000, 0..10, &[]),
        };
        planted.recording()
    }

    fn missing(recording: &Recording, step: u64, to: &str) -> Missing {
        let (walk, ended) = Walk::new(recording, true);
        assert!(ended.is_none(), "{ended:?}");
        let mut all = walk.missing_at(step * 20_000 + 19_999, "watch/Look", to);
        assert_eq!(all.len(), 1);
        all.remove(0)
    }

    #[test]
    fn the_fewest_terms_that_are_missing_are_told_with_the_time_since_which_they_are() {
        let reports = [
            (10, "set watch/Look.low"),
            // Far beyond the first place that the walk can begin at.
            (1500, "clear watch/Look.low"),
        ];
        let recording = recorded(&reports, false);
        let told = missing(&recording, 2990, "watch/Done");
        assert!(told.is_current && told.guard.is_some() && told.event == "pulse");
        let terms: Vec<_> = (told.terms.iter())
            .map(|it| {
                (
                    it.name.as_str(),
                    it.is_set,
                    it.since.step,
                    it.since.is_first,
                )
            })
            .collect();
        // `Look` becomes current in the first macro step: what was before is known from the next.
        assert_eq!(
            terms,
            [
                (".near", false, 0, true),
                (".low", false, 1500, false),
                (".calm", false, 0, true)
            ]
        );
        assert_eq!(told.missing, [[0, 1], [0, 2]]);
        assert_eq!(told.since.step, 1);
        assert_eq!(told.terms[1].since.t_us, 30_000_000);
        let before = missing(&recording, 1499, "watch/Done");
        assert_eq!(
            before.missing,
            [[0]],
            "one term is enough while the other is true"
        );
        assert_eq!(before.terms[1].since.step, 10);
    }

    #[test]
    fn a_state_that_is_not_current_is_told_since_when_it_is_not() {
        let recording = recorded(&[(40, "exit watch/Look")], false);
        let told = missing(&recording, 2000, "watch/Done");
        assert!(!told.is_current);
        assert_eq!((told.since.step, told.since.is_first), (41, false));
        let (walk, _) = Walk::new(&recording, false);
        let of_event = walk.missing_at(u64::MAX, "watch/Wait", "watch/Look");
        assert_eq!(of_event[0].event, "Far");
        let nothing: [Vec<usize>; 1] = [Vec::new()];
        assert_eq!(of_event[0].missing, nothing, "a guard that is none is true");
    }

    #[test]
    fn terms_over_time_have_each_change_also_where_robot_time_begins_anew() {
        let reports = [(10, "set watch/Look.near"), (1030, "clear watch/Look.near")];
        let recording = recorded(&reports, true);
        let (walk, _) = Walk::new(&recording, true);
        let term = |to: &str, name| walk.term_over_time(("watch/Look", to, 0), name);
        assert_eq!(
            term("watch/Done", ".near"),
            [(0, false), (200_000, true), (20_600_000, false)]
        );
        assert_eq!(term("watch/Done", ".nothing"), []);
        assert_eq!(term("watch/None", ".near"), []);
        assert_eq!(walk.missing_at(0, "nothing", "watch/Done"), []);
    }
}
