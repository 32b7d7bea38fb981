//! What is said about the states and transitions of a set of files: W101, W103, W105, W108, W110 to
//! W112.

use std::collections::{BTreeMap, VecDeque};

use crate::lang::cure::{exclude_guards, insert_behind, remove_item};
use crate::lang::diagnostic::{Code, Diagnostic, Fix, Sink};
use crate::model::{
    Model, PathEnd, Region, Source, Span, State, StateKind, Target, Task, Transition, Trigger,
};

use super::activity::{
    Activity, Groups, STEPS_A_GROUP, StateId, Uses, formula, lacks_kind, region_holes,
};
use super::freshness::{self, Staying, TooStrict};
use super::guards::{Atom, Diagrams, Formula, TooLarge};
use super::holes::{Holes, RegionHoles, StateHoles};
use super::nets::{self, Port, Writer};
use super::side_by_side::{Meeting, SideBySide};

/// As many related places are shown of one kind.
const MAX_SHOWN: usize = 4;

/// More transitions, states or paths are not looked through to find what has to do with one state.
const MAX_LOOKED_THROUGH: usize = 1_000;

/// What the warnings are about.
pub(super) struct Warnings<'a> {
    pub(super) model: &'a Model,
    pub(super) holes: &'a Holes,
    /// What can happen in what is known.
    pub(super) known: &'a Activity,
    /// What can happen, whatever is in the holes.
    pub(super) possible: &'a Activity,
    /// The same if every state had a limit of time, where a `timeout` is read of one that has none.
    /// What is out of reach for that reason alone
    /// follows from what is said there.
    pub(super) with_limits: Option<&'a Activity>,
}

impl Warnings<'_> {
    fn region(&self, container: usize, region: usize) -> Option<&Region> {
        self.model.containers.get(container)?.regions.get(region)
    }

    fn state(&self, id: StateId) -> Option<&State> {
        self.region(id.container, id.region)?.states.get(id.state)
    }

    fn container_name(&self, container: usize) -> &str {
        self.model
            .containers
            .get(container)
            .map_or("", |container| container.name.as_str())
    }

    /// All regions with their indices and holes.
    fn regions(&self) -> impl Iterator<Item = (usize, usize, &Region, Option<&RegionHoles>)> {
        let containers = self.model.containers.iter().enumerate();
        containers.flat_map(move |(index, container)| {
            let regions = container.regions.iter().enumerate();
            regions.map(move |(region_index, region)| {
                let holes = region_holes(self.holes, index, region_index);
                (index, region_index, region, holes)
            })
        })
    }
}

fn state_holes(holes: Option<&RegionHoles>, state: usize) -> StateHoles {
    holes
        .and_then(|holes| holes.states.get(state))
        .copied()
        .unwrap_or_default()
}

// ─── W101: states that cannot be reached ─────────────────────────────────────────────────────────

