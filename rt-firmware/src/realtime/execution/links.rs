//! The dispatchers of links, which are executed as tasks are: in their slots, while their states
//! are current.

use super::super::machine::{Machine, Mission};
use super::Execution;
use crate::board::Board;
use crate::frames::{Activation, Flags, FrameLists, LinkDevice, NO_DISPATCHER};
use crate::ports::ValueKind;

/// The flags and nets of a mission.
struct OfMission<'a, 'm>(&'a mut Mission<'m>);

impl Flags for OfMission<'_, '_> {
    fn flag(&self, instance: u16, flag: u16) -> bool {
        self.0.flag(instance, flag)
    }

    fn set_flag(&mut self, instance: u16, flag: u16, value: bool) {
        self.0.set_flag(instance, flag, value);
    }

    fn net(&self, instance: u16, port: u8) -> Option<usize> {
        let tables = self.0.tables();
        let first = tables.task_instance(instance.into())?.first_connection;
        tables.connection(first + usize::from(port)).flatten()
    }
}

/// Executes a dispatcher once.
#[inline(never)]
pub(super) fn run<B: Board>(
    execution: &mut Execution<'_, '_>,
    board: &mut B,
    machine: &mut Machine<'_, '_>,
    instance: u16,
) {
    if let Some(record) = execution.tasks.lists.tasks.get(usize::from(instance)) {
        let device = board.link(FrameLists::device_of(record.dispatcher));
        run_with(execution, device, machine, instance);
    }
}

/// The same, compiled once, with this crate's settings.
#[inline(never)]
fn run_with(
    execution: &mut Execution<'_, '_>,
    device: Option<&mut dyn LinkDevice>,
    machine: &mut Machine<'_, '_>,
    instance: u16,
) {
    let robot_us = execution.executor.robot_us();
    let lists = &mut execution.tasks.lists;
    let (Some(record), Some(mission)) = (
        lists.tasks.get(usize::from(instance)),
        machine.mission_mut(),
    ) else {
        return;
    };
    let at = Activation {
        instance,
        is_fresh: record.activity.is_fresh(),
        robot_us,
        period_us: record.period_us,
        duration_us: execution.duration_us,
    };
    lists.frames.run(
        record.dispatcher,
        &at,
        device,
        &mut execution.executor,
        &mut OfMission(mission),
    );
}

/// The kind of the values on a data port, if the task is a dispatcher.
pub(super) fn kind(execution: &Execution<'_, '_>, instance: u16, port: usize) -> Option<ValueKind> {
    let lists = &execution.tasks.lists;
    let record = lists.tasks.get(usize::from(instance))?;
    lists.frames.kind(record.dispatcher, port)
}

/// A task state was entered in a macro step at this time.
pub(super) fn enter(execution: &mut Execution<'_, '_>, instance: u16, robot_us: u64) {
    let lists = &mut execution.tasks.lists;
    if let Some(record) = lists.tasks.get(usize::from(instance))
        && record.dispatcher != NO_DISPATCHER
    {
        lists.frames.enter(record.dispatcher, robot_us);
    }
}

/// A task state was left in a macro step at this time.
pub(super) fn leave(execution: &mut Execution<'_, '_>, instance: u16, robot_us: u64) {
    let lists = &mut execution.tasks.lists;
    if let Some(record) = lists.tasks.get(usize::from(instance))
        && record.dispatcher != NO_DISPATCHER
    {
        lists.frames.leave(record.dispatcher, robot_us);
    }
}

/// A macro step has seen the flags that are true for one.
pub(in super::super) fn clear_seen(execution: &mut Execution<'_, '_>, mission: &mut Mission<'_>) {
    let frames = &mut execution.tasks.lists.frames;
    frames.clear_seen(&mut OfMission(mission));
}
