//! Where an emulated board's firmware is found, and how it comes to be there.

use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::SystemTime;

use esm_toolkit::boards;
use object::read::elf::{ElfFile32, ProgramHeader};
use object::{Architecture, Endianness, Object};
use thiserror::Error;

use crate::files::{self, MAX_FIRMWARE_BYTES};

/// The board that runs in the emulator where none is named.
pub const BOARD: &str = boards::DEFAULT;

/// Where `cargo xtask firmware` puts what it builds, below the checkout.
const FIRMWARE_FOLDER: &str = "target/firmware";

/// What is known of a board's firmware; of the host board's, nothing.
pub(crate) fn about(board: &boards::Board) -> boards::Firmware {
    board.firmware.unwrap_or(boards::Firmware {
        target: "",
        bin: "",
        runner: "",
        flash: boards::Flash {
            origin: 0,
            bytes: 0,
            erase_bytes: 1,
        },
        stack_bytes: None,
    })
}

/// What builds a board's firmware, or the one with a feature that it lacks by default.
fn builder(board: &boards::Board, feature: Option<&str>) -> String {
    let command = match board.name {
        BOARD => "cargo xtask firmware".to_owned(),
        name => format!("cargo xtask firmware --board {name}"),
    };
    match feature {
        None => command,
        Some(feature) => format!("{command} --with {feature}"),
    }
}

/// Where such a firmware is, below the checkout.
fn built_firmware(board: &boards::Board, feature: Option<&str>) -> String {
    let suffix = feature.map_or_else(String::new, |feature| format!("-{feature}"));
    format!(
        "{FIRMWARE_FOLDER}/{}/{}{suffix}.elf",
        board.name,
        about(board).bin
    )
}

/// A board's default firmware as cargo built it, below the checkout.
fn made(board: &boards::Board) -> String {
    let boards::Firmware { target, bin, .. } = about(board);
    format!("target/firmware-build/{target}/release/{bin}")
}

/// Where cargo says which files it is made of.
fn made_of(board: &boards::Board) -> String {
    made(board) + ".d"
}

/// What a checkout has at its top and nobody else does.
fn checkout_mark() -> String {
    format!("boards/{BOARD}/board.toml")
}

/// Why there is no firmware.
#[derive(Debug, Error)]
pub enum FirmwareError {
    /// The file that was named is not there.
    #[error("there is no firmware at {}", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// The file cannot be read.
    #[error("cannot read the firmware {}: {cause}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: io::Error,
    },
    /// The file is no program for a microcontroller, or ends before its end.
    #[error(
        "{} is no firmware: it cannot be read as a whole ELF file for a 32-bit processor ({cause}); `{builder}` builds one",
        path.display()
    )]
    NotElf {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        cause: object::Error,
        /// The command that builds one.
        builder: String,
    },
    /// The file ends before what is to be loaded of it.
    #[error("the firmware {} is cut off before its end: build it again with `{builder}`", path.display())]
    Cut {
        /// The file.
        path: PathBuf,
        /// The command that builds one.
        builder: String,
    },
    /// It was built for another processor.
    #[error(
        "the firmware {} was built for another processor than the board {board} has, a Cortex-M; `{builder}` builds one for it",
        path.display()
    )]
    OtherProcessor {
        /// The file.
        path: PathBuf,
        /// The board.
        board: &'static str,
        /// The command that builds one.
        builder: String,
    },
    /// Something of it stands where this board has no flash, or nothing where it starts.
    #[error(
        "the firmware {} was built for another board than {board}: it does not fit into {} KiB of flash from address {:#x} on; `{builder}` builds one that does",
        path.display(),
        flash.bytes >> 10,
        flash.origin
    )]
    OtherBoard {
        /// The file.
        path: PathBuf,
        /// The board.
        board: &'static str,
        /// Its flash.
        flash: boards::Flash,
        /// The command that builds one.
        builder: String,
    },
    /// This is no checkout, so nothing can be built.
    #[error(
        "no firmware for the board {board}: drive on the host with `--board host`; or name a firmware with --firmware ELF or ESM_FIRMWARE; or run esm inside a checkout, where `{builder}` builds it, and with `--robot FOLDER` that of a robot of your own"
    )]
    NoCheckout {
        /// The board.
        board: &'static str,
        /// The command that builds one.
        builder: String,
    },
    /// Building failed.
    #[error("the firmware does not build; run `{builder}` in {} to see why", checkout.display())]
    Build {
        /// The checkout.
        checkout: PathBuf,
        /// The command that builds it.
        builder: String,
    },
}

