//! What a robot does whose records are damaged, and one whose flash came with anything in it.

use std::vec::Vec;

use super::flash_store::{RECORD_BYTES, bank_bytes};
use super::kept_flash::{BLOB_BYTES, ERASE, blank, with_store};
use super::key_values::{Found, Key, PutError};
use super::layout::HEADER_BYTES;
use super::nor::Rewrite;
use crate::mission_store::MissionStore;
use crate::realtime::params::SavedParams;
use esm_link::key_store::{KeyStore, NotStored, STORED_KEY_BYTES, StoredKey};
use esm_link::message::{KeyValuesState, LinkError, WayIn};

#[test]
fn a_robot_whose_records_are_damaged_is_stopped_and_keeps_them_as_they_are() {
    let flash = blank(Rewrite::Merge);
    with_store(&flash, None, |keep| {
        keep.records()
            .write_of_key(StoredKey::Key, &[7; STORED_KEY_BYTES])
            .unwrap();
        assert!(!keep.is_emergency_stopped());
    });
    let area = bank_bytes(RECORD_BYTES as u32, ERASE as u32);
    let first = 2 * bank_bytes(BLOB_BYTES, ERASE as u32) + HEADER_BYTES + 5;
    flash.borrow_mut().flip(first as usize, 0);
    flash.borrow_mut().flip((first + area) as usize, 1);
    let erases = flash.borrow().erases;
    let writes = flash.borrow().writes;
    with_store(&flash, None, |keep| {
        assert_eq!(keep.records().found(), Found::Damage);
        assert!(keep.is_emergency_stopped(), "it is not known whether it is");
        for record in [StoredKey::Key, StoredKey::Counter, StoredKey::Starts] {
            let read = keep.records().read_of_key(record, &mut [0; 64]);
            assert_eq!(read, Err(NotStored), "{record:?}");
            let written = keep.records().write_of_key(record, &[1]);
            assert_eq!(written, Err(NotStored), "{record:?}");
        }
        for latched in [true, false] {
            let set = keep.set_emergency_stop(latched);
            assert_eq!(set, Err(LinkError::StopNotStored));
        }
        let saved = keep.save_params(&SavedParams::NONE);
        assert_eq!(saved, Err(LinkError::FlashRefused));
        assert_eq!(keep.wait_for_host(), Err(PutError::Damaged));
    });
    let after = (flash.borrow().erases, flash.borrow().writes);
    assert_eq!(after, (erases, writes), "nothing was touched");
}

#[test]
fn a_flash_that_comes_with_anything_in_it_is_to_be_erased_first() {
    let noise: Vec<u8> = (0..10_240_u32)
        .map(|at| (at.wrapping_mul(2_654_435_761) >> 13) as u8)
        .collect();
    let fills = [0, 1, 0x5A, 0x69, 0x96, 0xC3, 0xFE];
    let flashes = fills.iter().map(|byte| {
        let flash = blank(Rewrite::Merge);
        flash.borrow_mut().fill(*byte);
        flash
    });
    let noisy = blank(Rewrite::Merge);
    noisy.borrow_mut().put(0, &noise);
    // The journal alone was erased, or the areas alone.
    let areas = blank(Rewrite::Merge);
    areas.borrow_mut().put(0, &noise[..8192]);
    let journal = blank(Rewrite::Merge);
    journal.borrow_mut().put(8192, &noise[8192..]);
    for flash in flashes.chain([noisy, areas, journal]) {
        with_store(&flash, None, |keep| {
            assert_eq!(keep.records().found(), Found::Damage);
            let state = keep.flash_health().records;
            assert_eq!(state, KeyValuesState::Unreadable(WayIn::Erase));
            assert!(keep.is_emergency_stopped());
            for room in [&mut [0; 64][..], &mut []] {
                let key = keep.read(StoredKey::Key, room);
                assert_eq!(key, Err(NotStored));
                assert_eq!(keep.remembered_key(room), Err(NotStored));
            }
            assert_eq!(
                keep.records().put(Key(1), &[7; STORED_KEY_BYTES]),
                Err(PutError::Damaged)
            );
        });
    }
    let erased = blank(Rewrite::Merge);
    with_store(&erased, None, |keep| {
        assert_eq!(keep.flash_health().records, KeyValuesState::New);
        assert!(!keep.is_emergency_stopped());
        assert_eq!(keep.read(StoredKey::Key, &mut [0; 64]), Ok(0));
        keep.records().put(Key(1), &[7; STORED_KEY_BYTES]).unwrap();
    });
    with_store(&erased, None, |keep| {
        assert_eq!(keep.records().get(Key(1)), Some(&[7; STORED_KEY_BYTES][..]));
    });
}
