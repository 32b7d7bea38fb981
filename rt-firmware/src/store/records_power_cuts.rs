//! What records promise, held against a flash that loses power in every operation of several
//! histories, and again while it recovers.
//!
//! The invariants: a record that was acknowledged is there; one whose writing was cut has its old
//! or its new value, and from the next start on always the same; whatever happened, the next record
//! can be kept. Neither is a cut taken for damage, nor damage for a flash that never had records:
//! what was acknowledged is there although any bit changes or any reading fails once.

use std::cell::RefCell;
use std::collections::{BTreeMap, HashSet};
use std::format;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::rc::Rc;
use std::string::String;
use std::vec;
use std::vec::Vec;

use super::key_values::{Found, Key, KeyValues, MAX_VALUE_BYTES, PutError};
use super::layout::{BLOCK_BYTES, HEADER_BYTES, Layout};
use super::nor::{Chip, Cut, Flicker, Geometry, Kind, Nor, Rewrite, Tear};
use super::{FlashBank, Store, journal};

type Broken = String;

const WRITE: usize = 8;
const ERASE: usize = 1024;
const AREA_BYTES: usize = 2 * ERASE;
/// Two areas, and the journal behind them.
const FLASH_BYTES: usize = 2 * AREA_BYTES + journal::bytes(ERASE as u32) as usize;
/// Room for the table.
const ROOM: usize = 128;

/// What is done to the records.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// Off and on.
    Reboot,
    /// Keeps a value of this length, its bytes all alike, under this key.
    Put(u8, usize, u8),
}
use Step::{Put, Reboot};

const HISTORIES: &[&[Step]] = &[
    &[
        Put(1, 8, 1),
        Put(1, 8, 2),
        Reboot,
        Put(1, 8, 3),
        Put(1, 8, 4),
        Reboot,
        Reboot,
    ],
    &[
        Put(1, 32, 9),
        Put(2, 4, 1),
        Put(2, 4, 2),
        Put(1, 0, 0),
        Reboot,
        Put(2, 0, 0),
        Put(3, 64, 7),
        Reboot,
        Put(3, 5, 8),
    ],
];

/// What comes after a cut.
const RECOVERIES: &[&[Step]] = &[
    &[Reboot, Put(1, 8, 21), Put(1, 8, 22), Reboot],
    &[Reboot, Reboot, Put(2, 4, 23), Reboot],
];

/// What a cut makes of an operation. The first of them are of each kind: clean, weak, torn.
const TEARS: &[Tear] = &[
    Tear::Nothing,
    Tear::Weak(Flicker::NewOld),
    Tear::FirstHalf,
    Tear::Whole,
    Tear::Weak(Flicker::OldNew),
    Tear::Weak(Flicker::NewNewOld),
    Tear::Weak(Flicker::OldNewNew),
    Tear::Unreadable,
    Tear::Some(77),
    Tear::SomeWeak(99, Flicker::OldNew),
    Tear::Garbage(5),
];

/// Values that a record may have.
type Allowed = BTreeMap<u8, Vec<Vec<u8>>>;

#[derive(Clone)]
struct World {
    nor: Nor,
    allowed: Allowed,
    /// A record was acknowledged.
    has_kept: bool,
}

/// What a start finds, and the values of some records.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Opened {
    found: Found,
    values: Vec<Vec<u8>>,
}

/// Power was lost; or an invariant was broken.
enum Stop {
    PowerLoss,
    Broken(Broken),
}

impl World {
    fn new(rewrite: Rewrite) -> Self {
        let geometry = Geometry {
            write: WRITE,
            rewrite,
        };
        World {
            nor: Nor::new(geometry, FLASH_BYTES),
            allowed: Allowed::new(),
            has_kept: false,
        }
    }

