//! Whatever happens to a blob on its way: it is refused with a reason, or it is a valid blob, and a
//! valid blob runs, whatever the flags do, without a panic and to its end. All of it also with the
//! CRC made right again, so that it is the verifier's own judgement.

#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::collections::BTreeMap;

use esm_core::format::{CRC_BYTES, crc32};
use esm_core::reads::{Checked, Reads, Unchecked};
use esm_core::tables::TaskPlaces;
use esm_core::{Interpreter, Observer, Verified};
use esm_tests::random::Random;
use esm_tests::{random_machine, subject};
use host_tools::inspect;
use host_tools::trace::directory::Directory;

/// Macro steps that an accepted blob is run for.
const STEPS: usize = 6;

struct Unobserved;

impl Observer for Unobserved {}

/// What became of many blobs.
#[derive(Debug, Default)]
struct Tally {
    accepted: usize,
    refused: BTreeMap<String, usize>,
}

impl Tally {
    /// What tools read of a blob that passed: its names, which may be gone, and its tables.
    fn read_as_tools_do(&mut self, bytes: &[u8]) {
        // Slow, and the same for most: one in a few is enough.
        if !self.accepted.is_multiple_of(16) {
            return;
        }
        let verified: Verified<Vec<u8>> = subject::verified(bytes).unwrap();
        let _ = Directory::of(&verified.tables());
        let _ = inspect::Report::of(&verified);
    }

    /// Verifies the bytes, and runs them if they pass.
    fn try_blob(&mut self, bytes: &[u8], random: &mut Random) {
        let verified = match esm_core::verify(bytes) {
            Ok(verified) => verified,
            Err((_, refusal)) => {
                let reason = format!("{refusal:?}");
                let reason = reason.split([' ', '(']).next().unwrap_or_default();
                *self.refused.entry(reason.to_owned()).or_default() += 1;
                return;
            }
        };
        self.accepted += 1;
        self.read_as_tools_do(bytes);
        let task_instances = verified.tables().task_instance_count();
        let mut arena = vec![0; verified.arena_words()];
        let Ok(mut interpreter) = Interpreter::new(verified, &mut arena) else {
            panic!("a blob that passed wants more memory than it says");
        };
        for _ in 0..STEPS {
            if interpreter.macro_step(&mut Unobserved).is_err() {
                break;
            }
            for _ in 0..4 {
                let task = random.below(task_instances);
                if task >= task_instances {
                    break;
                }
                match random.below(4) {
                    // Flags beyond the task's are a caller's mistake that must not reach another's
                    // memory.
                    0 => interpreter.set_flag(task, random.below(6), random.chance(70)),
                    1 => interpreter.report_exit(task),
                    2 => interpreter.set_busy(task, random.chance(50)),
                    _ => interpreter.clear_enabled(task),
                }
            }
        }
    }
}

fn with_right_crc(bytes: &[u8]) -> Vec<u8> {
    let mut fixed = bytes.to_vec();
    if let Some(end) = fixed.len().checked_sub(CRC_BYTES) {
        let crc = crc32(&fixed[..end]);
        fixed[end..].copy_from_slice(&crc.to_le_bytes());
    }
    fixed
}

/// Blobs of three sizes that between them use every section.
fn blobs() -> Vec<(String, Vec<u8>)> {
    let mut found = vec![(
        "the CD player".to_owned(),
        subject::build(include_str!("../data/cd51.esm"))
            .unwrap()
            .blob,
    )];
    // Not every seed makes a machine of a handy size.
    for seed in 1..200 {
        let built = subject::build(&random_machine::machine(seed)).unwrap();
        let nets = !built.model.containers.iter().all(|it| it.paths.is_empty());
        if (1_200..3_000).contains(&built.blob.len()) && nets == (found.len() == 2) {
            found.push((format!("the machine of seed {seed}"), built.blob));
        }
        if found.len() == 3 {
            break;
        }
    }
    assert_eq!(
        found.len(),
        3,
        "too few seeds make machines of a handy size"
    );
    found
}

#[test]
fn one_changed_byte_is_refused_or_harmless() {
    for (number, (name, blob)) in blobs().into_iter().enumerate() {
        // Every bit of the first, and enough of the larger ones.
        let bits: &[u8] = if number == 0 {
            &[0, 1, 2, 3, 4, 5, 6, 7]
        } else {
            &[0, 3, 7]
        };
        let mut random = Random::new(1);
        let (mut raw, mut fixed) = (Tally::default(), Tally::default());
        for place in 0..blob.len() {
            let mut bytes = blob.clone();
            for bit in bits {
                bytes[place] = blob[place] ^ (1 << bit);
                raw.try_blob(&bytes, &mut random);
                fixed.try_blob(&with_right_crc(&bytes), &mut random);
            }
            for value in [0x00, blob[place].wrapping_add(1)] {
                if value != blob[place] {
                    bytes[place] = value;
                    raw.try_blob(&bytes, &mut random);
                    fixed.try_blob(&with_right_crc(&bytes), &mut random);
                }
            }
        }
        println!(
            "{name}, {} bytes: {raw:?}\nwith the CRC made right: {fixed:?}",
            blob.len()
        );
        assert_eq!(raw.accepted, 0, "{name}: a CRC-32 finds every changed byte");
        assert!(
            fixed.accepted > 0,
            "{name}: parameters and names can be anything"
        );
        assert!(fixed.refused.len() >= 3, "{name}: only {:?}", fixed.refused);
        assert!(
            fixed.refused.values().sum::<usize>() > fixed.accepted / 4,
            "{name}: {fixed:?}"
        );
    }
}

