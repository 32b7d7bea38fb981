//! The report: what was measured, as tables, and what was promised of it.

use crate::benchmark::charts::{self, DEPTHS, GUARDS, LEVELS, REGIONS, TRANSITIONS};
use crate::benchmark::limits::{self, Bound, Promise};
use crate::benchmark::measured::Measured;
use crate::benchmark::table::{Table, grouped, number};

/// What the command is that measures all of it again.
pub const COMMAND: &str = "cargo xtask bench";

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

/// An engine that reads a chart when it starts.
pub struct Interpreting {
    /// How its row ends.
    pub row: String,
    /// For people, with its version.
    pub name: String,
    /// What runs it.
    pub by: String,
    /// What it took, or why there is nothing.
    pub measured: Result<Measured, String>,
}

impl Interpreting {
    /// Whether it performs what a chart says, actions and initial states included. The simulator of
    /// scxml does not.
    fn performs(&self) -> bool {
        self.row != "scxml"
    }
}

/// A swap through the firmware, in instructions.
pub struct Swap {
    /// The mission that it leads to.
    pub mission: String,
    /// Of the link: from the last byte of the request to the mission's being handed over, its check
    /// included.
    pub link: f64,
    /// Of the interpreter's slot: until the first macro step is over.
    pub slot: f64,
}

/// Sizes that tables and memory have, in bytes.
pub struct Sizes {
    /// By mission: bytes of transitions, guards and actions for each transition, the player first.
    pub transition: Vec<(String, f64)>,
    /// Bytes of RAM that one more region takes, flags aside.
    pub region: f64,
    /// Of flash, at `-Os`: interpreter, verifier and dispatcher.
    pub flash: Option<u32>,
    /// Of the player as a mission, names included.
    pub player_blob: usize,
    /// Of memory that its machine takes.
    pub player_ram: usize,
    /// Of the interpreter's own variables.
    pub interpreter_ram: u32,
    /// Of a program with interpreter and verifier, for speed and for size.
    pub interpreter: [u32; 2],
}

/// Everything that is told.
pub struct Report {
    /// The day.
    pub date: String,
    /// The compiler of all programs.
    pub compiler: String,
    /// What the board's programs are built for.
    pub target: String,
    /// What the emulator says of itself.
    pub emulator: String,
    /// What valgrind says of itself.
    pub valgrind: String,
    /// What was left out, and how to have it; empty if nothing was.
    pub left_out: String,
    /// The board for speed, the board for size, the host in instructions, the host in nanoseconds.
    pub settings: [Setting; 4],
    /// The first three of these with reads that are checked, as far as [`CHECKED`] needs them.
    pub checked: [Setting; 3],
    /// Bytes of a program with interpreter and verifier whose reads are checked, for speed and for
    /// size.
    pub checked_interpreter: [u32; 2],
    /// The engines, of which the first does nothing.
    pub engines: Vec<Engine>,
    /// Engines that read a chart when they start.
    pub interpreting: Vec<Interpreting>,
    /// Swaps through the firmware.
    pub swaps: Vec<Swap>,
    /// Sizes.
    pub sizes: Sizes,
    /// Events of a pass through the script.
    pub events: u32,
}

/// Ways to have nothing to do: how the rows begin, and what the same takes without any region.
#[derive(Clone, Copy)]
enum Idle {
    /// A pulse, and no flag has changed.
    Still,
    /// A pulse, and a flag has changed that no region looks at but the panel's.
    Stirred,
    /// An event that all see and none waits for.
    Unheard,
}

impl Idle {
    const ALL: [Idle; 3] = [Idle::Still, Idle::Stirred, Idle::Unheard];

