//! Which behaviours can be inserted without a task state.

use super::law::Behaviour;
use crate::declaration::Param;

/// A task that [`behaviour!`](crate::behaviour!) has made.
pub trait BehaviourTask {
    /// Its control law.
    type Law: Behaviour + Default;
    /// Its parameter `outside_m`.
    const OUTSIDE: Param<f32>;
    /// Its parameter `at_head`.
    const AT_HEAD: Param<bool>;
}

/// The control law of one of several behaviours: what [`repertoire!`](crate::repertoire!) makes.
pub trait Repertoire: Send + Sized {
    /// A law that begins, of the behaviour whose task has a signature of this hash; none where it
    /// is not among them.
    fn of_task(task: u64) -> Option<Self>;

    /// The law.
    fn law(&mut self) -> &mut dyn Behaviour;

    /// The parameter `outside_m` of its behaviour.
    fn outside(&self) -> Param<f32>;

    /// The parameter `at_head` of its behaviour.
    fn at_head(&self) -> Param<bool>;
}

/// Says which behaviours the task [`Behaviours`](crate::behaviours::Behaviours) of a robot can
/// insert by itself, for a command of the link or a script:
///
/// ```
/// use rt_firmware::behaviours::{Behaviours, Move, Repertoire, TurnTo};
///
/// rt_firmware::repertoire! {
///     /// What can be inserted.
///     pub enum Laws { Move, TurnTo }
/// }
///
/// let behaviours = Behaviours::<Laws>::default();
/// assert!(Laws::of_task(rt_firmware::declaration_of::<Move>().signature_hash).is_some());
/// # drop(behaviours);
/// ```
#[macro_export]
macro_rules! repertoire {
    (
        $(#[$meta:meta])*
        $visibility:vis enum $laws:ident { $($task:ident),+ $(,)? }
    ) => {
        $(#[$meta])*
        #[derive(Debug)]
        $visibility enum $laws {
            $(
                #[doc = concat!("The law of [`", stringify!($task), "`].")]
                $task(<$task as $crate::behaviours::BehaviourTask>::Law),
            )+
        }

        impl $crate::behaviours::Repertoire for $laws {
            fn of_task(task: u64) -> Option<Self> {
                $(
                    if task == $crate::declaration_of::<$task>().signature_hash {
                        return Some(Self::$task(Default::default()));
                    }
                )+
                None
            }

            fn law(&mut self) -> &mut dyn $crate::behaviours::Behaviour {
                match self {
                    $(Self::$task(law) => law,)+
                }
            }

            fn outside(&self) -> $crate::Param<f32> {
                match self {
                    $(Self::$task(_) => <$task as $crate::behaviours::BehaviourTask>::OUTSIDE,)+
                }
            }

            fn at_head(&self) -> $crate::Param<bool> {
                match self {
                    $(Self::$task(_) => <$task as $crate::behaviours::BehaviourTask>::AT_HEAD,)+
                }
            }
        }
    };
}
