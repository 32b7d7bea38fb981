//! Tables with their names: what reports, guards and sources are read from.

use esm_core::format::{PULSE, WINDOW_FLAGS};
use esm_core::signature::{Port, Signature};
use esm_core::tables::{self, Code, Container, Region, State, StateKind, Tables};

use super::flags::Flag;
use super::guard::{self, Expression, Test, Written};
use super::names::Names;

/// Tables with their names.
pub(super) struct Reader<'a> {
    pub(super) tables: Tables<'a>,
    pub(super) names: Names,
}

impl Reader<'_> {
    /// Number of a slot; 0 for none.
    pub(super) fn slot_number(&self, slot: Option<usize>) -> u32 {
        slot.and_then(|slot| self.tables.slot(slot))
            .map_or(0, |slot| slot.number)
    }

    /// The regions of the container with an index, with their own.
    pub(super) fn regions_of(
        &self,
        index: usize,
        container: &Container,
    ) -> impl Iterator<Item = (usize, Region)> {
        // By their numbers: whoever passes over those before decodes each of them, for each
        // container.
        let from_its_first = container.first_region..self.tables.regions().len();
        from_its_first
            .map_while(|number| Some((number, self.tables.region(number)?)))
            .take_while(move |(_, region)| region.container == index)
    }

    /// What a task state runs.
    pub(super) fn task_state(&self, state: usize) -> Option<tables::TaskState> {
        self.tables.task_state(self.tables.task_state_at(state)?)
    }

    /// The container of a superstate.
    pub(super) fn container_inside(&self, state: usize) -> Option<usize> {
        let StateKind::Super { instance_offset } = self.tables.state(state)?.kind else {
            return None;
        };
        let around = self.tables.container(self.container_of(state)?)?;
        let inside = around.first_instance + instance_offset;
        Some(self.tables.instance(inside)?.container)
    }

    /// The container that a state is written in.
    pub(super) fn container_of(&self, state: usize) -> Option<usize> {
        let region = self.tables.region(self.tables.region_of_state(state))?;
        Some(region.container)
    }

    pub(super) fn params(&self, signature: Signature<'_>, first: usize) -> Vec<(String, String)> {
        let params = signature.ports().filter_map(|port| match port {
            Port::Param { name, type_name } => Some((name, type_name)),
            _ => None,
        });
        params
            .zip(first..)
            .map(|((name, type_name), index)| {
                let bits = self.tables.param(index).unwrap_or(0);
                let value = match type_name {
                    b"bool" => (bits != 0).to_string(),
                    b"i32" => (bits as i32).to_string(),
                    b"f32" => f32::from_bits(bits).to_string(),
                    _ => bits.to_string(),
                };
                (readable(name), value)
            })
            .collect()
    }

    /// What a transition asks for.
    pub(super) fn guard(&self, from: usize, source: &State, index: usize) -> Option<Written> {
        let container = self.container_of(from)?;
        let name = |bit| self.flag(container, (from, source), bit);
        let of_window = |bit, value| Expression::flag(name(source.first_flag + bit), value);
        Some(match self.tables.guard_of(index)? {
            tables::Guard::True => Written::Nothing,
            tables::Guard::Flag { bit, value } => Written::Expression(of_window(bit, value)),
            tables::Guard::Mask { mask, value } => {
                let bits = (0..WINDOW_FLAGS).filter(|bit| mask >> bit & 1 != 0);
                let flags = bits.map(|bit| of_window(usize::from(bit), value >> bit & 1 != 0));
                flags
                    .reduce(Expression::and)
                    .map_or(Written::Nothing, Written::Expression)
            }
            tables::Guard::Program { .. } => {
                let mut tests = Vec::new();
                for code in self.tables.program_of(index) {
                    let (jumps_if, jump) = match code {
                        Code::Test {
                            flag,
                            jump_if,
                            jump,
                        } => (Expression::flag(name(flag), jump_if), jump),
                        Code::TestBusyInside { jump_if, jump } => {
                            (Expression::flag("busy".to_owned(), jump_if), jump)
                        }
                        Code::End | Code::Send { .. } | Code::Write { .. } => continue,
                    };
                    let to = jump.map(|jump| tests.len() + jump);
                    tests.push(Test { jumps_if, to });
                }
                guard::fold(tests.clone()).map_or(Written::Tests(tests), Written::Expression)
            }
        })
    }

    /// What a transition does.
    pub(super) fn actions(&self, from: usize, index: usize) -> Option<Vec<String>> {
        let container = self.container_of(from)?;
        let to = self.tables.transition(index)?.target;
        let target = self.tables.state(to)?;
        let actions = self.tables.actions_of(index).filter_map(|code| match code {
            Code::Send { channel, .. } => {
                Some(format!("send {}", self.sent_event(container, channel)))
            }
            Code::Write { flag, value, .. } => {
                let verb = if value { "set" } else { "clear" };
                Some(format!(
                    "{verb} {}",
                    self.flag(container, (to, &target), flag)
                ))
            }
            Code::Test { .. } | Code::TestBusyInside { .. } | Code::End => None,
        });
        Some(actions.collect())
    }

    /// The event of a channel of a container.
    pub(super) fn sent_event(&self, container: usize, channel: usize) -> &str {
        let event = self
            .tables
            .container(container)
            .and_then(|container| self.tables.instance(container.first_instance))
            .and_then(|instance| self.tables.channel(instance.first_channel + channel))
            .map_or(PULSE, |channel| channel.event);
        Names::get(&self.names.events, usize::from(event))
    }

    /// A flag as a transition that leaves or enters the state with an index writes it.
    pub(super) fn flag(
        &self,
        container: usize,
        (index, state): (usize, &State),
        bit: usize,
    ) -> String {
        let of_container = self
            .names
            .flags
            .get(container)
            .map_or(&[][..], Vec::as_slice);
        match Flag::of(state, of_container.len(), bit) {
            Flag::Exit => "exit".to_owned(),
            Flag::Timeout => "timeout".to_owned(),
            Flag::Busy => "busy".to_owned(),
            Flag::Own(flag) => format!(".{}", self.own_flag(index, state, flag)),
            Flag::Parent(flag) => format!("^{}", Names::get(of_container, flag)),
            Flag::Nameless => format!("bit {bit}"),
        }
    }

    /// The name of a control flag of a state.
    pub(super) fn own_flag(&self, index: usize, state: &State, flag: usize) -> String {
        let name = match state.kind {
            StateKind::Task { .. } => self
                .task_state(index)
                .and_then(|task_state| self.tables.task(task_state.task))
                .and_then(|task| flag_names(task.signature).nth(flag)),
            _ => self
                .container_inside(index)
                .and_then(|inside| self.names.flags.get(inside)?.get(flag).cloned()),
        };
        name.unwrap_or_default()
    }

    /// The path of a state of a region instance.
    pub(super) fn path(
        &self,
        superstates: &[Option<(usize, usize)>],
        region_instance: usize,
        state: usize,
    ) -> String {
        let mut parts = vec![Names::get(&self.names.states, state)];
        let mut at = region_instance;
        while let Some(region) = self.tables.region_instance(at) {
            let template = self.tables.region_of_state(region.initial);
            parts.push(Names::get(&self.names.regions, template));
            let Some((around, superstate)) = superstates.get(region.instance).copied().flatten()
            else {
                break;
            };
            // A region instance is numbered above the one around it: so this ends.
            at = around;
            parts.push(Names::get(&self.names.states, superstate));
        }
        parts.reverse();
        parts.join("/")
    }
}

pub(super) fn readable(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Names of a signature's flags.
fn flag_names(signature: Signature<'_>) -> impl Iterator<Item = String> {
    signature.ports().filter_map(|port| match port {
        Port::Flag { name, .. } => Some(readable(name)),
        _ => None,
    })
}
