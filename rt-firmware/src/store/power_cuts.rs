//! What the store promises, held against a flash that loses power in every operation of many
//! histories, and again while it recovers.
//!
//! The invariants:
//! - What was acknowledged is not lost: an upload whose `finish` returned is tried, a mission whose
//!   `confirm` returned is the one that runs, unless something newer was asked for.
//! - Each choice is one whole mission, byte for byte, or none; and it is the one that is due. Where
//!   power was lost while it was being decided, either answer is right, also one today and the
//!   other tomorrow.
//! - A mission that was on trial and was not confirmed is not run again.
//! - Nothing is in the way of the next upload.
//! - The slot that runs is not touched, and no unit is written twice.

use std::cell::RefCell;
use std::collections::HashSet;
use std::format;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::rc::Rc;
use std::string::String;
use std::vec;
use std::vec::Vec;

use super::nor::{Chip, Cut, Flicker, Geometry, Kind, Nor, Rewrite, Tear};
use super::*;

/// An invariant that was broken, and how.
type Broken = String;

/// A mission is known by its number.
type Id = u32;

/// Some bytes that no other mission has. Their number is sometimes a multiple of a block's.
fn mission(id: Id) -> Vec<u8> {
    let len = [45, 64, 7, 71][id as usize % 4];
    (0..len)
        .map(|at: u32| (id * 37 + at * 11) as u8 ^ (at as u8).rotate_left(3))
        .collect()
}

fn crc_of(bytes: &[u8]) -> u32 {
    esm_core::format::crc32(bytes)
}

/// What is known of a mission that is not the one to fall back to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Stage {
    /// Power was lost before its upload was acknowledged.
    MaybeThere,
    /// It is to be tried.
    There,
    /// Power was lost before its trial began.
    MaybeTried,
    /// It runs on trial.
    OnTrial,
    /// Power was lost while it was confirmed.
    MaybeConfirmed,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Runs {
    Default,
    Trial(Id),
    Confirmed(Id),
}

/// What has to be, from what was asked for and answered.
#[derive(Clone, Default, Hash)]
struct Oracle {
    /// The mission that was confirmed last.
    base: Option<Id>,
    /// Those after it, the newest last.
    candidates: Vec<(Id, Stage)>,
    runs: Option<Runs>,
}

impl Oracle {
    /// All that may run after the next choice.
    fn due(&self) -> Vec<Runs> {
        let mut due = vec![];
        for (id, stage) in self.candidates.iter().rev() {
            match stage {
                Stage::MaybeThere | Stage::MaybeTried => due.push(Runs::Trial(*id)),
                Stage::MaybeConfirmed => due.push(Runs::Confirmed(*id)),
                Stage::OnTrial => {}
                Stage::There => {
                    due.push(Runs::Trial(*id));
                    return due;
                }
            }
        }
        due.push(self.base.map_or(Runs::Default, Runs::Confirmed));
        due
    }

    fn choice_begins(&mut self) {
        self.candidates
            .retain(|(_, stage)| *stage != Stage::OnTrial);
        self.runs = None;
    }

    fn choice_cut(&mut self) {
        for (_, stage) in &mut self.candidates {
            if *stage == Stage::There {
                *stage = Stage::MaybeTried;
            }
        }
    }

    fn chosen(&mut self, runs: Runs) -> Result<(), Broken> {
        let due = self.due();
        if !due.contains(&runs) {
            return Err(format!("{runs:?} was chosen, due was {due:?}"));
        }
        self.runs = Some(runs);
        if let Runs::Trial(id) = runs {
            let place = self
                .candidates
                .iter()
                .position(|(other, _)| *other == id)
                .unwrap();
            self.candidates[place].1 = Stage::OnTrial;
            let mut at = 0;
            self.candidates.retain(|(_, stage)| {
                at += 1;
                at > place || *stage == Stage::MaybeConfirmed
            });
        }
        Ok(())
    }

    /// An upload begins to erase: what runs is what stays.
    fn erases(&mut self) {
        match self.runs {
            Some(Runs::Confirmed(id)) => {
                self.base = Some(id);
                self.candidates.clear();
            }
            // Nothing runs. One of the uploads that nobody tried may be gone.
            _ => self.erase_cut(),
        }
    }

    /// Power is lost while an upload that nobody tried is given up.
    fn erase_cut(&mut self) {
        for (_, stage) in &mut self.candidates {
            if *stage == Stage::There {
                *stage = Stage::MaybeThere;
            }
        }
    }

    fn running(&self) -> Option<Id> {
        match self.runs {
            Some(Runs::Trial(id) | Runs::Confirmed(id)) => Some(id),
            _ => None,
        }
    }

    fn confirmed(&mut self) {
        let Some(id) = self.running() else { return };
        self.runs = Some(Runs::Confirmed(id));
        if self.base != Some(id) {
            self.base = Some(id);
            let place = self
                .candidates
                .iter()
                .position(|(other, _)| *other == id)
                .unwrap();
            self.candidates.drain(..=place);
        }
    }

    fn confirm_cut(&mut self) {
        let running = self.running();
        for (id, stage) in &mut self.candidates {
            if Some(*id) == running {
                *stage = Stage::MaybeConfirmed;
            }
        }
    }
}

/// What a host and a robot do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// Off and on.
    Reboot,
    /// The store is asked again while the robot stays on.
    Choose,
    /// What was uploaded runs on trial while the robot stays on.
    Try,
    /// The trial is left while the robot stays on.
    FallBack,
    Confirm,
    /// In pieces of some size.
    Upload,
    /// The link fails in the middle; bytes come twice; then it goes on where it stopped.
    UploadWithTrouble,
    /// One that is not ended.
    HalfUpload,
    /// One that is longer than a slot.
    LongUpload,
}
use Step::{
    Choose, Confirm, FallBack, HalfUpload, LongUpload, Reboot, Try, Upload, UploadWithTrouble,
};

