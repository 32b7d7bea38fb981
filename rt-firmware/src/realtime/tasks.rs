//! The record of each task instance of a mission: all that its executions need, bound when the
//! mission is staged; whether it waits to be entered; and who holds its `exclusive` group.

use esm_core::tables::Tables;

pub(crate) use super::slots::NONE;
use super::slots::SlotEntry;
use crate::frames::FrameLists;
#[cfg(feature = "links")]
use crate::frames::NO_DISPATCHER;
use crate::ports::{Binding, Registry, TaskPlace};
use crate::task::MAX_PARAMS;

/// Stands for no bank of the registry.
const NO_BANK: u8 = u8::MAX;
/// Stands for no place of a bank, which has fewer.
const NO_PLACE: u8 = u8::MAX;
/// Stands for no group.
pub(crate) const NO_GROUP: u8 = u8::MAX;

/// What is kept for a task instance: its executions read this and nothing else.
#[derive(Clone, Copy, Debug)]
pub struct TaskEntry {
    /// Its task, where the task's ports lead, and where its flags and parameters stand.
    pub(super) binding: Binding,
    /// The next task instance of the same slot, in instance order.
    pub(super) next_in_slot: u16,
    /// Its slot, or [`NONE`] for slot 0.
    slot: u16,
    /// The slot's period in microseconds, 0 of slot 0.
    pub(super) period_us: u32,
    /// When it was enabled: a number that grows with each task that becomes enabled.
    order: u32,
    overruns: u16,
    place: TaskPlace,
    pub(super) group: u8,
    pub(super) activity: TaskActivity,
    /// Its busy flag may be set.
    pub(super) is_busy: bool,
    /// Number of its parameters.
    pub(super) params: u8,
    /// The dispatcher of a link that it is, or [`NO_DISPATCHER`].
    #[cfg(feature = "links")]
    pub(super) dispatcher: u8,
}

/// Whether a task is enabled, and how far it has come. The number of [`Fresh`](Self::Fresh) alone
/// is odd, so that who is fresh is known by one bit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum TaskActivity {
    /// It is not enabled.
    Off = 0,
    /// Entered, and not executed since.
    Fresh = 1,
    /// Executed since it was entered.
    UnderWay = 2,
    /// Its mission was left, and it serves the one that took over.
    GoneOn = 4,
}

impl TaskActivity {
    /// Whether the task was entered, and not executed since.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn is_fresh(self) -> bool {
        self as u8 & 1 != 0
    }
}

impl TaskEntry {
    /// The entry of no task.
    pub const EMPTY: TaskEntry = TaskEntry {
        binding: Binding::NONE,
        next_in_slot: NONE,
        slot: NONE,
        period_us: 0,
        order: 0,
        overruns: 0,
        place: TaskPlace {
            bank: NO_BANK,
            place: 0,
        },
        group: NO_GROUP,
        activity: TaskActivity::Off,
        is_busy: false,
        params: 0,
        #[cfg(feature = "links")]
        dispatcher: NO_DISPATCHER,
    };

    /// The place of a task before any mission, which makes it [`EMPTY`](Self::EMPTY). All zeros, so
    /// that a static of it takes no flash.
    pub(crate) const UNUSED: TaskEntry = TaskEntry {
        next_in_slot: 0,
        slot: 0,
        group: 0,
        #[cfg(feature = "links")]
        dispatcher: 0,
        place: TaskPlace { bank: 0, place: 0 },
        ..Self::EMPTY
    };
}

/// An `exclusive` group: at most one of its enabled tasks is executed.
#[derive(Clone, Copy, Debug)]
pub struct Group {
    /// The task instance that has been enabled longest.
    holder: u16,
}

impl Group {
    /// A group that nobody holds.
    pub const FREE: Group = Group { holder: NONE };

    /// The place of a group before any mission, which makes it [`FREE`](Self::FREE). All zeros, so
    /// that a static of it takes no flash.
    pub(crate) const UNUSED: Group = Group { holder: 0 };
}

/// What is kept for the tasks and slots of a mission.
#[derive(Default)]
pub(crate) struct Lists<'m> {
    pub(crate) tasks: &'m mut [TaskEntry],
    pub(crate) slots: &'m mut [SlotEntry],
    pub(crate) first_in_slot_0: Option<u16>,
    /// What is kept for the links of the mission.
    #[cfg_attr(not(feature = "links"), expect(dead_code, reason = "there are none"))]
    pub(crate) frames: FrameLists<'m>,
}

