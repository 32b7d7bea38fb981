//! The report: tables, for a terminal and for the documentation.

use std::fmt::Write as _;

use crate::charts::{self, DEPTHS, GUARDS, LEVELS, REGIONS, TRANSITIONS};
use crate::measured::Measured;

/// An engine that was compared.
pub struct Engine {
    /// How its rows end.
    pub row: &'static str,
    /// For people, with its version.
    pub name: String,
    /// Bytes of a program with it, for speed and for size.
    pub flash: [u32; 2],
    /// Bytes of its machine.
    pub ram: Option<u32>,
}

/// Where it was measured, and what that gave.
pub struct Setting {
    /// The heading of its columns.
    pub name: &'static str,
    /// What it gave.
    pub measured: Measured,
}

/// Everything that is told.
pub struct Report {
    /// The day.
    pub date: String,
    /// The compiler of all programs.
    pub compiler: String,
    /// What the emulator says of itself.
    pub emulator: String,
    /// What valgrind says of itself.
    pub valgrind: String,
    /// The board for speed, the board for size, the host in instructions, the host in nanoseconds.
    pub settings: [Setting; 4],
    /// The engines, of which the first does nothing.
    pub engines: Vec<Engine>,
    /// Bytes of a program with interpreter and verifier.
    pub interpreter_flash: [u32; 2],
    /// Bytes of the player as a mission, names included.
    pub player_blob: usize,
    /// Bytes of memory that its machine takes.
    pub player_ram: usize,
    /// Bytes of the interpreter's own variables.
    pub interpreter_ram: u32,
    /// Events of a pass through the script.
    pub events: u32,
}

/// Rows of cells under a head, with a title and what to know of it.
struct Table {
    title: &'static str,
    note: String,
    head: Vec<String>,
    rows: Vec<Vec<String>>,
}

/// A number as people read it; a dash where there is none.
fn number(value: Option<f64>) -> String {
    match value {
        None => "–".to_owned(),
        Some(value) if value < 1_000.0 => format!("{value:.1}"),
        Some(value) => grouped(&format!("{value:.0}")),
    }
}

