//! Why there is no schedule, in words.

use std::fmt;

/// Why there is no schedule. `Display` says it in words that name the slots.
#[derive(Clone, Debug, PartialEq)]
pub enum Infeasibility {
    /// A slot that cannot occur at all: its period is 0, or shorter than its duration.
    TooLong {
        /// Its number.
        slot: u32,
        /// Its duration in microseconds.
        duration_us: u32,
        /// Its period in microseconds.
        period_us: u32,
    },
    /// The slots ask for more time than there is.
    Utilisation {
        /// Sum of duration over period.
        utilisation: f64,
        /// Numbers of those with the greatest shares, the greatest first: the others fit without
        /// them.
        heaviest: Vec<u32>,
    },
    /// Slots that meet each other in every window of `window_us`, and do not fit in one together.
    Crowded {
        /// Their numbers.
        slots: Vec<u32>,
        /// Length of the window in microseconds: every common divisor of two of their periods
        /// divides it.
        window_us: u64,
        /// Sum of their durations in microseconds.
        sum_us: u64,
    },
    /// Slots that cannot be packed into frames as long as the shortest period among them: every way
    /// was tried or ruled out by counting.
    Packing {
        /// Their numbers: none of them can be left out.
        slots: Vec<u32>,
        /// Length of a frame in microseconds.
        frame_us: u64,
        /// Number of the longest of them.
        longest: u32,
    },
    /// Slots that have no start times beside each other: every order of their activations was tried
    /// or ruled out.
    Orders {
        /// Their numbers: none of them can be left out.
        slots: Vec<u32>,
        /// Number of the longest of them.
        longest: u32,
    },
    /// Slots whose starts are given clash.
    FixedStarts {
        /// Number of a slot.
        first: u32,
        /// Number of the other.
        second: u32,
    },
    /// Every way to lay them out was tried.
    Exhausted {
        /// How many arrangements.
        arrangements: u64,
    },
}

impl Infeasibility {
    /// The same where the slots are frames of a link.
    pub fn of_frames(&self) -> String {
        let text = self.to_string();
        text.replace("into frames", "into windows")
            .replace("slot", "frame")
    }

    /// What helps in general, where no change of the slots at hand was found.
    pub(super) fn advice(&self) -> String {
        match self {
            Infeasibility::TooLong { slot, .. } => {
                format!("shorten slot {slot} or lengthen its period")
            }
            Infeasibility::Utilisation { .. } => {
                "shorten durations or lengthen periods until the sum is at most 100 %".to_owned()
            }
            Infeasibility::Crowded {
                window_us, sum_us, ..
            } => format!(
                "shorten them by {} us together, or give them periods with a greater common divisor than {window_us} us",
                sum_us.saturating_sub(*window_us)
            ),
            Infeasibility::Packing { longest, .. } | Infeasibility::Orders { longest, .. } => {
                format!(
                    "shorten one of them, slot {longest} first, or let one of them occur less often"
                )
            }
            Infeasibility::FixedStarts { first, second } => {
                format!("let slot {first} or slot {second} start at another time")
            }
            Infeasibility::Exhausted { .. } => {
                "shorten durations, or let periods be multiples of each other".to_owned()
            }
        }
    }
}

impl fmt::Display for Infeasibility {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Infeasibility::TooLong {
                slot,
                duration_us,
                period_us,
            } => write!(
                f,
                "slot {slot} lasts {duration_us} us, its period is {period_us} us"
            ),
            Infeasibility::Utilisation {
                utilisation,
                heaviest,
            } => write!(
                f,
                "they ask for {} % of the time, most of it slot{} {}",
                Percent(*utilisation),
                if heaviest.len() == 1 { "" } else { "s" },
                Numbers(heaviest)
            ),
            Infeasibility::Crowded {
                slots,
                window_us,
                sum_us,
            } => write!(
                f,
                "slots {} meet in every {window_us} us and last {sum_us} us together",
                Numbers(slots)
            ),
            Infeasibility::Packing {
                slots, frame_us, ..
            } => write!(
                f,
                "slots {} cannot be packed into frames of {frame_us} us",
                Numbers(slots)
            ),
            Infeasibility::Orders { slots, .. } => write!(
                f,
                "slots {} overlap in whatever order they come",
                Numbers(slots)
            ),
            Infeasibility::FixedStarts { first, second } => {
                write!(f, "slots {first} and {second} clash at the starts given")
            }
            Infeasibility::Exhausted { arrangements } => {
                write!(f, "none of all {arrangements} arrangements works")
            }
        }
    }
}

/// A share above 1 in percent, never rounded down to 100.
struct Percent(f64);

impl fmt::Display for Percent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let percent = self.0 * 100.0;
        if percent < 100.01 {
            f.write_str("a little more than 100")
        } else {
            write!(f, "{percent:.2}")
        }
    }
}

/// Slot numbers in a sentence, the first of many.
pub(super) struct Numbers<'n>(pub(super) &'n [u32]);

impl fmt::Display for Numbers<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const MAX_SHOWN: usize = 12;
        for (position, number) in self.0.iter().take(MAX_SHOWN).enumerate() {
            let separator = match position {
                0 => "",
                _ if position + 1 == self.0.len() => " and ",
                _ => ", ",
            };
            write!(f, "{separator}{number}")?;
        }
        match self.0.len().saturating_sub(MAX_SHOWN) {
            0 => Ok(()),
            more => write!(f, " and {more} more"),
        }
    }
}