/// The task instances of a mission.
pub(crate) struct TaskTable<'m> {
    /// Those of the mission, if there is one.
    pub(crate) lists: Lists<'m>,
    pub(super) groups: &'m mut [Group],
    next_order: u32,
    /// Whether something has changed since background tasks were looked at, so that one may start
    /// that could not.
    look_for_runs: bool,
}

/// Makes the lists of a mission that was [checked](crate::check), before its first macro step:
/// gives each task instance a task, in instance order, and links those of each slot.
// Not inlined: no mission should be made on top of this.
#[inline(never)]
pub(crate) fn prepare(tables: &Tables<'_>, registry: Registry<'_>, lists: &mut Lists<'_>) {
    let Lists {
        tasks,
        slots,
        first_in_slot_0,
        #[cfg(feature = "links")]
        frames,
        ..
    } = lists;
    #[cfg(feature = "links")]
    frames.prepare(tables, registry);
    let count = tables.task_instance_count().min(tasks.len());
    tasks.fill(TaskEntry::EMPTY);
    *first_in_slot_0 = None;
    // Nobody looks at a slot that the mission does not have.
    for (entry, slot) in slots.iter_mut().zip(tables.slots()) {
        *entry = SlotEntry::EMPTY;
        entry.set_duration_us(slot.duration_us);
    }
    for instance in 0..count {
        let state = tables.task_state_of(instance);
        let task = state.and_then(|state| tables.task(state.task));
        let bank = task.and_then(|task| registry.find(task.signature_hash));
        let free = free_place(tasks, bank.unwrap_or(NO_BANK));
        let places = tables.task_places(instance).unwrap_or_default();
        if let Some(entry) = tasks.get_mut(instance) {
            entry.place = free;
            entry.binding = registry.bind(free, tables.nets_from(places.first_connection));
            entry.binding.places = places;
            entry.params = entry.binding.param_count().min(MAX_PARAMS) as u8;
            #[cfg(feature = "links")]
            if let Some(state) = state {
                entry.dispatcher = frames.dispatcher(tables, state.task);
            }
            entry.group = task
                .and_then(|task| task.exclusive)
                .map_or(NO_GROUP, |group| group as u8);
        }
    }
    // From the last to the first, so that each becomes the head of its slot's list.
    for (instance, entry) in tasks.iter_mut().enumerate().take(count).rev() {
        let Some(state) = tables.task_state_of(instance) else {
            return;
        };
        let next = match state.slot {
            None => first_in_slot_0.replace(instance as u16).unwrap_or(NONE),
            Some(slot) => match slots.get_mut(slot) {
                Some(slot) => slot.put_first(instance as u16),
                None => continue,
            },
        };
        entry.next_in_slot = next;
        entry.slot = state.slot.map_or(NONE, |slot| slot as u16);
        let slot = state.slot.and_then(|slot| tables.slot(slot));
        entry.period_us = slot.map_or(0, |slot| slot.period_us);
    }
}

/// The first enabled task instance of a slot, from this one on, or [`NONE`].
#[cfg_attr(feature = "speed", inline(always))]
fn first_enabled(entries: &[TaskEntry], first: u16) -> u16 {
    let mut instance = first;
    while let Some(entry) = entries.get(usize::from(instance))
        && entry.activity == TaskActivity::Off
    {
        instance = entry.next_in_slot;
    }
    instance
}

/// Makes the lists of a mission that ran with them what they were before its first macro step.
pub(crate) fn prepare_again(lists: &mut Lists<'_>) {
    for entry in lists.tasks.iter_mut() {
        entry.activity = TaskActivity::Off;
        entry.overruns = 0;
        entry.is_busy = false;
    }
    for slot in lists.slots.iter_mut() {
        slot.begin_anew();
    }
}

/// The tasks of a mission that has ended which do not go on. Those that served nobody have nothing
/// to forget.
pub(crate) fn left_behind(entries: &[TaskEntry]) -> impl Iterator<Item = TaskPlace> {
    entries
        .iter()
        .filter(|entry| entry.place.bank != NO_BANK && entry.activity != TaskActivity::GoneOn)
        .map(|entry| entry.place)
}

