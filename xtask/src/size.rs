//! `cargo xtask size`: flash and RAM of the firmware, part by part, and what missions take, against
//! the sizes that the repository keeps.
//!
//! The totals are the file's sections. Interpreter, verifier and dispatcher are measured as the
//! difference of two linked images, one of which has them and does nothing else. How the rest
//! divides up is read from the symbols' names: link-time optimisation inlines across crates, so a
//! small function may count for the part that calls it.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use crate::elf::{self, Image};
use crate::firmware::{self, BOARD_FOLDER, DEFAULT_BIN};
use crate::missions;
use crate::process::Failure;
use crate::setup::Toolchain;

/// An image that verifies a blob and interprets it, and one that only has the blob.
const WITH_INTERPRETER: &str = "size_interpreter";
const WITHOUT_INTERPRETER: &str = "size_empty";

/// What a firmware may take, in bytes: the limits in `board.toml`.
struct Limits {
    flash: u32,
    /// Variables and stack together.
    ram: u32,
    stack: u32,
}

/// The section of `board.toml` with the limits of the default firmware.
pub const LIMITS: &str = "limits";
/// The section with those of the firmware without features.
pub const LEAN_LIMITS: &str = "limits.lean";
/// The section with those of the firmware for a part of silicon, where they differ.
const HARDWARE_LIMITS: &str = "limits.hardware";
/// The key, of the first section, of what interpreter, verifier and dispatcher may take of flash.
const INTERPRETER_LIMIT: &str = "interpreter_flash_bytes";

impl Limits {
    /// Those of the default board.
    fn read(root: &Path, section: &str) -> Result<Self, Failure> {
        Self::of(root, Path::new(BOARD_FOLDER), section)
    }

    /// Those of the board in a folder below the checkout.
    fn of(root: &Path, board: &Path, section: &str) -> Result<Self, Failure> {
        Ok(Limits {
            flash: number(root, board, section, "flash_bytes")?,
            ram: number(root, board, section, "ram_bytes")?,
            stack: number(root, board, section, "stack_bytes")?,
        })
    }
}

/// Whether a `board.toml` has a section.
fn has_section(root: &Path, board: &Path, section: &str) -> Result<bool, Failure> {
    let path = root.join(board).join("board.toml");
    let text = std::fs::read_to_string(&path).map_err(|cause| Failure::File { path, cause })?;
    Ok(text.contains(&format!("\n[{section}]\n")))
}

/// A number of a section of a `board.toml`.
fn number(root: &Path, board: &Path, section: &str, key: &str) -> Result<u32, Failure> {
    let path = root.join(board).join("board.toml");
    let text = std::fs::read_to_string(&path).map_err(|cause| Failure::File {
        path: path.clone(),
        cause,
    })?;
    text.lines()
        .skip_while(|line| *line != format!("[{section}]"))
        .skip(1)
        .take_while(|line| !line.starts_with('['))
        .filter_map(|line| line.split_once(" = "))
        .find_map(|(found, value)| (found == key).then(|| value.parse().ok())?)
        .ok_or(Failure::Content {
            path,
            problem: "lacks one of flash_bytes, ram_bytes, stack_bytes in its section limits or limits.lean, or interpreter_flash_bytes in the first",
        })
}

/// The rows that every compiler must come close to. How code divides up among the parts depends on
/// what a compiler inlines, so the other rows are compared only where the compiler is the one that
/// the expected sizes are of.
const FOR_EVERY_COMPILER: [&str; 2] = [INTERPRETER_ALONE, WHOLE];
const INTERPRETER_ALONE: &str = "interpreter to dispatcher alone";
const WHOLE: &str = "whole firmware";

/// How the expected sizes name their compiler.
const COMPILER_LINE: &str = "# compiler: ";

/// Sizes may differ from the expected ones by one part in this many, or by [`TOLERANCE_BYTES`]
/// where that is more: compilers differ that much from one release to the next.
const TOLERANCE_PART: u32 = 20;
/// See [`TOLERANCE_PART`].
const TOLERANCE_BYTES: u32 = 128;

