//! Where values live and how tasks reach them: banks of tasks, port buffers, nets. The only
//! `unsafe` of this crate is here.
//!
//! A value is stored once, in a buffer of the output port that wrote it, and is never copied on its
//! way to its readers. An output port has two buffers: one that its net refers to, and another, for
//! what a background run reads or writes meanwhile. A real-time task writes over its last value, as
//! long as nobody reads that. A port of a task that may read its own output has three
//! ([`buffers_for`]).
//!
//! # Invariants
//! The `unsafe` below rests on these, each kept by this file alone:
//!
//! 1. **One owner.** [`assemble`] borrows every [`TaskPool`] mutably for as long as its
//!    [`Executor`] lives, and an executor cannot be cloned: all access to the tasks and buffers of
//!    a bank goes through one executor and the one [`BackgroundRun`] that it has lent.
//! 2. **Lent is gone.** While a background run is out, the executor does not touch the background
//!    run's task, nor write into a buffer that the background run refers to, nor hand out a second
//!    background run.
//! 3. **Published or pinned is constant.** A buffer that a net refers to or that a background run
//!    reads (its pins) is never given to a task for writing. The one exception is a real-time
//!    task's own output and `inout`: a value is changed in place if no background run reads it and
//!    the same task does not read it through another port; nobody else can be reading it, since
//!    real-time tasks never preempt each other.
//!    A value that comes over a link is written by the executor itself, into a place to which no
//!    net refers but the one that it is published on.
//! 4. **Types are known.** Each value carries the [`ValueKind`] of what is in its buffer, which has
//!    its type from [`ValueKind::of`] alone. It is compared with the port's when a task instance is
//!    executed, unless the buffer is one of the port's own, and the port's with the handle's at
//!    each access.
//! 5. **Bound to one robot.** A [`Binding`] points into the banks that it was made for. It is
//!    executed by the executor of these alone, which compares.

#![allow(unsafe_code)]

use core::any::TypeId;
use core::cell::{Cell, UnsafeCell};
use core::marker::PhantomData;
use core::ptr::NonNull;

use esm_core::tables::TaskPlaces;

#[cfg(feature = "links")]
use crate::declaration::Codec;
pub use crate::declaration::ValueKind;
use crate::declaration::{
    Declaration, Direction, In, InFlag, InOut, Kind, MAX_DATA_PORTS, MAX_PARAMS, OptIn, OptInOut,
    Out, OutFlag, Param, ParamType, Params, PortDeclaration, PortType, Step, same_text,
};
use crate::features::{MISSIONS, WARM};
use crate::list_command::{Answer, CommandBox, ListCommand};
use crate::notes::Notes;
use crate::odometry::Pose;
#[cfg(feature = "links")]
use crate::received_value::{ReceivedValue, VALUE_BYTES};
#[cfg(feature = "telemetry")]
use crate::show::Show;
use esm_link::black_box::Event;
use esm_link::message::SafeReason;
use esm_link::position::Correction;

/// Buffers of one output port.
///
/// One of them is published, on one net. A background run may have pinned one, which need not be
/// the same; then the published one is written over by a real-time task, for nobody reads it. A
/// slot-0 run writes one that is not published. So two are enough, unless the task may find what it
/// published on another of its ports while it writes the next value.
const BUFFERS: usize = 2;

/// How many buffers an output port with this direction and type needs in a task with these `ports`:
/// pairs of direction and type.
#[doc(hidden)]
pub const fn buffers_for(direction: &str, type_name: &str, ports: &[(&str, &str)]) -> usize {
    let mut rest = ports;
    while let [(other, name), tail @ ..] = rest {
        let finds =
            same_text(other, "in") || same_text(other, "inout") && same_text(direction, "out");
        if finds && same_text(name, type_name) {
            return BUFFERS + 1;
        }
        rest = tail;
    }
    BUFFERS
}

/// What is known of a buffer's use. Only the executor looks at it.
struct Head {
    /// Nets that refer to the buffer, in the low half, and background runs that read it, in the
    /// high half.
    uses: Cell<u32>,
}

/// One net refers to a buffer, and no background run reads it.
const PUBLISHED_ONCE: u32 = 1;
const PUBLICATIONS: u32 = u16::MAX as u32;
/// One background run that reads a buffer.
const PIN: u32 = PUBLICATIONS + 1;

impl Head {
    const fn free() -> Self {
        Head { uses: Cell::new(0) }
    }

    fn is_free(&self) -> bool {
        self.uses.get() == 0
    }

    fn is_pinned(&self) -> bool {
        self.uses.get() >= PIN
    }

    fn publications(&self) -> u32 {
        self.uses.get() & PUBLICATIONS
    }

    fn count_publication(&self) {
        if self.publications() < PUBLICATIONS {
            self.uses.set(self.uses.get() + 1);
        }
    }

    /// A count that saturated is never taken back: such a buffer stays out of use rather than being
    /// written while referred to.
    fn uncount_publication(&self) {
        if !matches!(self.publications(), 0 | PUBLICATIONS) {
            self.uses.set(self.uses.get() - 1);
        }
    }

    fn pin(&self) {
        self.uses.set(self.uses.get().saturating_add(PIN));
    }

    fn unpin(&self) {
        self.uses.set(self.uses.get().saturating_sub(PIN));
    }
}

/// A value and what is known of its use. The head comes first, so that a pointer to it is a pointer
/// to the whole.
#[repr(C)]
struct Buffer<V> {
    head: Head,
    value: UnsafeCell<V>,
}

impl ValueKind {
    /// The kind of these values.
    pub const fn of<V: PortType>() -> Self {
        let kind = const {
            &Kind::new::<V>(
                #[cfg(feature = "telemetry")]
                tell::<V>,
                #[cfg(feature = "links")]
                Codec {
                    payload_bytes: V::PAYLOAD_BYTES,
                    buffer_bytes: size_of::<Buffer<V>>(),
                    buffer_align: align_of::<Buffer<V>>(),
                    put: put::<V>,
                    take: take::<V>,
                },
            )
        };
        ValueKind::new(kind)
    }
}

/// A value on a net, as long as nothing is executed that could change it.
#[cfg(feature = "links")]
pub(crate) struct ValueToSend<'e> {
    head: NonNull<()>,
    codec: &'static Codec,
    executor: PhantomData<&'e ()>,
}

#[cfg(feature = "links")]
impl ValueToSend<'_> {
    /// Writes it into a payload of its length.
    pub(crate) fn put(&self, payload: &mut [u8]) {
        if payload.len() == self.codec.payload_bytes {
            // SAFETY: the kind is that of the buffer (invariant 4), and a published value is not
            // written except while a task is executed, which borrows the executor mutably
            // (invariant 3).
            unsafe { (self.codec.put)(self.head, payload) };
        }
    }
}

/// Writes the value in a buffer into a payload.
///
/// # Safety
/// The buffer is a live one of this type, its pointer has provenance over all of it, and nobody is
/// writing its value.
#[cfg(feature = "links")]
unsafe fn put<V: PortType>(buffer: NonNull<()>, payload: &mut [u8]) {
    // SAFETY: as the caller promises.
    unsafe { value_in::<V>(buffer.cast()).as_ref() }.put(payload);
}

/// Makes the value of a payload in a buffer.
///
/// # Safety
/// The pointer is aligned for a buffer of this type and has provenance over as many bytes as one
/// has, and nobody looks at these bytes but at the head.
#[cfg(feature = "links")]
unsafe fn take<V: PortType>(payload: &[u8], buffer: NonNull<()>) {
    // SAFETY: as the caller promises; what was there is overwritten, not dropped, and what is there
    // then is a value, which nobody else looks at.
    let value = unsafe {
        let place = value_in::<V>(buffer.cast()).as_ptr();
        place.write(V::INIT);
        &mut *place
    };
    value.take(payload);
}

/// Shows the value in a buffer, if there is one, and says what values of the type are made of.
///
/// # Safety
/// The buffer is a live one of this type, its pointer has provenance over all of it, and nobody is
/// writing its value.
#[cfg(feature = "telemetry")]
unsafe fn tell<V: PortType>(buffer: Option<NonNull<()>>, show: &mut Show<'_>) -> &'static str {
    if let Some(buffer) = buffer {
        let buffer = buffer.cast::<Buffer<V>>();
        // SAFETY: as the caller promises; the projection stays inside.
        let value = unsafe { &*UnsafeCell::raw_get(&raw const (*buffer.as_ptr()).value) };
        value.show(show);
    }
    V::FIELDS
}

/// A buffer whose type is known by its [`ValueKind`] only. The pointer's provenance is that of the
/// whole [`Buffer`].
#[derive(Clone, Copy)]
struct ErasedBuffer {
    head: NonNull<Head>,
    kind: ValueKind,
}

/// What is known of the use of a buffer.
///
/// # Safety
/// The pointer leads into a bank that outlives what is returned.
#[cfg_attr(feature = "speed", inline(always))]
unsafe fn head<'b>(buffer: NonNull<Head>) -> &'b Head {
    // SAFETY: as the caller promises. Only `Cell`s are behind it, and only the executor's thread
    // reaches them.
    unsafe { buffer.as_ref() }
}

/// Pointer to the value in a buffer.
///
/// # Safety
/// The buffer is a live one of this type, and its pointer has provenance over all of it.
#[cfg_attr(feature = "speed", inline(always))]
unsafe fn value_in<V: PortType>(buffer: NonNull<Head>) -> NonNull<V> {
    let buffer = buffer.cast::<Buffer<V>>();
    // SAFETY: as the caller promises; the projection stays inside, `UnsafeCell::raw_get` makes no
    // reference, and what is inside a live buffer is not null.
    unsafe { NonNull::new_unchecked(UnsafeCell::raw_get(&raw const (*buffer.as_ptr()).value)) }
}

impl ErasedBuffer {
    #[cfg_attr(feature = "speed", inline(always))]
    fn head(&self) -> &Head {
        // SAFETY: `head` points into a bank that outlives the executor or background run that holds
        // this (invariant 1; nets are emptied when an executor is made).
        unsafe { head(self.head) }
    }

    /// Pointer to the value, if `V` is its type.
    fn value<V: PortType>(&self) -> Option<NonNull<V>> {
        // SAFETY: an `ErasedBuffer` is made from a `Buffer` whose value has the type of its kind,
        // with provenance over all of it.
        self.kind
            .is(ValueKind::of::<V>())
            .then(|| unsafe { value_in(self.head) })
    }
}

/// The buffers of an output port, whatever their type.
#[doc(hidden)]
#[allow(private_interfaces)]
pub trait PortBuffers {
    /// Type of the values.
    fn type_id(&self) -> TypeId;
    /// One of the buffers.
    fn buffer(&self, number: usize) -> Option<ErasedBuffer>;
    /// Copies a value of this port's type from one buffer into another.
    ///
    /// # Safety
    /// Nobody may be writing `from` or hold a reference to the value in `to`.
    unsafe fn copy(&self, from: ErasedBuffer, to: ErasedBuffer);
}

impl dyn PortBuffers + '_ {
    fn buffers(&self) -> impl Iterator<Item = ErasedBuffer> {
        (0..).map_while(|number| self.buffer(number))
    }

    fn free_buffer(&self) -> Option<ErasedBuffer> {
        self.buffers().find(|buffer| buffer.head().is_free())
    }

    /// Whether a buffer is one of these.
    fn owns(&self, buffer: ErasedBuffer) -> bool {
        self.buffers().any(|own| own.head == buffer.head)
    }
}

/// Buffers of a port that the task writes.
#[doc(hidden)]
pub struct Buffered<V, const N: usize = BUFFERS> {
    buffers: [Buffer<V>; N],
}

impl<V: PortType, const N: usize> Buffered<V, N> {
    #[expect(
        clippy::declare_interior_mutable_const,
        reason = "it is what each bank's buffers are made of, not a value to share"
    )]
    pub(crate) const EMPTY: Self = Buffered {
        buffers: [const {
            Buffer {
                head: Head::free(),
                value: UnsafeCell::new(V::INIT),
            }
        }; N],
    };
}

#[allow(private_interfaces)]
impl<V: PortType, const N: usize> PortBuffers for Buffered<V, N> {
    fn type_id(&self) -> TypeId {
        TypeId::of::<V>()
    }

    fn buffer(&self, number: usize) -> Option<ErasedBuffer> {
        let buffer = self.buffers.get(number)?;
        Some(ErasedBuffer {
            head: NonNull::from(buffer).cast(),
            kind: ValueKind::of::<V>(),
        })
    }

    unsafe fn copy(&self, from: ErasedBuffer, to: ErasedBuffer) {
        if let (Some(from), Some(to)) = (from.value::<V>(), to.value::<V>())
            && from != to
        {
            // SAFETY: the caller promises that nobody writes `from` or looks at `to`; both point to
            // live values of type `V`, which is `Copy`, and are of two buffers.
            unsafe { core::ptr::copy_nonoverlapping(from.as_ptr(), to.as_ptr(), 1) };
        }
    }
}

