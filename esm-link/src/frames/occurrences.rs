//! What the numbers of a frame's occurrences tell: whether one comes twice, and how many are
//! missing.

/// The occurrences of one frame, as they arrive.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Occurrences {
    last: Option<u8>,
    missing: u32,
    repeated: u32,
}

impl Occurrences {
    /// None has arrived.
    #[must_use]
    pub const fn new() -> Self {
        Occurrences {
            last: None,
            missing: 0,
            repeated: 0,
        }
    }

    /// Takes the number of one that has arrived. Whether it is to be used: the number of the one
    /// before is a repetition, unless the frame is `delayed`: then its sender has begun anew, or
    /// all numbers between were lost.
    pub fn take(&mut self, number: u8, delayed: bool) -> bool {
        let left_out = match self.last {
            Some(last) if last == number && !delayed => {
                self.repeated = self.repeated.saturating_add(1);
                return false;
            }
            Some(last) => number.wrapping_sub(last).wrapping_sub(1),
            None => 0,
        };
        self.last = Some(number);
        self.missing = self.missing.saturating_add(left_out.into());
        true
    }

    /// Number of the last one that was used.
    #[must_use]
    pub fn last(&self) -> Option<u8> {
        self.last
    }

    /// How many numbers were left out, since the first that arrived.
    #[must_use]
    pub fn missing(&self) -> u32 {
        self.missing
    }

    /// How many came twice.
    #[must_use]
    pub fn repeated(&self) -> u32 {
        self.repeated
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_repetition_is_dropped_and_what_is_left_out_is_counted() {
        // Number, whether the frame is delayed; whether it is used, and what is missing then.
        let cases = [
            (250, false, true, 0),
            (251, false, true, 0),
            (251, false, false, 0),
            (254, false, true, 2),
            (0, false, true, 3),
            (0, true, true, 258),
            (1, true, true, 258),
            (1, false, false, 258),
        ];
        let mut occurrences = Occurrences::new();
        assert_eq!(occurrences.last(), None);
        for (number, delayed, used, missing) in cases {
            assert_eq!(occurrences.take(number, delayed), used, "{number}");
            assert_eq!(occurrences.missing(), missing, "{number}");
            assert_eq!(occurrences.last(), Some(number));
        }
        assert_eq!(occurrences.repeated(), 2);
    }
}
