//! Models made by hand, for tests of what comes behind the language front end.

use crate::model::{
    Action, Container, ContainerEvent, DataPort, Direction, Flag, Guard, Model, Param, ParamType,
    Path, PathEnd, Region, Slot, SlotRef, Source, Span, State, StateKind, Target, Task, Transition,
    Trigger, Value,
};

/// Shorthand for parts of a model that carry no place in a file.
pub fn state(name: &str, kind: StateKind) -> State {
    State {
        name: name.to_owned(),
        kind,
        timeout_us: None,
        docs: String::new(),
        span: Span::default(),
        declaration: Span::default(),
    }
}

/// A simple state.
pub fn simple(name: &str) -> State {
    state(name, StateKind::Simple)
}

/// A simple state with a timeout.
pub fn limited(name: &str, timeout_us: u32) -> State {
    State {
        timeout_us: Some(timeout_us),
        ..simple(name)
    }
}

/// A task state without parameters.
pub fn task_state(name: &str, task: usize, slot: SlotRef) -> State {
    let params = Vec::new();
    state(name, StateKind::Task { task, slot, params })
}

/// A superstate.
pub fn superstate(name: &str, container: usize) -> State {
    state(name, StateKind::Super { container })
}

/// A transition between states on the pulse; `None` is a pseudo-state.
pub fn pulse(from: Option<usize>, to: Option<usize>) -> Transition {
    Transition {
        source: from.map_or(Source::Initial, Source::State),
        target: to.map_or(Target::Final, Target::State),
        trigger: Trigger::Pulse,
        guard: None,
        actions: Vec::new(),
        span: Span::default(),
    }
}

impl Transition {
    /// The same on another trigger.
    pub fn on(self, trigger: Trigger) -> Self {
        Self { trigger, ..self }
    }

    /// The same on an event.
    pub fn on_event(self, event: usize) -> Self {
        self.on(Trigger::Event(event))
    }

    /// The same with a guard.
    pub fn if_(self, guard: Guard) -> Self {
        let guard = Some(guard);
        Self { guard, ..self }
    }

    /// The same with one more action.
    pub fn act(mut self, action: Action) -> Self {
        self.actions.push(action);
        self
    }
}

/// A region.
pub fn region(name: &str, states: Vec<State>, transitions: Vec<Transition>) -> Region {
    Region {
        name: name.to_owned(),
        states,
        transitions,
        docs: String::new(),
        span: Span::default(),
    }
}

/// A container with these events: index, `in`, `out`.
pub fn container(name: &str, events: &[(usize, bool, bool)], regions: Vec<Region>) -> Container {
    let events = events
        .iter()
        .map(|(event, forwarded_in, forwarded_out)| ContainerEvent {
            event: *event,
            forwarded_in: *forwarded_in,
            forwarded_out: *forwarded_out,
            span: Span::default(),
        });
    Container {
        name: name.to_owned(),
        is_machine: false,
        events: events.collect(),
        flags: Vec::new(),
        data: Vec::new(),
        regions,
        paths: Vec::new(),
        docs: String::new(),
        span: Span::default(),
    }
}

/// A flag.
pub fn flag(name: &str, direction: Direction) -> Flag {
    Flag {
        name: name.to_owned(),
        direction,
        docs: String::new(),
        span: Span::default(),
    }
}

/// A data port.
pub fn port(name: &str, direction: Direction, type_name: &str) -> DataPort {
    DataPort {
        name: name.to_owned(),
        direction,
        type_name: type_name.to_owned(),
        optional: false,
        within_us: None,
        docs: String::new(),
        span: Span::default(),
    }
}

/// A task with flags.
pub fn task(name: &str, flags: Vec<Flag>) -> Task {
    Task {
        name: name.to_owned(),
        slot: None,
        wcet_us: None,
        exclusive: None,
        count: None,
        endless: false,
        data: Vec::new(),
        flags,
        params: Vec::new(),
        dispatcher: None,
        docs: String::new(),
        span: Span::default(),
    }
}

/// A model whose machine is container 0, with an interpreter slot of 1 ms and a second slot behind
/// it.
pub fn model(events: &[&str], tasks: Vec<Task>, containers: Vec<Container>) -> Model {
    let slot = |number| Slot {
        number,
        period_us: 1_000,
        duration_us: 100,
        docs: String::new(),
        span: Span::default(),
    };
    Model {
        files: Vec::new(),
        machine: Some(0),
        interpreter_slot: Some(0),
        queue: 32,
        events: events.iter().map(|name| (*name).to_owned()).collect(),
        slots: vec![slot(1), slot(2)],
        tasks,
        containers,
        links: Vec::new(),
        frames: Vec::new(),
    }
}

/// The start times that go with [`model`].
pub const STARTS_US: [u32; 2] = [0, 100];