/// A port that the task only reads: it has no buffers.
#[doc(hidden)]
pub struct Unbuffered;

mod sealed {
    pub trait Sealed {}
}

/// The buffers of one port, in a list of them.
#[doc(hidden)]
pub trait PortSlot: sealed::Sealed {
    /// The port before anything was written.
    const EMPTY: Self;
    /// Its buffers, if it has some.
    fn buffers(&self) -> Option<&dyn PortBuffers>;
}

impl sealed::Sealed for Unbuffered {}
impl PortSlot for Unbuffered {
    const EMPTY: Self = Unbuffered;
    fn buffers(&self) -> Option<&dyn PortBuffers> {
        None
    }
}

impl<V: PortType, const N: usize> sealed::Sealed for Buffered<V, N> {}
impl<V: PortType, const N: usize> PortSlot for Buffered<V, N> {
    const EMPTY: Self = Self::EMPTY;
    fn buffers(&self) -> Option<&dyn PortBuffers> {
        Some(self)
    }
}

/// The buffers of a task's data ports: a list of [`Buffered`] and [`Unbuffered`] in port order,
/// `(first, (second, ()))`.
pub trait OutputPorts: sealed::Sealed {
    /// The buffers before anything was written.
    #[doc(hidden)]
    const EMPTY: Self;
    /// The buffers of a port, if it is one that the task writes.
    #[doc(hidden)]
    fn port(&self, index: usize) -> Option<&dyn PortBuffers>;
    /// How long a monitor has said nothing; none for any other task.
    #[doc(hidden)]
    #[cfg_attr(feature = "speed", inline(always))]
    fn silence(&self) -> Option<&Silence> {
        None
    }
}

impl sealed::Sealed for () {}
impl OutputPorts for () {
    const EMPTY: Self = ();
    fn port(&self, _index: usize) -> Option<&dyn PortBuffers> {
        None
    }
}

/// A monitor that said nothing in so many executions in a row is broken, and the robot goes to its
/// safe state: 200 ms in a slot of 40 ms, which is how old a range may be. One that works says
/// something in each.
pub const SILENT_EXECUTIONS: u8 = 5;

/// Executions of a monitor in a row in which it said nothing. It stands at the end of the list,
/// behind the ports.
#[doc(hidden)]
pub struct Silence(Cell<u8>);

impl sealed::Sealed for Silence {}
impl OutputPorts for Silence {
    const EMPTY: Self = Silence(Cell::new(0));
    fn port(&self, _index: usize) -> Option<&dyn PortBuffers> {
        None
    }
    fn silence(&self) -> Option<&Silence> {
        Some(self)
    }
}

impl Silence {
    /// Counts the execution that has just ended.
    #[inline(never)]
    fn count(&self, state: &mut IoState) {
        let is_heard = state.done & !HAS_TOLD != 0;
        let silent = if is_heard { 0 } else { self.0.get() + 1 };
        if silent < SILENT_EXECUTIONS {
            self.0.set(silent);
        } else {
            state.tell();
            state.failure = Some(SafeReason::MonitorSilent);
        }
    }
}

impl<P: PortSlot, R: OutputPorts> sealed::Sealed for (P, R) {}
impl<P: PortSlot, R: OutputPorts> OutputPorts for (P, R) {
    const EMPTY: Self = (P::EMPTY, R::EMPTY);
    #[cfg_attr(feature = "speed", inline(always))]
    fn silence(&self) -> Option<&Silence> {
        self.1.silence()
    }
    fn port(&self, index: usize) -> Option<&dyn PortBuffers> {
        match index.checked_sub(1) {
            None => self.0.buffers(),
            Some(index) => self.1.port(index),
        }
    }
}

/// A type of task: what runs when a task state of a mission is executed.
///
/// One value of the type serves one task state at a time; the robot's registry says how many there
/// are.
pub trait Task: Declared + Send {
    /// A mission starts: forget everything that an earlier mission left behind.
    fn reset(&mut self) {}

    /// The task state was entered anew; called before the first [`step`](Task::step) of each
    /// activation.
    fn enter(&mut self) {}

    /// Executes the task once. For a real-time task this is called once in each activation of its
    /// slot and must end within the slot's duration; for a task in slot 0 it is called again and
    /// again, preempted by every slot, until it returns [`Step::Finished`].
    fn step(&mut self, io: &mut Io<'_>) -> Step;
}

/// A type with a declaration; implemented by [`task!`](crate::task!).
pub trait Declared {
    /// Canonical text of the signature, which blobs are compiled against. A robot does not keep it:
    /// see [`Declaration::has_signature`].
    const SIGNATURE: &'static str;
    /// What the type declares.
    const DECLARATION: Declaration;
    /// Buffers of the data ports; made of [`Buffered`] and
    /// [`Unbuffered`] in port order.
    type Outputs: OutputPorts;
}

/// The declaration of a task type.
pub const fn declaration_of<T: Declared>() -> &'static Declaration {
    const { &T::DECLARATION }
}

/// One task with the buffers of its output ports.
struct Place<T: Task> {
    task: UnsafeCell<T>,
    outputs: T::Outputs,
}

/// The tasks of one type that a robot has: as many task states of that type can a mission have.
pub struct TaskPool<T: Task, const N: usize> {
    places: [Place<T>; N],
}

impl<T: Task, const N: usize> TaskPool<T, N> {
    /// A bank of these tasks.
    pub fn new(tasks: [T; N]) -> Self {
        TaskPool {
            places: tasks.map(|task| Place {
                task: UnsafeCell::new(task),
                outputs: <T::Outputs as OutputPorts>::EMPTY,
            }),
        }
    }

    /// A bank of tasks that this makes, one after the other.
    pub fn from_fn(mut make: impl FnMut() -> T) -> Self {
        TaskPool {
            places: core::array::from_fn(|_| Place {
                task: UnsafeCell::new(make()),
                outputs: <T::Outputs as OutputPorts>::EMPTY,
            }),
        }
    }
}

// SAFETY: through a shared bank one reaches its tasks only by the `unsafe` methods of
// `AnyTaskPool`, whose callers, the executor and the background run, keep to one thread at a time
// for each task and each buffer (invariants 1 to 3). `Task` requires `Send`, `PortType` `Send` and
// `Sync`.
unsafe impl<T: Task, const N: usize> Sync for TaskPool<T, N> {}

/// A [`TaskPool`] of tasks of any type.
pub trait AnyTaskPool: Sync + sealed::Sealed {
    /// What the tasks declare.
    fn declaration(&self) -> &'static Declaration;

    /// Number of tasks.
    fn capacity(&self) -> usize;

    /// Buffers of a port, if there is that task and it writes that port.
    #[doc(hidden)]
    fn output(&self, place: usize, port: usize) -> Option<&dyn PortBuffers>;

    /// Makes a task forget everything.
    ///
    /// # Safety
    /// Nobody else may be using this task.
    #[doc(hidden)]
    unsafe fn reset(&self, place: usize);

    /// A task as its executor reaches it.
    #[doc(hidden)]
    #[allow(private_interfaces)]
    fn task(&self, place: usize) -> Option<TaskPointer>;
}

/// A task, and how it is executed.
#[derive(Clone, Copy)]
struct TaskPointer {
    /// The [`Place`] that it is in. The pointer's provenance is that of the whole place.
    place: NonNull<()>,
    /// Executes the task in a place of its type once; the flag says whether an activation begins.
    step: unsafe fn(NonNull<()>, bool, &mut Io<'_>) -> Step,
}

/// Executes the task in a place once; `enter` says whether an activation begins.
///
/// # Safety
/// It is a live place with a task of this type, the pointer has provenance over it, and nobody else
/// is using the task.
unsafe fn step_in<T: Task>(place: NonNull<()>, enter: bool, io: &mut Io<'_>) -> Step {
    let place = place.cast::<Place<T>>();
    // SAFETY: as the caller promises; the projection stays inside.
    let task = unsafe { &mut *UnsafeCell::raw_get(&raw const (*place.as_ptr()).task) };
    if enter {
        task.enter();
    }
    let step = task.step(io);
    // SAFETY: as above; what the outputs hold is reached through shared references alone.
    let outputs = unsafe { &(*place.as_ptr()).outputs };
    if let Some(silence) = outputs.silence() {
        silence.count(&mut io.state);
    }
    step
}

impl<T: Task, const N: usize> sealed::Sealed for TaskPool<T, N> {}
impl<T: Task, const N: usize> AnyTaskPool for TaskPool<T, N> {
    fn declaration(&self) -> &'static Declaration {
        declaration_of::<T>()
    }

    fn capacity(&self) -> usize {
        N
    }

    fn output(&self, place: usize, port: usize) -> Option<&dyn PortBuffers> {
        self.places.get(place)?.outputs.port(port)
    }

    unsafe fn reset(&self, place: usize) {
        if let Some(place) = self.places.get(place) {
            // SAFETY: the caller promises that nobody else uses this task.
            let task = unsafe { &mut *place.task.get() };
            task.reset();
            if let Some(silence) = place.outputs.silence() {
                silence.0.set(0);
            }
        }
    }

    #[allow(private_interfaces)]
    fn task(&self, place: usize) -> Option<TaskPointer> {
        Some(TaskPointer {
            place: NonNull::from(self.places.get(place)?).cast(),
            step: step_in::<T>,
        })
    }
}

/// What a task sees while it is executed: the values on its ports, its flags and parameters.
///
/// All access is by the handles that [`task!`](crate::task!) makes. A handle of another task type
/// is a defect of the program and panics.
pub struct Io<'a> {
    state: IoState,
    /// For how long a task may look at values: who is given an `Io` to execute cannot know.
    execution: PhantomData<&'a ()>,
}

impl Io<'_> {
    const fn new(state: IoState) -> Self {
        Io {
            state,
            execution: PhantomData,
        }
    }
}

/// What is known of one execution.
struct IoState {
    /// The task's data ports.
    ports: &'static [PortDeclaration],
    /// The value of each of them: to read for `in`, to write for `out` and `inout`.
    values: [Option<NonNull<Head>>; MAX_DATA_PORTS],
    /// A time on the robot's clock. The [task's time](Inputs::now_us) is that at the same instant.
    robot_us: u64,
    /// From then to the activation's nominal start: so that from one activation to the next a
    /// number of 32 bits changes.
    since_us: u32,
    /// What the task has done: bit n, from 0 on, data port n was written; from [`FIRST_FLAG`] on,
    /// control flag n was; [`HAS_TOLD`], it has told something else.
    done: u32,
    /// Bit n: control flag n was set last. It means something where the flag was written.
    flags: u16,
    allowed_overruns: Option<u32>,
    failure: Option<SafeReason>,
    inputs: Inputs,
    /// What the list of behaviours is to do.
    behaviours: CommandBox,
    notes: Notes,
}

const WRITTEN_PORTS: u32 = (1 << MAX_DATA_PORTS) - 1;
const HAS_TOLD: u32 = 1 << MAX_DATA_PORTS;
/// The task has said that it still watches.
const IS_HEARD: u32 = HAS_TOLD << 1;
const FIRST_FLAG: u32 = 16;

impl IoState {
    const EMPTY: IoState = IoState {
        ports: &[],
        values: [None; MAX_DATA_PORTS],
        robot_us: 0,
        since_us: 0,
        done: 0,
        flags: 0,
        allowed_overruns: None,
        failure: None,
        inputs: Inputs {
            flags: 0,
            params: [0; MAX_PARAMS],
            now_us: 0,
            period_us: 0,
            overruns: 0,
            missed: 0,
            link_silent_us: 0,
        },
        behaviours: CommandBox::EMPTY,
        notes: Notes::EMPTY,
    };

    /// These are the buffers of so many data ports. Most tasks have few: a copy of all would be a
    /// call, which takes longer.
    #[cfg_attr(feature = "speed", inline(always))]
    fn take_buffers(&mut self, buffers: &[Option<NonNull<Head>>; MAX_DATA_PORTS], ports: usize) {
        let [first, second, third, fourth, rest @ ..] = &mut self.values;
        let [in_first, in_second, in_third, in_fourth, in_rest @ ..] = buffers;
        (*first, *second) = (*in_first, *in_second);
        (*third, *fourth) = (*in_third, *in_fourth);
        if ports > MAX_DATA_PORTS - in_rest.len() {
            *rest = *in_rest;
        }
    }

    /// Nominal start of the activation on the robot's clock.
    #[cfg_attr(feature = "speed", inline(always))]
    fn start_robot_us(&self) -> u64 {
        self.robot_us.wrapping_add(self.since_us.into())
    }

    /// The control flags that the task has written.
    #[cfg_attr(feature = "speed", inline(always))]
    fn flag_changes(&self) -> FlagChanges {
        let written = (self.done >> FIRST_FLAG) as u16;
        FlagChanges {
            written,
            values: self.flags & written,
        }
    }

