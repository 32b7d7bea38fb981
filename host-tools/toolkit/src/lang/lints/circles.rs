//! W104: events that can cause each other in a circle within one macro step.
//!
//! An event causes another if a transition that it triggers sends the other. What is caused so
//! happens in the same macro step, for an event stays in the queue until somebody has looked at it.
//! First this is asked of the names of events, which settles most sets of files; only for the names
//! that are left, the instance tree is unfolded and it is asked who sees what.

use std::collections::{BTreeMap, HashMap, HashSet, VecDeque};

use esm_core::format;

use crate::lang::analysis::activity::Activity;
use crate::lang::analysis::holes::{ContainerHoles, Holes};
use crate::lang::diagnostic::{Code, Diagnostic, Sink};
use crate::lang::lexer::{Lexer, TokenKind};
use crate::lang::resolve::Trees;
use crate::lang::tree;
use crate::model::{Action, Container, Model, Span, StateKind, Transition, Trigger};

use super::components::strongly_connected;
use super::uses::Uses;

/// The most container instances that are unfolded: as many as a blob can hold. A machine with more
/// is refused anyway (E012).
const MAX_INSTANCES: usize = format::NONE as usize - 1;

/// The most pairs of an instance and an event of a circle that can be seen there. In a set of files
/// with more, circles are not looked for.
const MAX_PAIRS: usize = 1_000_000;

/// As many sends of a circle are shown.
const MAX_SHOWN: usize = 8;

/// A `send` in a transition that an event triggers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Cause {
    trigger: usize,
    sent: usize,
    /// The whole transition.
    transition: Span,
}

/// Reports circles of events.
pub(super) fn check(
    trees: &Trees<'_>,
    model: &Model,
    holes: &Holes,
    activity: &Activity,
    uses: &Uses,
    sink: &mut Sink,
) {
    let mut causes = causes(model, holes, activity);
    let in_circles = keep_circles(model, &mut causes);
    if in_circles.is_empty() {
        return;
    }
    let Some(tree) = Unfolded::of(model, holes, uses, &causes, &in_circles) else {
        return;
    };
    let circles = tree.circles(&causes);
    if circles.is_empty() {
        return;
    }
    let sends = SendPlaces::of(trees);
    for circle in circles.values() {
        sink.push(report(model, &sends, circle));
    }
}

/// Per container, what its transitions cause, of those that can be taken for all that is known.
fn causes(model: &Model, holes: &Holes, activity: &Activity) -> Vec<Vec<Cause>> {
    let of_container = |index: usize, container: &Container, holes: &ContainerHoles| {
        if holes.is_twin {
            return Vec::new();
        }
        let mut causes = Vec::new();
        let regions = container.regions.iter().zip(&holes.regions);
        for (region_index, (region, holes)) in regions.enumerate() {
            for (transition_index, transition) in region.transitions.iter().enumerate() {
                if activity.can_be_taken(index, region_index, transition_index)
                    && !holes.lacks_guard(transition_index)
                {
                    causes.extend(causes_of(transition));
                }
            }
        }
        causes
    };
    model
        .containers
        .iter()
        .zip(&holes.containers)
        .enumerate()
        .map(|(index, (container, holes))| of_container(index, container, holes))
        .collect()
}

fn causes_of(transition: &Transition) -> impl Iterator<Item = Cause> + '_ {
    let trigger = match transition.trigger {
        Trigger::Event(event) => Some(event),
        Trigger::Pulse | Trigger::Star => None,
    };
    transition.actions.iter().filter_map(move |action| {
        let Action::Send(sent) = *action else {
            return None;
        };
        Some(Cause {
            trigger: trigger?,
            sent,
            transition: transition.span,
        })
    })
}

/// Leaves the causes that are in a circle of names; gives the events of these circles.
fn keep_circles(model: &Model, causes: &mut [Vec<Cause>]) -> HashSet<usize> {
    let mut edges = vec![Vec::new(); model.events.len()];
    for cause in causes.iter().flatten() {
        if let Some(edges) = edges.get_mut(cause.trigger) {
            edges.push(cause.sent);
        }
    }
    let component = strongly_connected(&edges);
    for causes in causes.iter_mut() {
        causes.retain(|cause| component.get(cause.trigger) == component.get(cause.sent));
    }
    causes.iter().flatten().map(|cause| cause.sent).collect()
}

/// Per container, the first cause of each pair of events.
fn by_events(causes: &[Vec<Cause>]) -> Vec<HashMap<(usize, usize), Cause>> {
    causes
        .iter()
        .map(|causes| {
            let mut first = HashMap::new();
            for &cause in causes {
                first.entry((cause.trigger, cause.sent)).or_insert(cause);
            }
            first
        })
        .collect()
}

/// A container instance.
struct Instance {
    container: usize,
    /// The instance around it.
    around: Option<usize>,
}

