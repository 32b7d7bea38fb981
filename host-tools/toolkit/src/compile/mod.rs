//! From a resolved model to a blob.
//!
//! The passes run in the order of the modules: which containers the machine uses and how an
//! instance of each is laid out (`layout`); guards and actions (`code`); templates as records
//! (`templates`); the instance tree (`instances`); who listens to which events (`channels`); which
//! ports share a net (`nets`); links and frames (`links`); names (`names`). What comes out is
//! verified by the firmware's own code before anybody gets it.
//!
//! Equal models give equal bytes: nothing here depends on addresses, hash seeds or time.

mod channels;
mod code;
mod instances;
mod layout;
mod links;
mod names;
mod nets;
#[cfg(test)]
mod rules;
pub mod signature;
mod templates;
#[cfg(any(test, feature = "samples"))]
pub mod test_models;
#[cfg(test)]
mod tests;

use esm_core::format::{self, Envelope, MAX_SLOTS, Section};
use esm_core::layout::{Mission, Record, Short, Slot};
use esm_core::{Cause, Refusal};

use crate::model::{Container, Model, Span};
use crate::schedule::LaidOut;

/// Why a model cannot become a blob.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CompileError {
    /// The set of files has no machine.
    #[error("there is no machine to compile: add a `machine`, or name the file that has one")]
    NoMachine,
    /// The set of files does not say which slot runs the interpreter.
    #[error("no slot runs the interpreter: add `interpreter slot N;`")]
    NoInterpreterSlot,
    /// The machine has no region: nothing is wrong with it, and there is nothing to run.
    #[error(
        "machine `{machine}` has no region, so there is nothing to run: give it one, `region main {{ state Idle; initial -> Idle; }}`"
    )]
    NothingToRun {
        /// Name of the machine.
        machine: String,
    },
    /// Not as many start times as slots.
    #[error("{starts} start times were given for {slots} slots: give one for each")]
    StartTimes {
        /// Slots of the model.
        slots: usize,
        /// Start times given.
        starts: usize,
    },
    /// With these start times a slot would overlap with another.
    #[error(
        "slot {number} overlaps with a slot before it at these start times, or its numbers are out of range: search a schedule first"
    )]
    Schedule {
        /// The number of the slot.
        number: u32,
    },
    /// The machine needs more of something than a blob can hold.
    #[error(
        "the machine needs {found} {capacity}, a blob holds at most {limit}: split the mission or use fewer instances"
    )]
    Limit {
        /// What there is too much of.
        capacity: Capacity,
        /// How many the model needs, as far as it was counted.
        found: usize,
        /// How many there can be.
        limit: usize,
        /// The declaration with which it is too much; the machine as a whole where there is none.
        at: Option<Span>,
    },
    /// The model says something that checked files cannot say, such as a guard on a flag that its
    /// state does not have.
    #[error("the model contradicts itself in file {} at byte {}: check it before compiling", .0.file, .0.start)]
    Contradiction(Span),
    /// The verifier refuses what was compiled. A defect of the compiler: please report it with the
    /// files.
    #[error("the compiled blob was refused ({0:?}): this is a defect of the compiler")]
    Refused(Refusal),
}

/// What a blob's format limits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Capacity {
    /// Slots.
    Slots,
    /// Events.
    Events,
    /// Containers in use.
    Containers,
    /// Regions of all containers in use.
    Regions,
    /// States of all containers in use, pseudo-states included.
    States,
    /// Transitions of all containers in use.
    Transitions,
    /// Records of guards and actions.
    Code,
    /// Tests of one guard.
    GuardTests,
    /// Container instances.
    Instances,
    /// Region instances.
    RegionInstances,
    /// States of all instances, pseudo-states included.
    StateInstances,
    /// Task states of all instances.
    TaskInstances,
    /// Flag bits of all instances.
    Flags,
    /// Flags of one state.
    StateFlags,
    /// Pairs of a container instance and an event that it sends.
    Channels,
    /// Words of bits of those who listen to events.
    ListenerWords,
    /// Tasks in use.
    Tasks,
    /// Bytes of all signatures.
    SignatureBytes,
    /// Task states of all containers in use.
    TaskStates,
    /// Parameter values of all task states.
    Params,
    /// Data ports of all task instances.
    Ports,
    /// Nets.
    Nets,
    /// Links.
    Links,
    /// Frames of one link in one direction.
    Frames,
}

