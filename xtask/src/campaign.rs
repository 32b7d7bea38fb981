//! `cargo xtask campaign`: tests of which each run of `cargo xtask test` does a small part, at full
//! length. The book has what came of the last ones.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering::Relaxed};
use std::thread::JoinHandle;
use std::time::Instant;

use crate::firmware::{self, DEFAULT_BIN};
use crate::process::{self, Failure, cargo};
use crate::setup::Toolchain;

/// Keeps the processor busy for as long as it lives.
struct Load {
    ended: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Load {
    fn of(threads: usize) -> Self {
        let ended = Arc::new(AtomicBool::new(false));
        let hog = || {
            let ended = Arc::clone(&ended);
            std::thread::spawn(move || while !ended.load(Relaxed) {})
        };
        let threads = (0..threads).map(|_| hog()).collect();
        Load { ended, threads }
    }
}

impl Drop for Load {
    fn drop(&mut self) {
        self.ended.store(true, Relaxed);
        for thread in self.threads.drain(..) {
            // It cannot have panicked.
            let _ = thread.join();
        }
    }
}

/// A test at full length.
struct Campaign {
    name: &'static str,
    /// What it does, and about how long it takes on two cores.
    what: &'static str,
    package: &'static str,
    /// Which tests: a target of the package, and a part of their names.
    target: &'static [&'static str],
    tests: &'static str,
    /// What says how long it is.
    settings: &'static [(&'static str, &'static str)],
    /// It drives the firmware in the emulator.
    needs_firmware: bool,
    /// So many threads do nothing but keep the processor busy meanwhile.
    hogs: usize,
}

const CAMPAIGNS: &[Campaign] = &[
    Campaign {
        name: "packages",
        what: "each package that is published, built from what was packed (10 min)",
        package: "esm-tests",
        target: &["--test", "packages"],
        tests: "all_that_is_published",
        settings: &[("ESM_PUBLISH_VERIFY", "1")],
        needs_firmware: false,
        hogs: 0,
    },
    Campaign {
        name: "line",
        what: "a million attacks on the line of a robot with a key (10 min)",
        package: "esm-tests",
        target: &["--test", "attack"],
        tests: "",
        settings: &[("ESM_ATTACKS", "1000000")],
        needs_firmware: false,
        hogs: 0,
    },
    Campaign {
        name: "frames",
        what: "a million frames between processors of which up to four bytes are changed (1 min)",
        package: "esm-tests",
        target: &["--test", "frames"],
        tests: "no_damaged_frame",
        settings: &[("ESM_FRAME_DAMAGES", "1000000")],
        needs_firmware: false,
        hogs: 0,
    },
    Campaign {
        name: "systems",
        what: "2 minutes of a rover in two, with boards in the emulator: the traces of boards on the host (5 min)",
        package: "esm-tests",
        target: &["--test", "system"],
        tests: "emulator_leaves_the_trace",
        settings: &[("ESM_SYSTEM_S", "120")],
        needs_firmware: true,
        hogs: 0,
    },
    Campaign {
        name: "drift",
        what: "10 minutes of two boards in the emulator, and 24 h of two on the host, by clocks 200 ppm apart: each frame starts within 50 us, and none is lost (20 min)",
        package: "esm-tests",
        target: &["--test", "system"],
        tests: "frames_start_in_time",
        settings: &[("ESM_DRIFT_S", "600"), ("ESM_DRIFT_HOST_S", "86400")],
        needs_firmware: true,
        hogs: 0,
    },
    Campaign {
        name: "links",
        what: "links of each board in the emulator: over its UART, and in a system (6 min)",
        package: "esm-tests",
        target: &["--test", "system", "--test", "uart_link"],
        tests: "board",
        settings: &[("ESM_LINK_BOARDS", "2"), ("ESM_SYSTEM_S", "120")],
        needs_firmware: true,
        hogs: 0,
    },
    Campaign {
        name: "stops",
        what: "10,000 stops on a full line, in the emulator (40 min)",
        package: "esm-tests",
        target: &["--test", "line_load"],
        tests: "a_stop_on_a_full_line",
        settings: &[("ESM_LOAD_STOPS", "10000")],
        needs_firmware: true,
        hogs: 0,
    },
    Campaign {
        name: "many-stops",
        what: "100,000 stops on a full line of a robot that turns on the spot, in the emulator (6 h)",
        package: "esm-tests",
        target: &["--test", "line_load"],
        tests: "a_stop_on_a_full_line",
        settings: &[
            ("ESM_LOAD_STOPS", "100000"),
            ("ESM_LOAD_MISSION", "tests/data/turns.esm"),
        ],
        needs_firmware: true,
        hogs: 0,
    },
    Campaign {
        name: "load",
        what: "each request at the line's rate for 10 minutes of robot time, in the emulator (20 min)",
        package: "esm-tests",
        target: &["--test", "line_load"],
        tests: "whatever_fills_the_line",
        settings: &[("ESM_LOAD_ALL", "1"), ("ESM_LOAD_SECONDS", "600")],
        needs_firmware: true,
        hogs: 0,
    },
    Campaign {
        name: "records",
        what: "up to four flipped bits in all places of the records, and a million random flashes (15 min)",
        package: "rt-firmware",
        target: &["--lib"],
        tests: "store::damages",
        settings: &[("ESM_RECORD_DAMAGES", "full")],
        needs_firmware: false,
        hogs: 0,
    },
    Campaign {
        name: "liar",
        what: "100,000 sessions with a robot that lies (8 min)",
        package: "esm-tests",
        target: &["--test", "lying_robot"],
        tests: "whatever_a_robot_says",
        settings: &[("ESM_LIAR_SESSIONS", "100000")],
        needs_firmware: false,
        hogs: 0,
    },
    Campaign {
        name: "power-cuts",
        what: "power cut at every fourth operation of the flash, in the emulator (2 min)",
        package: "esm-tests",
        target: &["--test", "power_cuts"],
        tests: "",
        settings: &[("ESM_POWER_CUTS_ONE_IN", "4")],
        needs_firmware: true,
        hogs: 0,
    },
    Campaign {
        name: "boards",
        what: "all missions that ship in all worlds, a minute each, on all boards of QEMU: the traces of the host (15 min)",
        package: "esm-tests",
        target: &["--test", "boards"],
        tests: "every_other_board_in_qemu",
        settings: &[("ESM_BOARDS_ALL_WORLDS", "1"), ("ESM_BOARDS_S", "60")],
        needs_firmware: true,
        hogs: 0,
    },
    Campaign {
        name: "missions",
        what: "all missions that have a goal file, over 100 seeds each: they reach their goals, and touch nothing that they could have avoided (1 min)",
        package: "esm-tests",
        target: &["--test", "bench_missions"],
        tests: "missions_reach_their_goals",
        settings: &[("ESM_BENCH_SEEDS", "100")],
        needs_firmware: false,
        hogs: 0,
    },
    Campaign {
        name: "selftest",
        what: "all pairs of twelve planted faults on each board of QEMU: `esm selftest` finds both (6 min)",
        package: "esm-tests",
        target: &["--test", "selftest"],
        tests: "any_two_faults",
        settings: &[("ESM_SELFTEST_PAIRS", "1")],
        needs_firmware: true,
        hogs: 0,
    },
    Campaign {
        name: "repeatable",
        what: "1,000 runs with uploads on each board, half of them warm, while four threads keep the processor busy: all leave the same bytes (90 min)",
        package: "esm-tests",
        target: &["--test", "repeatable"],
        tests: "two_runs_with_uploads",
        settings: &[("ESM_REPEATS", "500")],
        needs_firmware: true,
        hogs: 4,
    },
];