/// Power was lost; or an invariant was broken.
enum Stop {
    PowerLoss,
    Broken(Broken),
}

impl From<Broken> for Stop {
    fn from(broken: Broken) -> Self {
        Stop::Broken(broken)
    }
}

struct World<const WRITE: usize, const ERASE: usize> {
    nor: Rc<RefCell<Nor>>,
    store: Option<Store<Chip<WRITE, ERASE>>>,
    layout: Layout,
    oracle: Oracle,
    /// The mission whose upload ended since the last choice, and that nobody has tried.
    ended: Option<Id>,
    /// What ran before the trial, where that began since the last choice.
    before: Option<Option<Runs>>,
    next: Id,
    room: [u8; 128],
}

impl<const WRITE: usize, const ERASE: usize> World<WRITE, ERASE> {
    /// Slots behind a stretch of flash that is someone else's.
    fn new(bank_bytes: usize, rewrite: Rewrite) -> Self {
        let geometry = Geometry {
            write: WRITE,
            rewrite,
        };
        let nor = Nor::new(geometry, ERASE + 2 * bank_bytes);
        World {
            nor: Rc::new(RefCell::new(nor)),
            store: None,
            layout: Layout::new(ERASE as u32, bank_bytes as u32),
            oracle: Oracle::default(),
            ended: None,
            before: None,
            next: 1,
            room: [0; 128],
        }
    }

    /// The same world, with a flash of its own.
    fn snapshot(&self) -> Self {
        let nor = Rc::new(RefCell::new(self.nor.borrow().clone()));
        let store = self.store.as_ref().map(|store| Store {
            flash: Chip(nor.clone()),
            layout: store.layout,
            running: store.running,
            before: store.before,
            upload: None,
            ended: store.ended,
            erases: store.erases,
            floor: store.floor,
        });
        World {
            nor,
            store,
            layout: self.layout,
            oracle: self.oracle.clone(),
            ended: self.ended,
            before: self.before,
            next: self.next,
            room: [0; 128],
        }
    }

    /// Without power.
    fn off(&mut self) {
        self.store = None;
        self.nor.borrow_mut().power_on();
    }

    /// Two worlds with the same number go on alike.
    fn fingerprint(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        self.nor.borrow().fingerprint(&mut hasher);
        self.oracle.hash(&mut hasher);
        self.next.hash(&mut hasher);
        if let Some(store) = &self.store {
            let of = |running: Running| (running.slot as u8, running.on_trial, running.is_certain);
            let before = store.before.map(|before| before.map(of));
            let ended = store.ended.map(|slot| slot as u8);
            (store.running.map(of), before, ended).hash(&mut hasher);
            (self.ended, self.before).hash(&mut hasher);
        }
        hasher.finish()
    }

    /// Looks whether a rule of the flash was broken, and whether power is still on.
    fn look(&self) -> Result<(), Stop> {
        let nor = self.nor.borrow();
        match &nor.breach {
            Some(rule) => Err(Stop::Broken(rule.clone())),
            None if nor.is_off => Err(Stop::PowerLoss),
            None => Ok(()),
        }
    }

    /// The operation that was cut since the last time, and forgets it.
    fn cut(&self) -> Option<Kind> {
        self.nor.borrow_mut().fired.take()
    }

    fn step(&mut self, step: Step) -> Result<(), Stop> {
        match step {
            Reboot => self.boot(),
            Choose => self.choose(),
            Confirm => self.confirm(),
            Try => self.begin_trial(),
            FallBack => self.fall_back(),
            Upload => self.upload(33, false, true),
            UploadWithTrouble => self.upload(5, true, true),
            HalfUpload => self.upload(32, false, false),
            LongUpload => self.long_upload(),
        }
    }

    fn boot(&mut self) -> Result<(), Stop> {
        let is_on = self.store.is_some();
        self.store = None;
        if is_on {
            let mut nor = self.nor.borrow_mut();
            let cut = nor.cut;
            nor.power_on();
            nor.cut = cut;
        }
        self.oracle.choice_begins();
        let chip = Chip(self.nor.clone());
        self.room.fill(0xEE);
        let booted = Store::boot(chip, self.layout, &mut self.room, |_| true);
        let (store, choice) = booted.map_err(|error| format!("no store: {error:?}"))?;
        self.store = Some(store);
        self.chosen(choice)
    }

    fn choose(&mut self) -> Result<(), Stop> {
        self.nor.borrow_mut().running = None;
        self.oracle.choice_begins();
        self.room.fill(0xEE);
        let choice = self
            .store
            .as_mut()
            .unwrap()
            .choose(&mut self.room, |_| true);
        self.chosen(choice)
    }

    fn chosen(&mut self, choice: Choice) -> Result<(), Stop> {
        if self.cut().is_some() {
            self.oracle.choice_cut();
        }
        self.look()?;
        (self.ended, self.before) = (None, None);
        let runs = match choice.mission {
            None => Runs::Default,
            Some(chosen) => {
                let bytes = &self.room[..chosen.len as usize];
                let id = (1..self.next).find(|id| mission(*id) == bytes);
                let id = id.ok_or_else(|| format!("{choice:?}: no mission that was ever sent"))?;
                if chosen.on_trial {
                    Runs::Trial(id)
                } else {
                    Runs::Confirmed(id)
                }
            }
        };
        self.oracle
            .chosen(runs)
            .map_err(|broken| format!("{broken}; {choice:?}"))?;
        says_why(&choice)?;
        self.guard(choice.mission.map(|chosen| chosen.slot));
        Ok(())
    }

