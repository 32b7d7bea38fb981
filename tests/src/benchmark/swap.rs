//! Swaps through the firmware: `boards/lm3s6965/src/bin/bench_swap.rs` measures them, told over its
//! serial line what to swap to.

use std::path::Path;

use crate::benchmark::charts;
use crate::benchmark::emulated::Emulated;
use crate::benchmark::report::Swap;
use crate::subject;

/// The mission before each that is measured. Its slots leave all the time to the task that watches.
const WATCH: &str = "task Watch slot 0 {}
interpreter slot 1;
slot 1 period 200 ms duration 50 ms;
machine Watching {
    region below { task Work: Watch; initial -> Work; Work -> Work on *; }
}
";

/// Has the firmware swap to each of the missions that are shipped.
///
/// # Errors
/// What stands in the way, for a person.
pub fn measure(firmware: &Path) -> Result<Vec<Swap>, String> {
    let watch = subject::build(WATCH)?.blob;
    let folder = tempfile::tempdir().map_err(|error| error.to_string())?;
    let (board, mut client) = Emulated::start(firmware, folder.path())?;
    let mut swap_to = |blob: &[u8]| {
        let swapped = client.upload(blob, &mut |_| ());
        swapped.map(drop).map_err(|error| error.to_string())
    };
    for name in charts::SHIPPED {
        swap_to(&watch)?;
        swap_to(&subject::build_file(&charts::shipped(name))?.blob)?;
    }
    let printed = board.printed().map_err(|error| error.to_string())?;
    swaps(&printed).ok_or_else(|| format!("the firmware says:\n{printed}"))
}

/// What the firmware told: a line for each mission that began, of which every second one is
/// measured.
fn swaps(printed: &str) -> Option<Vec<Swap>> {
    let told: Vec<(f64, f64)> = printed
        .lines()
        .filter_map(|line| line.strip_prefix("swap "))
        .map(|numbers| {
            let (link, slot) = numbers.split_once(' ')?;
            Some((link.parse().ok()?, slot.parse().ok()?))
        })
        .collect::<Option<_>>()?;
    let measured = told.iter().skip(1).step_by(2);
    let swaps: Vec<Swap> = charts::SHIPPED
        .iter()
        .zip(measured)
        .map(|(name, (link, slot))| Swap {
            mission: format!("`{name}.esm`"),
            link: *link,
            slot: *slot,
        })
        .collect();
    (swaps.len() == charts::SHIPPED.len()).then_some(swaps)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_second_mission_that_began_is_measured() {
        let printed = "Timer with period zero, disabling\nswap 1 2\nswap 300 40\nswap 5 6\nswap 310 41\nswap 7 8\nswap 320 42\n";
        let swaps = swaps(printed).unwrap();
        let numbers: Vec<_> = swaps.iter().map(|swap| (swap.link, swap.slot)).collect();
        assert_eq!(numbers, [(300.0, 40.0), (310.0, 41.0), (320.0, 42.0)]);
    }

    #[test]
    fn a_firmware_that_stops_early_has_measured_nothing() {
        for printed in ["", "swap 1 2\nswap 3 4\n", "swap 1 2\nswap 3 x\n"] {
            assert!(swaps(printed).is_none(), "{printed}");
        }
    }
}
