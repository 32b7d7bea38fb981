//! What can happen at all: which transitions can be taken, which states can be reached, which flags
//! can be set.
//!
//! Each container is looked at once, for all its instances together: a flag can be set if a
//! transition into any superstate of the container sets it. Flags that tasks set, `exit` and `busy`
//! of task states may have any value at any time, and every event may come at any time. These are
//! never true:
//!
//! - `timeout` of a state without a limit,
//! - `exit` of a superstate in whose container no region can reach `final`, and of a task state
//!   whose task is `endless`,
//! - an `out` flag of a container that no transition inside can set, and an `in` flag that no
//!   transition into a superstate of it can,
//! - `busy` of a superstate without a task state inside.
//!
//! A transition can be taken if its source can be reached and its guard can be true where those of
//! all transitions before it, of the same source on the same event, are not. So what is said to be
//! impossible is; what is said to be possible may still never happen.
//!
//! The answer is the least one: it starts with nothing and adds what follows until nothing more
//! does. All work is in proportion to the size of the model, but for guards, where it is counted:
//! beyond [`STEPS_A_GROUP`] and [`STEPS_A_NODE`] a guard is taken for one that can be true. Whoever
//! warns of what is impossible then warns of less, whoever warns of what is possible of more.

use std::collections::{BTreeMap, VecDeque};

use crate::model::{
    Action, Direction, Guard, Model, Region, Source, StateKind, Target, Transition, Trigger,
};

use super::guards::{Atom, Diagrams, Formula, TooLarge};
use super::holes::{Holes, RegionHoles};

/// Steps that the guards of one state on one event may take.
pub const STEPS_A_GROUP: usize = 20_000;

/// Steps that all guards of a set may take, for each of their parts.
pub const STEPS_A_NODE: usize = 64;

/// A state of a container, the same one in all instances.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct StateId {
    /// Index into [`Model::containers`].
    pub container: usize,
    /// Index into [`Container::regions`](crate::model::Container::regions).
    pub region: usize,
    /// Index into [`Region::states`].
    pub state: usize,
}

/// How holes are looked at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// There is nothing in a hole but what is known of it. Right for warnings of what is possible.
    Known,
    /// There may be anything in a hole. Right for warnings of what is not.
    Possible,
}

/// What can happen in a set of files.
#[derive(Clone, Debug)]
pub struct Activity {
    containers: Vec<ContainerActivity>,
    /// Containers, each behind all that it uses; `None` where one uses itself.
    order: Option<Vec<usize>>,
    /// How many steps the guards of the set may take.
    steps: usize,
}

#[derive(Clone, Debug)]
struct ContainerActivity {
    /// Whether an instance of it can be entered, or it is judged by itself.
    is_live: bool,
    /// Whether an instance that belongs to the machine can be entered. Without a machine each
    /// container may be the whole.
    is_active: bool,
    /// Whether a region can reach `final`.
    can_finish: bool,
    /// Whether there is a task state in it, at any depth.
    has_task: bool,
    /// One for each flag: whether it can be true.
    flags: Vec<bool>,
    regions: Vec<RegionActivity>,
}

#[derive(Clone, Debug)]
struct RegionActivity {
    /// One for each state: whether it can be current.
    states: Vec<bool>,
    /// One for each transition: whether it can be taken.
    transitions: Vec<bool>,
}

impl Activity {
    /// Finds out what can happen in a model.
    pub fn of(model: &Model, holes: &Holes, view: View) -> Self {
        let uses = Uses::of(model, holes);
        let mut search = Search::new(model, holes, view, &uses);
        let steps = search.steps_left;
        search.run();
        let mut activity = Activity {
            containers: search.containers,
            steps,
            order: uses.children_first(),
        };
        activity.mark_active(model, &uses);
        activity
    }

