//! Where fuzzing starts: small inputs that reach much.
//!
//! Those that can be made are made here, and lie in `fuzz/corpus/<target>/` for fuzzers to read;
//! `ESM_BLESS=1 cargo test -p esm-tests --test fuzzing` writes them again. What else lies there was
//! written by hand.

use std::path::PathBuf;

use host_tools::lang::{self, Code};

use crate::command::root;
use crate::fuzzing::front_end::FILE_MARK;
use crate::random::Random;
use crate::{random_machine, subject};

/// An input with the name of its file.
#[derive(Clone, Debug)]
pub struct Seed {
    /// File name.
    pub name: String,
    /// The input.
    pub bytes: Vec<u8>,
}

/// Missions that the repository ships, by the name of the seed.
const MISSIONS: [(&str, &str); 4] = [
    ("patrol", "missions/patrol.esm"),
    ("follow_wall", "missions/follow_wall.esm"),
    ("my_robot", "examples/my_robot/mission.esm"),
    ("cd51", "tests/data/cd51.esm"),
];

/// Random machines of a handy size that use, between them, the whole language.
const MACHINES: [u64; 5] = [2, 7, 11, 19, 23];

/// Seeds of decisions, and how many decisions are in each.
const DECISIONS: u64 = 24;
const DECISIONS_BYTES: usize = 160;

/// Where the seeds of a target lie.
pub fn folder(target: &str) -> PathBuf {
    root().join("fuzz/corpus").join(target)
}

/// All seeds that lie in the folder of a target, by name.
///
/// # Panics
/// If the folder cannot be read.
pub fn all(target: &str) -> Vec<Seed> {
    let folder = folder(target);
    let read = |path: PathBuf| Seed {
        name: path
            .file_name()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned(),
        bytes: std::fs::read(&path).unwrap_or_else(|error| panic!("{}: {error}", path.display())),
    };
    let entries =
        std::fs::read_dir(&folder).unwrap_or_else(|error| panic!("{}: {error}", folder.display()));
    let mut seeds: Vec<Seed> = entries
        .map(|entry| entry.map(|it| it.path()).expect("a folder can be listed"))
        .map(read)
        .collect();
    seeds.sort_by(|a, b| a.name.cmp(&b.name));
    seeds
}

/// [`missions`], and the smallest wrong file that the collection in `tests/cases` has for each
/// code.
pub fn texts() -> Vec<Seed> {
    let mut texts = missions();
    for code in Code::ALL {
        texts.extend(smallest_case(code));
    }
    texts
}

/// [`missions`] and [`decisions`].
pub fn texts_and_decisions() -> Vec<Seed> {
    [missions(), decisions()].concat()
}

/// Missions with all that they use, and random machines, as text.
pub fn missions() -> Vec<Seed> {
    let missions = MISSIONS.map(|(name, path)| (name.to_owned(), set_of_files(path)));
    let machines = MACHINES.map(|seed| (format!("machine_{seed}"), random_machine::machine(seed)));
    let texts = missions.into_iter().chain(machines);
    texts
        .map(|(name, text)| Seed {
            name: format!("{name}.esm"),
            bytes: text.into_bytes(),
        })
        .collect()
}

/// The same, compiled.
///
/// # Panics
/// If a mission of the repository does not compile.
pub fn blobs() -> Vec<Seed> {
    let mut blobs = Vec::new();
    for seed in missions() {
        let files = super::front_end::split(&seed.bytes);
        let built = subject::build_files(&files);
        blobs.push(Seed {
            name: seed.name.replace(".esm", ".blob"),
            bytes: built
                .unwrap_or_else(|cause| panic!("{}: {cause}", seed.name))
                .blob,
        });
    }
    blobs
}

/// Lines of random printable characters: a decision each.
pub fn decisions() -> Vec<Seed> {
    let of_seed = |seed| {
        let mut random = Random::new(seed);
        Seed {
            name: format!("decisions_{seed:02}"),
            bytes: (0..DECISIONS_BYTES)
                .map(|_| random.between(usize::from(b' '), usize::from(b'~')) as u8)
                .collect(),
        }
    };
    (1..=DECISIONS).map(of_seed).collect()
}

/// The smallest file among the wrong ones of a code.
fn smallest_case(code: Code) -> Option<Seed> {
    let folder = root().join("tests/cases/wrong").join(code.as_str());
    let entries = std::fs::read_dir(folder).ok()?;
    let files = entries.filter_map(|entry| {
        let path = entry.ok()?.path();
        std::fs::read(&path).ok()
    });
    let smallest = files.min_by(|a, b| (a.len(), a).cmp(&(b.len(), b)))?;
    Some(Seed {
        name: format!("{code}.esm"),
        bytes: smallest,
    })
}

/// A file of the repository and all that it uses, as one text.
fn set_of_files(path: &str) -> String {
    let path = root().join(path);
    let checked = lang::load(&path).unwrap_or_else(|error| panic!("{error}"));
    let folder = path.parent().unwrap_or(&path);
    let mut text = String::new();
    for (index, file) in checked.files.iter().enumerate() {
        if index > 0 {
            let path = file.path.strip_prefix(&*folder.to_string_lossy());
            let path = path.unwrap_or(&file.path).trim_start_matches('/');
            text += &format!("{FILE_MARK}{path}\n");
        }
        text += &file.text;
    }
    text
}
