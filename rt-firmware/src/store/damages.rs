//! What becomes of a robot's key and of its emergency stop, whatever is damaged of records and
//! journal.
//!
//! The invariants: a robot that had a key lets nobody in without it, one whose emergency stop was
//! latched is stopped, and damage is told. The owner of the key gets in as long as the key is known
//! for certain, and no key of an earlier owner is taken for it.
//!
//! What a start makes of a flash depends on each place of it (a block of an area, or a copy of an
//! entry) by its kind alone: as written, blank, or neither. So all patterns of up to four bits are:
//! within a place, that no such pattern makes something of it that counts; and over places, each
//! choice of up to four that are neither.
//!
//! `ESM_RECORD_DAMAGES=full` before the tests of this module tries all of them, and a million of
//! random flashes.

use std::cell::RefCell;
use std::collections::HashSet;
use std::env;
use std::format;
use std::rc::Rc;
use std::string::String;
use std::vec;
use std::vec::Vec;

use embedded_storage::nor_flash::{ErrorType, NorFlash, NorFlashErrorKind, ReadNorFlash};

use super::flash_store::{FlashStore, RECORD_BYTES, bank_bytes, flash_bytes};
use super::journal::COPY_BYTES;
use super::layout::{BLANK, BLOCK_BYTES, HEADER_BYTES, HEADER_WRITTEN, NOTE, SEALED, TRIED};
use crate::mission_store::MissionStore;
use crate::realtime::params::SavedParams;
use esm_link::key_store::{KeyStore, STORED_KEY_BYTES, StoredKey};
use esm_link::message::{KeyValuesState, WayIn};

type Broken = String;

const BLOB_BYTES: u32 = 512;
const ERASE: usize = 1024;
/// Where areas and journal are.
const FIRST: usize = 2 * bank_bytes(BLOB_BYTES, ERASE as u32) as usize;
const AREA: usize = bank_bytes(RECORD_BYTES as u32, ERASE as u32) as usize;
const JOURNAL: usize = FIRST + 2 * AREA;
const END: usize = flash_bytes(BLOB_BYTES, ERASE as u32) as usize;
/// Pairs of copies in a half of the journal.
const PAIRS: usize = ERASE / (2 * COPY_BYTES);

const OLD_KEY: [u8; STORED_KEY_BYTES] = [0x33; STORED_KEY_BYTES];
const KEY: [u8; STORED_KEY_BYTES] = [0xC5; STORED_KEY_BYTES];

/// A flash that does what it is told.
#[derive(Clone)]
struct Chip(Rc<RefCell<Vec<u8>>>);

impl Chip {
    fn of(cells: &[u8]) -> Self {
        Chip(Rc::new(RefCell::new(cells.to_vec())))
    }

    fn cells(&self) -> Vec<u8> {
        self.0.borrow().clone()
    }
}

impl ErrorType for Chip {
    type Error = NorFlashErrorKind;
}

impl ReadNorFlash for Chip {
    const READ_SIZE: usize = 1;

    fn read(&mut self, at: u32, bytes: &mut [u8]) -> Result<(), NorFlashErrorKind> {
        bytes.copy_from_slice(&self.0.borrow()[at as usize..][..bytes.len()]);
        Ok(())
    }

    fn capacity(&self) -> usize {
        self.0.borrow().len()
    }
}

impl NorFlash for Chip {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = ERASE;

    fn erase(&mut self, from: u32, to: u32) -> Result<(), NorFlashErrorKind> {
        self.0.borrow_mut()[from as usize..to as usize].fill(0xFF);
        Ok(())
    }

    fn write(&mut self, at: u32, bytes: &[u8]) -> Result<(), NorFlashErrorKind> {
        let mut cells = self.0.borrow_mut();
        for (cell, byte) in cells[at as usize..].iter_mut().zip(bytes) {
            *cell &= byte;
        }
        Ok(())
    }
}

