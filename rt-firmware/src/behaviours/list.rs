//! The list of behaviours: who executes, who waits, who was interrupted.

use super::life_cycle::{Cause, LifeState};
use super::way_round::WayRound;
use crate::list_command::LIST_TYPE;
use crate::show::{Field, Show};
use crate::task::PortType;
use crate::tasks::Twist;
use esm_link::behaviours::Reaction;

/// How many behaviours the list has room for, beside [`IDLE`](Key::IDLE).
pub const MAX_BEHAVIOURS: usize = 8;

/// Places on the list: one is IDLE's, so that danger finds room in a full list.
const PLACES: usize = MAX_BEHAVIOURS + 1;

/// A behaviour that was not seen in so many looks of the list's owner is gone: its task state was
/// left.
pub const UNSEEN_LOOKS: u8 = 2;

/// A situation that does not say anew for so many looks that it lasts is over, or nobody watches
/// for it any more.
const BARRED_LOOKS: u8 = 2;

/// Who is on the list.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Key(u16);

impl Key {
    /// The behaviour that stands still.
    pub const IDLE: Self = Self(0);

    /// Its number.
    pub const fn number(self) -> u16 {
        self.0
    }

    /// The key of this number.
    pub const fn of_number(number: u16) -> Self {
        Self(number)
    }
}

/// A situation that came up beside a behaviour.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct CameUp {
    /// Beside which one.
    pub key: Key,
    /// Its number in the flight recorder.
    pub situation: u8,
    /// What is done about it.
    pub reaction: Reaction,
}

/// Those that are known of one activation: the first one. Where who executes ends by it, the next
/// one may have one of its own, which is not told.
const CAME_UP: usize = 1;

/// The list has no room.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ListFull;

/// A state, and what keeps a behaviour from executing, in one byte: each task state of a behaviour
/// has room for two lists.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Life(u8);

impl Life {
    const STATE: u8 = 0b111;
    /// It was suspended by hand.
    const HELD: u8 = 0b1000;
    /// A situation keeps it from executing for one look more, of up to [`BARRED_LOOKS`].
    const BARRED_LOOK: u8 = 0b1_0000;
    /// It executes, and nothing keeps it from that.
    const GOES_ON: Self = Self(LifeState::Execute as u8);

    const fn state(self) -> LifeState {
        LifeState::of_number(self.0 & Self::STATE)
    }

    fn set_state(&mut self, state: LifeState) {
        self.0 = self.0 & !Self::STATE | state as u8;
    }

    const fn is_held(self) -> bool {
        self.0 & Self::HELD != 0
    }

    fn hold(&mut self, is_held: bool) {
        self.0 = self.0 & !Self::HELD | if is_held { Self::HELD } else { 0 };
    }

    const fn is_barred(self) -> bool {
        self.0 >= Self::BARRED_LOOK
    }

    fn bar(&mut self) {
        self.0 = self.0 % Self::BARRED_LOOK + Self::BARRED_LOOK * BARRED_LOOKS;
    }

    /// One look less is to come.
    fn was_looked_at(&mut self) {
        self.0 -= Self::BARRED_LOOK;
    }

    /// By hand, or by a situation.
    const fn is_kept(self) -> bool {
        self.0 > Self::STATE
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Entry {
    key: Key,
    /// The lower half of its task's signature hash.
    task: u16,
    life: Life,
    unseen: u8,
}

impl Entry {
    /// At the head, it executes, as before, and nothing keeps it from that.
    fn goes_on(&self) -> bool {
        self.life == Life::GOES_ON
    }

    /// It has not shown itself for so long, or it is IDLE and nobody is behind it.
    fn is_gone(&self, is_alone: bool) -> bool {
        if self.key == Key::IDLE {
            is_alone
        } else {
            self.unseen > UNSEEN_LOOKS
        }
    }
}

/// The behaviours of a robot, in the order in which they execute. The head does; the others wait.
///
/// New ones go to the tail, or before the head, which they interrupt. The list is a value on a net
/// of the mission: its behaviours and its owner, the task [`Behaviours`](super::Behaviours), change
/// it one after the other.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BehaviourList {
    entries: [Entry; PLACES],
    /// The head is a behaviour that goes on, and not IDLE. Found out where something changes.
    head_goes_on: bool,
    len: u8,
    last_key: u16,
    /// What the behaviour that executes has asked for, in this look or in the last one.
    asked: Twist,
    /// It was not taken yet.
    is_new: bool,
    /// Situations that came up beside a behaviour, since this was taken.
    came_up: [Option<CameUp>; CAME_UP],
    /// Which way round the robot drives, whoever executes.
    pub(super) way_round: WayRound,
    /// Goes on whenever somebody comes, leaves, or goes on in another state.
    changes: u8,
}

impl BehaviourList {
    /// A list with nobody on it.
    pub const EMPTY: Self = Self {
        entries: [Entry {
            key: Key::IDLE,
            task: 0,
            life: Life(LifeState::Initial as u8),
            unseen: 0,
        }; PLACES],
        head_goes_on: false,
        len: 0,
        last_key: 0,
        asked: Twist::STILL,
        is_new: false,
        came_up: [None; CAME_UP],
        way_round: WayRound::FORWARDS,
        changes: 0,
    };

