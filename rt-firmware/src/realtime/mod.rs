//! The real-time side: owned by the slot timer's interrupt, it executes what is due and says when it wants to be called again.
//!
//! In an occurrence of a slot, in this order: a slot-0 run that has ended is taken back; in the interpreter's slot a new mission is switched
//! to, or else a macro step is made; the slot's enabled tasks are executed in the order of the instance tree; a waiting slot-0 run is
//! started. Where the first task was made ready (`Ready`), the slot-0 run is taken back after the tasks. Nothing here waits or locks.
//!
//! After a stop or in the safe state slots go on, so that time, counters, link and the simulated body do, but neither the interpreter nor any task
//! is executed. After an emergency stop the motors are switched off before each exchange with the body besides, whoever else may have written them.

pub mod params;
pub(crate) mod slots;
pub(crate) mod tasks;
pub(crate) mod trace;
pub(crate) mod upcoming;

use core::num::NonZeroU64;
use core::sync::atomic::Ordering;

use esm_core::tables::{Tables, TaskPlaces};
use esm_core::{Dispatcher, Fault, Interpreter, Pairing, dispatcher};
use heapless::spsc::{Consumer, Producer};

use crate::black_box::Event;
use crate::board::{Board, OccurrenceStart, microseconds};
use crate::features::{PARAMS, TELEMETRY, WARM};
use crate::kept::Kept;
use crate::link::message::{LinkError, Mode, SafeReason, Swap, TaskCounters};
use crate::link::telemetry::Ask;
use crate::link::trace::{EMERGENCY, TraceRecord};
use crate::link::trial::{self, FallBack, FallBackReason};
use crate::mail::{Bytes, Freed, Letter, NO_DEADLINE, Posted};
use crate::ports::{Executor, FlagChanges, Harvest, Inputs, Job, Said};
use crate::recorder::Recorder;
use crate::status::{Health, SnapshotWriter};
use crate::supervision::{Signs, Supervision};
use crate::task::{Declaration, MAX_DATA_PORTS, Step};
use crate::telemetry::Sampler;
use esm_core::BlobBuffer;
use params::{LiveParams, SavedParams};
use slots::{SlotEntry, nanoseconds};
use tasks::{NONE, TaskTable};
use trace::{StepObserver, Trace};
use upcoming::{Lists, OwnRoom, Prepared, Resting, Room, Upcoming};

/// How long the real-time side leaves the link without an answer, and the watchdog without food, when no slot is due.
pub const IDLE_POLL_US: u32 = 10_000;

/// How long occurrences may follow one another, each made ready after the one before, without a look at the whole clock.
const LOOK_US: u32 = 100_000;

/// How long before the first macro step of another mission the missions are exchanged, if nothing is due in between: longer than that takes.
const CHANGE_LEAD_US: u32 = 2_000;

/// How much may go wrong before the robot goes to its safe state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Occurrences of one slot, one after another, that take longer than its duration.
    pub overruns_in_a_row: u16,
    /// Occurrences of one slot, one after another, that do not start within their period.
    pub missed_in_a_row: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            overruns_in_a_row: 10,
            missed_in_a_row: 10,
        }
    }
}

/// The mission that runs.
struct Mission<'m> {
    interpreter: Interpreter<'m, BlobBuffer<'m>>,
    /// What the starts of its slots are counted from.
    origin: Origin,
    /// Its first macro step, which its own time is counted from, since the origin.
    began_us: u64,
    /// What the time of its tasks was then: 0, or what it was in the mission that it took over from.
    tasks_us: u64,
    /// Occurrences of all slots so far.
    occurrences: u64,
    /// Number of the next macro step.
    next_step: u64,
    /// The slot that runs the interpreter.
    interpreter_slot: usize,
}

impl Mission<'_> {
    /// The time of the mission's tasks at a nominal start since the origin.
    fn t_us(&self, start_us: u64) -> u64 {
        self.tasks_us + start_us.saturating_sub(self.began_us)
    }

    /// Its origin, and the interpreter's period: what the slots of another mission go on with.
    fn running(&self) -> (Origin, u32) {
        (
            self.origin,
            interpreter_period_us(&self.interpreter.tables()),
        )
    }
}

/// What is known of the mission that runs while it is on trial.
struct Trial<'m> {
    /// The mission before, to fall back to.
    before: Option<Resting<'m>>,
    /// When it ends, in microseconds since the first macro step of the first mission.
    until_us: u64,
    /// Why it has failed: the robot falls back at the interpreter's next occurrence.
    failed: Option<SafeReason>,
}

/// What the starts of slots are counted from: the first macro step of a mission that started from standing still. It stays where it is
/// as long as missions follow one another whose interpreter slots have one period.
#[derive(Clone, Copy)]
struct Origin {
    /// On the board's clock.
    ticks: u64,
    /// Since the first macro step of the first mission.
    us: u64,
}

/// An occurrence that is being executed.
#[derive(Clone, Copy)]
struct Occurrence {
    slot: usize,
    /// Nominal start since the origin.
    start_us: u64,
    number: u64,
    interpreter: bool,
}

/// The real-time side of a runtime for missions with up to `SLOTS` slots.
pub struct RealTime<'q, 'm, const SLOTS: usize> {
    executor: Executor<'m>,
    mission: Option<Mission<'m>>,
    /// Of the mission's slots. Beside it, not in it, so that a mission is small enough to be moved on the stack.
    dispatcher: Dispatcher<SLOTS>,
    /// Memory for the next mission, where the link has none.
    own: OwnRoom<'m>,
    tasks: TaskTable<'m>,
    mode: Mode,
    limits: Limits,
    /// The task instance that has said how many overruns in a row are allowed while it is enabled, and how many.
    supervisor: Option<(u16, u16)>,
    /// Where a job is put to be passed around, while none is.
    job: Option<&'m mut Option<Job<'m>>>,
    /// The task instance of the job that is under way, if it belongs to this mission.
    running: Option<u16>,
    to_background: Producer<'q, &'m mut Option<Job<'m>>>,
    from_background: Consumer<'q, &'m mut Option<Job<'m>>>,
    from_link: Consumer<'q, Posted<'m>>,
    to_link: Producer<'q, &'m mut Letter<'m>>,
    /// Buffers that no mission is in any more.
    freed: Producer<'q, Freed<'m>>,
    /// A swap, a start, a fall-back or another value of a parameter, to be done at the interpreter's next occurrence.
    waiting: Option<&'m mut Letter<'m>>,
    /// What is answered when the new mission begins.
    answered: Option<&'m mut Letter<'m>>,
    /// When it is too late for what waits, on the board's clock in microseconds.
    waiting_by_us: u64,
    /// When it came, in ticks.
    waiting_since_ticks: u64,
    params: LiveParams,
    /// What the mission of this hash starts with.
    saved: SavedParams,
    trial: Option<Trial<'m>>,
    trace: Trace<'m>,
    kept: Option<&'m Kept>,
    signs: &'m Signs,
    supervision: Supervision,
    /// Which slots were executed since the supervision asked last.
    was_executed: [bool; SLOTS],
    /// Requests that had come when that was looked at last, and robot time when another one had.
    requests: u32,
    heard_us: u64,
    /// How long none has come.
    link_silent_us: u32,
    /// What a slot-0 run that has ended found wrong.
    failure: Option<SafeReason>,
    record: Recorder<'m>,
    sampler: Sampler<'m>,
    snapshot: SnapshotWriter<'m>,
    health: Health,
    /// Nominal end of the last occurrence, since the first macro step of the first mission.
    previous_end_us: u64,
    /// Longest start delay since the mission started.
    max_delay_ticks: u32,
    /// When the whole clock was looked at last, low half.
    looked_ticks: u32,
    ready: Ready,
}

/// The next occurrence, where all that it needs was made ready after the one before. If one of its slot's tasks is enabled, the executor has the first
/// that is.
///
/// It never is one of the interpreter's, which begins with a macro step, and nothing happens between that it depends on: flags, enabled tasks and nets
/// change in occurrences alone.
#[derive(Clone, Copy)]
struct Ready {
    /// Nominal start on the board's clock, low half.
    start_ticks: u32,
    /// For how long from then it is on time; 0 where nothing is ready.
    window_ticks: u32,
    duration_us: u32,
    /// The slot's first enabled task instance, or [`NONE`].
    instance: u16,
    /// Of the task that the executor has.
    places: TaskPlaces,
}