/// The first task of a bank that serves nobody.
fn free_place(entries: &[TaskEntry], bank: u8) -> TaskPlace {
    let mut first = 0;
    loop {
        // As many at a time as a word has bits, so that as a rule one look at the instances is
        // enough.
        let mut taken: u32 = 0;
        for entry in entries {
            if entry.place.bank == bank {
                let bit = u32::from(entry.place.place).wrapping_sub(first);
                taken |= 1u32.checked_shl(bit).unwrap_or(0);
            }
        }
        let place = first + taken.trailing_ones();
        first += u32::BITS;
        if place < first || first > u32::from(u8::MAX) {
            let place = u8::try_from(place).unwrap_or(u8::MAX);
            return TaskPlace { bank, place };
        }
    }
}

impl<'m> TaskTable<'m> {
    pub(crate) fn new(groups: &'m mut [Group]) -> Self {
        TaskTable {
            lists: Lists::default(),
            groups,
            next_order: 0,
            look_for_runs: true,
        }
    }

    /// A mission takes over, with these lists. Answers those of the one before.
    pub(crate) fn begin(&mut self, lists: Lists<'m>) -> Lists<'m> {
        self.groups.fill(Group::FREE);
        self.look_for_runs = true;
        core::mem::replace(&mut self.lists, lists)
    }

    /// The tasks that served the mission before, whose entries are `before`, serve this one and go
    /// on as they are: pairs of task instances, here and there. Enabled are those of which
    /// `is_enabled` says so; but a run in slot 0 begins anew.
    pub(crate) fn go_on(
        &mut self,
        before: &mut [TaskEntry],
        pairs: impl Iterator<Item = (usize, usize)> + Clone,
        registry: Registry<'_>,
        is_enabled: impl Fn(usize) -> bool,
    ) {
        let place =
            |entries: &[TaskEntry], instance: usize| entries.get(instance).map(|entry| entry.place);
        let mut all = pairs.clone();
        // As a rule each has the place that it would have had anyway.
        let is_moved =
            all.any(|(task, other)| place(self.lists.tasks, task) != place(before, other));
        if is_moved {
            for entry in self.lists.tasks.iter_mut() {
                entry.place.place = NO_PLACE;
            }
        }
        for (instance, other) in pairs {
            let now = self.next_order;
            let (Some(entry), Some(old)) =
                (self.lists.tasks.get_mut(instance), before.get_mut(other))
            else {
                continue;
            };
            let was = core::mem::replace(&mut old.activity, TaskActivity::GoneOn);
            let is_new = was == TaskActivity::Off;
            entry.place = old.place;
            // Flags were taken over, too.
            entry.is_busy = true;
            entry.order = if is_new { now } else { old.order };
            entry.activity = match is_enabled(instance) {
                false => TaskActivity::Off,
                true if is_new => TaskActivity::Fresh,
                true => was,
            };
            let (activity, group, age) =
                (entry.activity, entry.group, now.wrapping_sub(entry.order));
            let group = self.groups.get(usize::from(group));
            let is_oldest =
                group.is_some_and(|group| group.holder == NONE || self.age(group.holder) < age);
            if activity != TaskActivity::Off && is_oldest {
                self.hold_group(instance as u16);
            }
        }
        for entry in self.lists.slots.iter_mut() {
            entry.set_first_enabled(first_enabled(self.lists.tasks, entry.first_task()));
        }
        let mut next = self.lists.first_in_slot_0;
        while let Some(instance) = next {
            if let Some(entry) = self.lists.tasks.get_mut(usize::from(instance))
                && entry.activity == TaskActivity::UnderWay
            {
                entry.activity = TaskActivity::Fresh;
            }
            next = self.next_in_slot(instance);
        }
        if is_moved {
            for instance in 0..self.lists.tasks.len() {
                let place = self.entry(instance as u16).place;
                if place.place == NO_PLACE && place.bank != NO_BANK {
                    let free = free_place(self.lists.tasks, place.bank);
                    if let Some(entry) = self.lists.tasks.get_mut(instance) {
                        entry.place = free;
                    }
                }
            }
            for entry in self.lists.tasks.iter_mut() {
                registry.bind_again(&mut entry.binding, entry.place);
            }
        }
    }

    fn hold_group(&mut self, instance: u16) {
        let group = self.entry(instance).group;
        if let Some(group) = self.groups.get_mut(usize::from(group)) {
            group.holder = instance;
        }
    }

    fn entry(&self, instance: u16) -> TaskEntry {
        self.lists
            .tasks
            .get(usize::from(instance))
            .copied()
            .unwrap_or(TaskEntry::EMPTY)
    }

    /// The task that serves a task instance.
    pub(crate) fn place(&self, instance: u16) -> TaskPlace {
        self.entry(instance).place
    }

    /// The next task instance of the same slot.
    pub(crate) fn next_in_slot(&self, instance: u16) -> Option<u16> {
        let entry = self.lists.tasks.get(usize::from(instance));
        let next = entry.map_or(NONE, |entry| entry.next_in_slot);
        (next != NONE).then_some(next)
    }

    /// The first enabled task instance of a slot, from this one on, or [`NONE`].
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn first_enabled(&self, first: u16) -> u16 {
        first_enabled(self.lists.tasks, first)
    }

    /// A task instance of this slot has been enabled or disabled.
    fn look_at_slot(&mut self, slot: u16) {
        if let Some(entry) = self.lists.slots.get_mut(usize::from(slot)) {
            entry.set_first_enabled(first_enabled(self.lists.tasks, entry.first_task()));
        }
    }

    /// The first task instance of slot 0.
    pub(crate) fn first_in_slot_0(&self) -> Option<u16> {
        self.lists.first_in_slot_0
    }

    /// Whether it is worth while to look for a background task that can be started.
    pub(crate) fn look_for_runs(&self) -> bool {
        self.look_for_runs
    }

    /// All background tasks were looked at: nothing changes for them until one of these tasks is
    /// enabled or disabled, or somebody [says so](Self::look_again).
    pub(crate) fn looked(&mut self) {
        self.look_for_runs = false;
    }

    /// A background task that could not be started may be able to.
    pub(crate) fn look_again(&mut self) {
        self.look_for_runs = true;
    }

    /// The task's state was entered.
    pub(crate) fn enable(&mut self, instance: u16) {
        self.look_for_runs = true;
        let order = self.next_order;
        let Some(entry) = self.lists.tasks.get_mut(usize::from(instance)) else {
            return;
        };
        let slot = entry.slot;
        let before = core::mem::replace(&mut entry.activity, TaskActivity::Fresh);
        if before != TaskActivity::Off {
            // A background run goes on under the next activation: enabled it has been all the time.
            return;
        }
        entry.order = order;
        self.next_order = order.wrapping_add(1);
        if let Some(group) = self.groups.get_mut(usize::from(entry.group))
            && group.holder == NONE
        {
            group.holder = instance;
        }
        self.look_at_slot(slot);
    }

    /// The task is enabled no more.
    pub(crate) fn disable(&mut self, instance: u16) {
        self.look_for_runs = true;
        let Some(entry) = self.lists.tasks.get_mut(usize::from(instance)) else {
            return;
        };
        entry.activity = TaskActivity::Off;
        let (group, slot) = (entry.group, entry.slot);
        self.look_at_slot(slot);
        let Some(held) = self
            .groups
            .get_mut(usize::from(group))
            .filter(|held| held.holder == instance)
        else {
            return;
        };
        let now = self.next_order;
        held.holder = self
            .lists
            .tasks
            .iter()
            .zip(0u16..)
            .filter(|(entry, _)| entry.activity != TaskActivity::Off && entry.group == group)
            .max_by_key(|(entry, _)| now.wrapping_sub(entry.order))
            .map_or(NONE, |(_, instance)| instance);
    }

    /// The run of a background task ended, and its next activation waits behind those that wait
    /// already.
    pub(crate) fn requeue(&mut self, instance: u16) {
        self.look_for_runs = true;
        if let Some(entry) = self.lists.tasks.get_mut(usize::from(instance)) {
            entry.order = self.next_order;
            self.next_order = self.next_order.wrapping_add(1);
        }
    }

    /// Whether nobody else holds the task's group.
    pub(crate) fn may_run(&self, instance: u16) -> bool {
        let group = self.entry(instance).group;
        self.groups
            .get(usize::from(group))
            .is_none_or(|group| group.holder == instance)
    }

    /// Whether the task was entered and not executed since.
    pub(crate) fn is_fresh(&self, instance: u16) -> bool {
        self.entry(instance).activity.is_fresh()
    }

    /// The run of a background task begins.
    pub(crate) fn executed(&mut self, instance: u16) {
        if let Some(entry) = self.lists.tasks.get_mut(usize::from(instance))
            && entry.activity == TaskActivity::Fresh
        {
            entry.activity = TaskActivity::UnderWay;
        }
    }

    /// The record of a task instance.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn record(&mut self, instance: u16) -> Option<&mut TaskEntry> {
        self.lists.tasks.get_mut(usize::from(instance))
    }

