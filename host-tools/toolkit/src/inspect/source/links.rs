//! Links and frames as text. Their names, and those of flags and types, are those of the
//! dispatchers' signatures.

use esm_core::frames::{RECEIVE_FLAGS, frames_of};
use esm_core::layout::{Frame, Link};
use esm_core::signature::Port;
use esm_core::tables::Tables;

use super::Reader;
use super::text::time;
use crate::inspect::reader::readable;

/// What stands where nothing is said.
const DEFAULT_HEADER_BYTES: u32 = 4;
const DEFAULT_BITS: u32 = 10;

/// What the flag is called with which a frame ends that is sent, or received.
const BY_ITSELF: [&str; 2] = ["_full", "_available"];

/// Whether a task is a dispatcher of a link.
pub(super) fn is_dispatcher(tables: &Tables<'_>, task: usize) -> bool {
    let mut links = tables.links().iter();
    links.any(|link| [link.transmit.index(), link.receive.index()].contains(&Some(task)))
}

/// A line for each link and each frame.
pub(super) fn lines(reader: &Reader<'_>) -> Vec<String> {
    let tables = &reader.tables;
    let mut lines = Vec::new();
    for (index, link) in tables.links().iter().enumerate() {
        let name = name(tables, link);
        lines.push(String::new());
        lines.push(declaration(&name, link));
        for (task, is_received) in [(link.transmit, false), (link.receive, true)] {
            let Some(task) = task.index() else { continue };
            let frames = frames_of(tables, index, is_received);
            lines.extend(frames_of_dispatcher(
                tables,
                task,
                &name,
                is_received,
                frames,
            ));
        }
    }
    lines
}

/// The name of a link: what its dispatchers' names begin with.
pub(crate) fn name(tables: &Tables<'_>, link: &Link) -> String {
    let task = link.transmit.index().or(link.receive.index());
    let task = task.and_then(|task| tables.task(task));
    let name = task.map_or_else(String::new, |task| readable(task.signature.name()));
    name.split('.').next().unwrap_or_default().to_owned()
}

fn declaration(name: &str, link: &Link) -> String {
    let mut line = format!("link {name} rate {} bps", link.rate_bps.get());
    if link.header_bytes() != DEFAULT_HEADER_BYTES {
        line += &format!(" header {} bytes", link.header_bytes());
    }
    if link.gap_us.get() != 0 {
        line += &format!(" gap {}", time(link.gap_us.get()));
    }
    if link.bits() != DEFAULT_BITS {
        line += &format!(" bits {}", link.bits());
    }
    line + ";"
}

fn frames_of_dispatcher<'t>(
    tables: &Tables<'t>,
    task: usize,
    link: &str,
    is_received: bool,
    frames: impl Iterator<Item = &'t Frame> + Clone,
) -> Vec<String> {
    let Some(task) = tables.task(task) else {
        return Vec::new();
    };
    let ports = task.signature.ports();
    let mut values = ports.clone().filter_map(|port| match port {
        Port::Data {
            name, type_name, ..
        } => Some((readable(name), readable(type_name))),
        _ => None,
    });
    let flags = ports.filter_map(|port| match port {
        Port::Flag { name, .. } => Some(readable(name)),
        _ => None,
    });
    let flags: Vec<String> = flags.collect();
    let carried: usize = frames.clone().map(|frame| frame.flags.get()).sum();
    let (mut carried, by_itself) = {
        let (carried, by_itself) = flags.split_at(carried.min(flags.len()));
        (carried.iter(), by_itself)
    };
    let (each, ending) = match is_received {
        true => (RECEIVE_FLAGS, BY_ITSELF[1]),
        false => (1, BY_ITSELF[0]),
    };
    let direction = if is_received { "in" } else { "out" };
    let mut lines = Vec::new();
    for (index, frame) in frames.enumerate() {
        let flag = by_itself.get(index * each).map_or("", String::as_str);
        let name = flag.strip_suffix(ending).unwrap_or_default();
        let content = match frame.flags.get() {
            0 => format!(": {}", values.next().unwrap_or_default().1),
            count => {
                let names: Vec<&str> = carried.by_ref().take(count).map(String::as_str).collect();
                format!(" flags {}", names.join(", "))
            }
        };
        let late = match frame.late_us.get() {
            0 => String::new(),
            late_us => format!(" late {}", time(late_us)),
        };
        lines.push(format!(
            "frame {name} {} {direction} on {link}{content} payload {} bytes period {}{late};",
            frame.identifier(),
            frame.payload.get(),
            time(frame.period_us.get()),
        ));
    }
    lines
}