/// The file of the expected sizes, in the board's folder.
const EXPECTED_FILE: &str = "expected-size.txt";

/// What the app's macro makes, by what the names contain: handlers that have their side inlined,
/// and the memory of each side.
const APP_PARTS: [(&str, &str); 9] = [
    ("TIMER_0A", "runtime"),
    ("SSI0", "link"),
    ("init_memory", "memory of missions"),
    ("init_real_time", "runtime"),
    ("init_mail", "runtime"),
    ("init_link", "link"),
    ("init_received", "link"),
    ("init_to_transmit", "link"),
    ("init_robot", "tasks and drivers"),
];

/// Parts, by what their symbols' names contain; the first that occurs in a name counts.
const PARTS: [(&str, &[&str]); 9] = [
    (
        "keys",
        &[
            "15ed25519_compact",
            "ed25519_compact..",
            "8esm_link4keys",
            "8esm_link5proof",
            "4hmac",
            "hmac..",
            "4sha2",
            "sha2..",
            "12block_buffer",
            "13generic_array",
        ],
    ),
    (
        "tasks and drivers",
        &[
            "11rt_firmware5tasks",
            "rt_firmware..tasks",
            "11rt_firmware7drivers",
            "rt_firmware..drivers",
            "11rt_firmware5rover",
            "11rt_firmware8odometry",
            "rt_firmware..ports..TaskPool",
        ],
    ),
    (
        "link",
        &[
            "11rt_firmware4link",
            "rt_firmware..link",
            "8esm_link",
            "esm_link..",
            "8postcard",
            "postcard..",
            "4cobs",
            "cobs..",
        ],
    ),
    ("runtime", &["11rt_firmware", "rt_firmware.."]),
    ("interpreter", &["8esm_core", "esm_core.."]),
    ("log", &["5defmt", "_defmt", "14cortex_m_board3log"]),
    (
        "board",
        &[
            "8lm3s6965",
            "lm3s6965..",
            "14cortex_m_board",
            "cortex_m_board..",
            "5rover",
            "11semihosting",
            "UART0",
            "__INTERRUPTS",
            "__EXCEPTIONS",
        ],
    ),
    ("arithmetic", &["4libm", "17compiler_builtins", "__aeabi"]),
    ("core", &["4core"]),
];
/// Symbols without a part, and bytes without a symbol: constants (the texts of the tasks'
/// declarations most of all), padding.
const REST: &str = "other";

/// Bytes of one part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Size {
    flash: u32,
    ram: u32,
}

/// A row of the table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Row {
    /// In the firmware with its default features.
    full: Size,
    /// In the one without.
    lean: Size,
}