    fn mark_active(&mut self, model: &Model, uses: &Uses) {
        let Some(machine) = model.machine else {
            self.containers
                .iter_mut()
                .for_each(|container| container.is_active = true);
            return;
        };
        let mut queue = vec![machine];
        while let Some(index) = queue.pop() {
            let Some(container) = self.containers.get_mut(index) else {
                continue;
            };
            if std::mem::replace(&mut container.is_active, true) {
                continue;
            }
            let inside = uses.of_container(index);
            queue.extend(
                inside
                    .iter()
                    .filter(|(state, _)| self.can_be_current(*state))
                    .map(|(_, used)| *used),
            );
        }
    }

    /// Whether transitions that can be taken lead to a state, in an instance of its container that
    /// can be entered.
    pub fn is_reachable(&self, state: StateId) -> bool {
        self.is_live(state.container) && self.can_be_current(state)
    }

    /// Whether transitions that can be taken lead to a state, in an instance that belongs to the
    /// machine; without a machine in any.
    pub fn is_active(&self, state: StateId) -> bool {
        self.is_container_active(state.container) && self.can_be_current(state)
    }

    fn can_be_current(&self, state: StateId) -> bool {
        self.region(state.container, state.region)
            .and_then(|region| region.states.get(state.state))
            == Some(&true)
    }

    /// Whether a transition can be taken, by the indices of its container, region and itself.
    pub fn can_be_taken(&self, container: usize, region: usize, transition: usize) -> bool {
        self.region(container, region)
            .and_then(|region| region.transitions.get(transition))
            == Some(&true)
    }

    /// Whether an instance of a container can be entered. A container of which the machine has no
    /// instance is judged by itself.
    pub fn is_live(&self, container: usize) -> bool {
        self.containers
            .get(container)
            .is_some_and(|container| container.is_live)
    }

    /// Whether an instance of a container that belongs to the machine can be entered. Without a
    /// machine each container may be the whole.
    pub fn is_container_active(&self, container: usize) -> bool {
        self.containers
            .get(container)
            .is_some_and(|container| container.is_active)
    }

    /// Containers, each behind all that it uses; `None` where one uses itself.
    pub fn children_first(&self) -> Option<&[usize]> {
        self.order.as_deref()
    }

    /// How many steps the guards of the set may take, for whoever looks at all of them again.
    pub(super) fn steps(&self) -> usize {
        self.steps
    }

    /// Whether what a guard reads is false whenever transitions from `source` are looked at.
    pub(super) fn is_never(
        &self,
        model: &Model,
        holes: &Holes,
        container: usize,
        region: usize,
        source: Source,
        atom: Atom,
    ) -> bool {
        Place {
            container,
            region,
            source,
        }
        .is_never(model, holes, &self.containers, atom)
    }

    fn region(&self, container: usize, region: usize) -> Option<&RegionActivity> {
        self.containers.get(container)?.regions.get(region)
    }
}

// ─── Which containers are used where ─────────────────────────────────────────────────────────────

/// The superstates of a model.
pub(super) struct Uses {
    /// Per container, its superstates in source order, each with the container that it is an
    /// instance of.
    inside: Vec<Vec<(StateId, usize)>>,
}

impl Uses {
    pub(super) fn of(model: &Model, holes: &Holes) -> Self {
        let mut inside = vec![Vec::new(); model.containers.len()];
        for (index, (container, uses)) in model.containers.iter().zip(&mut inside).enumerate() {
            for (region_index, region) in container.regions.iter().enumerate() {
                for (state_index, state) in region.states.iter().enumerate() {
                    let id = StateId {
                        container: index,
                        region: region_index,
                        state: state_index,
                    };
                    if let StateKind::Super { container } = state.kind
                        && !lacks_kind(holes, id)
                    {
                        uses.push((id, container));
                    }
                }
            }
        }
        Uses { inside }
    }

    /// The superstates in a container, each with the container that it is an instance of.
    pub(super) fn of_container(&self, container: usize) -> &[(StateId, usize)] {
        self.inside.get(container).map_or(&[], Vec::as_slice)
    }

