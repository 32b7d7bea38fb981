//! The missions that are measured, made from numbers, and the plan that says what is done with
//! each.
//!
//! Each has a panel as its first region, whose task's flags are set from outside. Its first flag
//! changes nothing: it is there so that the interpreter has to look. The second makes the panel
//! send an event.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use crate::command::root;
use crate::subject;

/// The CD player.
pub const PLAYER: &str = "tests/data/cd51.esm";
/// Missions that people drive robots with.
pub const SHIPPED: [&str; 3] = ["patrol", "follow_wall", "watch_timing"];

/// Regions side by side, beside the panel's.
pub const REGIONS: [usize; 4] = [1, 4, 16, 64];
/// States inside each other, in each region.
pub const DEPTHS: [usize; 4] = [1, 2, 4, 8];
/// Transitions that leave a state.
pub const TRANSITIONS: [usize; 3] = [1, 4, 16];
/// Levels of the deep machine.
pub const LEVELS: usize = 8;
/// Terms of a guard.
const TERMS: usize = 12;
/// The rows of guards, what each says, and the row of the same machine without that guard.
pub const GUARDS: [(&str, &str, &str); 4] = [
    (
        "guard-few",
        "12 terms joined by `and`, of a task with 12 flags",
        "guard-few-none",
    ),
    (
        "guard-and",
        "12 terms joined by `and`, of which the last fails, of a task with 14 flags",
        NO_GUARD,
    ),
    ("guard-or", "12 terms joined by `or`, all false", NO_GUARD),
    (
        "guard-mixed",
        "`or` in six pairs joined by `and`, of which the last fails",
        NO_GUARD,
    ),
];
/// The row of the machine without any of the last three.
const NO_GUARD: &str = "guard-none";

/// The shape of the largest mission: regions, depth, transitions.
const LARGEST: (usize, usize, usize) = (64, 8, 16);

/// All rows of guards, each once.
pub fn guard_rows() -> BTreeSet<&'static str> {
    GUARDS
        .iter()
        .flat_map(|(row, _, none)| [*row, *none])
        .collect()
}

/// Regions, depth and transitions of all missions that have nothing to do.
pub fn shapes() -> impl Iterator<Item = (usize, usize, usize)> {
    DEPTHS.into_iter().flat_map(|depth| {
        TRANSITIONS.into_iter().flat_map(move |transitions| {
            REGIONS
                .into_iter()
                .map(move |regions| (regions, depth, transitions))
        })
    })
}

/// The file of a mission that people drive robots with.
pub fn shipped(name: &str) -> PathBuf {
    root().join(format!("missions/{name}.esm"))
}

/// Missions, and a plan.
#[derive(Default)]
pub struct Plan {
    lines: String,
    /// Compiled, with names; the number of a mission is its place. The player is the first.
    blobs: Vec<Vec<u8>>,
}

impl Plan {
    /// The CD player's script.
    ///
    /// # Errors
    /// What the front end or the compiler has against it.
    pub fn player_alone() -> Result<Self, String> {
        let mut plan = Self::default();
        let player = fs::read_to_string(root().join(PLAYER)).map_err(|error| error.to_string())?;
        let blob = plan.add(&player)?;
        plan.line("cd51-esm", "script", blob);
        Ok(plan)
    }

