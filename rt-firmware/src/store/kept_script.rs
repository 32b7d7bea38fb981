//! A script that a robot keeps beside its missions.
//!
//! It stands in two areas of the flash behind all else, which are slots as those of
//! missions are: the one that counts is not touched while the other is written, tried and
//! confirmed, one right behind the other. So a script that was acknowledged is there after any loss
//! of power. One whose writing was cut is there whole, or the one before is: which of the two may
//! differ from start to start, until the next one is kept.

use embedded_storage::nor_flash::NorFlash;

use super::{Choice, Layout, LayoutError, Store};
/// What stands there where there is none: no mission is empty, and neither is a script.
const NONE: [u8; 1] = [0];
/// How often what cannot be confirmed is looked at.
const LOOKS: u32 = 3;

/// The script that is kept.
pub(super) struct KeptScript<F> {
    store: Store<F>,
}

impl<F: NorFlash> KeptScript<F> {
    /// That of the areas in this layout.
    ///
    /// # Errors
    /// They do not fit the flash.
    pub(super) fn open(flash: F, layout: Layout) -> Result<Self, LayoutError> {
        let mut store = Store::new(flash, layout)?;
        // What counts is known before anything is written.
        let _ = store.choose(&mut [], |_| false);
        Ok(Self { store })
    }

    /// Reads it into the beginning of `room`. 0 where there is none.
    pub(super) fn read(&mut self, room: &mut [u8]) -> usize {
        for _ in 0..LOOKS {
            let Choice { mission, .. } = self.store.choose(room, |_| true);
            let Some(found) = mission else {
                return 0;
            };
            // What was never confirmed, or by a word that may have been cut, is so from now on.
            let is_tried = !found.on_trial || self.store.begin_trial().is_ok();
            if is_tried && self.store.confirm().is_ok() {
                let len = found.len as usize;
                return if len == NONE.len() { 0 } else { len };
            }
        }
        0
    }

    /// Keeps these bytes in the place of those before, `None` for none.
    pub(super) fn keep(&mut self, script: Option<&[u8]>) -> Result<(), ()> {
        let written = self.write(script.unwrap_or(&NONE));
        if written.is_none() {
            self.store.abort();
            // So that the next one can go the same way.
            self.store.fall_back();
        }
        written.ok_or(())
    }

    fn write(&mut self, bytes: &[u8]) -> Option<()> {
        let crc = esm_core::format::crc32(bytes);
        self.store.begin(bytes.len() as u32, crc).ok()?;
        self.store.append(0, bytes).ok()?;
        self.store.finish().ok()?;
        self.store.begin_trial().ok()?;
        self.store.confirm().ok()
    }
}