/// The file of a board's firmware: `named` if there is one, else what the checkout around `from`
/// has built.
/// `tell` is told what is about to be built, before that takes its minutes, or that what was built
/// is older than its sources.
///
/// # Errors
/// [`FirmwareError`]: what is missing, and what to do.
pub fn find(
    board: &boards::Board,
    named: Option<&Path>,
    from: &Path,
    tell: impl FnOnce(&str),
) -> Result<PathBuf, FirmwareError> {
    find_with(board, None, named, from, tell)
}

/// The same of the firmware with a feature that it lacks by default.
///
/// # Errors
/// [`FirmwareError`]: what is missing, and what to do.
pub fn find_with(
    board: &boards::Board,
    feature: Option<&str>,
    named: Option<&Path>,
    from: &Path,
    tell: impl FnOnce(&str),
) -> Result<PathBuf, FirmwareError> {
    if let Some(path) = named {
        let path = path.to_owned();
        return match files::require(&path) {
            Ok(()) => Ok(path),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                Err(FirmwareError::Missing { path })
            }
            Err(cause) => Err(FirmwareError::Unreadable { path, cause }),
        };
    }
    let builder = builder(board, feature);
    let checkout = checkout_around(from).ok_or_else(|| FirmwareError::NoCheckout {
        board: board.name,
        builder: builder.clone(),
    })?;
    let built = built_firmware(board, feature);
    let path = checkout.join(&built);
    if path.is_file() {
        if feature.is_none()
            && let Some(source) = newer_source(board, &checkout, &path)
        {
            tell(&format!(
                "The firmware {built} is older than {}: `{builder}` builds it anew",
                source.display()
            ));
        }
        return Ok(path);
    }
    tell(&format!(
        "No firmware yet: building it with `{builder}` (some minutes the first time) …"
    ));
    let mut words = builder.split_whitespace();
    let built = Command::new(words.next().unwrap_or_default())
        .args(words)
        .current_dir(&checkout)
        .status();
    match built {
        Ok(status) if status.success() && path.is_file() => Ok(path),
        _ => Err(FirmwareError::Build { checkout, builder }),
    }
}

/// Fails where a file is no firmware that a board could start.
///
/// # Errors
/// [`FirmwareError`]: what is wrong with the file.
pub fn check(board: &'static boards::Board, path: &Path) -> Result<(), FirmwareError> {
    let at = || path.to_owned();
    let bytes = files::read(path, MAX_FIRMWARE_BYTES)
        .map_err(|cause| FirmwareError::Unreadable { path: at(), cause })?;
    let elf = ElfFile32::<Endianness>::parse(bytes.as_slice());
    let builder = || builder(board, None);
    let elf = elf.map_err(|cause| FirmwareError::NotElf {
        path: at(),
        cause,
        builder: builder(),
    })?;
    if elf.architecture() != Architecture::Arm || !elf.is_little_endian() {
        return Err(FirmwareError::OtherProcessor {
            path: at(),
            board: board.name,
            builder: builder(),
        });
    }
    let flash = about(board).flash;
    let flash_end = u64::from(flash.origin) + u64::from(flash.bytes);
    let other_board = || FirmwareError::OtherBoard {
        path: at(),
        board: board.name,
        flash,
        builder: builder(),
    };
    let mut starts = false;
    for segment in elf.elf_program_headers() {
        let (from, length) = (
            u64::from(segment.p_paddr(elf.endian())),
            u64::from(segment.p_filesz(elf.endian())),
        );
        if segment.p_type(elf.endian()) != object::elf::PT_LOAD || length == 0 {
            continue;
        }
        if segment.data(elf.endian(), bytes.as_slice()).is_err() {
            return Err(FirmwareError::Cut {
                path: at(),
                builder: builder(),
            });
        }
        if from < u64::from(flash.origin) || from + length > flash_end {
            return Err(other_board());
        }
        starts |= from == u64::from(flash.origin);
    }
    match starts {
        true => Ok(()),
        false => Err(other_board()),
    }
}

