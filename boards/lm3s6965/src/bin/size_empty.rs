//! What the interpreter's size is measured against: a program with a blob that the compiler knows nothing of, and what any firmware has
//! of the compiler's own functions (copy, clear, compare; of bytes and of words).
#![no_std]
#![no_main]

use core::hint::black_box;

use lm3s6965::cortex_m;
use lm3s6965::settings::BLOB_BYTES;

static BLOB: [u8; BLOB_BYTES] = [0; BLOB_BYTES];

#[lm3s6965::rt::entry]
fn main() -> ! {
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
    loop {
        cortex_m::asm::wfi();
    }
}