    fn present(&self) -> &[Entry] {
        self.entries.get(..usize::from(self.len)).unwrap_or(&[])
    }

    fn present_mut(&mut self) -> &mut [Entry] {
        (self.entries.get_mut(..usize::from(self.len))).unwrap_or(&mut [])
    }

    fn place(&self, key: Key) -> Option<usize> {
        self.present().iter().position(|entry| entry.key == key)
    }

    /// How many are on it.
    pub fn len(&self) -> usize {
        self.len.into()
    }

    /// Whether nobody is on it.
    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    /// Who is at the head.
    pub fn head(&self) -> Option<Key> {
        self.present().first().map(|entry| entry.key)
    }

    /// Who comes after the head.
    pub fn second(&self) -> Option<Key> {
        self.present().get(1).map(|entry| entry.key)
    }

    /// The state of a behaviour; none where it is not on the list.
    pub fn state(&self, key: Key) -> Option<LifeState> {
        let place = self.place(key)?;
        self.present().get(place).map(|entry| entry.life.state())
    }

    /// Puts a new behaviour behind all others. The lower half of its task's signature hash names
    /// it to whoever looks at the list.
    ///
    /// # Errors
    /// [`ListFull`]
    pub fn insert_at_tail(&mut self, task: u16) -> Result<Key, ListFull> {
        let key = self.room_for_one()?;
        self.put_in(self.len.into(), key, task);
        Ok(key)
    }

    /// Puts a new behaviour before the head, which is interrupted if it executes.
    ///
    /// # Errors
    /// [`ListFull`]
    pub fn insert_at_head(&mut self, task: u16) -> Result<Key, ListFull> {
        let key = self.room_for_one()?;
        self.interrupt_head();
        self.put_in(0, key, task);
        Ok(key)
    }

    /// Puts a new behaviour before the head, or behind all others.
    ///
    /// # Errors
    /// [`ListFull`]
    pub fn insert(&mut self, at_head: bool, task: u16) -> Result<Key, ListFull> {
        if at_head {
            self.insert_at_head(task)
        } else {
            self.insert_at_tail(task)
        }
    }

    /// The place of a behaviour on the list, from the head on.
    pub(super) fn place_of(&self, key: Key) -> Option<usize> {
        self.place(key)
    }

    /// Puts a new behaviour into the place of one that has left it.
    ///
    /// # Errors
    /// [`ListFull`]
    pub(super) fn insert_at(&mut self, place: usize, task: u16) -> Result<Key, ListFull> {
        let key = self.room_for_one()?;
        self.put_in(place.min(self.len()), key, task);
        Ok(key)
    }

    /// Puts IDLE before the head, which is interrupted if it executes: the robot stands still until
    /// [`end`](Self::end) takes IDLE off again. There is always room for it, once: one that another
    /// behaviour was put before leaves its place, and who is behind that looks for itself.
    pub fn idle(&mut self) {
        if self.head() != Some(Key::IDLE) {
            self.end(Key::IDLE);
            self.interrupt_head();
            self.put_in(0, Key::IDLE, 0);
            self.dispatch();
        }
    }

    /// Suspends a behaviour by hand, or resumes it: one that is held does not execute; IDLE does in
    /// its place, once its turn comes. Returns whether it is on the list.
    pub fn hold(&mut self, key: Key, is_held: bool) -> bool {
        let place = self.place(key).filter(|_| key != Key::IDLE);
        let Some(entry) = place.and_then(|place| self.present_mut().get_mut(place)) else {
            return false;
        };
        entry.life.hold(is_held);
        self.find_who_goes_on();
        true
    }

    /// Whether a behaviour was suspended by hand.
    pub fn is_held(&self, key: Key) -> bool {
        let entry = self.place(key).and_then(|place| self.present().get(place));
        entry.is_some_and(|entry| entry.life.is_held())
    }

