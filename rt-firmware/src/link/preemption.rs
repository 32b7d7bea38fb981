//! Lets interrupts come in tests, at each place where one side looks at what it shares with others:
//! every order of a stop, what else is asked for, and the slots' turns is tried.

use core::cell::{Cell, RefCell};
use std::boxed::Box;
use std::collections::VecDeque;
use std::rc::Rc;
use std::vec::Vec;

use super::device::{LinkPort, LinkSide};
use super::stop_listener::StopListener;
use crate::{About, AnyTaskPool, Board, Limits, Mailbox, Memory, RealTime, split};
use esm_link::frame::{DELIMITER, FrameReader, MAX_FRAME_BYTES, decode, encode};
use esm_link::message::{FromDevice, LinkError, Mode, Request, Response, ToDevice};

std::thread_local! {
    static INTERRUPTED: RefCell<Option<Rc<Interrupts>>> = const { RefCell::new(None) };
}

/// A place where an interrupt may come.
pub(crate) fn point() {
    let interrupts = INTERRUPTED.with_borrow(Clone::clone);
    if let Some(interrupts) = interrupts {
        interrupts.point();
    }
}

/// Who has the processor. A later one interrupts an earlier one.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd)]
enum Level {
    Link,
    Line,
    Slots,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Interrupt {
    /// The next frame comes off the line, as a whole.
    Frame,
    /// The slot timer's.
    Timer,
}

const SLOTS: usize = 4;

/// All but the link.
struct Interrupts {
    level: Cell<Level>,
    /// Points so far.
    points: Cell<usize>,
    /// What comes at which point, or as soon as it can from there on.
    schedule: RefCell<VecDeque<(usize, Interrupt)>>,
    frames: RefCell<VecDeque<Vec<u8>>>,
    listener: RefCell<StopListener<'static>>,
    /// Between the interrupt and the link.
    queue: RefCell<VecDeque<u8>>,
    room: Cell<usize>,
    real_time: RefCell<RealTime<'static, 'static>>,
    /// The line's interrupt has called the slots.
    is_called: Cell<bool>,
    /// The last byte of the last stop has come.
    stop_came: Cell<bool>,
    /// The robot must stand still after it, whatever else is done.
    stays: Cell<bool>,
}

struct Timer;

impl Board for Timer {
    const TICKS_PER_US: u32 = 1;
    fn now_ticks(&mut self) -> u64 {
        1_000
    }
    fn motors_off(&mut self) {}
}

impl Interrupts {
    fn point(&self) {
        let level = self.level.get();
        if level == Level::Slots {
            return;
        }
        self.points.set(self.points.get() + 1);
        loop {
            let next = self.schedule.borrow().front().copied();
            let Some((at, what)) = next.filter(|(at, _)| *at <= self.points.get()) else {
                return;
            };
            let _ = at;
            if what == Interrupt::Frame && level >= Level::Line {
                return;
            }
            self.schedule.borrow_mut().pop_front();
            match what {
                Interrupt::Frame => self.take_frame(),
                Interrupt::Timer => self.slots(),
            }
        }
    }

    fn take_frame(&self) {
        let Some(frame) = self.frames.borrow_mut().pop_front() else {
            return;
        };
        self.level.set(Level::Line);
        for byte in frame {
            let is_kept = self.queue.borrow().len() < self.room.get();
            if is_kept {
                self.queue.borrow_mut().push_back(byte);
            }
            if self.listener.borrow_mut().hear(byte, is_kept) {
                self.stop_came.set(true);
                self.is_called.set(true);
            }
        }
        // Pended, it comes as soon as nothing above it runs.
        if self.is_called.take() {
            self.slots();
        }
        self.level.set(Level::Link);
    }

    fn slots(&self) {
        let level = self.level.replace(Level::Slots);
        self.real_time.borrow_mut().on_timer(&mut Timer);
        if self.stop_came.get() && self.stays.get() {
            assert!(self.mode().is_latched(), "a stop was undone");
        }
        self.level.set(level);
    }

    fn mode(&self) -> Mode {
        self.real_time.borrow().mode()
    }
}

/// The link's port.
struct Port {
    interrupts: Rc<Interrupts>,
    /// Whether the link calls the slots.
    wakes: bool,
    sent: Vec<u8>,
    /// The mode when the last frame began.
    mode: Mode,
    answers: Vec<(u8, Result<(), LinkError>, Mode)>,
    reader: FrameReader,
}

impl LinkPort for Port {
    fn now_us(&mut self) -> u64 {
        point();
        1_000
    }

    fn receive(&mut self) -> Option<u8> {
        point();
        self.interrupts.queue.borrow_mut().pop_front()
    }