    /// How many overruns in a row the task allows from now on, if it has said so, and why the robot
    /// is to go to its safe state, if it has said that.
    fn told(&self) -> (Option<u32>, Option<SafeReason>) {
        match self.done & HAS_TOLD != 0 {
            true => (self.allowed_overruns, self.failure),
            false => (None, None),
        }
    }

    /// Notes that the task tells something that it has told nothing of yet in this execution.
    fn tell(&mut self) {
        if self.done & HAS_TOLD == 0 {
            self.done |= HAS_TOLD;
            self.allowed_overruns = None;
            self.failure = None;
        }
    }
}

/// What enters an execution beside the values on nets.
#[derive(Clone, Copy, Debug, Default)]
pub struct Inputs {
    /// Bit n: control flag n of the declaration is set.
    pub flags: u16,
    /// Bits of each parameter.
    pub params: [u32; MAX_PARAMS],
    /// Nominal start of the slot's activation, in microseconds since the mission started.
    pub now_us: u64,
    /// Period of the slot in microseconds; 0 in slot 0.
    pub period_us: u32,
    /// Overruns of all slots so far.
    pub overruns: u32,
    /// Deadline misses of all slots so far.
    pub missed: u32,
    /// How long no request has come over the link, in microseconds; stays at its greatest value.
    pub link_silent_us: u32,
}

/// The control flags that an execution wrote.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FlagChanges {
    /// Bit n: flag n was written.
    pub written: u16,
    /// Bit n: flag n was set last; 0 where not written.
    pub values: u16,
}

/// A handle belongs to another task type.
#[cold]
#[inline(never)]
fn wrong_handle() -> ! {
    panic!("this handle belongs to another task type")
}

impl<'a> Io<'a> {
    /// The value of a port, if it has one, and the handle is one of the task's.
    #[cfg_attr(feature = "speed", inline(always))]
    fn value<V: PortType>(&self, index: u8, is_input: bool) -> Option<NonNull<V>> {
        let index = usize::from(index);
        let (Some(port), Some(value)) = (self.state.ports.get(index), self.state.values.get(index))
        else {
            wrong_handle()
        };
        let is_right =
            (port.direction == Direction::In) == is_input && port.kind.is(ValueKind::of::<V>());
        if !is_right {
            wrong_handle();
        }
        // SAFETY: the value was found to be of the port's kind (invariant 4), which is that of `V`;
        // its buffer is in a bank that outlives the executor or background run.
        value.map(|value| unsafe { value_in(value) })
    }

    #[cfg_attr(feature = "speed", inline(always))]
    fn readable<V: PortType>(&self, index: u8) -> Option<&'a V> {
        // SAFETY: the value is published or pinned and not written during this execution (invariant
        // 3), which 'a does not outlive.
        self.value(index, true)
            .map(|value| unsafe { value.as_ref() })
    }

    #[cfg_attr(feature = "speed", inline(always))]
    fn writable<V: PortType>(&mut self, index: u8) -> Option<&mut V> {
        let mut value = self.value::<V>(index, false)?;
        self.state.done |= 1 << index;
        // SAFETY: ports that are no inputs have buffers that are free, or values that nobody reads
        // (invariant 3). Two ports of a task may be given one `inout` value, but the mutable borrow
        // of `self` allows one reference at a time.
        Some(unsafe { value.as_mut() })
    }

    /// The value on an input.
    pub fn read<V: PortType>(&self, port: In<V>) -> &'a V {
        let Some(value) = self.readable(port.index) else {
            wrong_handle()
        };
        value
    }

    /// The value on an optional input, if its net holds one that is fresh enough.
    pub fn try_read<V: PortType>(&self, port: OptIn<V>) -> Option<&'a V> {
        self.readable(port.index)
    }

    /// The place for a new value of an output, which is published when the step ends. It holds some
    /// older value: assign all of it. An output that is not written keeps its last value on the
    /// net.
    pub fn write<V: PortType>(&mut self, port: Out<V>) -> &mut V {
        let Some(value) = self.writable(port.index) else {
            wrong_handle()
        };
        value
    }

    /// The value on an `inout` port, to be changed and, when the step ends, published again.
    pub fn update<V: PortType>(&mut self, port: InOut<V>) -> &mut V {
        let Some(value) = self.writable(port.index) else {
            wrong_handle()
        };
        value
    }

    /// The value on an optional `inout` port, if its net holds one that is fresh enough.
    pub fn try_update<V: PortType>(&mut self, port: OptInOut<V>) -> Option<&mut V> {
        self.writable(port.index)
    }

    /// Whether a control flag was set by a transition into the task's state.
    pub fn flag(&self, flag: InFlag) -> bool {
        self.state.inputs.flags & bit16(flag.index) != 0
    }

    /// Sets or clears a control flag, seen by the next macro step.
    pub fn set(&mut self, flag: OutFlag, value: bool) {
        let bit = bit16(flag.index);
        self.state.done |= u32::from(bit) << FIRST_FLAG;
        self.state.flags = if value {
            self.state.flags | bit
        } else {
            self.state.flags & !bit
        };
    }

    /// All parameters.
    #[cfg_attr(feature = "speed", inline(always))]
    pub fn params(&self) -> Params {
        // One by one: a copy of all would be a call, which takes longer.
        let [first, second, third, fourth, fifth, sixth, seventh, eighth] =
            self.state.inputs.params;
        Params::from([first, second, third, fourth, fifth, sixth, seventh, eighth])
    }

    /// Nominal start of the activation on the robot's clock, in microseconds; of slot 0, when the
    /// run was started.
    pub fn robot_us(&self) -> u64 {
        self.state.start_robot_us()
    }

    /// What the list of behaviours is to do, if something is. Who asks is its owner, and is known
    /// to be there from now on.
    pub(crate) fn take_list_command(&mut self) -> Option<ListCommand> {
        self.state.behaviours.take(self.state.start_robot_us())
    }

    /// Where the robot is, or how far off, as the link says. Who asks is known to be there from now
    /// on.
    #[cfg_attr(
        not(feature = "behaviours"),
        expect(dead_code, reason = "who takes it comes with behaviours")
    )]
    pub(crate) fn take_position(&mut self) -> Option<(Correction, Pose)> {
        self.state
            .behaviours
            .take_position(self.state.start_robot_us())
    }

    /// What came of it.
    pub(crate) fn answer_list_command(&mut self, answer: Answer) {
        self.state.behaviours.answer(answer);
    }

    /// Notes something for the trace and the flight recorder. There is room for what the tasks that
    /// do so note at most in one execution; a firmware without behaviours has none.
    pub(crate) fn note(&mut self, event: Event) {
        if self.state.notes.push(event) {
            self.state.tell();
        }
    }

    /// The value of a parameter.
    pub fn param<P: ParamType>(&self, param: Param<P>) -> P {
        P::from_bits(
            self.state
                .inputs
                .params
                .get(usize::from(param.index))
                .copied()
                .unwrap_or(0),
        )
    }

    /// Nominal start of the slot's activation (of the one that started the run, in slot 0), in
    /// microseconds since the mission started.
    pub fn now_us(&self) -> u64 {
        let since_us = u64::from(self.state.since_us);
        self.state.inputs.now_us.wrapping_add(since_us)
    }

    /// Period of the task's slot in microseconds; 0 in slot 0.
    pub fn period_us(&self) -> u32 {
        self.state.inputs.period_us
    }

    /// How often an activation of any slot lasted longer than its slot since the robot started, up
    /// to the activation before.
    pub fn overruns(&self) -> u32 {
        self.state.inputs.overruns
    }

    /// How often an activation of any slot did not start within its period since the robot started.
    pub fn missed(&self) -> u32 {
        self.state.inputs.missed
    }

    /// How long no request has come over the link, in microseconds, as of the last activation of
    /// the interpreter's slot; counted from the start of the mission where none has come since.
    /// Stays at its greatest value, which is 71 minutes.
    pub fn link_silent_us(&self) -> u32 {
        self.state.inputs.link_silent_us
    }

    /// The motors are to go off, whatever the mission does: after this execution the robot is in
    /// its safe state, for this reason. Said in slot 0, when the run has ended.
    pub fn fail_safe(&mut self, reason: SafeReason) {
        self.state.tell();
        self.state.failure = Some(reason);
    }

    /// Says that a task which is a [monitor](crate::task!) still watches, where it has no flag to
    /// set and nothing to write.
    pub fn beat(&mut self) {
        self.state.done |= IS_HEARD;
    }

    /// From now on, and for as long as the task is enabled, so many activations of one slot in a
    /// row may last too long; one more brings the robot to its safe state. It takes the place of
    /// the board's own [limit](crate::Limits); of several tasks, the last one to say so counts.
    /// Said in slot 0, it has no effect.
    pub fn allow_overruns(&mut self, in_a_row: u32) {
        self.state.tell();
        self.state.allowed_overruns = Some(in_a_row);
    }
}

fn bit16(index: u8) -> u16 {
    1u16.checked_shl(u32::from(index)).unwrap_or(0)
}

/// Why a set of banks is no robot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum RegistryFault {
    /// Two banks have tasks of the same name: give one task type another name.
    TaskNameTwice {
        /// The name.
        task: &'static str,
    },
    /// One port type name stands for two Rust types: give one of them another `PortType::NAME`.
    TypeNameTwice {
        /// The name.
        type_name: &'static str,
    },
    /// A declaration that was not made by `task!` contradicts the task's buffers.
    Inconsistent {
        /// The task's name.
        task: &'static str,
    },
    /// More banks, or more tasks in one, than a registry can number.
    TooMany,
}

/// What a robot's tasks declare: a view that can be shared.
#[derive(Clone, Copy)]
pub struct Registry<'m> {
    banks: &'m [&'m mut (dyn AnyTaskPool + 'm)],
}

impl<'m> Registry<'m> {
    fn bank(&self, index: usize) -> Option<&'m dyn AnyTaskPool> {
        self.banks.get(index).map(|bank| &**bank)
    }

    /// Number of task types.
    pub fn len(&self) -> usize {
        self.banks.len()
    }

    /// Whether the robot has no tasks at all.
    pub fn is_empty(&self) -> bool {
        self.banks.is_empty()
    }

    /// Declaration of a task type.
    pub fn declaration(&self, index: usize) -> Option<&'static Declaration> {
        self.bank(index).map(|bank| bank.declaration())
    }

    /// Number of task states of this type that a mission can have.
    pub fn capacity(&self, index: usize) -> usize {
        self.bank(index).map_or(0, |bank| bank.capacity())
    }

    /// Index of the task type with this signature.
    pub fn find(&self, signature_hash: u64) -> Option<u8> {
        self.declarations()
            .zip(0u8..)
            .find(|(declared, _)| declared.signature_hash == signature_hash)
            .map(|(_, index)| index)
    }

    /// All declarations, in the order of the registry.
    pub fn declarations(self) -> impl Iterator<Item = &'static Declaration> + use<'m> {
        self.banks.iter().map(|bank| bank.declaration())
    }

    fn check(self) -> Result<(), RegistryFault> {
        if self.banks.len() >= usize::from(u8::MAX)
            || self
                .banks
                .iter()
                .any(|bank| bank.capacity() > usize::from(u8::MAX))
        {
            return Err(RegistryFault::TooMany);
        }
        for (index, bank) in self.banks.iter().enumerate() {
            let declaration = bank.declaration();
            if self
                .declarations()
                .take(index)
                .any(|other| other.name == declaration.name)
            {
                return Err(RegistryFault::TaskNameTwice {
                    task: declaration.name,
                });
            }
            for (port, declared) in declaration.ports.iter().enumerate() {
                let buffered = bank.output(0, port).map(|buffers| buffers.type_id());
                let expected = (declared.direction != Direction::In && bank.capacity() > 0)
                    .then_some(declared.kind.type_id());
                if buffered != expected {
                    return Err(RegistryFault::Inconsistent {
                        task: declaration.name,
                    });
                }
                for other in self
                    .declarations()
                    .take(index + 1)
                    .flat_map(|other| other.ports)
                {
                    let type_name = declared.type_name();
                    if other.type_name() == type_name && !other.kind.is(declared.kind) {
                        return Err(RegistryFault::TypeNameTwice { type_name });
                    }
                }
            }
        }
        Ok(())
    }
}

/// A net: refers to the value that was published on it last.
#[derive(Clone, Copy)]
pub struct Net {
    value: Option<ErasedBuffer>,
    /// The value's time on the robot's clock.
    value_us: u64,
}

impl Net {
    /// A net without a value.
    pub const EMPTY: Net = Net {
        value: None,
        value_us: 0,
    };

    /// The value, if it has a port's type and is not older than the port wants it at this time on
    /// the robot's clock.
    fn fresh(&self, port: &PortDeclaration, robot_us: u64) -> Option<NonNull<Head>> {
        self.value_for(port)
            .filter(|_| self.is_fresh(port, robot_us))
    }

