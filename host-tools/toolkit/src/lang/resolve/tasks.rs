//! Tasks: ports, parameters, attributes.

use std::collections::HashMap;

use crate::lang::analysis::holes::TaskHoles;
use crate::lang::diagnostic::{Code, Diagnostic, Fix};
use crate::lang::parser::excerpt;
use crate::lang::references::Undeclared;
use crate::lang::tree::{self, Given, Literal, Number};
use crate::model::{Direction, Model, Param, ParamType, SlotRef, Task, Value};

use super::declarations::{Trees, declare_data, declare_flags};
use super::demand::Demands;
use super::literals::{self, Misfit, Written};
use super::scope::{Names, Scope};
use super::slots::SlotTable;

/// The name space of tasks, and what else is known of each than its model.
pub(super) struct TaskTable<'f> {
    pub(super) names: Scope<'f>,
    facts: Vec<TaskFacts<'f>>,
    /// What is not known of the dispatchers, whose tasks stand behind those of files.
    dispatchers: Vec<TaskHoles>,
}

/// What else is known of a task than its model.
pub(super) struct TaskFacts<'f> {
    pub(super) flags: Scope<'f>,
    /// Direction of each flag of the model; `None` where it could not be read.
    pub(super) flag_directions: Vec<Option<Direction>>,
    pub(super) data: Scope<'f>,
    pub(super) params: Scope<'f>,
    /// Per parameter of the model.
    pub(super) param_facts: Vec<ParamFacts>,
    /// The slot that the declaration names; [`Given::Broken`] also where that is no slot.
    pub(super) slot: Given<SlotRef>,
    /// From the word on.
    pub(super) span: crate::model::Span,
}

/// What is known of a parameter.
#[derive(Clone, Copy, Debug)]
pub(super) struct ParamFacts {
    /// Its type, where that could be read.
    pub(super) param_type: Option<ParamType>,
    /// Whether it has a default value, right or wrong.
    pub(super) has_default: bool,
}

impl TaskFacts<'_> {
    /// Those of a task without anything.
    pub(super) fn new(span: crate::model::Span) -> Self {
        TaskFacts {
            flags: Scope::default(),
            flag_directions: Vec::new(),
            data: Scope::default(),
            params: Scope::default(),
            param_facts: Vec::new(),
            slot: Given::Absent,
            span,
        }
    }
}

impl<'f> TaskTable<'f> {
    /// Declares the tasks of all files.
    pub(super) fn declare(
        set: &Trees<'f>,
        slots: &SlotTable,
        model: &mut Model,
        names: &mut Names<'f, '_>,
    ) -> Self {
        let mut table = TaskTable {
            names: Scope::default(),
            facts: Vec::new(),
            dispatchers: Vec::new(),
        };
        if set.is_incomplete() {
            table.names.is_incomplete();
        }
        for (index, tree) in set.tasks().enumerate() {
            names.declare(&mut table.names, tree.name, index, "task");
            let (task, facts) = declare_task(tree, slots, names);
            check_wcet(&task, &facts, slots, model, names);
            model.tasks.push(task);
            table.facts.push(facts);
        }
        for file in set.trees {
            table.names.may_hide(names, &file.skipped, file.is_cut);
        }
        table.report_unknown_slots(set, slots, names);
        table
    }

    /// Reports slots that are not declared, at the first task that is used and names one. A
    /// library's tasks name slots of their own; those that a mission does not use cost it nothing.
    fn report_unknown_slots(&self, set: &Trees<'f>, slots: &SlotTable, names: &mut Names<'f, '_>) {
        let wanted: HashMap<&str, (Number, u32)> = self.wanted_slots(set, names);
        if wanted.is_empty() {
            return;
        }
        let demands = Demands::of(set, &wanted, names);
        let trees = set.tasks();
        for name in trees.filter_map(|tree| tree.name) {
            let name = names.text(name.0);
            if let Some(&(number, _)) = wanted.get(name)
                && let Some(demand) = demands.get(number.value, name)
            {
                slots.report_unknown(number, demand, names);
            }
        }
    }