    /// What a start finds in this flash.
    fn opened(nor: &Rc<RefCell<Nor>>) -> Result<Opened, Broken> {
        let mut room = [0xEE; ROOM];
        let layout = Layout::new(0, AREA_BYTES as u32);
        let records = KeyValues::open(Chip::<WRITE, ERASE>(nor.clone()), layout, &mut room)
            .map_err(|error| format!("{error:?}"))?;
        let values = (1..=3)
            .map(|key| records.get(Key(key)).unwrap_or_default().to_vec())
            .collect();
        let found = records.found();
        Ok(Opened { found, values })
    }

    /// Switches on and does these steps. Returns whether power was on to the end; then it is
    /// switched off.
    fn run(&mut self, steps: &[Step], cut: Option<Cut>) -> Result<bool, Broken> {
        let nor = Rc::new(RefCell::new(self.nor.clone()));
        let mut sessions = steps.split(|step| *step == Reboot).peekable();
        let mut ended = Ok(());
        let mut pending = cut;
        while let Some(session) = sessions.next() {
            nor.borrow_mut().power_on();
            nor.borrow_mut().cut = pending;
            ended = self.session(&nor, session);
            pending = nor.borrow().cut;
            if ended.is_err() || sessions.peek().is_none() {
                break;
            }
        }
        let mut after = nor.borrow().clone();
        let breach = after.breach.take();
        let cut_is_left = after.cut;
        after.power_on();
        after.cut = cut_is_left;
        self.nor = after;
        if let Some(rule) = breach {
            return Err(rule);
        }
        match ended {
            Ok(()) => Ok(true),
            Err(Stop::PowerLoss) => Ok(false),
            Err(Stop::Broken(broken)) => Err(broken),
        }
    }

    fn session(&mut self, nor: &Rc<RefCell<Nor>>, steps: &[Step]) -> Result<(), Stop> {
        let mut room = [0xEE; ROOM];
        let chip = Chip::<WRITE, ERASE>(nor.clone());
        let layout = Layout::new(0, AREA_BYTES as u32);
        let opened = KeyValues::open(chip, layout, &mut room);
        if nor.borrow().is_off {
            return Err(Stop::PowerLoss);
        }
        let mut records = opened.map_err(|error| Stop::Broken(format!("{error:?}")))?;
        self.look(&records).map_err(Stop::Broken)?;
        for step in steps {
            let Put(key, len, byte) = *step else { continue };
            let value = vec![byte; len];
            let result = records.put(Key(key), &value);
            let failed = nor.borrow_mut().fired.take().is_some();
            let known = self.allowed.entry(key).or_insert_with(|| vec![vec![]]);
            self.has_kept |= result.is_ok();
            match result {
                Ok(()) => *known = vec![value],
                Err(_) => known.push(value),
            }
            if nor.borrow().is_off {
                return Err(Stop::PowerLoss);
            }
            if result.is_err() && !failed {
                return Err(Stop::Broken(format!("{step:?}: {result:?}")));
            }
            self.look(&records)
                .map_err(|broken| Stop::Broken(format!("{step:?}: {broken}")))?;
        }
        Ok(())
    }

    /// Each record has a value that it may have, and from now on no other.
    fn look(&mut self, records: &KeyValues<'_, Chip<WRITE, ERASE>>) -> Result<(), Broken> {
        match records.found() {
            Found::Table => {}
            Found::Nothing if !self.has_kept => {}
            found => return Err(format!("{found:?} where nothing was damaged")),
        }
        for (key, known) in &mut self.allowed {
            let value = records.get(Key(*key)).unwrap_or_default().to_vec();
            if !known.contains(&value) {
                return Err(format!("record {key} is {value:?}, and may be {known:?}"));
            }
            *known = vec![value];
        }
        Ok(())
    }

    /// Two worlds with the same number go on alike.
    fn fingerprint(&self) -> u64 {
        let mut hasher = DefaultHasher::new();
        self.nor.fingerprint(&mut hasher);
        (&self.allowed, self.has_kept).hash(&mut hasher);
        hasher.finish()
    }