impl Warnings<'_> {
    pub(super) fn unreachable_states(&self, sink: &mut Sink) {
        let mut reasons = Reasons {
            diagrams: Diagrams::default(),
            steps_left: self.possible.steps(),
        };
        for (container, region_index, region, holes) in self.regions() {
            // What is inside a superstate that is never entered needs no report of its own.
            if !self.possible.is_live(container) {
                continue;
            }
            let unreached: Vec<usize> = (0..region.states.len())
                .filter(|&state| {
                    let id = StateId {
                        container,
                        region: region_index,
                        state,
                    };
                    !self.possible.is_reachable(id)
                        && !self.with_limits.is_some_and(|it| it.is_reachable(id))
                        && !state_holes(holes, state).is_twin
                })
                .collect();
            if unreached.is_empty() {
                continue;
            }
            let mut leading: Vec<Vec<usize>> = vec![Vec::new(); region.states.len()];
            for (index, transition) in region.transitions.iter().enumerate() {
                if let Target::State(target) = transition.target
                    && transition.source != Source::State(target)
                    && let Some(leading) = leading.get_mut(target)
                    && leading.len() < MAX_SHOWN
                {
                    leading.push(index);
                }
            }
            // Removing is proposed where that is not much to look through.
            let is_small = region.transitions.len() <= MAX_LOOKED_THROUGH
                && unreached.len() <= MAX_LOOKED_THROUGH;
            for state in unreached {
                let (Some(declared), Some(leading)) =
                    (region.states.get(state), leading.get(state))
                else {
                    continue;
                };
                let mut diagnostic = Diagnostic::new(
                    Code::W101,
                    declared.declaration,
                    format!("state `{}` is never entered", declared.name),
                )
                .hint(if leading.is_empty() {
                    format!(
                        "no transition leads to it: write one (`… -> {};`), or remove the state",
                        declared.name
                    )
                } else {
                    "no transition to it can ever be taken: correct one of them, or remove the state"
                        .to_owned()
                });
                for &index in leading {
                    if let Some(transition) = region.transitions.get(index) {
                        let why = self.why_never(container, region_index, transition, &mut reasons);
                        diagnostic = diagnostic.related(transition.span, why);
                    }
                }
                if leading.is_empty()
                    && is_small
                    && let Some(fix) = self.without_state(container, region_index, state)
                {
                    diagnostic = diagnostic.fix(fix);
                }
                sink.push(diagnostic);
            }
        }
    }

    /// Removes a state that no transition leads to, with the transitions from it; nothing where a
    /// data path names it.
    fn without_state(&self, container: usize, region_index: usize, state: usize) -> Option<Fix> {
        let paths = &self.model.containers.get(container)?.paths;
        if paths.len() > MAX_LOOKED_THROUGH {
            return None;
        }
        let is_wired = paths.iter().flat_map(|path| path.from.iter().chain(&path.to)).any(|end| {
            matches!(end, PathEnd::State { region, state: other, .. } if (*region, *other) == (region_index, state))
        });
        let has_holes = self
            .holes
            .containers
            .get(container)
            .is_none_or(|it| it.any());
        if is_wired || has_holes {
            return None;
        }
        let region = self.region(container, region_index)?;
        let declared = region.states.get(state)?;
        let text = &self.model.files.get(declared.span.file as usize)?.text;
        let mut edits = vec![remove_item(text, declared.declaration)];
        for transition in &region.transitions {
            if transition.source == Source::State(state) {
                edits.push(remove_item(text, transition.span));
            }
        }
        let title = format!("remove state `{}`", declared.name);
        Some(Fix::new(title, edits))
    }

    /// Why a transition is never taken.
    fn why_never(
        &self,
        container: usize,
        region: usize,
        transition: &Transition,
        reasons: &mut Reasons,
    ) -> &'static str {
        if let Source::State(state) = transition.source
            && !self.possible.is_reachable(StateId {
                container,
                region,
                state,
            })
        {
            return "the state before it is never entered either";
        }
        let is_never = |atom| {
            self.possible.is_never(
                self.model,
                self.holes,
                container,
                region,
                transition.source,
                atom,
            )
        };
        let Reasons {
            diagrams,
            steps_left,
        } = reasons;
        diagrams.restart(STEPS_A_GROUP.min(*steps_left));
        let guard = formula(diagrams, transition, true, &is_never);
        *steps_left = steps_left.saturating_sub(diagrams.steps());
        match guard {
            Ok(Some(Formula::NEVER)) => "its guard is never true",
            Ok(_) => "whenever it could be taken, one before it is taken",
            Err(TooLarge) => "it is never taken",
        }
    }
}

/// What it takes to say why transitions are never taken.
struct Reasons {
    diagrams: Diagrams,
    /// How many steps the guards that are left may take.
    steps_left: usize,
}

// ─── W103: transitions that compete ──────────────────────────────────────────────────────────────

