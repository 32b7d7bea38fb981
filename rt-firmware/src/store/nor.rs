//! A flash for tests: it minds the rules of NOR flash, and power can be lost in each of its
//! operations.
//!
//! What an operation that was cut leaves behind is the worst that chips are known for: some bits
//! changed and some not; bits that are *weak* and read today like this and tomorrow like that;
//! units that cannot be read at all; after an erase, anything.

use core::hash::{Hash, Hasher};
use core::ops::Range;
use std::cell::RefCell;
use std::rc::Rc;
use std::string::String;
use std::vec;
use std::vec::Vec;

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};

use super::layout::BLOCK_BYTES;

/// How bits that are weak read in the sessions that follow: a session is the time from one power-on
/// to the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Flicker {
    /// As before the cut and as after it in turn, after it first.
    NewOld,
    /// The other way round.
    OldNew,
    /// Twice as if the operation had been done, then not.
    NewNewOld,
    /// Not done, then twice done, then not.
    OldNewNew,
    /// Another value with each reading.
    Noise,
}

impl Flicker {
    /// Which bits of a byte read as new, `age` sessions after the cut.
    fn phase(self, age: u32, random: &mut Random) -> u8 {
        let new = match self {
            Flicker::NewOld => age.is_multiple_of(2),
            Flicker::OldNew => !age.is_multiple_of(2),
            Flicker::NewNewOld => age % 3 < 2,
            Flicker::OldNewNew => !age.is_multiple_of(3),
            Flicker::Noise => return random.next() as u8,
        };
        if new { 0xFF } else { 0 }
    }
}

/// What becomes of an operation that is cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tear {
    /// It was not begun.
    Nothing,
    /// It was done, but nobody was told.
    Whole,
    /// Only the first half of its bytes.
    FirstHalf,
    /// Only the second half.
    LastHalf,
    /// One bit only.
    OneBit,
    /// All bits but one.
    AllButOneBit,
    /// Some bits.
    Some(u32),
    /// All bits that it would have changed are weak.
    Weak(Flicker),
    /// Some bits changed, some are weak, some are as before.
    SomeWeak(u32, Flicker),
    /// The units that it would have changed cannot be read.
    Unreadable,
    /// Of a block of the range, all bits; the others are as before.
    OnlyBlock(usize),
    /// Of a block of the range, all bits; the others are weak.
    BlockAndWeak(usize, Flicker),
    /// Zeros, which some chips write before they erase.
    Zeros,
    /// Anything.
    Garbage(u32),
}

/// A cut of power, or an error of the flash.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Cut {
    /// The number of the operation, and what it is: a cut of another kind does not happen.
    pub(super) at: usize,
    pub(super) kind: Kind,
    pub(super) tear: Tear,
    /// Power is lost; else the operation returns an error, and power stays.
    pub(super) is_loss: bool,
}

/// What the flash does with a write to a unit whose writing was cut.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rewrite {
    /// Zeros are added.
    Merge,
    /// An error.
    Refuse,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Write,
    Erase,
}

#[derive(Clone, Copy)]
pub(super) struct Geometry {
    pub(super) write: usize,
    pub(super) rewrite: Rewrite,
}

/// What a write unit went through since it was erased: some of these.
type Unit = u8;
const WRITTEN: Unit = 1;
const TORN: Unit = 2;
const UNREADABLE: Unit = 4;

#[derive(Clone)]
pub(super) struct Nor {
    geometry: Geometry,
    cells: Vec<u8>,
    /// Bits that read differently from time to time, and of which tear they are.
    weak: Vec<u8>,
    weak_since: Vec<u8>,
    /// Sessions of the tears that left weak bits, and how these read.
    weak_tears: Vec<(u32, Flicker)>,
    any_weak: bool,
    units: Vec<Unit>,
    /// Bits that cannot be programmed.
    worn: Vec<(usize, u8)>,
    session: u32,
    random: Random,
    /// Operations so far: each is a possible cut.
    pub(super) operations: usize,
    /// The operations since somebody began to look.
    pub(super) log: Vec<Kind>,
    pub(super) cut: Option<Cut>,
    /// The operation that was cut, and whether power is off.
    pub(super) fired: Option<Kind>,
    pub(super) is_off: bool,
    /// What must not be touched, and the part of it that may be written.
    pub(super) running: Option<(Range<usize>, Range<usize>)>,
    /// The first rule that was broken.
    pub(super) breach: Option<String>,
    pub(super) erases: u32,
    pub(super) writes: u32,
    pub(super) bytes_read: usize,
    pub(super) reads: usize,
    /// The reading of this number fails.
    pub(super) failing_read: Option<usize>,
}

