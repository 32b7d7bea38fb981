//! What is compiled here, and not where it is used.
//!
//! Functions with type parameters are compiled by the crate that names the types, with that crate's
//! settings. An interpreter has one, the owner of its blob, which is the firmware's business. The walk must
//! not be: it is compiled for speed where the rest of a firmware is compiled for size. So it is a function of
//! [`Machine`] and of borrowed bytes, and for each of the two kinds of reads there is one here that has no
//! type parameters and is not inlined.

use super::events::Observer;
use super::machine::{Blob, Machine};
use super::walk::Ended;
#[cfg(feature = "unchecked")]
use crate::reads::Unchecked;
use crate::reads::{Checked, access::Access};
use crate::tables::TaskPlaces;

/// Reads for which the walk is compiled: [`Checked`] and, with the feature `unchecked`,
#[cfg_attr(feature = "unchecked", doc = "[`Unchecked`].")]
#[cfg_attr(not(feature = "unchecked"), doc = "`Unchecked`.")]
pub trait Compiled: Access {
    /// Handles the pulse and all events that follow from it.
    fn walk(
        machine: &mut Machine<'_, Self>,
        blob: Blob<'_, Self>,
        observer: &mut dyn Observer,
    ) -> Ended
    where
        Self: Sized;

    /// The same, of a macro step in which timers may run out.
    fn walk_after_timers(
        machine: &mut Machine<'_, Self>,
        blob: Blob<'_, Self>,
        observer: &mut dyn Observer,
    ) -> Ended
    where
        Self: Sized;

    /// Writes a bit of a task instance's flag block, if there is such a task and its block has it.
    fn write_task_flag(
        machine: &mut Machine<'_, Self>,
        blob: Blob<'_, Self>,
        task: usize,
        flag: usize,
        value: bool,
    ) where
        Self: Sized;

    /// Writes a bit of the flag block with these places.
    fn write_flag_at(
        machine: &mut Machine<'_, Self>,
        places: &TaskPlaces,
        flag: usize,
        value: bool,
    ) where
        Self: Sized;
}

macro_rules! compiled {
    ($reads:ty) => {
        impl Compiled for $reads {
            #[inline(never)]
            fn walk(
                machine: &mut Machine<'_, Self>,
                blob: Blob<'_, Self>,
                observer: &mut dyn Observer,
            ) -> Ended {
                machine.walk(blob, observer)
            }

            #[cold]
            #[inline(never)]
            fn walk_after_timers(
                machine: &mut Machine<'_, Self>,
                blob: Blob<'_, Self>,
                observer: &mut dyn Observer,
            ) -> Ended {
                match machine.run_timers(blob) {
                    Ok(()) => Self::walk(machine, blob, observer),
                    Err(fault) => Ended::Stopped(fault),
                }
            }

            #[inline(never)]
            fn write_task_flag(
                machine: &mut Machine<'_, Self>,
                blob: Blob<'_, Self>,
                task: usize,
                flag: usize,
                value: bool,
            ) {
                machine.write_task_flag(blob, task, flag, value);
            }

            #[inline(never)]
            fn write_flag_at(
                machine: &mut Machine<'_, Self>,
                places: &TaskPlaces,
                flag: usize,
                value: bool,
            ) {
                machine.write_flag_at(places, flag, value);
            }
        }
    };
}

compiled!(Checked);
#[cfg(feature = "unchecked")]
compiled!(Unchecked);