    fn ends_well(&mut self) -> Result<(), Broken> {
        self.nor.cut = None;
        let steps = [
            Reboot,
            Reboot,
            Reboot,
            Put(1, 8, 91),
            Put(2, 4, 92),
            Reboot,
            Reboot,
            Put(1, 8, 93),
            Reboot,
        ];
        self.run(&steps, None).map(drop)
    }
}

/// Each operation of these steps is cut in each way, as a loss of power and as an error; and goes
/// on from there. What is known of the world before a session (`is_known`) is passed over, with all
/// that would come of it.
fn cut_each(
    start: &World,
    steps: &[Step],
    tears: usize,
    is_known: &mut dyn FnMut(usize, u64) -> bool,
    go_on: &mut dyn FnMut(World) -> Result<(), Broken>,
) -> Result<(), Broken> {
    let (mut start, mut steps) = (start.clone(), steps);
    loop {
        if is_known(steps.len(), start.fingerprint()) {
            return Ok(());
        }
        // What is before the session that is cut need not be done again.
        let end = steps.iter().position(|step| *step == Reboot);
        let session = &steps[..end.unwrap_or(steps.len())];
        let mut whole = start.clone();
        let first = whole.nor.operations;
        whole.nor.log.clear();
        whole.run(session, None)?;
        for (at, kind) in (first..).zip(whole.nor.log.clone()) {
            for tear in TEARS.iter().take(tears) {
                for is_loss in [true, false] {
                    let cut = Cut {
                        at,
                        kind,
                        tear: *tear,
                        is_loss,
                    };
                    let mut world = start.clone();
                    let within = |broken| format!("{broken}\n  {cut:?} in {steps:?}");
                    world.run(steps, Some(cut)).map_err(within)?;
                    go_on(world).map_err(within)?;
                }
            }
        }
        let Some(end) = end else {
            return go_on(whole);
        };
        (start, steps) = (whole, &steps[end + 1..]);
    }
}

/// All of it. One in so many of the worlds that a first cut leads to is cut again.
fn invariants(tears: usize, one_in: usize) -> Result<(), Broken> {
    tables_fill_up()?;
    let mut worlds = 0;
    for rewrite in [Rewrite::Refuse, Rewrite::Merge] {
        for history in HISTORIES {
            let (mut seen, mut seen_again) = (HashSet::new(), HashSet::new());
            let mut sessions = HashSet::new();
            let never = &mut |_, _| false;
            cut_each(
                &World::new(rewrite),
                history,
                tears,
                never,
                &mut |mut world| {
                    if !seen.insert(world.fingerprint()) {
                        return Ok(());
                    }
                    worlds += 1;
                    if worlds % one_in == 0 {
                        for (number, recovery) in RECOVERIES.iter().enumerate() {
                            let mut is_known =
                                |left, world| !sessions.insert((number, left, world));
                            let mut again = |mut world: World| {
                                if seen_again.insert(world.fingerprint()) {
                                    world.ends_well()?;
                                }
                                Ok(())
                            };
                            cut_each(&world, recovery, tears.min(3), &mut is_known, &mut again)?;
                        }
                    }
                    world.ends_well()
                },
            )?;
        }
    }
    Ok(())
}

/// Of one history, with this operation cut in each way, and each of what follows.
fn cut_twice(history: usize, at: usize) -> Result<(), Broken> {
    let start = World::new(Rewrite::Refuse);
    let steps = HISTORIES.get(history).copied().unwrap_or_default();
    let log = {
        let mut whole = start.clone();
        whole.run(steps, None)?;
        whole.nor.log
    };
    for tear in TEARS.iter().take(4) {
        let mut world = start.clone();
        let cut = Cut {
            at,
            kind: log[at],
            tear: *tear,
            is_loss: true,
        };
        world.run(steps, Some(cut))?;
        for recovery in RECOVERIES {
            let mut go_on = |mut world: World| world.ends_well();
            cut_each(&world, recovery, 3, &mut |_, _| false, &mut go_on)?;
        }
    }
    Ok(())
}

