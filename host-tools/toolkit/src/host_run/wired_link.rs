//! What a device needs to know of a mission's link, and who looks at what crosses it.

use esm_core::tables::Tables;

use crate::inspect::{FrameRow, link_rows};
use crate::trace::directory::Directory;

/// A link in a blob.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct WiredLink {
    /// Its name.
    pub name: String,
    /// Bits a second.
    pub rate_bps: u32,
    /// Bits that a byte takes.
    pub bits: u8,
    /// Its frames.
    pub frames: Vec<FrameRow>,
    /// The states that receive, each as the path of its region and its name.
    pub receive_states: Vec<(String, String)>,
}

impl WiredLink {
    /// The links of a mission, in their order.
    pub(super) fn of(tables: &Tables<'_>, directory: &Directory) -> Vec<Self> {
        let rows = link_rows(tables).into_iter();
        let links = tables
            .links()
            .iter()
            .zip(rows)
            .map(|(link, row)| WiredLink {
                name: row.link,
                rate_bps: row.rate_bps,
                // A byte of the record.
                bits: row.bits as u8,
                frames: row.frames,
                receive_states: (link.receive.index())
                    .map_or_else(Vec::new, |task| states_of(tables, directory, task)),
            });
        links.collect()
    }
}

/// The states of a task.
fn states_of(tables: &Tables<'_>, directory: &Directory, task: usize) -> Vec<(String, String)> {
    let states = directory.task_states().iter().enumerate();
    let of_task = states.filter_map(|(instance, state)| {
        let is_of_it = tables.task_state_of(instance)?.task == task;
        let name = directory.state(*state)?.name().to_owned();
        let path = directory.regions().get(state.region)?.path.clone();
        is_of_it.then_some((path, name))
    });
    of_task.collect()
}
