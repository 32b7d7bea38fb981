//! What is encoded arrives, and what is not does not.

use super::configuration::Configuration;
use super::receiver::{Arrived, InFrame, MAX_FRAMES, ReceiveError, Receiver, SortedFrames};
use super::wire::{
    self, EncodeError, Header, MAX_IDENTIFIER, MAX_PAYLOAD_BYTES, MAX_WIRE_BYTES, OVERHEAD_BYTES,
};
use crate::frame::DELIMITER;
use proptest::collection::vec;
use proptest::prelude::*;
use std::vec::Vec;

const CONFIGURATION: u64 = 0x0123_4567_89AB_CDEF;

fn header(identifier: u16, number: u8) -> Header {
    Header {
        identifier,
        number,
        configuration: Configuration::from_hash(CONFIGURATION ^ u64::from(identifier)),
    }
}

fn in_frame(identifier: u16, payload_bytes: usize) -> InFrame {
    InFrame {
        identifier,
        payload_bytes: payload_bytes as u8,
        configuration: header(identifier, 0).configuration,
    }
}

fn encoded(header: Header, payload: &[u8]) -> Vec<u8> {
    let mut bytes = [0; MAX_WIRE_BYTES];
    let len = wire::encode(header, payload, &mut bytes).unwrap();
    bytes[..len].to_vec()
}

/// Index, number and payload of a frame, or why it is none.
type Outcome = Result<(usize, u8, Vec<u8>), ReceiveError>;

/// What a receiver makes of bytes that arrive in pieces of a length.
fn received(bytes: &[u8], piece: usize, frames: &[InFrame]) -> Vec<Outcome> {
    let frames = SortedFrames::new(frames).unwrap();
    let mut receiver = Receiver::new();
    let mut outcomes = Vec::new();
    for mut arrived in bytes.chunks(piece) {
        while let Some(outcome) = receiver.take(&mut arrived, &frames) {
            outcomes.push(outcome.map(|frame| (frame.index, frame.number, frame.payload.to_vec())));
        }
        assert!(arrived.is_empty());
    }
    outcomes
}

#[test]
fn a_frame_is_what_cobs_makes_of_header_payload_and_checksum() {
    for payload in [
        &[0][..],
        &[1, 0, 2],
        &[0xff; MAX_PAYLOAD_BYTES],
        &[0; MAX_PAYLOAD_BYTES],
    ] {
        let header = header(0x102, 7);
        let mut plain = std::vec![2, 1, 7, header.configuration.low_byte()];
        plain.extend(payload);
        let hash = header.configuration.hash().to_le_bytes();
        let crc = esm_core::format::crc32(&[&hash[..], &plain[..]].concat());
        plain.extend(crc.to_le_bytes());
        let mut expected = [0; MAX_WIRE_BYTES];
        let len = cobs::encode(&plain, &mut expected);
        expected[len] = DELIMITER;
        assert_eq!(encoded(header, payload), expected[..=len]);
        assert_eq!(len + 1, payload.len() + OVERHEAD_BYTES);
    }
}

#[test]
fn what_cannot_be_sent_is_refused() {
    let mut bytes = [0; MAX_WIRE_BYTES];
    let mut encode =
        |header, payload: &[u8], room| wire::encode(header, payload, &mut bytes[..room]);
    let most = MAX_WIRE_BYTES;
    let too_high = header(MAX_IDENTIFIER + 1, 0);
    assert_eq!(encode(too_high, &[1], most), Err(EncodeError::Identifier));
    let good = header(MAX_IDENTIFIER, 0);
    for payload in [&[][..], &[1; MAX_PAYLOAD_BYTES + 1]] {
        assert_eq!(encode(good, payload, most), Err(EncodeError::Payload));
    }
    let needed = 16 + OVERHEAD_BYTES;
    for room in 0..needed {
        let no_room = EncodeError::NoRoom {
            needed: needed as u8,
        };
        assert_eq!(encode(good, &[1; 16], room), Err(no_room), "{room} bytes");
    }
    assert_eq!(encode(good, &[1; 16], needed), Ok(needed));
}

#[test]
fn a_table_is_in_order_and_has_room_for_so_many() {
    let ascending: Vec<InFrame> = (0..=MAX_FRAMES).map(|id| in_frame(id as u16, 1)).collect();
    assert!(SortedFrames::new(&ascending).is_none());
    assert!(SortedFrames::new(&ascending[..MAX_FRAMES]).is_some());
    assert!(SortedFrames::new(&[]).is_some());
    for wrong in [[in_frame(2, 1), in_frame(1, 1)], [in_frame(2, 1); 2]] {
        assert!(SortedFrames::new(&wrong).is_none());
    }
}

