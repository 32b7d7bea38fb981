//! What tests here share with those of the command.

use esm_link::message::{Mode, ResetReason, Status};

/// What a robot says that drives with a mission, and to which nothing has happened.
pub fn status(mission: Option<u32>, steps: u64) -> Status {
    Status {
        mode: Mode::Running,
        mission,
        steps,
        t_us: 0,
        executed: 0,
        missed: 0,
        overruns: 0,
        max_delay_ns: 0,
        trace_dropped: 0,
        background_busy: false,
        stack_bytes: None,
        reset: ResetReason::PowerOn,
        trial: None,
        fell_back: None,
        kept: None,
        changed_params: 0,
        record_dropped: 0,
        record_pending: false,
        saved_params: 0,
        stop_pressed: false,
        flash: None,
    }
}

/// The least ELF file of a processor with these segments: where each is loaded, and its bytes. All
/// of them run somewhere in RAM.
pub fn elf(machine: u16, segments: &[(u32, &[u8])]) -> Vec<u8> {
    const HEADER_BYTES: u32 = 52;
    const SEGMENT_BYTES: u32 = 32;
    const RAM: u32 = 0x2000_0000;
    let words =
        |words: &[u32]| -> Vec<u8> { words.iter().flat_map(|it| it.to_le_bytes()).collect() };
    let halves =
        |halves: &[u16]| -> Vec<u8> { halves.iter().flat_map(|it| it.to_le_bytes()).collect() };
    let mut bytes = b"\x7fELF\x01\x01\x01\0\0\0\0\0\0\0\0\0".to_vec();
    bytes.extend(halves(&[2, machine]));
    bytes.extend(words(&[1, 0, HEADER_BYTES, 0, 0]));
    let count = segments.len() as u16;
    let (header, segment) = (HEADER_BYTES as u16, SEGMENT_BYTES as u16);
    bytes.extend(halves(&[header, segment, count, 0, 0, 0]));
    let mut place = HEADER_BYTES + SEGMENT_BYTES * u32::from(count);
    for (at, data) in segments {
        let length = data.len() as u32;
        bytes.extend(words(&[1, place, RAM, *at, length, length, 5, 4]));
        place += length;
    }
    for (_, data) in segments {
        bytes.extend(*data);
    }
    bytes
}