#[test]
fn a_part_of_a_blob_is_refused() {
    for (name, blob) in blobs() {
        let mut random = Random::new(2);
        let mut tally = Tally::default();
        for length in 0..blob.len() {
            tally.try_blob(&blob[..length], &mut random);
            tally.try_blob(&with_right_crc(&blob[..length]), &mut random);
        }
        assert_eq!(tally.accepted, 0, "{name}");
        for surplus in 1..9 {
            let longer = [&blob[..], &vec![0; surplus]].concat();
            tally.try_blob(&longer, &mut random);
            tally.try_blob(&with_right_crc(&longer), &mut random);
        }
        assert_eq!(tally.accepted, 0, "{name}, with bytes behind it");
    }
}

#[test]
fn random_bytes_are_refused() {
    let mut random = Random::new(3);
    let mut tally = Tally::default();
    for _ in 0..20_000 {
        let mut bytes: Vec<u8> = (0..random.below(200))
            .map(|_| random.bits() as u8)
            .collect();
        tally.try_blob(&bytes, &mut random);
        // With the right beginning they get further.
        for (byte, magic) in bytes.iter_mut().zip(*b"ESM2") {
            *byte = magic;
        }
        tally.try_blob(&with_right_crc(&bytes), &mut random);
    }
    assert_eq!(tally.accepted, 0, "{tally:?}");
}

#[test]
fn several_changed_words_are_refused_or_harmless() {
    for (name, blob) in blobs() {
        let mut random = Random::new(4);
        let mut tally = Tally::default();
        for _ in 0..3_000 {
            let mut bytes = blob.clone();
            for _ in 0..random.between(1, 4) {
                let place = random.between(4, bytes.len() - CRC_BYTES - 2);
                // Small numbers are indices that exist: the changes that are hardest to see
                // through.
                let word = match random.below(3) {
                    0 => random.bits() as u16,
                    1 => random.below(16) as u16,
                    _ => {
                        let from = random.between(4, bytes.len() - CRC_BYTES - 2);
                        u16::from_le_bytes([bytes[from], bytes[from + 1]])
                    }
                };
                bytes[place..place + 2].copy_from_slice(&word.to_le_bytes());
            }
            tally.try_blob(&with_right_crc(&bytes), &mut random);
        }
        println!("{name}: {tally:?}");
        assert!(tally.refused.len() >= 3, "{name}: only {tally:?}");
    }
}

/// What a task instance with places finds: its flags and its parameters, which were 9 before; and
/// all flags and enable bits of the machine, once it has set its first two flags.
fn found<R: Reads<Vec<u8>>>(
    blob: &[u8],
    change: impl FnOnce(&mut TaskPlaces),
) -> (u16, [u32; 2], Vec<u32>) {
    let verified = subject::verified(blob).unwrap();
    let mut places = verified.tables().task_places(0).unwrap();
    let mut arena = vec![0; verified.arena_words()];
    let mut interpreter = Interpreter::<_, R>::with_reads(verified, &mut arena).unwrap();
    // Of a task that is told to have more flags than it has, both are seen.
    interpreter.set_flags_at(&places, u16::MAX, 0b01);
    change(&mut places);
    let mut params = [9; 2];
    interpreter.params_at(&places, &mut params);
    let flags = interpreter.control_flags_at(&places);
    interpreter.set_flags_at(&places, 0b11, 0b11);
    (flags, params, interpreter.input_words().to_vec())
}

#[test]
fn places_that_are_not_in_a_missions_tables_lead_nowhere() {
    let text = "interpreter slot 1; slot 1 period 10 ms duration 1 ms; slot 2 period 10 ms duration 1 ms;\n\
        task Work slot 2 { in flag go; out flag near; param gain: u32 = 3; param limit: u32 = 5; }\n\
        machine M { region r { task T: Work; initial -> T; } }\n";
    let blob = subject::build(text).unwrap().blob;
    let both = |change: fn(&mut TaskPlaces)| {
        let found_checked = found::<Checked>(&blob, change);
        assert_eq!(found::<Unchecked>(&blob, change), found_checked);
        found_checked
    };
    let places = subject::verified(&blob).unwrap().tables().task_places(0);
    let first = usize::from(places.unwrap().first_flag) + esm_core::format::TASK_CONTROL_FLAGS;
    let with = |flags: u32| vec![flags << first, 0];
    assert_eq!(both(|_| ()), (0b01, [3, 5], with(0b11)));
    assert_eq!(
        both(|places| places.first_param = 1),
        (0b01, [9, 9], with(0b11))
    );
    assert_eq!(
        both(|places| places.first_param = u16::MAX),
        (0b01, [9, 9], with(0b11))
    );
    // No such flags, or not so many: nothing is written, and no enable bit.
    assert_eq!(
        both(|places| places.first_flag = u16::MAX),
        (0, [3, 5], with(0b01))
    );
    let (_, _, words) = both(|places| (places.first_flag, places.control_flags) = (28, u16::MAX));
    assert_eq!(words, with(0b01));
    assert_eq!(
        both(|places| places.region = u16::MAX),
        (0b01, [3, 5], with(0b01))
    );
    // Flags that it has not are no matter of it.
    assert_eq!(
        both(|places| places.control_flags = 0b10),
        (0, [3, 5], with(0b11))
    );
    assert_eq!(
        both(|places| places.control_flags = 0),
        (0, [3, 5], with(0b01))
    );
}