    /// From now on nothing may touch this slot but for its notes.
    fn guard(&self, slot: Option<FlashBank>) {
        let guarded = slot.map(|slot| {
            let (from, to) = self.layout.bounds(slot);
            let notes = self.layout.address(slot, NOTES_AT) as usize
                ..self.layout.address(slot, HEADER_AT) as usize;
            (from as usize..to as usize, notes)
        });
        self.nor.borrow_mut().running = guarded;
    }

    fn begin_trial(&mut self) -> Result<(), Stop> {
        let store = self.store.as_mut().unwrap();
        let result = store.begin_trial();
        let slot = store.running.map(|running| running.slot);
        let cut = self.cut();
        let ended = self.ended.take();
        if cut.is_some() {
            self.oracle.choice_cut();
        }
        self.look()?;
        match (result, ended) {
            (Ok(()), Some(id)) => {
                self.before = Some(self.oracle.runs);
                self.oracle.chosen(Runs::Trial(id))?;
                self.guard(slot);
                Ok(())
            }
            (Err(TrialError::NoUpload), None) => Ok(()),
            // It was refused, and is not tried by the next start either.
            (Err(TrialError::NotRecorded), Some(id)) if cut.is_some() => {
                self.oracle.candidates.retain(|(other, _)| *other != id);
                Ok(())
            }
            (result, ended) => Err(format!("{result:?} when {ended:?} was put on trial").into()),
        }
    }

    fn fall_back(&mut self) -> Result<(), Stop> {
        let store = self.store.as_mut().unwrap();
        let result = store.fall_back();
        let slot = store.running.map(|running| running.slot);
        self.look()?;
        let before = self.before.take();
        if result != before.is_some() {
            return Err(format!("falling back to {before:?}: {result}").into());
        }
        if let Some(before) = before {
            self.oracle.choice_begins();
            self.oracle.runs = before;
            self.guard(slot);
        }
        Ok(())
    }

    fn confirm(&mut self) -> Result<(), Stop> {
        let result = self.store.as_mut().unwrap().confirm();
        let cut = self.cut();
        if cut.is_some() {
            self.oracle.confirm_cut();
        }
        self.look()?;
        match (result, self.oracle.running()) {
            (Ok(()), Some(_)) => {
                self.oracle.confirmed();
                self.before = None;
            }
            (Err(ConfirmError::NoMission), None) => {}
            (Err(ConfirmError::NotRecorded), Some(_)) if cut.is_some() => {}
            (result, running) => {
                return Err(format!("{result:?} when {running:?} was confirmed").into());
            }
        }
        Ok(())
    }

    fn upload(&mut self, piece: usize, has_trouble: bool, ends: bool) -> Result<(), Stop> {
        let id = self.next;
        let bytes = mission(id);
        if !self.begin(&bytes)? {
            return Ok(());
        }
        self.next += 1;
        let bytes_to_send = if ends {
            &bytes[..]
        } else {
            &bytes[..bytes.len() / 2]
        };
        let mut offset = 0;
        for piece in bytes_to_send.chunks(piece) {
            let sent = self.store.as_mut().unwrap().append(offset, piece);
            let cut = self.cut();
            self.look()?;
            match sent {
                Ok(next) => offset = next,
                Err(AppendError::Flash(_)) if cut.is_some() => return Ok(()),
                Err(error) => return Err(format!("bytes at {offset}: {error:?}").into()),
            }
            if has_trouble {
                let store = self.store.as_mut().unwrap();
                let twice = store.append(offset - piece.len() as u32, piece);
                self.look()?;
                if twice != Err(AppendError::Offset { expected: offset }) {
                    return Err(format!("bytes came twice: {twice:?}").into());
                }
                let again = self
                    .store
                    .as_mut()
                    .unwrap()
                    .begin(bytes.len() as u32, crc_of(&bytes));
                if again != Ok(offset) {
                    return Err(format!("at {offset}, the upload goes on at {again:?}").into());
                }
            }
        }
        let store = self.store.as_mut().unwrap();
        if !ends {
            let ended = store.finish();
            if ended != Err(FinishError::Incomplete { received: offset }) {
                return Err(format!("half an upload: {ended:?}").into());
            }
            store.abort();
            return Ok(());
        }
        if store.append(offset, &[1]) != Err(AppendError::TooLong) {
            return Err(String::from("a byte too many was taken").into());
        }
        let ended = self.store.as_mut().unwrap().finish();
        let cut = self.cut();
        let result = match ended {
            _ if cut.is_some() => Ok(Stage::MaybeThere),
            Ok(_) => {
                self.ended = Some(id);
                Ok(Stage::There)
            }
            Err(error) => Err(format!("an upload ends in {error:?}")),
        };
        if let Ok(stage) = result {
            self.oracle.candidates.push((id, stage));
        }
        self.look()?;
        result.map(drop).map_err(Stop::from)
    }

    /// Returns whether an upload began.
    fn begin(&mut self, bytes: &[u8]) -> Result<bool, Stop> {
        let result = self
            .store
            .as_mut()
            .unwrap()
            .begin(bytes.len() as u32, crc_of(bytes));
        let cut = self.cut();
        if cut == Some(Kind::Erase) || result.is_ok() {
            self.ended = None;
            self.oracle.erases();
        } else if cut == Some(Kind::Write) {
            self.oracle.erase_cut();
        }
        self.look()?;
        let on_trial = matches!(self.oracle.runs, Some(Runs::Trial(_)));
        match result {
            Ok(0) if !on_trial => Ok(true),
            Err(BeginError::OnTrial) if on_trial => Ok(false),
            Err(BeginError::Flash(_)) if cut.is_some() => Ok(false),
            result => Err(format!("an upload begins with {result:?}").into()),
        }
    }