fn with_store<T>(chip: &Chip, act: impl FnOnce(&mut FlashStore<'_, Chip>) -> T) -> T {
    let mut room = [0; RECORD_BYTES];
    let mut keep = FlashStore::open(chip.clone(), BLOB_BYTES, None, &mut room).unwrap();
    act(&mut keep)
}

/// A robot that was sold once, has a key now, and was stopped for an emergency; then other records
/// were kept `more` times.
fn owned_and_stopped(more: u32) -> Chip {
    let chip = Chip::of(&vec![0xFF; END]);
    with_store(&chip, |keep| {
        keep.write(StoredKey::Key, &OLD_KEY).unwrap();
        keep.write(StoredKey::Key, &KEY).unwrap();
        keep.set_emergency_stop(true).unwrap();
        for number in 0..more {
            let saved = SavedParams::from_bytes(&[number as u8, 0, 0, 1, 7, 0, 1, 2, 3, 4]);
            keep.save_params(&saved).unwrap();
        }
    });
    chip
}

/// A robot that has a key, and of which nothing else was ever kept.
fn young() -> Chip {
    let chip = Chip::of(&vec![0xFF; END]);
    with_store(&chip, |keep| keep.write(StoredKey::Key, &KEY)).unwrap();
    chip
}

/// What a start makes of a flash.
#[derive(Debug)]
struct Found {
    is_locked: bool,
    is_stopped: bool,
    state: KeyValuesState,
    flaws: u16,
    remembered: Option<Vec<u8>>,
}

impl Found {
    fn is_told(&self) -> bool {
        self.flaws > 0 || !matches!(self.state, KeyValuesState::New | KeyValuesState::Whole)
    }
}

fn start(cells: &[u8]) -> Found {
    with_store(&Chip::of(cells), |keep| {
        let mut room = [0; 64];
        let key = keep.read(StoredKey::Key, &mut room);
        let is_locked = match key {
            Ok(len) => room[..len] == KEY,
            Err(_) => true,
        };
        let health = keep.flash_health();
        let remembered = keep.remembered_key(&mut room).ok();
        Found {
            is_locked,
            is_stopped: keep.is_emergency_stopped(),
            state: health.records,
            flaws: health.flaws,
            remembered: remembered.map(|len| room[..len].to_vec()),
        }
    })
}

/// Holds the invariants against what a start makes of the damaged flash of a robot with a key that
/// was stopped.
fn judge(cells: &[u8], what: &dyn Fn() -> String) -> Result<(), Broken> {
    judge_any(cells, true, what)
}

/// The same for one that was stopped, or was not.
fn judge_any(cells: &[u8], was_stopped: bool, what: &dyn Fn() -> String) -> Result<(), Broken> {
    let found = start(cells);
    let is_damaged = matches!(
        found.state,
        KeyValuesState::Unreadable(_) | KeyValuesState::Older(_)
    );
    let is_kept_out = found.remembered.as_ref().is_none_or(|key| key[..] == KEY);
    let is_stopped = found.is_stopped || !(is_damaged || was_stopped);
    if found.is_locked && is_stopped && found.is_told() && is_kept_out {
        Ok(())
    } else {
        Err(format!("{}: {found:x?}", what()))
    }
}

#[derive(Clone)]
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        self.0
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }
}

/// How much is tried.
#[derive(Clone, Copy, Debug)]
struct Size {
    /// Histories of a robot: how often more was kept.
    histories: u32,
    /// Choices of so many places are tried one by one, and of more this many at random.
    places: usize,
    samples: u32,
    images: u32,
}

impl Size {
    /// With each mutant.
    const SMALL: Size = Size {
        histories: 1,
        places: 1,
        samples: 300,
        images: 300,
    };
    /// With each run of the tests.
    const USUAL: Size = Size {
        histories: 3,
        places: 2,
        samples: 2_000,
        images: 3_000,
    };
    const FULL: Size = Size {
        histories: 3,
        places: 4,
        samples: 1_000_000,
        images: 1_000_000,
    };

    fn asked() -> Size {
        match env::var("ESM_RECORD_DAMAGES").as_deref() {
            Ok("full") => Size::FULL,
            Ok("small") => Size::SMALL,
            _ => Size::USUAL,
        }
    }
}