impl std::fmt::Display for Capacity {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Slots => "slots",
            Self::Events => "events",
            Self::Containers => "containers",
            Self::Regions => "regions",
            Self::States => "states",
            Self::Transitions => "transitions",
            Self::Code => "records of guards and actions",
            Self::GuardTests => "tests in one guard",
            Self::Instances => "container instances",
            Self::RegionInstances => "region instances",
            Self::StateInstances => "state instances",
            Self::TaskInstances => "task instances",
            Self::Flags => "flag bits",
            Self::StateFlags => "flags of one state",
            Self::Channels => "channels",
            Self::ListenerWords => "words of listeners",
            Self::Tasks => "tasks",
            Self::SignatureBytes => "bytes of task signatures",
            Self::TaskStates => "task states",
            Self::Params => "parameter values",
            Self::Ports => "data ports",
            Self::Nets => "nets",
            Self::Links => "links",
            Self::Frames => "frames of one link in one direction",
        })
    }
}

/// Records that a table addressed with 16 bits holds at most.
const MAX_RECORDS: usize = format::NONE as usize - 1;

/// A limit that is checked before `found` things are numbered.
fn within(capacity: Capacity, found: usize, limit: usize) -> Result<(), CompileError> {
    if found <= limit {
        Ok(())
    } else {
        Err(CompileError::Limit {
            capacity,
            found,
            limit,
            at: None,
        })
    }
}

impl CompileError {
    /// The same, with the declaration that exceeds a limit.
    fn at(self, declaration: Span) -> Self {
        match self {
            Self::Limit {
                capacity,
                found,
                limit,
                at: None,
            } => Self::Limit {
                capacity,
                found,
                limit,
                at: Some(declaration),
            },
            other => other,
        }
    }
}

/// A table in the making: records, one after another.
#[derive(Default)]
struct Table {
    bytes: Vec<u8>,
}

impl Table {
    /// Appends a record. Its numbers are within the limits that were checked before.
    fn push(&mut self, record: impl Record) {
        self.bytes.extend_from_slice(record.as_bytes());
    }

    /// The record that was appended last.
    fn last_mut<R: Record>(&mut self) -> Option<&mut R> {
        let found = R::mut_from_suffix(&mut self.bytes).ok();
        found.map(|(_, record)| record)
    }
}

/// Whether a blob gets its table of names. The firmware runs it with and without; traces, status
/// and scenarios need the names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NameTable {
    /// Names are in the blob.
    Kept,
    /// Only what signatures of tasks name is.
    LeftOut,
}

/// [`compile_with`] all names.
///
/// # Errors
/// See [`CompileError`].
pub fn compile<'s>(model: &Model, starts: impl Into<Starts<'s>>) -> Result<Vec<u8>, CompileError> {
    compile_with(model, starts, NameTable::Kept)
}

/// First starts of slots and frames in microseconds, in the order of the model: those of
/// [`Model::slots`], and for each link those of the frames that are sent.
#[derive(Clone, Copy, Debug)]
pub struct Starts<'s> {
    slots: &'s [u32],
    frames: &'s [Vec<u32>],
}

impl<'s> From<&'s LaidOut> for Starts<'s> {
    fn from(schedule: &'s LaidOut) -> Self {
        Starts {
            slots: &schedule.starts_us,
            frames: &schedule.frame_starts_us,
        }
    }
}

/// Of a model without links.
impl<'s> From<&'s [u32]> for Starts<'s> {
    fn from(slots: &'s [u32]) -> Self {
        Starts { slots, frames: &[] }
    }
}

impl<'s> From<&'s Vec<u32>> for Starts<'s> {
    fn from(slots: &'s Vec<u32>) -> Self {
        slots.as_slice().into()
    }
}

impl<'s, const COUNT: usize> From<&'s [u32; COUNT]> for Starts<'s> {
    fn from(slots: &'s [u32; COUNT]) -> Self {
        slots.as_slice().into()
    }
}

/// The machine, if it has no region. Nothing is wrong with it, and no blob holds it.
pub fn machine_without_regions(model: &Model) -> Option<&Container> {
    let machine = model.containers.get(model.machine?)?;
    machine.regions.is_empty().then_some(machine)
}

