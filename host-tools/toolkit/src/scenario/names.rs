//! Names of states and flags in a scenario, looked up in a machine.

use crate::nearest::nearest;
use crate::trace::directory::{Directory, RegionEntry, StateEntry, StateId, StateKind};

use super::{Mistake, MistakeCause, Name, Place};

/// What an expectation looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Subject {
    /// Whether a state is current.
    State(StateId),
    /// Whether a flag of a state is set.
    Flag(StateId, FlagKind),
}

/// A flag of a state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FlagKind {
    /// `exit`, of a task state or superstate.
    Exit,
    /// `timeout`, of every state that is no pseudo-state.
    Timeout,
    /// `busy`, of a task state or superstate.
    Busy,
    /// A control flag, by its index in the signature.
    Control(usize),
}

/// A name, taken apart at its first dot.
pub(super) struct SplitName<'a> {
    whole: &'a Name,
    path: &'a str,
    flag: Option<&'a str>,
}

impl<'a> SplitName<'a> {
    pub(super) fn of(name: &'a Name) -> Self {
        let (path, flag) = match name.text.split_once('.') {
            Some((path, flag)) => (path, Some(flag)),
            None => (name.text.as_str(), None),
        };
        SplitName {
            whole: name,
            path,
            flag,
        }
    }

    /// A mistake at the part of the name that starts at byte `start`.
    pub(super) fn mistake(&self, start: usize, cause: MistakeCause) -> Mistake {
        let before = self
            .whole
            .text
            .get(..start)
            .unwrap_or_default()
            .chars()
            .count();
        Mistake {
            place: Place {
                col: self.whole.place.col + before,
                ..self.whole.place
            },
            cause,
        }
    }

    fn flag_start(&self) -> usize {
        self.path.len() + 1
    }

    /// The out flag of a task state that the name stands for: task instance and flag.
    pub(super) fn written_flag(&self, directory: &Directory) -> Result<(usize, usize), Mistake> {
        let (_, state) = self.state(directory)?;
        let StateKind::Task { instance } = state.kind else {
            return Err(self.mistake(
                0,
                MistakeCause::NotWritable {
                    name: self.whole.text.clone(),
                },
            ));
        };
        let Some(flag) = self.flag else {
            let example = state
                .flags
                .iter()
                .find(|flag| flag.is_out)
                .map_or("flag", |flag| &flag.name)
                .to_owned();
            let path = self.path.to_owned();
            return Err(self.mistake(self.path.len(), MistakeCause::FlagNeeded { path, example }));
        };
        match self.flag_kind(state, flag)? {
            FlagKind::Control(index) if state.flags.get(index).is_some_and(|flag| flag.is_out) => {
                Ok((instance, index))
            }
            _ => Err(self.mistake(
                self.flag_start(),
                MistakeCause::NotWritable {
                    name: self.whole.text.clone(),
                },
            )),
        }
    }

    /// The task instance of the task state that the name stands for.
    pub(super) fn task(&self, directory: &Directory) -> Result<usize, Mistake> {
        let (_, state) = self.state(directory)?;
        if let Some(flag) = self.flag {
            return Err(self.mistake(
                self.path.len(),
                MistakeCause::FlagExcess { flag: flag.into() },
            ));
        }
        match state.kind {
            StateKind::Task { instance } => Ok(instance),
            _ => Err(self.mistake(
                0,
                MistakeCause::NoTaskState {
                    path: self.path.into(),
                },
            )),
        }
    }

    /// What an expectation looks at.
    pub(super) fn subject(&self, directory: &Directory) -> Result<Subject, Mistake> {
        let (id, state) = self.state(directory)?;
        match self.flag {
            None => Ok(Subject::State(id)),
            Some(flag) => Ok(Subject::Flag(id, self.flag_kind(state, flag)?)),
        }
    }

    /// A flag of a state, by its name.
    fn flag_kind(&self, state: &StateEntry, flag: &str) -> Result<FlagKind, Mistake> {
        let system = match state.kind {
            StateKind::Pseudo => &[][..],
            StateKind::Simple => &[("timeout", FlagKind::Timeout)][..],
            StateKind::Task { .. } | StateKind::Super { .. } => &[
                ("exit", FlagKind::Exit),
                ("timeout", FlagKind::Timeout),
                ("busy", FlagKind::Busy),
            ][..],
        };
        let control = state
            .flags
            .iter()
            .position(|known| known.name == flag)
            .map(FlagKind::Control);
        let system_flag = system
            .iter()
            .find(|(name, _)| *name == flag)
            .map(|(_, kind)| *kind);
        control.or(system_flag).ok_or_else(|| {
            let known = state
                .flags
                .iter()
                .map(|flag| flag.name.as_str())
                .chain(system.iter().map(|(name, _)| *name));
            let meant = nearest(flag, known).map(String::from);
            let cause = MistakeCause::UnknownFlag {
                path: self.path.into(),
                found: flag.into(),
                meant,
            };
            self.mistake(self.flag_start(), cause)
        })
    }

    pub(super) fn state<'d>(
        &self,
        directory: &'d Directory,
    ) -> Result<(StateId, &'d StateEntry), Mistake> {
        let found = directory
            .find(self.path)
            .and_then(|id| Some((id, directory.state(id)?)));
        found.ok_or_else(|| self.why_unknown(directory))
    }

    /// Why no state has the path: the first part that leads nowhere.
    fn why_unknown(&self, directory: &Directory) -> Mistake {
        let malformed = || MistakeCause::MalformedName {
            name: self.whole.text.clone(),
        };
        let mut owner: Option<(StateId, &StateEntry)> = None;
        let mut region: Option<&RegionEntry> = None;
        let mut start = 0;
        for part in self.path.split('/') {
            if part.is_empty() {
                return self.mistake(start, malformed());
            }
            match region.take() {
                None => {
                    let inside = || directory.regions_of(owner.map(|(id, _)| id));
                    let Some(found) = inside().find(|region| region.name == part) else {
                        let cause = match owner {
                            Some((_, state)) if inside().next().is_none() => {
                                MistakeCause::NothingInside {
                                    path: state.path.clone(),
                                }
                            }
                            _ => MistakeCause::UnknownRegion {
                                container: owner.map_or("the machine".into(), |(_, state)| {
                                    format!("`{}`", state.path)
                                }),
                                found: part.into(),
                                meant: nearest(part, inside().map(|region| region.name.as_str()))
                                    .map(String::from),
                            },
                        };
                        return self.mistake(start, cause);
                    };
                    region = Some(found);
                }
                Some(within) => match within
                    .find(part)
                    .and_then(|id| Some((id, directory.state(id)?)))
                {
                    Some(found) => owner = Some(found),
                    None => {
                        let names = within.locals.iter().map(StateEntry::name);
                        let cause = MistakeCause::UnknownState {
                            region: within.path.clone(),
                            found: part.into(),
                            meant: nearest(part, names).map(String::from),
                        };
                        return self.mistake(start, cause);
                    }
                },
            }
            start += part.len() + 1;
        }
        match region {
            Some(region) => {
                let example = region
                    .locals
                    .last()
                    .map_or("initial", StateEntry::name)
                    .to_owned();
                self.mistake(
                    0,
                    MistakeCause::RegionOnly {
                        path: region.path.clone(),
                        example,
                    },
                )
            }
            None => self.mistake(0, malformed()),
        }
    }
}