/// Within a place: no change of up to four bits makes a whole header or copy of one, nor a word of
/// another.
fn no_pattern_of_four_bits_makes_a_place_count() -> Result<(), Broken> {
    let words = [BLANK, HEADER_WRITTEN, SEALED, TRIED, NOTE];
    for (at, word) in words.iter().enumerate() {
        for other in &words[at + 1..] {
            let bits = word.iter().zip(other).map(|(a, b)| (a ^ b).count_ones());
            let distance: u32 = bits.sum();
            if distance <= 2 * 4 {
                return Err(format!(
                    "{word:x?} and {other:x?} are {distance} bits apart"
                ));
            }
        }
    }
    // A checksum is linear: what it makes of a change is the sum of what it makes of each bit. So
    // all sums of up to four must differ from nothing.
    let cells = owned_and_stopped(2).cells();
    let header = &cells[FIRST + HEADER_BYTES as usize - BLOCK_BYTES..][..BLOCK_BYTES];
    let copy = &cells[JOURNAL..][..COPY_BYTES];
    for place in [header, copy] {
        let (body, _) = place.split_at(place.len() - 4);
        let whole = esm_core::format::crc32(body);
        let of_checksum = (0..32).map(|bit| 1_u32 << bit);
        let of_body = (0..8 * body.len()).map(|bit| {
            let mut changed = body.to_vec();
            changed[bit / 8] ^= 1 << (bit % 8);
            esm_core::format::crc32(&changed) ^ whole
        });
        let single: Vec<u32> = of_checksum.chain(of_body).collect();
        let known: HashSet<u32> = single.iter().copied().collect();
        if known.len() < single.len() || known.contains(&0) {
            return Err("one or two wrong bits are not found".into());
        }
        let mut pairs = HashSet::new();
        for (at, first) in single.iter().enumerate() {
            for second in &single[at + 1..] {
                let pair = first ^ second;
                if known.contains(&pair) || !pairs.insert(pair) {
                    return Err("three or four wrong bits are not found".into());
                }
            }
        }
    }
    Ok(())
}

/// The places of areas and journal, each with the bytes that it has.
fn places(cells: &[u8]) -> Vec<(usize, usize)> {
    let mut places = vec![];
    for area in [FIRST, FIRST + AREA] {
        // All of the head, and of the payload what is written and one block that is not.
        let payload = area + HEADER_BYTES as usize;
        let written = (payload..area + AREA)
            .step_by(BLOCK_BYTES)
            .take_while(|at| cells[*at..*at + BLOCK_BYTES] != BLANK);
        let end = payload + (written.count() + 1) * BLOCK_BYTES;
        places.extend((area..end).step_by(BLOCK_BYTES).map(|at| (at, BLOCK_BYTES)));
    }
    for half in [JOURNAL, JOURNAL + ERASE] {
        places.extend((0..2 * PAIRS).map(|copy| (half + copy * COPY_BYTES, COPY_BYTES)));
    }
    places
}

/// Bits that change by themselves.
fn flipped(size: Size) -> Result<(), Broken> {
    let mut random = Random(0x2545_F491_4F6C_DD1D);
    for history in 0..=size.histories {
        let more = history.checked_sub(1);
        let cells = more.map_or_else(young, owned_and_stopped).cells();
        let found = start(&cells);
        if found.is_told() || !found.is_locked || found.is_stopped != more.is_some() {
            return Err(format!("undamaged: {found:x?}"));
        }
        let places = places(&cells);
        let mut broken = cells.clone();
        let mut hit = |chosen: &[usize], random: &mut Random| {
            broken.copy_from_slice(&cells);
            for place in chosen {
                let (at, len) = places[*place];
                let bit = random.below(8 * len);
                broken[at + bit / 8] ^= 1 << (bit % 8);
            }
            // The same bit twice.
            if broken == cells {
                return Ok(());
            }
            let what = || format!("{chosen:?} of the places after {more:?} more");
            judge_any(&broken, more.is_some(), &what)
        };
        // Each choice of up to so many places.
        let mut chosen = vec![0];
        while let Some(last) = chosen.last_mut() {
            if *last >= places.len() {
                chosen.pop();
                if let Some(last) = chosen.last_mut() {
                    *last += 1;
                }
                continue;
            }
            hit(&chosen, &mut random)?;
            let next = chosen[chosen.len() - 1] + 1;
            if chosen.len() < size.places && next < places.len() {
                chosen.push(next);
            } else if let Some(last) = chosen.last_mut() {
                *last += 1;
            }
        }
        // And any four, of which some may be in one place.
        for _ in 0..size.samples / (size.histories + 1) {
            let count = 1 + random.below(4);
            let chosen: Vec<usize> = (0..count).map(|_| random.below(places.len())).collect();
            hit(&chosen, &mut random)?;
        }
        // Two in each area and nowhere else, and both copies of an entry: what was found once.
        for entry in (0..4 * PAIRS).step_by(2) {
            let copies = places.len() - 4 * PAIRS;
            hit(&[copies + entry, copies + entry + 1], &mut random)?;
            let header = HEADER_BYTES as usize / BLOCK_BYTES - 1;
            let second = (copies) / 2;
            hit(&[0, header, second, second + header], &mut random)?;
            // The header of each, and both copies; the tables, and both copies.
            for payload in [header + 1, header] {
                let areas = [payload, second + payload];
                hit(
                    &[areas[0], areas[1], copies + entry, copies + entry + 1],
                    &mut random,
                )?;
            }
        }
    }
    Ok(())
}