    /// Whether the value is not older than a port wants it.
    #[cfg_attr(feature = "speed", inline(always))]
    fn is_fresh(&self, port: &PortDeclaration, robot_us: u64) -> bool {
        port.within_us
            .is_none_or(|most_us| robot_us.saturating_sub(self.value_us) <= u64::from(most_us))
    }

    /// The value, if it has a port's type.
    fn value_for(&self, port: &PortDeclaration) -> Option<NonNull<Head>> {
        let value = self.value?;
        value.kind.is(port.kind).then_some(value.head)
    }

    fn publish(&mut self, value: Option<ErasedBuffer>, value_us: u64) {
        self.value_us = value_us;
        // Most tasks write over the value that they published before.
        if let (Some(new), Some(old)) = (value, self.value)
            && new.head == old.head
        {
            return;
        }
        if let Some(new) = value {
            new.head().count_publication();
        }
        if let Some(old) = core::mem::replace(&mut self.value, value) {
            old.head().uncount_publication();
        }
    }
}

// SAFETY: a net's reference is only followed by the executor that owns the net (invariant 1), which
// moves as a whole.
unsafe impl Send for Net {}

/// Which task: a bank of the registry and a place in it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TaskPlace {
    /// The bank's index in the registry.
    pub bank: u8,
    /// The task's place in its bank.
    pub place: u8,
}

impl TaskPlace {
    /// Both numbers in one, which is compared at once.
    #[cfg_attr(feature = "speed", inline(always))]
    fn number(self) -> u16 {
        u16::from_le_bytes([self.bank, self.place])
    }

    fn of_number(number: u16) -> Self {
        let [bank, place] = number.to_le_bytes();
        TaskPlace { bank, place }
    }
}

/// How an execution ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outcome {
    /// What the task said.
    pub step: Step,
    /// The control flags that it wrote.
    pub flags: FlagChanges,
    /// How many overruns in a row are allowed from now on, if the task said so.
    pub allowed_overruns: Option<u32>,
    /// Why the robot is to go to its safe state, if the task said so.
    pub failure: Option<SafeReason>,
}

/// What became of a background run that came back.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ReturnedRun {
    /// The run ended, its outputs are published.
    Ended(Outcome),
    /// The run ended, but its mission is over: nothing of it is kept.
    Stale,
    /// The background run is not one that this executor lent.
    Foreign,
}

/// Number of no task: there are fewer banks.
const NOBODY: u16 = u16::MAX;
/// A port that leads nowhere.
const NO_NET: u16 = u16::MAX;
/// How often it has changed which buffer a net refers to, or what a background run reads. As long
/// as it has not, an execution finds the buffers of the one before.
#[derive(Clone, Copy, PartialEq, Eq)]
struct Changes(u32);

impl Changes {
    /// Stands for no number: nothing was found yet.
    const NEVER: Changes = Changes(0);
    /// Before the first change.
    const NONE: Changes = Changes(1);
    /// So many are not told from more: what was found then is found anew each time. At a hundred
    /// changes a second that is after 497 days.
    const UNCOUNTED: Changes = Changes(u32::MAX);

    fn count(&mut self) {
        self.0 = self.0.saturating_add(1);
    }
}

/// All that an execution of a task instance needs: found once, when its mission is staged. Where
/// its values are is found again only when something has changed since the last execution.
#[derive(Clone, Copy)]
pub struct Binding {
    /// None where the robot has no such task.
    task: Option<BoundTask>,
    /// The buffer of each data port in its last execution; at first one of the port's own, if it
    /// has any.
    buffers: [Option<NonNull<Head>>; MAX_DATA_PORTS],
    /// How many changes there had been when all buffers were found at a look, if they were.
    found_at: Changes,
    /// The net of each data port, or [`NO_NET`].
    nets: [u16; MAX_DATA_PORTS],
    /// Where its flags and parameters stand; whoever binds it says so.
    pub(crate) places: TaskPlaces,
    place: TaskPlace,
    /// Bit n: the task can find what its data port n wrote or changed on no other of its ports, but
    /// where a value is on two nets.
    alone: u8,
    /// Bit n: no net refers to the buffer of data port n, or nobody has looked.
    unpublished: u8,
    /// Bit n: what data port n publishes is as new as its execution, and not as old as what it
    /// changed.
    is_new: u8,
    /// Bit n: data port n takes no value that is too old.
    is_limited: u8,
}

// A bit for each port.
const _: () = assert!(MAX_DATA_PORTS <= u8::BITS as usize);

#[derive(Clone, Copy)]
struct BoundTask {
    pointer: TaskPointer,
    declared: &'static Declaration,
    /// Where the list of banks is that the task is of (invariant 5).
    banks: NonNull<()>,
}

// SAFETY: what it points to is reached by the executor of its banks alone (invariants 1, 5), which
// is `Send` itself.
unsafe impl Send for Binding {}

impl Binding {
    /// A task instance that nothing serves.
    pub(crate) const NONE: Binding = Binding {
        task: None,
        buffers: [None; MAX_DATA_PORTS],
        found_at: Changes::NEVER,
        nets: [0; MAX_DATA_PORTS],
        places: TaskPlaces {
            first_flag: 0,
            control_flags: 0,
            first_param: 0,
            first_connection: 0,
            region: 0,
        },
        place: TaskPlace { bank: 0, place: 0 },
        alone: 0,
        unpublished: 0,
        is_new: 0,
        is_limited: 0,
    };

    /// All buffers were found at a look, after so many changes.
    fn found(&mut self, changes: Changes) {
        let is_counted = changes != Changes::UNCOUNTED;
        self.found_at = if is_counted { changes } else { Changes::NEVER };
    }

    /// Whether all buffers were found at a look, and nothing has changed since.
    #[cfg_attr(feature = "speed", inline(always))]
    fn is_found(&self, changes: Changes) -> bool {
        self.found_at == changes
    }

    /// The net of a data port, if it leads to one.
    fn net<'n>(&self, nets: &'n [Net], port: usize) -> Option<&'n Net> {
        nets.get(usize::from(*self.nets.get(port)?))
    }

    /// The task that it is of.
    pub(crate) fn place(&self) -> Option<TaskPlace> {
        self.task.map(|_| self.place)
    }

    /// Number of the task's parameters.
    pub(crate) fn param_count(&self) -> usize {
        self.task.map_or(0, |task| task.declared.params.len())
    }
}

impl core::fmt::Debug for Binding {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        self.place().fmt(f)
    }
}

impl Registry<'_> {
    /// Finds all that executions of a task need. `net_of` tells the net of each data port.
    pub(crate) fn bind(self, task: TaskPlace, net_of: impl Fn(usize) -> Option<usize>) -> Binding {
        let mut binding = Binding {
            place: task,
            ..Binding::NONE
        };
        let Some((bank, pointer)) = self
            .bank(usize::from(task.bank))
            .and_then(|bank| Some((bank, bank.task(usize::from(task.place))?)))
        else {
            return binding;
        };
        let declared = bank.declaration();
        binding.task = Some(BoundTask {
            pointer,
            declared,
            banks: self.address(),
        });
        let places = binding.nets.iter_mut().zip(&mut binding.buffers);
        for (index, (port, (bound, buffer))) in declared.ports.iter().zip(places).enumerate() {
            let net = net_of(index);
            *bound = net
                .and_then(|net| u16::try_from(net).ok())
                .unwrap_or(NO_NET);
            let buffers = bank.output(usize::from(task.place), index);
            let first = buffers.and_then(|buffers| buffers.buffer(0));
            *buffer = first.map(|first| first.head);
            let finds = declared.ports.iter().enumerate().any(|(other, declared)| {
                let reads = match declared.direction {
                    Direction::In => true,
                    Direction::InOut => port.direction == Direction::Out,
                    Direction::Out => false,
                };
                reads && net.is_some() && net_of(other) == net
            });
            if !finds {
                binding.alone |= 1 << index;
            }
            if *bound != NO_NET && port.direction == Direction::Out {
                binding.is_new |= 1 << index;
            }
            if port.within_us.is_some() && port.direction != Direction::Out {
                binding.is_limited |= 1 << index;
            }
        }
        binding
    }

    /// Binds a task instance to another task of the same type.
    pub(crate) fn bind_again(self, binding: &mut Binding, task: TaskPlace) {
        if binding.place != task {
            let (nets, places) = (binding.nets, binding.places);
            *binding = self.bind(task, |port| {
                let net = nets.get(port).copied().unwrap_or(NO_NET);
                (net != NO_NET).then_some(usize::from(net))
            });
            binding.places = places;
        }
    }

    /// What tells one robot's banks from another's: a list of banks is borrowed by one executor
    /// alone, and one with a task in it is not empty, so that its address is nobody else's.
    #[cfg_attr(feature = "speed", inline(always))]
    fn address(self) -> NonNull<()> {
        NonNull::from(self.banks).cast()
    }
}

/// Background runs that may be under way at the same time.
pub const CARRIERS: usize = 1;

/// Executes tasks: the one owner of a robot's banks and nets.
pub struct Executor<'m> {
    registry: Registry<'m>,
    nets: &'m mut [Net],
    /// Empty but while nets are carried from one mission to the next. None where they cannot be.
    nets_before: &'m mut [Net],
    /// Values that came over links.
    #[cfg(feature = "links")]
    received: &'m [ReceivedValue],
    changes: Changes,
    /// The number of the task that is lent, or [`NOBODY`].
    lent: u16,
    /// The lent background run belongs to a mission that is over.
    lent_is_stale: bool,
    /// The task that was prepared.
    call: Option<TaskPointer>,
    /// Whether its activation begins.
    enter: bool,
    /// What it sees.
    io: Io<'static>,
}

// SAFETY: tasks are `Send`, values `Send` and `Sync`, and everything that the executor's pointers
// lead to is reached by it alone or by the background run it lent, which share only values that
// neither writes (invariants 1 to 3).
unsafe impl Send for Executor<'_> {}

/// Makes a robot of banks, as `registry!` lists them. `nets` limits the number of nets of a
/// mission; there are two sets, so that one mission can follow another warm.
///
/// # Errors
/// What is wrong with the declarations; to be told at start-up, before any mission.
pub fn assemble<'m, const NETS: usize>(
    banks: &'m mut [&'m mut (dyn AnyTaskPool + 'm)],
    [nets, nets_before @ ..]: &'m mut [[Net; NETS]; MISSIONS],
) -> Result<(Executor<'m>, Registry<'m>), RegistryFault> {
    let registry = Registry { banks };
    registry.check()?;
    let nets_before = nets_before.as_flattened_mut();
    nets.fill(Net::EMPTY);
    nets_before.fill(Net::EMPTY);
    Ok((
        Executor {
            registry,
            nets,
            nets_before,
            #[cfg(feature = "links")]
            received: &[],
            changes: Changes::NONE,
            lent: NOBODY,
            lent_is_stale: false,
            call: None,
            enter: false,
            io: Io::new(IoState::EMPTY),
        },
        registry,
    ))
}

impl<'m> Executor<'m> {
    /// Gives it places for values that come over links. It borrows them mutably, so that nobody
    /// else has them (invariant 1).
    #[cfg(feature = "links")]
    pub(crate) fn with_received(mut self, places: &'m mut [ReceivedValue]) -> Self {
        self.received = places;
        self
    }

