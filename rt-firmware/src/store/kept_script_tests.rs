//! What is promised of a script that is kept, held against a flash that loses power, or refuses, in
//! every operation of a history, and again in every operation of what follows.

use std::cell::RefCell;
use std::format;
use std::rc::Rc;
use std::string::String;
use std::vec;
use std::vec::Vec;

use super::kept_script::KeptScript;
use super::layout::Layout;
use super::nor::{Chip, Cut, Flicker, Geometry, Nor, Rewrite, Tear};
use super::script_bytes::SCRIPT_BYTES;

const WRITE: usize = 8;
const ERASE: usize = 1024;
const AREA_BYTES: usize = 2 * ERASE;

/// What is done to the script.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// Off and on.
    Reboot,
    /// Keeps one of this length, its bytes all alike.
    Keep(usize, u8),
    Remove,
}
use Step::{Keep, Reboot, Remove};

const HISTORY: &[Step] = &[
    Keep(72, 1),
    Keep(132, 2),
    Reboot,
    Keep(72, 3),
    Remove,
    Reboot,
    Keep(192, 4),
    Keep(72, 5),
];
const RECOVERY: &[Step] = &[Reboot, Keep(72, 21), Reboot, Keep(132, 22)];
const AFTERWARDS: &[Step] = &[Reboot, Reboot, Keep(72, 91), Reboot, Remove, Keep(72, 92)];

/// What a cut makes of an operation.
const TEARS: &[Tear] = &[
    Tear::Nothing,
    Tear::Weak(Flicker::NewOld),
    Tear::FirstHalf,
    Tear::Whole,
    Tear::Weak(Flicker::OldNew),
    Tear::Weak(Flicker::NewNewOld),
    Tear::Unreadable,
    Tear::Some(77),
    Tear::SomeWeak(99, Flicker::OldNew),
    Tear::Garbage(5),
];
/// So many of them, from the first on, are tried in what follows a cut.
const TEARS_AFTER_A_CUT: usize = 3;
/// Each so many-th operation of what follows is cut as well.
const ONE_IN: usize = 13;

#[derive(Clone)]
struct World {
    nor: Nor,
    /// What may be kept; empty is none.
    allowed: Vec<Vec<u8>>,
}

impl World {
    fn new(rewrite: Rewrite) -> Self {
        let geometry = Geometry {
            write: WRITE,
            rewrite,
        };
        Self {
            nor: Nor::new(geometry, 2 * AREA_BYTES),
            allowed: vec![vec![]],
        }
    }

    /// Does these steps, the cut in one of their operations, and switches off.
    fn run(&mut self, steps: &[Step], cut: Option<Cut>) -> Result<(), String> {
        let nor = Rc::new(RefCell::new(self.nor.clone()));
        let mut pending = cut;
        let mut ended = Ok(());
        for session in steps.split(|step| *step == Reboot) {
            nor.borrow_mut().power_on();
            nor.borrow_mut().cut = pending;
            ended = self.session(&nor, session);
            pending = nor.borrow().cut;
            if ended.is_err() || nor.borrow().is_off {
                break;
            }
        }
        let mut after = nor.borrow().clone();
        let breach = after.breach.take();
        after.power_on();
        self.nor = after;
        match breach {
            Some(rule) => Err(rule),
            None => ended,
        }
    }

    fn session(&mut self, nor: &Rc<RefCell<Nor>>, steps: &[Step]) -> Result<(), String> {
        let chip = Chip::<WRITE, ERASE>(nor.clone());
        let layout = Layout::new(0, AREA_BYTES as u32);
        let mut kept = KeptScript::open(chip, layout).map_err(|error| format!("{error:?}"))?;
        self.look(nor, &mut kept)?;
        for step in steps {
            if nor.borrow().is_off {
                return Ok(());
            }
            let script = match *step {
                Keep(len, byte) => vec![byte; len],
                Remove | Reboot => vec![],
            };
            let result = kept.keep(Some(&script[..]).filter(|script| !script.is_empty()));
            let has_failed = nor.borrow_mut().fired.take().is_some();
            match result {
                Ok(()) => self.allowed = vec![script],
                Err(()) => self.allowed.push(script),
            }
            if result.is_err() && !has_failed && !nor.borrow().is_off {
                return Err(format!("{step:?} was refused"));
            }
            if nor.borrow().is_off {
                return Ok(());
            }
        }
        Ok(())
    }

    /// What a start finds may be there: what was acknowledged last, or, until the next is, one
    /// whose writing was cut since.
    fn look(
        &self,
        nor: &Rc<RefCell<Nor>>,
        kept: &mut KeptScript<Chip<WRITE, ERASE>>,
    ) -> Result<(), String> {
        let mut room = [0xEE; SCRIPT_BYTES];
        let len = kept.read(&mut room);
        let has_failed = nor.borrow_mut().fired.take().is_some();
        if nor.borrow().is_off || has_failed {
            return Ok(());
        }
        let found = room[..len].to_vec();
        if !self.allowed.contains(&found) {
            return Err(format!("{found:?} is kept, and may be {:?}", self.allowed));
        }
        Ok(())
    }
}

/// Each so many-th operation of these steps is cut, in so many ways, as a loss of power and as an
/// error; and goes on from there.
fn cut_each(
    start: &World,
    steps: &[Step],
    tears: usize,
    one_in: usize,
    go_on: &mut dyn FnMut(World) -> Result<(), String>,
) -> Result<(), String> {
    let mut whole = start.clone();
    let first = whole.nor.operations;
    whole.nor.log.clear();
    whole.run(steps, None)?;
    for (at, kind) in (first..).zip(whole.nor.log.clone()).step_by(one_in) {
        for tear in TEARS.iter().take(tears) {
            for is_loss in [true, false] {
                let cut = Cut {
                    at,
                    kind,
                    tear: *tear,
                    is_loss,
                };
                let within = |broken| format!("{broken}\n  {cut:?} in {steps:?}");
                let mut world = start.clone();
                world.run(steps, Some(cut)).map_err(within)?;
                go_on(world).map_err(within)?;
            }
        }
    }
    Ok(())
}

#[test]
fn what_was_acknowledged_is_kept_whenever_power_is_lost_and_lost_again() {
    for rewrite in [Rewrite::Refuse, Rewrite::Merge] {
        let cut_again = &mut |world: World| {
            let mut ends_well = |mut world: World| world.run(AFTERWARDS, None);
            ends_well(world.clone())?;
            cut_each(&world, RECOVERY, TEARS_AFTER_A_CUT, ONE_IN, &mut ends_well)
        };
        let all = TEARS.len();
        cut_each(&World::new(rewrite), HISTORY, all, 1, cut_again).unwrap();
    }
}

#[test]
fn a_flash_that_was_never_written_has_none() {
    let mut world = World::new(Rewrite::Refuse);
    world.run(&[Remove, Reboot, Reboot], None).unwrap();
    assert_eq!(world.allowed, [vec![]]);
}
