//! The mission that runs: its interpreter, the values of its parameters, its trial, and the memory
//! that comes and goes with missions.

use esm_core::tables::{Tables, TaskPlaces};
use esm_core::{BlobBuffer, Fault, Interpreter, Observer, StateMapping, StepSummary};
use heapless::spsc::Producer;

use super::mailbox::Freed;
use super::params::{self, LiveParams, SavedParams};
use super::staging::{MissionMemory, OwnMemory, StoppedMission};
use super::tasks::Lists;
use crate::ports::{FlagChanges, Inputs, Registry};
use esm_link::message::{LinkError, SafeReason};
use esm_link::trial::{FallBack, FallBackReason};

/// The mission, and what has to do with it.
pub(crate) struct Machine<'q, 'm> {
    mission: Option<Mission<'m>>,
    /// Memory for the next mission, where the link has none.
    own: OwnMemory<'m>,
    params: LiveParams,
    /// What the mission of this hash starts with.
    saved: SavedParams,
    trial: Option<Trial<'m>>,
    /// Buffers that no mission is in any more.
    freed: Producer<'q, Freed<'m>>,
}

/// The mission that runs.
pub(super) struct Mission<'m> {
    interpreter: Interpreter<'m, BlobBuffer<'m>>,
    /// Number of the next macro step.
    next_step: u64,
}

/// The trial of a mission that is about to start.
pub(super) struct NewTrial {
    /// Why the robot is in the safe state, if it is.
    pub(super) safe: Option<SafeReason>,
    /// Robot time at which it ends.
    pub(super) until_us: u64,
}

/// What is known of the mission that runs while it is on trial.
pub(super) struct Trial<'m> {
    /// The mission before, to fall back to.
    pub(super) before: Option<StoppedMission<'m>>,
    /// Why the robot was in its safe state then, if it was.
    pub(super) safe: Option<SafeReason>,
    /// When it ends, in microseconds since the first macro step of the first mission.
    pub(super) until_us: u64,
    /// Why it has failed: the robot falls back at the interpreter's next activation.
    pub(super) failed: Option<SafeReason>,
}

impl Trial<'_> {
    /// Why the robot falls back now, if it does.
    fn end_at(&self, now_us: u64) -> Option<FallBackReason> {
        match self.failed {
            Some(reason) => Some(FallBackReason::Failed(reason)),
            None => (now_us >= self.until_us).then_some(FallBackReason::NotConfirmed),
        }
    }
}

impl<'m> Mission<'m> {
    /// One that is before its first macro step.
    pub(super) fn new(interpreter: Interpreter<'m, BlobBuffer<'m>>) -> Self {
        Mission {
            interpreter,
            next_step: 0,
        }
    }

    /// Its hash.
    pub(super) fn hash(&self) -> u32 {
        self.interpreter.verified().hash()
    }

    /// The bytes of its blob.
    pub(super) fn blob(&self) -> &[u8] {
        self.interpreter.verified().bytes()
    }

