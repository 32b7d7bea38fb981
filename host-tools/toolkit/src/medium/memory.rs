//! Memory that two processors share: what one writes is there for the other, whole and at once.

use std::collections::VecDeque;

use super::clock::{Clock, Life};

/// What was written, and when.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Written {
    /// By the reader's clock.
    pub at_us: u64,
    /// What.
    pub bytes: Vec<u8>,
}

/// One direction.
#[derive(Clone, Debug)]
pub struct SharedMemory {
    writer: Life,
    reader: Life,
    waiting: VecDeque<(u64, Vec<u8>)>,
}

impl SharedMemory {
    /// Memory in which nothing is.
    #[must_use]
    pub fn new(writer: Clock, reader: Clock) -> Self {
        SharedMemory {
            writer: Life::whole(writer),
            reader: Life::whole(reader),
            waiting: VecDeque::new(),
        }
    }

    /// Who writes from now on: the processor as it is between two resets.
    pub fn set_writer(&mut self, writer: Life) {
        self.writer = writer;
    }

    /// Who reads from now on.
    pub fn set_reader(&mut self, reader: Life) {
        self.reader = reader;
    }

    /// Writes at a time of the writer's clock. What is given later may be written earlier, but not
    /// before what has been taken.
    pub fn write(&mut self, at_us: u64, bytes: &[u8]) {
        let at_ps = self.writer.clock.plant_ps(at_us);
        if at_ps >= self.writer.to_ps {
            // It is reset before.
            return;
        }
        let place = self.waiting.partition_point(|(it_ps, _)| *it_ps <= at_ps);
        self.waiting.insert(place, (at_ps, bytes.to_vec()));
    }

    /// What was written next by a time of the reader's clock.
    pub fn take(&mut self, until_us: u64) -> Option<Written> {
        let Life { clock, from_ps, .. } = self.reader;
        let reader = clock;
        // What came before a reset is gone with it.
        while self.waiting.pop_front_if(|it| it.0 < from_ps).is_some() {}
        let there = |(at_ps, _): &mut (u64, Vec<u8>)| reader.local_us(*at_ps) <= until_us;
        let (at_ps, bytes) = self.waiting.pop_front_if(there)?;
        let at_us = reader.local_us(at_ps);
        Some(Written { at_us, bytes })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_is_there_at_once() {
        let mut memory = SharedMemory::new(Clock::new(0, 0), Clock::new(1_000_000, 0));
        memory.write(20, b"second");
        memory.write(10, b"first");
        assert_eq!(memory.take(8), None);
        let taken = |memory: &mut SharedMemory| memory.take(19).map(|it| (it.at_us, it.bytes));
        assert_eq!(taken(&mut memory), Some((9, b"first".to_vec())));
        assert_eq!(taken(&mut memory), Some((19, b"second".to_vec())));
        assert_eq!(taken(&mut memory), None);
    }
}
