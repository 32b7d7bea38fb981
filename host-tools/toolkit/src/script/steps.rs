//! What a script is made of.

use esm_link::behaviours::{Call, PARAM_BYTES, WATCH_BYTES, Watch};
use rt_firmware::PortType;
use rt_firmware::behaviours::BehaviourList;

use crate::lang::Diagnostic;
use crate::model::{Direction, SourceFile, Task};

/// A behaviour of a script, as it is sent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Step {
    /// Its line in the file, from 1 on.
    pub line: u32,
    /// Its name, as the firmware declares it.
    pub name: String,
    /// Hash of the signature of its task.
    pub task: u64,
    /// The bits of its parameters, as [`Call::params`] has them.
    pub(super) params: Vec<u8>,
    /// Its situations, as [`Call::watches`] has them.
    pub(super) watches: Vec<u8>,
}

impl Step {
    /// As it is sent.
    pub fn call(&self) -> Call<'_> {
        Call {
            task: self.task,
            params: &self.params,
            watches: &self.watches,
        }
    }

    /// The bits of its parameters, in the order of the declaration.
    pub fn params(&self) -> impl Iterator<Item = u32> {
        let (params, _) = self.params.as_chunks::<PARAM_BYTES>();
        params.iter().map(|bytes| u32::from_le_bytes(*bytes))
    }

    /// Its situations.
    pub fn watches(&self) -> impl Iterator<Item = Watch> {
        let (watches, _) = self.watches.as_chunks::<WATCH_BYTES>();
        watches.iter().filter_map(|bytes| Watch::of_bytes(*bytes))
    }
}

/// A script that a firmware can run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Script {
    /// Its steps, and behind them what situations insert.
    pub all: Vec<Step>,
    /// How many of them are steps.
    pub steps: usize,
}

impl Script {
    /// Names it: a checksum of what is sent, never 0.
    pub fn id(&self) -> u32 {
        let mut bytes = vec![self.steps as u8];
        for step in &self.all {
            bytes.extend(step.task.to_le_bytes());
            bytes.extend(&step.params);
            bytes.push(step.watches.len() as u8);
            bytes.extend(&step.watches);
        }
        esm_core::format::crc32(&bytes).max(1)
    }
}

/// A text and what is wrong with it; the script exactly if nothing is.
#[derive(Clone, Debug)]
pub struct Reading {
    /// The text.
    pub files: [SourceFile; 1],
    /// What is wrong, by its place.
    pub diagnostics: Vec<Diagnostic>,
    /// What it says.
    pub script: Option<Script>,
}

/// Whether a task is a behaviour: it stands on the list, which it has not made, and may fail.
/// Situations change the list as well.
pub fn is_behaviour(task: &Task) -> bool {
    let has = |direction| {
        let mut lists = (task.data.iter()).filter(|port| port.type_name == BehaviourList::NAME);
        lists.any(|port| port.direction == direction)
    };
    let may_fail = task.flags.iter().any(|flag| flag.name == "failed");
    has(Direction::InOut) && !has(Direction::Out) && may_fail
}

/// Hash of a task's signature, by which requests name it.
pub fn signature_hash(task: &Task) -> u64 {
    esm_core::signature::fnv1a(crate::compile::signature::text(task).as_bytes())
}

/// The name of a task in a script: `turn_to` of `TurnTo`.
pub fn script_name(name: &str) -> String {
    let mut text = String::new();
    for letter in name.chars() {
        if letter.is_uppercase() && !text.is_empty() {
            text.push('_');
        }
        text.extend(letter.to_lowercase());
    }
    text
}
