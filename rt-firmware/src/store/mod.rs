//! The store of missions on a flash: a robot that loses power at any moment starts with one whole
//! mission, or with the one that is compiled in.
//!
//! There are two slots, each of erase units of its own. One holds the mission that runs and is
//! never touched but for words that are added to it; the other takes the next upload. A mission
//! that was uploaded runs on trial first. If it is not confirmed until the next start, the one
//! before runs again.
//!
//! The store knows flash by the traits of `embedded-storage`. It holds to the strictest reading of
//! them: what is written is aligned, and nothing is written twice between two erases. It allocates
//! nothing and needs room for one mission from its caller, who runs the mission from there: what
//! was checked is what runs, also where the flash would read differently a second time.
//!
//! # Layout
//! The store has `2 * bank_bytes` from `start` on: bank A, then bank B. A slot is blocks of 32
//! bytes; all numbers are little-endian:
//!
//! | offset | bytes | what |
//! |---|---|---|
//! | 0 | 32 | headed: all bytes 0x69 once the header is there |
//! | 32 | 32 | sealed: all bytes 0x5A once the upload has ended |
//! | 64 | 32 | tried: all bytes 0xC3 once the mission is about to run on trial |
//! | 96 | 5 × 32 | confirmed: all bytes 0x96 in one of them once the mission was confirmed |
//! | 256 | 2 × 32 | promoted: all bytes 0x96 in one of them before it is confirmed |
//! | 320 | 21 × 32 | advanced: all bytes 0x96 in one more each time that the other slot is about to be erased and holds a mission |
//! | 992 | 32 | header: magic `esmS`, format (1), sequence number, length, CRC-32 of the payload, erases of both slots so far, 4 bytes not used (0xFF), CRC-32 of the 28 bytes before |
//! | 1024 | length | payload; its last block is filled up with 0xFF |
//!
//! Every word is its own block, so that flashes that program up to 32 bytes at once can be used.
//! What is kept besides missions (saved parameters, the counter of signed uploads) are
//! [`key_values`], behind bank B, in two more slots; behind those is their journal.
//!
//! # Torn words
//! A write that is cut leaves any of its bits programmed, and some of them *weak*: they read like
//! this today and like that tomorrow, and no reading tells. So no decision rests on a word alone
//! that may have been cut. Each word is written after the one before it was written to its end, and
//! so proves it: sealed, tried and promoted prove that there is a header. A torn `tried` counts as
//! set: the mission does not run. A torn `confirmed` counts as not set. What is acknowledged was
//! written and read back since the start.
//!
//! # Order
//! Missions are ordered by *place*: sequence number, plus 4 if promoted, plus 2 for each advance up
//! to the last one. The comparison is that of serial numbers (`a - b` as signed), so that the order
//! survives the wrap after 2^32; two missions that are in the flash together are a few dozen places
//! apart. Numbers grow by about five an upload: the wrap is 400 times beyond what a flash of a
//! million erases lasts.
//!
//! At the start the last in the order runs if it is confirmed, or on trial if it was not tried yet;
//! else the other one if it is confirmed; else none. Before an upload erases a mission, the slot
//! that stays advances over it: an erase that is cut may wipe the word that says that a trial
//! failed, or leave weak bits in what still reads well, and such a mission must not come back.
//!
//! # Costs
//! | | erases | blocks written | bytes read |
//! |---|---|---|---|
//! | start | 0 | at most 1 | 2048 and the payload, once or twice |
//! | begin | 1 (a slot) | at most 2 | 3072; where no mission runs, both payloads, too |
//! | append | 0 | 1 each 32 bytes | 0 |
//! | finish | 0 | 3, and what is left of the payload | the payload and 1024 |
//! | begin a trial | 0 | 1 | 32 |
//! | fall back | 0 | 0 | 0 |
//! | confirm | 0 | 2 | 1200 |
//!
//! A block that the flash refuses is passed over, and the next of its kind is taken: then there are
//! more writes, at most as many as there are blocks. Checksums are computed bit by bit. No loop is
//! longer than the 32 blocks of a head or those of a payload.
//!
//! # Limits
//! Power may be lost twice in the worst moments in a row; tests cut each operation of many
//! histories and again each operation of what follows. A third cut in a word that was torn twice
//! already may bring back the mission before. After about five failed trials over the same
//! confirmed mission the advances are used up: then an upload that is cut in its erase may bring
//! the last failed mission back on trial, until some mission is confirmed. The next upload always
//! works.

