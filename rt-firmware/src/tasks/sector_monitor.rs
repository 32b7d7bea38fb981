//! Watches how far away things are in two sectors of an array of sonars.

use super::values::ArrayRanges;
use crate::ports::Io;
use crate::task;
use crate::task::{Step, Task};

/// Compares the least range of some neighbouring sonars that look ahead with one limit, and that of
/// some that look to a side with two.
///
/// What is unknown is never far: a sector of which a sonar is not known is not `ahead_free`, not
/// `beside_far`, and `beside_near`.
#[derive(Clone, Copy, Debug, Default)]
pub struct SectorMonitor;

task! {
    /// Watches two sectors of the array, ahead and beside the robot: the least range of the sonars
    /// first to last, counted from 1. A sector of which something is not known is near.
    impl SectorMonitor {
        slot 3;
        wcet 100 us;
        endless;
        monitor;
        data {
            /// What is around the robot.
            in ranges: ArrayRanges optional within 400 ms;
        }
        flags {
            /// There are ranges.
            out known;
            /// Ahead there is nothing up to `ahead_mm`.
            out ahead_free;
            /// Beside there is something nearer than `near_mm`, or it is not known.
            out beside_near;
            /// Beside there is nothing up to `far_mm`.
            out beside_far;
        }
        params {
            /// The sector ahead begins with this sonar.
            ahead_first: u32 = 11, 1..=24;
            /// And ends with this one.
            ahead_last: u32 = 15, 1..=24;
            /// In millimetres.
            ahead_mm: u32 = 900, 0..=4000;
            /// The sector beside begins with this sonar.
            beside_first: u32 = 18, 1..=24;
            /// And ends with this one.
            beside_last: u32 = 20, 1..=24;
            /// In millimetres.
            near_mm: u32 = 495, 0..=4000;
            /// In millimetres.
            far_mm: u32 = 900, 0..=4000;
        }
    }
}

impl Task for SectorMonitor {
    fn step(&mut self, io: &mut Io<'_>) -> Step {
        let ahead = io.param(Self::AHEAD_FIRST)..=io.param(Self::AHEAD_LAST);
        let beside = io.param(Self::BESIDE_FIRST)..=io.param(Self::BESIDE_LAST);
        let ranges = io.try_read(Self::RANGES);
        let least_mm = |sector| ranges.map_or(0, |ranges| ranges.least_mm(sector));
        let (ahead_mm, beside_mm) = (least_mm(ahead), least_mm(beside));
        let known = ranges.is_some();
        let ahead_free = ahead_mm > io.param(Self::AHEAD_MM);
        let beside_near = beside_mm == 0 || beside_mm < io.param(Self::NEAR_MM);
        let beside_far = beside_mm > io.param(Self::FAR_MM);
        io.set(Self::KNOWN, known);
        io.set(Self::AHEAD_FREE, ahead_free);
        io.set(Self::BESIDE_NEAR, beside_near);
        io.set(Self::BESIDE_FAR, beside_far);
        Step::Run
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::TaskBench;

    fn flags(bench: &mut TaskBench<'_>) -> [bool; 4] {
        bench.step();
        [
            SectorMonitor::KNOWN,
            SectorMonitor::AHEAD_FREE,
            SectorMonitor::BESIDE_NEAR,
            SectorMonitor::BESIDE_FAR,
        ]
        .map(|flag| bench.flag(flag))
    }

    fn bench() -> TaskBench<'static> {
        let mut bench = TaskBench::new(SectorMonitor);
        bench
            .param(SectorMonitor::AHEAD_FIRST, 11)
            .param(SectorMonitor::AHEAD_LAST, 12)
            .param(SectorMonitor::AHEAD_MM, 900)
            .param(SectorMonitor::BESIDE_FIRST, 18)
            .param(SectorMonitor::BESIDE_LAST, 19)
            .param(SectorMonitor::NEAR_MM, 495)
            .param(SectorMonitor::FAR_MM, 900);
        bench
    }

    #[test]
    fn a_sector_is_as_near_as_its_nearest_and_never_far_where_one_is_unknown() {
        // Sonars 10 to 13 and 17 to 20; of each four the sector has the two in the middle.
        for (ahead, beside, free, near, far) in [
            ([1, 2_000, 901, 1], [1, 700, 495, 1], true, false, false),
            ([1, 2_000, 900, 1], [1, 901, 950, 1], false, false, true),
            ([1, 901, 2_000, 1], [1, 900, 950, 1], true, false, false),
            ([1, 300, 2_000, 1], [1, 494, 950, 1], false, true, false),
            ([1, 2_000, 0, 1], [1, 0, 2_000, 1], false, true, false),
        ] {
            let mut ranges = ArrayRanges::NONE;
            ranges.range_mm[9..13].copy_from_slice(&ahead);
            ranges.range_mm[16..20].copy_from_slice(&beside);
            let mut bench = bench();
            bench.give(SectorMonitor::RANGES, ranges);
            assert_eq!(
                flags(&mut bench),
                [true, free, near, far],
                "{ahead:?} {beside:?}"
            );
        }
    }

    #[test]
    fn without_ranges_and_without_sonars_all_is_near() {
        let mut bench = bench();
        assert_eq!(flags(&mut bench), [false, false, true, false]);
        bench
            .param(SectorMonitor::AHEAD_FIRST, 13)
            .param(SectorMonitor::BESIDE_FIRST, 20)
            .param(SectorMonitor::NEAR_MM, 0);
        let far = ArrayRanges {
            range_mm: [4_000; 24],
        };
        bench.give(SectorMonitor::RANGES, far);
        assert_eq!(flags(&mut bench), [true, false, true, false]);
    }
}