    /// A situation has come up that keeps a behaviour from executing: IDLE does in its place, once
    /// its turn comes. Said anew in each activation as long as it lasts; see [`BARRED_LOOKS`].
    pub(super) fn bar(&mut self, key: Key) {
        let place = self.place(key).filter(|_| key != Key::IDLE);
        if let Some(entry) = place.and_then(|place| self.present_mut().get_mut(place)) {
            entry.life.bar();
        }
        self.find_who_goes_on();
    }

    /// Whether a situation keeps a behaviour from executing.
    pub(super) fn is_barred(&self, key: Key) -> bool {
        let entry = self.place(key).and_then(|place| self.present().get(place));
        entry.is_some_and(|entry| entry.life.is_barred())
    }

    /// The behaviour whose turn it is, whether it executes or IDLE does in its place. None while
    /// the robot is steered by hand.
    pub(super) fn in_turn(&self) -> Option<Key> {
        let mut others = self.present().iter().filter(|entry| entry.key != Key::IDLE);
        // REMOTE_CONTROL is no task.
        others
            .next()
            .filter(|entry| entry.task != 0)
            .map(|entry| entry.key)
    }

    /// A behaviour shows that it is there, if it executes, and may go on. False changes nothing:
    /// then [`see`](Self::see) and [`dispatch`](Self::dispatch) find out how it is. So a behaviour
    /// that goes on takes part in the list with one look.
    #[inline(always)]
    pub(super) fn goes_on(&mut self, key: Key) -> bool {
        let goes_on = self.head_goes_on;
        let head = self.entries.first_mut().filter(|_| goes_on);
        match head.filter(|head| head.key == key) {
            Some(head) => {
                head.unseen = 0;
                true
            }
            None => false,
        }
    }

    fn find_who_goes_on(&mut self) {
        let head = self.present().first();
        self.head_goes_on = head.is_some_and(|head| head.goes_on() && head.key != Key::IDLE);
    }

    /// A number that is another one when somebody has come, left, or gone on in another state.
    pub(super) fn changes(&self) -> u8 {
        self.changes
    }

    /// Lets the head execute, or IDLE before it where it is held or barred. Others never do.
    #[inline(always)]
    pub fn dispatch(&mut self) {
        if !self.head_goes_on {
            self.dispatch_another();
        }
    }

    #[inline(never)]
    fn dispatch_another(&mut self) {
        let head = self.present().first();
        if head.is_some_and(|head| head.life.is_kept()) {
            self.idle();
        }
        if let Some(head) = self.present_mut().first_mut()
            && let Some(state) = head.life.state().after(Cause::Dispatch)
        {
            head.life.set_state(state);
            self.changes = self.changes.wrapping_add(1);
            self.find_who_goes_on();
        }
    }

    /// A behaviour is over, whether it executes or not: it leaves the list. Returns whether it was
    /// on it.
    pub fn end(&mut self, key: Key) -> bool {
        let Some(place) = self.place(key) else {
            return false;
        };
        // Those behind it move up, one after the other.
        for place in place + 1..self.len() {
            if let Some(entry) = self.present().get(place).copied() {
                self.put(place - 1, entry);
            }
        }
        self.len -= 1;
        self.changes = self.changes.wrapping_add(1);
        self.find_who_goes_on();
        true
    }

    /// A behaviour shows that it is there.
    pub fn see(&mut self, key: Key) {
        if let Some(place) = self.place(key)
            && let Some(entry) = self.present_mut().get_mut(place)
        {
            entry.unseen = 0;
        }
    }

    /// Takes off those that have not shown themselves in [`UNSEEN_LOOKS`] looks, IDLE if nobody is
    /// behind it, and lets the head execute.
    pub fn look(&mut self) {
        let is_alone = self.len == 1;
        let mut is_anybody_gone = false;
        let mut was_barred = false;
        for entry in self.present_mut() {
            if entry.life.is_barred() {
                entry.life.was_looked_at();
                was_barred = true;
            }
            entry.unseen = entry.unseen.saturating_add(1);
            is_anybody_gone |= entry.is_gone(is_alone);
        }
        if was_barred {
            self.find_who_goes_on();
        }
        if is_anybody_gone {
            self.take_off_who_is_gone();
        }
        self.dispatch();
    }

    #[inline(never)]
    fn take_off_who_is_gone(&mut self) {
        // From the end on: what is taken off moves only those that have been looked at.
        for place in (0..self.len()).rev() {
            let is_alone = self.len == 1;
            let entry = self.present().get(place);
            if let Some(entry) = entry.filter(|entry| entry.is_gone(is_alone)) {
                self.end(entry.key);
            }
        }
    }

