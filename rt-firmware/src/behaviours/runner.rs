//! What a task does that is a behaviour.

use super::life_cycle::LifeState;
use super::list::{BehaviourList, Key};
use super::situation::{OutsideRange, Reaction, SafetyCheck, Situation};
use super::{Behaviour, Control, Scene};
use crate::ports::Io;
use crate::task::{OptIn, OptInOut, OutFlag, Param, Step};
use crate::tasks::{Pose, Ranges, Twist};

/// How long the way must have been free before a suspended behaviour resumes, in microseconds: who
/// steps aside may step back.
const FREE_FOR_US: u32 = 500_000;

/// The ports, flags and parameters that all behaviours have.
#[derive(Clone, Copy)]
pub struct Ports {
    /// The list of behaviours.
    pub list: OptInOut<BehaviourList>,
    /// Where the robot is.
    pub pose: OptIn<Pose>,
    /// What is around it.
    pub ranges: OptIn<Ranges>,
    /// It waits.
    pub suspended: OutFlag,
    /// It has ended without being done.
    pub failed: OutFlag,
    /// Where it ends.
    pub outside_m: Param<f32>,
}

/// A behaviour between its entry and its end.
#[derive(Debug, Default)]
pub struct Runner<B> {
    law: B,
    place: Place,
}

/// Its place on the list, and in the world.
#[derive(Debug, Default)]
struct Place {
    key: Option<Key>,
    /// It has not come onto the list since its state was entered.
    is_new: bool,
    centre: Pose,
    /// What it asked for when it was interrupted.
    asked: Twist,
    free_us: u32,
}

/// Whose turn it is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Role {
    /// This behaviour executes.
    Executes,
    /// IDLE executes, and this one is next.
    Idles,
    /// Others are before it.
    Waits,
    /// It is not on the list any more.
    Gone,
}

impl<B: Behaviour + Default> Runner<B> {
    /// Its state was entered anew.
    pub fn enter(&mut self) {
        self.law = B::default();
        self.place.is_new = true;
    }

    /// Takes part in the list, and in its turn says how to move.
    pub fn step(&mut self, io: &mut Io<'_>, ports: &Ports) -> Step {
        self.place.step(io, ports, &mut self.law)
    }
}

impl Place {
    // Apart from the law, so that it is there once for all laws.
    fn step(&mut self, io: &mut Io<'_>, ports: &Ports, law: &mut dyn Behaviour) -> Step {
        let Some(pose) = io.try_read(ports.pose).copied() else {
            // Nobody knows where its local frame is to be, or where the robot is in it.
            return self.stand(io, ports);
        };
        if self.is_new {
            let centre = law.centre(pose, io);
            if let Some(step) = self.come(io, ports, centre) {
                return step;
            }
        }
        let role = self.role(io, ports);
        if role != Role::Executes {
            return self.wait(io, ports, role);
        }
        let scene = Scene {
            pose: self.centre.to_local(pose),
            ranges: io.try_read(ports.ranges),
            period_us: io.period_us(),
        };
        let control = law.control(&scene, io);
        self.obey(io, ports, &scene, control)
    }

    fn stand(&mut self, io: &mut Io<'_>, ports: &Ports) -> Step {
        if !self.is_new {
            let role = self.role(io, ports);
            if role != Role::Executes {
                return self.wait(io, ports, role);
            }
        }
        Step::Run
    }

    /// Comes onto the list. Returns the end of the step where it has not.
    fn come(&mut self, io: &mut Io<'_>, ports: &Ports, centre: Pose) -> Option<Step> {
        // Without a list nobody executes: its owner has not begun.
        let Some(list) = io.try_update(ports.list) else {
            return Some(Step::Run);
        };
        if let Some(earlier) = self.key.take() {
            list.end(earlier);
        }
        let Ok(key) = list.insert_at_tail() else {
            io.set(ports.failed, true);
            return Some(Step::Finished);
        };
        *self = Self {
            key: Some(key),
            is_new: false,
            centre,
            asked: Twist::STILL,
            free_us: 0,
        };
        None
    }

    fn role(&self, io: &mut Io<'_>, ports: &Ports) -> Role {
        let (Some(list), Some(key)) = (io.try_update(ports.list), self.key) else {
            return Role::Gone;
        };
        list.see(key);
        list.dispatch();
        match list.state(key) {
            None => Role::Gone,
            Some(LifeState::Execute) => Role::Executes,
            Some(_) if list.head() == Some(Key::IDLE) && list.second() == Some(key) => Role::Idles,
            Some(_) => Role::Waits,
        }
    }

    /// Does what is to do where another one executes.
    fn wait(&mut self, io: &mut Io<'_>, ports: &Ports, role: Role) -> Step {
        match role {
            Role::Gone => {
                io.set(ports.failed, true);
                return Step::Finished;
            }
            Role::Executes | Role::Waits => {}
            Role::Idles => {
                let ranges = io.try_read(ports.ranges);
                let is_free = SafetyCheck
                    .look(&self.centre, &self.asked, ranges)
                    .is_none();
                self.free_us = if is_free {
                    self.free_us.saturating_add(io.period_us())
                } else {
                    0
                };
                if self.free_us >= FREE_FOR_US
                    && let Some(list) = io.try_update(ports.list)
                {
                    list.end(Key::IDLE);
                }
            }
        }
        io.set(ports.suspended, true);
        Step::Run
    }

    /// Does what the law says, unless a situation is in the way.
    fn obey(
        &mut self,
        io: &mut Io<'_>,
        ports: &Ports,
        scene: &Scene<'_>,
        control: Control,
    ) -> Step {
        let outside = OutsideRange {
            radius_m: io.param(ports.outside_m),
        };
        let Control::Move(twist) = control else {
            return self.end(io, ports, control == Control::Failed);
        };
        let reaction = (outside.look(&scene.pose, &twist, scene.ranges))
            .or_else(|| SafetyCheck.look(&scene.pose, &twist, scene.ranges));
        match reaction {
            None => {
                if let Some(list) = io.try_update(ports.list) {
                    list.ask(twist);
                }
                io.set(ports.suspended, false);
                Step::Run
            }
            Some(Reaction::Cancel) => self.end(io, ports, false),
            Some(Reaction::Suspend) => {
                (self.asked, self.free_us) = (twist, 0);
                if let Some(list) = io.try_update(ports.list) {
                    list.idle();
                }
                self.wait(io, ports, Role::Idles)
            }
        }
    }

    fn end(&mut self, io: &mut Io<'_>, ports: &Ports, failed: bool) -> Step {
        if let (Some(list), Some(key)) = (io.try_update(ports.list), self.key.take()) {
            list.end(key);
        }
        io.set(ports.suspended, false);
        io.set(ports.failed, failed);
        Step::Finished
    }
}