    /// Its tables.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn tables(&self) -> Tables<'_> {
        self.interpreter.tables()
    }

    /// Its interpreter, to look at.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn interpreter(&self) -> &Interpreter<'m, BlobBuffer<'m>> {
        &self.interpreter
    }

    /// Number of the next macro step.
    pub(super) fn next_step(&self) -> u64 {
        self.next_step
    }

    /// What it has in common with the one before is as it was there. Answers how many regions go
    /// on.
    pub(super) fn take_over(&mut self, before: &Mission<'m>, common: &StateMapping<'_>) -> u16 {
        let taken = self.interpreter.take_over(&before.interpreter, common);
        taken.regions
    }

    /// Does a macro step.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn macro_step(
        &mut self,
        observer: &mut impl Observer,
    ) -> Result<StepSummary, Fault> {
        let summary = self.interpreter.macro_step(observer)?;
        self.next_step = summary.step + 1;
        Ok(summary)
    }

    /// Leaves out macro steps before the next one.
    pub(super) fn skip(&mut self, missed: u32) {
        self.interpreter.skip(missed);
        self.next_step += u64::from(missed);
    }

    /// The control flags that a task reads.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn control_flags(&self, places: &TaskPlaces) -> u16 {
        self.interpreter.control_flags_at(places)
    }

    /// Writes the control flags that a task wrote.
    pub(super) fn apply_flags(&mut self, places: &TaskPlaces, flags: FlagChanges) {
        self.interpreter
            .set_flags_at(places, flags.written, flags.values);
    }

    /// Sets or resets the busy flag of a task.
    pub(super) fn set_busy_at(&mut self, places: &TaskPlaces, is_busy: bool) {
        self.interpreter.set_busy_at(places, is_busy);
    }

    /// Sets or resets the busy flag of a task instance.
    pub(super) fn set_busy(&mut self, task_instance: usize, is_busy: bool) {
        self.interpreter.set_busy(task_instance, is_busy);
    }

    /// Whether a control flag of a task instance is set.
    #[cfg(feature = "links")]
    pub(super) fn flag(&self, task_instance: u16, flag: u16) -> bool {
        self.interpreter
            .task_flag(task_instance.into(), flag.into())
    }

    /// Sets or clears a control flag of a task instance.
    #[cfg(feature = "links")]
    pub(super) fn set_flag(&mut self, task_instance: u16, flag: u16, value: bool) {
        self.interpreter
            .set_flag(task_instance.into(), flag.into(), value);
    }

    /// Whether a task instance is enabled.
    pub(super) fn is_enabled(&self, task_instance: usize) -> bool {
        self.interpreter.is_enabled(task_instance)
    }

    /// Whether a task instance's state is current.
    pub(super) fn is_current(&self, task_instance: usize) -> bool {
        self.interpreter.is_current(task_instance)
    }

    /// Whether a task instance is busy. The flag of a state that was left stands as it did until it
    /// is entered anew.
    pub(super) fn is_busy(&self, task_instance: usize) -> bool {
        self.is_current(task_instance) && self.interpreter.is_busy(task_instance)
    }

    /// The current state of a region instance, if the region is active.
    pub(super) fn state(&self, region: usize) -> Option<usize> {
        let instance = self.tables().region_instance(region)?.instance;
        let is_active = self.interpreter.is_active(instance);
        is_active.then(|| self.interpreter.current(region))
    }

    /// A task has done its work.
    pub(super) fn report_exit(&mut self, task_instance: usize) {
        self.interpreter.report_exit(task_instance);
    }

    /// A task has ended whose state was left.
    pub(super) fn clear_enabled(&mut self, task_instance: usize) {
        self.interpreter.clear_enabled(task_instance);
    }
}

impl<'q, 'm> Machine<'q, 'm> {
    pub(crate) fn new(own: OwnMemory<'m>, freed: Producer<'q, Freed<'m>>) -> Self {
        Machine {
            mission: None,
            own,
            params: LiveParams::NONE,
            saved: SavedParams::NONE,
            trial: None,
            freed,
        }
    }

