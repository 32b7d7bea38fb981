//! Links and frames of a blob. Their names, and those of flags and types, are those of the
//! dispatchers' signatures.

use esm_core::frames::{RECEIVE_FLAGS, frames_of};
use esm_core::layout::{Frame, Link};
use esm_core::signature::Port;
use esm_core::tables::Tables;
use serde::Serialize;

use super::reader::readable;

/// What the flag is called with which a frame ends that is sent, or received.
const BY_ITSELF: [&str; 2] = ["_full", "_available"];

/// A link.
#[derive(Clone, Debug, Serialize)]
pub struct LinkRow {
    /// Its name.
    pub link: String,
    /// Bits a second.
    pub rate_bps: u32,
    /// What medium and identifier take of a frame.
    pub header_bytes: u32,
    /// Silence between two frames, in microseconds.
    pub gap_us: u32,
    /// Bits that a byte takes on the wire.
    pub bits: u32,
    /// Its frames: those that are sent, then those that are received.
    pub frames: Vec<FrameRow>,
}

/// A frame.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FrameRow {
    /// Its name.
    pub frame: String,
    /// Its identifier.
    pub id: u16,
    /// `out` or `in`.
    pub direction: &'static str,
    /// The type of the value that it carries.
    #[serde(rename = "type")]
    pub type_name: Option<String>,
    /// The flags that it carries, the first in the lowest bit.
    pub flags: Vec<String>,
    /// Bytes of its payload.
    pub payload_bytes: usize,
    /// Its period in microseconds.
    pub period_us: u32,
    /// Its first start in microseconds, where it is sent.
    pub start_us: Option<u32>,
    /// How old a received value may be in microseconds, where that is not three periods.
    pub late_us: Option<u32>,
    /// Its configuration, 16 hexadecimal digits.
    pub configuration: String,
}

/// The links of a blob.
pub(crate) fn rows(tables: &Tables<'_>) -> Vec<LinkRow> {
    let of_link = |(index, link): (usize, &Link)| LinkRow {
        link: name(tables, link),
        rate_bps: link.rate_bps.get(),
        header_bytes: link.header_bytes(),
        gap_us: link.gap_us.get(),
        bits: link.bits(),
        frames: [(link.transmit, false), (link.receive, true)]
            .into_iter()
            .filter_map(|(task, is_received)| Some((task.index()?, is_received)))
            .flat_map(|(task, is_received)| frames(tables, index, task, is_received))
            .collect(),
    };
    tables.links().iter().enumerate().map(of_link).collect()
}

/// The name of a link: what its dispatchers' names begin with.
fn name(tables: &Tables<'_>, link: &Link) -> String {
    let task = link.transmit.index().or(link.receive.index());
    let task = task.and_then(|task| tables.task(task));
    let name = task.map_or_else(String::new, |task| readable(task.signature.name()));
    name.split('.').next().unwrap_or_default().to_owned()
}

fn frames(tables: &Tables<'_>, link: usize, task: usize, is_received: bool) -> Vec<FrameRow> {
    let Some(task) = tables.task(task) else {
        return Vec::new();
    };
    let frames = frames_of(tables, link, is_received);
    let ports = task.signature.ports();
    let mut types = task.signature.data_types().map(readable);
    let flags = ports.filter_map(|port| match port {
        Port::Flag { name, .. } => Some(readable(name)),
        _ => None,
    });
    let flags: Vec<String> = flags.collect();
    let carried: usize = frames.clone().map(|frame| frame.flags.get()).sum();
    let (carried, by_itself) = flags.split_at(carried.min(flags.len()));
    let mut carried = carried.iter();
    let (each, ending, direction) = match is_received {
        true => (RECEIVE_FLAGS, BY_ITSELF[1], "in"),
        false => (1, BY_ITSELF[0], "out"),
    };
    let row = |(index, frame): (usize, &Frame)| {
        let flag = by_itself.get(index * each).map_or("", String::as_str);
        let flags = frame.flags.get();
        FrameRow {
            frame: flag.strip_suffix(ending).unwrap_or_default().to_owned(),
            id: frame.identifier(),
            direction,
            type_name: match flags {
                0 => types.next(),
                _ => None,
            },
            flags: carried.by_ref().take(flags).cloned().collect(),
            payload_bytes: frame.payload.get(),
            period_us: frame.period_us.get(),
            start_us: (!is_received).then(|| frame.start_us.get()),
            late_us: Some(frame.late_us.get()).filter(|late_us| *late_us > 0),
            configuration: format!("{:016x}", frame.configuration.get()),
        }
    };
    frames.enumerate().map(row).collect()
}
