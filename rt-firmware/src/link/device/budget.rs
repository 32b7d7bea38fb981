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
/// Of the time that slots leave, the owner's requests may take so much besides, in percent: so
/// strangers who take all that the link may have hold up neither his upload nor his signature.
const OWNERS_PERCENT: u32 = 25;
/// How much of that is saved up, in microseconds: a signature takes 0.12 s on a slow board.
const OWNERS_BURST_US: u32 = 150_000;
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
    /// What the owner has besides, in microseconds.
    owners_us: u32,
}

impl Budget {
    /// As much as can be saved up, whatever that is.
    pub(super) const FULL: Budget = Budget {
        left_us: i32::MAX,
        at_us: 0,
        slots_us: 0,
        owners_us: OWNERS_BURST_US,
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
            assert!(P::LINK_PERCENT as u32 + OWNERS_PERCENT <= PERCENT);
            assert!(P::LINK_BURST_US <= LONGEST_US);
        };
        let passed_us = now_us.saturating_sub(self.at_us);
        let passed_us = passed_us.min(u64::from(LONGEST_US)) as u32;
        let slots_took_us = slots_us.wrapping_sub(self.slots_us);
        let passed_us = passed_us.saturating_sub(slots_took_us);
        self.at_us = now_us;
        self.slots_us = slots_us;
        let share_us = share(passed_us, u32::from(P::LINK_PERCENT));
        let left_us = self.left_us.saturating_add(share_us as i32);
        self.left_us = left_us.min(P::LINK_BURST_US as i32);
        let owners_us = self.owners_us + share(passed_us, OWNERS_PERCENT);
        self.owners_us = owners_us.min(OWNERS_BURST_US);
        passed_us
    }

    /// What is left of it.
    pub(super) fn left_us(&self) -> i32 {
        self.left_us
    }

    /// A request of the owner's is done, before which so much was left: what it took is for the
    /// owner's own part to pay, as far as that goes.
    pub(super) fn pay_for_owner(&mut self, before_us: i32) {
        let took_us = before_us.saturating_sub(self.left_us).max(0) as u32;
        let paid_us = took_us.min(self.owners_us);
        self.owners_us -= paid_us;
        self.left_us += paid_us as i32;
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

/// So many percent of a time.
fn share(time_us: u32, percent: u32) -> u32 {
    time_us / PERCENT * percent + time_us % PERCENT * percent / PERCENT
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

    /// Works for so long at a time, with what was saved up used up before. Returns the debt.
    fn after(budget: &mut Budget, now_us: u64, took_us: u64) -> i32 {
        budget.begin::<Port>(now_us, 0);
        budget.left_us = 0;
        budget.charge::<Port>(now_us + took_us, 0);
        budget.pay_for_owner(0);
        -budget.left_us()
    }

    #[test]
    fn the_owner_has_a_part_of_his_own_and_no_more_of_it() {
        let mut budget = Budget::FULL;
        // A signature, of which the link's share comes in meanwhile.
        let net = |took_us: i32| took_us - took_us * i32::from(Port::LINK_PERCENT) / 100;
        assert_eq!(after(&mut budget, 0, 120_000), 0);
        // What is left of the part, and what came in since.
        assert_eq!(after(&mut budget, 120_000, 240_000), 0);
        let owners_us = 150_000 - net(240_000);
        assert_eq!(
            after(&mut budget, 360_000, 400_000),
            net(400_000) - owners_us - 400_000 / 4
        );
        // A quarter of a time that passes, so that slot 0 has another.
        assert_eq!(after(&mut budget, 960_000, 200_000), 0);
        assert_eq!(
            after(&mut budget, 1_160_000, 100_000),
            net(100_000) - 25_000
        );
    }

    #[test]
    fn what_strangers_take_is_their_own_debt() {
        let mut budget = Budget::FULL;
        budget.begin::<Port>(0, 0);
        budget.left_us = 0;
        budget.charge::<Port>(100_000, 0);
        let before_us = budget.left_us();
        assert_eq!(
            before_us,
            -100_000 * (100 - i32::from(Port::LINK_PERCENT)) / 100
        );
        budget.pay_for_owner(before_us);
        assert_eq!(budget.left_us(), before_us);
    }
}