use core::ops::Range;

use embedded_storage::nor_flash::{NorFlash, NorFlashError, NorFlashErrorKind};
use esm_link::message::BankState;

pub mod budget;
#[cfg(test)]
mod damaged;
#[cfg(test)]
mod damages;
#[cfg(test)]
mod erases;
pub mod flash_store;
mod journal;
#[cfg(test)]
mod kept_flash;
#[cfg(feature = "behaviours")]
mod kept_script;
#[cfg(all(test, feature = "behaviours"))]
mod kept_script_tests;
pub mod key_values;
mod layout;
#[cfg(test)]
mod nor;
#[cfg(test)]
mod own_mission;
#[cfg(test)]
mod power_cuts;
#[cfg(test)]
mod records_power_cuts;
#[cfg(test)]
mod saved_params;
#[cfg(feature = "behaviours")]
mod script_bytes;

pub use layout::{
    ADVANCES, BLOCK_BYTES, CONFIRMATIONS, FlashBank, HEADER_BYTES, Layout, LayoutError, PROMOTIONS,
};
use layout::{
    BLANK, Block, CERTAIN_CONFIRMATIONS, FIRST_ADVANCE, HEADER_AT, HEADER_WRITTEN,
    HEADER_WRITTEN_AT, Header, NOTE, NOTES, NOTES_AT, SEALED, SEALED_AT, TRIED, TRIED_AT,
    UPLOAD_LEAD, is_newer, lead,
};
#[cfg(feature = "behaviours")]
pub use script_bytes::SCRIPT_BYTES;
#[cfg(feature = "behaviours")]
pub(crate) use script_bytes::{HEAD_BYTES as SCRIPT_HEAD_BYTES, STEP_BYTES as SCRIPT_STEP_BYTES};

/// A store of missions on a flash.
pub struct Store<F> {
    flash: F,
    layout: Layout,
    /// The slot whose mission runs: it is not touched but for its notes.
    running: Option<Running>,
    /// What ran before the trial, where that began since the choice.
    before: Option<Option<Running>>,
    upload: Option<Upload>,
    /// The slot of the upload that has ended and that nobody has tried.
    ended: Option<FlashBank>,
    /// How often a slot was erased, as far as that is known: from the headers, and since the start.
    erases: u32,
    /// Uploads get numbers beyond this one, whatever is in the slots.
    floor: Option<u32>,
}

#[derive(Clone, Copy)]
struct Running {
    slot: FlashBank,
    on_trial: bool,
    /// It was confirmed since it was chosen. What was read of a confirmation may be a torn one that
    /// reads well today.
    is_certain: bool,
}

/// A mission that arrives.
struct Upload {
    slot: FlashBank,
    header: Header,
    /// What of the slot is not erased yet.
    to_erase: Range<u32>,
    received: u32,
    /// Bytes that are not written yet, for they do not fill a block.
    block: Block,
}

/// Which mission to run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Choice {
    /// This one, whose bytes were read into the room; or none, so that the one that is compiled in
    /// is to run.
    pub mission: Option<Mission>,
    /// Why: what is in bank A and bank B.
    pub slots: [BankState; 2],
}

/// A mission that was chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Mission {
    /// Where it is.
    pub slot: FlashBank,
    /// Its sequence number.
    pub seq: u32,
    /// Its length in bytes.
    pub len: u32,
    /// It was never confirmed. If it is not until the next choice, the other is run again.
    pub on_trial: bool,
}

/// Why an upload cannot begin.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BeginError {
    /// The mission that runs is on trial, and the other slot holds what to fall back to. Confirm
    /// it, or choose again.
    OnTrial,
    /// A mission has at least one byte and at most this many.
    Length {
        /// The longest mission in bytes.
        capacity: u32,
    },
    /// The flash did not erase the slot.
    Flash(NorFlashErrorKind),
}