/// Digits in groups of three.
fn grouped(digits: &str) -> String {
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

impl Report {
    /// For a terminal.
    pub fn text(&self) -> String {
        let mut text = self.head();
        for table in self.tables() {
            let _ = writeln!(
                text,
                "\n{}\n{}\n{}",
                table.title,
                table.note,
                table.aligned("  ", false)
            );
        }
        text
    }

    /// For the documentation.
    pub fn markdown(&self) -> String {
        let mut text = format!("# Benchmarks of state machines\n\n{}", self.head());
        for table in self.tables() {
            let _ = write!(
                text,
                "\n## {}\n\n{}\n\n{}",
                table.title,
                table.note,
                table.aligned(" | ", true)
            );
        }
        text
    }

    fn head(&self) -> String {
        format!(
            "Measured on {} by `cargo xtask bench machines --write`, with {}; `lto = \"fat\"`, one codegen unit, `panic = \"abort\"`.\n\
             M4: instructions on {}, machine mps2-an386, code for thumbv7m, `-icount`. Host: instructions under {}, and\n\
             nanoseconds, the shortest of ten measurements, at `-O2`. Counts repeat exactly; nanoseconds depend on the machine and on who else uses it;\n\
             a dash stands where a difference of them drowns in that, and where there is nothing to measure.\n",
            self.date, self.compiler, self.emulator, self.valgrind
        )
    }

    fn tables(&self) -> Vec<Table> {
        vec![
            self.player(),
            self.unheard(),
            self.sizes(),
            self.idle("still-", "Idle pulse", "A macro step at a pulse that enables nothing, while no flag has changed since the last one.".into()),
            self.idle(
                "stirred-",
                "Idle pulse after a change",
                "The same, after a flag has changed that a guard of the panel's region looks at, which is one more than the regions of the row, and that enables nothing. The change is counted.".into(),
            ),
            self.events(),
            self.swap(),
        ]
    }

    /// What an event of a row takes, in each setting, less what one of another row does: the harness, or the same with less to do.
    fn net(&self, row: &str, less: &str) -> Vec<String> {
        let of = |setting: &Setting| {
            let own = setting.measured.event(less)?;
            // Differences of nanoseconds can drown in what disturbs both.
            Some(setting.measured.event(row)? - own).filter(|less| *less >= 0.0)
        };
        self.settings
            .iter()
            .map(|setting| number(of(setting)))
            .collect()
    }

    /// What an event of a row takes, in each setting, with all that is around it.
    fn own(&self, row: &str) -> Vec<String> {
        let of = |setting: &Setting| number(setting.measured.event(row));
        self.settings.iter().map(of).collect()
    }

    fn heads(&self, first: &str) -> Vec<String> {
        let names = self.settings.iter().map(|setting| setting.name.to_owned());
        std::iter::once(first.to_owned()).chain(names).collect()
    }

    fn player(&self) -> Table {
        let named = |name: &str, cells: Vec<String>| {
            std::iter::once(name.to_owned())
                .chain(cells)
                .collect::<Vec<_>>()
        };
        let harness = "cd51-nothing";
        let mut rows: Vec<_> = self
            .engines
            .iter()
            .skip(1)
            .map(|engine| {
                named(
                    &engine.name,
                    self.net(&format!("cd51-{}", engine.row), harness),
                )
            })
            .collect();
        rows.push(named(
            "ours: macro step, from flag through event to transition",
            self.net("cd51-esm", harness),
        ));
        rows.push(named(
            "ours: less the same without the player's region, so that no one receives",
            self.net("cd51-esm", "cd51-deaf"),
        ));
        rows.push(named(
            "ours: less the same that sends no event",
            self.net("cd51-esm", "cd51-mute"),
        ));
        rows.push(named(
            "ours: setting or clearing a flag, which is part of each macro step",
            self.own("set-cd51"),
        ));
        rows.push(named(
            "(the harness, which is taken off above)",
            self.own(harness),
        ));
        Table {
            title: "CD player, an event",
            note: format!(
                "The composite CD player of Boost.SML's benchmark, {} events a pass, one dispatch or macro step an event; ours is `{}`. An action, or a transition of ours, is an opaque call\n\
                 that counts in a volatile cell; all engines have done the same. smlang and rust-fsm have no nested states: there, the songs stand beside the others.",
                self.events,
                charts::PLAYER
            ),
            head: self.heads("engine"),
            rows,
        }
    }

    fn unheard(&self) -> Table {
        let mut rows = Vec::new();
        for engine in self.engines.iter().skip(1) {
            let mut row = vec![engine.name.clone()];
            row.extend(self.net(&format!("idle-{}", engine.row), "idle-nothing"));
            rows.push(row);
        }
        for (row, name) in [
            ("still-1-1-1", "ours: pulse, one region"),
            (
                "stirred-1-1-1",
                "ours: pulse after a change, one region and the panel's",
            ),
        ] {
            let mut cells = vec![name.to_owned()];
            cells.extend(self.net(row, "idle-nothing"));
            rows.push(cells);
        }
        Table {
            title: "Nothing to do",
            note: "An event that nothing waits for in the state that is current; of ours, a pulse."
                .to_owned(),
            head: self.heads("engine"),
            rows,
        }
    }

    fn sizes(&self) -> Table {
        let [empty_fast, empty_small] = self.engines.first().map_or([0, 0], |engine| engine.flash);
        let less = |bytes: u32, empty: u32| grouped(&bytes.saturating_sub(empty).to_string());
        let mut rows = Vec::new();
        for engine in self.engines.iter().skip(1) {
            let [fast, small] = engine.flash;
            rows.push(vec![
                engine.name.clone(),
                "0".to_owned(),
                "0".to_owned(),
                less(fast, empty_fast),
                less(small, empty_small),
                engine
                    .ram
                    .map_or_else(|| "–".to_owned(), |bytes| bytes.to_string()),
            ]);
        }
        let [fast, small] = self.interpreter_flash;
        let blob = grouped(&self.player_blob.to_string());
        rows.push(vec![
            "ours".to_owned(),
            less(fast, empty_fast),
            less(small, empty_small),
            blob.clone(),
            blob,
            format!("{} + {}", self.player_ram, self.interpreter_ram),
        ]);
        Table {
            title: "Flash and RAM of the player, bytes",
            note: "Programs on the board less the one that does nothing. Of ours, interpreter and verifier are there once for all machines, and a machine is its mission, names included;\n\
                   its RAM is the machine's state and the interpreter's own variables. The cell pointer of the counters is in all."
                .to_owned(),
            head: ["engine", "engine -O2", "engine -Os", "machine -O2", "machine -Os", "RAM"]
                .map(str::to_owned)
                .to_vec(),
            rows,
        }
    }

    fn idle(&self, prefix: &str, title: &'static str, note: String) -> Table {
        let mut rows = Vec::new();
        for depth in DEPTHS {
            for transitions in TRANSITIONS {
                let mut row = vec![depth.to_string(), transitions.to_string()];
                for setting in [0, 2] {
                    for regions in REGIONS {
                        let name = format!("{prefix}{regions}-{depth}-{transitions}");
                        let setting = self.settings.get(setting);
                        row.push(number(
                            setting.and_then(|setting| setting.measured.event(&name)),
                        ));
                    }
                }
                rows.push(row);
            }
        }
        let mut head = vec!["depth".to_owned(), "transitions a state".to_owned()];
        for setting in [0, 2] {
            for regions in REGIONS {
                let name = self
                    .settings
                    .get(setting)
                    .map_or("", |setting| setting.name);
                head.push(format!("{name}, {regions}"));
            }
        }
        Table {
            title,
            note: note
                + " Columns: where, and how many regions; each has states inside each other, as deep as the row says.",
            head,
            rows,
        }
    }

    fn events(&self) -> Table {
        let mut names: Vec<(String, String)> = Vec::new();
        for regions in REGIONS {
            names.push((
                format!("unheard-{regions}"),
                format!("event seen, and not waited for: regions: {regions}"),
            ));
        }
        for regions in REGIONS {
            names.push((
                format!("storm-{regions}"),
                format!("event with a transition in each region: regions: {regions}"),
            ));
        }
        for level in 1..=LEVELS {
            names.push((
                format!("deep-{level}"),
                format!("{LEVELS} states inside each other, transition at level {level}"),
            ));
        }
        for (row, says) in GUARDS {
            names.push((row.to_owned(), format!("pulse after a change, {says}")));
        }
        Table {
            title: "Macro steps of other shapes",
            note: "The panel's own transition, which sends the event, is counted.".to_owned(),
            head: self.heads("macro step"),
            rows: self.rows_of(names),
        }
    }

    fn rows_of(&self, names: Vec<(String, String)>) -> Vec<Vec<String>> {
        names
            .into_iter()
            .map(|(row, name)| {
                let cells = self
                    .settings
                    .iter()
                    .map(|setting| number(setting.measured.event(&row)));
                std::iter::once(name).chain(cells).collect()
            })
            .collect()
    }

    fn swap(&self) -> Table {
        const MISSIONS: [(&str, &str); 4] = [
            ("cd51", "the CD player"),
            ("patrol", "`patrol.esm`"),
            ("follow_wall", "`follow_wall.esm`"),
            ("largest", "64 regions, 8 deep, 16 transitions a state"),
        ];
        let verify = MISSIONS
            .map(|(row, name)| (format!("verify-{row}"), format!("check, a byte of {name}")));
        let start = MISSIONS.map(|(row, name)| (format!("start-{row}"), format!("swap to {name}")));
        Table {
            title: "Check and swap",
            note: "A check is the verifier's, a byte of the mission. A swap is the interpreter's part: from the mission before to the end of the first macro step.".to_owned(),
            head: self.heads("what"),
            rows: self.rows_of(verify.into_iter().chain(start).collect()),
        }
    }
}

impl Table {
    /// The rows with equal widths of columns; `ruled` as Markdown wants it.
    fn aligned(&self, between: &str, ruled: bool) -> String {
        let mut widths = vec![0; self.head.len()];
        for row in std::iter::once(&self.head).chain(&self.rows) {
            for (width, cell) in widths.iter_mut().zip(row) {
                *width = cell.chars().count().max(*width);
            }
        }
        let line = |row: &[String]| {
            let cells: Vec<String> = row
                .iter()
                .zip(&widths)
                .enumerate()
                .map(|(column, (cell, width))| match column {
                    0 => format!("{cell:<width$}"),
                    _ => format!("{cell:>width$}"),
                })
                .collect();
            let cells = cells.join(between);
            if ruled {
                format!("| {cells} |\n")
            } else {
                format!("{}\n", cells.trim_end())
            }
        };
        let mut text = line(&self.head);
        if ruled {
            let rules = widths
                .iter()
                .enumerate()
                .map(|(column, width)| match column {
                    0 => "-".repeat(*width),
                    _ => format!("{}:", "-".repeat(width.saturating_sub(1))),
                });
            text += &line(&rules.collect::<Vec<_>>());
        }
        for row in &self.rows {
            text += &line(row);
        }
        text
    }
}