    /// The declarations of the tasks.
    pub fn registry(&self) -> Registry<'m> {
        self.registry
    }

    /// Greatest number of nets.
    pub fn net_capacity(&self) -> usize {
        self.nets.len()
    }

    /// The task that is lent, if there is one.
    pub fn checked_out(&self) -> Option<TaskPlace> {
        (self.lent != NOBODY).then(|| TaskPlace::of_number(self.lent))
    }

    /// A mission starts: nets are emptied, tasks forget what they knew. A task that is lent does so
    /// when it comes back.
    pub fn clear(&mut self) {
        self.begin_migration();
        let registry = self.registry;
        // A registry has no more banks, nor a bank more tasks, than these numbers hold.
        let all = (0..registry.len()).flat_map(|bank| {
            (0..registry.capacity(bank)).map(move |place| TaskPlace {
                bank: bank as u8,
                place: place as u8,
            })
        });
        self.end_migration(all);
    }

    /// A mission starts that goes on from the one before: from here to
    /// [`end_migration`](Self::end_migration) values can be [carried](Self::migrate_net).
    pub fn begin_migration(&mut self) {
        self.call = None;
        self.changes.count();
        if WARM {
            core::mem::swap(&mut self.nets, &mut self.nets_before);
        }
    }

    /// The value that was on a net of the mission before is on this one, unless another is already.
    pub fn migrate_net(&mut self, net: usize, before: usize) {
        if let Some(before) = self.nets_before.get(before)
            && let Some(net) = self.nets.get_mut(net).filter(|net| net.value.is_none())
        {
            self.changes.count();
            net.publish(before.value, before.value_us);
        }
    }

    /// Forgets the nets of the mission before, and lets these tasks forget what they knew. One that
    /// is lent does so when it comes back.
    pub fn end_migration(&mut self, left_behind: impl Iterator<Item = TaskPlace>) {
        let before = if WARM {
            &mut self.nets_before
        } else {
            &mut self.nets
        };
        for net in before.iter_mut() {
            net.publish(None, 0);
        }
        self.changes.count();
        self.lent_is_stale = self.lent != NOBODY;
        for task in left_behind.filter(|task| self.lent != task.number()) {
            if let Some(bank) = self.registry.bank(usize::from(task.bank)) {
                // SAFETY: the executor owns all tasks (invariant 1), except for the lent one, which
                // was left out.
                unsafe { bank.reset(usize::from(task.place)) };
            }
        }
    }

    /// Executes a task once and publishes what it wrote. `net_of` tells the net of each data port.
    /// `enter` says whether an activation begins. The mission's time is the robot's, too. `None`,
    /// and nothing is done, if a required input has no fresh value or the task is lent.
    pub fn execute(
        &mut self,
        task: TaskPlace,
        net_of: impl Fn(usize) -> Option<usize>,
        inputs: &Inputs,
        enter: bool,
    ) -> Option<Outcome> {
        let mut binding = self.registry.bind(task, net_of);
        self.begin(inputs.now_us, inputs.now_us);
        self.io.state.inputs = *inputs;
        self.prepare(&mut binding, enter);
        let step = self.run(|| ())?;
        let (flags, _) = self.end_step(&binding);
        let (allowed_overruns, failure) = self.told();
        Some(Outcome {
            step,
            flags,
            allowed_overruns,
            failure,
        })
    }

    /// All executions from here on are of an activation that starts at these times of the mission
    /// and the robot, which later ones are [counted from](Self::begin_near).
    pub(crate) fn begin(&mut self, now_us: u64, robot_us: u64) {
        self.io.state.inputs.now_us = now_us;
        self.io.state.robot_us = robot_us;
        self.io.state.since_us = 0;
    }

    /// All executions from here on are of an activation that starts so long after the times that
    /// were given last.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn begin_near(&mut self, since_us: u32) {
        self.io.state.since_us = since_us;
    }

    /// Nominal start of the activation that began last, on the robot's clock.
    pub(crate) fn robot_us(&self) -> u64 {
        self.io.state.start_robot_us()
    }

    /// What the task has noted that was executed last.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn notes(&mut self) -> &mut Notes {
        &mut self.io.state.notes
    }

    /// What the list of behaviours is to do.
    pub(crate) fn behaviours(&mut self) -> &mut CommandBox {
        &mut self.io.state.behaviours
    }

    /// What enters the next execution beside the values on nets.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn inputs(&mut self) -> &mut Inputs {
        &mut self.io.state.inputs
    }

    /// Finds the values of a task's ports for its next execution, which [`run`](Self::run) does.
    /// `enter` says whether an activation begins. Nothing [is prepared](Self::is_prepared) if a
    /// required input has no fresh value or the task is lent. Whatever changes nets, tasks or the
    /// use of buffers takes this back (invariant 3).
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn prepare(&mut self, binding: &mut Binding, enter: bool) {
        self.enter = enter;
        self.call = self.find_call(binding);
    }

    /// Whether a task is prepared.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn is_prepared(&self) -> bool {
        self.call.is_some()
    }

    /// The task of a binding, for whose next execution all is found. None if it cannot be executed.
    #[cfg_attr(feature = "speed", inline(always))]
    fn find_call(&mut self, binding: &mut Binding) -> Option<TaskPointer> {
        let task = binding.task?;
        if self.lent == binding.place.number() || task.banks != self.registry.address() {
            return None;
        }
        self.io.state.done = 0;
        let ports = task.declared.ports;
        self.io.state.ports = ports;
        if !ports.is_empty() {
            let is_known = binding.is_found(self.changes)
                && (binding.is_limited == 0 || self.are_fresh(binding, ports));
            if !is_known && !self.connect(binding, task) {
                return None;
            }
            self.io.state.take_buffers(&binding.buffers, ports.len());
        }
        Some(task.pointer)
    }

    /// What was prepared is not executed.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn forget(&mut self) {
        self.call = None;
    }

    /// Executes the task that was prepared, if one was, and `begin` before it. What the task wrote
    /// is published by [`end_step`](Self::end_step).
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn run(&mut self, begin: impl FnOnce()) -> Option<Step> {
        let task = self.call?;
        begin();
        // SAFETY: the pointer is of a task of this executor's banks (invariant 5), which owns it
        // (invariant 1). It is not lent: it was not when it was prepared, and lending takes that
        // back.
        let step = unsafe { (task.step)(task.place, self.enter, &mut self.io) };
        self.call = None;
        Some(step)
    }

    /// Publishes what the task wrote that was executed last. Returns the control flags that it
    /// wrote, and whether it [told](Self::told) something else.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(crate) fn end_step(&mut self, binding: &Binding) -> (FlagChanges, bool) {
        let done = self.io.state.done;
        if done & WRITTEN_PORTS != 0 {
            self.publish(binding);
        }
        (self.io.state.flag_changes(), done & HAS_TOLD != 0)
    }

    /// What else the task said that was executed last.
    pub(crate) fn told(&self) -> (Option<u32>, Option<SafeReason>) {
        self.io.state.told()
    }

    /// Whether no value is too old on the data ports that mind.
    #[inline(never)]
    fn are_fresh(&self, binding: &Binding, ports: &[PortDeclaration]) -> bool {
        let robot_us = self.robot_us();
        let mut limited = binding.is_limited;
        while limited != 0 {
            let index = limited.trailing_zeros() as usize;
            limited &= limited - 1;
            let net = binding.net(self.nets, index);
            if let (Some(net), Some(port)) = (net, ports.get(index))
                && !net.is_fresh(port, robot_us)
            {
                return false;
            }
        }
        true
    }

    /// Finds the buffer of each data port. False if a required input has no fresh value.
    #[inline(never)]
    fn connect(&mut self, binding: &mut Binding, task: BoundTask) -> bool {
        let robot_us = self.robot_us();
        binding.found_at = Changes::NEVER;
        binding.unpublished = 0;
        for (index, port) in task.declared.ports.iter().enumerate() {
            let Some(found) = usual_value(self.nets, binding, index, port, robot_us) else {
                return self.connect_anew(binding, task);
            };
            if found.is_none() && !port.optional {
                return false;
            }
            if let Some(buffer) = binding.buffers.get_mut(index) {
                *buffer = found;
            }
            let net = binding.net(self.nets, index);
            if net.is_some_and(|net| net.value.map(|value| value.head) != found) {
                binding.unpublished |= 1 << index;
            }
        }
        binding.found(self.changes);
        true
    }

    /// Finds the buffer of each data port where for one of them a look at its net is not enough.
    fn connect_anew(&mut self, binding: &mut Binding, task: BoundTask) -> bool {
        let robot_us = self.robot_us();
        binding.unpublished = u8::MAX;
        for (index, port) in task.declared.ports.iter().enumerate() {
            let found = find_buffer(
                self.nets,
                self.registry,
                binding,
                task,
                index,
                robot_us,
                true,
            );
            if found.is_none() && !port.optional {
                return false;
            }
            if let Some(buffer) = binding.buffers.get_mut(index) {
                *buffer = found;
            }
        }
        true
    }

    /// Publishes what the task wrote. What was changed keeps its time.
    #[cfg_attr(feature = "speed", inline(always))]
    fn publish(&mut self, binding: &Binding) {
        let mut new = self.io.state.done & u32::from(binding.is_new);
        while new != 0 {
            let index = new.trailing_zeros() as usize;
            new &= new - 1;
            if let Some(&net) = binding.nets.get(index)
                && let Some(net) = self.nets.get_mut(usize::from(net))
            {
                net.value_us = self.io.state.start_robot_us();
            }
        }
        // Else nets refer already to what it wrote over.
        if self.io.state.done & u32::from(binding.unpublished) != 0 {
            self.publish_others(binding);
        }
    }

    /// Publishes what the task wrote where a net does not refer to it yet.
    #[inline(never)]
    fn publish_others(&mut self, binding: &Binding) {
        let mut written = self.io.state.done & u32::from(binding.unpublished);
        while written != 0 {
            let index = written.trailing_zeros() as usize;
            written &= written - 1;
            if let (Some(&net), Some(port)) =
                (binding.nets.get(index), self.io.state.ports.get(index))
                && let (Some(net), Some(&Some(head))) = (
                    self.nets.get_mut(usize::from(net)),
                    self.io.state.values.get(index),
                )
                && net.value.is_none_or(|value| value.head != head)
            {
                let kind = port.kind;
                self.changes.count();
                net.publish(Some(ErasedBuffer { head, kind }), net.value_us);
            }
        }
    }

    /// Lends a task for one run in slot 0, with the values that are on its inputs now. `net_of`
    /// tells the net of each data port. See `checkout_bound`.
    pub fn checkout(
        &mut self,
        task: TaskPlace,
        net_of: impl Fn(usize) -> Option<usize>,
        step_us: u64,
        find_inputs: impl FnOnce(&mut Inputs, &Declaration),
    ) -> Option<BackgroundRun<'m>> {
        let binding = self.registry.bind(task, net_of);
        self.checkout_bound(&binding, step_us, find_inputs)
    }

    /// Lends a task for one run in slot 0, with the values that are on its inputs now. Their age is
    /// that at `step_us` on the robot's clock, the last macro step. `None`, and nothing is done, if
    /// a required input has no fresh value or a task is lent already.
    pub(crate) fn checkout_bound(
        &mut self,
        binding: &Binding,
        step_us: u64,
        find_inputs: impl FnOnce(&mut Inputs, &Declaration),
    ) -> Option<BackgroundRun<'m>> {
        self.call = None;
        let task = binding.task?;
        if task.banks != self.registry.address() || self.lent != NOBODY {
            return None;
        }
        let mut state = IoState {
            ports: task.declared.ports,
            robot_us: step_us,
            ..IoState::EMPTY
        };
        let mut times_us = [0; MAX_DATA_PORTS];
        for (index, port) in task.declared.ports.iter().enumerate() {
            let net = binding.net(self.nets, index);
            let found = find_buffer(
                self.nets,
                self.registry,
                binding,
                task,
                index,
                step_us,
                false,
            );
            if found.is_none() && !port.optional {
                return None;
            }
            if let (Some(value), Some(time_us)) =
                (state.values.get_mut(index), times_us.get_mut(index))
            {
                *value = found;
                *time_us = net.map_or(0, |net| net.value_us);
            }
        }
        find_inputs(&mut state.inputs, task.declared);
        for value in read_by(&state) {
            // SAFETY: a value on a net is in a buffer of this executor's banks (invariant 1).
            unsafe { head(value) }.pin();
            self.changes.count();
        }
        self.lent = binding.place.number();
        self.lent_is_stale = false;
        Some(BackgroundRun {
            binding: *binding,
            banks: self.registry.banks,
            io: Io::new(state),
            times_us,
            entered: false,
            step: Step::Run,
        })
    }

    /// Takes a background run back and publishes what its run wrote, where its mission still runs.
    /// The time of that is `step_us` on the robot's clock, the macro step that notes the run's end.
    pub fn return_run(&mut self, background_run: BackgroundRun<'m>, step_us: u64) -> ReturnedRun {
        self.call = None;
        // A list of banks is borrowed by one executor alone, and one that has lent a task is not
        // empty: its address is nobody else's.
        let own = core::ptr::eq(self.registry.banks, background_run.banks);
        if !own || self.lent != background_run.binding.place.number() {
            return ReturnedRun::Foreign;
        }
        for value in read_by(&background_run.io.state) {
            // SAFETY: the background run is one of this executor's, so that its values are in
            // buffers of its banks (invariant 1).
            unsafe { head(value) }.unpin();
        }
        self.lent = NOBODY;
        if core::mem::take(&mut self.lent_is_stale) {
            let place = background_run.binding.place;
            if let Some(bank) = self.registry.bank(usize::from(place.bank)) {
                // SAFETY: the background run is back, so that the executor owns the task again.
                unsafe { bank.reset(usize::from(place.place)) };
            }
            return ReturnedRun::Stale;
        }
        let written =
            |index: &usize| background_run.io.state.done & WRITTEN_PORTS & 1 << index != 0;
        for index in (0..MAX_DATA_PORTS).filter(written) {
            if let (Some(port), Some(&bound), Some(&value), Some(&time_us)) = (
                background_run.io.state.ports.get(index),
                background_run.binding.nets.get(index),
                background_run.io.state.values.get(index),
                background_run.times_us.get(index),
            ) && let Some(net) = self.nets.get_mut(usize::from(bound))
            {
                self.changes.count();
                let kind = port.kind;
                let keeps_time = port.direction == Direction::InOut;
                let value_us = if keeps_time { time_us } else { step_us };
                net.publish(value.map(|head| ErasedBuffer { head, kind }), value_us);
            }
        }
        let (allowed_overruns, failure) = background_run.io.state.told();
        ReturnedRun::Ended(Outcome {
            step: background_run.step,
            flags: background_run.io.state.flag_changes(),
            allowed_overruns,
            failure,
        })
    }

    /// The value on a net, to be written into payloads.
    #[cfg(feature = "links")]
    pub(crate) fn value_to_send(&self, net: usize) -> Option<ValueToSend<'_>> {
        let value = self.nets.get(net)?.value?;
        Some(ValueToSend {
            head: value.head.cast(),
            codec: value.kind.codec(),
            executor: PhantomData,
        })
    }

    /// Publishes the value of a payload on a net. Where the last one that came so is on no other
    /// net, and no background run reads it, it is written over. False if there is no place for it.
    #[cfg(feature = "links")]
    pub(crate) fn take_value(
        &mut self,
        net: usize,
        kind: ValueKind,
        payload: &[u8],
        value_us: u64,
    ) -> bool {
        self.call = None;
        let codec = kind.codec();
        let fits = payload.len() == codec.payload_bytes
            && codec.buffer_bytes <= VALUE_BYTES
            && codec.buffer_align <= align_of::<u64>();
        let Some(net) = self.nets.get_mut(net).filter(|_| fits) else {
            return false;
        };
        let first = self.received.as_ptr().addr();
        let places = self.received.iter();
        let mut places = places.map(|place| NonNull::from(&place.0).cast::<Head>());
        let own = net.value.filter(|value| {
            let from_first = value.head.addr().get().wrapping_sub(first);
            let is_own = from_first < size_of_val(self.received);
            is_own && value.kind.is(kind) && value.head().uses.get() == PUBLISHED_ONCE
        });
        let free = || {
            // SAFETY: these places outlive the executor, and each begins with a head: its memory is
            // zeros at first, which is a free one, and nobody but this function writes into it.
            places.find(|place| unsafe { head(*place) }.is_free())
        };
        let Some(place) = own.map(|value| value.head).or_else(free) else {
            return false;
        };
        // SAFETY: the place is aligned for any value that fits, as was asked above, and the pointer
        // has provenance over all of it. No net but this one refers to it and no background run
        // reads it, so that nobody looks at the value (invariant 3).
        unsafe { (codec.take)(payload, place.cast()) };
        if own.is_none() {
            self.changes.count();
        }
        net.publish(Some(ErasedBuffer { head: place, kind }), value_us);
        true
    }

    /// Publishes a value from outside on a net, which is as fresh as anyone wants it: how a
    /// [`TaskBench`](crate::TaskBench) gives inputs.
    #[cfg(any(test, feature = "std"))]
    pub(crate) fn inject<V: PortType>(
        &mut self,
        net: usize,
        value: V,
        storage: &'m mut Buffered<V>,
    ) {
        self.call = None;
        self.changes.count();
        let [buffer, ..] = &mut storage.buffers;
        *buffer.value.get_mut() = value;
        let storage: &'m Buffered<V> = storage;
        if let Some(net) = self.nets.get_mut(net) {
            net.publish(storage.buffer(0), u64::MAX);
        }
    }

    /// Takes the value off a net.
    #[cfg(any(test, feature = "std"))]
    pub(crate) fn empty(&mut self, net: usize) {
        self.call = None;
        self.changes.count();
        if let Some(net) = self.nets.get_mut(net) {
            net.publish(None, 0);
        }
    }

    /// Shows the value on a net. False if it holds none.
    #[cfg(feature = "telemetry")]
    pub(crate) fn show(&self, net: u16, show: &mut Show<'_>) -> bool {
        let Some(value) = self.nets.get(usize::from(net)).and_then(|net| net.value) else {
            return false;
        };
        // SAFETY: the type is the one that the buffer was made for (invariant 4), and a published
        // value is not written except while a task is executed, which borrows the executor mutably
        // (invariant 3).
        unsafe { value.kind.tell()(Some(value.head.cast()), show) };
        true
    }

    /// What the values are made of that tasks of a bank write on a port: [`PortType::FIELDS`].
    #[cfg(feature = "telemetry")]
    pub(crate) fn fields(&self, bank: u8, port: usize) -> Option<&'static str> {
        let buffer = self
            .registry
            .bank(bank.into())?
            .output(0, port)?
            .buffer(0)?;
        // SAFETY: it is given no buffer to look into.
        Some(unsafe { buffer.kind.tell()(None, &mut Show::new(&[])) })
    }

    /// What values of a kind are made of.
    #[cfg(all(feature = "telemetry", feature = "links"))]
    pub(crate) fn fields_of(kind: ValueKind) -> Option<&'static str> {
        // SAFETY: it is given no buffer to look into.
        Some(unsafe { kind.tell()(None, &mut Show::new(&[])) })
    }

    /// What values of a kind are made of: this firmware does not know.
    #[cfg(all(not(feature = "telemetry"), feature = "links"))]
    pub(crate) fn fields_of(_kind: ValueKind) -> Option<&'static str> {
        None
    }

    /// What the values are made of that tasks of a bank write on a port: this firmware does not
    /// know.
    #[cfg(not(feature = "telemetry"))]
    pub(crate) fn fields(&self, _bank: u8, _port: usize) -> Option<&'static str> {
        None
    }

    /// The value on a net, if there is one and it has this type.
    pub fn value_on<V: PortType>(&self, net: usize) -> Option<V> {
        let value = self.nets.get(net)?.value?.value::<V>()?;
        // SAFETY: a published value is not written except while a task is executed, which borrows
        // the executor mutably (invariant 3).
        Some(unsafe { value.read() })
    }
}