    /// By name, the tasks whose slots are not declared: the slot and the worst execution time.
    fn wanted_slots(
        &self,
        set: &Trees<'f>,
        names: &Names<'f, '_>,
    ) -> HashMap<&'f str, (Number, u32)> {
        let trees = set.tasks();
        let mut wanted = HashMap::new();
        for (index, (tree, facts)) in trees.zip(&self.facts).enumerate() {
            if let (Some(name), Given::Value(number), Given::Broken) =
                (tree.name, tree.slot, facts.slot)
            {
                let name = names.text(name.0);
                if self.names.is_first(name, index) {
                    wanted.insert(name, (number, tree.wcet_us.value().unwrap_or(0)));
                }
            }
        }
        wanted
    }

    /// What is not known of each task.
    pub(super) fn holes(&self, set: &Trees<'f>, names: &Names<'f, '_>) -> Vec<TaskHoles> {
        let trees = set.tasks();
        trees
            .enumerate()
            .map(|(index, tree)| TaskHoles {
                declarations: tree.has_gaps
                    || tree.is_cut
                    || !tree.skipped.is_empty()
                    || tree
                        .flags
                        .iter()
                        .any(|flag| flag.name.is_none() || flag.direction.is_none())
                    || tree
                        .data
                        .iter()
                        .any(|port| port.name.is_none() || port.type_name.is_none())
                    || tree
                        .params
                        .iter()
                        .any(|param| param.name.is_none() || param.param_type.is_none()),
                is_twin: tree
                    .name
                    .is_none_or(|name| !self.names.is_first(names.text(name.0), index)),
            })
            .chain(self.dispatchers.iter().cloned())
            .collect()
    }

    /// Adds the task of a dispatcher.
    pub(super) fn push_dispatcher(&mut self, mut facts: TaskFacts<'f>, holes: TaskHoles) {
        if holes.declarations {
            facts.flags.is_incomplete();
            facts.data.is_incomplete();
        }
        self.facts.push(facts);
        self.dispatchers.push(holes);
    }

    /// What is known of the task with an index.
    pub(super) fn facts(&self, index: usize) -> Option<&TaskFacts<'f>> {
        self.facts.get(index)
    }
}

fn declare_task<'f>(
    tree: &'f tree::Task,
    slots: &SlotTable,
    names: &mut Names<'f, '_>,
) -> (Task, TaskFacts<'f>) {
    let slot = match tree.slot {
        Given::Absent => Given::Absent,
        Given::Broken => Given::Broken,
        Given::Value(number) => Given::from_read(slots.find(number, names)),
    };
    let mut facts = TaskFacts {
        slot,
        ..TaskFacts::new(tree.span)
    };
    let data = declare_data(&tree.data, &mut facts.data, names);
    let (flags, flag_directions) = declare_flags(&tree.flags, &mut facts.flags, names);
    facts.flag_directions = flag_directions;
    let mut params = Vec::with_capacity(tree.params.len());
    for (index, param) in tree.params.iter().enumerate() {
        names.declare(&mut facts.params, param.name, index, "parameter");
        params.push(declare_param(param, names));
        facts.param_facts.push(ParamFacts {
            param_type: param.param_type,
            has_default: param.default.is_given(),
        });
    }
    for scope in [&mut facts.flags, &mut facts.data, &mut facts.params] {
        scope.may_hide(names, &tree.skipped, tree.is_cut);
    }
    names.mention(Undeclared::Group, tree.exclusive.value());
    let span = tree.name.map_or(tree.span, |name| name.0);
    let task = Task {
        name: names.text(span).to_owned(),
        slot: slot.value(),
        wcet_us: tree.wcet_us.value(),
        exclusive: tree
            .exclusive
            .value()
            .map(|name| names.text(name.0).to_owned()),
        count: tree.count.value(),
        endless: tree.endless,
        data,
        flags,
        params,
        dispatcher: None,
        docs: names.docs(tree.docs),
        span,
    };
    (task, facts)
}