impl Warnings<'_> {
    pub(super) fn competing_transitions(&self, sink: &mut Sink) {
        let mut diagrams = Diagrams::default();
        let mut steps_left = self.known.steps();
        for (container, region_index, region, holes) in self.regions() {
            if region.transitions.len() < 2 {
                continue;
            }
            let groups = Groups::of(region);
            let sources = (0..region.states.len()).map(Source::State);
            for source in std::iter::once(Source::Initial).chain(sources) {
                for group in groups.of_source(source).filter(|group| group.len() > 1) {
                    let is_never = |atom| {
                        self.known.is_never(
                            self.model,
                            self.holes,
                            container,
                            region_index,
                            source,
                            atom,
                        )
                    };
                    diagrams.restart(STEPS_A_GROUP.min(steps_left));
                    let found =
                        Competition::new(region, group, holes).run(&mut diagrams, &is_never);
                    steps_left = steps_left.saturating_sub(diagrams.steps() + group.len());
                    for later in found {
                        let place = (container, region_index, source);
                        self.report_competing(place, region, &later, sink);
                    }
                }
            }
        }
    }

    fn report_competing(
        &self,
        (container, region_index, source): (usize, usize, Source),
        region: &Region,
        later: &Later,
        sink: &mut Sink,
    ) {
        let Some(transition) = region.transitions.get(later.transition) else {
            return;
        };
        let words = |atom| self.atom_in_words(container, region, source, atom);
        let set: Vec<String> = later
            .example
            .iter()
            .filter(|(_, is_set)| *is_set)
            .map(|(atom, _)| format!("`{}`", words(*atom)))
            .collect();
        let only = later.example.iter().any(|(_, is_set)| !is_set);
        let when = match (set.as_slice(), only) {
            ([], _) => "no flag is set".to_owned(),
            ([one], false) => format!("{one} is set"),
            ([one], true) => format!("{one} is set and no other flag"),
            ([most @ .., last], only) => {
                let rest = if only { " and no other flag" } else { "" };
                format!("{} and {last} are set{rest}", most.join(", "))
            }
        };
        let from = match source {
            Source::Initial => "`initial`".to_owned(),
            Source::State(state) => {
                let id = StateId {
                    container,
                    region: region_index,
                    state,
                };
                format!("`{}`", self.state(id).map_or("", |state| &state.name))
            }
        };
        let event = match transition.trigger {
            Trigger::Pulse | Trigger::Star => "the pulse".to_owned(),
            Trigger::Event(event) => {
                let name = self.model.events.get(event).map_or("", String::as_str);
                format!("event `{name}`")
            }
        };
        let mut diagnostic = Diagnostic::new(
            Code::W103,
            transition.span,
            format!(
                "two transitions from {from} on {event} compete: both hold when {when}, and the first in the source is taken"
            ),
        )
        .hint("exclude the earlier guard in the later one (`… and not …`), or, for all that is left, write the later one last and without a guard");
        let earlier: Vec<Span> = (later.earlier.iter())
            .filter_map(|&earlier| Some(region.transitions.get(earlier)?.span))
            .collect();
        for span in &earlier {
            diagnostic = diagnostic.related(*span, "this one comes first");
        }
        // It changes nothing: the first one is taken as before.
        let file = self.model.files.get(transition.span.file as usize);
        if later.has_rest
            && let Some(fix) =
                file.and_then(|file| exclude_guards(&file.text, transition.span, &earlier))
        {
            diagnostic = diagnostic.fix(fix);
        }
        sink.push(diagnostic);
    }

    fn atom_in_words(
        &self,
        container: usize,
        region: &Region,
        source: Source,
        atom: Atom,
    ) -> String {
        let container = self.model.containers.get(container);
        match atom {
            Atom::Exit => "exit".to_owned(),
            Atom::Timeout => "timeout".to_owned(),
            Atom::Busy => "busy".to_owned(),
            Atom::Parent(flag) => {
                let flag = container.and_then(|container| container.flags.get(flag));
                format!("^{}", flag.map_or("", |flag| &flag.name))
            }
            Atom::Own(flag) => {
                let state = match source {
                    Source::Initial => None,
                    Source::State(state) => region.states.get(state),
                };
                let flags = match state.map(|state| &state.kind) {
                    Some(StateKind::Task { task, .. }) => {
                        self.model.tasks.get(*task).map(|task| &task.flags)
                    }
                    Some(StateKind::Super { container }) => self
                        .model
                        .containers
                        .get(*container)
                        .map(|container| &container.flags),
                    _ => None,
                };
                let flag = flags.and_then(|flags| flags.get(flag));
                format!(".{}", flag.map_or("", |flag| &flag.name))
            }
        }
    }
}

/// A transition whose guard can be true together with those of earlier ones.
struct Later {
    transition: usize,
    /// The first of those earlier ones.
    earlier: Vec<usize>,
    /// Flags with which it and the first of them both hold.
    example: Vec<(Atom, bool)>,
    /// These are all of them, and it can be true where none of them is.
    has_rest: bool,
}

/// The transitions of one state on one event.
struct Competition<'r> {
    region: &'r Region,
    group: &'r [usize],
    holes: Option<&'r RegionHoles>,
    /// Transitions so far whose guard is known and can be true, with that.
    before: Vec<(usize, Formula)>,
}

