//! Values on nets of the mission that a robot runs: asked for, and as they come in samples.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use esm_core::{Refusal, Verified};
use esm_link::features::Feature;
use esm_link::message::LinkError;
use esm_link::telemetry::MAX_VALUE_WORDS;

use crate::link_client::{ClientError, LinkClient, StreamEvent};
use crate::serial::ByteLink;
use esm_toolkit::clean::counted;
use esm_toolkit::inspect::refusal::Explained;
use esm_toolkit::parameters::Value;
use esm_toolkit::recording::samples::RawSample;
use esm_toolkit::trace::directory::NoDirectory;
pub use esm_toolkit::values::{
    Field, MAX_FIELDS, Net, Text, Watched, fields_of, nets_of, words_of,
};
use esm_toolkit::values::{kept, values_in};

/// The nets of the mission that a robot runs, and what their values are made of.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Catalogue {
    /// Hash of the mission.
    pub mission: u32,
    /// The nets, in the order of their indices.
    pub nets: Vec<Watched>,
}

impl Catalogue {
    /// Asks a robot, whose mission is the one in this blob, what is on its nets.
    ///
    /// # Errors
    /// [`ValuesError`]
    pub fn read<L: ByteLink, B>(
        robot: &mut LinkClient<L>,
        blob: &Verified<B>,
    ) -> Result<Self, ValuesError>
    where
        B: std::ops::Deref<Target = [u8]>,
    {
        let mut known: HashMap<String, Arc<[Field]>> = HashMap::new();
        let mut count = 0;
        let mut nets = Vec::new();
        for net in nets_of(blob)? {
            let fields = match known.get(&net.type_name) {
                Some(fields) => fields.clone(),
                None => {
                    let text = robot.fields(blob.hash(), net.index)?;
                    let fields: Arc<[Field]> = fields_of(&text).ok_or(ValuesError::Unknown)?.into();
                    count += fields.len();
                    if count > MAX_FIELDS {
                        return Err(ValuesError::TooMany);
                    }
                    known.insert(net.type_name.clone(), fields.clone());
                    fields
                }
            };
            nets.push(Watched { net, fields });
        }
        Ok(Catalogue {
            mission: blob.hash(),
            nets,
        })
    }

    /// The net of this name.
    pub fn find(&self, name: &str) -> Option<&Watched> {
        let has_name = |it: &&Watched| it.net.names.iter().any(|known| known == name);
        self.nets.iter().find(has_name)
    }

    /// The nets that a recording keeps samples of, in as many words as one has: poses, twists and
    /// ranges before others. And how many have no room.
    pub fn kept(&self) -> (Vec<Watched>, usize) {
        kept(&self.nets)
    }

    /// All nets whose values say what they are made of, in groups that a sample has room for. A
    /// value that is too large for any is left out.
    pub fn groups(&self) -> Vec<Vec<Watched>> {
        let mut groups: Vec<Vec<Watched>> = Vec::new();
        let mut room = 0;
        for watched in &self.nets {
            let words = words_of(&watched.fields);
            if words == 0 || words > MAX_VALUE_WORDS {
                continue;
            }
            match groups.last_mut() {
                Some(group) if words <= room => group.push(watched.clone()),
                _ => {
                    groups.push(vec![watched.clone()]);
                    room = MAX_VALUE_WORDS;
                }
            }
            room -= words;
        }
        groups
    }
}

/// Why there are no values.
#[derive(Debug, thiserror::Error)]
pub enum ValuesError {
    /// The robot did not answer, or refused to.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The mission has no names.
    #[error(transparent)]
    NoNames(#[from] NoDirectory),
    /// The mission is none.
    #[error("the mission is not valid: {}", Explained(*.0))]
    BadMission(#[from] Refusal),
    /// The robot speaks of types that this program does not know.
    #[error(
        "the robot has values of a type that this program does not know: use the `esm` of its firmware's version"
    )]
    Unknown,
    /// More than any robot has.
    #[error(
        "the robot has values of more than {MAX_FIELDS} numbers together, which no robot has: its firmware and this program do not fit together"
    )]
    TooMany,
}

