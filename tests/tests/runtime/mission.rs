//! Missions of one flat machine, written in few lines.

use host_tools::compile::compile;
use host_tools::model::{
    Action, Container, DataPort, Direction, Flag, Guard, Model, Param, ParamType, Path, PathEnd,
    Region, Slot, SlotRef, Source, Span, State, StateKind, Target, Task, Transition, Trigger,
    Value,
};

/// By which a robot knows this mission.
pub fn hash(blob: &[u8]) -> u32 {
    u32::from_le_bytes(*blob.last_chunk().expect("a blob ends with its hash"))
}

/// A mission in the making.
pub struct Mission {
    model: Model,
    starts_us: Vec<u32>,
}

const NOWHERE: Span = Span {
    file: 0,
    start: 0,
    end: 0,
};

impl Mission {
    /// A mission with these slots, (period, duration, start) in µs, numbered from 1; the first runs
    /// the interpreter.
    pub fn new(slots: &[(u32, u32, u32)]) -> Self {
        let model = Model {
            machine: Some(0),
            interpreter_slot: Some(0),
            queue: 4,
            events: vec!["Again".into()],
            slots: slots
                .iter()
                .zip(1..)
                .map(|((period_us, duration_us, _), number)| Slot {
                    number,
                    period_us: *period_us,
                    duration_us: *duration_us,
                    docs: String::new(),
                    span: NOWHERE,
                })
                .collect(),
            containers: vec![Container {
                name: "Test".into(),
                is_machine: true,
                events: vec![host_tools::model::ContainerEvent {
                    event: 0,
                    forwarded_in: false,
                    forwarded_out: false,
                    span: NOWHERE,
                }],
                flags: vec![],
                data: vec![],
                regions: vec![],
                paths: vec![],
                docs: String::new(),
                span: NOWHERE,
            }],
            ..Model::default()
        };
        Mission {
            model,
            starts_us: slots.iter().map(|slot| slot.2).collect(),
        }
    }

    /// Another slot, by its index, runs the interpreter.
    pub fn interpreter(mut self, slot: usize) -> Self {
        self.model.interpreter_slot = Some(slot);
        self
    }

    /// Declares a task by its signature, as `Registry` has it.
    pub fn task(mut self, signature: &str, exclusive: Option<&str>) -> Self {
        let (name, ports) = signature
            .strip_prefix("task ")
            .and_then(|rest| rest.split_once('{'))
            .expect("a signature");
        let mut task = Task {
            name: name.into(),
            slot: None,
            wcet_us: None,
            exclusive: exclusive.map(Into::into),
            count: None,
            endless: false,
            data: vec![],
            flags: vec![],
            params: vec![],
            dispatcher: None,
            docs: String::new(),
            span: NOWHERE,
        };
        for port in ports.trim_end_matches('}').split_terminator(';') {
            let words: Vec<&str> = port.split([' ', ':']).collect();
            let direction = match words[0] {
                "in" => Direction::In,
                "inout" => Direction::InOut,
                _ => Direction::Out,
            };
            match words[..] {
                ["param", name, param_type] => task.params.push(Param {
                    name: name.into(),
                    param_type: match param_type {
                        "u32" => ParamType::U32,
                        other => panic!("parameters here are u32, not {other}"),
                    },
                    default: None,
                    range: None,
                    docs: String::new(),
                    span: NOWHERE,
                }),
                [_, "flag", name] => task.flags.push(Flag {
                    name: name.into(),
                    direction,
                    docs: String::new(),
                    span: NOWHERE,
                }),
                [_, "data", name, type_name, ref rest @ ..] => task.data.push(DataPort {
                    name: name.into(),
                    direction,
                    type_name: type_name.into(),
                    optional: rest.contains(&"optional"),
                    within_us: rest
                        .iter()
                        .position(|word| *word == "within")
                        .map(|at| rest[at + 1].parse().expect("microseconds")),
                    docs: String::new(),
                    span: NOWHERE,
                }),
                _ => panic!("{port}"),
            }
        }
        self.model.tasks.push(task);
        self
    }

