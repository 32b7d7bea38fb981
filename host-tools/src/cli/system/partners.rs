//! What the processors of a run know of each other, in figures.

use std::fmt::Write as _;

use serde::Serialize;

use crate::host_run::{Ended, WiredLink};
use crate::medium::PS_IN_US;
use crate::system::declaration::System;
use crate::system::lock_step::Member;
use crate::system::partner::{FrameAccount, Partner, Ran, Way, known};
use crate::system_run::Outcome;

/// What one end of a link knows of the other.
#[derive(Serialize)]
pub struct PartnerSummary {
    /// The other end.
    from: String,
    /// The end that receives.
    to: String,
    /// By how much the partner's clock gains on the processor's own.
    drift_ppm: Option<f64>,
    corrupt: u64,
    other_configuration: u64,
    unknown: u64,
    begun_anew: u64,
    frames: Vec<FrameSummary>,
}

/// What it knows of a frame.
#[derive(Serialize)]
struct FrameSummary {
    frame: String,
    id: u16,
    period_us: u32,
    received: u64,
    lost: u64,
    doubled: u64,
    dropped: u64,
    late: u64,
    age_ms: Option<f64>,
    largest_age_ms: Option<f64>,
}

/// What a figure has behind the point: hundredths of a millionth, microseconds of milliseconds.
fn rounded(value: f64, parts: f64) -> f64 {
    // No zero with a sign.
    libm::round(value * parts) / parts + 0.0
}

impl FrameSummary {
    fn of(account: FrameAccount) -> Self {
        let ms = |us: f64| rounded(us / 1e3, 1e3);
        FrameSummary {
            frame: account.frame,
            id: account.id,
            period_us: account.period_us,
            received: account.received,
            lost: account.lost,
            doubled: account.doubled,
            dropped: account.dropped,
            late: account.late,
            age_ms: account.age_us.map(ms),
            largest_age_ms: account.largest_age_us.map(ms),
        }
    }
}

/// What each end of each link knows of the other, at the end of a run, which is a plant time in
/// microseconds. A processor that was reset knows what has come since.
pub fn summaries(
    system: &System,
    lives: &[(usize, Member)],
    outcome: &Outcome,
    end_us: u64,
) -> Vec<PartnerSummary> {
    let mut summaries = Vec::new();
    for (link, arrived) in system.links.iter().zip(&outcome.arrived) {
        let Some(arrived) = arrived else {
            continue;
        };
        let [first, second] = &link.ends;
        for ((own, other), arrivals) in [(first, second), (second, first)].into_iter().zip(arrived)
        {
            let last = (lives.iter()).rposition(|(index, _)| *index == own.processor);
            let member = last.and_then(|last| lives.get(last));
            let ended = last.and_then(|last| outcome.processors.get(last));
            let (Some((_, member)), Some(Some(ended))) = (member, ended) else {
                continue;
            };
            let Some(declared) = find(&member.mission.links, &own.link) else {
                continue;
            };
            let missions = ran(member, ended, &own.link);
            let local_us = member.life.clock.local_us(end_us.saturating_mul(PS_IN_US));
            let partner = known(arrivals, &missions, &Way::new(link, declared), local_us);
            let name = |end: &crate::system::declaration::End| {
                let processor = system.processors.get(end.processor);
                let processor = processor.map_or("", |it| it.name.text.as_str());
                format!("{processor}.{}", end.link)
            };
            summaries.push(summary(name(other), name(own), partner));
        }
    }
    summaries
}

fn summary(from: String, to: String, partner: Partner) -> PartnerSummary {
    PartnerSummary {
        from,
        to,
        drift_ppm: partner.drift_ppm.map(|ppm| rounded(ppm, 1e2)),
        corrupt: partner.corrupt,
        other_configuration: partner.other_configuration,
        unknown: partner.unknown,
        begun_anew: partner.begun_anew,
        frames: partner.frames.into_iter().map(FrameSummary::of).collect(),
    }
}

fn find<'l>(links: &'l [WiredLink], name: &str) -> Option<&'l WiredLink> {
    links.iter().find(|it| it.name == name)
}

/// The missions that ran on a processor, as one of its links sees them.
fn ran<'m>(member: &'m Member, ended: &Ended, link: &str) -> Vec<Ran<'m>> {
    let then = (member.then.iter()).map(|planned| (&planned.mission, planned.warm));
    let missions = [(&member.mission, false)].into_iter().chain(then);
    (missions.zip(&ended.told.missions))
        .map(|((mission, is_warm), states)| Ran::new(find(&mission.links, link), states, is_warm))
        .collect()
}

/// The same for a person.
pub fn words(partners: &[PartnerSummary]) -> String {
    let mut text = String::new();
    // Writing to a string does not fail.
    for it in partners {
        let drift = match it.drift_ppm {
            Some(ppm) => format!("clock {ppm:+.1} ppm"),
            None => "clock not judged: too few frames".to_owned(),
        };
        let mut wrong = String::new();
        for (count, what) in [
            (it.corrupt, "corrupt"),
            (it.other_configuration, "of another configuration"),
            (it.unknown, "unknown"),
        ] {
            if count > 0 {
                let _ = write!(wrong, ", {count} {what}");
            }
        }
        if it.begun_anew > 0 {
            let _ = write!(wrong, ", numbers began anew {} times", it.begun_anew);
        }
        let _ = writeln!(text, "  {} knows of {}: {drift}{wrong}", it.to, it.from);
        for frame in &it.frames {
            let (name, period_ms) = (&frame.frame, f64::from(frame.period_us) / 1e3);
            let _ = write!(
                text,
                "    {name}, each {period_ms} ms: {} received",
                frame.received
            );
            for (count, what) in [
                (frame.lost, "lost"),
                (frame.doubled, "doubled"),
                (frame.dropped, "dropped"),
            ] {
                if count > 0 {
                    let _ = write!(text, ", {count} {what}");
                }
            }
            if frame.late > 0 {
                let _ = write!(text, ", late {} times", frame.late);
            }
            if let (Some(last), Some(largest)) = (frame.age_ms, frame.largest_age_ms) {
                let _ = write!(text, ", age {last:.1} ms, at most {largest:.1} ms");
            }
            text.push('\n');
        }
    }
    text
}
