//! How bad a line is, as far as frames tell that passed or did not, and what chunks do best on it.
//!
//! If one byte in 1/r is corrupt, a frame of n bytes passes with the probability e^(-rn). A chunk
//! of d bytes, in a frame of d + h, brings d·e^(-r(d+h)) in the time of d + h bytes, which is most
//! where d² + h·d = h/r.

/// Bytes of a chunk's frame beside its data, the delimiter in front included.
pub(super) const OVERHEAD: usize = 12;

/// What is taken for known of a line of which nothing is known: so many corrupt bytes of so many.
/// It is good, and the first lost frame makes it look worse.
const FIRST_CORRUPT: f64 = 0.1;
const FIRST_BYTES: f64 = 1_000.0;

/// Older frames count less: a frame of so many bytes would make all before it forgotten.
const MEMORY_BYTES: f64 = 1_000.0;

/// Bytes of a good line for which at least one is taken for corrupt.
const BEST_RATE: f64 = 1e-5;

/// How often a line spoils a byte.
#[derive(Clone, Copy, Debug)]
pub(super) struct Loss {
    corrupt: f64,
    of_bytes: f64,
}

impl Loss {
    /// Of a line of which nothing is known.
    pub(super) const UNKNOWN: Loss = Loss {
        corrupt: FIRST_CORRUPT,
        of_bytes: FIRST_BYTES,
    };

    /// Corrupt bytes by bytes.
    pub(super) fn rate(&self) -> f64 {
        (self.corrupt / self.of_bytes).max(BEST_RATE)
    }

    /// The probability that a chunk of so many bytes passes.
    pub(super) fn passes(&self, chunk: usize) -> f64 {
        libm::exp(-self.rate() * frame_bytes(chunk))
    }

    /// The chunk that brings most, of up to `largest` bytes.
    pub(super) fn best_chunk(&self, largest: usize) -> usize {
        let overhead = OVERHEAD as f64;
        let root = libm::sqrt(overhead * overhead + 4.0 * overhead / self.rate());
        // Saturates.
        let best = libm::round((root - overhead) / 2.0) as usize;
        best.clamp(1, largest.max(1))
    }

    /// A chunk of so many bytes has passed.
    pub(super) fn chunk_passed(&mut self, chunk: usize) {
        self.fade(frame_bytes(chunk));
    }

    /// A chunk of so many bytes was lost: of its bytes one was corrupt, or more, as they are at
    /// this rate.
    pub(super) fn chunk_lost(&mut self, chunk: usize) {
        let expected = self.rate() * frame_bytes(chunk);
        self.fade(frame_bytes(chunk));
        self.corrupt += expected / (1.0 - libm::exp(-expected));
    }

    fn fade(&mut self, bytes: f64) {
        let rest = (1.0 - bytes / MEMORY_BYTES).max(0.0);
        self.corrupt *= rest;
        self.of_bytes = self.of_bytes * rest + bytes;
    }
}

fn frame_bytes(chunk: usize) -> f64 {
    (chunk + OVERHEAD) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_fit_the_line() {
        // What chunks bring on a line of this rate, in parts of its bytes.
        let brought = |rate: f64, chunk: usize| {
            chunk as f64 / frame_bytes(chunk) * libm::exp(-rate * frame_bytes(chunk))
        };
        for rate in [0.001, 0.01, 0.02, 0.05, 0.1, 0.2] {
            let line = Loss {
                corrupt: rate,
                of_bytes: 1.0,
            };
            let best = line.best_chunk(500);
            for other in 1..500 {
                let is_best = brought(rate, other) <= brought(rate, best) * 1.01;
                assert!(is_best, "{rate}: {other} is better than {best}");
            }
        }
        assert_eq!(Loss::UNKNOWN.best_chunk(176), 176);
        assert_eq!(Loss::UNKNOWN.best_chunk(0), 1);
    }

    #[test]
    fn lost_frames_tell_the_rate_whatever_their_length_and_are_forgotten() {
        let mut line = Loss::UNKNOWN;
        // All of the first frames are lost: they are too long to tell more than that.
        for _ in 0..6 {
            line.chunk_lost(line.best_chunk(176));
        }
        assert!(line.best_chunk(176) < 60, "{line:?}");
        // One byte in twenty: of frames of 22 bytes one in three passes.
        for at in 0..300 {
            if at % 3 == 0 {
                line.chunk_passed(10);
            } else {
                line.chunk_lost(10);
            }
        }
        assert!((0.04..0.06).contains(&line.rate()), "{line:?}");
        let mut bytes = 0;
        while line.best_chunk(176) < 176 {
            line.chunk_passed(line.best_chunk(176));
            bytes += line.best_chunk(176);
        }
        assert!((1_000..4_000).contains(&bytes), "{bytes}");
    }
}