impl Ready {
    const NOTHING: Ready = Ready {
        start_ticks: 0,
        window_ticks: 0,
        duration_us: 0,
        instance: NONE,
        places: TaskPlaces {
            region: 0,
            first_flag: 0,
            flags: 0,
            first_param: 0,
            first_connection: 0,
        },
    };
}

/// What a real-time side is made of.
pub(crate) struct Parts<'q, 'm> {
    pub(crate) executor: Executor<'m>,
    pub(crate) own: OwnRoom<'m>,
    pub(crate) tasks: TaskTable<'m>,
    pub(crate) limits: Limits,
    pub(crate) job: &'m mut Option<Job<'m>>,
    pub(crate) to_background: Producer<'q, &'m mut Option<Job<'m>>>,
    pub(crate) from_background: Consumer<'q, &'m mut Option<Job<'m>>>,
    pub(crate) from_link: Consumer<'q, Posted<'m>>,
    pub(crate) to_link: Producer<'q, &'m mut Letter<'m>>,
    pub(crate) freed: Producer<'q, Freed<'m>>,
    pub(crate) trace: Trace<'m>,
    pub(crate) kept: Option<&'m Kept>,
    pub(crate) signs: &'m Signs,
    pub(crate) record: Recorder<'m>,
    pub(crate) sampler: Sampler<'m>,
    pub(crate) snapshot: SnapshotWriter<'m>,
}

impl<'q, 'm, const SLOTS: usize> RealTime<'q, 'm, SLOTS> {
    pub(crate) fn new(parts: Parts<'q, 'm>) -> Self {
        RealTime {
            executor: parts.executor,
            mission: None,
            dispatcher: Dispatcher::idle(),
            own: parts.own,
            tasks: parts.tasks,
            mode: Mode::Empty,
            limits: parts.limits,
            supervisor: None,
            job: Some(parts.job),
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
            signs: parts.signs,
            supervision: Supervision::new(),
            was_executed: [false; SLOTS],
            requests: 0,
            heard_us: 0,
            link_silent_us: 0,
            failure: None,
            record: parts.record,
            sampler: parts.sampler,
            snapshot: parts.snapshot,
            health: Health::EMPTY,
            previous_end_us: 0,
            max_delay_ticks: 0,
            looked_ticks: 0,
            ready: Ready::NOTHING,
        }
    }

    /// Executes all that is due, and returns when to be called again, in ticks of the board's clock. To be called from the slot timer's
    /// interrupt, first at any time. Being called early does no harm.
    #[inline]
    pub fn on_timer<B: Board>(&mut self, board: &mut B) -> u64 {
        // Nothing comes before this: it is what the delay of a slot is made of.
        let now = board.now_low_ticks();
        let delay_ticks = now.wrapping_sub(self.ready.start_ticks);
        if delay_ticks >= self.ready.window_ticks || self.wants_emergency_stop(board) {
            return self.go_on(board, false);
        }
        let start = self.ready_start::<B>();
        let begun = board.begin_occurrence(&start);
        let step = if begun.is_ok() {
            self.execute_ready(self.ready.instance)
        } else {
            None
        };
        match self.end_ready(board, delay_ticks, begun, step) {
            Some(at_ticks) => at_ticks.get(),
            None => self.go_on(board, true),
        }
    }

    /// Whether somebody wants the robot to stop for an emergency, or wanted it and it is not released.
    #[inline(always)]
    fn wants_emergency_stop<B: Board>(&self, board: &mut B) -> bool {
        self.signs.emergency_stop.load(Ordering::Relaxed) || board.is_emergency_stop_pressed()
    }

    /// Stops the robot for an emergency, until it is released.
    #[cold]
    #[inline(never)]
    fn stop_for_emergency<B: Board>(&mut self, board: &mut B) {
        self.signs.emergency_stop.store(true, Ordering::Relaxed);
        if let Some(kept) = self.kept {
            kept.set_emergency_stop(true);
        }
        self.set_stopped(Mode::EmergencyStopped, board);
        self.hold_still(board);
        self.tell_health();
    }

    /// Motors off during an emergency stop, whoever may have switched them on.
    #[inline(never)]
    fn hold_still<B: Board>(&mut self, board: &mut B) {
        board.motors_off();
        let is_pressed = is_stop_pressed(board);
        self.signs.stop_pressed.store(is_pressed, Ordering::Relaxed);
    }

    /// Motors off, and so they stay.
    #[inline(never)]
    fn set_stopped<B: Board>(&mut self, mode: Mode, board: &mut B) {
        self.ready = Ready::NOTHING;
        self.mode = mode;
        self.note(Event::Mode(mode));
        let reason = (mode == Mode::EmergencyStopped).then_some(EMERGENCY);
        self.trace.record(TraceRecord::MotorsOff { reason });
        board.motors_off();
    }

    /// Executes the task that the executor has, and keeps which one that is for whoever ends the firmware meanwhile.
    #[inline(always)]
    fn execute_ready(&mut self, instance: u16) -> Option<Step> {
        if let Some(kept) = self.kept {
            kept.set_task((instance != NONE).then_some(instance));
            let step = self.executor.execute_ready();
            kept.set_task(None);
            return step;
        }
        self.executor.execute_ready()
    }

    /// Writes into the flight recorder.
    #[inline(always)]
    fn note(&self, event: Event) {
        if let Some(kept) = self.kept {
            kept.black_box.record(self.previous_end_us, event);
        }
    }

    /// What is told of the occurrence that is ready.
    #[inline(always)]
    fn ready_start<B: Board>(&self) -> OccurrenceStart {
        let dispatcher::Occurrence { slot, start_us } = self.dispatcher.next();
        let (origin, number) = self
            .mission
            .as_ref()
            .map_or((Origin { ticks: 0, us: 0 }, 0), |mission| {
                (mission.origin, mission.occurrences)
            });
        let since_us = origin.us + start_us;
        OccurrenceStart {
            slot,
            number,
            start_us: since_us,
            start_ticks: origin.ticks + start_us * u64::from(B::TICKS_PER_US),
            previous_end_us: self.previous_end_us.min(since_us),
            interpreter: false,
        }
    }

    /// Does what comes after the first task of an occurrence that was ready. Returns when to be called again, unless there is something else to do now.
    // Most of a robot's occurrences have no task, or one: what only those with a task need stands elsewhere.
    #[inline(never)]
    fn end_ready<B: Board>(
        &mut self,
        board: &mut B,
        delay_ticks: u32,
        begun: Result<(), SafeReason>,
        step: Option<Step>,
    ) -> Option<NonZeroU64> {
        let taken = self.dispatcher.next();
        self.dispatcher.take_on_time();
        let Ready {
            start_ticks,
            duration_us,
            instance,
            ..
        } = self.ready;
        self.begin(taken.start_us, duration_us, delay_ticks, B::TICKS_PER_US);
        if instance != NONE || begun.is_err() {
            self.end_tasks(board, &taken, delay_ticks, begun, step);
        }
        if self.from_background.ready() || self.tasks.look_for_jobs() {
            self.change_jobs(taken.start_us);
        }
        let now_ticks = board.now_low_ticks();
        if self.mode == Mode::Running {
            let took_ticks = now_ticks
                .wrapping_sub(start_ticks)
                .wrapping_sub(delay_ticks);
            let duration_ticks = duration_us.saturating_mul(B::TICKS_PER_US);
            self.count_execution(board, taken.slot, delay_ticks, took_ticks, duration_ticks);
        }
        self.make_next_ready::<B>(taken.start_us, now_ticks)
    }

    /// Does what comes after the execution of a slot's first enabled task: takes over what it did, and executes those that follow. There was no
    /// execution if the occurrence could not begin.
    #[inline(never)]
    fn end_tasks<B: Board>(
        &mut self,
        board: &mut B,
        taken: &dispatcher::Occurrence,
        delay_ticks: u32,
        begun: Result<(), SafeReason>,
        step: Option<Step>,
    ) {
        if let Err(reason) = begun {
            self.fail_safe(board, reason);
            return;
        }
        let Ready {
            start_ticks,
            duration_us,
            instance,
            ..
        } = self.ready;
        let duration_ticks = duration_us.saturating_mul(B::TICKS_PER_US);
        self.end_task(
            board,
            instance,
            step,
            start_ticks.wrapping_add(delay_ticks),
            duration_ticks,
        );
        if let Some(next) = self.tasks.next_in_slot(instance) {
            let period_us = self.dispatcher.period_us(taken.slot);
            self.execute_tasks(board, Some(next), taken.start_us, period_us, duration_ticks);
        }
    }