/// The values that an execution reads.
fn read_by(state: &IoState) -> impl Iterator<Item = NonNull<Head>> {
    let ports = state.ports.iter().zip(&state.values);
    ports
        .filter(|(port, _)| port.direction == Direction::In)
        .filter_map(|(_, value)| *value)
}

/// The buffer of a port, where it takes no more than a look at its net: whose value it reads, or
/// writes over or changes in place, since it can be seen nowhere else.
fn usual_value(
    nets: &[Net],
    binding: &Binding,
    index: usize,
    port: &PortDeclaration,
    robot_us: u64,
) -> Option<Option<NonNull<Head>>> {
    let net = binding.net(nets, index);
    let is_alone = binding.alone >> index & 1 != 0;
    // SAFETY: a value on a net is in a buffer of its executor's banks (invariant 1).
    let is_own =
        |value: NonNull<Head>| is_alone && unsafe { head(value) }.uses.get() == PUBLISHED_ONCE;
    if port.direction == Direction::Out {
        // Of the port's own buffers, so that it has the port's type.
        let last = (*binding.buffers.get(index)?)?;
        let is_usual = match net {
            // What it wrote last is written over, or, where that is nowhere any more, written anew.
            Some(net) => match net.value {
                Some(value) if value.head == last => is_own(last),
                // SAFETY: it is a buffer of the executor's banks (invariant 1).
                _ => unsafe { head(last) }.is_free(),
            },
            // Nobody ever reads a buffer of a port that leads nowhere.
            None => binding.nets.get(index) == Some(&NO_NET),
        };
        return is_usual.then_some(Some(last));
    }
    let Some((net, value)) = net.and_then(|net| Some((net, net.value?))) else {
        return Some(None);
    };
    let is_usual = value.kind.is_same(port.kind)
        && net.is_fresh(port, robot_us)
        && (port.direction == Direction::In || is_own(value.head));
    is_usual.then_some(Some(value.head))
}

/// Finds the buffer of a port: that of the fresh value on its net where it is read; where it is
/// written or changed, one that nobody else looks at, for an execution's first value, beside a
/// background run that reads the last one, or in a background run itself. `None` where the task
/// cannot be executed, or the port is optional and has no value.
#[inline(never)]
fn find_buffer(
    nets: &[Net],
    registry: Registry<'_>,
    binding: &Binding,
    task: BoundTask,
    index: usize,
    robot_us: u64,
    in_place: bool,
) -> Option<NonNull<Head>> {
    let ports = task.declared.ports;
    let port = ports.get(index)?;
    if port.direction == Direction::In {
        return binding.net(nets, index)?.fresh(port, robot_us);
    }
    let bank = registry.bank(usize::from(binding.place.bank))?;
    let buffers = bank.output(usize::from(binding.place.place), index)?;
    let net_of = |port: usize| binding.net(nets, port);
    let is_changed = port.direction == Direction::InOut;
    let current = net_of(index).and_then(|net| {
        net.value_for(port)?;
        if is_changed {
            net.fresh(port, robot_us)?;
        }
        net.value
    });
    // No background run reads it, nor the task itself through another port.
    let unread = current.filter(|current| {
        let mut others = ports
            .iter()
            .enumerate()
            .filter(|(_, other)| match other.direction {
                Direction::In => true,
                Direction::InOut => !is_changed,
                Direction::Out => false,
            });
        let is_on = |port: usize| {
            let other = net_of(port).and_then(|net| net.value);
            other.is_some_and(|other| other.head == current.head)
        };
        in_place && !current.head().is_pinned() && !others.any(|(port, _)| is_on(port))
    });
    let chosen = if is_changed {
        let current = current?;
        match unread {
            Some(value) => value,
            None => {
                let own = buffers.free_buffer()?;
                // SAFETY: `current` is published, so that nobody writes it now; `own` is free, so
                // that nobody looks at it.
                unsafe { buffers.copy(current, own) };
                own
            }
        }
    } else {
        // Another net that refers to it, or another task's buffer, is not this port's to change.
        match unread {
            Some(last) if last.head().publications() == 1 && buffers.owns(last) => last,
            _ => buffers.free_buffer()?,
        }
    };
    Some(chosen.head)
}

/// One run of a task in slot 0. It owns the task and what it reads and writes until it is given
/// back to the executor.
pub struct BackgroundRun<'m> {
    binding: Binding,
    banks: &'m [&'m mut (dyn AnyTaskPool + 'm)],
    io: Io<'static>,
    /// The time of each `inout` port's value, which it keeps when it is published again.
    times_us: [u64; MAX_DATA_PORTS],
    entered: bool,
    step: Step,
}

// SAFETY: tasks are `Send`, values `Send` and `Sync`. What a background run points to is not
// written by anyone else while it is out (invariants 2, 3), and it never touches the heads of its
// buffers.
unsafe impl Send for BackgroundRun<'_> {}

impl BackgroundRun<'_> {
    /// Which task runs.
    pub fn task(&self) -> TaskPlace {
        self.binding.place
    }

    /// Executes the task once more. The run ends with [`Step::Finished`]; after that this does
    /// nothing.
    pub fn step(&mut self) -> Step {
        if self.step == Step::Run {
            let Some(task) = self.binding.task else {
                return Step::Finished;
            };
            let TaskPointer { place, step } = task.pointer;
            // SAFETY: the task is lent to this background run (invariant 2), of which there is one.
            self.step = unsafe { step(place, !self.entered, &mut self.io) };
            self.entered = true;
        }
        self.step
    }
}

#[cfg(test)]
mod tests {
    use proptest::strategy::Strategy;

    use super::*;
    use crate::registry::nets;
    use crate::task;

    #[derive(Clone, Copy, Debug, PartialEq)]
    struct Count(u32);
    impl PortType for Count {
        const NAME: &'static str = "Count";
        const INIT: Self = Count(0);
    }

    /// Counts its executions and publishes the number.
    struct Source {
        count: u32,
    }
    task! { impl Source { data { out count: Count; } } }
    impl Task for Source {
        fn reset(&mut self) {
            self.count = 0;
        }
        fn step(&mut self, io: &mut Io<'_>) -> Step {
            self.count += 1;
            *io.write(Self::COUNT) = Count(self.count);
            Step::Run
        }
    }

    /// Adds 100 to what it finds.
    struct Adder;
    task! { impl Adder { data { in also: Count optional; inout count: Count; } } }
    impl Task for Adder {
        fn step(&mut self, io: &mut Io<'_>) -> Step {
            let also = io.try_read(Self::ALSO);
            let before = also.copied();
            io.update(Self::COUNT).0 += 100;
            assert_eq!(
                also.copied(),
                before,
                "what a task reads is constant while it is executed"
            );
            Step::Run
        }
    }

    /// Remembers what it reads, and runs for several steps.
    struct Reader {
        seen: [u32; 3],
        steps: usize,
    }
    task! { impl Reader { data { in count: Count; out sum: Count; } } }
    impl Task for Reader {
        fn reset(&mut self) {
            self.steps = 0;
        }
        fn enter(&mut self) {
            self.steps = 0;
        }
        fn step(&mut self, io: &mut Io<'_>) -> Step {
            self.seen[self.steps] = io.read(Self::COUNT).0;
            self.steps += 1;
            if self.steps < 3 {
                return Step::Run;
            }
            *io.write(Self::SUM) = Count(self.seen.iter().sum());
            Step::Finished
        }
    }

    struct Robot {
        source: TaskPool<Source, 2>,
        adder: TaskPool<Adder, 1>,
        reader: TaskPool<Reader, 1>,
    }