    /// Per container, the superstates that are instances of it, in source order.
    pub(super) fn outside(&self) -> Vec<Vec<StateId>> {
        let mut outside = vec![Vec::new(); self.inside.len()];
        for &(state, used) in self.inside.iter().flatten() {
            if let Some(outside) = outside.get_mut(used) {
                outside.push(state);
            }
        }
        outside
    }

    /// Containers, each behind all that it uses; `None` where one uses itself.
    fn children_first(&self) -> Option<Vec<usize>> {
        let outside = self.outside();
        let mut open: Vec<usize> = self.inside.iter().map(Vec::len).collect();
        let mut order: Vec<usize> = (0..open.len())
            .filter(|&container| open.get(container) == Some(&0))
            .collect();
        let mut next = 0;
        while let Some(&container) = order.get(next) {
            next += 1;
            for user in outside.get(container).into_iter().flatten() {
                if let Some(open) = open.get_mut(user.container) {
                    *open -= 1;
                    if *open == 0 {
                        order.push(user.container);
                    }
                }
            }
        }
        (order.len() == self.inside.len()).then_some(order)
    }
}

pub(super) fn lacks_kind(holes: &Holes, state: StateId) -> bool {
    region_holes(holes, state.container, state.region)
        .and_then(|region| region.states.get(state.state))
        .is_some_and(|state| state.kind)
}

pub(super) fn region_holes(holes: &Holes, container: usize, region: usize) -> Option<&RegionHoles> {
    holes.containers.get(container)?.regions.get(region)
}

// ─── The search ──────────────────────────────────────────────────────────────────────────────────

/// A state, or `initial`, of a region.
#[derive(Clone, Copy, Debug)]
struct Place {
    container: usize,
    region: usize,
    source: Source,
}

impl Place {
    /// Whether something that its transitions read is false in all that is known so far.
    fn is_never(
        self,
        model: &Model,
        holes: &Holes,
        containers: &[ContainerActivity],
        atom: Atom,
    ) -> bool {
        let can_be_set = |container: usize, flag: usize| {
            containers
                .get(container)
                .and_then(|container| container.flags.get(flag))
                == Some(&true)
        };
        if let Atom::Parent(flag) = atom {
            return !can_be_set(self.container, flag);
        }
        let Source::State(state) = self.source else {
            return true;
        };
        let Some(declared) = model
            .containers
            .get(self.container)
            .and_then(|container| container.regions.get(self.region))
            .and_then(|region| region.states.get(state))
        else {
            return true;
        };
        let lacks = region_holes(holes, self.container, self.region)
            .and_then(|region| region.states.get(state))
            .copied()
            .unwrap_or_default();
        if atom == Atom::Timeout {
            return declared.timeout_us.is_none() && !lacks.limit;
        }
        match declared.kind {
            _ if lacks.kind => false,
            StateKind::Simple => true,
            StateKind::Task { task, .. } => {
                atom == Atom::Exit && model.tasks.get(task).is_some_and(|task| task.endless)
            }
            StateKind::Super { container } => match atom {
                Atom::Own(flag) => !can_be_set(container, flag),
                Atom::Exit => !containers
                    .get(container)
                    .is_some_and(|container| container.can_finish),
                Atom::Busy => !containers
                    .get(container)
                    .is_some_and(|container| container.has_task),
                Atom::Timeout | Atom::Parent(_) => false,
            },
        }
    }
}

/// The transitions of a region by source, then by event, then in source order.
pub(super) struct Groups {
    /// Indices into [`Region::transitions`].
    order: Vec<usize>,
    /// Where in `order` each group starts, and the end of the last.
    bounds: Vec<usize>,
    /// Which group is the first of `initial`, of state 0, of state 1, and so on, and how many there
    /// are.
    first: Vec<usize>,
}

