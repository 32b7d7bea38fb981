//! Which tasks share a slot, and how long they take together at most.
//!
//! Tasks that share a slot run one after another in it, as far as they can be active together. That
//! is worked out on the tree: of the states of a region one is active, of the regions of a
//! container all are. Of an `exclusive` group one runs at a time. States that nothing leads to are
//! never active ([`Activity`]).
//!
//! Each slot is added up by itself, through the containers that have one of its tasks inside, so
//! that what is kept at a time is one sum a container.
//!
//! ```
//! use esm_toolkit::lang::{analysis::sharing, load_text};
//!
//! let model = load_text("one.esm", "
//!     interpreter slot 1; slot 1 period 20 ms duration 1 ms; slot 2 period 20 ms duration 4 ms;
//!     task Go slot 2 wcet 1 ms { } task Turn slot 2 wcet 2 ms { } task Count slot 2 wcet 500 us { }
//!     machine M {
//!       region motion { task Ahead: Go; task Away: Turn; initial -> Ahead; Ahead -> Away; Away -> Ahead; }
//!       region position { task Here: Count; initial -> Here; Here -> Here; }
//!     }
//! ").model.expect("a set without errors");
//! let of_two = &sharing::of_model(&model)[1];
//! assert_eq!(of_two.tasks, ["motion/Ahead", "motion/Away", "position/Here"]);
//! assert_eq!((of_two.worst_us, &of_two.together[..]), (Some(2_500), &["motion/Away".into(), "position/Here".into()][..]));
//! ```

use std::collections::{BTreeMap, HashMap, HashSet};

use serde::Serialize;

use crate::model::{Model, SlotRef, StateKind};

use super::activity::{Activity, StateId, View};
use super::holes::Holes;
use super::side_by_side::SideBySide;

/// How many `exclusive` groups with tasks that can be active together are told apart in one slot.
pub const MAX_GROUPS_IN_SLOT: usize = 8;

/// Steps that the sums of all slots may take together.
pub const MAX_STEPS: usize = 10_000_000;

/// Steps that finding out which task states these are may take for all slots together: beyond them
/// they are not named.
pub const MAX_NAMING_STEPS: usize = 2_000_000;

/// As many task states of a slot are named; of more there is the number.
pub const MAX_NAMED: usize = 256;

/// As many pairs of slots are compared for whether one of them would do.
pub const MAX_PAIRS: usize = 1_000;

// ─── What a slot is asked for ────────────────────────────────────────────────────────────────────

/// The tasks of a slot. Paths are region and state names in turn from the machine, or in a set
/// without one from a container's name on.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SlotTasks {
    /// Number of the slot.
    pub slot: u32,
    /// Its duration in microseconds.
    pub duration_us: u32,
    /// The most that tasks which can be active together take in it, in microseconds; `None` where
    /// that is beyond [`MAX_STEPS`] or [`MAX_GROUPS_IN_SLOT`].
    pub worst_us: Option<u64>,
    /// The task states that take it, of each `exclusive` group the longest, in the order in which
    /// they run.
    pub together: Vec<String>,
    /// All task states that name the slot and can be active, in the order of the instance tree.
    pub tasks: Vec<String>,
    /// How many more there are, where these are too many to be named.
    pub left_out: u64,
    /// How many of all have no `wcet`: they count as 0.
    pub without_wcet: u64,
}

/// Two slots of one period of which one would do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Spare {
    /// Number of a slot.
    pub first: u32,
    /// Number of the other.
    pub second: u32,
    /// Their period in microseconds.
    pub period_us: u32,
    /// How long the one slot has to be, in microseconds.
    pub duration_us: u32,
}

/// The tasks of each slot of a model, in the order of the slots.
pub fn of_model(model: &Model) -> Vec<SlotTasks> {
    let holes = Holes::none(model);
    let activity = Activity::of(model, &holes, View::Known);
    let Some(mut loads) = loads_of(model, &activity) else {
        return Vec::new();
    };
    (0..model.slots.len())
        .filter_map(|slot| {
            let found = model.slots.get(slot)?;
            let (worst, together) = match loads.sum(slot) {
                Ok(summed) => (
                    summed.is_exact.then_some(summed.most.us),
                    loads.together(&summed),
                ),
                Err(TooLarge) => (None, Vec::new()),
            };
            let (tasks, count) = loads.all(slot);
            let path = |trail: &Vec<StateId>| path(model, trail);
            Some(SlotTasks {
                slot: found.number,
                duration_us: found.duration_us,
                worst_us: worst,
                together: together.iter().map(path).collect(),
                left_out: count.all.saturating_sub(tasks.len() as u64),
                tasks: tasks.iter().map(path).collect(),
                without_wcet: count.without_wcet,
            })
        })
        .collect()
}

