//! Slots as the search knows them, and sums over them.

use crate::model::{Frame, Model};

/// The most slots that are laid out: more than any robot's table has, and few enough to compare
/// each with each.
pub const MAX_SLOTS: usize = esm_core::format::MAX_SLOTS as usize;

/// What the search needs to know of a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct SlotSpec {
    /// The number that it was declared with, for messages.
    pub number: u32,
    /// Period in microseconds, above 0.
    pub period_us: u32,
    /// Duration in microseconds.
    pub duration_us: u32,
    /// A start that is given: 0 for the interpreter's slot.
    pub fixed_start_us: Option<u32>,
}

impl SlotSpec {
    /// The slots of a model in their order; the interpreter's starts at 0.
    pub fn of_model(model: &Model) -> Vec<SlotSpec> {
        model
            .slots
            .iter()
            .enumerate()
            .map(|(index, slot)| SlotSpec {
                number: slot.number,
                period_us: slot.period_us,
                duration_us: slot.duration_us,
                fixed_start_us: (model.interpreter_slot == Some(index)).then_some(0),
            })
            .collect()
    }

    /// The frames that are sent over a link, in source order, as far as their times are known.
    /// Their numbers are their identifiers.
    pub fn of_link(model: &Model, link: usize) -> Vec<SlotSpec> {
        let Some(declared) = model.links.get(link) else {
            return Vec::new();
        };
        let known = |frame: &Frame| {
            Some(SlotSpec {
                number: frame.id.into(),
                period_us: frame.period_us?,
                duration_us: u32::try_from(frame.duration_us(declared)?).ok()?,
                fixed_start_us: None,
            })
        };
        model.frames_out(link).filter_map(known).collect()
    }
}

/// Start times that [`check`](super::check()) has found right.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Schedule {
    /// Start of each slot in microseconds, in the order of the slots given; 0 ≤ start < period.
    pub starts_us: Vec<u32>,
}

/// Start times of all slots and frames of a mission.
#[derive(Clone, Debug, PartialEq, Eq, Default)]
pub struct LaidOut {
    /// Start of each slot in microseconds, in the order of the slots; 0 ≤ start < period.
    pub starts_us: Vec<u32>,
    /// For each link, the start of each frame that is sent over it, in source order.
    pub frame_starts_us: Vec<Vec<u32>>,
}

/// Greatest common divisor; that of 0 and n is n.
pub(crate) fn gcd(mut a: u64, mut b: u64) -> u64 {
    while b != 0 {
        (a, b) = (b, a % b);
    }
    a
}

/// Least common multiple of the periods in microseconds; `None` where it exceeds 64 bits.
pub fn hyperperiod_us(slots: &[SlotSpec]) -> Option<u64> {
    slots.iter().try_fold(1_u64, |multiple, slot| {
        let period_us = u64::from(slot.period_us.max(1));
        multiple.checked_mul(period_us / gcd(multiple, period_us))
    })
}

/// Sum of duration over period of (period, duration) pairs, to the precision of `f64`.
pub fn utilisation(times_us: impl Iterator<Item = (u32, u32)>) -> f64 {
    times_us
        .map(|(period_us, duration_us)| f64::from(duration_us) / f64::from(period_us.max(1)))
        // Not `sum`, which gives -0 for nothing.
        .fold(0.0, |sum, share| sum + share)
}

/// Whether duration over period of (period, duration) pairs sum up to more than 1: exactly, where
/// [`utilisation`] rounds.
///
/// Sums that are nearer to 1 than 2⁻⁶⁴ a slot are worked out as a fraction; one whose denominator
/// exceeds 128 bits counts as 1.
pub fn exceeds_one(times_us: impl Iterator<Item = (u32, u32)> + Clone) -> bool {
    const ONE: u128 = 1 << 64;
    let mut floor_sum = 0_u128;
    let mut terms = 0_u128;
    for (period_us, duration_us) in times_us.clone() {
        floor_sum += (u128::from(duration_us) << 64) / u128::from(period_us.max(1));
        terms += 1;
    }
    // Each term is less than 1/2⁶⁴ below its value.
    if floor_sum > ONE || floor_sum + terms <= ONE {
        return floor_sum > ONE;
    }
    exact_sum(times_us).is_some_and(|(numerator, denominator)| numerator > denominator)
}

/// The sum of duration over period as a fraction, where that fits 128 bits.
fn exact_sum(times_us: impl Iterator<Item = (u32, u32)>) -> Option<(u128, u128)> {
    let wide_gcd = |mut a: u128, mut b: u128| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a.max(1)
    };
    let (mut numerator, mut denominator) = (0_u128, 1_u128);
    for (period_us, duration_us) in times_us {
        let period_us = u128::from(period_us.max(1));
        let common = wide_gcd(denominator, period_us);
        let scale = period_us / common;
        let share = u128::from(duration_us).checked_mul(denominator / common)?;
        numerator = numerator.checked_mul(scale)?.checked_add(share)?;
        denominator = denominator.checked_mul(scale)?;
        let reduce = wide_gcd(numerator, denominator);
        numerator /= reduce;
        denominator /= reduce;
    }
    Some((numerator, denominator))
}
