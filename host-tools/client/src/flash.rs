//! The flash of a simulated robot: its cells, in memory or in a file, and what becomes of them when
//! power is lost in the middle of an operation.
//!
//! Boards reach it by the messages of `rt_firmware::body::flash`.

use std::fs::{File, OpenOptions};
use std::io::{self, Read, Seek, SeekFrom, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};
use rt_firmware::body::flash::{
    ERASE_BYTES, FlashRequest, MAX_PART_BYTES, Operation, REQUEST_HEADER_BYTES, WRITE_BYTES,
    status_number,
};

use crate::files;

/// What an erased byte reads as.
const BLANK: u8 = 0xFF;

/// Why a file is no flash.
#[derive(Debug, thiserror::Error)]
pub enum FlashError {
    /// The system.
    #[error("cannot open the flash {}: {cause}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What the system says.
        cause: io::Error,
    },
    /// Another run has it.
    #[error("the flash {} is in use by another run", path.display())]
    InUse {
        /// The file.
        path: PathBuf,
    },
    /// It has another length.
    #[error(
        "{} is no flash of this board: it has {found} bytes, the board's flash has {expected}",
        path.display()
    )]
    Length {
        /// The file.
        path: PathBuf,
        /// Its length in bytes.
        found: u64,
        /// That of the board's flash.
        expected: u32,
    },
}

/// What is left of an operation in which power is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tear {
    /// It was not begun.
    Nothing,
    /// It was done, but nobody was told.
    Whole,
    /// The first half of its bytes is done.
    FirstHalf,
    /// The second half is done.
    LastHalf,
    /// Of each byte some bits are done, others with each seed.
    SomeBits(u32),
}

/// When power is lost.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PowerCut {
    /// In this one of the writes and erases, counted from 0 since the flash was made or opened.
    pub operation: u64,
    /// What is left of it.
    pub tear: Tear,
}

/// A flash, shared by whoever answers the board and whoever watches.
#[derive(Clone)]
pub struct Flash {
    shared: Arc<(Mutex<Cells>, Condvar)>,
    bytes: u32,
}

struct Cells {
    cells: Vec<u8>,
    image: Option<File>,
    /// Writes and erases so far.
    operations: u64,
    cut: Option<PowerCut>,
    is_off: bool,
    /// What takes no write and no erase any more.
    worn: Vec<Range<usize>>,
}

impl Flash {
    /// A blank flash of so many bytes, which ends with the process.
    pub fn blank(bytes: u32) -> Self {
        Self::of(vec![BLANK; bytes as usize], None)
    }