/// The first file of the checkout, by its name, that `firmware` was made of and that has changed or
/// gone since. None where nobody wrote down what it was made of.
fn newer_source(board: &boards::Board, checkout: &Path, firmware: &Path) -> Option<PathBuf> {
    let built = modified(firmware)?;
    // Cargo names its files as the system does.
    let checkout = checkout.canonicalize().ok()?;
    let made_of = std::fs::read_to_string(checkout.join(self::made_of(board))).ok()?;
    // The checkout may have been moved or copied since: then the list has the old names.
    let then = built_in(board, &made_of)?;
    let is_newer = |source: &PathBuf| modified(&checkout.join(source)).is_none_or(|at| at > built);
    let mut sources: Vec<PathBuf> = sources(&made_of)
        .filter_map(|source| Some(source.strip_prefix(&then).ok()?.to_owned()))
        .collect();
    sources.sort();
    sources.into_iter().find(is_newer)
}

/// The checkout in which cargo wrote the list `made_of`: what is made comes first, and stands in a
/// known place below it.
fn built_in(board: &boards::Board, made_of: &str) -> Option<PathBuf> {
    let (made, _) = made_of.split_once(": ")?;
    let made = made.replace("\\ ", " ");
    let top = made.strip_suffix(&self::made(board))?;
    Some(PathBuf::from(top))
}

fn modified(file: &Path) -> Option<SystemTime> {
    file.metadata().ok()?.modified().ok()
}

/// The files in a list that cargo wrote: what is made, a colon, and what it is made of, with a
/// backslash before each blank that is part of a name.
fn sources(made_of: &str) -> impl Iterator<Item = PathBuf> {
    /// What no name contains.
    const BLANK: &str = "\0";
    let lists = made_of.lines().filter_map(|line| line.split_once(": "));
    lists.flat_map(|(_, list)| {
        let names = list.replace("\\ ", BLANK);
        let names = names.split(' ').filter(|name| !name.is_empty());
        let names: Vec<PathBuf> = names.map(|name| name.replace(BLANK, " ").into()).collect();
        names
    })
}

