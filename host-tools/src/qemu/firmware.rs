//! Where an emulated board's firmware is found, and how it comes to be there.

use std::path::{Path, PathBuf};
use std::process::Command;

use thiserror::Error;

/// The board that runs in the emulator.
pub const BOARD: &str = "lm3s6965";

/// The firmware that a board runs if no other is named.
pub const DEFAULT_FIRMWARE: &str = "rover";

/// Where `cargo xtask firmware` puts what it builds, below the checkout.
const FIRMWARE_FOLDER: &str = "target/firmware";

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

/// The firmware's file: `named` if there is one, else what the checkout around `from` has built. `build` is told what is about to be
/// built, before that takes its minutes.
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

/// The checkout that holds `from`, if one does.
fn checkout_around(from: &Path) -> Option<PathBuf> {
    from.ancestors()
        .find(|folder| folder.join(CHECKOUT_MARK).is_file())
        .map(Path::to_owned)
}

#[cfg(test)]
mod tests {
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
}