    /// A flash whose cells are a file's, which is made if it is not there. Each operation is in the
    /// file when it is done.
    ///
    /// # Errors
    /// [`FlashError`]
    pub fn open(path: &Path, bytes: u32) -> Result<Self, FlashError> {
        let failed = |cause| FlashError::File {
            path: path.to_owned(),
            cause,
        };
        // What is no file would keep nothing, or keep this waiting.
        match files::require(path) {
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            found => found.map_err(failed)?,
        }
        let mut file = OpenOptions::new()
            .read(true)
            .write(true)
            .create(true)
            .truncate(false)
            .open(path)
            .map_err(failed)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(std::fs::TryLockError::WouldBlock) => {
                return Err(FlashError::InUse {
                    path: path.to_owned(),
                });
            }
            Err(std::fs::TryLockError::Error(cause)) => return Err(failed(cause)),
        }
        let found = file.metadata().map_err(failed)?.len();
        let mut cells = vec![BLANK; bytes as usize];
        if found == 0 {
            file.write_all(&cells).map_err(failed)?;
        } else if found == u64::from(bytes) {
            file.read_exact(&mut cells).map_err(failed)?;
        } else {
            return Err(FlashError::Length {
                path: path.to_owned(),
                found,
                expected: bytes,
            });
        }
        Ok(Self::of(cells, Some(file)))
    }

    fn of(cells: Vec<u8>, image: Option<File>) -> Self {
        Flash {
            bytes: cells.len() as u32,
            shared: Arc::new((
                Mutex::new(Cells {
                    cells,
                    image,
                    operations: 0,
                    cut: None,
                    is_off: false,
                    worn: Vec::new(),
                }),
                Condvar::new(),
            )),
        }
    }

    /// Its length in bytes.
    pub fn bytes(&self) -> u32 {
        self.bytes
    }

    /// Lets power fail in an operation to come. From then on nobody is answered, until
    /// [`power_on`](Flash::power_on).
    pub fn cut_power(&self, cut: PowerCut) {
        self.lock().cut = Some(cut);
    }

    /// Power is there again.
    pub fn power_on(&self) {
        let mut cells = self.lock();
        cells.cut = None;
        cells.is_off = false;
    }

    /// Waits until power has failed, for so long at most. Returns whether it has.
    pub fn wait_for_power_cut(&self, limit: Duration) -> bool {
        let (_, failed) = &*self.shared;
        let waited = failed.wait_timeout_while(self.lock(), limit, |cells| !cells.is_off);
        let (cells, _) = waited.unwrap_or_else(PoisonError::into_inner);
        cells.is_off
    }

    /// Writes and erases since it was made or opened.
    pub fn operations(&self) -> u64 {
        self.lock().operations
    }

    /// All of its bytes.
    pub fn cells(&self) -> Vec<u8> {
        self.lock().cells.clone()
    }

    /// A flash with the same bytes and a life of its own.
    pub fn copy(&self) -> Self {
        Self::of(self.cells(), None)
    }

    /// Changes bits of a byte, as the years do.
    pub fn flip(&self, address: usize, bits: u8) {
        if let Some(cell) = self.lock().cells.get_mut(address) {
            *cell ^= bits;
        }
    }

    /// From now on these bytes take no write and no erase: each is an error, and changes nothing.
    pub fn wear_out(&self, bytes: Range<usize>) {
        self.lock().worn.push(bytes);
    }

    /// The reply to a request, whose bytes to write are `written`; `None` where power has failed.
    pub fn answer(&self, request: &FlashRequest, written: &[u8]) -> Option<Vec<u8>> {
        let mut cells = self.lock();
        let from = request.address as usize;
        let range = from..from.saturating_add(request.len as usize);
        let result = match request.operation {
            Operation::Read => cells.read(range).map(<[u8]>::to_vec),
            Operation::Write => cells.write(range, written).map(|()| Vec::new()),
            Operation::Erase => cells.erase(range).map(|()| Vec::new()),
        };
        let is_off = cells.is_off;
        drop(cells);
        if is_off {
            self.shared.1.notify_all();
            return None;
        }
        let status = status_number(result.as_ref().map(|_| ()).map_err(|kind| *kind));
        let mut reply = vec![status];
        reply.extend(result.unwrap_or_default());
        Some(reply)
    }

    /// Answers requests until the board has closed its end, or power has failed.
    ///
    /// # Errors
    /// What the system says of the pipes.
    pub fn serve(&self, mut requests: impl Read, mut replies: impl Write) -> io::Result<()> {
        let mut head = [0; REQUEST_HEADER_BYTES];
        loop {
            match requests.read_exact(&mut head) {
                Ok(()) => {}
                Err(error) if error.kind() == io::ErrorKind::UnexpectedEof => return Ok(()),
                Err(error) => return Err(error),
            }
            let request = FlashRequest::decode(&head)
                .filter(|request| {
                    request.written_bytes().max(request.read_bytes()) <= MAX_PART_BYTES
                })
                .ok_or(io::ErrorKind::InvalidData)?;
            let mut written = vec![0; request.written_bytes()];
            requests.read_exact(&mut written)?;
            match self.answer(&request, &written) {
                Some(reply) => replies.write_all(&reply)?,
                None => return Ok(()),
            }
        }
    }

    /// A thread that panicked while it held the lock has left cells between two bytes of an
    /// operation, as a loss of power does.
    fn lock(&self) -> MutexGuard<'_, Cells> {
        self.shared.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Cells {
    fn read(&self, range: Range<usize>) -> Result<&[u8], NorFlashErrorKind> {
        self.cells.get(range).ok_or(NorFlashErrorKind::OutOfBounds)
    }

    fn write(&mut self, range: Range<usize>, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        if !range.start.is_multiple_of(WRITE_BYTES) || !bytes.len().is_multiple_of(WRITE_BYTES) {
            return Err(NorFlashErrorKind::NotAligned);
        }
        // A unit is written once between two erases.
        if self.read(range.clone())?.iter().any(|cell| *cell != BLANK) {
            return Err(NorFlashErrorKind::Other);
        }
        self.operate(range, |at| bytes.get(at).copied().unwrap_or(BLANK))
    }

    fn erase(&mut self, range: Range<usize>) -> Result<(), NorFlashErrorKind> {
        if !range.start.is_multiple_of(ERASE_BYTES) || !range.len().is_multiple_of(ERASE_BYTES) {
            return Err(NorFlashErrorKind::NotAligned);
        }
        self.operate(range, |_| BLANK)
    }

    /// Puts what `goal` says of each byte of the range, or what a loss of power leaves of that.
    fn operate(
        &mut self,
        range: Range<usize>,
        goal: impl Fn(usize) -> u8,
    ) -> Result<(), NorFlashErrorKind> {
        let is_worn = |worn: &Range<usize>| worn.start < range.end && range.start < worn.end;
        if self.worn.iter().any(is_worn) {
            return Err(NorFlashErrorKind::Other);
        }
        let (start, half) = (range.start, range.len() / 2);
        let cut = self.cut.filter(|cut| cut.operation == self.operations);
        let tear = cut.map_or(Tear::Whole, |cut| cut.tear);
        let mut seed = match tear {
            Tear::SomeBits(seed) => seed | 1,
            _ => 1,
        };
        let cells = self
            .cells
            .get_mut(range)
            .ok_or(NorFlashErrorKind::OutOfBounds)?;
        self.operations += 1;
        for (at, cell) in cells.iter_mut().enumerate() {
            let done = match tear {
                Tear::Nothing => 0,
                Tear::Whole => 0xFF,
                Tear::FirstHalf => u8::from(at < half) * 0xFF,
                Tear::LastHalf => u8::from(at >= half) * 0xFF,
                Tear::SomeBits(_) => {
                    seed ^= seed << 13;
                    seed ^= seed >> 17;
                    seed ^= seed << 5;
                    (seed >> 8) as u8
                }
            };
            *cell ^= (*cell ^ goal(at)) & done;
        }
        if let Some(image) = &mut self.image {
            let kept = image
                .seek(SeekFrom::Start(start as u64))
                .and_then(|_| image.write_all(cells));
            // A disk that is full is a flash that is worn.
            kept.map_err(|_| NorFlashErrorKind::Other)?;
        }
        self.is_off |= cut.is_some();
        Ok(())
    }
}

