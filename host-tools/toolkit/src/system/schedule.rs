//! The schedules of all processors on one time axis: their slots, and the frames of the links
//! between them.
//!
//! Each mission is laid out by itself, from an origin of its own. On plant time the origins are
//! apart, by the `start` of the processors. How far clocks drift is left out: this is how a run
//! begins.

use serde::Serialize;

use super::declaration::{Link, Medium, System};
use crate::inspect::link_rows;
use crate::schedule::utilisation;
use crate::timetable::{TimedSlot, Timetable};
use esm_core::Verified;

/// The schedule of a system, in the form of its JSON.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SystemSchedule {
    /// Least common multiple of all periods in microseconds; `None` where it exceeds 64 bits.
    pub hyperperiod_us: Option<u64>,
    /// The processors, in the file's order.
    pub processors: Vec<ProcessorSlots>,
    /// The links, in the file's order.
    pub links: Vec<LinkUse>,
}

/// The slots of a processor.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ProcessorSlots {
    /// Its name.
    pub processor: String,
    /// The file of its mission.
    pub mission: String,
    /// Plant time of its origin, in microseconds.
    pub origin_us: u64,
    /// Share of its time that slots take.
    pub utilisation: f64,
    /// The slots, in the order of their declarations.
    pub slots: Vec<Placed>,
}

/// What is sent over a link.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LinkUse {
    /// The ends, as `PROCESSOR.LINK`.
    pub ends: [String; 2],
    /// What the medium is.
    pub medium: &'static str,
    /// Share of the medium's time that frames take: the greater one of both directions, or both
    /// together on a bus.
    pub utilisation: f64,
    /// What each end sends.
    pub directions: Vec<SentFrames>,
}

/// The frames that one end of a link sends.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SentFrames {
    /// The end that sends.
    pub from: String,
    /// The end that receives.
    pub to: String,
    /// Plant time of the sender's origin, in microseconds.
    pub origin_us: u64,
    /// Share of its time that the frames take.
    pub utilisation: f64,
    /// The frames, in the order of their declarations.
    pub frames: Vec<Placed>,
}

/// A slot or a frame with its place in time.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Placed {
    /// The slot's number, or the frame's identifier.
    #[serde(rename = "id")]
    pub number: u32,
    /// The name of a frame; the tasks of a slot.
    pub names: Vec<String>,
    /// Its first start in microseconds from the origin, below its period.
    pub start_us: u32,
    /// Its period in microseconds.
    pub period_us: u32,
    /// How long it lasts, in microseconds.
    pub duration_us: u32,
}

/// What is shown together: the slots of a processor, or the frames of an end of a link.
#[derive(Clone, Copy)]
pub struct Group<'s> {
    /// What it is, in words.
    pub heading: GroupName<'s>,
    /// Plant time of its origin, in microseconds.
    pub origin_us: u64,
    /// Share of its time that is taken.
    pub utilisation: f64,
    /// What is in it.
    pub placed: &'s [Placed],
}

/// Whose slots or frames they are.
#[derive(Clone, Copy)]
pub enum GroupName<'s> {
    /// The slots of a processor.
    Processor(&'s str),
    /// The frames from one end to the other.
    Frames(&'s str, &'s str),
}

impl SystemSchedule {
    /// Puts the schedules of all missions together. `blobs` are those of the processors, in their
    /// order; `tasks` gives the names of the tasks in each slot of a processor, by its number.
    ///
    /// One without a blob has no slots, and sends nothing.
    #[must_use]
    pub fn new(
        system: &System,
        blobs: &[Option<&Verified<Vec<u8>>>],
        tasks: &dyn Fn(usize, u32) -> Vec<String>,
    ) -> Self {
        let of_processor = |index: usize| blobs.get(index).copied().flatten();
        let processors = system.processors.iter().enumerate().map(|(index, it)| {
            let tables = of_processor(index).map(Verified::tables);
            let slots = tables.map_or_else(Vec::new, |tables| tables.slots().collect());
            let slots: Vec<Placed> = (slots.into_iter())
                .map(|slot| Placed {
                    number: slot.number,
                    names: tasks(index, slot.number),
                    start_us: slot.start_us,
                    period_us: slot.period_us,
                    duration_us: slot.duration_us,
                })
                .collect();
            ProcessorSlots {
                processor: it.name.text.clone(),
                mission: it.mission.text.clone(),
                origin_us: it.start_us,
                utilisation: taken(&slots),
                slots,
            }
        });
        let links = (system.links.iter()).map(|link| link_use(system, link, &of_processor));
        let mut schedule = SystemSchedule {
            hyperperiod_us: None,
            processors: processors.collect(),
            links: links.collect(),
        };
        schedule.hyperperiod_us = schedule.timetable().hyperperiod_us();
        schedule
    }

    /// The processors, and behind them the directions of all links.
    pub fn groups(&self) -> impl Iterator<Item = Group<'_>> {
        let slots = self.processors.iter().map(|it| Group {
            heading: GroupName::Processor(&it.processor),
            origin_us: it.origin_us,
            utilisation: it.utilisation,
            placed: &it.slots,
        });
        let directions = self.links.iter().flat_map(|it| &it.directions);
        slots.chain(directions.map(|it| Group {
            heading: GroupName::Frames(&it.from, &it.to),
            origin_us: it.origin_us,
            utilisation: it.utilisation,
            placed: &it.frames,
        }))
    }

    /// All of it on plant time, in the order of [`SystemSchedule::groups`], as it is when all
    /// processors run.
    #[must_use]
    pub fn timetable(&self) -> Timetable {
        let timed = self.groups().flat_map(|group| {
            group.placed.iter().map(move |it| {
                let period_us = u64::from(it.period_us.max(1));
                let start_us = (u64::from(it.start_us) + group.origin_us) % period_us;
                TimedSlot {
                    number: it.number,
                    // Below the period, which has so many bits.
                    start_us: start_us as u32,
                    period_us: it.period_us,
                    duration_us: it.duration_us,
                }
            })
        });
        Timetable::new(timed.collect())
    }
}