    /// Takes a slot-0 run back that has ended, and starts another one, in the occurrence that began last.
    #[inline(never)]
    fn change_jobs(&mut self, start_us: u64) {
        if self.mode != Mode::Running {
            return;
        }
        let begun = self
            .mission
            .as_ref()
            .map_or(0, |mission| mission.occurrences);
        let number = begun.saturating_sub(1);
        self.take_job_back(Some(number));
        self.start_job(start_us, number);
    }

    /// Makes the next occurrence ready after one that was on time, and returns its start, which is when to be called again. `None` if it is
    /// due already or far away, or if there is something else to do first: a letter waits, or the whole clock was not looked at for long.
    #[inline(always)]
    fn make_next_ready<B: Board>(&mut self, start_us: u64, now_ticks: u32) -> Option<NonZeroU64> {
        const NEAR_US: u64 = 2 * IDLE_POLL_US as u64;
        let look_ticks = LOOK_US.saturating_mul(B::TICKS_PER_US);
        if self.from_link.ready() || now_ticks.wrapping_sub(self.looked_ticks) >= look_ticks {
            return None;
        }
        let next = self.dispatcher.next();
        if next.start_us - start_us > NEAR_US {
            return None;
        }
        let mission = self.mission.as_ref()?;
        if WARM
            && next.slot == mission.interpreter_slot
            && (self.waiting.is_some()
                || self.trial.is_some()
                || self.signs.mission_is_coming.load(Ordering::Relaxed))
        {
            return None;
        }
        let start_ticks = mission.origin.ticks + next.start_us * u64::from(B::TICKS_PER_US);
        let wait_ticks = (start_ticks as u32).wrapping_sub(now_ticks) as i32;
        if wait_ticks <= 0 {
            return None;
        }
        self.make_ready::<B>(next, start_ticks as u32);
        NonZeroU64::new(start_ticks)
    }

    /// Makes the dispatcher's next occurrence ready, if it is one to be ready for: not the interpreter's, and the first enabled task of its slot, if
    /// there is one, can be executed. Its start is near, so that the low half of the clock tells whether it is due.
    #[inline(always)]
    fn make_ready<B: Board>(&mut self, next: dispatcher::Occurrence, start_ticks: u32) {
        /// Less than half a round of the clock, so that one that has gone half around is not taken for one that is late.
        const LONGEST_WINDOW_US: u32 = i32::MAX as u32 / u16::MAX as u32;
        self.ready.window_ticks = 0;
        let Some(mission) = &self.mission else { return };
        let Some(entry) = self.tasks.lists.slots.get(next.slot) else {
            return;
        };
        if self.mode != Mode::Running || next.slot == mission.interpreter_slot {
            return;
        }
        let duration_us = entry.duration_us();
        let first = entry.first_task();
        let period_us = self.dispatcher.period_us(next.slot);
        self.ready.instance = NONE;
        if let Some(first) = first
            && !self.make_first_task_ready(first, next.start_us, period_us)
        {
            return;
        }
        self.ready.start_ticks = start_ticks;
        self.ready.duration_us = duration_us;
        self.ready.window_ticks = period_us.min(LONGEST_WINDOW_US) * B::TICKS_PER_US;
    }

    /// Makes the first enabled task of a slot ready, from this one on, if there is one. False if it cannot be executed.
    #[inline(never)]
    fn make_first_task_ready(&mut self, first: u16, start_us: u64, period_us: u32) -> bool {
        let Some(instance) = self.first_enabled(first) else {
            return true;
        };
        self.ready.instance = instance;
        self.make_task_ready(instance, start_us, period_us)
    }

    /// The first enabled task instance of a slot, from this one on.
    #[inline(always)]
    fn first_enabled(&self, first: u16) -> Option<u16> {
        let found = self.tasks.first_enabled(first);
        // What the interpreter enables and disables is told to the table.
        debug_assert!(found.is_none_or(|found| {
            let mission = self.mission.as_ref();
            mission.is_some_and(|mission| mission.interpreter.is_enabled(usize::from(found)))
        }));
        found
    }

    /// Executes what else is due, and returns when to be called again. A letter from the link waits until the slot is done that the interrupt was
    /// for, unless that is the interpreter's.
    #[inline(never)]
    fn go_on<B: Board>(&mut self, board: &mut B, letter_waits: bool) -> u64 {
        if !letter_waits {
            self.take_letter(board);
        }
        let mut at_ticks = self.execute_due(board);
        if letter_waits {
            self.take_letter(board);
            if WARM && self.waiting.is_some() {
                at_ticks = self.execute_due(board);
            }
        }
        self.ready = Ready::NOTHING;
        let next = self.dispatcher.next();
        if let Some(mission) = &self.mission {
            let start_ticks = mission.origin.ticks + next.start_us * u64::from(B::TICKS_PER_US);
            if start_ticks == at_ticks {
                self.make_ready::<B>(next, start_ticks as u32);
            }
        }
        at_ticks
    }

    /// Executes all that is due; returns when to be called again.
    fn execute_due<B: Board>(&mut self, board: &mut B) -> u64 {
        let poll_ticks = u64::from(IDLE_POLL_US) * u64::from(B::TICKS_PER_US);
        loop {
            let now = board.now_ticks();
            self.looked_ticks = now as u32;
            if self.mode != Mode::EmergencyStopped
                && (self.signs.emergency_stop.load(Ordering::Relaxed) || is_stop_pressed(board))
            {
                self.stop_for_emergency(board);
            }
            if self.waiting.is_some() {
                self.refuse_late::<B>(now);
            }
            let Some(mission) = &self.mission else {
                if self.waiting.is_some() {
                    let lead_ticks = u64::from(B::START_LEAD_US) * u64::from(B::TICKS_PER_US);
                    self.change_mission(Origin {
                        ticks: now + lead_ticks,
                        us: self.previous_end_us,
                    });
                    if self.mission.is_some() {
                        continue;
                    }
                }
                self.send_answered();
                self.take_job_back(None);
                self.feed_watchdog(board, now);
                if self.mode == Mode::EmergencyStopped {
                    self.hold_still(board);
                }
                board.motors_off();
                self.tell_health();
                return now + poll_ticks;
            };
            let (origin, interpreter_slot) = (mission.origin, mission.interpreter_slot);
            let at = |start_us: u64| Origin {
                ticks: origin.ticks + start_us * u64::from(B::TICKS_PER_US),
                us: origin.us + start_us,
            };
            let next = self.dispatcher.next();
            let start_ticks = at(next.start_us).ticks;
            if WARM
                && let Some(wait_ticks) = start_ticks.checked_sub(now)
                && next.slot == interpreter_slot
            {
                let is_asked = self.changes_mission::<B>(at(next.start_us));
                let lead_ticks = lead_ticks::<B>();
                let is_coming = is_asked || self.signs.mission_is_coming.load(Ordering::Relaxed);
                if is_coming && wait_ticks > lead_ticks {
                    self.feed_watchdog(board, now);
                    return now + poll_ticks.min(wait_ticks - lead_ticks);
                }
                if is_asked {
                    // Nothing of the mission before is due until then.
                    self.change_mission(at(next.start_us));
                    continue;
                }
            }
            let Some(late_ticks) = now.checked_sub(start_ticks) else {
                self.feed_watchdog(board, now);
                // A slot is not delayed by a poll just before it.
                return if start_ticks - now > 2 * poll_ticks {
                    now + poll_ticks
                } else {
                    start_ticks
                };
            };
            let late_us = microseconds(late_ticks, B::TICKS_PER_US);
            let missed_before = self.dispatcher.missed(next.slot);
            let Some(taken) = self.dispatcher.take(next.start_us + late_us) else {
                return now + poll_ticks;
            };
            let missed = self
                .dispatcher
                .missed(taken.slot)
                .wrapping_sub(missed_before);
            let interpreter = taken.slot == interpreter_slot;
            if PARAMS
                && interpreter
                && let Some(mission) = &self.mission
                && let Some(letter) = self.waiting.take_if(|letter| letter.sets_param())
            {
                set_param(&mut self.params, &mission.interpreter.tables(), letter);
                // There is one letter, so that there is room for it.
                let refused = self.to_link.enqueue(letter);
                debug_assert!(refused.is_ok());
            }
            let start = at(taken.start_us);
            if interpreter && self.changes_mission::<B>(start) {
                self.note_missed(taken.slot, missed);
                self.give_up_before(taken.start_us);
                self.change_mission(start);
                continue;
            }
            let Some(mission) = &mut self.mission else {
                continue;
            };
            let occurrence = Occurrence {
                slot: taken.slot,
                start_us: taken.start_us,
                number: mission.occurrences,
                interpreter,
            };
            if interpreter && missed > 0 {
                mission.interpreter.skip(missed);
                mission.next_step += u64::from(missed);
                self.record.skipped(missed);
                self.trace.write_next_in_full();
            }
            self.count_missed(board, &occurrence, missed);
            self.execute(board, &occurrence, now, start.ticks);
        }
    }