/// Pairs of slots of one period, of which neither runs the interpreter, whose tasks can never be
/// active together: tasks of both fit one slot that is as long as the longer of the two. Of the
/// first [`MAX_PAIRS`] that have one period.
pub fn spare_slots(model: &Model) -> Vec<Spare> {
    let holes = Holes::none(model);
    let activity = Activity::of(model, &holes, View::Known);
    let (Some(loads), Some(mut nesting)) = (
        loads_of(model, &activity),
        SideBySide::new(model, &holes, &activity),
    ) else {
        return Vec::new();
    };
    let mut of_period: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (index, slot) in model.slots.iter().enumerate() {
        let has_tasks = loads.members.get(index).is_some_and(|it| !it.is_empty());
        if has_tasks && model.interpreter_slot != Some(index) {
            of_period.entry(slot.period_us).or_default().push(index);
        }
    }
    let pairs = of_period.values().flat_map(|slots| {
        slots.iter().enumerate().flat_map(|(at, &first)| {
            slots
                .iter()
                .skip(at + 1)
                .map(move |&second| (first, second))
        })
    });
    let mut spare = Vec::new();
    for (first, second) in pairs.take(MAX_PAIRS) {
        let (Some(one), Some(other)) = (model.slots.get(first), model.slots.get(second)) else {
            continue;
        };
        let of_slot = |slot: usize| loads.members.get(slot).into_iter().flatten();
        let states: Vec<StateId> = of_slot(first)
            .chain(of_slot(second))
            .map(|it| it.state)
            .collect();
        let of_first = of_slot(first).count();
        // What meets one of the first slot's tasks is told so before it is told of its own slot's:
        // those come first in the list.
        let Some(partners) = nesting.partners(&states) else {
            return spare;
        };
        let meets = |partner: &Option<super::side_by_side::Partner>| {
            partner.is_some_and(|partner| partner.member < of_first)
        };
        if !partners.iter().skip(of_first).any(meets) {
            spare.push(Spare {
                first: one.number,
                second: other.number,
                period_us: one.period_us,
                duration_us: one.duration_us.max(other.duration_us),
            });
        }
    }
    spare.sort_by_key(|pair| (pair.first, pair.second));
    spare
}

fn loads_of<'m>(model: &'m Model, activity: &Activity) -> Option<Loads<'m>> {
    let mut loads = Loads::new(model, activity.children_first()?);
    for (container, inside) in model.containers.iter().enumerate() {
        for (region, inside) in inside.regions.iter().enumerate() {
            for (state, inside) in inside.states.iter().enumerate() {
                let id = StateId {
                    container,
                    region,
                    state,
                };
                match inside.kind {
                    _ if !activity.is_active(id) => {}
                    StateKind::Task {
                        task,
                        slot: SlotRef::Slot(slot),
                        ..
                    } => {
                        let task = model.tasks.get(task)?;
                        let member = Member {
                            state: id,
                            wcet_us: task.wcet_us,
                            group: task.exclusive.as_deref(),
                        };
                        loads.add_task(slot, member);
                    }
                    StateKind::Super { container } => loads.add_super(id, container),
                    StateKind::Simple | StateKind::Task { .. } => {}
                }
            }
        }
    }
    Some(loads)
}

fn path(model: &Model, trail: &[StateId]) -> String {
    let mut path = String::new();
    for (depth, id) in trail.iter().enumerate() {
        let Some(container) = model.containers.get(id.container) else {
            continue;
        };
        if depth > 0 {
            path.push('/');
        } else if model.machine.is_none() {
            path += &container.name;
            path.push('/');
        }
        if let Some(region) = container.regions.get(id.region)
            && let Some(state) = region.states.get(id.state)
        {
            path += &region.name;
            path.push('/');
            path += &state.name;
        }
    }
    path
}

// ─── The sums ────────────────────────────────────────────────────────────────────────────────────

/// No steps are left.
#[derive(Debug)]
pub(in crate::lang) struct TooLarge;

/// A task state in a slot.
#[derive(Clone, Copy)]
pub(in crate::lang) struct Member<'l> {
    pub(in crate::lang) state: StateId,
    /// One without counts as 0.
    pub(in crate::lang) wcet_us: Option<u32>,
    /// Its `exclusive` group.
    pub(in crate::lang) group: Option<&'l str>,
}

