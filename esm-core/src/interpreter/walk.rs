//! The walk: what happens in a macro step, the pulse first and then the events that follow from it.
//!
//! Two bits are kept for each region instance, 32 in a word, the first in the highest bit. *Active*
//! says that all superstates around it are current; *awake* that the pulse may do something there.
//! The pulse visits those that are both, an event those of its channel's row that are active, and
//! each in ascending order, which is the order of the tree. So what has nothing to do costs
//! nothing.
//!
//! A guard is a function of flags of its own state and of the head of its instance's block, and a
//! region is woken when one of these changes: by a transition of its own, by its superstate's
//! start, from outside, by an action or a `final` around it, by its timer. A guard that asks for
//! busy tasks inside wakes its region each time.
//!
//! Functions with type parameters are compiled where the types are named, with the settings there:
//! here the observer is one. So that a macro step takes the same whatever these are, what is short
//! is inlined by order, what is rare is apart by order, and [`load_anew`] says what is not to be
//! kept on the stack.

use core::num::NonZeroU32;
use core::sync::atomic::{Ordering, compiler_fence};

use super::events::{Fault, MAX_MICRO_STEPS, Observer, TransitionTaken};
use super::machine::{Blob, FIRST, Here, Machine, Mark, Word, from_place};
use super::transitions::QueueFull;
use crate::arena::WORD_BITS;
use crate::format::{self, Section};
use crate::layout::{channel, state, transition};
use crate::reads::access::Access;
use crate::tables::record_bytes;

/// How a macro step ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ended {
    /// There was nothing to do.
    Resting,
    /// The pulse and all events were handled.
    Walked,
    /// The machine is stopped.
    Stopped(Fault),
}

const TRANSITION_BYTES: usize = record_bytes(Section::Transitions);

/// What is read of the machine from here on is loaded when it is needed. Without this the compiler
/// would load all before the first visit, and put it on the stack: for most macro steps, which have
/// one or two visits, that takes longer. It is no instruction itself.
#[cfg_attr(feature = "speed", inline(always))]
fn load_anew() {
    compiler_fence(Ordering::SeqCst);
}

/// The first region instance of those of a word that are to be visited.
#[cfg_attr(feature = "speed", inline(always))]
fn first_of<P: Copy>(word: Word<P>, visit: NonZeroU32) -> Here<P> {
    let offset = visit.leading_zeros();
    Here {
        region: word.first + offset as usize,
        bit: FIRST >> offset,
        marks: word.marks,
    }
}