/// Why bytes cannot be added to an upload.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AppendError {
    /// There is no upload. Begin one.
    NoUpload,
    /// The slot is not erased yet.
    NotErased,
    /// These are not the next bytes.
    Offset {
        /// Offset of the next byte.
        expected: u32,
    },
    /// There are more bytes than were announced.
    TooLong,
    /// The flash did not take them. The upload is over.
    Flash(NorFlashErrorKind),
}

/// Why an upload cannot end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FinishError {
    /// There is no upload.
    NoUpload,
    /// Bytes are missing. The upload goes on.
    Incomplete {
        /// As many have arrived.
        received: u32,
    },
    /// The flash did not take all of it. The upload is over.
    Flash(NorFlashErrorKind),
    /// What the flash holds is not what was announced: other bytes were sent, or it is worn. The
    /// upload is over.
    ReadBack,
}

/// Why a mission cannot be put on trial.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TrialError {
    /// No upload has ended since the start or the last trial.
    NoUpload,
    /// The flash did not take the word that says so. The mission may not run. After the next start
    /// it does not either, unless power was lost meanwhile or the flash took no other word.
    NotRecorded,
}

/// Why the mission that runs cannot be confirmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ConfirmError {
    /// No mission of the store runs.
    NoMission,
    /// The flash did not take the word. The mission is still on trial.
    NotRecorded,
}

/// What the state words and the header of a slot say.
struct BankHeader {
    header: Result<Header, BankState>,
    /// The writing of the header came to an end.
    is_headed: bool,
    /// The upload did.
    is_sealed: bool,
    is_tried: bool,
    /// Its confirmations.
    confirmations: u32,
    /// How far it is ahead of its number in the order.
    lead: u32,
}

impl BankHeader {
    /// Its place in the order of missions, the newest last.
    fn rank(&self) -> Option<u32> {
        let header = self.header.ok()?;
        Some(header.seq.wrapping_add(self.lead))
    }

    /// The same, if its header is there for certain.
    fn headed_rank(&self) -> Option<u32> {
        self.rank().filter(|_| self.is_headed)
    }

    /// The same, if it was confirmed.
    fn confirmed_rank(&self) -> Option<u32> {
        let is_confirmed = self.confirmations > 0;
        self.rank().filter(|_| is_confirmed)
    }

    /// The same, if its upload has ended.
    fn sealed_rank(&self) -> Option<u32> {
        self.rank().filter(|_| self.is_sealed)
    }
}

/// The later of two places in the order.
fn newest(ranks: [Option<u32>; 2]) -> Option<FlashBank> {
    match ranks {
        [Some(a), Some(b)] if is_newer(b, a) => Some(FlashBank::B),
        [None, Some(_)] => Some(FlashBank::B),
        [Some(_), _] => Some(FlashBank::A),
        [None, None] => None,
    }
}

impl<F: NorFlash> Store<F> {
    /// Opens the store and chooses the mission to run: see [`Store::choose`].
    ///
    /// # Errors
    /// The layout does not fit the flash.
    pub fn boot(
        flash: F,
        layout: Layout,
        room: &mut [u8],
        accepts: impl FnMut(&[u8]) -> bool,
    ) -> Result<(Self, Choice), LayoutError> {
        let mut store = Self::new(flash, layout)?;
        let choice = store.choose(room, accepts);
        Ok((store, choice))
    }

    /// Opens the store, in which no mission runs yet. [`choose`](Store::choose) is to be called
    /// before anything else.
    ///
    /// # Errors
    /// The layout does not fit the flash.
    pub fn new(flash: F, layout: Layout) -> Result<Self, LayoutError> {
        layout.check(&flash)?;
        Ok(Store {
            flash,
            layout,
            running: None,
            before: None,
            upload: None,
            ended: None,
            erases: 0,
            floor: None,
        })
    }

