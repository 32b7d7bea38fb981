//! The place of a behaviour on the list, and in the world.

use super::law::{Behaviour, Control, Scene};
use super::life_cycle::LifeState;
use super::list::{BehaviourList, CameUp, Key};
use super::situation::{SafetyCheck, StopDistance, is_outside, is_positive};
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
    pub(super) pose: Option<&'a Pose>,
    /// What is around the robot; none where nobody knows.
    pub(super) ranges: Option<&'a Ranges>,
    /// Time between two looks, in microseconds.
    pub(super) period_us: u32,
    /// Farther than this from its start it ends, in metres; 0 is no limit.
    pub(super) outside_m: f32,
}

/// How a behaviour comes onto the list.
#[derive(Clone, Copy, Debug)]
pub(super) struct Begins {
    /// Before the head of the list.
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
    /// On the list; [`Key::IDLE`] where it is not on it.
    key: Key,
    /// It has begun anew, and is to come onto the list. `Key::IDLE` where it was not on it before.
    begins: Option<Key>,
    centre: LocalFrame,
    /// What it asked for last.
    asked: Twist,
    free_us: u32,
    stop_distance: StopDistance,
    /// A situation keeps it from executing.
    is_barred: bool,
    /// Whoever steps it remembers here that it waits. There is no byte more for it: what is beside
    /// a place takes four of each task state.
    pub(super) is_suspended: bool,
}