impl ErrorType for Flash {
    type Error = NorFlashErrorKind;
}

/// For a board of the same process.
impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let cells = self.lock();
        let from = offset as usize;
        if cells.is_off {
            return Err(NorFlashErrorKind::Other);
        }
        bytes.copy_from_slice(cells.read(from..from.saturating_add(bytes.len()))?);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes as usize
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = WRITE_BYTES;
    const ERASE_SIZE: usize = ERASE_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.operate_here(Operation::Erase, from, to.saturating_sub(from), &[])
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.operate_here(Operation::Write, offset, bytes.len() as u32, bytes)
    }
}

impl Flash {
    fn operate_here(
        &mut self,
        operation: Operation,
        address: u32,
        len: u32,
        written: &[u8],
    ) -> Result<(), NorFlashErrorKind> {
        if self.lock().is_off {
            return Err(NorFlashErrorKind::Other);
        }
        let request = FlashRequest {
            operation,
            address,
            len,
        };
        let status = self
            .answer(&request, written)
            .and_then(|reply| reply.first().copied());
        status.map_or(
            Err(NorFlashErrorKind::Other),
            rt_firmware::body::flash::status_of,
        )
    }
}

/// The same cells, as a flash that erases so many bytes at once.
#[derive(Clone)]
pub struct InSectors<const BYTES: usize>(pub Flash);

impl<const BYTES: usize> InSectors<BYTES> {
    /// What is erased at once.
    pub const BYTES: u32 = BYTES as u32;
}

impl<const BYTES: usize> ErrorType for InSectors<BYTES> {
    type Error = NorFlashErrorKind;
}