    /// The mission that runs.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn mission(&self) -> Option<&Mission<'m>> {
        self.mission.as_ref()
    }

    /// The mission that runs, to do something with it.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn mission_mut(&mut self) -> Option<&mut Mission<'m>> {
        self.mission.as_mut()
    }

    /// Hash of the mission that runs.
    pub(super) fn hash(&self) -> Option<u32> {
        self.mission.as_ref().map(Mission::hash)
    }

    /// The mission that runs, if it is the one of this hash.
    pub(super) fn mission_of(&self, hash: u32) -> Result<&Mission<'m>, LinkError> {
        match &self.mission {
            Some(mission) if mission.hash() == hash => Ok(mission),
            Some(_) => Err(LinkError::OtherMission),
            None => Err(LinkError::NoMission),
        }
    }

    /// Takes the mission away.
    pub(super) fn take(&mut self) -> Option<Mission<'m>> {
        self.mission.take()
    }

    /// This mission runs from now on, with the values that were saved for it.
    pub(super) fn begin_mission(&mut self, mission: Mission<'m>, registry: Registry<'_>) {
        self.params = LiveParams::NONE;
        let saved = self.saved.of(mission.hash());
        params::restore(&mut self.params, saved, &mission.tables(), registry);
        self.mission = Some(mission);
    }

    /// Takes a mission apart that has ended.
    pub(super) fn rest(&mut self, mission: Mission<'m>, lists: Lists<'m>) -> StoppedMission<'m> {
        let (mission, arena) = mission.interpreter.into_parts();
        let spare = self.own.keep(MissionMemory { arena, lists });
        StoppedMission { mission, spare }
    }

    /// The memory for a mission that starts again.
    pub(super) fn own_memory(&mut self) -> &mut OwnMemory<'m> {
        &mut self.own
    }

    /// Gives a buffer back that no mission is in any more, with the memory that goes with it.
    pub(super) fn free(&mut self, ended: StoppedMission<'m>, fell_back: Option<FallBack>) {
        let freed = Freed {
            blob: ended.mission.into_bytes(),
            spare: ended.spare,
            fell_back,
        };
        // There are as many places as buffers.
        let refused = self.freed.enqueue(freed);
        debug_assert!(refused.is_ok());
    }

    /// The mission runs on trial from now on.
    pub(super) fn begin_trial(&mut self, trial: Trial<'m>) {
        self.trial = Some(trial);
    }

    /// What is known while the mission is on trial.
    pub(super) fn trial(&self) -> Option<&Trial<'m>> {
        self.trial.as_ref()
    }

    /// Ends the trial.
    pub(super) fn end_trial(&mut self) -> Option<Trial<'m>> {
        self.trial.take()
    }

    /// The trial has failed for this reason, unless it had before.
    pub(super) fn fail_trial(&mut self, reason: SafeReason) {
        if let Some(trial) = &mut self.trial {
            trial.failed.get_or_insert(reason);
        }
    }

    /// Why the robot falls back at this robot time, if it does.
    pub(super) fn trial_end(&self, now_us: u64) -> Option<FallBackReason> {
        self.trial.as_ref()?.end_at(now_us)
    }

    /// Whether the mission of this hash is on trial, and has not failed.
    pub(super) fn is_on_trial(&self, mission: u32) -> bool {
        let goes_on = (self.trial.as_ref()).is_some_and(|trial| trial.failed.is_none());
        goes_on && self.hash() == Some(mission)
    }

    /// Whether the mission of this hash runs, and none is on trial.
    pub(super) fn stays(&self, mission: u32) -> bool {
        self.trial.is_none() && self.hash() == Some(mission)
    }

    /// Finds what a task's parameters are in this mission, the one that runs.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn find_params(
        &self,
        mission: &Mission<'m>,
        places: &TaskPlaces,
        count: usize,
        inputs: &mut Inputs,
    ) {
        let wanted = inputs.params.get_mut(..count).unwrap_or_default();
        mission.interpreter.params_at(places, wanted);
        if self.params.is_any() {
            self.params.put_into(wanted, places.first_param);
        }
    }

    /// The values that differ from the mission's.
    pub(super) fn params(&self) -> &LiveParams {
        &self.params
    }

    /// Gives a parameter of the mission of this hash another value, and answers the one before.
    pub(super) fn set_param(
        &mut self,
        mission: u32,
        param: u16,
        value: u32,
    ) -> Result<u32, LinkError> {
        let tables = self.mission_of(mission)?.tables();
        let of_mission = tables.param(usize::from(param)).unwrap_or_default();
        let before = self.params.get(param).unwrap_or(of_mission);
        self.params.set(param, value, of_mission);
        Ok(before)
    }

    /// What the mission of this hash starts with.
    pub(super) fn saved_of(&self, mission: u32) -> &LiveParams {
        self.saved.of(mission)
    }

    /// How many values were saved, for whichever mission.
    pub(super) fn saved_len(&self) -> u8 {
        self.saved.len()
    }

    /// These values were saved.
    pub(super) fn save(&mut self, saved: &SavedParams) {
        self.saved.assign(saved);
    }
}