fn taken(placed: &[Placed]) -> f64 {
    utilisation(placed.iter().map(|it| (it.period_us, it.duration_us)))
}

fn link_use<'b>(
    system: &System,
    link: &Link,
    blob: &dyn Fn(usize) -> Option<&'b Verified<Vec<u8>>>,
) -> LinkUse {
    let ends = link.ends.each_ref().map(|end| {
        let processor = system.processors.get(end.processor);
        let processor = processor.map_or("", |it| it.name.text.as_str());
        format!("{processor}.{}", end.link)
    });
    let sent = |from: usize, to: usize| {
        let end = link.ends.get(from);
        let processor = end.and_then(|end| system.processors.get(end.processor));
        let frames = end.map_or_else(Vec::new, |end| {
            blob(end.processor).map_or_else(Vec::new, |blob| frames(blob, &end.link))
        });
        let name = |end: usize| ends.get(end).cloned().unwrap_or_default();
        SentFrames {
            from: name(from),
            to: name(to),
            origin_us: processor.map_or(0, |it| it.start_us),
            utilisation: taken(&frames),
            frames,
        }
    };
    let directions = vec![sent(0, 1), sent(1, 0)];
    let shares = directions.iter().map(|it| it.utilisation);
    LinkUse {
        utilisation: match link.medium {
            Medium::Can => shares.sum(),
            Medium::Line | Medium::Memory => shares.fold(0.0, f64::max),
        },
        medium: link.medium.name(),
        ends,
        directions,
    }
}

/// What a mission sends over a link.
fn frames(blob: &Verified<Vec<u8>>, name: &str) -> Vec<Placed> {
    let tables = blob.tables();
    let rows = link_rows(&tables).into_iter().zip(tables.links());
    let mut placed = Vec::new();
    for (row, link) in rows.filter(|(row, _)| row.link == name) {
        for frame in row.frames {
            let Some(start_us) = frame.start_us else {
                continue;
            };
            let duration_us = link.duration_us(frame.payload_bytes);
            placed.push(Placed {
                number: frame.id.into(),
                names: vec![frame.frame],
                start_us,
                period_us: frame.period_us,
                // At most its period, as the verifier sees to.
                duration_us: u32::try_from(duration_us).unwrap_or(frame.period_us),
            });
        }
    }
    placed
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::directory_and_blob;
    use crate::system::read::read;

    /// A processor that sends one frame of 16 bytes each 20 ms, and hears another.
    fn mission(sent: u16, heard: u16) -> String {
        format!(
            "interpreter slot 1; slot 1 period 20 ms duration 2 ms;\n\
            slot 2 period 10 ms duration 3 ms;\n\
            link other rate 500000 bps header 6 bytes;\n\
            frame sent {sent} out on other flags a payload 8 bytes period 20 ms;\n\
            frame heard {heard} in on other flags b payload 8 bytes period 20 ms;\n\
            machine M {{ region t {{ task T: other.transmit slot 2; initial -> T; }}\n\
            region h {{ task H: other.receive slot 2; initial -> H; }} }}"
        )
    }

    fn scheduled(words: &str) -> SystemSchedule {
        let text = format!(
            "processor a mission \"a.esm\"; processor b mission \"b.esm\" start 23 ms;\n\
            link a.other to b.other {words};"
        );
        let system = read(&text).0.unwrap();
        let blobs = [mission(1, 2), mission(2, 1)]
            .map(|text| esm_core::verify(directory_and_blob(&text).1).unwrap());
        let blobs: Vec<_> = blobs.iter().map(Some).collect();
        SystemSchedule::new(&system, &blobs, &|_, _| Vec::new())
    }

    #[test]
    fn all_slots_and_frames_are_on_plant_time() {
        let schedule = scheduled("");
        assert_eq!(schedule.hyperperiod_us, Some(20_000));
        let groups: Vec<_> = schedule.groups().collect();
        assert_eq!(groups.len(), 4);
        let starts: Vec<u32> = (schedule.timetable().slots().iter())
            .map(|it| it.start_us)
            .collect();
        let own = |group: usize, at: usize| groups[group].placed[at].start_us;
        // The second begins 3 ms into the others' period of 20 ms.
        assert_eq!(starts[0], own(0, 0));
        assert_eq!(starts[1], own(0, 1));
        assert_eq!(starts[2], (own(1, 0) + 23_000) % 20_000);
        assert_eq!(starts[3], (own(1, 1) + 23_000) % 10_000);
        assert_eq!(starts[4], own(2, 0));
        assert_eq!(starts[5], (own(3, 0) + 23_000) % 20_000);
    }

    #[test]
    fn shares_are_those_of_a_processor_of_a_direction_and_of_a_bus() {
        // 18 bytes of 10 bits at 500,000 bit/s, each 20 ms.
        let one_way = 360.0 / 20_000.0;
        for (words, expected) in [
            ("", one_way),
            ("over memory", one_way),
            ("over can", 2.0 * one_way),
        ] {
            let schedule = scheduled(words);
            for processor in &schedule.processors {
                assert!((processor.utilisation - 0.4).abs() < 1e-9, "{schedule:?}");
            }
            let link = &schedule.links[0];
            assert!((link.utilisation - expected).abs() < 1e-9, "{schedule:?}");
            for sent in &link.directions {
                assert!((sent.utilisation - one_way).abs() < 1e-9, "{schedule:?}");
                assert_eq!(sent.frames[0].duration_us, 360);
            }
        }
    }
}