/// What can be active in a slot at a time: the longer, and of what is equally long the more.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(in crate::lang) struct Most {
    /// Sum of the wcets in microseconds.
    pub(in crate::lang) us: u64,
    tasks: u64,
}

impl Most {
    fn and(self, other: Most) -> Most {
        Most {
            us: self.us.saturating_add(other.us),
            tasks: self.tasks.saturating_add(other.tasks),
        }
    }
}

/// For each set of `exclusive` groups (as bits) the most with at most one task of each of these
/// groups, and none of the others.
type Load = Vec<Most>;

/// What a region asks of the slot: one of its states at a time.
#[derive(Clone, Default)]
struct RegionLoad {
    most: Load,
    /// For each set the state that asks for it.
    by: Vec<Option<StateId>>,
}

/// What a container asks of the slot, once all is known of its regions.
struct ContainerLoad {
    regions: Vec<(usize, RegionLoad)>,
    sum: Load,
}

/// What a slot is asked for.
pub(in crate::lang) struct Summed {
    /// The most.
    pub(in crate::lang) most: Most,
    /// Whether it is that, or only the most with at most one task of all the groups beyond
    /// [`MAX_GROUPS_IN_SLOT`].
    is_exact: bool,
    /// The container that asks for it: the machine.
    root: Option<usize>,
    containers: HashMap<usize, ContainerLoad>,
}

#[derive(Clone, Copy, Default)]
struct Count {
    all: u64,
    without_wcet: u64,
}

pub(in crate::lang) struct Loads<'l> {
    model: &'l Model,
    /// Per slot, its task states that can be active, in the order of the model.
    members: Vec<Vec<Member<'l>>>,
    /// Per container, the superstates that are instances of it and can be active.
    outside: Vec<Vec<StateId>>,
    /// The container of each superstate that can be active.
    inside: HashMap<StateId, usize>,
    /// Per container, its place in an order in which each stands behind all that it uses.
    rank: Vec<usize>,
    steps_left: usize,
    /// For finding out which task states they are.
    naming_steps_left: usize,
    /// Per container, what its regions ask of the slot that is looked at; empty in between.
    regions: Vec<BTreeMap<usize, RegionLoad>>,
}

impl<'l> Loads<'l> {
    /// `order`: the containers, each behind all that it uses.
    pub(in crate::lang) fn new(model: &'l Model, order: &[usize]) -> Self {
        let containers = model.containers.len();
        let mut rank = vec![0; containers];
        for (place, &container) in order.iter().enumerate() {
            if let Some(rank) = rank.get_mut(container) {
                *rank = place;
            }
        }
        Loads {
            model,
            members: vec![Vec::new(); model.slots.len()],
            outside: vec![Vec::new(); containers],
            inside: HashMap::new(),
            rank,
            steps_left: MAX_STEPS,
            naming_steps_left: MAX_NAMING_STEPS,
            regions: vec![BTreeMap::new(); containers],
        }
    }

    /// Adds a task state that can be active, in the order of the model.
    pub(in crate::lang) fn add_task(&mut self, slot: usize, member: Member<'l>) {
        if let Some(members) = self.members.get_mut(slot) {
            members.push(member);
        }
    }

    /// Adds a superstate that can be active, an instance of `container`.
    pub(in crate::lang) fn add_super(&mut self, state: StateId, container: usize) {
        if let Some(outside) = self.outside.get_mut(container) {
            outside.push(state);
            self.inside.insert(state, container);
        }
    }

    /// The task states of a slot.
    pub(in crate::lang) fn members(&self, slot: usize) -> &[Member<'l>] {
        self.members.get(slot).map_or(&[], Vec::as_slice)
    }

    /// The most that can be active in a slot at a time.
    pub(in crate::lang) fn sum(&mut self, slot: usize) -> Result<Summed, TooLarge> {
        let members = self.members(slot).to_vec();
        let (groups, is_exact) = self.groups(&members)?;
        let mut summed = self.sum_of(&members, &groups)?;
        summed.is_exact = is_exact;
        Ok(summed)
    }