/// Bits that change by themselves, and readings that fail once, when a history has come to its end
/// and where it was cut.
fn bits_flip() -> Result<(), Broken> {
    for history in HISTORIES {
        for end in 1..=history.len() {
            let (before, last) = history[..end].split_at(end - 1);
            if last == [Reboot] {
                continue;
            }
            let mut start = World::new(Rewrite::Merge);
            start.run(before, None)?;
            let mut whole = start.clone();
            whole.run(last, None)?;
            let within = |broken| format!("{broken}\n  after {:?}", &history[..end]);
            is_not_lost(&whole, true).map_err(within)?;
            for at in start.nor.operations..whole.nor.operations {
                // Where it stopped between two operations, and in an erase.
                for (kind, tear, is_loss) in [
                    (Kind::Write, Tear::Whole, true),
                    (Kind::Erase, Tear::Whole, true),
                    (Kind::Erase, Tear::Some(77), true),
                    (Kind::Erase, Tear::Nothing, false),
                ] {
                    let cut = Cut {
                        at,
                        kind,
                        tear,
                        is_loss,
                    };
                    let mut world = start.clone();
                    world.run(last, Some(cut)).map_err(within)?;
                    if world.nor.cut.is_none() {
                        is_not_lost(&world, false)
                            .map_err(|broken| within(format!("{broken}\n  {cut:?}")))?;
                    }
                }
            }
        }
    }
    Ok(())
}

/// Whether what is known of the records stands, whatever bit changes and whatever reading fails. At
/// rest nothing is lost; after a cut it may be, and is known to be.
fn is_not_lost(world: &World, is_at_rest: bool) -> Result<(), Broken> {
    let opened = |act: &dyn Fn(&mut Nor)| {
        let mut nor = world.nor.clone();
        nor.cut = None;
        nor.power_on();
        act(&mut nor);
        let nor = Rc::new(RefCell::new(nor));
        let opened = World::opened(&nor)?;
        Ok::<_, Broken>((opened, nor))
    };
    let (due, nor) = opened(&|_| {})?;
    if due.found != Found::Table && world.has_kept {
        return Err(format!("{due:?}"));
    }
    let judge = |found: &Opened, nor: &Rc<RefCell<Nor>>, must_be_due: bool| {
        let is_known = |opened: &Opened| {
            (1..).zip(&opened.values).all(|(key, value)| {
                let none = vec![vec![]];
                world.allowed.get(&key).unwrap_or(&none).contains(value)
            })
        };
        let is_fine = match found.found {
            _ if is_at_rest => *found == due,
            Found::Damage => return true,
            Found::Table if must_be_due => *found == due,
            Found::Table | Found::Nothing => is_known(found),
        };
        nor.borrow_mut().power_on();
        let next = World::opened(nor);
        is_fine && next.is_ok_and(|next| next.values == found.values)
    };
    let reads = (world.nor.reads, nor.borrow().reads);
    // At rest each of them, else some.
    let stride = if is_at_rest { 1 } else { 11 };
    for number in (reads.0 + 1..=reads.1).step_by(stride) {
        let (found, nor) = opened(&|nor| nor.failing_read = Some(number))?;
        if !judge(&found, &nor, false) {
            return Err(format!(
                "reading {number} failed: {found:?}, due was {due:?}"
            ));
        }
    }
    // What was not confirmed yet may give way.
    let is_confirmed = [FlashBank::A, FlashBank::B].map(|slot| {
        let nor = Rc::new(RefCell::new(world.nor.clone()));
        nor.borrow_mut().power_on();
        let layout = Layout::new(0, AREA_BYTES as u32);
        Store::new(Chip::<WRITE, ERASE>(nor), layout)
            .is_ok_and(|mut store| store.head(slot).confirmed_rank().is_some())
    });
    let used = HEADER_BYTES as usize + 3 * BLOCK_BYTES;
    for at in (0..FLASH_BYTES).filter(|at| *at >= 2 * AREA_BYTES || at % AREA_BYTES < used) {
        let is_blank = world.nor.byte(at) == 0xFF;
        let is_of_table = at < 2 * AREA_BYTES && at % AREA_BYTES >= HEADER_BYTES as usize;
        let is_acknowledged = is_of_table && is_confirmed[at / AREA_BYTES];
        // One bit of a byte, not always the same.
        let bit = (at % 8) as u8;
        if at % (if is_blank { 8 } else { 1 } * stride) != 0 {
            continue;
        }
        let (found, nor) = opened(&|nor| nor.flip(at, bit))?;
        if !judge(&found, &nor, is_acknowledged) {
            return Err(format!(
                "bit {bit} of byte {at} flipped: {found:?}, due was {due:?}"
            ));
        }
    }
    Ok(())
}