    /// Chooses the mission that is to run from now on, and reads it into `room`. Whoever runs on
    /// trial and is not confirmed has failed: so this is also how a mission on trial is left.
    /// `accepts` is asked before a mission is chosen: one that it refuses is passed over, and stays
    /// as it is.
    ///
    /// An upload that has not ended is over.
    pub fn choose(&mut self, room: &mut [u8], mut accepts: impl FnMut(&[u8]) -> bool) -> Choice {
        self.upload = None;
        self.ended = None;
        self.running = None;
        self.before = None;
        let [a, b] = [FlashBank::A, FlashBank::B].map(|slot| self.head(slot));
        for header in [a.header, b.header].into_iter().flatten() {
            self.erases = self.erases.max(header.erases);
        }
        let first = newest([a.sealed_rank(), b.sealed_rank()]).unwrap_or(FlashBank::A);
        let mut mission = None;
        let mut slots = [BankState::Empty; 2];
        for slot in [first, first.other()] {
            let head = slot.of([&a, &b]);
            *slot.of(slots.each_mut()) =
                self.consider(slot, head, slot == first, &mut mission, room, &mut accepts);
        }
        self.running = mission.map(|mission: Mission| Running {
            slot: mission.slot,
            on_trial: mission.on_trial,
            is_certain: false,
        });
        Choice { mission, slots }
    }

    /// Chooses the mission of a slot if it may run and none was chosen before.
    fn consider(
        &mut self,
        slot: FlashBank,
        head: &BankHeader,
        is_first: bool,
        chosen: &mut Option<Mission>,
        room: &mut [u8],
        accepts: &mut impl FnMut(&[u8]) -> bool,
    ) -> BankState {
        let Header { seq, len, crc, .. } = match head.header {
            Ok(header) => header,
            Err(state) => return state,
        };
        let on_trial = head.confirmations == 0;
        if !head.is_sealed {
            return BankState::Unsealed;
        }
        if on_trial && head.is_tried {
            return BankState::TrialFailed;
        }
        // A mission that never ran and is not the newest was given up; parts of it may be erased.
        if on_trial && !is_first {
            return BankState::GivenUp;
        }
        if chosen.is_some() {
            return BankState::Spare;
        }
        let Some(room) = room.get_mut(..len as usize) else {
            return BankState::NoRoom { len };
        };
        match self.payload_crc(slot, len, room) {
            None => return BankState::Unreadable,
            Some(found) if found != crc => {
                return BankState::BrokenPayload;
            }
            Some(_) => {}
        }
        if !accepts(room) {
            return BankState::Refused;
        }
        // What is not on record cannot be fallen back from.
        if on_trial && !self.record(slot, TRIED_AT, &TRIED) {
            return BankState::TrialNotRecorded;
        }
        *chosen = Some(Mission {
            slot,
            seq,
            len,
            on_trial,
        });
        if on_trial {
            BankState::OnTrial
        } else {
            BankState::Runs
        }
    }

    /// Puts the mission whose upload has ended on trial, for a robot that has its bytes and is
    /// about to run it. Until it is confirmed or left ([`fall_back`](Store::fall_back)), the slot
    /// of the mission before is not touched.
    ///
    /// # Errors
    /// Why it may not run.
    pub fn begin_trial(&mut self) -> Result<(), TrialError> {
        let slot = self.ended.take().ok_or(TrialError::NoUpload)?;
        if !self.record(slot, TRIED_AT, &TRIED) {
            // A promotion says that there was a trial, too: so the next start does not run what was
            // refused now.
            self.note(slot, CONFIRMATIONS..FIRST_ADVANCE);
            return Err(TrialError::NotRecorded);
        }
        self.before = Some(self.running);
        self.running = Some(Running {
            slot,
            on_trial: true,
            is_certain: false,
        });
        Ok(())
    }

    /// Leaves the trial that began with [`begin_trial`](Store::begin_trial): the mission before
    /// runs again. Nothing is written: a trial that was not confirmed has failed. Returns whether
    /// there was such a trial; one that a choice began is left by another
    /// [`choose`](Store::choose).
    pub fn fall_back(&mut self) -> bool {
        let Some(before) = self.before.take() else {
            return false;
        };
        self.running = before;
        true
    }

