//! What both programs have whose difference is the interpreter: a blob that the compiler knows
//! nothing of, and the compiler's own functions that any firmware has (copy, clear, fill, compare).
//! Each would be in a firmware without the interpreter, so it must neither count for the
//! interpreter where that calls it, nor be taken off where it does not.

use core::hint::black_box;

use lm3s6965::settings::BLOB_BYTES;

static BLOB: [u8; BLOB_BYTES] = [0; BLOB_BYTES];

/// The blob, after a call of each of those functions.
#[inline(never)]
pub fn blob() -> &'static [u8] {
    let blob: &[u8] = black_box(&BLOB);
    let mut copy = [0; 64];
    let length = black_box(copy.len());
    if let (Some(to), Some(from)) = (copy.get_mut(..length), blob.get(..length)) {
        to.copy_from_slice(from);
        black_box(*to == *from);
        to.fill(black_box(0));
    }
    black_box(copy);
    let mut words = [black_box(0_u64); 64];
    black_box(&mut words);
    let copied = words;
    black_box(&copied);
    words.fill(0);
    black_box(&words);
    blob
}