impl Row {
    /// Its columns, and what they are called.
    fn columns(&self) -> [(&'static str, u32); 4] {
        [
            ("flash", self.full.flash),
            ("RAM", self.full.ram),
            ("flash without features", self.lean.flash),
            ("RAM without features", self.lean.ram),
        ]
    }
}

/// Rows of the table, by name.
type Table = BTreeMap<String, Row>;

/// Prints the sizes, and compares them with the expected ones or keeps them.
///
/// # Errors
/// [`Failure::Checks`] if a limit or a tolerance is exceeded, another [`Failure`] if the firmware
/// does not build.
pub fn command(root: &Path, toolchain: &Toolchain, write: bool) -> Result<(), Failure> {
    let mut files = firmware::build_lean(root, toolchain)?;
    files.extend(firmware::build(
        root,
        toolchain,
        firmware::RELEASE,
        &[DEFAULT_BIN.to_owned()],
    )?);
    let [lean, firmware] = &images(&files)?[..] else {
        return Ok(());
    };
    let interpreter = interpreter_flash(root, toolchain)?;
    let mut table = Table::new();
    for (part, size) in parts_of(firmware) {
        table.entry(part).or_default().full = size;
    }
    for (part, size) in parts_of(lean) {
        table.entry(part).or_default().lean = size;
    }
    let alone = Size {
        flash: interpreter,
        ram: 0,
    };
    table.insert(
        INTERPRETER_ALONE.into(),
        Row {
            full: alone,
            lean: alone,
        },
    );
    table.insert(
        WHOLE.into(),
        Row {
            full: whole(firmware),
            lean: whole(lean),
        },
    );
    let missions = missions::measure(root)?;
    let compiler = toolchain.rustc_version();
    let shown = render(&table, &missions, &compiler);
    print!("\n{shown}\n{}", largest_variables(firmware));

    let expected_file = root.join(BOARD_FOLDER).join(EXPECTED_FILE);
    let expected = std::fs::read_to_string(&expected_file).map_err(|cause| Failure::File {
        path: expected_file.clone(),
        cause,
    });
    if let Ok(expected) = &expected {
        print!("{}", changes(expected, &shown));
    }
    let expected = if write {
        std::fs::write(&expected_file, &shown).map_err(|cause| Failure::File {
            path: expected_file.clone(),
            cause,
        })?;
        println!("Kept in {}.", expected_file.display());
        shown
    } else {
        expected?
    };
    let expected = Expected::parse(&expected).ok_or(Failure::Content {
        path: expected_file,
        problem: "is no table of sizes; write it anew with `cargo xtask size --write`",
    })?;
    let mut problems = excesses("the firmware", firmware, &Limits::read(root, LIMITS)?);
    problems.extend(excesses(
        "the firmware without features",
        lean,
        &Limits::read(root, LEAN_LIMITS)?,
    ));
    let interpreter_limit = number(root, Path::new(BOARD_FOLDER), LIMITS, INTERPRETER_LIMIT)?;
    problems.extend(excess(
        "interpreter, verifier and dispatcher",
        interpreter,
        interpreter_limit,
    ));
    problems.extend(missions::excesses(&missions));
    problems.extend(expected.differences(&table, &missions, &compiler));
    for problem in &problems {
        println!("{problem}");
    }
    match problems.len() {
        0 => {
            println!(
                "All within their limits, and as expected: missions exactly, firmware within 1/{TOLERANCE_PART} or {TOLERANCE_BYTES} bytes."
            );
            Ok(())
        }
        failed => Err(Failure::Checks { failed }),
    }
}

/// Prints the sizes of another board's firmware, and of that for a part of silicon where it is
/// another, and compares them with the board's expected ones or keeps them.
///
/// # Errors
/// [`Failure::Checks`] if a limit or a tolerance is exceeded, another [`Failure`] if the firmware
/// does not build.
pub fn of_board(
    root: &Path,
    board: &str,
    toolchain: &Toolchain,
    write: bool,
) -> Result<(), Failure> {
    let mut files = firmware::build_for(root, board, toolchain, &[DEFAULT_BIN.to_owned()])?;
    if firmware::has_hardware(root, board) {
        files.extend(firmware::build_hardware(root, board, toolchain)?);
    }
    let folder = Path::new("boards").join(board);
    let limits = Limits::of(root, &folder, LIMITS)?;
    // A part may have more memory than its emulator.
    let of_hardware = match has_section(root, &folder, HARDWARE_LIMITS)? {
        true => Some(Limits::of(root, &folder, HARDWARE_LIMITS)?),
        false => None,
    };
    let mut now = format!(
        "# Flash and RAM of the firmware in bytes; kept by `cargo xtask size --board {board} --write`.\n"
    );
    let mut problems = Vec::new();
    for (file, image) in files.iter().zip(images(&files)?) {
        let name = file.file_stem().unwrap_or_default().display();
        for (part, Size { flash, ram }) in parts_of(&image) {
            println!("{name} {part:<24} {flash:>7} {ram:>7}");
        }
        let Size { flash, ram } = whole(&image);
        // Writing to a string cannot fail.
        let _ = writeln!(now, "{name} {flash} {ram}");
        let name = name.to_string();
        let limits = match &of_hardware {
            Some(of_hardware) if name.ends_with(firmware::HARDWARE_SUFFIX) => of_hardware,
            _ => &limits,
        };
        problems.extend(excesses(&name, &image, limits));
    }
    let path = root.join(folder).join(EXPECTED_FILE);
    let of_file = |cause| Failure::File {
        path: path.clone(),
        cause,
    };
    println!("\n{now}");
    if write {
        std::fs::write(&path, &now).map_err(of_file)?;
    }
    let expected = std::fs::read_to_string(&path).map_err(of_file)?;
    problems.extend(unexpected(&expected, &now));
    for problem in &problems {
        println!("{problem}");
    }
    match problems.len() {
        0 => Ok(()),
        failed => Err(Failure::Checks { failed }),
    }
}

/// The rows of a board's sizes that differ from the expected ones by more than the tolerance.
fn unexpected(expected: &str, now: &str) -> Vec<String> {
    let rows = |text: &str| -> BTreeMap<String, Vec<u32>> {
        let rows = text.lines().filter(|line| !line.starts_with('#'));
        rows.map(|row| {
            let mut words = row.split(' ');
            let name = words.next().unwrap_or_default().to_owned();
            (name, words.filter_map(|word| word.parse().ok()).collect())
        })
        .collect()
    };
    let (expected, now) = (rows(expected), rows(now));
    let names: BTreeSet<&String> = expected.keys().chain(now.keys()).collect();
    let is_near = |(now, then): (&u32, &u32)| {
        now.abs_diff(*then) <= (then / TOLERANCE_PART).max(TOLERANCE_BYTES)
    };
    let differs = |name: &&&String| match (now.get(**name), expected.get(**name)) {
        (Some(now), Some(then)) => now.len() != then.len() || !now.iter().zip(then).all(is_near),
        _ => true,
    };
    (names.iter().filter(differs))
        .map(|name| {
            format!(
                "Not as expected: {name}: {:?}, expected {:?}. If that is meant: --write",
                now.get(*name),
                expected.get(*name)
            )
        })
        .collect()
}

/// Bytes of flash that interpreter, verifier and dispatcher take, with the plain setting for size.
///
/// # Errors
/// [`Failure`]: what did not build.
pub fn interpreter_flash(root: &Path, toolchain: &Toolchain) -> Result<u32, Failure> {
    let pair = [WITH_INTERPRETER, WITHOUT_INTERPRETER].map(str::to_owned);
    let files = firmware::build(root, toolchain, firmware::SIZE, &pair)?;
    let flash: Vec<u32> = images(&files)?.iter().map(Image::flash_bytes).collect();
    match flash[..] {
        [with, without] => Ok(with.saturating_sub(without)),
        _ => Ok(0),
    }
}

/// What is in the files of firmware.
fn images(files: &[PathBuf]) -> Result<Vec<Image>, Failure> {
    let image = |file: &PathBuf| {
        let bytes = std::fs::read(file).map_err(|cause| Failure::File {
            path: file.clone(),
            cause,
        })?;
        elf::read(&bytes).ok_or_else(|| Failure::Content {
            path: file.clone(),
            problem: "is no firmware (32-bit little-endian ELF)",
        })
    };
    files.iter().map(image).collect()
}

/// Compares the deepest stack of a run, which its summary tells, with what the limits in a section
/// of `board.toml` leave room for.
///
/// # Errors
/// [`Failure::Content`] if the stack was deeper, or the summary does not tell.
pub fn check_stack(root: &Path, section: &str, summary_file: &Path) -> Result<(), Failure> {
    const KEY: &str = "\"deepest_stack_bytes\":";
    let fail = |problem| Failure::Content {
        path: summary_file.to_owned(),
        problem,
    };
    let summary = std::fs::read_to_string(summary_file).map_err(|cause| Failure::File {
        path: summary_file.to_owned(),
        cause,
    })?;
    let bytes: u32 = summary
        .split_once(KEY)
        .and_then(|(_, rest)| rest.split([',', '\n', '}']).next()?.trim().parse().ok())
        .ok_or_else(|| fail("does not tell the deepest stack"))?;
    let limit = Limits::read(root, section)?.stack;
    println!("Deepest stack: {bytes} bytes, limit {limit} ({section}).");
    if bytes > limit {
        return Err(fail("tells of a stack deeper than its limit"));
    }
    Ok(())
}

fn excesses(what: &str, firmware: &Image, limits: &Limits) -> Vec<String> {
    [
        excess(
            &format!("flash of {what}"),
            firmware.flash_bytes(),
            limits.flash,
        ),
        excess(
            &format!("variables in RAM of {what}, beside the stack"),
            firmware.ram_bytes(),
            limits.ram.saturating_sub(limits.stack),
        ),
    ]
    .into_iter()
    .flatten()
    .collect()
}

fn excess(what: &str, bytes: u32, limit: u32) -> Option<String> {
    (bytes > limit).then(|| format!("Too large: {what}: {bytes} bytes, limit {limit}"))
}

/// All of a firmware's bytes.
fn whole(image: &Image) -> Size {
    Size {
        flash: image.flash_bytes(),
        ram: image.ram_bytes(),
    }
}

/// Bytes of flash and of RAM that a program takes.
///
/// # Errors
/// [`Failure`]: the file cannot be read, or is no program.
pub fn of_file(file: &Path) -> Result<(u32, u32), Failure> {
    let images = images(&[file.to_owned()])?;
    Ok((images.iter()).fold((0, 0), |_, image| (image.flash_bytes(), image.ram_bytes())))
}

/// How a firmware's bytes divide up.
fn parts_of(image: &Image) -> BTreeMap<String, Size> {
    let mut table = BTreeMap::<String, Size>::new();
    for symbol in &image.symbols {
        let address = symbol.address & !1;
        let section = image
            .sections
            .iter()
            .find(|section| (section.address..section.address + section.bytes).contains(&address));
        let Some(section) = section else { continue };
        let size = table.entry(part_of(&symbol.name).to_owned()).or_default();
        if section.has_content {
            size.flash += symbol.bytes;
        }
        if section.writable {
            size.ram += symbol.bytes;
        }
    }
    let sum = |of: fn(&Size) -> u32| table.values().map(of).sum::<u32>();
    let rest = Size {
        flash: image.flash_bytes().saturating_sub(sum(|size| size.flash)),
        ram: image.ram_bytes().saturating_sub(sum(|size| size.ram)),
    };
    let other = table.entry(REST.into()).or_default();
    other.flash += rest.flash;
    other.ram += rest.ram;
    table
}

/// The part whose mark occurs first in a symbol's name.
fn part_of(name: &str) -> &'static str {
    if let Some((_, part)) = APP_PARTS.iter().find(|(mark, _)| name.contains(mark)) {
        return part;
    }
    PARTS
        .iter()
        .flat_map(|(part, marks)| {
            marks
                .iter()
                .filter_map(|mark| Some((name.find(mark)?, *part)))
        })
        .min_by_key(|(place, _)| *place)
        .map_or(REST, |(_, part)| part)
}

