//! Frames between processors, as bytes: the vectors of the book, and damage of every kind.
#![allow(clippy::unwrap_used)] // a test that cannot go on has failed

use std::fs;

use esm_link::frames::can;
use esm_link::frames::configuration::{Configuration, Content};
use esm_link::frames::receiver::{InFrame, Receiver, SortedFrames};
use esm_link::frames::wire::{self, Header, MAX_PAYLOAD_BYTES, MAX_WIRE_BYTES};
use esm_tests::command::root;
use esm_tests::environment;
use esm_tests::random::Random;

/// Frames that are damaged in each run of the tests. `cargo xtask campaign frames` damages a
/// million.
const DAMAGES: u64 = 100_000;
/// Bytes of a frame that are changed, at most.
const MAX_CHANGES: usize = 4;

/// A row of the book's table of vectors.
struct Vector {
    configuration: String,
    number: u8,
    payload: Vec<u8>,
    hash: u64,
    bytes: Vec<u8>,
    can: u32,
}

fn hexadecimal(text: &str) -> Vec<u8> {
    let byte = |digits| u8::from_str_radix(digits, 16).unwrap();
    text.split_whitespace().map(byte).collect()
}

fn vectors() -> Vec<Vector> {
    let page = fs::read_to_string(root().join("docs/src/communication.md")).unwrap();
    let rows = page
        .lines()
        .skip_while(|line| !line.starts_with("| configuration's text"))
        .skip(2)
        .take_while(|line| line.starts_with('|'));
    rows.map(|row| {
        let cells: Vec<&str> = row
            .trim_matches('|')
            .split('|')
            .map(|cell| cell.trim().trim_matches('`'))
            .collect();
        let [configuration, number, payload, hash, bytes, can] = cells[..] else {
            panic!("{row}");
        };
        Vector {
            configuration: configuration.to_owned(),
            number: number.parse().unwrap(),
            payload: hexadecimal(payload),
            hash: u64::from_str_radix(hash, 16).unwrap(),
            bytes: hexadecimal(bytes),
            can: u32::from_str_radix(can, 16).unwrap(),
        }
    })
    .collect()
}

#[test]
fn frames_are_the_bytes_of_the_book() {
    let vectors = vectors();
    assert_eq!(vectors.len(), 4);
    for vector in vectors {
        let parts: Vec<&str> = vector.configuration.split(' ').collect();
        let [identifier, content, payload_bytes, period_us] = parts[..] else {
            panic!("{}", vector.configuration);
        };
        let identifier = identifier.parse().unwrap();
        let content = content
            .parse()
            .map_or(Content::Value(content), Content::Flags);
        let payload_bytes: u8 = payload_bytes.parse().unwrap();
        let period_us = period_us.parse().unwrap();
        let configuration = Configuration::of(identifier, content, payload_bytes, period_us);
        assert_eq!(
            configuration.hash(),
            vector.hash,
            "{}",
            vector.configuration
        );
        let header = Header {
            identifier,
            number: vector.number,
            configuration,
        };
        let mut bytes = [0; MAX_WIRE_BYTES];
        let len = wire::encode(header, &vector.payload, &mut bytes).unwrap();
        assert_eq!(bytes[..len], vector.bytes, "{}", vector.configuration);
        let frames = [InFrame {
            identifier,
            payload_bytes,
            configuration,
        }];
        let frames = SortedFrames::new(&frames).unwrap();
        let mut receiver = Receiver::new();
        let arrived = receiver
            .take(&mut &vector.bytes[..], &frames)
            .unwrap()
            .unwrap();
        assert_eq!(
            (arrived.number, arrived.payload),
            (vector.number, &vector.payload[..])
        );
        assert_eq!(
            can::identifier(header),
            Some(vector.can),
            "{}",
            vector.configuration
        );
    }
}

/// Changes one to four bytes of a frame, the delimiter included.
fn damage(bytes: &mut [u8], random: &mut Random) {
    for _ in 0..=random.below(MAX_CHANGES) {
        let at = random.below(bytes.len());
        if let Some(byte) = bytes.get_mut(at) {
            // A byte 0 cuts the frame in two; a bit is what noise changes.
            *byte = match random.below(3) {
                0 => 0,
                1 => *byte ^ 1 << random.below(8),
                _ => random.bits() as u8,
            };
        }
    }
}

#[test]
fn no_damaged_frame_is_taken_for_another() {
    let damages = environment::number("ESM_FRAME_DAMAGES", DAMAGES);
    let mut random = Random::new(environment::number("ESM_FRAME_SEED", 1));
    let lengths = [1, 2, 4, 12, 16, 64, MAX_PAYLOAD_BYTES];
    let frames: Vec<InFrame> = (0..64)
        .map(|number| InFrame {
            identifier: number * 7 % 64 * 32,
            payload_bytes: lengths[usize::from(number) % lengths.len()] as u8,
            configuration: Configuration::from_hash(random.bits()),
        })
        .collect();
    let mut frames = frames;
    frames.sort_by_key(|frame| frame.identifier);
    let table = SortedFrames::new(&frames).unwrap();
    let mut receiver = Receiver::new();
    let mut whole = 0;
    let mut bytes = [0; MAX_WIRE_BYTES];
    for nth in 0..damages {
        let index = random.below(frames.len());
        let frame = frames[index];
        let number = random.bits() as u8;
        // Zeros are what COBS is about.
        let zeros = random.below(4) == 0;
        let mut byte = || if zeros { 0 } else { random.bits() as u8 };
        let payload: Vec<u8> = (0..frame.payload_bytes).map(|_| byte()).collect();
        let header = Header {
            identifier: frame.identifier,
            number,
            configuration: frame.configuration,
        };
        let len = wire::encode(header, &payload, &mut bytes).unwrap();
        let sent = bytes[..len].to_vec();
        let mut damaged = sent.clone();
        damage(&mut damaged, &mut random);
        // A delimiter in between, so that only this frame is damaged.
        damaged.push(0);
        let mut arriving = &damaged[..];
        while let Some(outcome) = receiver.take(&mut arriving, &table) {
            if let Ok(arrived) = outcome {
                assert_eq!(arrived.index, index, "damage {nth}");
                assert_eq!(arrived.number, number, "damage {nth}");
                assert_eq!(arrived.payload, payload, "damage {nth}");
                // The delimiter may have been what was changed, or nothing.
                assert_eq!(damaged[..len - 1], sent[..len - 1], "damage {nth}");
                whole += 1;
            }
        }
    }
    println!("{damages} frames damaged, {whole} of them by nothing or at their end alone");
    assert!(whole * 10 < damages);
}