    fn prefix(self) -> &'static str {
        match self {
            Idle::Still => "still",
            Idle::Stirred => "stirred",
            Idle::Unheard => "unheard",
        }
    }

    /// The row of the same with no region but the panel's; of a pulse at rest, of nothing at all.
    fn without(self) -> &'static str {
        match self {
            Idle::Still => "idle-nothing",
            Idle::Stirred => "stirred-none",
            Idle::Unheard => "unheard-none",
        }
    }

    fn name(self) -> &'static str {
        match self {
            Idle::Still => "pulse while nothing changes",
            Idle::Stirred => "pulse after a flag of others has changed",
            Idle::Unheard => "event that is seen and not waited for",
        }
    }

    fn took(
        self,
        measured: &Measured,
        regions: usize,
        depth: usize,
        transitions: usize,
    ) -> Option<f64> {
        measured.event(&format!(
            "{}-{regions}-{depth}-{transitions}",
            self.prefix()
        ))
    }

    /// What the first region adds, with all that is in it: for a pulse at rest, the whole macro
    /// step.
    fn first(self, measured: &Measured, depth: usize, transitions: usize) -> Option<f64> {
        Some(self.took(measured, 1, depth, transitions)? - measured.event(self.without())?)
    }

    /// The most that one further region adds, side by side or inside: each level of a nested one is
    /// a region.
    fn further(self, measured: &Measured, depth: usize, transitions: usize) -> Option<f64> {
        let mut most: Option<f64> = None;
        let mut add = |more: f64, regions: usize| {
            let each = more / regions as f64;
            most = Some(most.map_or(each, |most| most.max(each)));
        };
        for pair in REGIONS.windows(2) {
            let &[fewer, more] = pair else { continue };
            let took = |regions| self.took(measured, regions, depth, transitions);
            add(took(more)? - took(fewer)?, (more - fewer) * depth);
        }
        if depth > 1 {
            let shallow = self.took(measured, 1, 1, transitions)?;
            add(
                self.took(measured, 1, depth, transitions)? - shallow,
                depth - 1,
            );
        }
        most
    }
}

/// The most of some figures; none if one is missing.
fn most(figures: impl IntoIterator<Item = Option<f64>>) -> Option<f64> {
    figures
        .into_iter()
        .try_fold(f64::NEG_INFINITY, |most, figure| Some(most.max(figure?)))
        .filter(|most| most.is_finite())
}

const HARNESS: &str = "cd51-nothing";
const OURS: &str = "cd51-esm";
/// The player without its region, so that no one receives an event.
const DEAF: &str = "cd51-deaf";
/// The player that sends no event.
const MUTE: &str = "cd51-mute";

/// What is measured with checked reads, too: what it is called, the row, and what is taken off.
pub const CHECKED: [(&str, &str, &str); 7] = [
    ("CD player: macro step", OURS, HARNESS),
    ("CD player: event micro step", OURS, DEAF),
    (
        "pulse while nothing changes, one region",
        "still-1-1-1",
        "idle-nothing",
    ),
    (
        "event with a transition in each of 64 regions",
        "storm-64",
        "unheard-none",
    ),
    (
        "event that 64 regions see and do not wait for",
        "unheard-64-1-1",
        "unheard-none",
    ),
    (
        "12 terms of a guard joined by `and`, task with 12 flags",
        "guard-few",
        "guard-few-none",
    ),
    (
        "12 terms of a guard, `or` in pairs joined by `and`",
        "guard-mixed",
        "guard-none",
    ),
];

impl Report {
    /// For a terminal.
    pub fn text(&self) -> String {
        let tables: String = self.tables().iter().map(Table::text).collect();
        self.head() + &tables
    }

    /// For the documentation.
    pub fn markdown(&self) -> String {
        let tables: String = self.tables().iter().map(Table::markdown).collect();
        format!("# Benchmarks of state machines\n\n{}{tables}", self.head())
    }

