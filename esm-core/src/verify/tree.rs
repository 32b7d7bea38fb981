//! The instance tree, and the templates that it is made of.

use core::ops::Range;

use super::finding::{Entry, Finding};
use super::pass::Pass;
use super::transitions::Source;
use crate::format::{self, Section};
use crate::layout::{
    Container, Instance, Mission, Region, RegionInstance, State, Task, TaskInstance, TaskState,
    Timer,
};
use crate::refusal::Cause;

/// An instance that is walked over.
struct Walk<'t> {
    /// Events of the mission.
    events: usize,
    instance: Entry<'t, Instance>,
    container: Entry<'t, Container>,
    /// Whether it is the first instance of its container, in which the template is checked, too.
    is_model: bool,
    /// Where its next part begins.
    next: Places,
}

/// A flag, a task instance, a region instance and a container instance of the machine.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Places {
    flag: usize,
    task: usize,
    region: usize,
    instance: usize,
}

impl Places {
    /// What stands behind an instance of a container, and all that is inside it.
    fn behind(instance: &Entry<'_, Instance>, container: &Container) -> Self {
        Self {
            flag: instance.first_flag.get() + container.flag_span.get(),
            task: instance.first_task.get() + container.task_span.get(),
            region: instance.first_region.get() + container.region_span.get(),
            instance: instance.index + container.instance_span.get(),
        }
    }
}

/// A region of an instance.
struct RegionOf {
    /// Its states.
    states: Range<usize>,
    /// Number of the region instance.
    instance: usize,
}

/// What a state must say of its content.
struct Content {
    /// Its part *a*.
    a: usize,
    /// Its flags. None if it cannot be right.
    flags: Option<usize>,
}

impl Content {
    const WRONG: Self = Self { a: 0, flags: None };
}

impl<'a> Pass<'a> {
    /// Checks all instances, and all templates in their first instances.
    pub(super) fn check_instances(&mut self, mission: &Mission) -> Result<(), Finding> {
        for index in self.numbers(Section::Instances) {
            let instance = self.entry::<Instance>(index, Cause::Order)?;
            self.check_instance(instance, mission.events.get())?;
        }
        Ok(())
    }

    /// Checks an instance, and the records of what it is made of.
    fn check_instance(
        &mut self,
        instance: Entry<'a, Instance>,
        events: usize,
    ) -> Result<(), Finding> {
        // Its channels stand behind those of the instance before, and no container is passed over.
        let number = instance.container.get();
        let in_order = instance.first_channel.get() == self.checked[Section::Channels]
            && number <= self.checked[Section::Containers];
        instance.ensure(in_order, Cause::Order)?;
        let behind = if instance.index == 0 {
            // The machine begins everywhere, and nothing comes behind it.
            let starts = [
                instance.first_region,
                instance.first_flag,
                instance.first_task,
                instance.around,
            ];
            let begins = starts.iter().all(|start| start.get() == 0);
            instance.ensure(begins, Cause::Template)?;
            self.tables.count(Section::RegionInstances)
        } else {
            // Behind its last region comes what comes behind the region around.
            let around = self.tables.record::<RegionInstance>(instance.around.get());
            around.map_or(format::NONE.into(), |around| around.next.get())
        };

        let container = self.entry::<Container>(number, Cause::Order)?;
        let is_model = number == self.checked[Section::Containers];
        if is_model {
            let in_order = container.first_region.get() == self.checked[Section::Regions]
                && container.first_instance.get() == instance.index;
            container.ensure(in_order, Cause::Order)?;
            self.checked[Section::Containers] += 1;
        }
        self.checked[Section::Channels] += container.channels.get();

        // Its states come behind the flags at its head.
        let mut walk = Walk {
            events,
            is_model,
            next: Places {
                flag: instance.first_flag.get() + head(&container),
                task: instance.first_task.get(),
                region: instance.first_region.get(),
                instance: instance.index + 1,
            },
            instance,
            container,
        };
        let mut region = walk.container.first_region.get();
        while !self.check_region(&mut walk, region, behind)? {
            region += 1;
        }
        let is_sum = walk.next == Places::behind(&walk.instance, &walk.container);
        walk.container.ensure(is_sum, Cause::Template)
    }