    /// A region. States are `(name, task, slot, parameters)`, an empty task making a simple state.
    /// Transitions are `A -> B`, then `[exit]`, `[busy]` or `[FLAG]` of A's task, then `on Again`,
    /// then `/ Again`, each or none.
    pub fn region(mut self, states: &[(&str, &str, u32, &[u32])], transitions: &[&str]) -> Self {
        let tasks = &self.model.tasks;
        let place = |name: &str| states.iter().position(|state| state.0 == name).expect(name);
        let task_of = |state: usize| tasks.iter().position(|task| task.name == states[state].1);
        let region = Region {
            name: format!("region{}", self.model.containers[0].regions.len()),
            docs: String::new(),
            states: states
                .iter()
                .map(|(name, task, slot, params)| State {
                    name: (*name).into(),
                    kind: match tasks.iter().position(|declared| declared.name == *task) {
                        None => StateKind::Simple,
                        Some(task) => StateKind::Task {
                            task,
                            slot: match slot {
                                0 => SlotRef::NonRealTime,
                                number => SlotRef::Slot(*number as usize - 1),
                            },
                            params: params.iter().map(|value| Value::U32(*value)).collect(),
                        },
                    },
                    timeout_us: None,
                    docs: String::new(),
                    span: NOWHERE,
                    declaration: NOWHERE,
                })
                .collect(),
            transitions: transitions
                .iter()
                .map(|text| {
                    let words: Vec<&str> = text.split_whitespace().collect();
                    let [from, "->", to, ref rest @ ..] = words[..] else {
                        panic!("{text}")
                    };
                    let source = if from == "initial" {
                        Source::Initial
                    } else {
                        Source::State(place(from))
                    };
                    let guard = rest
                        .iter()
                        .find_map(|word| word.strip_prefix('['))
                        .map(|word| match word.trim_end_matches(']') {
                            "exit" => Guard::Exit,
                            "busy" => Guard::Busy,
                            flag => {
                                let task = &tasks[task_of(place(from)).expect("a task state")];
                                Guard::Own(
                                    task.flags
                                        .iter()
                                        .position(|declared| declared.name == flag)
                                        .expect(flag),
                                )
                            }
                        });
                    Transition {
                        source,
                        target: Target::State(place(to)),
                        trigger: if rest.contains(&"on") {
                            Trigger::Event(0)
                        } else {
                            Trigger::Pulse
                        },
                        guard,
                        actions: if rest.contains(&"/") {
                            vec![Action::Send(0)]
                        } else {
                            vec![]
                        },
                        span: NOWHERE,
                    }
                })
                .collect(),
            span: NOWHERE,
        };
        self.model.containers[0].regions.push(region);
        self
    }

    /// Declares the task of a region's first state once more, and gives it to that state, as no
    /// compiler of files would.
    pub fn declared_twice(mut self, region: usize) -> Self {
        let state = &mut self.model.containers[0].regions[region].states[0];
        let StateKind::Task { task, .. } = &mut state.kind else {
            panic!("{} is a task state", state.name)
        };
        self.model.tasks.push(self.model.tasks[*task].clone());
        *task = self.model.tasks.len() - 1;
        self
    }

    /// Joins two ports, each (region, state, data port).
    pub fn path(mut self, from: (usize, usize, usize), to: (usize, usize, usize)) -> Self {
        let end = |(region, state, port)| PathEnd::State {
            region,
            state,
            port,
        };
        self.model.containers[0].paths.push(Path {
            from: vec![end(from)],
            to: vec![end(to)],
            span: NOWHERE,
        });
        self
    }

    /// The blob.
    pub fn blob(&self) -> Vec<u8> {
        compile(&self.model, &self.starts_us).expect("the mission is right")
    }
}