    /// A situation came up beside a behaviour.
    pub(super) fn come_up(&mut self, came_up: CameUp) {
        if let Some(room) = self.came_up.iter_mut().find(|place| place.is_none()) {
            *room = Some(came_up);
        }
    }

    /// The situations that came up since the last call.
    pub(super) fn take_came_up(&mut self) -> [Option<CameUp>; CAME_UP] {
        core::mem::take(&mut self.came_up)
    }

    /// The lower half of the signature hash of a behaviour's task, if it is on the list.
    pub(super) fn task(&self, key: Key) -> Option<u16> {
        let place = self.place(key)?;
        self.present().get(place).map(|entry| entry.task)
    }

    /// The behaviour that executes asks for a movement.
    pub fn ask(&mut self, twist: Twist) {
        (self.asked, self.is_new) = (twist, true);
    }

    /// The movement that was asked for last, in this look or in the one before.
    pub(super) fn asked(&self) -> Twist {
        self.asked
    }

    /// The movement that was asked for since the last call; none stands still.
    pub fn take_asked(&mut self) -> Twist {
        if !core::mem::take(&mut self.is_new) {
            self.asked = Twist::STILL;
        }
        self.asked
    }

    /// What stands on the list, the head first: key, task, state, and whether it is held.
    pub fn entries(&self) -> impl Iterator<Item = (Key, u16, LifeState, bool)> {
        self.present().iter().map(|entry| {
            let life = entry.life;
            (entry.key, entry.task, life.state(), life.is_held())
        })
    }

    fn room_for_one(&mut self) -> Result<Key, ListFull> {
        let others = self.present().iter().filter(|entry| entry.key != Key::IDLE);
        if others.count() >= MAX_BEHAVIOURS {
            return Err(ListFull);
        }
        // A key of a behaviour that has been on the list for 65,535 others is not given twice.
        for _ in 0..=MAX_BEHAVIOURS {
            self.last_key = self.last_key.checked_add(1).unwrap_or(1);
            let key = Key(self.last_key);
            if self.place(key).is_none() {
                return Ok(key);
            }
        }
        Err(ListFull)
    }

    fn put_in(&mut self, place: usize, key: Key, task: u16) {
        self.len += 1;
        self.changes = self.changes.wrapping_add(1);
        let mut moved = Entry {
            key,
            task,
            ..Entry::default()
        };
        for place in place..self.len() {
            if let Some(entry) = self.present_mut().get_mut(place) {
                core::mem::swap(entry, &mut moved);
            }
        }
        self.find_who_goes_on();
    }

    fn put(&mut self, place: usize, entry: Entry) {
        if let Some(at) = self.present_mut().get_mut(place) {
            *at = entry;
        }
    }

    fn interrupt_head(&mut self) {
        if let Some(head) = self.present_mut().first_mut() {
            for cause in [Cause::Interrupt, Cause::Requeue] {
                if let Some(state) = head.life.state().after(cause) {
                    head.life.set_state(state);
                }
            }
            self.changes = self.changes.wrapping_add(1);
        }
    }
}

impl PortType for BehaviourList {
    const NAME: &'static str = LIST_TYPE;
    const INIT: Self = Self::EMPTY;

    const FIELDS: &'static str = "behaviours:u8\nkeys:[u16;9]\nstates:[u8;9]\ntasks:[u16;9]\n";