    /// The `exclusive` groups that are told apart, by number, and whether these are all that make a
    /// difference.
    fn groups(
        &mut self,
        members: &[Member<'l>],
    ) -> Result<(HashMap<&'l str, usize>, bool), TooLarge> {
        let number = |names: &[&'l str]| names.iter().copied().zip(0..).collect();
        let mut names: Vec<&str> = Vec::new();
        let mut known = HashSet::new();
        for group in members.iter().filter_map(|member| member.group) {
            if known.insert(group) {
                names.push(group);
            }
        }
        if names.len() <= MAX_GROUPS_IN_SLOT {
            return Ok((number(&names), true));
        }
        // A group of which at most one task is active at any time makes no difference.
        let mut meeting = Vec::new();
        for name in names {
            let of_group: Vec<Member<'_>> = members
                .iter()
                .filter(|member| member.group == Some(name))
                .map(|member| Member {
                    wcet_us: Some(1),
                    ..*member
                })
                .collect();
            if self.sum_of(&of_group, &HashMap::new())?.most.us > 1 {
                meeting.push(name);
            }
        }
        let mut groups: HashMap<&str, usize> = number(&meeting);
        // The groups beyond the limit are one: what is said to be active together then is.
        for group in groups.values_mut() {
            *group = (*group).min(MAX_GROUPS_IN_SLOT - 1);
        }
        Ok((groups, meeting.len() <= MAX_GROUPS_IN_SLOT))
    }

    /// The most of some task states; those of groups without a number are in none.
    fn sum_of(
        &mut self,
        members: &[Member<'l>],
        groups: &HashMap<&str, usize>,
    ) -> Result<Summed, TooLarge> {
        let opened = self.open(members, groups)?;
        let mut summed = Summed {
            most: Most::default(),
            is_exact: true,
            root: None,
            containers: HashMap::new(),
        };
        for container in opened {
            let load = self.container(container)?;
            // Without a machine each container may be the whole.
            let is_whole = self
                .model
                .machine
                .is_none_or(|machine| machine == container);
            if let Some(&most) = load.sum.last()
                && is_whole
                && (most > summed.most || summed.root.is_none())
            {
                summed.most = most;
                summed.root = Some(container);
            }
            let users = self
                .outside
                .get_mut(container)
                .map(std::mem::take)
                .unwrap_or_default();
            for user in &users {
                self.either(*user, &load.sum)?;
            }
            if let Some(outside) = self.outside.get_mut(container) {
                *outside = users;
            }
            summed.containers.insert(container, load);
        }
        Ok(summed)
    }

    fn step(&mut self, steps: usize) -> Result<(), TooLarge> {
        let left = self.steps_left.checked_sub(steps);
        // What was given up leaves sums behind: nothing is added up after it.
        self.steps_left = left.unwrap_or(0);
        left.map(|_| ()).ok_or(TooLarge)
    }

    /// Notes what task states ask of their slot. Gives the containers around them, each behind all
    /// that it uses.
    fn open(
        &mut self,
        members: &[Member<'l>],
        groups: &HashMap<&str, usize>,
    ) -> Result<Vec<usize>, TooLarge> {
        let group_count = groups.values().max().map_or(0, |last| last + 1);
        for member in members {
            let group = member.group.and_then(|group| groups.get(group).copied());
            let most = Most {
                us: member.wcet_us.unwrap_or(0).into(),
                tasks: 1,
            };
            let load: Load = (0..1 << group_count)
                .map(|set: usize| match group {
                    Some(group) if set >> group & 1 == 0 => Most::default(),
                    _ => most,
                })
                .collect();
            self.either(member.state, &load)?;
        }
        self.around(members)
    }

    /// The containers around task states, each behind all that it uses.
    fn around(&mut self, members: &[Member<'l>]) -> Result<Vec<usize>, TooLarge> {
        let mut is_open = HashSet::new();
        let mut opened = Vec::new();
        for member in members {
            if is_open.insert(member.state.container) {
                opened.push(member.state.container);
            }
        }
        let mut next = 0;
        while let Some(&inside) = opened.get(next) {
            next += 1;
            let users = self.outside.get(inside).map_or(0, Vec::len);
            self.step(1 + users)?;
            for user in self.outside.get(inside).into_iter().flatten() {
                if is_open.insert(user.container) {
                    opened.push(user.container);
                }
            }
        }
        opened.sort_by_key(|&container| self.rank.get(container));
        Ok(opened)
    }

    /// Takes one more state of a region, which is active instead of the others.
    fn either(&mut self, state: StateId, load: &Load) -> Result<(), TooLarge> {
        self.step(load.len())?;
        let Some(regions) = self.regions.get_mut(state.container) else {
            return Ok(());
        };
        let region = regions.entry(state.region).or_insert_with(|| RegionLoad {
            most: vec![Most::default(); load.len()],
            by: vec![None; load.len()],
        });
        for ((most, by), &new) in region.most.iter_mut().zip(&mut region.by).zip(load) {
            if new > *most {
                *most = new;
                *by = Some(state);
            }
        }
        Ok(())
    }

    /// What a container asks of the slot, once all is known of its regions.
    fn container(&mut self, container: usize) -> Result<ContainerLoad, TooLarge> {
        let regions: Vec<(usize, RegionLoad)> = self
            .regions
            .get_mut(container)
            .map(std::mem::take)
            .unwrap_or_default()
            .into_iter()
            .collect();
        let mut sum = Load::new();
        for (place, (_, region)) in regions.iter().enumerate() {
            if place == 0 {
                sum.clone_from(&region.most);
            } else {
                // As many pairs are there of a set of groups and a part of it.
                self.step(3_usize.pow(region.most.len().max(1).ilog2()))?;
                sum = together(&sum, &region.most);
            }
        }
        Ok(ContainerLoad { regions, sum })
    }

    // ─── Which ones they are ─────────────────────────────────────────────────────────────────────

    /// The task states that take the most, each with the superstates around it, from the outside
    /// in; [`MAX_NAMED`] of them.
    fn together(&mut self, summed: &Summed) -> Vec<Vec<StateId>> {
        let mut found = Vec::new();
        let mut trails = Trails::default();
        let cost = |container: usize| {
            let load = summed.containers.get(&container);
            load.map_or(0, |load| {
                load.regions.len() * 3_usize.pow(load.sum.len().max(1).ilog2())
            })
        };
        let share = |container: usize, set: Option<usize>| -> Vec<(StateId, usize)> {
            summed
                .containers
                .get(&container)
                .map_or_else(Vec::new, |load| load.shares(set))
        };
        let Some(root) = summed.root else {
            return found;
        };
        let mut open: Vec<(Option<usize>, StateId, usize)> = share(root, None)
            .into_iter()
            .rev()
            .map(|(state, set)| (None, state, set))
            .collect();
        while let Some((outer, state, set)) = open.pop() {
            if found.len() == MAX_NAMED || !self.may_name(1) {
                break;
            }
            let here = trails.add(outer, state);
            match self.inside.get(&state).copied() {
                None => {
                    let trail = trails.get(here);
                    self.may_name(trail.len());
                    found.push(trail);
                }
                Some(container) => {
                    if !self.may_name(cost(container)) {
                        break;
                    }
                    let inside = share(container, Some(set)).into_iter().rev();
                    open.extend(inside.map(|(state, set)| (Some(here), state, set)));
                }
            }
        }
        found
    }

    /// Whether so many steps of naming are left. They are taken.
    fn may_name(&mut self, steps: usize) -> bool {
        let left = self.naming_steps_left.checked_sub(steps);
        self.naming_steps_left = left.unwrap_or(0);
        left.is_some()
    }

    /// The task states of a slot in the order of the instance tree, [`MAX_NAMED`] of them, and how
    /// many there are: at least, where that takes too long to count.
    fn all(&mut self, slot: usize) -> (Vec<Vec<StateId>>, Count) {
        let members = self.members(slot).to_vec();
        // Per container, what of it is a task of the slot or holds one.
        let mut parts: HashMap<usize, Vec<StateId>> = HashMap::new();
        let mut counts: HashMap<usize, Count> = HashMap::new();
        for member in &members {
            parts
                .entry(member.state.container)
                .or_default()
                .push(member.state);
            let count = counts.entry(member.state.container).or_default();
            count.all += 1;
            count.without_wcet += u64::from(member.wcet_us.is_none());
        }
        let mut opened: Vec<usize> = parts.keys().copied().collect();
        let mut is_open: HashSet<usize> = opened.iter().copied().collect();
        let mut next = 0;
        while let Some(&inside) = opened.get(next) {
            next += 1;
            if !self.may_name(1 + self.outside.get(inside).map_or(0, Vec::len)) {
                let all = members.len() as u64;
                let without_wcet = members.iter().filter(|it| it.wcet_us.is_none()).count() as u64;
                return (Vec::new(), Count { all, without_wcet });
            }
            for user in self.outside.get(inside).into_iter().flatten() {
                parts.entry(user.container).or_default().push(*user);
                if is_open.insert(user.container) {
                    opened.push(user.container);
                }
            }
        }
        opened.sort_by_key(|&container| self.rank.get(container));
        let mut roots = Vec::new();
        let mut total = Count::default();
        for &container in &opened {
            let users = self.outside.get(container).map_or(&[][..], Vec::as_slice);
            let (all, without_wcet) = counts
                .get(&container)
                .map_or((0, 0), |it| (it.all, it.without_wcet));
            for user in users {
                let count = counts.entry(user.container).or_default();
                count.all = count.all.saturating_add(all);
                count.without_wcet = count.without_wcet.saturating_add(without_wcet);
            }
            let is_root = match self.model.machine {
                Some(machine) => machine == container,
                None => users.is_empty(),
            };
            if is_root {
                roots.push(container);
                total.all = total.all.saturating_add(all);
                total.without_wcet = total.without_wcet.saturating_add(without_wcet);
            }
        }
        roots.sort_unstable();
        for parts in parts.values_mut() {
            parts.sort_unstable();
        }
        let inside = |container: usize, outer: Option<usize>| {
            let parts = parts.get(&container).into_iter().flatten().rev();
            parts.map(move |state| (outer, *state))
        };
        let mut found = Vec::new();
        let mut trails = Trails::default();
        let mut open: Vec<(Option<usize>, StateId)> = roots
            .iter()
            .rev()
            .flat_map(|root| inside(*root, None))
            .collect();
        while let Some((outer, state)) = open.pop() {
            if found.len() == MAX_NAMED || !self.may_name(1) {
                break;
            }
            let here = trails.add(outer, state);
            match self.inside.get(&state).copied() {
                None => {
                    let trail = trails.get(here);
                    self.may_name(trail.len());
                    found.push(trail);
                }
                Some(container) => open.extend(inside(container, Some(here))),
            }
        }
        (found, total)
    }
}

impl ContainerLoad {
    /// Which states ask for the most with a set of groups (all where none is given), and for which
    /// part of the set each. In source order.
    fn shares(&self, set: Option<usize>) -> Vec<(StateId, usize)> {
        let mut sums: Vec<Load> = Vec::with_capacity(self.regions.len());
        for (_, region) in &self.regions {
            let sum = sums.last().map(|before| together(before, &region.most));
            sums.push(sum.unwrap_or_else(|| region.most.clone()));
        }
        let mut set = set.unwrap_or(self.sum.len().saturating_sub(1));
        let mut shares = Vec::new();
        for (place, (_, region)) in self.regions.iter().enumerate().rev() {
            let before = place.checked_sub(1).and_then(|before| sums.get(before));
            let of_region = match before {
                None => set,
                Some(before) => {
                    let whole = at(sums.get(place).unwrap_or(before), set);
                    let adds_up = |part: &usize| {
                        at(before, set & !part).and(at(&region.most, *part)) == whole
                    };
                    parts_of(set).find(adds_up).unwrap_or(0)
                }
            };
            if let Some(state) = region.by.get(of_region).copied().flatten() {
                shares.push((state, of_region));
            }
            set &= !of_region;
        }
        shares.reverse();
        shares
    }
}

/// Ways from the outside to states, which share their beginnings.
#[derive(Default)]
struct Trails {
    /// Each with the one around it.
    steps: Vec<(Option<usize>, StateId)>,
}

impl Trails {
    fn add(&mut self, outer: Option<usize>, state: StateId) -> usize {
        self.steps.push((outer, state));
        self.steps.len() - 1
    }

    fn get(&self, last: usize) -> Vec<StateId> {
        let mut trail = Vec::new();
        let mut next = Some(last);
        while let Some(&(outer, state)) = next.and_then(|here| self.steps.get(here)) {
            trail.push(state);
            next = outer;
        }
        trail.reverse();
        trail
    }
}

fn at(load: &Load, set: usize) -> Most {
    load.get(set).copied().unwrap_or_default()
}

/// All parts of a set, the whole one first and the empty one last.
fn parts_of(set: usize) -> impl Iterator<Item = usize> {
    std::iter::successors(Some(set), move |&part| {
        part.checked_sub(1).map(|smaller| smaller & set)
    })
}

/// The load of two regions of one container, which are active at the same time.
fn together(a: &Load, b: &Load) -> Load {
    (0..a.len().max(b.len()))
        // All ways to give each group of the set to one of the two.
        .map(|set| {
            let shared = parts_of(set).map(|of_a| at(a, of_a).and(at(b, set & !of_a)));
            shared.max().unwrap_or_default()
        })
        .collect()
}