    /// Whether a macro step at this time is the first of another mission, or of this one anew. A swap that is asked for when that step is due waits for the one after it, for which there is time to
    /// make it; where the step is late anyway, it comes with it.
    fn changes_mission<B: Board>(&self, at: Origin) -> bool {
        let is_asked = (self.waiting.as_ref()).is_some_and(|letter| match &**letter {
            Letter::SetParam { .. } => false,
            Letter::Swap { .. } if WARM => {
                let due_ticks = self.waiting_since_ticks.checked_sub(at.ticks);
                due_ticks.is_none_or(|due_ticks| due_ticks > lead_ticks::<B>())
            }
            _ => true,
        });
        is_asked || (self.trial.as_ref()).is_some_and(|trial| trial.is_over(at.us))
    }

    /// What the real-time side is doing.
    pub fn mode(&self) -> Mode {
        self.mode
    }

    /// Feeds the watchdog if all have shown that they live who should have.
    #[inline(never)]
    fn feed_watchdog<B: Board>(&mut self, board: &mut B, now_ticks: u64) {
        let was_executed = &mut self.was_executed;
        let count = self
            .mission
            .as_ref()
            .map_or(0, |mission| mission.interpreter.tables().slots().len());
        let first_silent_slot = || {
            let mut silent = None;
            for (index, was_executed) in was_executed.iter_mut().enumerate().take(count) {
                if !core::mem::take(was_executed) {
                    silent.get_or_insert(index);
                }
            }
            silent
        };
        let fed = self.supervision.allows_food(
            now_ticks,
            B::TICKS_PER_US,
            self.signs,
            self.mode == Mode::Running,
            first_silent_slot,
        );
        match (fed, self.kept) {
            (Ok(()), _) => board.feed_watchdog(),
            (Err(who), Some(kept)) => kept.set_silent(who),
            (Err(_), None) => {}
        }
    }

    /// Looks whether the host has called, in an occurrence that starts at this robot time.
    fn listen(&mut self, robot_us: u64) {
        let requests = self.signs.requests.load(Ordering::Relaxed);
        if requests != self.requests {
            self.requests = requests;
            self.heard_us = robot_us;
        }
        let silent_us = robot_us.saturating_sub(self.heard_us);
        self.link_silent_us = u32::try_from(silent_us).unwrap_or(u32::MAX);
    }

    /// Puts the robot into its safe state: for what a board finds out outside of occurrences.
    pub fn fail_safe(&mut self, board: &mut impl Board, reason: SafeReason) {
        self.ready = Ready::NOTHING;
        if !self.mode.is_latched() {
            self.mode = Mode::Safe(reason);
            self.note(Event::Mode(self.mode));
        }
        if let Some(trial) = &mut self.trial
            && is_the_missions_fault(reason)
        {
            trial.failed.get_or_insert(reason);
        }
        self.trace.record(TraceRecord::MotorsOff {
            reason: Some(reason.number()),
        });
        board.motors_off();
        self.tell_health();
    }

    fn count_missed(&mut self, board: &mut impl Board, occurrence: &Occurrence, missed: u32) {
        self.note_missed(occurrence.slot, missed);
        if missed > self.limits.missed_in_a_row && self.mode == Mode::Running {
            self.fail_safe(board, SafeReason::Missed);
        }
    }

    // Not inlined: no task should run on top of what a trace record needs of the stack.
    #[inline(never)]
    fn note_missed(&mut self, slot: usize, missed: u32) {
        if missed == 0 {
            return;
        }
        self.health.missed = self.health.missed.saturating_add(missed);
        self.note(Event::Missed {
            slot: u8::try_from(slot).unwrap_or(u8::MAX),
            count: missed,
        });
        self.trace.record(TraceRecord::Missed {
            slot: slot as u16,
            count: missed,
        });
    }

    /// Counts as missed what the old mission still owes when the interpreter comes so late that the new one starts first: occurrences
    /// whose nominal start is before this time.
    #[inline(never)]
    fn give_up_before(&mut self, start_us: u64) {
        // A slot that is taken goes on at or after `start_us`, so that each of them is taken once at most.
        while let Some(last_us) = start_us.checked_sub(1) {
            let owed = self.dispatcher.next().slot;
            let before = self.dispatcher.missed(owed);
            if self.dispatcher.take(last_us).is_none() {
                return;
            }
            let skipped = self.dispatcher.missed(owed).wrapping_sub(before);
            // It was handed out, but is not executed.
            self.note_missed(owed, skipped.saturating_add(1));
        }
    }

    /// Notes that an occurrence begins, so long after its nominal start.
    #[inline(always)]
    fn begin(&mut self, start_us: u64, duration_us: u32, delay_ticks: u32, ticks_per_us: u32) {
        let Some(mission) = &mut self.mission else {
            return;
        };
        mission.occurrences += 1;
        self.previous_end_us = mission.origin.us + start_us + u64::from(duration_us);
        if delay_ticks > self.max_delay_ticks {
            self.note_delay(delay_ticks, ticks_per_us);
        }
    }

    #[cold]
    #[inline(never)]
    fn note_delay(&mut self, delay_ticks: u32, ticks_per_us: u32) {
        self.max_delay_ticks = delay_ticks;
        self.health.max_delay_ns = nanoseconds(delay_ticks, ticks_per_us);
    }

    /// Executes an occurrence that began at `began_ticks`; its nominal start was at `start_ticks`.
    fn execute<B: Board>(
        &mut self,
        board: &mut B,
        occurrence: &Occurrence,
        began_ticks: u64,
        start_ticks: u64,
    ) {
        let delay_ticks = u32::try_from(began_ticks - start_ticks).unwrap_or(u32::MAX);
        let Some(mission) = &self.mission else { return };
        let start_us = mission.origin.us + occurrence.start_us;
        let start = OccurrenceStart {
            slot: occurrence.slot,
            number: occurrence.number,
            start_us,
            start_ticks,
            previous_end_us: self.previous_end_us.min(start_us),
            interpreter: occurrence.interpreter,
        };
        let duration_us = self
            .tasks
            .lists
            .slots
            .get(occurrence.slot)
            .map_or(0, SlotEntry::duration_us);
        self.begin(
            occurrence.start_us,
            duration_us,
            delay_ticks,
            B::TICKS_PER_US,
        );
        if self.mode == Mode::EmergencyStopped {
            self.hold_still(board);
        }
        if let Err(reason) = board.begin_occurrence(&start)
            && self.mode == Mode::Running
        {
            self.fail_safe(board, reason);
        }
        self.take_job_back(Some(occurrence.number));
        if occurrence.interpreter {
            self.send_answered();
            self.listen(start_us);
            if self.mode == Mode::Running {
                self.macro_step(board, start_us);
            } else {
                board.motors_off();
            }
        }
        if self.mode == Mode::Running {
            let duration_ticks = duration_us.saturating_mul(B::TICKS_PER_US);
            let first = self
                .tasks
                .lists
                .slots
                .get(occurrence.slot)
                .and_then(SlotEntry::first_task);
            let period_us = self.dispatcher.period_us(occurrence.slot);
            self.execute_tasks(board, first, occurrence.start_us, period_us, duration_ticks);
            if self.tasks.look_for_jobs() {
                self.start_job(occurrence.start_us, occurrence.number);
            }
            let took_ticks = board.now_low_ticks().wrapping_sub(began_ticks as u32);
            self.count_execution(
                board,
                occurrence.slot,
                delay_ticks,
                took_ticks,
                duration_ticks,
            );
        }
        if occurrence.interpreter {
            self.tell_health();
        }
    }

    /// How many overruns in a row of one slot do not lead to the safe state.
    fn allowed_overruns_in_a_row(&self) -> u16 {
        match (self.supervisor, &self.mission) {
            (Some((instance, allowed)), Some(mission))
                if mission.interpreter.is_enabled(usize::from(instance)) =>
            {
                allowed
            }
            _ => self.limits.overruns_in_a_row,
        }
    }

