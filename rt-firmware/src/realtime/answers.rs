//! What the link asks of the mission that runs: its blob, states, counters, parameters, and the
//! values on its nets.

use esm_core::tables::Tables;
use esm_core::{BlobBuffer, Interpreter};

use super::RealTime;
use super::background_runs::net_of;
use super::running::Mission;
use crate::features::PARAMS;
use crate::realtime::mailbox::{Bytes, Command};
use crate::task::MAX_DATA_PORTS;
use esm_link::message::{LinkError, TaskCounters};
use esm_link::telemetry::Ask;

impl<'m> RealTime<'_, 'm> {
    /// Answers a question about the mission.
    pub(super) fn answer(&self, question: &Command<'m>, ticks_per_us: u32) -> Command<'m> {
        let Some(mission) = &self.mission else {
            return Command::Failed(LinkError::NoMission);
        };
        let tables = mission.interpreter.tables();
        match *question {
            Command::ReadBlob { offset } => {
                let blob = mission.interpreter.verified().bytes();
                let bytes = blob.get(offset as usize..).unwrap_or_default();
                Command::Blob {
                    total: blob.len() as u32,
                    bytes: Bytes::first_of(bytes),
                }
            }
            Command::ReadStates { first } => {
                let mut bytes = Bytes::EMPTY;
                let total = tables.region_instance_count();
                for region in usize::from(first)..total {
                    if !bytes.push_u16(state_of(&mission.interpreter, region)) {
                        break;
                    }
                }
                Command::States {
                    step: mission.next_step,
                    total: total as u16,
                    bytes,
                }
            }
            Command::ReadSlot { slot } => {
                let index = usize::from(slot);
                match (tables.slot(index), self.tasks.lists.slots.get(index)) {
                    (Some(slot), Some(entry)) => Command::Slot(entry.counters(
                        slot.number,
                        self.dispatcher.missed(index),
                        ticks_per_us,
                    )),
                    _ => Command::Failed(LinkError::NoSuchIndex),
                }
            }
            Command::ReadTask { task_instance } => {
                let index = usize::from(task_instance);
                if index < tables.task_instance_count() {
                    Command::Task(TaskCounters {
                        enabled: mission.interpreter.is_enabled(index),
                        // The flag of a state that was left stands as it did until it is entered
                        // anew.
                        busy: mission.interpreter.is_current(index)
                            && mission.interpreter.is_busy(index),
                        overruns: self.tasks.overruns(task_instance),
                    })
                } else {
                    Command::Failed(LinkError::NoSuchIndex)
                }
            }
            Command::ReadParam { mission, param } if PARAMS => {
                match (self.mission_of(mission), tables.param(usize::from(param))) {
                    (Ok(_), Some(of_mission)) => Command::Param {
                        value: self.params.get(param).unwrap_or(of_mission),
                        of_mission,
                        saved: self.saved.of(mission).get(param),
                    },
                    (Ok(_), None) => Command::Failed(LinkError::NoSuchIndex),
                    (Err(error), _) => Command::Failed(error),
                }
            }
            _ => Command::Failed(LinkError::NoSuchIndex),
        }
    }

    /// The mission that runs, if it is the one of this hash.
    pub(super) fn mission_of(&self, hash: u32) -> Result<&Mission<'m>, LinkError> {
        match &self.mission {
            Some(mission) if self.health.mission == Some(hash) => Ok(mission),
            Some(_) => Err(LinkError::OtherMission),
            None => Err(LinkError::NoMission),
        }
    }

    /// Lets samples of values be taken from the next macro step on, or tells what values are made
    /// of.
    #[inline(never)]
    pub(super) fn answer_of_values(
        &mut self,
        number: u8,
        ask: &[u8],
    ) -> Result<Command<'m>, LinkError> {
        let ask = Ask::of(ask)?;
        let (Ask::Fields { mission, .. } | Ask::Values { mission, .. }) = ask;
        let tables = self.mission_of(mission)?.interpreter.tables();
        match ask {
            Ask::Fields { net, offset, .. } => {
                let text = self.fields(&tables, net).ok_or(LinkError::NoSuchIndex)?;
                Ok(Command::Fields { text, offset })
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
                Ok(Command::ValuesWanted { number, mission })
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
        esm_link::message::NO_STATE
    }
}
