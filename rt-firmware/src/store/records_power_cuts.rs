//! What records promise, held against a flash that loses power in every operation of several histories, and again while it recovers.
//!
//! The laws: a record that was acknowledged is there; one whose writing was cut has its old or its new value, and from the next start on always the same;
//! whatever happened, the next record can be kept.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::format;
use std::rc::Rc;
use std::string::String;
use std::vec;
use std::vec::Vec;

use super::layout::Layout;
use super::nor::{Chip, Cut, Flicker, Geometry, Kind, Nor, Rewrite, Tear};
use super::records::{Found, Key, MAX_VALUE_BYTES, PutError, Records};

type Broken = String;

const WRITE: usize = 8;
const ERASE: usize = 1024;
const AREA_BYTES: usize = 2 * ERASE;
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

const TEARS: &[Tear] = &[
    Tear::Weak(Flicker::NewOld),
    Tear::Weak(Flicker::OldNew),
    Tear::Weak(Flicker::NewNewOld),
    Tear::Weak(Flicker::OldNewNew),
    Tear::Nothing,
    Tear::Whole,
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
}

/// Power was lost; or a law was broken.
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
            nor: Nor::new(geometry, 2 * AREA_BYTES),
            allowed: Allowed::new(),
        }
    }

    /// Switches on and does these steps. Returns whether power was on to the end; then it is switched off.
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
        let opened = Records::open(chip, layout, &mut room);
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
    fn look(&mut self, records: &Records<'_, Chip<WRITE, ERASE>>) -> Result<(), Broken> {
        for (key, known) in &mut self.allowed {
            let value = records.get(Key(*key)).unwrap_or_default().to_vec();
            if !known.contains(&value) {
                return Err(format!("record {key} is {value:?}, and may be {known:?}"));
            }
            *known = vec![value];
        }
        Ok(())
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

/// Each operation of these steps is cut in each way, as a loss of power and as an error; and goes on from there.
fn cut_each(
    start: &World,
    steps: &[Step],
    tears: usize,
    go_on: &mut dyn FnMut(World) -> Result<(), Broken>,
) -> Result<(), Broken> {
    let mut whole = start.clone();
    let first = whole.nor.operations;
    whole.run(steps, None)?;
    for at in first..whole.nor.operations {
        for tear in TEARS.iter().take(tears) {
            for kind in [Kind::Write, Kind::Erase] {
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
                    if world.nor.cut.is_none() {
                        go_on(world).map_err(within)?;
                    }
                }
            }
        }
    }
    go_on(whole)
}

/// All of it. One in so many of the worlds that a first cut leads to is cut again.
pub(super) fn laws(tears: usize, one_in: usize) -> Result<(), Broken> {
    tables_fill_up()?;
    let mut worlds = 0;
    for rewrite in [Rewrite::Refuse, Rewrite::Merge] {
        for history in HISTORIES {
            cut_each(&World::new(rewrite), history, tears, &mut |mut world| {
                worlds += 1;
                if worlds % one_in == 0 {
                    for recovery in RECOVERIES {
                        let again = |mut world: World| world.ends_well();
                        cut_each(&world, recovery, tears.min(3), &mut { again })?;
                    }
                }
                world.ends_well()
            })?;
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
        Records::open(chip, layout, &mut room).map_err(|error| format!("{error:?}"))?;
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
    if let Err(broken) = laws(3, 211) {
        panic!("{broken}");
    }
}

#[test]
#[ignore = "minutes with --release"]
fn records_survive_two_losses_of_power_at_any_two_moments() {
    if let Err(broken) = laws(TEARS.len(), 1) {
        panic!("{broken}");
    }
}
