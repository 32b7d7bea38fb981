//! What fuzzers drive: one function a target, which takes any bytes and panics if a law does not
//! hold.
//!
//! `cargo xtask fuzz` runs them under libFuzzer, which watches which code an input reaches and
//! keeps what is new; the ordinary test `fuzzing` runs them over the seeds and over changed copies
//! of these, for a few seconds and with no tool but cargo. Either way it is the same function.
//!
//! | target | takes | holds |
//! |---|---|---|
//! | [`front_end`](fn@front_end) | a set of `.esm` files | what the front end says has a place in a file, and an order; right files compile |
//! | [`verifier`](fn@verifier) | a blob, and the same with magic and CRC made right | what passes can be read everywhere and run |
//! | [`interpreter`](fn@interpreter) | decisions about a machine and about what happens to it | it runs as the reference says, and keeps the laws of [`watched`] |
//! | [`link`](fn@link) | what comes over a robot's line, over its starts | nothing but messages comes back, and afterwards a good client, who may need his key, can do all that one can |
//! | [`round_trip`](fn@round_trip) | a mission, or decisions about a machine | a blob comes back as source that makes the same blob |
//!
//! Bytes that go wrong are a file; see the chapter on robustness in the book for how to run it
//! again.

pub mod front_end;
pub mod interpreter;
pub mod link;
pub mod mutations;
pub mod plain;
pub mod records;
pub mod round_trip;
pub mod seeds;
pub mod verifier;
pub mod watched;

pub use front_end::front_end;
pub use interpreter::interpreter;
pub use link::link;
pub use round_trip::round_trip;
pub use verifier::verifier;

/// Which of the costly laws are held for an input: the bits of a number that follows from its
/// bytes, so that a run can be repeated.
#[derive(Clone, Copy, Debug)]
struct Chosen(u32);

impl Chosen {
    fn by(bytes: &[u8]) -> Self {
        Chosen(esm_core::format::crc32(bytes))
    }

    /// True for one in `of` inputs. Different places in the number are chosen independently of each
    /// other.
    fn one_in(self, of: u32, place: u32) -> bool {
        (self.0 >> place).is_multiple_of(of)
    }
}

/// A function with its seeds.
#[derive(Clone, Copy, Debug)]
pub struct Target {
    /// Its name, which is that of its folder in `fuzz/corpus`.
    pub name: &'static str,
    /// Panics where a law does not hold for these bytes.
    pub body: fn(&[u8]),
    /// Makes its seeds.
    pub seeds: fn() -> Vec<seeds::Seed>,
    /// How many changed copies of seeds the ordinary test runs: some seconds' worth.
    pub short_runs: usize,
}

/// All targets.
pub const TARGETS: [Target; 5] = [
    Target {
        name: "front_end",
        body: front_end,
        seeds: seeds::texts,
        short_runs: 300,
    },
    Target {
        name: "verifier",
        body: verifier,
        seeds: seeds::blobs,
        short_runs: 3_000,
    },
    Target {
        name: "interpreter",
        body: interpreter,
        seeds: seeds::decisions,
        short_runs: 1_200,
    },
    Target {
        name: "link",
        body: link,
        seeds: link::sessions,
        short_runs: 1_500,
    },
    Target {
        name: "round_trip",
        body: round_trip,
        seeds: seeds::texts_and_decisions,
        short_runs: 200,
    },
];
