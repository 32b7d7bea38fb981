//! Input files: opened without waiting, and read up to a limit.
//!
//! A name may stand for a pipe without a writer, which keeps whoever opens it waiting, or for a
//! device without an end. Both are told, and neither is read.

use std::fs::{self, File, FileType};
use std::io::{self, Read};
use std::os::unix::fs::{FileTypeExt, OpenOptionsExt};
use std::path::Path;

use esm_toolkit::lang;
use esm_toolkit::world::{World, WorldError};
use rustix::fs::OFlags;
use thiserror::Error;

/// The longest blob that is read: as long as the longest source.
pub const MAX_BLOB_BYTES: u64 = lang::MAX_FILE_BYTES;

/// The longest firmware that is read. One with all that a debugger wants to know has some MiB.
pub const MAX_FIRMWARE_BYTES: u64 = 256 << 20;

/// The longest world or scenario that is read. People write some KiB.
pub const MAX_TEXT_BYTES: u64 = 16 << 20;

/// Why a file is not read, where the system has nothing against it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum Unread {
    /// It is something else than a file.
    #[error("it is {0}, and a file is wanted")]
    NotAFile(&'static str),
    /// It has no end, or a late one.
    #[error("it is longer than {0} bytes, which is the most that is read")]
    TooLong(u64),
}

impl From<Unread> for io::Error {
    fn from(unread: Unread) -> Self {
        io::Error::new(io::ErrorKind::InvalidInput, unread)
    }
}

/// What something is called that is no file.
fn other_than_file(found: FileType) -> Option<&'static str> {
    if found.is_file() {
        return None;
    }
    Some(if found.is_dir() {
        "a folder"
    } else if found.is_fifo() {
        "a pipe"
    } else if found.is_socket() {
        "a socket"
    } else {
        "a device"
    })
}

/// Fails where there is something else than a file of that name.
///
/// # Errors
/// [`Unread::NotAFile`], and what the system says.
pub fn require(path: &Path) -> io::Result<()> {
    match other_than_file(fs::metadata(path)?.file_type()) {
        None => Ok(()),
        Some(other) => Err(Unread::NotAFile(other).into()),
    }
}

/// Opens a file to be read, and nothing else than a file.
///
/// # Errors
/// [`Unread::NotAFile`], and what the system says.
pub fn open(path: &Path) -> io::Result<File> {
    // Some devices do something when they are opened.
    require(path)?;
    let flags = OFlags::NONBLOCK | OFlags::NOCTTY;
    let file = File::options()
        .read(true)
        .custom_flags(flags.bits() as i32)
        .open(path)?;
    // It may have been exchanged meanwhile; then it was opened without waiting.
    match other_than_file(file.metadata()?.file_type()) {
        None => Ok(file),
        Some(other) => Err(Unread::NotAFile(other).into()),
    }
}

/// Reads a whole file that is no longer than `most_bytes`.
///
/// # Errors
/// [`Unread`], and what the system says.
pub fn read(path: &Path, most_bytes: u64) -> io::Result<Vec<u8>> {
    let file = open(path)?;
    // One of `/proc` says that it has no bytes.
    if file.metadata()?.len() > most_bytes {
        return Err(Unread::TooLong(most_bytes).into());
    }
    let mut bytes = Vec::new();
    file.take(most_bytes.saturating_add(1))
        .read_to_end(&mut bytes)?;
    if bytes.len() as u64 > most_bytes {
        return Err(Unread::TooLong(most_bytes).into());
    }
    Ok(bytes)
}

/// Reads and checks the world file at `path`.
///
/// # Errors
/// [`WorldError`]
pub fn load_world(path: &Path) -> Result<World, WorldError> {
    let unread = |source| WorldError::Read {
        path: path.to_owned(),
        source,
    };
    let bytes = read(path, MAX_TEXT_BYTES).map_err(unread)?;
    let text = String::from_utf8(bytes)
        .map_err(|error| unread(io::Error::new(io::ErrorKind::InvalidData, error)))?;
    World::parse(&text)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn why(path: &Path) -> Option<Unread> {
        let error = read(path, 4).unwrap_err();
        error.get_ref()?.downcast_ref().copied()
    }

    #[test]
    fn what_is_no_file_or_too_long_is_told_and_not_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let mode = nix::sys::stat::Mode::S_IRUSR | nix::sys::stat::Mode::S_IWUSR;
        nix::unistd::mkfifo(&at("pipe"), mode).unwrap();
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).unwrap();
        fs::write(at("fits"), "1234").unwrap();
        fs::write(at("long"), "12345").unwrap();
        std::os::unix::fs::symlink(at("pipe"), at("link")).unwrap();
        assert_eq!(read(&at("fits"), 4).unwrap(), b"1234");
        assert_eq!(why(&at("long")), Some(Unread::TooLong(4)));
        assert_eq!(why(Path::new("/proc/self/maps")), Some(Unread::TooLong(4)));
        for (path, what) in [
            (at("pipe"), "a pipe"),
            (at("link"), "a pipe"),
            (at("socket"), "a socket"),
            (folder.path().to_owned(), "a folder"),
            ("/dev/zero".into(), "a device"),
        ] {
            assert_eq!(why(&path), Some(Unread::NotAFile(what)), "{path:?}");
        }
        let error = read(&at("gone"), 4).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::NotFound);
    }
}