/// Instances, and the events of circles that can be seen in each.
struct Unfolded {
    instances: Vec<Instance>,
    /// A number for each pair of instance and event.
    pairs: HashMap<(usize, usize), usize>,
    /// The pairs by number.
    places: Vec<(usize, usize)>,
    /// Two nodes a pair: [`up`] and [`down`].
    edges: Vec<Vec<usize>>,
}

/// The event is here and goes on its way up and down.
fn up(pair: usize) -> usize {
    2 * pair
}

/// The event can be seen here, and goes on its way down.
fn down(pair: usize) -> usize {
    2 * pair + 1
}

impl Unfolded {
    /// Unfolds the machine, or what nobody uses where there is none. `None` where that is too much.
    fn of(
        model: &Model,
        holes: &Holes,
        uses: &Uses,
        causes: &[Vec<Cause>],
        events: &HashSet<usize>,
    ) -> Option<Self> {
        // Only what contains a cause needs to be unfolded.
        let mut matters = vec![false; causes.len()];
        for &container in &uses.children_first {
            let has_causes = !causes.get(container)?.is_empty();
            let inside = uses.inside.get(container)?;
            let is_around = inside.iter().any(|&used| matters.get(used) == Some(&true));
            *matters.get_mut(container)? = has_causes || is_around;
        }
        let mut instances: Vec<Instance> = match model.machine {
            Some(machine) => vec![machine],
            None => (0..causes.len())
                .filter(|&container| uses.around.get(container).is_some_and(Vec::is_empty))
                .collect(),
        }
        .into_iter()
        .map(|container| Instance {
            container,
            around: None,
        })
        .collect();
        let mut next = 0;
        while let Some(&Instance { container, .. }) = instances.get(next) {
            let regions = model.containers.get(container)?.regions.iter();
            for (region, holes) in regions.zip(&holes.containers.get(container)?.regions) {
                for (state, holes) in region.states.iter().zip(&holes.states) {
                    if let (StateKind::Super { container }, false) = (&state.kind, holes.kind)
                        && matters.get(*container) == Some(&true)
                    {
                        if instances.len() == MAX_INSTANCES {
                            return None;
                        }
                        instances.push(Instance {
                            container: *container,
                            around: Some(next),
                        });
                    }
                }
            }
            next += 1;
        }
        let mut tree = Unfolded {
            instances,
            pairs: HashMap::new(),
            places: Vec::new(),
            edges: Vec::new(),
        };
        tree.connect(model, causes, events)?;
        Some(tree)
    }

    fn pair(&mut self, instance: usize, event: usize) -> Option<usize> {
        let count = self.pairs.len();
        let pair = *self.pairs.entry((instance, event)).or_insert(count);
        if pair == count {
            if count == MAX_PAIRS {
                return None;
            }
            self.places.push((instance, event));
            self.edges.push(vec![down(pair)]);
            self.edges.push(Vec::new());
        }
        Some(pair)
    }

    fn connect(
        &mut self,
        model: &Model,
        causes: &[Vec<Cause>],
        events: &HashSet<usize>,
    ) -> Option<()> {
        for index in 0..self.instances.len() {
            let &Instance { container, around } = self.instances.get(index)?;
            if let Some(around) = around {
                for event in &model.containers.get(container)?.events {
                    if !events.contains(&event.event)
                        || !(event.forwarded_in || event.forwarded_out)
                    {
                        continue;
                    }
                    let (outer, inner) = (
                        self.pair(around, event.event)?,
                        self.pair(index, event.event)?,
                    );
                    if event.forwarded_in {
                        self.edges.get_mut(down(outer))?.push(down(inner));
                    }
                    if event.forwarded_out {
                        self.edges.get_mut(up(inner))?.push(up(outer));
                    }
                }
            }
            for cause in causes.get(container)? {
                let (trigger, sent) = (
                    self.pair(index, cause.trigger)?,
                    self.pair(index, cause.sent)?,
                );
                self.edges.get_mut(down(trigger))?.push(up(sent));
            }
        }
        Some(())
    }

    /// A circle for each strongly connected set of events in instances, by the place of its first
    /// transition. The circle of a container that is used several times is one.
    fn circles(&self, causes: &[Vec<Cause>]) -> BTreeMap<Span, Vec<Cause>> {
        let component = strongly_connected(&self.edges);
        // The first send of each component, with its instance.
        let mut first: BTreeMap<usize, (Cause, usize)> = BTreeMap::new();
        for (index, instance) in self.instances.iter().enumerate() {
            for &cause in causes.get(instance.container).into_iter().flatten() {
                let Some((from, to)) = self.ends(index, cause) else {
                    continue;
                };
                if let (Some(circle), true) = (
                    component.get(from),
                    component.get(from) == component.get(to),
                ) {
                    let known = first.entry(*circle).or_insert((cause, index));
                    if cause.transition < known.0.transition {
                        *known = (cause, index);
                    }
                }
            }
        }
        let by_events = by_events(causes);
        let mut circles = BTreeMap::new();
        for &(cause, index) in first.values() {
            circles
                .entry(cause.transition)
                .or_insert_with(|| self.way_round(&by_events, &component, cause, index));
        }
        circles
    }

