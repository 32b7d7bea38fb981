//! A runtime: its memory, and the three sides that it is split into.
//!
//! ```
//! use rt_firmware::{
//!     About, Board, Io, Limits, LinkPort, Mailbox, Memory, Step, Task, TaskPool, registry, split, task,
//! };
//!
//! struct Blink;
//! task! { impl Blink { flags { out lit; } } }
//! impl Task for Blink {
//!     fn step(&mut self, io: &mut Io<'_>) -> Step {
//!         io.set(Self::LIT, true);
//!         Step::Run
//!     }
//! }
//! registry! { pub struct Lamp { blink: Blink[1] } }
//!
//! struct Timer(u64);
//! impl Board for Timer {
//!     const TICKS_PER_US: u32 = 1;
//!     fn now_ticks(&mut self) -> u64 { self.0 }
//!     fn motors_off(&mut self) {}
//! }
//!
//! struct Uart;
//! impl LinkPort for Uart {
//!     fn now_us(&mut self) -> u64 { 0 }
//!     fn receive(&mut self) -> Option<u8> { None }
//!     fn send(&mut self, _byte: u8) -> bool { false }
//! }
//!
//! // On a board these are in statics.
//! let mut lamp = Lamp { blink: TaskPool::new([Blink]) };
//! let mut banks = lamp.banks();
//! let mut memory = Memory::<4096, 256, 8, 16, 16, 2, 1024>::new();
//! let mut mailbox = Mailbox::new();
//! let (mut real_time, mut background, mut link) =
//!     split(&mut memory, &mut banks, &mut mailbox, About::new("lamp 1.0", "example"), Limits::default()).expect("names are unique");
//!
//! let mut timer = Timer(0);
//! let next_ticks = real_time.on_timer(&mut timer); // from the slot timer's interrupt; set the timer to this
//! let link_has_more = link.poll(&mut Uart); // from a task at a low priority
//! let background_has_more = background.poll(); // from the idle loop
//! assert!(next_ticks > 0 && !link_has_more && !background_has_more);
//! ```

use core::mem::MaybeUninit;
use core::sync::atomic::AtomicBool;

use crate::about::About;
use crate::background::Background;
use crate::features::MISSIONS;
#[cfg(not(feature = "links"))]
use crate::frames::FrameLists;
use crate::frames::FrameMemory;
use crate::heartbeats::Heartbeats;
#[cfg(feature = "behaviours")]
use crate::link::device::ScriptKeeper;
use crate::link::device::{LineRate, LinkSide, RequestHandler};
use crate::ports::{AnyTaskPool, BackgroundRun, Net, RegistryFault, assemble};
use crate::realtime::commands::Commands;
use crate::realtime::execution::Execution;
use crate::realtime::machine::Machine;
use crate::realtime::mailbox::{Content, Mailbox};
use crate::realtime::observers::Observers;
use crate::realtime::safety::Safety;
use crate::realtime::slots::SlotEntry;
use crate::realtime::staging::{MissionMemories, MissionMemory};
use crate::realtime::tasks::{Group, Lists, NO_GROUP, NONE, TaskEntry, TaskTable};
use crate::realtime::timetable::Timetable;
use crate::realtime::trace::Trace;
use crate::realtime::{Limits, RealTime};
use crate::recorder::RecorderMemory;
use crate::retained_ram::RetainedRam;
use crate::ring::Ring;
use crate::status::Snapshot;
use crate::stops::Place;
use crate::telemetry::TelemetryMemory;
use esm_core::{BlobBuffer, Dispatcher};
use esm_link::message::Capacities;
use esm_link::selftest::MEASURES_BYTES;

/// Entries of the table of what two missions have in common, for each word of the interpreter's. It
/// is never too short for their region instances.
const PAIRS_OF_WORD: usize = 2;

/// All memory of a runtime but that of its tasks. Its parameters are what a mission may use: bytes
/// of a blob, words for the interpreter, slots, task instances, nets, exclusive groups; and the
/// bytes of the trace ring.
pub struct Memory<
    'm,
    const BLOB_BYTES: usize,
    const ARENA_WORDS: usize,
    const SLOTS: usize,
    const TASKS: usize,
    const NETS: usize,
    const GROUPS: usize,
    const TRACE_BYTES: usize,
