//! The check of start times, by the definition alone.

use std::collections::BTreeMap;

use super::{SlotSpec, gcd};

/// Two slots of which some activations overlap, by index, or one whose start is out of its range
/// (then both are that one).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Clash {
    /// Index of a slot.
    pub first: usize,
    /// Index of the other.
    pub second: usize,
}

/// Checks start times by the definition alone, independently of how they were found.
///
/// # Errors
/// The first pair that clashes. A slot without a start, or with one outside of its period or other
/// than the one given, clashes with itself.
pub fn check(slots: &[SlotSpec], starts_us: &[u32]) -> Result<(), Clash> {
    for (first, slot) in slots.iter().enumerate() {
        let start_us = starts_us.get(first).copied();
        let is_in_range = start_us.is_some_and(|start_us| start_us < slot.period_us);
        let is_as_given = slot.fixed_start_us.is_none() || slot.fixed_start_us == start_us;
        if !is_in_range || !is_as_given || slot.duration_us > slot.period_us {
            return Err(Clash {
                first,
                second: first,
            });
        }
    }
    // Slots of one period have the same divisors with others: these are worked out once for all of
    // them.
    let mut by_period: BTreeMap<u32, Vec<(usize, Occurring)>> = BTreeMap::new();
    for (index, (slot, &start_us)) in slots.iter().zip(starts_us).enumerate() {
        let occurring = Occurring {
            start_us: start_us.into(),
            duration_us: slot.duration_us.into(),
        };
        by_period
            .entry(slot.period_us)
            .or_default()
            .push((index, occurring));
    }
    let mut clash: Option<Clash> = None;
    for (&period_a, group_a) in &by_period {
        for (&period_b, group_b) in by_period.range(period_a..) {
            let divisor_us = gcd(period_a.into(), period_b.into());
            for (first, a) in group_a {
                for (second, b) in group_b {
                    if first != second && !a.fits(b, divisor_us) && !b.fits(a, divisor_us) {
                        let found = Clash {
                            first: *first.min(second),
                            second: *first.max(second),
                        };
                        let is_earlier = clash.is_none_or(|clash| {
                            (found.second, found.first) < (clash.second, clash.first)
                        });
                        clash = if is_earlier { Some(found) } else { clash };
                    }
                }
            }
        }
    }
    clash.map_or(Ok(()), Err)
}

/// Start and duration of a slot, in microseconds.
#[derive(Clone, Copy)]
struct Occurring {
    start_us: u64,
    duration_us: u64,
}

impl Occurring {
    /// Whether no activations of two slots overlap whose periods have this greatest common divisor:
    /// the theorem of Korst, Aarts and Lenstra. Asked the other way round, it says the same, but
    /// where both start at once: there one without duration fits before the other, and not behind
    /// it.
    fn fits(&self, other: &Occurring, divisor_us: u64) -> bool {
        let distance_us = (other.start_us + divisor_us - self.start_us % divisor_us) % divisor_us;
        self.duration_us <= distance_us && distance_us + other.duration_us <= divisor_us
    }
}
