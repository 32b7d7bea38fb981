//! The execution of tasks: a slot's enabled ones, one after another, and one of slot 0 at a time.
//! Each execution reads its task instance's record, and nothing else that a mission says.
//!
//! *Invariant:* what was [prepared](Execution::prepare_first) is executed next, or forgotten.

pub(super) mod background_runs;
#[cfg(feature = "links")]
pub(super) mod links;

#[cfg(feature = "links")]
use esm_core::tables::Tables;
use esm_core::{Observer, StateMapping, TransitionTaken};
use heapless::spsc::{Consumer, Producer};

use super::events::Event;
use super::machine::{Machine, Mission};
use super::observers::Observers;
use super::slots::SlotEntry;
use super::tasks::{self, Lists, NONE, TaskActivity, TaskEntry, TaskTable};
use crate::board::{Board, ticks_between};
use crate::features::NOTES;
#[cfg(feature = "links")]
use crate::frames::{FrameLists, NO_DISPATCHER};
use crate::list_command::CommandBox;
use crate::notes::MAX_NOTES;
use crate::ports::{BackgroundRun, Executor, Registry};
use crate::task::Step;
use crate::task_word::TaskWord;
#[cfg(feature = "links")]
use esm_link::message::FrameCounters;
use esm_link::message::SafeReason;

/// Where a background run is put to be passed around.
pub(crate) type RunPlace<'m> = &'m mut Option<BackgroundRun<'m>>;

/// The tasks, what is kept for those of the mission, and what they have said.
pub(crate) struct Execution<'q, 'm> {
    executor: Executor<'m>,
    tasks: TaskTable<'m>,
    /// The place of a background run, while none is under way.
    background_run: Option<RunPlace<'m>>,
    to_background: Producer<'q, RunPlace<'m>>,
    from_background: Consumer<'q, RunPlace<'m>>,
    /// The task instance of the background run that is under way, if it belongs to this mission.
    running: Option<u16>,
    /// Where it is written down which task is executed.
    task_word: &'m TaskWord,
    /// The task instance that has said how many overruns in a row are allowed while it is enabled,
    /// and how many.
    supervisor: Option<(u16, u16)>,
    /// What a task has found wrong.
    failure: Option<SafeReason>,
    /// The first task instance of the next activation, which was prepared; where one was.
    first: u16,
    /// Duration of the slot whose activation has begun, in microseconds.
    duration_us: u32,
    /// Tasks were executed, after which a background run may begin or the robot may have to stop.
    has_executed: bool,
    /// What was prepared is a dispatcher of a link, and not a task of the registry.
    #[cfg(feature = "links")]
    dispatcher_is_prepared: bool,
}

/// What executions have to do with: the mission that they belong to, and who is told of them.
pub(super) struct Around<'a, 'q, 'm> {
    pub(super) machine: &'a mut Machine<'q, 'm>,
    pub(super) observers: &'a mut Observers<'m>,
}

impl<'q, 'm> Execution<'q, 'm> {
    pub(crate) fn new(
        executor: Executor<'m>,
        tasks: TaskTable<'m>,
        background_run: RunPlace<'m>,
        to_background: Producer<'q, RunPlace<'m>>,
        from_background: Consumer<'q, RunPlace<'m>>,
        task_word: &'m TaskWord,
    ) -> Self {
        Execution {
            executor,
            tasks,
            background_run: Some(background_run),
            to_background,
            from_background,
            task_word,
            running: None,
            supervisor: None,
            failure: None,
            first: NONE,
            duration_us: 0,
            has_executed: false,
            #[cfg(feature = "links")]
            dispatcher_is_prepared: false,
        }
    }

