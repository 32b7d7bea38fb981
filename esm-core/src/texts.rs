//! Names and signatures: what people and task registries read of a blob, and the interpreter never
//! does.
//!
//! [`verify`](crate::verify()) leaves texts alone but for where they begin and end. A firmware
//! compares each signature, letter by letter, with that of its own task, and its own task's ports
//! with the counts and the nets' types that the blob gives; that covers all but the names and takes
//! less flash. Host tools, which have no tasks to compare with, call [`check`] instead.

use crate::format::Section;
use crate::refusal::{Cause, Refusal};
use crate::signature::{fnv1a, is_identifier_part};
use crate::tables::Tables;

/// Checks the texts of a verified blob: signatures are well formed, with the hash and the counts
/// that the blob gives them; ports on one net have one type; and a name table, where there is one,
/// names everything.
///
/// # Errors
/// The first record that is wrong.
pub fn check(tables: &Tables<'_>) -> Result<(), Refusal> {
    for (index, task) in tables.tasks().enumerate() {
        let right = task.signature.counts() == Some(task.ports)
            && task.signature.hash() == task.signature_hash;
        ensure(right, Section::Tasks, index, Cause::Text)?;
    }
    for task_instance in 0..tables.task_instance_count() {
        check_net_types(tables, task_instance)?;
    }
    check_names(tables)
}

fn ensure(holds: bool, section: Section, index: usize, cause: Cause) -> Result<(), Refusal> {
    if holds {
        return Ok(());
    }
    Err(Refusal::Record {
        section,
        index: index as u16,
        cause,
    })
}

/// Checks that each port of a task instance has the type of its net.
fn check_net_types(tables: &Tables<'_>, task_instance: usize) -> Result<(), Refusal> {
    let task = tables
        .task_state_of(task_instance)
        .and_then(|task_state| tables.task(task_state.task));
    let first = tables
        .task_instance(task_instance)
        .map_or(0, |instance| instance.first_connection);
    let types = task
        .into_iter()
        .flat_map(|task| task.signature.data_types());
    for (type_name, index) in types.zip(first..) {
        let net = tables.connection(index).flatten();
        let same_type = net
            .and_then(|net| tables.net(net))
            .is_none_or(|net| net.type_hash == fnv1a(type_name));
        ensure(same_type, Section::Connections, index, Cause::Type)?;
    }
    Ok(())
}

/// Checks that a name table is whole or absent.
fn check_names(tables: &Tables<'_>) -> Result<(), Refusal> {
    let Some(mut names) = tables.names() else {
        return Ok(());
    };
    // A region has one name of its own and none for its two pseudo-states.
    let of_regions = tables.state_count() - tables.regions().len();
    let of_flags: usize = tables.containers().map(|container| container.flags).sum();
    let expected = tables.event_count()
        + tables.containers().len()
        + of_flags
        + of_regions
        + tables.exclusive_group_count();
    let mut count = 0;
    for name in names.by_ref() {
        let is_identifier = !name.is_empty() && name.iter().copied().all(is_identifier_part);
        ensure(is_identifier, Section::Names, count, Cause::Text)?;
        count += 1;
    }
    let is_whole = count == expected && names.is_at_end();
    ensure(is_whole, Section::Names, count, Cause::Order)
}
