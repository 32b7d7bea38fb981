//! The place of a behaviour on the list, and in the world.

use super::law::{Behaviour, Control, Scene};
use super::life_cycle::LifeState;
use super::list::{BehaviourList, Key};
use super::situation::{SafetyCheck, is_outside};
use crate::declaration::Params;
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
    /// What the list is to name it by.
    pub(super) task: u16,
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
    /// What it asked for last.
    asked: Twist,
    free_us: u32,
    /// A situation keeps it from executing.
    is_barred: bool,
}

impl Default for Place {
    fn default() -> Self {
        Self {
            key: None,
            is_new: false,
            centre: LocalFrame::START,
            asked: Twist::STILL,
            free_us: 0,
            is_barred: false,
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

    /// The place of one that is on the list already, with a local frame of this centre.
    pub(super) fn at(key: Key, centre: Pose) -> Self {
        Self {
            key: Some(key),
            centre: LocalFrame::from(centre),
            ..Self::default()
        }
    }

    /// A pose in its local frame.
    pub(super) fn see(&self, pose: Pose) -> Pose {
        self.centre.see(pose)
    }

    /// What it asked for last.
    pub(super) fn asked(&self) -> Twist {
        self.asked
    }

    /// Whether a situation keeps it from executing from now on.
    pub(super) fn bar(&mut self, is_barred: bool) {
        self.is_barred = is_barred;
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
        let way_round = list.way_round;
        let mut room = None;
        let around = &Around {
            ranges: way_round.ranges(around.ranges, &mut room),
            ..*around
        };
        // Without a pose nobody knows where its local frame is to be, or where the robot is in it.
        if self.is_new {
            let Some(pose) = around.pose else {
                return Turn::NotYet;
            };
            let centre = law.centre(way_round.pose(pose), params);
            if !self.come(list, centre, around.task) {
                return Turn::Ends { failed: true };
            }
        }
        let role = self.role(list);
        if role != Role::Executes {
            let turns = list
                .way_round
                .is_to_change(around.ranges, || law.needs(params));
            return self.wait(list, around, role, turns);
        }
        let Some(pose) = around.pose else {
            return Turn::NotYet;
        };
        let turns = (list.way_round).turn_around(&pose, around.ranges, || law.needs(params));
        if let Some(twist) = turns {
            self.asked = twist;
            list.ask(twist);
            return Turn::Goes { suspended: false };
        }
        let scene = Scene {
            pose: self.centre.see(way_round.pose(pose)),
            ranges: around.ranges,
            period_us: around.period_us,
        };
        let control = law.control(&scene, params);
        self.obey(list, around, &scene.pose, control)
    }

    /// Comes onto the list. False where there is no room.
    fn come(&mut self, list: &mut BehaviourList, centre: Pose, task: u16) -> bool {
        if let Some(earlier) = self.key.take() {
            list.end(earlier);
        }
        let Ok(key) = list.insert_at_tail(task) else {
            return false;
        };
        *self = Self::at(key, centre);
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

    /// Does what is to do where another one executes. `turns` says that the robot is to turn around
    /// before it goes on, which is free however near things are.
    fn wait(
        &mut self,
        list: &mut BehaviourList,
        around: &Around<'_>,
        role: Role,
        turns: bool,
    ) -> Turn {
        match role {
            Role::Gone => {
                self.key = None;
                return Turn::Ends { failed: true };
            }
            Role::Executes | Role::Waits => {}
            Role::Idles => {
                let way = SafetyCheck::is_free_again(&self.asked, around.ranges);
                let is_barred = self.is_barred || self.key.is_some_and(|key| list.is_barred(key));
                let is_free = !is_barred && (turns || way);
                self.free_us = if is_free {
                    self.free_us.saturating_add(around.period_us)
                } else {
                    0
                };
                let is_held = self.key.is_some_and(|key| list.is_held(key));
                if self.free_us >= FREE_FOR_US && !is_held {
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
        let Control::Move(twist) = control else {
            return self.end(list, control == Control::Failed);
        };
        self.asked = twist;
        if around.outside_m > 0.0 && is_outside(pose, around.outside_m) {
            return self.end(list, false);
        }
        if self.is_barred || !SafetyCheck::is_free(&twist, around.ranges) {
            self.free_us = 0;
            list.idle();
            return self.wait(list, around, Role::Idles, false);
        }
        list.ask(list.way_round.twist(twist));
        Turn::Goes { suspended: false }
    }

    /// Leaves the list.
    pub(super) fn end(&mut self, list: &mut BehaviourList, failed: bool) -> Turn {
        if let Some(key) = self.key.take() {
            list.end(key);
        }
        Turn::Ends { failed }
    }
}