fn render(table: &Table, missions: &missions::Table, compiler: &str) -> String {
    let mut text = String::from(
        "# Flash and RAM of the default firmware, with its features and without (lean), and what missions take, in bytes; kept by `cargo xtask size --write`, compared by `cargo xtask test`.\n",
    );
    // Writing to a string cannot fail.
    let _ = writeln!(text, "{COMPILER_LINE}{compiler}");
    let _ = writeln!(
        text,
        "{:<32} {:>7} {:>7} {:>10} {:>8}",
        "# part", "flash", "ram", "lean-flash", "lean-ram"
    );
    for (part, Row { full, lean }) in table {
        let _ = writeln!(
            text,
            "{part:<32} {:>7} {:>7} {:>10} {:>8}",
            full.flash, full.ram, lean.flash, lean.ram
        );
    }
    text + &missions::render(missions)
}

/// The rows that are not as expected, as they were and as they are; what differs less than the
/// tolerance is among them.
fn changes(expected: &str, now: &str) -> String {
    let mut text = String::new();
    for (sign, lines, others) in [('-', expected, now), ('+', now, expected)] {
        let is_new = |line: &&str| !others.lines().any(|other| other == *line);
        let told = |line: &&str| !line.starts_with('#') || line.starts_with(COMPILER_LINE);
        for line in lines.lines().filter(told).filter(is_new) {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "{sign} {line}");
        }
    }
    if text.is_empty() {
        return text;
    }
    format!("Other than in the expected sizes (`cargo xtask size --write` keeps them):\n{text}")
}

