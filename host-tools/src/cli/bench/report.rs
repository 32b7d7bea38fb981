//! What a bench says: a table with a row a mission, what went wrong in which run, or an object a
//! run for programs.

use std::fmt::Write as _;

use serde::Serialize;

use crate::bench::{Course, Outcome};
use crate::clean::counted;
use crate::run::touches::TouchSummary;
use crate::scenario::time::Time;

/// The most runs of one mission of which it is said what went wrong.
const TOLD_RUNS: usize = 5;

/// What `--json` says of a run.
#[derive(Serialize)]
pub struct Row<'a> {
    mission: String,
    script: Option<String>,
    world: &'a str,
    seed: u64,
    at_goal: Option<bool>,
    off_goal_m: Option<f64>,
    time_s: f64,
    finished: bool,
    distance_m: f64,
    rooms_entered: &'a [String],
    collisions: u32,
    avoidable: u32,
    touches: &'a [TouchSummary],
    dead_sonars: Vec<DeadSonar>,
    fault: Option<&'a str>,
}

#[derive(Serialize)]
struct DeadSonar {
    sonar: usize,
    at_s: f64,
}

impl<'a> Row<'a> {
    /// What came of a run.
    pub fn new(course: &'a Course, outcome: &'a Outcome) -> Self {
        let summary = &outcome.summary;
        Row {
            mission: course.mission.file.display().to_string(),
            script: (course.script.as_ref()).map(|sent| sent.file.display().to_string()),
            world: &course.world_name,
            seed: outcome.seed,
            at_goal: course.goal.map(|_| outcome.is_at_goal()),
            off_goal_m: outcome.reached.and_then(|reached| reached.off_m),
            time_s: outcome.time_s(),
            finished: summary.finished_s.is_some(),
            distance_m: summary.distance_m,
            rooms_entered: &summary.rooms_entered,
            collisions: summary.collisions,
            avoidable: summary.avoidable,
            touches: &summary.touches,
            dead_sonars: (outcome.sonar_breaks.iter())
                .map(|broken| DeadSonar {
                    sonar: broken.sonar,
                    at_s: broken.robot_us as f64 / 1e6,
                })
                .collect(),
            fault: summary.fault.as_deref(),
        }
    }
}

/// All runs together; the last line of `--json`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct Total {
    runs: usize,
    /// Runs that came to their end, and to their goal where there is one.
    at_goal: usize,
    missed: usize,
    collisions: u32,
    avoidable: u32,
}

impl Total {
    /// All runs of all courses.
    pub fn of<'a>(outcomes: impl IntoIterator<Item = &'a Outcome>) -> Self {
        let mut total = Total::default();
        for outcome in outcomes {
            total.runs += 1;
            match outcome.is_at_goal() {
                true => total.at_goal += 1,
                false => total.missed += 1,
            }
            total.collisions += outcome.summary.collisions;
            total.avoidable += outcome.summary.avoidable;
        }
        total
    }

    /// Whether each run reached its goal and touched nothing that it could have avoided.
    pub fn is_good(&self) -> bool {
        self.missed == 0 && self.avoidable == 0
    }
}

const HEADINGS: [&str; 9] = [
    "mission",
    "world",
    "goal",
    "runs",
    "at goal",
    "collisions",
    "avoidable",
    "m off goal",
    "s to the end",
];

/// How many of the first columns are words: they stand at the left, numbers at the right.
const WORDS: usize = 3;

/// The table, a row a course. Of distances and times the median and the worst are told.
pub fn table(benched: &[(&Course, Vec<Outcome>)]) -> String {
    let mut rows = vec![HEADINGS.map(str::to_owned)];
    rows.extend(benched.iter().map(|(course, runs)| row(course, runs)));
    let mut widths = [0; HEADINGS.len()];
    for row in &rows {
        for (width, cell) in widths.iter_mut().zip(row) {
            *width = (*width).max(cell.chars().count());
        }
    }
    let mut table = String::new();
    for row in &rows {
        let cells = row.iter().zip(widths).enumerate();
        let cells: Vec<String> = cells
            .map(|(column, (cell, width))| match column < WORDS {
                true => format!("{cell:<width$}"),
                false => format!("{cell:>width$}"),
            })
            .collect();
        // Writing to a string does not fail.
        let _ = writeln!(table, "{}", cells.join("  ").trim_end());
    }
    table
}