impl<'r> Competition<'r> {
    fn new(region: &'r Region, group: &'r [usize], holes: Option<&'r RegionHoles>) -> Self {
        Competition {
            region,
            group,
            holes,
            before: Vec::new(),
        }
    }

    /// Finds all that compete with an earlier one; where guards are too large, those found before
    /// that.
    fn run(mut self, diagrams: &mut Diagrams, is_never: &impl Fn(Atom) -> bool) -> Vec<Later> {
        let mut found = Vec::new();
        // True where any earlier one is.
        let mut any = Formula::NEVER;
        for &index in self.group {
            match self.next(index, &mut any, diagrams, is_never) {
                Ok(later) => found.extend(later),
                Err(TooLarge) => break,
            }
        }
        found
    }

    fn next(
        &mut self,
        index: usize,
        any: &mut Formula,
        diagrams: &mut Diagrams,
        is_never: &impl Fn(Atom) -> bool,
    ) -> Result<Option<Later>, TooLarge> {
        let Some(transition) = self.region.transitions.get(index) else {
            return Ok(None);
        };
        let is_known = !self.holes.is_some_and(|holes| holes.lacks_guard(index));
        let Some(guard) = formula(diagrams, transition, is_known, is_never)? else {
            return Ok(None);
        };
        let is_default = transition.guard.is_none() && transition.trigger != Trigger::Star;
        let mut later = Later {
            transition: index,
            earlier: Vec::new(),
            example: Vec::new(),
            has_rest: false,
        };
        if !is_default && diagrams.and(*any, guard)?.can_be_true() {
            for &(earlier, formula) in &self.before {
                let both = diagrams.and(formula, guard)?;
                if let Some(example) = diagrams.example(both) {
                    if later.earlier.is_empty() {
                        later.example = example;
                    }
                    later.earlier.push(earlier);
                    if later.earlier.len() == MAX_SHOWN {
                        break;
                    }
                }
            }
            let none = diagrams.not(*any)?;
            later.has_rest =
                later.earlier.len() < MAX_SHOWN && diagrams.and(none, guard)?.can_be_true();
        }
        *any = diagrams.or(*any, guard)?;
        if guard.can_be_true() {
            self.before.push((index, guard));
        }
        Ok((!later.earlier.is_empty()).then_some(later))
    }
}

// ─── W105: one `exclusive` group, two active tasks ───────────────────────────────────────────────

