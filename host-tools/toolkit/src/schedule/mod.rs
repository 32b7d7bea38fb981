//! Start times of the slots: search, proof, check.
//!
//! Slots are strictly periodic and never preempt each other: slot i with period T_i and duration
//! C_i needs one start s_i with 0 ≤ s_i < T_i such that no two activations of any slots ever
//! overlap. Two slots i, j fit if and only if, with g = gcd(T_i, T_j), C_i ≤ (s_j − s_i) mod g ≤ g
//! − C_j (Korst, Aarts, Lenstra). Nothing here ever lists the activations of a hyperperiod.
//!
//! ```
//! use esm_toolkit::schedule::{Limit, Outcome, SlotSpec, check, solve};
//!
//! let slot = |number, period_us, duration_us| SlotSpec { number, period_us, duration_us, fixed_start_us: None };
//! let slots = [slot(1, 4_000, 1_000), slot(2, 6_000, 1_000)];
//! let Outcome::Feasible(schedule) = solve(&slots, Limit::pieces(1_000_000)) else { panic!() };
//! assert_eq!(check(&slots, &schedule.starts_us), Ok(()));
//! ```

mod bounds;
mod chain;
mod check;
mod clock;
mod columns;
mod construct;
mod cure;
mod ejection;
mod frames;
mod growth;
pub mod handover;
mod infeasibility;
pub mod instances;
mod luby;
mod orders;
mod outcome;
mod proof;
pub(crate) mod random;
mod search;
mod slot;
mod snap;
mod solve;
mod spread;

use serde::Serialize;

pub use check::{Clash, check};
pub use clock::{Limit, Now};
pub use cure::{Change, Cure};
pub use growth::{Growth, growth};
pub use infeasibility::Infeasibility;
pub use outcome::Outcome;
pub(crate) use slot::gcd;
pub use slot::{LaidOut, MAX_SLOTS, Schedule, SlotSpec, exceeds_one, hyperperiod_us, utilisation};
pub use snap::{MAX_SNAP_PERCENT, RateChange, Snap, snap};
use solve::solve_within;
pub use solve::{overcommitted, solve};

// ─── Report ──────────────────────────────────────────────────────────────────────────────────────

/// What `esm schedule` tells, in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Report {
    /// Whether there is a schedule; `None` where that is undecided.
    pub feasible: Option<bool>,
    /// Least common multiple of the periods in microseconds, 1 without slots; `None` where it
    /// exceeds 64 bits.
    pub hyperperiod_us: Option<u64>,
    /// Sum of duration over period.
    pub utilisation: f64,
    /// The slots with their starts; empty without a schedule.
    pub slots: Vec<SlotReport>,
    /// Why there is no schedule, in words; `None` otherwise.
    pub reason: Option<String>,
    /// What to change, in words, where there is no schedule.
    pub cure: Option<String>,
    /// By which factor all durations may grow together with these starts; `None` without a
    /// schedule, or where nothing lasts.
    pub growth_factor: Option<f64>,
    /// Changes of rates that make the slots easy; there only where they were asked for.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub snap: Option<Vec<SnapReport>>,
}

/// A slot of a [`Report`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct SlotReport {
    /// Number of the slot.
    pub slot: u32,
    /// Its first start in microseconds, below its period.
    pub start_us: u32,
    /// Its period in microseconds.
    pub period_us: u32,
    /// Its duration in microseconds.
    pub duration_us: u32,
    /// By how many microseconds it may last longer, alone, with these starts.
    pub growth_us: u32,
}

