//! What is kept for each frame of a mission: found once, when the mission is staged, and what is
//! known of its last occurrences.

use core::cell::Cell;

use esm_core::frames::frames_of;
use esm_core::layout::Frame;
use esm_core::tables::Tables;
use esm_link::frames::configuration::Configuration;
use esm_link::frames::occurrences::Occurrences;
use esm_link::frames::receiver::{InFrame, InFrames};
use zerocopy::IntoBytes;

use super::check::kind_of;
use super::limits::LINKS;
use crate::declaration::ValueKind;
use crate::ports::Registry;

/// A frame.
#[derive(Clone)]
pub(crate) struct FrameEntry {
    /// What the blob says of it.
    pub(super) record: Option<Frame>,
    pub(super) configuration: Option<Configuration>,
    /// What a received payload is read as.
    pub(super) kind: Option<ValueKind>,
    /// Its data port among those of its dispatcher.
    pub(super) port: u8,
    /// The first of the flags that it carries, and of those that come by themselves.
    pub(super) carried: u16,
    pub(super) by_itself: u16,
    /// The net of its data port, of the task instance that its dispatcher was executed for last.
    pub(super) net: Cell<u16>,
    pub(super) state: FrameState,
}

/// No net.
pub(super) const NO_NET: u16 = u16::MAX;

/// What is known of the last occurrences of a frame. Who receives looks for frames while it changes
/// them.
#[derive(Clone)]
pub(crate) struct FrameState {
    /// Of a frame that is sent: start of the next occurrence. Of one that is received: the
    /// activation at which the last one came, or when the state was entered.
    pub(super) at_us: Cell<u64>,
    /// Number of the next occurrence that is sent.
    pub(super) number: Cell<u8>,
    /// What is received.
    pub(super) occurrences: Cell<Occurrences>,
    /// One has come in the activation that is under way.
    pub(super) has_come: Cell<bool>,
    /// Which of the flags that come by themselves are set.
    pub(super) is_full: Cell<bool>,
    pub(super) is_available: Cell<bool>,
    pub(super) is_delayed: Cell<bool>,
    /// How many were sent, or came as they should.
    pub(super) passed: Cell<u32>,
    /// How many were not sent for lack of room.
    pub(super) unsent: Cell<u32>,
    /// How many were overtaken by a newer one.
    pub(super) older: Cell<u32>,
}

impl FrameEntry {
    #[expect(
        clippy::declare_interior_mutable_const,
        reason = "it is what the memory is made of, not a value to share"
    )]
    pub(crate) const EMPTY: Self = FrameEntry {
        record: None,
        configuration: None,
        kind: None,
        port: 0,
        carried: 0,
        by_itself: 0,
        // Found before anybody looks; zeros take no flash.
        net: Cell::new(0),
        state: FrameState::NEW,
    };

    /// Whether another entry is of the same frame, declared in the same way.
    pub(super) fn is_same(&self, other: &FrameEntry) -> bool {
        match (&self.record, &other.record) {
            (Some(record), Some(other)) => record.as_bytes() == other.as_bytes(),
            _ => false,
        }
    }
}

impl FrameState {
    #[expect(
        clippy::declare_interior_mutable_const,
        reason = "it is what the memory is made of, not a value to share"
    )]
    pub(super) const NEW: Self = FrameState {
        at_us: Cell::new(0),
        number: Cell::new(0),
        occurrences: Cell::new(Occurrences::new()),
        has_come: Cell::new(false),
        is_full: Cell::new(false),
        is_available: Cell::new(false),
        is_delayed: Cell::new(false),
        passed: Cell::new(0),
        unsent: Cell::new(0),
        older: Cell::new(0),
    };
}