    #[inline(always)]
    fn count_execution(
        &mut self,
        board: &mut impl Board,
        slot: usize,
        delay_ticks: u32,
        took_ticks: u32,
        duration_ticks: u32,
    ) {
        let Some(entry) = self.tasks.lists.slots.get_mut(slot) else {
            return;
        };
        entry.began(delay_ticks);
        if let Some(was_executed) = self.was_executed.get_mut(slot) {
            *was_executed = true;
        }
        if entry.ended(took_ticks, duration_ticks) {
            let in_a_row = entry.overruns_in_a_row();
            self.count_overrun(board, in_a_row);
        }
        // After all tasks of the slot, so that none of them writes the motors any more.
        if let Some(reason) = self.failure.take() {
            self.fail_safe(board, reason);
        }
    }

    #[cold]
    #[inline(never)]
    fn count_overrun(&mut self, board: &mut impl Board, in_a_row: u16) {
        self.health.overruns = self.health.overruns.saturating_add(1);
        if in_a_row > self.allowed_overruns_in_a_row() {
            self.fail_safe(board, SafeReason::Overruns);
        }
    }

    #[inline(never)]
    fn macro_step(&mut self, board: &mut impl Board, robot_us: u64) {
        let Some(mission) = &mut self.mission else {
            return;
        };
        let mut observer = StepObserver {
            tasks: &mut self.tasks,
            trace: &mut self.trace,
            black_box: self.kept.map(|kept| &kept.black_box),
            robot_us,
        };
        self.record.before_step(&mission.interpreter);
        let ended = mission.interpreter.macro_step(&mut observer);
        self.record.after_step(&mission.interpreter);
        match ended {
            Ok(summary) => {
                mission.next_step = summary.step + 1;
                self.health.steps = mission.next_step;
                self.health.t_us = summary.t_us;
                self.sampler.after_step(&self.executor, summary.t_us);
                self.trace.step(&summary, &mission.interpreter);
            }
            Err(fault) => {
                self.trace.fault(mission.next_step, fault);
                let reason = match fault {
                    Fault::EventQueueOverflow => SafeReason::EventQueueOverflow,
                    Fault::MacroStepLimit => SafeReason::MacroStepLimit,
                };
                self.fail_safe(board, reason);
            }
        }
    }

    /// Executes the enabled tasks of a slot, from this one on, in an occurrence that starts at `start_us`.
    fn execute_tasks<B: Board>(
        &mut self,
        board: &mut B,
        first: Option<u16>,
        start_us: u64,
        period_us: u32,
        duration_ticks: u32,
    ) {
        let mut next = first;
        while let Some(instance) = next.and_then(|next| self.first_enabled(next)) {
            let began_ticks = board.now_low_ticks();
            let step = if self.make_task_ready(instance, start_us, period_us) {
                self.execute_ready(instance)
            } else {
                None
            };
            self.end_task(board, instance, step, began_ticks, duration_ticks);
            next = self.tasks.next_in_slot(instance);
        }
    }

    /// Gives an enabled task what it needs to be executed in an occurrence that starts at `start_us`, and finds where what belongs to it stands. False if
    /// it cannot be executed.
    // Not inlined: no task should run on top of what this needs of the stack.
    #[inline(never)]
    fn make_task_ready(&mut self, instance: u16, start_us: u64, period_us: u32) -> bool {
        let Some(mission) = &self.mission else {
            return false;
        };
        let Some((task, enter)) = self.tasks.to_run(instance) else {
            return false;
        };
        let interpreter = &mission.interpreter;
        let tables = interpreter.tables();
        let Some(places) = tables.task_places(usize::from(instance)) else {
            return false;
        };
        self.ready.places = places;
        let health = &self.health;
        let link_silent_us = self.link_silent_us;
        let params = &self.params;
        self.executor.make_ready(
            task,
            tables.nets_from(places.first_connection),
            enter,
            |inputs, declared| {
                inputs.now_us = mission.t_us(start_us);
                inputs.period_us = period_us;
                inputs.overruns = health.overruns;
                inputs.missed = health.missed;
                inputs.link_silent_us = link_silent_us;
                find_inputs(interpreter, params, &places, declared, inputs);
            },
        )
    }

    /// Takes over what an enabled task did in its execution, which began at `began_ticks`; there was none if it could not be executed.
    #[inline(never)]
    fn end_task<B: Board>(
        &mut self,
        board: &mut B,
        instance: u16,
        step: Option<Step>,
        began_ticks: u32,
        duration_ticks: u32,
    ) {
        let Some(Mission { interpreter, .. }) = &mut self.mission else {
            return;
        };
        let index = usize::from(instance);
        let places = self.ready.places;
        let Some(step) = step else {
            interpreter.set_busy(index, true);
            return;
        };
        interpreter.set_busy_at(&places, false);
        let tables = interpreter.tables();
        let Said {
            flags,
            allowed_overruns,
            failure,
        } = self
            .executor
            .end_ready(tables.nets_from(places.first_connection))
            .unwrap_or_default();
        if let Some(allowed) = allowed_overruns {
            self.supervisor = Some((instance, u16::try_from(allowed).unwrap_or(u16::MAX)));
        }
        self.tasks.executed(instance);
        apply_flags(interpreter, &places, flags);
        self.failure = self.failure.or(failure);
        if step == Step::Finished {
            interpreter.report_exit(index);
            self.tasks.disable(instance);
            self.trace.write_next_in_full();
        }
        let took_ticks = board.now_low_ticks().wrapping_sub(began_ticks);
        if took_ticks > duration_ticks {
            self.tasks.overrun(instance);
            let took_us = took_ticks / B::TICKS_PER_US.max(1);
            self.note(Event::Overrun {
                task_instance: instance,
                took_us: u16::try_from(took_us).unwrap_or(u16::MAX),
            });
            self.trace.record(TraceRecord::Overrun {
                task_instance: instance,
                took_us,
            });
        }
    }

    /// Takes back a slot-0 run that has ended; it becomes known in the occurrence of this number.
    fn take_job_back(&mut self, occurrence: Option<u64>) {
        let Some(place) = self.from_background.dequeue() else {
            return;
        };
        let job = place.take();
        self.job = Some(place);
        self.tasks.look_again();
        let running = self.running.take();
        let Some(job) = job else { return };
        let Some(mission) = &mut self.mission else {
            self.executor.harvest(job, |_| None);
            return;
        };
        let tables = mission.interpreter.tables();
        let index = usize::from(running.unwrap_or(u16::MAX));
        let harvest = self
            .executor
            .harvest(job, |port| net_of(&tables, index, port));
        let (Some(instance), Harvest::Ended(outcome)) = (running, harvest) else {
            return;
        };
        self.failure = self.failure.or(outcome.failure);
        if self.tasks.is_fresh(instance) {
            // Entered anew meanwhile: flags and enable bit belong to the next activation.
            self.tasks.requeue(instance);
        } else {
            if mission.interpreter.is_current(index) {
                if let Some(places) = mission.interpreter.tables().task_places(index) {
                    apply_flags(&mut mission.interpreter, &places, outcome.flags);
                }
                mission.interpreter.report_exit(index);
            } else {
                mission.interpreter.clear_enabled(index);
            }
            self.tasks.disable(instance);
            self.trace.write_next_in_full();
        }
        if let Some(occurrence) = occurrence {
            self.trace.record(TraceRecord::JobEnded {
                task_instance: instance,
                occurrence,
            });
        }
    }

    /// Starts the slot-0 run that has waited longest and can be started, and marks as busy those that cannot.
    #[inline(never)]
    fn start_job(&mut self, start_us: u64, number: u64) {
        let Some(mission) = &mut self.mission else {
            return;
        };
        let t_us = mission.t_us(start_us);
        let params = &self.params;
        let interpreter = &mut mission.interpreter;
        let mut younger_than = None;
        self.tasks.looked();
        while let Some((instance, age)) = oldest_waiting(&self.tasks, younger_than) {
            younger_than = Some(age);
            let index = usize::from(instance);
            let place = self.tasks.place(instance);
            let blocked = self.executor.lent() == Some(place) || !self.tasks.may_run(instance);
            if !blocked && self.job.is_none() {
                // It waits for another task's run to end, which is not being busy.
                interpreter.set_busy(index, false);
                continue;
            }
            let tables = interpreter.tables();
            let places = tables.task_places(index).filter(|_| !blocked);
            let job = places.and_then(|places| {
                self.executor.lend(
                    place,
                    tables.nets_from(places.first_connection),
                    |inputs, declared| {
                        inputs.now_us = t_us;
                        find_inputs(interpreter, params, &places, declared, inputs);
                    },
                )
            });
            if job.is_none() && !blocked {
                // Any execution may bring the value that it lacks.
                self.tasks.look_again();
            }
            if interpreter.is_current(index) {
                interpreter.set_busy(index, job.is_none());
            }
            let Some(job) = job else { continue };
            let Some(carrier) = self.job.take() else {
                continue;
            };
            *carrier = Some(job);
            // There is one job, so that there is room for it.
            self.job = self.to_background.enqueue(carrier).err();
            self.running = Some(instance);
            self.tasks.executed(instance);
            self.trace.record(TraceRecord::JobStarted {
                task_instance: instance,
                occurrence: number,
            });
        }
    }