/// The checkout that holds `from`, if one does.
pub fn checkout_around(from: &Path) -> Option<PathBuf> {
    from.ancestors()
        .find(|folder| folder.join(checkout_mark()).is_file())
        .map(Path::to_owned)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;
    use crate::samples;

    fn default_board() -> &'static boards::Board {
        boards::find(BOARD).unwrap()
    }

    #[test]
    fn a_named_firmware_must_be_there_and_a_built_one_is_found_from_below() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        let below = root.join("missions/office");
        std::fs::create_dir_all(&below).unwrap();
        assert!(matches!(
            find(default_board(), None, &below, |_| ()),
            Err(FirmwareError::NoCheckout { .. })
        ));
        assert!(matches!(
            find(
                default_board(),
                Some(&root.join("gone.elf")),
                &below,
                |_| ()
            ),
            Err(FirmwareError::Missing { .. })
        ));
        let mark = root.join(checkout_mark());
        std::fs::create_dir_all(mark.parent().unwrap()).unwrap();
        std::fs::write(mark, "").unwrap();
        let elf = root.join(built_firmware(default_board(), None));
        std::fs::create_dir_all(elf.parent().unwrap()).unwrap();
        std::fs::write(&elf, "").unwrap();
        assert_eq!(find(default_board(), None, &below, |_| ()).unwrap(), elf);
        assert_eq!(
            find(default_board(), Some(&elf), &below, |_| ()).unwrap(),
            elf
        );
    }

    /// The least ELF file with these segments: where each is loaded, and how long it is.
    fn elf(machine: u16, segments: &[(u32, u32)]) -> Vec<u8> {
        let zeros = [0; 256];
        let bytes = |&(at, length): &(u32, u32)| (at, &zeros[..length as usize]);
        let segments: Vec<(u32, &[u8])> = segments.iter().map(bytes).collect();
        samples::elf(machine, &segments)
    }

    #[test]
    fn what_the_board_cannot_start_is_told_from_a_firmware() {
        const ARM: u16 = 40;
        const RISC_V: u16 = 243;
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("firmware.elf");
        let said = |bytes: &[u8]| {
            std::fs::write(&file, bytes).unwrap();
            check(default_board(), &file).map_err(|error| error.to_string())
        };
        let good = elf(ARM, &[(0, 64), (64, 128)]);
        assert_eq!(said(&good), Ok(()));
        for (what, bytes, why) in [
            ("empty", vec![], "is no firmware"),
            ("text", b"interpreter slot 1;".to_vec(), "is no firmware"),
            ("cut", good[..100].to_vec(), "is no firmware"),
            (
                "without its end",
                good[..good.len() - 1].to_vec(),
                "is cut off",
            ),
            ("RISC-V", elf(RISC_V, &[(0, 64)]), "another processor"),
            ("elsewhere", elf(ARM, &[(0x0800_0000, 64)]), "another board"),
            ("not at the start", elf(ARM, &[(64, 64)]), "another board"),
            (
                "too long",
                elf(ARM, &[(0, 64), (about(default_board()).flash.bytes, 1)]),
                "another board",
            ),
            ("nothing", elf(ARM, &[]), "another board"),
        ] {
            let said = said(&bytes).unwrap_err();
            assert!(said.contains(why), "{what}: {said}");
        }
    }

    #[test]
    fn a_firmware_that_is_older_than_a_source_of_it_is_told() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().canonicalize().unwrap().join("my robots");
        // When each file was changed, in seconds of some clock.
        let write = |name: &str, text: &str, at_s: u64| {
            let path = root.join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, text).unwrap();
            let file = std::fs::File::options().write(true).open(path).unwrap();
            let at = SystemTime::UNIX_EPOCH + Duration::from_secs(at_s);
            file.set_modified(at).unwrap();
        };
        let told = || {
            let mut told = None;
            find(default_board(), None, &root, |text| {
                told = Some(text.to_owned())
            })
            .unwrap();
            told
        };
        let built = built_firmware(default_board(), None);
        let elf = built.as_str();
        write(&checkout_mark(), "", 1_000);
        write("rt-firmware/src/lib.rs", "", 1_000);
        write("rt-firmware/src/link.rs", "", 1_000);
        write("a test.rs", "", 3_000);
        write(elf, "", 2_000);
        assert_eq!(told(), None, "nobody knows what it was made of");
        let named = |name: &str| root.join(name).display().to_string().replace(' ', "\\ ");
        let (lib, link) = (
            named("rt-firmware/src/lib.rs"),
            named("rt-firmware/src/link.rs"),
        );
        let made = named(&made(default_board()));
        let list = format!("{made}: {link} /elsewhere/gone.rs {lib}\n");
        write(&made_of(default_board()), &list, 2_000);
        assert_eq!(told(), None, "what it was not made of is of no interest");
        write("rt-firmware/src/link.rs", "", 2_001);
        assert_eq!(
            told().unwrap(),
            format!(
                "The firmware {elf} is older than rt-firmware/src/link.rs: `cargo xtask firmware` builds it anew"
            )
        );
        write(elf, "", 2_002);
        assert_eq!(told(), None);
        // The list of a checkout that was copied from elsewhere.
        let here = root.display().to_string().replace(' ', "\\ ");
        write(
            &made_of(default_board()),
            &list.replace(&here, "/some\\ where/else"),
            2_000,
        );
        assert_eq!(told(), None);
        write("rt-firmware/src/link.rs", "", 2_003);
        assert!(
            told()
                .unwrap()
                .contains("is older than rt-firmware/src/link.rs")
        );
        write(elf, "", 2_004);
        std::fs::remove_file(root.join("rt-firmware/src/lib.rs")).unwrap();
        assert!(told().unwrap().contains("lib.rs"), "it has gone");
    }
}
