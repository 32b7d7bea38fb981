//! A blob taken apart, changed record by record, and put together again.
//!
//! A changed byte is mostly refused for its CRC, and with that made right for a length that no
//! longer fits. Changes of whole fields and records get far deeper: to tables that are wrong in
//! meaning, and to tables that are right and that no compiler would write.

use esm_core::format::{CRC_BYTES, MAGIC, NONE, Section, crc32};

use crate::random::Random;

/// Sections of a blob.
const SECTIONS: usize = Section::ALL.len();

/// Bytes of a record of each section, as [`esm_core::format`] lists them.
const RECORD_BYTES: [usize; SECTIONS] = [
    10, 16, 16, 4, 16, 8, 4, 4, 12, 8, 8, 4, 20, 1, 8, 4, 10, 2, 8, 1, 16, 28,
];

/// Sections in which a changed number often means another machine, and not only a broken one: these
/// are changed more often.
const FREE: [Section; 11] = [
    Section::Mission,
    Section::Slots,
    Section::States,
    Section::Transitions,
    Section::Code,
    Section::Timers,
    Section::Channels,
    Section::Listeners,
    Section::Tasks,
    Section::Params,
    Section::Connections,
];

/// The sections of a blob, each as its bytes.
#[derive(Clone, Debug)]
pub struct Records {
    sections: [Vec<u8>; SECTIONS],
}

impl Records {
    /// Takes a blob apart. Nothing is looked at but the lengths; `None` where these do not fit.
    pub fn of(blob: &[u8]) -> Option<Self> {
        let body = blob.get(MAGIC.len()..blob.len().checked_sub(CRC_BYTES)?)?;
        let mut rest = body;
        let mut sections: [Vec<u8>; SECTIONS] = Default::default();
        for (number, section) in sections.iter_mut().enumerate() {
            if number == Section::Links as usize && rest.is_empty() {
                // A mission without links ends here.
                break;
            }
            let length = take_varint(&mut rest)?;
            let (content, behind) = rest.split_at_checked(length)?;
            *section = content.to_vec();
            rest = behind;
        }
        Some(Records { sections })
    }

    /// Puts the blob together, with its lengths and its CRC right.
    pub fn seal(&self) -> Vec<u8> {
        let mut blob = MAGIC.to_vec();
        let (always, links) = self.sections.split_at(Section::Links as usize);
        let has_links = links.iter().any(|section| !section.is_empty());
        for section in always.iter().chain(links.iter().filter(|_| has_links)) {
            put_varint(&mut blob, section.len());
            blob.extend_from_slice(section);
        }
        let crc = crc32(&blob);
        blob.extend_from_slice(&crc.to_le_bytes());
        blob
    }

    /// Changes one thing: a field of a record, or which records there are.
    pub fn change(&mut self, random: &mut Random) {
        let number = if random.chance(80) {
            FREE[random.below(FREE.len())] as usize
        } else {
            random.below(SECTIONS)
        };
        let bytes = &mut self.sections[number];
        let size = RECORD_BYTES[number];
        let records = bytes.len() / size;
        if records == 0 {
            bytes.extend(std::iter::repeat_with(|| random.below(4) as u8).take(size));
            return;
        }
        let record = random.below(records) * size;
        match random.below(16) {
            0 => {
                bytes.drain(record..record + size);
            }
            1 => {
                let copy = bytes[record..record + size].to_vec();
                bytes.splice(record..record, copy);
            }
            2 => {
                let other = random.below(records) * size;
                for at in 0..size {
                    bytes.swap(record + at, other + at);
                }
            }
            3 => bytes[record + random.below(size)] ^= 1 << random.below(8),
            _ if size == 1 => bytes[record] = random.below(256) as u8,
            way => {
                let at = 2 * random.below(size / 2);
                let old = word(bytes, record + at);
                let new = match way {
                    4..=7 => random.below(24) as u16,
                    8 | 9 => old.wrapping_add(1),
                    10 | 11 => old.wrapping_sub(1),
                    12 | 13 => word(bytes, random.below(records) * size + at),
                    14 => NONE,
                    _ => random.below(1 << 16) as u16,
                };
                bytes[record + at..record + at + 2].copy_from_slice(&new.to_le_bytes());
            }
        }
    }
}

fn word(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes([bytes[at], bytes[at + 1]])
}

/// The same bytes with the beginning and the CRC of a blob.
pub fn repaired(bytes: &[u8]) -> Vec<u8> {
    let mut blob = bytes.to_vec();
    blob.resize(blob.len().max(MAGIC.len() + CRC_BYTES), 0);
    blob[..MAGIC.len()].copy_from_slice(&MAGIC);
    let end = blob.len() - CRC_BYTES;
    let crc = crc32(&blob[..end]);
    blob[end..].copy_from_slice(&crc.to_le_bytes());
    blob
}

/// The lowest seven bits of each byte count; the highest says that another byte follows.
fn put_varint(to: &mut Vec<u8>, mut number: usize) {
    while number >= 0x80 {
        to.push(number as u8 | 0x80);
        number >>= 7;
    }
    to.push(number as u8);
}

fn take_varint(from: &mut &[u8]) -> Option<usize> {
    let mut number = 0;
    for shift in [0, 7, 14, 21] {
        let (byte, rest) = from.split_first()?;
        *from = rest;
        number |= usize::from(byte & 0x7F) << shift;
        if byte & 0x80 == 0 {
            return Some(number);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_blob_taken_apart_and_put_together_is_the_same() {
        for seed in crate::fuzzing::seeds::blobs() {
            let records = Records::of(&seed.bytes).expect("a blob");
            assert_eq!(records.seal(), seed.bytes, "{}", seed.name);
            assert_eq!(repaired(&seed.bytes), seed.bytes, "{}", seed.name);
        }
    }

    #[test]
    fn a_blob_with_wrong_ends_is_repaired() {
        let seed = &crate::fuzzing::seeds::blobs()[0].bytes;
        let mut broken = seed.clone();
        let end = broken.len();
        broken[..4].fill(0);
        broken[end - 4..].fill(0);
        assert_eq!(&repaired(&broken), seed);
        assert!(esm_core::verify(repaired(b"")).is_err());
    }
}
