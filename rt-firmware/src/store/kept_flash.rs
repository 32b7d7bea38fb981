//! A small flash that a [`FlashStore`] keeps things in, for tests of what it promises from one
//! power-on to the next.

use std::cell::RefCell;
use std::rc::Rc;

use super::flash_store::{FlashStore, RECORD_BYTES, flash_bytes};
use super::nor::{Chip, Geometry, Nor, Rewrite};
use crate::retained_ram::RetainedRam;

pub(super) const WRITE: usize = 8;
pub(super) const ERASE: usize = 1024;
pub(super) const BLOB_BYTES: u32 = 512;

pub(super) type Flash = Rc<RefCell<Nor>>;

pub(super) fn blank(rewrite: Rewrite) -> Flash {
    let geometry = Geometry {
        write: WRITE,
        rewrite,
    };
    let bytes = flash_bytes(BLOB_BYTES, ERASE as u32) as usize;
    Rc::new(RefCell::new(Nor::new(geometry, bytes)))
}

/// Switches a robot on whose firmware has this mission, does this, and switches off.
pub(super) fn with_store<T>(
    flash: &Flash,
    own: Option<&'static [u8]>,
    act: impl FnOnce(&mut FlashStore<'_, Chip<WRITE, ERASE>>) -> T,
) -> T {
    with_keep_over_resets(flash, own, None, act)
}

/// The same for a robot with retained RAM.
pub(super) fn with_keep_over_resets<T>(
    flash: &Flash,
    own: Option<&'static [u8]>,
    retained: Option<&RetainedRam>,
    act: impl FnOnce(&mut FlashStore<'_, Chip<WRITE, ERASE>>) -> T,
) -> T {
    flash.borrow_mut().power_on();
    let mut room = [0; RECORD_BYTES];
    let chip = Chip::<WRITE, ERASE>(flash.clone());
    let mut keep = FlashStore::open(chip, BLOB_BYTES, own, &mut room).unwrap();
    if let Some(retained) = retained {
        keep = keep.over_resets(retained);
    }
    act(&mut keep)
}