impl Groups {
    pub(super) fn of(region: &Region) -> Self {
        let key = |index: usize| {
            region.transitions.get(index).map(|transition| {
                let event = match transition.trigger {
                    Trigger::Pulse | Trigger::Star => 0,
                    Trigger::Event(event) => event + 1,
                };
                (row(transition.source), event)
            })
        };
        let mut order: Vec<usize> = (0..region.transitions.len()).collect();
        order.sort_by_key(|&index| key(index));
        let mut groups = Groups {
            order: Vec::new(),
            bounds: Vec::new(),
            first: Vec::with_capacity(region.states.len() + 2),
        };
        let mut last = None;
        for (at, &index) in order.iter().enumerate() {
            let here = key(index);
            if here != last {
                let source = here.map_or(0, |(source, _)| source);
                while groups.first.len() <= source {
                    groups.first.push(groups.bounds.len());
                }
                groups.bounds.push(at);
                last = here;
            }
        }
        while groups.first.len() < region.states.len() + 2 {
            groups.first.push(groups.bounds.len());
        }
        groups.bounds.push(order.len());
        groups.order = order;
        groups
    }

    /// The groups of a source, each the indices of its transitions in source order.
    pub(super) fn of_source(&self, source: Source) -> impl Iterator<Item = &[usize]> {
        let at = |row: usize| self.first.get(row).copied().unwrap_or(0);
        let row = row(source);
        (at(row)..at(row + 1)).filter_map(|group| {
            let (&start, &end) = (self.bounds.get(group)?, self.bounds.get(group + 1)?);
            self.order.get(start..end)
        })
    }
}

/// `initial` and the states of a region in one row.
fn row(source: Source) -> usize {
    match source {
        Source::Initial => 0,
        Source::State(state) => state + 1,
    }
}

/// A transition's guard as a formula; `None` where it is not known.
///
/// # Errors
/// It is too large.
pub(super) fn formula(
    diagrams: &mut Diagrams,
    transition: &Transition,
    is_known: bool,
    is_never: &impl Fn(Atom) -> bool,
) -> Result<Option<Formula>, TooLarge> {
    if !is_known {
        return Ok(None);
    }
    match (transition.trigger, &transition.guard) {
        (Trigger::Star, _) => diagrams.atom(Atom::Exit, is_never).map(Some),
        (_, None) => Ok(Some(Formula::ALWAYS)),
        (_, Some(guard)) => diagrams.guard(guard, is_never).map(Some),
    }
}

struct Search<'m> {
    model: &'m Model,
    holes: &'m Holes,
    view: View,
    containers: Vec<ContainerActivity>,
    regions: Vec<Vec<RegionSearch>>,
    readers: Readers,
    queue: VecDeque<Place>,
    /// Containers that can be entered and have not been looked at yet.
    entered: Vec<usize>,
    diagrams: Diagrams,
    steps_left: usize,
}

/// How far the search is with a region.
struct RegionSearch {
    groups: Groups,
    /// By [`row`]: whether it can be current.
    is_reached: Vec<bool>,
    /// By [`row`]: whether it waits in the queue.
    is_queued: Vec<bool>,
    /// By [`row`]: whether all that leads on from it has been found.
    is_done: Vec<bool>,
    /// By [`row`] of their sources: targets of transitions that are known no better, until they
    /// have been taken.
    loose: BTreeMap<usize, Vec<Target>>,
}

/// Who looks again when something can become true, for each container.
#[derive(Default)]
struct Readers {
    /// Superstates of it whose transitions read `exit`.
    of_exit: Vec<Vec<Place>>,
    /// By flag: superstates of it that read the flag with `.`, and places in it that read it with
    /// `^`.
    of_flag: Vec<Vec<Vec<Place>>>,
}

