//! Links and frames as records: those of dispatchers that the mission uses.

use esm_core::format::{Communication, FRAME_IS_RECEIVED};
use esm_core::frames::{MAX_FRAMES, MAX_LINKS};
use esm_core::layout::{self as records, Short};
use esm_link::frames::configuration::{self, Configuration};

use super::templates::Templates;
use super::{Capacity, CompileError, Table, within};
use crate::model::{Content, Direction, Frame, Model};

/// The two sections.
#[derive(Default)]
pub(super) struct Tables {
    links: Table,
    frames: Table,
}

impl Tables {
    /// What follows the envelope; nothing in a mission without links.
    pub(super) fn sections(&self) -> Option<Communication<'_>> {
        (!self.links.bytes.is_empty()).then_some(Communication {
            links: &self.links.bytes,
            frames: &self.frames.bytes,
        })
    }
}

/// What a frame means: sender and receiver hold theirs against each other.
fn configuration(frame: &Frame) -> u64 {
    let content = match &frame.content {
        Content::Value(type_name) => configuration::Content::Value(type_name),
        Content::Flags(flags) => {
            // As many as fit the payload.
            configuration::Content::Flags(u16::try_from(flags.len()).unwrap_or(u16::MAX))
        }
    };
    let payload = frame.payload_bytes.unwrap_or(0);
    let period_us = frame.period_us.unwrap_or(0);
    Configuration::of(frame.id, content, payload, period_us).hash()
}

/// Writes the links whose dispatchers are used, with the frames of these. `starts_us` has, for each
/// link of the model, the first start of each frame that is sent.
pub(super) fn write(
    model: &Model,
    templates: &Templates,
    starts_us: &[Vec<u32>],
) -> Result<Tables, CompileError> {
    let mut tables = Tables::default();
    let mut number = 0;
    for (index, link) in model.links.iter().enumerate() {
        let transmit = templates.task_number(link.transmit);
        let receive = templates.task_number(link.receive);
        if transmit.is_none() && receive.is_none() {
            continue;
        }
        within(Capacity::Links, number + 1, MAX_LINKS)
            .map_err(|error| error.at(link.declaration))?;
        let header_and_bits = u16::from_le_bytes([link.header_bytes, link.bits]);
        tables.links.push(records::Link {
            rate_bps: link.rate_bps.unwrap_or(1).into(),
            gap_us: link.gap_us.into(),
            header_and_bits: header_and_bits.into(),
            transmit: Short::optional(transmit),
            receive: Short::optional(receive),
            reserved: 0.into(),
        });
        let starts = starts_us.get(index).map_or(&[][..], Vec::as_slice);
        let sent = model.frames_out(index).count();
        if sent != starts.len() {
            return Err(CompileError::StartTimes {
                slots: sent,
                starts: starts.len(),
            });
        }
        if transmit.is_some() {
            within(Capacity::Frames, sent, MAX_FRAMES)
                .map_err(|error| error.at(link.declaration))?;
            for (frame, &start_us) in model.frames_out(index).zip(starts) {
                tables.frames.push(record(frame, number, start_us));
            }
        }
        if receive.is_some() {
            let received = model
                .frames
                .iter()
                .filter(|frame| frame.link == index && frame.direction == Direction::In);
            within(Capacity::Frames, received.clone().count(), MAX_FRAMES)
                .map_err(|error| error.at(link.declaration))?;
            received.for_each(|frame| tables.frames.push(record(frame, number, 0)));
        }
        number += 1;
    }
    Ok(tables)
}

fn record(frame: &Frame, link: usize, start_us: u32) -> records::Frame {
    let received = match frame.direction {
        Direction::Out => 0,
        _ => FRAME_IS_RECEIVED,
    };
    let flags = match &frame.content {
        Content::Value(_) => 0,
        Content::Flags(flags) => flags.len(),
    };
    records::Frame {
        configuration: configuration(frame).into(),
        period_us: frame.period_us.unwrap_or(1).into(),
        start_us: start_us.into(),
        late_us: frame.late_us.unwrap_or(0).into(),
        id: (frame.id | received).into(),
        link: Short::new(link),
        payload: Short::new(frame.payload_bytes.unwrap_or(0).into()),
        flags: Short::new(flags),
    }
}