    /// Everything that is measured.
    ///
    /// # Errors
    /// What the front end or the compiler has against a mission: a mistake in this file.
    pub fn whole() -> Result<Self, String> {
        let mut plan = Self::player_alone()?;
        let player = fs::read_to_string(root().join(PLAYER)).map_err(|error| error.to_string())?;
        let blob = 0;
        plan.line("set-cd51", "set", blob);
        plan.line("verify-cd51", "verify", blob);
        plan.line("start-cd51", "start", blob);
        let deaf = plan.add(&without_region(&player, "player")?)?;
        plan.line("cd51-deaf", "script", deaf);
        let mute = plan.add(&without_sends(&player))?;
        plan.line("cd51-mute", "script", mute);

        let alone = plan.add(&idle(0, 1, 0))?;
        plan.line("stirred-none", "stirred", alone);
        let unheard_alone = plan.add(&unheard(0, 1, 0))?;
        plan.line("unheard-none", "flag-1", unheard_alone);
        for (regions, depth, transitions) in shapes() {
            let row = format!("{regions}-{depth}-{transitions}");
            let blob = plan.add(&idle(regions, depth, transitions))?;
            plan.line(&format!("still-{row}"), "still", blob);
            plan.line(&format!("stirred-{row}"), "stirred", blob);
            if (regions, depth, transitions) == LARGEST {
                plan.line("verify-largest", "verify", blob);
                plan.line("start-largest", "start", blob);
            }
            let blob = plan.add(&unheard(regions, depth, transitions))?;
            plan.line(&format!("unheard-{row}"), "flag-1", blob);
        }
        for regions in REGIONS {
            let heard = plan.add(&storm(regions))?;
            plan.line(&format!("storm-{regions}"), "flag-1", heard);
        }
        let deep = plan.add(&deep())?;
        for level in 1..=LEVELS {
            plan.line(&format!("deep-{level}"), &format!("flag-{level}"), deep);
        }
        for row in guard_rows() {
            let guard = plan.add(&guarded(row))?;
            plan.line(row, "stirred", guard);
        }
        for name in SHIPPED {
            let built = subject::build_file(&shipped(name))?;
            plan.blobs.push(built.blob);
            let blob = plan.blobs.len() - 1;
            plan.line(&format!("verify-{name}"), "verify", blob);
            plan.line(&format!("start-{name}"), "start", blob);
        }
        Ok(plan)
    }

    /// The CD player, compiled.
    pub fn player(&self) -> &[u8] {
        self.blobs.first().map_or(&[], Vec::as_slice)
    }

    fn add(&mut self, text: &str) -> Result<usize, String> {
        let built = subject::build(text).map_err(|problem| format!("{problem}\n{text}"))?;
        self.blobs.push(built.blob);
        Ok(self.blobs.len() - 1)
    }

    fn line(&mut self, row: &str, drive: &str, blob: usize) {
        // Writing to a string cannot fail.
        let _ = writeln!(self.lines, "{row} {drive} m{blob}");
    }

    /// The lines of these rows alone.
    pub fn only(&self, rows: &[&str]) -> Self {
        let of_row = |line: &&str| {
            line.split(' ')
                .next()
                .is_some_and(|row| rows.contains(&row))
        };
        let lines = self.lines.lines().filter(of_row);
        Self {
            lines: lines.map(|line| format!("{line}\n")).collect(),
            blobs: self.blobs.clone(),
        }
    }

    /// Writes plan and missions to files, as the programs that are measured read them.
    ///
    /// # Errors
    /// What the system says.
    pub fn write(&self, folder: &Path) -> std::io::Result<()> {
        fs::write(folder.join("plan"), &self.lines)?;
        for (number, blob) in self.blobs.iter().enumerate() {
            fs::write(folder.join(format!("m{number}")), blob)?;
        }
        Ok(())
    }
}

/// A text without one of its regions and what that alone used.
fn without_region(text: &str, region: &str) -> Result<String, String> {
    let head = format!("region {region} {{");
    let start = text
        .find(&head)
        .ok_or("the player's chart has no such region")?;
    let mut open = 0;
    let length = text[start..].find(|character| {
        match character {
            '{' => open += 1,
            '}' => open -= 1,
            _ => return false,
        }
        open == 0
    });
    let end = start + length.ok_or("the player's chart is cut")? + 1;
    Ok(format!("{}{}", &text[..start], &text[end..]))
}

/// A text in which no transition sends an event.
fn without_sends(text: &str) -> String {
    let lines = text.lines().map(|line| match line.split_once(" / send ") {
        Some((before, _)) => format!("{};\n", before.trim_end()),
        None => format!("{line}\n"),
    });
    lines.collect()
}

const SLOTS: &str =
    "interpreter slot 1; slot 1 period 1 ms duration 100 us; slot 2 period 1 ms duration 100 us;\n";

