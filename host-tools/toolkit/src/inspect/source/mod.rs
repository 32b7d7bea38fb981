//! A blob back to a source that compiles to the same blob, byte for byte.
//!
//! What a blob does not keep is worked out or left out. Which events a container lists ([`events`])
//! and which data ports and paths it has ([`ports`]) follow from what all its instances do; whether
//! a flag is `in` or `out` follows from who reads and writes it; transitions keep the order that
//! matters ([`order`]). Containers pass on the events that somebody listens to; the blob has no
//! trace of others. Comments, execution times, ranges of parameters, and what the machine does not
//! use are gone: they leave no byte.
//!
//! A source is only given out when it has been compiled and found to make the blob that it came
//! from. Every blob of the compiler passes; a verified blob that somebody made by hand may not be
//! the blob of any source, and then [`NoSource`] says why.

mod events;
mod order;
mod ports;
#[cfg(test)]
mod tests;
mod text;
mod tree;

use esm_core::Verified;
use esm_core::format::WINDOW_FLAGS;
use esm_core::tables::{self, Code, State, StateKind};

use super::flags::Flag;
use super::guard::Written;
use super::names::Names;
use super::reader::Reader;
use crate::compile::{self, NameTable};
use crate::lang::{self, MAX_FILE_BYTES, Severity};
use crate::schedule::Limit;

/// What a source is called while it is compiled.
const SOURCE_NAME: &str = "inspected.esm";

/// Why a blob cannot be given back as source. None of these happens to a blob that `esm build`
/// made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoSource {
    /// A name is none.
    #[error("it calls something `{name}`, which is no name in the language")]
    Name {
        /// As the blob has it.
        name: String,
    },
    /// The machine has control flags.
    #[error(
        "its machine has control flags, and nothing is around a machine that could read or set them"
    )]
    MachineFlags,
    /// The program of a guard does not come from an expression.
    #[error("the guard of {transition} jumps as no expression does")]
    Guard {
        /// `A -> B`, with the container and region.
        transition: String,
    },
    /// A guard or an action uses a flag that has no name there.
    #[error("{transition} uses flag bit {bit}, which has no name there")]
    Flag {
        /// `A -> B`, with the container and region.
        transition: String,
        /// The bit, counted from the first of the instance.
        bit: usize,
    },
    /// A flag is written inside and outside of its container.
    #[error("flag `{flag}` of container `{container}` is used as `in` flag and as `out` flag")]
    FlagDirection {
        /// The container.
        container: String,
        /// The flag.
        flag: String,
    },
    /// No order of transitions numbers the events that they send as the blob does.
    #[error(
        "container `{container}` numbers the events that it sends in an order in which its transitions cannot send them"
    )]
    SendOrder {
        /// The container.
        container: String,
    },
    /// A data port is on a net in one instance of its container and open in another.
    #[error(
        "port `{state}.{port}` is on a net in one instance of its container and open in another"
    )]
    HalfOpen {
        /// The state.
        state: String,
        /// Its port.
        port: String,
    },
    /// A net of the machine lacks a writer or a reader, and there is no superstate to lend it one.
    #[error("the net of `{state}.{port}` is one that no path in the machine makes")]
    Net {
        /// A state on it.
        state: String,
        /// Its port.
        port: String,
    },
    /// The bits of a parameter's value are none of its type, or cannot be written.
    #[error(
        "parameter `{param}` of `{state}` has the bits {bits:#010x}, which no literal of its type stands for"
    )]
    Value {
        /// The task state.
        state: String,
        /// The parameter.
        param: String,
        /// The value.
        bits: u32,
    },
    /// It would take too long, or become too long.
    #[error("its source would take more than {limit} {what}")]
    TooMuch {
        /// What there is too much of.
        what: &'static str,
        /// How much is possible.
        limit: usize,
    },
    /// The front end refuses the source.
    #[error("its source would be refused: {mistake}")]
    Mistake {
        /// The first error.
        mistake: String,
    },
    /// The source compiles to another blob.
    #[error("its source would compile to another blob, which differs from byte {byte} on")]
    Differs {
        /// The first byte that differs, from 0.
        byte: usize,
    },
}

/// The source of a blob whose texts were [checked](esm_core::texts::check). A blob without names
/// gets made-up ones, and is the same again when its source is compiled without names. Start times
/// of the slots are searched for as long as `limit` says: as long as for the blob itself.
///
/// # Errors
/// See [`NoSource`].
pub fn source(blob: &Verified<Vec<u8>>, limit: impl Into<Limit>) -> Result<String, NoSource> {
    let tables = blob.tables();
    let reader = Reader {
        tables,
        names: Names::of(blob),
    };
    reader.check_names()?;
    let flags_out = reader.flags_out()?;
    let tree = tree::Tree::of(&tables);
    let parts = text::Parts {
        events: events::lists(&reader, &tree)?,
        flags_out,
        wirings: ports::wirings(&reader, &tree)?,
        transitions: reader.transition_order()?,
        containers: ports::children_first(&reader, tables.containers().len()),
    };
    let source = text::write(&reader, blob, &parts)?;
    // One that has syntax errors, since a task of the blob is called `set` for instance, is refused
    // below.
    let source = lang::format::format(SOURCE_NAME, source.as_bytes()).unwrap_or(source);
    compiles_to(&source, blob, limit.into())?;
    Ok(source)
}