    /// Makes the mission that runs the one that is run from now on.
    ///
    /// # Errors
    /// Why it is not. It may be tried again.
    pub fn confirm(&mut self) -> Result<(), ConfirmError> {
        let running = self.running.ok_or(ConfirmError::NoMission)?;
        // What was read is not certain, but that all of so many confirmations are torn.
        let mut is_there =
            running.is_certain || self.head(running.slot).confirmations >= CERTAIN_CONFIRMATIONS;
        if !is_there {
            let is_promoted = !running.on_trial
                || self
                    .note(running.slot, CONFIRMATIONS..FIRST_ADVANCE)
                    .is_some();
            is_there = is_promoted && self.note(running.slot, 0..CONFIRMATIONS).is_some();
        }
        if !is_there {
            return Err(ConfirmError::NotRecorded);
        }
        self.running = Some(Running {
            on_trial: false,
            is_certain: true,
            ..running
        });
        self.before = None;
        Ok(())
    }

    /// The place in the order of what a slot holds, if it was confirmed and reads as it was sealed.
    #[inline(never)]
    fn whole_rank(&mut self, slot: FlashBank, head: &BankHeader) -> Option<u32> {
        let rank = head.confirmed_rank()?;
        let header = head.header.ok()?;
        let crc = self.payload_crc(slot, header.len, &mut [])?;
        (crc == header.crc).then_some(rank)
    }

    /// Begins the upload of a mission of `len` bytes with the CRC-32 (IEEE 802.3) `crc`, and erases
    /// the slot that does not run. If this very upload has begun already, it goes on. Returns the
    /// offset of the next byte.
    ///
    /// # Errors
    /// Why there is no upload now. One that was under way goes on, but after an error of the flash.
    pub fn begin(&mut self, len: u32, crc: u32) -> Result<u32, BeginError> {
        let received = self.prepare(len, crc)?;
        while self.erase_next()? {}
        Ok(received)
    }

    /// Erases one more unit of the slot that [`prepare`](Store::prepare) has chosen. Returns
    /// whether there is more to erase.
    ///
    /// # Errors
    /// The flash did not erase it. The upload is over.
    pub fn erase_next(&mut self) -> Result<bool, BeginError> {
        let Some(upload) = &mut self.upload else {
            return Ok(false);
        };
        let from = upload.to_erase.start;
        if from >= upload.to_erase.end {
            return Ok(false);
        }
        upload.to_erase.start = from + F::ERASE_SIZE as u32;
        let goes_on = !upload.to_erase.is_empty();
        if let Err(error) = self.flash.erase(from, from + F::ERASE_SIZE as u32) {
            self.upload = None;
            return Err(BeginError::Flash(error.kind()));
        }
        Ok(goes_on)
    }

    /// The first part of [`begin`](Store::begin), for those who cannot wait until a slot is erased:
    /// [`erase_next`](Store::erase_next) is to be called until there is nothing left to erase.
    ///
    /// # Errors
    /// As of `begin`.
    pub fn prepare(&mut self, len: u32, crc: u32) -> Result<u32, BeginError> {
        if let Some(upload) = &self.upload
            && (upload.header.len, upload.header.crc) == (len, crc)
        {
            return Ok(upload.received);
        }
        let capacity = self.layout.payload_capacity();
        if len == 0 || len > capacity {
            return Err(BeginError::Length { capacity });
        }
        let running = self.running;
        if running.is_some_and(|running| running.on_trial) {
            return Err(BeginError::OnTrial);
        }
        self.upload = None;
        self.ended = None;
        // What is erased may be all that there is beside the mission that runs: that it is
        // confirmed must be certain. If the flash does not even take a word more, so be it: new
        // missions must find a way in.
        if running.is_some() {
            let _ = self.confirm();
        }
        let heads = [FlashBank::A, FlashBank::B].map(|slot| self.head(slot));
        let [a, b] = &heads;
        let ranks = [a.rank(), b.rank()];
        let mut newest_rank = newest(ranks).and_then(|slot| slot.of(ranks)).unwrap_or(0);
        if let Some(floor) = self.floor
            && is_newer(floor, newest_rank)
        {
            newest_rank = floor;
        }
        let slot = match running {
            Some(running) => running.slot.other(),
            // Nothing runs. What stays is what was confirmed, the whole before the damaged, or else
            // what is newest for certain.
            None => newest([
                self.whole_rank(FlashBank::A, a),
                self.whole_rank(FlashBank::B, b),
            ])
            .or(newest([a.confirmed_rank(), b.confirmed_rank()]))
            .or(newest([a.sealed_rank(), b.sealed_rank()]))
            .or(newest([a.headed_rank(), b.headed_rank()]))
            .unwrap_or(FlashBank::B)
            .other(),
        };
        let (erased, kept) = (slot.of([a, b]), slot.of([b, a]));
        if let Ok(header) = kept.header
            && kept.is_sealed
        {
            let rank = |note| header.seq.wrapping_add(lead(note));
            let first = (FIRST_ADVANCE..NOTES).find(|note| is_newer(rank(*note), newest_rank));
            if let Some(first) = first {
                // From here on what stays is over what is erased, whatever an erase that is cut
                // leaves of it.
                let noted = match erased.headed_rank() {
                    Some(_) => self.note(slot.other(), first..NOTES),
                    None => Some(first),
                };
                newest_rank = rank(noted.unwrap_or(NOTES - 1));
            }
            // If its promotion was cut and reads as blank today, a note that was to be over it may
            // have been cut, too.
            if let Ok(header) = erased.header
                && erased.is_tried
            {
                let promoted = header.seq.wrapping_add(lead(FIRST_ADVANCE));
                if is_newer(promoted, newest_rank) {
                    newest_rank = promoted;
                }
            }
        }
        let (from, to) = self.layout.bounds(slot);
        // Over the next note, too: there may be one whose writing was cut and that reads as blank
        // today.
        let seq = newest_rank.wrapping_add(UPLOAD_LEAD);
        self.erases = self.erases.saturating_add(1);
        let header = Header {
            seq,
            len,
            crc,
            erases: self.erases,
        };
        self.upload = Some(Upload {
            slot,
            header,
            to_erase: from..to,
            received: 0,
            block: BLANK,
        });
        Ok(0)
    }