#[derive(Clone)]
pub(super) struct Random(pub(super) u32);

impl Random {
    pub(super) fn next(&mut self) -> u32 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 17;
        self.0 ^= self.0 << 5;
        self.0
    }
}

impl Nor {
    pub(super) fn new(geometry: Geometry, len: usize) -> Self {
        Nor {
            geometry,
            cells: vec![0xFF; len],
            weak: vec![0; len],
            weak_since: vec![0; len],
            weak_tears: Vec::new(),
            any_weak: false,
            units: vec![0; len / geometry.write],
            worn: Vec::new(),
            session: 0,
            random: Random(0x2545_F491),
            operations: 0,
            log: Vec::new(),
            cut: None,
            fired: None,
            is_off: false,
            running: None,
            breach: None,
            erases: 0,
            writes: 0,
            bytes_read: 0,
            reads: 0,
            failing_read: None,
        }
    }

    /// What a flash holds when it is new may be anything.
    pub(super) fn fill(&mut self, byte: u8) {
        self.cells.fill(byte);
        for unit in &mut self.units {
            *unit |= WRITTEN;
        }
    }

    /// Puts bytes there, as if they had been written long ago.
    pub(super) fn put(&mut self, at: usize, bytes: &[u8]) {
        self.cells[at..at + bytes.len()].copy_from_slice(bytes);
        for unit in &mut self.units
            [at / self.geometry.write..(at + bytes.len()).div_ceil(self.geometry.write)]
        {
            *unit |= WRITTEN;
        }
    }

    pub(super) fn byte(&self, at: usize) -> u8 {
        self.cells[at]
    }

    pub(super) fn flip(&mut self, at: usize, bit: u8) {
        self.cells[at] ^= 1 << bit;
    }

    pub(super) fn wear(&mut self, at: usize, bits: u8) {
        self.worn.push((at, bits));
    }

    /// What matters for all that follows.
    pub(super) fn fingerprint(&self, hasher: &mut impl Hasher) {
        // Most of it is blank.
        const PART: usize = 64;
        let blank = ([0xFF; PART], [0; PART]);
        for (at, part) in self.cells.chunks(PART).enumerate() {
            if part != blank.0 {
                (at, part).hash(hasher);
            }
        }
        for (at, part) in self.units.chunks(PART).enumerate() {
            if part != blank.1 {
                (at, part).hash(hasher);
            }
        }
        if !self.any_weak {
            return;
        }
        for (at, mask) in self.weak.iter().enumerate().filter(|(_, mask)| **mask != 0) {
            let (since, flicker) = self.weak_tears[usize::from(self.weak_since[at])];
            // What flickers starts anew after two sessions or three.
            let age = self.session.saturating_sub(since) % 6;
            (at, mask, flicker, age).hash(hasher);
            if flicker == Flicker::Noise {
                self.random.0.hash(hasher);
            }
        }
    }

    pub(super) fn power_on(&mut self) {
        self.is_off = false;
        self.fired = None;
        self.cut = None;
        self.running = None;
        self.session += 1;
    }

    fn break_rule(&mut self, rule: &str) {
        self.breach.get_or_insert_with(|| rule.into());
    }

    fn read(&mut self, at: usize, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        let range = at..at + bytes.len();
        if self.is_off {
            return Err(NorFlashErrorKind::Other);
        }
        if range.end > self.cells.len() {
            return Err(NorFlashErrorKind::OutOfBounds);
        }
        self.bytes_read += bytes.len();
        self.reads += 1;
        if self.failing_read == Some(self.reads) {
            return Err(NorFlashErrorKind::Other);
        }
        bytes.copy_from_slice(&self.cells[range.clone()]);
        if self.any_weak {
            if self.units(&range).iter().any(|unit| unit & UNREADABLE != 0) {
                return Err(NorFlashErrorKind::Other);
            }
            for (byte, at) in bytes.iter_mut().zip(range) {
                let mask = self.weak[at];
                if mask != 0 {
                    let (since, flicker) = self.weak_tears[usize::from(self.weak_since[at])];
                    *byte ^= mask
                        & flicker.phase(self.session.saturating_sub(since + 1), &mut self.random);
                }
            }
        }
        Ok(())
    }