/// Parts of the flash that are put back as they once were, or erased.
fn put_back() -> Result<(), Broken> {
    let parts = [
        FIRST..FIRST + AREA,
        FIRST + AREA..JOURNAL,
        JOURNAL..JOURNAL + ERASE,
        JOURNAL + ERASE..END,
    ];
    // How the robot was before it had this key, when it had no key, and when it was not stopped.
    let chip = Chip::of(&vec![0xFF; END]);
    let mut past = vec![];
    with_store(&chip, |keep| {
        past.push(chip.cells());
        keep.save_params(&SavedParams::from_bytes(&[1, 0, 0, 1, 7, 0, 1, 2, 3, 4]))
            .unwrap();
        past.push(chip.cells());
        keep.write(StoredKey::Key, &OLD_KEY).unwrap();
        past.push(chip.cells());
        keep.write(StoredKey::Key, &KEY).unwrap();
        past.push(chip.cells());
        keep.set_emergency_stop(true).unwrap();
        keep.set_emergency_stop(false).unwrap();
        past.push(chip.cells());
        keep.set_emergency_stop(true).unwrap();
    });
    for more in 0..12 {
        let now = chip.cells();
        let mut before = past.clone();
        before.push(vec![0xFF; END]);
        before.push(vec![0; END]);
        for (number, old) in before.iter().enumerate() {
            // Each area is as now, as then, or erased; and so is the journal, unless all of it is
            // of then.
            for choice in 0..3_usize.pow(3) {
                let digits = [choice % 3, choice / 3 % 3, choice / 9];
                let mut cells = now.clone();
                for (part, digit) in parts
                    .iter()
                    .zip([digits[0], digits[1], digits[2], digits[2]])
                {
                    match digit {
                        0 => {}
                        1 => cells[part.clone()].copy_from_slice(&old[part.clone()]),
                        _ => cells[part.clone()].fill(0xFF),
                    }
                }
                // With the journal of then, or with all of it erased, it is the robot of then, or a
                // new one.
                let is_then = digits[2] == 1 || digits == [2, 2, 2];
                let is_new = cells[FIRST..].iter().all(|byte| *byte == 0xFF);
                if is_then || is_new || cells == now {
                    continue;
                }
                judge(&cells, &|| {
                    format!("areas and journal of {digits:?} of {number}, after {more} more")
                })?;
            }
        }
        with_store(&chip, |keep| {
            let saved = SavedParams::from_bytes(&[more, 0, 0, 1, 7, 0, 1, 2, 3, 4]);
            keep.save_params(&saved).unwrap();
        });
    }
    Ok(())
}

/// Flashes with anything in them, all of the records or some.
fn random(size: Size) -> Result<(), Broken> {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let histories: Vec<Vec<u8>> = (0..4)
        .map(|more| owned_and_stopped(3 * more).cells())
        .collect();
    let regions = [
        FIRST..END,
        FIRST..JOURNAL,
        JOURNAL..END,
        FIRST..FIRST + AREA,
        FIRST + AREA..END,
    ];
    for number in 0..size.images as usize {
        let mut cells = histories[number % histories.len()].clone();
        let region = regions[number / 4 % regions.len()].clone();
        // Noise, noise of few zeros or few ones, blocks of noise, and what was written with noise
        // over it.
        let density = number / 20 % 5;
        for at in region {
            let noise = random.next();
            cells[at] = match density {
                0 => noise as u8,
                1 => (noise | noise >> 8 | noise >> 16) as u8,
                2 => (noise & noise >> 8 & noise >> 16) as u8,
                3 if (at / BLOCK_BYTES * 7 + number).is_multiple_of(3) => noise as u8,
                3 => 0xFF,
                _ => cells[at] ^ (noise & noise >> 8 & noise >> 16 & noise >> 24) as u8,
            };
        }
        judge(&cells, &|| format!("random flash {number}"))?;
    }
    Ok(())
}

