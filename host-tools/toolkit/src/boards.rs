//! The boards that there are, and what a mission may use on each.
//!
//! The list is made of every `boards/*/board.toml` when the command is built, and so needs no
//! checkout later; the host board joins it.

use esm_link::message::Capacities;
use rt_firmware::frames::{BOARD_FRAMES, BOARD_LINKS, FRAMES, LINKS};

use crate::bound::Costs;

/// The board that is meant where none is named.
pub const DEFAULT: &str = include!(concat!(env!("OUT_DIR"), "/default_board.rs"));

/// What tools know of a board.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Board {
    /// Its name, as `--board` takes it.
    pub name: &'static str,
    /// What it is, in a line.
    pub description: &'static str,
    /// What a mission may use on it: what its firmware compares a mission with.
    pub capacities: Capacities,
    /// The feature with which its firmware serves links of missions; `None` where none does.
    pub links: Option<&'static str>,
    /// What runs on it; `None` for the board that is a part of the command.
    pub firmware: Option<Firmware>,
    /// How its firmware gets onto it; `None` where the board is an emulator's alone.
    pub flashing: Option<Flashing>,
    /// How fast its interpreter is, where that was measured.
    pub interpreter: Option<InterpreterSpeed>,
}

/// What a board runs, and where: of its `board.toml`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Firmware {
    /// The target that it is compiled for.
    pub target: &'static str,
    /// Name of the program that the board runs where no other is named.
    pub bin: &'static str,
    /// The command that runs it in an emulator; empty where no emulator has the chip.
    pub runner: &'static str,
    /// Its flash.
    pub flash: Flash,
    /// Bytes of RAM that are meant for the stack, where that is said.
    pub stack_bytes: Option<u32>,
}

/// A board's flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flash {
    /// Address of its first byte.
    pub origin: u32,
    /// Its length.
    pub bytes: u32,
    /// What is erased at once where missions are kept.
    pub erase_bytes: u32,
}

/// What brings a firmware onto a board: of its `board.toml`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Flashing {
    /// The family of chips that its UF2 files are for.
    pub uf2_family: u32,
    /// The `Board-ID` of its boot drive.
    pub boot_board_id: &'static str,
    /// The `Model` of its boot drive.
    pub boot_model: &'static str,
    /// The button that is held while it is plugged in, so that the boot drive appears.
    pub boot_button: &'static str,
    /// What `probe-rs` calls its chip.
    pub probe_rs_chip: &'static str,
}

impl Firmware {
    /// Whether an emulator has the chip.
    pub fn is_emulated(&self) -> bool {
        !self.runner.is_empty()
    }

    /// The emulator's name of the board, where that is QEMU.
    pub fn machine(&self) -> Option<&'static str> {
        let mut words = self.runner.split_whitespace();
        words.find(|word| *word == "-machine")?;
        words.next()
    }

    /// The script that emulates the chip, in the board's folder, where that is one.
    pub fn script(&self) -> Option<&'static str> {
        let words = self.runner.strip_prefix("python ")?;
        words.split_whitespace().next()
    }
}

/// How fast the interpreter of a board's firmware is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InterpreterSpeed {
    /// Instructions of each construct of a macro step, as [`Costs::parse`] reads them: the board's
    /// `costs.txt`.
    pub costs: &'static str,
    /// Nanoseconds that an instruction takes at most: `instruction_ns` of its `board.toml`.
    pub instruction_ns: u32,
}

impl InterpreterSpeed {
    /// What so many instructions take, in microseconds, rounded up.
    pub fn time_us(&self, instructions: u64) -> u64 {
        instructions
            .saturating_mul(u64::from(self.instruction_ns))
            .div_ceil(1_000)
    }
}

impl Board {
    /// How many links of a mission it serves, and how many frames of them.
    pub fn link_room(&self) -> (usize, usize) {
        match (self.links, self.firmware) {
            (None, _) => (0, 0),
            (Some(_), Some(_)) => (BOARD_LINKS, BOARD_FRAMES),
            (Some(_), None) => (LINKS, FRAMES),
        }
    }

    /// Instructions of each construct of a macro step, where they were measured on this board.
    pub fn costs(&self) -> Option<Costs> {
        Costs::parse(self.interpreter?.costs).ok()
    }
}

/// The boards with a folder of their own, by name.
const WITH_FOLDER: &[Board] = &include!(concat!(env!("OUT_DIR"), "/boards.rs"));

/// The board that runs inside the command.
pub const HOST: Board = Board {
    name: "host",
    description: "this computer: the runtime as a part of the command",
    // Enough for any mission that fits a microcontroller, and for the limits of the blob format.
    capacities: Capacities {
        blob_bytes: 256 * 1024,
        arena_words: 16 * 1024,
        slots: 256,
        task_instances: 2048,
        nets: 2048,
        exclusive_groups: 128,
    },
    links: Some("many-frames"),
    firmware: None,
    flashing: None,
    interpreter: None,
};