/// What is too long, or too much, changes nothing.
fn tables_fill_up() -> Result<(), Broken> {
    let world = World::new(Rewrite::Refuse);
    let nor = Rc::new(RefCell::new(world.nor));
    let mut room = [0; ROOM];
    let chip = Chip::<WRITE, ERASE>(nor.clone());
    let layout = Layout::new(0, AREA_BYTES as u32);
    let mut records =
        KeyValues::open(chip, layout, &mut room).map_err(|error| format!("{error:?}"))?;
    let found = records.found();
    let cases: &[(u8, usize, Result<(), PutError>)] = &[
        (1, MAX_VALUE_BYTES + 1, Err(PutError::TooLong)),
        (1, MAX_VALUE_BYTES, Ok(())),
        (
            2,
            ROOM - MAX_VALUE_BYTES - 3,
            Err(PutError::Full { capacity: ROOM }),
        ),
        (2, ROOM - MAX_VALUE_BYTES - 4, Ok(())),
        (3, 1, Err(PutError::Full { capacity: ROOM })),
        (1, 10, Ok(())),
        (3, 50, Ok(())),
    ];
    for (key, len, expected) in cases {
        let before = records.get(Key(*key)).map(<[u8]>::to_vec);
        let put = records.put(Key(*key), &vec![*key; *len]);
        let after = records.get(Key(*key)).map(<[u8]>::to_vec);
        let due = if put.is_ok() {
            Some(vec![*key; *len])
        } else {
            before
        };
        if put != *expected || after != due {
            return Err(format!("{len} bytes under {key}: {put:?}, then {after:?}"));
        }
    }
    let same = (
        nor.borrow().writes,
        records.put(Key(3), &[3; 50]),
        nor.borrow().writes,
    );
    if same.0 != same.2 || (found, records.found()) != (Found::Nothing, Found::Table) {
        return Err(format!("nothing changed: {same:?}; {found:?}"));
    }
    Ok(())
}

#[test]
fn records_survive_losses_of_power() {
    // With each mutant, fewer.
    let one_in = if std::env::var_os("ESM_FEW_CUTS").is_some() {
        500
    } else {
        32
    };
    if let Err(broken) = invariants(4, one_in) {
        panic!("{broken}");
    }
}

#[test]
#[ignore = "a minute with --release"]
fn records_survive_two_losses_of_power_at_any_two_moments() {
    if let Err(broken) = invariants(TEARS.len(), 1) {
        panic!("{broken}");
    }
}

#[test]
fn records_survive_bits_that_flip_and_readings_that_fail() {
    if let Err(broken) = bits_flip() {
        panic!("{broken}");
    }
}

/// Where a second cut finds what a first one does not: a mutant has shown it.
#[test]
fn records_survive_a_second_cut_where_it_tells_the_most() {
    if let Err(broken) = cut_twice(0, 14) {
        panic!("{broken}");
    }
}
