//! What models report, from macro step to macro step, and the values on nets that they make.

use std::collections::BTreeMap;

use crate::scenario::bind::Report;
use crate::scenario::models::{By, Does, Kept, Model, Side};
use crate::trace::directory::StateId;

/// The models of a run, with what they remember.
#[derive(Debug, Default)]
pub(super) struct Models<'s> {
    models: Vec<Remembering<'s>>,
    /// The last value that was written to each net.
    values: BTreeMap<usize, f64>,
}

#[derive(Debug)]
struct Remembering<'s> {
    model: &'s Model,
    /// When its state was entered last, in microseconds.
    entered_us: Option<u64>,
    /// It has reported what it reports once.
    has_reported: bool,
    /// What it keeps set is set.
    is_set: Option<bool>,
}

/// Something that a model reports.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reported {
    /// The model's line of the scenario.
    pub line: usize,
    /// Whether it is anything new, and worth to be told of.
    pub is_new: bool,
    /// Index of the task instance.
    pub task: usize,
    pub report: Report,
}

impl<'s> Models<'s> {
    pub fn new(models: &'s [Model]) -> Self {
        let models = models.iter().map(|model| Remembering {
            model,
            entered_us: None,
            has_reported: false,
            is_set: None,
        });
        Self {
            models: models.collect(),
            values: BTreeMap::new(),
        }
    }

    pub fn is_empty(&self) -> bool {
        self.models.is_empty()
    }

    /// The state of this path was entered in the macro step at a time, in microseconds.
    pub fn entered(&mut self, path: &str, t_us: u64) {
        for remembering in &mut self.models {
            if remembering.model.path == path {
                remembering.entered_us = Some(t_us);
                remembering.has_reported = false;
                remembering.is_set = None;
            }
        }
    }

    /// What the models of current states report before the macro step at a time, in the order of
    /// the file. What one writes to a net, those behind it read.
    pub fn report(&mut self, t_us: u64, is_current: impl Fn(StateId) -> bool) -> Vec<Reported> {
        let mut reported = Vec::new();
        for remembering in &mut self.models {
            let Model {
                line,
                state,
                task,
                does,
                ..
            } = remembering.model;
            let Some(entered_us) = remembering.entered_us.filter(|_| is_current(*state)) else {
                continue;
            };
            let since_us = t_us.saturating_sub(entered_us);
            let (report, is_new) = match does {
                Does::Data { net, by, table } => {
                    let x = match by {
                        By::Time => Some(since_us as f64 / 1e6),
                        By::Net(net) => self.values.get(net).copied(),
                    };
                    if let Some(x) = x {
                        self.values.insert(*net, table.at(x));
                    }
                    continue;
                }
                Does::After { time_us, report } => {
                    if remembering.has_reported || since_us < *time_us {
                        continue;
                    }
                    remembering.has_reported = true;
                    (*report, true)
                }
                Does::While {
                    net,
                    side,
                    limit,
                    kept,
                } => {
                    // Nobody knows of a value that nothing has written.
                    let Some(value) = self.values.get(net) else {
                        continue;
                    };
                    let is_set = match side {
                        Side::Below => value < limit,
                        Side::Above => value > limit,
                    };
                    let is_new = remembering.is_set.replace(is_set).unwrap_or(false) != is_set;
                    let report = match kept {
                        Kept::Flag(flag) => Report::Flag {
                            flag: *flag,
                            value: is_set,
                        },
                        Kept::Busy => Report::Busy(is_set),
                        Kept::Exit if is_set && is_new => Report::Exit,
                        Kept::Exit => continue,
                    };
                    (report, is_new)
                }
            };
            reported.push(Reported {
                line: *line,
                is_new,
                task: *task,
                report,
            });
        }
        reported
    }
}