/// The composite CD player of `tests/data/cd51.esm`.
pub fn cd_player() -> Model {
    const EVENTS: [&str; 8] = [
        "Play",
        "EndPause",
        "Stop",
        "Pause",
        "OpenClose",
        "Cd",
        "Next",
        "Prev",
    ];
    let on = |from, to, event| pulse(Some(from), Some(to)).on_event(event);
    let songs = region(
        "song",
        vec![simple("One"), simple("Two"), simple("Three")],
        vec![
            pulse(None, Some(0)),
            on(0, 1, 6),
            on(1, 2, 6),
            on(1, 0, 7),
            on(2, 1, 7),
        ],
    );
    let player = region(
        "player",
        vec![
            simple("Empty"),
            simple("Open"),
            simple("Stopped"),
            simple("Paused"),
            superstate("Playing", 1),
        ],
        vec![
            pulse(None, Some(0)),
            on(0, 1, 4),
            on(0, 2, 5),
            on(1, 0, 4),
            on(2, 4, 0),
            on(2, 1, 4),
            on(2, 2, 2),
            on(4, 2, 2),
            on(4, 3, 3),
            on(4, 1, 4),
            on(3, 4, 1),
            on(3, 2, 2),
            on(3, 1, 4),
        ],
    );
    let mut presses = vec![pulse(None, Some(0))];
    for button in 0..EVENTS.len() {
        presses.push(
            pulse(Some(0), Some(0))
                .if_(Guard::Own(button))
                .act(Action::Send(button)),
        );
    }
    let input = region(
        "input",
        vec![task_state("Panel", 0, SlotRef::Slot(1))],
        presses,
    );
    let names = [
        "play",
        "end_pause",
        "stop",
        "pause",
        "open_close",
        "cd",
        "next",
        "prev",
    ];
    let flags = names.map(|name| flag(name, Direction::Out)).to_vec();
    let all = [0, 1, 2, 3, 4, 5, 6, 7].map(|event| (event, false, false));
    model(
        &EVENTS,
        vec![task("Buttons", flags)],
        vec![
            container("CdPlayer", &all, vec![player, input]),
            container("Songs", &[(6, true, false), (7, true, false)], vec![songs]),
        ],
    )
}

/// A machine that uses everything that a blob can hold: nested instances of one container,
/// parameters, nets over container borders, exclusive groups, background tasks, guards of all
/// kinds, visibility with gaps.
pub fn everything() -> Model {
    let mut drive = task(
        "Drive",
        vec![flag("go", Direction::In), flag("near", Direction::Out)],
    );
    drive.data = vec![
        port("scan", Direction::In, "Scan"),
        port("cmd", Direction::Out, "Twist"),
    ];
    drive.params = vec![Param {
        name: "speed".to_owned(),
        param_type: ParamType::F32,
        default: None,
        range: None,
        docs: String::new(),
        span: Span::default(),
    }];
    drive.exclusive = Some("motors".to_owned());
    let mut sonar = task("Sonar", Vec::new());
    sonar.data = vec![port("scan", Direction::Out, "Scan")];
    let driving = |name: &str, speed| {
        let params = vec![Value::F32(speed)];
        let slot = SlotRef::Slot(1);
        let task = 0;
        state(name, StateKind::Task { task, slot, params })
    };
    let own = Guard::Own;
    let mut leg = container(
        "Leg",
        &[(0, true, false), (1, false, true), (2, false, false)],
        vec![
            region(
                "turn",
                vec![
                    driving("Back", -0.25),
                    limited("Wait", 5_000),
                    task_state("Log", 1, SlotRef::NonRealTime),
                ],
                vec![
                    pulse(None, Some(0)).act(Action::Own(0, true)),
                    pulse(Some(0), Some(1))
                        .if_(Guard::Or(vec![
                            Guard::And(vec![own(1), Guard::Not(Box::new(Guard::Parent(0)))]),
                            Guard::And(vec![
                                Guard::Exit,
                                Guard::Or(vec![Guard::Timeout, Guard::Busy]),
                            ]),
                        ]))
                        .act(Action::Send(1))
                        .act(Action::Parent(1, true)),
                    pulse(Some(0), Some(2)).on_event(0),
                    pulse(Some(1), None).if_(Guard::Timeout),
                    pulse(Some(2), Some(0)).on(Trigger::Star),
                ],
            ),
            region(
                "watch",
                vec![simple("Seen")],
                vec![pulse(None, Some(0)).on_event(2).act(Action::Send(2))],
            ),
        ],
    );
    leg.flags = vec![flag("hurry", Direction::In), flag("done", Direction::Out)];
    leg.data = vec![
        port("scan", Direction::In, "Scan"),
        port("cmd", Direction::Out, "Twist"),
    ];
    let inner = |state, port| PathEnd::State {
        region: 0,
        state,
        port,
    };
    let path = |from: PathEnd, to: PathEnd| Path {
        from: vec![from],
        to: vec![to],
        span: Span::default(),
    };
    leg.paths = vec![
        path(PathEnd::Container { port: 0 }, inner(0, 0)),
        path(inner(0, 1), PathEnd::Container { port: 1 }),
    ];
    let pair = container(
        "Pair",
        &[(0, true, false), (1, false, true)],
        vec![region(
            "both",
            vec![superstate("Left", 1), superstate("Right", 1)],
            vec![
                pulse(None, Some(0)),
                pulse(Some(0), Some(1))
                    .if_(Guard::Not(Box::new(Guard::Busy)))
                    .act(Action::Own(0, true)),
                pulse(Some(1), None).if_(Guard::And(vec![Guard::Exit, own(1)])),
            ],
        )],
    );
    let mut root = container(
        "Rover",
        &[(0, false, false), (1, false, false)],
        vec![
            region(
                "motion",
                vec![superstate("First", 1), superstate("Nested", 2)],
                vec![
                    pulse(None, Some(0)),
                    pulse(Some(0), Some(1)).on_event(1),
                    pulse(Some(1), Some(0)).on(Trigger::Star),
                ],
            ),
            region(
                "sense",
                vec![task_state("Ring", 1, SlotRef::Slot(1))],
                vec![
                    pulse(None, Some(0)),
                    pulse(Some(0), Some(0))
                        .on(Trigger::Star)
                        .act(Action::Send(0)),
                ],
            ),
        ],
    );
    let sensed = PathEnd::State {
        region: 1,
        state: 0,
        port: 0,
    };
    root.paths = vec![path(sensed, inner(0, 0))];
    model(
        &["Halt", "Done", "Tick"],
        vec![drive, sonar],
        vec![root, leg, pair],
    )
}