    /// Adds bytes to the upload, of which `offset` have arrived. Any number of bytes will do.
    /// Returns the offset of the next byte.
    ///
    /// # Errors
    /// Why they were not taken: none of them, but after an error of the flash.
    pub fn append(&mut self, offset: u32, bytes: &[u8]) -> Result<u32, AppendError> {
        let Some(upload) = &mut self.upload else {
            return Err(AppendError::NoUpload);
        };
        if !upload.to_erase.is_empty() {
            return Err(AppendError::NotErased);
        }
        if offset != upload.received {
            return Err(AppendError::Offset {
                expected: upload.received,
            });
        }
        if bytes.len() > (upload.header.len - upload.received) as usize {
            return Err(AppendError::TooLong);
        }
        for byte in bytes {
            let at = upload.received as usize % BLOCK_BYTES;
            if let Some(place) = upload.block.get_mut(at) {
                *place = *byte;
            }
            upload.received += 1;
            if at + 1 == BLOCK_BYTES {
                let written = upload.write_block(&mut self.flash, &self.layout);
                if let Err(kind) = written {
                    self.upload = None;
                    return Err(AppendError::Flash(kind));
                }
            }
        }
        Ok(upload.received)
    }

    /// Bytes that have arrived of the upload that is under way.
    #[must_use]
    pub fn received(&self) -> Option<u32> {
        Some(self.upload.as_ref()?.received)
    }

    /// Ends the upload. When this returns the sequence number of the mission, it is in the flash,
    /// and the next choice runs it on trial.
    ///
    /// # Errors
    /// Why it is not there. The mission that runs is as it was.
    pub fn finish(&mut self) -> Result<u32, FinishError> {
        let Some(mut upload) = self.upload.take() else {
            return Err(FinishError::NoUpload);
        };
        let (received, Header { seq, len, .. }) = (upload.received, upload.header);
        if received < len {
            self.upload = Some(upload);
            return Err(FinishError::Incomplete { received });
        }
        if !(received as usize).is_multiple_of(BLOCK_BYTES) {
            upload
                .write_block(&mut self.flash, &self.layout)
                .map_err(FinishError::Flash)?;
        }
        self.seal(&upload)?;
        self.ended = Some(upload.slot);
        Ok(seq)
    }

