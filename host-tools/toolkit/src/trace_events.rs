//! A schedule in Chrome's trace event format, which <https://ui.perfetto.dev> and
//! `chrome://tracing` open.
//!
//! One track a slot, and one for what is free. What is written is a hyperperiod if it has at most
//! [`MAX_ACTIVATIONS`], else the busiest window that has about as many; `otherData` says which.
//! Times are nominal: the origin is the origin of the slots' starts.

use std::collections::BTreeMap;

use serde::Serialize;
use serde_json::{Value, json};

use crate::timetable::{Activation, Extent, Timetable, gaps};

/// Activations in a file, about.
pub const MAX_ACTIVATIONS: u64 = 20_000;

/// The only process: its threads are the tracks.
const PROCESS: u32 = 1;
/// Thread of the track of what is free. It comes last.
const FREE_THREAD: usize = 2;
/// Thread of the first slot; the others follow in their order.
const FIRST_THREAD: usize = 3;

/// An event with a beginning and an end.
#[derive(Serialize)]
struct Complete {
    name: String,
    cat: &'static str,
    ph: &'static str,
    pid: u32,
    tid: usize,
    /// In microseconds.
    ts: u64,
    dur: u64,
    args: Value,
}

/// The schedule as a JSON text, one event a line. `tasks`: names of the tasks of each slot, by its
/// number.
///
/// # Errors
/// Never, for what is written is plain data; the encoder's word is passed on.
pub fn to_json(
    name: &str,
    timetable: &Timetable,
    tasks: &BTreeMap<u32, Vec<String>>,
) -> serde_json::Result<String> {
    let window = timetable.window(timetable.frames_with(MAX_ACTIVATIONS));
    let is_inside = |one: &Activation| {
        let is_real = one.number >= 0;
        is_real && u64::try_from(one.start_us).is_ok_and(|start_us| start_us >= window.start_us)
    };
    let what = timetable.describe(&window);
    let mut lines = vec![
        metadata(
            "process_name",
            0,
            json!({ "name": format!("{name}: {what}") }),
        ),
        metadata(
            "thread_name",
            FREE_THREAD,
            json!({ "name": "slot 0: free" }),
        ),
        metadata(
            "thread_sort_index",
            FREE_THREAD,
            json!({ "sort_index": timetable.slots().len() }),
        ),
    ];
    for (index, slot) in timetable.slots().iter().enumerate() {
        let of_slot = tasks
            .get(&slot.number)
            .map_or_else(String::new, |names| names.join(", "));
        let separator = if of_slot.is_empty() { "" } else { ": " };
        let track = format!("slot {}{separator}{of_slot}", slot.number);
        lines.push(metadata(
            "thread_name",
            FIRST_THREAD + index,
            json!({ "name": track }),
        ));
        lines.push(metadata(
            "thread_sort_index",
            FIRST_THREAD + index,
            json!({ "sort_index": index }),
        ));
    }
    let mut lines = lines
        .iter()
        .map(serde_json::to_string)
        .collect::<Result<Vec<String>, _>>()?;
    // What began before the window, or would have begun before the origin, leaves no gap and is no
    // event.
    let activations: Vec<Activation> = timetable
        .activations(window.start_us, window.end_us())
        .into_iter()
        .filter(|one| one.number >= 0)
        .collect();
    for one in activations.iter().filter(|one| is_inside(one)) {
        let Some(slot) = timetable.slots().get(one.slot) else {
            continue;
        };
        lines.push(serde_json::to_string(&Complete {
            name: format!("slot {}", slot.number),
            cat: "slot",
            ph: "X",
            pid: PROCESS,
            tid: FIRST_THREAD + one.slot,
            ts: u64::try_from(one.start_us).unwrap_or(0),
            dur: slot.duration_us.into(),
            args: json!({
                "slot": slot.number,
                "period_us": slot.period_us,
                "duration_us": slot.duration_us,
                "occurrence": one.number,
            }),
        })?);
    }
    for gap in gaps(&activations, window.start_us, window.end_us()) {
        lines.push(serde_json::to_string(&Complete {
            name: "free".into(),
            cat: "free",
            ph: "X",
            pid: PROCESS,
            tid: FREE_THREAD,
            ts: gap.start_us,
            dur: gap.length_us,
            args: json!({ "duration_us": gap.length_us }),
        })?);
    }
    let other = json!({
        "schedule": name,
        "shown": what,
        "whole_hyperperiod": window.extent == Extent::Hyperperiod,
        "start_us": window.start_us,
        "length_us": window.length_us,
        "busy_us": window.busy_us,
        "hyperperiod_us": timetable.hyperperiod_us(),
    });
    Ok(format!(
        "{{\"displayTimeUnit\":\"ms\",\"otherData\":{other},\"traceEvents\":[\n{}\n]}}\n",
        lines.join(",\n")
    ))
}

