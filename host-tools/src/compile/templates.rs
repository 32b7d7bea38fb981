//! Containers, regions, states, transitions and tasks as records.

use std::collections::HashMap;

use esm_core::format::{
    NONE, PULSE, STATE_BACKGROUND_TASK, STATE_FINAL, STATE_HAS_TIMEOUT, STATE_INITIAL,
    STATE_KIND_SHIFT, STATE_SIMPLE, STATE_SUPER, STATE_TASK, TRANSITION_HAS_CODE,
};
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
    pub tasks: Table,
    pub signatures: Vec<u8>,
    pub task_states: Table,
    pub params: Table,
    counts: Counts,
    /// Number of each task in use, by its place in [`Model::tasks`].
    task_numbers: HashMap<usize, usize>,
    /// Names of exclusive groups in the order of their numbers.
    pub groups: Vec<String>,
}

/// Records written so far.
#[derive(Default)]
struct Counts {
    regions: usize,
    transitions: usize,
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
    b: usize,
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
        templates.containers.words([
            templates.counts.regions,
            declared.flags.len(),
            container.sent.len(),
            tree.first_instance_of(number),
            spans.flags,
            spans.tasks,
            spans.regions,
            spans.instances,
        ]);
        for (region, declared) in container.regions.iter().zip(&declared.regions) {
            templates.regions.words([region.initial, number]);
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

/// Bytes of a code record.
const CODE_BYTES: usize = 4;

impl Templates {
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
            b: 0,
        };
        let begin = region
            .states
            .first()
            .map_or_else(|| self.region_end(container, region), |state| state.begin);
        self.state(no_flags(STATE_INITIAL, begin), &by_source[0]);
        self.transitions(layout, container, region, declared, None, &by_source[0])?;
        for (number, (state, declared_state)) in
            region.states.iter().zip(&declared.states).enumerate()
        {
            let (kind, a, b) = match &declared_state.kind {
                StateKind::Simple => (STATE_SIMPLE, 0, 0),
                StateKind::Task { task, slot, params } => {
                    let task_state = self.task_state(model, *task, *slot, params)?;
                    let kind = match slot {
                        SlotRef::NonRealTime => STATE_BACKGROUND_TASK,
                        SlotRef::Slot(_) => STATE_TASK,
                    };
                    (kind, state.begin.tasks, task_state)
                }
                StateKind::Super { .. } => {
                    (STATE_SUPER, state.begin.regions, state.begin.instances)
                }
            };
            let outgoing = &by_source[number + 1];
            self.state(
                Shape {
                    kind,
                    flags: state.flags,
                    timeout_us: declared_state.timeout_us,
                    begin: state.begin,
                    a,
                    b,
                },
                outgoing,
            );
            let source = Some(Flags {
                state: declared_state,
                layout: state,
            });
            self.transitions(layout, container, region, declared, source, outgoing)?;
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
    fn state(&mut self, shape: Shape, outgoing: &[&model::Transition]) {
        let first = self.counts.transitions;
        let on_pulse = outgoing
            .iter()
            .filter(|transition| is_on_pulse(transition))
            .count();
        let timeout_bit = match shape.timeout_us {
            Some(_) => STATE_HAS_TIMEOUT,
            None => 0,
        };
        let word = usize::from(shape.kind << STATE_KIND_SHIFT | timeout_bit) | shape.flags;
        self.states.words([
            first,
            first + on_pulse,
            shape.begin.flags,
            word,
            shape.a,
            shape.b,
        ]);
        self.states.longs([shape.timeout_us.unwrap_or(0)]);
    }

    /// Writes the transitions out of one state: those on the pulse first, since the interpreter looks at one kind only.
    fn transitions(
        &mut self,
        layout: &Layout,
        container: &ContainerLayout,
        region: &RegionLayout,
        declared: &model::Region,
        source: Option<Flags<'_>>,
        outgoing: &[&model::Transition],
    ) -> Result<(), CompileError> {
        let (on_pulse, on_event): (Vec<_>, Vec<_>) = outgoing
            .iter()
            .copied()
            .partition(|transition| is_on_pulse(transition));
        for transition in on_pulse.into_iter().chain(on_event) {
            let contradiction = CompileError::Contradiction(transition.span);
            let (target, target_index) = match transition.target {
                Target::Final => (None, region.last),
                Target::State(number) => {
                    let pair = region.states.get(number).zip(declared.states.get(number));
                    let (layout, state) = pair.ok_or(contradiction.clone())?;
                    (Some(Flags { state, layout }), layout.index)
                }
            };
            let event = match transition.trigger {
                Trigger::Pulse | Trigger::Star => usize::from(PULSE),
                Trigger::Event(event) => *layout.event_numbers.get(&event).ok_or(contradiction)?,
            };
            let start = self.code.bytes.len() / CODE_BYTES;
            within(Capacity::Code, start, MAX_RECORDS)?;
            let has_code = code::append(&mut self.code, container, transition, source, target)?;
            let mark = if has_code {
                usize::from(TRANSITION_HAS_CODE)
            } else {
                0
            };
            self.transitions.words([event | mark, target_index, start]);
            self.counts.transitions += 1;
        }
        within(
            Capacity::Code,
            self.code.bytes.len() / CODE_BYTES,
            MAX_RECORDS,
        )
    }

    /// Writes a task state, and its task where it is the first of it. Returns its number.
    fn task_state(
        &mut self,
        model: &Model,
        task: usize,
        slot: SlotRef,
        params: &[Value],
    ) -> Result<usize, CompileError> {
        let number = self.task(model, task)?;
        let slot = match slot {
            SlotRef::NonRealTime => usize::from(NONE),
            SlotRef::Slot(slot) => slot,
        };
        self.task_states.words([number, slot, self.counts.params]);
        for value in params {
            self.params.longs([match *value {
                Value::Bool(value) => u32::from(value),
                Value::I32(value) => value as u32,
                Value::U32(value) => value,
                Value::F32(value) => value.to_bits(),
            }]);
        }
        self.counts.params += params.len();
        let index = self.counts.task_states;
        self.counts.task_states += 1;
        Ok(index)
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
        self.tasks.longs([hash as u32, (hash >> u32::BITS) as u32]);
        self.tasks.words([
            start,
            text.len(),
            group,
            task.data.len(),
            task.flags.len(),
            task.params.len(),
        ]);
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

fn is_on_pulse(transition: &model::Transition) -> bool {
    matches!(transition.trigger, Trigger::Pulse | Trigger::Star)
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