    /// Switches to the mission that waits, falls back to the one before, or starts the present one anew, at this time.
    fn change_mission(&mut self, at: Origin) {
        if let Some(reason) = self.trial.as_ref().and_then(|trial| trial.end_at(at.us)) {
            // Whatever waits comes after it, unless it is what was asked for.
            self.fall_back(reason, at);
            if let Some(letter) =
                (self.waiting).take_if(|letter| matches!(letter, Letter::FallBack { .. }))
            {
                *letter = Letter::Done;
                self.answer_then(letter);
            }
            return;
        }
        let Some(letter) = self.waiting.take() else {
            return;
        };
        *letter = match core::mem::replace(letter, Letter::Empty) {
            Letter::FallBack { .. } => {
                self.fall_back(FallBackReason::Asked, at);
                Letter::Done
            }
            Letter::Swap {
                mission,
                swap,
                saved,
            } => {
                self.saved.become_those(&saved);
                self.swap(mission, swap, at)
            }
            _ => self.start_anew(at),
        };
        self.answer_then(letter);
    }

    /// Answers a letter that has changed the mission when its first macro step begins: until then the one before runs, whatever was exchanged already.
    fn answer_then(&mut self, letter: &'m mut Letter<'m>) {
        if WARM {
            self.answered = Some(letter);
        } else {
            self.tell_health();
            self.send(letter);
        }
    }

    fn send_answered(&mut self) {
        if WARM && let Some(letter) = self.answered.take() {
            self.tell_health();
            self.send(letter);
        }
    }

    /// Switches to another mission.
    // Not inlined, as nothing here: no other mission should be made on top of this one.
    #[inline(never)]
    fn swap(&mut self, new: Upcoming<'m>, swap: Swap, at: Origin) -> Letter<'m> {
        let mission = new.mission().hash();
        // What failed or stands still has nothing to hand over.
        let warm = swap.warm && self.mode == Mode::Running;
        let (carried, old, pairs) = self.start_upcoming(new, warm, at);
        let on_trial = swap.trial_ms > 0;
        if on_trial {
            self.trial = Some(Trial {
                before: old,
                until_us: at.us + u64::from(swap.trial_ms) * 1_000,
                failed: None,
            });
        } else if let Some(old) = old {
            self.free(old, None);
        }
        Letter::Swapped {
            mission,
            on_trial,
            carried,
            pairs,
        }
    }

    /// Starts the present mission anew.
    #[inline(never)]
    fn start_anew(&mut self, at: Origin) -> Letter<'m> {
        // It came while this waited.
        if self.mode == Mode::EmergencyStopped {
            return Letter::Failed(LinkError::EmergencyStopped);
        }
        let running = self.running();
        let Some(mission) = self.end_mission() else {
            return Letter::Failed(LinkError::NoMission);
        };
        self.mode = Mode::Running;
        self.start_again(mission, running, at);
        Letter::Done
    }

    /// Goes back to the mission before the one on trial.
    #[inline(never)]
    fn fall_back(&mut self, reason: FallBackReason, at: Origin) {
        let Some(Trial { before, .. }) = self.trial.take() else {
            return;
        };
        let running = self.running();
        let Some(failed) = self.end_mission() else {
            return;
        };
        let fell_back = FallBack {
            mission: failed.mission.hash(),
            reason,
        };
        self.trace.record(TraceRecord::FellBack {
            mission: fell_back.mission,
            reason: reason.number(),
        });
        self.free(failed, Some(fell_back));
        self.health.fell_back = Some(fell_back);
        let mode = self.mode;
        self.go_back_to(before, running, at);
        if let Mode::Safe(reason) = mode
            && !is_the_missions_fault(reason)
        {
            // What the mission before would not have helped against.
            self.mode = mode;
        }
        self.tell_health();
    }

    /// Starts a mission that ran before, or goes without one.
    fn go_back_to(
        &mut self,
        before: Option<Resting<'m>>,
        running: Option<(Origin, u32)>,
        at: Origin,
    ) {
        self.begin_health();
        if let Some(before) = before {
            self.start_again(before, running, at);
        }
    }

    /// Starts a mission that does not run, from its beginning.
    #[inline(never)]
    fn start_again(
        &mut self,
        Resting { mission, spare }: Resting<'m>,
        running: Option<(Origin, u32)>,
        at: Origin,
    ) {
        // A mission that has ended has left a room.
        let prepared = self.own.take(spare).and_then(|room| match WARM {
            true => Prepared::again(mission, room),
            // The room was another's.
            false => Prepared::new(mission, room, self.executor.registry()),
        });
        debug_assert!(prepared.is_some());
        if let Some(prepared) = prepared {
            self.start_mission(prepared, running, at, None);
        }
    }

    /// Gives a buffer back that no mission is in any more, with the memory that goes with it.
    fn free(&mut self, ended: Resting<'m>, fell_back: Option<FallBack>) {
        let freed = Freed {
            blob: ended.mission.into_bytes(),
            spare: ended.spare,
            fell_back,
        };
        // There are as many places as buffers.
        let refused = self.freed.enqueue(freed);
        debug_assert!(refused.is_ok());
    }

    /// Counters and mode of a robot before its next mission.
    fn begin_health(&mut self) {
        self.health = Health {
            missed: self.health.missed,
            overruns: self.health.overruns,
            fell_back: self.health.fell_back,
            ..Health::EMPTY
        };
        self.max_delay_ticks = 0;
        if !self.mode.is_latched() {
            self.mode = Mode::Empty;
        }
    }

