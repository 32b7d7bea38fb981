//! What a run says to its board over the link, and hears from it.

use std::io;

use esm_link::frame::{self, DELIMITER, FrameReader, MAX_FRAME_BYTES};
use esm_link::message::{
    Channel, FromDevice, LinkError, MAX_CHUNK, Request, Response, Swap, ToDevice,
};
use thiserror::Error;

use super::port::DirectPort;
use crate::host_board::HostLife;
use crate::plant::behind_pins::BehindPins;
use crate::streams::{Assembler, StreamEvent, Waiting};
use crate::values::{Net, Watched, ask_for_fields, ask_for_values, fields_of, kept};

/// Turns of the board in which a request is answered: its bytes take no time, and what the
/// real-time side has to do with it is done in the slot that comes next.
const ANSWER_TURNS: u32 = 1_000;

/// Why a run did not come to its end.
#[derive(Debug, Error)]
pub enum RunError {
    /// Something is wrong with the declarations of the robot's tasks.
    #[error("the robot's registry is wrong: {0:?}")]
    Registry(rt_firmware::RegistryFault),
    /// The robot does not stand well in the world.
    #[error(transparent)]
    Plant(#[from] crate::plant::PlantError),
    /// The board does not take a mission, or something else that it was asked for.
    #[error("the robot refused to {request}: {error:?}")]
    Refused {
        /// What it was asked for.
        request: &'static str,
        /// Why.
        error: LinkError,
    },
    /// The board does not answer, or not what was asked.
    #[error("the robot gave no answer to: {request}")]
    NoAnswer {
        /// What it was asked for.
        request: &'static str,
    },
    /// A stream of the board has a hole.
    #[error("the trace is not whole: {missing} records did not come through")]
    Gap {
        /// Records that are missing.
        missing: u32,
    },
    /// The board streams what makes no sense.
    #[error("the robot's trace makes no sense")]
    BadTrace,
    /// What is written went wrong.
    #[error("cannot keep what the run tells: {0}")]
    Io(#[from] io::Error),
}

/// How time passes while a request is open.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum While {
    /// It passes: a board without a mission.
    Passing,
    /// It stands still: a board before the time at which something is to happen.
    Standing,
}

/// The client's end of the link.
pub(super) struct Session {
    seq: u8,
    reader: FrameReader,
    trace: Assembler,
    record: Assembler,
    log: Assembler,
    values: Assembler,
    events: Waiting,
}

impl Session {
    pub(super) fn new() -> Self {
        Session {
            seq: 0,
            reader: FrameReader::new(),
            trace: Assembler::new(Channel::Trace),
            record: Assembler::new(Channel::Record),
            log: Assembler::new(Channel::Log),
            values: Assembler::new(Channel::Values),
            events: Waiting::default(),
        }
    }

    /// What the streams have brought.
    pub(super) fn take_events(&mut self) -> Vec<StreamEvent> {
        self.events.take()
    }

    /// Sends a request whose answer nobody waits for.
    pub(super) fn call(
        &mut self,
        port: &mut DirectPort<'_>,
        name: &'static str,
        request: Request<'_>,
    ) -> Result<(), RunError> {
        self.seq = self.seq.wrapping_add(1);
        let mut wire = [0; MAX_FRAME_BYTES + 1];
        wire[0] = DELIMITER;
        let seq = self.seq;
        let length = frame::encode(&ToDevice { seq, request }, &mut wire[1..]);
        let length = length.map_err(|_| RunError::Refused {
            request: name,
            error: LinkError::TooLong,
        })?;
        port.give(wire.get(..=length).unwrap_or_default());
        Ok(())
    }