    fn long_upload(&mut self) -> Result<(), Stop> {
        let bytes = vec![0x11; self.layout.payload_capacity() as usize + 1];
        let store = self.store.as_mut().unwrap();
        let result = store.begin(bytes.len() as u32, crc_of(&bytes));
        if result.is_ok() {
            let _ = store.append(0, &bytes);
            let _ = store.finish();
        }
        self.look()?;
        if matches!(result, Err(BeginError::Length { .. })) {
            Ok(())
        } else {
            Err(format!("an upload that is too long begins with {result:?}").into())
        }
    }

    /// Does these steps. If power is lost, the rest is not done.
    fn run(&mut self, steps: &[Step]) -> Result<bool, Broken> {
        for step in steps {
            match self.step(*step) {
                Ok(()) => {}
                Err(Stop::PowerLoss) => {
                    self.off();
                    return Ok(false);
                }
                Err(Stop::Broken(broken)) => return Err(format!("{step:?}: {broken}")),
            }
        }
        Ok(true)
    }

    /// If there is power, these steps are done; then the robot starts again.
    fn goes_on_well(&mut self, rest: &[Step]) -> Result<(), Broken> {
        if self.store.is_some() {
            self.run(rest)?;
            self.off();
        }
        self.ends_well()
    }

    /// Whatever happened, the robot starts again and again, and then takes an upload.
    fn ends_well(&mut self) -> Result<(), Broken> {
        self.nor.borrow_mut().cut = None;
        self.run(&[Reboot, Reboot, Reboot])?;
        for _ in 0..4 {
            if !matches!(self.oracle.runs, Some(Runs::Trial(_))) {
                break;
            }
            self.run(&[Choose])?;
        }
        let id = self.next;
        self.run(&[Upload, Reboot])?;
        if self.oracle.runs != Some(Runs::Trial(id)) {
            return Err(format!("after the next upload, {:?}", self.oracle.runs));
        }
        self.run(&[Confirm, Reboot, Reboot])?;
        if self.oracle.runs != Some(Runs::Confirmed(id)) {
            return Err(format!(
                "after the next confirmation, {:?}",
                self.oracle.runs
            ));
        }
        Ok(())
    }
}

/// The states of the slots say what was chosen and why nothing newer was.
fn says_why(choice: &Choice) -> Result<(), Broken> {
    let is_fine = match choice.mission {
        None => choice.slots.iter().all(|state| {
            !matches!(
                state,
                BankState::Runs | BankState::OnTrial | BankState::Spare
            )
        }),
        Some(chosen) => {
            let expected = if chosen.on_trial {
                BankState::OnTrial
            } else {
                BankState::Runs
            };
            chosen.slot.of(choice.slots) == expected
                && !matches!(
                    chosen.slot.other().of(choice.slots),
                    BankState::Runs | BankState::OnTrial
                )
        }
    };
    if is_fine {
        Ok(())
    } else {
        Err(format!("it does not say why: {choice:?}"))
    }
}

/// What happens before the first cut or up to it.
const HISTORIES: &[&[Step]] = &[
    &[
        Reboot, Upload, Choose, Confirm, Upload, Reboot, Confirm, Reboot,
    ],
    // Without a mission to fall back to.
    &[
        Reboot, Upload, Reboot, Reboot, Upload, Choose, Upload, Choose, Upload, Reboot,
    ],
    &[Reboot, Upload, Upload, Upload, Reboot, Reboot],
    // Trials that fail.
    &[
        Reboot,
        UploadWithTrouble,
        Choose,
        Confirm,
        Upload,
        Choose,
        Choose,
        Confirm,
        Upload,
        Choose,
        Reboot,
        Upload,
        Choose,
        Confirm,
    ],
    &[
        Reboot, Upload, Choose, Confirm, Upload, Confirm, HalfUpload, LongUpload, Upload, Reboot,
        Confirm, HalfUpload, Reboot, Upload, Upload, Choose,
    ],
    // Trials while the robot stays on.
    &[
        Reboot, Upload, Try, Confirm, Upload, Try, FallBack, Confirm, FallBack, Upload, Try, Try,
        Upload, Reboot, Upload, Try, Reboot, FallBack,
    ],
];

/// What happens after it, up to the second.
const RECOVERIES: &[&[Step]] = &[
    &[Reboot, Confirm, Reboot, Upload, Choose, Confirm],
    &[Reboot, Reboot, Upload, Reboot],
    &[Reboot, Upload, Reboot, Upload, Choose, Confirm, Reboot],
    &[Reboot, Choose, HalfUpload, Confirm, Choose, Upload],
    &[
        Reboot, FallBack, Upload, Try, FallBack, Upload, Try, Confirm,
    ],
];

/// What a cut makes of a write. The first of them are of each kind: clean, torn, weak.
const WRITE_TEARS: &[Tear] = &[
    Tear::Nothing,
    Tear::Weak(Flicker::NewOld),
    Tear::FirstHalf,
    Tear::Whole,
    Tear::Weak(Flicker::OldNew),
    Tear::Unreadable,
    Tear::Weak(Flicker::NewNewOld),
    Tear::Some(77),
    Tear::LastHalf,
    Tear::OneBit,
    Tear::AllButOneBit,
    Tear::Weak(Flicker::OldNewNew),
    Tear::Weak(Flicker::Noise),
    Tear::SomeWeak(99, Flicker::NewOld),
];