/// A link.
#[derive(Clone, Copy, Default)]
pub(crate) struct LinkEntry {
    /// Its tasks, where the mission uses them.
    pub(super) transmit: Option<u16>,
    pub(super) receive: Option<u16>,
    /// What it sends, and what it receives, among the frames.
    pub(super) sent: (u16, u16),
    pub(super) received: (u16, u16),
    /// Its declaration, to be compared.
    pub(super) times: (u32, u32, u16),
    /// When its state that receives was entered.
    pub(super) entered_us: u64,
    /// Since when some state has received, without a break.
    pub(super) listens_us: u64,
    /// When a state that receives was left last.
    pub(super) left_us: Option<u64>,
    /// The task instance that the nets of frames that are sent are known for.
    pub(super) sender: Option<u16>,
    /// The same of those that are received: `available` and `errors` are its flags.
    pub(super) receiver: Option<u16>,
    /// The flag `errors`, and whether it is set.
    pub(super) errors: u16,
    pub(super) has_errors: bool,
    /// A flag is set that is true for one macro step.
    pub(super) has_news: bool,
    /// How much came that was wrong, and how much while no state received.
    pub(super) error_count: u32,
    pub(super) dropped_count: u32,
}

/// Counts so many more; the greatest value stays.
#[inline(always)]
pub(super) fn count(counter: &Cell<u32>, more: u32) {
    counter.set(counter.get().saturating_add(more));
}

/// Finds what is to be kept for the links of a mission that was checked. Answers how many frames
/// there are.
pub(super) fn prepare(
    tables: &Tables<'_>,
    registry: Registry<'_>,
    links: &mut [LinkEntry; LINKS],
    frames: &mut [FrameEntry],
) -> usize {
    *links = [LinkEntry::default(); LINKS];
    let mut count = 0;
    for ((index, record), entry) in tables.links().iter().enumerate().zip(links) {
        entry.transmit = record.transmit.index().map(|task| task as u16);
        entry.receive = record.receive.index().map(|task| task as u16);
        entry.times = (
            record.rate_bps.get(),
            record.gap_us.get(),
            record.header_and_bits.get(),
        );
        for is_received in [false, true] {
            let first = count;
            let of_it = frames_of(tables, index, is_received);
            let carried: usize = of_it.clone().map(|frame| frame.flags.get()).sum();
            let task = match is_received {
                true => record.receive,
                false => record.transmit,
            };
            let task = task.index().and_then(|task| tables.task(task));
            let mut types = task
                .into_iter()
                .flat_map(|task| task.signature.data_types());
            let (mut port, mut next_carried, mut by_itself) = (0, 0, carried);
            for frame in of_it {
                let Some(place) = frames.get_mut(count) else {
                    break;
                };
                *place = FrameEntry {
                    record: Some(*frame),
                    configuration: Some(Configuration::from_hash(frame.configuration.get())),
                    port,
                    carried: next_carried,
                    by_itself: by_itself as u16,
                    ..FrameEntry::EMPTY
                };
                if frame.flags.get() == 0 {
                    let type_name = types.next();
                    place.kind = type_name.and_then(|name| kind_of(registry, name));
                    port += 1;
                }
                next_carried += frame.flags.get() as u16;
                by_itself += frame.flags_by_itself();
                count += 1;
            }
            let range = (first as u16, count as u16);
            match is_received {
                true => {
                    entry.received = range;
                    entry.errors = by_itself as u16;
                }
                false => entry.sent = range,
            }
        }
    }
    count
}

/// Frames that are received over a link.
pub(super) struct Received<'a>(pub(super) &'a [FrameEntry]);

impl InFrames for Received<'_> {
    fn find(&self, identifier: u16) -> Option<(usize, InFrame)> {
        let of = |entry: &FrameEntry| entry.record.as_ref().map(Frame::identifier);
        let index = self
            .0
            .iter()
            .position(|entry| of(entry) == Some(identifier))?;
        let entry = self.0.get(index)?;
        Some((
            index,
            InFrame {
                identifier,
                payload_bytes: entry.record.as_ref()?.payload.get() as u8,
                configuration: entry.configuration?,
            },
        ))
    }
}
