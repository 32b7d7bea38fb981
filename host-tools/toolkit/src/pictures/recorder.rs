//! From macro steps to the states over time.

use std::sync::Arc;

use super::{MissionStates, RegionStates, StateSpan};
use crate::trace::Snapshot;
use crate::trace::directory::Directory;

/// Watches a mission run and keeps when each state was current.
pub struct StatesRecorder {
    directory: Arc<Directory>,
    start_us: u64,
    regions: Vec<RegionRecord>,
}

#[derive(Clone, Default)]
struct RegionRecord {
    /// The state that was current after the last macro step, and since when. `None` where the
    /// region was not active.
    open: Option<(usize, u64)>,
    spans: Vec<StateSpan>,
}

impl StatesRecorder {
    /// Starts with a mission whose first macro step is at `start_us` of the run.
    pub fn new(directory: Arc<Directory>, start_us: u64) -> Self {
        let regions = vec![RegionRecord::default(); directory.regions().len()];
        StatesRecorder {
            directory,
            start_us,
            regions,
        }
    }

    /// A macro step that started at `t_us`, counted from the mission's first, has ended in that
    /// state.
    ///
    /// Costs time in proportion to the machine's region instances.
    pub fn step(&mut self, t_us: u64, snapshot: &impl Snapshot) {
        let now_us = self.start_us + t_us;
        let mut active = self
            .directory
            .active(|region| snapshot.current(region))
            .peekable();
        for (region, record) in self.regions.iter_mut().enumerate() {
            // Active regions come in ascending order, as the regions do.
            let local = active
                .next_if(|state| state.region == region)
                .map(|state| state.local);
            if record.open.map(|(open, _)| open) != local {
                record.close(now_us, region, &self.directory);
                record.open = local.map(|local| (local, now_us));
            }
        }
    }

    /// The states until `end_us` of the run. Regions that never were active are left out.
    pub fn finish(mut self, name: &str, end_us: u64) -> MissionStates {
        let mut regions = Vec::new();
        for (index, record) in self.regions.iter_mut().enumerate() {
            record.close(end_us, index, &self.directory);
            let path = self
                .directory
                .regions()
                .get(index)
                .map(|region| region.path.clone())
                .unwrap_or_default();
            if !record.spans.is_empty() {
                regions.push(RegionStates {
                    path,
                    spans: std::mem::take(&mut record.spans),
                });
            }
        }
        MissionStates {
            name: name.into(),
            start_us: self.start_us,
            end_us,
            regions,
        }
    }
}

impl RegionRecord {
    fn close(&mut self, now_us: u64, region: usize, directory: &Directory) {
        let Some((local, since_us)) = self.open.take() else {
            return;
        };
        let state = directory.state(crate::trace::directory::StateId { region, local });
        let state = state
            .map(|state| state.name().to_owned())
            .unwrap_or_default();
        self.spans.push(StateSpan {
            state,
            start_us: since_us,
            end_us: now_us,
        });
    }
}