    /// What was promised, and what came of it.
    pub fn promises(&self) -> Vec<Promise> {
        let fast = &self.settings[0].measured;
        let mut promises = Vec::new();
        let mut promise = |what: String, bound: Bound, figure: Option<f64>| {
            promises.push(Promise {
                what,
                bound,
                figure,
            });
        };
        let m4 = |what: &str| format!("M4 -O2, instructions: {what}");
        promise(
            m4("CD player, event micro step: macro step less the same with no receiver"),
            Bound::AtMost(110.0),
            fast.difference(OURS, DEAF),
        );
        promise(
            m4("CD player, macro step from flag through event to transition"),
            Bound::AtMost(310.0),
            fast.difference(OURS, HARNESS),
        );
        for idle in Idle::ALL {
            promise(
                m4(&format!("{}, one region", idle.name())),
                Bound::AtMost(40.0),
                most(TRANSITIONS.map(|transitions| idle.first(fast, 1, transitions))),
            );
            let further = DEPTHS.into_iter().flat_map(|depth| {
                TRANSITIONS.map(|transitions| idle.further(fast, depth, transitions))
            });
            promise(
                m4(&format!("{}, each further region", idle.name())),
                Bound::AtMost(12.0),
                most(further),
            );
        }
        let player = self.sizes.transition.first();
        promise(
            "CD player, bytes of blob a transition".to_owned(),
            Bound::AtMost(10.0),
            player.map(|(_, bytes)| *bytes),
        );
        promise(
            "bytes of RAM a region, flags aside".to_owned(),
            Bound::AtMost(8.0),
            Some(self.sizes.region),
        );
        promise(
            "bytes of flash at -Os: interpreter, verifier and dispatcher".to_owned(),
            Bound::AtMost(10_752.0),
            self.sizes.flash.map(f64::from),
        );
        promise(
            "host: CD player, millions of events a second".to_owned(),
            Bound::AtLeast(20.0),
            self.settings[3].measured.event(OURS).map(|ns| 1e3 / ns),
        );
        // Where no other one could be measured, the table of engines says why, and the promise is
        // one that nobody knows to hold.
        promise(
            "host: times as fast as the fastest other interpreting engine".to_owned(),
            Bound::AtLeast(10.0),
            self.times_faster(),
        );
        promises
    }

    /// How many times as long as ours the fastest other engine takes that interprets.
    fn times_faster(&self) -> Option<f64> {
        let ours = self.settings[3].measured.event(OURS)?;
        let performing = self.interpreting.iter().filter(|engine| engine.performs());
        let others = performing.filter_map(|engine| {
            let measured = engine.measured.as_ref().ok()?;
            measured.event(&format!("cd51-{}", engine.row))
        });
        others.min_by(f64::total_cmp).map(|least| least / ours)
    }

    fn head(&self) -> String {
        let left_out = match &self.left_out[..] {
            "" => String::new(),
            left_out => format!("\n{left_out}"),
        };
        format!(
            "Measured on {} by `{COMMAND} --write`, with {}; `lto = \"fat\"`, one codegen unit, `panic = \"abort\"`.\n\
             M4: instructions on {}, machine mps2-an386, code for {}, `-icount`. Host: instructions under {}, and\n\
             nanoseconds, the shortest of ten measurements, at `-O2`. Counts repeat exactly; nanoseconds depend on the machine and on who else uses it;\n\
             a dash stands where a difference of them drowns in that, and where there is nothing to measure. Nothing is told unless each machine has done what\n\
             its chart says: actions of each engine by kind, transitions of ours by the states that they lead from and to.{left_out}\n",
            self.date, self.compiler, self.emulator, self.target, self.valgrind
        )
    }

    fn tables(&self) -> Vec<Table> {
        let mut tables = vec![
            limits::table(&self.promises()),
            self.player(),
            self.unheard(),
            self.speed(),
            self.sizes(),
        ];
        tables.extend(Idle::ALL.map(|idle| self.idle(idle)));
        tables.push(self.shapes());
        tables.push(self.checks());
        tables.push(self.swap());
        if !self.swaps.is_empty() {
            tables.push(self.firmware());
        }
        tables
    }