/// What takes most of RAM, for a person who has to save some.
fn largest_variables(image: &Image) -> String {
    const SHOWN: usize = 12;
    let mut variables: Vec<_> = image
        .symbols
        .iter()
        .filter(|symbol| {
            image.sections.iter().any(|section| {
                section.writable
                    && (section.address..section.address + section.bytes).contains(&symbol.address)
            })
        })
        .collect();
    variables.sort_by_key(|symbol| std::cmp::Reverse(symbol.bytes));
    let mut text = String::from("Largest variables in RAM:\n");
    for symbol in variables.iter().take(SHOWN) {
        let _ = writeln!(text, "{:>7}  {}", symbol.bytes, symbol.name);
    }
    text
}

/// The expected sizes.
#[derive(Debug, PartialEq)]
struct Expected {
    firmware: Table,
    missions: missions::Table,
    compiler: Option<String>,
}

impl Expected {
    /// What [`render`] wrote.
    fn parse(text: &str) -> Option<Self> {
        let is_head = |line: &&str| line.starts_with(missions::HEAD);
        let rows = |line: &&str| !line.starts_with('#');
        let compiler = text
            .lines()
            .find_map(|line| line.strip_prefix(COMPILER_LINE));
        Some(Self {
            firmware: parse(text.lines().take_while(|line| !is_head(line)).filter(rows))?,
            missions: missions::parse(text.lines().skip_while(|line| !is_head(line)).filter(rows))?,
            compiler: compiler.map(str::to_owned),
        })
    }