/// Of an erase.
const ERASE_TEARS: &[Tear] = &[
    Tear::Nothing,
    Tear::BlockAndWeak(2, Flicker::OldNew),
    Tear::FirstHalf,
    Tear::Whole,
    Tear::BlockAndWeak(2, Flicker::OldNewNew),
    Tear::Weak(Flicker::OldNew),
    Tear::OnlyBlock(0),
    Tear::OnlyBlock(1),
    Tear::LastHalf,
    Tear::Some(55),
    Tear::Weak(Flicker::NewOld),
    Tear::Weak(Flicker::Noise),
    Tear::SomeWeak(33, Flicker::OldNew),
    Tear::OnlyBlock(31),
    Tear::OnlyBlock(2),
    Tear::OnlyBlock(3),
    Tear::Zeros,
    Tear::Garbage(11),
    Tear::Unreadable,
];

/// How deep to go, and how far it went.
struct Search {
    /// Tears of the first and of the second cut, as many of each list.
    tears: [usize; 2],
    /// A second cut comes after one in this many of the worlds that a first one leads to.
    one_in: usize,
    /// Worlds that were gone on from.
    seen: HashSet<(u64, Option<(usize, usize)>)>,
    histories: usize,
}

impl Search {
    fn new(tears: [usize; 2]) -> Self {
        Search {
            tears,
            one_in: 1,
            seen: HashSet::new(),
            histories: 0,
        }
    }

    /// Runs a history with each of its operations cut in each way, and each recovery from it
    /// likewise.
    fn cut_twice<const WRITE: usize, const ERASE: usize>(
        &mut self,
        start: &World<WRITE, ERASE>,
        history: &[Step],
    ) -> Result<(), Broken> {
        let [first_tears, second_tears] = self.tears;
        self.seen.clear();
        let (mut seen, mut steps) = (HashSet::new(), HashSet::new());
        let never = &mut |_, _| false;
        cut_each(
            start,
            history,
            first_tears,
            never,
            &mut |first, world, rest| {
                let is_on = world.store.is_some();
                // What is still to be done makes a difference where it is done.
                let left = if is_on { rest.len() } else { 0 };
                if !seen.insert((world.fingerprint(), left)) {
                    return Ok(());
                }
                let within = |broken| format!("{broken}\n  after {first:?} in {history:?}");
                world.snapshot().goes_on_well(rest).map_err(within)?;
                if !seen.len().is_multiple_of(self.one_in) {
                    return Ok(());
                }
                for (number, recovery) in RECOVERIES.iter().enumerate() {
                    // With power on, it is the session of the error that goes on.
                    let recovery = &recovery[usize::from(is_on)..];
                    let mut is_known = |done, world| !steps.insert((number, is_on, done, world));
                    let again = &mut |second, mut world: World<WRITE, ERASE>, rest: &[Step]| {
                        self.histories += 1;
                        let left = world.store.as_ref().map(|_| (number, rest.len()));
                        if !self.seen.insert((world.fingerprint(), left)) {
                            return Ok(());
                        }
                        world
                            .goes_on_well(rest)
                            .map_err(|broken| format!("{broken}\n  after {second:?}"))
                    };
                    cut_each(&world, recovery, second_tears, &mut is_known, again).map_err(
                        |broken| within(format!("{broken}\n  recovering with {recovery:?}")),
                    )?;
                }
                Ok(())
            },
        )
    }
}

/// Errors without a loss of power have fewer shapes: as many of each list.
const ERRORS: usize = 2;

/// What is done with a world that a cut has led to, or none, and with the steps that are still to
/// be done.
type GoOn<'g, const WRITE: usize, const ERASE: usize> =
    dyn FnMut(Option<Cut>, World<WRITE, ERASE>, &[Step]) -> Result<(), Broken> + 'g;

/// Goes on from the worlds that steps lead to: without a cut, and with each cut. Where that was an
/// error and no loss of power, they have power, and the steps after it are still to be done. What
/// is known of the world before a step (`is_known`) is passed over, with all that would come of it.
fn cut_each<const WRITE: usize, const ERASE: usize>(
    start: &World<WRITE, ERASE>,
    steps: &[Step],
    tears: usize,
    is_known: &mut dyn FnMut(usize, u64) -> bool,
    go_on: &mut GoOn<'_, WRITE, ERASE>,
) -> Result<(), Broken> {
    let mut whole = start.snapshot();
    for done in 0..steps.len() {
        if is_known(done, whole.fingerprint()) {
            return Ok(());
        }
        let before = whole.snapshot();
        let first = whole.nor.borrow().operations;
        whole.nor.borrow_mut().log.clear();
        whole.run(&steps[done..=done])?;
        let kinds = whole.nor.borrow().log.clone();
        for (at, kind) in (first..).zip(kinds) {
            let tears_of_kind = match kind {
                Kind::Write => WRITE_TEARS,
                Kind::Erase => ERASE_TEARS,
            };
            for is_loss in [true, false] {
                let tears = if is_loss { tears } else { tears.min(ERRORS) };
                for tear in tears_of_kind.iter().take(tears) {
                    let cut = Cut {
                        at,
                        kind,
                        tear: *tear,
                        is_loss,
                    };
                    let mut world = before.snapshot();
                    world.nor.borrow_mut().cut = Some(cut);
                    world
                        .run(&steps[done..=done])
                        .map_err(|broken| format!("{broken}\n  in {cut:?}"))?;
                    go_on(Some(cut), world, &steps[done + 1..])?;
                }
            }
        }
    }
    go_on(None, whole, &[])
}

