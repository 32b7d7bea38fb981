//! Which tasks share each slot, in words.

use std::fmt::Write;

use super::Time;
use crate::lang::analysis::sharing::{SlotTasks, Spare};

/// Pairs of slots of which one would do that are told; of more there is the number.
pub const MAX_PAIRS_TOLD: usize = 8;

/// Lines are no shorter where a terminal is narrower: the numbers have room.
pub const LEAST_COLUMNS: usize = 60;

/// A line for each slot with tasks, none wider than a terminal of so many columns; empty without
/// tasks.
pub fn table(slots: &[SlotTasks], columns: usize) -> String {
    let mut text = String::new();
    for slot in slots.iter().filter(|slot| !slot.tasks.is_empty()) {
        if text.is_empty() {
            text += "\nTask states that share a slot, and the worst case of those that can be active together:\n";
            let _ = writeln!(
                text,
                "{:>6} {:>12} {:>12}  task states",
                "slot", "worst case", "left"
            );
        }
        let time = |us: u64| Time { us }.to_string();
        let (worst, left) = match slot.worst_us {
            Some(us) => (
                time(us),
                time(u64::from(slot.duration_us).saturating_sub(us)),
            ),
            None => ("too many".to_owned(), "?".to_owned()),
        };
        let count = slot.tasks.len() as u64 + slot.left_out;
        let unknown = match slot.without_wcet {
            0 => String::new(),
            all if all == count => ", no wcet".to_owned(),
            some => format!(", {some} without wcet"),
        };
        let names = format!(
            "{} of {count}{unknown}: {}",
            slot.together.len(),
            slot.together.join(", ")
        );
        let line = format!("{:>6} {worst:>12} {left:>12}  {names}", slot.slot);
        let _ = writeln!(text, "{}", shortened(&line, columns));
    }
    text
}

/// What may be said about slots that could be one.
pub fn hints(pairs: &[Spare]) -> String {
    let mut text = String::new();
    for pair in pairs.iter().take(MAX_PAIRS_TOLD) {
        let [period, duration] =
            [pair.period_us, pair.duration_us].map(|us| Time { us: us.into() }.to_string());
        let _ = writeln!(
            text,
            "hint: the tasks of slots {} and {} are never active together, and both come every {period}: one slot of {duration} has room for either",
            pair.first, pair.second
        );
    }
    if let Some(more @ 1..) = pairs.len().checked_sub(MAX_PAIRS_TOLD) {
        let _ = writeln!(text, "hint: the same holds for {more} more pairs of slots");
    }
    text
}

fn shortened(line: &str, columns: usize) -> String {
    if line.chars().count() <= columns {
        return line.to_owned();
    }
    let kept: String = line.chars().take(columns.saturating_sub(1)).collect();
    kept + "…"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_says_what_takes_longest_and_is_no_wider_than_the_terminal() {
        let slot = SlotTasks {
            slot: 2,
            duration_us: 4_000,
            worst_us: Some(1_500),
            together: vec!["motion/Ahead".into(), "position/Here".into()],
            tasks: ["motion/Ahead", "motion/Away", "position/Here"]
                .map(String::from)
                .to_vec(),
            left_out: 0,
            without_wcet: 1,
        };
        let line = |columns| {
            table(std::slice::from_ref(&slot), columns)
                .lines()
                .last()
                .unwrap_or_default()
                .to_owned()
        };
        assert_eq!(
            line(100),
            "     2      1500 us      2500 us  2 of 3, 1 without wcet: motion/Ahead, position/Here"
        );
        assert_eq!(
            line(50),
            "     2      1500 us      2500 us  2 of 3, 1 witho…"
        );
        let unknown = SlotTasks {
            worst_us: None,
            ..slot
        };
        assert!(table(&[unknown], 100).contains("too many            ?"));
        assert_eq!(table(&[], 100), "");
    }

    #[test]
    fn hints_are_few() {
        let pair = Spare {
            first: 2,
            second: 3,
            period_us: 20_000,
            duration_us: 4_000,
        };
        assert_eq!(
            hints(&[pair]),
            "hint: the tasks of slots 2 and 3 are never active together, and both come every 20 ms: one slot of 4 ms has room for either\n"
        );
        let many = hints(&[pair; 20]);
        assert_eq!(many.lines().count(), MAX_PAIRS_TOLD + 1);
        assert!(
            many.ends_with("hint: the same holds for 12 more pairs of slots\n"),
            "{many}"
        );
    }
}