impl<'m> Search<'m> {
    fn new(model: &'m Model, holes: &'m Holes, view: View, uses: &Uses) -> Self {
        let mut search = Search {
            model,
            holes,
            view,
            containers: Vec::with_capacity(model.containers.len()),
            regions: Vec::with_capacity(model.containers.len()),
            readers: Readers::default(),
            queue: VecDeque::new(),
            entered: Vec::new(),
            diagrams: Diagrams::default(),
            steps_left: 0,
        };
        let mut parts = 0;
        for container in &model.containers {
            search.containers.push(ContainerActivity {
                is_live: false,
                is_active: false,
                can_finish: false,
                has_task: false,
                flags: vec![false; container.flags.len()],
                regions: container
                    .regions
                    .iter()
                    .map(|region| RegionActivity {
                        states: vec![false; region.states.len()],
                        transitions: vec![false; region.transitions.len()],
                    })
                    .collect(),
            });
            search.readers.of_exit.push(Vec::new());
            search
                .readers
                .of_flag
                .push(vec![Vec::new(); container.flags.len()]);
        }
        for (index, container) in model.containers.iter().enumerate() {
            let mut regions = Vec::with_capacity(container.regions.len());
            for (region_index, region) in container.regions.iter().enumerate() {
                for transition in &region.transitions {
                    let place = Place {
                        container: index,
                        region: region_index,
                        source: transition.source,
                    };
                    parts += 1 + search.note_readers(place, transition);
                }
                regions.push(RegionSearch {
                    groups: Groups::of(region),
                    is_reached: vec![false; region.states.len() + 1],
                    is_queued: vec![false; region.states.len() + 1],
                    is_done: vec![false; region.states.len() + 1],
                    loose: loose(holes, index, region_index),
                });
            }
            search.regions.push(regions);
        }
        search.steps_left = STEPS_A_NODE.saturating_mul(parts);
        search.note_tasks(uses);
        search.note_inputs(uses);
        if view == View::Possible {
            search.note_holes();
        }
        search
    }

    /// Notes what the guard of a transition reads; gives how many parts it has.
    fn note_readers(&mut self, place: Place, transition: &Transition) -> usize {
        let used = match place.source {
            Source::Initial => None,
            Source::State(state) => match self.kind(place, state) {
                Some(StateKind::Super { container }) => Some(*container),
                _ => None,
            },
        };
        if transition.trigger == Trigger::Star
            && let Some(readers) = used.and_then(|used| self.readers.of_exit.get_mut(used))
        {
            readers.push(place);
        }
        let mut parts = 0;
        let mut open: Vec<&Guard> = transition.guard.iter().collect();
        while let Some(guard) = open.pop() {
            parts += 1;
            let readers = match guard {
                Guard::Not(inner) => {
                    open.push(inner);
                    continue;
                }
                Guard::And(terms) | Guard::Or(terms) => {
                    open.extend(terms);
                    continue;
                }
                Guard::Exit => used.and_then(|used| self.readers.of_exit.get_mut(used)),
                Guard::Own(flag) => {
                    used.and_then(|used| self.readers.of_flag.get_mut(used)?.get_mut(*flag))
                }
                Guard::Parent(flag) => self
                    .readers
                    .of_flag
                    .get_mut(place.container)
                    .and_then(|flags| flags.get_mut(*flag)),
                Guard::Timeout | Guard::Busy => None,
            };
            if let Some(readers) = readers {
                readers.push(place);
            }
        }
        parts
    }

