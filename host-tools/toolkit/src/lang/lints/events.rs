//! W102: events that are never sent, never received, or sent where no receiver can see them.
//!
//! An event that is sent in an instance of a container goes up as far as containers list it as
//! `out event`, and down from everywhere on that way as far as they list it as `in event`. Whether
//! there is an instance of a container in which an event can be seen, or from which it reaches a
//! receiver, follows from the containers as they are written: what is below an instance is the same
//! in all of them, and each way down to a container is some instance of it. So two passes over the
//! containers do, one up and one down.

use std::collections::HashMap;

use crate::lang::analysis::holes::{ContainerHoles, Holes};
use crate::lang::cure::remove_from_list;
use crate::lang::diagnostic::{Code, Diagnostic, Fix, Sink};
use crate::model::{Action, Container, ContainerEvent, Model, Span, Trigger};

use super::uses::Uses;

/// The most pairs of a use of a container and an event that it passes on, in a set of files. In one
/// that has more, W102 is not looked for.
const MAX_FORWARDINGS: usize = 4_000_000;

/// Of so many reports it is worked out why nobody sees the event; it takes a look at all containers
/// each.
const MAX_EXPLAINED: usize = 100;

/// What is known of an event in a container.
#[derive(Clone, Copy, Debug, Default)]
struct Facts {
    forwarded_in: bool,
    forwarded_out: bool,
    /// A transition of the container sends it.
    sends: bool,
    /// A transition of the container is triggered by it.
    receives: bool,
    /// Somebody sends it here or below, so that it can be seen here.
    sent_below: bool,
    /// Somebody receives it here or below, if it can be seen here.
    received_below: bool,
    /// Somebody below sends it, somebody below hears that, and it can be seen here, too.
    passes_below: bool,
    /// There is an instance into which it comes from outside.
    sent_above: bool,
    /// There is an instance out of which it goes to somebody who receives it.
    received_above: bool,
}

impl Facts {
    /// Whether it does anything here.
    fn fault(&self) -> Option<Fault> {
        let is_seen = self.sent_below || self.sent_above;
        let is_heard = self.received_below || self.received_above;
        match (self.sends, self.receives) {
            (true, true) => None,
            (true, false) => (!is_heard).then_some(Fault::Unheard),
            (false, true) => (!is_seen).then_some(Fault::Unsent),
            (false, false) => {
                let comes_down = self.sent_above && self.received_below;
                let goes_up = self.sent_below && (is_heard || self.passes_below);
                match (comes_down || goes_up, is_seen, is_heard) {
                    (true, ..) => None,
                    (_, false, true) => Some(Fault::Unsent),
                    (_, true, _) => Some(Fault::Unheard),
                    (_, false, false) => Some(Fault::Idle),
                }
            }
        }
    }
}

/// What is wrong with an event of a container.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Fault {
    /// Nobody sends it.
    Unsent,
    /// Nobody receives it.
    Unheard,
    /// Neither.
    Idle,
}

/// A transition that sends or receives an event.
#[derive(Clone, Copy)]
struct Mention {
    container: usize,
    span: Span,
}

/// Where events are sent and received: the first places of each.
#[derive(Default)]
struct Mentions {
    sent: HashMap<usize, Vec<Mention>>,
    received: HashMap<usize, Vec<Mention>>,
}

/// As many places of an event are kept.
const MAX_MENTIONS: usize = 4;

/// Reports events that do nothing.
pub(super) fn check(model: &Model, holes: &Holes, uses: &Uses, sink: &mut Sink) {
    let hides = what_hides(holes, uses);
    let mut mentions = Mentions::default();
    let mut facts: Vec<HashMap<usize, Facts>> = model
        .containers
        .iter()
        .enumerate()
        .map(|(index, container)| own_facts(index, container, &mut mentions))
        .collect();
    if !add_passed_on(model, uses, &mut facts) {
        return;
    }
    for (facts, &hides) in facts.iter_mut().zip(&hides) {
        for facts in facts.values_mut() {
            // It may be sent and received in what is not known.
            facts.sends |= hides;
            facts.receives |= hides;
        }
    }
    look_below(model, uses, &mut facts);
    look_above(model, uses, &mut facts);
    let mut explained = 0;
    for (index, (container, holes)) in model.containers.iter().zip(&holes.containers).enumerate() {
        if holes.is_twin || hides.get(index) == Some(&true) {
            continue;
        }
        for event in &container.events {
            let fault = facts
                .get(index)
                .and_then(|facts| facts.get(&event.event))
                .and_then(Facts::fault);
            if let Some(fault) = fault {
                let report = Report {
                    model,
                    uses,
                    facts: &facts,
                    mentions: &mentions,
                    container: index,
                    event,
                };
                sink.push(report.diagnostic(fault, explained < MAX_EXPLAINED));
                explained += 1;
            }
        }
    }
}