fn row(course: &Course, runs: &[Outcome]) -> [String; HEADINGS.len()] {
    let total = Total::of(runs);
    let off_m = runs.iter().filter_map(|run| run.reached?.off_m);
    let goal = course.goal.map(|goal| goal.to_string());
    [
        shown_name(course),
        course.world.name.clone(),
        goal.unwrap_or_else(|| "-".to_owned()),
        total.runs.to_string(),
        (course.goal).map_or_else(|| "-".to_owned(), |_| total.at_goal.to_string()),
        total.collisions.to_string(),
        total.avoidable.to_string(),
        median_and_worst::<3>(off_m),
        median_and_worst::<1>(runs.iter().map(Outcome::time_s)),
    ]
}

/// What a row is called by: the mission, or the script that it is sent.
fn shown_name(course: &Course) -> String {
    let sent = course.script.as_ref();
    let file = sent.and_then(|sent| sent.file.file_name());
    file.map_or_else(
        || course.mission.name.clone(),
        |file| file.to_string_lossy().into_owned(),
    )
}

/// The median and the greatest of some numbers, with so many decimals.
fn median_and_worst<const DECIMALS: usize>(numbers: impl Iterator<Item = f64>) -> String {
    let mut numbers: Vec<f64> = numbers.collect();
    numbers.sort_by(f64::total_cmp);
    let middle = numbers.len() / 2;
    let (Some(upper), Some(worst)) = (numbers.get(middle), numbers.last()) else {
        return "-".to_owned();
    };
    let median = match numbers.len().is_multiple_of(2) {
        true => f64::midpoint(numbers[middle - 1], *upper),
        false => *upper,
    };
    format!("{median:.DECIMALS$}, {worst:.DECIMALS$}")
}

/// What went wrong in the runs of a course, and how to see one of them again; nothing where all is
/// well.
pub fn troubles(course: &Course, runs: &[Outcome], varies: bool) -> String {
    let mut told = String::new();
    let is_bad = |run: &&Outcome| !run.is_at_goal() || run.summary.collisions > 0;
    let bad: Vec<&Outcome> = runs.iter().filter(is_bad).collect();
    for run in bad.iter().take(TOLD_RUNS) {
        // Writing to a string does not fail.
        let _ = writeln!(
            told,
            "{} in {}, seed {}: {}",
            shown_name(course),
            course.world.name,
            run.seed,
            trouble(run)
        );
    }
    if let Some(more) = bad.len().checked_sub(TOLD_RUNS).filter(|more| *more > 0) {
        let more = counted(more as u64, "more run");
        let _ = writeln!(told, "  and {more}; `--json` has all");
    }
    if let Some(first) = bad.first() {
        let until = Time {
            us: course.until_us,
        };
        let _ = writeln!(
            told,
            "  again: esm run {} --board host --world {} --until '{until}' --seed {}{}{}",
            course.mission.file.display(),
            course.world_name,
            first.seed,
            if varies { " --vary" } else { "" },
            (course.script.as_ref()).map_or_else(String::new, |sent| format!(
                " --script {}",
                sent.file.display()
            ))
        );
    }
    told
}

/// What went wrong in a run.
fn trouble(run: &Outcome) -> String {
    let mut told = Vec::new();
    let summary = &run.summary;
    if let Some(fault) = &summary.fault {
        told.push(format!("ended at {:.3} s: {fault}", summary.robot_time_s));
    }
    if let Some(reached) = run.reached.filter(|reached| !reached.is_reached) {
        told.push(match reached.off_m {
            Some(off_m) => format!("{off_m:.3} m off its goal"),
            None => format!(
                "came into {}",
                counted(summary.rooms_entered.len() as u64, "room")
            ),
        });
    }
    told.extend(summary.touches.iter().map(ToString::to_string));
    told.extend(run.sonar_breaks.iter().map(|broken| {
        let at_s = broken.robot_us as f64 / 1e6;
        format!(
            "sonar {} {} from {at_s:.3} s on",
            broken.sonar, broken.fault
        )
    }));
    told.join("; ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn of_numbers_the_median_and_the_worst_are_told() {
        for (numbers, expected) in [
            (&[][..], "-"),
            (&[1.0], "1.00, 1.00"),
            (&[3.0, 1.0], "2.00, 3.00"),
            (&[3.0, 1.0, 1.5], "1.50, 3.00"),
        ] {
            let told = median_and_worst::<2>(numbers.iter().copied());
            assert_eq!(told, expected);
        }
    }
}