/// All boards, the host last.
pub fn all() -> impl Iterator<Item = &'static Board> {
    WITH_FOLDER.iter().chain([&HOST])
}

/// The board of a name.
///
/// # Errors
/// [`UnknownBoard`], which says the names that there are.
pub fn find(name: &str) -> Result<&'static Board, UnknownBoard> {
    all()
        .find(|board| board.name == name)
        .ok_or_else(|| UnknownBoard {
            name: name.to_owned(),
        })
}

/// A name that no board has.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("there is no board `{name}`; the boards are {}", names())]
pub struct UnknownBoard {
    /// The name that was asked for.
    pub name: String,
}

/// All names.
fn names() -> String {
    joined(all())
}

/// The names of the boards that a firmware can be put onto.
pub fn flashable() -> String {
    joined(all().filter(|board| board.flashing.is_some()))
}

/// The names of the boards that serve links of missions.
pub fn linked() -> String {
    joined(all().filter(|board| board.links.is_some()))
}

/// `a`, `b` and `c`
fn joined(boards: impl Iterator<Item = &'static Board>) -> String {
    let mut text = String::new();
    let mut names = boards.map(|board| board.name).peekable();
    while let Some(name) = names.next() {
        let separator = match (text.is_empty(), names.peek()) {
            (true, _) => "",
            (false, Some(_)) => ", ",
            (false, None) => " and ",
        };
        text += &format!("{separator}`{name}`");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_board_is_found_by_its_name_and_the_default_is_one() {
        for board in all() {
            assert_eq!(find(board.name), Ok(board));
        }
        let default = find(DEFAULT).unwrap();
        let firmware = default.firmware.unwrap();
        assert!(firmware.machine().is_some(), "{}", firmware.runner);
        assert!(default.costs().is_some(), "{DEFAULT}: costs.txt");
        let Err(unknown) = find("toaster") else {
            panic!("there is a toaster");
        };
        let told = unknown.to_string();
        assert!(told.starts_with("there is no board `toaster`; the boards are `"));
        assert!(told.ends_with(" and `host`"), "{told}");
        for board in all() {
            assert!(told.contains(&format!("`{}`", board.name)), "{told}");
        }
    }

    #[test]
    fn each_board_folder_is_in_the_list_with_the_numbers_of_its_file() {
        let folder = "../../boards";
        let mut found = 0;
        for entry in std::fs::read_dir(folder).unwrap() {
            let entry = entry.unwrap().path().join("board.toml");
            let Ok(text) = std::fs::read_to_string(&entry) else {
                continue;
            };
            let told = |key: &str| {
                let lines = text.lines().filter_map(|line| line.split_once(" = "));
                let value = lines.clone().find(|(found, _)| *found == key);
                value.unwrap().1.trim_matches('"').to_owned()
            };
            let board = find(&told("name")).unwrap();
            let Capacities {
                blob_bytes,
                arena_words,
                slots,
                task_instances,
                nets,
                exclusive_groups,
            } = board.capacities;
            for (key, number) in [
                ("blob_bytes", blob_bytes),
                ("arena_words", arena_words),
                ("slots", slots.into()),
                ("tasks", task_instances.into()),
                ("nets", nets.into()),
                ("exclusive_groups", exclusive_groups.into()),
            ] {
                assert_eq!(told(key), number.to_string(), "{}: {key}", board.name);
            }
            let flash = board.firmware.unwrap().flash;
            for (key, number) in [
                ("origin", flash.origin),
                ("bytes", flash.bytes),
                ("erase_bytes", flash.erase_bytes),
            ] {
                assert_eq!(told(key), number.to_string(), "{}: {key}", board.name);
            }
            // How fast a board is, is known where both files say so.
            let is_measured = text.contains("\ninstruction_ns = ");
            let has_costs = entry.with_file_name("costs.txt").is_file();
            assert_eq!(is_measured, has_costs, "{}: costs.txt", board.name);
            let ns = board
                .interpreter
                .map(|speed| speed.instruction_ns.to_string());
            assert_eq!(ns, is_measured.then(|| told("instruction_ns")));
            assert_eq!(
                board.costs().is_some(),
                has_costs,
                "{}: costs.txt",
                board.name
            );
            if let Some(flashing) = board.flashing {
                assert_eq!(format!("{:#x}", flashing.uf2_family), told("uf2_family"));
                assert_eq!(flashing.boot_button, told("boot_button"));
            }
            found += 1;
        }
        assert_eq!(found, WITH_FOLDER.len());
    }
}
