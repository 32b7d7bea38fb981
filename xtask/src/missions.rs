//! What missions take: bytes of their blobs, of a transition, and of RAM.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use crate::process::{self, Failure, command, make_folder};

/// The missions, by what their rows are called. The first is the one that a limit is for.
const MISSIONS: [(&str, &str); 4] = [
    (PLAYER, "tests/data/cd51.esm"),
    ("patrol", "missions/patrol.esm"),
    ("follow_wall", "missions/follow_wall.esm"),
    ("watch_timing", "missions/watch_timing.esm"),
];
const PLAYER: &str = "cd51";
/// The row of what one more region takes, which has RAM alone.
const REGION: &str = "one more region";
/// Regions of the machines that this is the difference of.
const REGIONS: [u32; 2] = [1, 65];
/// Where their blobs are put.
const TARGET: &str = "target/size";

/// The most that a transition of the CD player and a region may take, in hundredths of a byte.
const TRANSITION_LIMIT: u32 = 1_000;
/// See [`TRANSITION_LIMIT`].
const REGION_LIMIT: u32 = 800;

/// The head of their part of the expected sizes.
pub const HEAD: &str = "# mission";

/// What one takes; what it has not is nothing.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Taken {
    /// Bytes of the blob, names included.
    blob: Option<u32>,
    /// Transitions, guards and actions for each transition, in hundredths of a byte.
    transition: Option<u32>,
    /// The interpreter's memory, in hundredths of a byte.
    ram: Option<u32>,
}

/// By row.
pub type Table = BTreeMap<String, Taken>;

/// Compiles the missions and says what they take.
///
/// # Errors
/// [`Failure`]: what did not compile.
pub fn measure(root: &Path) -> Result<Table, Failure> {
    let folder = root.join(TARGET);
    make_folder(&folder)?;
    let mut table = Table::new();
    for (row, file) in MISSIONS {
        let taken = inspected(root, &root.join(file), &folder)?;
        table.insert(row.to_owned(), taken);
    }
    let mut ram = [0; REGIONS.len()];
    for (ram, regions) in ram.iter_mut().zip(REGIONS) {
        let file = folder.join(format!("regions-{regions}.esm"));
        std::fs::write(&file, machine(regions)).map_err(|cause| Failure::File {
            path: file.clone(),
            cause,
        })?;
        *ram = inspected(root, &file, &folder)?.ram.unwrap_or(0);
    }
    let ([fewer, more], [few_bytes, more_bytes]) = (REGIONS, ram);
    let region = Taken {
        ram: Some(more_bytes.saturating_sub(few_bytes) / (more - fewer)),
        ..Taken::default()
    };
    table.insert(REGION.to_owned(), region);
    Ok(table)
}

/// A machine of regions without flags.
fn machine(regions: u32) -> String {
    let mut text = String::from(
        "interpreter slot 1;\nslot 1 period 1 ms duration 100 us;\nmachine Regions {\n    event Go;\n",
    );
    for region in 0..regions {
        // Writing to a string cannot fail.
        let _ = writeln!(
            text,
            "    region r{region} {{ state S; initial -> S; S -> S on Go; }}"
        );
    }
    text + "}\n"
}

/// What the mission in a file takes.
fn inspected(root: &Path, file: &Path, folder: &Path) -> Result<Taken, Failure> {
    let blob = folder.join("mission.blob");
    esm(root, &[&"build".into(), &file.into(), &"-o".into(), &blob])?;
    let told = esm(root, &[&"inspect".into(), &"--json".into(), &blob])?;
    let number = |key: &str| {
        hundredths(&told, key).ok_or_else(|| Failure::Content {
            path: file.to_owned(),
            problem: "was compiled to a blob of which `esm inspect --json` does not tell the size",
        })
    };
    Ok(Taken {
        blob: Some(number("bytes")? / 100),
        transition: Some(number("bytes_per_transition")?),
        ram: Some(number("ram_bytes")?),
    })
}

/// What `esm` prints.
fn esm(root: &Path, arguments: &[&PathBuf]) -> Result<String, Failure> {
    let mut cargo = command(process::host_cargo());
    cargo
        .current_dir(root)
        .args([
            "run",
            "--quiet",
            // As the demo and the tests have it, which is there then.
            "--release",
            "--package",
            "host-tools",
            "--bin",
            "esm",
            "--",
        ])
        .args(arguments);
    // Its warnings are not what is asked for; its errors are told by its status, and again by
    // `esm check`.
    process::printed(&mut cargo, true)
}

