//! The place of a behaviour on the list, and in the world.

use super::law::{Behaviour, Control, Scene};
use super::life_cycle::LifeState;
use super::list::{BehaviourList, CameUp, Key};
use super::situation::{SafetyCheck, is_outside};
use crate::declaration::Params;
use crate::odometry::LocalFrame;
use crate::tasks::{Pose, Ranges, Twist};
use esm_link::behaviours::{Reaction, Situation};
use esm_link::black_box::SAFETY_CHECK;

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
    /// It comes before the head of the list.
    pub(super) at_head: bool,
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
            if !self.come(list, centre, around) {
                return Turn::Ends { failed: true };
            }
        }
        let see = |pose| Scene {
            pose: self.centre.see(way_round.pose(pose)),
            ranges: around.ranges,
            period_us: around.period_us,
        };
        let needs = || (!law.is_front_first()).then(|| law.needs(params));
        match self.role(list) {
            Role::Executes => {}
            Role::Gone => {
                self.key = None;
                return Turn::Ends { failed: true };
            }
            Role::Waits => return Turn::Goes { suspended: true },
            Role::Idles => {
                let clearance_m = around.pose.map_or(SafetyCheck::CLEARANCE_M, |pose| {
                    law.clearance_m(&see(pose), params)
                });
                // To turn around it needs no way.
                let is_free = SafetyCheck::is_free_but(
                    clearance_m + SafetyCheck::MORE_M,
                    &self.asked,
                    around.ranges,
                ) || (list.way_round).is_to_change(around.ranges, needs);
                return self.idle(list, around, is_free);
            }
        }
        let Some(pose) = around.pose else {
            return Turn::NotYet;
        };
        let turns = (list.way_round).turn_around(&pose, around.ranges, needs);
        if let Some(twist) = turns {
            self.asked = twist;
            list.ask(twist);
            return Turn::Goes { suspended: false };
        }
        let scene = see(pose);
        match law.control(&scene, params) {
            Control::Move(twist) => {
                self.asked = twist;
                let clearance_m = law.clearance_m(&scene, params);
                self.go(list, around, &scene.pose, clearance_m)
            }
            Control::Done => self.end(list, false),
            Control::Failed => self.end(list, true),
        }
    }

    /// Comes onto the list. False where there is no room.
    fn come(&mut self, list: &mut BehaviourList, centre: Pose, around: &Around<'_>) -> bool {
        if let Some(earlier) = self.key.take() {
            list.end(earlier);
        }
        let Ok(key) = list.insert(around.at_head, around.task) else {
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

    /// Waits while IDLE executes in its place, until the way has been free for a while.
    fn idle(&mut self, list: &mut BehaviourList, around: &Around<'_>, way_is_free: bool) -> Turn {
        let is_barred = self.is_barred || self.key.is_some_and(|key| list.is_barred(key));
        self.free_us = if way_is_free && !is_barred {
            self.free_us.saturating_add(around.period_us)
        } else {
            0
        };
        let is_held = self.key.is_some_and(|key| list.is_held(key));
        if self.free_us >= FREE_FOR_US && !is_held {
            list.end(Key::IDLE);
        }
        Turn::Goes { suspended: true }
    }

    /// Asks for what the law says, unless a situation is in the way.
    fn go(
        &mut self,
        list: &mut BehaviourList,
        around: &Around<'_>,
        pose: &Pose,
        clearance_m: f32,
    ) -> Turn {
        let twist = self.asked;
        if around.outside_m > 0.0 && is_outside(pose, around.outside_m) {
            self.tell(list, Situation::OutsideRange as u8, Reaction::Cancel);
            return self.end(list, false);
        }
        if self.is_barred || !SafetyCheck::is_free_but(clearance_m, &twist, around.ranges) {
            if !self.is_barred {
                self.tell(list, SAFETY_CHECK, Reaction::Suspend);
            }
            self.free_us = 0;
            list.idle();
            return Turn::Goes { suspended: true };
        }
        list.ask(list.way_round.twist(twist));
        Turn::Goes { suspended: false }
    }

    /// Notes that a situation has come up.
    fn tell(&self, list: &mut BehaviourList, situation: u8, reaction: Reaction) {
        if let Some(key) = self.key {
            list.come_up(CameUp {
                key,
                situation,
                reaction,
            });
        }
    }

    /// Leaves the list.
    pub(super) fn end(&mut self, list: &mut BehaviourList, failed: bool) -> Turn {
        if let Some(key) = self.key.take() {
            list.end(key);
        }
        Turn::Ends { failed }
    }
}