#[test]
fn each_thing_that_is_no_frame_says_what_is_wrong_with_it() {
    let good = encoded(header(5, 9), b"\0zeros\0");
    let frames = [in_frame(4, 1), in_frame(5, 7)];
    let changed = |at: usize| {
        let mut changed = good.clone();
        changed[at] ^= 0x40;
        changed
    };
    let other_configuration = Header {
        configuration: Configuration::from_hash(CONFIGURATION ^ 0x77),
        ..header(5, 9)
    };
    // The lowest byte is the same.
    let other_meaning = Header {
        configuration: Configuration::from_hash(CONFIGURATION ^ 5 ^ 1 << 32),
        ..header(5, 9)
    };
    let mut too_long = std::vec![1; MAX_WIRE_BYTES];
    too_long.push(DELIMITER);
    let cases = [
        (changed(8), ReceiveError::Checksum),
        (std::vec![9, 1, 1, DELIMITER], ReceiveError::Checksum),
        (encoded(other_meaning, b"\0zeros\0"), ReceiveError::Checksum),
        (std::vec![4, 5, 1, 1, DELIMITER], ReceiveError::Length),
        (encoded(header(5, 9), b"short"), ReceiveError::Length),
        (encoded(header(5, 9), b"too long"), ReceiveError::Length),
        (
            encoded(other_configuration, b"\0zeros\0"),
            ReceiveError::Configuration,
        ),
        (
            encoded(header(6, 9), b"\0zeros\0"),
            ReceiveError::UnknownIdentifier,
        ),
        (too_long, ReceiveError::TooLong),
    ];
    for (bytes, error) in cases {
        let expected = [
            Ok((1, 9, b"\0zeros\0".to_vec())),
            Err(error),
            Ok((1, 9, b"\0zeros\0".to_vec())),
        ];
        let all = [&[0, 0][..], &good, &bytes, &[0], &good].concat();
        assert_eq!(received(&all, all.len(), &frames), expected, "{bytes:?}");
        assert!(!std::string::ToString::to_string(&error).is_empty());
    }
}

#[test]
fn a_receiver_knows_whether_it_is_within_a_frame() {
    let frames = SortedFrames::new(&[]).unwrap();
    let mut receiver = Receiver::new();
    assert!(!receiver.is_within());
    assert_eq!(receiver.take(&mut &[1, 2][..], &frames), None);
    assert!(receiver.is_within());
    let ended: Result<Arrived<'_>, _> = receiver.take(&mut &[0][..], &frames).unwrap();
    assert!(ended.is_err());
    assert!(!receiver.is_within());
}

proptest! {
    #[test]
    fn whatever_is_sent_arrives_in_pieces_of_any_length(
        sent in vec((0..4_u16, any::<u8>(), vec(any::<u8>(), 20..=20)), 1..20),
        long in vec(prop_oneof![Just(0), any::<u8>()], 1..=MAX_PAYLOAD_BYTES),
        piece in 1..600_usize,
    ) {
        let frames = [
            in_frame(0, 20),
            in_frame(1, 20),
            in_frame(2, 20),
            in_frame(3, 20),
            in_frame(MAX_IDENTIFIER, long.len()),
        ];
        let mut bytes = encoded(header(MAX_IDENTIFIER, 1), &long);
        let mut expected = std::vec![Ok((4, 1, long))];
        for (identifier, number, payload) in sent {
            bytes.extend(encoded(header(identifier, number), &payload));
            expected.push(Ok((usize::from(identifier), number, payload)));
        }
        prop_assert_eq!(received(&bytes, piece, &frames), expected);
    }

    #[test]
    fn no_bytes_make_a_receiver_panic_or_lose_step(
        noise in vec(prop_oneof![Just(0), 0..8_u8, any::<u8>()], 0..2000),
        piece in 1..600_usize,
    ) {
        let frames = [in_frame(1, 3), in_frame(0x102, 4)];
        let good = encoded(header(1, 2), &[0, 0, 0]);
        let bytes = [&noise[..], &[0], &good].concat();
        let outcomes = received(&bytes, piece, &frames);
        prop_assert_eq!(outcomes.last(), Some(&Ok((0, 2, std::vec![0; 3]))));
        prop_assert!(outcomes.len() <= noise.len() + 2);
    }
}
