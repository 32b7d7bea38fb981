//! A board that is one of several: whoever runs all of them answers what it asks, in the order of
//! its time.
//!
//! The board waits for each answer, and its virtual time stands still meanwhile. So whoever runs
//! all decides how far it is.

use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Mutex, PoisonError};

use rt_firmware::body::frames::CarriedFrame;
use rt_firmware::body::{Reply, Request};

/// What a board asks.
#[derive(Clone, Copy, Debug)]
#[expect(
    clippy::large_enum_variant,
    reason = "one is there at a time, and a box would be made for each frame"
)]
pub enum Asked {
    /// It exchanges its pins: a slot begins.
    Pins(Request),
    /// A frame starts.
    Starts(CarriedFrame),
    /// What had arrived first, by this robot time in microseconds.
    Arrived(u64),
}

/// Makes both sides of what one board asks.
pub fn pair() -> (BoardSide, SystemSide) {
    let (asks, asked) = channel();
    let (pins, pins_answers) = channel();
    let (started, started_answers) = channel();
    let (frames, frames_answers) = channel();
    (
        BoardSide {
            asks: Mutex::new(asks),
            pins: Mutex::new(pins_answers),
            started: Mutex::new(started_answers),
            frames: Mutex::new(frames_answers),
        },
        SystemSide {
            asked,
            pins,
            started,
            frames,
        },
    )
}

/// The board's side. Each kind of question has one who asks it.
pub struct BoardSide {
    asks: Mutex<Sender<Asked>>,
    pins: Mutex<Receiver<Reply>>,
    started: Mutex<Receiver<()>>,
    frames: Mutex<Receiver<CarriedFrame>>,
}

impl BoardSide {
    fn ask<T>(&self, asked: Asked, answers: &Mutex<Receiver<T>>) -> Option<T> {
        let asks = self.asks.lock().unwrap_or_else(PoisonError::into_inner);
        asks.send(asked).ok()?;
        drop(asks);
        let answers = answers.lock().unwrap_or_else(PoisonError::into_inner);
        answers.recv().ok()
    }

    /// An exchange of pins. Where the system is gone the answer is a stale one, by which the board
    /// notices.
    pub fn exchange(&self, request: &Request) -> Reply {
        self.ask(Asked::Pins(*request), &self.pins)
            .unwrap_or_default()
    }

    /// A frame starts.
    pub fn start(&self, frame: CarriedFrame) {
        // There is nothing to be done where the system is gone.
        let _ = self.ask(Asked::Starts(frame), &self.started);
    }

    /// The next frame that had arrived by then.
    pub fn arrived(&self, until_us: u64) -> CarriedFrame {
        self.ask(Asked::Arrived(until_us), &self.frames)
            .unwrap_or(CarriedFrame::NONE)
    }
}

/// The side of whoever runs all boards.
pub struct SystemSide {
    asked: Receiver<Asked>,
    pins: Sender<Reply>,
    started: Sender<()>,
    frames: Sender<CarriedFrame>,
}

impl SystemSide {
    /// Waits for what the board asks next. None where it is gone.
    pub fn next(&self) -> Option<Asked> {
        self.asked.recv().ok()
    }

    /// Answers an exchange of pins.
    pub fn give_pins(&self, reply: Reply) {
        // A board that is gone asks for nothing more, which is noticed then.
        let _ = self.pins.send(reply);
    }

    /// Answers that a frame was started.
    pub fn take_frame(&self) {
        let _ = self.started.send(());
    }

    /// Answers with what had arrived.
    pub fn give_frame(&self, frame: CarriedFrame) {
        let _ = self.frames.send(frame);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_board_waits_for_its_answers_and_notices_that_nobody_is_there() {
        let (board, system) = pair();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                while let Some(asked) = system.next() {
                    match asked {
                        Asked::Pins(request) if request.sequence == 9 => break,
                        Asked::Pins(request) => system.give_pins(Reply {
                            sequence: request.sequence,
                            ..Reply::default()
                        }),
                        Asked::Starts(_) => system.take_frame(),
                        Asked::Arrived(until_us) => {
                            system.give_frame(CarriedFrame::new(until_us, 0, &[1]));
                        }
                    }
                }
                drop(system);
            });
            let request = |sequence| Request {
                sequence,
                ..Request::default()
            };
            assert_eq!(board.exchange(&request(7)).sequence, 7);
            board.start(CarriedFrame::NONE);
            assert_eq!(board.arrived(40).at_us(), 40);
            assert_eq!(board.exchange(&request(9)), Reply::default());
            assert!(board.arrived(50).is_none());
        });
    }
}