impl Default for Place {
    fn default() -> Self {
        Self {
            key: Key::IDLE,
            begins: None,
            centre: LocalFrame::START,
            asked: Twist::STILL,
            free_us: 0,
            stop_distance: StopDistance::UNKNOWN,
            is_barred: false,
            is_suspended: false,
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
        let earlier = core::mem::replace(&mut self.key, Key::IDLE);
        self.begins.get_or_insert(earlier);
    }

    /// The place of one that is on the list already, with a local frame of this centre.
    pub(super) fn at(key: Key, centre: Pose) -> Self {
        Self {
            key,
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

    /// Takes part in the list, and in its turn says how to move. One that is not on the list yet
    /// comes onto it.
    pub(super) fn step(
        &mut self,
        list: &mut BehaviourList,
        around: &Around<'_>,
        begins: Begins,
        params: &Params,
        law: &mut dyn Behaviour,
    ) -> Turn {
        let turn = self.go_on(list, around, params, law);
        turn.unwrap_or_else(|| self.take_part(list, around, begins, params, law))
    }

    /// What most steps are: it executes, as in the look before, and the robot has its front ahead
    /// and hears with all sonars, so that there is nothing to find out. None where that is not so.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn go_on<L: Behaviour + ?Sized>(
        &mut self,
        list: &mut BehaviourList,
        around: &Around<'_>,
        params: &Params,
        law: &mut L,
    ) -> Option<Turn> {
        let pose = around.pose?;
        let goes_on = list.way_round.is_settled(around.ranges) && list.goes_on(self.key);
        goes_on.then(|| self.execute(list, around, pose, around.ranges, params, law))
    }

    /// There is no list: its owner has not begun, or its net has ended.
    pub(super) fn without_list(&mut self) -> Turn {
        if self.begins.is_some() {
            Turn::NotYet
        } else {
            self.key = Key::IDLE;
            Turn::Ends { failed: true }
        }
    }

    /// Finds out whose turn it is, and which way round the robot drives.
    #[inline(never)]
    pub(super) fn take_part(
        &mut self,
        list: &mut BehaviourList,
        around: &Around<'_>,
        begins: Begins,
        params: &Params,
        law: &mut dyn Behaviour,
    ) -> Turn {
        let way_round = list.way_round;
        let mut room = None;
        let ranges = way_round.ranges(around.ranges, &mut room);
        // Without a pose nobody knows where its local frame is to be, or where the robot is in it.
        if let Some(earlier) = self.begins {
            let Some(pose) = around.pose else {
                return Turn::NotYet;
            };
            let centre = law.centre(way_round.pose(*pose), params);
            self.begins = None;
            if earlier != Key::IDLE {
                list.end(earlier);
            }
            if !self.come(list, centre, begins) {
                return Turn::Ends { failed: true };
            }
        }
        let needs = || (!law.is_front_first()).then(|| law.needs(params));
        match self.role(list) {
            Role::Executes => {}
            Role::Gone => {
                self.key = Key::IDLE;
                return Turn::Ends { failed: true };
            }
            Role::Waits => return Turn::Goes { suspended: true },
            Role::Idles => {
                let clearance_m = around.pose.map_or(SafetyCheck::CLEARANCE_M, |pose| {
                    let pose = way_round.pose(*pose);
                    let scene = Scene::seen_from(&self.centre, &pose, ranges, around.period_us);
                    law.clearance_m(&scene, params)
                });
                // To turn around it needs no way.
                let more_m = clearance_m + SafetyCheck::MORE_M;
                let is_free = SafetyCheck::is_free_but(more_m, &self.asked, ranges)
                    || (list.way_round).is_to_change(ranges, needs);
                return self.idle(list, around, is_free);
            }
        }
        let Some(pose) = around.pose else {
            return Turn::NotYet;
        };
        let turns = (list.way_round).turn_around(pose, ranges, needs);
        if let Some(twist) = turns {
            self.asked = twist;
            list.ask(twist);
            return Turn::Goes { suspended: false };
        }
        self.execute(list, around, &way_round.pose(*pose), ranges, params, law)
    }

    /// Asks for what the law says, unless a situation is in the way. `pose` and `ranges` are as
    /// laws see them.
    #[cfg_attr(feature = "speed", inline(always))]
    fn execute<L: Behaviour + ?Sized>(
        &mut self,
        list: &mut BehaviourList,
        around: &Around<'_>,
        pose: &Pose,
        ranges: Option<&Ranges>,
        params: &Params,
        law: &mut L,
    ) -> Turn {
        let scene = Scene::seen_from(&self.centre, pose, ranges, around.period_us);
        let twist = match law.control(&scene, params) {
            Control::Move(twist) => twist,
            Control::Done => return self.end(list, false),
            Control::Failed => return self.end(list, true),
        };
        self.asked = twist;
        let clearance_m = law.clearance_m(&scene, params);
        if is_positive(around.outside_m) && is_outside(&scene.pose(), around.outside_m) {
            return self.end_outside(list);
        }
        if self.is_barred || !(self.stop_distance).is_free(clearance_m, &twist, ranges) {
            return self.stand(list);
        }
        list.ask(list.way_round.twist(twist));
        Turn::Goes { suspended: false }
    }

    /// It is farther from its start than it may be.
    #[inline(never)]
    fn end_outside(&mut self, list: &mut BehaviourList) -> Turn {
        self.tell(list, Situation::OutsideRange as u8, Reaction::Cancel);
        self.end(list, false)
    }

    /// IDLE executes in its place: a situation has come up, or its way is not free.
    #[inline(never)]
    fn stand(&mut self, list: &mut BehaviourList) -> Turn {
        if !self.is_barred {
            self.tell(list, SAFETY_CHECK, Reaction::Suspend);
        }
        self.free_us = 0;
        list.idle();
        Turn::Goes { suspended: true }
    }

    /// Comes onto the list. False where there is no room.
    fn come(&mut self, list: &mut BehaviourList, centre: Pose, begins: Begins) -> bool {
        let Ok(key) = list.insert(begins.at_head, begins.task) else {
            return false;
        };
        *self = Self::at(key, centre);
        true
    }

    fn role(&self, list: &mut BehaviourList) -> Role {
        let key = self.key;
        if key == Key::IDLE {
            return Role::Gone;
        }
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
        let is_barred = self.is_barred || list.is_barred(self.key);
        self.free_us = if way_is_free && !is_barred {
            self.free_us.saturating_add(around.period_us)
        } else {
            0
        };
        if self.free_us >= FREE_FOR_US && !list.is_held(self.key) {
            list.end(Key::IDLE);
        }
        Turn::Goes { suspended: true }
    }

    /// Notes that a situation has come up.
    fn tell(&self, list: &mut BehaviourList, situation: u8, reaction: Reaction) {
        list.come_up(CameUp {
            key: self.key,
            situation,
            reaction,
        });
    }

    /// Leaves the list.
    #[inline(never)]
    pub(super) fn end(&mut self, list: &mut BehaviourList, failed: bool) -> Turn {
        let key = core::mem::replace(&mut self.key, Key::IDLE);
        if key != Key::IDLE {
            list.end(key);
        }
        Turn::Ends { failed }
    }
}