/// The owner gets in with the key that is remembered, and the robot stays stopped.
fn in_by_the_key() -> Result<(), Broken> {
    for more in 0..12 {
        let mut cells = owned_and_stopped(more).cells();
        for area in [FIRST, FIRST + AREA] {
            cells[area + HEADER_BYTES as usize + 3] ^= 1;
        }
        let found = start(&cells);
        let is_known = found.state == KeyValuesState::Unreadable(WayIn::Key)
            && found.remembered.as_deref() == Some(&KEY);
        if !is_known {
            return Err(format!(
                "the key is not remembered after {more} more: {found:x?}"
            ));
        }
        // An entry that is damaged may have had another key.
        let mut unsure = cells.clone();
        let entry = (2 + more as usize + 1) % (2 * PAIRS);
        let half = JOURNAL + entry / PAIRS * ERASE;
        for copy in [0, 1] {
            unsure[half + (2 * (entry % PAIRS) + copy) * COPY_BYTES + 40] ^= 4;
        }
        let found = start(&unsure);
        if found.state != KeyValuesState::Unreadable(WayIn::Erase) || found.remembered.is_some() {
            return Err(format!(
                "an earlier key is remembered after {more} more: {found:x?}"
            ));
        }
        let chip = Chip::of(&cells);
        with_store(&chip, |keep| keep.renew(&KEY)).map_err(|error| format!("{error:?}"))?;
        let found = start(&chip.cells());
        let is_renewed = found.is_locked
            && found.is_stopped
            && found.state == KeyValuesState::Whole
            && found.remembered.is_some();
        if !is_renewed {
            return Err(format!("renewed after {more} more: {found:x?}"));
        }
        let released = with_store(&chip, |keep| {
            keep.set_emergency_stop(false)?;
            Ok(keep.is_emergency_stopped())
        });
        if released != Ok::<_, esm_link::message::LinkError>(false) {
            return Err(format!("{released:?}"));
        }
        // What was there before is older now.
        let mut back = chip.cells();
        back[FIRST..FIRST + AREA]
            .copy_from_slice(&owned_and_stopped(more).cells()[FIRST..][..AREA]);
        back[FIRST + AREA..JOURNAL].fill(0xFF);
        judge(&back, &|| "records from before they were renewed".into())?;
    }
    // One that was sold has no owner.
    let chip = owned_and_stopped(1);
    with_store(&chip, |keep| keep.write(StoredKey::Key, &[]))
        .map_err(|error| format!("{error:?}"))?;
    let mut cells = chip.cells();
    cells[FIRST..JOURNAL].fill(0xFF);
    let found = start(&cells);
    let is_nobodys = found.state == KeyValuesState::Unreadable(WayIn::NoKey)
        && found.remembered.as_deref() == Some(&[])
        && found.is_locked
        && found.is_stopped;
    if is_nobodys {
        Ok(())
    } else {
        Err(format!("a robot without an owner: {found:x?}"))
    }
}

/// A chip that never had records, with some bits that changed by themselves, takes them, and tells
/// of the bits.
fn new_chips(size: Size) -> Result<(), Broken> {
    let mut random = Random(0xD1B5_4A32_D192_ED03);
    for number in 0..size.samples / 4 {
        let mut cells = vec![0xFF; END];
        let count = 1 + random.below(4);
        for _ in 0..count {
            let bit = 8 * FIRST + random.below(8 * (END - FIRST));
            cells[bit / 8] &= !(1 << (bit % 8));
        }
        let found = start(&cells);
        if found.state != KeyValuesState::New || found.is_stopped || found.flaws == 0 {
            return Err(format!("new chip {number} with worn bits: {found:x?}"));
        }
        let chip = Chip::of(&cells);
        let kept = with_store(&chip, |keep| keep.set_emergency_stop(true).is_ok());
        // A bit that stays programmed in a header or a word is a flash that does not take it.
        let found = start(&chip.cells());
        if kept && !found.is_stopped {
            return Err(format!("new chip {number} keeps no stop: {found:x?}"));
        }
    }
    Ok(())
}

fn passes(invariant: impl FnOnce(Size) -> Result<(), Broken>) {
    if let Err(broken) = invariant(Size::asked()) {
        panic!("{broken}");
    }
}

#[test]
fn no_pattern_of_four_bits_in_a_place_is_overlooked() {
    passes(|_| no_pattern_of_four_bits_makes_a_place_count());
}

#[test]
fn bits_that_flip_neither_unlock_nor_release_and_are_told() {
    passes(flipped);
}

#[test]
fn records_that_are_put_back_neither_unlock_nor_release_and_are_told() {
    passes(|_| put_back());
}

#[test]
fn random_flashes_neither_unlock_nor_release_and_are_told() {
    passes(random);
}

#[test]
fn the_owner_gets_in_with_the_key_that_is_remembered() {
    passes(|_| in_by_the_key());
}

#[test]
fn a_new_chip_with_worn_bits_is_a_new_chip_and_tells_of_them() {
    passes(new_chips);
}