/// The panel's region, with a guarded `send` for each flag, and further lines.
fn panel(flags: &[&str], further: &str) -> String {
    let mut text = String::from(
        "region panel { task Panel: Buttons; initial -> Panel; Panel -> Panel [.stir and .never];\n",
    );
    for flag in flags {
        let _ = writeln!(text, "Panel -> Panel [.{flag}] / send E{flag};");
    }
    text + further + "}\n"
}

fn buttons(flags: &[&str]) -> String {
    let flags: String = flags
        .iter()
        .map(|flag| format!(" out flag {flag};"))
        .collect();
    format!("{SLOTS}task Buttons slot 2 {{ out flag stir;{flags} out flag never; }}\n")
}

/// Regions of nested states with as many transitions each, none of which can be taken.
fn idle(regions: usize, depth: usize, transitions: usize) -> String {
    let level = |level: usize| {
        let inside = if level == depth {
            "task S: Work".to_owned()
        } else {
            format!("super S: Level{}", level + 1)
        };
        format!(
            "{inside}; initial -> S;{}",
            " S -> S [.go];".repeat(transitions)
        )
    };
    let mut text = buttons(&[]) + "task Work slot 2 { out flag go; }\n";
    for below in 2..=depth {
        let _ = writeln!(
            text,
            "container Level{below} {{ out flag go; region r {{ {} }} }}",
            level(below)
        );
    }
    text += "machine Idle {\n";
    text += &panel(&[], "");
    for region in 0..regions {
        let _ = writeln!(text, "region r{region} {{ {} }}", level(1));
    }
    text + "}\n"
}

/// An event that regions of nested states see and wait for in another state than the one that is
/// current, which has as many transitions on an event that never comes.
fn unheard(regions: usize, depth: usize, transitions: usize) -> String {
    let level = |level: usize| {
        let inside = if level == depth {
            "state S".to_owned()
        } else {
            format!("super S: Level{}", level + 1)
        };
        format!(
            "{inside}; state T; initial -> S;{} T -> S on Ego;",
            " S -> T on Eother;".repeat(transitions)
        )
    };
    let mut text = buttons(&["go", "other"]);
    for below in 2..=depth {
        let _ = writeln!(
            text,
            "container Level{below} {{ in event Ego; in event Eother; region r {{ {} }} }}",
            level(below)
        );
    }
    text += "machine Unheard { event Ego, Eother;\n";
    text += &panel(&["go", "other"], "");
    for region in 0..regions {
        let _ = writeln!(text, "region r{region} {{ {} }}", level(1));
    }
    text + "}\n"
}

/// An event that is visible in regions, each of which has a transition on it.
pub fn storm(regions: usize) -> String {
    let mut text = buttons(&["go"]) + "machine Storm { event Ego;\n";
    text += &panel(&["go"], "");
    for region in 0..regions {
        let _ = writeln!(
            text,
            "region r{region} {{ state S; initial -> S; S -> S on Ego; }}"
        );
    }
    text + "}\n"
}

/// States inside each other, each with a transition on an event of its own.
fn deep() -> String {
    let names: Vec<String> = (1..=LEVELS).map(|level| format!("l{level}")).collect();
    let flags: Vec<&str> = names.iter().map(String::as_str).collect();
    let state = |level: usize| {
        let inside = if level == LEVELS {
            "state S".to_owned()
        } else {
            format!("super S: Level{}", level + 1)
        };
        format!("region r {{ {inside}; initial -> S; S -> S on El{level}; }}")
    };
    let mut text = buttons(&flags);
    for level in 2..=LEVELS {
        let events: String = (level..=LEVELS)
            .map(|level| format!("in event El{level}; "))
            .collect();
        let _ = writeln!(
            text,
            "container Level{level} {{ {events}{} }}",
            state(level)
        );
    }
    let events: Vec<String> = flags.iter().map(|flag| format!("E{flag}")).collect();
    let _ = writeln!(text, "machine Deep {{ event {};", events.join(", "));
    text + &panel(&flags, "") + &state(1) + "}\n"
}

