//! Instructions of macro steps, counted on the emulated board.
//!
//! The firmware is `boards/lm3s6965/src/bin/bench_bound.rs`; there stands also how a plan is
//! written.

use std::error::Error;
use std::fs;
use std::path::Path;
use std::process::Stdio;
use std::thread;
use std::time::{Duration, Instant};

use host_tools::bound::search::{Change, Input};
use host_tools::qemu::machine;

use crate::benchmark::emulated::emulator;

/// A mission and its macro steps.
pub struct Run<'r> {
    /// The mission.
    pub blob: &'r [u8],
    /// What comes before each macro step.
    pub inputs: &'r [Input],
}

/// Blobs that are longer have no room in the firmware.
pub const MAX_BLOB_BYTES: usize = 24 * 1024;
/// Machines that need more words have no room in the firmware.
pub const MAX_ARENA_WORDS: usize = 4 * 1024;

/// Nanoseconds that an instruction takes, as a power of two.
const SHIFT: u32 = 9;
/// Nanoseconds that a tick takes.
const TICK_NS: u64 = 20;
/// How long the emulator may take.
const LIMIT: Duration = Duration::from_secs(300);

/// Runs all macro steps; gives the instructions of each, run by run.
///
/// # Errors
/// The emulator cannot be started, or the firmware does not come to its end.
pub fn count(firmware: &Path, runs: &[Run<'_>]) -> Result<Vec<Vec<u64>>, Box<dyn Error>> {
    let firmware = firmware.canonicalize()?;
    let folder = tempfile::tempdir()?;
    fs::write(folder.path().join("plan"), plan(runs))?;
    let mut emulator = emulator(machine(), SHIFT, &firmware, folder.path())
        .args(["-serial", "null"])
        .stdin(Stdio::null())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()?;
    let begun = Instant::now();
    let status = loop {
        if let Some(status) = emulator.try_wait()? {
            break status;
        }
        if begun.elapsed() > LIMIT {
            emulator.kill()?;
            emulator.wait()?;
            return Err("the firmware that counts instructions does not come to an end".into());
        }
        thread::sleep(Duration::from_millis(5));
    };
    if !status.success() {
        return Err(format!("the firmware that counts instructions ends with {status}").into());
    }
    let counts = fs::read(folder.path().join("counts"))?;
    let (counts, _) = counts.as_chunks::<4>();
    let mut counts = counts
        .iter()
        .map(|ticks| instructions(u32::from_le_bytes(*ticks)));
    runs.iter()
        .map(|run| {
            let of_run: Vec<u64> = counts.by_ref().take(run.inputs.len()).collect();
            if of_run.len() == run.inputs.len() {
                Ok(of_run)
            } else {
                Err("the firmware has counted less than it was given".into())
            }
        })
        .collect()
}

/// Rounded: reading the clock is exact to a tick, which is a small part of an instruction.
fn instructions(ticks: u32) -> u64 {
    ((u64::from(ticks) * TICK_NS) + (1 << SHIFT) / 2) >> SHIFT
}

fn plan(runs: &[Run<'_>]) -> Vec<u8> {
    let mut plan = Vec::new();
    for run in runs {
        plan.push(b'M');
        plan.extend((run.blob.len() as u32).to_le_bytes());
        plan.extend(run.blob);
        for input in run.inputs {
            plan.push(b'S');
            plan.extend(input.missed.to_le_bytes());
            plan.extend((input.changes.len() as u16).to_le_bytes());
            for &(instance, change) in &input.changes {
                let what = match change {
                    Change::Busy(busy) => u16::from(busy),
                    Change::Exit => 2,
                    Change::Flag(flag, value) => 4 + 2 * flag as u16 + u16::from(value),
                };
                plan.extend((instance as u16).to_le_bytes());
                plan.extend(what.to_le_bytes());
            }
        }
    }
    plan.push(b'E');
    plan
}