/// Slots of one erase unit; words of four bytes.
type Small = World<4, 2048>;
/// Slots of several erase units; a block is one write.
type Coarse = World<32, 512>;

fn small(rewrite: Rewrite) -> Small {
    World::new(2048, rewrite)
}

/// A mission that was confirmed long ago, with this number, in bank A.
fn with_a_mission_numbered<const WRITE: usize, const ERASE: usize>(
    mut world: World<WRITE, ERASE>,
    seq: u32,
) -> World<WRITE, ERASE> {
    let (id, bytes) = (world.next, mission(world.next));
    world.next += 1;
    put_mission(&world, FlashBank::A, seq, &bytes, bytes.len() as u32);
    world.oracle.base = Some(id);
    world
}

fn put_mission<const WRITE: usize, const ERASE: usize>(
    world: &World<WRITE, ERASE>,
    slot: FlashBank,
    seq: u32,
    bytes: &[u8],
    len: u32,
) {
    let header = Header {
        seq,
        len,
        crc: crc_of(bytes),
        erases: 1,
    };
    let mut nor = world.nor.borrow_mut();
    let blocks = [
        (HEADER_WRITTEN_AT, HEADER_WRITTEN),
        (SEALED_AT, SEALED),
        (TRIED_AT, TRIED),
        (NOTES_AT, NOTE),
        (HEADER_AT, header.encode()),
    ];
    for (offset, block) in blocks {
        nor.put(world.layout.address(slot, offset) as usize, &block);
    }
    let mut padded = bytes.to_vec();
    padded.resize(bytes.len().next_multiple_of(BLOCK_BYTES), 0xFF);
    nor.put(world.layout.address(slot, HEADER_BYTES) as usize, &padded);
}

/// The histories without any cut, on flashes of several kinds, also with a first content that
/// nobody wrote, and near the end of the numbers.
fn without_cuts() -> Result<(), Broken> {
    for history in HISTORIES {
        let within = |broken| format!("{broken}\n  in {history:?}");
        let starts = [
            small(Rewrite::Refuse),
            with_a_mission_numbered(small(Rewrite::Refuse), u32::MAX - 3),
        ];
        for mut world in starts {
            world
                .run(history)
                .and_then(|_| world.ends_well())
                .map_err(within)?;
        }
        let mut world = Coarse::new(1536, Rewrite::Refuse);
        world
            .run(history)
            .and_then(|_| world.ends_well())
            .map_err(within)?;
        for byte in [0, 0x5A, 0x96, 0xC3] {
            let mut world = World::<1, 256>::new(1280, Rewrite::Refuse);
            world.nor.borrow_mut().fill(byte);
            world
                .run(history)
                .and_then(|_| world.ends_well())
                .map_err(within)?;
        }
    }
    Ok(())
}

/// Each bit of both slots, in the states between the steps of a history, changes by itself. What
/// was due, or what the other slot has, is chosen, and what is wrong is said.
fn bits_flip() -> Result<(), Broken> {
    let history = [
        Reboot, Upload, Choose, Confirm, Upload, Choose, Choose, Upload, Choose, Confirm,
    ];
    for end in [2, 3, 4, 5, 6, 10] {
        let mut world = small(Rewrite::Merge);
        world.run(&history[..end])?;
        world.off();
        let mut sound = world.snapshot();
        sound.oracle.choice_begins();
        let due = sound.oracle.due();
        let (from, to) = (
            sound.layout.bounds(FlashBank::A).0 as usize,
            sound.layout.bounds(FlashBank::B).1 as usize,
        );
        let used = HEADER_BYTES as usize + 3 * BLOCK_BYTES;
        for at in (from..to).filter(|at| (at - from) % 2048 < used) {
            for bit in 0..8 {
                let within = |broken: Broken| {
                    format!(
                        "{broken}\n  bit {bit} of byte {} flipped after {:?}",
                        at - from,
                        &history[..end]
                    )
                };
                let world = sound.snapshot();
                world.nor.borrow_mut().flip(at, bit);
                let mut room = [0xEE; 128];
                let (_, choice) = Store::boot(
                    Chip::<4, 2048>(world.nor.clone()),
                    world.layout,
                    &mut room,
                    |_| true,
                )
                .map_err(|error| format!("{error:?}"))?;
                says_why(&choice).map_err(within)?;
                let runs = match choice.mission {
                    None => Runs::Default,
                    Some(chosen) => {
                        let bytes = room.get(..chosen.len as usize).unwrap_or_default();
                        let id = (1..world.next).find(|id| mission(*id) == bytes);
                        let id = id.ok_or_else(|| within(format!("{choice:?}: no mission")))?;
                        if chosen.on_trial {
                            Runs::Trial(id)
                        } else {
                            Runs::Confirmed(id)
                        }
                    }
                };
                if due.contains(&runs) {
                    continue;
                }
                let damaged = |state: &BankState| {
                    matches!(
                        state,
                        BankState::BrokenHeader
                            | BankState::BrokenPayload
                            | BankState::Unsealed
                            | BankState::TrialFailed
                    )
                };
                let is_old = matches!(runs, Runs::Confirmed(_) | Runs::Default);
                if !is_old || !choice.slots.iter().any(damaged) {
                    return Err(within(format!(
                        "{runs:?} was chosen, due was {due:?}; {choice:?}"
                    )));
                }
                if at % 7 == 0 {
                    next_upload_works(&world.snapshot()).map_err(within)?;
                }
            }
        }
    }
    Ok(())
}

