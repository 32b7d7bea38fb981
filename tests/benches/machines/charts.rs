//! The missions that are measured, made from numbers, and the plan that says what is done with each.
//!
//! Each has a panel as its first region, whose task's flags are set from outside. Its first flag changes nothing: it is there so that the interpreter has to
//! look. The second makes the panel send an event.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use esm_tests::command::root;
use esm_tests::subject;

/// The CD player.
pub const PLAYER: &str = "tests/data/cd51.esm";
/// Missions that people drive robots with.
const SHIPPED: [&str; 2] = ["patrol", "follow_wall"];

/// Regions beside the panel's.
pub const REGIONS: [usize; 4] = [1, 4, 16, 64];
/// States inside each other, in each region.
pub const DEPTHS: [usize; 4] = [1, 2, 4, 8];
/// Transitions that leave a state.
pub const TRANSITIONS: [usize; 3] = [1, 4, 16];
/// Levels of the deep machine.
pub const LEVELS: usize = 8;
/// Terms of a guard.
const TERMS: usize = 12;
/// The rows of guards, and what each says, `none` for the machine without one.
pub const GUARDS: [(&str, &str); 4] = [
    ("guard-none", "no guard"),
    (
        "guard-and",
        "12 terms joined by `and`, of which the last fails",
    ),
    ("guard-or", "12 terms joined by `or`, all false"),
    (
        "guard-mixed",
        "`or` in six pairs joined by `and`, of which the last fails",
    ),
];

/// Missions, and a plan.
#[derive(Default)]
pub struct Plan {
    lines: String,
    /// Compiled, with names; the number of a mission is its place.
    pub blobs: Vec<Vec<u8>>,
}

impl Plan {
    /// Everything that is measured.
    ///
    /// # Errors
    /// What the front end or the compiler has against a mission: a mistake in this file.
    pub fn whole() -> Result<Self, String> {
        let mut plan = Self::default();
        let player = fs::read_to_string(root().join(PLAYER)).map_err(|error| error.to_string())?;
        let blob = plan.add(&player)?;
        plan.line("cd51-esm", "script", blob);
        plan.line("set-cd51", "set", blob);
        plan.line("verify-cd51", "verify", blob);
        plan.line("start-cd51", "start", blob);
        let deaf = plan.add(&without_region(&player, "player")?)?;
        plan.line("cd51-deaf", "script", deaf);
        let mute = plan.add(&without_sends(&player))?;
        plan.line("cd51-mute", "script", mute);

        for regions in REGIONS {
            for depth in DEPTHS {
                for transitions in TRANSITIONS {
                    let blob = plan.add(&idle(regions, depth, transitions))?;
                    let row = format!("{regions}-{depth}-{transitions}");
                    plan.line(&format!("still-{row}"), "still", blob);
                    plan.line(&format!("stirred-{row}"), "stirred", blob);
                }
            }
        }
        let largest = plan.blobs.len() - 1;
        plan.line("verify-largest", "verify", largest);
        plan.line("start-largest", "start", largest);

        for regions in REGIONS {
            let unheard = plan.add(&storm(regions, false))?;
            plan.line(&format!("unheard-{regions}"), "flag-1", unheard);
            let heard = plan.add(&storm(regions, true))?;
            plan.line(&format!("storm-{regions}"), "flag-1", heard);
        }
        let deep = plan.add(&deep())?;
        for level in 1..=LEVELS {
            plan.line(&format!("deep-{level}"), &format!("flag-{level}"), deep);
        }
        for (row, _) in GUARDS {
            let guard = plan.add(&guarded(row))?;
            plan.line(row, "stirred", guard);
        }
        for name in SHIPPED {
            let built = subject::build_file(&root().join(format!("missions/{name}.esm")))?;
            plan.blobs.push(built.blob);
            let blob = plan.blobs.len() - 1;
            plan.line(&format!("verify-{name}"), "verify", blob);
            plan.line(&format!("start-{name}"), "start", blob);
        }
        Ok(plan)
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

/// An event that regions see; whether they wait for it in the state that they are in.
fn storm(regions: usize, heard: bool) -> String {
    let waiting = if heard {
        "S -> S on Ego;"
    } else {
        // Another state waits for it, which is entered only when the panel asks for it.
        "S -> T on Eother; T -> S on Ego;"
    };
    let mut text = buttons(&["go", "other"]) + "machine Storm { event Ego, Eother;\n";
    text += &panel(&["go", "other"], "");
    for region in 0..regions {
        let _ = writeln!(
            text,
            "region r{region} {{ state S; {} initial -> S; {waiting} }}",
            if heard { "" } else { "state T;" }
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

/// A panel with one more transition, under a guard of [`TERMS`] terms that is false, and only the last term makes it so.
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
