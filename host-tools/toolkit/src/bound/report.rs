//! A bound in words: the events of the macro step, and the regions that take most of it.

use serde::Serialize;

use esm_core::tables::Tables;

use super::machine::Trigger;
use super::worst::{Bound, Events, Part, Share};
use crate::trace::directory::Directory;

/// What a bound says, with names.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Report {
    /// The most instructions that a macro step takes.
    pub instructions: u64,
    /// Events that it has then, the pulse included.
    pub micro_steps: u64,
    /// Why there are no more: `counted`, `circle`, `limited`, `too-large`.
    pub events: &'static str,
    /// What it is made of, what takes most first.
    pub parts: Vec<Contribution>,
}

/// What one region does on one event, in all the times that the event comes; or what the event
/// itself takes.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Contribution {
    /// `pulse`, or the name of the event.
    pub event: String,
    /// How often it comes.
    pub times: u64,
    /// Path of the current state; none for what the event itself takes.
    pub state: Option<String>,
    /// Path of the state that it goes to, where it takes a transition.
    pub to: Option<String>,
    /// Instructions of all times together.
    pub instructions: u64,
}

impl Report {
    /// Gives a bound its names; numbers where the mission has none.
    #[must_use]
    pub fn of(bound: &Bound, tables: &Tables<'_>) -> Self {
        let directory = Directory::of(tables).ok();
        let names = Names {
            tables,
            directory: directory.as_ref(),
            events: event_names(tables),
        };
        let mut parts: Vec<Contribution> = Vec::new();
        for part in &bound.parts {
            let event = names.event(part.trigger);
            let times = part.times;
            let visits: u64 = part.shares.iter().map(|share| share.instructions).sum();
            parts.push(Contribution {
                event: event.clone(),
                times,
                state: None,
                to: None,
                instructions: own(part, visits),
            });
            parts.extend(part.shares.iter().map(|share| {
                let (state, to) = names.share(share);
                Contribution {
                    event: event.clone(),
                    times,
                    state: Some(state),
                    to,
                    instructions: share.instructions.saturating_mul(times),
                }
            }));
        }
        // Stable: of equals, the order of events and regions stays.
        parts.sort_by_key(|part| std::cmp::Reverse(part.instructions));
        Report {
            instructions: bound.instructions,
            micro_steps: bound.micro_steps,
            events: match bound.events {
                Events::Counted => "counted",
                Events::Circle => "circle",
                Events::Limited => "limited",
                Events::TooLarge => "too-large",
            },
            parts,
        }
    }
}

impl Contribution {
    /// What it is, for people.
    #[must_use]
    pub fn says(&self) -> String {
        let times = match self.times {
            1 => String::new(),
            times => format!("{times} times "),
        };
        match (&self.state, &self.to) {
            (None, _) => format!("{times}{}: beginning and end", self.event),
            (Some(state), None) => format!("{times}{}: {state} stays", self.event),
            (Some(state), Some(to)) => format!("{times}{}: {state} -> {to}", self.event),
        }
    }
}

fn own(part: &Part, visits: u64) -> u64 {
    part.instructions
        .saturating_sub(visits)
        .saturating_mul(part.times)
}

struct Names<'t> {
    tables: &'t Tables<'t>,
    directory: Option<&'t Directory>,
    events: Vec<String>,
}

impl Names<'_> {
    fn event(&self, trigger: Trigger) -> String {
        let number = match trigger {
            Trigger::Pulse => return "pulse".to_owned(),
            Trigger::Any => return "any event".to_owned(),
            Trigger::Channel(channel) => self.tables.channel(channel).map_or(0, |it| it.event),
        };
        let name = usize::from(number)
            .checked_sub(1)
            .and_then(|at| self.events.get(at));
        name.cloned().unwrap_or_else(|| format!("event {number}"))
    }

    /// Paths of a region's current state and of the state that it goes to.
    fn share(&self, share: &Share) -> (String, Option<String>) {
        let path = |state: usize| {
            let named = self.directory.and_then(|directory| {
                let id = directory.state_at(share.region, state)?;
                Some(directory.state(id)?.path.clone())
            });
            named.unwrap_or_else(|| format!("region {} state {state}", share.region))
        };
        let target = share.transition.and_then(|it| self.tables.transition(it));
        (path(share.state), target.map(|it| path(it.target)))
    }
}

/// The names of events in the order of their numbers; none where they were left out.
fn event_names(tables: &Tables<'_>) -> Vec<String> {
    let names = tables.names().into_iter().flatten();
    names
        .take(tables.event_count())
        .map(|name| String::from_utf8_lossy(name).into_owned())
        .collect()
}
