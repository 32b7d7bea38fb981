//! The table of a mission's links and frames: what a firmware with links must know of it before it
//! sends anything.
//!
//! [`verify`](crate::verify()) looks only at the lengths of the two sections, since most firmware
//! has no links. One that has calls [`check`], as tools do.

use zerocopy::little_endian::U32;

use crate::format::{FRAME_IS_RECEIVED, MAX_TIME_US, Section};
use crate::layout::{Frame, Link, Short, Slot};
use crate::refusal::{Cause, Refusal};
use crate::tables::Tables;
use crate::verify::are_apart;

/// The most links of a mission.
pub const MAX_LINKS: usize = 64;
/// The greatest identifier of a frame: 11 bits.
pub const MAX_ID: u16 = 2_047;
/// The most frames of one link in one direction.
pub const MAX_FRAMES: usize = 64;
/// The longest payload, in bytes.
pub const MAX_PAYLOAD_BYTES: usize = 240;
/// Bytes of the checksum behind a payload.
pub const CHECKSUM_BYTES: u32 = 4;
/// The fastest link, in bits a second.
pub const MAX_RATE_BPS: u32 = 100_000_000;
/// The most bits that a byte takes on a wire.
pub const MAX_BITS: u32 = 20;
/// A received value is late after so many periods, where nothing else is said.
pub const LATE_PERIODS: u64 = 3;
/// Flags that come by themselves with each frame that is received: `available` and `delayed`.
pub const RECEIVE_FLAGS: usize = 2;

const US_PER_SECOND: u64 = 1_000_000;

impl Link {
    /// What medium and identifier take of a frame, in bytes.
    #[must_use]
    pub const fn header_bytes(&self) -> u32 {
        (self.header_and_bits.get() & 0xFF) as u32
    }

    /// Bits that a byte takes on the wire.
    #[must_use]
    pub const fn bits(&self) -> u32 {
        (self.header_and_bits.get() >> 8) as u32
    }

    /// How long a frame with this payload takes, with the gap behind it, in microseconds.
    #[must_use]
    pub fn duration_us(&self, payload_bytes: usize) -> u64 {
        let bytes = self.header_bytes() + payload_bytes as u32;
        duration_us(bytes, self.bits(), self.rate_bps.get(), self.gap_us.get())
    }
}

/// How long a frame of so many bytes, header and payload, takes on a link with its checksum and the
/// gap behind it: in microseconds, rounded up.
#[must_use]
pub fn duration_us(bytes: u32, bits: u32, rate_bps: u32, gap_us: u32) -> u64 {
    let bits = u64::from(bytes + CHECKSUM_BYTES) * u64::from(bits);
    (bits * US_PER_SECOND).div_ceil(u64::from(rate_bps.max(1))) + u64::from(gap_us)
}

impl Frame {
    /// Its identifier.
    #[must_use]
    pub const fn identifier(&self) -> u16 {
        self.id.get() & !FRAME_IS_RECEIVED
    }

    /// Whether it is received.
    #[must_use]
    pub const fn is_received(&self) -> bool {
        self.id.get() & FRAME_IS_RECEIVED != 0
    }

    /// How old a received value may be, in microseconds.
    #[must_use]
    pub fn late_us(&self) -> u64 {
        match self.late_us.get() {
            0 => LATE_PERIODS * u64::from(self.period_us.get()),
            late_us => u64::from(late_us),
        }
    }

    /// Flags of its dispatcher that come by themselves with it.
    #[must_use]
    pub const fn flags_by_itself(&self) -> usize {
        if self.is_received() { RECEIVE_FLAGS } else { 1 }
    }
}

/// The frames of one link in one direction.
pub fn frames_of<'a>(
    tables: &Tables<'a>,
    link: usize,
    is_received: bool,
) -> impl Iterator<Item = &'a Frame> + Clone + use<'a> {
    (tables.frames().iter())
        .filter(move |frame| frame.link.get() == link && frame.is_received() == is_received)
}

/// Whether a task of a mission is a dispatcher: of which link, and whether it receives.
#[must_use]
pub fn dispatcher_of(tables: &Tables<'_>, task: usize) -> Option<(usize, bool)> {
    for (index, link) in tables.links().iter().enumerate() {
        for (dispatcher, is_received) in [(link.transmit, false), (link.receive, true)] {
            if dispatcher.index() == Some(task) {
                return Some((index, is_received));
            }
        }
    }
    None
}

fn wrong(section: Section, index: usize, cause: Cause) -> Refusal {
    Refusal::Record {
        section,
        index: index as u16,
        cause,
    }
}