/// A number of a JSON object, in hundredths, rounded.
fn hundredths(json: &str, key: &str) -> Option<u32> {
    let (_, rest) = json.split_once(&format!("\"{key}\":"))?;
    let number: f64 = rest.split([',', '}', '\n']).next()?.trim().parse().ok()?;
    (number >= 0.0 && number < f64::from(u32::MAX / 100)).then_some((number * 100.0 + 0.5) as u32)
}

/// What is over its limit.
pub fn excesses(table: &Table) -> Vec<String> {
    let of = |row: &str| table.get(row).copied().unwrap_or_default();
    [
        (
            "a transition of the CD player, in bytes of blob",
            of(PLAYER).transition,
            TRANSITION_LIMIT,
        ),
        ("a region, in bytes of RAM", of(REGION).ram, REGION_LIMIT),
    ]
    .into_iter()
    .filter_map(|(what, taken, limit)| {
        let taken = taken.filter(|taken| *taken > limit)?;
        Some(format!(
            "Too large: {what}: {}, limit {}",
            shown(Some(taken)),
            shown(Some(limit))
        ))
    })
    .collect()
}

/// Hundredths as a decimal number.
fn shown(hundredths: Option<u32>) -> String {
    hundredths.map_or_else(
        || "-".to_owned(),
        |number| format!("{}.{:02}", number / 100, number % 100),
    )
}

/// The table with its head.
pub fn render(table: &Table) -> String {
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "{HEAD:<32} {:>7} {:>12} {:>7}",
        "blob", "a transition", "ram"
    );
    for (row, taken) in table {
        let blob = taken
            .blob
            .map_or_else(|| "-".to_owned(), |bytes| bytes.to_string());
        let _ = writeln!(
            text,
            "{row:<32} {blob:>7} {:>12} {:>7}",
            shown(taken.transition),
            shown(taken.ram)
        );
    }
    text
}

/// Rows as [`render`] writes them, without the head.
pub fn parse<'t>(lines: impl Iterator<Item = &'t str>) -> Option<Table> {
    fn read(word: &str, scale: f64) -> Option<Option<u32>> {
        if word == "-" {
            return Some(None);
        }
        let number: f64 = word.parse().ok()?;
        Some(Some((number * scale + 0.5) as u32))
    }
    let mut table = Table::new();
    for line in lines {
        let mut words = line.split_whitespace().rev();
        let taken = Taken {
            ram: read(words.next()?, 100.0)?,
            transition: read(words.next()?, 100.0)?,
            blob: read(words.next()?, 1.0)?,
        };
        let mut name: Vec<&str> = words.collect();
        name.reverse();
        table.insert(name.join(" "), taken);
    }
    Some(table)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn example() -> Table {
        let player = Taken {
            blob: Some(1_022),
            transition: Some(837),
            ram: Some(9_600),
        };
        let region = Taken {
            ram: Some(625),
            ..Taken::default()
        };
        Table::from([(PLAYER.to_owned(), player), (REGION.to_owned(), region)])
    }

    #[test]
    fn a_table_reads_back_as_it_was_written() {
        let text = render(&example());
        assert!(text.starts_with(HEAD));
        assert_eq!(parse(text.lines().skip(1)), Some(example()));
        assert_eq!(parse(["no table"].into_iter()), None);
    }

    #[test]
    fn a_number_of_a_json_object_is_that_of_its_whole_key() {
        let json = "{\"bytes\":1022,\"ram_bytes\":96,\"bytes_per_transition\":8.37037}";
        assert_eq!(hundredths(json, "bytes"), Some(102_200));
        assert_eq!(hundredths(json, "ram_bytes"), Some(9_600));
        assert_eq!(hundredths(json, "bytes_per_transition"), Some(837));
        assert_eq!(hundredths(json, "queue"), None);
    }

    #[test]
    fn what_is_over_its_limit_is_told_and_what_is_at_it_is_not() {
        let mut table = example();
        assert_eq!(excesses(&table), [""; 0]);
        let at_limit = Taken {
            ram: Some(REGION_LIMIT),
            ..Taken::default()
        };
        table.insert(REGION.to_owned(), at_limit);
        assert_eq!(excesses(&table), [""; 0]);
        let over = Taken {
            transition: Some(TRANSITION_LIMIT + 1),
            ..Taken::default()
        };
        table.insert(PLAYER.to_owned(), over);
        assert_eq!(excesses(&table).len(), 1);
    }
}