    impl Robot {
        fn new() -> Self {
            Robot {
                source: TaskPool::new([Source { count: 0 }, Source { count: 1000 }]),
                adder: TaskPool::new([Adder]),
                reader: TaskPool::new([Reader {
                    seen: [0; 3],
                    steps: 0,
                }]),
            }
        }

        fn banks(&mut self) -> [&mut (dyn AnyTaskPool + '_); 3] {
            [&mut self.source, &mut self.adder, &mut self.reader]
        }
    }

    const SOURCE: TaskPlace = TaskPlace { bank: 0, place: 0 };
    const OTHER_SOURCE: TaskPlace = TaskPlace { bank: 0, place: 1 };
    const ADDER: TaskPlace = TaskPlace { bank: 1, place: 0 };
    const READER: TaskPlace = TaskPlace { bank: 2, place: 0 };
    const NET: usize = 0;
    const SUM: usize = 1;

    fn source_net(_: usize) -> Option<usize> {
        Some(NET)
    }
    fn adder_net(port: usize) -> Option<usize> {
        [None, Some(NET)][port]
    }
    fn adder_reads_too(_: usize) -> Option<usize> {
        Some(NET)
    }
    fn reader_net(port: usize) -> Option<usize> {
        [Some(NET), Some(SUM)][port]
    }

    fn with_robot(test: impl FnOnce(&mut Executor<'_>)) {
        let mut robot = Robot::new();
        let mut banks = robot.banks();
        let mut nets = nets::<2>();
        let (mut executor, _) = assemble(&mut banks, &mut nets).unwrap();
        test(&mut executor);
    }

    fn step(
        executor: &mut Executor<'_>,
        task: TaskPlace,
        net_of: fn(usize) -> Option<usize>,
    ) -> bool {
        executor
            .execute(task, net_of, &Inputs::default(), false)
            .is_some()
    }

    #[test]
    fn a_task_without_its_input_is_not_executed() {
        with_robot(|executor| {
            assert!(!step(executor, READER, reader_net));
            assert!(!step(executor, ADDER, adder_net));
            assert!(
                executor
                    .checkout(READER, reader_net, 0, |_, _| ())
                    .is_none()
            );
            assert!(step(executor, SOURCE, source_net));
            assert!(step(executor, READER, reader_net));
        });
    }

    #[test]
    fn a_net_holds_what_was_published_last() {
        with_robot(|executor| {
            for expected in 1..20 {
                step(executor, SOURCE, source_net);
                assert_eq!(executor.value_on(NET), Some(Count(expected)));
            }
            assert_eq!(executor.value_on::<u32>(NET), None, "of another type");
        });
    }

    #[test]
    fn inout_changes_the_value_in_place() {
        with_robot(|executor| {
            step(executor, SOURCE, source_net);
            let before = executor.nets[NET].value.unwrap().head;
            step(executor, ADDER, adder_net);
            assert_eq!(executor.value_on(NET), Some(Count(101)));
            assert_eq!(executor.nets[NET].value.unwrap().head, before);
        });
    }

    #[test]
    fn inout_copies_what_its_task_reads_too() {
        with_robot(|executor| {
            step(executor, SOURCE, source_net);
            let before = executor.nets[NET].value.unwrap().head;
            for round in 1..5 {
                assert!(step(executor, ADDER, adder_reads_too));
                assert_eq!(executor.value_on(NET), Some(Count(1 + 100 * round)));
                assert_ne!(executor.nets[NET].value.unwrap().head, before);
            }
        });
    }

    #[test]
    fn a_lent_task_reads_constant_values_while_their_writers_go_on() {
        with_robot(|executor| {
            step(executor, SOURCE, source_net);
            let mut background_run = executor.checkout(READER, reader_net, 0, |_, _| ()).unwrap();
            assert!(
                executor
                    .checkout(READER, reader_net, 0, |_, _| ())
                    .is_none(),
                "one job at a time"
            );
            assert!(
                !step(executor, READER, reader_net),
                "a lent task is not executed"
            );
            let background_run = std::thread::scope(|threads| {
                let runner = threads.spawn(move || {
                    while background_run.step() == Step::Run {}
                    background_run
                });
                for _ in 0..10 {
                    assert!(step(executor, SOURCE, source_net));
                    assert!(step(executor, ADDER, adder_net));
                }
                runner.join().unwrap()
            });
            assert_eq!(
                executor.value_on::<Count>(SUM),
                None,
                "published when it comes back"
            );
            let returned = executor.return_run(background_run, 0);
            assert_eq!(
                returned,
                ReturnedRun::Ended(Outcome {
                    step: Step::Finished,
                    flags: FlagChanges::default(),
                    allowed_overruns: None,
                    failure: None,
                })
            );
            assert_eq!(executor.value_on(SUM), Some(Count(3)));
            assert!(
                executor
                    .checkout(READER, reader_net, 0, |_, _| ())
                    .is_some()
            );
        });
    }

    #[test]
    fn a_real_time_task_writes_over_its_last_value_unless_somebody_reads_it() {
        with_robot(|executor| {
            let published = |executor: &Executor<'_>| executor.nets[NET].value.unwrap().head;
            step(executor, SOURCE, source_net);
            let first = published(executor);
            step(executor, SOURCE, source_net);
            assert_eq!(published(executor), first);
            let background_run = executor.checkout(READER, reader_net, 0, |_, _| ()).unwrap();
            step(executor, SOURCE, source_net);
            let second = published(executor);
            assert_ne!(second, first, "the first is being read");
            step(executor, SOURCE, source_net);
            assert_eq!(published(executor), second);
            executor.return_run(background_run, 0);
            // Another task's value is left alone.
            step(executor, OTHER_SOURCE, source_net);
            let others = published(executor);
            step(executor, SOURCE, source_net);
            assert_ne!(published(executor), others);
            assert_eq!(executor.value_on(NET), Some(Count(5)));
        });
    }

    #[test]
    fn what_a_task_changes_and_what_it_writes_are_two_values_on_one_net() {
        struct Both;
        task! { impl Both { data { inout total: Count; out next: Count; } } }
        impl Task for Both {
            fn step(&mut self, io: &mut Io<'_>) -> Step {
                *io.write(Self::NEXT) = Count(1);
                io.update(Self::TOTAL).0 += 10;
                Step::Run
            }
        }
        let mut source = TaskPool::new([Source { count: 0 }]);
        let mut both = TaskPool::new([Both]);
        let mut banks: [&mut dyn AnyTaskPool; 2] = [&mut source, &mut both];
        let mut nets = nets::<1>();
        let (mut executor, _) = assemble(&mut banks, &mut nets).unwrap();
        let both = TaskPlace { bank: 1, place: 0 };
        step(&mut executor, SOURCE, source_net);
        for _ in 0..5 {
            assert!(step(&mut executor, both, source_net));
            assert_eq!(
                executor.value_on(NET),
                Some(Count(1)),
                "the later port wins"
            );
        }
    }

    /// Wants a value that is fresh, and says what it found.
    struct Careful;
    task! { impl Careful { data { in count: Count within 100 us; in also: Count optional within 30 us; out sum: Count; } } }
    impl Task for Careful {
        fn step(&mut self, io: &mut Io<'_>) -> Step {
            let also = io.try_read(Self::ALSO).map_or(1_000, |also| also.0);
            *io.write(Self::SUM) = Count(io.read(Self::COUNT).0 + also);
            Step::Finished
        }
    }

    /// Changes what is fresh.
    struct Changer;
    task! { impl Changer { data { inout count: Count within 100 us; } } }
    impl Task for Changer {
        fn step(&mut self, io: &mut Io<'_>) -> Step {
            io.update(Self::COUNT).0 += 100;
            Step::Run
        }
    }

    const CAREFUL: TaskPlace = TaskPlace { bank: 3, place: 0 };
    const CHANGER: TaskPlace = TaskPlace { bank: 4, place: 0 };
    fn careful_net(port: usize) -> Option<usize> {
        [Some(NET), Some(NET), Some(SUM)][port]
    }

    fn with_careful_robot(test: impl FnOnce(&mut Executor<'_>)) {
        let mut robot = Robot::new();
        let [source, adder, reader] = robot.banks();
        let mut careful = TaskPool::new([Careful]);
        let mut changer = TaskPool::new([Changer]);
        let mut banks: [&mut dyn AnyTaskPool; 5] =
            [source, adder, reader, &mut careful, &mut changer];
        let mut nets = nets::<2>();
        let (mut executor, _) = assemble(&mut banks, &mut nets).unwrap();
        test(&mut executor);
    }

    fn step_at(
        executor: &mut Executor<'_>,
        now_us: u64,
        task: TaskPlace,
        net_of: fn(usize) -> Option<usize>,
    ) -> bool {
        let inputs = Inputs {
            now_us,
            ..Inputs::default()
        };
        executor.execute(task, net_of, &inputs, false).is_some()
    }

    #[test]
    fn a_value_that_is_older_than_wanted_is_none() {
        const PUBLISHED_US: u64 = u32::MAX as u64 * 3;
        with_careful_robot(|executor| {
            step_at(executor, PUBLISHED_US, SOURCE, source_net);
            // Its age; whether the task is executed, and with which sum. One that comes from the
            // future is new.
            for (now_us, sum) in [
                (PUBLISHED_US - 1, Some(2)),
                (PUBLISHED_US, Some(2)),
                (PUBLISHED_US + 30, Some(2)),
                (PUBLISHED_US + 31, Some(1_001)),
                (PUBLISHED_US + 100, Some(1_001)),
                (PUBLISHED_US + 101, None),
                (PUBLISHED_US + u64::from(u32::MAX) + 1, None),
                (u64::MAX, None),
            ] {
                let is_executed = step_at(executor, now_us, CAREFUL, careful_net);
                assert_eq!(is_executed, sum.is_some(), "{now_us}");
                let mut background_run = executor.checkout(CAREFUL, careful_net, now_us, |_, _| ());
                assert_eq!(background_run.is_some(), sum.is_some(), "{now_us}");
                if let Some(mut background_run) = background_run.take() {
                    assert_eq!(background_run.step(), Step::Finished);
                    executor.return_run(background_run, now_us);
                    assert_eq!(executor.value_on(SUM), sum.map(Count), "{now_us}");
                }
            }
            // The other ports of the net want nothing of the kind.
            assert!(step_at(executor, u64::MAX, READER, reader_net));
        });
    }

    /// What happens to a robot's values.
    #[derive(Clone, Copy, Debug)]
    enum Happens {
        /// A task is executed, so many microseconds later.
        Execution(usize, u64),
        /// A task is lent, or what was lent comes back after so many steps.
        BackgroundRun(usize, usize),
        /// A mission takes over that has the same nets, and keeps this one's value.
        Migration(usize),
        /// The mission begins anew.
        Clear,
    }

    /// A task, and the nets of its ports.
    type Instance = (TaskPlace, fn(usize) -> Option<usize>);
    const INSTANCES: [Instance; 5] = [
        (SOURCE, source_net),
        (OTHER_SOURCE, source_net),
        (ADDER, adder_reads_too),
        (CAREFUL, careful_net),
        (READER, reader_net),
    ];

    /// Whether something was done, and what is on the nets then: values and their times.
    type Published = (bool, [Option<(Count, u64)>; 2]);

    /// What tasks have published after each of these, where each execution finds its buffers anew,
    /// or where bindings are kept from one to the next.
    fn published_after(happens: &[Happens], are_kept: bool) -> Vec<Published> {
        let mut all = Vec::new();
        with_careful_robot(|executor| {
            let registry = executor.registry();
            let mut bindings = INSTANCES.map(|(task, net_of)| registry.bind(task, net_of));
            let mut lent = None;
            let mut now_us = 0;
            for &happens in happens {
                let is_executed = match happens {
                    Happens::Execution(instance, later_us) => {
                        now_us += later_us;
                        let binding = &mut bindings[instance];
                        if !are_kept {
                            binding.found_at = Changes::NEVER;
                        }
                        executor.begin(now_us, now_us);
                        executor.prepare(binding, true);
                        let is_executed = executor.is_prepared();
                        if is_executed {
                            executor.run(|| ()).unwrap();
                            executor.end_step(binding);
                        }
                        is_executed
                    }
                    Happens::BackgroundRun(instance, steps) => match lent.take() {
                        None => {
                            let binding = &bindings[instance];
                            lent = executor.checkout_bound(binding, now_us, |_, _| ());
                            lent.is_some()
                        }
                        Some(mut run) => {
                            (0..steps).for_each(|_| _ = BackgroundRun::step(&mut run));
                            matches!(executor.return_run(run, now_us), ReturnedRun::Ended(_))
                        }
                    },
                    Happens::Migration(net) => {
                        executor.begin_migration();
                        executor.migrate_net(net, net);
                        executor.end_migration(core::iter::empty());
                        true
                    }
                    Happens::Clear => {
                        executor.clear();
                        true
                    }
                };
                let on = |net: usize| Some((executor.value_on(net)?, executor.nets[net].value_us));
                all.push((is_executed, [on(NET), on(SUM)]));
            }
        });
        all
    }

    proptest::proptest! {
        #![proptest_config(proptest::prelude::ProptestConfig::with_cases(8_192))]
        #[test]
        fn an_execution_finds_what_one_finds_that_looks_anew(
            happens in proptest::collection::vec(
                proptest::prop_oneof![
                    12 => (0..INSTANCES.len(), 0..40_u64)
                        .prop_map(|(instance, later_us)| Happens::Execution(instance, later_us)),
                    4 => (0..INSTANCES.len(), 0..4_usize)
                        .prop_map(|(instance, steps)| Happens::BackgroundRun(instance, steps)),
                    1 => (0..2_usize).prop_map(Happens::Migration),
                    1 => proptest::strategy::Just(Happens::Clear),
                ],
                1..60,
            ),
        ) {
            proptest::prop_assert_eq!(
                published_after(&happens, true),
                published_after(&happens, false)
            );
        }
    }

    #[test]
    fn a_value_that_is_changed_keeps_its_time() {
        with_careful_robot(|executor| {
            step_at(executor, 1_000, SOURCE, source_net);
            assert!(step_at(executor, 1_060, CHANGER, source_net));
            assert!(step_at(executor, 1_100, CHANGER, source_net));
            assert!(!step_at(executor, 1_101, CHANGER, source_net));
            assert!(!step_at(executor, 1_101, CAREFUL, careful_net));
            assert_eq!(executor.value_on(NET), Some(Count(201)));
            // Changed in a background run while it was written anew: the older value is published,
            // with the time that it had.
            step_at(executor, 2_000, SOURCE, source_net);
            let mut background_run = executor
                .checkout(CHANGER, source_net, 2_000, |_, _| ())
                .unwrap();
            background_run.step();
            step_at(executor, 2_090, SOURCE, source_net);
            executor.return_run(background_run, 2_095);
            assert_eq!(executor.value_on(NET), Some(Count(102)));
            assert!(step_at(executor, 2_100, CAREFUL, careful_net));
            assert!(!step_at(executor, 2_101, CAREFUL, careful_net));
        });
    }

    #[test]
    fn what_a_run_in_slot_0_writes_is_as_old_as_the_step_that_notes_its_end() {
        with_careful_robot(|executor| {
            step_at(executor, 1_000, SOURCE, source_net);
            let background_run = executor.checkout(SOURCE, source_net, 1_000, |_, _| ());
            let mut background_run = background_run.unwrap();
            background_run.step();
            executor.return_run(background_run, 5_000);
            assert!(step_at(executor, 4_980, CAREFUL, careful_net));
            assert!(step_at(executor, 5_100, CAREFUL, careful_net));
            assert!(!step_at(executor, 5_101, CAREFUL, careful_net));
        });
    }

    #[test]
    fn an_age_goes_on_over_a_warm_swap() {
        if !WARM {
            return;
        }
        with_careful_robot(|executor| {
            step_at(executor, 1_000, SOURCE, source_net);
            executor.begin_migration();
            executor.migrate_net(NET, NET);
            executor.end_migration(core::iter::empty());
            assert!(step_at(executor, 1_100, CAREFUL, careful_net));
            assert!(!step_at(executor, 1_101, CAREFUL, careful_net));
        });
    }

    #[test]
    fn a_value_on_two_nets_stays_on_the_other() {
        with_robot(|executor| {
            step(executor, SOURCE, source_net);
            executor.nets[SUM].publish(executor.nets[NET].value, 0);
            for expected in 2..5 {
                assert!(step(executor, SOURCE, source_net));
                assert_eq!(executor.value_on(NET), Some(Count(expected)));
                assert_eq!(executor.value_on(SUM), Some(Count(1)));
            }
        });
    }

    #[test]
    fn a_task_that_reads_its_own_output_goes_on_while_a_slot_0_run_reads_it_too() {
        struct Loop;
        task! { impl Loop { data { in last: Count optional; out next: Count; } } }
        impl Task for Loop {
            fn step(&mut self, io: &mut Io<'_>) -> Step {
                let last = io.try_read(Self::LAST);
                let before = last.map_or(0, |last| last.0);
                *io.write(Self::NEXT) = Count(before + 1);
                assert_eq!(last.map_or(0, |last| last.0), before);
                Step::Run
            }
        }
        let mut looping = TaskPool::new([Loop]);
        let mut reader = TaskPool::new([Reader {
            seen: [0; 3],
            steps: 0,
        }]);
        let mut banks: [&mut dyn AnyTaskPool; 2] = [&mut looping, &mut reader];
        let mut nets = nets::<2>();
        let (mut executor, _) = assemble(&mut banks, &mut nets).unwrap();
        let (looping, reader) = (SOURCE, TaskPlace { bank: 1, place: 0 });
        assert!(step(&mut executor, looping, source_net));
        let mut background_run = executor.checkout(reader, reader_net, 0, |_, _| ()).unwrap();
        for expected in 2..9 {
            assert!(step(&mut executor, looping, source_net));
            assert_eq!(executor.value_on(NET), Some(Count(expected)));
        }
        while background_run.step() == Step::Run {}
        executor.return_run(background_run, 0);
        assert_eq!(executor.value_on(SUM), Some(Count(3)));
    }

    #[test]
    fn inout_copies_what_a_lent_task_reads() {
        with_robot(|executor| {
            step(executor, SOURCE, source_net);
            let mut background_run = executor.checkout(READER, reader_net, 0, |_, _| ()).unwrap();
            assert!(step(executor, ADDER, adder_net));
            assert_eq!(executor.value_on(NET), Some(Count(101)));
            while background_run.step() == Step::Run {}
            executor.return_run(background_run, 0);
            assert_eq!(executor.value_on(SUM), Some(Count(3)));
        });
    }

    #[test]
    fn a_new_mission_starts_empty_and_keeps_nothing_of_a_job_that_comes_back_late() {
        with_robot(|executor| {
            step(executor, SOURCE, source_net);
            let mut background_run = executor.checkout(READER, reader_net, 0, |_, _| ()).unwrap();
            executor.clear();
            assert_eq!(executor.value_on::<Count>(NET), None);
            for expected in 1..5 {
                step(executor, SOURCE, source_net);
                assert_eq!(
                    executor.value_on(NET),
                    Some(Count(expected)),
                    "its state started anew"
                );
            }
            assert!(!step(executor, READER, reader_net), "still lent");
            while background_run.step() == Step::Run {}
            assert_eq!(executor.return_run(background_run, 0), ReturnedRun::Stale);
            assert_eq!(executor.value_on::<Count>(SUM), None);
            assert!(step(executor, READER, reader_net));
        });
    }

    #[test]
    fn a_job_of_another_robot_is_refused() {
        let (mut first, mut second) = (Robot::new(), Robot::new());
        let (mut first, mut second) = (first.banks(), second.banks());
        let (mut first_nets, mut second_nets) = (nets::<2>(), nets::<2>());
        let (mut first, _) = assemble(&mut first, &mut first_nets).unwrap();
        let (mut second, _) = assemble(&mut second, &mut second_nets).unwrap();
        let checked_out = [&mut first, &mut second].map(|executor| {
            step(executor, SOURCE, source_net);
            executor.checkout(READER, reader_net, 0, |_, _| ()).unwrap()
        });
        let [of_first, of_second] = checked_out;
        assert_eq!(first.return_run(of_second, 0), ReturnedRun::Foreign);
        assert!(matches!(
            first.return_run(of_first, 0),
            ReturnedRun::Ended(_)
        ));
    }

    #[test]
    fn a_job_of_another_robot_without_any_memory_is_refused_too() {
        struct Nothing;
        task! { impl Nothing {} }
        impl Task for Nothing {
            fn step(&mut self, _: &mut Io<'_>) -> Step {
                Step::Finished
            }
        }
        let (mut first, mut second) = (TaskPool::new([Nothing]), TaskPool::new([Nothing]));
        assert_eq!(size_of_val(&first), 0);
        let mut first: [&mut dyn AnyTaskPool; 1] = [&mut first];
        let mut second: [&mut dyn AnyTaskPool; 1] = [&mut second];
        let (mut first_nets, mut second_nets) = (nets::<0>(), nets::<0>());
        let (mut first, _) = assemble(&mut first, &mut first_nets).unwrap();
        let (mut second, _) = assemble(&mut second, &mut second_nets).unwrap();
        let checked_out = [&mut first, &mut second].map(|executor| {
            let checked_out = executor.checkout(SOURCE, |_| None, 0, |_, _| ());
            checked_out.unwrap()
        });
        let [of_first, of_second] = checked_out;
        assert_eq!(first.return_run(of_second, 0), ReturnedRun::Foreign);
        assert!(matches!(
            first.return_run(of_first, 0),
            ReturnedRun::Ended(_)
        ));
    }

    #[test]
    #[should_panic = "this handle belongs to another task type"]
    fn a_handle_of_the_wrong_type_is_a_defect() {
        struct Wrong;
        task! { impl Wrong { data { in count: Count; } } }
        impl Task for Wrong {
            fn step(&mut self, io: &mut Io<'_>) -> Step {
                let _: &u32 = io.read(In::at(0));
                Step::Run
            }
        }
        crate::TaskBench::new(Wrong)
            .give(Wrong::COUNT, Count(1))
            .step();
    }

    #[test]
    #[should_panic = "this handle belongs to another task type"]
    fn an_input_cannot_be_written() {
        struct Wrong;
        task! { impl Wrong { data { in count: Count; } } }
        impl Task for Wrong {
            fn step(&mut self, io: &mut Io<'_>) -> Step {
                *io.write(Out::at(0)) = Count(1);
                Step::Run
            }
        }
        crate::TaskBench::new(Wrong)
            .give(Wrong::COUNT, Count(1))
            .step();
    }

    #[test]
    fn names_must_be_unique() {
        #[allow(dead_code)]
        mod other {
            use super::*;
            #[derive(Clone, Copy)]
            pub struct Count;
            impl PortType for Count {
                const NAME: &'static str = "Count";
                const INIT: Self = Count;
            }
            pub struct Source;
            task! { impl Source { data { out count: u32; } } }
            impl Task for Source {
                fn step(&mut self, _: &mut Io<'_>) -> Step {
                    Step::Run
                }
            }
            pub struct Another;
            task! { impl Another { data { in count: Count; } } }
            impl Task for Another {
                fn step(&mut self, _: &mut Io<'_>) -> Step {
                    Step::Run
                }
            }
        }
        fn fault<'m>(banks: &'m mut [&'m mut (dyn AnyTaskPool + 'm)]) -> Option<RegistryFault> {
            Registry { banks }.check().err()
        }
        assert_eq!(
            fault(&mut [&mut TaskPool::new([Source { count: 0 }])]),
            None
        );
        assert_eq!(
            fault(&mut [
                &mut TaskPool::new([Source { count: 0 }]),
                &mut TaskPool::new([other::Source])
            ]),
            Some(RegistryFault::TaskNameTwice { task: "Source" })
        );
        assert_eq!(
            fault(&mut [
                &mut TaskPool::new([Source { count: 0 }]),
                &mut TaskPool::new([other::Another])
            ]),
            Some(RegistryFault::TypeNameTwice { type_name: "Count" })
        );
    }

