//! How much of a recording is replayed: a few bytes of a file can stand for work without end.

use std::fmt;

use esm_core::format::MAX_SLOTS;

use crate::trace::directory;

/// What a recording may have at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Macro steps: three bytes stand for a thousand.
    pub macro_steps: u64,
    /// Transitions in them: a macro step can have millions.
    pub transitions: u64,
    /// Words of all the machines that its missions begin with: ten bytes are a beginning.
    pub begun_words: u64,
    /// Words of the machines that a walk keeps, to go on from.
    pub kept_words: u64,
    /// Comparisons of a slot with another in the check of all its missions.
    pub slot_pairs: u64,
    /// Bytes of the paths of all states of its missions.
    pub path_bytes: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Limits {
            // As many as a scenario may ask for: three weeks at 50 a second, a day at 1,000.
            macro_steps: 100_000_000,
            transitions: 100_000_000,
            // 1 GiB that is cleared, one machine after the other.
            begun_words: 1 << 28,
            // 256 MiB.
            kept_words: 1 << 26,
            // Two missions with as many slots as there can be; 500 with the slots of the largest
            // robot.
            slot_pairs: u64::from(MAX_SLOTS).pow(2),
            path_bytes: 4 * directory::MAX_PATH_BYTES as u64,
        }
    }
}

/// What there is too much of in a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TooMuch {
    what: &'static str,
    limit: u64,
}

impl TooMuch {
    /// Fails if there is more of it than may be.
    pub(super) fn check(what: &'static str, found: u64, limit: u64) -> Result<(), Self> {
        match found <= limit {
            true => Ok(()),
            false => Err(TooMuch { what, limit }),
        }
    }
}

impl fmt::Display for TooMuch {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "the recording has more than {} {}, which is more than is replayed; record the run in shorter parts",
            self.limit, self.what
        )
    }
}

impl std::error::Error for TooMuch {}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::planted::{BLINK, FLOOD, Planted};
    use crate::recording::player::{RecordingError, ReplayError, replay};
    use crate::recording::walk::Walk;

    /// A mission with so many slots, whose machine has a word or two.
    fn slots(count: u32) -> String {
        let slots: String = (0..count)
            .map(|slot| format!("slot {} period 1 s duration 1 us;\n", slot + 2))
            .collect();
        let machine = "machine M { region r { state S; initial -> S; S -> S; } }";
        format!("interpreter slot 1;\nslot 1 period 1 s duration 1 ms;\n{slots}{machine}")
    }

    #[track_caller]
    fn assert_refused(planted: &Planted, limits: Limits, what: &str) {
        let refused = planted.recording_within(limits).unwrap_err();
        let RecordingError::TooMuch(refused) = refused else {
            panic!("{refused}");
        };
        assert_eq!(refused.what, what);
    }

    #[test]
    fn macro_steps_that_a_few_bytes_stand_for_are_refused_before_one_is_made() {
        let most = Limits::default().macro_steps;
        let as_many = Planted::new().quiet(("blink", BLINK), most);
        assert!(as_many.recording_within(Limits::default()).is_ok());
        let more = Planted::new().quiet(("blink", BLINK), most + 1);
        assert_refused(&more, Limits::default(), "macro steps");
    }

    #[test]
    fn macro_steps_of_all_missions_count_together() {
        let both = Planted::new()
            .quiet(("blink", BLINK), 600)
            .quiet(("flood", FLOOD), 500);
        let of = |macro_steps| Limits {
            macro_steps,
            ..Limits::default()
        };
        assert!(both.recording_within(of(1_100)).is_ok());
        assert_refused(&both, of(1_099), "macro steps");
    }

    #[test]
    fn machines_that_begin_count_with_their_words() {
        let mut planted = Planted::new();
        for start in 0..10 {
            planted = planted.run(("blink", BLINK), 1_000_000 * start, 0..3, &[]);
        }
        let recording = planted.recording();
        assert_eq!(
            recording.missions.len(),
            1,
            "the same mission is checked once"
        );
        let words = 10 * recording.missions[0].verified.arena_words() as u64;
        let of = |begun_words| Limits {
            begun_words,
            ..Limits::default()
        };
        assert!(planted.recording_within(of(words)).is_ok());
        assert_refused(&planted, of(words - 1), "words of machines that begin");
    }

    #[test]
    fn slots_of_all_missions_count_with_their_square() {
        let (ten, twenty) = (slots(9), slots(19));
        let both = Planted::new()
            .run(("ten", &ten), 0, 0..1, &[])
            .run(("twenty", &twenty), 10, 0..1, &[])
            .run(("ten", &ten), 20, 0..1, &[]);
        let of = |slot_pairs| Limits {
            slot_pairs,
            ..Limits::default()
        };
        assert!(both.recording_within(of(50 + 200)).is_ok());
        assert_refused(&both, of(50 + 199), "pairs of slots in its missions");
    }

    #[test]
    fn paths_of_all_missions_count_together() {
        let both =
            Planted::new()
                .run(("blink", BLINK), 0, 0..1, &[])
                .run(("flood", FLOOD), 10, 0..1, &[]);
        let missions = both.recording().missions;
        let bytes: usize = (missions.iter())
            .map(|mission| mission.directory.bytes_of_paths())
            .sum();
        let of = |path_bytes| Limits {
            path_bytes,
            ..Limits::default()
        };
        assert!(both.recording_within(of(bytes as u64)).is_ok());
        let what = "bytes of paths of the states of its missions";
        assert_refused(&both, of(bytes as u64 - 1), what);
    }

    #[test]
    fn a_replay_and_a_walk_end_with_more_transitions_than_may_be() {
        let planted = Planted::new().run(("blink", BLINK), 0, 0..1_000, &[]);
        let all = replay(&planted.recording(), false, Some(Vec::new())).unwrap();
        let of = |transitions| Limits {
            transitions,
            ..Limits::default()
        };
        let exactly = planted.recording_within(of(all.transitions)).unwrap();
        assert_eq!(replay(&exactly, false, None::<Vec<u8>>).unwrap(), all);
        assert!(Walk::new(&exactly, false).1.is_none());

        let fewer = planted.recording_within(of(all.transitions / 2)).unwrap();
        let (until, why) = replay(&fewer, false, None::<Vec<u8>>).unwrap_err();
        assert!(matches!(why, ReplayError::TooMuch(_)), "{why}");
        assert_eq!(until.transitions, all.transitions / 2 + 1);
        let (walk, why) = Walk::new(&fewer, false);
        assert!(matches!(why, Some(ReplayError::TooMuch(_))), "{why:?}");
        assert_eq!(walk.count(), all.transitions / 2);
    }

    #[test]
    fn a_walk_keeps_no_more_machines_than_may_be() {
        let planted = Planted::new().run(("blink", BLINK), 0, 0..5_000, &[]);
        let of = |kept_words| Limits {
            kept_words,
            ..Limits::default()
        };
        let words_of_five = {
            let recording = planted.recording();
            let mission = &recording.missions[0];
            let words = mission.verified.arena_words() as u64;
            assert!(Walk::new(&recording, false).1.is_none());
            // State and flags of each, of which both are a part of the arena, and what comes with
            // them.
            5 * (2 * words + 50)
        };
        let enough = planted.recording_within(of(words_of_five)).unwrap();
        assert!(Walk::new(&enough, false).1.is_none());
        let too_few = planted.recording_within(of(4 * 50)).unwrap();
        let (_, why) = Walk::new(&too_few, false);
        let why = why.unwrap().to_string();
        assert!(
            why.contains("more than 200 words of machines to walk from"),
            "{why}"
        );
    }
}