    /// Reads back the payload, writes the header, and after it the word that says that header and
    /// payload are whole. So a header counts only if its writing came to an end: one that was cut
    /// could read well today and not tomorrow.
    fn seal(&mut self, upload: &Upload) -> Result<(), FinishError> {
        let Upload { slot, header, .. } = *upload;
        let found = self.payload_crc(slot, header.len, &mut []);
        if found != Some(header.crc) {
            return Err(FinishError::ReadBack);
        }
        let words = [
            (HEADER_AT, header.encode()),
            (HEADER_WRITTEN_AT, HEADER_WRITTEN),
            (SEALED_AT, SEALED),
        ];
        for (offset, block) in words {
            let address = self.layout.address(slot, offset);
            self.flash
                .write(address, &block)
                .map_err(|error| FinishError::Flash(error.kind()))?;
        }
        let head = self.head(slot);
        let is_new = head.header == Ok(header)
            && head.is_sealed
            && !head.is_tried
            && head.confirmations == 0
            && head.lead == 0;
        if is_new {
            Ok(())
        } else {
            Err(FinishError::ReadBack)
        }
    }

    /// The slot that the upload which is under way goes to.
    #[must_use]
    pub fn upload_slot(&self) -> Option<FlashBank> {
        Some(self.upload.as_ref()?.slot)
    }

    /// The slot of the mission that runs.
    #[must_use]
    pub fn running_slot(&self) -> Option<FlashBank> {
        Some(self.running?.slot)
    }

    /// Ends the upload that is under way and forgets what arrived.
    pub fn abort(&mut self) {
        self.upload = None;
    }

    /// How often a slot was erased, both counted together, as far as their headers tell. An upload
    /// that was cut before its header is not counted.
    #[must_use]
    pub fn erases(&self) -> u32 {
        self.erases
    }

    /// The sequence number of what is in a slot.
    pub(super) fn seq(&mut self, slot: FlashBank) -> Option<u32> {
        Some(self.head(slot).header.ok()?.seq)
    }

    /// Uploads get numbers beyond this one from now on.
    pub(super) fn stay_beyond(&mut self, floor: Option<u32>) {
        self.floor = floor;
    }

    /// Zeros in both slots: none of a chip that was never written.
    pub(super) fn zeros(&mut self) -> u32 {
        let mut zeros = 0;
        for slot in [FlashBank::A, FlashBank::B] {
            for offset in (0..self.layout.bank_bytes()).step_by(BLOCK_BYTES) {
                let block = self.read_again(slot, offset).unwrap_or([0; BLOCK_BYTES]);
                zeros += block.iter().map(|byte| byte.count_zeros()).sum::<u32>();
            }
        }
        zeros
    }

    /// Blocks of a slot that are neither blank nor what is written there: damage, or what a cut has
    /// left.
    pub(super) fn flaws(&mut self, slot: FlashBank) -> u32 {
        let head = self.head(slot);
        let written = head.header.map_or(0, |header| header.len as usize);
        let mut flaws = 0;
        for offset in (0..self.layout.bank_bytes()).step_by(BLOCK_BYTES) {
            let block = self.read_again(slot, offset);
            let word = match offset {
                HEADER_WRITTEN_AT => Some(HEADER_WRITTEN),
                SEALED_AT => Some(SEALED),
                TRIED_AT => Some(TRIED),
                HEADER_AT => block.filter(|_| head.header.is_ok()),
                _ if offset < HEADER_AT => Some(NOTE),
                // The payload has a checksum; its last block is filled up with what is blank.
                _ => {
                    let of_payload = written.saturating_sub((offset - HEADER_BYTES) as usize);
                    let filling = of_payload.min(BLOCK_BYTES)..BLOCK_BYTES;
                    block.filter(|block| block.get(filling.clone()) == BLANK.get(filling.clone()))
                }
            };
            let is_fine = block == Some(BLANK) || block.is_some() && block == word;
            flaws += u32::from(!is_fine);
        }
        if let Ok(header) = head.header
            && head.is_sealed
            && self.payload_crc(slot, header.len, &mut []) != Some(header.crc)
            && self.payload_crc(slot, header.len, &mut []) != Some(header.crc)
        {
            flaws += 1;
        }
        flaws
    }

