//! A run of a system, in figures.

use std::fmt::Write as _;

use serde::Serialize;

use super::partners::{self, PartnerSummary};
use crate::clean::counted;
use crate::host_board;
use crate::host_run::Ended;
use crate::medium::PS_IN_US;
use crate::system::declaration::System;
use crate::system::lock_step::Member;
use crate::system::wiring::Sent;

/// A run in figures.
#[derive(Serialize)]
pub struct Summary {
    pub world: String,
    pub plant_time_s: f64,
    pub distance_m: f64,
    pub collisions: u32,
    pub rooms_entered: Vec<String>,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub interrupted: bool,
    pub processors: Vec<ProcessorSummary>,
    pub lines: Vec<LineSummary>,
    pub links: Vec<PartnerSummary>,
}

/// What one end of a line has sent.
#[derive(Serialize)]
pub struct LineSummary {
    from: String,
    to: String,
    frames: u64,
    /// By how much the first bit of any of them was later than its start, at most.
    latest_us: f64,
}

/// A processor's part of it.
#[derive(Serialize)]
pub struct ProcessorSummary {
    pub processor: String,
    pub mission: String,
    board: String,
    macro_steps: u64,
    transitions: u64,
    pub fault: Option<String>,
    finished_s: Option<f64>,
    slots_missed: u64,
    resets: usize,
}

/// How it ended for each processor, over all its resets.
pub fn summaries(
    system: &System,
    lives: &[(usize, Member)],
    ended: &[Option<Ended>],
) -> Vec<ProcessorSummary> {
    let mut summaries = Vec::new();
    for (index, processor) in system.processors.iter().enumerate() {
        let of_it = lives.iter().zip(ended).filter(|((of, _), _)| *of == index);
        let resets = of_it.clone().count().saturating_sub(1);
        let began = of_it.filter_map(|(_, ended)| ended.as_ref());
        let told = || began.clone().map(|it| &it.told);
        let board = processor.board.as_ref().map(|it| it.text.clone());
        summaries.push(ProcessorSummary {
            processor: processor.name.text.clone(),
            mission: processor.mission.text.clone(),
            board: board.unwrap_or_else(|| host_board::BOARD.to_owned()),
            macro_steps: told().map(|it| it.counts.macro_steps).sum(),
            transitions: told().map(|it| it.counts.transitions).sum(),
            fault: told().find_map(|it| it.fault.clone()),
            finished_s: told()
                .next_back()
                .and_then(|it| Some(it.finished_us? as f64 / 1e6)),
            slots_missed: began.map(|it| it.slots_missed).sum(),
            resets,
        });
    }
    summaries
}

/// What has crossed the lines.
pub fn lines(system: &System, traffic: &[Option<[Sent; 2]>]) -> Vec<LineSummary> {
    let mut lines = Vec::new();
    for (link, sent) in system.links.iter().zip(traffic) {
        let names = link.ends.each_ref().map(|end| {
            let processor = system.processors.get(end.processor);
            let processor = processor.map_or("", |it| it.name.text.as_str());
            format!("{processor}.{}", end.link)
        });
        let [first, second] = names;
        let Some([there, back]) = sent else {
            continue;
        };
        for (from, to, sent) in [(&first, &second, there), (&second, &first, back)] {
            lines.push(LineSummary {
                from: from.clone(),
                to: to.clone(),
                frames: sent.count,
                latest_us: sent.latest_ps as f64 / PS_IN_US as f64,
            });
        }
    }
    lines
}

/// The figures for a person.
pub fn words(summary: &Summary) -> String {
    let mut text = String::new();
    let rooms = match &summary.rooms_entered[..] {
        [] => "none".to_owned(),
        rooms => rooms.join(", "),
    };
    // Writing to a string does not fail.
    let _ = writeln!(
        text,
        "world {}, {:.1} s{}: {:.2} m, {} collisions, rooms {rooms}",
        summary.world,
        summary.plant_time_s,
        if summary.interrupted {
            " (interrupted)"
        } else {
            ""
        },
        summary.distance_m,
        summary.collisions,
    );
    for it in &summary.processors {
        let end = match (&it.fault, it.finished_s) {
            (Some(fault), _) => format!(", ended early: {fault}"),
            (None, Some(finished_s)) => format!(", finished at {finished_s:.3} s"),
            (None, None) => String::new(),
        };
        let _ = writeln!(
            text,
            "  {} ({} on {}): {} macro steps, {} transitions{end}{}{}",
            it.processor,
            it.mission,
            it.board,
            it.macro_steps,
            it.transitions,
            match it.slots_missed {
                0 => String::new(),
                missed => format!(", {missed} slots missed"),
            },
            match it.resets {
                0 => String::new(),
                resets => format!(", {}", counted(resets as u64, "reset")),
            }
        );
    }
    text.push_str(&partners::words(&summary.links));
    text
}