> {
    blobs: [[u8; BLOB_BYTES]; 2],
    /// All that a mission keeps, for two where one can take over from another warm.
    arenas: [[u32; ARENA_WORDS]; MISSIONS],
    dispatcher: Dispatcher<SLOTS>,
    slots: [[SlotEntry; SLOTS]; MISSIONS],
    tasks: [[TaskEntry; TASKS]; MISSIONS],
    /// What a mission has in common with the one that it takes over from.
    pairs: [[[u16; PAIRS_OF_WORD]; ARENA_WORDS]; MISSIONS - 1],
    nets: [[Net; NETS]; MISSIONS],
    #[cfg_attr(not(feature = "links"), expect(dead_code, reason = "there are none"))]
    frames: FrameMemory,
    groups: [Group; GROUPS],
    trace: Ring<TRACE_BYTES>,
    trace_wanted: AtomicBool,
    heartbeats: Heartbeats,
    recorder: RecorderMemory<ARENA_WORDS>,
    telemetry: TelemetryMemory,
    snapshot: Snapshot,
    /// This and the command are written when the runtime is made: so all of this is zeros before,
    /// and a static of it takes no flash.
    background_run: MaybeUninit<Option<BackgroundRun<'m>>>,
    command: MaybeUninit<Content<'m>>,
}

impl<
    const BLOB_BYTES: usize,
    const ARENA_WORDS: usize,
    const SLOTS: usize,
    const TASKS: usize,
    const NETS: usize,
    const GROUPS: usize,
    const TRACE_BYTES: usize,
> Memory<'_, BLOB_BYTES, ARENA_WORDS, SLOTS, TASKS, NETS, GROUPS, TRACE_BYTES>
{
    /// Memory that nothing uses yet.
    pub const fn new() -> Self {
        Memory {
            blobs: [[0; BLOB_BYTES]; 2],
            arenas: [[0; ARENA_WORDS]; MISSIONS],
            dispatcher: Dispatcher::idle(),
            slots: [[SlotEntry::UNUSED; SLOTS]; MISSIONS],
            tasks: [[TaskEntry::UNUSED; TASKS]; MISSIONS],
            pairs: [[[0; PAIRS_OF_WORD]; ARENA_WORDS]; MISSIONS - 1],
            nets: [[Net::EMPTY; NETS]; MISSIONS],
            frames: FrameMemory::new(),
            groups: [Group::UNUSED; GROUPS],
            trace: Ring::new(),
            trace_wanted: AtomicBool::new(false),
            heartbeats: Heartbeats::new(),
            recorder: RecorderMemory::new(),
            telemetry: TelemetryMemory::new(),
            snapshot: Snapshot::new(),
            background_run: MaybeUninit::uninit(),
            command: MaybeUninit::uninit(),
        }
    }
}

impl<
    const BLOB_BYTES: usize,
    const ARENA_WORDS: usize,
    const SLOTS: usize,
    const TASKS: usize,
    const NETS: usize,
    const GROUPS: usize,
    const TRACE_BYTES: usize,
> Default for Memory<'_, BLOB_BYTES, ARENA_WORDS, SLOTS, TASKS, NETS, GROUPS, TRACE_BYTES>
{
    fn default() -> Self {
        Self::new()
    }
}

/// The sides of a runtime: for the slot timer's interrupt, for the idle loop, for a task at a low
/// priority.
pub type Sides<'q, 'm> = (RealTime<'q, 'm>, Background<'q, 'm>, LinkSide<'q, 'm>);

/// Makes a runtime of its memory and a robot's banks, and splits it into its sides.
///
/// # Errors
/// What is wrong with the declarations of the tasks.
pub fn split<
    'q,
    'm,
    const BLOB_BYTES: usize,
    const ARENA_WORDS: usize,
    const SLOTS: usize,
    const TASKS: usize,
    const NETS: usize,
    const GROUPS: usize,
    const TRACE_BYTES: usize,