fn declare_param(tree: &tree::Param, names: &mut Names<'_, '_>) -> Param {
    let name = tree.name.map_or("", |name| names.text(name.0));
    let mut param = Param {
        name: name.to_owned(),
        param_type: tree.param_type.unwrap_or(ParamType::Bool),
        default: None,
        range: None,
        docs: names.docs(tree.docs),
        span: tree.span,
    };
    if tree.param_type.is_none() {
        return param;
    }
    if let Some((least, greatest)) = tree.range.value() {
        let values = (
            read_value(least, &param, names),
            read_value(greatest, &param, names),
        );
        if let (Some(least_value), Some(greatest_value)) = values {
            if literals::is_within(least_value, (least_value, greatest_value)) {
                param.range = Some((least_value, greatest_value));
            } else {
                let message = format!(
                    "the range of parameter `{name}` is empty: its `max` {} is below its `min` {}",
                    Written(greatest_value),
                    Written(least_value)
                );
                names.report(
                    Diagnostic::new(Code::E009, greatest.span, message)
                        .hint("swap the two")
                        .related(least.span, "the `min`"),
                );
            }
        }
    }
    if let Some(default) = tree.default.value() {
        param.default = read_value(default, &param, names);
    }
    param
}

/// Reads a literal as a value of a parameter; one that does not fit is reported.
pub(super) fn read_value(
    literal: Literal,
    param: &Param,
    names: &mut Names<'_, '_>,
) -> Option<Value> {
    let digits = names.text(literal.digits);
    let type_word = literals::type_word(param.param_type);
    let diagnostic = match literals::value(literal, digits, param.param_type) {
        Ok(value) => match param.range {
            Some((least, greatest)) if !literals::is_within(value, (least, greatest)) => {
                Diagnostic::new(
                    Code::E009,
                    literal.span,
                    format!(
                        "{} is out of the range of parameter `{}`",
                        Written(value),
                        param.name
                    ),
                )
                .hint(format!(
                    "write a value from {} to {}",
                    Written(least),
                    Written(greatest)
                ))
                .related(param.span, "the parameter")
                .fix(Fix::write(
                    literal.span,
                    literals::nearest_in(value, (least, greatest)).to_string(),
                ))
            }
            _ => return Some(value),
        },
        Err(misfit) => {
            let found = excerpt(names.text(literal.span));
            let message = match misfit {
                Misfit::Kind => {
                    format!(
                        "parameter `{}` is of type {type_word}, {found} is not",
                        param.name
                    )
                }
                Misfit::Size => format!(
                    "{found} is out of the range of {type_word}, the type of parameter `{}`",
                    param.name
                ),
            };
            let mut diagnostic = Diagnostic::new(Code::E009, literal.span, message)
                .hint(literals::how_to_write(param.param_type))
                .related(param.span, "the parameter");
            if let Some(meant) = literals::meant(digits, param.param_type) {
                diagnostic = diagnostic.fix(Fix::write(literal.span, meant));
            }
            diagnostic
        }
    };
    names.report(diagnostic);
    None
}

/// A task must fit the slot that its declaration names.
fn check_wcet(
    task: &Task,
    facts: &TaskFacts<'_>,
    slots: &SlotTable,
    model: &Model,
    names: &mut Names<'_, '_>,
) {
    if let (Some(wcet_us), Some(SlotRef::Slot(slot))) = (task.wcet_us, task.slot)
        && let Some((_, duration_us)) = slots.times_us(model, slot)
        && wcet_us > duration_us
    {
        let number = model.slots.get(slot).map_or(0, |slot| slot.number);
        let message = format!(
            "task `{}` takes up to {wcet_us} us, slot {number} lasts {duration_us} us",
            task.name
        );
        let mut diagnostic = Diagnostic::new(Code::E010, facts.span, message).hint(format!(
            "give slot {number} a longer duration, or the task another slot"
        ));
        if let Some(slot) = model.slots.get(slot) {
            diagnostic = diagnostic.related(slot.span, "the slot");
        }
        names.report(diagnostic);
    }
}
