//! What requests are carried out with. What is done for each of them stands in files of their own.

use core::sync::atomic::AtomicBool;

use esm_core::BlobBuffer;
use heapless::spsc::{Consumer, Producer};

use super::client_session::Sender;
use super::line_rate::LineRate;
#[cfg(feature = "behaviours")]
use super::script_keeper::ScriptKeeper;
use crate::about::About;
use crate::heartbeats::Heartbeats;
use crate::link::status_event::Watch;
use crate::ports::Registry;
use crate::realtime::mailbox::{Content, Freed, Posted};
use crate::realtime::staging::MissionMemories;
use crate::recorder::RecordReader;
use crate::ring::RingReader;
use crate::status::SnapshotReader;
use crate::stops::Place;
use crate::telemetry::SampleReader;
use esm_link::keys::{Keys, SignedUpload};
use esm_link::message::{Capacities, LinkError, Response};
use esm_link::selftest::MEASURES_BYTES;

/// What requests are answered from.
pub(crate) struct RequestHandler<'q, 'm> {
    pub(crate) registry: Registry<'m>,
    pub(crate) capacities: Capacities,
    pub(crate) about: About<'m>,
    /// Buffers that no mission is in.
    pub(crate) blobs: [Option<BlobBuffer<'m>>; 2],
    /// Memory of missions that do not run, and what has to do with it.
    pub(crate) memories: MissionMemories<'m>,
    pub(crate) upload: Option<Upload<'m>>,
    /// The place for a command, while it is here.
    pub(crate) command: Option<&'m mut Content<'m>>,
    /// The request that is carried out, as long as it has asked nobody.
    pub(crate) pending: Option<PendingRequest>,
    /// Where the link stands among the bytes of its line.
    pub(crate) place: Place,
    /// How many stops had been wished for when the request was read that is carried out.
    pub(crate) stops_before: u32,
    /// The request whose answer the command will bring.
    pub(crate) asked: Option<PendingRequest>,
    pub(crate) to_real_time: Producer<'q, Posted<'m>>,
    pub(crate) from_real_time: Consumer<'q, &'m mut Content<'m>>,
    pub(crate) freed: Consumer<'q, Freed<'m>>,
    /// The mission store's mission is to be started, as soon as the command is here.
    pub(crate) start_wanted: bool,
    pub(crate) snapshot: SnapshotReader<'m>,
    pub(crate) trace: RingReader<'m>,
    pub(crate) trace_wanted: &'m AtomicBool,
    pub(crate) heartbeats: &'m Heartbeats,
    pub(crate) record: RecordReader<'m>,
    pub(crate) values: SampleReader<'m>,
    /// No part of a stream is on its way out.
    pub(crate) streams_are_sent: bool,
    pub(crate) log_wanted: bool,
    pub(crate) keys: Keys,
    /// The wish for status events, if there is one.
    pub(crate) watch: Option<Watch>,
    /// The mission store was told that an emergency stop is latched, whoever latched it.
    pub(crate) stop_is_stored: bool,
    /// Which rate the line has.
    pub(crate) line_rate: LineRate,
    /// What the board has measured, as it is told.
    pub(crate) measures: [u8; MEASURES_BYTES],
    #[cfg(feature = "behaviours")]
    pub(crate) script_keeper: ScriptKeeper,
}

/// A blob that arrives.
pub(crate) struct Upload<'m> {
    pub(super) blob: BlobBuffer<'m>,
    pub(super) len: u32,
    pub(super) crc: u32,
    pub(super) signed: Option<SignedUpload>,
}

impl Upload<'_> {
    pub(super) fn received(&self) -> u32 {
        self.blob.len() as u32
    }
}

/// What a request goes by while it is carried out.
#[derive(Clone, Copy)]
pub(crate) struct PendingRequest {
    pub(super) seq: u8,
    /// Who sent it.
    pub(super) sender: Sender,
    /// Its kind.
    pub(super) of: u8,
    /// When it is too late for it, on the board's clock in microseconds.
    pub(super) by_us: u64,
    /// How many stops had been wished for when it was read, see
    /// [`wishes_before`](Place::wishes_before).
    pub(super) stops: u32,
}

/// What becomes of a request.
pub(super) enum Reaction<'a> {
    /// This is the answer.
    Answer(Result<Response<'a>, LinkError>),
    /// The real-time side was asked.
    Later,
    /// The real-time side was called: this is the answer when it has stopped for the wish of this
    /// number.
    WhenStopped {
        wish: u32,
        result: Result<(), LinkError>,
    },
}
