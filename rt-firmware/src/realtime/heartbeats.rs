//! Heartbeats: the watchdog is fed while all show some who should, and the mission knows for how
//! long the host has shown none.

use core::sync::atomic::Ordering;

use super::RealTime;
use crate::board::Board;

impl RealTime<'_, '_> {
    /// Feeds the watchdog if all have shown that they live who should have.
    #[inline(never)]
    pub(super) fn feed_watchdog<B: Board>(&mut self, board: &mut B, now_ticks: u64) {
        let is_running = self.is_running();
        let slots = &mut self.tasks.lists.slots;
        let mission = self.mission.as_ref();
        let first_silent_slot = || {
            let count = mission.map_or(0, |mission| mission.interpreter.tables().slots().len());
            let mut silent = None;
            for (index, slot) in slots.iter_mut().enumerate().take(count) {
                if !slot.take_executed() {
                    silent.get_or_insert(index);
                }
            }
            silent
        };
        let fed = self.supervision.may_feed(
            now_ticks,
            B::TICKS_PER_US,
            self.heartbeats,
            is_running,
            first_silent_slot,
        );
        match (fed, self.kept) {
            (Ok(()), _) => board.feed_watchdog(),
            (Err(who), Some(kept)) => kept.set_silent(who),
            (Err(_), None) => {}
        }
    }

    /// Looks whether the host has called, in an activation that starts at this robot time.
    pub(super) fn listen(&mut self, robot_us: u64) {
        let requests = self.heartbeats.requests.load(Ordering::Relaxed);
        if requests != self.requests {
            self.requests = requests;
            self.heard_us = robot_us;
        }
        let silent_us = robot_us.saturating_sub(self.heard_us);
        self.executor.inputs().link_silent_us = u32::try_from(silent_us).unwrap_or(u32::MAX);
    }
}