impl<R: Access> Machine<'_, R> {
    /// Whether a pulse has anything to do.
    // It is short, and inlined where macro steps are run.
    #[cfg_attr(feature = "speed", inline(always))]
    pub(super) fn is_awake(&self) -> bool {
        self.woken(self.word_of(0)) != 0 || self.layout.regions > WORD_BITS
    }

    /// The rest of a macro step in which timers may run out.
    #[cold]
    #[inline(never)]
    pub(super) fn walk_after_timers(
        &mut self,
        blob: Blob<'_, R>,
        observer: &mut impl Observer,
    ) -> Ended {
        match self.run_timers(blob) {
            Ok(()) => self.walk(blob, observer),
            Err(fault) => Ended::Stopped(fault),
        }
    }

    /// Handles the pulse and all events that follow from it.
    #[inline(never)]
    pub(super) fn walk(&mut self, blob: Blob<'_, R>, observer: &mut impl Observer) -> Ended {
        self.queued = 0;
        self.taken = 0;
        self.changed = false;
        if self.pulse(blob, observer).is_err() {
            return self.stop(blob, Fault::EventQueueOverflow, observer);
        }
        while self.taken != self.queued {
            if self.taken == u32::from(MAX_MICRO_STEPS - 1) {
                return self.stop(blob, Fault::MacroStepLimit, observer);
            }
            let place = (self.taken & self.places.queue_mask) as usize;
            self.taken += 1;
            let sent = R::load_half(self.arena, self.places.queue, place).into();
            if self.event(blob, sent, observer).is_err() {
                return self.stop(blob, Fault::EventQueueOverflow, observer);
            }
        }
        Ended::Walked
    }

    /// Shows the pulse to those who are awake.
    #[cfg_attr(feature = "speed", inline(always))]
    fn pulse(&mut self, blob: Blob<'_, R>, observer: &mut impl Observer) -> Result<(), QueueFull> {
        let mut word = self.word_of(0);
        let mut visit = self.woken(word);
        loop {
            let Some(left) = NonZeroU32::new(visit) else {
                word.first += WORD_BITS;
                if word.first >= self.layout.regions {
                    return Ok(());
                }
                word.marks = R::further(word.marks, 2);
                visit = self.woken(word);
                continue;
            };
            load_anew();
            let here = first_of(word, left);
            visit ^= here.bit;
            if let Some(next) = self.visit_on_pulse(blob, here, observer)? {
                if next >= self.layout.regions {
                    return Ok(());
                }
                word = self.word_of(next);
                visit = self.woken(word) & from_place(next);
            }
        }
    }

    /// Who of a word is awake and active.
    #[cfg_attr(feature = "speed", inline(always))]
    fn woken(&self, Word { marks, .. }: Word<R::Part>) -> u32 {
        self.marked(marks, Mark::Active) & self.marked(marks, Mark::Awake)
    }

    /// Shows an event to those who listen.
    #[cfg_attr(feature = "speed", inline(always))]
    fn event(
        &mut self,
        blob: Blob<'_, R>,
        sent: usize,
        observer: &mut impl Observer,
    ) -> Result<(), QueueFull> {
        load_anew();
        let sent = self.record(Section::Channels, sent);
        if self.field(blob, sent, channel::REGION_WORDS) == 0 {
            return Ok(());
        }
        let event = self.field(blob, sent, channel::EVENT) as u16;
        let waits = 1 << (u32::from(event) % u32::BITS);
        let first = self.field(blob, sent, channel::FIRST_REGION_WORD);
        let mut word = self.word_of(WORD_BITS * first);
        let mut visit = self.listening(blob, sent, word);
        loop {
            while let Some((here, current)) = self.next_waiting(blob, word, waits, &mut visit) {
                load_anew();
                visit &= !here.bit;
                let event = self.field(blob, sent, channel::EVENT) as u16;
                if let Some(next) = self.visit_on_event(blob, here, current, event, observer)? {
                    word = self.word_of(next);
                    if word.first >= self.end_of_row(blob, sent) {
                        return Ok(());
                    }
                    visit = self.listening(blob, sent, word) & from_place(next);
                }
                if visit == 0 {
                    break;
                }
            }
            if self.field(blob, sent, channel::REGION_WORDS) == 1 {
                return Ok(());
            }
            word.first += WORD_BITS;
            if word.first >= self.end_of_row(blob, sent) {
                return Ok(());
            }
            word.marks = R::further(word.marks, 2);
            visit = self.listening(blob, sent, word);
        }
    }

    /// The next region instance among those of a word that are to be visited whose current state,
    /// with this record, waits for one of some events.
    #[cfg_attr(feature = "speed", inline(always))]
    fn next_waiting(
        &self,
        blob: Blob<'_, R>,
        word: Word<R::Part>,
        waits: u32,
        visit: &mut u32,
    ) -> Option<(Here<R::Part>, R::Place)> {
        while let Some(left) = NonZeroU32::new(*visit) {
            let here = first_of(word, left);
            let current = self.current_record(here.region);
            if self.events(blob, current) & waits != 0 {
                return Some((here, current));
            }
            *visit &= !here.bit;
        }
        None
    }

    /// The first region instance behind those of whom the row of a channel with this record speaks.
    fn end_of_row(&self, blob: Blob<'_, R>, sent: R::Place) -> usize {
        let first = self.field(blob, sent, channel::FIRST_REGION_WORD);
        WORD_BITS * (first + self.field(blob, sent, channel::REGION_WORDS))
    }

    /// Who of a word is active and listens to a channel with this record, whose row speaks of that
    /// word.
    #[cfg_attr(feature = "speed", inline(always))]
    fn listening(&self, blob: Blob<'_, R>, sent: R::Place, word: Word<R::Part>) -> u32 {
        let ahead = word.first / WORD_BITS - self.field(blob, sent, channel::FIRST_REGION_WORD);
        let row = self.field(blob, sent, channel::FIRST_ROW_WORD) + ahead;
        let row = self.record(Section::Listeners, row);
        self.marked(word.marks, Mark::Active) & R::word(blob, row)
    }

    /// Takes the first transition on the pulse whose guard is true, out of the current state of a
    /// region instance. If others are concerned by it, returns the next who is not inside this one.
    #[cfg_attr(feature = "speed", inline(always))]
    fn visit_on_pulse(
        &mut self,
        blob: Blob<'_, R>,
        here: Here<R::Part>,
        observer: &mut impl Observer,
    ) -> Result<Option<usize>, QueueFull> {
        let current = self.current_record(here.region);
        let first_flag = self.first_flag(blob, here.region, current);
        let Some(at) = self.find_on_pulse(blob, here, current, first_flag) else {
            return Ok(None);
        };
        load_anew();
        let trigger = self.field(blob, at, transition::EVENT) as u16;
        if trigger & format::TRANSITION_IS_PLAIN == 0 {
            return self.take_any(blob, here.region, at, observer);
        }
        let action = self.field(blob, at, transition::ACTION) as u16;
        if action != format::ACTION_NONE {
            self.enter_again(blob, here.region, current, first_flag, action, observer)?;
        } else {
            let target = self.field(blob, at, transition::TARGET);
            self.make_current(blob, here, target);
        }
        self.tell(here.region, at, observer);
        Ok(None)
    }

    /// The same on an event, out of a state that waits for it or for one whose number leaves the
    /// same remainder.
    #[cfg_attr(feature = "speed", inline(always))]
    fn visit_on_event(
        &mut self,
        blob: Blob<'_, R>,
        here: Here<R::Part>,
        current: R::Place,
        event: u16,
        observer: &mut impl Observer,
    ) -> Result<Option<usize>, QueueFull> {
        let first = self.field(blob, current, state::FIRST_EVENT_TRANSITION);
        // `final` has no transitions, so a state that has some is not the last.
        let after = R::ahead(current, record_bytes(Section::States));
        let end = self.field(blob, after, state::FIRST_TRANSITION);
        let mut at = self.record(Section::Transitions, first);
        for _ in first..end {
            // Without the plain mark, which is in the highest bit.
            let differs = self.field(blob, at, transition::EVENT) as u16 ^ event;
            if differs << 1 == 0 {
                let guard = self.field(blob, at, transition::GUARD);
                if guard == usize::from(format::GUARD_TRUE)
                    || self.is_true(blob, guard, here.region)
                {
                    load_anew();
                    if differs == 0 {
                        return self.take_any(blob, here.region, at, observer);
                    }
                    let target = self.field(blob, at, transition::TARGET);
                    self.make_current(blob, here, target);
                    self.tell(here.region, at, observer);
                    return Ok(None);
                }
            }
            at = R::ahead(at, TRANSITION_BYTES);
        }
        Ok(None)
    }

    /// The first transition on the pulse whose guard is true. If there is none, the region instance
    /// sleeps until it is woken again.
    #[cfg_attr(feature = "speed", inline(always))]
    fn find_on_pulse(
        &mut self,
        blob: Blob<'_, R>,
        here: Here<R::Part>,
        current: R::Place,
        first_flag: usize,
    ) -> Option<R::Place> {
        let first = self.field(blob, current, state::FIRST_TRANSITION);
        let mut at = self.record(Section::Transitions, first);
        let window = self.window(first_flag);
        let row = self.field(blob, current, state::B);
        let shape = self.field(blob, current, state::SHAPE) as u16;
        if row != 0 && shape & format::STATE_HAS_TIMEOUT == 0 {
            let guard = self.field(blob, at, transition::GUARD);
            if let Some(first) = window.first_of::<R>(guard, row) {
                return Some(R::ahead(at, TRANSITION_BYTES * first));
            }
            at = R::ahead(at, TRANSITION_BYTES * row);
        }
        // Before its guards, of which some wake it.
        self.set_awake(here, false);
        let end = self.field(blob, current, state::FIRST_EVENT_TRANSITION);
        let end = self.record(Section::Transitions, end);
        while at != end {
            let guard = self.field(blob, at, transition::GUARD);
            let holds = if guard < usize::from(format::GUARD_PROGRAM) {
                window.holds(guard)
            } else {
                self.is_true(blob, guard, here.region)
            };
            if holds {
                // Who enters another state sleeps or not by what that one is.
                self.set_awake(here, true);
                return Some(at);
            }
            at = R::ahead(at, TRANSITION_BYTES);
        }
        None
    }

    /// Takes a transition that is not plain, and tells of it.
    #[cfg_attr(feature = "speed", inline(always))]
    fn take_any(
        &mut self,
        blob: Blob<'_, R>,
        region: usize,
        at: R::Place,
        observer: &mut impl Observer,
    ) -> Result<Option<usize>, QueueFull> {
        let next = self.take(blob, region, at, observer)?;
        self.tell(region, at, observer);
        Ok(Some(next))
    }

    /// Tells of a transition that was taken.
    #[cfg_attr(feature = "speed", inline(always))]
    fn tell(&mut self, region: usize, at: R::Place, observer: &mut impl Observer) {
        self.changed = true;
        let first = self.record(Section::Transitions, 0);
        observer.transition(TransitionTaken {
            micro: self.taken as u8,
            region_instance: region as u16,
            transition: (R::distance(first, at) / TRANSITION_BYTES) as u16,
        });
    }

    /// Ends all for good.
    #[cold]
    #[inline(never)]
    fn stop(&mut self, blob: Blob<'_, R>, fault: Fault, observer: &mut impl Observer) -> Ended {
        self.disable_real_time(blob, 0..self.layout.tasks, observer);
        self.fault = Some(fault);
        self.taken = self.queued;
        self.clock.look_in(1);
        Ended::Stopped(fault)
    }
}