/// Puts slots and outcome together for `esm schedule`.
pub fn report(slots: &[SlotSpec], outcome: &Outcome) -> Report {
    let (feasible, starts_us, reason) = match outcome {
        Outcome::Feasible(schedule) => (Some(true), schedule.starts_us.as_slice(), None),
        Outcome::Infeasible(reason) => (Some(false), &[][..], Some(reason)),
        Outcome::Undecided => (None, &[][..], None),
    };
    let growth = growth(slots.get(..starts_us.len()).unwrap_or(slots), starts_us);
    Report {
        feasible,
        hyperperiod_us: hyperperiod_us(slots),
        utilisation: utilisation(slots.iter().map(|slot| (slot.period_us, slot.duration_us))),
        slots: slots
            .iter()
            .zip(starts_us)
            .zip(&growth.alone_us)
            .map(|((slot, &start_us), &growth_us)| SlotReport {
                slot: slot.number,
                start_us,
                period_us: slot.period_us,
                duration_us: slot.duration_us,
                growth_us,
            })
            .collect(),
        reason: reason.map(Infeasibility::to_string),
        cure: reason.map(|reason| reason.cure(slots).to_string()),
        growth_factor: growth.together,
        snap: None,
    }
}

/// A link of `esm schedule`, in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LinkReport {
    /// Its name.
    pub link: String,
    /// Sum of duration over period of the frames that are sent.
    pub utilisation: f64,
    /// Whether there is a schedule; `None` where that is undecided.
    pub feasible: Option<bool>,
    /// The frames with their starts; empty without a schedule.
    pub frames: Vec<FrameReport>,
}

/// A frame of a [`LinkReport`].
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct FrameReport {
    /// Its name.
    pub frame: String,
    /// Its identifier.
    pub id: u32,
    /// Its first start in microseconds, below its period.
    pub start_us: u32,
    /// Its period in microseconds.
    pub period_us: u32,
    /// How long it takes with the gap behind it, in microseconds.
    pub duration_us: u32,
}

/// Puts the frames that a link sends and the outcome of their search together.
pub fn link_report(
    link: &str,
    names: &[String],
    frames: &[SlotSpec],
    outcome: &Outcome,
) -> LinkReport {
    let (feasible, starts_us) = match outcome {
        Outcome::Feasible(schedule) => (Some(true), schedule.starts_us.as_slice()),
        Outcome::Infeasible(_) => (Some(false), &[][..]),
        Outcome::Undecided => (None, &[][..]),
    };
    let times = frames
        .iter()
        .map(|frame| (frame.period_us, frame.duration_us));
    let frames = names.iter().zip(frames).zip(starts_us);
    LinkReport {
        link: link.to_owned(),
        utilisation: utilisation(times),
        feasible,
        frames: frames
            .map(|((name, frame), &start_us)| FrameReport {
                frame: name.clone(),
                id: frame.number,
                start_us,
                period_us: frame.period_us,
                duration_us: frame.duration_us,
            })
            .collect(),
    }
}

/// A proposal of [`snap`], in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SnapReport {
    /// Whether each period divides the next longer one then.
    pub harmonic: bool,
    /// Least common multiple of the periods in microseconds; `None` where it exceeds 64 bits.
    pub hyperperiod_us: Option<u64>,
    /// Sum of duration over period.
    pub utilisation: f64,
    /// Sum of the changes of all slots in percent, each counted as positive.
    pub total_percent: f64,
    /// The slots whose rates change.
    pub changes: Vec<SnapChange>,
}

/// A change of a [`SnapReport`].
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SnapChange {
    /// Number of the slot.
    pub slot: u32,
    /// Its period in microseconds.
    pub period_us: u32,
    /// The new one.
    pub new_period_us: u32,
    /// By how much the period changes, in percent; above 0 where the slot becomes slower.
    pub percent: f64,
}

/// Puts a proposal into the form of its JSON.
pub fn snap_report(snap: &Snap) -> SnapReport {
    SnapReport {
        harmonic: snap.is_harmonic(),
        hyperperiod_us: hyperperiod_us(&snap.slots),
        utilisation: utilisation(
            snap.slots
                .iter()
                .map(|slot| (slot.period_us, slot.duration_us)),
        ),
        total_percent: snap.total_percent(),
        changes: snap
            .changes
            .iter()
            .map(|change| SnapChange {
                slot: change.slot,
                period_us: change.from_us,
                new_period_us: change.to_us,
                percent: change.percent(),
            })
            .collect(),
    }
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod oracle;
