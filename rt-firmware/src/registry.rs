//! A robot's task registry: which task types there are, and how many of each.

use core::mem::MaybeUninit;

use crate::features::MISSIONS;
use crate::ports::{AnyTaskPool, TaskPool};
use crate::task::Task;

/// Declares a robot: a struct with one [`TaskPool`](crate::TaskPool) of tasks for each task type.
///
/// ```
/// use rt_firmware::{Io, Step, Task, assemble, nets, registry, task};
///
/// #[derive(Default)]
/// struct Blink;
/// task! { impl Blink { flags { out lit; } } }
/// impl Task for Blink {
///     fn step(&mut self, io: &mut Io<'_>) -> Step {
///         io.set(Self::LIT, true);
///         Step::Finished
///     }
/// }
///
/// registry! {
///     /// A robot that can do one thing, twice at a time.
///     pub struct Lamp {
///         blink: Blink[2],
///     }
/// }
///
/// let mut robot = Lamp { blink: rt_firmware::TaskPool::new([Blink, Blink]) };
/// let mut banks = robot.banks();
/// let mut nets = nets::<4>();
/// let (executor, registry) = assemble(&mut banks, &mut nets).expect("names are unique");
/// assert_eq!(registry.capacity(0), 2);
/// # drop(executor);
/// ```
///
/// A bank that is only there with a feature of the crate says so behind its number:
/// `blink: Blink[2] if "lamps"`.
///
/// Generics stand in brackets, as in [`task!`](crate::task!):
/// `pub struct Rover[M: SetDutyCycle]<M> { drive: Drive<M>[1] }`. A type that only banks with a
/// feature need is said to be one of the robot's all the same: `pub struct Rover[L]<L> marks L { …
/// }` has a field `marks`, a [`PhantomData`](core::marker::PhantomData) of a function that returns
/// it.
///
/// A robot that is made as a value stands on the stack before it is where it stays. Behind `in` is
/// the name of a struct with the places of its banks, for a robot that is made in them, bank by
/// bank: see [`put_bank`].
///
/// ```
/// use rt_firmware::{AnyTaskPool, TaskPool, put_bank, registry};
/// use rt_firmware::tasks::{Cruise, Turn};
///
/// registry! {
///     /// A robot that drives and turns.
///     pub struct Mine in MyPlaces {
///         cruise: Cruise[1],
///         turn: Turn[2],
///     }
/// }
///
/// impl MyPlaces {
///     fn fill(&mut self) -> [&mut (dyn AnyTaskPool + '_); Mine::POOLS] {
///         [
///             put_bank(&mut self.cruise, || TaskPool::new([Cruise])),
///             put_bank(&mut self.turn, || TaskPool::from_fn(Turn::default)),
///         ]
///     }
/// }
///
/// let mut places = MyPlaces::EMPTY;
/// assert_eq!(places.fill().map(|bank| bank.capacity()), [1, 2]);
/// ```
#[macro_export]
macro_rules! registry {
    (
        $(#[$meta:meta])*
        $visibility:vis struct $robot:ident in $places:ident $($rest:tt)*
    ) => {
        $crate::registry! {
            $(#[$meta])*
            $visibility struct $robot $($rest)*
        }
        $crate::registry! { @places $visibility $places of $robot $($rest)* }
    };
    (
        @places $visibility:vis $places:ident of $robot:ident
        $([$($generics:tt)*] <$($argument:tt),+ $(,)?>)?
        $(marks $mark:ident)? {
            $(
                $(#[$bank_meta:meta])* $bank:ident : $task:ty [$count:expr]
                $(if $feature:literal)?
            ),+ $(,)?
        }
    ) => {
        #[doc = concat!("The places of the banks of [`", stringify!($robot), "`].")]
        $visibility struct $places $(<$($generics)*>)? {
            $(
                /// A type that only some of its banks need.
                pub marks: ::core::marker::PhantomData<fn() -> $mark>,
            )?
            $(
                $(#[$bank_meta])*
                $(#[cfg(feature = $feature)])?
                #[doc = concat!("For tasks of type `", stringify!($task), "`.")]
                pub $bank: ::core::mem::MaybeUninit<$crate::TaskPool<$task, { $count }>>,
            )+
        }

        impl $(<$($generics)*>)? $places $(<$($argument),+>)? {
            /// Number of task types.
            pub const POOLS: usize = [$($(#[cfg(feature = $feature)])? stringify!($bank)),+].len();

            /// None of them is made.
            pub const EMPTY: Self = Self {
                $(marks: ::core::marker::PhantomData::<fn() -> $mark>,)?
                $(
                    $(#[cfg(feature = $feature)])?
                    $bank: ::core::mem::MaybeUninit::uninit(),
                )+
            };
        }
    };
    (
        $(#[$meta:meta])*
        $visibility:vis struct $robot:ident
        $([$($generics:tt)*] <$($argument:tt),+ $(,)?>)?
        $(marks $mark:ident)? {
            $($(#[$bank_meta:meta])* $bank:ident : $task:ty [$count:expr] $(if $feature:literal)?),+ $(,)?
        }
    ) => {
        $(#[$meta])*
        $visibility struct $robot $(<$($generics)*>)? {
            $(
                /// A type that only some of its banks need.
                pub marks: ::core::marker::PhantomData<fn() -> $mark>,
            )?
            $(
                $(#[$bank_meta])*
                $(#[cfg(feature = $feature)])?
                #[doc = concat!("Tasks of type `", stringify!($task), "`.")]
                pub $bank: $crate::TaskPool<$task, { $count }>,
            )+
        }

        impl $(<$($generics)*>)? $robot $(<$($argument),+>)? {
            /// Number of task types.
            pub const POOLS: usize = [$($(#[cfg(feature = $feature)])? stringify!($bank)),+].len();

            /// The banks, to be made a robot of by `assemble`.
            pub fn banks(&mut self) -> [&mut (dyn $crate::AnyTaskPool + '_); [$($(#[cfg(feature = $feature)])? stringify!($bank)),+].len()] {
                [$($(#[cfg(feature = $feature)])? &mut self.$bank),+]
            }
        }
    };
}

/// Makes a bank, and puts it into its place. Not inlined where banks are large, so that what making
/// one takes of the stack is given back before the next is made.
#[cfg_attr(feature = "behaviours", inline(never))]
pub fn put_bank<T: Task, const N: usize>(
    place: &mut MaybeUninit<TaskPool<T, N>>,
    make: impl FnOnce() -> TaskPool<T, N>,
) -> &mut dyn AnyTaskPool {
    place.write(make())
}

/// Storage for the nets of missions with up to `N`: for two missions, where one can take over from
/// another.
pub const fn nets<const N: usize>() -> [[crate::Net; N]; MISSIONS] {
    [[crate::Net::EMPTY; N]; MISSIONS]
}