    fn send(&mut self, byte: u8) -> bool {
        if self.sent.is_empty() {
            self.mode = self.interrupts.mode();
        }
        self.sent.push(byte);
        if let Some(frame) = self.reader.push(byte) {
            if let Ok(FromDevice::Reply { seq, result, .. }) = decode(frame) {
                let result = result.map(|answer| assert_eq!(answer, Response::Done));
                self.answers.push((seq, result, self.mode));
            }
            self.sent.clear();
        }
        point();
        true
    }

    fn wake_real_time(&mut self) {
        if self.wakes {
            self.interrupts.slots();
        }
    }
}

/// A robot without a mission, for as long as the process lives: the order in which things come is
/// new each time, and the robot is not.
struct Robot {
    link: LinkSide<'static, 'static>,
    port: Port,
}

impl Robot {
    fn new() -> Self {
        let memory = Box::leak(Box::new(Memory::<256, 64, SLOTS, 4, 4, 1, 256>::new()));
        let banks: &'static mut [&'static mut dyn AnyTaskPool] = Box::leak(Box::new([]));
        let mailbox = Box::leak(Box::new(Mailbox::new()));
        let about = About::new("interrupted", "none");
        let (mut real_time, _, link) =
            split(memory, banks, mailbox, about, Limits::default()).expect("nothing is declared");
        real_time.on_timer(&mut Timer);
        let interrupts = Rc::new(Interrupts {
            level: Cell::new(Level::Link),
            points: Cell::new(0),
            schedule: RefCell::default(),
            frames: RefCell::default(),
            listener: RefCell::new(link.stop_listener()),
            queue: RefCell::default(),
            room: Cell::new(usize::MAX),
            real_time: RefCell::new(real_time),
            is_called: Cell::new(false),
            stop_came: Cell::new(false),
            stays: Cell::new(false),
        });
        Robot {
            link,
            port: Port {
                interrupts,
                wakes: true,
                sent: Vec::new(),
                mode: Mode::Empty,
                answers: Vec::new(),
                reader: FrameReader::new(),
            },
        }
    }

    /// Lets all that is there be done, without interrupts but those.
    fn settle(&mut self) {
        for _ in 0..4 {
            while self.link.poll(&mut self.port) {}
            self.port.interrupts.slots();
        }
        while self.link.poll(&mut self.port) {}
    }

    /// Brings it into this mode, without anything else under way.
    fn bring_to(&mut self, mode: Mode) {
        let interrupts = Rc::clone(&self.port.interrupts);
        interrupts.stays.set(false);
        interrupts.room.set(usize::MAX);
        let requests: &[Request<'_>] = match mode {
            Mode::Empty => &[Request::Release, Request::Start],
            Mode::Stopped => &[Request::Release, Request::Stop],
            _ => &[Request::EmergencyStop],
        };
        // Numbers that no script has.
        for (request, seq) in requests.iter().zip(200..) {
            let frame = framed(seq, *request);
            interrupts.frames.borrow_mut().push_back(frame);
            interrupts.take_frame();
            self.settle();
        }
        assert_eq!(interrupts.mode(), mode);
        self.port.answers.clear();
        interrupts.stop_came.set(false);
    }
}

fn framed(seq: u8, request: Request<'_>) -> Vec<u8> {
    let mut frame = [0; MAX_FRAME_BYTES];
    let len = encode(&ToDevice { seq, request }, &mut frame).expect("it fits");
    // With a delimiter in front, as clients send it.
    [&[DELIMITER], &frame[..len]].concat()
}

/// Requests in the order in which they come, numbered from 1.
struct Script {
    requests: &'static [Request<'static>],
    from: Mode,
    /// How the robot ends, and what is answered to the last request.
    ends: Mode,
    last: Result<(), LinkError>,
    /// Bytes that there is room for.
    room: usize,
}

const ALL: usize = usize::MAX;

const SCRIPTS: &[Script] = &[
    Script {
        requests: &[Request::Stop],
        from: Mode::Empty,
        ends: Mode::Stopped,
        last: Ok(()),
        room: ALL,
    },
    Script {
        requests: &[Request::Start, Request::Stop],
        from: Mode::Stopped,
        ends: Mode::Stopped,
        last: Ok(()),
        room: ALL,
    },
    Script {
        requests: &[Request::Stop, Request::Start],
        from: Mode::Empty,
        ends: Mode::Empty,
        last: Ok(()),
        room: ALL,
    },
    Script {
        requests: &[Request::Release, Request::EmergencyStop],
        from: Mode::EmergencyStopped,
        ends: Mode::EmergencyStopped,
        last: Ok(()),
        room: ALL,
    },
    Script {
        requests: &[Request::EmergencyStop, Request::Release],
        from: Mode::Empty,
        ends: Mode::Stopped,
        last: Ok(()),
        room: ALL,
    },
    // The stop finds no room, and is never read; a start has just enough.
    Script {
        requests: &[Request::Start, Request::Stop],
        from: Mode::Stopped,
        ends: Mode::Stopped,
        last: Err(LinkError::StopCame),
        room: 8,
    },
    // Less than the stop is kept.
    Script {
        requests: &[Request::Start, Request::Stop],
        from: Mode::Stopped,
        ends: Mode::Stopped,
        last: Err(LinkError::StopCame),
        room: 12,
    },
];

