//! Containers, regions, states, transitions and tasks as records.

use std::collections::HashMap;

use esm_core::format::{
    ACTION_NONE, ACTION_SEND, GUARD_PROGRAM, NONE, PLAIN_FLAGS, PULSE, STATE_BACKGROUND_TASK,
    STATE_FINAL, STATE_HAS_TIMEOUT, STATE_INITIAL, STATE_KIND_SHIFT, STATE_SIMPLE, STATE_SUPER,
    STATE_TASK, TRANSITION_IS_PLAIN,
};
use esm_core::layout::{self as records, Param, Short, TaskState, Timer};
use esm_core::signature::fnv1a;

use super::code::{self, Flags};
use super::instances::Tree;
use super::layout::{ContainerLayout, Layout, RegionLayout, Spans};
use super::{Capacity, CompileError, MAX_RECORDS, Table, signature, within};
use crate::model::{self, Model, SlotRef, Source, StateKind, Target, Trigger, Value};

/// The tables that all instances share.
#[derive(Default)]
pub(super) struct Templates {
    pub containers: Table,
    pub regions: Table,
    pub states: Table,
    pub transitions: Table,
    pub code: Table,
    pub timers: Table,
    pub tasks: Table,
    pub signatures: Vec<u8>,
    pub task_states: Table,
    pub params: Table,
    counts: Counts,
    /// Number of each task in use, by its place in [`Model::tasks`].
    task_numbers: HashMap<usize, usize>,
    /// Number of each task state, by its number in the table of states.
    pub task_state_numbers: HashMap<usize, usize>,
    /// Names of exclusive groups in the order of their numbers.
    pub groups: Vec<String>,
}

/// Records written so far.
#[derive(Default)]
struct Counts {
    regions: usize,
    transitions: usize,
    timers: usize,
    task_states: usize,
    params: usize,
}

/// The fields of a state that depend on what it is.
struct Shape {
    kind: u16,
    flags: usize,
    timeout_us: Option<u32>,
    begin: Spans,
    a: usize,
}

/// Writes all templates.
pub(super) fn write(
    model: &Model,
    layout: &Layout,
    tree: &Tree,
) -> Result<Templates, CompileError> {
    let mut templates = Templates::default();
    for (number, (container, declared)) in layout.with_models(model).enumerate() {
        let spans = container.spans;
        templates.containers.push(records::Container {
            first_region: Short::new(templates.counts.regions),
            flags: Short::new(declared.flags.len()),
            channels: Short::new(container.sent.len()),
            first_instance: Short::new(tree.first_instance_of(number)),
            flag_span: Short::new(spans.flags),
            task_span: Short::new(spans.tasks),
            region_span: Short::new(spans.regions),
            instance_span: Short::new(spans.instances),
        });
        for (region, declared) in container.regions.iter().zip(&declared.regions) {
            templates.regions.push(records::Region {
                first_state: Short::new(region.initial),
                container: Short::new(number),
            });
            templates.counts.regions += 1;
            templates.region(model, layout, container, region, declared)?;
        }
    }
    within(
        Capacity::Transitions,
        templates.counts.transitions,
        MAX_RECORDS,
    )?;
    within(
        Capacity::TaskStates,
        templates.counts.task_states,
        MAX_RECORDS,
    )?;
    within(Capacity::Params, templates.counts.params, MAX_RECORDS)?;
    Ok(templates)
}

/// Events whose numbers leave the same remainder share a bit of a state.
const EVENT_BITS: usize = u32::BITS as usize;

impl Templates {
    /// Number of a task in the blob, by its place in the model; none where it is not used.
    pub(super) fn task_number(&self, task: usize) -> Option<usize> {
        self.task_numbers.get(&task).copied()
    }