>(
    memory: &'m mut Memory<'m, BLOB_BYTES, ARENA_WORDS, SLOTS, TASKS, NETS, GROUPS, TRACE_BYTES>,
    banks: &'m mut [&'m mut (dyn AnyTaskPool + 'm)],
    mailbox: &'q mut Mailbox<'m>,
    about: About<'m>,
    limits: Limits,
) -> Result<Sides<'q, 'm>, RegistryFault> {
    const {
        assert!(TASKS < NONE as usize && GROUPS < NO_GROUP as usize);
        assert!(SLOTS <= u16::MAX as usize && NETS <= u16::MAX as usize);
    };
    let capacities = Capacities {
        blob_bytes: BLOB_BYTES as u32,
        arena_words: ARENA_WORDS as u32,
        slots: SLOTS as u16,
        task_instances: TASKS as u16,
        nets: NETS as u16,
        exclusive_groups: GROUPS as u16,
    };
    let (executor, registry) = assemble(banks, &mut memory.nets)?;
    #[cfg(feature = "links")]
    let (mut frames, received) = memory.frames.split();
    #[cfg(feature = "links")]
    let executor = executor.with_received(received);
    let (trace_writer, trace_reader) = memory.trace.split();
    let (recorder, record) = memory.recorder.split();
    let (sampler, values) = memory.telemetry.split();
    let (snapshot_writer, snapshot_reader) = memory.snapshot.split();
    let (to_real_time, from_link) = mailbox.to_real_time.split();
    let (to_link, from_real_time) = mailbox.to_link.split();
    let (to_background, background_runs) = mailbox.to_background.split();
    let (ended, from_background) = mailbox.from_background.split();
    let (freed, from_missions) = mailbox.freed.split();
    let trace_wanted = &memory.trace_wanted;
    let is_stopped = about.kept.is_some_and(RetainedRam::is_emergency_stopped);
    *memory.heartbeats.emergency_stop.get_mut() = is_stopped;
    let mut tasks = memory.tasks.iter_mut();
    let mut slots = memory.slots.iter_mut();
    let memories = memory.arenas.each_mut().map(|arena| MissionMemory {
        arena,
        lists: Lists {
            tasks: tasks.next().map(|tasks| &mut tasks[..]).unwrap_or_default(),
            slots: slots.next().map(|slots| &mut slots[..]).unwrap_or_default(),
            first_in_slot_0: None,
            #[cfg(feature = "links")]
            frames: frames.next().unwrap_or_default(),
            #[cfg(not(feature = "links"))]
            frames: FrameLists::default(),
        },
    });
    let pairs = memory.pairs.as_flattened_mut().as_flattened_mut();
    let (memories, own) = MissionMemories::new(memories, pairs);
    let real_time = RealTime::new(
        Timetable::new(&mut memory.dispatcher),
        Machine::new(own, freed),
        Execution::new(
            executor,
            TaskTable::new(&mut memory.groups),
            memory.background_run.write(None),
            to_background,
            from_background,
            match about.kept {
                Some(kept) => kept.task(),
                None => &memory.heartbeats.task,
            },
        ),
        Safety::new(limits, &memory.heartbeats),
        Observers::new(
            Trace::new(trace_writer, trace_wanted),
            about.kept,
            recorder,
            sampler,
            snapshot_writer,
        ),
        Commands::new(from_link, to_link),
    );
    let background = Background {
        background_runs,
        ended,
        current: None,
        heartbeats: &memory.heartbeats,
    };
    let link = LinkSide::new(RequestHandler {
        registry,
        capacities,
        about,
        blobs: memory
            .blobs
            .each_mut()
            .map(|storage| Some(BlobBuffer::new(storage))),
        memories,
        upload: None,
        command: Some(memory.command.write(Content::Empty)),
        pending: None,
        place: Place::BEGINNING,
        stops_before: 0,
        asked: None,
        to_real_time,
        from_real_time,
        freed: from_missions,
        snapshot: snapshot_reader,
        trace: trace_reader,
        trace_wanted,
        heartbeats: &memory.heartbeats,
        record,
        values,
        streams_are_sent: true,
        log_wanted: false,
        keys: esm_link::keys::Keys::new(),
        start_wanted: false,
        watch: None,
        stop_is_stored: false,
        line_rate: LineRate::Own,
        measures: [0; MEASURES_BYTES],
        #[cfg(feature = "behaviours")]
        script_keeper: ScriptKeeper::EMPTY,
    });
    Ok((real_time, background, link))
}