    /// What an event of a row takes, in each setting, less what one of another row does: the
    /// harness, or the same with less to do.
    fn net(&self, row: &str, less: &str) -> Vec<String> {
        let of = |setting: &Setting| {
            let net = setting.measured.difference(row, less);
            // Differences of nanoseconds can drown in what disturbs both.
            number(net.filter(|net| *net >= 0.0))
        };
        self.settings.iter().map(of).collect()
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
        let mut rows: Vec<_> = self
            .engines
            .iter()
            .skip(1)
            .map(|engine| {
                named(
                    &engine.name,
                    self.net(&format!("cd51-{}", engine.row), HARNESS),
                )
            })
            .collect();
        for (name, cells) in [
            (
                "ours: macro step, from flag through event to transition",
                self.net(OURS, HARNESS),
            ),
            (
                "ours: event micro step: less the same without the player's region, so that no one receives",
                self.net(OURS, DEAF),
            ),
            (
                "ours: less the same that sends no event",
                self.net(OURS, MUTE),
            ),
            (
                "ours: setting or clearing a flag, which is part of each macro step",
                self.own("set-cd51"),
            ),
            ("(the harness, which is taken off above)", self.own(HARNESS)),
        ] {
            rows.push(named(name, cells));
        }
        Table {
            title: "CD player, an event".to_owned(),
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
            let row = format!("idle-{}", engine.row);
            rows.push(named(&engine.name, self.net(&row, "idle-nothing")));
        }
        for (row, less, name) in [
            (
                "still-1-1-1",
                "idle-nothing",
                "ours: pulse while nothing changes, one region and the panel's",
            ),
            (
                "stirred-1-1-1",
                "stirred-none",
                "ours: pulse after a flag of others has changed: what one region adds",
            ),
            (
                "unheard-1-1-1",
                "unheard-none",
                "ours: event that one region sees and does not wait for: what it adds",
            ),
            (
                "stirred-none",
                "idle-nothing",
                "ours: setting a flag, and a pulse on which the panel's region looks at it in vain",
            ),
        ] {
            rows.push(named(name, self.net(row, less)));
        }
        Table {
            title: "Nothing to do".to_owned(),
            note: "An event that nothing waits for in the state that is current; of ours, a pulse, too."
                .to_owned(),
            head: self.heads("engine"),
            rows,
        }
    }

    fn speed(&self) -> Table {
        let compiled: Vec<_> = self
            .engines
            .iter()
            .skip(1)
            .map(|engine| (engine.row, engine.name.clone()))
            .collect();
        speed(&self.settings[3].measured, &compiled, &self.interpreting)
    }

    fn sizes(&self) -> Table {
        let [empty_fast, empty_small] = self.engines.first().map_or([0, 0], |engine| engine.flash);
        let less = |bytes: u32, empty: u32| grouped(&bytes.saturating_sub(empty).to_string());
        let mut rows = Vec::new();
        for engine in self.engines.iter().skip(1) {
            let [fast, small] = engine.flash;
            let ram = engine
                .ram
                .map_or_else(|| "–".to_owned(), |bytes| bytes.to_string());
            let none = || "0".to_owned();
            rows.push(vec![
                engine.name.clone(),
                none(),
                none(),
                less(fast, empty_fast),
                less(small, empty_small),
                ram,
            ]);
        }
        let [fast, small] = self.sizes.interpreter;
        let blob = grouped(&self.sizes.player_blob.to_string());
        rows.push(vec![
            "ours".to_owned(),
            less(fast, empty_fast),
            less(small, empty_small),
            blob.clone(),
            blob,
            format!("{} + {}", self.sizes.player_ram, self.sizes.interpreter_ram),
        ]);
        let transitions: Vec<String> = self
            .sizes
            .transition
            .iter()
            .map(|(mission, bytes)| format!("{mission} {bytes:.1}"))
            .collect();
        Table {
            title: "Flash and RAM of the player, bytes".to_owned(),
            note: format!(
                "Programs on the board less the one that does nothing. Of ours, interpreter and verifier are there once for all machines, and a machine is its mission, names included;\n\
                 its RAM is the machine's state and the interpreter's own variables. The cell pointer of the counters is in all. `cargo xtask size` has the firmware's parts. A transition of ours takes,\n\
                 guards and actions included: {}.",
                transitions.join(", ")
            ),
            head: [
                "engine",
                "engine -O2",
                "engine -Os",
                "machine -O2",
                "machine -Os",
                "RAM",
            ]
            .map(str::to_owned)
            .to_vec(),
            rows,
        }
    }