/// Runs the campaigns of these names; lists them where none is named.
///
/// # Errors
/// [`Failure::Usage`] for a name that is none; what a campaign has found.
pub fn command(
    root: &Path,
    names: &[String],
    toolchain: impl FnOnce() -> Result<Toolchain, Failure>,
) -> Result<(), Failure> {
    let known = |name: &String| CAMPAIGNS.iter().find(|campaign| campaign.name == name);
    if let Some(unknown) = names.iter().find(|name| known(name).is_none()) {
        let all: Vec<_> = CAMPAIGNS.iter().map(|campaign| campaign.name).collect();
        let all = all.join(", ");
        let problem = format!("there is no campaign {unknown}; there are {all}");
        return Err(Failure::Usage(problem));
    }
    if names.is_empty() {
        for Campaign { name, what, .. } in CAMPAIGNS {
            println!("{name:12} {what}");
        }
        return Ok(());
    }
    let campaigns: Vec<_> = names.iter().filter_map(known).collect();
    if campaigns.iter().any(|campaign| campaign.needs_firmware) {
        let bins = [DEFAULT_BIN.to_owned()];
        firmware::build(root, &toolchain()?, firmware::RELEASE, &bins)?;
    }
    for campaign in campaigns {
        let started = Instant::now();
        let load = Load::of(campaign.hogs);
        let mut command = cargo(root);
        command
            .args(["test", "--release", "--package", campaign.package])
            .args(campaign.target)
            .args([campaign.tests, "--", "--nocapture"])
            .envs(campaign.settings.iter().copied());
        process::run(&mut command)?;
        drop(load);
        let minutes = started.elapsed().as_secs_f32() / 60.0;
        println!("campaign {}: passed, {minutes:.1} min", campaign.name);
    }
    Ok(())
}