/// Per container, whether it may send and receive more than the model says.
fn what_hides(holes: &Holes, uses: &Uses) -> Vec<bool> {
    let mut hides: Vec<bool> = holes.containers.iter().map(hides_something).collect();
    for (index, holes) in holes.containers.iter().enumerate() {
        // What it forwards is not known, so neither is what passes through where it is used.
        if holes.declarations {
            for &around in uses.around.get(index).into_iter().flatten() {
                if let Some(hides) = hides.get_mut(around) {
                    *hides = true;
                }
            }
        }
    }
    hides
}

fn hides_something(holes: &ContainerHoles) -> bool {
    holes.declarations
        || holes.regions.iter().any(|region| {
            region.body
                || !region.transitions.is_empty()
                || !region.actions.is_empty()
                || region.states.iter().any(|state| state.kind)
        })
}

/// What a container says of its events.
fn own_facts(
    index: usize,
    container: &Container,
    mentions: &mut Mentions,
) -> HashMap<usize, Facts> {
    let mut facts: HashMap<usize, Facts> = container
        .events
        .iter()
        .map(|event| {
            let facts = Facts {
                forwarded_in: event.forwarded_in,
                forwarded_out: event.forwarded_out,
                ..Facts::default()
            };
            (event.event, facts)
        })
        .collect();
    let transitions = container
        .regions
        .iter()
        .flat_map(|region| &region.transitions);
    for transition in transitions {
        let mention = Mention {
            container: index,
            span: transition.span,
        };
        if let Trigger::Event(event) = transition.trigger {
            facts.entry(event).or_default().receives = true;
            keep(mentions.received.entry(event).or_default(), mention);
        }
        for action in &transition.actions {
            if let Action::Send(event) = *action {
                facts.entry(event).or_default().sends = true;
                keep(mentions.sent.entry(event).or_default(), mention);
            }
        }
    }
    facts
}

fn keep(mentions: &mut Vec<Mention>, mention: Mention) {
    if mentions.len() < MAX_MENTIONS {
        mentions.push(mention);
    }
}

/// Adds the events that a container does not list and that pass between those it contains. Gives
/// false where these are too many.
fn add_passed_on(model: &Model, uses: &Uses, facts: &mut [HashMap<usize, Facts>]) -> bool {
    let mut forwardings = 0;
    for (facts, inside) in facts.iter_mut().zip(&uses.inside) {
        for event in inside.iter().flat_map(|&used| forwarded(model, used)) {
            forwardings += 1;
            if forwardings > MAX_FORWARDINGS {
                return false;
            }
            facts.entry(event.event).or_default();
        }
    }
    true
}

/// The events that a container forwards, up or down.
fn forwarded(model: &Model, container: usize) -> impl Iterator<Item = &ContainerEvent> {
    let events = model
        .containers
        .get(container)
        .map_or(&[][..], |container| &container.events);
    events
        .iter()
        .filter(|event| event.forwarded_in || event.forwarded_out)
}

fn facts_of(facts: &[HashMap<usize, Facts>], container: usize, event: usize) -> Facts {
    facts
        .get(container)
        .and_then(|facts| facts.get(&event))
        .copied()
        .unwrap_or_default()
}

/// Finds out what is sent and received at or below each container.
fn look_below(model: &Model, uses: &Uses, facts: &mut [HashMap<usize, Facts>]) {
    for &index in &uses.children_first {
        // The containers inside are done by now.
        let Some(mut own) = facts.get_mut(index).map(std::mem::take) else {
            continue;
        };
        for facts in own.values_mut() {
            facts.sent_below = facts.sends;
            facts.received_below = facts.receives;
        }
        for &used in uses.inside.get(index).into_iter().flatten() {
            for event in forwarded(model, used) {
                let (inner, outer) = (
                    facts_of(facts, used, event.event),
                    own.entry(event.event).or_default(),
                );
                outer.received_below |= event.forwarded_in && inner.received_below;
                outer.sent_below |= event.forwarded_out && inner.sent_below;
                outer.passes_below |= event.forwarded_out && inner.passes_below;
            }
        }
        for facts in own.values_mut() {
            facts.passes_below |= facts.sent_below && facts.received_below;
        }
        if let Some(place) = facts.get_mut(index) {
            *place = own;
        }
    }
}

/// Finds out what comes into each container from outside, and who outside hears what goes out.
fn look_above(model: &Model, uses: &Uses, facts: &mut [HashMap<usize, Facts>]) {
    for &index in uses.children_first.iter().rev() {
        if uses.has_unknown_surroundings(model, index)
            && let Some(facts) = facts.get_mut(index)
        {
            for facts in facts.values_mut() {
                facts.sent_above |= facts.forwarded_in;
                facts.received_above |= facts.forwarded_out;
            }
        }
        for &used in uses.inside.get(index).into_iter().flatten() {
            for event in forwarded(model, used) {
                let outer = facts_of(facts, index, event.event);
                if let Some(inner) = facts
                    .get_mut(used)
                    .and_then(|facts| facts.get_mut(&event.event))
                {
                    inner.sent_above |=
                        event.forwarded_in && (outer.sent_below || outer.sent_above);
                    inner.received_above |=
                        event.forwarded_out && (outer.received_below || outer.received_above);
                }
            }
        }
    }
}

