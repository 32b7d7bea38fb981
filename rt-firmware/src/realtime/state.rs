//! What the real-time side is made of.

use esm_core::dispatcher::SlotQueue;
use heapless::spsc::{Consumer, Producer};

use super::limits::Limits;
use super::mailbox::{Command, Freed, NO_DEADLINE, Posted};
use super::params::{LiveParams, SavedParams};
use super::running::{Mission, Next, Trial};
use super::staging::OwnMemory;
use super::tasks::TaskTable;
use super::trace::Trace;
use crate::heartbeats::Heartbeats;
use crate::ports::{BackgroundRun, Executor};
use crate::recorder::Recorder;
use crate::retained_ram::RetainedRam;
use crate::status::{Health, SnapshotWriter};
use crate::supervision::Supervision;
use crate::telemetry::Sampler;
use esm_link::message::{Mode, SafeReason};

/// How long the real-time side leaves the link without an answer, and the watchdog without food,
/// when no slot is due.
pub const IDLE_POLL_US: u32 = 10_000;

/// The real-time side of a runtime.
pub struct RealTime<'q, 'm> {
    pub(super) executor: Executor<'m>,
    pub(super) mission: Option<Mission<'m>>,
    /// Of the mission's slots. Beside it, not in it, so that a mission is small enough to be moved
    /// on the stack.
    pub(super) dispatcher: &'m mut SlotQueue,
    /// Memory for the next mission, where the link has none.
    pub(super) own: OwnMemory<'m>,
    pub(super) tasks: TaskTable<'m>,
    pub(super) mode: Mode,
    pub(super) limits: Limits,
    /// The task instance that has said how many overruns in a row are allowed while it is enabled,
    /// and how many.
    pub(super) supervisor: Option<(u16, u16)>,
    /// Where a background run is put to be passed around, while none is.
    pub(super) background_run: Option<&'m mut Option<BackgroundRun<'m>>>,
    /// The task instance of the background run that is under way, if it belongs to this mission.
    pub(super) running: Option<u16>,
    pub(super) to_background: Producer<'q, &'m mut Option<BackgroundRun<'m>>>,
    pub(super) from_background: Consumer<'q, &'m mut Option<BackgroundRun<'m>>>,
    pub(super) from_link: Consumer<'q, Posted<'m>>,
    pub(super) to_link: Producer<'q, &'m mut Command<'m>>,
    /// Buffers that no mission is in any more.
    pub(super) freed: Producer<'q, Freed<'m>>,
    /// A swap, a start, a fall-back or another value of a parameter, to be done at the
    /// interpreter's next activation.
    pub(super) waiting: Option<&'m mut Command<'m>>,
    /// What is answered when the new mission begins.
    pub(super) answered: Option<&'m mut Command<'m>>,
    /// When it is too late for what waits, on the board's clock in microseconds.
    pub(super) waiting_by_us: u64,
    /// When it came, in ticks.
    pub(super) waiting_since_ticks: u64,
    pub(super) params: LiveParams,
    /// What the mission of this hash starts with.
    pub(super) saved: SavedParams,
    pub(super) trial: Option<Trial<'m>>,
    pub(super) trace: Trace<'m>,
    pub(super) kept: Option<&'m RetainedRam>,
    pub(super) heartbeats: &'m Heartbeats,
    pub(super) supervision: Supervision,
    /// Wishes that the robot stops, as many as were looked at.
    pub(super) stops: u32,
    /// Requests that had come when that was looked at last, and robot time when another one had.
    pub(super) requests: u32,
    pub(super) heard_us: u64,
    /// What a background run that has ended found wrong.
    pub(super) failure: Option<SafeReason>,
    pub(super) record: Recorder<'m>,
    pub(super) sampler: Sampler<'m>,
    pub(super) snapshot: SnapshotWriter<'m>,
    pub(super) health: Health,
    /// Nominal end of the last activation, since the first macro step of the first mission.
    pub(super) previous_end_us: u64,
    /// Longest start delay since the mission started.
    pub(super) max_delay_ticks: u32,
    pub(super) next: Next,
    /// Shortest period of the mission's slots, in microseconds.
    pub(super) shortest_period_us: u32,
}

/// What a real-time side is made of.
pub(crate) struct Parts<'q, 'm> {
    pub(crate) executor: Executor<'m>,
    pub(crate) dispatcher: &'m mut SlotQueue,
    pub(crate) own: OwnMemory<'m>,
    pub(crate) tasks: TaskTable<'m>,
    pub(crate) limits: Limits,
    pub(crate) background_run: &'m mut Option<BackgroundRun<'m>>,
    pub(crate) to_background: Producer<'q, &'m mut Option<BackgroundRun<'m>>>,
    pub(crate) from_background: Consumer<'q, &'m mut Option<BackgroundRun<'m>>>,
    pub(crate) from_link: Consumer<'q, Posted<'m>>,
    pub(crate) to_link: Producer<'q, &'m mut Command<'m>>,
    pub(crate) freed: Producer<'q, Freed<'m>>,
    pub(crate) trace: Trace<'m>,
    pub(crate) kept: Option<&'m RetainedRam>,
    pub(crate) heartbeats: &'m Heartbeats,
    pub(crate) record: Recorder<'m>,
    pub(crate) sampler: Sampler<'m>,
    pub(crate) snapshot: SnapshotWriter<'m>,
}

impl<'q, 'm> RealTime<'q, 'm> {
    pub(crate) fn new(parts: Parts<'q, 'm>) -> Self {
        RealTime {
            executor: parts.executor,
            mission: None,
            dispatcher: parts.dispatcher,
            own: parts.own,
            tasks: parts.tasks,
            mode: Mode::Empty,
            limits: parts.limits,
            supervisor: None,
            background_run: Some(parts.background_run),
            running: None,
            to_background: parts.to_background,
            from_background: parts.from_background,
            from_link: parts.from_link,
            to_link: parts.to_link,
            freed: parts.freed,
            waiting: None,
            answered: None,
            waiting_by_us: NO_DEADLINE,
            waiting_since_ticks: 0,
            params: LiveParams::NONE,
            saved: SavedParams::NONE,
            trial: None,
            trace: parts.trace,
            kept: parts.kept,
            heartbeats: parts.heartbeats,
            supervision: Supervision::new(),
            stops: 0,
            requests: 0,
            heard_us: 0,
            failure: None,
            record: parts.record,
            sampler: parts.sampler,
            snapshot: parts.snapshot,
            health: Health::EMPTY,
            previous_end_us: 0,
            max_delay_ticks: 0,
            next: Next::NOTHING,
            shortest_period_us: 0,
        }
    }

    /// What the real-time side is doing.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Whether the mission runs. Modes as a whole are not compared for it.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn is_running(&self) -> bool {
        matches!(self.mode, Mode::Running)
    }
}