    fn idle(&self, idle: Idle) -> Table {
        let (title, what) = match idle {
            Idle::Still => (
                "Idle pulse",
                "A macro step at a pulse that enables nothing, while no flag has changed since the last one; *first* is this of one region, less the harness.",
            ),
            Idle::Stirred => (
                "Idle pulse after a change",
                "The same after a flag has changed that only a guard of the panel's region looks at, and that enables nothing. The change is counted; *first* is what is more than without any region but the panel's.",
            ),
            Idle::Unheard => (
                "Idle event",
                "A macro step in which the panel sends an event that all regions see and none waits for in its current state, which has transitions on another one. *First* is what is more than without any region but the panel's.",
            ),
        };
        let fast = &self.settings[0].measured;
        let mut rows = Vec::new();
        for depth in DEPTHS {
            for transitions in TRANSITIONS {
                let mut row = vec![depth.to_string(), transitions.to_string()];
                row.extend(
                    REGIONS.map(|regions| number(idle.took(fast, regions, depth, transitions))),
                );
                for setting in &self.settings[..3] {
                    row.push(number(idle.first(&setting.measured, depth, transitions)));
                    row.push(number(idle.further(&setting.measured, depth, transitions)));
                }
                rows.push(row);
            }
        }
        let mut head = vec!["depth".to_owned(), "transitions a state".to_owned()];
        head.extend(REGIONS.map(|regions| format!("{}, {regions}", self.settings[0].name)));
        for setting in &self.settings[..3] {
            head.push(format!("{}, first", setting.name));
            head.push(format!("{}, each further", setting.name));
        }
        Table {
            title: title.to_owned(),
            note: format!(
                "{what}\nColumns with a number: so many regions side by side, each with states inside each other as deep as the row says. *Each further*: the most that one region more adds, \
                 side by side or inside; each level counts as a region."
            ),
            head,
            rows,
        }
    }

    fn shapes(&self) -> Table {
        let mut rows = vec![named("event that nobody sees", self.own("unheard-none"))];
        for regions in REGIONS {
            rows.push(named(
                &format!("event with a transition in each region: regions: {regions}"),
                self.own(&format!("storm-{regions}")),
            ));
        }
        let [.., fewer, more] = REGIONS;
        let each = |setting: &Setting| {
            let all = (format!("storm-{more}"), format!("storm-{fewer}"));
            Some(setting.measured.difference(&all.0, &all.1)? / (more - fewer) as f64)
        };
        rows.push(named(
            &format!("… each of these {more}"),
            self.settings
                .iter()
                .map(|setting| number(each(setting)))
                .collect(),
        ));
        for level in 1..=LEVELS {
            rows.push(named(
                &format!("{LEVELS} states inside each other, transition at level {level}"),
                self.own(&format!("deep-{level}")),
            ));
        }
        for (row, says, none) in GUARDS {
            let name = format!("pulse after a change, {says}");
            rows.push(named(&name, self.own(row)));
            rows.push(named("… more than without", self.net(row, none)));
        }
        Table {
            title: "Macro steps of other shapes".to_owned(),
            note: "The panel's own transition, which sends the event, is counted.".to_owned(),
            head: self.heads("macro step"),
            rows,
        }
    }

    /// The same code with checked reads beside it.
    fn checks(&self) -> Table {
        let checked = |name: &str| {
            let found = self.checked.iter().find(|checked| checked.name == name);
            found.map(|checked| &checked.measured)
        };
        let mut head = vec!["figure".to_owned()];
        for Setting { name, .. } in &self.settings[..3] {
            head.push(format!("{name}, unchecked"));
            head.push(format!("{name}, checked"));
        }
        let mut rows: Vec<_> = CHECKED
            .into_iter()
            .map(|(name, row, less)| {
                let mut cells = Vec::new();
                for Setting { name, measured } in &self.settings[..3] {
                    cells.push(number(measured.difference(row, less)));
                    let checked = checked(name).and_then(|checked| checked.difference(row, less));
                    cells.push(number(checked));
                }
                named(name, cells)
            })
            .collect();
        let [empty, ..] = &self.engines[..] else {
            return Table::default();
        };
        let mut flash = Vec::new();
        for (setting, empty) in empty.flash.iter().enumerate() {
            for bytes in [
                self.sizes.interpreter[setting],
                self.checked_interpreter[setting],
            ] {
                flash.push(number(Some(f64::from(bytes.saturating_sub(*empty)))));
            }
        }
        flash.extend(["–", "–"].map(str::to_owned));
        rows.push(named("flash of interpreter and verifier, bytes", flash));
        Table {
            title: "Reads that are not checked".to_owned(),
            note: "The verifier proves once what the interpreter's reads rest on. Without the feature `unchecked` of `esm-core`, each is checked again and there is no `unsafe` in it."
                .to_owned(),
            head,
            rows,
        }
    }

