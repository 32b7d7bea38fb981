//! The drive as which a board's boot loader shows itself: what is copied there becomes the board's
//! firmware.

use std::ffi::OsString;
use std::fs::{self, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::thread;
use std::time::{Duration, Instant};

use esm_toolkit::boards::Flashing;
use thiserror::Error;

use crate::{files, interrupt};

/// Names the folder of the drive. Then it is looked for nowhere else.
pub const VARIABLE: &str = "ESM_BOOT_DRIVE";

/// Where systems mount drives: in these folders, or in one of each user in them.
const MOUNTS: [&str; 4] = ["/media", "/run/media", "/mnt", "/Volumes"];

/// As many folders deep.
const DEPTH: u32 = 2;

/// As many entries of a folder are looked at.
const MAX_ENTRIES: usize = 256;

/// The file with which the drive says what it is.
const INFO: &str = "INFO_UF2.TXT";

/// More than one has.
const MAX_INFO_BYTES: u64 = 16 << 10;

/// What the firmware is called on the drive.
const FIRMWARE: &str = "firmware.uf2";

/// Where Linux has drives by their labels, mounted or not.
const BY_LABEL: &str = "/dev/disk/by-label";

/// How often the drive is looked for.
const LOOK_INTERVAL: Duration = Duration::from_millis(100);

/// How long a board may take to restart when it has all blocks.
const RESTART_WAIT: Duration = Duration::from_secs(10);

/// Bytes written at once; then Ctrl-C is looked for.
const WRITE_BYTES: usize = 16 << 10;

/// Why a drive did not take the firmware.
#[derive(Debug, Error)]
pub enum DriveError {
    /// It is not there.
    #[error(
        "no boot drive of the board: unplug it, hold its button {button} and plug it in by USB; \
         `--wait` waits for the drive{}",
        unmounted.as_deref().map(not_mounted).unwrap_or_default()
    )]
    Missing {
        /// The button that is to be held.
        button: &'static str,
        /// Where it is, if it is not mounted.
        unmounted: Option<PathBuf>,
    },
    /// There are several.
    #[error("there are several boot drives, {}; {VARIABLE} says which", list(.drives))]
    Several {
        /// Where.
        drives: Vec<PathBuf>,
    },
    /// It takes no file.
    #[error("the firmware cannot be copied to {}: {cause}", path.display())]
    Copy {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: io::Error,
    },
    /// Everything was copied, and the board does not restart.
    #[error(
        "the firmware was copied to {}, but after {} s the board is still there: \
         it has not taken the firmware; unplug it and begin anew",
        drive.display(),
        RESTART_WAIT.as_secs()
    )]
    Stays {
        /// The drive.
        drive: PathBuf,
    },
    /// Ctrl-C came before anything was copied.
    #[error("interrupted; the board is as it was")]
    Interrupted,
    /// Ctrl-C came while the firmware was copied.
    #[error("interrupted; the board has a part of its firmware: flash it again")]
    InterruptedCopy,
}

fn not_mounted(device: &Path) -> String {
    let device = device.display();
    format!("; {device} is there and not mounted: `udisksctl mount -b {device}`")
}

fn list(drives: &[PathBuf]) -> String {
    let names: Vec<String> = drives.iter().map(|it| it.display().to_string()).collect();
    names.join(", ")
}

/// Where boot drives are looked for.
#[derive(Clone, Debug)]
pub struct Places(Vec<(PathBuf, u32)>);

impl Places {
    /// Where the system mounts drives, or the one folder that [`VARIABLE`] names.
    pub fn of_environment() -> Self {
        let named = std::env::var_os(VARIABLE).filter(|named: &OsString| !named.is_empty());
        Places(match named {
            Some(named) => vec![(named.into(), 0)],
            None => MOUNTS.iter().map(|mount| (mount.into(), DEPTH)).collect(),
        })
    }

    /// The boot drives of such a board.
    fn drives(&self, board: &Flashing) -> Vec<PathBuf> {
        let mut drives = Vec::new();
        for (folder, depth) in &self.0 {
            search(folder, *depth, board, &mut drives);
        }
        let mut seen = Vec::new();
        drives.retain(|drive| {
            let place = fs::canonicalize(drive).unwrap_or_else(|_| drive.clone());
            let is_new = !seen.contains(&place);
            seen.push(place);
            is_new
        });
        drives
    }

    /// The boot drive of such a board, if one is there.
    ///
    /// # Errors
    /// [`DriveError::Several`]
    pub fn find(&self, board: &Flashing) -> Result<Option<PathBuf>, DriveError> {
        let mut drives = self.drives(board);
        match drives.len() {
            0 | 1 => Ok(drives.pop()),
            _ => Err(DriveError::Several { drives }),
        }
    }

    /// The boot drive, which is waited for so long.
    ///
    /// # Errors
    /// [`DriveError`]
    pub fn await_drive(&self, board: &Flashing, wait: Duration) -> Result<PathBuf, DriveError> {
        let begun = Instant::now();
        loop {
            if let Some(drive) = self.find(board)? {
                return Ok(drive);
            }
            if interrupt::is_requested() {
                return Err(DriveError::Interrupted);
            }
            if begun.elapsed() >= wait {
                let device = Path::new(BY_LABEL).join(board.boot_board_id);
                return Err(DriveError::Missing {
                    button: board.boot_button,
                    unmounted: device.exists().then_some(device),
                });
            }
            thread::sleep(LOOK_INTERVAL);
        }
    }
}