/// Places where the first interrupt comes, and places behind it where others do. A turn of the link
/// without a byte has fewer points than the first, and the way of a request from its first byte to
/// its answer fewer than the second.
const FIRST_POINTS: usize = 8;
const POINTS: usize = 48;
/// Turns of the slots beside those that are asked for.
const TIMERS: usize = 2;

/// All orders of so many frames and turns.
fn orders(frames: usize, timers: usize) -> Vec<Vec<Interrupt>> {
    let one = |what, rest: Vec<Vec<Interrupt>>| {
        let with = move |rest: Vec<Interrupt>| [&[what][..], &rest].concat();
        rest.into_iter().map(with).collect::<Vec<_>>()
    };
    match (frames, timers) {
        (0, 0) => [Vec::new()].to_vec(),
        (0, _) => one(Interrupt::Timer, orders(0, timers - 1)),
        (_, 0) => one(Interrupt::Frame, orders(frames - 1, 0)),
        _ => [
            one(Interrupt::Frame, orders(frames - 1, timers)),
            one(Interrupt::Timer, orders(frames, timers - 1)),
        ]
        .concat(),
    }
}

/// Tries one order, at these points.
fn attempt(robot: &mut Robot, script: &Script, order: &[Interrupt], at: &[usize]) {
    robot.bring_to(script.from);
    let interrupts = Rc::clone(&robot.port.interrupts);
    let is_stop = |request: &Request<'_>| matches!(request, Request::Stop | Request::EmergencyStop);
    interrupts.room.set(script.room);
    let stop_is_last = script.requests.last().is_some_and(is_stop);
    interrupts.stays.set(stop_is_last);
    for (request, seq) in script.requests.iter().zip(1..) {
        let frame = framed(seq, *request);
        interrupts.frames.borrow_mut().push_back(frame);
    }
    let schedule = at.iter().copied().zip(order.iter().copied());
    interrupts.schedule.replace(schedule.collect());
    interrupts.points.set(0);
    INTERRUPTED.set(Some(Rc::clone(&interrupts)));
    let is_done = || interrupts.schedule.borrow().is_empty();
    while !is_done() {
        robot.link.poll(&mut robot.port);
    }
    INTERRUPTED.set(None);
    robot.settle();
    assert_eq!(interrupts.mode(), script.ends);
    for (seq, result, mode) in &robot.port.answers {
        let is_stop = script
            .requests
            .get(usize::from(*seq) - 1)
            .is_some_and(is_stop);
        if is_stop && stop_is_last {
            assert!(
                mode.is_latched(),
                "{seq} was answered {result:?} in {mode:?}"
            );
        }
    }
    // Answers to requests before it may come behind it.
    let answers = &robot.port.answers;
    let of_last = |(seq, _, _): &&(u8, _, _)| usize::from(*seq) == script.requests.len();
    let last = answers.iter().rfind(of_last).map(|(_, result, _)| *result);
    // What finds no room is not answered; what came before it may have been done before it came.
    if script.room == ALL || last.is_some_and(|last| last.is_err()) {
        assert_eq!(last, Some(script.last));
    }
}

/// All places, in non-decreasing order, each so many points from those beside it.
fn placed(
    order: &[Interrupt],
    at: &mut Vec<usize>,
    step: usize,
    attempt: &mut impl FnMut(&[usize]),
) {
    if at.len() == order.len() {
        return attempt(at);
    }
    let places = match (at.first(), at.last()) {
        (Some(first), Some(last)) => (*last..=first + POINTS).step_by(step),
        _ => (1..=FIRST_POINTS).step_by(1),
    };
    for place in places {
        at.push(place);
        placed(order, at, step, attempt);
        at.pop();
    }
}

#[test]
fn no_order_of_interrupts_loses_a_stop_or_lets_what_is_older_undo_it() {
    let mut attempts = 0;
    for wakes in [true, false] {
        let mut robot = Robot::new();
        robot.port.wakes = wakes;
        for (number, script) in SCRIPTS.iter().enumerate() {
            for timers in 0..=TIMERS {
                for order in orders(script.requests.len(), timers) {
                    // All places of two interrupts; of three every other behind the first, of more
                    // every seventh.
                    let step = match order.len() {
                        ..=2 => 1,
                        3 => 2,
                        _ => 7,
                    };
                    placed(&order, &mut Vec::new(), step, &mut |at| {
                        attempts += 1;
                        let tried = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| {
                            attempt(&mut robot, script, &order, at);
                        }));
                        assert!(
                            tried.is_ok(),
                            "script {number}, wakes {wakes}: {order:?} at {at:?}"
                        );
                    });
                }
            }
        }
    }
    assert!(attempts > 100_000, "{attempts}");
    std::println!("{attempts} orders");
}
