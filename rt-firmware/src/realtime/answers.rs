//! What the link asks of the mission that runs: its blob, states, counters, parameters, and the
//! values on its nets. A function for each question.

use esm_core::tables::Tables;

use super::RealTime;
use super::machine::Mission;
use crate::features::PARAMS;
use crate::frames::LINKS;
use crate::realtime::mailbox::{Bytes, Command, Reply};
use crate::task::MAX_DATA_PORTS;
use esm_link::message::{LinkError, NO_STATE, TaskCounters};
use esm_link::telemetry::Ask;

impl<'m> RealTime<'_, 'm> {
    /// Answers a question about the mission.
    pub(super) fn answer(&self, question: &Command<'m>, ticks_per_us: u32) -> Reply<'m> {
        let Some(mission) = self.machine.mission() else {
            return Reply::Failed(LinkError::NoMission);
        };
        match *question {
            Command::ReadBlob { offset } => blob_part(mission, offset),
            Command::ReadStates { first } => states(mission, first),
            Command::ReadSlot { slot } => self.slot_counters(mission, slot, ticks_per_us),
            Command::ReadTask { task_instance } => self.task_counters(mission, task_instance),
            #[cfg(feature = "links")]
            Command::ReadFrame { frame } => self.frame_counters(mission, frame),
            Command::ReadParam { mission, param } if PARAMS => self.param(mission, param),
            _ => Reply::Failed(LinkError::NoSuchIndex),
        }
    }

    /// What was counted of a slot.
    fn slot_counters(&self, mission: &Mission<'m>, slot: u8, ticks_per_us: u32) -> Reply<'m> {
        let index = usize::from(slot);
        match (mission.tables().slot(index), self.execution.slot(index)) {
            (Some(slot), Some(entry)) => {
                Reply::Slot(entry.counters(slot.number, self.timetable.missed(index), ticks_per_us))
            }
            _ => Reply::Failed(LinkError::NoSuchIndex),
        }
    }

    /// What was counted of a task instance.
    fn task_counters(&self, mission: &Mission<'m>, task_instance: u16) -> Reply<'m> {
        let index = usize::from(task_instance);
        if index >= mission.tables().task_instance_count() {
            return Reply::Failed(LinkError::NoSuchIndex);
        }
        Reply::Task(TaskCounters {
            enabled: mission.is_enabled(index),
            busy: mission.is_busy(index),
            overruns: self.execution.overruns(task_instance),
        })
    }

    /// What was counted of a frame of a link.
    #[cfg(feature = "links")]
    fn frame_counters(&self, mission: &Mission<'m>, frame: u16) -> Reply<'m> {
        let counters = (self.execution).frame_counters(&mission.tables(), frame.into());
        counters.map_or(Reply::Failed(LinkError::NoSuchIndex), Reply::Frame)
    }

    /// The value of a parameter.
    fn param(&self, mission: u32, param: u16) -> Reply<'m> {
        let tables = match self.machine.mission_of(mission) {
            Ok(mission) => mission.tables(),
            Err(error) => return Reply::Failed(error),
        };
        match tables.param(usize::from(param)) {
            Some(of_mission) => Reply::Param {
                value: self.machine.params().get(param).unwrap_or(of_mission),
                of_mission,
                saved: self.machine.saved_of(mission).get(param),
            },
            None => Reply::Failed(LinkError::NoSuchIndex),
        }
    }

    /// Lets samples of values be taken from the next macro step on, or tells what values are made
    /// of.
    #[inline(never)]
    pub(super) fn answer_of_values(
        &mut self,
        number: u8,
        ask: &[u8],
    ) -> Result<Reply<'m>, LinkError> {
        let ask = Ask::of(ask)?;
        let (Ask::Fields { mission, .. } | Ask::Values { mission, .. }) = ask;
        let tables = self.machine.mission_of(mission)?.tables();
        match ask {
            Ask::Fields { net, offset, .. } => {
                let text = self.fields(&tables, net).ok_or(LinkError::NoSuchIndex)?;
                Ok(Reply::Fields { text, offset })
            }
            Ask::Values {
                period_ms, nets, ..
            } => {
                let count = tables.net_count();
                let nets = nets.iter().map(|net| u16::from_le_bytes(*net));
                if nets.clone().any(|net| usize::from(net) >= count) {
                    return Err(LinkError::NoSuchIndex);
                }
                self.observers
                    .begin_samples(number, mission, period_ms, nets);
                Ok(Reply::ValuesWanted { number, mission })
            }
        }
    }

    /// What the values on a net are made of, as a task says that writes them.
    fn fields(&self, tables: &Tables<'_>, net: u16) -> Option<&'static str> {
        let net = usize::from(net);
        (0..tables.task_instance_count()).find_map(|instance| {
            // A dispatcher of a link may have more ports than a task.
            let ports = match LINKS {
                0 => MAX_DATA_PORTS,
                _ => ports_of(tables, instance),
            };
            let ports = 0..ports;
            let mut on_net = ports.filter(|port| net_of(tables, instance, *port) == Some(net));
            on_net.find_map(|port| self.execution.fields(instance as u16, port))
        })
    }
}

/// How many data ports a task instance has.
fn ports_of(tables: &Tables<'_>, instance: usize) -> usize {
    let state = tables.task_state_of(instance);
    let task = state.and_then(|state| tables.task(state.task));
    task.map_or(0, |task| task.ports.data)
}

/// Bytes of a mission's blob.
fn blob_part<'m>(mission: &Mission<'m>, offset: u32) -> Reply<'m> {
    let blob = mission.blob();
    let bytes = blob.get(offset as usize..).unwrap_or_default();
    Reply::Blob {
        total: blob.len() as u32,
        bytes: Bytes::first_of(bytes),
    }
}

/// Current states of region instances, or none where a region is not active.
fn states<'m>(mission: &Mission<'m>, first: u16) -> Reply<'m> {
    let mut bytes = Bytes::EMPTY;
    let total = mission.tables().region_instance_count();
    for region in usize::from(first)..total {
        let state = mission.state(region).map_or(NO_STATE, |state| state as u16);
        if !bytes.push_u16(state) {
            break;
        }
    }
    Reply::States {
        step: mission.next_step(),
        total: total as u16,
        bytes,
    }
}

/// The net of a data port.
fn net_of(tables: &Tables<'_>, task_instance: usize, port: usize) -> Option<usize> {
    let first = tables.task_instance(task_instance)?.first_connection;
    tables.connection(first + port).flatten()
}
