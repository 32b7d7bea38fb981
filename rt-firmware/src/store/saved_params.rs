//! What is promised of saved parameters, held against a flash that loses power, or refuses, in
//! every operation of a save.

use std::cell::RefCell;
use std::rc::Rc;
use std::vec::Vec;

use super::kept_flash::{blank, with_store};
use super::nor::{Cut, Kind, Rewrite, Tear};
use crate::mission_store::MissionStore;
use crate::realtime::params::SavedParams;
use esm_link::message::LinkError;

fn saved(mission: u32, values: &[(u16, u32)]) -> SavedParams {
    let mut bytes: Vec<u8> = mission.to_le_bytes().into();
    for (param, value) in values {
        bytes.extend(param.to_le_bytes());
        bytes.extend(value.to_le_bytes());
    }
    SavedParams::from_bytes(&bytes)
}

#[test]
fn a_save_that_is_cut_leaves_what_was_saved_before_or_what_was_to_be() {
    let full: Vec<_> = (0..8)
        .map(|param| (param * 300, u32::MAX - u32::from(param)))
        .collect();
    let histories = [
        (SavedParams::NONE, saved(7, &[(3, 5)])),
        (saved(7, &[(3, 5)]), saved(0xFFFF_0000, &full)),
        (saved(7, &full), SavedParams::NONE),
    ];
    let mut seen = Vec::new();
    for (before, after) in histories {
        let start = blank(Rewrite::Refuse);
        with_store(&start, None, |keep| keep.save_params(&before)).unwrap();
        with_store(&start, None, |keep| assert_eq!(keep.saved_params(), before));
        let first = start.borrow().operations;
        let whole = Rc::new(RefCell::new(start.borrow().clone()));
        with_store(&whole, None, |keep| keep.save_params(&after)).unwrap();
        with_store(&whole, None, |keep| assert_eq!(keep.saved_params(), after));
        let last = whole.borrow().operations;
        assert!(last > first);
        for at in first..last {
            for kind in [Kind::Write, Kind::Erase] {
                for (tear, is_loss) in [
                    (Tear::Nothing, true),
                    (Tear::Whole, true),
                    (Tear::Some(77), true),
                    (Tear::Nothing, false),
                ] {
                    let nor = Rc::new(RefCell::new(start.borrow().clone()));
                    let answer = with_store(&nor, None, |keep| {
                        nor.borrow_mut().cut = Some(Cut {
                            at,
                            kind,
                            tear,
                            is_loss,
                        });
                        keep.save_params(&after)
                    });
                    let is_cut = nor.borrow().fired.is_some();
                    let found = with_store(&nor, None, |keep| keep.saved_params());
                    let what = (at, kind, tear, is_loss);
                    match answer {
                        Ok(()) => assert_eq!(found, after, "{what:?}"),
                        Err(error) => {
                            assert_eq!(error, LinkError::FlashRefused);
                            assert!(is_cut, "{what:?}");
                            assert!([before, after].contains(&found), "{what:?}: {found:?}");
                            seen.push(found == after);
                        }
                    }
                    let again = with_store(&nor, None, |keep| keep.saved_params());
                    assert_eq!(again, found, "{what:?}: it stays so");
                }
            }
        }
    }
    assert!(
        seen.contains(&true) && seen.contains(&false),
        "both outcomes are met"
    );
}