    fn units(&mut self, range: &Range<usize>) -> &mut [Unit] {
        &mut self.units[range.start / self.geometry.write..range.end.div_ceil(self.geometry.write)]
    }

    /// Does an operation that leaves `goal` in `range`, or what a cut makes of it.
    fn operate(
        &mut self,
        kind: Kind,
        range: Range<usize>,
        goal: &dyn Fn(usize, u8) -> u8,
    ) -> Result<(), NorFlashErrorKind> {
        if self.is_off {
            return Err(NorFlashErrorKind::Other);
        }
        if range.end > self.cells.len() {
            return Err(NorFlashErrorKind::OutOfBounds);
        }
        if let Some((running, notes)) = &self.running {
            let touches = range.start < running.end && running.start < range.end;
            let is_note =
                kind == Kind::Write && notes.start <= range.start && range.end <= notes.end;
            if touches && !is_note {
                self.break_rule("the slot that runs was touched");
            }
        }
        let number = self.operations;
        self.operations += 1;
        self.log.push(kind);
        match kind {
            Kind::Write => self.writes += 1,
            Kind::Erase => self.erases += 1,
        }
        let cut = self.cut.filter(|cut| cut.at == number && cut.kind == kind);
        let tear = cut.map_or(Tear::Whole, |cut| cut.tear);
        self.tear(kind, range, goal, tear);
        let Some(cut) = cut else { return Ok(()) };
        self.cut = None;
        self.fired = Some(kind);
        self.is_off = cut.is_loss;
        Err(NorFlashErrorKind::Other)
    }

    fn tear(
        &mut self,
        kind: Kind,
        range: Range<usize>,
        goal: &dyn Fn(usize, u8) -> u8,
        tear: Tear,
    ) {
        if tear == Tear::Nothing {
            return;
        }
        if tear == Tear::Whole && kind == Kind::Erase && self.worn.is_empty() {
            self.cells[range.clone()].fill(0xFF);
            self.weak[range.clone()].fill(0);
            self.units(&range).fill(0);
            self.any_weak &= self.weak.iter().any(|mask| *mask != 0)
                || self.units.iter().any(|unit| unit & UNREADABLE != 0);
            return;
        }
        let (middle, session) = (range.start + range.len() / 2, self.session);
        let mut seed = Random(match tear {
            Tear::Some(seed) | Tear::SomeWeak(seed, _) | Tear::Garbage(seed) => seed,
            _ => 1,
        });
        let mut is_first_bit = true;
        for at in range.clone() {
            let old = self.cells[at];
            let change = old ^ goal(at, old);
            let block = (at - range.start) / BLOCK_BYTES;
            let lowest = change & change.wrapping_neg();
            // Which bits change for good, and which are weak.
            let (done, weak, flicker) = match tear {
                Tear::Nothing => (0, 0, None),
                Tear::Whole => (0xFF, 0, None),
                Tear::FirstHalf => (if at < middle { 0xFF } else { 0 }, 0, None),
                Tear::LastHalf => (if at < middle { 0 } else { 0xFF }, 0, None),
                Tear::OneBit => (if is_first_bit { lowest } else { 0 }, 0, None),
                Tear::AllButOneBit => (if is_first_bit { !lowest } else { 0xFF }, 0, None),
                Tear::Some(_) => (seed.next() as u8, 0, None),
                Tear::Weak(flicker) => (0, 0xFF, Some(flicker)),
                Tear::SomeWeak(_, flicker) => (seed.next() as u8, seed.next() as u8, Some(flicker)),
                Tear::Unreadable => (0, 0, None),
                Tear::OnlyBlock(only) => (if block == only { 0xFF } else { 0 }, 0, None),
                Tear::BlockAndWeak(only, flicker) => {
                    (if block == only { 0xFF } else { 0 }, 0xFF, Some(flicker))
                }
                Tear::Zeros => {
                    self.cells[at] = 0;
                    (0, 0, None)
                }
                Tear::Garbage(_) => {
                    self.cells[at] = seed.next() as u8;
                    (0, 0, None)
                }
            };
            is_first_bit &= change == 0;
            self.cells[at] ^= change & done;
            if tear == Tear::Whole && kind == Kind::Erase {
                self.weak[at] = 0;
            }
            // A bit that was programmed for good is not weak any more.
            let settled = change & done;
            self.weak[at] &= !settled;
            let weak = change & !done & weak;
            if let (Some(flicker), true) = (flicker, weak != 0) {
                if self.weak_tears.last() != Some(&(session, flicker)) {
                    self.weak_tears.push((session, flicker));
                }
                self.weak[at] |= weak;
                self.weak_since[at] = self.weak_tears.len() as u8 - 1;
                self.any_weak = true;
            }
        }
        for (at, bits) in self.worn.clone() {
            if range.contains(&at) {
                self.cells[at] |= bits;
            }
        }
        let is_whole = tear == Tear::Whole;
        self.any_weak |= tear == Tear::Unreadable;
        for unit in self.units(&range) {
            let was_unreadable = *unit & UNREADABLE != 0;
            let is_erased = is_whole && kind == Kind::Erase;
            *unit = if is_erased { 0 } else { WRITTEN };
            if !is_whole {
                *unit |= TORN;
            }
            if tear == Tear::Unreadable || was_unreadable && !is_erased {
                *unit |= UNREADABLE;
            }
        }
    }
}