/// Compiles a source as the command does, and compares.
fn compiles_to(source: &str, blob: &Verified<Vec<u8>>, limit: Limit) -> Result<(), NoSource> {
    if source.len() as u64 > MAX_FILE_BYTES {
        return Err(NoSource::TooMuch {
            what: "bytes",
            limit: usize::try_from(MAX_FILE_BYTES).unwrap_or(usize::MAX),
        });
    }
    let mut checked = lang::load_text(SOURCE_NAME, source);
    let schedule = checked.lay_out(limit);
    let (Some(model), Some(schedule)) = (&checked.model, schedule) else {
        let is_error = |found: &&lang::Diagnostic| found.severity() == Severity::Error;
        let first = checked.diagnostics.iter().find(is_error);
        return Err(NoSource::Mistake {
            mistake: first.map_or_else(String::new, |error| error.message.clone()),
        });
    };
    let names = match blob.tables().names() {
        Some(_) => NameTable::Kept,
        None => NameTable::LeftOut,
    };
    let again =
        compile::compile_with(model, &schedule, names).map_err(|error| NoSource::Mistake {
            mistake: error.to_string(),
        })?;
    let bytes = blob.bytes();
    if again == bytes {
        return Ok(());
    }
    let pairs = again.iter().zip(bytes);
    Err(NoSource::Differs {
        byte: pairs.take_while(|(a, b)| a == b).count(),
    })
}

