//! Whether a robot can run a mission: does it have the tasks, and the room?

use core::ops::Deref;

use esm_core::Verified;
use esm_core::format::{MAGIC, Section};
use esm_core::frames::dispatcher_of;
use esm_core::signature::{PortCounts, fnv1a};
use esm_core::tables::{Tables, record_bytes};

use crate::frames::{self, LINKS};
use crate::ports::Registry;
use crate::task::Declaration;
use esm_link::message::{Capacities, Capacity, LinkError};

/// Checks a valid blob against what the robot has.
///
/// # Errors
/// The first thing that is missing: a task, the same signature of it, enough tasks of a type,
/// values that a port or parameter can take, or room.
// Not inlined: the verifier, which goes deeper, should not run on top of what this needs of the
// stack.
#[inline(never)]
pub fn check<B: Deref<Target = [u8]>>(
    verified: &Verified<B>,
    registry: Registry<'_>,
    capacities: &Capacities,
) -> Result<(), LinkError> {
    let tables = verified.tables();
    frames::check(&tables, registry)?;
    for (index, task) in tables.tasks().enumerate() {
        if LINKS > 0 && dispatcher_of(&tables, index).is_some() {
            let types = task.signature.data_types();
            check_nets(&tables, index, task.signature_hash, types)?;
            continue;
        }
        let name = task.signature.name();
        let Some(declared) = registry
            .declarations()
            .find(|declared| declared.name.as_bytes() == name)
        else {
            return Err(LinkError::UnknownTask { task: index as u16 });
        };
        let ports = PortCounts {
            data: declared.ports.len(),
            flags: declared.flags.len(),
            params: declared.params.len(),
        };
        // The verifier leaves texts alone: that a blob's counts are those of its text is only known
        // from the task's own.
        let same = declared.has_signature(task.signature.text())
            && declared.signature_hash == task.signature_hash
            && ports == task.ports;
        if !same {
            return Err(LinkError::SignatureDiffers { task: index as u16 });
        }
        // Counted by signature: two entries of the blob may stand for one task of the robot.
        let needed = task_instances_of(&tables, task.signature_hash).count();
        let available = registry
            .find(task.signature_hash)
            .map_or(0, |bank| registry.capacity(usize::from(bank)));
        if needed > available {
            return Err(LinkError::TooManyInstances {
                task: index as u16,
                needed: needed as u16,
                available: available as u16,
            });
        }
        let types = declared
            .ports
            .iter()
            .map(|port| port.type_name().as_bytes());
        check_nets(&tables, index, task.signature_hash, types)?;
        check_params(&tables, index, task.signature_hash, declared)?;
    }
    for Need {
        what,
        needed,
        available,
    } in needs(verified, capacities)
    {
        if needed > available {
            return Err(LinkError::CapacityExceeded {
                what,
                needed,
                available,
            });
        }
    }
    Ok(())
}

/// Whether a blob that nobody has checked has more slots than the robot. Each pair of slots costs
/// the verifier time, and a robot checks while its mission runs: what it could not run anyway must
/// not keep its link from its turn until the watchdog bites.
///
/// # Errors
/// [`LinkError::CapacityExceeded`]. A blob that cannot be read so far is left to the verifier,
/// which says what is wrong with it.
pub fn check_slots(blob: &[u8], capacities: &Capacities) -> Result<(), LinkError> {
    let sections = blob.get(MAGIC.len()..).unwrap_or_default();
    let slots = postcard::take_from_bytes::<(&[u8], &[u8])>(sections)
        .map_or(0, |((_mission, slots), _)| {
            slots.len() / record_bytes(Section::Slots)
        });
    let available = u32::from(capacities.slots);
    if slots as u32 > available {
        return Err(LinkError::CapacityExceeded {
            what: Capacity::Slots,
            needed: slots as u32,
            available,
        });
    }
    Ok(())
}

/// What a mission needs of one of a robot's [`Capacities`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Need {
    /// Of what.
    pub what: Capacity,
    /// How much the mission needs.
    pub needed: u32,
    /// How much the robot has.
    pub available: u32,
}

/// What a valid blob needs of each capacity. A robot takes it only if all of it is there; tools
/// that know a robot's capacities ask here whether it will.
#[inline(never)] // Its tables are off the stack again before anything deeper is called.
pub fn needs<B: Deref<Target = [u8]>>(
    verified: &Verified<B>,
    capacities: &Capacities,
) -> [Need; CAPACITIES] {
    let tables = verified.tables();
    let groups = tables
        .tasks()
        .filter_map(|task| task.exclusive)
        .max()
        .map_or(0, |greatest| usize::from(greatest) + 1);
    [
        (
            Capacity::BlobBytes,
            verified.bytes().len(),
            capacities.blob_bytes,
        ),
        (
            Capacity::ArenaWords,
            verified.arena_words(),
            capacities.arena_words,
        ),
        (
            Capacity::Slots,
            tables.slots().len(),
            u32::from(capacities.slots),
        ),
        (
            Capacity::TaskInstances,
            tables.task_instance_count(),
            u32::from(capacities.task_instances),
        ),
        (
            Capacity::Nets,
            tables.net_count(),
            u32::from(capacities.nets),
        ),
        (
            Capacity::ExclusiveGroups,
            groups,
            u32::from(capacities.exclusive_groups),
        ),
    ]
    .map(|(what, needed, available)| Need {
        what,
        needed: needed as u32,
        available,
    })
}

/// How many [`Capacity`]s there are.
const CAPACITIES: usize = 6;

/// The task instances of all tasks with this signature.
fn task_instances_of(tables: &Tables<'_>, signature_hash: u64) -> impl Iterator<Item = usize> {
    (0..tables.task_instance_count()).filter(move |instance| {
        tables
            .task_state_of(*instance)
            .and_then(|state| tables.task(state.task))
            .is_some_and(|task| task.signature_hash == signature_hash)
    })
}

/// Whether each port of a task is on nets of its own type: a value must never reach a port that
/// takes it for something else. `types` are those of its ports, in order.
fn check_nets<'t>(
    tables: &Tables<'_>,
    task: usize,
    signature_hash: u64,
    types: impl Iterator<Item = &'t [u8]>,
) -> Result<(), LinkError> {
    for (port, type_name) in types.enumerate() {
        let type_hash = fnv1a(type_name);
        let fits = task_instances_of(tables, signature_hash).all(|instance| {
            tables
                .task_instance(instance)
                .and_then(|instance| tables.connection(instance.first_connection + port))
                .flatten()
                .and_then(|net| tables.net(net))
                .is_none_or(|net| net.type_hash == type_hash)
        });
        if !fits {
            return Err(LinkError::NetTypeDiffers {
                task: task as u16,
                port: port as u16,
            });
        }
    }
    Ok(())
}

/// Whether each parameter is within the bounds that the firmware's own task gives it, whatever the
/// mission's text said of them.
fn check_params(
    tables: &Tables<'_>,
    task: usize,
    signature_hash: u64,
    declared: &Declaration,
) -> Result<(), LinkError> {
    for (index, param) in declared.params.iter().enumerate() {
        let fits = task_instances_of(tables, signature_hash).all(|instance| {
            tables
                .task_state_of(instance)
                .and_then(|state| tables.param(state.first_param + index))
                .is_some_and(|bits| param.admits(bits))
        });
        if !fits {
            return Err(LinkError::ParamOutOfRange {
                task: task as u16,
                param: index as u16,
            });
        }
    }
    Ok(())
}