impl<const BYTES: usize> ReadNorFlash for InSectors<BYTES> {
    const READ_SIZE: usize = Flash::READ_SIZE;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        self.0.read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl<const BYTES: usize> NorFlash for InSectors<BYTES> {
    const WRITE_SIZE: usize = Flash::WRITE_SIZE;
    const ERASE_SIZE: usize = BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.0.erase(from, to)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        self.0.write(offset, bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_byte_is_written_once_between_two_erases() {
        let mut flash = Flash::blank(2048);
        assert_eq!(flash.write(8, &[0; 8]), Ok(()));
        assert_eq!(flash.write(8, &[0; 8]), Err(NorFlashErrorKind::Other));
        assert_eq!(flash.write(4, &[0; 8]), Err(NorFlashErrorKind::NotAligned));
        assert_eq!(
            flash.write(2048, &[0; 8]),
            Err(NorFlashErrorKind::OutOfBounds)
        );
        assert_eq!(flash.erase(8, 1032), Err(NorFlashErrorKind::NotAligned));
        assert_eq!(flash.erase(0, 1024), Ok(()));
        assert_eq!(flash.write(8, &[1; 8]), Ok(()));
        assert_eq!(flash.cells()[7..17], [0xFF, 1, 1, 1, 1, 1, 1, 1, 1, 0xFF]);
        assert_eq!(flash.operations(), 3);
    }

    #[test]
    fn what_is_worn_out_takes_nothing_and_is_read_as_it_is() {
        let mut flash = Flash::blank(3072);
        assert_eq!(flash.write(1024, &[7; 8]), Ok(()));
        flash.wear_out(1024..2048);
        assert_eq!(flash.write(1032, &[0; 8]), Err(NorFlashErrorKind::Other));
        assert_eq!(flash.erase(0, 2048), Err(NorFlashErrorKind::Other));
        assert_eq!(flash.erase(0, 1024), Ok(()));
        flash.wear_out(0..1);
        assert_eq!(flash.erase(0, 1024), Err(NorFlashErrorKind::Other));
        assert_eq!(flash.write(2048, &[0; 8]), Ok(()));
        let mut bytes = [0; 16];
        assert_eq!(flash.read(1024, &mut bytes), Ok(()));
        assert_eq!(
            bytes,
            [
                7, 7, 7, 7, 7, 7, 7, 7, 255, 255, 255, 255, 255, 255, 255, 255
            ]
        );
    }

    #[test]
    fn power_fails_in_the_operation_that_was_named_and_nothing_happens_after_it() {
        for (tear, expected) in [
            (Tear::Nothing, [0xFF; 8]),
            (Tear::Whole, [0; 8]),
            (Tear::FirstHalf, [0, 0, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF]),
            (Tear::LastHalf, [0xFF, 0xFF, 0xFF, 0xFF, 0, 0, 0, 0]),
        ] {
            let mut flash = Flash::blank(1024);
            flash.cut_power(PowerCut { operation: 1, tear });
            assert_eq!(flash.write(0, &[0; 8]), Ok(()));
            assert!(!flash.wait_for_power_cut(Duration::ZERO));
            assert_eq!(flash.write(8, &[0; 8]), Err(NorFlashErrorKind::Other));
            assert!(flash.wait_for_power_cut(Duration::ZERO));
            assert_eq!(flash.write(16, &[0; 8]), Err(NorFlashErrorKind::Other));
            assert_eq!(flash.read(0, &mut [0; 8]), Err(NorFlashErrorKind::Other));
            flash.power_on();
            let mut bytes = [0; 24];
            assert_eq!(flash.read(0, &mut bytes), Ok(()));
            assert_eq!(bytes[..8], [0; 8]);
            assert_eq!(bytes[8..16], expected, "{tear:?}");
            assert_eq!(bytes[16..], [0xFF; 8]);
        }
    }

    #[test]
    fn a_file_keeps_what_was_written_and_is_one_runs_at_a_time() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("robot.flash");
        let mut flash = Flash::open(&path, 1024).unwrap();
        assert_eq!(flash.write(16, b"whatever"), Ok(()));
        assert!(matches!(
            Flash::open(&path, 1024),
            Err(FlashError::InUse { .. })
        ));
        drop(flash);
        let mut again = Flash::open(&path, 1024).unwrap();
        let mut bytes = [0; 9];
        assert_eq!(again.read(16, &mut bytes), Ok(()));
        assert_eq!(&bytes, b"whatever\xFF");
        drop(again);
        let other = Flash::open(&path, 2048).map(drop);
        assert!(matches!(other, Err(FlashError::Length { found: 1024, .. })));
    }
}