/// Tasks of which one alone should be active at a time.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Exclusive<'m> {
    /// Those of a group.
    Group(&'m str),
    /// A dispatcher, by its name.
    Dispatcher(&'m str),
}

impl<'m> Exclusive<'m> {
    fn of(task: &'m Task) -> Option<Self> {
        match &task.exclusive {
            _ if task.dispatcher.is_some() => Some(Self::Dispatcher(&task.name)),
            Some(group) => Some(Self::Group(group)),
            None => None,
        }
    }
}

impl Warnings<'_> {
    /// Also E014: dispatchers that two task states use at a time.
    pub(super) fn exclusive_tasks(&self, sink: &mut Sink) {
        let mut groups: BTreeMap<Exclusive<'_>, Vec<StateId>> = BTreeMap::new();
        for (container, region, declared, _) in self.regions() {
            for (state, declared) in declared.states.iter().enumerate() {
                let id = StateId {
                    container,
                    region,
                    state,
                };
                if let StateKind::Task { task, .. } = declared.kind
                    && !lacks_kind(self.holes, id)
                    && let Some(task) = self.model.tasks.get(task)
                    && let Some(group) = Exclusive::of(task)
                {
                    groups.entry(group).or_default().push(id);
                }
            }
        }
        let Some(mut nesting) = SideBySide::new(self.model, self.holes, self.known) else {
            return;
        };
        for (group, mut members) in groups {
            // In source order: which of two comes later is which is reported.
            members.sort_by_key(|id| self.state(*id).map(|state| state.declaration));
            let Some(partners) = nesting.partners(&members) else {
                return;
            };
            for (index, (member, partner)) in members.iter().zip(partners).enumerate() {
                if let Some(partner) = partner
                    && partner.member <= index
                    && let Some(other) = members.get(partner.member)
                {
                    self.report_exclusive(group, *member, *other, partner.meeting, sink);
                }
            }
        }
    }

    fn report_exclusive(
        &self,
        group: Exclusive<'_>,
        later: StateId,
        earlier: StateId,
        meeting: Meeting,
        sink: &mut Sink,
    ) {
        let (Some(later_state), Some(earlier_state)) = (self.state(later), self.state(earlier))
        else {
            return;
        };
        let who = if later == earlier {
            format!(
                "task state `{}` can be active twice at a time",
                later_state.name
            )
        } else {
            format!(
                "task states `{}` and `{}` can be active together",
                earlier_state.name, later_state.name
            )
        };
        let (code, message, hint) = match group {
            Exclusive::Group(group) => (
                Code::W105,
                match later == earlier {
                    true => format!("{who}, and its task is `exclusive {group}`"),
                    false => format!("{who}, and their tasks are `exclusive {group}`"),
                },
                "of the two the one that is entered first runs, the other one waits and is `busy`: put both into one region, or let them be entered one after the other",
            ),
            Exclusive::Dispatcher(name) => (
                Code::E014,
                format!("{who}, and a link has one `{name}`"),
                "put both into one region, or use the dispatcher in one task state that all the others go on beside",
            ),
        };
        let mut diagnostic = Diagnostic::new(code, later_state.declaration, message).hint(hint);
        if later != earlier {
            diagnostic = diagnostic.related(earlier_state.declaration, "the other task state");
        }
        sink.push(self.relate_regions(diagnostic, meeting));
    }

    fn relate_regions(&self, diagnostic: Diagnostic, meeting: Meeting) -> Diagnostic {
        match meeting {
            Meeting::Regions {
                container,
                own,
                other,
            } => self.relate_two_regions(diagnostic, container, own, other),
            Meeting::Inside => diagnostic,
        }
    }

    fn relate_two_regions(
        &self,
        diagnostic: Diagnostic,
        container: usize,
        own: usize,
        other: usize,
    ) -> Diagnostic {
        let (Some(a), Some(b)) = (
            self.region(container, own.min(other)),
            self.region(container, own.max(other)),
        ) else {
            return diagnostic;
        };
        diagnostic
            .related(
                a.span,
                format!(
                    "region `{}` of `{}`, with one of them, runs side by side",
                    a.name,
                    self.container_name(container)
                ),
            )
            .related(
                b.span,
                format!("with region `{}`, with the other one", b.name),
            )
    }
}

// ─── W108: states without a way out ──────────────────────────────────────────────────────────────