impl ValuesError {
    /// What is wrong with the line, if it is that. Otherwise the robot answers, and has no values
    /// to tell of: its firmware was built without, or another mission runs by now.
    ///
    /// # Errors
    /// The answer.
    pub fn of_line(self) -> Result<ClientError, Self> {
        match self {
            ValuesError::Client(error)
                if error.refusal().is_none()
                    && !matches!(error, ClientError::NotBuiltIn { .. }) =>
            {
                Ok(error)
            }
            other => Err(other),
        }
    }
}

/// Values that a robot was asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Subscription {
    number: u8,
    nets: Vec<Watched>,
}

/// What a robot says of values that it was asked for.
#[derive(Clone, Debug, PartialEq)]
pub enum Told {
    /// What was on the nets.
    Sample(Reading),
    /// So many samples did not come: the robot had no room for them, or the line lost them.
    Gap(u32),
    /// The mission is another one; no more will come.
    Ended,
}

/// What was on nets at the same time.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Nominal start of the macro step behind which it was read, in microseconds since the mission
    /// started.
    pub t_us: u64,
    /// The values of the nets that were asked for, in that order; none of a net that nothing was
    /// written to yet.
    pub values: Vec<Option<Vec<Value>>>,
}

/// Values that a recording keeps.
pub struct Kept {
    /// What the robot was asked for.
    pub subscription: Subscription,
    /// How many nets have no room.
    missing: usize,
}

impl Kept {
    /// What a person should know of nets that have no room.
    pub fn left_out(&self) -> Option<String> {
        let nets = counted(self.missing as u64, "net");
        (self.missing > 0).then(|| {
            format!(
                "the recording is without the values of {nets}: a robot tells of {MAX_VALUE_WORDS} numbers at a time"
            )
        })
    }
}

impl Subscription {
    /// Asks the robot for values of the mission in this blob, which runs, as a recording [keeps
    /// them](Catalogue::kept): a sample each `period` at most. None where it has no nets.
    ///
    /// # Errors
    /// [`ValuesError`]
    pub fn of_kept<L: ByteLink>(
        robot: &mut LinkClient<L>,
        blob: &[u8],
        period: Duration,
    ) -> Result<Option<Kept>, ValuesError> {
        robot.require(Feature::Telemetry)?;
        let blob = esm_core::verify(blob).map_err(|(_, refusal)| refusal)?;
        let catalogue = Catalogue::read(robot, &blob)?;
        let (nets, missing) = catalogue.kept();
        if nets.is_empty() {
            return Ok(None);
        }
        let subscription = Subscription::begin(robot, catalogue.mission, nets, period)?;
        Ok(Some(Kept {
            subscription,
            missing,
        }))
    }

    /// Asks the robot for values of these nets of the mission of this hash, each `period` at most,
    /// in place of others.
    ///
    /// # Errors
    /// [`ClientError`]
    pub fn begin<L: ByteLink>(
        robot: &mut LinkClient<L>,
        mission: u32,
        nets: Vec<Watched>,
        period: Duration,
    ) -> Result<Self, ClientError> {
        let indices: Vec<u16> = nets.iter().map(|watched| watched.net.index).collect();
        let number = robot.values(mission, &indices, period)?;
        Ok(Subscription { number, nets })
    }

    /// What was asked for.
    pub fn nets(&self) -> &[Watched] {
        &self.nets
    }

    /// What an event brings of it, as it came.
    pub fn raw(&self, mission: u32, event: &StreamEvent) -> Option<RawSample> {
        match event {
            StreamEvent::Values {
                number,
                left_out: _,
                has,
                t_us,
                words,
            } if *number == self.number => Some(RawSample {
                mission,
                t_us: *t_us,
                has: *has,
                words: words.clone(),
            }),
            _ => None,
        }
    }

