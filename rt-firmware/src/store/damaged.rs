//! What a robot does whose records are damaged, and one whose flash came with anything in it.

use std::cell::RefCell;
use std::rc::Rc;
use std::vec::Vec;

use super::keep::{Keep, RECORD_BYTES, flash_bytes, slot_bytes};
use super::layout::HEAD_BYTES;
use super::nor::{Chip, Geometry, Nor, Rewrite};
use super::records::{Found, Key, PutError};
use crate::link::key_safe::{KeyRecord, NotKept};
use crate::link::message::LinkError;
use crate::link::trial::MissionKeeper;
use crate::realtime::params::SavedParams;

const WRITE: usize = 8;
const ERASE: usize = 1024;
const BLOB_BYTES: u32 = 512;

type Flash = Rc<RefCell<Nor>>;

fn blank() -> Flash {
    let geometry = Geometry {
        write: WRITE,
        rewrite: Rewrite::Merge,
    };
    let bytes = flash_bytes(BLOB_BYTES, ERASE as u32) as usize;
    Rc::new(RefCell::new(Nor::new(geometry, bytes)))
}

/// Switches on, does this, and switches off.
fn with_keep<T>(flash: &Flash, act: impl FnOnce(&mut Keep<'_, Chip<WRITE, ERASE>>) -> T) -> T {
    flash.borrow_mut().power_on();
    let mut room = [0; RECORD_BYTES];
    let chip = Chip::<WRITE, ERASE>(flash.clone());
    let mut keep = Keep::open(chip, BLOB_BYTES, None, &mut room).unwrap();
    act(&mut keep)
}

#[test]
fn a_robot_whose_records_are_damaged_is_stopped_and_keeps_them_as_they_are() {
    let flash = blank();
    with_keep(&flash, |keep| {
        keep.records()
            .write_of_key(KeyRecord::Key, &[7; 48])
            .unwrap();
        assert!(!keep.is_emergency_stopped());
    });
    let area = slot_bytes(RECORD_BYTES as u32, ERASE as u32);
    let first = 2 * slot_bytes(BLOB_BYTES, ERASE as u32) + HEAD_BYTES + 5;
    flash.borrow_mut().flip(first as usize, 0);
    flash.borrow_mut().flip((first + area) as usize, 1);
    let erases = flash.borrow().erases;
    let writes = flash.borrow().writes;
    with_keep(&flash, |keep| {
        assert_eq!(keep.records().found(), Found::Damage);
        assert!(keep.is_emergency_stopped(), "it is not known whether it is");
        for record in [KeyRecord::Key, KeyRecord::Counter, KeyRecord::Starts] {
            let read = keep.records().read_of_key(record, &mut [0; 64]);
            assert_eq!(read, Err(NotKept), "{record:?}");
            let written = keep.records().write_of_key(record, &[1]);
            assert_eq!(written, Err(NotKept), "{record:?}");
        }
        for latched in [true, false] {
            let set = keep.set_emergency_stop(latched);
            assert_eq!(set, Err(LinkError::StopNotKept));
        }
        let saved = keep.save_params(&SavedParams::NONE);
        assert_eq!(saved, Err(LinkError::FlashRefused));
        assert_eq!(keep.wait_for_host(), Err(PutError::Damaged));
    });
    let after = (flash.borrow().erases, flash.borrow().writes);
    assert_eq!(after, (erases, writes), "nothing was touched");
}

#[test]
fn a_flash_that_comes_with_anything_in_it_is_one_without_records() {
    let noise: Vec<u8> = (0..4096_u32)
        .map(|at| (at.wrapping_mul(2_654_435_761) >> 13) as u8)
        .collect();
    let fills = [0, 1, 0x5A, 0x69, 0x96, 0xC3, 0xFE];
    let flashes = fills.iter().map(|byte| {
        let flash = blank();
        flash.borrow_mut().fill(*byte);
        flash
    });
    let noisy = blank();
    noisy.borrow_mut().put(0, &noise);
    for flash in flashes.chain([noisy]) {
        with_keep(&flash, |keep| {
            assert_eq!(keep.records().found(), Found::Nothing);
            assert!(!keep.is_emergency_stopped());
            let key = keep.records().read_of_key(KeyRecord::Key, &mut [0; 64]);
            assert_eq!(key, Ok(0));
            keep.records().put(Key(1), &[7; 48]).unwrap();
        });
        with_keep(&flash, |keep| {
            assert_eq!(keep.records().get(Key(1)), Some(&[7; 48][..]));
        });
    }
}