    /// The nodes that a cause leads from and to in an instance.
    fn ends(&self, instance: usize, cause: Cause) -> Option<(usize, usize)> {
        let pair = |event| self.pairs.get(&(instance, event)).copied();
        Some((down(pair(cause.trigger)?), up(pair(cause.sent)?)))
    }

    /// A shortest circle that begins with a cause.
    fn way_round(
        &self,
        by_events: &[HashMap<(usize, usize), Cause>],
        component: &[usize],
        first: Cause,
        instance: usize,
    ) -> Vec<Cause> {
        let mut circle = vec![first];
        let Some((goal, start)) = self.ends(instance, first) else {
            return circle;
        };
        let mut before: HashMap<usize, usize> = HashMap::new();
        let mut open = VecDeque::from([start]);
        while let Some(node) = open.pop_front() {
            if node == goal {
                break;
            }
            for &next in self.edges.get(node).into_iter().flatten() {
                if component.get(next) == component.get(goal) && next != start {
                    before.entry(next).or_insert_with(|| {
                        open.push_back(next);
                        node
                    });
                }
            }
        }
        let mut way = vec![goal];
        while let Some(&node) = way.last().and_then(|node| before.get(node)) {
            way.push(node);
        }
        way.reverse();
        for step in way.windows(2) {
            let [from, to] = *step else { continue };
            // Only a send leads from an event that can be seen to one that goes on its way.
            if from != down(from / 2) || to != up(to / 2) {
                continue;
            }
            let (Some(&(instance, trigger)), Some(&(_, sent))) =
                (self.places.get(from / 2), self.places.get(to / 2))
            else {
                continue;
            };
            let container = self.instances.get(instance).map(|it| it.container);
            let causes = container.and_then(|container| by_events.get(container));
            let cause = causes.and_then(|causes| causes.get(&(trigger, sent)));
            circle.extend(cause);
        }
        circle
    }
}

// ─── Reports ─────────────────────────────────────────────────────────────────────────────────────

/// Where the `send`s of transitions stand, which the model does not say.
struct SendPlaces<'t> {
    trees: &'t Trees<'t>,
    transitions: HashMap<Span, &'t tree::Transition>,
}

impl<'t> SendPlaces<'t> {
    fn of(trees: &'t Trees<'t>) -> Self {
        let transitions = trees
            .trees
            .iter()
            .flat_map(|file| &file.containers)
            .flat_map(|container| &container.regions)
            .flat_map(|region| &region.transitions)
            .map(|transition| (transition.span, transition))
            .collect();
        SendPlaces { trees, transitions }
    }

    /// From the word `send` to the end of the event's name.
    fn of_cause(&self, model: &Model, cause: &Cause) -> Span {
        let whole = cause.transition;
        let (Some(transition), Some(file), Some(event)) = (
            self.transitions.get(&whole),
            self.trees.files.get(whole.file as usize),
            model.events.get(cause.sent),
        ) else {
            return whole;
        };
        let text = |start: u32, end: u32| file.text.get(start as usize..end as usize).unwrap_or("");
        let name = transition.actions.iter().find_map(|action| match action {
            tree::Action::Send(name) if text(name.0.start, name.0.end) == event => Some(name.0),
            _ => None,
        });
        let Some(name) = name else {
            return whole;
        };
        let mut lexer = Lexer::new(text(whole.start, name.start));
        let mut start = name.start;
        loop {
            let token = lexer.next_token();
            match token.kind {
                TokenKind::EndOfFile => return Span { start, ..name },
                TokenKind::Send => start = whole.start + token.start,
                _ => {}
            }
        }
    }
}

fn report(model: &Model, sends: &SendPlaces<'_>, circle: &[Cause]) -> Diagnostic {
    let name = |event: usize| model.events.get(event).map_or("", String::as_str);
    let first = circle.first().map_or(0, |cause| cause.trigger);
    let mut names = vec![format!("`{}`", name(first))];
    for cause in circle.iter().take(MAX_SHOWN) {
        names.push(format!("`{}`", name(cause.sent)));
    }
    if circle.len() > MAX_SHOWN {
        names.push("…".to_owned());
    }
    let place = circle
        .first()
        .map(|cause| sends.of_cause(model, cause))
        .unwrap_or_default();
    let message = format!(
        "events cause each other in a circle within one macro step: {}",
        names.join(" → ")
    );
    let mut diagnostic = Diagnostic::new(Code::W104, place, message).hint(
        "take one of these transitions on the pulse, with a flag that says why, so that the circle waits for the next macro step; one of more than 255 micro steps is a fault",
    );
    for cause in circle.iter().take(MAX_SHOWN) {
        diagnostic = diagnostic.related(
            sends.of_cause(model, cause),
            format!(
                "`{}` is sent when `{}` comes",
                name(cause.sent),
                name(cause.trigger)
            ),
        );
    }
    diagnostic
}
