//! The place of a behaviour on the list, and in the world.

use super::law::{Behaviour, Control, Params, Scene};
use super::life_cycle::LifeState;
use super::list::{BehaviourList, Key};
use super::situation::{OutsideRange, Reaction, SafetyCheck, Situation};
use crate::odometry::LocalFrame;
use crate::tasks::{Pose, Ranges, Twist};

/// How long the way must have been free before a suspended behaviour resumes, in microseconds: who
/// steps aside may step back.
pub(super) const FREE_FOR_US: u32 = 500_000;

/// What a behaviour finds when it is looked at.
#[derive(Clone, Copy, Debug)]
pub(super) struct Around<'a> {
    /// Where the robot is, if anybody knows.
    pub(super) pose: Option<Pose>,
    /// What is around the robot; none where nobody knows.
    pub(super) ranges: Option<&'a Ranges>,
    /// Time between two looks, in microseconds.
    pub(super) period_us: u32,
    /// Farther than this from its start it ends, in metres; 0 is no limit.
    pub(super) outside_m: f32,
}

/// What became of a behaviour in one look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turn {
    /// It cannot come onto the list yet, or does not know where it is: nothing changes.
    NotYet,
    /// It is on the list.
    Goes {
        /// Others are before it, or its way is not free.
        suspended: bool,
    },
    /// It is over, and not on the list any more.
    Ends {
        /// It was not done.
        failed: bool,
    },
}

/// A behaviour's place on the list, and in the world.
#[derive(Debug)]
pub(super) struct Place {
    key: Option<Key>,
    /// It has not come onto the list since it began.
    is_new: bool,
    centre: LocalFrame,
    /// What it asked for when it was interrupted.
    asked: Twist,
    free_us: u32,
}

impl Default for Place {
    fn default() -> Self {
        Self {
            key: None,
            is_new: false,
            centre: LocalFrame::START,
            asked: Twist::STILL,
            free_us: 0,
        }
    }
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

impl Place {
    /// It begins anew, and comes onto the list in its next step.
    pub(super) fn begin_anew(&mut self) {
        self.is_new = true;
    }

    /// Takes part in the list, and in its turn says how to move.
    pub(super) fn step(
        &mut self,
        list: Option<&mut BehaviourList>,
        around: &Around<'_>,
        params: &Params,
        law: &mut dyn Behaviour,
    ) -> Turn {
        let Some(list) = list else {
            // Its owner has not begun, or its net has ended.
            return if self.is_new {
                Turn::NotYet
            } else {
                self.key = None;
                Turn::Ends { failed: true }
            };
        };
        // Without a pose nobody knows where its local frame is to be, or where the robot is in it.
        if self.is_new {
            let Some(pose) = around.pose else {
                return Turn::NotYet;
            };
            if !self.come(list, law.centre(pose, params)) {
                return Turn::Ends { failed: true };
            }
        }
        let role = self.role(list);
        if role != Role::Executes {
            return self.wait(list, around, role);
        }
        let Some(pose) = around.pose else {
            return Turn::NotYet;
        };
        let scene = Scene {
            pose: self.centre.see(pose),
            ranges: around.ranges,
            period_us: around.period_us,
        };
        let control = law.control(&scene, params);
        self.obey(list, around, &scene.pose, control)
    }

    /// Comes onto the list. False where there is no room.
    fn come(&mut self, list: &mut BehaviourList, centre: Pose) -> bool {
        if let Some(earlier) = self.key.take() {
            list.end(earlier);
        }
        let Ok(key) = list.insert_at_tail() else {
            return false;
        };
        *self = Self {
            key: Some(key),
            is_new: false,
            centre: LocalFrame::from(centre),
            asked: Twist::STILL,
            free_us: 0,
        };
        true
    }

    fn role(&self, list: &mut BehaviourList) -> Role {
        let Some(key) = self.key else {
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
    fn wait(&mut self, list: &mut BehaviourList, around: &Around<'_>, role: Role) -> Turn {
        match role {
            Role::Gone => {
                self.key = None;
                return Turn::Ends { failed: true };
            }
            Role::Executes | Role::Waits => {}
            Role::Idles => {
                let is_free = SafetyCheck::is_free(&self.asked, around.ranges);
                self.free_us = if is_free {
                    self.free_us.saturating_add(around.period_us)
                } else {
                    0
                };
                if self.free_us >= FREE_FOR_US {
                    list.end(Key::IDLE);
                }
            }
        }
        Turn::Goes { suspended: true }
    }

    /// Does what the law says, unless a situation is in the way.
    fn obey(
        &mut self,
        list: &mut BehaviourList,
        around: &Around<'_>,
        pose: &Pose,
        control: Control,
    ) -> Turn {
        let outside = OutsideRange {
            radius_m: around.outside_m,
        };
        let Control::Move(twist) = control else {
            return self.end(list, control == Control::Failed);
        };
        let reaction = (outside.look(pose, &twist, around.ranges))
            .or_else(|| SafetyCheck.look(pose, &twist, around.ranges));
        match reaction {
            None => {
                list.ask(twist);
                Turn::Goes { suspended: false }
            }
            Some(Reaction::Cancel) => self.end(list, false),
            Some(Reaction::Suspend) => {
                (self.asked, self.free_us) = (twist, 0);
                list.idle();
                self.wait(list, around, Role::Idles)
            }
        }
    }

    fn end(&mut self, list: &mut BehaviourList, failed: bool) -> Turn {
        if let Some(key) = self.key.take() {
            list.end(key);
        }
        Turn::Ends { failed }
    }
}
