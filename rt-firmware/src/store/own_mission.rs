//! When the mission that is compiled into a firmware runs.

use std::cell::RefCell;
use std::rc::Rc;
use std::vec::Vec;

use super::flash_store::{FlashStore, flash_bytes};
use super::kept_flash::{self, BLOB_BYTES, ERASE, Flash, WRITE};
use super::nor::{Chip, Cut, Kind, Rewrite, Tear};
use crate::mission_store::{MissionStore, Start};
use esm_link::message::{BankState, LinkError, Source};

const OWN: &[u8] = b"the firmware's own";

fn blank() -> Flash {
    kept_flash::blank(Rewrite::Refuse)
}

/// Switches on, does this, and switches off.
fn with_store<T>(
    flash: &Flash,
    act: impl FnOnce(&mut FlashStore<'_, Chip<WRITE, ERASE>>) -> T,
) -> T {
    kept_flash::with_store(flash, Some(OWN), act)
}

/// What a robot starts with that refuses these missions, and where it says that it is.
fn started(flash: &Flash, refused: &[&[u8]]) -> (Option<Vec<u8>>, Source) {
    with_store(flash, |keep| {
        let mut room = [0; BLOB_BYTES as usize];
        let start = FlashStore::choose(keep, &mut room, |blob| !refused.contains(&blob));
        let mission = match start {
            Start::Mission { len, on_trial } => {
                assert!(!on_trial);
                Some(room[..len].to_vec())
            }
            Start::Nothing => None,
        };
        (mission, keep.kept().runs)
    })
}

/// A flash with two confirmed missions, `first` and then `second`.
fn with_two() -> Flash {
    let flash = blank();
    for mission in [&b"first"[..], b"second"] {
        with_store(&flash, |keep| {
            let mut room = [0; BLOB_BYTES as usize];
            FlashStore::choose(keep, &mut room, |_| true);
            keep.begin_trial(mission).unwrap();
            keep.confirm().unwrap();
        });
    }
    flash
}

#[test]
fn the_firmwares_own_mission_runs_where_none_of_the_flashs_may() {
    let own = (Some(OWN.to_vec()), Source::Firmware);
    assert_eq!(started(&blank(), &[]), own, "a blank flash");
    let two = with_two();
    let second = (Some(b"second".to_vec()), Source::B);
    assert_eq!(started(&two, &[]), second);
    let first = (Some(b"first".to_vec()), Source::A);
    assert_eq!(started(&two, &[b"second"]), first);
    assert_eq!(started(&two, &[b"first", b"second"]), own, "both refused");
    // It is judged as any other.
    let nothing = (None, Source::Nothing);
    assert_eq!(started(&two, &[b"first", b"second", OWN]), nothing);
    assert_eq!(started(&blank(), &[OWN]), nothing);
}

#[test]
fn a_mission_that_fails_its_trial_over_the_firmwares_own_gives_way_to_it() {
    let flash = blank();
    with_store(&flash, |keep| {
        let mut room = [0; BLOB_BYTES as usize];
        FlashStore::choose(keep, &mut room, |_| true);
        keep.begin_trial(b"first").unwrap();
        assert_eq!(keep.kept().runs, Source::A);
        assert!(keep.fall_back());
        assert_eq!(keep.kept().runs, Source::Firmware);
        assert_eq!(keep.kept().slots[0], BankState::TrialFailed);
    });
    // Where it was not the one before, it is not the one after.
    with_store(&flash, |keep| {
        let mut room = [0; BLOB_BYTES as usize];
        FlashStore::choose(keep, &mut room, |_| false);
        keep.begin_trial(b"second").unwrap();
        assert!(keep.fall_back());
        assert_eq!(keep.kept().runs, Source::Nothing);
    });
}

#[test]
fn a_mission_whose_confirmation_the_flash_refused_is_in_the_way_of_no_other() {
    let flash = blank();
    with_store(&flash, |keep| {
        let mut room = [0; BLOB_BYTES as usize];
        FlashStore::choose(keep, &mut room, |_| true);
        keep.trial_begins(b"first").unwrap();
        flash.borrow_mut().is_off = true;
        assert_eq!(keep.trial_confirmed(1), Err(LinkError::FlashRefused));
        assert_eq!(keep.trial_begins(b"second"), Err(LinkError::FlashRefused));
        flash.borrow_mut().is_off = false;
        assert_eq!(keep.trial_begins(b"second"), Ok(()));
        assert_eq!(keep.kept().slots, [BankState::Spare, BankState::OnTrial]);
        // One that was given up is not confirmed in passing.
        assert!(!keep.trial_failed(2));
        assert_eq!(keep.trial_begins(b"third"), Ok(()));
        assert!(!keep.trial_failed(3));
    });
    assert_eq!(started(&flash, &[]).0, Some(b"first".to_vec()));
}

#[test]
fn an_upload_where_nothing_runs_leaves_the_confirmed_mission_that_is_whole() {
    for damaged in [&b"first"[..], b"second"] {
        let flash = with_two();
        let whole = if damaged == b"first" {
            &b"second"[..]
        } else {
            b"first"
        };
        let place = (0..flash_bytes(BLOB_BYTES, ERASE as u32) as usize).find(|at| {
            (damaged.iter().enumerate())
                .all(|(place, byte)| flash.borrow().byte(at + place) == *byte)
        });
        flash.borrow_mut().flip(place.unwrap(), 0);
        with_store(&flash, |keep| {
            let mut room = [0; BLOB_BYTES as usize];
            FlashStore::choose(keep, &mut room, |_| false);
            keep.trial_begins(b"third").unwrap();
            assert!(!keep.trial_failed(3));
        });
        assert_eq!(started(&flash, &[]).0, Some(whole.to_vec()));
    }
}

#[test]
fn a_mission_that_failed_on_trial_since_the_start_is_not_confirmed_in_passing() {
    let flash = with_two();
    let uploaded = |flash: &Flash, cut| {
        with_store(flash, |keep| {
            let mut room = [0; BLOB_BYTES as usize];
            FlashStore::choose(keep, &mut room, |_| true);
            flash.borrow_mut().cut = cut;
            keep.trial_begins(b"third").is_ok()
        })
    };
    let whole = Rc::new(RefCell::new(flash.borrow().clone()));
    assert!(uploaded(&whole, None));
    // Power is lost before its trial begins.
    let cut = Cut {
        at: whole.borrow().operations - 1,
        kind: Kind::Write,
        tear: Tear::Nothing,
        is_loss: true,
    };
    assert!(!uploaded(&flash, Some(cut)));
    with_store(&flash, |keep| {
        let mut room = [0; BLOB_BYTES as usize];
        let start = FlashStore::choose(keep, &mut room, |_| true);
        assert!(matches!(start, Start::Mission { on_trial: true, .. }));
        assert!(keep.trial_failed(3), "another one is to be chosen");
        assert_eq!(keep.trial_begins(b"fourth"), Err(LinkError::OnTrial));
    });
    assert_eq!(started(&flash, &[]).0, Some(b"second".to_vec()));
}

#[test]
fn a_robot_that_is_to_wait_for_a_host_does_not_start_with_the_firmwares_own() {
    let flash = blank();
    with_store(&flash, |keep| keep.wait_for_host()).unwrap();
    assert_eq!(started(&flash, &[]), (None, Source::Nothing));
    let two = with_two();
    with_store(&two, |keep| keep.wait_for_host()).unwrap();
    assert_eq!(started(&two, &[]).1, Source::B, "a host has brought one");
}
