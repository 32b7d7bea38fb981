//! How often a flash is erased for those who ask, held against who asks without an end.

use std::format;
use std::string::String;

use super::budget::{Allowance, KEYS, RECORDS, UPLOADS};
use super::flash_store::FlashStore;
use super::kept_flash::{
    BLOB_BYTES, ERASE, Flash, WRITE, blank, with_keep_over_resets, with_store,
};
use super::nor::{Chip, Rewrite};
use crate::mission_store::MissionStore;
use crate::realtime::params::SavedParams;
use crate::retained_ram::RetainedRam;
use esm_link::key_store::{KeyStore, STORED_KEY_BYTES, StoredKey, WriteError};
use esm_link::message::{LinkError, ResetReason};

type Broken = String;
type Store<'a> = FlashStore<'a, Chip<WRITE, ERASE>>;

const SECOND_US: u64 = 1_000_000;
const HOUR_US: u64 = 3_600 * SECOND_US;
/// What a flash of the usual kind lasts.
const LIFE: u32 = 10_000;

fn saved(number: u32) -> SavedParams {
    let mut bytes = [0, 0, 0, 1, 7, 0, 0, 0, 0, 0];
    bytes[6..].copy_from_slice(&number.to_le_bytes());
    SavedParams::from_bytes(&bytes)
}

fn chosen(keep: &mut Store<'_>) {
    let mut room = [0; BLOB_BYTES as usize];
    FlashStore::choose(keep, &mut room, |_| true);
}

