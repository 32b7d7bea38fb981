//! From source to a blob, back to source, and to a blob again.

use std::time::Duration;

use host_tools::compile::{self, NameTable};
use host_tools::model::Model;
use host_tools::{inspect, lang};

use crate::random::Random;
use crate::random_machine;

use super::front_end::split;

/// How long start times are searched for, for texts that nobody made to be laid out at once.
const LAY_OUT_LIMIT: Duration = Duration::from_millis(200);

/// Longer texts take long to compile four times over.
const MAX_TEXT_BYTES: usize = 20_000;

/// Compiles a mission, gives the blob back as source, and compiles that. The mission is in the bytes, if they are a set of files without errors; else the
/// bytes decide how a random machine is made.
///
/// # Panics
/// Where a law does not hold.
pub fn round_trip(bytes: &[u8]) {
    let made;
    let files = split(bytes);
    let (model, starts_us) = match right(&files) {
        Some(right) => right,
        None => {
            made = random_machine::machine_of(&mut Random::of_bytes(bytes));
            if made.len() > MAX_TEXT_BYTES {
                return;
            }
            let Some(right) = right(&[("machine.esm", made.as_bytes())]) else {
                panic!("a random machine has errors:\n{made}");
            };
            right
        }
    };
    for names in [NameTable::Kept, NameTable::LeftOut] {
        // What is too large for a blob is told, and that is tried elsewhere.
        let Ok(blob) = compile::compile_with(&model, &starts_us, names) else {
            return;
        };
        let source = source(&blob);
        let Some((again, starts_us)) = right(&[("again.esm", source.as_bytes())]) else {
            panic!("what was given back has errors:\n{source}");
        };
        let again = compile::compile_with(&again, &starts_us, names);
        assert!(
            again.is_ok_and(|again| again == blob),
            "another blob:\n{source}"
        );
        let laid_out = lang::format::format("again.esm", source.as_bytes());
        assert!(
            laid_out.is_ok_and(|text| text == source),
            "`esm fmt` would lay this out in another way:\n{source}"
        );
    }
}

/// The model of files without errors and with a machine, and the starts of its slots.
fn right(files: &[(&str, &[u8])]) -> Option<(Model, Vec<u32>)> {
    let mut checked = lang::load_files(files);
    checked.require_machine();
    if checked.has_errors() {
        return None;
    }
    let schedule = checked.lay_out(LAY_OUT_LIMIT)?;
    Some((checked.model?, schedule.starts_us))
}

fn source(blob: &[u8]) -> String {
    let verified = esm_core::verify(blob.to_vec()).unwrap_or_else(|(_, refusal)| {
        panic!("the verifier refuses what the compiler made: {refusal:?}")
    });
    inspect::source(&verified)
        .unwrap_or_else(|cause| panic!("what was compiled cannot be given back: {cause}"))
}
