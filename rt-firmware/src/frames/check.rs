//! Whether a firmware can serve the links of a mission.

use esm_core::frames::{self, dispatcher_of, frames_of};
use esm_core::layout::Frame;
use esm_core::signature::{Direction, Port, Signature};
use esm_core::tables::Tables;

use super::limits::{FRAMES, LINKS};
use crate::declaration::ValueKind;
use crate::ports::{AnyTaskPool, Executor, Registry};
use crate::received_value::VALUE_BYTES;
use esm_link::message::{Capacity, LinkError};

/// The type of this name that a task of the robot has.
pub(crate) fn kind_of(registry: Registry<'_>, type_name: &[u8]) -> Option<ValueKind> {
    let mut ports = registry.declarations().flat_map(|declared| declared.ports);
    let port = ports.find(|port| port.type_name().as_bytes() == type_name)?;
    Some(port.kind)
}

/// What values of the type of this name are made of: a line a field, its name, `:`, its type. None
/// where no task of these banks has such a type, or this firmware does not know.
#[must_use]
pub fn fields_of(banks: &[&mut (dyn AnyTaskPool + '_)], type_name: &str) -> Option<&'static str> {
    let mut ports = (banks.iter()).flat_map(|bank| bank.declaration().ports);
    let port = ports.find(|port| port.type_name() == type_name)?;
    Executor::fields_of(port.kind)
}

/// Checks the links of a verified blob: their table, that there is room for them, the signatures of
/// their dispatchers, and that each value fits its payload. Whether ports are on nets of their
/// types is asked as of any task.
///
/// # Errors
/// What cannot be served.
// Not inlined: what it needs of the stack is not needed with anything else.
#[inline(never)]
pub fn check(tables: &Tables<'_>, registry: Registry<'_>) -> Result<(), LinkError> {
    if tables.links().is_empty() && tables.frames().is_empty() {
        return Ok(());
    }
    for (what, needed, available) in [
        (Capacity::Links, tables.links().len(), LINKS),
        (Capacity::Frames, tables.frames().len(), FRAMES),
    ] {
        if needed > available {
            return Err(LinkError::CapacityExceeded {
                what,
                needed: needed as u32,
                available: available as u32,
            });
        }
    }
    frames::check(tables).map_err(LinkError::Invalid)?;
    for (task, declared) in tables.tasks().enumerate() {
        let Some((link, is_received)) = dispatcher_of(tables, task) else {
            continue;
        };
        let differs = LinkError::SignatureDiffers { task: task as u16 };
        let frames = frames_of(tables, link, is_received);
        let carried: usize = frames.clone().map(|frame| frame.flags.get()).sum();
        // The hash and the counts are what the text says, and so are directions.
        let is_right = declared.signature.counts() == Some(declared.ports)
            && declared.signature.hash() == declared.signature_hash
            && has_directions(declared.signature, is_received, carried);
        if !is_right {
            return Err(differs);
        }
        let values = frames.filter(|frame| frame.flags.get() == 0);
        for (frame, type_name) in values.zip(declared.signature.data_types()) {
            check_value(registry, frame, type_name).map_err(|needed| {
                LinkError::PayloadDiffers {
                    frame: place_of(tables, frame),
                    needed,
                }
            })?;
        }
    }
    Ok(())
}

fn place_of(tables: &Tables<'_>, frame: &Frame) -> u16 {
    let mut frames = tables.frames().iter();
    let place = frames.position(|other| core::ptr::eq(other, frame));
    place.unwrap_or(0) as u16
}

/// Whether ports and flags have the directions of a dispatcher, of which so many flags are carried.
fn has_directions(signature: Signature<'_>, is_received: bool, carried: usize) -> bool {
    let into = match is_received {
        true => Direction::Out,
        false => Direction::In,
    };
    let mut flags = 0;
    signature.ports().all(|port| match port {
        Port::Data {
            direction,
            optional,
            within_us,
            ..
        } => direction == into && optional != is_received && within_us == 0,
        Port::Flag { direction, .. } => {
            flags += 1;
            let is_carried = flags <= carried;
            direction == if is_carried { into } else { Direction::Out }
        }
        Port::Param { .. } => false,
    })
}

/// Whether a value fits the payload of its frame; else how long it is, 0 where nobody knows it.
fn check_value(registry: Registry<'_>, frame: &Frame, type_name: &[u8]) -> Result<(), u16> {
    let codec = kind_of(registry, type_name).ok_or(0_u16)?.codec();
    let fits = codec.buffer_bytes <= VALUE_BYTES && codec.buffer_align <= align_of::<u64>();
    match codec.payload_bytes {
        bytes if bytes == frame.payload.get() && fits => Ok(()),
        bytes => Err(bytes as u16),
    }
}