/// A new mission goes into this flash, whatever is in it.
fn next_upload_works<const WRITE: usize, const ERASE: usize>(
    world: &World<WRITE, ERASE>,
) -> Result<(), Broken> {
    let bytes = mission(1000);
    let mut room = [0; 128];
    let chip = || Chip::<WRITE, ERASE>(world.nor.clone());
    let (mut store, mut choice) = Store::boot(chip(), world.layout, &mut room, |_| true)
        .map_err(|error| format!("{error:?}"))?;
    if choice.mission.is_some_and(|mission| mission.on_trial) {
        choice = store.choose(&mut room, |_| true);
    }
    let mut steps = || -> Result<(), Broken> {
        store
            .begin(bytes.len() as u32, crc_of(&bytes))
            .map_err(|error| format!("{error:?}"))?;
        store
            .append(0, &bytes)
            .map_err(|error| format!("{error:?}"))?;
        store.finish().map_err(|error| format!("{error:?}"))?;
        Ok(())
    };
    steps().map_err(|broken| format!("the next upload does not work: {broken}; {choice:?}"))?;
    let (_, choice) = Store::boot(chip(), world.layout, &mut room, |_| true)
        .map_err(|error| format!("{error:?}"))?;
    match choice.mission {
        Some(chosen) if chosen.on_trial && room.get(..chosen.len as usize) == Some(&bytes) => {
            Ok(())
        }
        _ => Err(format!("the next upload is not tried: {choice:?}")),
    }
}

/// Cells of a flash wear out: a block of a slot does not take what is written, and no error is
/// told. What is acknowledged is there all the same, and what cannot be put on record does not run.
fn cells_are_worn() -> Result<(), Broken> {
    let offsets = [
        SEALED_AT,
        TRIED_AT,
        NOTES_AT,
        HEADER_AT,
        HEADER_AT + 8,
        HEADER_BYTES,
        HEADER_BYTES + 40,
    ];
    for offset in offsets {
        for slot in [FlashBank::A, FlashBank::B] {
            let mut world = small(Rewrite::Refuse);
            world.run(&[Reboot, Upload, Choose, Confirm])?;
            let at = world.layout.address(slot, offset) as usize;
            world.nor.borrow_mut().wear(at, 0xFF);
            let bytes = mission(1001);
            let mut room = [0; 128];
            let within =
                |broken: Broken| format!("{broken}\n  byte {offset} of slot {slot:?} is worn");
            let store = world.store.as_mut().ok_or("no store")?;
            let is_there = store.begin(bytes.len() as u32, crc_of(&bytes)).is_ok()
                && store.append(0, &bytes).is_ok()
                && store.finish().is_ok();
            for _ in 0..2 {
                let (_, choice) = Store::boot(
                    Chip::<4, 2048>(world.nor.clone()),
                    world.layout,
                    &mut room,
                    |_| true,
                )
                .map_err(|error| format!("{error:?}"))?;
                let new = choice.slots.contains(&BankState::OnTrial)
                    || choice.slots.contains(&BankState::TrialFailed);
                let is_excused = choice.slots.contains(&BankState::TrialNotRecorded);
                if is_there != (new || is_excused) {
                    return Err(within(format!("acknowledged: {is_there}; {choice:?}")));
                }
                let word = world
                    .nor
                    .borrow()
                    .byte(world.layout.address(slot, TRIED_AT) as usize);
                if choice
                    .mission
                    .is_some_and(|mission| mission.on_trial && mission.slot == slot)
                    && word == 0xFF
                {
                    return Err(within(format!("a trial is not on record: {choice:?}")));
                }
                if choice.mission.is_none() {
                    return Err(within(format!("nothing runs: {choice:?}")));
                }
            }
        }
    }
    Ok(())
}

/// A header that is whole and tells more than its slot has.
fn headers_lie() -> Result<(), Broken> {
    let mut world = small(Rewrite::Refuse);
    let len = world.layout.payload_capacity() as usize + BLOCK_BYTES;
    let bytes = vec![0x33; len];
    put_mission(&world, FlashBank::A, 1, &bytes, len as u32);
    let mut room = vec![0; 4096];
    let chip = Chip::<4, 2048>(world.nor.clone());
    let (_, choice) = Store::boot(chip, world.layout, &mut room, |_| true)
        .map_err(|error| format!("{error:?}"))?;
    if choice.mission.is_some() || choice.slots[0] != BankState::TooLong {
        return Err(format!("a mission of {len} bytes: {choice:?}"));
    }
    world.ends_well()
}