impl Warnings<'_> {
    /// A state of a container that is used often has no way out if it has none in some instance.
    pub(super) fn dead_ends(&self, uses: &Uses, sink: &mut Sink) {
        let (Some(machine), true) = (self.model.machine, self.known.children_first().is_some())
        else {
            return;
        };
        let mut ways_out: Vec<Vec<Vec<bool>>> = vec![Vec::new(); self.model.containers.len()];
        for (container, _, region, holes) in self.regions() {
            if let Some(ways_out) = ways_out.get_mut(container) {
                ways_out.push(has_way_out(region, holes));
            }
        }
        let has_way_out = |id: StateId| {
            ways_out
                .get(id.container)
                .and_then(|regions| regions.get(id.region)?.get(id.state))
                != Some(&false)
        };
        // Containers with an instance around which nothing has a way out, and the superstate that
        // is that instance.
        let mut is_open = vec![false; self.model.containers.len()];
        let mut around: Vec<Option<StateId>> = vec![None; self.model.containers.len()];
        let mut queue = VecDeque::from([machine]);
        if let Some(is_open) = is_open.get_mut(machine) {
            *is_open = true;
        }
        while let Some(container) = queue.pop_front() {
            for &(state, inside) in uses.of_container(container) {
                if !has_way_out(state)
                    && let Some(is_open) = is_open.get_mut(inside)
                    && !std::mem::replace(is_open, true)
                {
                    if let Some(around) = around.get_mut(inside) {
                        *around = Some(state);
                    }
                    queue.push_back(inside);
                }
            }
        }
        for (container, region_index, region, holes) in self.regions() {
            if is_open.get(container) != Some(&true) {
                continue;
            }
            for (state_index, state) in region.states.iter().enumerate() {
                let id = StateId {
                    container,
                    region: region_index,
                    state: state_index,
                };
                // What is unknown may be a task that never finishes.
                let is_unknown =
                    state_holes(holes, state_index).is_twin || lacks_kind(self.holes, id);
                if has_way_out(id) || is_unknown || self.is_endless(state) {
                    continue;
                }
                sink.push(self.dead_end(state, container, &around));
            }
        }
    }

    /// Whether a state's task never finishes, so that it needs no way out.
    fn is_endless(&self, state: &State) -> bool {
        match state.kind {
            StateKind::Task { task, .. } => {
                self.model.tasks.get(task).is_some_and(|task| task.endless)
            }
            _ => false,
        }
    }

    fn dead_end(&self, state: &State, container: usize, around: &[Option<StateId>]) -> Diagnostic {
        let name = &state.name;
        let hint = match state.kind {
            StateKind::Simple => format!(
                "write a transition from it; where a region is to end write `-> final` instead of `-> {name}`"
            ),
            StateKind::Task { task, .. } => format!(
                "write a transition from it; if its task never finishes, declare it so: `task {} endless …`",
                self.model.tasks.get(task).map_or("", |task| &task.name)
            ),
            StateKind::Super { .. } => format!(
                "write a transition from it; if it is to go on for ever, say what happens should it finish: `{name} -> {name} on *;`"
            ),
        };
        let mut outside = around.get(container).copied().flatten();
        let message = if outside.is_some() {
            format!(
                "state `{name}` has no way out: no transition leaves it or a superstate around it"
            )
        } else {
            format!("state `{name}` has no way out: no transition leaves it")
        };
        let mut diagnostic = Diagnostic::new(Code::W108, state.declaration, message).hint(hint);
        let file = self.model.files.get(state.span.file as usize);
        if let (false, Some(file)) = (matches!(state.kind, StateKind::Simple), file) {
            let statement = format!("{name} -> {name} on *;");
            let insert = insert_behind(&file.text, state.declaration, &statement);
            diagnostic = diagnostic.fix(Fix::one(format!("write `{statement}`"), insert));
        }
        for _ in 0..MAX_SHOWN {
            let Some(id) = outside else {
                break;
            };
            if let Some(state) = self.state(id) {
                diagnostic =
                    diagnostic.related(state.declaration, "around it, and never left either");
            }
            outside = around.get(id.container).copied().flatten();
        }
        diagnostic
    }
}

/// For each state, whether a transition leaves it, or may.
fn has_way_out(region: &Region, holes: Option<&RegionHoles>) -> Vec<bool> {
    let loose = || holes.into_iter().flat_map(|holes| &holes.transitions);
    let is_unknown =
        holes.is_some_and(|holes| holes.body) || loose().any(|loose| loose.source.is_none());
    let mut has_way_out = vec![is_unknown; region.states.len()];
    let sources = region
        .transitions
        .iter()
        .map(|transition| transition.source);
    for source in sources.chain(loose().filter_map(|loose| loose.source)) {
        if let Source::State(state) = source
            && let Some(has_way_out) = has_way_out.get_mut(state)
        {
            *has_way_out = true;
        }
    }
    has_way_out
}

// ─── W110: one net, two active writers ───────────────────────────────────────────────────────────

impl Warnings<'_> {
    pub(super) fn competing_writers(&self, uses: &Uses, sink: &mut Sink) {
        for meeting in nets::meetings(self.model, self.known, uses) {
            let container = meeting.second.state.container;
            let has_holes = self
                .holes
                .containers
                .get(container)
                .is_some_and(|holes| holes.paths);
            if has_holes {
                continue;
            }
            let (first, second) = (meeting.first, meeting.second);
            let mut diagnostic = Diagnostic::new(
                Code::W110,
                self.path_span(container, second.path),
                format!(
                    "`{}` and `{}` write to one net and can be active together",
                    self.written(first),
                    self.written(second)
                ),
            )
            .hint("a reader sees whichever wrote last: put both into one region, or give each its own net");
            if first.path != second.path {
                let span = self.path_span(container, first.path);
                diagnostic =
                    diagnostic.related(span, format!("`{}` writes here", self.written(first)));
            }
            let (own, other) = (second.state.region, first.state.region);
            sink.push(self.relate_two_regions(diagnostic, container, own, other));
        }
    }

    fn path_span(&self, container: usize, path: usize) -> Span {
        self.model
            .containers
            .get(container)
            .and_then(|container| container.paths.get(path))
            .map_or_else(Span::default, |path| path.span)
    }

    /// An end as it is written in its path.
    fn written(&self, writer: Writer) -> String {
        let Some(state) = self.state(writer.state) else {
            return String::new();
        };
        let ports = match state.kind {
            StateKind::Task { task, .. } => self.model.tasks.get(task).map(|task| &task.data),
            StateKind::Super { container } => self
                .model
                .containers
                .get(container)
                .map(|container| &container.data),
            StateKind::Simple => None,
        };
        let port = ports.and_then(|ports| ports.get(writer.port));
        format!("{}.{}", state.name, port.map_or("", |port| &port.name))
    }
}

