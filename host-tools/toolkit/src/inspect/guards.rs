//! The guard of a transition as the source has it, and the flags that it reads.

use esm_core::Verified;
use esm_core::format::WINDOW_FLAGS;
use esm_core::tables::{self, Code};

use super::guard::{self, Written};
use super::names::Names;
use super::reader::Reader;

/// Reads guards of a blob.
pub struct GuardReader<'a>(Reader<'a>);

/// A guard.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReadGuard {
    /// As the source has it; none where there is none.
    pub text: Option<String>,
    /// The flags that it reads, each once, in the order of their tests.
    pub terms: Vec<Read>,
}

/// A flag that a guard reads.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Read {
    /// As the source names it.
    pub name: String,
    /// Its bit, counted from the first of the container instance; none for the busy flag of a
    /// superstate.
    pub bit: Option<usize>,
}

impl<'a> GuardReader<'a> {
    /// A reader of a blob's guards.
    pub fn of(blob: &'a Verified<Vec<u8>>) -> Self {
        GuardReader(Reader {
            tables: blob.tables(),
            names: Names::of(blob),
        })
    }

    /// The guard of a transition.
    pub fn read(&self, transition: usize) -> ReadGuard {
        let tables = &self.0.tables;
        let from = tables.source_of_transition(transition);
        let Some((source, container)) = tables.state(from).zip(self.0.container_of(from)) else {
            return ReadGuard::default();
        };
        let text = match self.0.guard(from, &source, transition) {
            None | Some(Written::Nothing) => None,
            Some(Written::Expression(expression)) => Some(expression.to_string()),
            Some(Written::Tests(tests)) => Some(guard::listing(&tests)),
        };
        let own = |bit: usize| Some(source.first_flag + bit);
        let bits: Vec<Option<usize>> = match tables.guard_of(transition) {
            None | Some(tables::Guard::True) => Vec::new(),
            Some(tables::Guard::Flag { bit, .. }) => vec![own(bit)],
            Some(tables::Guard::Mask { mask, .. }) => (0..WINDOW_FLAGS)
                .filter(|bit| mask >> bit & 1 != 0)
                .map(|bit| own(bit.into()))
                .collect(),
            Some(tables::Guard::Program { .. }) => tables
                .program_of(transition)
                .filter_map(|code| match code {
                    Code::Test { flag, .. } => Some(Some(flag)),
                    Code::TestBusyInside { .. } => Some(None),
                    Code::End | Code::Send { .. } | Code::Write { .. } => None,
                })
                .collect(),
        };
        let mut terms: Vec<Read> = Vec::new();
        for bit in bits {
            if terms.iter().all(|term| term.bit != bit) {
                let name = match bit {
                    Some(bit) => self.0.flag(container, (from, &source), bit),
                    None => "busy".to_owned(),
                };
                terms.push(Read { name, bit });
            }
        }
        ReadGuard { text, terms }
    }
}