    /// What differs, of the firmware by more than the tolerance.
    fn differences(
        &self,
        table: &Table,
        missions: &missions::Table,
        compiler: &str,
    ) -> Vec<String> {
        const MEANT: &str = "If that is meant: `cargo xtask size --write`.";
        let same_compiler = self.compiler.as_deref() == Some(compiler);
        let mut problems = Vec::new();
        let names: BTreeSet<_> = self.firmware.keys().chain(table.keys()).collect();
        for name in names {
            if !same_compiler && !FOR_EVERY_COMPILER.contains(&name.as_str()) {
                continue;
            }
            let now = table.get(name).copied().unwrap_or_default();
            let then = self.firmware.get(name).copied().unwrap_or_default();
            for ((what, now), (_, then)) in now.columns().into_iter().zip(then.columns()) {
                if now.abs_diff(then) > (then / TOLERANCE_PART).max(TOLERANCE_BYTES) {
                    problems.push(format!(
                        "Not as expected: {name}: {now} bytes of {what}, expected {then}. {MEANT}"
                    ));
                }
            }
        }
        let names: BTreeSet<_> = self.missions.keys().chain(missions.keys()).collect();
        for name in names {
            // A compiler of Rust changes nothing in a mission.
            if self.missions.get(name) != missions.get(name) {
                problems.push(format!("Not as expected: {name}. {MEANT}"));
            }
        }
        problems
    }
}