    fn swap(&self) -> Table {
        const MISSIONS: [(&str, &str); 5] = [
            ("cd51", "the CD player"),
            ("patrol", "`patrol.esm`"),
            ("follow_wall", "`follow_wall.esm`"),
            ("watch_timing", "`watch_timing.esm`"),
            ("largest", "64 regions, 8 deep, 16 transitions a state"),
        ];
        let verify = MISSIONS.map(|(row, name)| {
            named(
                &format!("check, a byte of {name}"),
                self.own(&format!("verify-{row}")),
            )
        });
        let start = MISSIONS.map(|(row, name)| {
            named(
                &format!("swap to {name}"),
                self.own(&format!("start-{row}")),
            )
        });
        Table {
            title: "Check and swap".to_owned(),
            note: "A check is the verifier's, a byte of the mission. A swap is the interpreter's part: from the mission before to the end of the first macro step.".to_owned(),
            head: self.heads("what"),
            rows: verify.into_iter().chain(start).collect(),
        }
    }

    fn firmware(&self) -> Table {
        let row = |swap: &Swap| {
            vec![
                swap.mission.clone(),
                number(Some(swap.link)),
                number(Some(swap.slot)),
            ]
        };
        Table {
            title: "Swap in the firmware".to_owned(),
            note: "Instructions on the default board (lm3s6965, Cortex-M3, `opt-level = \"z\"`). On the link: what the request to commit takes, its answer aside; the mission is checked against its own sums, \
                   the rules of the tables, and what the robot has. In the slot: from the timer's\n\
                   interrupt in which one mission follows another to the end of the new one's first macro step. Between the two the robot waits for the interpreter's next slot. What the link takes differs by some percent from run to run, with when bytes arrive and slots come."
                .to_owned(),
            head: ["mission", "on the link", "in the interpreter's slot"].map(str::to_owned).to_vec(),
            rows: self.swaps.iter().map(row).collect(),
        }
    }
}

/// Events a second on the host: of compiled engines, by row and name, of ours, and of others that
/// read a chart when they start.
pub fn speed(time: &Measured, compiled: &[(&str, String)], interpreting: &[Interpreting]) -> Table {
    let ours = time.event(OURS);
    let row = |name: &str, what: &str, measured: &Measured, row: &str| {
        let a_second = |ns: Option<f64>| number(ns.map(|ns| 1e9 / ns));
        let ratio = measured
            .event(row)
            .zip(ours)
            .map(|(other, ours)| other / ours);
        vec![
            name.to_owned(),
            what.to_owned(),
            number(measured.event(row)),
            a_second(measured.event(row)),
            a_second(measured.most(row)),
            number(ratio),
        ]
    };
    let mut rows: Vec<_> = compiled
        .iter()
        .map(|(engine, name)| row(name, "compiled, Rust", time, &format!("cd51-{engine}")))
        .collect();
    rows.push(row("ours", "interprets, Rust", time, OURS));
    for engine in interpreting {
        let verb = if engine.performs() {
            "interprets"
        } else {
            "looks up"
        };
        let what = format!("{verb}, {}", engine.by);
        rows.push(match &engine.measured {
            Ok(measured) => row(
                &engine.name,
                &what,
                measured,
                &format!("cd51-{}", engine.row),
            ),
            Err(reason) => {
                let mut cells = vec![engine.name.clone(), format!("{what}: {reason}")];
                cells.extend(["–"; 4].map(str::to_owned));
                cells
            }
        });
    }
    let looks_up = interpreting.iter().any(|engine| !engine.performs());
    let remark = if looks_up {
        "\nscxml, which reads a chart as SCXML, has a simulator that looks for the transition and is not counted as an engine: it performs no actions and enters no initial states. Here, guards\n\
         count for the actions, and transitions lead to the first song itself."
    } else {
        ""
    };
    Table {
        title: "On the host: CD player, events a second".to_owned(),
        note: format!(
            "The harness included: of ten measurements the fastest, and the slowest to show how far they lie apart; compiled machines and ours three times ten, at the beginning, in the middle and at the end of the run. The last column: how many times as long as ours. Ours does more with an event\n\
             than the others: it sets a flag, sends the event and takes two transitions. Engines that interpret have read the chart before they are measured.{remark}"
        ),
        head: [
            "engine",
            "what it is",
            "ns an event",
            "events/s",
            "in the slowest measurement",
            "× ours",
        ]
        .map(str::to_owned)
        .to_vec(),
        rows,
    }
}