/// Asks for something, for the time of this number.
type Attack<'a> = &'a dyn Fn(&mut Store<'_>, u32);

const ATTACKS: [(&str, Allowance, Attack<'static>); 4] = [
    ("saves", RECORDS, &|keep, number| {
        let _ = keep.save_params(&saved(number));
    }),
    ("stops and releases", RECORDS, &|keep, number| {
        let _ = keep.set_emergency_stop(number % 2 == 0);
    }),
    ("keys", KEYS, &|keep, number| {
        let _ = keep.write(StoredKey::Key, &[number as u8; STORED_KEY_BYTES]);
    }),
    ("uploads", UPLOADS, &|keep, number| {
        if keep.trial_begins(&number.to_le_bytes()).is_ok() {
            let _ = keep.trial_confirmed(number);
        }
    }),
];

/// Each of these asks once a second for six hours.
fn nobody_wears_it_out() -> Result<(), Broken> {
    const HOURS: u32 = 6;
    for (what, budget, ask) in ATTACKS {
        let allowed = budget.burst + HOURS * budget.per_hour;
        let flash = blank(Rewrite::Refuse);
        let before = flash.borrow().erases;
        let health = with_store(&flash, None, |keep| {
            chosen(keep);
            for number in 0..HOURS * 3_600 {
                keep.tick(u64::from(number) * SECOND_US);
                ask(keep, number);
            }
            keep.flash_health()
        });
        let asked = health.record_erases / 2 + health.mission_erases;
        // One table without records is written before all else, and a stop may be the first.
        if asked > allowed + 2 || asked + 4 < allowed {
            return Err(format!("{what}: {asked} were kept, {allowed} are allowed"));
        }
        // The counters tell what the chip has seen: areas and slots are two units each, halves of
        // the journal one for each five entries.
        let seen = flash.borrow().erases - before;
        let told = 2 * (health.record_erases + health.mission_erases);
        if told > seen || seen > told + told / 20 + 4 {
            return Err(format!("{what}: {told} erases are told, {seen} were seen"));
        }
        // And the next start knows of them.
        let again = with_store(&flash, None, |keep| {
            chosen(keep);
            keep.flash_health()
        });
        if (again.record_erases, again.mission_erases)
            != (health.record_erases, health.mission_erases)
        {
            return Err(format!("{what}: {health:?}, and after a start {again:?}"));
        }
        // A flash lasts weeks of it.
        let weeks = (LIFE - budget.burst) / budget.per_hour / (24 * 7);
        if weeks < 1 {
            return Err(format!("{what}: {weeks} weeks"));
        }
    }
    Ok(())
}

/// Each of these asks as often as it can, forces a reset, and goes on: for as much time as the
/// robot is on, it gets no more than without resets. When power comes, the allowance is full.
fn resets_bring_nothing() -> Result<(), Broken> {
    const RESETS: u32 = 50;
    const SECONDS: u32 = 60;
    for (what, budget, ask) in ATTACKS {
        let retained = RetainedRam::new();
        retained.begin(None);
        let flash = blank(Rewrite::Refuse);
        let asked = |reset: u32| {
            with_keep_over_resets(&flash, None, Some(&retained), |keep| {
                chosen(keep);
                for number in 0..2 * budget.burst {
                    ask(keep, reset * 2 * budget.burst + number);
                }
                keep.tick(u64::from(SECONDS) * SECOND_US);
                let health = keep.flash_health();
                health.record_erases / 2 + health.mission_erases
            })
        };
        let mut kept = 0;
        for reset in 0..RESETS {
            kept = asked(reset);
            retained.begin(Some(ResetReason::Watchdog));
        }
        let allowed = budget.burst + budget.per_hour * (RESETS * SECONDS).div_ceil(3_600);
        if kept > allowed + 2 || kept < budget.burst {
            return Err(format!(
                "{what}: {kept} were kept over resets, {allowed} are allowed"
            ));
        }
        // Power comes: the RAM has anything in it.
        let retained = RetainedRam::new();
        retained.begin(None);
        let again = with_keep_over_resets(&flash, None, Some(&retained), |keep| {
            chosen(keep);
            for number in 0..2 * budget.burst {
                ask(keep, u32::MAX / 2 + number);
            }
            let health = keep.flash_health();
            health.record_erases / 2 + health.mission_erases
        });
        if again < kept + budget.burst - 2 {
            return Err(format!("{what}: {kept}, and after power came {again}"));
        }
    }
    Ok(())
}

/// Whatever was used up, the flash knows of a stop when it is asked for.
fn a_stop_is_kept_always() -> Result<(), Broken> {
    let flash = blank(Rewrite::Refuse);
    with_store(&flash, None, |keep| {
        for number in 0..10 * RECORDS.burst {
            let _ = keep.save_params(&saved(number));
        }
        let refused = keep.save_params(&saved(u32::MAX));
        if !matches!(refused, Err(LinkError::FlashBudget { s: 1.. })) {
            return Err(format!("not used up: {refused:?}"));
        }
        let set = keep.set_emergency_stop(true);
        if set != Ok(()) {
            return Err(format!("{set:?}"));
        }
        Ok(())
    })?;
    is_stopped(&flash, true)?;
    // Pressed and released, it is kept at each press.
    let flash = blank(Rewrite::Refuse);
    for _ in 0..3 * RECORDS.burst {
        with_store(&flash, None, |keep| {
            for _ in 0..RECORDS.burst {
                let _ = keep.set_emergency_stop(false);
                if keep.set_emergency_stop(true) != Ok(()) {
                    return Err(String::from("a stop was not kept"));
                }
            }
            Ok(())
        })?;
        is_stopped(&flash, true)?;
    }
    Ok(())
}

fn is_stopped(flash: &Flash, due: bool) -> Result<(), Broken> {
    match with_store(flash, None, |keep| keep.is_emergency_stopped()) {
        found if found == due => Ok(()),
        found => Err(format!("after a start: stopped {found}")),
    }
}

/// What a release lacks of the allowance it gets with time, unless there is another stop.
fn a_release_is_kept_later() -> Result<(), Broken> {
    for stops_again in [false, true] {
        let flash = blank(Rewrite::Refuse);
        let used_up = |keep: &mut Store<'_>| {
            keep.set_emergency_stop(true).unwrap();
            for number in 0..10 * RECORDS.burst {
                let _ = keep.save_params(&saved(number));
            }
            keep.set_emergency_stop(false)
        };
        let kept = with_store(&flash, None, used_up);
        if kept != Err(LinkError::StopNotStored) {
            return Err(format!("{kept:?}"));
        }
        is_stopped(&flash, true)?;
        with_store(&flash, None, |keep| {
            let _ = used_up(keep);
            if stops_again {
                let _ = keep.set_emergency_stop(true);
            }
            keep.tick(HOUR_US / 60);
            let early = keep.is_emergency_stopped();
            keep.tick(HOUR_US);
            if early {
                Ok(())
            } else {
                Err(String::from("it is kept at once"))
            }
        })?;
        is_stopped(&flash, stops_again)?;
    }
    Ok(())
}

/// Twenty uploads in a row pass, signed or not, with a saved parameter each; and after a refusal
/// the time that was told is enough.
fn ordinary_use_passes() -> Result<(), Broken> {
    let flash = blank(Rewrite::Refuse);
    with_store(&flash, None, |keep| {
        chosen(keep);
        keep.write(StoredKey::Key, &[7; STORED_KEY_BYTES]).unwrap();
        for number in 0..20_u32 {
            let counter = u64::from(number) + 1;
            keep.write(StoredKey::Counter, &counter.to_le_bytes())
                .map_err(|error| format!("{error:?}"))?;
            keep.trial_begins(&number.to_le_bytes())
                .and_then(|()| keep.trial_confirmed(number))
                .and_then(|()| keep.save_params(&saved(number)))
                .map_err(|error| format!("upload {number}: {error:?}"))?;
        }
        let mut now_us = 0;
        for number in 0..3_u8 {
            let refused = (0..=KEYS.burst as u8).find_map(|other| {
                let key = [0x80 | ((KEYS.burst as u8 + 1) * number + other); STORED_KEY_BYTES];
                keep.write(StoredKey::Key, &key).err()
            });
            let Some(WriteError::Budget { s }) = refused else {
                return Err(format!("{refused:?}"));
            };
            now_us += u64::from(s) * SECOND_US;
            keep.tick(now_us);
            keep.write(StoredKey::Key, &[0x40 | number; STORED_KEY_BYTES])
                .map_err(|error| format!("after {s} s: {error:?}"))?;
        }
        Ok(())
    })
}

#[test]
fn who_asks_without_an_end_does_not_wear_the_flash_out() {
    nobody_wears_it_out().unwrap();
}

#[test]
fn who_forces_resets_wears_the_flash_no_more_than_others() {
    resets_bring_nothing().unwrap();
}

#[test]
fn an_emergency_stop_is_kept_whatever_was_used_up() {
    a_stop_is_kept_always().unwrap();
}

#[test]
fn a_release_that_was_put_off_is_kept_later() {
    a_release_is_kept_later().unwrap();
}

#[test]
fn ordinary_use_is_not_hindered() {
    ordinary_use_passes().unwrap();
}