    /// Takes what the board has sent; `on_reply` gets the answer to the last request.
    pub(super) fn hear(
        &mut self,
        port: &mut DirectPort<'_>,
        mut on_reply: impl FnMut(Result<Response<'_>, LinkError>),
    ) {
        for byte in port.take() {
            let Some(frame) = self.reader.push(byte) else {
                continue;
            };
            let Ok(message) = frame::unpack(frame) else {
                continue;
            };
            match frame::parse(message) {
                Ok(FromDevice::Reply { seq, result, .. }) if seq == self.seq => on_reply(result),
                Ok(FromDevice::Stream(part)) => {
                    let assembler = match part.channel {
                        Channel::Trace => &mut self.trace,
                        Channel::Record => &mut self.record,
                        Channel::Log => &mut self.log,
                        Channel::Values => &mut self.values,
                    };
                    assembler.take(&part, &mut self.events);
                }
                _ => {}
            }
        }
    }

    /// Asks for something and waits for the answer.
    pub(super) fn ask<T, P: BehindPins>(
        &mut self,
        (life, port): (&mut HostLife<'_, '_, '_, P>, &mut DirectPort<'_>),
        time: While,
        name: &'static str,
        request: Request<'_>,
        read: impl Fn(Response<'_>) -> Option<T>,
    ) -> Result<T, RunError> {
        let takes_over = matches!(request, Request::Commit(_));
        self.call(port, name, request)?;
        let mut is_taken = false;
        for _ in 0..ANSWER_TURNS {
            life.serve(port);
            let mut answer = None;
            self.hear(port, |result| answer = Some(result.map(&read)));
            match answer {
                Some(Ok(Some(value))) => return Ok(value),
                Some(Ok(None)) => break,
                Some(Err(error)) => {
                    return Err(RunError::Refused {
                        request: name,
                        error,
                    });
                }
                None => {}
            }
            if time == While::Passing || is_taken {
                life.pass(port);
            } else if takes_over && life.is_asked() {
                life.activate();
                is_taken = true;
            } else if life.is_asked() {
                life.answer();
            }
        }
        Err(RunError::NoAnswer { request: name })
    }

    /// Begins the session, and asks for all streams.
    pub(super) fn begin<P: BehindPins>(
        &mut self,
        (life, port): (&mut HostLife<'_, '_, '_, P>, &mut DirectPort<'_>),
    ) -> Result<(), RunError> {
        let hello = |response: Response<'_>| matches!(response, Response::Hello(_)).then_some(());
        self.ask(
            (life, port),
            While::Passing,
            "say who it is",
            Request::Hello,
            hello,
        )?;
        let streams = Request::Subscribe {
            trace: true,
            log: true,
            record: true,
        };
        self.ask(
            (life, port),
            While::Passing,
            "send its streams",
            streams,
            done,
        )
    }

    /// Asks for values on the nets of the mission that runs, as a recording keeps them. Answers
    /// which, and the number that their samples have; none where it has none.
    pub(super) fn watch<P: BehindPins>(
        &mut self,
        (life, port): (&mut HostLife<'_, '_, '_, P>, &mut DirectPort<'_>),
        nets: &[Net],
        mission: u32,
        period_ms: u16,
    ) -> Result<Option<(Vec<Watched>, u8)>, RunError> {
        const VALUES: &str = "tell of values";
        let no_answer = || RunError::NoAnswer { request: VALUES };
        let mut all: Vec<Watched> = Vec::new();
        for net in nets {
            let known = all.iter().find(|it| it.net.type_name == net.type_name);
            let fields = match known.map(|it| it.fields.clone()) {
                Some(fields) => fields,
                None => {
                    let mut text = Vec::new();
                    loop {
                        let offset = u16::try_from(text.len()).map_err(|_| no_answer())?;
                        let ask = ask_for_fields(mission, net.index, offset);
                        let part = |response: Response<'_>| match response {
                            Response::TaskText { total, text } => {
                                Some((usize::from(total), text.to_vec()))
                            }
                            _ => None,
                        };
                        let request = Request::Values { ask: &ask };
                        let board = (&mut *life, &mut *port);
                        let (total, part) =
                            self.ask(board, While::Standing, VALUES, request, part)?;
                        let is_empty = part.is_empty();
                        text.extend(part);
                        if text.len() >= total || is_empty {
                            break;
                        }
                    }
                    let fields = fields_of(&String::from_utf8_lossy(&text));
                    fields.ok_or_else(no_answer)?.into()
                }
            };
            let net = net.clone();
            all.push(Watched { net, fields });
        }
        let (nets, _) = kept(&all);
        if nets.is_empty() {
            return Ok(None);
        }
        let indices: Vec<u16> = nets.iter().map(|watched| watched.net.index).collect();
        let ask = ask_for_values(mission, period_ms, &indices);
        let request = Request::Values { ask: &ask };
        self.ask((life, port), While::Standing, VALUES, request, done)?;
        Ok(Some((nets, self.seq)))
    }

    /// Brings a mission to the board, and lets it take over. Answers how many active regions went
    /// on as they were.
    pub(super) fn bring<P: BehindPins>(
        &mut self,
        (life, port): (&mut HostLife<'_, '_, '_, P>, &mut DirectPort<'_>),
        time: While,
        blob: &[u8],
        warm: bool,
    ) -> Result<u16, RunError> {
        const UPLOAD: &str = "take the mission";
        let received = |response: Response<'_>| match response {
            Response::Received { len } => Some(len as usize),
            _ => None,
        };
        let len = u32::try_from(blob.len()).map_err(|_| RunError::Refused {
            request: UPLOAD,
            error: LinkError::TooLong,
        })?;
        let crc = frame::checksum(blob);
        let begin = Request::Begin { len, crc };
        let mut there = self.ask((life, port), time, UPLOAD, begin, received)?;
        while let Some(rest) = blob.get(there..).filter(|rest| !rest.is_empty()) {
            let data = rest.get(..MAX_CHUNK).unwrap_or(rest);
            let chunk = Request::Chunk {
                offset: there as u32,
                data,
            };
            let now = self.ask((life, port), time, UPLOAD, chunk, received)?;
            if now <= there {
                return Err(RunError::NoAnswer { request: UPLOAD });
            }
            there = now;
        }
        let swap = Swap { warm, trial_ms: 0 };
        let committed = |response: Response<'_>| match response {
            Response::Committed { carried, .. } => Some(carried),
            _ => None,
        };
        self.ask((life, port), time, UPLOAD, Request::Commit(swap), committed)
    }
}

fn done(response: Response<'_>) -> Option<()> {
    matches!(response, Response::Done).then_some(())
}