impl Reader<'_> {
    /// The states of a container's regions, pseudo-states included.
    fn states_of(&self, container: usize) -> Vec<usize> {
        let Some(described) = self.tables.container(container) else {
            return Vec::new();
        };
        self.regions_of(container, &described)
            .flat_map(|(_, region)| self.states_of_region(region.first_state))
            .collect()
    }

    /// The states of a region from `initial` to `final`.
    fn states_of_region(&self, first: usize) -> impl Iterator<Item = usize> {
        let mut is_at_end = false;
        (first..self.tables.state_count()).take_while(move |state| {
            let was_at_end = is_at_end;
            let kind = self.tables.state(*state).map(|state| state.kind);
            is_at_end = kind == Some(StateKind::Final);
            !was_at_end
        })
    }

    /// The containers of a container's superstates.
    fn used_by(&self, container: usize) -> Vec<usize> {
        let states = self.states_of(container);
        states
            .into_iter()
            .filter_map(|state| self.container_inside(state))
            .collect()
    }

    fn state_name(&self, state: usize) -> String {
        Names::get(&self.names.states, state).to_owned()
    }

    /// A transition as messages name it.
    fn transition_name(&self, transition: usize) -> String {
        let from = self.tables.source_of_transition(transition);
        let to = self
            .tables
            .transition(transition)
            .map_or(0, |transition| transition.target);
        let container = self.container_of(from).unwrap_or(0);
        format!(
            "`{} -> {}` in `{}`",
            self.state_name(from),
            self.state_name(to),
            Names::get(&self.names.containers, container)
        )
    }

    /// Names of a blob can be words that no source can have as names.
    fn check_names(&self) -> Result<(), NoSource> {
        if !self.names.are_original {
            return Ok(());
        }
        let names = &self.names;
        let is_pseudo = |state: &str| state == "initial" || state == "final";
        let states = names.states.iter().filter(|state| !is_pseudo(state));
        let all = names
            .events
            .iter()
            .skip(1)
            .chain(&names.containers)
            .chain(names.flags.iter().flatten())
            .chain(&names.regions)
            .chain(states)
            .chain(&names.groups);
        for name in all {
            if !lang::is_name(name) {
                return Err(NoSource::Name { name: name.clone() });
            }
        }
        Ok(())
    }

    /// For each control flag of each container, whether it is an `out` flag. A flag that nobody
    /// outside writes or reads, and nobody inside writes, is `in`.
    fn flags_out(&self) -> Result<Vec<Vec<bool>>, NoSource> {
        let tables = &self.tables;
        let none_of: Vec<Vec<bool>> = tables
            .containers()
            .map(|container| vec![false; container.flags])
            .collect();
        if none_of.first().is_some_and(|flags| !flags.is_empty()) {
            return Err(NoSource::MachineFlags);
        }
        let (mut is_in, mut is_out) = (none_of.clone(), none_of);
        for transition in 0..tables.transition_count() {
            let source_index = tables.source_of_transition(transition);
            let ends = tables.transition(transition).and_then(|transition| {
                let source = tables.state(source_index)?;
                let target = tables.state(transition.target)?;
                let container = self.container_of(source_index)?;
                Some((source, transition.target, target, container))
            });
            let Some((source, target_index, target, container)) = ends else {
                continue;
            };
            let around = tables
                .container(container)
                .map_or(0, |container| container.flags);
            let mark = |list: &mut Vec<Vec<bool>>, of: Option<usize>, flag: usize| {
                let flags = of.and_then(|container| list.get_mut(container));
                if let Some(mark) = flags.and_then(|flags| flags.get_mut(flag)) {
                    *mark = true;
                }
            };
            let tested = self.flags_tested(transition, &source).into_iter();
            let tested = tested.map(|bit| (bit, Flag::of(&source, around, bit), true));
            let written = tables.actions_of(transition).filter_map(|code| match code {
                Code::Write { flag, .. } => Some(flag),
                _ => None,
            });
            let written = written.map(|bit| (bit, Flag::of(&target, around, bit), false));
            for (bit, found, is_test) in tested.chain(written) {
                match (found, is_test) {
                    (Flag::Own(flag), true) => {
                        mark(&mut is_out, self.container_inside(source_index), flag);
                    }
                    (Flag::Own(flag), false) => {
                        mark(&mut is_in, self.container_inside(target_index), flag);
                    }
                    (Flag::Parent(flag), false) => mark(&mut is_out, Some(container), flag),
                    (Flag::Parent(_) | Flag::Exit | Flag::Timeout | Flag::Busy, true) => {}
                    (Flag::Nameless, _) | (Flag::Exit | Flag::Timeout | Flag::Busy, false) => {
                        let transition = self.transition_name(transition);
                        return Err(NoSource::Flag { transition, bit });
                    }
                }
            }
        }
        for (container, (ins, outs)) in is_in.iter().zip(&is_out).enumerate() {
            let both = ins
                .iter()
                .zip(outs)
                .position(|(is_in, is_out)| *is_in && *is_out);
            if let Some(flag) = both {
                return Err(NoSource::FlagDirection {
                    container: Names::get(&self.names.containers, container).to_owned(),
                    flag: self
                        .names
                        .flags
                        .get(container)
                        .map_or("", |flags| Names::get(flags, flag))
                        .to_owned(),
                });
            }
        }
        Ok(is_out)
    }

    /// The flags that the guard of a transition names, counted from the first of the instance.
    fn flags_tested(&self, transition: usize, source: &State) -> Vec<usize> {
        let of_window = |bit: u16| source.first_flag + usize::from(bit);
        match self.tables.guard_of(transition) {
            None | Some(tables::Guard::True) => Vec::new(),
            Some(tables::Guard::Flag { bit, .. }) => vec![source.first_flag + bit],
            Some(tables::Guard::Mask { mask, .. }) => {
                let bits = (0..WINDOW_FLAGS).filter(|bit| mask >> bit & 1 != 0);
                bits.map(of_window).collect()
            }
            Some(tables::Guard::Program { .. }) => {
                let tests = self.tables.program_of(transition);
                let flags = tests.filter_map(|code| match code {
                    Code::Test { flag, .. } => Some(flag),
                    _ => None,
                });
                flags.collect()
            }
        }
    }

    /// For each region its transitions, in the order in which to write them.
    fn transition_order(&self) -> Result<Vec<Vec<usize>>, NoSource> {
        let tables = &self.tables;
        let mut orders = Vec::with_capacity(tables.regions().len());
        for (container, described) in tables.containers().enumerate() {
            let mut sent = order::Sent::default();
            for (_, region) in self.regions_of(container, &described) {
                let mut chains = Vec::new();
                for state in self.states_of_region(region.first_state) {
                    // Only those on one event must keep their order: they stand one after another.
                    let event = |index: usize| tables.transition(index).map(|it| it.event);
                    let mut all = tables.transitions_of(state);
                    while let Some(first) = all.next() {
                        while !all.is_empty() && event(all.start) == event(first) {
                            all.next();
                        }
                        chains.push(first..all.start);
                    }
                }
                let sends = |transition| {
                    let channels = tables.actions_of(transition).filter_map(|code| match code {
                        Code::Send { channel, .. } => Some(channel),
                        _ => None,
                    });
                    channels.collect::<Vec<_>>()
                };
                let order = sent
                    .order(&chains, sends)
                    .ok_or_else(|| NoSource::SendOrder {
                        container: Names::get(&self.names.containers, container).to_owned(),
                    })?;
                orders.push(order);
            }
        }
        Ok(orders)
    }

    /// The guard of a transition as it is written, if it has one.
    fn guard_text(
        &self,
        from: usize,
        source: &State,
        transition: usize,
    ) -> Result<Option<String>, NoSource> {
        match self.guard(from, source, transition) {
            None | Some(Written::Nothing) => Ok(None),
            Some(Written::Expression(expression)) => Ok(Some(expression.to_string())),
            Some(Written::Tests(_)) => Err(NoSource::Guard {
                transition: self.transition_name(transition),
            }),
        }
    }
}