/// A robot that starts none of its missions, of which one was confirmed and the newer one was not,
/// takes an upload in the place of the latter, whatever is cut meanwhile.
fn refused_missions_stay() -> Result<(), Broken> {
    for newer in [&[Upload][..], &[Upload, Choose], &[Upload, Try, FallBack]] {
        let mut world = small(Rewrite::Refuse);
        world.run(&[Reboot, Upload, Choose, Confirm])?;
        world.run(newer)?;
        world.off();
        let upload = |world: &Small, cut: Option<Cut>| -> Result<bool, Broken> {
            world.nor.borrow_mut().power_on();
            world.nor.borrow_mut().cut = cut;
            let mut room = [0; 128];
            let chip = Chip::<4, 2048>(world.nor.clone());
            let (mut store, choice) = Store::boot(chip, world.layout, &mut room, |_| false)
                .map_err(|error| format!("{error:?}"))?;
            if choice.mission.is_some() || choice.slots.contains(&BankState::OnTrial) {
                return Err(format!("{choice:?}"));
            }
            let bytes = mission(1000);
            let len = bytes.len() as u32;
            let written = store.begin(len, crc_of(&bytes)).is_ok()
                && store.append(0, &bytes).is_ok()
                && store.finish().is_ok()
                && store.begin_trial().is_ok();
            Ok(written)
        };
        let whole = world.snapshot();
        let first = whole.nor.borrow().operations;
        if !upload(&whole, None)? {
            return Err(String::from("an upload does not work where nothing runs"));
        }
        let last = whole.nor.borrow().operations;
        for at in first..=last {
            for (kind, tear) in [
                (Kind::Write, Tear::Nothing),
                (Kind::Write, Tear::Whole),
                (Kind::Erase, Tear::FirstHalf),
                (Kind::Erase, Tear::Weak(Flicker::OldNew)),
            ] {
                let cut = Cut {
                    at,
                    kind,
                    tear,
                    is_loss: true,
                };
                let world = world.snapshot();
                upload(&world, Some(cut))?;
                world.nor.borrow_mut().power_on();
                let mut room = [0; 128];
                let chip = Chip::<4, 2048>(world.nor.clone());
                let (mut store, mut choice) = Store::boot(chip, world.layout, &mut room, |_| true)
                    .map_err(|error| format!("{error:?}"))?;
                if choice.mission.is_some_and(|mission| mission.on_trial) {
                    choice = store.choose(&mut room, |_| true);
                }
                let len = choice.mission.map_or(0, |mission| mission.len as usize);
                if room.get(..len) != Some(&mission(1)) {
                    return Err(format!("{choice:?}\n  {cut:?} after {newer:?}"));
                }
            }
        }
    }
    Ok(())
}

/// Where a flash is of another kind, one in so many worlds is cut again.
fn invariants(search: &mut Search, one_in: usize) -> Result<(), Broken> {
    for history in HISTORIES {
        search.one_in = 1;
        search.cut_twice(&small(Rewrite::Refuse), history)?;
        search.one_in = one_in;
        search.cut_twice(&small(Rewrite::Merge), history)?;
    }
    search.cut_twice(
        &with_a_mission_numbered(small(Rewrite::Merge), u32::MAX - 2),
        HISTORIES[0],
    )?;
    search.cut_twice(&Coarse::new(1536, Rewrite::Refuse), HISTORIES[3])
}

/// So many tears of the first and of the second cut find most.
const FEW: [usize; 2] = [6, 5];

#[test]
fn histories_that_are_cut_keep_the_invariants() {
    let mut search = Search::new([4, 3]);
    if let Err(broken) = invariants(&mut search, 32) {
        panic!("{broken}");
    }
    std::println!("{} histories", search.histories);
    assert!(search.histories > 100_000, "{}", search.histories);
}

#[test]
#[ignore = "a minute with --release, many without"]
fn histories_that_are_cut_twice_everywhere_keep_the_invariants() {
    let mut search = Search::new(FEW);
    if let Err(broken) = invariants(&mut search, 1) {
        panic!("{broken}");
    }
    std::println!("{} histories", search.histories);
    assert!(search.histories > 100_000, "{}", search.histories);
}

#[test]
#[ignore = "an hour with --release"]
fn histories_that_are_cut_twice_everywhere_in_every_way_keep_the_invariants() {
    let mut search = Search::new([usize::MAX; 2]);
    if let Err(broken) = invariants(&mut search, 1) {
        panic!("{broken}");
    }
    std::println!("{} histories", search.histories);
}

/// Runs of this history that are cut in this operation, and then in any of this recovery.
fn cut_twice_at([history, at, recovery]: [usize; 3]) -> Result<(), Broken> {
    let start = small(Rewrite::Merge);
    let [first_tears, second_tears] = FEW;
    let never = &mut |_, _| false;
    cut_each(
        &start,
        HISTORIES[history],
        first_tears,
        never,
        &mut |cut, world, _| {
            if cut.is_none_or(|cut| cut.at != at) {
                return Ok(());
            }
            let recovery = &RECOVERIES[recovery][usize::from(world.store.is_some())..];
            let never = &mut |_, _| false;
            cut_each(
                &world,
                recovery,
                second_tears,
                never,
                &mut |_, mut world, rest| world.goes_on_well(rest),
            )
        },
    )
}

/// Operations in which a cut, and a second one behind it, find the most: mutants have shown which.
const TELLING_CUTS: [[usize; 3]; 9] = [
    [0, 0, 0],
    [0, 4, 0],
    [0, 8, 0],
    [0, 8, 2],
    [0, 13, 2],
    [0, 15, 0],
    [0, 15, 2],
    [1, 13, 2],
    [4, 13, 0],
];

#[test]
fn histories_that_are_cut_twice_where_it_tells_the_most_go_on_well() {
    for cuts in TELLING_CUTS {
        assert_eq!(cut_twice_at(cuts), Ok(()), "{cuts:?}");
    }
}

#[test]
fn histories_without_a_cut_end_well() {
    assert_eq!(without_cuts(), Ok(()));
}

#[test]
fn a_header_with_a_length_beyond_its_slot_is_refused() {
    assert_eq!(headers_lie(), Ok(()));
}

#[test]
fn missions_that_are_refused_stay() {
    assert_eq!(refused_missions_stay(), Ok(()));
}

#[test]
fn worn_cells_are_noticed() {
    assert_eq!(cells_are_worn(), Ok(()));
}

#[test]
fn flipped_bits_are_noticed() {
    assert_eq!(bits_flip(), Ok(()));
}