    fn region(
        &mut self,
        model: &Model,
        layout: &Layout,
        container: &ContainerLayout,
        region: &RegionLayout,
        declared: &model::Region,
    ) -> Result<(), CompileError> {
        let by_source = transitions_by_source(declared);
        let no_flags = |kind, begin| Shape {
            kind,
            flags: 0,
            timeout_us: None,
            begin,
            a: 0,
        };
        let begin = region
            .states
            .first()
            .map_or_else(|| self.region_end(container, region), |state| state.begin);
        let outgoing = sorted(layout, &by_source[0])?;
        self.state(no_flags(STATE_INITIAL, begin), &outgoing);
        self.transitions(container, region, declared, None, &outgoing)?;
        for (number, (state, declared_state)) in
            region.states.iter().zip(&declared.states).enumerate()
        {
            let (kind, a) = match &declared_state.kind {
                StateKind::Simple => (STATE_SIMPLE, 0),
                StateKind::Task { task, slot, params } => {
                    self.task_state(model, state.index, *task, *slot, params)?;
                    let kind = match slot {
                        SlotRef::NonRealTime => STATE_BACKGROUND_TASK,
                        SlotRef::Slot(_) => STATE_TASK,
                    };
                    (kind, state.begin.tasks)
                }
                StateKind::Super { .. } => (STATE_SUPER, state.begin.instances),
            };
            let outgoing = sorted(layout, &by_source[number + 1])?;
            self.state(
                Shape {
                    kind,
                    flags: state.flags,
                    timeout_us: declared_state.timeout_us,
                    begin: state.begin,
                    a,
                },
                &outgoing,
            );
            let source = Some(Flags {
                state: declared_state,
                layout: state,
            });
            self.transitions(container, region, declared, source, &outgoing)?;
        }
        let end = self.region_end(container, region);
        self.state(no_flags(STATE_FINAL, end), &[]);
        Ok(())
    }

    /// Where the flags behind a region's states begin.
    fn region_end(&self, container: &ContainerLayout, region: &RegionLayout) -> Spans {
        container
            .regions
            .iter()
            .skip_while(|other| other.initial <= region.initial)
            .find_map(|later| later.states.first())
            .map_or(container.spans, |state| state.begin)
    }