    /// The declarations of the tasks.
    pub(super) fn registry(&self) -> Registry<'m> {
        self.executor.registry()
    }

    /// The executor, whose nets have the values that are told.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn executor(&self) -> &Executor<'m> {
        &self.executor
    }

    /// What is kept for a slot.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn slot(&self, slot: usize) -> Option<&SlotEntry> {
        self.tasks.lists.slots.get(slot)
    }

    /// Duration of a slot in microseconds.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn duration_us(&self, slot: usize) -> u32 {
        self.slot(slot).map_or(0, SlotEntry::duration_us)
    }

    /// How often a task ran longer than its slot.
    pub(super) fn overruns(&self, instance: u16) -> u16 {
        self.tasks.overruns(instance)
    }

    /// What was counted of a frame of a mission with these tables.
    #[cfg(feature = "links")]
    pub(super) fn frame_counters(
        &self,
        tables: &Tables<'_>,
        frame: usize,
    ) -> Option<FrameCounters> {
        self.tasks.lists.frames.counters(tables, frame)
    }

    /// What the values of a task's data port are made of, if the task says so.
    pub(super) fn fields(&self, instance: u16, port: usize) -> Option<&'static str> {
        #[cfg(feature = "links")]
        if let Some(kind) = links::kind(self, instance, port) {
            return Executor::fields_of(kind);
        }
        let bank = self.tasks.place(instance).bank;
        self.executor.fields(bank, port)
    }

    /// Counts an execution of a slot's tasks. False if it is not a usual one, and was not counted.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn count(&mut self, slot: usize, delay_ticks: u32, took_ticks: u32) -> bool {
        match self.tasks.lists.slots.get_mut(slot) {
            Some(slot) => slot.count(delay_ticks, took_ticks),
            None => true,
        }
    }

    /// Counts one that is not usual. Answers the overruns in a row, if it is one.
    pub(super) fn count_unusual<B: Board>(
        &mut self,
        slot: usize,
        delay_ticks: u32,
        took_ticks: u32,
    ) -> Option<u16> {
        let entry = self.tasks.lists.slots.get_mut(slot)?;
        let duration_ticks = entry.duration_us().saturating_mul(B::TICKS_PER_US);
        let is_overrun = entry.count_unusual(delay_ticks, took_ticks, duration_ticks);
        is_overrun.then(|| entry.overruns_in_a_row())
    }

    /// The first of so many slots that was not executed since this was asked last.
    pub(super) fn first_silent_slot(&mut self, count: usize) -> Option<usize> {
        let mut silent = None;
        let slots = self.tasks.lists.slots.iter_mut();
        for (index, slot) in slots.enumerate().take(count) {
            if !slot.take_executed() {
                silent.get_or_insert(index);
            }
        }
        silent
    }

    /// Lets tasks know how many overruns there were.
    pub(super) fn tell_overruns(&mut self, overruns: u32) {
        self.executor.inputs().overruns = overruns;
    }

    /// Lets tasks know how many activations were missed.
    pub(super) fn tell_missed(&mut self, missed: u32) {
        self.executor.inputs().missed = missed;
    }

    /// Lets tasks know for how long the host has shown nothing.
    pub(super) fn tell_link_silent(&mut self, silent_us: u32) {
        self.executor.inputs().link_silent_us = silent_us;
    }

    /// What the list of behaviours is to do.
    pub(super) fn behaviours(&mut self) -> &mut CommandBox {
        self.executor.behaviours()
    }

    /// How many overruns in a row of one slot a task allows that is enabled.
    pub(super) fn allowed_overruns_in_a_row(&self, machine: &Machine<'_, '_>) -> Option<u16> {
        let (instance, allowed) = self.supervisor?;
        let is_enabled = machine.mission()?.is_enabled(usize::from(instance));
        is_enabled.then_some(allowed)
    }

    /// Takes what a task has found wrong.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn take_failure(&mut self) -> Option<SafeReason> {
        self.failure.take()
    }

    /// What tasks have said counts no more, since another mission starts.
    pub(super) fn forget_said(&mut self) {
        self.running = None;
        self.supervisor = None;
        self.failure = None;
        self.executor.inputs().link_silent_us = 0;
        self.executor.behaviours().forget();
    }

    /// A mission takes over, with these lists. Answers those of the one before.
    pub(super) fn begin_mission(&mut self, lists: Lists<'m>) -> Lists<'m> {
        self.tasks.begin(lists)
    }

    /// The links of the mission begin. Those that it has as the mission `before` go on, where it
    /// follows one warm at `robot_us`; its slots count from `origin_us` on.
    #[cfg(feature = "links")]
    pub(super) fn begin_links(
        &mut self,
        before: Option<&FrameLists<'_>>,
        origin_us: u64,
        robot_us: u64,
    ) {
        self.tasks.lists.frames.begin(before, origin_us, robot_us);
    }

    /// Values and tasks of a mission begin, where those of the one before are left: from here to
    /// [`end_migration`](Self::end_migration) they can be [taken over](Self::take_over).
    pub(super) fn begin_migration(&mut self) {
        self.executor.begin_migration();
    }

    /// Takes over the tasks, whose entries were `before`, and the values on nets that two missions
    /// have in common.
    pub(super) fn take_over(
        &mut self,
        before: &mut [TaskEntry],
        common: &StateMapping<'_>,
        mission: &Mission<'m>,
    ) {
        let registry = self.executor.registry();
        self.tasks.go_on(before, common.tasks(), registry, |task| {
            mission.is_enabled(task)
        });
        for (net, other) in common.nets() {
            self.executor.migrate_net(net, other);
        }
    }

    /// The tasks of the mission before, with these entries, forget what they knew, but for those
    /// that were taken over.
    pub(super) fn end_migration(&mut self, before: &[TaskEntry]) {
        self.executor.end_migration(tasks::left_behind(before));
    }

    /// Begins an activation of a slot at these times of the mission's tasks and the robot.
    pub(super) fn begin(&mut self, slot: usize, t_us: u64, robot_us: u64) {
        self.duration_us = self.duration_us(slot);
        self.executor.begin(t_us, robot_us);
    }

    /// Activations that are looked up are counted from these times of the mission's tasks and the
    /// robot.
    pub(super) fn set_base(&mut self, (t_us, robot_us): (u64, u64)) {
        self.executor.begin(t_us, robot_us);
    }

    /// Begins an activation of a slot so long after the [base](Self::set_base).
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn begin_near(&mut self, slot: usize, since_us: u32) {
        self.duration_us = self.duration_us(slot);
        self.executor.begin_near(since_us);
    }

    /// Forgets what was prepared, and that something was executed.
    pub(super) fn forget(&mut self) {
        self.executor.forget();
        self.has_executed = false;
        #[cfg(feature = "links")]
        {
            self.dispatcher_is_prepared = false;
        }
    }

    /// Gives the first task of an activation that [began](Self::begin) what its execution needs.
    /// False if it cannot be executed.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn prepare_first(&mut self, instance: u16, machine: &Machine<'_, 'm>) -> bool {
        self.first = instance;
        self.prepare_task(instance, machine);
        self.is_prepared()
    }

    #[cfg_attr(feature = "speed", inline(always))]
    fn is_prepared(&self) -> bool {
        #[cfg(feature = "links")]
        if self.dispatcher_is_prepared {
            return true;
        }
        self.executor.is_prepared()
    }

    /// Executes the first task of a slot, if it was [prepared](Self::prepare_first).
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn execute_first<B: Board>(
        &mut self,
        board: &mut B,
        machine: &mut Machine<'_, 'm>,
    ) -> Option<Step> {
        self.run_task(board, machine, self.first)
    }

    /// Takes over what the first task of a slot did, and executes those that follow it, in an
    /// activation that began at `began_count`.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn execute_others<B: Board>(
        &mut self,
        first: Option<Step>,
        board: &mut B,
        around: Around<'_, '_, 'm>,
        began_count: u32,
    ) {
        let Around { machine, observers } = around;
        let mut began_count = began_count;
        let (mut instance, mut step) = (self.first, first);
        loop {
            let now_count = board.count();
            let took_ticks = ticks_between::<B>(began_count, now_count);
            began_count = now_count;
            let next = self.end_task(instance, step, machine, observers);
            let duration_ticks = self.duration_us.saturating_mul(B::TICKS_PER_US);
            if took_ticks > duration_ticks && step.is_some() {
                self.note_overrun::<B>(instance, took_ticks, observers);
            }
            // As a rule there is one.
            if next == NONE {
                break;
            }
            instance = self.tasks.first_enabled(next);
            if instance == NONE {
                break;
            }
            self.prepare_task(instance, machine);
            step = self.run_task(board, machine, instance);
        }
    }

    /// Whether a background run may begin, or the robot has to stop, after tasks of an activation
    /// that was looked up. Keeps that until somebody [looks](Self::take_executed).
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn is_more_to_do(&mut self) -> bool {
        let is = self.tasks.look_for_runs() || self.failure.is_some();
        if is {
            self.has_executed = true;
        }
        is
    }

    /// Whether tasks were executed since this was asked last, after which more is to be done.
    pub(super) fn take_executed(&mut self) -> bool {
        core::mem::take(&mut self.has_executed)
    }

    /// Executes the task that was prepared, if one was, and keeps which one that is for whoever
    /// ends the firmware meanwhile.
    #[cfg_attr(feature = "speed", inline(always))]
    #[cfg_attr(not(feature = "links"), expect(unused_variables, reason = "for links"))]
    fn run_task<B: Board>(
        &mut self,
        board: &mut B,
        machine: &mut Machine<'_, 'm>,
        instance: u16,
    ) -> Option<Step> {
        #[cfg(feature = "links")]
        if core::mem::take(&mut self.dispatcher_is_prepared) {
            links::run(self, board, machine, instance);
            return Some(Step::Run);
        }
        let step = self.executor.run(|| self.task_word.begin(instance))?;
        self.task_word.end();
        Some(step)
    }

    /// Gives an enabled task what its next execution needs. Nothing is prepared if it cannot be
    /// executed: it is busy then.
    #[inline(never)]
    fn prepare_task(&mut self, instance: u16, machine: &Machine<'_, 'm>) {
        let Some(mission) = machine.mission() else {
            return;
        };
        let Some(record) = self.tasks.lists.tasks.get_mut(usize::from(instance)) else {
            return;
        };
        #[cfg(feature = "links")]
        {
            self.dispatcher_is_prepared = record.dispatcher != NO_DISPATCHER;
            if self.dispatcher_is_prepared {
                self.executor.forget();
                return;
            }
        }
        if TaskTable::is_held_from(self.tasks.groups, record.group, instance) {
            self.executor.forget();
            return;
        }
        let inputs = self.executor.inputs();
        inputs.period_us = record.period_us;
        if record.binding.places.control_flags != 0 {
            inputs.flags = mission.control_flags(&record.binding.places);
        }
        if record.params != 0 {
            machine.find_params(
                mission,
                &record.binding.places,
                record.params.into(),
                inputs,
            );
        }
        let enter = record.activity.is_fresh();
        self.executor.prepare(&mut record.binding, enter);
    }

    /// Takes over what a task did, and returns the task instance that follows in its slot. It was
    /// not executed if it is busy.
    #[cfg_attr(feature = "speed", inline(always))]
    fn end_task(
        &mut self,
        instance: u16,
        step: Option<Step>,
        machine: &mut Machine<'_, 'm>,
        observers: &mut Observers<'m>,
    ) -> u16 {
        let (Some(record), Some(mission)) = (
            self.tasks.lists.tasks.get_mut(usize::from(instance)),
            machine.mission_mut(),
        ) else {
            return NONE;
        };
        let next = record.next_in_slot;
        let Some(step) = step else {
            show_busy(mission, record, true);
            return next;
        };
        if record.is_busy {
            show_busy(mission, record, false);
        }
        record.activity = TaskActivity::UnderWay;
        #[cfg(feature = "links")]
        if record.dispatcher != NO_DISPATCHER {
            return next;
        }
        let (flags, has_told) = self.executor.end_step(&record.binding);
        if flags.written != 0 {
            mission.apply_flags(&record.binding.places, flags);
        }
        if has_told {
            self.take_in(instance, observers);
        }
        if step == Step::Finished {
            mission.report_exit(usize::from(instance));
            self.finish_task(instance, observers);
        }
        next
    }

    /// Takes in what a task said beside its flags.
    #[inline(never)]
    fn take_in(&mut self, instance: u16, observers: &mut Observers<'m>) {
        let (allowed, failure) = self.executor.told();
        if let Some(allowed) = allowed {
            self.supervisor = Some((instance, u16::try_from(allowed).unwrap_or(u16::MAX)));
        }
        self.failure = self.failure.or(failure);
        if NOTES && !self.executor.notes().is_empty() {
            self.tell_notes(observers);
        }
    }

    /// Tells what a task has noted: as much as there is room for in one execution.
    #[cold]
    fn tell_notes(&mut self, observers: &mut Observers<'m>) {
        let robot_us = self.executor.robot_us();
        for index in 0..MAX_NOTES {
            let Some(event) = self.executor.notes().get(index) else {
                break;
            };
            observers.tell(robot_us, Event::Noted(event));
        }
        self.executor.notes().clear();
    }

    /// A task has done its work.
    #[inline(never)]
    fn finish_task(&mut self, instance: u16, observers: &mut Observers<'m>) {
        self.tasks.disable(instance);
        observers.tell_next_step_in_full();
    }

    /// A task took longer than its slot.
    #[cold]
    #[inline(never)]
    fn note_overrun<B: Board>(
        &mut self,
        instance: u16,
        took_ticks: u32,
        observers: &mut Observers<'m>,
    ) {
        self.tasks.overrun(instance);
        let event = Event::Overrun {
            task_instance: instance,
            took_us: took_ticks / B::TICKS_PER_US.max(1),
        };
        observers.tell(
            self.executor.robot_us() + u64::from(self.duration_us),
            event,
        );
    }
}

/// Sets or resets a task's busy flag.
#[inline(never)]
fn show_busy(mission: &mut Mission<'_>, record: &mut TaskEntry, is_busy: bool) {
    record.is_busy = is_busy;
    mission.set_busy_at(&record.binding.places, is_busy);
}

/// Watches a macro step: keeps the task table up to date and tells of transitions.
pub(super) struct StepObserver<'o, 'q, 'm> {
    pub(super) execution: &'o mut Execution<'q, 'm>,
    pub(super) observers: &'o mut Observers<'m>,
    /// Robot time of the macro step.
    pub(super) robot_us: u64,
}

impl Observer for StepObserver<'_, '_, '_> {
    fn transition(&mut self, taken: TransitionTaken) {
        self.observers.tell(self.robot_us, Event::Transition(taken));
    }

    fn enabled(&mut self, task_instance: u16) {
        self.execution.tasks.enable(task_instance);
        #[cfg(feature = "links")]
        links::enter(self.execution, task_instance, self.robot_us);
    }

    fn disabled(&mut self, task_instance: u16) {
        self.execution.tasks.disable(task_instance);
        #[cfg(feature = "links")]
        links::leave(self.execution, task_instance, self.robot_us);
    }
}