    /// Which containers have a task state inside.
    fn note_tasks(&mut self, uses: &Uses) {
        let is_possible = self.view == View::Possible;
        let mut queue: Vec<usize> = Vec::new();
        for (index, container) in self.model.containers.iter().enumerate() {
            let holes = self.holes.containers.get(index);
            let may_have_more = is_possible
                && holes.is_some_and(|container| {
                    container.declarations
                        || container.regions.iter().any(|region| {
                            region.body || region.states.iter().any(|state| state.kind)
                        })
                });
            let has_task = container
                .regions
                .iter()
                .enumerate()
                .any(|(region, declared)| {
                    declared.states.iter().enumerate().any(|(state, declared)| {
                        let id = StateId {
                            container: index,
                            region,
                            state,
                        };
                        matches!(declared.kind, StateKind::Task { .. })
                            && !lacks_kind(self.holes, id)
                    })
                });
            if has_task || may_have_more {
                queue.push(index);
            }
        }
        let outside = uses.outside();
        while let Some(index) = queue.pop() {
            if let Some(container) = self.containers.get_mut(index)
                && !std::mem::replace(&mut container.has_task, true)
            {
                let users = outside.get(index).into_iter().flatten();
                queue.extend(users.map(|state| state.container));
            }
        }
    }

    /// Which containers are judged by themselves, and so have inputs of which nothing is known.
    fn note_inputs(&mut self, uses: &Uses) {
        let mut is_inside_machine = vec![false; self.containers.len()];
        let mut queue: Vec<usize> = self.model.machine.into_iter().collect();
        while let Some(index) = queue.pop() {
            if let Some(is_inside) = is_inside_machine.get_mut(index)
                && !std::mem::replace(is_inside, true)
            {
                queue.extend(uses.of_container(index).iter().map(|(_, used)| *used));
            }
        }
        let may_be_used_elsewhere = self.view == View::Possible && self.holes.any();
        for (index, is_inside) in is_inside_machine.into_iter().enumerate() {
            let is_alone = !is_inside || self.model.machine == Some(index);
            if !is_inside || may_be_used_elsewhere {
                self.free_inputs(index);
            }
            if is_alone {
                self.enter(index);
            }
        }
    }

    fn free_inputs(&mut self, index: usize) {
        if let (Some(container), Some(declared)) = (
            self.containers.get_mut(index),
            self.model.containers.get(index),
        ) {
            for (can_be_set, flag) in container.flags.iter_mut().zip(&declared.flags) {
                *can_be_set |= flag.direction == Direction::In;
            }
        }
    }

    /// Notes all that a hole may hold.
    fn note_holes(&mut self) {
        for (container, holes) in self.containers.iter_mut().zip(&self.holes.containers) {
            let has_loose = |region: &RegionHoles| region.body || !region.transitions.is_empty();
            let may_write = holes.declarations
                || holes
                    .regions
                    .iter()
                    .any(|region| has_loose(region) || !region.actions.is_empty());
            container.can_finish |= holes.declarations
                || holes.regions.iter().any(|region| {
                    region.body
                        || region
                            .transitions
                            .iter()
                            .any(|loose| !matches!(loose.target, Some(Target::State(_))))
                });
            if may_write {
                container.flags.fill(true);
            }
        }
    }