    /// Checks a region of an instance, its record, and its states. Returns whether it is the last.
    fn check_region(
        &mut self,
        walk: &mut Walk<'a>,
        index: usize,
        behind: usize,
    ) -> Result<bool, Finding> {
        let region = self.entry::<Region>(index, Cause::Order)?;
        let next = self.tables.record::<Region>(index + 1);
        let number = walk.instance.container.get();
        let first_state = region.first_state.get();
        let end_state = next.and_then(|next| next.first_state.index());
        let of = RegionOf {
            states: first_state..end_state.unwrap_or(self.tables.count(Section::States)),
            instance: walk.next.region,
        };
        walk.next.region += 1;
        if walk.is_model {
            // Two states at least, behind those of the region before.
            self.checked[Section::Regions] += 1;
            let in_order = first_state == self.checked[Section::States]
                && region.container.get() == number
                && first_state + 1 < of.states.end;
            region.ensure(in_order, Cause::Order)?;
        }
        for state in of.states.clone() {
            self.check_state(walk, &of, state)?;
        }

        // Its record is what the template makes of it.
        let is_last = next.is_none_or(|next| next.container.get() != number);
        let right_next = match is_last {
            true => behind,
            false => walk.next.region,
        };
        let record = self.entry::<RegionInstance>(of.instance, Cause::Template)?;
        let is_right = record.next.get() == right_next
            && record.first_flag == walk.instance.first_flag
            && record.initial == region.first_state
            && record.instance.get() == walk.instance.index;
        record.ensure(is_right, Cause::Template)?;
        Ok(is_last)
    }

    /// Checks a state of an instance.
    fn check_state(
        &mut self,
        walk: &mut Walk<'a>,
        region: &RegionOf,
        index: usize,
    ) -> Result<(), Finding> {
        let state = self.entry::<State>(index, Cause::Kind)?;
        // Templates that are used often could make the walk much longer than the blob.
        self.state_instances += 1;
        let is_short = self.state_instances <= format::MAX_STATE_INSTANCES;
        state.ensure(is_short, Cause::Range)?;
        let first_flag = walk.next.flag - walk.instance.first_flag.get();
        let content = match state.kind() {
            format::STATE_SIMPLE => {
                walk.next.flag += state.flags();
                // A flag, its timeout, or nothing at all.
                let has_flag = state.has_timeout() || state.flags() != 0;
                let flags = Some(usize::from(has_flag));
                Content { a: 0, flags }
            }
            format::STATE_TASK | format::STATE_BACKGROUND_TASK => {
                self.check_task(walk, region, &state)?
            }
            format::STATE_SUPER => self.check_inside(walk, region)?,
            _ => Content::WRONG,
        };
        match walk.is_model {
            true => self.check_template(walk, region, &state, first_flag, content),
            false => Ok(()),
        }
    }

    /// Checks the record of a task instance and, in the first instance of a container, the template
    /// of that.
    fn check_task(
        &mut self,
        walk: &mut Walk<'a>,
        region: &RegionOf,
        state: &Entry<'a, State>,
    ) -> Result<Content, Finding> {
        let index = walk.next.task;
        let record = self.entry::<TaskInstance>(index, Cause::Template)?;
        let number = record.task_state.get();
        let is_right = record.state.get() == state.index
            && record.region.get() == region.instance
            && record.first_flag.get() == walk.next.flag
            && (!walk.is_model || number == self.checked[Section::TaskStates]);
        record.ensure(is_right, Cause::Template)?;
        walk.next.task += 1;
        walk.next.flag += state.flags();

        // No other task state has this state: each one's is tested here once, in its turn.
        let task_state = self.entry::<TaskState>(number, Cause::Template)?;
        task_state.ensure(task_state.state.get() == state.index, Cause::Template)?;
        if !walk.is_model {
            return Ok(Content::WRONG);
        }
        self.checked[Section::TaskStates] += 1;
        // Its slot exists; in slot 0 there is none.
        let has_slot = match task_state.slot.index() {
            Some(slot) => {
                state.kind() == format::STATE_TASK && slot < self.tables.count(Section::Slots)
            }
            None => state.kind() == format::STATE_BACKGROUND_TASK,
        };
        task_state.ensure(has_slot, Cause::Index)?;
        let in_order = task_state.first_param.get() == self.checked[Section::Params];
        task_state.ensure(in_order, Cause::Order)?;
        let task = self.tables.record::<Task>(task_state.task.get());
        self.checked[Section::Params] += task.map_or(0, |task| task.params.get());
        Ok(Content {
            a: index - walk.instance.first_task.get(),
            flags: task.map(|task| format::TASK_CONTROL_FLAGS + task.flags.get()),
        })
    }