    /// What an event says of it, if it is about this.
    pub fn read(&self, event: &StreamEvent) -> Option<Told> {
        match event {
            StreamEvent::Values {
                number,
                left_out: _,
                has,
                t_us,
                words,
            } if *number == self.number => {
                let values = values_in(&self.nets, *has, words.iter().copied());
                Some(Told::Sample(Reading {
                    t_us: *t_us,
                    values,
                }))
            }
            StreamEvent::ValuesEnded { number } if *number == self.number => Some(Told::Ended),
            StreamEvent::Gap {
                channel: esm_link::message::Channel::Values,
                missing,
            } => Some(Told::Gap(*missing)),
            _ => None,
        }
    }
}

/// Whether a robot refused because its firmware has no telemetry.
pub fn is_not_built_in(error: &ValuesError) -> bool {
    matches!(error, ValuesError::Client(error) if error.refusal() == Some(LinkError::NotBuiltIn))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fields(text: &str) -> Vec<Field> {
        fields_of(text).unwrap()
    }

    #[test]
    fn a_sample_is_read_net_by_net_and_those_of_other_requests_are_passed_over() {
        let net = |index, said| Watched {
            net: Net {
                index,
                names: vec![format!("n{index}")],
                type_name: "T".into(),
            },
            fields: fields(said).into(),
        };
        let nets = vec![
            net(3, "a:u32\nb:i32\n"),
            net(1, "c:bool\n"),
            net(2, ":f32\n"),
        ];
        let subscription = Subscription { number: 9, nets };
        let event = |number, has, words: &[u32]| StreamEvent::Values {
            number,
            left_out: 0,
            has,
            t_us: 40_000,
            words: words.to_vec(),
        };
        let told = subscription.read(&event(9, 0b101, &[1, u32::MAX, 1.5_f32.to_bits()]));
        let expected = Reading {
            t_us: 40_000,
            values: vec![
                Some(vec![Value::U32(1), Value::I32(-1)]),
                None,
                Some(vec![Value::F32(1.5)]),
            ],
        };
        assert_eq!(told, Some(Told::Sample(expected)));
        assert_eq!(subscription.read(&event(8, 0, &[])), None);
        let ended = |number| StreamEvent::ValuesEnded { number };
        assert_eq!(subscription.read(&ended(9)), Some(Told::Ended));
        assert_eq!(subscription.read(&ended(8)), None);
    }

    #[test]
    fn a_recording_keeps_poses_twists_and_ranges_before_others() {
        let net = |index: u16, text: &str| Watched {
            net: Net {
                index,
                names: vec![format!("n{index}")],
                type_name: "T".into(),
            },
            fields: fields_of(text).unwrap().into(),
        };
        let catalogue = Catalogue {
            mission: 7,
            nets: vec![
                net(0, "x:[u32;6]\n"),
                net(1, ""),
                net(2, "range_m:[f32;8]\nage_cs:[u8;8]\n"),
                net(3, "forward_m_per_s:f32\nturn_rad_per_s:f32\n"),
                net(4, ":f32\n"),
                net(5, "x_m:f32\ny_m:f32\nheading_rad:f32\n"),
            ],
        };
        let (kept, left_out) = catalogue.kept();
        let kept: Vec<u16> = kept.iter().map(|watched| watched.net.index).collect();
        // The pose has 3 words, the twist 2, the ranges 10, of 20 that there are.
        assert_eq!((kept, left_out), (vec![5, 3, 2, 4], 1));
    }

    #[test]
    fn nets_go_into_as_many_groups_as_they_need() {
        let net = |index: u16, words: usize| Watched {
            net: Net {
                index,
                names: vec![format!("n{index}")],
                type_name: "T".into(),
            },
            fields: fields(&format!("x:[u32;{words}]\n")).into(),
        };
        let sizes = [8, 0, 12, 1, MAX_VALUE_WORDS + 1, MAX_VALUE_WORDS];
        let catalogue = Catalogue {
            mission: 7,
            nets: (0..)
                .zip(sizes)
                .map(|(index, words)| net(index, words))
                .collect(),
        };
        let groups: Vec<Vec<u16>> = catalogue
            .groups()
            .iter()
            .map(|group| group.iter().map(|watched| watched.net.index).collect())
            .collect();
        assert_eq!(groups, [vec![0, 2], vec![3], vec![5]]);
    }
}
