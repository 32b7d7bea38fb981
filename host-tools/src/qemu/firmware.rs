//! Where an emulated board's firmware is found, and how it comes to be there.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::SystemTime;

use thiserror::Error;

/// The board that runs in the emulator.
pub const BOARD: &str = "lm3s6965";

/// The firmware that a board runs if no other is named.
pub const DEFAULT_FIRMWARE: &str = "rover";

/// Where `cargo xtask firmware` puts what it builds, below the checkout.
const FIRMWARE_FOLDER: &str = "target/firmware";

/// Where cargo says which files the default firmware is made of, below the checkout.
const MADE_OF: &str = "target/firmware-build/thumbv7m-none-eabi/release/rover.d";

/// What a checkout has at its top and nobody else does.
const CHECKOUT_MARK: &str = "boards/lm3s6965/board.toml";

/// Why there is no firmware.
#[derive(Debug, Error)]
pub enum FirmwareError {
    /// The file that was named is not there.
    #[error("there is no firmware at {}", path.display())]
    Missing {
        /// The file.
        path: PathBuf,
    },
    /// This is no checkout, so nothing can be built.
    #[error(
        "no firmware for the board {BOARD}: name one with --firmware ELF or ESM_FIRMWARE, or run esm inside a checkout, where `cargo xtask firmware` builds it"
    )]
    NoCheckout,
    /// Building failed.
    #[error("the firmware does not build; run `cargo xtask firmware` in {} to see why", checkout.display())]
    Build {
        /// The checkout.
        checkout: PathBuf,
    },
}

/// The firmware's file: `named` if there is one, else what the checkout around `from` has built. `tell` is told what is about to be
/// built, before that takes its minutes, or that what was built is older than its sources.
///
/// # Errors
/// [`FirmwareError`]: what is missing, and what to do.
pub fn find(
    named: Option<&Path>,
    from: &Path,
    tell: impl FnOnce(&str),
) -> Result<PathBuf, FirmwareError> {
    if let Some(path) = named {
        return if path.is_file() {
            Ok(path.to_owned())
        } else {
            Err(FirmwareError::Missing {
                path: path.to_owned(),
            })
        };
    }
    let checkout = checkout_around(from).ok_or(FirmwareError::NoCheckout)?;
    let path = checkout
        .join(FIRMWARE_FOLDER)
        .join(BOARD)
        .join(format!("{DEFAULT_FIRMWARE}.elf"));
    if path.is_file() {
        if let Some(source) = newer_source(&checkout, &path) {
            tell(&format!(
                "The firmware {FIRMWARE_FOLDER}/{BOARD}/{DEFAULT_FIRMWARE}.elf is older than {}: `cargo xtask firmware` builds it anew",
                source.display()
            ));
        }
        return Ok(path);
    }
    tell(
        "No firmware yet: building it with `cargo xtask firmware` (some minutes the first time) …",
    );
    let built = Command::new("cargo")
        .args(["xtask", "firmware"])
        .current_dir(&checkout)
        .status();
    match built {
        Ok(status) if status.success() && path.is_file() => Ok(path),
        _ => Err(FirmwareError::Build { checkout }),
    }
}

/// The first file of the checkout, by its name, that `firmware` was made of and that has changed or gone since. None where nobody wrote down what it was made of.
fn newer_source(checkout: &Path, firmware: &Path) -> Option<PathBuf> {
    let built = modified(firmware)?;
    // Cargo names its files as the system does.
    let checkout = checkout.canonicalize().ok()?;
    let made_of = std::fs::read_to_string(checkout.join(MADE_OF)).ok()?;
    let is_newer = |source: &PathBuf| modified(&checkout.join(source)).is_none_or(|at| at > built);
    let mut sources: Vec<PathBuf> = sources(&made_of)
        .filter_map(|source| Some(source.strip_prefix(&checkout).ok()?.to_owned()))
        .collect();
    sources.sort();
    sources.into_iter().find(is_newer)
}

fn modified(file: &Path) -> Option<SystemTime> {
    file.metadata().ok()?.modified().ok()
}

/// The files in a list that cargo wrote: what is made, a colon, and what it is made of, with a backslash before each blank that is part of a name.
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
fn checkout_around(from: &Path) -> Option<PathBuf> {
    from.ancestors()
        .find(|folder| folder.join(CHECKOUT_MARK).is_file())
        .map(Path::to_owned)
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_named_firmware_must_be_there_and_a_built_one_is_found_from_below() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        let below = root.join("missions/office");
        std::fs::create_dir_all(&below).unwrap();
        assert!(matches!(
            find(None, &below, |_| ()),
            Err(FirmwareError::NoCheckout)
        ));
        assert!(matches!(
            find(Some(&root.join("gone.elf")), &below, |_| ()),
            Err(FirmwareError::Missing { .. })
        ));
        let mark = root.join(CHECKOUT_MARK);
        std::fs::create_dir_all(mark.parent().unwrap()).unwrap();
        std::fs::write(mark, "").unwrap();
        let elf = root.join("target/firmware/lm3s6965/rover.elf");
        std::fs::create_dir_all(elf.parent().unwrap()).unwrap();
        std::fs::write(&elf, "").unwrap();
        assert_eq!(find(None, &below, |_| ()).unwrap(), elf);
        assert_eq!(find(Some(&elf), &below, |_| ()).unwrap(), elf);
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
            find(None, &root, |text| told = Some(text.to_owned())).unwrap();
            told
        };
        let elf = "target/firmware/lm3s6965/rover.elf";
        write(CHECKOUT_MARK, "", 1_000);
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
        let list = format!("{}: {link} /elsewhere/gone.rs {lib}\n", named("rover"));
        write(MADE_OF, &list, 2_000);
        assert_eq!(told(), None, "what it was not made of is of no interest");
        write("rt-firmware/src/link.rs", "", 2_001);
        assert_eq!(
            told().unwrap(),
            "The firmware target/firmware/lm3s6965/rover.elf is older than rt-firmware/src/link.rs: `cargo xtask firmware` builds it anew"
        );
        write(elf, "", 2_002);
        assert_eq!(told(), None);
        std::fs::remove_file(root.join("rt-firmware/src/lib.rs")).unwrap();
        assert!(told().unwrap().contains("lib.rs"), "it has gone");
    }
}