// ─── W111, W112: values that get old ─────────────────────────────────────────────────────────────

impl Warnings<'_> {
    /// A state of a container that is used often is reported if the value stays in some instance.
    pub(super) fn old_values(&self, uses: &Uses, sink: &mut Sink) {
        // What is not known may write.
        if !self.holes.are_parts_known() {
            return;
        }
        let Some(mut layout) = nets::lay_out(self.model, self.possible, uses) else {
            return;
        };
        let found = freshness::find(self.model, self.known, self.possible, &mut layout);
        for staying in &found.staying {
            self.report_staying(staying, sink);
        }
        if self.holes.slots {
            return;
        }
        let of_states = found
            .too_strict
            .chunk_by(|a, b| a.reader.state == b.reader.state);
        for ports in of_states {
            self.report_too_strict(ports, sink);
        }
    }

    fn report_staying(&self, staying: &Staying, sink: &mut Sink) {
        let (Some(state), Some(writer)) = (self.state(staying.state), self.state(staying.writer))
        else {
            return;
        };
        let (name, writer_name) = (&state.name, &writer.name);
        let reader = self.port_written(staying.reader);
        let mut diagnostic = Diagnostic::new(
            Code::W111,
            state.declaration,
            format!(
                "the last value stays: in `{name}` nobody writes what `{reader}` reads, which is still what `{writer_name}` wrote last"
            ),
        );
        if let Some(task) = self.model.tasks.get(staying.reader.task)
            && let Some(port) = task.data.get(staying.reader.port)
        {
            let hint = match task.dispatcher {
                Some(_) => format!(
                    "let `{name}` write one, or leave the state that sends where `{writer_name}` is left"
                ),
                None => format!(
                    "let task `{}` ask for a fresh value (`{}: {} within 500 ms`) and do what is safe where there is none, or let `{name}` write one",
                    task.name, port.name, port.type_name
                ),
            };
            diagnostic = diagnostic
                .hint(hint)
                .related(port.span, "this port takes a value however old it is");
        }
        sink.push(diagnostic.related(writer.declaration, "the value comes from here"));
    }

    /// What is said of the ports of one task state.
    fn report_too_strict(&self, ports: &[TooStrict], sink: &mut Sink) {
        let Some(first) = ports.first() else {
            return;
        };
        let Some(state) = self.state(first.reader.state) else {
            return;
        };
        let limits: Vec<String> = ports
            .iter()
            .map(|found| {
                format!(
                    "`{}` wants a value within {} us, and `{}` writes every {} us",
                    self.port_written(found.reader),
                    found.within_us,
                    self.port_written(found.writer),
                    found.period_us
                )
            })
            .collect();
        let message = format!(
            "{}: a value is too old before the next one can come",
            limits.join("; ")
        );
        let mut diagnostic = Diagnostic::new(Code::W112, state.declaration, message)
            .hint("lengthen the `within`, or let the writer run in a slot with a shorter period");
        for found in ports.iter().take(MAX_SHOWN) {
            if let Some(task) = self.model.tasks.get(found.reader.task)
                && let Some(port) = task.data.get(found.reader.port)
            {
                diagnostic = diagnostic.related(port.span, "the port that reads");
            }
            if let Some(writer) = self.state(found.writer.state) {
                diagnostic = diagnostic.related(writer.declaration, "what writes the most often");
            }
        }
        sink.push(diagnostic);
    }

    /// A port of a task state as a path names it.
    fn port_written(&self, port: Port) -> String {
        let state = self.state(port.state).map_or("", |state| &state.name);
        let task = self.model.tasks.get(port.task);
        let declared = task.and_then(|task| task.data.get(port.port));
        format!("{state}.{}", declared.map_or("", |port| &port.name))
    }
}