    /// A monitor that does in each execution what it is told.
    struct Watcher(std::vec::IntoIter<Word>);

    #[derive(Clone, Copy, PartialEq)]
    enum Word {
        Nothing,
        Flag,
        Value,
        Beat,
    }

    task! {
        impl Watcher { endless; monitor; data { out seen: u32; } flags { out near; } }
    }

    impl Task for Watcher {
        fn step(&mut self, io: &mut Io<'_>) -> Step {
            match self.0.next().unwrap() {
                Word::Nothing => {}
                Word::Flag => io.set(Self::NEAR, false),
                Word::Value => *io.write(Self::SEEN) = 7,
                Word::Beat => io.beat(),
            }
            Step::Run
        }
    }

    #[test]
    fn a_monitor_may_be_silent_for_less_than_its_limit_and_says_anything_at_all() {
        const LIMIT: usize = SILENT_EXECUTIONS as usize;
        let mut words = std::vec::Vec::new();
        for word in [Word::Flag, Word::Value, Word::Beat] {
            words.extend([Word::Nothing].repeat(LIMIT - 1));
            words.push(word);
        }
        words.extend([Word::Nothing].repeat(LIMIT + 2));
        words.push(Word::Flag);
        let mut bench = crate::TaskBench::new(Watcher(words.clone().into_iter()));
        for (step, word) in words.iter().enumerate() {
            // A mission that enters the state anew all the time changes nothing.
            bench.enter_anew().step();
            let is_silent = (3 * LIMIT + LIMIT - 1..words.len() - 1).contains(&step);
            let expected = is_silent.then_some(SafeReason::MonitorSilent);
            assert_eq!(
                bench.failure(),
                expected,
                "{step}: {}",
                *word == Word::Nothing
            );
        }
    }
}