    /// Takes the mission away, if there is one. What is left are its tables and memory.
    // Not inlined: no other mission should be made on top of this one.
    #[inline(never)]
    fn end_mission(&mut self) -> Option<Resting<'m>> {
        let mission = self.mission.take()?;
        let lists = self.tasks.begin(Lists::default());
        self.executor.begin_carry();
        self.executor.end_carry(tasks::left_behind(lists.tasks));
        Some(self.rest(mission, lists))
    }

    /// The origin of the mission's slots, and its interpreter's period.
    #[inline(never)]
    fn running(&self) -> Option<(Origin, u32)> {
        self.mission.as_ref().map(Mission::running)
    }

    /// Takes a mission apart that has ended.
    fn rest(&mut self, mission: Mission<'m>, lists: Lists<'m>) -> Resting<'m> {
        let (mission, arena) = mission.interpreter.into_parts();
        let spare = self.own.keep(Room { arena, lists });
        Resting { mission, spare }
    }

    /// Starts a mission whose first macro step is `at` this time. `running` is what was in its place until now: origin and interpreter's
    /// period, which the slots go on with if it is the new interpreter's, too. If there still is a mission, the new one takes over what they have in `common`. Answers how many regions go on
    /// as they were, and the mission before, if there was one.
    #[inline(never)]
    fn start_mission(
        &mut self,
        prepared: Prepared<'m>,
        running: Option<(Origin, u32)>,
        at: Origin,
        common: Option<&Pairing<'_>>,
    ) -> (u16, Option<Resting<'m>>) {
        self.running = None;
        self.supervisor = None;
        self.failure = None;
        self.heard_us = at.us;
        self.link_silent_us = 0;
        self.params = LiveParams::NONE;
        self.begin_health();
        let Prepared {
            mut interpreter,
            lists,
        } = prepared;
        let tables = interpreter.tables();
        let follows = running.filter(|(_, period_us)| *period_us == interpreter_period_us(&tables));
        let origin = follows.map_or(at, |(origin, _)| origin);
        let began_us = at.us - origin.us;
        // It was checked before that there is room for the slots, and verified that they have periods.
        let refused = self.dispatcher.restart_at(tables.slots(), began_us);
        debug_assert!(refused.is_ok());
        // What starts with the interpreter, and before it in the order of the slots, has been.
        while follows.is_some()
            && self.dispatcher.next().slot != tables.interpreter_slot()
            && self.dispatcher.take(began_us).is_some()
        {}
        let old = self.tasks.begin(lists);
        let (mut carried, mut tasks_us) = (0, 0);
        // Where there is memory for one mission, the one before has ended.
        let before = if WARM { self.mission.take() } else { None };
        if WARM {
            self.executor.begin_carry();
            if let (Some(before), Some(pairing)) = (&before, common) {
                carried = interpreter.take_over(&before.interpreter, pairing).regions;
                tasks_us = before.t_us(at.us.saturating_sub(before.origin.us));
                self.tasks.go_on(old.tasks, pairing.tasks(), |task| {
                    interpreter.is_enabled(task)
                });
                for (net, other) in pairing.nets() {
                    self.executor.carry_net(net, other);
                }
            }
            self.executor.end_carry(tasks::left_behind(old.tasks));
        }
        let tables = interpreter.tables();
        let longest = tables.slots().map(|slot| slot.period_us).max();
        self.supervision.begin_mission(longest.unwrap_or(0));
        let mission = interpreter.verified().hash();
        let saved = self.saved.of(mission);
        params::restore(&mut self.params, saved, &tables, self.executor.registry());
        self.health.mission = Some(mission);
        if !self.mode.is_latched() {
            self.mode = Mode::Running;
        }
        let interpreter_slot = tables.interpreter_slot();
        self.note(Event::Mission { hash: mission });
        self.trace.write_next_in_full();
        self.trace.record(TraceRecord::Started {
            mission,
            start_us: at.us,
        });
        self.record.started(mission, at.us, common.is_some());
        self.sampler.started(mission);
        self.mission = Some(Mission {
            interpreter,
            origin,
            began_us,
            tasks_us,
            occurrences: 0,
            next_step: 0,
            interpreter_slot,
        });
        (carried, before.map(|before| self.rest(before, old)))
    }

    /// Takes what the link wants, and answers it or keeps it for the interpreter's next occurrence.
    // Not inlined: no task should run on top of what this needs of the stack.
    #[inline(never)]
    fn take_letter<B: Board>(&mut self, board: &mut B) {
        let Some(Posted { letter, by_us }) = self.from_link.dequeue() else {
            return;
        };
        let now_ticks = board.now_ticks();
        if is_late::<B>(now_ticks, by_us) {
            self.send(letter);
            return;
        }
        self.waiting_by_us = by_us;
        if WARM {
            self.waiting_since_ticks = now_ticks;
        }
        let answer = match &*letter {
            Letter::Swap { .. } => {
                self.waiting = Some(letter);
                return;
            }
            &Letter::FallBack { mission } if self.is_on_trial(mission) => {
                self.waiting = Some(letter);
                return;
            }
            &Letter::Confirm { mission } if self.is_on_trial(mission) => {
                let before = self.trial.take().and_then(|trial| trial.before);
                if let Some(before) = before {
                    self.free(before, None);
                }
                Letter::Confirmed { mission }
            }
            Letter::FallBack { .. } | Letter::Confirm { .. } => {
                Letter::Failed(LinkError::NotOnTrial)
            }
            &Letter::SetParam {
                mission,
                param,
                value,
            } if PARAMS => match self.check_param(mission, param, value) {
                Ok(()) => {
                    self.waiting = Some(letter);
                    return;
                }
                Err(error) => Letter::Failed(error),
            },
            &Letter::ReadChanged { mission } if PARAMS => {
                match (&self.trial, self.mission_of(mission)) {
                    // So that what the mission before starts with is what was saved for it.
                    (Some(_), _) => Letter::Failed(LinkError::OnTrial),
                    (None, Ok(_)) => Letter::Changed(SavedParams::new(mission, self.params)),
                    (None, Err(error)) => Letter::Failed(error),
                }
            }
            Letter::Saved(saved) if PARAMS => {
                self.saved.become_those(saved);
                Letter::ParamsSaved {
                    count: self.saved.len(),
                }
            }
            &Letter::AskValues { number, ref ask } if TELEMETRY => self
                .answer_of_values(number, ask.as_slice())
                .unwrap_or_else(Letter::Failed),
            // Latched by the link, and not looked at in a slot yet.
            Letter::Start if self.signs.emergency_stop.load(Ordering::Relaxed) => {
                Letter::Failed(LinkError::EmergencyStopped)
            }
            Letter::Start => match (self.mode, &self.mission) {
                (Mode::Running, _) => Letter::Done,
                (Mode::EmergencyStopped, _) => Letter::Failed(LinkError::EmergencyStopped),
                (_, None) => {
                    self.mode = Mode::Empty;
                    Letter::Done
                }
                (_, Some(_)) => {
                    self.waiting = Some(letter);
                    return;
                }
            },
            // It has stopped for more than that.
            Letter::Stop if self.mode == Mode::EmergencyStopped => Letter::Done,
            Letter::Stop => {
                self.set_stopped(Mode::Stopped, board);
                Letter::Done
            }
            Letter::Release if is_stop_pressed(board) => {
                Letter::Failed(LinkError::EmergencyStopped)
            }
            Letter::Release => {
                self.signs.emergency_stop.store(false, Ordering::Relaxed);
                self.signs.stop_pressed.store(false, Ordering::Relaxed);
                if let Some(kept) = self.kept {
                    kept.set_emergency_stop(false);
                }
                if self.mode == Mode::EmergencyStopped {
                    self.set_stopped(Mode::Stopped, board);
                }
                Letter::Released
            }
            question => self.answer(question, B::TICKS_PER_US),
        };
        *letter = answer;
        self.tell_health();
        self.send(letter);
    }

    /// Hands what waits back if it is too late for it now.
    #[inline(never)]
    fn refuse_late<B: Board>(&mut self, now_ticks: u64) {
        if is_late::<B>(now_ticks, self.waiting_by_us)
            && let Some(letter) = self.waiting.take()
        {
            self.send(letter);
        }
    }

    /// Whether the mission of this hash is on trial, and has not failed.
    fn is_on_trial(&self, mission: u32) -> bool {
        let goes_on = (self.trial.as_ref()).is_some_and(|trial| trial.failed.is_none());
        goes_on && self.health.mission == Some(mission)
    }

    /// The mission that runs, if it is the one of this hash.
    fn mission_of(&self, hash: u32) -> Result<&Mission<'m>, LinkError> {
        match &self.mission {
            Some(mission) if self.health.mission == Some(hash) => Ok(mission),
            Some(_) => Err(LinkError::OtherMission),
            None => Err(LinkError::NoMission),
        }
    }

    /// Whether a parameter can be given this value.
    fn check_param(&self, mission: u32, param: u16, value: u32) -> Result<(), LinkError> {
        let tables = self.mission_of(mission)?.interpreter.tables();
        let declared = params::declared(&tables, self.executor.registry(), param)
            .ok_or(LinkError::NoSuchIndex)?;
        params::check(declared, value)?;
        self.params.has_room(param)
    }

    /// Lets samples of values be taken from the next macro step on, or tells what values are made of.
    #[inline(never)]
    fn answer_of_values(&mut self, number: u8, ask: &[u8]) -> Result<Letter<'m>, LinkError> {
        let ask = Ask::of(ask)?;
        let (Ask::Fields { mission, .. } | Ask::Values { mission, .. }) = ask;
        let tables = self.mission_of(mission)?.interpreter.tables();
        match ask {
            Ask::Fields { net, offset, .. } => {
                let text = self.fields(&tables, net).ok_or(LinkError::NoSuchIndex)?;
                Ok(Letter::Fields { text, offset })
            }
            Ask::Values {
                period_ms, nets, ..
            } => {
                let count = tables.net_count();
                let nets = nets.iter().map(|net| u16::from_le_bytes(*net));
                if nets.clone().any(|net| usize::from(net) >= count) {
                    return Err(LinkError::NoSuchIndex);
                }
                self.sampler.begin(number, mission, period_ms, nets);
                Ok(Letter::ValuesWanted { number, mission })
            }
        }
    }

    /// What the values on a net are made of, as a task says that writes them.
    fn fields(&self, tables: &Tables<'_>, net: u16) -> Option<&'static str> {
        let net = usize::from(net);
        (0..tables.task_instance_count()).find_map(|instance| {
            let bank = self.tasks.place(instance as u16).bank;
            let ports = 0..MAX_DATA_PORTS;
            let mut on_net = ports.filter(|port| net_of(tables, instance, *port) == Some(net));
            on_net.find_map(|port| self.executor.fields(bank, port))
        })
    }

    /// Answers a question about the mission.
    fn answer(&self, question: &Letter<'m>, ticks_per_us: u32) -> Letter<'m> {
        let Some(mission) = &self.mission else {
            return Letter::Failed(LinkError::NoMission);
        };
        let tables = mission.interpreter.tables();
        match *question {
            Letter::ReadBlob { offset } => {
                let blob = mission.interpreter.verified().bytes();
                let bytes = blob.get(offset as usize..).unwrap_or_default();
                Letter::Blob {
                    total: blob.len() as u32,
                    bytes: Bytes::first_of(bytes),
                }
            }
            Letter::ReadStates { first } => {
                let mut bytes = Bytes::EMPTY;
                let total = tables.region_instance_count();
                for region in usize::from(first)..total {
                    if !bytes.push_u16(state_of(&mission.interpreter, region)) {
                        break;
                    }
                }
                Letter::States {
                    step: mission.next_step,
                    total: total as u16,
                    bytes,
                }
            }
            Letter::ReadSlot { slot } => {
                let index = usize::from(slot);
                match (tables.slot(index), self.tasks.lists.slots.get(index)) {
                    (Some(slot), Some(entry)) => Letter::Slot(entry.counters(
                        slot.number,
                        self.dispatcher.missed(index),
                        ticks_per_us,
                    )),
                    _ => Letter::Failed(LinkError::NoSuchIndex),
                }
            }
            Letter::ReadTask { task_instance } => {
                let index = usize::from(task_instance);
                if index < tables.task_instance_count() {
                    Letter::Task(TaskCounters {
                        enabled: mission.interpreter.is_enabled(index),
                        // The flag of a state that was left stands as it did until it is entered anew.
                        busy: mission.interpreter.is_current(index)
                            && mission.interpreter.is_busy(index),
                        overruns: self.tasks.overruns(task_instance),
                    })
                } else {
                    Letter::Failed(LinkError::NoSuchIndex)
                }
            }
            Letter::ReadParam { mission, param } if PARAMS => {
                match (self.mission_of(mission), tables.param(usize::from(param))) {
                    (Ok(_), Some(of_mission)) => Letter::Param {
                        value: self.params.get(param).unwrap_or(of_mission),
                        of_mission,
                        saved: self.saved.of(mission).get(param),
                    },
                    (Ok(_), None) => Letter::Failed(LinkError::NoSuchIndex),
                    (Err(error), _) => Letter::Failed(error),
                }
            }
            _ => Letter::Failed(LinkError::NoSuchIndex),
        }
    }

    fn send(&mut self, letter: &'m mut Letter<'m>) {
        // There is one letter, so that there is room for it.
        let refused = self.to_link.enqueue(letter);
        debug_assert!(refused.is_ok());
    }

    fn tell_health(&mut self) {
        self.health.mode = self.mode;
        // What wraps is the number that is told.
        self.health.executed = self
            .mission
            .as_ref()
            .map_or(0, |mission| mission.occurrences as u32);
        self.health.background_busy = self.executor.lent().is_some();
        self.health.changed_params = self.params.len();
        let saved = self
            .health
            .mission
            .map(|mission| self.saved.of(mission).len());
        self.health.saved_params = saved.unwrap_or_default();
        const US_PER_MS: u32 = 1_000;
        self.health.trial = self.trial.as_ref().map(|trial| trial::Trial {
            // Divided as ticks are: a division of 64 bits would take a routine of its own.
            left_ms: microseconds(
                trial.until_us.saturating_sub(self.previous_end_us),
                US_PER_MS,
            ) as u32,
            before: trial.before.as_ref().map(|before| before.mission.hash()),
        });
        if let Some(kept) = self.kept {
            kept.set_alive(self.previous_end_us);
        }
        self.snapshot.write(&self.health);
    }
}

impl Trial<'_> {
    /// Why the robot falls back now, if it does.
    fn end_at(&self, now_us: u64) -> Option<FallBackReason> {
        match self.failed {
            Some(reason) => Some(FallBackReason::Failed(reason)),
            None => (now_us >= self.until_us).then_some(FallBackReason::NotConfirmed),
        }
    }

    fn is_over(&self, now_us: u64) -> bool {
        self.end_at(now_us).is_some()
    }
}

