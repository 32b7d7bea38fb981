//! The real-time side: owned by the slot timer's interrupt, it executes what is due and says when
//! it wants to be called again.
//!
//! What it does stands in modules of its own. The timer's interrupt enters at `activation`, which
//! has looked up the next one, as a rule; `due` finds what else is due. An `activation` is a macro
//! step, where the slot is the interpreter's, the `execution` of the slot's enabled tasks, in the
//! order of the instance tree, and the `background_runs` in slot 0, which are taken back and
//! started; `counters` says what was counted of it, and when that is too much. A `mission` starts
//! and ends; `change` is when another one takes over, or the same one starts anew, and `trial` how
//! the robot goes back to the one before. `commands` are what the link wants, and `answers` what it
//! asks. `safe_state` is motors off. `health` is what the others see of all this, and `heartbeats`
//! what the watchdog is fed for.
//!
//! *Invariant:* nothing here waits or locks.
//!
//! *Invariant:* after a stop or in the safe state slots go on, so that time, counters, link and the
//! simulated body do, but neither the interpreter nor any task is executed. After an emergency stop
//! the motors are switched off before each exchange with the body besides, whoever else may have
//! written them.

mod activation;
mod answers;
mod background_runs;
mod change;
mod commands;
mod counters;
mod due;
mod execution;
mod health;
mod heartbeats;
pub mod mailbox;
mod mission;
pub mod params;
mod safe_state;
pub(crate) mod slots;
pub(crate) mod staging;
pub(crate) mod tasks;
pub(crate) mod trace;
mod trial;

pub use counters::Limits;

use esm_core::dispatcher::SlotQueue;
use heapless::spsc::{Consumer, Producer};

use crate::heartbeats::Heartbeats;
use crate::ports::{BackgroundRun, Executor};
use crate::realtime::mailbox::{Command, Freed, NO_DEADLINE, Posted};
use crate::recorder::Recorder;
use crate::retained_ram::RetainedRam;
use crate::status::{Health, SnapshotWriter};
use crate::supervision::Supervision;
use crate::telemetry::Sampler;
use activation::Next;
use esm_link::message::{Mode, SafeReason};
use mission::Mission;
use params::{LiveParams, SavedParams};
use staging::OwnMemory;
use tasks::TaskTable;
use trace::Trace;
use trial::Trial;

/// How long the real-time side leaves the link without an answer, and the watchdog without food,
/// when no slot is due.
pub const IDLE_POLL_US: u32 = 10_000;

/// The real-time side of a runtime.
pub struct RealTime<'q, 'm> {
    executor: Executor<'m>,
    mission: Option<Mission<'m>>,
    /// Of the mission's slots. Beside it, not in it, so that a mission is small enough to be moved
    /// on the stack.
    dispatcher: &'m mut SlotQueue,
    /// Memory for the next mission, where the link has none.
    own: OwnMemory<'m>,
    tasks: TaskTable<'m>,
    mode: Mode,
    limits: Limits,
    /// The task instance that has said how many overruns in a row are allowed while it is enabled,
    /// and how many.
    supervisor: Option<(u16, u16)>,
    /// Where a background run is put to be passed around, while none is.
    background_run: Option<&'m mut Option<BackgroundRun<'m>>>,
    /// The task instance of the background run that is under way, if it belongs to this mission.
    running: Option<u16>,
    to_background: Producer<'q, &'m mut Option<BackgroundRun<'m>>>,
    from_background: Consumer<'q, &'m mut Option<BackgroundRun<'m>>>,
    from_link: Consumer<'q, Posted<'m>>,
    to_link: Producer<'q, &'m mut Command<'m>>,
    /// Buffers that no mission is in any more.
    freed: Producer<'q, Freed<'m>>,
    /// A swap, a start, a fall-back or another value of a parameter, to be done at the
    /// interpreter's next activation.
    waiting: Option<&'m mut Command<'m>>,
    /// What is answered when the new mission begins.
    answered: Option<&'m mut Command<'m>>,
    /// When it is too late for what waits, on the board's clock in microseconds.
    waiting_by_us: u64,
    /// When it came, in ticks.
    waiting_since_ticks: u64,
    params: LiveParams,
    /// What the mission of this hash starts with.
    saved: SavedParams,
    trial: Option<Trial<'m>>,
    trace: Trace<'m>,
    kept: Option<&'m RetainedRam>,
    heartbeats: &'m Heartbeats,
    supervision: Supervision,
    /// Wishes that the robot stops, as many as were looked at.
    stops: u32,
    /// Requests that had come when that was looked at last, and robot time when another one had.
    requests: u32,
    heard_us: u64,
    /// What a background run that has ended found wrong.
    failure: Option<SafeReason>,
    record: Recorder<'m>,
    sampler: Sampler<'m>,
    snapshot: SnapshotWriter<'m>,
    health: Health,
    /// Nominal end of the last activation, since the first macro step of the first mission.
    previous_end_us: u64,
    /// Longest start delay since the mission started.
    max_delay_ticks: u32,
    next: Next,
    /// Shortest period of the mission's slots, in microseconds.
    shortest_period_us: u32,
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
}