    /// Writes a state's record; its transitions are to follow.
    fn state(&mut self, shape: Shape, outgoing: &[Outgoing<'_>]) {
        let first = self.counts.transitions;
        let is_on_pulse = |transition: &&Outgoing<'_>| transition.event == usize::from(PULSE);
        let on_pulse = outgoing.iter().filter(is_on_pulse).count();
        let bits = outgoing.iter().map(|it| 1 << (it.event % EVENT_BITS));
        let events = bits.fold(0, |events: u32, bit: u32| events | bit);
        let (timeout_bit, timer) = match shape.timeout_us {
            Some(timeout_us) => {
                self.timers.push(Timer {
                    timeout_us: timeout_us.into(),
                });
                self.counts.timers += 1;
                (STATE_HAS_TIMEOUT, self.counts.timers - 1)
            }
            None => (0, 0),
        };
        let kind = shape.kind << STATE_KIND_SHIFT | timeout_bit;
        self.states.push(records::State {
            events: events.into(),
            first_transition: Short::new(first),
            first_event_transition: Short::new(first + on_pulse),
            first_flag: Short::new(shape.begin.flags),
            shape: (kind | shape.flags as u16).into(),
            a: Short::new(shape.a),
            b: Short::new(timer),
        });
    }

    /// Writes the transitions out of one state.
    fn transitions(
        &mut self,
        container: &ContainerLayout,
        region: &RegionLayout,
        declared: &model::Region,
        source: Option<Flags<'_>>,
        outgoing: &[Outgoing<'_>],
    ) -> Result<(), CompileError> {
        // The guards at the head that ask for one bit each, one behind the other.
        let mut row: Vec<u16> = Vec::new();
        let mut on_pulse = 0;
        let is_timed = source.is_some_and(|source| source.state.timeout_us.is_some());
        for Outgoing { event, transition } in outgoing {
            let (target, target_index) = match transition.target {
                Target::Final => (None, region.last),
                Target::State(number) => {
                    let pair = region.states.get(number).zip(declared.states.get(number));
                    let (layout, state) =
                        pair.ok_or(CompileError::Contradiction(transition.span))?;
                    (Some(Flags { state, layout }), layout.index)
                }
            };
            let guard = code::append_guard(&mut self.code, transition, source)?;
            let action = code::append_actions(&mut self.code, container, transition, target)?;
            let is_plain = action == ACTION_NONE
                && source.is_none_or(|source| source.is_simple())
                && target.is_some_and(|target| target.is_simple() && target.layout.flags == 0);
            let is_again = *event == usize::from(PULSE)
                && action >= ACTION_SEND
                && source.zip(target).is_some_and(|(source, target)| {
                    source.layout.index == target.layout.index && is_short_task(source)
                });
            let mark = if is_plain || is_again {
                TRANSITION_IS_PLAIN
            } else {
                0
            };
            if *event == usize::from(PULSE) {
                let is_next = guard < GUARD_PROGRAM
                    && row.len() == on_pulse
                    && row.last().is_none_or(|last| last + 1 == guard);
                if is_next {
                    row.push(guard);
                }
                on_pulse += 1;
            }
            self.transitions.push(records::Transition {
                event: (*event as u16 | mark).into(),
                target: Short::new(target_index),
                guard: guard.into(),
                action: action.into(),
            });
            self.counts.transitions += 1;
        }
        if !is_timed
            && row.len() > 1
            && let Some(state) = self.states.last_mut::<records::State>()
        {
            state.b = Short::new(row.len());
        }
        Ok(())
    }

    /// Writes a task state, and its task where it is the first of it.
    fn task_state(
        &mut self,
        model: &Model,
        state: usize,
        task: usize,
        slot: SlotRef,
        params: &[Value],
    ) -> Result<(), CompileError> {
        let number = self.task(model, task)?;
        let slot = match slot {
            SlotRef::NonRealTime => usize::from(NONE),
            SlotRef::Slot(slot) => slot,
        };
        self.task_states.push(TaskState {
            task: Short::new(number),
            slot: Short::new(slot),
            first_param: Short::new(self.counts.params),
            state: Short::new(state),
        });
        for value in params {
            let value = match *value {
                Value::Bool(value) => u32::from(value),
                Value::I32(value) => value as u32,
                Value::U32(value) => value,
                Value::F32(value) => value.to_bits(),
            };
            self.params.push(Param {
                value: value.into(),
            });
        }
        self.counts.params += params.len();
        self.task_state_numbers
            .insert(state, self.counts.task_states);
        self.counts.task_states += 1;
        Ok(())
    }

    fn task(&mut self, model: &Model, index: usize) -> Result<usize, CompileError> {
        if let Some(number) = self.task_numbers.get(&index) {
            return Ok(*number);
        }
        let number = self.task_numbers.len();
        within(Capacity::Tasks, number + 1, MAX_RECORDS)?;
        let task = &model.tasks[index];
        let text = signature::text(task);
        let group = match &task.exclusive {
            None => usize::from(NONE),
            Some(name) => self.group(name),
        };
        let start = self.signatures.len();
        within(
            Capacity::SignatureBytes,
            start + text.len(),
            usize::from(u16::MAX),
        )?;
        let hash = fnv1a(text.as_bytes());
        self.tasks.push(records::Task {
            signature_hash: hash.into(),
            text_start: Short::new(start),
            text_length: Short::new(text.len()),
            exclusive: Short::new(group),
            data: Short::new(task.data.len()),
            flags: Short::new(task.flags.len()),
            params: Short::new(task.params.len()),
        });
        self.signatures.extend_from_slice(text.as_bytes());
        self.task_numbers.insert(index, number);
        Ok(number)
    }

    fn group(&mut self, name: &str) -> usize {
        match self.groups.iter().position(|group| group == name) {
            Some(number) => number,
            None => {
                self.groups.push(name.to_owned());
                self.groups.len() - 1
            }
        }
    }
}

/// A transition with the number of its event.
struct Outgoing<'a> {
    event: usize,
    transition: &'a model::Transition,
}

/// The transitions out of one state in the order of a blob: by the numbers of their events, of
/// which that of the pulse is the lowest. The interpreter looks at those of one event only.
fn sorted<'a>(
    layout: &Layout,
    outgoing: &[&'a model::Transition],
) -> Result<Vec<Outgoing<'a>>, CompileError> {
    let with_event = |transition: &&'a model::Transition| {
        let event = match transition.trigger {
            Trigger::Pulse | Trigger::Star => Some(usize::from(PULSE)),
            Trigger::Event(event) => layout.event_numbers.get(&event).copied(),
        };
        Ok(Outgoing {
            event: event.ok_or(CompileError::Contradiction(transition.span))?,
            transition,
        })
    };
    let mut sorted: Vec<_> = outgoing.iter().map(with_event).collect::<Result<_, _>>()?;
    sorted.sort_by_key(|transition| transition.event);
    Ok(sorted)
}

/// The transitions out of `initial` and of each state, in source order.
fn transitions_by_source(region: &model::Region) -> Vec<Vec<&model::Transition>> {
    let mut by_source = vec![Vec::new(); region.states.len() + 1];
    for transition in &region.transitions {
        let place = match transition.source {
            Source::Initial => 0,
            Source::State(state) => state + 1,
        };
        if let Some(outgoing) = by_source.get_mut(place) {
            outgoing.push(transition);
        }
    }
    by_source
}

/// Whether a state is a real-time task without timeout, with few enough flags to enter itself by a
/// plain transition.
fn is_short_task(state: Flags<'_>) -> bool {
    let in_slot = matches!(
        state.state.kind,
        StateKind::Task {
            slot: SlotRef::Slot(_),
            ..
        }
    );
    in_slot && state.state.timeout_us.is_none() && state.layout.flags <= usize::from(PLAIN_FLAGS)
}