/// Compiles the machine of a model into a blob.
///
/// # Errors
/// See [`CompileError`].
pub fn compile_with<'s>(
    model: &Model,
    starts: impl Into<Starts<'s>>,
    name_table: NameTable,
) -> Result<Vec<u8>, CompileError> {
    let starts = starts.into();
    let starts_us = starts.slots;
    let machine = model.machine.ok_or(CompileError::NoMachine)?;
    let interpreter_slot = model
        .interpreter_slot
        .ok_or(CompileError::NoInterpreterSlot)?;
    if let Some(machine) = machine_without_regions(model) {
        return Err(CompileError::NothingToRun {
            machine: machine.name.clone(),
        });
    }
    if starts_us.len() != model.slots.len() {
        return Err(CompileError::StartTimes {
            slots: model.slots.len(),
            starts: starts_us.len(),
        });
    }
    let most_slots = usize::from(MAX_SLOTS);
    within(Capacity::Slots, model.slots.len(), most_slots).map_err(|error| {
        match model.slots.get(most_slots) {
            Some(slot) => error.at(slot.span),
            None => error,
        }
    })?;
    let mut slots = Table::default();
    for (slot, start_us) in model.slots.iter().zip(starts_us) {
        slots.push(Slot {
            number: slot.number.into(),
            period_us: slot.period_us.into(),
            duration_us: slot.duration_us.into(),
            start_us: (*start_us).into(),
        });
    }

    let layout = layout::Layout::of(model, machine)?;
    let tree = instances::Tree::of(model, &layout)?;
    let templates = templates::write(model, &layout, &tree)?;
    let channels = channels::write(model, &layout, &tree)?;
    let nets = nets::write(model, &layout, &tree, &templates)?;
    let names = match name_table {
        NameTable::Kept => names::write(model, &layout, &templates.groups),
        NameTable::LeftOut => Vec::new(),
    };
    let instances = tree.write();
    let communication = links::write(model, &templates, starts.frames)?;

    let mut mission = Table::default();
    mission.push(Mission {
        queue: Short::new(model.queue.into()),
        interpreter_slot: Short::new(interpreter_slot),
        events: Short::new(layout.events.len()),
        flags: Short::new(layout.root().spans.flags),
        exclusive_groups: Short::new(templates.groups.len()),
    });
    let envelope = Envelope {
        mission: &mission.bytes,
        slots: &slots.bytes,
        containers: &templates.containers.bytes,
        regions: &templates.regions.bytes,
        states: &templates.states.bytes,
        transitions: &templates.transitions.bytes,
        code: &templates.code.bytes,
        timers: &templates.timers.bytes,
        instances: &instances.instances.bytes,
        region_instances: &instances.region_instances.bytes,
        channels: &channels.channels.bytes,
        listeners: &channels.listeners.bytes,
        tasks: &templates.tasks.bytes,
        signatures: &templates.signatures,
        task_states: &templates.task_states.bytes,
        params: &templates.params.bytes,
        task_instances: &nets.task_instances.bytes,
        connections: &nets.connections.bytes,
        nets: &nets.nets.bytes,
        names: &names,
    };
    seal(model, &envelope, &communication)
}

/// Puts magic and CRC around the envelope, and lets the verifier have the last word.
fn seal(
    model: &Model,
    envelope: &Envelope<'_>,
    communication: &links::Tables,
) -> Result<Vec<u8>, CompileError> {
    let mut blob = format::MAGIC.to_vec();
    blob = postcard::to_extend(envelope, blob).map_err(|_| CompileError::Refused(Refusal::Cut))?;
    if let Some(communication) = communication.sections() {
        blob = postcard::to_extend(&communication, blob)
            .map_err(|_| CompileError::Refused(Refusal::Cut))?;
    }
    let crc = format::crc32(&blob);
    blob.extend_from_slice(&crc.to_le_bytes());
    match esm_core::verify(blob) {
        Ok(verified) => match esm_core::texts::check(&verified.tables())
            .and_then(|()| esm_core::frames::check(&verified.tables()))
        {
            Ok(()) => Ok(verified.into_bytes()),
            Err(refusal) => Err(CompileError::Refused(refusal)),
        },
        Err((_, refusal)) => Err(match refusal {
            Refusal::Record {
                section: Section::Slots,
                index,
                cause: Cause::Overlap | Cause::Range,
            } => CompileError::Schedule {
                number: model
                    .slots
                    .get(usize::from(index))
                    .map_or(0, |slot| slot.number),
            },
            refusal => CompileError::Refused(refusal),
        }),
    }
}