    // What is not on the list is 0.
    fn show(&self, show: &mut Show<'_>) {
        let mut keys = [0; PLACES];
        let mut states = [0; PLACES];
        let mut tasks = [0; PLACES];
        let rows = keys.iter_mut().zip(&mut states).zip(&mut tasks);
        for (entry, ((key, state), task)) in self.present().iter().zip(rows) {
            (*key, *state, *task) = (entry.key.0, entry.life.state() as u8, entry.task);
        }
        self.len.show(show);
        keys.show(show);
        states.show(show);
        tasks.show(show);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn new_ones_wait_behind_the_others_and_the_head_executes() {
        let mut list = BehaviourList::EMPTY;
        let first = list.insert_at_tail(1).unwrap();
        let second = list.insert_at_tail(1).unwrap();
        assert_eq!(list.state(first), Some(LifeState::Initial));
        list.dispatch();
        assert_eq!(list.state(first), Some(LifeState::Execute));
        assert_eq!(list.state(second), Some(LifeState::Initial));
        assert!(list.end(first) && !list.end(first));
        list.dispatch();
        assert_eq!(list.head(), Some(second));
        assert_eq!(list.state(second), Some(LifeState::Execute));
    }

    #[test]
    fn one_before_the_head_interrupts_it_and_it_resumes() {
        let mut list = BehaviourList::EMPTY;
        let first = list.insert_at_tail(1).unwrap();
        list.dispatch();
        let urgent = list.insert_at_head(1).unwrap();
        assert_eq!(list.state(first), Some(LifeState::Resume));
        list.dispatch();
        assert_eq!(list.state(urgent), Some(LifeState::Execute));
        list.end(urgent);
        list.dispatch();
        assert_eq!(list.state(first), Some(LifeState::Execute));
        // One that has never executed stays as it is.
        let waits = list.insert_at_tail(1).unwrap();
        list.end(first);
        list.insert_at_head(1).unwrap();
        assert_eq!(list.state(waits), Some(LifeState::Initial));
    }

    #[test]
    fn a_full_list_refuses_and_has_room_for_idle() {
        for insert in [BehaviourList::insert_at_tail, BehaviourList::insert_at_head] {
            let mut list = BehaviourList::EMPTY;
            for _ in 0..MAX_BEHAVIOURS {
                insert(&mut list, 1).unwrap();
            }
            assert_eq!(insert(&mut list, 1), Err(ListFull));
            let head = list.head().unwrap();
            list.dispatch();
            list.idle();
            list.idle();
            assert_eq!(list.len(), MAX_BEHAVIOURS + 1);
            assert_eq!(insert(&mut list, 1), Err(ListFull));
            assert_eq!(list.state(Key::IDLE), Some(LifeState::Execute));
            assert_eq!(list.second(), Some(head));
            assert_eq!(list.state(head), Some(LifeState::Resume));
        }
    }

    #[test]
    fn who_is_not_seen_leaves_and_idle_does_not_stay_alone() {
        let mut list = BehaviourList::EMPTY;
        let left = list.insert_at_tail(1).unwrap();
        let stays = list.insert_at_tail(1).unwrap();
        list.dispatch();
        list.idle();
        for look in 1..=UNSEEN_LOOKS + 1 {
            list.look();
            list.see(stays);
            assert_eq!(list.state(left).is_some(), look <= UNSEEN_LOOKS);
        }
        assert_eq!((list.head(), list.second()), (Some(Key::IDLE), Some(stays)));
        list.end(stays);
        list.look();
        assert!(list.is_empty());
    }

    /// Each task state of a behaviour has room for two: the chapter on behaviours says how much.
    #[test]
    fn a_list_is_as_small_as_the_book_says() {
        let bytes = if cfg!(feature = "all-behaviours") {
            88
        } else {
            76
        };
        assert_eq!(size_of::<BehaviourList>(), bytes);
    }

    proptest! {
        /// Whatever is done to a list, in any order: its keys differ, it is never overfull, and
        /// only the head executes.
        #[test]
        fn only_the_head_executes(ops in prop::collection::vec((0_u8..9, 0_usize..PLACES), 0..60)) {
            let mut list = BehaviourList::EMPTY;
            for (op, at) in ops {
                let key = list.present().get(at).map(|entry| entry.key);
                match (op, key) {
                    (0, _) => drop(list.insert_at_tail(1)),
                    (1, _) => drop(list.insert_at_head(1)),
                    (2, _) => list.idle(),
                    (3, _) => list.look(),
                    (4, Some(key)) => drop(list.end(key)),
                    (5, Some(key)) => drop(list.hold(key, at % 2 == 0)),
                    (6, Some(key)) => list.bar(key),
                    (7, _) => list.dispatch(),
                    (_, Some(key)) => list.see(key),
                    (_, None) => {}
                }
                prop_assert!(list.len() <= PLACES);
                let head = list.present().first().copied();
                let goes_on = head.filter(|head| head.goes_on() && head.key != Key::IDLE);
                for key in list.present().iter().map(|entry| entry.key).chain([Key::IDLE]) {
                    let is_going_on = goes_on.is_some_and(|head| head.key == key);
                    prop_assert_eq!(list.clone().goes_on(key), is_going_on);
                }
                for (place, entry) in list.present().iter().enumerate() {
                    prop_assert_eq!(list.place(entry.key), Some(place));
                    let state = entry.life.state();
                    prop_assert!(place == 0 || state != LifeState::Execute);
                    prop_assert!(!matches!(state, LifeState::Suspend | LifeState::Destroy));
                }
            }
        }
    }
}