    /// What a slot says of itself.
    fn head(&mut self, slot: FlashBank) -> BankHeader {
        let capacity = self.layout.payload_capacity();
        let header = match self.read(slot, HEADER_AT) {
            Some(block) => Header::decode(&block, capacity),
            None => Err(BankState::Unreadable),
        };
        let is_headed = self.read(slot, HEADER_WRITTEN_AT) == Some(HEADER_WRITTEN);
        let is_sealed = self.read(slot, SEALED_AT) == Some(SEALED);
        let is_tried = match self.read(slot, TRIED_AT) {
            // The word is there if any of it is: also where the flash can tell no more than that
            // something is wrong with it.
            Some(block) => block != BLANK,
            None => true,
        };
        let (mut confirmations, mut ahead, mut is_promoted) = (0, 0, false);
        for note in 0..NOTES {
            let block = self.read(slot, note_at(note));
            if (CONFIRMATIONS..FIRST_ADVANCE).contains(&note) {
                is_promoted |= block != Some(BLANK);
            }
            if block == Some(NOTE) {
                ahead = ahead.max(lead(note));
                confirmations += u32::from(note < CONFIRMATIONS);
            }
        }
        let is_tried = is_tried || is_promoted;
        // Each word says that those before it were there, also where they were torn and read now
        // so, now so.
        let is_sealed = is_sealed || is_tried || confirmations > 0;
        BankHeader {
            header,
            is_headed: is_headed || is_sealed,
            is_sealed,
            is_tried,
            confirmations,
            lead: ahead,
        }
    }

    /// Adds one of these notes to a slot, the first that is blank and that the flash takes. Returns
    /// which.
    fn note(&mut self, slot: FlashBank, mut notes: Range<u32>) -> Option<u32> {
        notes.find(|note| {
            let is_blank = self.read(slot, note_at(*note)) == Some(BLANK);
            is_blank && self.record(slot, note_at(*note), &NOTE)
        })
    }

    /// Writes a block of a slot's head. Returns whether it is there.
    fn record(&mut self, slot: FlashBank, offset: u32, block: &Block) -> bool {
        let address = self.layout.address(slot, offset);
        self.flash.write(address, block).is_ok() && self.read(slot, offset) == Some(*block)
    }

    /// A block of a slot, if the flash can read it.
    fn read(&mut self, slot: FlashBank, offset: u32) -> Option<Block> {
        let mut block = BLANK;
        let address = self.layout.address(slot, offset);
        self.flash.read(address, &mut block).ok()?;
        Some(block)
    }

    /// The same; what cannot be read is tried once more.
    fn read_again(&mut self, slot: FlashBank, offset: u32) -> Option<Block> {
        self.read(slot, offset).or_else(|| self.read(slot, offset))
    }

    /// The checksum of the first `len` bytes of a payload, which must be within its slot. What was
    /// read is in `room` afterwards, as far as there is some: so what is checked is what is used,
    /// also where a second reading would give something else.
    fn payload_crc(&mut self, slot: FlashBank, len: u32, room: &mut [u8]) -> Option<u32> {
        const CRC: crc::Crc<u32, crc::NoTable> =
            crc::Crc::<u32, crc::NoTable>::new(&crc::CRC_32_ISO_HDLC);
        let mut digest = CRC.digest();
        let mut places = room.chunks_mut(BLOCK_BYTES);
        for at in (0..len).step_by(BLOCK_BYTES) {
            let block = self.read(slot, HEADER_BYTES + at)?;
            let part = block.get(..(len - at) as usize).unwrap_or(&block);
            digest.update(part);
            for (place, byte) in places.next().unwrap_or_default().iter_mut().zip(part) {
                *place = *byte;
            }
        }
        Some(digest.finalize())
    }
}

impl Upload {
    /// Writes the block that the last byte which arrived is in.
    fn write_block<F: NorFlash>(
        &mut self,
        flash: &mut F,
        layout: &Layout,
    ) -> Result<(), NorFlashErrorKind> {
        let block = core::mem::replace(&mut self.block, BLANK);
        let at = self.received.saturating_sub(1) / BLOCK_BYTES as u32 * BLOCK_BYTES as u32;
        flash
            .write(layout.address(self.slot, HEADER_BYTES + at), &block)
            .map_err(|error| error.kind())
    }
}

/// Where a note is in its slot.
fn note_at(note: u32) -> u32 {
    NOTES_AT + note * BLOCK_BYTES as u32
}
