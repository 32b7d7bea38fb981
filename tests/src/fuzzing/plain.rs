//! What a verified blob means, by its tables alone: every region that is active is looked at for
//! every event, every guard is worked out, and nothing is skipped.
//!
//! It is slow, and shares with the interpreter the decoder of records and nothing else. So it is
//! held against it on tables that no source makes, and on times that no scenario asks for; whether
//! tables say what their source means is for [`reference`](mod@crate::reference) to tell.

use std::collections::VecDeque;

use esm_core::format::{FLAG_BUSY, FLAG_EXIT, FLAG_TIMEOUT, PULSE, WINDOW_FLAGS};
use esm_core::tables::{Code, Guard, State, StateKind, Tables};
use esm_core::{Fault, MAX_MICRO_STEPS, MAX_STEPS, StepSummary, TransitionTaken};

/// A machine that runs.
#[derive(Clone, Debug)]
pub struct Plain<'a> {
    tables: Tables<'a>,
    /// By region instance.
    current: Vec<usize>,
    entered_us: Vec<u128>,
    /// All flags.
    pub flags: Vec<bool>,
    /// By task instance.
    pub enabled: Vec<bool>,
    queue: VecDeque<usize>,
    period_us: u32,
    step: u64,
    micro: u8,
    fault: Option<Fault>,
    /// The transitions of the last macro step.
    pub taken: Vec<TransitionTaken>,
}

impl<'a> Plain<'a> {
    /// A machine before its first macro step.
    pub fn new(tables: Tables<'a>) -> Self {
        let regions = 0..tables.region_instance_count();
        let slot = tables.slot(tables.interpreter_slot()).expect("a slot");
        Plain {
            tables,
            current: regions
                .clone()
                .map(|index| tables.region_instance(index).expect("it exists").initial)
                .collect(),
            entered_us: vec![0; regions.len()],
            flags: vec![false; tables.flag_count()],
            enabled: vec![false; tables.task_instance_count()],
            queue: VecDeque::new(),
            period_us: slot.period_us,
            step: 0,
            micro: 0,
            fault: None,
            taken: Vec::new(),
        }
    }

    /// The current state of a region instance; none where a superstate around it is not current.
    pub fn current(&self, region: usize) -> Option<usize> {
        let mut at = region;
        loop {
            let instance = self.tables.region_instance(at)?.instance;
            let Some((around, superstate)) = self.tables.superstate_of(instance) else {
                return Some(self.current[region]);
            };
            if self.current[around] != superstate {
                return None;
            }
            at = around;
        }
    }

    /// Lets macro steps pass, as many as there can be.
    pub fn skip(&mut self, missed: u32) {
        self.step = (self.step + u64::from(missed)).min(self.step.max(MAX_STEPS));
    }

    /// When the macro step is that comes next or goes on: no number of steps is too large for it.
    fn t_us(&self) -> u128 {
        u128::from(self.step) * u128::from(self.period_us)
    }

    /// Changes a flag of a task, if it has it: exit, timeout, busy, then the control flags.
    pub fn write(&mut self, task: usize, flag: usize, value: bool) {
        if let Some((first, length)) = self.tables.flags_of_task(task)
            && flag < length
        {
            self.flags[first + flag] = value;
        }
    }

    /// Disables a task, if there is one.
    pub fn disable(&mut self, task: usize) {
        if let Some(enabled) = self.enabled.get_mut(task) {
            *enabled = false;
        }
    }

    /// Runs one macro step.
    ///
    /// # Errors
    /// The fault that stopped the machine.
    pub fn macro_step(&mut self) -> Result<StepSummary, Fault> {
        self.taken.clear();
        if let Some(fault) = self.fault {
            return Err(fault);
        }
        self.micro = 0;
        if let Err(fault) = self.handle_all() {
            self.fault = Some(fault);
            self.disable_real_time(0..self.enabled.len());
            return Err(fault);
        }
        let summary = StepSummary {
            step: self.step,
            period_us: self.period_us,
            micro_steps: self.micro + 1,
            changed: !self.taken.is_empty(),
            finished: self.flags[FLAG_EXIT],
        };
        self.step += 1;
        Ok(summary)
    }

    fn handle_all(&mut self) -> Result<(), Fault> {
        self.run_timers();
        self.handle(None)?;
        while let Some(channel) = self.queue.pop_front() {
            if self.micro == MAX_MICRO_STEPS - 1 {
                return Err(Fault::MacroStepLimit);
            }
            self.micro += 1;
            self.handle(Some(channel))?;
        }
        Ok(())
    }

    /// Shows the pulse, or what was sent on a channel, to all that is active.
    fn handle(&mut self, channel: Option<usize>) -> Result<(), Fault> {
        let tables = self.tables;
        let channel = channel.map(|channel| tables.channel(channel).expect("it exists"));
        let mut at = 0;
        while let Some(region) = tables.region_instance(at) {
            let source = self.current[at];
            let state = tables.state(source).expect("it exists");
            let event = channel.map_or(PULSE, |channel| channel.event);
            let hears = channel.is_none_or(|channel| tables.is_listening(&channel, at));
            let on_event = |transition: usize| {
                let found = tables.transition(transition);
                hears && found.is_some_and(|found| found.event == event)
            };
            let taken = tables.transitions_of(source).find(|&transition| {
                on_event(transition) && self.holds(at, source, &state, transition)
            });
            at = match (taken, tables.first_region_inside(at, source)) {
                (Some(transition), _) => {
                    self.take(at, &state, transition)?;
                    region.next
                }
                (None, Some(inside)) => inside,
                (None, None) => region.next,
            };
        }
        Ok(())
    }