    fn kind(&self, place: Place, state: usize) -> Option<&'m StateKind> {
        let id = StateId {
            container: place.container,
            region: place.region,
            state,
        };
        if lacks_kind(self.holes, id) {
            return None;
        }
        let container = self.model.containers.get(place.container)?;
        let declared = container.regions.get(place.region)?.states.get(state)?;
        Some(&declared.kind)
    }

    fn run(&mut self) {
        loop {
            // Not from within one another: containers nest without bound.
            while let Some(container) = self.entered.pop() {
                self.open(container);
            }
            let Some(place) = self.queue.pop_front() else {
                return;
            };
            if let Some(region) = self.region_mut(place)
                && let Some(is_queued) = region.is_queued.get_mut(row(place.source))
            {
                *is_queued = false;
            }
            self.look(place);
        }
    }

    fn region_mut(&mut self, place: Place) -> Option<&mut RegionSearch> {
        self.regions.get_mut(place.container)?.get_mut(place.region)
    }

    /// Looks at all that leads on from a place, for the first time or again.
    fn look(&mut self, place: Place) {
        let model = self.model;
        let Some(declared) = model
            .containers
            .get(place.container)
            .and_then(|container| container.regions.get(place.region))
        else {
            return;
        };
        let mut taken = Vec::new();
        let mut is_done = true;
        if let Some(region) = self
            .regions
            .get(place.container)
            .and_then(|regions| regions.get(place.region))
        {
            let holes = region_holes(self.holes, place.container, place.region);
            for group in region.groups.of_source(place.source) {
                // Also where nothing is left to be found: a state with many transitions may be
                // looked at often.
                self.steps_left = self.steps_left.saturating_sub(group.len());
                let done = self
                    .containers
                    .get(place.container)
                    .and_then(|container| container.regions.get(place.region))
                    .map_or(&[][..], |region| &region.transitions);
                if group.iter().all(|&index| done.get(index) == Some(&true)) {
                    continue;
                }
                let is_never = |atom| place.is_never(model, self.holes, &self.containers, atom);
                self.diagrams.restart(STEPS_A_GROUP.min(self.steps_left));
                let possible = possible(&mut self.diagrams, declared, group, holes, &is_never);
                self.steps_left = self.steps_left.saturating_sub(self.diagrams.steps());
                match possible {
                    Ok(possible) => {
                        is_done &= possible.len() == group.len();
                        taken.extend(possible);
                    }
                    Err(TooLarge) => taken.extend(group),
                }
            }
        }
        for index in taken {
            if let Some(transition) = declared.transitions.get(index) {
                self.take(place, index, transition);
            }
        }
        self.take_loose(place);
        if let Some(region) = self.region_mut(place)
            && let Some(known) = region.is_done.get_mut(row(place.source))
        {
            *known = is_done;
        }
    }

    /// Notes that a transition can be taken, and what follows from it.
    fn take(&mut self, place: Place, index: usize, transition: &Transition) {
        let Some(can_be_taken) = self
            .containers
            .get_mut(place.container)
            .and_then(|container| container.regions.get_mut(place.region))
            .and_then(|region| region.transitions.get_mut(index))
        else {
            return;
        };
        if std::mem::replace(can_be_taken, true) {
            return;
        }
        self.arrive(place, transition.target);
        for action in &transition.actions {
            match (*action, transition.target) {
                (Action::Own(flag, true), Target::State(state)) => {
                    if let Some(StateKind::Super { container }) = self.kind(place, state) {
                        self.set(*container, flag);
                    }
                }
                (Action::Parent(flag, true), _) => self.set(place.container, flag),
                _ => {}
            }
        }
    }

    fn take_loose(&mut self, place: Place) {
        let targets = self
            .region_mut(place)
            .and_then(|region| region.loose.remove(&row(place.source)));
        for target in targets.into_iter().flatten() {
            self.arrive(place, target);
        }
    }

    /// Notes that a transition from a place can lead to a target.
    fn arrive(&mut self, place: Place, target: Target) {
        match target {
            Target::State(state) => self.reach(Place {
                source: Source::State(state),
                ..place
            }),
            Target::Final => self.finish(place.container),
        }
    }

    fn finish(&mut self, container: usize) {
        if let Some(activity) = self.containers.get_mut(container)
            && !std::mem::replace(&mut activity.can_finish, true)
        {
            let readers = self.readers.of_exit.get_mut(container);
            for place in readers.map(std::mem::take).unwrap_or_default() {
                self.look_again(place);
            }
        }
    }

    fn set(&mut self, container: usize, flag: usize) {
        if let Some(can_be_set) = self
            .containers
            .get_mut(container)
            .and_then(|container| container.flags.get_mut(flag))
            && !std::mem::replace(can_be_set, true)
        {
            let readers = self
                .readers
                .of_flag
                .get_mut(container)
                .and_then(|flags| flags.get_mut(flag));
            for place in readers.map(std::mem::take).unwrap_or_default() {
                self.look_again(place);
            }
        }
    }

    /// Notes that a place can be current.
    fn reach(&mut self, place: Place) {
        let Some(is_reached) = self
            .region_mut(place)
            .and_then(|region| region.is_reached.get_mut(row(place.source)))
        else {
            return;
        };
        if std::mem::replace(is_reached, true) {
            return;
        }
        if let Source::State(state) = place.source {
            if let Some(can_be_current) = self
                .containers
                .get_mut(place.container)
                .and_then(|container| container.regions.get_mut(place.region))
                .and_then(|region| region.states.get_mut(state))
            {
                *can_be_current = true;
            }
            if let Some(StateKind::Super { container }) = self.kind(place, state) {
                self.enter(*container);
            }
        }
        self.look_again(place);
    }

    /// Puts a place that can be current into the queue.
    fn look_again(&mut self, place: Place) {
        let row = row(place.source);
        if let Some(region) = self.region_mut(place)
            && region.is_reached.get(row) == Some(&true)
            && region.is_done.get(row) != Some(&true)
            && let Some(is_queued) = region.is_queued.get_mut(row)
            && !std::mem::replace(is_queued, true)
        {
            self.queue.push_back(place);
        }
    }

    /// Notes that a container can be entered.
    fn enter(&mut self, index: usize) {
        if let Some(container) = self.containers.get_mut(index)
            && !std::mem::replace(&mut container.is_live, true)
        {
            self.entered.push(index);
        }
    }

    /// Starts with the regions of a container.
    fn open(&mut self, index: usize) {
        for region in 0..self.regions.get(index).map_or(0, Vec::len) {
            let place = Place {
                container: index,
                region,
                source: Source::Initial,
            };
            self.reach(place);
            if let (View::Possible, Some(holes)) =
                (self.view, region_holes(self.holes, index, region))
            {
                if holes.body || holes.transitions.iter().any(|loose| loose.target.is_none()) {
                    self.reach_all(place);
                }
                for target in holes.transitions.iter().filter_map(|loose| loose.target) {
                    self.arrive(place, target);
                }
            }
        }
    }

    fn reach_all(&mut self, place: Place) {
        let states = self
            .region_mut(place)
            .map_or(0, |region| region.is_reached.len().saturating_sub(1));
        for state in 0..states {
            self.reach(Place {
                source: Source::State(state),
                ..place
            });
        }
    }
}