    /// Whether a group is held by somebody else than this task instance. [`NO_GROUP`] is none of
    /// them.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn is_held_from(groups: &[Group], group: u8, instance: u16) -> bool {
        let held = groups.get(usize::from(group));
        held.is_some_and(|group| group.holder != instance)
    }

    /// How long ago, counted in tasks that became enabled, this one did.
    pub(crate) fn age(&self, instance: u16) -> u32 {
        self.next_order.wrapping_sub(self.entry(instance).order)
    }

    /// The task ran longer than its slot.
    pub(crate) fn overrun(&mut self, instance: u16) {
        if let Some(entry) = self.lists.tasks.get_mut(usize::from(instance)) {
            entry.overruns = entry.overruns.saturating_add(1);
        }
    }

    /// How often the task ran longer than its slot.
    pub(crate) fn overruns(&self, instance: u16) -> u16 {
        self.entry(instance).overruns
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn with_group(test: impl FnOnce(&mut TaskTable<'_>)) {
        let mut entries = [TaskEntry {
            group: 0,
            ..TaskEntry::EMPTY
        }; 3];
        let mut groups = [Group::UNUSED; 1];
        let mut tasks = TaskTable::new(&mut groups);
        tasks.begin(Lists {
            tasks: &mut entries,
            ..Lists::default()
        });
        test(&mut tasks);
    }

    fn holder(tasks: &TaskTable<'_>) -> u16 {
        tasks.groups[0].holder
    }

    #[test]
    fn the_task_that_was_enabled_first_holds_its_group() {
        with_group(|tasks| {
            tasks.enable(2);
            tasks.enable(0);
            tasks.enable(1);
            assert_eq!(holder(tasks), 2);
            tasks.disable(0);
            tasks.enable(0);
            assert_eq!(holder(tasks), 2);
            tasks.disable(2);
            assert_eq!(holder(tasks), 1);
            assert!(tasks.may_run(1) && !tasks.may_run(0));
            tasks.disable(1);
            assert_eq!(holder(tasks), 0);
            tasks.disable(0);
            assert_eq!(holder(tasks), NONE);
        });
    }

    #[test]
    fn the_order_survives_the_wrap_of_its_counter() {
        with_group(|tasks| {
            tasks.next_order = u32::MAX - 1;
            for instance in [1, 0, 2] {
                tasks.enable(instance);
            }
            for expected in [1, 0, 2] {
                assert_eq!(holder(tasks), expected);
                tasks.disable(expected);
            }
        });
    }

    #[test]
    fn entering_a_running_task_anew_changes_nothing_in_its_group() {
        with_group(|tasks| {
            tasks.enable(1);
            tasks.executed(1);
            tasks.enable(0);
            tasks.enable(1);
            assert!(tasks.is_fresh(1));
            assert_eq!(holder(tasks), 1);
        });
    }

    #[test]
    fn a_task_gets_the_first_place_of_its_bank_that_is_free() {
        let mut entries = [TaskEntry::EMPTY; 80];
        let place = |entries: &[TaskEntry]| free_place(entries, 3).place;
        for taken in 0..70 {
            assert_eq!(place(&entries), taken, "behind as many as are taken");
            entries[usize::from(taken)].place = TaskPlace {
                bank: 3,
                place: taken,
            };
        }
        for gap in [0, 31, 32, 69] {
            entries[gap].place.bank = 4;
            assert_eq!(usize::from(place(&entries)), gap);
            entries[gap].place.bank = 3;
        }
        assert_eq!(free_place(&entries, NO_BANK).bank, NO_BANK);
    }
}