/// A panel with one more transition, under a guard of [`TERMS`] terms that is false, and only the
/// last term makes it so.
fn guarded(row: &str) -> String {
    let names: Vec<String> = (1..=TERMS).map(|term| format!("a{term}")).collect();
    let flags: Vec<&str> = names.iter().map(String::as_str).collect();
    let terms = |form: fn((usize, &&str)) -> String, joint: &str| {
        flags
            .iter()
            .enumerate()
            .map(form)
            .collect::<Vec<_>>()
            .join(joint)
    };
    if row.starts_with("guard-few") {
        return guarded_few(&flags, row == "guard-few");
    }
    let guard = match row {
        "guard-and" => terms(
            |(place, flag)| format!("{}.{flag}", if place + 1 < TERMS { "not " } else { "" }),
            " and ",
        ),
        "guard-or" => terms(|(_, flag)| format!(".{flag}"), " or "),
        "guard-mixed" => terms(
            |(place, flag)| match (place % 2, place + 1 < TERMS) {
                (0, _) => format!("(.{flag}"),
                (_, true) => format!("or not .{flag})"),
                (_, false) => format!("or .{flag})"),
            },
            " ",
        )
        .replace(") (", ") and ("),
        _ => String::new(),
    };
    let further = if guard.is_empty() {
        String::new()
    } else {
        format!("Panel -> Panel [{guard}];")
    };
    let mut text = buttons(&flags) + "machine Guarded {\n";
    text += &panel(&[], &further);
    text + "}\n"
}

/// The same with no flag but those of the terms. The first one is changed all the time, and the
/// last one never.
fn guarded_few(flags: &[&str], guarded: bool) -> String {
    let declared: String = flags
        .iter()
        .map(|flag| format!(" out flag {flag};"))
        .collect();
    let mut text = format!("{SLOTS}task Buttons slot 2 {{{declared} }}\nmachine Guarded {{\n");
    text += "region panel { task Panel: Buttons; initial -> Panel;\n";
    if let [first, between @ .., last] = flags {
        let _ = writeln!(text, "Panel -> Panel [.{first} and .{last}];");
        if guarded {
            let between: String = between
                .iter()
                .map(|flag| format!("not .{flag} and "))
                .collect();
            let _ = writeln!(text, "Panel -> Panel [not .{first} and {between}.{last}];");
        }
    }
    text + "}\n}\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::subject::verified;

    fn counts(text: &str) -> (usize, usize) {
        let blob = subject::build(text)
            .unwrap_or_else(|problem| panic!("{problem}\n{text}"))
            .blob;
        let tables = verified(&blob).unwrap();
        let tables = tables.tables();
        (tables.region_instance_count(), tables.transition_count())
    }

    #[test]
    fn idle_missions_have_the_regions_and_transitions_that_their_rows_say() {
        for (regions, depth, transitions) in shapes().filter(|(regions, ..)| *regions <= 4) {
            let row = format!("{regions} {depth} {transitions}");
            // Templates: each level but the first once, whatever uses it; and the panel with its
            // region.
            let templates = regions + depth - 1 + 1;
            let (found, of_idle) = counts(&idle(regions, depth, transitions));
            assert_eq!(found, regions * depth + 1, "{row}");
            assert_eq!(of_idle, (templates - 1) * (1 + transitions) + 2, "{row}");
            let (found, of_unheard) = counts(&unheard(regions, depth, transitions));
            assert_eq!(found, regions * depth + 1, "{row}");
            assert_eq!(of_unheard, (templates - 1) * (2 + transitions) + 4, "{row}");
        }
    }

    #[test]
    fn a_plan_of_some_rows_keeps_their_missions() {
        let plan = Plan {
            lines: "a script m0\nab set m1\nb still m1\n".to_owned(),
            blobs: vec![vec![1], vec![2]],
        };
        let few = plan.only(&["b", "a"]);
        assert_eq!(few.lines, "a script m0\nb still m1\n");
        assert_eq!(few.blobs, plan.blobs);
    }
}
