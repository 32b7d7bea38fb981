//! The flash of a robot whose body is simulated: the plant holds its cells, and can lose power in
//! each of its operations.
//!
//! It is a NOR flash beside the chip, as a serial one is: it erases [`ERASE_BYTES`] at once to
//! 0xFF, and writes [`WRITE_BYTES`] at once, each once between two erases. A board reaches it by
//! messages of its own ([`FlashWire`]), apart from those of the pins, so that an operation and a
//! slot's exchange never mix. Numbers are little endian:
//!
//! | request | bytes | | reply | bytes |
//! |---|---|---|---|---|
//! | operation: 0 read, 1 write, 2 erase | 1 | | 0 done, 1 beyond the end, 2 not aligned, 3 refused | 1 |
//! | address | 4 | | to a read that was done: what was read | its length |
//! | length; [`MAX_PART_BYTES`] at most for a read and a write | 4 | | | |
//! | of a write: the bytes | its length | | | |

use embedded_storage::nor_flash::{
    ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash, check_erase, check_write,
};

/// What is erased at once, in bytes.
pub const ERASE_BYTES: usize = 1024;
/// What is written at once, in bytes.
pub const WRITE_BYTES: usize = 8;
/// How long an erase of [`ERASE_BYTES`] takes, in microseconds.
pub const ERASE_US: u32 = 20_000;
/// How long a write of [`WRITE_BYTES`] takes, in microseconds.
pub const WRITE_US: u32 = 40;

/// The most bytes that one read or write carries.
pub const MAX_PART_BYTES: usize = 64;
/// Bytes of a request before those that are to be written.
pub const REQUEST_HEADER_BYTES: usize = 9;

/// What is done to the flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Read these many bytes.
    Read,
    /// Write the bytes that follow.
    Write,
    /// Erase these many bytes.
    Erase,
}

/// The head of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FlashRequest {
    /// What to do.
    pub operation: Operation,
    /// The first byte.
    pub address: u32,
    /// How many bytes.
    pub len: u32,
}

impl FlashRequest {
    /// The head as bytes.
    pub fn encode(&self) -> [u8; REQUEST_HEADER_BYTES] {
        let [a0, a1, a2, a3] = self.address.to_le_bytes();
        let [l0, l1, l2, l3] = self.len.to_le_bytes();
        [self.operation as u8, a0, a1, a2, a3, l0, l1, l2, l3]
    }

    /// The head in `bytes`, if it is one.
    pub fn decode(bytes: &[u8; REQUEST_HEADER_BYTES]) -> Option<Self> {
        let [operation, a0, a1, a2, a3, l0, l1, l2, l3] = *bytes;
        let operation = match operation {
            0 => Operation::Read,
            1 => Operation::Write,
            2 => Operation::Erase,
            _ => return None,
        };
        Some(Self {
            operation,
            address: u32::from_le_bytes([a0, a1, a2, a3]),
            len: u32::from_le_bytes([l0, l1, l2, l3]),
        })
    }

    /// Bytes that follow this head.
    pub fn written_bytes(&self) -> usize {
        match self.operation {
            Operation::Write => self.len as usize,
            Operation::Read | Operation::Erase => 0,
        }
    }

    /// Bytes that a reply has behind its status, if the request is done.
    pub fn read_bytes(&self) -> usize {
        match self.operation {
            Operation::Read => self.len as usize,
            Operation::Write | Operation::Erase => 0,
        }
    }
}

/// The number of a status in a reply.
pub fn status_number(result: Result<(), NorFlashErrorKind>) -> u8 {
    match result {
        Ok(()) => 0,
        Err(NorFlashErrorKind::OutOfBounds) => 1,
        Err(NorFlashErrorKind::NotAligned) => 2,
        Err(_) => 3,
    }
}

/// The status of this number.
pub fn status_of(number: u8) -> Result<(), NorFlashErrorKind> {
    match number {
        0 => Ok(()),
        1 => Err(NorFlashErrorKind::OutOfBounds),
        2 => Err(NorFlashErrorKind::NotAligned),
        _ => Err(NorFlashErrorKind::Other),
    }
}

/// The way from a board to its flash.
pub trait FlashWire {
    /// Sends a request, `written` behind its head, and waits for the reply: its status, and what
    /// was read into `room`. None if nobody answers.
    fn exchange(
        &mut self,
        request: &FlashRequest,
        written: &[u8],
        room: &mut [u8],
    ) -> Option<Result<(), NorFlashErrorKind>>;

    /// Waits so many microseconds, which an operation takes.
    fn wait_us(&mut self, us: u32);
}

/// The flash at the other end of a wire.
#[derive(Clone, Copy, Debug)]
pub struct BodyFlash<W> {
    wire: W,
    bytes: u32,
}

impl<W: FlashWire> BodyFlash<W> {
    /// A flash of so many bytes.
    pub const fn new(wire: W, bytes: u32) -> Self {
        BodyFlash { wire, bytes }
    }

    fn operate(
        &mut self,
        operation: Operation,
        address: u32,
        len: usize,
        written: &[u8],
        room: &mut [u8],
    ) -> Result<(), NorFlashErrorKind> {
        let request = FlashRequest {
            operation,
            address,
            len: len as u32,
        };
        let answer = self.wire.exchange(&request, written, room);
        answer.unwrap_or(Err(NorFlashErrorKind::Other))
    }
}

impl<W> ErrorType for BodyFlash<W> {
    type Error = NorFlashErrorKind;
}

impl<W: FlashWire> ReadNorFlash for BodyFlash<W> {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let mut address = offset;
        for part in bytes.chunks_mut(MAX_PART_BYTES) {
            self.operate(Operation::Read, address, part.len(), &[], part)?;
            address = address.saturating_add(part.len() as u32);
        }
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.bytes as usize
    }
}

impl<W: FlashWire> NorFlash for BodyFlash<W> {
    const WRITE_SIZE: usize = WRITE_BYTES;
    const ERASE_SIZE: usize = ERASE_BYTES;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        check_erase(self, from, to)?;
        for address in (from..to).step_by(ERASE_BYTES) {
            self.operate(Operation::Erase, address, ERASE_BYTES, &[], &mut [])?;
            self.wire.wait_us(ERASE_US);
        }
        Ok(())
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        check_write(self, offset, bytes.len())?;
        let mut address = offset;
        for part in bytes.chunks(MAX_PART_BYTES) {
            self.operate(Operation::Write, address, part.len(), part, &mut [])?;
            self.wire
                .wait_us((part.len() / WRITE_BYTES) as u32 * WRITE_US);
            address = address.saturating_add(part.len() as u32);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_head_reads_back_as_it_was_written() {
        for operation in [Operation::Read, Operation::Write, Operation::Erase] {
            let request = FlashRequest {
                operation,
                address: 0x1234_5678,
                len: 0x9ABC_DEF0,
            };
            assert_eq!(FlashRequest::decode(&request.encode()), Some(request));
        }
        assert_eq!(FlashRequest::decode(&[3; REQUEST_HEADER_BYTES]), None);
    }

    #[test]
    fn a_status_reads_back_as_it_was_written() {
        use NorFlashErrorKind::{NotAligned, Other, OutOfBounds};
        for status in [Ok(()), Err(OutOfBounds), Err(NotAligned), Err(Other)] {
            assert_eq!(status_of(status_number(status)), status);
        }
    }
}
