//! A recording that begins where another one ends: so who looks at one that grows replays what is
//! new of it, and not all of it again.

use std::collections::BTreeMap;

use esm_link::recording::write_state;
use esm_link::trace::RecordSink;

use super::file::{self, Frame, take_number};
use super::player::{Player, Recording};

#[derive(Default)]
struct Bytes(Vec<u8>);

impl RecordSink for Bytes {
    fn put(&mut self, byte: u8) {
        self.0.push(byte);
    }
}

impl Recording {
    /// Bytes of a recording with the same head, missions and nets, which begins with all that the
    /// machine is where this one ends. Frames that would follow here follow there. None where there
    /// is no such machine: nothing has run, a fault has stopped it, or a replay ends before.
    pub fn rest(&self) -> Option<Vec<u8>> {
        let stretch = self.stretches.last()?;
        let mission = self.mission(stretch.mission)?;
        let mut arena = vec![0; mission.verified.arena_words()];
        let mut player = Player::new(mission, stretch, &mut arena).ok()?;
        while player.enter().ok()?.goes_on {
            player.macro_step(&mut ()).ok()?;
        }
        let machine = player.machine();
        let mut state = Bytes::default();
        let (words, progress) = (machine.state_words(), machine.progress());
        let (hash, start_us) = (stretch.mission, stretch.start_us);
        write_state(&mut state, false, hash, start_us, &progress, words);
        // The last word on the nets of each mission.
        let nets: BTreeMap<u32, &Frame> = (self.sample_frames.iter())
            .filter_map(|(_, frame)| match frame {
                Frame::Nets(content) => Some((take_number(&mut content.as_slice())?, frame)),
                _ => None,
            })
            .collect();
        let missions = self.missions.iter().map(|mission| Frame::Mission {
            name: mission.name.clone(),
            blob: mission.verified.bytes().to_vec(),
        });
        let mut bytes = Vec::new();
        file::write_mark(&mut bytes).ok()?;
        let head = Frame::Header(self.head.clone());
        for frame in std::iter::once(head).chain(missions) {
            frame.write(&mut bytes).ok()?;
        }
        for frame in nets.into_values() {
            frame.write(&mut bytes).ok()?;
        }
        Frame::Records(state.0).write(&mut bytes).ok()?;
        Some(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::planted::{BLINK, Planted};
    use crate::recording::told::Told;

    #[test]
    fn what_follows_on_the_rest_is_what_follows_on_the_whole() {
        let whole = Planted::new().run(("blink", BLINK), 4_000, 0..40, &[]);
        let whole = whole.recording();
        let (told, ended) = Told::of(&whole);
        ended.unwrap();
        for cut in [1, 2, 3, 7, 20] {
            let first = Planted::new().run(("blink", BLINK), 4_000, 0..cut, &[]);
            let rest = first.recording().rest().unwrap();
            // Nothing has run in it yet, and it is a whole recording.
            let empty = Recording::read(&rest).unwrap();
            assert_eq!(empty.stretches.len(), 1);
            assert_eq!(empty.stretches[0].made, 0);
            let rest = Planted::behind(rest).run(("blink", BLINK), 4_000, cut..40, &[]);
            let rest = rest.recording();
            assert_eq!(rest.missions.len(), 1, "{cut}");
            let (behind, ended) = Told::of(&rest);
            ended.unwrap();
            let first_us = 4_000 + cut * 20_000;
            let expected = told.transitions.iter().map(|it| it.t_us);
            let expected: Vec<u64> = expected.filter(|t_us| *t_us >= first_us).collect();
            let found: Vec<u64> = behind.transitions.iter().map(|it| it.t_us).collect();
            assert!(expected.len() > 3, "{expected:?}");
            assert_eq!(found, expected, "cut at {cut}");
            assert_eq!(behind.last_start(&rest), Some((4_000, 0)));
        }
        assert!(Planted::new().recording().rest().is_none());
    }
}