    fn first_flag(&self, region: usize, state: &State) -> usize {
        let region = self.tables.region_instance(region).expect("it exists");
        region.first_flag + state.first_flag
    }

    /// Runs the timers of all that is active. The language runs each when its region instance is
    /// looked at; who is left before takes its flag with it, so that nobody can tell.
    fn run_timers(&mut self) {
        let tables = self.tables;
        let mut at = 0;
        while let Some(region) = tables.region_instance(at) {
            let state = tables.state(self.current[at]).expect("it exists");
            self.run_timer(at, &state);
            let inside = tables.first_region_inside(at, self.current[at]);
            at = inside.unwrap_or(region.next);
        }
    }

    fn run_timer(&mut self, region: usize, state: &State) {
        let is_over = state
            .timeout_us
            .is_some_and(|limit_us| self.t_us() - self.entered_us[region] > u128::from(limit_us));
        if is_over {
            let bit = match state.kind {
                StateKind::Simple => 0,
                _ => FLAG_TIMEOUT,
            };
            let first = self.first_flag(region, state);
            self.flags[first + bit] = true;
        }
    }

    fn holds(&self, region: usize, source: usize, state: &State, transition: usize) -> bool {
        let own = |bit: usize| self.flags[self.first_flag(region, state) + bit];
        match self.tables.guard_of(transition).expect("a guard") {
            Guard::True => true,
            Guard::Flag { bit, value } => own(bit) == value,
            Guard::Mask { mask, value } => (0..WINDOW_FLAGS)
                .filter(|bit| mask >> bit & 1 != 0)
                .all(|bit| own(usize::from(bit)) == (value >> bit & 1 != 0)),
            Guard::Program { first } => {
                let base = self.first_flag(region, state) - state.first_flag;
                let mut at = first;
                loop {
                    let (jumps, jump) = match self.tables.code(at).expect("it exists") {
                        Code::Test {
                            flag,
                            jump_if,
                            jump,
                        } => (self.flags[base + flag] == jump_if, jump),
                        Code::TestBusyInside { jump_if, jump } => {
                            (self.is_busy_inside(region, source) == jump_if, jump)
                        }
                        Code::End => return true,
                        Code::Send { .. } | Code::Write { .. } => panic!("an action in a guard"),
                    };
                    match (jumps, jump) {
                        (false, _) => at += 1,
                        (true, Some(jump)) => at += jump,
                        (true, None) => return false,
                    }
                }
            }
        }
    }

    fn is_busy_inside(&self, region: usize, superstate: usize) -> bool {
        let tables = &self.tables;
        let end = tables.region_instance(region).expect("it exists").next;
        let mut at = tables
            .first_region_inside(region, superstate)
            .unwrap_or(end);
        while at < end {
            let current = self.current[at];
            let state = tables.state(current).expect("it exists");
            let is_task = matches!(state.kind, StateKind::Task { .. });
            if is_task && self.flags[self.first_flag(at, &state) + FLAG_BUSY] {
                return true;
            }
            let next = tables.region_instance(at).expect("it exists").next;
            at = tables.first_region_inside(at, current).unwrap_or(next);
        }
        false
    }

    fn take(&mut self, region: usize, left: &State, transition: usize) -> Result<(), Fault> {
        let tables = self.tables;
        let here = tables.region_instance(region).expect("it exists");
        let instance = tables.instance(here.instance).expect("it exists");
        match left.kind {
            StateKind::Task { task_offset, .. } => {
                let task = instance.first_task + task_offset;
                self.disable_real_time(task..task + 1);
            }
            StateKind::Super { instance_offset } => {
                self.disable_real_time(tables.tasks_inside(here.instance + instance_offset));
            }
            _ => {}
        }
        let target = tables.transition(transition).expect("it exists").target;
        let entered = tables.state(target).expect("it exists");
        let first = here.first_flag + entered.first_flag;
        self.flags[first..first + entered.flags].fill(false);
        for action in tables.actions_of(transition) {
            match action {
                Code::Send { channel, .. } => {
                    if self.queue.len() == tables.queue_capacity() {
                        return Err(Fault::EventQueueOverflow);
                    }
                    self.queue.push_back(instance.first_channel + channel);
                }
                Code::Write { flag, value, .. } => self.flags[here.first_flag + flag] = value,
                _ => panic!("a test among actions"),
            }
        }
        self.current[region] = target;
        self.entered_us[region] = self.t_us();
        match entered.kind {
            StateKind::Task { task_offset, .. } => {
                self.enabled[instance.first_task + task_offset] = true;
            }
            StateKind::Final => self.flags[instance.first_flag + FLAG_EXIT] = true,
            StateKind::Super { .. } => {
                let mut at = tables
                    .first_region_inside(region, target)
                    .expect("a region");
                while at < here.next {
                    let inside = tables.region_instance(at).expect("it exists");
                    self.current[at] = inside.initial;
                    self.entered_us[at] = self.t_us();
                    at = inside.next;
                }
            }
            _ => {}
        }
        self.taken.push(TransitionTaken {
            micro: self.micro,
            region_instance: region as u16,
            transition: transition as u16,
        });
        Ok(())
    }

    fn disable_real_time(&mut self, tasks: std::ops::Range<usize>) {
        for task in tasks {
            let state = self.tables.task_instance(task).expect("it exists").state;
            let kind = self.tables.state(state).expect("it exists").kind;
            if matches!(kind, StateKind::Task { real_time, .. } if real_time) {
                self.enabled[task] = false;
            }
        }
    }
}