fn metadata(name: &str, thread: usize, args: Value) -> Value {
    json!({ "name": name, "ph": "M", "pid": PROCESS, "tid": thread, "args": args })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::samples::numbered_from;

    fn timetable(slots: &[(u32, u32, u32)]) -> Timetable {
        numbered_from(5, slots)
    }

    /// The events of a kind with the track that each is on, after a check of what the format asks
    /// of all.
    fn events(text: &str, phase: &str) -> Vec<(String, Value)> {
        let parsed: Value = serde_json::from_str(text).unwrap();
        let all = parsed["traceEvents"].as_array().unwrap();
        let mut tracks = BTreeMap::new();
        for event in all.iter().filter(|event| event["name"] == "thread_name") {
            let name = event["args"]["name"].as_str().unwrap();
            assert!(
                tracks
                    .insert(event["tid"].as_u64().unwrap(), name.to_owned())
                    .is_none()
            );
        }
        for event in all {
            assert!(
                event["name"].is_string() && event["pid"].is_u64() && event["tid"].is_u64(),
                "{event}"
            );
            match event["ph"].as_str().unwrap() {
                "M" => assert!(event["args"].is_object(), "{event}"),
                "X" => assert!(
                    event["ts"].is_u64() && event["dur"].as_u64().unwrap() > 0,
                    "{event}"
                ),
                other => panic!("{other}"),
            }
        }
        let of_phase = all.iter().filter(|event| event["ph"] == phase);
        of_phase
            .map(|event| {
                let track = tracks.get(&event["tid"].as_u64().unwrap()).cloned();
                (track.unwrap_or_default(), event.clone())
            })
            .collect()
    }

    #[test]
    fn events_are_the_occurrences_of_a_hyperperiod_and_its_gaps() {
        let slots = timetable(&[(0, 20, 2), (2, 20, 4), (36, 40, 3)]);
        let tasks = BTreeMap::from([(6, vec!["Odometry".into(), "Wheel \"speed\"".into()])]);
        let text = to_json("a.esm", &slots, &tasks).unwrap();
        let found: Vec<(String, u64, u64, Option<i64>)> = events(&text, "X")
            .into_iter()
            .map(|(track, event)| {
                let number = event["args"]["occurrence"].as_i64();
                (
                    track,
                    event["ts"].as_u64().unwrap(),
                    event["dur"].as_u64().unwrap(),
                    number,
                )
            })
            .collect();
        let two = "slot 6: Odometry, Wheel \"speed\"";
        let expected = [
            ("slot 5", 0, 2, Some(0)),
            (two, 2, 4, Some(0)),
            ("slot 5", 20, 2, Some(1)),
            (two, 22, 4, Some(1)),
            ("slot 7", 36, 3, Some(0)),
            ("slot 0: free", 6, 14, None),
            ("slot 0: free", 26, 10, None),
            ("slot 0: free", 39, 1, None),
        ];
        assert_eq!(
            found,
            expected.map(|(track, ts, dur, number)| (track.to_owned(), ts, dur, number))
        );
    }

    #[test]
    fn a_hyperperiod_that_is_too_long_gives_its_busiest_window_and_says_so() {
        let primes = [999_983, 999_979, 999_961, 999_959, 999_953, 999_931];
        let primes: Vec<_> = primes
            .iter()
            .zip(0..)
            .map(|(&period, at)| (at * 10, period, 5))
            .collect();
        let slots = timetable(&primes);
        let text = to_json("a.esm", &slots, &BTreeMap::new()).unwrap();
        let parsed: Value = serde_json::from_str(&text).unwrap();
        let other = &parsed["otherData"];
        assert_eq!(
            (&other["whole_hyperperiod"], &other["hyperperiod_us"]),
            (&json!(false), &Value::Null)
        );
        let (start, length) = (
            other["start_us"].as_u64().unwrap(),
            other["length_us"].as_u64().unwrap(),
        );
        let mut activations = 0;
        for (_, event) in events(&text, "X") {
            let (ts, dur) = (
                event["ts"].as_u64().unwrap(),
                event["dur"].as_u64().unwrap(),
            );
            assert!((start..start + length).contains(&ts));
            if event["cat"] == "slot" {
                let args = &event["args"];
                let index = args["slot"].as_u64().unwrap() as usize - 5;
                let (first, period, duration) = primes[index];
                assert_eq!((dur, u64::from(duration)), (5, 5));
                assert_eq!(
                    ts,
                    u64::from(first) + args["occurrence"].as_u64().unwrap() * u64::from(period)
                );
                activations += 1;
            }
        }
        assert!(
            activations <= MAX_ACTIVATIONS && activations > MAX_ACTIVATIONS / 2,
            "{activations}"
        );
    }

    #[test]
    fn a_schedule_of_nothing_is_a_file_too() {
        let text = to_json("a.esm", &timetable(&[]), &BTreeMap::new()).unwrap();
        assert_eq!(events(&text, "M").len(), 3);
    }
}
