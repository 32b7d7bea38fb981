//! The link's line of an emulated board: moved by the interrupt of its UART, or by that of the
//! [`LineTimer`], where the plant carries it.

use heapless::spsc::Queue;
use rt_firmware::StopListener;
use rt_firmware::body::line::{LinePart, PART_BYTES};

use crate::line::{self, LineBoard, LinkEnd, RECEIVE_BYTES, TRANSMIT_BYTES, Wire};
use crate::line_timer::LineTimer;
use crate::plant_line;

const _: () = assert!(TRANSMIT_BYTES > PART_BYTES);

/// Makes the two ends of a line of its queues, and lets the plant carry its bytes where that does.
pub fn split<B: LineBoard + LineTimer>(
    received: &'static mut Queue<u8, RECEIVE_BYTES>,
    to_transmit: &'static mut Queue<u8, TRANSMIT_BYTES>,
    listener: StopListener<'static>,
    keep: Option<&'static mut B::Store>,
) -> (Line<B>, LinkEnd<B>) {
    let (line, mut link_end) = line::split(received, to_transmit, listener, keep);
    let goes_by_plant = plant_line::start::<B>();
    if goes_by_plant {
        link_end.without_rate();
    }
    let line = Line {
        line,
        goes_by_plant,
    };
    (line, link_end)
}

/// The interrupt handler's end.
pub struct Line<B> {
    line: line::Line<B>,
    /// The plant carries the bytes, and the UART none.
    goes_by_plant: bool,
}

impl<B: LineBoard + LineTimer> Line<B> {
    /// Swaps bytes with the plant. To be called by the interrupt of the [`LineTimer`].
    ///
    /// Returns whether the link task has something to do.
    pub fn swap(&mut self) -> bool {
        plant_line::acknowledge::<B>();
        let mut part = LinePart::new(PART_BYTES);
        while !part.is_full() {
            let Some(byte) = self.line.next_to_transmit() else {
                break;
            };
            part.push(byte);
        }
        let answer = plant_line::swap(&part);
        let carried = answer.as_ref().map_or(&[][..], LinePart::carried);
        for &byte in carried {
            self.line.take(byte);
        }
        !carried.is_empty() || !part.carried().is_empty()
    }

    /// Moves bytes between the UART and the queues: see [`Line::serve`](line::Line::serve).
    pub fn serve<W: Wire>(&mut self, wire: &mut W) -> bool {
        !self.goes_by_plant && self.line.serve(wire)
    }
}