/// Checks links and frames of a verified blob: every number is in its range, frames stand in their
/// order and have identifiers of their own, those of a link are never due at once, and dispatchers
/// have the ports and flags of their frames.
///
/// # Errors
/// The first record that is wrong.
pub fn check(tables: &Tables<'_>) -> Result<(), Refusal> {
    if tables.links().len() > MAX_LINKS {
        return Err(wrong(Section::Links, MAX_LINKS, Cause::Range));
    }
    for (index, link) in tables.links().iter().enumerate() {
        let is_right = (1..=MAX_RATE_BPS).contains(&link.rate_bps.get())
            && link.gap_us.get() <= MAX_TIME_US
            && (1..=MAX_BITS).contains(&link.bits())
            && link.reserved.get() == 0;
        if !is_right {
            return Err(wrong(Section::Links, index, Cause::Range));
        }
        check_dispatcher(tables, index, link.transmit, false)?;
        check_dispatcher(tables, index, link.receive, true)?;
        check_times(tables, index, link)?;
    }
    let mut before = (0, false);
    for (index, frame) in tables.frames().iter().enumerate() {
        check_frame(tables, index, frame)?;
        let place = (frame.link.get(), frame.is_received());
        if place < before {
            return Err(wrong(Section::Frames, index, Cause::Order));
        }
        before = place;
    }
    Ok(())
}

fn check_frame(tables: &Tables<'_>, index: usize, frame: &Frame) -> Result<(), Refusal> {
    let payload = frame.payload.get();
    let period_us = frame.period_us.get();
    let start_us = frame.start_us.get();
    let is_right = frame.identifier() <= MAX_ID
        && (1..=MAX_PAYLOAD_BYTES).contains(&payload)
        && frame.flags.get() <= payload * u8::BITS as usize
        && (1..=MAX_TIME_US).contains(&period_us)
        && frame.late_us.get() <= MAX_TIME_US
        && start_us < period_us
        && (!frame.is_received() || start_us == 0);
    if !is_right {
        return Err(wrong(Section::Frames, index, Cause::Range));
    }
    if frame.link.get() >= tables.links().len() {
        return Err(wrong(Section::Frames, index, Cause::Index));
    }
    // Those of a dispatcher stand together and are few.
    let earlier = tables.frames().iter().take(index).rev();
    let is_twin = earlier
        .take_while(|other| other.link == frame.link)
        .any(|other| other.id == frame.id);
    match is_twin {
        true => Err(wrong(Section::Frames, index, Cause::Range)),
        false => Ok(()),
    }
}

/// Checks that a dispatcher's task is there where it has frames, with their ports and flags.
fn check_dispatcher(
    tables: &Tables<'_>,
    link: usize,
    task: Short,
    is_received: bool,
) -> Result<(), Refusal> {
    let frames = frames_of(tables, link, is_received);
    let count = frames.clone().count();
    if count > MAX_FRAMES {
        return Err(wrong(Section::Links, link, Cause::Range));
    }
    let Some(task) = task.index() else {
        return match count {
            0 => Ok(()),
            _ => Err(wrong(Section::Links, link, Cause::Index)),
        };
    };
    let Some(task) = tables.task(task) else {
        return Err(wrong(Section::Links, link, Cause::Index));
    };
    let values = frames
        .clone()
        .filter(|frame| frame.flags.get() == 0)
        .count();
    let flags: usize = frames
        .map(|frame| frame.flags.get() + frame.flags_by_itself())
        .sum();
    let errors = usize::from(is_received);
    let ports = task.ports;
    let is_right = ports.data == values && ports.flags == flags + errors && ports.params == 0;
    match is_right {
        true => Ok(()),
        false => Err(wrong(Section::Links, link, Cause::Type)),
    }
}

/// Checks that the frames that a link sends are never on it together.
fn check_times(tables: &Tables<'_>, index: usize, link: &Link) -> Result<(), Refusal> {
    const NONE: Slot = Slot {
        number: U32::ZERO,
        period_us: U32::ZERO,
        duration_us: U32::ZERO,
        start_us: U32::ZERO,
    };
    let mut times = [NONE; MAX_FRAMES];
    let mut count = 0;
    for (time, frame) in times.iter_mut().zip(frames_of(tables, index, false)) {
        count += 1;
        let duration_us = link.duration_us(frame.payload.get());
        let Ok(duration_us) = u32::try_from(duration_us) else {
            return Err(wrong(Section::Links, index, Cause::Overlap));
        };
        *time = Slot {
            number: count.into(),
            period_us: frame.period_us,
            duration_us: duration_us.into(),
            start_us: frame.start_us,
        };
    }
    let times = times.get(..count as usize).unwrap_or_default();
    match are_apart(times) {
        true => Ok(()),
        false => Err(wrong(Section::Links, index, Cause::Overlap)),
    }
}
