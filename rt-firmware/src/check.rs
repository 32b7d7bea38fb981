//! Whether a robot can run a mission: does it have the tasks, and the room?

use core::ops::Deref;

use esm_core::Verified;
use esm_core::signature::PortCounts;
use esm_core::tables::Tables;

use crate::link::message::{Capacities, Capacity, LinkError};
use crate::ports::Registry;

/// Checks a valid blob against what the robot has.
///
/// # Errors
/// The first thing that is missing: a task, the same signature of it, enough tasks of a type, or room.
pub fn check<B: Deref<Target = [u8]>>(
    verified: &Verified<B>,
    registry: Registry<'_>,
    capacities: &Capacities,
) -> Result<(), LinkError> {
    let tables = verified.tables();
    for (index, task) in tables.tasks().enumerate() {
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
        // The verifier leaves texts alone: that a blob's counts are those of its text is only known from the task's own.
        let same = declared.signature.as_bytes() == task.signature.text()
            && declared.signature_hash == task.signature_hash
            && ports == task.ports;
        if !same {
            return Err(LinkError::SignatureDiffers { task: index as u16 });
        }
        let needed = instances_of(&tables, index);
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
    }
    let groups = tables
        .tasks()
        .filter_map(|task| task.exclusive)
        .max()
        .map_or(0, |greatest| usize::from(greatest) + 1);
    let needs = [
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
    ];
    for (what, needed, available) in needs {
        let needed = needed as u32;
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

/// Task instances of a task type.
fn instances_of(tables: &Tables<'_>, task: usize) -> usize {
    (0..tables.task_instance_count())
        .filter(|instance| {
            tables
                .task_state_of(*instance)
                .is_some_and(|state| state.task == task)
        })
        .count()
}