/// Whether somebody presses the emergency stop: asked here where an instruction more does not matter, so that the code for it is not there again and again.
#[inline(never)]
fn is_stop_pressed<B: Board>(board: &mut B) -> bool {
    board.is_emergency_stop_pressed()
}

/// Whether what led to the safe state is the doing of the mission that runs, so that the one before would do without. A battery that is low or a body that is lost would be
/// so with any mission, and motors must not start again for it.
fn is_the_missions_fault(reason: SafeReason) -> bool {
    matches!(
        reason,
        SafeReason::EventQueueOverflow
            | SafeReason::MacroStepLimit
            | SafeReason::Overruns
            | SafeReason::Missed
    )
}

/// [`CHANGE_LEAD_US`] on the board's clock.
fn lead_ticks<B: Board>() -> u64 {
    u64::from(CHANGE_LEAD_US) * u64::from(B::TICKS_PER_US)
}

/// Whether the board's clock is past this time in microseconds.
fn is_late<B: Board>(now_ticks: u64, by_us: u64) -> bool {
    now_ticks > by_us * u64::from(B::TICKS_PER_US)
}

/// Gives a parameter the value that a letter says, and makes the answer of it. The value was checked when the letter came, for this mission: missions change where this is
/// done, and behind it.
// Not inlined: no task should run on top of what this needs of the stack.
#[inline(never)]
fn set_param(params: &mut LiveParams, tables: &Tables<'_>, letter: &mut Letter<'_>) {
    let Letter::SetParam { param, value, .. } = *letter else {
        return;
    };
    let of_mission = tables.param(usize::from(param)).unwrap_or_default();
    let before = params.get(param).unwrap_or(of_mission);
    params.set(param, value, of_mission);
    *letter = Letter::ParamSet { before };
}

/// Period of the interpreter's slot in microseconds.
fn interpreter_period_us(tables: &Tables<'_>) -> u32 {
    tables
        .slot(tables.interpreter_slot())
        .map_or(0, |slot| slot.period_us)
}

/// The current state of a region instance, or none if the region is not active.
fn state_of(interpreter: &Interpreter<'_, BlobBuffer<'_>>, region: usize) -> u16 {
    let active = interpreter
        .tables()
        .region_instance(region)
        .is_some_and(|region| interpreter.is_active(region.instance));
    if active {
        interpreter.current(region) as u16
    } else {
        crate::link::message::NO_STATE
    }
}

/// The slot-0 task instance that was enabled longest ago among those that wait to be started, if younger than the last one looked at.
fn oldest_waiting(tasks: &TaskTable<'_>, younger_than: Option<u32>) -> Option<(u16, u32)> {
    let mut oldest: Option<(u16, u32)> = None;
    let mut next = tasks.first_in_slot_0();
    while let Some(instance) = next {
        next = tasks.next_in_slot(instance);
        let age = tasks.age(instance);
        let candidate = tasks.is_fresh(instance) && younger_than.is_none_or(|last| age < last);
        if candidate && oldest.is_none_or(|(_, oldest_age)| age > oldest_age) {
            oldest = Some((instance, age));
        }
    }
    oldest
}

/// The net of a data port.
fn net_of(tables: &Tables<'_>, task_instance: usize, port: usize) -> Option<usize> {
    let first = tables.task_instance(task_instance)?.first_connection;
    tables.connection(first + port).flatten()
}

/// Finds what enters the execution of a task beside time and the values on nets: its parameters and flags.
fn find_inputs(
    interpreter: &Interpreter<'_, BlobBuffer<'_>>,
    params: &LiveParams,
    places: &TaskPlaces,
    declared: &Declaration,
    inputs: &mut Inputs,
) {
    if !declared.params.is_empty() {
        let values = interpreter.tables().params_from(places.first_param);
        let wanted = inputs.params.get_mut(..declared.params.len());
        let wanted = wanted.unwrap_or_default();
        for (bits, value) in wanted.iter_mut().zip(values) {
            *bits = value;
        }
        params.put_into(wanted, places.first_param);
    }
    inputs.flags = interpreter.control_flags_at(places);
}

/// Writes the control flags that a task wrote.
fn apply_flags(
    interpreter: &mut Interpreter<'_, BlobBuffer<'_>>,
    places: &TaskPlaces,
    flags: FlagChanges,
) {
    let mut written = flags.written;
    while written != 0 {
        let flag = written.trailing_zeros();
        written &= written - 1;
        interpreter.set_flag_at(places, flag as usize, flags.values >> flag & 1 != 0);
    }
}