/// What the store takes for its flash: the test keeps the other end.
#[derive(Clone)]
pub(super) struct Chip<const WRITE: usize, const ERASE: usize>(pub(super) Rc<RefCell<Nor>>);

impl<const WRITE: usize, const ERASE: usize> ErrorType for Chip<WRITE, ERASE> {
    type Error = NorFlashErrorKind;
}

impl<const WRITE: usize, const ERASE: usize> ReadNorFlash for Chip<WRITE, ERASE> {
    const READ_SIZE: usize = 4;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        let mut nor = self.0.borrow_mut();
        if !offset.is_multiple_of(4) || !bytes.len().is_multiple_of(4) {
            nor.break_rule("a reading is not aligned");
        }
        nor.read(offset as usize, bytes)
    }

    fn capacity(&self) -> usize {
        self.0.borrow().cells.len()
    }
}

impl<const WRITE: usize, const ERASE: usize> NorFlash for Chip<WRITE, ERASE> {
    const WRITE_SIZE: usize = WRITE;
    const ERASE_SIZE: usize = ERASE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        let mut nor = self.0.borrow_mut();
        let range = from as usize..to as usize;
        if from > to || !range.start.is_multiple_of(ERASE) || !range.end.is_multiple_of(ERASE) {
            nor.break_rule("an erase is not aligned");
        }
        nor.operate(Kind::Erase, range, &|_, _| 0xFF)
    }

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        let mut nor = self.0.borrow_mut();
        let start = offset as usize;
        let range = start..start + bytes.len();
        if !start.is_multiple_of(WRITE) || !bytes.len().is_multiple_of(WRITE) {
            nor.break_rule("a write is not aligned");
        }
        if range.end > nor.cells.len() {
            return Err(NorFlashErrorKind::OutOfBounds);
        }
        if nor.is_off {
            return Err(NorFlashErrorKind::Other);
        }
        if nor
            .units(&range)
            .iter()
            .any(|unit| unit & (WRITTEN | TORN) == WRITTEN)
        {
            nor.break_rule("a unit was written twice");
        }
        let refuses = nor.geometry.rewrite == Rewrite::Refuse;
        if nor
            .units(&range)
            .iter()
            .any(|unit| unit & UNREADABLE != 0 || (unit & TORN != 0 && refuses))
        {
            return Err(NorFlashErrorKind::Other);
        }
        nor.operate(Kind::Write, range, &|at, old| old & bytes[at - start])
    }
}