/// A row with its name.
fn named(name: &str, cells: Vec<String>) -> Vec<String> {
    std::iter::once(name.to_owned()).chain(cells).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What an interpreter would tell that takes 5 for a pulse and 3 for each of its regions.
    fn idle_rows() -> String {
        let mut rows = String::from("row idle-nothing 1 2\nrow stirred-none 1 40\n");
        for (regions, depth, transitions) in charts::shapes() {
            let name = format!("{regions}-{depth}-{transitions}");
            let active = regions * depth;
            rows += &format!("row still-{name} 1 {}\n", 7 + 3 * (active - 1));
            rows += &format!("row stirred-{name} 1 {}\n", 45 + 3 * (active - 1));
        }
        rows
    }

    fn measured(rows: &str) -> Measured {
        Measured::timed(rows).unwrap()
    }

    #[test]
    fn a_further_region_is_the_same_side_by_side_and_inside() {
        let measured = measured(&idle_rows());
        for depth in DEPTHS {
            for transitions in TRANSITIONS {
                let inside = 3.0 * (depth as f64 - 1.0);
                for idle in [Idle::Still, Idle::Stirred] {
                    let first = idle.first(&measured, depth, transitions);
                    assert_eq!(first, Some(5.0 + inside), "{depth} {transitions}");
                    let further = idle.further(&measured, depth, transitions);
                    assert_eq!(further, Some(3.0), "{depth} {transitions}");
                }
                assert_eq!(Idle::Unheard.further(&measured, depth, transitions), None);
            }
        }
    }

    #[test]
    fn of_further_regions_the_dearest_counts() {
        // One number of regions takes more than those around it: it is not averaged away.
        let rows = idle_rows().replace("row still-16-1-4 1 52\n", "row still-16-1-4 1 172\n");
        assert_ne!(rows, idle_rows(), "the row is there");
        assert_eq!(Idle::Still.further(&measured(&rows), 1, 4), Some(13.0));
    }

    #[test]
    fn the_most_of_figures_needs_all_of_them() {
        assert_eq!(most([Some(1.0), Some(3.0), Some(2.0)]), Some(3.0));
        assert_eq!(most([Some(1.0), None]), None);
        assert_eq!(most([]), None);
    }

    fn engine(row: &str, ns: Result<&str, &str>) -> Interpreting {
        Interpreting {
            row: row.to_owned(),
            name: row.to_owned(),
            by: "Rust".to_owned(),
            measured: ns
                .map(|ns| measured(&format!("row cd51-{row} 10 {ns}\n")))
                .map_err(str::to_owned),
        }
    }

    #[test]
    fn speeds_have_their_spread_and_what_is_absent_says_why() {
        let time = measured("row cd51-esm 10 500 510 900\nrow cd51-by-hand 10 100 120\n");
        let table = speed(
            &time,
            &[("by-hand", "by hand".to_owned())],
            &[
                engine("slow", Ok("7000 5000")),
                engine("gone", Err("no network")),
            ],
        );
        assert_eq!(
            table.rows,
            [
                [
                    "by hand",
                    "compiled, Rust",
                    "10.0",
                    "100,000,000",
                    "83,333,333",
                    "0.2"
                ],
                [
                    "ours",
                    "interprets, Rust",
                    "50.0",
                    "20,000,000",
                    "11,111,111",
                    "1.0"
                ],
                [
                    "slow",
                    "interprets, Rust",
                    "500.0",
                    "2,000,000",
                    "1,428,571",
                    "10.0"
                ],
                ["gone", "interprets, Rust: no network", "–", "–", "–", "–"],
            ]
        );
    }
}