/// Adds the boot drives in and below a folder.
fn search(folder: &Path, depth: u32, board: &Flashing, drives: &mut Vec<PathBuf>) {
    if is_boot_drive(folder, board) {
        drives.push(folder.to_owned());
        return;
    }
    if depth == 0 {
        return;
    }
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let mut below: Vec<PathBuf> = (entries.take(MAX_ENTRIES))
        .filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()))
        .map(|entry| entry.path())
        .collect();
    below.sort();
    for folder in below {
        search(&folder, depth - 1, board, drives);
    }
}

/// Whether a folder is the drive of such a board's boot loader.
fn is_boot_drive(folder: &Path, board: &Flashing) -> bool {
    let Ok(info) = files::read(&folder.join(INFO), MAX_INFO_BYTES) else {
        return false;
    };
    let info = String::from_utf8_lossy(&info);
    let mut lines = info.lines().filter_map(|line| line.split_once(':'));
    lines.any(|(key, value)| match key.trim() {
        "Board-ID" => value.trim() == board.boot_board_id,
        "Model" => value.trim() == board.boot_model,
        _ => false,
    })
}

/// How sure it is that the board has all of its firmware.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Copied {
    /// The system has written all of it.
    Whole,
    /// The board restarted before the system said so.
    Unconfirmed,
}

/// Copies a UF2 file to the drive, and waits until the board has left it.
///
/// # Errors
/// [`DriveError`]
pub fn copy(uf2: &[u8], drive: &Path, board: &Flashing) -> Result<Copied, DriveError> {
    let path = drive.join(FIRMWARE);
    let at = |cause| DriveError::Copy {
        path: path.clone(),
        cause,
    };
    if interrupt::is_requested() {
        return Err(DriveError::Interrupted);
    }
    let mut file = File::create(&path).map_err(at)?;
    for part in uf2.chunks(WRITE_BYTES) {
        if interrupt::is_requested() {
            return Err(DriveError::InterruptedCopy);
        }
        file.write_all(part).map_err(at)?;
    }
    let synced = file.sync_all();
    drop(file);
    let begun = Instant::now();
    while is_boot_drive(drive, board) {
        if interrupt::is_requested() {
            return Err(DriveError::InterruptedCopy);
        }
        if begun.elapsed() >= RESTART_WAIT {
            return match synced {
                Ok(()) => Err(DriveError::Stays {
                    drive: drive.to_owned(),
                }),
                Err(cause) => Err(at(cause)),
            };
        }
        thread::sleep(LOOK_INTERVAL);
    }
    // A board that has its last block restarts at once, whatever its drive is still asked for.
    Ok(match synced {
        Ok(()) => Copied::Whole,
        Err(_) => Copied::Unconfirmed,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use esm_toolkit::boards;

    fn pico() -> Flashing {
        boards::find("pico").unwrap().flashing.unwrap()
    }

    const INFO_OF_RP2040: &str =
        "UF2 Bootloader v3.0\r\nModel: Raspberry Pi RP2\r\nBoard-ID: RPI-RP2\r\n";

    #[test]
    fn a_boot_drive_is_told_from_others() {
        let folder = tempfile::tempdir().unwrap();
        let make = |name: &str, info: Option<&str>| {
            let drive = folder.path().join(name);
            fs::create_dir_all(&drive).unwrap();
            if let Some(info) = info {
                fs::write(drive.join(INFO), info).unwrap();
            }
            drive
        };
        let other = "UF2 Bootloader v1.0\nModel: Raspberry Pi RP2350\nBoard-ID: RP2350\n";
        make("anna/USB-STICK", None);
        make("anna/RP2350", Some(other));
        make("anna/too/deep", Some(INFO_OF_RP2040));
        let places = Places(vec![(folder.path().to_owned(), DEPTH)]);
        assert_eq!(places.find(&pico()).unwrap(), None);
        let missing = places.await_drive(&pico(), Duration::ZERO).unwrap_err();
        assert!(missing.to_string().contains("BOOTSEL"), "{missing}");
        let first = make("anna/RPI-RP2", Some(INFO_OF_RP2040));
        assert_eq!(places.find(&pico()).unwrap(), Some(first.clone()));
        let link = folder.path().join("link");
        std::os::unix::fs::symlink(&first, &link).unwrap();
        let twice = Places(vec![(folder.path().to_owned(), DEPTH), (link, 0)]);
        assert_eq!(
            twice.find(&pico()).unwrap(),
            Some(first),
            "one by two names"
        );
        make("RPI-RP2", Some("Board-ID: RPI-RP2"));
        let several = places.find(&pico()).unwrap_err().to_string();
        for drive in ["/RPI-RP2, ", "/anna/RPI-RP2; ", VARIABLE] {
            assert!(several.contains(drive), "{several}");
        }
    }

    #[test]
    fn what_is_copied_is_the_file_and_a_board_that_leaves_has_taken_it() {
        let folder = tempfile::tempdir().unwrap();
        let drive = folder.path();
        fs::write(drive.join(INFO), INFO_OF_RP2040).unwrap();
        let uf2: Vec<u8> = (0..40_000_u32).map(|it| it as u8).collect();
        let board = thread::spawn({
            let (drive, length) = (drive.to_owned(), uf2.len() as u64);
            move || {
                let taken = || fs::metadata(drive.join(FIRMWARE)).map_or(0, |file| file.len());
                while taken() < length {
                    thread::sleep(LOOK_INTERVAL);
                }
                fs::remove_file(drive.join(INFO)).unwrap();
            }
        });
        assert_eq!(copy(&uf2, drive, &pico()).unwrap(), Copied::Whole);
        board.join().unwrap();
        assert_eq!(fs::read(drive.join(FIRMWARE)).unwrap(), uf2);
        let nowhere = copy(&uf2, &drive.join("gone"), &pico()).unwrap_err();
        assert!(matches!(nowhere, DriveError::Copy { .. }), "{nowhere}");
    }
}