/// Rows of the firmware's part.
fn parse<'t>(lines: impl Iterator<Item = &'t str>) -> Option<Table> {
    let mut table = Table::new();
    for line in lines {
        let mut name = line;
        let mut last = || {
            let (rest, number) = name.trim_end().rsplit_once(' ')?;
            name = rest;
            number.parse().ok()
        };
        let (lean_ram, lean_flash, ram, flash) = (last()?, last()?, last()?, last()?);
        let row = Row {
            full: Size { flash, ram },
            lean: Size {
                flash: lean_flash,
                ram: lean_ram,
            },
        };
        table.insert(name.trim_end().to_owned(), row);
    }
    Some(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_reads_back_as_it_was_written() {
        let table: Table = [
            ("whole firmware", [91_234, 22_345, 61_234, 12_345]),
            ("link", [0, 7, 0, 5]),
        ]
        .map(|(name, [flash, ram, lean_flash, lean_ram])| {
            let row = Row {
                full: Size { flash, ram },
                lean: Size {
                    flash: lean_flash,
                    ram: lean_ram,
                },
            };
            (name.to_owned(), row)
        })
        .into();
        let missions = missions::parse(["cd51 1022 8.37 96.00"].into_iter()).unwrap();
        let expected = Expected::parse(&render(&table, &missions, "rustc 1")).unwrap();
        assert_eq!(expected.differences(&table, &missions, "rustc 1"), [""; 0]);
        assert_eq!(
            expected,
            Expected {
                firmware: table,
                missions,
                compiler: Some("rustc 1".to_owned())
            }
        );
        assert_eq!(Expected::parse("no table"), None);
    }

    #[test]
    fn firmware_may_differ_a_little_and_missions_may_not() {
        let of = |flash: u32| {
            let row = Row {
                full: Size { flash, ram: 0 },
                ..Row::default()
            };
            Table::from([(WHOLE.to_owned(), row), ("link".to_owned(), row)])
        };
        let missions = |transition: &str| {
            missions::parse([format!("cd51 1022 {transition} 96.00").as_str()].into_iter()).unwrap()
        };
        let expected = Expected {
            firmware: of(10_000),
            missions: missions("8.37"),
            compiler: Some("rustc 1".to_owned()),
        };
        for (flash, transition, compiler, problems) in [
            (10_000, "8.37", "rustc 1", 0),
            (10_500, "8.37", "rustc 1", 0),
            (9_500, "8.37", "rustc 1", 0),
            (10_501, "8.37", "rustc 1", 2),
            // How the parts divide up is one compiler's business.
            (10_501, "8.37", "rustc 2", 1),
            (10_000, "8.38", "rustc 2", 1),
        ] {
            let found = expected.differences(&of(flash), &missions(transition), compiler);
            assert_eq!(
                found.len(),
                problems,
                "{flash} {transition} {compiler}: {found:?}"
            );
        }
    }

    #[test]
    fn what_changed_is_shown_as_it_was_and_as_it_is() {
        assert_eq!(changes("a 1\nb 2\n", "a 1\nb 2\n"), "");
        let shown = changes("a 1\nb 2\n", "a 1\nb 3\nc 4\n");
        let lines: Vec<&str> = shown.lines().skip(1).collect();
        assert_eq!(lines, ["- b 2", "+ b 3", "+ c 4"]);
    }

    #[test]
    fn a_symbol_counts_for_the_part_that_is_named_first() {
        for (name, part) in [
            ("_ZN11rt_firmware4link6device8LinkSide4poll17h24d3E", "link"),
            ("_ZN11rt_firmware9real_time8RealTime3run17h24d3E", "runtime"),
            ("_ZN8esm_core6verify6verify17h24d3E", "interpreter"),
            (
                "_ZN4core3ptr41drop_in_place$LT$rt_firmware..link..X$GT$17h0E",
                "core",
            ),
            (
                "_RNvNtCseL1MqMlhvy0_17compiler_builtins3mem6memcpy",
                "arithmetic",
            ),
            (
                "_ZN86_$LT$rt_firmware..ports..TaskPool$LT$T$C$_$GT$$u20$as$u20$X$GT$4step17h0E",
                "tasks and drivers",
            ),
            (
                "_ZN5rover3app33__rtic_internal_local_init_memory17h42adE",
                "memory of missions",
            ),
            ("TIMER_0A", "runtime"),
            ("something_else", "other"),
        ] {
            assert_eq!(part_of(name), part, "{name}");
        }
    }

    #[test]
    fn sizes_of_a_board_may_differ_from_the_expected_by_the_tolerance() {
        let expected = "# sizes\nrover 200000 90000\nrover-hardware 220000 90000\n";
        let near = "rover 209999 90001\nrover-hardware 220000 90000\n";
        assert_eq!(unexpected(expected, near), [] as [String; 0]);
        for (now, name) in [
            (
                "rover 210001 90000\nrover-hardware 220000 90000\n",
                "rover:",
            ),
            ("rover 200000 90000\n", "rover-hardware:"),
            (
                "rover 200000 90000\nrover-hardware 220000\n",
                "rover-hardware:",
            ),
        ] {
            let told = unexpected(expected, now);
            assert!(matches!(&told[..], [one] if one.contains(name)), "{told:?}");
        }
    }
}