/// Transitions that are there, but not in the model, as far as both their ends are known.
fn loose(holes: &Holes, container: usize, region: usize) -> BTreeMap<usize, Vec<Target>> {
    let mut loose: BTreeMap<usize, Vec<Target>> = BTreeMap::new();
    for transition in region_holes(holes, container, region)
        .into_iter()
        .flat_map(|holes| &holes.transitions)
    {
        if let (Some(source), Some(target)) = (transition.source, transition.target) {
            loose.entry(row(source)).or_default().push(target);
        }
    }
    loose
}

/// Which transitions of a group can be taken.
///
/// # Errors
/// Their guards are too large.
fn possible(
    diagrams: &mut Diagrams,
    region: &Region,
    group: &[usize],
    holes: Option<&RegionHoles>,
    is_never: &impl Fn(Atom) -> bool,
) -> Result<Vec<usize>, TooLarge> {
    let mut possible = Vec::with_capacity(group.len());
    // What is left to a transition by those before it.
    let mut rest = Formula::ALWAYS;
    for &index in group {
        if !rest.can_be_true() {
            break;
        }
        let Some(transition) = region.transitions.get(index) else {
            continue;
        };
        let is_known = !holes.is_some_and(|holes| holes.lacks_guard(index));
        match formula(diagrams, transition, is_known, is_never)? {
            // One that is not known can be true, and leaves everything to the others.
            None => possible.push(index),
            Some(guard) => {
                if diagrams.and(rest, guard)?.can_be_true() {
                    possible.push(index);
                }
                let not = diagrams.not(guard)?;
                rest = diagrams.and(rest, not)?;
            }
        }
    }
    Ok(possible)
}