/// An event of a container that does nothing there.
struct Report<'r> {
    model: &'r Model,
    uses: &'r Uses,
    facts: &'r [HashMap<usize, Facts>],
    mentions: &'r Mentions,
    container: usize,
    event: &'r ContainerEvent,
}

impl Report<'_> {
    fn diagnostic(&self, fault: Fault, explain: bool) -> Diagnostic {
        let name = self
            .model
            .events
            .get(self.event.event)
            .map_or("", String::as_str);
        let none = Vec::new();
        let sent = self.mentions.sent.get(&self.event.event).unwrap_or(&none);
        let received = self
            .mentions
            .received
            .get(&self.event.event)
            .unwrap_or(&none);
        let (message, here, there, hint) = match fault {
            Fault::Idle => {
                let message = format!("event `{name}` is neither sent nor received");
                let span = self.event.span;
                let diagnostic = Diagnostic::new(Code::W102, span, message).hint(
                    "remove it, or use it: `… / send E` in one transition, `on E` in another",
                );
                let file = self.model.files.get(span.file as usize);
                let edit = file.and_then(|file| remove_from_list(&file.text, span));
                return match edit {
                    Some(edit) => diagnostic.fix(Fix::one("remove the event", edit)),
                    None => diagnostic,
                };
            }
            Fault::Unsent if sent.is_empty() => (
                format!("event `{name}` is never sent"),
                received,
                sent,
                format!(
                    "send it in a transition (`/ send {name}`), or remove it with what waits for it"
                ),
            ),
            Fault::Unsent => (
                format!(
                    "event `{name}` is sent, but never where `{}` can see it",
                    self.name(self.container)
                ),
                received,
                sent,
                "list the event in each container on the way".to_owned(),
            ),
            Fault::Unheard if received.is_empty() => (
                format!("event `{name}` is never received"),
                sent,
                received,
                format!(
                    "receive it in a transition (`on {name}`), or remove it with what sends it"
                ),
            ),
            Fault::Unheard if !self.own_facts().sent_below => {
                let here = self.name(self.container);
                let message =
                    format!("event `{name}` comes into `{here}`, and nobody in it receives it");
                return Diagnostic::new(Code::W102, self.event.span, message).hint(format!(
                    "receive it in a transition (`on {name}`), list it in the container that does, or remove `in event {name}`"
                ));
            }
            Fault::Unheard => (
                format!(
                    "event `{name}` is sent in `{}`, where no receiver can see it",
                    self.name(self.container)
                ),
                sent,
                received,
                "list the event in each container on the way".to_owned(),
            ),
        };
        let (at_here, at_there) = match fault {
            Fault::Unsent => ("received here", "sent here"),
            _ => ("sent here", "received here"),
        };
        let mut diagnostic = Diagnostic::new(Code::W102, self.event.span, message);
        if let Some(own) = here
            .iter()
            .find(|mention| mention.container == self.container)
        {
            diagnostic = diagnostic.related(own.span, at_here);
        }
        let Some(other) = there
            .iter()
            .find(|mention| mention.container != self.container)
        else {
            return diagnostic.hint(hint);
        };
        diagnostic = diagnostic.related(
            other.span,
            format!("{at_there}, in `{}`", self.name(other.container)),
        );
        let border = explain
            .then(|| match fault {
                Fault::Unsent => self.border(other.container, self.container),
                _ => self.border(self.container, other.container),
            })
            .flatten();
        match border {
            Some((container, word)) => {
                let border = self.name(container);
                diagnostic.hint(format!(
                    "container `{border}` does not list it as `{word} event`: write `{word} event {name};` there"
                ))
            }
            None => diagnostic.hint(hint),
        }
    }

    fn own_facts(&self) -> Facts {
        facts_of(self.facts, self.container, self.event.event)
    }

    fn name(&self, container: usize) -> &str {
        self.model
            .containers
            .get(container)
            .map_or("", |container| &container.name)
    }

    /// The container whose border an event does not cross on its way from one that sends it to one
    /// that receives it, and the word with which it would.
    fn border(&self, from: usize, to: usize) -> Option<(usize, &'static str)> {
        let facts = |container| facts_of(self.facts, container, self.event.event);
        let mut at = from;
        // Up to where it can be seen by the receiver, if the receiver lists it.
        loop {
            if at != to
                && let Some(way) = self.uses.way_down(at, to)
            {
                let closed = way
                    .into_iter()
                    .skip(1)
                    .find(|&container| !facts(container).forwarded_in)?;
                return Some((closed, "in"));
            }
            if self.model.machine == Some(at) {
                return None;
            }
            if !facts(at).forwarded_out {
                return Some((at, "out"));
            }
            at = *self.uses.around.get(at)?.first()?;
        }
    }
}