    /// Checks the record of the instance inside a superstate.
    fn check_inside(&mut self, walk: &mut Walk<'a>, region: &RegionOf) -> Result<Content, Finding> {
        let a = walk.next.instance - walk.instance.index;
        let record = self.entry::<Instance>(walk.next.instance, Cause::Template)?;
        // What the first instance of the container around makes of this state holds for all.
        let model = walk.container.first_instance.get() + a;
        let model = self.tables.record::<Instance>(model);
        let is_right = model.is_some_and(|model| model.container == record.container)
            && record.first_region.get() == walk.next.region
            && record.first_flag.get() == walk.next.flag
            && record.first_task.get() == walk.next.task
            && record.around.get() == region.instance;
        record.ensure(is_right, Cause::Template)?;
        // It takes what its container does.
        let Some(container) = self.tables.record::<Container>(record.container.get()) else {
            return Ok(Content::WRONG);
        };
        walk.next = Places::behind(&record, container);
        Ok(Content {
            a,
            flags: Some(head(container)),
        })
    }

    /// Checks a state of a template, with its timer and its transitions.
    fn check_template(
        &mut self,
        walk: &Walk<'a>,
        region: &RegionOf,
        state: &Entry<'a, State>,
        first_flag: usize,
        content: Content,
    ) -> Result<(), Finding> {
        let end = self.tables.record::<State>(state.index + 1);
        let end = end.and_then(|next| next.first_transition.index());
        let end = end.unwrap_or(self.tables.count(Section::Transitions));
        // The first of its region is `initial` and the last is `final`, without anything; between
        // them are others.
        let empty = |kind: u16| state.shape.get() == kind << format::STATE_KIND_SHIFT;
        let is_right = if state.index == region.states.start {
            empty(format::STATE_INITIAL)
        } else if state.index + 1 == region.states.end {
            state.ensure(end == self.checked[Section::Transitions], Cause::Index)?;
            empty(format::STATE_FINAL)
        } else {
            content.flags == Some(state.flags())
        };
        state.ensure(is_right, Cause::Kind)?;
        // Its parts begin where those of the state before end.
        let in_order = state.first_transition.get() == self.checked[Section::Transitions]
            && state.first_flag.get() == first_flag
            && state.a.get() == content.a;
        state.ensure(in_order, Cause::Order)?;
        self.checked[Section::States] += 1;

        let timer = self.checked[Section::Timers];
        if state.has_timeout() {
            let record = self.next::<Timer>(Cause::Range)?;
            let is_in_range = record.timeout_us.get() <= format::MAX_TIME_US;
            record.ensure(is_in_range, Cause::Range)?;
        }
        let source = Source {
            state,
            events: walk.events,
            region: region.states.clone(),
            head: head(&walk.container),
            channels: walk.container.channels.get(),
        };
        let summary = self.check_transitions(&source, end)?;
        let b = match summary.row {
            _ if state.has_timeout() => timer,
            1 => 0,
            row => row,
        };
        let is_right = state.events.get() == summary.events
            && state.first_event_transition.get()
                == state.first_transition.get() + summary.on_pulse
            && state.b.get() == b;
        state.ensure(is_right, Cause::Order)
    }
}

/// Flags at the head of the block of a container's instances.
fn head(container: &Container) -> usize {
    format::CONTAINER_CONTROL_FLAGS + container.flags.get()
}
