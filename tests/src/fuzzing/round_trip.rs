//! From source to a blob, back to source, and to a blob again.

use std::time::Duration;

use host_tools::compile::{self, NameTable};
use host_tools::model::Model;
use host_tools::time::work_limit;
use host_tools::{inspect, lang};

use crate::random::Random;
use crate::random_machine::{self, SMALL};
use crate::reference;

use super::Chosen;
use super::front_end::split;

/// How long start times are searched for, for texts that nobody made to be laid out at once.
const LAY_OUT_LIMIT: Duration = Duration::from_millis(50);

/// How long they are searched for again, when the source is given back.
const SOURCE_LIMIT: Duration = Duration::from_secs(10);

/// More slots than that are another matter than the way from a blob to source.
const MAX_SLOTS: usize = 8;

/// States are called by their paths in smaller blobs: those of nested containers are as many as
/// they are long.
const MAX_NAMED_BYTES: usize = 16_000;

/// Longer texts take long to compile twice.
const MAX_TEXT_BYTES: usize = 8_000;

/// Compiles a mission, gives the blob back as source, and compiles that. The mission is in the
/// bytes, if they are a set of files without errors; else the bytes decide how a random machine is
/// made. Whether its names stay follows from the bytes, too.
///
/// # Panics
/// Where a law does not hold.
pub fn round_trip(bytes: &[u8]) {
    let chosen = Chosen::by(bytes);
    let made;
    let files = split(bytes);
    let (model, starts_us) = match right(&files) {
        Some(right) => right,
        None => {
            made = random_machine::machine_of(&mut Random::of_bytes(bytes), SMALL);
            if made.len() > MAX_TEXT_BYTES {
                return;
            }
            let Some(right) = right(&[("machine.esm", made.as_bytes())]) else {
                panic!("a random machine has errors:\n{made}");
            };
            right
        }
    };
    let names = if chosen.one_in(2, 0) {
        NameTable::LeftOut
    } else {
        NameTable::Kept
    };
    // What is too large for a blob is told, and that is tried elsewhere.
    let Ok(blob) = compile::compile_with(&model, &starts_us, names) else {
        return;
    };
    let source = source(&blob);
    // Whoever gives a source out has compiled it: whether that is so is looked at now and then.
    if !chosen.one_in(3, 8) {
        return;
    }
    let Some((again, starts_us)) = right(&[("again.esm", source.as_bytes())]) else {
        panic!("what was given back has errors:\n{source}");
    };
    if names == NameTable::Kept {
        assert_eq!(
            paths(&model, &blob),
            paths(&again, &blob),
            "other names:\n{source}"
        );
    }
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

/// The model of files without errors and with a machine, and the starts of its slots.
fn right(files: &[(&str, &[u8])]) -> Option<(Model, Vec<u32>)> {
    // Most bytes are decisions: the front end need not look for all that is wrong with them as a
    // text.
    if files.iter().any(|(_, bytes)| !bytes.contains(&b'{')) {
        return None;
    }
    let mut checked = lang::load_files(files);
    checked.require_machine();
    if checked.has_errors() || checked.slots().len() > MAX_SLOTS {
        return None;
    }
    let schedule = checked.lay_out(work_limit(LAY_OUT_LIMIT))?;
    Some((checked.model?, schedule.starts_us))
}

/// The paths of all states, in order; none where these are very many.
fn paths(model: &Model, blob: &[u8]) -> Vec<String> {
    if blob.len() > MAX_NAMED_BYTES {
        return Vec::new();
    }
    let states = reference::states(model).into_iter();
    states.map(|(path, _)| path).collect()
}

fn source(blob: &[u8]) -> String {
    let verified = esm_core::verify(blob.to_vec()).unwrap_or_else(|(_, refusal)| {
        panic!("the verifier refuses what the compiler made: {refusal:?}")
    });
    inspect::source(&verified, work_limit(SOURCE_LIMIT))
        .unwrap_or_else(|cause| panic!("what was compiled cannot be given back: {cause}"))
}
