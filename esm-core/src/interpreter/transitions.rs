//! Transitions: leaving a state, actions, entering another.

use core::ops::Range;

use super::events::Observer;
use super::machine::{Blob, Here, Machine, Mark};
use crate::format::{self, Section};
use crate::layout::{code, container, instance, region_instance, state, task_instance, transition};
use crate::reads::{WINDOW_BITS, access::Access};
use crate::tables::record_bytes;

/// The queue had no room for an event.
pub(super) struct QueueFull;

impl<R: Access> Machine<'_, R> {
    /// Makes a state the current one of its region instance, which is awake then if the state has
    /// transitions on the pulse. Whoever woke it before, otherwise there is nothing to do on the
    /// pulse.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn make_current(&mut self, blob: Blob<'_, R>, here: Here<R::Part>, target: usize) {
        self.set_current(here.region, target);
        let events = self.events(blob, self.record(Section::States, target));
        // The lowest bit is for the pulse.
        self.take_awake_of(here, ((events << 31) as i32 >> 31) as u32);
    }

    /// Takes a plain transition on the pulse from a real-time task to itself, with its one `send`;
    /// `first_flag` is the first flag of the state. Its region instance is awake, and stays so.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn enter_again(
        &mut self,
        blob: Blob<'_, R>,
        region: usize,
        current: R::Place,
        first_flag: usize,
        action: u16,
        observer: &mut impl Observer,
    ) -> Result<(), QueueFull> {
        let count = self.field(blob, current, state::SHAPE) as u32 % u32::BITS;
        R::clear_window(self.arena, self.places.flags, first_flag, count);
        let record = self.record(Section::RegionInstances, region);
        let instance = self.field(blob, record, region_instance::INSTANCE);
        let instance = self.record(Section::Instances, instance);
        let channel = self.field(blob, instance, instance::FIRST_CHANNEL);
        let channel = channel + usize::from(action & !format::ACTION_SEND);
        // No event of this macro step has been taken out of the queue yet.
        if self.queued == self.queue_capacity {
            return Err(QueueFull);
        }
        R::store_half(
            self.arena,
            self.places.queue,
            self.queued as usize,
            channel as u16,
        );
        self.queued += 1;
        let task = self.field(blob, instance, instance::FIRST_TASK);
        let task = (task + self.field(blob, current, state::A)) as u16;
        if self.enable(task.into()) {
            observer.disabled(task);
        }
        observer.enabled(task);
        Ok(())
    }

    /// Takes any transition: leaves a state, acts, enters another. Returns the next region instance
    /// that is not inside this one.
    #[inline(never)]
    pub(super) fn take(
        &mut self,
        blob: Blob<'_, R>,
        region: usize,
        transition: R::Place,
        observer: &mut impl Observer,
    ) -> Result<usize, QueueFull> {
        let target = self.field(blob, transition, transition::TARGET);
        let left = self.current_record(region);
        let entered = self.record(Section::States, target);
        let here = self.record(Section::RegionInstances, region);
        let next = self.field(blob, here, region_instance::NEXT);
        let instance_index = self.field(blob, here, region_instance::INSTANCE);
        let instance = self.record(Section::Instances, instance_index);
        let left_kind = self.field(blob, left, state::SHAPE) as u16 >> format::STATE_KIND_SHIFT;
        if left_kind == format::STATE_TASK {
            let first_task = self.field(blob, instance, instance::FIRST_TASK);
            let task = first_task + self.field(blob, left, state::A);
            if self.disable(task) {
                observer.disabled(task as u16);
            }
        }
        let shape = self.field(blob, entered, state::SHAPE) as u16;
        let first_flag = self.field(blob, here, region_instance::FIRST_FLAG)
            + self.field(blob, entered, state::FIRST_FLAG);
        self.reset_flags(first_flag, shape & format::STATE_FLAGS_MASK);
        let action = self.field(blob, transition, transition::ACTION) as u16;
        if action & format::ACTION_SEND != 0 {
            let channel = self.field(blob, instance, instance::FIRST_CHANNEL);
            self.send(channel + usize::from(action & !format::ACTION_SEND))?;
        } else if action != format::ACTION_NONE {
            self.act(blob, action, here, entered)?;
        }
        // Not before it is known that there is room for what is sent: otherwise the state stays,
        // and what is inside it.
        if left_kind == format::STATE_SUPER {
            let inside = instance_index + self.field(blob, left, state::A);
            self.leave_regions(blob, inside, region + 1..next, observer);
        }
        self.make_current(blob, self.here(region), target);
        if shape & format::STATE_HAS_TIMEOUT != 0 {
            self.start_timer(blob, region, entered);
        }
        match shape >> format::STATE_KIND_SHIFT {
            format::STATE_TASK | format::STATE_BACKGROUND_TASK => {
                let first_task = self.field(blob, instance, instance::FIRST_TASK);
                let task = first_task + self.field(blob, entered, state::A);
                self.enable(task);
                observer.enabled(task as u16);
            }
            format::STATE_FINAL => {
                let first_flag = self.field(blob, instance, instance::FIRST_FLAG);
                self.set_flag_to(first_flag + format::FLAG_EXIT, true);
                self.wake_instance(blob, instance_index);
            }
            format::STATE_SUPER => {
                let inside = instance_index + self.field(blob, entered, state::A);
                let inside = self.record(Section::Instances, inside);
                let first = self.field(blob, inside, instance::FIRST_REGION);
                self.start_regions(blob, first, next);
            }
            _ => {}
        }
        Ok(next)
    }

    /// Carries out a row of actions of a transition in the region instance with the record `here`
    /// to the state with the record `entered`.
    #[inline(never)]
    fn act(
        &mut self,
        blob: Blob<'_, R>,
        action: u16,
        here: R::Place,
        entered: R::Place,
    ) -> Result<(), QueueFull> {
        let first_flag = self.field(blob, here, region_instance::FIRST_FLAG);
        let own = self.field(blob, entered, state::FIRST_FLAG);
        let own_flags = self.field(blob, entered, state::SHAPE);
        let own_flags = own_flags & usize::from(format::STATE_FLAGS_MASK);
        let instance_index = self.field(blob, here, region_instance::INSTANCE);
        let mut at = self.record(Section::Code, usize::from(action - format::ACTION_ROW));
        loop {
            let operand = self.field(blob, at, code::OPERAND);
            let control = self.field(blob, at, code::CONTROL) as u16;
            let operation = control >> format::CODE_OPERATION_SHIFT;
            if operation == format::CODE_SEND {
                let instance = self.record(Section::Instances, instance_index);
                let channel = self.field(blob, instance, instance::FIRST_CHANNEL);
                self.send(channel + operand)?;
            } else {
                self.set_flag_to(first_flag + operand, operation == format::CODE_SET);
                // Own flags of the state that is entered are looked at by nobody else.
                if operand.wrapping_sub(own) >= own_flags {
                    self.wake_instance(blob, instance_index);
                }
            }
            if control & format::CODE_LOW_MASK != 0 {
                return Ok(());
            }
            at = R::ahead(at, record_bytes(Section::Code));
        }
    }

    /// Resets `count` flags from `first` on.
    #[cfg_attr(feature = "speed", inline(always))]
    fn reset_flags(&mut self, first: usize, count: u16) {
        let mut first = first;
        let mut left = u32::from(count);
        while left > WINDOW_BITS {
            R::clear_window(self.arena, self.places.flags, first, WINDOW_BITS);
            first += WINDOW_BITS as usize;
            left -= WINDOW_BITS;
        }
        R::clear_window(self.arena, self.places.flags, first, left);
    }

    /// Appends an event to the queue.
    #[cfg_attr(feature = "speed", inline(always))]
    fn send(&mut self, channel: usize) -> Result<(), QueueFull> {
        if self.queued - self.taken == self.queue_capacity {
            return Err(QueueFull);
        }
        let place = (self.queued & self.places.queue_mask) as usize;
        R::store_half(self.arena, self.places.queue, place, channel as u16);
        self.queued += 1;
        Ok(())
    }

    /// Wakes those in a container instance, at any depth, and the region instance around it.
    #[inline(never)]
    fn wake_instance(&mut self, blob: Blob<'_, R>, instance_index: usize) {
        let instance = self.record(Section::Instances, instance_index);
        let around = self.field(blob, instance, instance::AROUND);
        let end = if instance_index == 0 {
            self.layout.regions
        } else {
            self.next(blob, around)
        };
        self.mark(around..end, Mark::Awake, true);
    }

    /// Ends what is inside a superstate: a container instance, and the region instances in it at
    /// any depth.
    #[inline(never)]
    fn leave_regions(
        &mut self,
        blob: Blob<'_, R>,
        instance: usize,
        regions: Range<usize>,
        observer: &mut impl Observer,
    ) {
        let instance = self.record(Section::Instances, instance);
        let content = self.field(blob, instance, instance::CONTAINER);
        let content = self.record(Section::Containers, content);
        let first_task = self.field(blob, instance, instance::FIRST_TASK);
        let tasks = self.field(blob, content, container::TASK_SPAN);
        self.disable_real_time(blob, first_task..first_task + tasks, observer);
        self.mark(regions, Mark::Active, false);
    }

    /// Starts the region instances of a container instance, of which the first is `first`, and all
    /// are before `end`.
    #[inline(never)]
    pub(super) fn start_regions(&mut self, blob: Blob<'_, R>, first: usize, end: usize) {
        let mut at = first;
        while at < end {
            let record = self.record(Section::RegionInstances, at);
            let initial = self.field(blob, record, region_instance::INITIAL);
            self.activate(at);
            self.make_current(blob, self.here(at), initial);
            at = self.field(blob, record, region_instance::NEXT);
        }
    }

    /// Disables the enabled real-time tasks among some task instances.
    #[inline(never)]
    pub(super) fn disable_real_time(
        &mut self,
        blob: Blob<'_, R>,
        tasks: Range<usize>,
        observer: &mut impl Observer,
    ) {
        for task in tasks {
            let record = self.record(Section::TaskInstances, task);
            let state = self.field(blob, record, task_instance::STATE);
            let state = self.record(Section::States, state);
            let shape = self.field(blob, state, state::SHAPE) as u16;
            let is_real_time = shape >> format::STATE_KIND_SHIFT == format::STATE_TASK;
            if is_real_time && self.disable(task) {
                observer.disabled(task as u16);
            }
        }
    }
}
