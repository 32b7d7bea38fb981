//! How much time the link may take: what comes from outside never takes more of the processor than
//! its share.
//!
//! Time that passes fills the budget, work empties it. What slots take meanwhile is neither. A
//! request is carried out where something is left, however long it takes: so a signature, or the
//! check of a blob, is done at once, and what it took beyond the budget is a debt that is to be
//! paid back first.

use super::port::LinkPort;

/// What the link owes is forgotten beyond this, in microseconds: so it looks at its line again in
/// bounded time, whatever it was at.
const MOST_DEBT_US: i32 = 2_000_000;
/// How much it may owe and still look for a stop that was heard, to answer it.
const DEBT_FOR_A_STOP_US: i32 = 50_000;
/// What takes longer beyond the budget is long, in microseconds.
const LONG_US: i32 = 20_000;
/// How much is forgiven of a long request of the owner's, and how often: a signature takes 0.12 s
/// on a slow board.
const MOST_FORGIVEN_US: i32 = 150_000;
const FORGIVEN_EACH_US: u64 = 1_000_000;
/// The longest time that is counted at once.
const LONGEST_US: u32 = 10_000_000;
const PERCENT: u32 = 100;

/// What the link has left of its time.
pub(super) struct Budget {
    /// In microseconds; below 0 is a debt.
    left_us: i32,
    /// When it was looked at last, on the board's clock.
    at_us: u64,
    /// How long slots had run then.
    slots_us: u32,
    /// From when on a long request of the owner's is forgiven.
    forgives_at_us: u64,
}

impl Budget {
    /// As much as can be saved up, whatever that is.
    pub(super) const FULL: Budget = Budget {
        left_us: i32::MAX,
        at_us: 0,
        slots_us: 0,
        forgives_at_us: 0,
    };

    /// The link's turn begins: what has passed is for the link to have its share of.
    pub(super) fn begin<P: LinkPort>(&mut self, now_us: u64, slots_us: u32) {
        self.pass::<P>(now_us, slots_us);
    }

    /// What has passed since it was looked at last, without slots; it was work. Returns how long.
    pub(super) fn charge<P: LinkPort>(&mut self, now_us: u64, slots_us: u32) -> u32 {
        let passed_us = self.pass::<P>(now_us, slots_us);
        if !mutant!(BudgetForgotten) {
            self.left_us = (self.left_us - passed_us as i32).max(-MOST_DEBT_US);
        }
        passed_us
    }

    fn pass<P: LinkPort>(&mut self, now_us: u64, slots_us: u32) -> u32 {
        const {
            assert!(P::LINK_PERCENT >= 1 && P::LINK_PERCENT <= PERCENT as u8);
            assert!(P::LINK_BURST_US <= LONGEST_US);
        };
        let passed_us = now_us.saturating_sub(self.at_us);
        let passed_us = passed_us.min(u64::from(LONGEST_US)) as u32;
        let slots_took_us = slots_us.wrapping_sub(self.slots_us);
        let passed_us = passed_us.saturating_sub(slots_took_us);
        self.at_us = now_us;
        self.slots_us = slots_us;
        let share_us = passed_us / PERCENT * u32::from(P::LINK_PERCENT)
            + passed_us % PERCENT * u32::from(P::LINK_PERCENT) / PERCENT;
        let left_us = self.left_us.saturating_add(share_us as i32);
        self.left_us = left_us.min(P::LINK_BURST_US as i32);
        passed_us
    }

    /// What is to be paid back.
    pub(super) fn owed_us(&self) -> i32 {
        -self.left_us.min(0)
    }

    /// A request of the owner's is done, who owed so much before: what it took beyond the budget
    /// is forgiven, once in [`FORGIVEN_EACH_US`] and so much at most. So a signature of his is
    /// looked at although strangers take all that the link may have, and slot 0 keeps its part
    /// whatever he asks for.
    pub(super) fn forgive(&mut self, owed_us: i32) {
        let took_us = self.owed_us() - owed_us;
        if took_us >= LONG_US && self.at_us >= self.forgives_at_us {
            self.left_us += took_us.min(MOST_FORGIVEN_US);
            self.forgives_at_us = self.at_us + FORGIVEN_EACH_US;
        }
    }

    /// Whether requests are carried out.
    pub(super) fn is_left(&self) -> bool {
        self.left_us > 0
    }

    /// Whether a stop that was heard may be looked for and answered.
    pub(super) fn is_left_for_a_stop(&self) -> bool {
        self.left_us > -DEBT_FOR_A_STOP_US
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Port;

    impl LinkPort for Port {
        fn now_us(&mut self) -> u64 {
            0
        }
        fn receive(&mut self) -> Option<u8> {
            None
        }
        fn send(&mut self, _byte: u8) -> bool {
            false
        }
    }

    /// Works for so long at a time, with what was saved up used up before.
    fn after(budget: &mut Budget, now_us: u64, took_us: u64) {
        budget.begin::<Port>(now_us, 0);
        budget.left_us = 0;
        let owed_us = budget.owed_us();
        budget.charge::<Port>(now_us + took_us, 0);
        budget.forgive(owed_us);
    }

    #[test]
    fn a_long_request_of_the_owners_is_forgiven_once_a_second_and_no_more_of_it() {
        let mut budget = Budget::FULL;
        let half = i32::from(Port::LINK_PERCENT) * 1_200;
        after(&mut budget, 0, 120_000);
        assert_eq!(budget.owed_us(), 0);
        after(&mut budget, 500_000, 120_000);
        assert_eq!(budget.owed_us(), 120_000 - half);
        after(&mut budget, 1_200_000, 120_000);
        assert_eq!(budget.owed_us(), 0);
        after(&mut budget, 2_400_000, 1_200_000);
        // What is earned meanwhile is no more than what can be saved up.
        let earned = Port::LINK_BURST_US as i32;
        assert_eq!(budget.owed_us(), 1_200_000 - earned - MOST_FORGIVEN_US);
        // Short ones are as anyone's.
        after(&mut budget, 9_000_000, 10_000);
        assert_eq!(budget.owed_us(), 10_000 - half / 12);
    }
}
